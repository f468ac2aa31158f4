//! The record of a case, and the answer to it.
use crate::campaign::unit_text;
use schuler_recording::case::{ExponentialCosine, Markov};

use super::bench::{Bench, Sized, sum};
use super::formula::{ALIKE_NATS, LEFT_OVER_NATS};
use super::{Made, Order, Unmade};
use crate::campaign::answer::{Answer, Effect, FORMAT, Pair, Parameter};
use crate::campaign::draw::Draw;
use crate::campaign::effect::{Family, Rule};
use crate::campaign::likelihood::Noise;
use crate::campaign::oracle::{self, View, half_square};
use crate::output::Interrupted;
use crate::simulation::{self, Simulated};

/// A repeated reading tells at least this much, nats.
const REPEATED_NATS: f64 = 1.0;

impl Bench<'_> {
    /// Simulates the record and describes what it conceals.
    pub(super) fn finish(
        &self,
        order: &Order<'_>,
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
        if draw.chance(order.group.inexact) {
            inexact(&mut simulated, &mut tolerated, draw);
        }
        if let Some(sensor) = simulated.case.sensors.iter_mut().find(|s| s.id == "ins") {
            sensor.axis = Some([1.0, 0.0, 0.0]);
        }
        let answer = Answer {
            format: FORMAT.to_owned(),
            seed: order.seed,
            index: order.index,
            name: order.group.name.clone(),
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
                    let Some(factor) = unit_text::si_factor(&parameter.unit) else { continue };
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
