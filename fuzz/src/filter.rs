//! The error filter: its covariance after every call, its means after a step.
use arbitrary::{Result, Unstructured};
use schuler_core::filter::{ErrorFilter, FilterConfig, Gaussian, MarkovNoise};
use schuler_core::module::ModuleConfig;

use crate::source;

/// Rounding of a correlation matrix: how far below zero its least eigenvalue may come out. (A pivot of its factor may come out
/// further below, where those before it are all but singular: they divide what rounding has left.)
const ROUNDING: [f64; 2] = [1e-5, 1e-12];

/// Measurements, gaps and new noise, in single and double precision at once.
pub fn filter(data: &[u8]) {
    // Bytes that end too early end the run.
    let _ = run(&mut Unstructured::new(data));
}

fn run(source: &mut Unstructured<'_>) -> Result<()> {
    let single = ModuleConfig::default().filter;
    let double = doubled(&single);
    let build = "the configuration is sound";
    let mut singles: ErrorFilter<f32> = ErrorFilter::try_build(&single).expect(build);
    let mut doubles: ErrorFilter<f64> = ErrorFilter::try_build(&double).expect(build);
    for _ in 0..200 {
        // Past their end, the bytes are zeros.
        if source.is_empty() {
            break;
        }
        let what = source.arbitrary::<u8>()?;
        match what {
            0..8 => {
                let steps = source.int_in_range(1..=600u16)?;
                singles.coast(&single.model(&single.accelerometer, &single.gyro, f32::from(steps)));
                doubles.coast(&double.model(&double.accelerometer, &double.gyro, f64::from(steps)));
            }
            8..16 => {
                // Within a thousand times either way of the data sheet, as the identification is.
                let mut factor = || source.arbitrary::<u8>().map(|k| 10f32.powf(f32::from(k) / 42.5 - 3.0));
                let accelerometer = scaled(single.accelerometer, factor()?, factor()?);
                let gyro = scaled(single.gyro, factor()?, factor()?);
                let retuned = FilterConfig { accelerometer, gyro, ..single };
                singles.retune(retuned.model(&accelerometer, &gyro, 1.0), retuned.prior());
                let retuned = doubled(&retuned);
                doubles.retune(retuned.model(&retuned.accelerometer, &retuned.gyro, 1.0), retuned.prior());
            }
            16..20 => {
                let velocity = source::number(source, 1.0)? as f32;
                if velocity.is_finite() {
                    singles.reacquire(velocity);
                    doubles.reacquire(f64::from(velocity));
                }
            }
            20..60 => {
                singles.step(None);
                doubles.step(None);
            }
            _ => {
                let velocity = source::number(source, 0.3)?;
                singles.step(Some(velocity as f32));
                doubles.step(Some(velocity));
            }
        }
        let after = widened(singles.state());
        check(&after, ROUNDING[0]);
        check(doubles.state(), ROUNDING[1]);
        // A velocity error of 10³⁸ m/s may end at infinity over a gap, and starts again in the next step.
        let stepped = what >= 20;
        let mut means = after.mean.iter().chain(&doubles.state().mean);
        assert!(!stepped || means.all(|mean| mean.is_finite()), "{after:?} {:?}", doubles.state());
    }
    Ok(())
}

fn scaled(noise: MarkovNoise<f32>, sigma: f32, tau: f32) -> MarkovNoise<f32> {
    MarkovNoise { sigma: noise.sigma * sigma, tau_s: (noise.tau_s * tau).max(1.0) }
}

fn doubled(config: &FilterConfig<f32>) -> FilterConfig<f64> {
    let noise =
        |it: &MarkovNoise<f32>| MarkovNoise { sigma: f64::from(it.sigma), tau_s: f64::from(it.tau_s) };
    FilterConfig {
        radius_m: f64::from(config.radius_m),
        gravity: f64::from(config.gravity),
        step_s: f64::from(config.step_s),
        accelerometer: noise(&config.accelerometer),
        gyro: noise(&config.gyro),
        velocity_noise: f64::from(config.velocity_noise),
        initial_velocity_sigma: f64::from(config.initial_velocity_sigma),
        initial_vertical_sigma: f64::from(config.initial_vertical_sigma),
        gate_sigma: f64::from(config.gate_sigma),
    }
}

fn widened(state: &Gaussian<f32>) -> Gaussian<f64> {
    Gaussian { mean: state.mean.map(f64::from), covariance: state.covariance.map(f64::from) }
}

/// The correlation matrix has a Cholesky factor once the rounding of its precision is added to its diagonal.
fn check(state: &Gaussian<f64>, rounding: f64) {
    assert!(state.covariance.iter().all(|x| x.is_finite()), "{state:?}");
    let [vv, vd, va, vw, dd, da, dw, aa, aw, ww] = state.covariance;
    let variances = [vv, dd, aa, ww];
    assert!(variances.iter().all(|&variance| variance > 0.0), "{state:?}");
    let sigma = variances.map(f64::sqrt);
    let rows = [[vv, vd, va, vw], [vd, dd, da, dw], [va, da, aa, aw], [vw, dw, aw, ww]];
    let mut factor = [[0.0f64; 4]; 4];
    for row in 0..4 {
        for column in 0..=row {
            let sum: f64 = (0..column).map(|k| factor[row][k] * factor[column][k]).sum();
            let left = rows[row][column] / (sigma[row] * sigma[column]) - sum;
            factor[row][column] = if row == column {
                assert!(left > -rounding, "an eigenvalue below {}: {state:?}", -rounding);
                (left + rounding).sqrt()
            } else {
                left / factor[column][column]
            };
        }
    }
}
