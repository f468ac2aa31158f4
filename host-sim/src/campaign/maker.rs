//! The maker of cases: draws a setting and effects, finds sizes near the limit of detection, and simulates.
//!
//! A case depends on its seed, its place in the plan and what the plan asks for there, and on nothing else.
use schuler_recording::case::{ExponentialCosine, Markov};

use super::answer::{Answer, Effect, FORMAT, Pair, Parameter};
use super::draw::Draw;
use super::effect::{Concealed, EFFECTS, Entry, Family, Rival, Rule};
use super::likelihood::{Model, Noise, Whitened, project_out};
use super::oracle::{self, Signals, View, half_square};
use super::plan::Group;
use super::setting::{Kind, Setting};
use crate::identify::likelihood::{Correlated, Parameters, Parts, Removed, fit};
use crate::identify::series::Blocks;
use crate::output::Interrupted;
use crate::physics::random::Process;
use crate::scenario::Scenario;
use crate::simulation::{self, Simulated};

/// A case with what the oracle knows of it.
#[derive(Clone, Debug)]
pub struct Made {
    /// Case, recording and truth.
    pub simulated: Simulated,
    /// What was concealed.
    pub answer: Answer,
    /// Gain of taking everything out, nats, row by row of the complete grid; NaN where nothing was recorded.
    pub gain: Vec<f64>,
}

/// Why a case could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Unmade {
    /// The user has stopped it.
    #[error(transparent)]
    Stopped(#[from] Interrupted),
    /// No effect that the plan allows could be put into any setting that it allows.
    #[error("group \"{0}\": none of its effects can be concealed in its settings")]
    Impossible(String),
}

/// Settings tried for an effect before another is drawn.
const TRIES: usize = 40;
/// Effects tried for a case; of those that a setting distorts, few are what they are called.
const MOST_EFFECTS_TRIED: usize = 250;
/// Simulations spent on the size of an effect that is not proportional to it.
const SEARCHES: usize = 8;
/// A found gain may be off the wanted one by this factor.
const CLOSE: f64 = 1.3;
/// Gains beyond which a size is no use, nats.
const USEFUL: [f64; 2] = [2.0, 1e6];
/// Parts of an effect that its formula leaves over and that another finding may rightly name, nats.
const LEFT_OVER_NATS: f64 = 2.0;
/// Share of an effect's gain that may be foreign to its name.
const MOST_FOREIGN: f64 = 0.1;
/// Another name that explains all but so much of an effect is as good as its own, nats: the noise takes one for the other in one
/// case of twenty-five.
const ALIKE_NATS: f64 = 6.0;
/// Share of an effect's gain that nothing else which is concealed may take: where the record does not tell two effects apart, nobody
/// can find both.
const LEAST_OWN: f64 = 0.5;
/// Onsets that the oracle tries over a record before it looks at every row …
const ONSETS: usize = 400;
/// … and so many at once.
const ONSETS_AT_ONCE: usize = 32;
/// A repeated reading tells at least this much, nats.
const REPEATED_NATS: f64 = 1.0;

/// A case under construction.
struct Bench<'c> {
    setting: Setting,
    rows: usize,
    time_s: Vec<f64>,
    /// Outputs without noise and without effects.
    base: Signals,
    check: &'c dyn Fn() -> Result<(), Interrupted>,
}

/// An effect of known size.
struct Sized {
    concealed: Concealed,
    size: f64,
    signals: Signals,
    silent: Option<Simulated>,
}

/// Gains of an effect that begins in each of some rows.
type GainsFrom<'g> = Box<dyn Fn(&[usize]) -> Vec<f64> + 'g>;

/// Makes a case of a group. `check` hears that work goes on and may stop it.
///
/// # Errors
/// The run was stopped, or the group asks for what cannot be.
pub fn make(
    group: &Group,
    index: usize,
    seed: u64,
    check: &dyn Fn() -> Result<(), Interrupted>,
) -> Result<Made, Unmade> {
    let mut draw = Draw::new(seed, "what");
    for attempt in 0..MOST_EFFECTS_TRIED {
        let entries = group.entries();
        let entry = (!entries.is_empty()).then(|| entries[draw.index(entries.len())]);
        let kinds = entry.map_or(Kind::ALL.as_slice(), |entry| entry.kinds);
        let kinds: Vec<Kind> = kinds.iter().copied().filter(|k| group.allows(*k)).collect();
        let Some(kind) = kinds.get(draw.index(kinds.len())).copied() else { continue };
        for _ in 0..TRIES {
            let mut setting_draw = Draw::new(seed, &format!("setting {attempt} {}", draw.between(0.0, 1.0)));
            let setting = Setting::draw(kind, group.most_rows, seed, &mut setting_draw);
            let first = match entry {
                Some(entry) => match (entry.draw)(&setting, &mut draw) {
                    Some(first) => Some(first),
                    None => continue,
                },
                None => None,
            };
            if let Some(made) = conceal(group, index, seed, setting, first, &mut draw, check)? {
                return Ok(made);
            }
            break;
        }
    }
    Err(Unmade::Impossible(group.name.clone()))
}

fn conceal(
    group: &Group,
    index: usize,
    seed: u64,
    setting: Setting,
    first: Option<Concealed>,
    draw: &mut Draw,
    check: &dyn Fn() -> Result<(), Interrupted>,
) -> Result<Option<Made>, Unmade> {
    let bench = Bench::new(setting, check)?;
    let mut effects = Vec::new();
    if let Some(first) = first {
        let Some(sized) = bench.size(first, group.gain_nats, draw)? else { return Ok(None) };
        effects.push(sized);
        let wanted = if group.effects > 1 { 2 + draw.index(group.effects - 1) } else { 1 };
        for _ in 0..TRIES {
            if effects.len() >= wanted {
                break;
            }
            let entries: Vec<&Entry> = group.entries();
            let entry = entries[draw.index(entries.len())];
            if !entry.kinds.contains(&bench.setting.kind) {
                continue;
            }
            let Some(another) = (entry.draw)(&bench.setting, draw) else { continue };
            if !goes_with(&effects, &another) {
                continue;
            }
            let Some(sized) = bench.size(another, group.gain_nats, draw)? else { continue };
            effects.push(sized);
            if !bench.tells_apart(&effects) {
                effects.pop();
            }
        }
        if effects.len() < wanted {
            return Ok(None);
        }
    }
    bench.finish(group, index, seed, &effects, draw).map(Some)
}

/// Whether an effect can stand beside others: one that changes the noise or fails takes its sensor for itself, and no effect comes
/// twice on one sensor.
fn goes_with(effects: &[Sized], another: &Concealed) -> bool {
    let alone = |it: &Concealed| it.noise.is_some() || it.with_noise || it.family == Family::Outside;
    effects.iter().all(|it| {
        let it = &it.concealed;
        let together = it.sensor == another.sensor || it.output == another.output;
        let same = it.effect == another.effect
            || it.same.iter().any(|(_, e)| *e == another.effect)
            || another.same.iter().any(|(_, e)| *e == it.effect);
        !(together && (same || alone(it) || alone(another))) && !(same && it.effect == another.effect)
    })
}

fn zero_like(signals: &Signals) -> Signals {
    signals.iter().map(|(id, v)| (id.clone(), vec![0.0; v.len()])).collect()
}

impl<'c> Bench<'c> {
    fn new(setting: Setting, check: &'c dyn Fn() -> Result<(), Interrupted>) -> Result<Self, Interrupted> {
        let rows = simulation::steps(&setting.scenario);
        let time_s = (1..=rows).map(|k| k as f64 * setting.scenario.step_s).collect();
        let mut it = Self { setting, rows, time_s, base: vec![], check };
        it.base = it.outputs(&it.run(&oracle::silent(&it.setting.scenario))?);
        Ok(it)
    }

    fn run(&self, scenario: &Scenario) -> Result<Simulated, Interrupted> {
        simulation::run(scenario, |k| if k.is_multiple_of(4096) { (self.check)() } else { Ok(()) })
    }

    fn outputs(&self, simulated: &Simulated) -> Signals {
        oracle::outputs(&self.setting, simulated, self.rows)
    }

    fn with(&self, concealed: &Concealed, size: f64) -> Scenario {
        let mut scenario = self.setting.scenario.clone();
        (concealed.inject)(&mut scenario, size);
        scenario
    }

    /// The exact signal of an effect of this size.
    fn signals(&self, concealed: &Concealed, size: f64) -> Result<(Signals, Option<Simulated>), Interrupted> {
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
    fn expected(&self, concealed: &Concealed, size: f64, signals: &Signals) -> f64 {
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
    fn tells_apart(&self, effects: &[Sized]) -> bool {
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

    /// Gain of the true noise against the nominal one, over a simulated record.
    fn noise_gain(&self, concealed: &Concealed, size: f64) -> Result<(f64, Vec<f64>), Interrupted> {
        let scenario = self.with(concealed, size);
        let simulated = self.run(&scenario)?;
        let noise = oracle::difference_or_missing(&self.outputs(&simulated), &self.base);
        Ok(self.noise_gain_of(concealed, size, &noise))
    }

    /// The same for a given noise series of every output; nats in all and row by row.
    fn noise_gain_of(&self, concealed: &Concealed, size: f64, noise: &Signals) -> (f64, Vec<f64>) {
        let Some(change) = &concealed.noise else { return (0.0, vec![0.0; self.rows]) };
        let nominal = |id: &str| self.setting.noise_of(id);
        let changed = |id: &str| {
            let own = nominal(id);
            if id == concealed.output { (change.with)(&own, size) } else { own }
        };
        let mut gain = vec![0.0; self.rows];
        let before = oracle::views(&self.setting, nominal);
        let after = oracle::views(&self.setting, changed);
        for (before, after) in before.iter().zip(&after).filter(|(view, _)| view.has(&concealed.output)) {
            let mut series = before.of(noise, self.rows);
            centre(&mut series, before.relative);
            let fitted = before.noise.as_ref().filter(|_| change.refit);
            let null = fitted.map_or_else(
                || before.model.clone(),
                |it| refitted(it, &series, self.setting.scenario.step_s).model(self.setting.scenario.step_s),
            );
            let (a, b) =
                (null.whiten(&self.time_s, &[&series]), after.model.whiten(&self.time_s, &[&series]));
            for k in 0..self.rows {
                let of =
                    |model: &Model, w: &Whitened| model.log_density(w.innovations[0][k], w.log_variance[k]);
                gain[k] += of(&after.model, &b) - of(&null, &a);
            }
        }
        (gain.iter().filter(|g| g.is_finite()).sum(), gain)
    }

    /// The effect with a size whose gain is as drawn from this range; none if there is no such size.
    fn size(
        &self,
        concealed: Concealed,
        gains: [f64; 2],
        draw: &mut Draw,
    ) -> Result<Option<Sized>, Interrupted> {
        let wanted = draw.log_between(gains[0], gains[1]);
        let mut size = concealed.start;
        let mut best: Option<(f64, f64)> = None;
        for search in 0..SEARCHES {
            let gain = if concealed.noise.is_some() {
                self.noise_gain(&concealed, size)?.0
            } else {
                let (signals, _) = self.signals(&concealed, size)?;
                self.expected(&concealed, size, &signals)
            };
            let off = (gain.max(1e-9) / wanted).ln().abs();
            if gain.is_finite() && best.is_none_or(|(_, before)| off < before) {
                best = Some((size, off));
            }
            if off < CLOSE.ln() || concealed.fixed || (concealed.effect == "output_stuck") {
                break;
            }
            if concealed.linear && gain > 0.0 {
                // The gain is a quadratic form of the signal.
                size *= (wanted / gain).sqrt();
                best = Some((size, 0.0));
                break;
            }
            let factor = if gain > 1e-3 { (wanted / gain).sqrt().clamp(0.1, 10.0) } else { 10.0 };
            // A gain that is a power of the size is met at once; otherwise nearer every time.
            size *= if search > 4 { factor.sqrt() } else { factor };
        }
        let Some((size, _)) = best else { return Ok(None) };
        let (signals, silent) = self.signals(&concealed, size)?;
        let gain = if concealed.noise.is_some() {
            self.noise_gain(&concealed, size)?.0
        } else {
            self.expected(&concealed, size, &signals)
        };
        let most = if concealed.fixed { gains } else { USEFUL };
        let useful = (most[0]..=most[1]).contains(&gain) || concealed.effect == "output_stuck";
        let sized = Sized { concealed, size, signals, silent };
        Ok((useful && size.is_finite() && self.is_what_it_is_called(&sized, gain)).then_some(sized))
    }

    /// Whether the formula by which the effect is called is most of what the physics made of it here; heaters may make a
    /// gradient that has little to do with the temperature's rate.
    fn is_what_it_is_called(&self, it: &Sized, gain: f64) -> bool {
        let views = oracle::views(&self.setting, |id| self.setting.noise_of(id));
        let truth = it.silent.as_ref().map(|s| &s.truth);
        it.concealed.parameters.iter().all(|parameter| match (&parameter.rule, truth) {
            (Rule::Slope(cause), Some(truth)) => {
                self.slope(it, &views, &cause(truth)).1 < (MOST_FOREIGN * gain).max(LEFT_OVER_NATS)
            }
            _ => true,
        }) && truth.is_none_or(|truth| (it.concealed.shows)(truth))
    }

    fn finish(
        &self,
        group: &Group,
        index: usize,
        seed: u64,
        effects: &[Sized],
        draw: &mut Draw,
    ) -> Result<Made, Unmade> {
        let mut scenario = self.setting.scenario.clone();
        for it in effects {
            (it.concealed.inject)(&mut scenario, it.size);
        }
        let mut simulated = self.run(&scenario)?;
        // The user believes what stood before anything was concealed, the step of a converter included.
        simulated.case = simulation::case(&self.setting.scenario);
        let told = self.outputs(&simulated);
        // What is left of the record once everything that is known is taken out.
        let mut noise = oracle::difference_or_missing(&told, &self.base);
        for it in effects {
            oracle::subtract(&mut noise, &it.signals);
        }
        let views = oracle::views(&self.setting, |id| {
            let change = effects.iter().find_map(|it| {
                let change = it.concealed.noise.as_ref().filter(|_| it.concealed.output == id)?;
                Some((change.with)(&self.setting.noise_of(id), it.size))
            });
            change.unwrap_or_else(|| self.setting.noise_of(id))
        });
        let mut gain = vec![f64::NAN; self.rows];
        let mut realised = vec![0.0; effects.len()];
        let mut expected = vec![0.0; effects.len()];
        for view in &views {
            let rest = view.of(&noise, self.rows);
            let signals: Vec<Vec<f64>> = effects.iter().map(|it| view.of(&it.signals, self.rows)).collect();
            let mut series: Vec<&[f64]> = vec![&rest];
            series.extend(signals.iter().map(Vec::as_slice));
            let white = view.whiten(&self.time_s, &series);
            let Some((rest, white)) = white.split_first() else { continue };
            for (j, signal) in white.iter().enumerate() {
                expected[j] += half_square(signal);
                realised[j] += sum(rest.iter().zip(signal).map(|(e, s)| s * e + 0.5 * s * s));
            }
            for k in 0..self.rows {
                if rest[k].is_finite() {
                    let all: f64 = white.iter().map(|s| s[k]).sum();
                    let before = if gain[k].is_finite() { gain[k] } else { 0.0 };
                    gain[k] = before + rest[k] * all + 0.5 * all * all;
                }
            }
        }
        for (j, it) in effects.iter().enumerate() {
            if it.concealed.noise.is_some() {
                let (sum, rows) = self.noise_gain_of(&it.concealed, it.size, &noise);
                (realised[j], expected[j]) = (sum, sum);
                gain.iter_mut().zip(&rows).filter(|(_, r)| r.is_finite()).for_each(|(g, r)| *g += r);
            }
            if it.concealed.effect == "output_stuck" {
                let from = it.concealed.interval_s.map_or(0.0, |i| i[0]);
                let repeated = self.time_s.iter().filter(|t| **t >= from).count() as f64 * REPEATED_NATS;
                realised[j] = realised[j].max(repeated);
                expected[j] = expected[j].max(repeated);
            }
        }
        let mut tolerated = Vec::new();
        let begin_s = simulated.recording.get("t").and_then(|t| t.first()).copied().unwrap_or_default();
        let described = effects
            .iter()
            .enumerate()
            .map(|(j, it)| {
                let onset_s = self.onset(it, &views, &noise)?.map(|time_s| time_s - begin_s);
                let gains = [realised[j], expected[j]];
                Ok(Effect {
                    oracle_onset_s: onset_s,
                    ..self.describe(it, &views, gains, begin_s, &mut tolerated)
                })
            })
            .collect::<Result<Vec<_>, Interrupted>>()?;
        if draw.chance(group.inexact) {
            inexact(&mut simulated, &mut tolerated, draw);
        }
        if let Some(sensor) = simulated.case.sensors.iter_mut().find(|s| s.id == "ins") {
            sensor.axis = Some([1.0, 0.0, 0.0]);
        }
        let answer = Answer {
            format: FORMAT.to_owned(),
            seed,
            index,
            name: group.name.clone(),
            family: effects.first().map_or(Family::Nothing, |it| it.concealed.family),
            setting: self.setting.kind,
            rows: self.rows,
            step_s: self.setting.scenario.step_s,
            effects: described,
            tolerated,
            gain_nats: if effects.is_empty() { 0.0 } else { sum(gain.iter().copied()) },
        };
        Ok(Made { simulated, answer, gain })
    }

    /// What the answer says of an effect of which taking it out gains this, and on average this; times count from the beginning
    /// of the recording.
    fn describe(
        &self,
        it: &Sized,
        views: &[View],
        [gain_nats, expected_gain_nats]: [f64; 2],
        begin_s: f64,
        tolerated: &mut Vec<Pair>,
    ) -> Effect {
        let c = &it.concealed;
        let mut form_error_nats = 0.0;
        let mut parameters = Vec::new();
        for parameter in &c.parameters {
            let value = match &parameter.rule {
                Rule::Sized(per) => {
                    // Sizes whose sign has no meaning are taken without it by those who use them.
                    if c.linear { it.size * per } else { it.size.abs() * per }
                }
                Rule::Fixed(value) => *value,
                Rule::Instant(time_s) => time_s - begin_s,
                Rule::Slope(cause) => {
                    let Some(truth) = it.silent.as_ref().map(|s| &s.truth) else { continue };
                    let (slope, left) = self.slope(it, views, &cause(truth));
                    form_error_nats = left;
                    let Some(factor) = super::unit_text::si_factor(&parameter.unit) else { continue };
                    slope / factor
                }
            };
            parameters.push(Parameter {
                name: parameter.name.to_owned(),
                value,
                unit: parameter.unit.clone(),
            });
        }
        tolerated.extend(c.tolerated.iter().map(|(sensor, effect)| Pair::new(sensor, effect)));
        let mut same: Vec<Pair> = c.same.iter().map(|(sensor, effect)| Pair::new(sensor, effect)).collect();
        let alike = c.rivals.iter().filter(|rival| self.left_by(it, views, rival) < ALIKE_NATS);
        same.extend(alike.map(|rival| Pair::new(&rival.sensor, rival.effect)));
        if form_error_nats > LEFT_OVER_NATS {
            tolerated.push(Pair::new(&c.sensor, "*"));
        }
        let view = views.iter().find(|v| v.has(&c.output));
        let mut time = view.and_then(|v| v.noise.as_ref()).map_or(0.0, Noise::correlation_time_s);
        if let Some(channel) = &self.setting.channel {
            time = channel.accelerometer.correlation_time_s().max(channel.gyro.correlation_time_s());
        }
        Effect {
            sensor: c.sensor.clone(),
            effect: c.effect.to_owned(),
            family: c.family,
            same,
            interval_s: c.interval_s.map(|interval| interval.map(|time_s| time_s - begin_s)),
            oracle_onset_s: None,
            parameters,
            gain_nats,
            expected_gain_nats,
            form_error_nats,
            correlation_time_s: time,
        }
    }

    /// Where the likelihood of an effect that begins at some time is largest, its shape and the noise known, its size free (of a
    /// change of noise the true one); none for one that acts all the time. `noise`: the outputs without any effect.
    fn onset(&self, it: &Sized, views: &[View], noise: &Signals) -> Result<Option<f64>, Interrupted> {
        let Some([from_s, _]) = it.concealed.interval_s else { return Ok(None) };
        if it.concealed.effect == "output_stuck" {
            // A value that is repeated shows itself.
            return Ok(Some(from_s));
        }
        let step_s = self.setting.scenario.step_s;
        let first_s = from_s - (from_s / step_s).floor() * step_s;
        let gains = if it.concealed.noise.is_some() {
            self.gains_of_noise_from(it, views, noise, first_s)
        } else {
            self.gains_of_signal_from(it, views, noise, first_s)?
        };
        let best_of = |rows: Vec<usize>| -> Result<usize, Interrupted> {
            let mut best = (f64::NEG_INFINITY, 0);
            for some in rows.chunks(ONSETS_AT_ONCE) {
                (self.check)()?;
                let better = |best: (f64, usize), (row, gain)| if gain > best.0 { (gain, row) } else { best };
                best = some.iter().copied().zip(gains(some)).fold(best, better);
            }
            Ok(best.1)
        };
        let stride = (self.rows / ONSETS).max(1);
        let coarse = best_of((0..self.rows).step_by(stride).collect())?;
        let best = best_of((coarse.saturating_sub(stride)..(coarse + stride).min(self.rows)).collect())?;
        Ok(Some(first_s + best as f64 * step_s))
    }

    /// Log-likelihoods of a change of noise that begins so many rows after `first_s`.
    fn gains_of_noise_from<'g>(
        &'g self,
        it: &Sized,
        views: &'g [View],
        noise: &Signals,
        first_s: f64,
    ) -> GainsFrom<'g> {
        let seen: Vec<(&View, Vec<f64>)> = (views.iter().filter(|view| view.has(&it.concealed.output)))
            .map(|view| {
                let mut series = view.of(noise, self.rows);
                centre(&mut series, view.relative);
                (view, series)
            })
            .collect();
        let step_s = self.setting.scenario.step_s;
        let likelihood = move |row: &usize| {
            let onset_s = first_s + *row as f64 * step_s;
            seen.iter()
                .map(|(view, series)| view.model.later(onset_s).log_likelihood(&self.time_s, series))
                .sum()
        };
        Box::new(move |rows| rows.iter().map(&likelihood).collect())
    }

    /// Gains of an effect of any size that begins so many rows after `first_s`. Its response does not depend on when it begins, so
    /// the earliest, moved, is that to every later onset.
    fn gains_of_signal_from<'g>(
        &'g self,
        it: &Sized,
        views: &'g [View],
        noise: &Signals,
        first_s: f64,
    ) -> Result<GainsFrom<'g>, Interrupted> {
        let mut earliest = self.with(&it.concealed, it.size);
        let before = self.setting.scenario.faults.len();
        earliest.faults.iter_mut().skip(before).for_each(|entry| entry.fault.onset_s = first_s);
        let earliest = self.outputs(&self.run(&oracle::silent(&earliest))?);
        let earliest = oracle::difference(&earliest, &self.base);
        let seen: Vec<(&View, Vec<f64>, Vec<f64>)> = (views.iter())
            .map(|view| {
                let signal = view.of(&it.signals, self.rows);
                let mut told = view.of(noise, self.rows);
                told.iter_mut().zip(signal).for_each(|(sum, signal)| *sum += signal);
                (view, told, view.of(&earliest, self.rows))
            })
            .collect();
        Ok(Box::new(move |rows| {
            let mut sums = vec![[0.0; 2]; rows.len()];
            for (view, told, earliest) in &seen {
                let late = |row: &usize| std::iter::repeat_n(0.0, *row).chain(earliest.iter().copied());
                let moved: Vec<Vec<f64>> =
                    rows.iter().map(|row| late(row).take(self.rows).collect()).collect();
                let series: Vec<&[f64]> =
                    std::iter::once(told.as_slice()).chain(moved.iter().map(Vec::as_slice)).collect();
                let white = view.whiten(&self.time_s, &series);
                let Some((told, moved)) = white.split_first() else { continue };
                for ([cross, square], signal) in sums.iter_mut().zip(moved) {
                    *cross += sum(told.iter().zip(signal).map(|(e, s)| e * s));
                    *square += sum(signal.iter().map(|s| s * s));
                }
            }
            let gain =
                |[cross, square]: [f64; 2]| if square > 0.0 { 0.5 * cross * cross / square } else { 0.0 };
            sums.into_iter().map(gain).collect()
        }))
    }

    /// Slope of the exact signal over its cause by generalised least squares with a constant, SI units, and what is left, nats.
    fn slope(&self, it: &Sized, views: &[View], cause: &[f64]) -> (f64, f64) {
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
    fn left_by(&self, it: &Sized, views: &[View], rival: &Rival) -> f64 {
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

fn sum(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|v| v.is_finite()).sum()
}

fn centre(series: &mut [f64], relative: bool) {
    if relative {
        let n = series.iter().filter(|v| v.is_finite()).count().max(1) as f64;
        let mean = sum(series.iter().copied()) / n;
        for v in series.iter_mut() {
            *v -= mean;
        }
    }
}

/// Noise of the same structure, fitted to a series by maximum likelihood: what the null model would make of it.
fn refitted(nominal: &Noise, series: &[f64], step_s: f64) -> Noise {
    let mut parts = Parts::default();
    for process in &nominal.drift {
        match process {
            Process::Markov { .. } | Process::Flicker { .. } => parts.markov = 1,
            Process::ExponentialCosine { .. } => parts.cosine = true,
            Process::RandomWalk { .. } => parts.walk = true,
        }
    }
    let n = series.iter().filter(|v| v.is_finite()).count().max(1) as f64;
    let spread = (sum(series.iter().map(|v| v * v)) / n).sqrt();
    let mut start = Parameters { white: nominal.white, ..Parameters::default() };
    for process in &nominal.drift {
        match *process {
            Process::Markov { sigma, tau_s } => {
                start.markov[0] = Correlated { sigma, alpha: step_s / tau_s };
            }
            Process::ExponentialCosine { sigma, alpha, beta } => {
                start.cosine = Correlated { sigma, alpha: alpha * step_s };
                start.beta = beta * step_s;
            }
            Process::RandomWalk { rate } => start.walk = rate * step_s.sqrt(),
            Process::Flicker { .. } => {}
        }
    }
    let mut starts = vec![start];
    for slower in [0.1, 0.3, 3.0] {
        let mut other = start;
        other.markov[0] = Correlated { sigma: spread, alpha: start.markov[0].alpha * slower };
        other.cosine.sigma = spread;
        starts.push(other);
    }
    let rows = Blocks::new(series, 1);
    let Some(fitted) = fit(&rows, parts, Removed::Mean, &starts) else { return nominal.clone() };
    let p = fitted.parameters;
    let mut drift = Vec::new();
    if parts.markov > 0 && p.markov[0].alpha > 0.0 {
        drift.push(Process::Markov { sigma: p.markov[0].sigma, tau_s: step_s / p.markov[0].alpha });
    }
    if parts.cosine {
        let (alpha, beta) = (p.cosine.alpha / step_s, p.beta / step_s);
        drift.push(Process::ExponentialCosine { sigma: p.cosine.sigma, alpha, beta });
    }
    if parts.walk {
        drift.push(Process::RandomWalk { rate: p.walk / step_s.sqrt() });
    }
    Noise { white: p.white, drift, ..Noise::default() }
}

/// Lets the user know the noise a little wrong, as from another run; findings that say so are not wrong.
fn inexact(simulated: &mut Simulated, tolerated: &mut Vec<Pair>, draw: &mut Draw) {
    let mut off = |share: f64| 1.0 + share * (2.0 * draw.between(0.0, 1.0) - 1.0);
    for sensor in &mut simulated.case.sensors {
        let nominal = &mut sensor.nominal;
        nominal.white *= off(0.03);
        nominal.markov =
            nominal.markov.map(|m| Markov { sigma: m.sigma * off(0.1), tau_s: m.tau_s * off(0.15) });
        nominal.exp_cos = nominal.exp_cos.map(|m| ExponentialCosine {
            sigma: m.sigma * off(0.1),
            alpha: m.alpha * off(0.15),
            beta: m.beta * off(0.05),
        });
        nominal.random_walk *= off(0.1);
        for effect in ["noise_white", "noise_markov", "noise_exp_cos", "noise_random_walk"] {
            tolerated.push(Pair::new(&sensor.id, effect));
        }
    }
}

/// The entries of the catalogue of makers that a list of names or families asks for.
pub fn entries(names: &[String], families: &[Family]) -> Vec<&'static Entry> {
    EFFECTS
        .iter()
        .filter(|e| families.contains(&e.family) || names.iter().any(|name| name == e.effect))
        .collect()
}
