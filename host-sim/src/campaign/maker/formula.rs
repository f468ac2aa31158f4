//! How well the formula by which an effect is called describes it, and how well that of another does.
use super::bench::{Bench, Sized, sum};
use crate::campaign::effect::{Rival, Rule};
use crate::campaign::likelihood::project_out;
use crate::campaign::oracle::{self, Signals, View};
use crate::campaign::setting::Kind;

/// Parts of an effect that its formula leaves over and that another finding may rightly name, nats.
pub(super) const LEFT_OVER_NATS: f64 = 2.0;
/// Share of an effect's gain that may be foreign to its name.
const MOST_FOREIGN: f64 = 0.1;
/// Another name that explains all but so much of an effect is as good as its own, nats: the noise takes one for the other in one
/// case of twenty-five.
pub(super) const ALIKE_NATS: f64 = 6.0;

impl Bench<'_> {
    /// Whether the formula by which the effect is called is most of what the physics made of it here; heaters may make a
    /// gradient that has little to do with the temperature's rate.
    pub(super) fn is_what_it_is_called(&self, it: &Sized, gain: f64) -> bool {
        let views = oracle::views(&self.setting, |id| self.setting.noise_of(id));
        let truth = it.silent.as_ref().map(|s| &s.truth);
        it.concealed.parameters.iter().all(|parameter| match (&parameter.rule, truth) {
            (Rule::Slope(cause), Some(truth)) => {
                self.slope(it, &views, &cause(truth)).1 < (MOST_FOREIGN * gain).max(LEFT_OVER_NATS)
            }
            _ => true,
        }) && truth.is_none_or(|truth| (it.concealed.shows)(truth))
    }

    /// Slope of the exact signal over its cause by generalised least squares with a constant, SI units, and what is left, nats.
    pub(super) fn slope(&self, it: &Sized, views: &[View], cause: &[f64]) -> (f64, f64) {
        let output = &it.concealed.output;
        if self.setting.kind == Kind::Channel {
            return (Self::instrument_slope(it, cause), 0.0);
        }
        let mask = oracle::mask(&self.setting.scenario.gaps, self.setting.scenario.step_s, self.rows);
        let ones = vec![1.0; self.rows];
        let (mut cross, mut square, mut left) = (0.0, 0.0, 0.0);
        let mut whitened = Vec::new();
        for view in views.iter().filter(|v| v.has(output)) {
            let of = |series: &[f64]| view.of(&vec![(output.clone(), series.to_vec())], self.rows);
            let signal = view.of(&it.signals, self.rows);
            let mut white = view.whiten(&self.time_s, &[&mask, &signal, &of(cause), &of(&ones)]);
            let constant = white.pop().unwrap_or_default();
            let mut cause = white.pop().unwrap_or_default();
            let mut signal = white.pop().unwrap_or_default();
            project_out(&mut cause, &constant);
            project_out(&mut signal, &constant);
            cross += sum(signal.iter().zip(&cause).map(|(s, c)| s * c));
            square += sum(cause.iter().map(|c| c * c));
            whitened.push((signal, cause));
        }
        let slope = if square > 0.0 { cross / square } else { 0.0 };
        for (signal, cause) in &whitened {
            left += 0.5 * sum(signal.iter().zip(cause).map(|(s, c)| (s - slope * c).powi(2)));
        }
        (slope, left)
    }

    /// The same inside the Schuler loop, where the instrument's error itself is known.
    fn instrument_slope(it: &Sized, cause: &[f64]) -> f64 {
        let Some(truth) = it.silent.as_ref().map(|s| &s.truth) else { return 0.0 };
        let error = truth.get(&format!("{}.error", it.concealed.output)).unwrap_or_default();
        let n = error.len().min(cause.len()).max(1) as f64;
        let (me, mc) = (error.iter().sum::<f64>() / n, cause.iter().sum::<f64>() / n);
        let (cross, square) = error
            .iter()
            .zip(cause)
            .fold((0.0, 0.0), |(x, s), (e, c)| (x + (e - me) * (c - mc), s + (c - mc) * (c - mc)));
        if square > 0.0 { cross / square } else { 0.0 }
    }

    /// What another name for an effect leaves of it at best, nats.
    pub(super) fn left_by(&self, it: &Sized, views: &[View], rival: &Rival) -> f64 {
        let Some(truth) = it.silent.as_ref().map(|s| &s.truth) else { return f64::INFINITY };
        let columns: Signals = rival.columns.iter().map(|(id, cause)| (id.clone(), cause(truth))).collect();
        let mask = oracle::mask(&self.setting.scenario.gaps, self.setting.scenario.step_s, self.rows);
        let (mut own, mut cross, mut square) = (0.0, 0.0, 0.0);
        for view in views {
            let (signal, column) = (view.of(&it.signals, self.rows), view.of(&columns, self.rows));
            let white = view.whiten(&self.time_s, &[&mask, &signal, &column]);
            let [_, signal, column] = white.as_slice() else { continue };
            own += sum(signal.iter().map(|s| s * s));
            cross += sum(signal.iter().zip(column).map(|(s, c)| s * c));
            square += sum(column.iter().map(|c| c * c));
        }
        0.5 * (own - if square > 0.0 { cross * cross / square } else { 0.0 })
    }
}
