//! The innovation of the velocity channel, and what a unit of a series would have added to it.
//!
//! The filter is linear: the innovation is the sum of what every cause has made of it. So a series goes through the loop and through
//! the filter by itself, with the gains that the filter had: the state here is the response of the loop to the series less the
//! filter's estimate of it,
//!
//! ```text
//! e⁻ = Φ e + B φ̄        ν_φ = e⁻₀ + h φ        e = e⁻ − K ν_φ
//! ```
//!
//! φ̄ is the mean of the series over the step, B what a constant error of accelerometer or gyro makes of the loop [FIL-3], and h
//! is one for an error of the velocity measurement. The loop alone forgets nothing; e is forgotten as the filter forgets, which is why
//! single precision is enough. Both sides are divided by the standard deviation √S of the innovation.
//!
//! A retune that takes the state from a replay, as the identification does, moves the filter in a way that e does not know.
//! The series is then wrong for as long as the filter remembers; that costs evidence and makes none up.
use crate::filter::{DiscreteModel, ErrorFilter, FilterConfig, FilterStep};
use crate::number::{select, sine_and_cosine};
use crate::saved::saved;

use super::config::{Port, Regressor};

/// Φ without its zeros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    velocity: [f32; 4],
    vertical: [f32; 4],
    decay: [f32; 2],
}

impl Transition {
    /// Over no time.
    pub const IDENTITY: Self =
        Self { velocity: [1.0, 0.0, 0.0, 0.0], vertical: [0.0, 1.0, 0.0, 0.0], decay: [1.0; 2] };

    /// This one, then `next`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let row = |[v, d, a, w]: [f32; 4]| {
            let ([vv, vd, va, vw], [dv, dd, da, dw]) = (self.velocity, self.vertical);
            let [decay_a, decay_w] = self.decay;
            [v * vv + d * dv, v * vd + d * dd, v * va + d * da + a * decay_a, v * vw + d * dw + w * decay_w]
        };
        let ([a, w], [next_a, next_w]) = (self.decay, next.decay);
        Self { velocity: row(next.velocity), vertical: row(next.vertical), decay: [a * next_a, w * next_w] }
    }

    fn apply(&self, [v, d, a, w]: [f32; 4]) -> [f32; 4] {
        let row = |[rv, rd, ra, rw]: [f32; 4]| rv * v + rd * d + ra * a + rw * w;
        let [decay_a, decay_w] = self.decay;
        [row(self.velocity), row(self.vertical), decay_a * a, decay_w * w]
    }
}

impl From<&DiscreteModel<f32>> for Transition {
    fn from(model: &DiscreteModel<f32>) -> Self {
        Self { velocity: model.velocity, vertical: model.vertical, decay: model.decay }
    }
}

/// What the filter has done in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterPass {
    transition: Transition,
    duration_s: f32,
    /// There was a measurement, and it was used.
    used: bool,
    /// Velocity was taken from the measurement before the step, or after it.
    restarted: [bool; 2],
    /// K; zero without a measurement that was used.
    gain: [f32; 4],
    /// ν, m/s.
    innovation: f32,
    /// 1/√S, s/m.
    weight: f32,
}

impl FilterPass {
    /// Of a filter that has just made `step` over `duration_s` seconds.
    ///
    /// `bridged`: what it was moved by before the step; `measured`: it had a measurement; `restarted`: and took its velocity from
    /// that before the step.
    pub fn of(
        filter: &ErrorFilter<f32>,
        step: &FilterStep<f32>,
        bridged: &Transition,
        duration_s: f32,
        measured: bool,
        restarted: bool,
    ) -> Self {
        let used = measured & !step.gated & !step.reset & step.innovation.value.is_finite();
        // In the Joseph form the velocity's row of the covariance after the measurement is r² Kᵀ.
        let [vv, vd, va, vw, ..] = filter.state().covariance;
        let inverse = select(used, step.innovation.noise.recip(), 0.0);
        Self {
            transition: bridged.then(&filter.model().into()),
            duration_s,
            used,
            restarted: [restarted & measured, step.reacquired],
            gain: [vv, vd, va, vw].map(|p| p * inverse),
            innovation: step.innovation.value,
            weight: libm::sqrtf(step.innovation.variance).recip(),
        }
    }

    /// ν/√S, of variance one where the filter knows its noise.
    pub(super) fn whitened(&self) -> f32 {
        self.innovation * self.weight
    }

    /// Whether the step has an innovation that counts.
    pub(super) fn counts(&self) -> bool {
        self.used
    }
}

/// The series in the innovation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Signatures<const N: usize> {
    /// e of each series.
    states: [[f32; 4]; N],
    /// Values of the step before.
    last: [f32; N],
}

impl<const N: usize> Signatures<N> {
    pub(super) const NONE: Self = Self { states: [[0.0; 4]; N], last: [0.0; N] };

    /// One step: ν_φ/√S of each series, for a coefficient of one σ of the noise of the series' port.
    pub(super) fn step(
        &mut self,
        pass: &FilterPass,
        config: &FilterConfig<f32>,
        regressors: &[Regressor; N],
        values: &[f32; N],
    ) -> [f32; N] {
        let ports = Ports::over(pass.duration_s, config);
        let mut whitened = [0.0; N];
        let series = self.states.iter_mut().zip(&mut self.last).zip(regressors.iter().zip(values));
        for (whitened, ((state, last), (regressor, &now))) in whitened.iter_mut().zip(series) {
            let Drive { velocity, vertical, direct } = ports.of(regressor.port);
            let mean = 0.5 * (*last + now);
            let direct = direct * now;
            *last = now;
            let [v, d, a, w] = *state;
            let [from_start, from_end] = pass.restarted;
            let [v, d, a, w] = pass.transition.apply([select(from_start, -direct, v), d, a, w]);
            let (v, d) = (v + velocity * mean, d + vertical * mean);
            let innovation = v + direct;
            let [kv, kd, ka, kw] = pass.gain;
            let v = select(from_end, -direct, v - kv * innovation);
            let after = [v, d - kd * innovation, a - ka * innovation, w - kw * innovation];
            let sound = after.iter().fold(true, |sound, x| sound & x.is_finite());
            *state = after.map(|x| select(sound, x, 0.0));
            *whitened = innovation * pass.weight;
        }
        whitened
    }
}

/// What one σ of an error over a step makes of velocity and vertical, and of the measurement at its end.
#[derive(Clone, Copy)]
struct Drive {
    velocity: f32,
    vertical: f32,
    direct: f32,
}

struct Ports {
    accelerometer: Drive,
    gyro: Drive,
    measurement: Drive,
}

impl Ports {
    /// The loop at rest driven by a constant error: ΔV = a sin(s)/ω₀ and δ = (1 − cos s) a/g of the accelerometer's, and
    /// ΔV = −R (1 − cos s) ω and δ = ω sin(s)/ω₀ of the gyro's, with s = ω₀Δ.
    fn over(duration_s: f32, config: &FilterConfig<f32>) -> Self {
        let (radius, gravity) = (config.radius_m, config.gravity);
        let schuler = libm::sqrtf(gravity / radius);
        // By the half angle: one less a cosine near one has no digits.
        let (sine, cosine) = sine_and_cosine(0.5 * schuler * duration_s);
        let (integral, versine) = (2.0 * sine * cosine / schuler, 2.0 * sine * sine);
        let (accelerometer, gyro) = (config.accelerometer.sigma, config.gyro.sigma);
        Self {
            accelerometer: Drive {
                velocity: accelerometer * integral,
                vertical: accelerometer * versine / gravity,
                direct: 0.0,
            },
            gyro: Drive { velocity: -gyro * radius * versine, vertical: gyro * integral, direct: 0.0 },
            measurement: Drive { velocity: 0.0, vertical: 0.0, direct: config.velocity_noise },
        }
    }

    fn of(&self, port: Port) -> Drive {
        match port {
            Port::Accelerometer => self.accelerometer,
            Port::Gyro => self.gyro,
            Port::Velocity => self.measurement,
        }
    }
}

saved!([const N: usize] Signatures<N> { states, last });
