//! The channel when the noise of its sensors is exponential-cosine: two more states.
//!
//! State x = [ΔV (m/s), δ (rad), a, a', ω, ω']: each sensor's error is the first component of a damped rotation
//!
//! ```text
//! (s, s')' = [−α −β; β −α] (s, s') + σ √(2α) (n, n')        R(t) = σ² e^(−α|t|) cos βt   [FIL-16]
//! ```
//!
//! driven by two independent white noises, which keeps the stationary covariance σ²I and the discretisation
//! free of cancellation. With β = 0 it is the first-order process, and the second component is idle.

use nalgebra::RealField;
use serde::{Deserialize, Serialize};

use super::kernel::{Farthest, Innovation, Kernel, Restart, are_finite, at_most, certain};
use super::model::{DOUBLINGS, QUADRATURE, TERMS};
use super::{FilterConfig, MarkovNoise};
use crate::number::{each, real, select, sine_and_cosine};
use crate::saved::{Blank, saved};

const STATES: usize = 6;

/// R(t) = σ² e^(−α|t|) cos βt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ColouredNoise<T> {
    /// Standard deviation σ, in the state's unit (m/s² for the accelerometer, rad/s for the gyro).
    pub sigma: T,
    /// Rate of decay α, 1/s.
    pub alpha: T,
    /// Angular frequency β, rad/s; zero for a first-order process.
    pub beta: T,
}

impl<T: RealField + Copy> ColouredNoise<T> {
    /// Level 2ασ² of each of the two white noises. [FIL-17]
    fn spectral_level(&self) -> T {
        real::<T>(2.0) * self.alpha * self.sigma * self.sigma
    }
}

impl<T: RealField + Copy> From<&MarkovNoise<T>> for ColouredNoise<T> {
    fn from(noise: &MarkovNoise<T>) -> Self {
        Self { sigma: noise.sigma, alpha: noise.tau_s.recip(), beta: T::zero() }
    }
}

/// x(k+1) = Φ x(k) + w(k), w ~ N(0, Q).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColouredModel<T> {
    /// Rows ΔV and δ of Φ.
    loop_rows: [[T; STATES]; 2],
    /// e^(−αΔ) cos βΔ and e^(−αΔ) sin βΔ of each sensor's rotation.
    rotations: [[T; 2]; 2],
    /// Q.
    noise: [[T; STATES]; STATES],
}

impl<T: RealField + Copy> ColouredModel<T> {
    /// Exact discretisation over `step_s` seconds, as for the four-state model.
    pub fn exact(
        config: &FilterConfig<T>,
        accelerometer: &ColouredNoise<T>,
        gyro: &ColouredNoise<T>,
        step_s: T,
    ) -> Self {
        let short = step_s * real(1.0 / f64::from(1u32 << DOUBLINGS));
        let sensors = [*accelerometer, *gyro];
        let mut rows = [[T::zero(); STATES]; 2];
        let mut noise = [[T::zero(); STATES]; STATES];
        for column in 0..STATES {
            let response = response(config, &sensors, column, short);
            rows[0][column] = response[0];
            rows[1][column] = response[1];
        }
        for (node, weight) in QUADRATURE {
            for column in 2..STATES {
                let c = response(config, &sensors, column, short * real(node));
                let level = sensors[(column - 2) / 2].spectral_level() * short * real(weight);
                for i in 0..STATES {
                    for j in 0..STATES {
                        noise[i][j] += level * c[i] * c[j];
                    }
                }
            }
        }
        let rotations = sensors.map(|sensor| {
            let decay = (-sensor.alpha * short).exp();
            let (sine, cosine) = sine_and_cosine(sensor.beta * short);
            [decay * cosine, decay * sine]
        });
        let mut model = Self { loop_rows: rows, rotations, noise };
        for _ in 0..DOUBLINGS {
            model = model.then(&model);
        }
        model
    }

    fn then(&self, next: &Self) -> Self {
        let row = |r: &[T; STATES]| {
            let mut out = [T::zero(); STATES];
            for (i, x) in out.iter_mut().enumerate() {
                *x = r[0] * self.loop_rows[0][i] + r[1] * self.loop_rows[1][i];
            }
            for (sensor, [c, s]) in self.rotations.iter().enumerate() {
                let (first, second) = (2 + 2 * sensor, 3 + 2 * sensor);
                out[first] += r[first] * *c + r[second] * *s;
                out[second] += r[second] * *c - r[first] * *s;
            }
            out
        };
        let turned = |[c1, s1]: [T; 2], [c2, s2]: [T; 2]| [c1 * c2 - s1 * s2, s1 * c2 + c1 * s2];
        let mut carried = ColouredGaussian { mean: [T::zero(); STATES], covariance: self.noise };
        carried.predict(next);
        Self {
            loop_rows: [row(&next.loop_rows[0]), row(&next.loop_rows[1])],
            rotations: [
                turned(self.rotations[0], next.rotations[0]),
                turned(self.rotations[1], next.rotations[1]),
            ],
            noise: carried.covariance,
        }
    }

    /// Φ x.
    #[inline(always)]
    fn transition(&self, [v, d, a, b, w, x]: [T; STATES]) -> [T; STATES] {
        let [[vv, vd, va, vb, vw, vx], [dv, dd, da, db, dw, dx]] = self.loop_rows;
        let [[ca, sa], [cw, sw]] = self.rotations;
        [
            vv * v + vd * d + va * a + vb * b + vw * w + vx * x,
            dv * v + dd * d + da * a + db * b + dw * w + dx * x,
            ca * a - sa * b,
            sa * a + ca * b,
            cw * w - sw * x,
            sw * w + cw * x,
        ]
    }
}

/// e^(F s) applied to a unit vector.
fn response<T: RealField + Copy>(
    config: &FilterConfig<T>,
    sensors: &[ColouredNoise<T>; 2],
    column: usize,
    s: T,
) -> [T; STATES] {
    let mut term = [T::zero(); STATES];
    for (i, x) in term.iter_mut().enumerate() {
        *x = if i == column { T::one() } else { T::zero() };
    }
    let mut sum = term;
    for k in 1..=TERMS {
        let [v, d, a, a2, w, w2] = term;
        let [sa, sw] = sensors;
        let scale = s / real(f64::from(k));
        term = [
            scale * (a - config.gravity * d),
            scale * (v / config.radius_m + w),
            scale * (-sa.alpha * a - sa.beta * a2),
            scale * (sa.beta * a - sa.alpha * a2),
            scale * (-sw.alpha * w - sw.beta * w2),
            scale * (sw.beta * w - sw.alpha * w2),
        ];
        for (sum, term) in sum.iter_mut().zip(term) {
            *sum += term;
        }
    }
    sum
}

/// A Gaussian over the six states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColouredGaussian<T> {
    mean: [T; STATES],
    covariance: [[T; STATES]; STATES],
}

impl<T: RealField + Copy> ColouredGaussian<T> {
    /// Independent states: ΔV and δ as given (m/s, rad), the sensors' errors stationary.
    pub fn stationary(
        mean: [T; 2],
        sigma: [T; 2],
        accelerometer: &ColouredNoise<T>,
        gyro: &ColouredNoise<T>,
    ) -> Self {
        let zero = T::zero();
        let sigma = [sigma[0], sigma[1], accelerometer.sigma, accelerometer.sigma, gyro.sigma, gyro.sigma];
        let mut covariance = [[zero; STATES]; STATES];
        for (i, (row, sigma)) in covariance.iter_mut().zip(sigma).enumerate() {
            row[i] = sigma * sigma;
        }
        Self { mean: [mean[0], mean[1], zero, zero, zero, zero], covariance }
    }

    /// Puts below the diagonal what stands above it.
    #[inline(always)]
    fn mirror(&mut self) {
        let p = &mut self.covariance;
        [_, p[1][0], p[2][0], p[3][0], p[4][0], p[5][0]] = p[0];
        [_, _, p[2][1], p[3][1], p[4][1], p[5][1]] = p[1];
        [_, _, _, p[3][2], p[4][2], p[5][2]] = p[2];
        [_, _, _, _, p[4][3], p[5][3]] = p[3];
        [_, _, _, _, _, p[5][4]] = p[4];
    }
}

impl<T: RealField + Copy> Kernel<T> for ColouredGaussian<T> {
    type Model = ColouredModel<T>;

    fn mean(&self) -> [T; 4] {
        [self.mean[0], self.mean[1], self.mean[2], self.mean[4]]
    }

    fn variances(&self) -> [T; 4] {
        let p = &self.covariance;
        [p[0][0], p[1][1], p[2][2], p[4][4]]
    }

    fn predict(&mut self, model: &ColouredModel<T>) {
        self.mean = model.transition(self.mean);
        // P is symmetric: the rows of P Φᵀ are Φ applied to the rows of P; once more over the columns gives
        // Φ P Φᵀ.
        let half = self.covariance.map(|row| model.transition(row));
        for (i, (row, noise)) in self.covariance.iter_mut().zip(&model.noise).enumerate() {
            let full = model.transition(each!(|k| half[k][i]; 0 1 2 3 4 5));
            *row = each!(|j| full[j] + noise[j]; 0 1 2 3 4 5);
        }
        self.mirror();
    }

    #[inline]
    fn spread_velocity(&mut self, variance: T) {
        self.covariance[0][0] += variance;
    }

    #[inline]
    fn correct(&mut self, innovation: &Innovation<T>, used: bool) {
        let first = self.covariance[0];
        let inverse = select(used, innovation.variance.recip(), T::zero());
        let value = select(used, innovation.value, T::zero());
        let gain = each!(|i| first[i] * inverse; 0 1 2 3 4 5);
        self.mean = each!(|i| self.mean[i] + gain[i] * value; 0 1 2 3 4 5);
        // Joseph form, as for four states.
        let uncertain = T::one() - certain::<T>();
        let left = select(used, innovation.noise * inverse, T::one());
        for ((row, &k), &p) in self.covariance.iter_mut().zip(&gain).zip(&first) {
            let excess = k * innovation.variance - p;
            *row = each!(|j| row[j] + gain[j] * excess - k * first[j]; 0 1 2 3 4 5);
        }
        for i in 1..STATES {
            self.covariance[i][i] += uncertain * gain[i] * first[i];
        }
        self.covariance[0] = each!(|j| first[j] * left; 0 1 2 3 4 5);
        self.mirror();
    }

    #[inline]
    fn is_sound(&self) -> bool {
        let variances = each!(|i| self.covariance[i][i]; 0 1 2 3 4 5);
        let finite = are_finite(self.mean.iter().chain(&variances));
        variances.iter().fold(finite, |sound, &p| sound & (p > T::zero()))
    }

    #[inline]
    fn restart_if(&mut self, restart: &Restart<T>, prior: &Self, most: &Farthest<T>) {
        let mean = |own: T, prior: T, most: T| {
            let start = select(own.abs() <= most, own, prior);
            select(restart.condition, start, own)
        };
        let variance = |own: T, prior: T, most: T| {
            let start = select(restart.variance_of_prior, prior, at_most(own * restart.factor, most));
            select(restart.condition, start, own)
        };
        let correlation = |own: T| select(restart.condition, T::zero(), own);

        // Written out: of a loop over a condition the compiler makes two, one of them shorter.
        let [_, d, a, b, w, x] = self.mean;
        let [_, prior_d, prior_a, prior_b, prior_w, prior_x] = prior.mean;
        let [_, most_d, most_a, most_w] = most.mean;
        self.mean = [
            restart.velocity,
            mean(d, prior_d, most_d),
            mean(a, prior_a, most_a),
            mean(b, prior_b, most_a),
            mean(w, prior_w, most_w),
            mean(x, prior_x, most_w),
        ];
        let [
            [vv, vd, va, vb, vw, vx],
            [_, dd, da, db, dw, dx],
            [_, _, aa, ab, aw, ax],
            [_, _, _, bb, bw, bx],
            [_, _, _, _, ww, wx],
            [.., xx],
        ] = self.covariance;
        let [
            _,
            [_, prior_d, ..],
            [_, _, prior_a, ..],
            [_, _, _, prior_b, ..],
            [.., prior_w, _],
            [.., prior_x],
        ] = prior.covariance;
        let [_, most_d, most_a, most_w] = most.variance;
        let vv = select(restart.condition, restart.velocity_variance, vv);
        let [vd, va, vb, vw, vx] =
            [correlation(vd), correlation(va), correlation(vb), correlation(vw), correlation(vx)];
        let [da, db, dw, dx] = [correlation(da), correlation(db), correlation(dw), correlation(dx)];
        let [ab, aw, ax] = [correlation(ab), correlation(aw), correlation(ax)];
        let [bw, bx, wx] = [correlation(bw), correlation(bx), correlation(wx)];
        let dd = variance(dd, prior_d, most_d);
        let (aa, bb) = (variance(aa, prior_a, most_a), variance(bb, prior_b, most_a));
        let (ww, xx) = (variance(ww, prior_w, most_w), variance(xx, prior_x, most_w));
        self.covariance = [
            [vv, vd, va, vb, vw, vx],
            [vd, dd, da, db, dw, dx],
            [va, da, aa, ab, aw, ax],
            [vb, db, ab, bb, bw, bx],
            [vw, dw, aw, bw, ww, wx],
            [vx, dx, ax, bx, wx, xx],
        ];
    }
}

saved!([T: Blank] ColouredNoise<T> { sigma, alpha, beta });
saved!([T: Blank] ColouredModel<T> { loop_rows, rotations, noise });
saved!([T: Blank] ColouredGaussian<T> { mean, covariance });

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::filter::{DiscreteModel, Gaussian};

    const CONFIG: FilterConfig<f64> = FilterConfig {
        radius_m: 6_371_000.0,
        gravity: 9.80665,
        step_s: 1.0,
        accelerometer: MarkovNoise { sigma: 1e-3, tau_s: 60.0 },
        gyro: MarkovNoise { sigma: 5e-7, tau_s: 1800.0 },
        velocity_noise: 0.1,
        initial_velocity_sigma: 0.1,
        initial_vertical_sigma: 1e-4,
        gate_sigma: 6.0,
    };

    #[test]
    fn fil_16_fil_17_rotation_and_driving_noise_keep_the_variance_and_give_the_autocorrelation() {
        let noise = ColouredNoise { sigma: 1.0, alpha: 1.0 / 600.0, beta: core::f64::consts::TAU / 1800.0 };
        let gyro = ColouredNoise::from(&CONFIG.gyro);
        let model = ColouredModel::exact(&CONFIG, &noise, &gyro, 10.0);
        let decay = (-10.0 * noise.alpha).exp();
        assert!((model.rotations[0][0] - decay * (10.0 * noise.beta).cos()).abs() < 1e-14);
        assert!((model.rotations[0][1] - decay * (10.0 * noise.beta).sin()).abs() < 1e-14);
        assert!((model.noise[2][2] - (1.0 - decay * decay)).abs() < 1e-13);
        assert!(model.noise[2][3].abs() < 1e-13);
    }

    #[test]
    fn fil_16_without_frequency_is_the_four_state_filter() {
        let four =
            DiscreteModel::exact(CONFIG.radius_m, CONFIG.gravity, &CONFIG.accelerometer, &CONFIG.gyro, 10.0);
        let (a, w) = (ColouredNoise::from(&CONFIG.accelerometer), ColouredNoise::from(&CONFIG.gyro));
        let six = ColouredModel::exact(&CONFIG, &a, &w, 10.0);
        let mut small = CONFIG.prior();
        let mut large = ColouredGaussian::stationary([0.0; 2], [0.1, 1e-4], &a, &w);
        for k in 0..crate::repeats(500) {
            let z = (f64::from(k) * 0.1).sin();
            Gaussian::predict(&mut small, &four);
            large.predict(&six);
            let (i, j) = (small.innovation(z, 0.001), large.innovation(z, 0.001));
            assert!((i.value - j.value).abs() < 1e-9 && (i.variance / j.variance - 1.0).abs() < 1e-9);
            small.correct(&i, k % 3 != 0);
            large.correct(&j, k % 3 != 0);
        }
        for (x, y) in small.variances().into_iter().zip(large.variances()) {
            assert!((x / y - 1.0).abs() < 1e-9);
        }
    }
}
