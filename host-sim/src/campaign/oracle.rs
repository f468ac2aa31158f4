//! The oracle: it knows the effect's exact signal and the true noise, and tells what taking the effect out gains.
//!
//! The signal is the difference of two simulations that have the same motion and surroundings, one with the effect and one
//! without it; nothing of the effect's formula is used. See [`super::likelihood`] for the gain.
use nalgebra::{DMatrix, Matrix3, Vector3};

use super::likelihood::{Model, Noise, project_out};
use super::setting::{Kind, Setting};
use crate::physics::fault::Fault;
use crate::physics::readout::{Conversion, ReadoutDesign};
use crate::scenario::{ErrorSource, Scenario};
use crate::simulation::Simulated;

/// One series in which effects can be seen: a sum of outputs, and its noise.
#[derive(Clone, Debug)]
pub struct View {
    /// Outputs with their weights.
    pub weights: Vec<(String, f64)>,
    /// Noise of the series; none for the loop's velocity, which has its own.
    pub noise: Option<Noise>,
    /// Whether a constant is free.
    pub relative: bool,
    /// Its model.
    pub model: Model,
}

/// Signals of outputs, SI units, on the complete grid.
pub type Signals = Vec<(String, Vec<f64>)>;

/// The views of a setting, with the noise of each output as given.
pub fn views(setting: &Setting, noise_of: impl Fn(&str) -> Noise) -> Vec<View> {
    let step = setting.scenario.step_s;
    let view = |weights: Vec<(String, f64)>, noise: Noise, relative: bool| View {
        model: noise.model(step),
        noise: Some(noise),
        weights,
        relative,
    };
    match setting.kind {
        Kind::Channel => {
            let id = "velocity_error".to_owned();
            // The noise of the loop's own velocity may be other than the channel says.
            let model = setting.channel.as_ref().map(|it| {
                let mut it = it.clone();
                let noise = noise_of(&id);
                (it.velocity_white, it.spikes) = (noise.white, noise.spikes);
                it.model(step)
            });
            model
                .map(|model| View { weights: vec![(id, 1.0)], noise: None, relative: false, model })
                .into_iter()
                .collect()
        }
        Kind::Radio => {
            let noise = noise_of("doppler").plus(&noise_of("ins"));
            vec![view(vec![("doppler".to_owned(), 1.0), ("ins".to_owned(), -1.0)], noise, false)]
        }
        Kind::Block => {
            let ids: Vec<String> = setting.scenario.fogs.iter().map(|g| g.id.clone()).collect();
            let axes: Vec<Vector3<f64>> = setting.scenario.fogs.iter().map(|g| g.design.input_axis).collect();
            parity(&axes)
                .into_iter()
                .map(|row| {
                    let noise = ids.first().map(|id| noise_of(id)).unwrap_or_default();
                    view(ids.iter().cloned().zip(row).collect(), noise, false)
                })
                .collect()
        }
        _ => setting
            .noise
            .iter()
            .map(|(id, _)| view(vec![(id.clone(), 1.0)], noise_of(id), setting.relative(id)))
            .collect(),
    }
}

/// Orthonormal combinations of outputs along these axes that no rate reaches; alike and independent noise stays so.
fn parity(axes: &[Vector3<f64>]) -> Vec<Vec<f64>> {
    let n = axes.len();
    let a = DMatrix::from_fn(n, 3, |i, j| axes[i][j]);
    let normal = a.transpose() * &a;
    let normal = Matrix3::from_fn(|i, j| normal[(i, j)]);
    let Some(inverse) = normal.try_inverse() else { return vec![] };
    let inverse = DMatrix::from_fn(3, 3, |i, j| inverse[(i, j)]);
    let projector = DMatrix::identity(n, n) - &a * inverse * a.transpose();
    // Gram–Schmidt over the projector's columns.
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for column in 0..n {
        let mut v: Vec<f64> = (0..n).map(|i| projector[(i, column)]).collect();
        for row in &rows {
            let share: f64 = v.iter().zip(row).map(|(x, y)| x * y).sum();
            v.iter_mut().zip(row).for_each(|(x, y)| *x -= share * y);
        }
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 1e-6 {
            rows.push(v.into_iter().map(|x| x / length).collect());
        }
    }
    rows
}

impl View {
    /// The view's series of some signals; outputs without a signal have none.
    pub fn of(&self, signals: &Signals, rows: usize) -> Vec<f64> {
        let mut sum = vec![0.0; rows];
        for (id, weight) in &self.weights {
            if let Some((_, values)) = signals.iter().find(|(name, _)| name == id) {
                sum.iter_mut().zip(values).for_each(|(s, v)| *s += weight * v);
            }
        }
        sum
    }

    /// Whitened series, the free constant taken out; the first decides what is missing.
    pub fn whiten(&self, time_s: &[f64], series: &[&[f64]]) -> Vec<Vec<f64>> {
        let ones = vec![1.0; time_s.len()];
        let mut all = series.to_vec();
        all.push(&ones);
        let mut white = self.model.whiten(time_s, &all).innovations;
        let constant = white.pop().unwrap_or_default();
        if self.relative {
            for series in &mut white {
                project_out(series, &constant);
            }
        }
        white
    }

    /// Whether an output enters.
    pub fn has(&self, id: &str) -> bool {
        self.weights.iter().any(|(name, _)| name == id)
    }
}

/// ½Σv² over what is there.
pub fn half_square(values: &[f64]) -> f64 {
    0.5 * values.iter().filter(|v| v.is_finite()).map(|v| v * v).sum::<f64>()
}

/// Of each whitened signal the share of its gain that is left beside the others with free sizes; one where there is no signal.
pub fn own_shares(white: &[Vec<f64>]) -> Vec<f64> {
    let share = |j: usize| {
        let (mut own, mut others) = (white[j].clone(), Vec::<Vec<f64>>::new());
        for (_, other) in white.iter().enumerate().filter(|(k, _)| *k != j) {
            let mut other = other.clone();
            for along in &others {
                project_out(&mut other, along);
            }
            project_out(&mut own, &other);
            others.push(other);
        }
        let whole = half_square(&white[j]);
        if whole > 0.0 { half_square(&own) / whole } else { 1.0 }
    };
    (0..white.len()).map(share).collect()
}

/// The scenario without noise, without conversion and without missing rows.
#[must_use]
pub fn silent(scenario: &Scenario) -> Scenario {
    let mut it = exact(scenario);
    each_readout(&mut it, |readout| {
        readout.white = 0.0;
        readout.electronics_drift.clear();
    });
    it.faults.retain(|entry| !matches!(entry.fault.fault, Fault::Noise(_)));
    if let Some(entry) = &mut it.schuler_loop {
        entry.velocity_white = 0.0;
        for source in [&mut entry.accelerometer, &mut entry.gyro] {
            if let ErrorSource::Process { drift, white } = source {
                drift.clear();
                *white = 0.0;
            }
        }
    }
    it
}

/// The scenario without conversion and without missing rows.
#[must_use]
pub fn exact(scenario: &Scenario) -> Scenario {
    let mut it = scenario.clone();
    each_readout(&mut it, |readout| readout.conversion = Conversion::Exact);
    it.gaps.clear();
    it
}

fn each_readout(scenario: &mut Scenario, change: impl Fn(&mut ReadoutDesign)) {
    scenario.gyros.iter_mut().for_each(|g| g.design.readout.iter_mut().for_each(&change));
    scenario.fogs.iter_mut().for_each(|g| change(&mut g.design.readout));
    scenario.accelerometers.iter_mut().for_each(|a| change(&mut a.design.readout));
    scenario.dopplers.iter_mut().for_each(|d| change(&mut d.design.readout));
}

/// The outputs of a simulation in SI units on the complete grid; NaN where a row or a value is missing.
pub fn outputs(setting: &Setting, simulated: &Simulated, rows: usize) -> Signals {
    let step = setting.scenario.step_s;
    let time = simulated.recording.get("t").unwrap_or_default();
    simulated
        .case
        .sensors
        .iter()
        .map(|sensor| {
            let si = sensor.unit.in_si();
            let mut values = vec![f64::NAN; rows];
            let told = simulated.recording.get(&sensor.column).unwrap_or_default();
            for (t, v) in time.iter().zip(told) {
                if let Some(place) = values.get_mut(((t / step).round() as usize).saturating_sub(1)) {
                    *place = v * si;
                }
            }
            (sensor.id.clone(), values)
        })
        .collect()
}

/// Difference of two simulations' outputs; zero where either has none.
pub fn difference(with: &Signals, without: &Signals) -> Signals {
    with.iter()
        .map(|(id, values)| {
            let base =
                without.iter().find(|(name, _)| name == id).map(|(_, v)| v.as_slice()).unwrap_or_default();
            let difference = values.iter().zip(base).map(|(a, b)| {
                let d = a - b;
                if d.is_finite() { d } else { 0.0 }
            });
            (id.clone(), difference.collect())
        })
        .collect()
}

/// Difference of two simulations' outputs; missing where the first has none.
pub fn difference_or_missing(with: &Signals, without: &Signals) -> Signals {
    with.iter()
        .map(|(id, values)| {
            let base =
                without.iter().find(|(name, _)| name == id).map(|(_, v)| v.as_slice()).unwrap_or_default();
            (id.clone(), values.iter().zip(base).map(|(a, b)| a - b).collect())
        })
        .collect()
}

/// Takes signals out of others.
pub fn subtract(from: &mut Signals, what: &Signals) {
    for (id, values) in from {
        if let Some((_, signal)) = what.iter().find(|(name, _)| name == id) {
            values.iter_mut().zip(signal).for_each(|(v, s)| *v -= s);
        }
    }
}

/// Which rows of the complete grid are recorded: zero, or NaN for a row in a gap.
pub fn mask(gaps: &[(f64, f64)], step_s: f64, rows: usize) -> Vec<f64> {
    (1..=rows)
        .map(|k| {
            let t = k as f64 * step_s;
            let missing = gaps.iter().any(|(start, length)| t >= *start && t < start + length);
            if missing { f64::NAN } else { 0.0 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::instruments::CONE;

    #[test]
    fn what_others_can_take_is_not_an_effects_own() {
        let (a, b) = (vec![1.0, 2.0, f64::NAN, 0.0], vec![0.0, 0.0, f64::NAN, 3.0]);
        let sum: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + b).collect();
        let apart = own_shares(&[a.clone(), b.clone(), vec![0.0; 4]]);
        assert!(apart.iter().all(|share| (share - 1.0).abs() < 1e-12), "{apart:?}");
        let together = own_shares(&[a.clone(), b, sum]);
        assert!(together.iter().all(|share| *share < 1e-12), "{together:?}");
        // Of two at 45° half of each is its own.
        let half = own_shares(&[vec![1.0, 0.0], vec![1.0, 1.0]]);
        assert!(half.iter().all(|share| (share - 0.5).abs() < 1e-12), "{half:?}");
    }

    #[test]
    fn parity_rows_are_orthonormal_and_blind_to_every_rate() {
        let axes: Vec<Vector3<f64>> = CONE.iter().map(|a| Vector3::from(*a).normalize()).collect();
        let rows = parity(&axes);
        assert_eq!(rows.len(), 2);
        for (i, p) in rows.iter().enumerate() {
            for (j, q) in rows.iter().enumerate() {
                let dot: f64 = p.iter().zip(q).map(|(x, y)| x * y).sum();
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
            for axis in 0..3 {
                let seen: f64 = p.iter().zip(&axes).map(|(x, a)| x * a[axis]).sum();
                assert!(seen.abs() < 1e-12);
            }
        }
    }
}
