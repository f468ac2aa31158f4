//! What a tuned gyro is made of, and what is wrong with it.
use nalgebra::{Complex, Vector3};

use super::I;
use crate::physics::readout::{Nonlinearity, ReadoutDesign};
use crate::physics::rotor::{Excitation, Harmonics, Rebalance, Response, Rotor};

/// Everything about one gyro.
#[derive(Clone, Debug, PartialEq)]
pub struct GyroDesign {
    /// Rotor, gimbal, flexures at the reference temperature.
    pub rotor: Rotor,
    /// Loop.
    pub rebalance: Rebalance,
    /// What the loop's torque is divided by: i × torque for a rate of one about x, N m s. Its phase is the angle by which
    /// rotor and gimbal turn the axes.
    pub calibration: Complex<f64>,
    /// Network of the electronics: they take this times the indicated rates' rate of change out of the indicated rates, the real
    /// part along the axes, the imaginary part across them, s.
    pub network: Complex<f64>,
    /// What turns with the spin.
    pub harmonics: Harmonics,
    /// Relative change of the flexures' stiffness, 1/K.
    pub stiffness_temperature: f64,
    /// The rotor's mass, kg.
    pub mass: f64,
    /// Centre of mass beyond the suspension along the spin axis, m.
    pub axial_unbalance: f64,
    /// Its change with the rotor's temperature, m/K.
    pub axial_unbalance_temperature: f64,
    /// Twist of a flexure by a load along it: torque per force, m.
    pub flexure_twist: f64,
    /// Compliance of the suspension and bearings, m/N, symmetric.
    pub compliance: nalgebra::Matrix3<f64>,
    /// Torque of the housing's field on a rotor moved along the spin axis, per axial force: x and y, m.
    pub axial_reaction: [f64; 2],
    /// Reaction torque of pick-off and torquer, x and y, N m.
    pub reaction_torque: [f64; 2],
    /// Its change with the magnet's temperature, N m/K.
    pub reaction_torque_temperature: [f64; 2],
    /// Its change with the magnet's temperature above the housing's, N m/K.
    pub reaction_torque_rise: [f64; 2],
    /// Its change with the temperature gradient across the housing, in which the gas around the rotor flows, N m/(K/m).
    pub reaction_torque_gradient: [f64; 2],
    /// Magnetic moment along the spin axis, A m².
    pub magnetic_moment: f64,
    /// Null of the pick-offs, x and y, rad.
    pub pickoff_offset: [f64; 2],
    /// Its change with the housing's temperature, rad/K.
    pub pickoff_offset_temperature: [f64; 2],
    /// Its change with the temperature gradient across the housing, rad/(K/m).
    pub pickoff_offset_gradient: [f64; 2],
    /// White noise of the pick-offs, rad/√Hz.
    pub pickoff_noise: f64,
    /// Lag of the rotor's temperature behind the housing's, s.
    pub rotor_lag_s: f64,
    /// Torquers: gain and its faults, x and y; input in rad/s of indicated rate.
    pub torquer: [Nonlinearity; 2],
    /// Relative change of the torquers' gain with the magnet's temperature, 1/K.
    pub torquer_temperature: f64,
    /// Power in the torquers per square of the rate, W/(rad/s)².
    pub torquer_power: f64,
    /// Heating of the magnet, K/W.
    pub magnet_resistance: f64,
    /// Time constant of that, s.
    pub magnet_lag_s: f64,
    /// Outputs x and y.
    pub readout: [ReadoutDesign; 2],
    /// Rotation of the housing in the body beside the nominal axes, as a rotation vector in instrument axes, rad.
    pub misalignment: Vector3<f64>,
    /// Input axis x in the body.
    pub input_axis: Vector3<f64>,
    /// Spin axis in the body, at right angles to it.
    pub spin_axis: Vector3<f64>,
    /// Integrate at full rate instead of using the exact response.
    pub full_rate: bool,
}

impl GyroDesign {
    /// A gyro without any error: tuned rotor at this spin speed (Hz), sensible inertias, stable loop, no noise.
    pub fn ideal(spin_hz: f64) -> Self {
        let spin = std::f64::consts::TAU * spin_hz;
        let gimbal = [2.0e-7, 2.0e-7, 3.2e-7];
        let stiffness = 0.5 * spin * spin * (gimbal[0] + gimbal[1] - gimbal[2]);
        let untrimmed = Rotor {
            spin,
            rotor_polar: 9.0e-6,
            rotor_equatorial: 5.2e-6,
            gimbal,
            stiffness: [stiffness; 2],
            flexure_damping: [0.0; 2],
            gas_damping: 1e-8,
        };
        let rebalance = Rebalance {
            bandwidth: 0.08 * spin,
            integral: 0.02 * spin,
            pickoff: 0.6 * spin,
            torquer: 0.6 * spin,
            phase: 0.0,
            design_momentum: untrimmed.angular_momentum(),
        };
        let rotor = rebalance.tune(&untrimmed);
        let readout = ReadoutDesign { range: f64::INFINITY, ..ReadoutDesign::default() };
        let mut design = Self {
            rotor,
            rebalance,
            calibration: Complex::from(rebalance.design_momentum),
            network: Complex::from(0.0),
            harmonics: Harmonics::default(),
            stiffness_temperature: 0.0,
            mass: 0.06,
            axial_unbalance: 0.0,
            axial_unbalance_temperature: 0.0,
            flexure_twist: 0.0,
            compliance: nalgebra::Matrix3::zeros(),
            axial_reaction: [0.0; 2],
            reaction_torque: [0.0; 2],
            reaction_torque_temperature: [0.0; 2],
            reaction_torque_rise: [0.0; 2],
            reaction_torque_gradient: [0.0; 2],
            magnetic_moment: 0.0,
            pickoff_offset: [0.0; 2],
            pickoff_offset_temperature: [0.0; 2],
            pickoff_offset_gradient: [0.0; 2],
            pickoff_noise: 0.0,
            rotor_lag_s: 0.0,
            torquer: [Nonlinearity::default(); 2],
            torquer_temperature: 0.0,
            torquer_power: 0.0,
            magnet_resistance: 0.0,
            magnet_lag_s: 0.0,
            readout: [readout.clone(), readout],
            misalignment: Vector3::zeros(),
            input_axis: Vector3::x(),
            spin_axis: Vector3::z(),
            full_rate: false,
        };
        design.calibrate();
        design
    }

    /// Sets what the torque is divided by so that scale factor and axes are right, as a calibration on a rate table does:
    /// the gimbal's anisotropy shifts them from the closed form by parts in 10⁴.
    pub fn calibrate(&mut self) {
        let response = Response::new(&self.rotor, &self.rebalance, 0.0, &Harmonics::default(), 1.0);
        let rate = Excitation { rate: Complex::from(1.0), ..Excitation::default() };
        self.calibration = I * response.constant_torque(&rate);
    }

    /// A gyro for large rates, without any error: the equatorial inertia of its rotor is such that a rate about the spin axis adds
    /// nothing to what a rate about an input axis needs, and its network takes out what the rotor answers to angular
    /// acceleration.
    pub fn strapdown(spin_hz: f64) -> Self {
        let mut design = Self::ideal(spin_hz);
        let polar = design.rotor.rotor_polar;
        // Torque that a rate about the spin axis adds, per rate about an input axis.
        let added = |equatorial: f64| {
            let rotor = design.rebalance.tune(&Rotor { rotor_equatorial: equatorial, ..design.rotor });
            let rate = Excitation { rate: Complex::from(1.0), ..Excitation::default() };
            let torque = |spin_axis_rate: f64| {
                Response::new(&rotor, &design.rebalance, spin_axis_rate, &Harmonics::default(), 1.0)
                    .constant_torque(&rate)
            };
            (torque(0.1) - torque(-0.1)).im
        };
        // Secant; it is very nearly linear in the inertia.
        let (mut a, mut b) = (0.95 * polar, polar);
        let (mut at_a, mut at_b) = (added(a), added(b));
        for _ in 0..8 {
            if at_b == at_a {
                break;
            }
            let next = b - at_b * (b - a) / (at_b - at_a);
            (a, at_a) = (b, at_b);
            (b, at_b) = (next, added(next));
        }
        design.rotor.rotor_equatorial = b;
        design.trim();
        design
    }

    /// Tunes, calibrates, and sets the network, all as on a rate table.
    pub fn trim(&mut self) {
        self.rotor = self.rebalance.tune(&self.rotor);
        self.calibrate();
        let response = Response::new(&self.rotor, &self.rebalance, 0.0, &Harmonics::default(), 1.0);
        self.network = I * response.torque_of_acceleration() / self.calibration;
    }
}
