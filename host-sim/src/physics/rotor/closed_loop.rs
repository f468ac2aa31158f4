//! Rotor and loop, moving.
use nalgebra::{Complex, ComplexField};

use super::equations::{ComplexState, I, Inputs, State, system, torque_parts};
use super::response::Response;
use super::{Excitation, Harmonics, Rebalance, Rotor};
use crate::physics::linear::{exponential, growth};

/// Rotor and loop, moving.
#[derive(Clone, Debug)]
pub struct ClosedLoop {
    rotor: Rotor,
    rebalance: Rebalance,
    state: State,
    /// Angle of the shaft, rad.
    angle: f64,
}

/// Why a loop cannot be simulated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the rebalance loop is unstable: its fastest mode grows at {growth:.3} 1/s")]
pub struct Unstable {
    /// Largest real part of the loop's eigenvalues, 1/s.
    pub growth: f64,
}

impl ClosedLoop {
    /// Rotor and loop at rest.
    ///
    /// # Errors
    /// A loop that is not stable.
    pub fn new(rotor: Rotor, rebalance: Rebalance) -> Result<Self, Unstable> {
        let growth = growth(&system(&rotor, &rebalance, 0.0));
        if growth < 0.0 {
            Ok(Self { rotor, rebalance, state: State::zeros(), angle: 0.0 })
        } else {
            Err(Unstable { growth })
        }
    }

    /// The rotor in use.
    pub fn rotor(&self) -> &Rotor {
        &self.rotor
    }

    /// Replaces the rotor by one whose parameters have moved (with temperature); the motion goes on.
    pub fn set_rotor(&mut self, rotor: Rotor) {
        self.rotor = rotor;
    }

    /// Response at the present parameters.
    pub fn response(&self, spin_axis_rate: f64, harmonics: &Harmonics, step_s: f64) -> Response {
        Response::new(&self.rotor, &self.rebalance, spin_axis_rate, harmonics, step_s)
    }

    /// Eigenvalues of rotor and loop seen from the case are those of the shaft frame shifted by ±iN; here in shaft axes.
    pub fn eigenvalues(&self) -> Vec<Complex<f64>> {
        system(&self.rotor, &self.rebalance, 0.0).complex_eigenvalues().iter().copied().collect()
    }

    /// Pick-off angles in case axes, rad.
    pub fn pickoff(&self) -> Complex<f64> {
        Complex::new(self.state[0], self.state[1]) * Complex::from_polar(1.0, self.angle)
    }

    /// Puts the state where the response says it is for a steady excitation.
    pub fn settle(&mut self, response: &Response, excitation: &Excitation) {
        let amplitude = response.amplitude(excitation, &Excitation::default());
        self.state = real_part(&amplitude, self.angle) + response.carried;
    }

    /// Moves on by a step in which the excitation goes linearly from `start` to `end`, and returns the mean torque of
    /// the loop over the step, in case axes. Exact for the parameters and the step of the response.
    pub fn advance(&mut self, response: &Response, start: &Excitation, end: &Excitation) -> Complex<f64> {
        let step_s = response.step_s;
        let spin = self.rotor.spin;
        let slope = Excitation {
            rate: (end.rate - start.rate) / step_s,
            torque: (end.torque - start.torque) / step_s,
            pickoff: (end.pickoff - start.pickoff) / step_s,
        };
        let (first, last) = (response.amplitude(start, &slope), response.amplitude(end, &slope));
        let angle = self.angle;
        self.angle = (angle + spin * step_s) % std::f64::consts::TAU;

        let transient = self.state - real_part(&first, angle) - response.carried;
        let ((constant_0, double_0), (constant_1, double_1)) = (torque_parts(&first), torque_parts(&last));
        let turned = I * spin * step_s;
        // Mean of e^{2iNt} and e^{iNt} over the step; the amplitude at 2N taken at mid-step.
        let mean_2n = Complex::from_polar(1.0, 2.0 * angle) * ((turned * 2.0).exp() - 1.0) / (turned * 2.0);
        let mean_1n = Complex::from_polar(1.0, angle) * (turned.exp() - 1.0) / turned;
        let carried = Complex::new(response.carried[8], response.carried[9]);
        let mut torque =
            (constant_0 + constant_1) * 0.5 + (double_0 + double_1) * 0.5 * mean_2n + carried * mean_1n;

        let left = response.transition * transient;
        let change = left.map(Complex::from) * turned.exp() - transient.map(Complex::from);
        torque += Complex::from_polar(1.0, angle) * (response.transient_torque * change)[0] / step_s;
        self.state = real_part(&last, self.angle) + response.carried + left;
        torque
    }

    /// The same by full-rate integration (fourth-order Runge–Kutta, `per_turn` steps a turn), for any excitation:
    /// a function of the time since the start of the step. Returns the mean torque over the step, in case axes.
    pub fn integrate(
        &mut self,
        spin_axis_rate: f64,
        harmonics: &Harmonics,
        step_s: f64,
        per_turn: u32,
        mut excitation: impl FnMut(f64) -> (Excitation, Complex<f64>),
    ) -> Complex<f64> {
        let system = system(&self.rotor, &self.rebalance, spin_axis_rate);
        let inputs = Inputs::new(&self.rotor, &self.rebalance, spin_axis_rate);
        let spin = self.rotor.spin;
        let start_angle = self.angle;
        let steps = (step_s * spin / std::f64::consts::TAU * f64::from(per_turn)).ceil().max(1.0) as usize;
        let h = step_s / steps as f64;

        let mut forcing = |t: f64| -> State {
            let (now, rate_slope) = excitation(t);
            let turn = Complex::from_polar(1.0, start_angle + spin * t);
            let into_shaft = turn.conj();
            let vibration = harmonics.vibration_2n * turn * turn;
            let rate = (now.rate + vibration) * into_shaft;
            let rate_derivative = (rate_slope + vibration * (2.0 * I * spin)) * into_shaft - I * spin * rate;
            let torque = now.torque * into_shaft;
            let pickoff =
                (now.pickoff + harmonics.runout_1n * turn + harmonics.runout_2n * turn * turn) * into_shaft;
            let part = |columns: &[State; 2], w: Complex<f64>| columns[0] * w.re + columns[1] * w.im;
            part(&inputs.rate, rate)
                + part(&inputs.rate_derivative, rate_derivative)
                + part(&inputs.torque, torque)
                + part(&inputs.pickoff, pickoff)
        };
        let torque_in_case = |state: &State, t: f64| {
            Complex::new(state[8], state[9]) * Complex::from_polar(1.0, start_angle + spin * t)
        };

        let mut sum = Complex::from(0.0);
        let mut b0 = forcing(0.0);
        for k in 0..steps {
            let t = k as f64 * h;
            let (bm, b1) = (forcing(t + 0.5 * h), forcing(t + h));
            let x = self.state;
            let k1 = system * x + b0;
            let k2 = system * (x + k1 * (0.5 * h)) + bm;
            let k3 = system * (x + k2 * (0.5 * h)) + bm;
            let k4 = system * (x + k3 * h) + b1;
            let next = x + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
            // Simpson over the step, the middle by Hermite interpolation.
            let middle = (x + next) * 0.5 + (k1 - (system * next + b1)) * (h / 8.0);
            sum += (torque_in_case(&x, t)
                + torque_in_case(&middle, t + 0.5 * h) * 4.0
                + torque_in_case(&next, t + h))
                * (h / 6.0);
            self.state = next;
            b0 = b1;
        }
        self.angle = (start_angle + spin * step_s) % std::f64::consts::TAU;
        sum / step_s
    }

    /// Stationary variance of one pick-off angle under white pick-off noise of this density (rad/√Hz), rad².
    ///
    /// The loop answers pick-off noise by moving the rotor, so this angle is what such noise adds to the integral of
    /// the output.
    pub fn pickoff_noise_variance(&self, density: f64) -> f64 {
        let system = system(&self.rotor, &self.rebalance, 0.0);
        let inputs = Inputs::new(&self.rotor, &self.rebalance, 0.0);
        let spectral = density * density / 2.0;
        let drive = inputs.pickoff[0] * inputs.pickoff[0].transpose()
            + inputs.pickoff[1] * inputs.pickoff[1].transpose();
        // P(2h) = P(h) + Φ P(h) Φᵀ from a short step on; the last doubling covers every transient.
        let h = 1e-3 / (self.rotor.spin + self.rebalance.torquer + self.rebalance.pickoff);
        let mut transition = exponential(&(system * h));
        let mut covariance = drive * (spectral * h);
        for _ in 0..60 {
            covariance += transition * covariance * transition.transpose();
            transition *= transition;
            if transition.norm() < 1e-30 {
                break;
            }
        }
        0.5 * (covariance[(0, 0)] + covariance[(1, 1)])
    }
}

fn real_part(amplitude: &ComplexState, angle: f64) -> State {
    let turn = Complex::from_polar(1.0, angle);
    amplitude.map(|v| (v * turn).real())
}
