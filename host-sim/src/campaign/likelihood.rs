//! What the oracle reckons with: the exact Gaussian likelihood of a residual under a linear model of its noise.
//!
//! The noise is put into state-space form and whitened by a Kalman filter, gaps and missing values included. Every series is
//! run through the same gains, so the whitened sum is the sum of the whitened. With e the whitened residual
//! and s the whitened signal of an effect, taking the effect out gains ½Σ(e² − (e − s)²) nats, on average ½Σs².
//! A constant that the model leaves free (a sensor read against an unknown constant) is projected out of both; this is the limit of a
//! prior without bound. Units: the residual's.
use nalgebra::{DMatrix, DVector};

use crate::physics::linear::discretise;
use crate::physics::random::Process;

/// Noise of a series, sampled at a constant step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Noise {
    /// White noise of a value, 1 σ.
    pub white: f64,
    /// Random drift.
    pub drift: Vec<Process>,
    /// 1 σ of what pulses leave over, divided by the step; readings hold its difference.
    pub left_over: f64,
    /// White noise that is added from a time on: that time, s, and 1 σ.
    pub more_white: Option<(f64, f64)>,
    /// Spikes: their probability in a reading, and 1 σ.
    pub spikes: Option<(f64, f64)>,
}

/// The Schuler loop whose velocity error is the series; its sensors' errors are held over a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Loop {
    /// Radius, m.
    pub radius_m: f64,
    /// Gravity, m/s².
    pub gravity: f64,
    /// Accelerometer error, m/s².
    pub accelerometer: Noise,
    /// Gyro drift, rad/s.
    pub gyro: Noise,
    /// White noise of the velocity, m/s.
    pub velocity_white: f64,
    /// Spikes of the velocity: their probability in a reading, and 1 σ, m/s.
    pub spikes: Option<(f64, f64)>,
}

/// Relative change of the gain below which the filter has settled.
const SETTLED: f64 = 1e-11;
/// Settled steps after which the gain is kept until something is missing.
const SETTLED_STEPS: usize = 8;
/// Prior 1 σ of the loop's velocity error (m/s) and tilt (rad): far beyond any that occur.
const LOOP_PRIOR: [f64; 2] = [100.0, 0.1];

/// A linear model: x' = F x + w, y = H x + v.
#[derive(Clone, Debug)]
pub struct Model {
    f: DMatrix<f64>,
    q: DMatrix<f64>,
    h: DVector<f64>,
    prior: DMatrix<f64>,
    white: f64,
    more_white: Option<(f64, f64)>,
    spikes: Option<(f64, f64)>,
}

/// Series after whitening.
#[derive(Clone, Debug, PartialEq)]
pub struct Whitened {
    /// Standardised innovations of each series; NaN where the first series has none.
    pub innovations: Vec<Vec<f64>>,
    /// Logarithm of the innovation's variance at each step.
    pub log_variance: Vec<f64>,
}

/// One drift's states: its transition, noise and prior, and how a reading holds them.
struct Block {
    f: DMatrix<f64>,
    q: DMatrix<f64>,
    prior: DMatrix<f64>,
    h: DVector<f64>,
}

/// The states of a drift, sampled at the readings.
fn block(process: &Process, step_s: f64) -> Vec<Block> {
    let one = |memory: f64, fresh: f64, variance: f64| Block {
        f: DMatrix::from_element(1, 1, memory),
        q: DMatrix::from_element(1, 1, fresh),
        prior: DMatrix::from_element(1, 1, variance),
        h: DVector::from_element(1, 1.0),
    };
    match *process {
        Process::Markov { sigma, tau_s } => {
            let memory = (-step_s / tau_s).exp();
            vec![one(memory, sigma * sigma * (1.0 - memory * memory), sigma * sigma)]
        }
        Process::RandomWalk { rate } => vec![one(1.0, rate * rate * step_s, 0.0)],
        Process::ExponentialCosine { sigma, alpha, beta } => {
            let memory = (-alpha * step_s).exp();
            let (s, c) = (beta * step_s).sin_cos();
            let fresh = sigma * sigma * (1.0 - memory * memory);
            vec![Block {
                f: DMatrix::from_row_slice(2, 2, &[memory * c, -memory * s, memory * s, memory * c]),
                q: DMatrix::from_diagonal_element(2, 2, fresh),
                prior: DMatrix::from_diagonal_element(2, 2, sigma * sigma),
                h: DVector::from_row_slice(&[1.0, 0.0]),
            }]
        }
        Process::Flicker { instability, shortest_s, longest_s } => {
            // As the simulator makes it: Markov processes spaced by a factor of two.
            let sigma = instability * (2f64.ln() / std::f64::consts::PI).sqrt();
            let mut all = Vec::new();
            let mut tau_s = shortest_s;
            while tau_s <= longest_s * (1.0 + 1e-9) {
                all.extend(block(&Process::Markov { sigma, tau_s }, step_s));
                tau_s *= 2.0;
            }
            all
        }
    }
}

fn stacked(blocks: &[Block]) -> Block {
    let n = blocks.iter().map(|b| b.h.len()).sum();
    let mut all = Block {
        f: DMatrix::zeros(n, n),
        q: DMatrix::zeros(n, n),
        prior: DMatrix::zeros(n, n),
        h: DVector::zeros(n),
    };
    let mut at = 0;
    for b in blocks {
        let m = b.h.len();
        all.f.view_mut((at, at), (m, m)).copy_from(&b.f);
        all.q.view_mut((at, at), (m, m)).copy_from(&b.q);
        all.prior.view_mut((at, at), (m, m)).copy_from(&b.prior);
        all.h.rows_mut(at, m).copy_from(&b.h);
        at += m;
    }
    all
}

impl Noise {
    fn blocks(&self, step_s: f64) -> Block {
        let mut blocks: Vec<Block> = self.drift.iter().flat_map(|p| block(p, step_s)).collect();
        if self.left_over > 0.0 {
            let variance = self.left_over * self.left_over;
            blocks.push(Block {
                f: DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 1.0, 0.0]),
                q: DMatrix::from_row_slice(2, 2, &[variance, 0.0, 0.0, 0.0]),
                prior: DMatrix::zeros(2, 2),
                h: DVector::from_row_slice(&[-1.0, 1.0]),
            });
        }
        stacked(&blocks)
    }

    /// The model of a series with this noise.
    pub fn model(&self, step_s: f64) -> Model {
        let Block { f, q, prior, h } = self.blocks(step_s);
        Model { f, q, h, prior, white: self.white, more_white: self.more_white, spikes: self.spikes }
    }

    /// The noise of the sum of two independent series.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            white: self.white.hypot(other.white),
            drift: self.drift.iter().chain(&other.drift).copied().collect(),
            left_over: self.left_over.hypot(other.left_over),
            more_white: self.more_white.or(other.more_white),
            spikes: self.spikes.or(other.spikes),
        }
    }

    /// The longest correlation time, s; zero for white noise.
    pub fn correlation_time_s(&self) -> f64 {
        self.drift
            .iter()
            .map(|p| match *p {
                Process::Markov { tau_s, .. } => tau_s,
                Process::ExponentialCosine { alpha, .. } => 1.0 / alpha,
                Process::RandomWalk { .. } => 0.0,
                Process::Flicker { longest_s, .. } => longest_s,
            })
            .fold(0.0, f64::max)
    }
}

impl Loop {
    /// The model of the loop's velocity error: ΔV, δ, then the sensors' errors; exact for errors held over a step.
    pub fn model(&self, step_s: f64) -> Model {
        let (a, w) = (self.accelerometer.blocks(step_s), self.gyro.blocks(step_s));
        let mut dynamics = nalgebra::Matrix4::zeros();
        dynamics[(0, 1)] = -self.gravity;
        dynamics[(0, 2)] = 1.0;
        dynamics[(1, 0)] = 1.0 / self.radius_m;
        dynamics[(1, 3)] = 1.0;
        let (phi, _) = discretise(&dynamics, &nalgebra::Matrix4::zeros(), step_s);
        let sensors = stacked(&[a, w]);
        let m = sensors.h.len();
        let n = 2 + m;
        // The sensors move first, then the loop over their errors, so the loop reads the new sensor states.
        let accelerometers = self.accelerometer.blocks(step_s).h.len();
        let reads = DMatrix::from_fn(2, m, |row, k| {
            let column = if k < accelerometers { 2 } else { 3 };
            phi[(row, column)] * sensors.h[k]
        });
        let mut f = DMatrix::zeros(n, n);
        for row in 0..2 {
            for column in 0..2 {
                f[(row, column)] = phi[(row, column)];
            }
        }
        f.view_mut((0, 2), (2, m)).copy_from(&(&reads * &sensors.f));
        f.view_mut((2, 2), (m, m)).copy_from(&sensors.f);
        // Noise enters the sensors and through them the loop; the white part of a sensor only the loop.
        let mut enters = DMatrix::zeros(n, m);
        enters.view_mut((0, 0), (2, m)).copy_from(&reads);
        enters.view_mut((2, 0), (m, m)).copy_from(&DMatrix::identity(m, m));
        let mut q = &enters * &sensors.q * enters.transpose();
        for (column, white) in [(2, self.accelerometer.white), (3, self.gyro.white)] {
            let through = nalgebra::Vector2::new(phi[(0, column)], phi[(1, column)]) * white;
            for i in 0..2 {
                for j in 0..2 {
                    q[(i, j)] += through[i] * through[j];
                }
            }
        }
        let mut prior = DMatrix::zeros(n, n);
        for (k, sigma) in LOOP_PRIOR.iter().enumerate() {
            prior[(k, k)] = sigma * sigma;
        }
        prior.view_mut((2, 2), (m, m)).copy_from(&sensors.prior);
        let mut h = DVector::zeros(n);
        h[0] = 1.0;
        Model { f, q, h, prior, white: self.velocity_white, more_white: None, spikes: self.spikes }
    }
}

impl Model {
    /// The same where white noise is added from another time on.
    #[must_use]
    pub fn later(&self, onset_s: f64) -> Self {
        Self { more_white: self.more_white.map(|(_, sigma)| (onset_s, sigma)), ..self.clone() }
    }

    /// Whitens several series of one step grid with the gains of this model; the first decides what is missing.
    /// A value of another series that is missing where the first has one counts as zero.
    pub fn whiten(&self, time_s: &[f64], series: &[&[f64]]) -> Whitened {
        let n = self.h.len();
        let rows = series.first().map_or(0, |s| s.len());
        let mut x: Vec<DVector<f64>> = series.iter().map(|_| DVector::zeros(n)).collect();
        let mut p = self.prior.clone();
        let mut gain: DVector<f64> = DVector::zeros(n);
        let mut variance: f64 = 0.0;
        let mut settled = 0;
        let mut last_white = f64::NAN;
        let mut out = Whitened {
            innovations: series.iter().map(|_| vec![f64::NAN; rows]).collect(),
            log_variance: vec![f64::NAN; rows],
        };
        let mut spare = DVector::zeros(n);
        for k in 0..rows {
            let present = series.first().and_then(|s| s.get(k)).is_some_and(|v| v.is_finite());
            let added = self.more_white.filter(|(onset, _)| time_s.get(k).is_some_and(|t| t >= onset));
            let white = self.white.hypot(added.map_or(0.0, |(_, sigma)| sigma));
            if !present || white != last_white {
                settled = 0;
            }
            last_white = white;
            if settled < SETTLED_STEPS {
                p = &self.f * &p * self.f.transpose() + &self.q;
                if present {
                    let ph = &p * &self.h;
                    variance = self.h.dot(&ph) + white * white;
                    let fresh = &ph / variance;
                    let change = (&fresh - &gain).amax();
                    settled = if change <= SETTLED * fresh.amax().max(1e-300) { settled + 1 } else { 0 };
                    gain = fresh;
                    // Joseph's form, so that rounding cannot make the covariance indefinite.
                    let keep = DMatrix::identity(n, n) - &gain * self.h.transpose();
                    p = &keep * &p * keep.transpose() + &gain * gain.transpose() * (white * white);
                }
            }
            for (i, (state, values)) in x.iter_mut().zip(series).enumerate() {
                spare.gemv(1.0, &self.f, state, 0.0);
                std::mem::swap(state, &mut spare);
                if present {
                    let value = values.get(k).copied().filter(|v| v.is_finite()).unwrap_or(0.0);
                    let innovation = value - self.h.dot(state);
                    state.axpy(innovation, &gain, 1.0);
                    out.innovations[i][k] = innovation / variance.sqrt();
                }
            }
            if present {
                out.log_variance[k] = variance.ln();
            }
        }
        out
    }

    /// Log-likelihood of a series.
    pub fn log_likelihood(&self, time_s: &[f64], series: &[f64]) -> f64 {
        let w = self.whiten(time_s, &[series]);
        let terms = w.innovations[0].iter().zip(&w.log_variance).filter(|(e, _)| e.is_finite());
        terms.map(|(e, l)| self.log_density(*e, *l) - 0.5 * std::f64::consts::TAU.ln()).sum()
    }

    /// Logarithm of a row's density, but for its constant, at a standardised innovation and the logarithm of its variance. Nobody
    /// knows where spikes fall, so it is that of their mixture; what a spike leaves in later innovations is not used.
    pub fn log_density(&self, innovation: f64, log_variance: f64) -> f64 {
        let square = innovation * innovation;
        let wider = self.spikes.map_or(0.0, |(probability, sigma)| {
            let more = sigma * sigma / log_variance.exp();
            let spike = probability.ln() + 0.5 * (square * more / (1.0 + more) - more.ln_1p());
            let none = (-probability).ln_1p();
            spike.max(none) + (-(spike - none).abs()).exp().ln_1p()
        });
        wider - 0.5 * (square + log_variance)
    }
}

/// Takes the part along `along` out of `series`; missing values stay missing.
pub fn project_out(series: &mut [f64], along: &[f64]) {
    let dot = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).filter(|(x, y)| x.is_finite() && y.is_finite()).map(|(x, y)| x * y).sum()
    };
    let square = dot(along, along);
    if square > 0.0 {
        let share = dot(series, along) / square;
        series.iter_mut().zip(along).for_each(|(v, a)| *v -= share * a);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::random::{Drift, Stream};
    use crate::physics::readout::{Readout, ReadoutDesign, Surroundings};
    use crate::physics::schuler::SchulerLoop;

    const STEP: f64 = 2.0;

    /// The density of a reading that may be a spike integrates to one, and is the wider normal's far out.
    #[test]
    fn spikes_are_a_mixture() {
        let (probability, sigma) = (0.01, 6.0);
        let model = Noise { white: 1.0, spikes: Some((probability, sigma)), ..Noise::default() }.model(STEP);
        let density = |e: f64| (model.log_density(e, 0.0) - 0.5 * std::f64::consts::TAU.ln()).exp();
        let whole: f64 = (-60_000..=60_000).map(|k| density(f64::from(k) * 1e-3) * 1e-3).sum();
        assert!((whole - 1.0).abs() < 1e-9, "{whole}");
        let variance = 1.0 + sigma * sigma;
        let wide = probability * (-0.5 * 400.0 / variance).exp() / (std::f64::consts::TAU * variance).sqrt();
        assert!((density(20.0) / wide - 1.0).abs() < 1e-12);
        assert!(model.log_density(1e4, 0.0).is_finite());
    }

    /// Log-likelihood with a dense covariance matrix.
    fn dense(covariance: &DMatrix<f64>, y: &DVector<f64>) -> f64 {
        let factor = covariance.clone().cholesky().unwrap();
        let log_determinant = 2.0 * factor.l().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        let n = y.len() as f64;
        -0.5 * (y.dot(&factor.solve(y)) + log_determinant + n * std::f64::consts::TAU.ln())
    }

    /// Covariance of a stationary process at the readings, from its autocovariance.
    fn sampled(r: impl Fn(f64) -> f64, n: usize) -> DMatrix<f64> {
        DMatrix::from_fn(n, n, |i, j| r(i.abs_diff(j) as f64 * STEP))
    }

    fn noise() -> Noise {
        Noise {
            white: 0.3,
            drift: vec![
                Process::Markov { sigma: 1.0, tau_s: 20.0 },
                Process::ExponentialCosine { sigma: 0.7, alpha: 0.02, beta: 0.15 },
                Process::RandomWalk { rate: 0.05 },
            ],
            ..Noise::default()
        }
    }

    fn covariance(n: usize) -> DMatrix<f64> {
        let mut c = sampled(|t| (-t / 20.0).exp(), n);
        c += sampled(|t| 0.49 * (-0.02 * t).exp() * (0.15 * t).cos(), n);
        for i in 0..n {
            for j in 0..n {
                // Walk from zero, one step before the first reading.
                c[(i, j)] += (i.min(j) + 1) as f64 * STEP * 0.05 * 0.05;
            }
            c[(i, i)] += 0.09;
        }
        c
    }

    fn simulated(n: usize) -> Vec<f64> {
        let design = ReadoutDesign {
            white: 0.3 * STEP.sqrt(),
            electronics_drift: noise().drift,
            range: f64::INFINITY,
            ..ReadoutDesign::default()
        };
        let mut readout = Readout::new(design, 5, "x");
        (0..n).map(|_| readout.read(0.0, &Surroundings::default(), STEP)).collect()
    }

    #[test]
    fn likelihood_agrees_with_a_dense_covariance_with_and_without_missing_values() {
        let n = 120;
        let time: Vec<f64> = (1..=n).map(|k| k as f64 * STEP).collect();
        let mut y = simulated(n);
        let full = noise().model(STEP).log_likelihood(&time, &y);
        let expected = dense(&covariance(n), &DVector::from_row_slice(&y));
        assert!((full - expected).abs() < 1e-8, "{full} {expected}");
        let kept: Vec<usize> = (0..n).filter(|k| !(30..47).contains(k) && k % 11 != 0).collect();
        for k in 0..n {
            if !kept.contains(&k) {
                y[k] = f64::NAN;
            }
        }
        let c = covariance(n);
        let part = DMatrix::from_fn(kept.len(), kept.len(), |i, j| c[(kept[i], kept[j])]);
        let values = DVector::from_fn(kept.len(), |i, _| y[kept[i]]);
        let found = noise().model(STEP).log_likelihood(&time, &y);
        assert!((found - dense(&part, &values)).abs() < 1e-8);
    }

    #[test]
    fn gain_of_a_signal_agrees_with_the_dense_quadratic_form_with_a_free_constant() {
        let n = 150;
        let time: Vec<f64> = (1..=n).map(|k| k as f64 * STEP).collect();
        let y = simulated(n);
        let signal: Vec<f64> =
            (0..n).map(|k| if k > 70 { 1.3 } else { 0.2 * (k as f64 * 0.1).sin() }).collect();
        let ones = vec![1.0; n];
        let w = noise().model(STEP).whiten(&time, &[&y, &signal, &ones]);
        let [_, mut s, one] = <[Vec<f64>; 3]>::try_from(w.innovations).unwrap();
        project_out(&mut s, &one);
        let found = 0.5 * s.iter().map(|v| v * v).sum::<f64>();
        let inverse = covariance(n).try_inverse().unwrap();
        let (s, o) = (DVector::from_row_slice(&signal), DVector::from_element(n, 1.0));
        let cross = s.dot(&(&inverse * &o));
        let expected = 0.5 * (s.dot(&(&inverse * &s)) - cross * cross / o.dot(&(&inverse * &o)));
        assert!((found / expected - 1.0).abs() < 1e-8, "{found} {expected}");
    }

    #[test]
    fn a_settled_gain_changes_nothing() {
        // Long enough to settle; innovations of the true model are white and of variance one.
        let n = 20_000;
        let time: Vec<f64> = (1..=n).map(|k| k as f64 * STEP).collect();
        let w = noise().model(STEP).whiten(&time, &[&simulated(n)]);
        let mean = w.innovations[0].iter().map(|e| e * e).sum::<f64>() / n as f64;
        assert!((mean - 1.0).abs() < 4.0 * (2.0 / n as f64).sqrt(), "{mean}");
    }

    #[test]
    fn a_loop_is_white_under_its_own_model() {
        let it = Loop {
            radius_m: 6_371_000.0,
            gravity: 9.80665,
            accelerometer: Noise {
                white: 2e-4,
                drift: vec![Process::Markov { sigma: 1e-3, tau_s: 60.0 }],
                ..Noise::default()
            },
            gyro: Noise {
                white: 0.0,
                drift: vec![Process::Markov { sigma: 5e-7, tau_s: 1800.0 }],
                ..Noise::default()
            },
            velocity_white: 0.05,
            spikes: None,
        };
        let mut truth =
            SchulerLoop { radius_m: 6_371_000.0, gravity: 9.80665, velocity_error: 0.4, tilt: 1e-4 };
        let mut a = Drift::new(&it.accelerometer.drift, Stream::new(1, "a"));
        let mut w = Drift::new(&it.gyro.drift, Stream::new(1, "w"));
        let mut white = Stream::new(1, "v");
        let n = 20_000;
        let y: Vec<f64> = (0..n)
            .map(|_| {
                let held = a.advance(1.0) + 2e-4 * white.normal();
                truth.advance(1.0, held, w.advance(1.0), 0.0);
                truth.velocity_error + 0.05 * white.normal()
            })
            .collect();
        let time: Vec<f64> = (1..=n).map(f64::from).collect();
        let e = &it.model(1.0).whiten(&time, &[&y]).innovations[0];
        let variance = e.iter().map(|v| v * v).sum::<f64>() / f64::from(n);
        assert!((variance - 1.0).abs() < 4.0 * (2.0 / f64::from(n)).sqrt(), "{variance}");
        let test = crate::statistics::ljung_box(e, 20);
        assert!(test.p_value > 1e-4, "{test:?}");
    }
}
