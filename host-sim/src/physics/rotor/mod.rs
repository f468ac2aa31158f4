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
use nalgebra::Complex;

pub use closed_loop::{ClosedLoop, Unstable};
pub use equations::{STATES, State};
pub use response::Response;

mod closed_loop;
mod equations;
mod response;
#[cfg(test)]
mod tests;

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
