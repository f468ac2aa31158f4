//! The exact response of rotor and loop to inputs that change linearly in time.
use nalgebra::{Complex, SMatrix};

use super::equations::{
    ComplexMatrix, ComplexState, I, Inputs, Matrix, STATES, State, case_fixed, system, torque_parts,
    turning_twice,
};
use super::{Excitation, Harmonics, Rebalance, Rotor};
use crate::physics::linear::exponential;

/// Mean torque of the loop for one input: constant part and lag.
#[derive(Clone, Copy, Debug)]
struct Gain {
    /// Amplitude of the state at N in shaft axes for a unit input.
    level: ComplexState,
    /// The same for a unit slope of the input.
    slope: ComplexState,
}

/// The response of rotor and loop, once transients have died, to inputs that change linearly in time.
#[derive(Clone, Debug)]
pub struct Response {
    rate: Gain,
    torque: Gain,
    pickoff: Gain,
    /// Amplitude at N in shaft axes of the response to what turns at 2N in the case.
    turning: ComplexState,
    /// Constant in shaft axes: the response to what turns at N in the case.
    pub(super) carried: State,
    pub(super) step_s: f64,
    /// How a transient decays over the step.
    pub(super) transition: Matrix,
    /// Row that gives, from the change of the transient over the step, the integral of its torque in case axes.
    pub(super) transient_torque: SMatrix<Complex<f64>, 1, STATES>,
}

impl Response {
    /// Solves for these parameters, the case's rate about the spin axis, the harmonics, and steps of one length.
    pub fn new(
        rotor: &Rotor,
        rebalance: &Rebalance,
        spin_axis_rate: f64,
        harmonics: &Harmonics,
        step_s: f64,
    ) -> Self {
        let system = system(rotor, rebalance, spin_axis_rate);
        let inputs = Inputs::new(rotor, rebalance, spin_axis_rate);
        let spin = rotor.spin;
        let shifted = ComplexMatrix::from_diagonal_element(I * spin) - system.map(Complex::from);
        let factors = shifted.lu();
        // A closed loop that passed `Rebalance` checks has no eigenvalue on the imaginary axis.
        let solve = |b: ComplexState| factors.solve(&b).unwrap_or_else(ComplexState::zeros);
        let gain = |level: ComplexState, slope: ComplexState| {
            let level = solve(level);
            Gain { level, slope: solve(slope - level) }
        };
        let rate_derivative = case_fixed(&inputs.rate_derivative);
        let rate = gain(case_fixed(&inputs.rate) + rate_derivative * (I * spin), rate_derivative);
        let torque = gain(case_fixed(&inputs.torque), ComplexState::zeros());
        let pickoff = gain(case_fixed(&inputs.pickoff), ComplexState::zeros());
        let turning = solve(
            (turning_twice(&inputs.rate) + turning_twice(&inputs.rate_derivative) * (I * spin))
                * harmonics.vibration_2n
                + turning_twice(&inputs.pickoff) * harmonics.runout_2n,
        );
        let runout = harmonics.runout_1n;
        let carried = if runout == Complex::from(0.0) {
            State::zeros()
        } else {
            (-system)
                .lu()
                .solve(&(inputs.pickoff[0] * runout.re + inputs.pickoff[1] * runout.im))
                .unwrap_or_else(State::zeros)
        };
        // ∫ e^{iNt} cᵀ e^{At} d dt = cᵀ (A + iN)⁻¹ (e^{(A + iN)Δ} − 1) d with the torque's row cᵀ = [.., 1, i].
        let mut row = ComplexState::zeros();
        row[8] = Complex::from(1.0);
        row[9] = I;
        let shifted = system.map(Complex::from) + ComplexMatrix::from_diagonal_element(I * spin);
        let transient_torque =
            shifted.transpose().lu().solve(&row).unwrap_or_else(ComplexState::zeros).transpose();
        let transition = exponential(&(system * step_s));
        Self { rate, torque, pickoff, turning, carried, step_s, transition, transient_torque }
    }

    /// Torque of the loop, constant in the case, that answers a steady excitation, N m.
    pub fn constant_torque(&self, excitation: &Excitation) -> Complex<f64> {
        torque_parts(&self.amplitude(excitation, &Excitation::default())).0
    }

    /// Torque of the loop, constant in the case, that answers a case whose transverse rate grows by one rad/s each second,
    /// beyond what answers the rate itself, N m.
    pub fn torque_of_acceleration(&self) -> Complex<f64> {
        let growing = Excitation { rate: Complex::from(1.0), ..Excitation::default() };
        torque_parts(&self.amplitude(&Excitation::default(), &growing)).0
    }

    /// Amplitude at N in shaft axes at an instant, for an excitation and its slope.
    pub(super) fn amplitude(&self, now: &Excitation, slope: &Excitation) -> ComplexState {
        let part = |gain: &Gain, value: Complex<f64>, slope: Complex<f64>| {
            gain.level * value.conj() + gain.slope * slope.conj()
        };
        part(&self.rate, now.rate, slope.rate)
            + part(&self.torque, now.torque, slope.torque)
            + part(&self.pickoff, now.pickoff, slope.pickoff)
            + self.turning
    }
}
