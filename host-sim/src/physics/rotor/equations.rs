//! The linear equations of rotor and loop in shaft axes.
use nalgebra::{Complex, SMatrix, SVector};

use super::{Rebalance, Rotor};

/// Number of states of rotor and loop.
pub const STATES: usize = 10;
/// θx, θy | θ̇x, θ̇y | pick-off filter | integrator | torquer torque; all in shaft axes.
pub type State = SVector<f64, STATES>;
pub(super) type Matrix = SMatrix<f64, STATES, STATES>;
pub(super) type ComplexMatrix = SMatrix<Complex<f64>, STATES, STATES>;
pub(super) type ComplexState = SVector<Complex<f64>, STATES>;
pub(super) const I: Complex<f64> = Complex::new(0.0, 1.0);

/// Matrix of rotor and loop in shaft axes for the case's rate about the spin axis.
pub(super) fn system(rotor: &Rotor, rebalance: &Rebalance, spin_axis_rate: f64) -> Matrix {
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
pub(super) struct Inputs {
    pub(super) rate: [State; 2],
    pub(super) rate_derivative: [State; 2],
    pub(super) torque: [State; 2],
    pub(super) pickoff: [State; 2],
}

impl Inputs {
    pub(super) fn new(rotor: &Rotor, rebalance: &Rebalance, spin_axis_rate: f64) -> Self {
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
pub(super) fn case_fixed(columns: &[State; 2]) -> ComplexState {
    columns[0].map(Complex::from) + columns[1].map(|v| I * v)
}

/// An input that turns in the case at 2N turns at N in the shaft: Re([1, −i]ᵀ w e^{iNt}).
pub(super) fn turning_twice(columns: &[State; 2]) -> ComplexState {
    columns[0].map(Complex::from) - columns[1].map(|v| I * v)
}

/// The torque's part constant in the case and its part at +2N, from the complex amplitude at N in the shaft.
pub(super) fn torque_parts(amplitude: &ComplexState) -> (Complex<f64>, Complex<f64>) {
    let (x, y) = (amplitude[8], amplitude[9]);
    ((x.conj() + I * y.conj()) * 0.5, (x + I * y) * 0.5)
}
