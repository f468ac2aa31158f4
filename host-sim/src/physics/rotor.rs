//! The dynamically tuned rotor: a rotor on a Hooke's joint with flexures, and the loop that closes its pick-offs.
//!
//! Derived from the Lagrangian of three bodies (shaft, gimbal, rotor), linear in the two joint angles. The shaft
//! turns at N about z. The gimbal turns by θx about the shaft's x axis, the rotor by θy about the gimbal's y axis.
//! In axes turning with the shaft every coefficient is constant:
//!
//! (A + Ag) θ̈x − (A + B − C) n θ̇y + [(C − B) + (Cg − Bg)] n² θx + Kx θx + Dx θ̇x + Dg (θ̇x − N θy)
//!     = Mx − (A + Ag) ẇx + (B + Bg − C − Cg) n wy
//! B θ̈y + (A + B − C) n θ̇x + (C − A) n² θy + Ky θy + Dy θ̇y + Dg (θ̇y + N θx) = My − B ẇy + (C − A) n wx
//!
//! with n = N + the case's rate about the spin axis, w the case's transverse rate in shaft axes, M the torque on the
//! rotor, D the flexures' damping and Dg the gas's. A rotor tilted by a constant angle in the case feels, averaged
//! over a turn, the spring ½(Kx + Ky) − ½ n² (Ag + Bg − Cg): the rotor is tuned where it vanishes. The one gimbal's
//! anisotropy stays, as terms at twice the spin speed.
//!
//! The loop (pick-off filter, proportional and integral gain, torquer lag) works in case axes. Its gains are the same
//! for both axes, so in shaft axes it has constant coefficients too, and rotor and loop together are one linear
//! system of ten states. That is what makes the exact response possible: [`Response`] solves it for inputs that are
//! linear in time, [`ClosedLoop::advance`] adds the decaying transient. [`ClosedLoop::integrate`] is the full-rate
//! integration of the same equations.
//!
//! Transverse vectors in case axes are complex numbers x + iy. Inertias kg m², stiffness N m/rad, damping N m s/rad,
//! angles rad, rates rad/s, torques N m, time s.
use nalgebra::{Complex, ComplexField, SMatrix, SVector};

use super::linear::{exponential, growth};

/// Number of states of rotor and loop.
pub const STATES: usize = 10;
/// θx, θy | θ̇x, θ̇y | pick-off filter | integrator | torquer torque; all in shaft axes.
pub type State = SVector<f64, STATES>;
type Matrix = SMatrix<f64, STATES, STATES>;
type ComplexMatrix = SMatrix<Complex<f64>, STATES, STATES>;
type ComplexState = SVector<Complex<f64>, STATES>;

const I: Complex<f64> = Complex::new(0.0, 1.0);

/// Rotor, gimbal and flexures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotor {
    /// Speed of the shaft relative to the case N, rad/s.
    pub spin: f64,
    /// Rotor's inertia about its spin axis C.
    pub rotor_polar: f64,
    /// Rotor's inertia about a diameter A = B.
    pub rotor_equatorial: f64,
    /// Gimbal's inertias Ag (shaft flexure axis), Bg (rotor flexure axis), Cg (spin axis).
    pub gimbal: [f64; 3],
    /// Stiffness of the shaft's flexures Kx and of the rotor's Ky.
    pub stiffness: [f64; 2],
    /// Damping in the flexures Dx, Dy; it turns with the shaft.
    pub flexure_damping: [f64; 2],
    /// Damping by the gas between rotor and case Dg.
    pub gas_damping: f64,
}

impl Rotor {
    /// Angular momentum that a precession works against: H = N (C + ½(Ag + Cg − Bg)).
    pub fn angular_momentum(&self) -> f64 {
        let [ag, bg, cg] = self.gimbal;
        self.spin * (self.rotor_polar + 0.5 * (ag + cg - bg))
    }

    /// The spin speed at which the mean spring vanishes to first order in the gimbal's anisotropy:
    /// √((Kx + Ky)/(Ag + Bg − Cg)), rad/s.
    pub fn tuned_speed(&self) -> f64 {
        let [ag, bg, cg] = self.gimbal;
        ((self.stiffness[0] + self.stiffness[1]) / (ag + bg - cg)).sqrt()
    }

    /// The mean spring left over by detuning at inertial spin speed n: ½(Kx + Ky) − ½ n²(Ag + Bg − Cg), N m/rad.
    pub fn residual_stiffness(&self) -> f64 {
        let [ag, bg, cg] = self.gimbal;
        0.5 * (self.stiffness[0] + self.stiffness[1]) - 0.5 * self.spin.powi(2) * (ag + bg - cg)
    }
}

/// The loop that holds the pick-offs at zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rebalance {
    /// Bandwidth of the loop k, rad/s: the rotor follows the case with time constant 1/k.
    pub bandwidth: f64,
    /// Integral rate, rad/s: torque command ∝ k (p + rate ∫p).
    pub integral: f64,
    /// Bandwidth of the pick-off's demodulator filter, rad/s.
    pub pickoff: f64,
    /// Bandwidth of the torquer and its amplifier, rad/s.
    pub torquer: f64,
    /// Angle by which torquer axes are turned against the pick-off axes, rad.
    pub phase: f64,
    /// Angular momentum the loop is designed for, N m s.
    pub design_momentum: f64,
}

impl Rebalance {
    /// The rotor tuned as on the bench: its flexures trimmed together until the loop feels no spring at a pick-off offset.
    /// The one gimbal's anisotropy shifts that point by a per cent or so from where the mean spring vanishes.
    pub fn tune(&self, rotor: &Rotor) -> Rotor {
        let spring = |trim: f64| {
            let trimmed = Rotor { stiffness: rotor.stiffness.map(|k| k * trim), ..*rotor };
            let response = Response::new(&trimmed, self, 0.0, &Harmonics::default(), 1.0);
            // Held at −offset, the rotor is balanced by the torque K·(−offset).
            -response.constant_torque(&Excitation { pickoff: Complex::from(1.0), ..Excitation::default() }).re
        };
        // Secant; the spring is very nearly linear in the trim.
        let (mut a, mut b) = (1.0, 1.01);
        let (mut at_a, mut at_b) = (spring(a), spring(b));
        for _ in 0..8 {
            if at_b == at_a {
                break;
            }
            let next = b - at_b * (b - a) / (at_b - at_a);
            (a, at_a) = (b, at_b);
            (b, at_b) = (next, spring(next));
        }
        Rotor { stiffness: rotor.stiffness.map(|k| k * b), ..*rotor }
    }
}

/// What acts on the rotor, in case axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Excitation {
    /// The case's transverse inertial rate.
    pub rate: Complex<f64>,
    /// Torque on the rotor.
    pub torque: Complex<f64>,
    /// Error of the pick-offs.
    pub pickoff: Complex<f64>,
}

/// Complex amplitude in case axes of what turns with the spin: x e^{iNt} and x e^{2iNt}.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Harmonics {
    /// Run-out seen by the pick-offs once a turn, rad.
    pub runout_1n: Complex<f64>,
    /// Run-out twice a turn, rad.
    pub runout_2n: Complex<f64>,
    /// Angular vibration of the case at twice the spin speed (from the bearings), rad/s.
    pub vibration_2n: Complex<f64>,
}

/// Matrix of rotor and loop in shaft axes for the case's rate about the spin axis.
fn system(rotor: &Rotor, rebalance: &Rebalance, spin_axis_rate: f64) -> Matrix {
    let shaft = rotor.spin;
    let n = shaft + spin_axis_rate;
    let (a, c) = (rotor.rotor_equatorial, rotor.rotor_polar);
    let [ag, bg, cg] = rotor.gimbal;
    let (ix, iy) = (a + ag, a);
    let gyroscopic = (2.0 * a - c) * n;
    let gas = rotor.gas_damping;

    let mut m = Matrix::zeros();
    m[(0, 2)] = 1.0;
    m[(1, 3)] = 1.0;
    m[(2, 0)] = -(((c - a) + (cg - bg)) * n * n + rotor.stiffness[0]) / ix;
    m[(2, 1)] = gas * shaft / ix;
    m[(2, 2)] = -(rotor.flexure_damping[0] + gas) / ix;
    m[(2, 3)] = gyroscopic / ix;
    m[(2, 8)] = 1.0 / ix;
    m[(3, 0)] = -gas * shaft / iy;
    m[(3, 1)] = -((c - a) * n * n + rotor.stiffness[1]) / iy;
    m[(3, 2)] = -gyroscopic / iy;
    m[(3, 3)] = -(rotor.flexure_damping[1] + gas) / iy;
    m[(3, 9)] = 1.0 / iy;
    // Case-fixed first-order blocks seen from the shaft: d/dt → d/dt + iN.
    for pair in [4, 6, 8] {
        m[(pair, pair + 1)] = shaft;
        m[(pair + 1, pair)] = -shaft;
    }
    for axis in 0..2 {
        m[(4 + axis, axis)] = rebalance.pickoff;
        m[(4 + axis, 4 + axis)] = -rebalance.pickoff;
        m[(6 + axis, 4 + axis)] = 1.0;
        m[(8 + axis, 8 + axis)] = -rebalance.torquer;
    }
    // Command i H k e^{i phase} (p + rate ∫p).
    let gain =
        I * Complex::from_polar(1.0, rebalance.phase) * rebalance.design_momentum * rebalance.bandwidth;
    for (column, factor) in [(4, 1.0), (6, rebalance.integral)] {
        let g = gain * factor * rebalance.torquer;
        m[(8, column)] = g.re;
        m[(8, column + 1)] = -g.im;
        m[(9, column)] = g.im;
        m[(9, column + 1)] = g.re;
    }
    m
}

/// How an excitation enters, in shaft axes: columns x and y of the rate, of its derivative, of torque and pick-off.
struct Inputs {
    rate: [State; 2],
    rate_derivative: [State; 2],
    torque: [State; 2],
    pickoff: [State; 2],
}

impl Inputs {
    fn new(rotor: &Rotor, rebalance: &Rebalance, spin_axis_rate: f64) -> Self {
        let n = rotor.spin + spin_axis_rate;
        let (a, c) = (rotor.rotor_equatorial, rotor.rotor_polar);
        let [ag, bg, cg] = rotor.gimbal;
        let (ix, iy) = (a + ag, a);
        let unit = |row: usize, value: f64| {
            let mut v = State::zeros();
            v[row] = value;
            v
        };
        Self {
            rate: [unit(3, (c - a) * n / iy), unit(2, (a + bg - c - cg) * n / ix)],
            rate_derivative: [unit(2, -1.0), unit(3, -1.0)],
            torque: [unit(2, 1.0 / ix), unit(3, 1.0 / iy)],
            pickoff: [unit(4, rebalance.pickoff), unit(5, rebalance.pickoff)],
        }
    }
}

/// A case-fixed input w(t) seen from the shaft is Re([1, i]ᵀ w̄ e^{iNt}): the complex amplitude of w̄ = 1.
fn case_fixed(columns: &[State; 2]) -> ComplexState {
    columns[0].map(Complex::from) + columns[1].map(|v| I * v)
}

/// An input that turns in the case at 2N turns at N in the shaft: Re([1, −i]ᵀ w e^{iNt}).
fn turning_twice(columns: &[State; 2]) -> ComplexState {
    columns[0].map(Complex::from) - columns[1].map(|v| I * v)
}

/// The torque's part constant in the case and its part at +2N, from the complex amplitude at N in the shaft.
fn torque_parts(amplitude: &ComplexState) -> (Complex<f64>, Complex<f64>) {
    let (x, y) = (amplitude[8], amplitude[9]);
    ((x.conj() + I * y.conj()) * 0.5, (x + I * y) * 0.5)
}

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
    carried: State,
    step_s: f64,
    /// How a transient decays over the step.
    transition: Matrix,
    /// Row that gives, from the change of the transient over the step, the integral of its torque in case axes.
    transient_torque: SMatrix<Complex<f64>, 1, STATES>,
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
    fn amplitude(&self, now: &Excitation, slope: &Excitation) -> ComplexState {
        let part = |gain: &Gain, value: Complex<f64>, slope: Complex<f64>| {
            gain.level * value.conj() + gain.slope * slope.conj()
        };
        part(&self.rate, now.rate, slope.rate)
            + part(&self.torque, now.torque, slope.torque)
            + part(&self.pickoff, now.pickoff, slope.pickoff)
            + self.turning
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn rotor() -> Rotor {
        let spin = TAU * 100.0;
        let gimbal = [2.0e-7, 2.1e-7, 3.3e-7];
        let tuned = 0.5 * spin * spin * (gimbal[0] + gimbal[1] - gimbal[2]);
        Rotor {
            spin,
            rotor_polar: 9.0e-6,
            rotor_equatorial: 5.2e-6,
            gimbal,
            stiffness: [tuned * 1.03, tuned * 0.97],
            flexure_damping: [2e-7, 1.5e-7],
            gas_damping: 5e-8,
        }
    }

    fn rebalance(rotor: &Rotor) -> Rebalance {
        Rebalance {
            bandwidth: TAU * 8.0,
            integral: 10.0,
            pickoff: TAU * 60.0,
            torquer: TAU * 60.0,
            phase: 0.0,
            design_momentum: rotor.angular_momentum(),
        }
    }

    /// Kinetic minus potential energy of gimbal and rotor with the joint's exact kinematics; the shaft's inertial rate
    /// in shaft axes is (wx, wy, n).
    fn lagrangian(r: &Rotor, q: [f64; 2], v: [f64; 2], w: [f64; 2], n: f64) -> f64 {
        let (a, c) = (r.rotor_equatorial, r.rotor_polar);
        let (s, cos) = q[0].sin_cos();
        let g = [w[0] + v[0], cos * w[1] + s * n, cos * n - s * w[1]];
        let (s, cos) = q[1].sin_cos();
        let b = [cos * g[0] - s * g[2], g[1] + v[1], s * g[0] + cos * g[2]];
        0.5 * (r.gimbal[0] * g[0] * g[0] + r.gimbal[1] * g[1] * g[1] + r.gimbal[2] * g[2] * g[2])
            + 0.5 * (a * (b[0] * b[0] + b[1] * b[1]) + c * b[2] * b[2])
            - 0.5 * (r.stiffness[0] * q[0] * q[0] + r.stiffness[1] * q[1] * q[1])
    }

    #[test]
    fn equations_agree_with_the_lagrangian_of_the_joint() {
        // Euler–Lagrange expressions by central differences of the exact Lagrangian, against the linear equations.
        let r = Rotor { flexure_damping: [0.0; 2], gas_damping: 0.0, ..rotor() };
        let (n, spin_axis_rate) = (r.spin + 0.4, 0.4);
        let (q, v, acc) = ([2e-6, -3e-6], [4e-4, 7e-4], [0.3, -0.2]);
        let (w, w_dot) = ([2e-3, -1e-3], [0.05, 0.08]);
        let along = |e: f64| {
            // A trajectory with these derivatives at e = 0.
            let at = |i: usize| q[i] + v[i] * e + 0.5 * acc[i] * e * e;
            let speed = |i: usize| v[i] + acc[i] * e;
            ([at(0), at(1)], [speed(0), speed(1)], [w[0] + w_dot[0] * e, w[1] + w_dot[1] * e])
        };
        let partial = |e: f64, wrt_speed: bool, i: usize| {
            let (q, v, w) = along(e);
            // The Lagrangian is exactly quadratic in the speeds.
            let h = if wrt_speed { 10.0 } else { 1e-4 };
            let shifted = |d: f64| {
                let (mut q, mut v) = (q, v);
                if wrt_speed {
                    v[i] += d;
                } else {
                    q[i] += d;
                }
                lagrangian(&r, q, v, w, n)
            };
            (shifted(h) - shifted(-h)) / (2.0 * h)
        };
        let loop_ = rebalance(&r);
        let system = system(&r, &loop_, spin_axis_rate);
        let inputs = Inputs::new(&r, &loop_, spin_axis_rate);
        let mut state = State::zeros();
        (state[0], state[1], state[2], state[3]) = (q[0], q[1], v[0], v[1]);
        let linear = system * state
            + inputs.rate[0] * w[0]
            + inputs.rate[1] * w[1]
            + inputs.rate_derivative[0] * w_dot[0]
            + inputs.rate_derivative[1] * w_dot[1];
        for i in 0..2 {
            let h = 1e-4;
            let exact = (partial(h, true, i) - partial(-h, true, i)) / (2.0 * h) - partial(0.0, false, i);
            let inertia = r.rotor_equatorial + if i == 0 { r.gimbal[0] } else { 0.0 };
            // Exact: inertia·(q̈ − linear acceleration) = Euler–Lagrange expression = 0 for the free joint.
            let from_linear = inertia * (acc[i] - linear[2 + i]);
            let scale = inertia * linear[2 + i].abs();
            assert!(
                (exact - from_linear).abs() < 1e-4 * scale,
                "axis {i}: {exact:e} against {from_linear:e}"
            );
        }
    }

    /// The rotor with a gimbal lighter by a factor, everything else in proportion.
    fn with_gimbal(factor: f64) -> Rotor {
        let r = rotor();
        Rotor {
            gimbal: r.gimbal.map(|j| j * factor),
            stiffness: r.stiffness.map(|k| k * factor),
            flexure_damping: r.flexure_damping.map(|d| d * factor),
            gas_damping: r.gas_damping * factor,
            ..r
        }
    }

    #[test]
    fn precession_under_a_torque_is_torque_over_momentum() {
        // To hold a rate ω the loop must give M = −iHω, to hold against a torque its opposite. The gimbal's anisotropy moves
        // that by second order: a tenth of the gimbal, a hundredth of the shift.
        let shift = |factor: f64| {
            let r = with_gimbal(factor);
            let loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
            let response = loop_.response(0.0, &Harmonics::default(), 1.0);
            let rate = Complex::new(1e-3, -2e-3);
            let answer = response.constant_torque(&Excitation { rate, ..Excitation::default() });
            (answer / (-I * r.angular_momentum() * rate) - 1.0).norm()
        };
        let (full, tenth) = (shift(1.0), shift(0.1));
        assert!(full < 5e-4 && tenth < full / 50.0, "{full:e} {tenth:e}");
        // Against a torque it gives exactly its opposite.
        let r = rotor();
        let response = ClosedLoop::new(r, rebalance(&r)).unwrap().response(0.0, &Harmonics::default(), 1.0);
        let torque = Complex::new(2e-8, 1e-8);
        let answer = response.constant_torque(&Excitation { torque, ..Excitation::default() });
        assert!((answer / -torque - 1.0).norm() < 1e-9);
    }

    #[test]
    fn tuned_speed_is_where_the_spring_vanishes() {
        // The loop holds the rotor at −offset against the spring: M = −K · offset.
        let spring = |r: Rotor| {
            let loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
            let response = loop_.response(0.0, &Harmonics::default(), 1.0);
            let offset = Excitation { pickoff: Complex::from(1e-5), ..Excitation::default() };
            (response.constant_torque(&offset) / -1e-5).re
        };
        let r = rotor();
        assert!((r.tuned_speed() / r.spin - 1.0).abs() < 1e-12);
        // Closed form to first order in the gimbal: the leftover at the nominal tuned speed falls with its square.
        let leftover = |factor: f64| spring(with_gimbal(factor)) / with_gimbal(factor).stiffness[0];
        assert!(
            leftover(1.0).abs() < 0.03 && leftover(0.1).abs() < 0.003,
            "{} {}",
            leftover(1.0),
            leftover(0.1)
        );
        // Trimmed on the bench it is gone, and detuning brings back ½(Kx + Ky) − ½n²(Ag + Bg − Cg).
        let tuned = rebalance(&r).tune(&r);
        assert!(spring(tuned).abs() < 1e-9 * tuned.stiffness[0], "{}", spring(tuned));
        for detuning in [-2e-3, -5e-4, 5e-4, 2e-3] {
            let off = Rotor { spin: tuned.spin * (1.0 + detuning), ..tuned };
            let expected = off.residual_stiffness() - tuned.residual_stiffness();
            assert!(
                (spring(off) / expected - 1.0).abs() < 0.05,
                "{detuning}: {} against {expected}",
                spring(off)
            );
        }
    }

    #[test]
    fn flexure_damping_turns_an_offset_into_a_torque_at_right_angles() {
        let r = with_gimbal(0.1);
        let loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
        let response = loop_.response(0.0, &Harmonics::default(), 1.0);
        let offset = Excitation { pickoff: Complex::from(1e-5), ..Excitation::default() };
        let torque = response.constant_torque(&offset);
        // In shaft axes a tilt −offset fixed in the case turns at −N: mean damping torque −D(−iN)(−offset), which the loop
        // balances: iDN·offset. The gas, at rest in the case, gives none.
        let damping = 0.5 * (r.flexure_damping[0] + r.flexure_damping[1]);
        let expected = damping * r.spin * 1e-5;
        assert!((torque.im / expected - 1.0).abs() < 0.02, "{torque} against {expected}");
    }

    #[test]
    fn nutation_of_the_free_rotor_is_at_polar_over_equatorial_times_spin() {
        // Without gimbal, flexures and loop: case-frame nutation at N C/A.
        let r = Rotor {
            gimbal: [0.0; 3],
            stiffness: [0.0; 2],
            flexure_damping: [0.0; 2],
            gas_damping: 0.0,
            ..rotor()
        };
        let free = system(&r, &Rebalance { bandwidth: 0.0, ..rebalance(&r) }, 0.0);
        let frequencies: Vec<f64> =
            free.fixed_view::<4, 4>(0, 0).clone_owned().complex_eigenvalues().iter().map(|e| e.im).collect();
        // In shaft axes: N (C/A − 1) and N.
        let nutation = r.spin * (r.rotor_polar / r.rotor_equatorial - 1.0);
        assert!(frequencies.iter().any(|f| (f - nutation).abs() < 1e-6 * nutation), "{frequencies:?}");
        assert!(frequencies.iter().any(|f| (f - r.spin).abs() < 1e-6 * r.spin), "{frequencies:?}");
    }

    #[test]
    fn exact_response_agrees_with_the_full_rate_integration() {
        let r = rotor();
        let harmonics = Harmonics {
            runout_1n: Complex::new(2e-6, 1e-6),
            runout_2n: Complex::new(-1e-6, 2e-6),
            vibration_2n: Complex::new(1e-3, 2e-3),
        };
        let spin_axis_rate = 0.05;
        let at = |k: f64| Excitation {
            rate: Complex::new(2e-3 * (0.7 * k).sin(), 1e-3 * k),
            torque: Complex::new(1e-8 * k, -2e-8),
            pickoff: Complex::new(1e-5, 2e-6 * k),
        };
        for step_s in [1.0, 0.05, 0.0123] {
            let mut exact = ClosedLoop::new(r, rebalance(&r)).unwrap();
            let mut full = exact.clone();
            let response = exact.response(spin_axis_rate, &harmonics, step_s);
            for k in 0..4 {
                let (start, end) = (at(f64::from(k)), at(f64::from(k + 1)));
                let mean = exact.advance(&response, &start, &end);
                let reference = full.integrate(spin_axis_rate, &harmonics, step_s, 128, |t| {
                    let mix = |a: Complex<f64>, b: Complex<f64>| a + (b - a) * (t / step_s);
                    let now = Excitation {
                        rate: mix(start.rate, end.rate),
                        torque: mix(start.torque, end.torque),
                        pickoff: mix(start.pickoff, end.pickoff),
                    };
                    (now, (end.rate - start.rate) / step_s)
                });
                let scale = r.angular_momentum() * 2e-3;
                assert!(
                    (mean - reference).norm() < 2e-5 * scale,
                    "step {step_s} k {k}: {mean} against {reference}"
                );
                assert!(
                    (exact.pickoff() - full.pickoff()).norm() < 1e-8,
                    "{} {}",
                    exact.pickoff(),
                    full.pickoff()
                );
            }
        }
    }

    #[test]
    fn an_unstable_loop_is_refused() {
        let r = rotor();
        // Without lag the nutation is driven, not damped.
        let wide = Rebalance { pickoff: TAU * 5000.0, torquer: TAU * 5000.0, ..rebalance(&r) };
        assert!(ClosedLoop::new(r, wide).is_err());
        let nonsense = Rebalance { bandwidth: f64::INFINITY, ..rebalance(&r) };
        assert!(ClosedLoop::new(r, nonsense).is_err());
        assert!(ClosedLoop::new(r, rebalance(&r)).is_ok());
    }

    #[test]
    fn pickoff_noise_variance_agrees_with_simulation() {
        let r = rotor();
        let mut loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
        let density = 1e-8;
        let theory = loop_.pickoff_noise_variance(density);
        // White noise held over short intervals: variance density²/(2Δ).
        let (held, n) = (2e-4, 100_000);
        let sigma = density / (2.0f64 * held).sqrt();
        let mut stream = super::super::random::Stream::new(3, "pickoff");
        let mut sum = 0.0;
        for k in 0..n {
            let noise = Complex::new(stream.normal(), stream.normal()) * sigma;
            let e = Excitation { pickoff: noise, ..Excitation::default() };
            let zero = Complex::from(0.0);
            loop_.integrate(0.0, &Harmonics::default(), held, 128, |_| (e, zero));
            if k > n / 20 {
                sum += 0.5 * loop_.pickoff().norm_sqr();
            }
        }
        let measured = sum / (f64::from(n) * 0.95);
        assert!((measured / theory - 1.0).abs() < 0.08, "{measured:e} against {theory:e}");
    }
}
