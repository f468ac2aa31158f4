//! A case under construction: its setting, and what an effect of some size does to its outputs.
use crate::campaign::effect::Concealed;
use crate::campaign::oracle::{self, Signals, half_square};
use crate::campaign::setting::Setting;
use crate::output::Interrupted;
use crate::scenario::Scenario;
use crate::simulation::{self, Simulated};

/// Share of an effect's gain that nothing else which is concealed may take: where the record does not tell two effects apart, nobody
/// can find both.
const LEAST_OWN: f64 = 0.5;

/// A case under construction.
pub(super) struct Bench<'c> {
    pub(super) setting: Setting,
    pub(super) rows: usize,
    pub(super) time_s: Vec<f64>,
    /// Outputs without noise and without effects.
    pub(super) base: Signals,
    pub(super) check: &'c dyn Fn() -> Result<(), Interrupted>,
}

/// An effect of known size.
pub(super) struct Sized {
    pub(super) concealed: Concealed,
    pub(super) size: f64,
    pub(super) signals: Signals,
    pub(super) silent: Option<Simulated>,
}

impl<'c> Bench<'c> {
    pub(super) fn new(
        setting: Setting,
        check: &'c dyn Fn() -> Result<(), Interrupted>,
    ) -> Result<Self, Interrupted> {
        let rows = simulation::steps(&setting.scenario);
        let time_s = (1..=rows).map(|k| k as f64 * setting.scenario.step_s).collect();
        let mut it = Self { setting, rows, time_s, base: vec![], check };
        it.base = it.outputs(&it.run(&oracle::silent(&it.setting.scenario))?);
        Ok(it)
    }

    pub(super) fn run(&self, scenario: &Scenario) -> Result<Simulated, Interrupted> {
        simulation::run(scenario, |k| if k.is_multiple_of(4096) { (self.check)() } else { Ok(()) })
    }

    pub(super) fn outputs(&self, simulated: &Simulated) -> Signals {
        oracle::outputs(&self.setting, simulated, self.rows)
    }

    pub(super) fn with(&self, concealed: &Concealed, size: f64) -> Scenario {
        let mut scenario = self.setting.scenario.clone();
        (concealed.inject)(&mut scenario, size);
        scenario
    }

    /// The exact signal of an effect of this size.
    pub(super) fn signals(
        &self,
        concealed: &Concealed,
        size: f64,
    ) -> Result<(Signals, Option<Simulated>), Interrupted> {
        let with = self.with(concealed, size);
        if concealed.with_noise {
            let a = self.run(&oracle::exact(&with))?;
            let b = self.run(&oracle::exact(&self.setting.scenario))?;
            return Ok((oracle::difference(&self.outputs(&a), &self.outputs(&b)), None));
        }
        if concealed.noise.is_some() {
            return Ok((zero_like(&self.base), None));
        }
        let simulated = self.run(&oracle::silent(&with))?;
        Ok((oracle::difference(&self.outputs(&simulated), &self.base), Some(simulated)))
    }

    /// Average gain of an effect whose signal is known.
    pub(super) fn expected(&self, concealed: &Concealed, size: f64, signals: &Signals) -> f64 {
        let mask = oracle::mask(&self.with(concealed, size).gaps, self.setting.scenario.step_s, self.rows);
        let views = oracle::views(&self.setting, |id| self.setting.noise_of(id));
        views
            .iter()
            .map(|view| {
                let signal = view.of(signals, self.rows);
                if signal.iter().all(|v| *v == 0.0) {
                    return 0.0;
                }
                view.whiten(&self.time_s, &[&mask, &signal]).get(1).map_or(0.0, |s| half_square(s))
            })
            .sum()
    }

    /// Whether most of what each effect gains is its own, and would be left were the sizes of the others free.
    pub(super) fn tells_apart(&self, effects: &[Sized]) -> bool {
        let mut scenario = self.setting.scenario.clone();
        for it in effects {
            (it.concealed.inject)(&mut scenario, it.size);
        }
        let mask = oracle::mask(&scenario.gaps, self.setting.scenario.step_s, self.rows);
        let mut white = vec![Vec::new(); effects.len()];
        for view in oracle::views(&self.setting, |id| self.setting.noise_of(id)) {
            let signals: Vec<Vec<f64>> = effects.iter().map(|it| view.of(&it.signals, self.rows)).collect();
            let series: Vec<&[f64]> =
                std::iter::once(mask.as_slice()).chain(signals.iter().map(Vec::as_slice)).collect();
            let all = view.whiten(&self.time_s, &series);
            white.iter_mut().zip(all.iter().skip(1)).for_each(|(own, seen)| own.extend(seen));
        }
        oracle::own_shares(&white).iter().all(|share| *share >= LEAST_OWN)
    }
}

fn zero_like(signals: &Signals) -> Signals {
    signals.iter().map(|(id, v)| (id.clone(), vec![0.0; v.len()])).collect()
}

/// Sum of what is finite.
pub(super) fn sum(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|v| v.is_finite()).sum()
}
