//! Noise parameters of a radio sensor from a fault-free record of its difference to an inertial sensor [HLT-6].
//!
//! The residual d = ε − ξ holds the radio's first-order Markov error ε (standard deviation σ, correlation time
//! τ) and the inertial error ξ, a random walk on a slow drift. Sought are σ and τ, by maximum likelihood: the
//! Kalman filter of (ε, ξ, μ) gives the likelihood of any pair, whatever is missing from the record. The start is
//! a fit of the structure function, `E (d(k+h) − d(k))² = 2σ²(1 − f^h) + h γ_ξ²`, which does not see an offset.
//!
//! Inputs: residuals, m/s, one a step, NaN where missing; the inertial sensor's specification, for the record
//! does not hold it: its random walk is a hundredth of the radio's noise. Outputs: σ, m/s, and τ, s, each with
//! its standard deviation.
use nalgebra::{Matrix2, Matrix3, RowVector3, Vector2, Vector3};
use thiserror::Error;

/// Lags of the structure function, steps.
const LAGS: [usize; 8] = [1, 2, 3, 5, 8, 12, 20, 30];
/// Fewest usable residuals.
const MIN_RESIDUALS: usize = 300;
/// A record shorter than this many correlation times does not hold them.
const MIN_CORRELATION_TIMES: f64 = 20.0;
/// Below this many steps a correlation time cannot be told from white noise.
const MIN_TAU_STEPS: f64 = 0.5;
/// Correlation times searched for a start, in steps, and in how many points.
const START_RANGE: [f64; 2] = [0.2, 300.0];
const START_POINTS: usize = 200;
/// Step of the numerical derivatives in ln σ and ln τ.
const DERIVATIVE_STEP: f64 = 0.01;
/// The estimate has converged when a step of Newton's method is smaller than this in ln σ and ln τ.
const CONVERGED: f64 = 1e-4;
const MAX_ITERATIONS: usize = 50;

/// What the inertial sensor is specified for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialSpecification {
    /// Random walk of the error ξ, (m/s)/√s.
    pub random_walk: f64,
    /// Standard deviation of ξ at the start, m/s.
    pub initial_sigma: f64,
    /// Standard deviation of the drift, m/s².
    pub drift_sigma: f64,
}

/// A parameter and its standard deviation, in the parameter's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// The estimate.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// Noise of a radio sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadioNoise {
    /// Standard deviation of the error, m/s.
    pub sigma: Parameter,
    /// Correlation time of the error, s.
    pub tau_s: Parameter,
    /// Logarithm of the likelihood at the estimate.
    pub log_likelihood: f64,
    /// Usable residuals.
    pub residuals: usize,
}

/// Why a record gives no parameters.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum IdentificationError {
    /// The step or a value of the specification cannot be.
    #[error("{0} is not a finite number of the right sign")]
    Invalid(&'static str),
    /// Too few residuals.
    #[error("{found} usable residuals, at least {MIN_RESIDUALS} are needed")]
    TooShort {
        /// Usable residuals.
        found: usize,
    },
    /// All residuals are the same.
    #[error("the residuals do not vary")]
    Constant,
    /// The correlation time is not resolved: too short for the step or too long for the record.
    #[error("correlation time {tau_s} s is not resolved by {residuals} residuals a step of {step_s} s apart")]
    Unresolved {
        /// Where the search stopped, s.
        tau_s: f64,
        /// Usable residuals.
        residuals: usize,
        /// Step, s.
        step_s: f64,
    },
    /// The likelihood has no clear maximum.
    #[error("the likelihood has no clear maximum")]
    NoMaximum,
}

impl RadioNoise {
    /// σ, m/s, and τ, s, moved by `sigmas` standard deviations to the side on which the health monitor raises no
    /// false alarms: a larger σ and a shorter τ.
    pub fn upper_side(&self, sigmas: f64) -> (f64, f64) {
        let moved =
            |parameter: Parameter, by: f64| parameter.value * (by * parameter.sigma / parameter.value).exp();
        (moved(self.sigma, sigmas), moved(self.tau_s, -sigmas))
    }
}

/// Identifies σ and τ. `residual_sigma`: white noise of the residual that is not ε, m/s.
///
/// # Errors
/// An input that cannot be, or a record that does not hold the parameters.
pub fn identify_radio_noise(
    residuals: &[f64],
    step_s: f64,
    residual_sigma: f64,
    inertial: &InertialSpecification,
) -> Result<RadioNoise, IdentificationError> {
    let valid = |name, value: f64, least: f64| {
        if value.is_finite() && value >= least { Ok(()) } else { Err(IdentificationError::Invalid(name)) }
    };
    valid("step_s", step_s, f64::MIN_POSITIVE)?;
    valid("residual_sigma", residual_sigma, 0.0)?;
    valid("random_walk", inertial.random_walk, 0.0)?;
    valid("initial_sigma", inertial.initial_sigma, 0.0)?;
    valid("drift_sigma", inertial.drift_sigma, 0.0)?;
    let found = residuals.iter().filter(|d| d.is_finite()).count();
    if found < MIN_RESIDUALS {
        return Err(IdentificationError::TooShort { found });
    }

    let likelihood = Likelihood { residuals, step_s, residual_variance: residual_sigma.powi(2), inertial };
    let (sigma, tau_s) = structure_function_fit(residuals, step_s, inertial.random_walk)?;
    let (at, covariance, log_likelihood) = maximum(&likelihood, Vector2::new(sigma.ln(), tau_s.ln()))?;
    let parameter =
        |log: f64, variance: f64| Parameter { value: log.exp(), sigma: log.exp() * variance.sqrt() };
    let tau_s = parameter(at.y, covariance.m22);
    let longest = found as f64 * step_s / MIN_CORRELATION_TIMES;
    if tau_s.value < MIN_TAU_STEPS * step_s || tau_s.value > longest {
        return Err(IdentificationError::Unresolved { tau_s: tau_s.value, residuals: found, step_s });
    }
    Ok(RadioNoise { sigma: parameter(at.x, covariance.m11), tau_s, log_likelihood, residuals: found })
}

/// Fit of the structure function with relative weights: σ, m/s, and τ, s [HLT-6].
fn structure_function_fit(
    residuals: &[f64],
    step_s: f64,
    random_walk: f64,
) -> Result<(f64, f64), IdentificationError> {
    let mean_square = |lag: usize| {
        let squares: Vec<f64> = residuals
            .iter()
            .zip(residuals.iter().skip(lag))
            .map(|(before, after)| (after - before).powi(2))
            .filter(|square| square.is_finite())
            .collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    };
    let measured: Vec<(f64, f64)> = LAGS
        .iter()
        .map(|&lag| (lag as f64, mean_square(lag)))
        .filter(|(_, v)| v.is_finite() && *v > 0.0)
        .collect();
    if measured.len() < 3 {
        return Err(IdentificationError::Constant);
    }
    let step_walk = random_walk.powi(2) * step_s;
    // For each τ the best σ² is linear.
    let fit = |tau_steps: f64| {
        let rows: Vec<(f64, f64)> = measured
            .iter()
            .map(|(lag, v)| (-2.0 * (-lag / tau_steps).exp_m1() / v, 1.0 - lag * step_walk / v))
            .collect();
        let variance =
            rows.iter().map(|(a, b)| a * b).sum::<f64>() / rows.iter().map(|(a, _)| a * a).sum::<f64>();
        let misfit = rows.iter().map(|(a, b)| (a * variance - b).powi(2)).sum::<f64>();
        (misfit, variance, tau_steps)
    };
    let [shortest, longest] = START_RANGE;
    (0..START_POINTS)
        .map(|point| fit(shortest * (longest / shortest).powf(point as f64 / (START_POINTS - 1) as f64)))
        .filter(|(_, variance, _)| *variance > 0.0)
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, variance, tau_steps)| (variance.sqrt(), tau_steps * step_s))
        .ok_or(IdentificationError::Constant)
}

/// The record, ready for the likelihood of any σ and τ.
struct Likelihood<'a> {
    residuals: &'a [f64],
    step_s: f64,
    residual_variance: f64,
    inertial: &'a InertialSpecification,
}

impl Likelihood<'_> {
    /// Logarithm of the likelihood at (ln σ, ln τ), from the innovations of a Kalman filter of (ε, ξ, μ).
    fn at(&self, logs: Vector2<f64>) -> f64 {
        let (variance, tau_s) = ((2.0 * logs.x).exp(), logs.y.exp());
        let dt = self.step_s;
        let f = (-dt / tau_s).exp();
        let innovation_variance = -variance * (-2.0 * dt / tau_s).exp_m1();
        let transition = Matrix3::new(f, 0.0, 0.0, 0.0, 1.0, dt, 0.0, 0.0, 1.0);
        let walk = self.inertial.random_walk.powi(2) * dt;
        let noise = Matrix3::from_diagonal(&Vector3::new(innovation_variance, walk, 0.0));
        let initial =
            Vector3::new(variance, self.inertial.initial_sigma.powi(2), self.inertial.drift_sigma.powi(2));
        let h = RowVector3::new(1.0, -1.0, 0.0);

        let mut mean = Vector3::zeros();
        let mut covariance = Matrix3::from_diagonal(&initial);
        let mut sum = 0.0;
        for &d in self.residuals {
            if d.is_finite() {
                let cross = covariance * h.transpose();
                let s = (h * cross).x + self.residual_variance;
                let v = d - (h * mean).x;
                sum -= 0.5 * (v * v / s + (std::f64::consts::TAU * s).ln());
                mean += cross * (v / s);
                covariance -= cross * cross.transpose() / s;
            }
            mean = transition * mean;
            covariance = transition * covariance * transition.transpose() + noise;
        }
        sum
    }

    /// Value, gradient and Hessian by central differences.
    fn expansion(&self, at: Vector2<f64>) -> (f64, Vector2<f64>, Matrix2<f64>) {
        let h = DERIVATIVE_STEP;
        let (x, y) = (Vector2::new(h, 0.0), Vector2::new(0.0, h));
        let [here, east, west, north, south] = [at, at + x, at - x, at + y, at - y].map(|at| self.at(at));
        let mixed = self.at(at + x + y) - self.at(at + x - y) - self.at(at - x + y) + self.at(at - x - y);
        let gradient = Vector2::new(east - west, north - south) / (2.0 * h);
        let mixed = mixed / (4.0 * h * h);
        let hessian = Matrix2::new(
            (east - 2.0 * here + west) / (h * h),
            mixed,
            mixed,
            (north - 2.0 * here + south) / (h * h),
        );
        (here, gradient, hessian)
    }
}

/// Newton's method with halving: place, covariance (inverse of the negative Hessian) and value of the maximum.
fn maximum(
    likelihood: &Likelihood<'_>,
    start: Vector2<f64>,
) -> Result<(Vector2<f64>, Matrix2<f64>, f64), IdentificationError> {
    let mut at = start;
    for _ in 0..MAX_ITERATIONS {
        let (value, gradient, hessian) = likelihood.expansion(at);
        let covariance = (-hessian).cholesky().map(|factor| factor.inverse());
        // Where the likelihood is not curved downwards, climb; never farther than a factor e.
        let direction = covariance.map_or(gradient, |covariance| covariance * gradient);
        let mut step = direction * (1.0 / direction.norm()).min(1.0);
        if let Some(covariance) = covariance.filter(|_| step.amax() < CONVERGED) {
            return Ok((at, covariance, value));
        }
        let improves = |step: &Vector2<f64>| likelihood.at(at + step) > value;
        while !improves(&step) && step.amax() >= CONVERGED {
            step *= 0.5;
        }
        at += step;
    }
    Err(IdentificationError::NoMaximum)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    use super::*;

    const SPECIFICATION: InertialSpecification =
        InertialSpecification { random_walk: 0.005, initial_sigma: 0.5, drift_sigma: 3e-4 };

    /// An hour of a fault-free Doppler radio, σ = 0.3 m/s, τ = 10 s [HLT-7].
    fn hour(seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut normal = move || random.sample::<f64, _>(StandardNormal);
        let f = (-0.1_f64).exp();
        let (mut eps, mut xi, mu) = (0.3 * normal(), 0.5 * normal(), 3e-4 * normal());
        (0..3600)
            .map(|_| {
                let d = eps - xi + 0.01 * normal();
                eps = f * eps + 0.3 * (1.0 - f * f).sqrt() * normal();
                xi += mu + 0.005 * normal();
                d
            })
            .collect()
    }

    fn spread(values: &[f64], truth: f64) -> (f64, f64) {
        let relative: Vec<f64> = values.iter().map(|value| value / truth - 1.0).collect();
        let mean = relative.iter().sum::<f64>() / relative.len() as f64;
        let variance = relative.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / relative.len() as f64;
        (mean, variance.sqrt())
    }

    /// One hour gives σ within 8 % and τ within 13 % (1 σ) by the structure function; maximum likelihood does
    /// better, and its standard deviations are what they say.
    #[test]
    fn hlt_6_identification_from_one_hour() {
        let records: Vec<_> = (0..150).map(hour).collect();
        let starts: Vec<_> =
            records.iter().map(|d| structure_function_fit(d, 1.0, 0.005).expect("a start")).collect();
        let found: Vec<_> = records
            .iter()
            .map(|d| identify_radio_noise(d, 1.0, 0.01, &SPECIFICATION).expect("a fit"))
            .collect();
        let column = |of: &dyn Fn(&RadioNoise) -> f64| found.iter().map(of).collect::<Vec<f64>>();

        let start = (
            spread(&starts.iter().map(|s| s.0).collect::<Vec<_>>(), 0.3),
            spread(&starts.iter().map(|s| s.1).collect::<Vec<_>>(), 10.0),
        );
        let sigma = spread(&column(&|noise| noise.sigma.value), 0.3);
        let tau = spread(&column(&|noise| noise.tau_s.value), 10.0);
        let off = |parameter: Parameter, truth: f64| (parameter.value - truth).abs() / parameter.sigma;
        let inside = |limit: f64| {
            let count = found
                .iter()
                .flat_map(|noise| [off(noise.sigma, 0.3), off(noise.tau_s, 10.0)])
                .filter(|off| *off < limit)
                .count();
            count as f64 / (2 * found.len()) as f64
        };
        println!("relative mean error and standard deviation: structure function {start:.3?}");
        println!(
            "maximum likelihood: σ {sigma:.3?}, τ {tau:.3?}; within 2 σ {:.3}, 3 σ {:.3}",
            inside(2.0),
            inside(3.0)
        );
        assert!(start.0.1 < 0.08 && start.1.1 < 0.2, "{start:?}");
        assert!(sigma.1 < 0.06 && tau.1 < 0.12, "{sigma:?} {tau:?}");
        assert!(sigma.0.abs() < 0.02 && tau.0.abs() < 0.04, "{sigma:?} {tau:?}");
        assert!(inside(2.0) > 0.9 && inside(3.0) > 0.97);
    }

    /// A tenth of the record missing, at random and in a block, changes little.
    #[test]
    fn hlt_6_identification_with_missing_residuals() {
        let full = hour(1000);
        let whole = identify_radio_noise(&full, 1.0, 0.01, &SPECIFICATION).expect("a fit");
        let mut holes = full.clone();
        holes[1000..1300].fill(f64::NAN);
        for d in holes.iter_mut().step_by(30) {
            *d = f64::NAN;
        }
        let found = identify_radio_noise(&holes, 1.0, 0.01, &SPECIFICATION).expect("a fit");
        assert!(found.residuals < whole.residuals - 350);
        assert!((found.sigma.value - whole.sigma.value).abs() < whole.sigma.sigma);
        assert!((found.tau_s.value - whole.tau_s.value).abs() < whole.tau_s.sigma);
    }

    #[test]
    fn hlt_6_upper_side_is_louder_and_faster() {
        let noise = identify_radio_noise(&hour(1001), 1.0, 0.01, &SPECIFICATION).expect("a fit");
        let (sigma, tau_s) = noise.upper_side(2.0);
        assert!(sigma > noise.sigma.value && tau_s < noise.tau_s.value && tau_s > 0.0);
    }

    #[test]
    fn hlt_6_identification_says_what_is_wrong() {
        let identify = |d: &[f64]| identify_radio_noise(d, 1.0, 0.01, &SPECIFICATION);
        let full = hour(1002);
        assert_eq!(identify(&full[..200]), Err(IdentificationError::TooShort { found: 200 }));
        assert_eq!(identify(&[1.0; 1000]), Err(IdentificationError::Constant));
        assert_eq!(
            identify_radio_noise(&full, -1.0, 0.01, &SPECIFICATION),
            Err(IdentificationError::Invalid("step_s"))
        );
        let bad = InertialSpecification { random_walk: f64::NAN, ..SPECIFICATION };
        assert_eq!(
            identify_radio_noise(&full, 1.0, 0.01, &bad),
            Err(IdentificationError::Invalid("random_walk"))
        );
        // White noise has no correlation time.
        let mut random = Pcg64::seed_from_u64(3);
        let white: Vec<f64> = (0..3600).map(|_| random.sample::<f64, _>(StandardNormal)).collect();
        assert!(identify(&white).is_err(), "{:?}", identify(&white));
    }
}
