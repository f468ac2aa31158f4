//! A dynamically tuned gyro: rotor and loop with everything that disturbs them, and its two outputs.
//!
//! Instrument axes: x and y the input axes, z the spin axis. Torques on the rotor come from its parts: a centre of mass
//! off the suspension, suspension that gives way under load, flexures that twist under load, a permanent reaction torque of
//! pick-off and torquer, a magnetic moment. Temperature works through parts too: the flexures' modulus (and with it the
//! tuning), the place of the centre of mass, the magnet's flux, the pick-offs' null, which a temperature difference across the
//! housing bends. The rotor follows the housing's temperature with a lag, the magnet is heated by the torquers' current, and so
//! much warmer than the housing it pulls at the rotor by its stray field. A network in the electronics takes out what the rotor
//! answers to angular acceleration.
//! SI units; see [`super::rotor`] for the equations of motion.
use nalgebra::{Complex, UnitQuaternion, Vector3};

use super::heat::Lag;
use super::random::Stream;
use super::readout::{Nonlinearity, REFERENCE_TEMPERATURE, Readout, ReadoutDesign, Surroundings};
use super::rotor::{ClosedLoop, Excitation, Harmonics, Rebalance, Response, Rotor, Unstable};

const I: Complex<f64> = Complex::new(0.0, 1.0);

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

/// A gyro at work.
#[derive(Clone, Debug)]
pub struct Gyro {
    design: GyroDesign,
    motion: ClosedLoop,
    response: Option<Cached>,
    /// Rows: instrument axes in body axes.
    to_instrument: nalgebra::Matrix3<f64>,
    rotor_temperature: Option<Lag>,
    housing_before: Option<f64>,
    magnet_rise: Lag,
    power_before: f64,
    readout: [Readout; 2],
    pickoff_noise: PickoffNoise,
    before: Option<Excitation>,
    network: Network,
}

#[derive(Clone, Debug)]
struct Cached {
    stiffness: f64,
    spin_axis_rate: f64,
    step_s: f64,
    response: Response,
}

/// Relative changes below this leave the response as it is: 1e-7 of the spring or of the spin is far below any output
/// noise.
const REFRESH: f64 = 1e-7;
/// Steps a turn of the full-rate integration.
const FULL_RATE_STEPS: u32 = 128;

/// Pick-off noise as the output's mean over a step feels it: the difference of a rotor angle between its ends.
#[derive(Clone, Debug)]
struct PickoffNoise {
    sigma: f64,
    before: Complex<f64>,
    stream: Stream,
}

impl PickoffNoise {
    fn mean_rate(&mut self, step_s: f64) -> Complex<f64> {
        let now = Complex::new(self.stream.normal(), self.stream.normal()) * self.sigma;
        let rate = (now - self.before) / step_s;
        self.before = now;
        rate
    }
}

/// The electronics' network: it tells the slope of the torque from straight lines through the means over successive parts of a step.
#[derive(Clone, Copy, Debug, Default)]
struct Network {
    /// Mean torque over the last part, and at its end.
    last: Option<(Complex<f64>, Complex<f64>)>,
}

impl Network {
    /// Takes the mean over the next part and returns by how much the torque grew over it.
    fn growth(&mut self, mean: Complex<f64>) -> Complex<f64> {
        let (before, start) = self.last.unwrap_or((mean, mean));
        let end = mean + (mean - before) * 0.5;
        self.last = Some((mean, end));
        end - start
    }
}

/// What a gyro says of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroReading {
    /// Indicated rates about x and y, rad/s.
    pub rate: [f64; 2],
    /// Mean true rates about the nominal axes x and y, rad/s.
    pub true_rate: [f64; 2],
    /// Whether each is at the end of its range.
    pub saturated: [bool; 2],
    /// Pick-off angles at the end of the step, as the pick-offs tell them, rad.
    pub pickoff: [f64; 2],
}

impl Gyro {
    /// The gyro called `name` of the run with this seed.
    ///
    /// # Errors
    /// A loop that is not stable.
    pub fn new(design: GyroDesign, seed: u64, name: &str) -> Result<Self, Unstable> {
        let motion = ClosedLoop::new(design.rotor, design.rebalance)?;
        let x = design.input_axis.normalize();
        let z = design.spin_axis.normalize();
        let nominal = nalgebra::Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
        let turned = UnitQuaternion::from_scaled_axis(-design.misalignment).to_rotation_matrix();
        let sigma = motion.pickoff_noise_variance(design.pickoff_noise).sqrt();
        let readout = |axis: usize, letter: char| {
            Readout::new(design.readout[axis].clone(), seed, &format!("{name}/{letter}"))
        };
        Ok(Self {
            to_instrument: turned.matrix() * nominal,
            readout: [readout(0, 'x'), readout(1, 'y')],
            pickoff_noise: PickoffNoise {
                sigma,
                before: Complex::from(0.0),
                stream: Stream::new(seed, &format!("{name}/pickoff")),
            },
            motion,
            design,
            response: None,
            rotor_temperature: None,
            housing_before: None,
            magnet_rise: Lag::new(0.0),
            power_before: 0.0,
            before: None,
            network: Network::default(),
        })
    }

    /// One reading: the mean over a step that is cut into equal parts, with rate and specific force in body axes at the parts'
    /// ends (`parts + 1` entries, the first at the start of the step).
    pub fn step(
        &mut self,
        rate: &[Vector3<f64>],
        specific_force: &[Vector3<f64>],
        around: &Surroundings,
        step_s: f64,
    ) -> GyroReading {
        let parts = rate.len().min(specific_force.len()).saturating_sub(1).max(1);
        let part_s = step_s / parts as f64;
        let housing = around.temperature;
        let rotor_temperature = self.rotor_temperature.get_or_insert(Lag::new(housing)).advance(
            step_s,
            self.design.rotor_lag_s,
            self.housing_before.unwrap_or(housing),
            housing,
        );
        self.housing_before = Some(housing);
        let rotor_deviation = rotor_temperature - REFERENCE_TEMPERATURE;
        let magnet_deviation = housing - REFERENCE_TEMPERATURE + self.magnet_rise.value();

        let d = &self.design;
        let drift = Complex::new(self.readout[0].drift(step_s), self.readout[1].drift(step_s));
        let stiffness = 1.0 + d.stiffness_temperature * rotor_deviation;
        let unbalance = d.axial_unbalance + d.axial_unbalance_temperature * rotor_deviation;
        let torque_of = |force: &Vector3<f64>| self.torque(force, unbalance, magnet_deviation, around);
        let pair = |v: [f64; 2]| Complex::new(v[0], v[1]);
        // Where the pick-offs say zero, and where the loop is told to hold them.
        let null = pair(d.pickoff_offset)
            + pair(d.pickoff_offset_temperature) * (housing - REFERENCE_TEMPERATURE)
            + pair(d.pickoff_offset_gradient) * around.gradient;
        let pickoff = null - pair(around.pickoff_command);

        let instrument: Vec<(Vector3<f64>, Excitation)> = rate
            .iter()
            .zip(specific_force)
            .map(|(w, f)| {
                let w = self.to_instrument * w;
                let torque = torque_of(&(self.to_instrument * f));
                (w, Excitation { rate: Complex::new(w.x, w.y), torque, pickoff })
            })
            .collect();

        self.motion.set_rotor(Rotor { stiffness: d.rotor.stiffness.map(|k| k * stiffness), ..d.rotor });
        let (mut mean_torque, mut growth) = (Complex::from(0.0), Complex::from(0.0));
        let harmonics = d.harmonics;
        let full_rate = d.full_rate;
        for ends in instrument.windows(2) {
            let [(w0, start), (w1, end)] = ends else { continue };
            let spin_axis_rate = 0.5 * (w0.z + w1.z);
            // Torque and pick-off may have moved since the last step's end with temperature; the rate may not jump.
            let start = Excitation { rate: start.rate, ..self.before.unwrap_or(*start) };
            let torque = if full_rate {
                self.integrate(&start, end, spin_axis_rate, part_s)
            } else {
                self.refresh(stiffness, spin_axis_rate, part_s, &harmonics);
                let Some(cached) = &self.response else { continue };
                if self.before.is_none() {
                    self.motion.settle(&cached.response, &start);
                }
                self.motion.advance(&cached.response, &start, end)
            };
            self.before = Some(*end);
            mean_torque += torque / parts as f64;
            growth += self.network.growth(torque);
        }
        let nominal_rate = rate
            .windows(2)
            .map(|w| (w[0] + w[1]) / (2.0 * parts as f64))
            .fold(Vector3::zeros(), |a, b| a + b);

        // Current of the torquers, in rad/s of the design's gain, and what it heats.
        let held = mean_torque - self.design.network * growth / step_s;
        // A drift is a torque on the rotor that the loop reads as this rate; its mean over the step is known.
        let indicated = I * held / self.design.calibration + drift + self.pickoff_noise.mean_rate(step_s);
        let d = &self.design;
        let gain = d.torquer_temperature * magnet_deviation;
        let current = |axis: usize, value: f64| {
            Nonlinearity { gain: d.torquer[axis].gain + gain, ..d.torquer[axis] }.invert(value)
        };
        let currents = [current(0, indicated.re), current(1, indicated.im)];
        let rise = d.magnet_resistance * d.torquer_power * (currents[0].powi(2) + currents[1].powi(2));
        self.magnet_rise.advance(step_s, d.magnet_lag_s, self.power_before, rise);
        self.power_before = rise;

        let reading = [0, 1].map(|axis| self.readout[axis].read(currents[axis], around, step_s));
        let x = self.design.input_axis.normalize();
        let y = self.design.spin_axis.normalize().cross(&x);
        let told = self.motion.pickoff() + null;
        GyroReading {
            rate: reading,
            true_rate: [nominal_rate.dot(&x), nominal_rate.dot(&y)],
            saturated: [0, 1].map(|axis| self.readout[axis].saturated(reading[axis])),
            pickoff: [told.re, told.im],
        }
    }

    /// Torque on the rotor for a specific force in instrument axes, N m.
    fn torque(
        &self,
        force: &Vector3<f64>,
        unbalance: f64,
        magnet_deviation: f64,
        around: &Surroundings,
    ) -> Complex<f64> {
        let d = &self.design;
        let m = d.mass;
        // r × (−m f) with the centre of mass at r = z ẑ − C m f.
        let bend = |f: &Vector3<f64>| (d.compliance * f).cross(f) * (m * m);
        let arm = Vector3::new(0.0, 0.0, unbalance);
        let vibration = self.to_instrument * around.vibration;
        let mechanical = arm.cross(&(force * -m)) + bend(force) + bend(&vibration) * 0.5;
        let field = self.to_instrument * around.magnetic_field;
        let magnetic = Vector3::new(0.0, 0.0, d.magnetic_moment).cross(&field);
        let load = m * d.flexure_twist;
        let axis = |k: usize| {
            mechanical[k]
                + magnetic[k]
                + load * force[k]
                + d.axial_reaction[k] * m * force.z
                + d.reaction_torque[k]
                + d.reaction_torque_temperature[k] * magnet_deviation
                + d.reaction_torque_rise[k] * self.magnet_rise.value()
                + d.reaction_torque_gradient[k] * around.gradient
        };
        Complex::new(axis(0), axis(1))
    }

    fn refresh(&mut self, stiffness: f64, spin_axis_rate: f64, step_s: f64, harmonics: &Harmonics) {
        let spin = self.design.rotor.spin;
        let fresh = self.response.as_ref().is_some_and(|c| {
            (c.stiffness - stiffness).abs() < REFRESH
                && (c.spin_axis_rate - spin_axis_rate).abs() < REFRESH * spin
                && c.step_s == step_s
        });
        if !fresh {
            let response = self.motion.response(spin_axis_rate, harmonics, step_s);
            self.response = Some(Cached { stiffness, spin_axis_rate, step_s, response });
        }
    }

    fn integrate(
        &mut self,
        start: &Excitation,
        end: &Excitation,
        spin_axis_rate: f64,
        step_s: f64,
    ) -> Complex<f64> {
        let harmonics = self.design.harmonics;
        let mix = |a: Complex<f64>, b: Complex<f64>, t: f64| a + (b - a) * (t / step_s);
        self.motion.integrate(spin_axis_rate, &harmonics, step_s, FULL_RATE_STEPS, |t| {
            let now = Excitation {
                rate: mix(start.rate, end.rate, t),
                torque: mix(start.torque, end.torque, t),
                pickoff: mix(start.pickoff, end.pickoff, t),
            };
            (now, (end.rate - start.rate) / step_s)
        })
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::earth::STANDARD_GRAVITY as G;

    const DEG_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;

    fn run(
        design: &GyroDesign,
        rate: Vector3<f64>,
        force: Vector3<f64>,
        around: &Surroundings,
        n: usize,
    ) -> [f64; 2] {
        let mut gyro = Gyro::new(design.clone(), 1, "gyro").unwrap();
        let mut last = [0.0; 2];
        for _ in 0..n {
            last = gyro.step(&[rate, rate], &[force, force], around, 1.0).rate;
        }
        last
    }

    #[test]
    fn an_ideal_gyro_tells_the_rate() {
        let design = GyroDesign::ideal(100.0);
        let rate = Vector3::new(0.01, -0.02, 0.0);
        let told = run(&design, rate, Vector3::new(1.0, 2.0, -9.8), &Surroundings::default(), 3);
        assert!((told[0] - 0.01).abs() < 1e-9 && (told[1] + 0.02).abs() < 1e-9, "{told:?}");
        // A rate about the spin axis: the torque is ω × L with L = (A ωx, A ωy, C (N + ωs)), which adds (C − A) ωi ωs.
        let told = run(&design, Vector3::new(0.01, 0.0, 0.5), Vector3::zeros(), &Surroundings::default(), 3);
        let r = &design.rotor;
        let added = (r.rotor_polar - r.rotor_equatorial) * 0.01 * 0.5 / r.angular_momentum();
        // The gimbal's share is a few per cent of that.
        assert!(((told[0] - 0.01) / added - 1.0).abs() < 0.03, "{told:?} {added}");
    }

    #[test]
    fn six_position_tumble_recovers_the_static_error_coefficients() {
        let mut design = GyroDesign::ideal(100.0);
        let h = design.calibration.norm();
        let (z, q) = (4.0e-8, 7.0e-9);
        design.axial_unbalance = z;
        design.flexure_twist = q;
        design.reaction_torque = [2.0e-8, -3.0e-8];
        let (radial, axial) = (2.0e-8, 1.4e-8);
        design.compliance = nalgebra::Matrix3::from_diagonal(&Vector3::new(radial, radial, axial));
        // Positions: each axis up and down, and one at 45° for the g² term.
        let tell = |f: Vector3<f64>| run(&design, Vector3::zeros(), f, &Surroundings::default(), 2)[0];
        let (x, y, s) = (Vector3::x() * G, Vector3::y() * G, Vector3::z() * G);
        let bias = (tell(x) + tell(-x) + tell(y) + tell(-y)) / 4.0;
        let (along_x, along_y, along_s) =
            ((tell(x) - tell(-x)) / 2.0, (tell(y) - tell(-y)) / 2.0, (tell(s) - tell(-s)) / 2.0);
        // Against a torque M the loop gives −M, told as i(−M)/H: x of that is My/H.
        let m = design.mass;
        assert!((bias - design.reaction_torque[1] / h).abs() < 1e-4 * bias.abs());
        assert!((along_x - -m * z * G / h).abs() < 1e-4 * along_x.abs(), "{along_x}");
        assert!((along_y - m * q * G / h).abs() < 1e-4 * along_y.abs(), "{along_y}");
        assert!(along_s.abs() < 1e-14);
        let d = (x + s) * std::f64::consts::FRAC_1_SQRT_2;
        let product = tell(d) - bias - along_x * std::f64::consts::FRAC_1_SQRT_2;
        let expected = -m * m * (radial - axial) * 0.5 * G * G / h;
        assert!((product / expected - 1.0).abs() < 1e-3, "{product} {expected}");
        // In the field's unit these are the usual sizes.
        assert!((0.1..2.0).contains(&(along_x.abs() / DEG_PER_HOUR)));
    }

    #[test]
    fn a_warm_detuned_rotor_turns_its_pickoff_offset_into_a_drift() {
        let mut design = GyroDesign::ideal(100.0);
        design.pickoff_offset = [2e-5, 0.0];
        design.stiffness_temperature = -2.4e-4;
        let warm = Surroundings { temperature: REFERENCE_TEMPERATURE + 15.0, ..Surroundings::default() };
        let zero = Vector3::zeros();
        let at = |around| run(&design, zero, zero, around, 2);
        let (cold, warm) = (at(&Surroundings::default()), at(&warm));
        // K changes by 0.36 %, held at −offset: the loop's torque is −δK · offset about x, told as y: Re(…)/H.
        let spring = -2.4e-4 * 15.0 * design.rotor.stiffness[0];
        let expected = -spring * 2e-5 / design.rebalance.design_momentum;
        assert!(((warm[1] - cold[1]) / expected - 1.0).abs() < 0.05, "{cold:?} {warm:?} {expected}");
    }

    #[test]
    fn torquer_heats_its_magnet() {
        let mut design = GyroDesign::ideal(100.0);
        design.torquer_temperature = -4e-4;
        design.torquer_power = 2.0;
        design.magnet_resistance = 5.0;
        design.magnet_lag_s = 100.0;
        let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
        let (w, f) = ([Vector3::new(0.5, 0.0, 0.0); 2], [Vector3::zeros(); 2]);
        let around = Surroundings::default();
        let mut last = 0.0;
        for k in 0..1000 {
            last = gyro.step(&w, &f, &around, 1.0).rate[0];
            if k == 99 {
                let rise = 2.0 * 5.0 * 0.25 * (1.0 - (-1.0f64).exp());
                assert!((last / (0.5 * (1.0 + 4e-4 * rise)) - 1.0).abs() < 2e-5, "{last}");
            }
        }
        assert!((last / (0.5 * (1.0 + 4e-4 * 2.5)) - 1.0).abs() < 2e-5, "{last}");
    }

    #[test]
    fn a_gradient_across_the_housing_pulls_at_the_rotor() {
        let mut design = GyroDesign::ideal(100.0);
        design.reaction_torque_gradient = [0.0, 1e-9];
        let h = design.calibration.norm();
        let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
        let mut drift = |gradient: f64| {
            let around = Surroundings { gradient, ..Surroundings::default() };
            let rest = [Vector3::zeros(); 2];
            (0..10).map(|_| gyro.step(&rest, &rest, &around, 1.0).rate[0]).last().unwrap()
        };
        assert!(drift(0.0).abs() < 1e-15);
        let expected = 1e-9 * 5.0 / h;
        let found = drift(5.0);
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    }

    #[test]
    fn a_warm_magnet_pulls_at_the_rotor() {
        let mut design = GyroDesign::ideal(100.0);
        design.torquer_power = 2.0;
        design.magnet_resistance = 5.0;
        design.magnet_lag_s = 100.0;
        design.reaction_torque_rise = [0.0, 1e-9];
        let h = design.calibration.norm();
        let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
        let (f, around) = ([Vector3::zeros(); 2], Surroundings::default());
        let mut tell = |rate: f64, n: usize| {
            let w = [Vector3::new(0.0, rate, 0.0); 2];
            (0..n).map(|_| gyro.step(&w, &f, &around, 1.0).rate[0]).last().unwrap()
        };
        // Power in the other coil: 2.5 K after long, and e⁻¹ of it left a time constant after the table has stopped.
        let hot = tell(0.5, 2000);
        let cooling = tell(0.0, 101);
        assert!((hot / (1e-9 * 2.5 / h) - 1.0).abs() < 1e-3, "{hot}");
        assert!((cooling / hot - (-1.0f64).exp()).abs() < 0.005, "{cooling} {hot}");
    }

    #[test]
    fn a_gyro_for_large_rates_tells_them_while_they_change_and_while_it_turns_about_its_spin_axis() {
        let design = GyroDesign::strapdown(200.0);
        let rotor = &design.rotor;
        assert!((rotor.rotor_equatorial / rotor.rotor_polar - 1.0).abs() < 0.05, "{rotor:?}");
        let worst = |design: &GyroDesign| {
            let mut gyro = Gyro::new(design.clone(), 1, "gyro").unwrap();
            let w = std::f64::consts::TAU * 0.01;
            let at =
                |t: f64| Vector3::new(0.03 * (w * t).sin(), 0.04 * (w * t).cos(), 0.3 * (0.7 * w * t).sin());
            let mut worst = 0.0f64;
            for k in 0..200 {
                let t = f64::from(k);
                let rate = [at(t), at(t + 0.5), at(t + 1.0)];
                let said = gyro.step(&rate, &[Vector3::zeros(); 3], &Surroundings::default(), 1.0);
                // The network knows no slope before its second step.
                for axis in (0..2).filter(|_| k > 1) {
                    worst = worst.max((said.rate[axis] - said.true_rate[axis]).abs() / DEG_PER_HOUR);
                }
            }
            worst
        };
        // What is left: the loop's answer to the rate's second derivative, and the rate about a spin axis that leans while the
        // loop catches up, both over bandwidth × integral rate.
        let ideal = worst(&design);
        let left = (0.3 * 0.04 * std::f64::consts::TAU * 0.01
            + 0.04 * (std::f64::consts::TAU * 0.01).powi(2))
            / (design.rebalance.bandwidth * design.rebalance.integral);
        assert!(ideal < left / DEG_PER_HOUR, "{ideal} deg/h");
        // Without its network, and with the rotor of a slower gyro, it does not.
        let bare = worst(&GyroDesign { network: Complex::from(0.0), ..design.clone() });
        // A/H of the rotor times the largest angular acceleration.
        let answer = 0.04 * std::f64::consts::TAU * 0.01 / rotor.spin / DEG_PER_HOUR;
        assert!((bare / answer - 1.0).abs() < 0.25, "{bare} {answer}");
        assert!(worst(&GyroDesign::ideal(200.0)) > 5.0 * ideal);
    }

    #[test]
    fn a_rotor_is_held_where_it_is_told_to_be_and_costs_nothing_while_it_is_tuned() {
        let tell = |detuning: f64| {
            let mut design = GyroDesign::strapdown(200.0);
            let spring = design.rotor.stiffness[0] * detuning / design.calibration.norm();
            design.rotor.stiffness = design.rotor.stiffness.map(|k| k * (1.0 + detuning));
            let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
            let around = Surroundings { pickoff_command: [3e-4, 1e-4], ..Surroundings::default() };
            let zero = [Vector3::zeros(); 2];
            let said = (0..3).map(|_| gyro.step(&zero, &zero, &around, 1.0)).last().unwrap();
            // But for the gimbal's anisotropy, which shakes it twice a turn.
            assert!(
                (said.pickoff[0] - 3e-4).abs() < 1e-5 && (said.pickoff[1] - 1e-4).abs() < 1e-5,
                "{said:?}"
            );
            (said.rate[0], spring * 1e-4)
        };
        assert!(tell(0.0).0.abs() < 0.005 * DEG_PER_HOUR, "{:?}", tell(0.0));
        // The loop holds the rotor against the spring: K θy/H about x.
        let (said, expected) = tell(1e-3);
        assert!((said.abs() / expected - 1.0).abs() < 0.05, "{said} {expected}");
    }

    #[test]
    fn the_fast_gyro_agrees_with_the_full_rate_one() {
        let mut design = GyroDesign::ideal(100.0);
        design.axial_unbalance = 4e-8;
        design.network = Complex::new(1e-5, 4e-4);
        design.pickoff_offset = [1e-5, -2e-5];
        design.rotor.flexure_damping = [2e-7; 2];
        design.misalignment = Vector3::new(1e-4, -2e-4, 3e-4);
        let mut fast = Gyro::new(design.clone(), 1, "gyro").unwrap();
        let mut full = Gyro::new(GyroDesign { full_rate: true, ..design }, 1, "gyro").unwrap();
        let at = |t: f64| {
            (
                Vector3::new(0.02 * (0.8 * t).sin(), 0.01 * t, 0.05 * (0.5 * t).cos()),
                Vector3::new((0.3 * t).sin(), 0.5, -9.8),
            )
        };
        let mut worst = 0.0f64;
        for k in 0..6 {
            let points: Vec<_> = (0..=10).map(|j| at(f64::from(k) + f64::from(j) / 10.0)).collect();
            let (w, f): (Vec<_>, Vec<_>) = points.into_iter().unzip();
            let around = Surroundings { temperature: 20.0 + f64::from(k), ..Surroundings::default() };
            let (a, b) = (fast.step(&w, &f, &around, 1.0), full.step(&w, &f, &around, 1.0));
            if k > 1 {
                // The first steps differ: the fast gyro starts settled.
                worst = worst.max((a.rate[0] - b.rate[0]).abs()).max((a.rate[1] - b.rate[1]).abs());
                assert!((a.pickoff[0] - b.pickoff[0]).abs() < 1e-8, "{a:?} {b:?}");
            }
        }
        assert!(worst < 0.002 * DEG_PER_HOUR, "{} deg/h", worst / DEG_PER_HOUR);
    }

    #[test]
    fn pickoff_noise_looks_like_differenced_angle_noise() {
        let mut design = GyroDesign::ideal(100.0);
        design.pickoff_noise = 1e-8;
        let mut gyro = Gyro::new(design, 5, "gyro").unwrap();
        let sigma = gyro.pickoff_noise.sigma;
        let (w, f) = ([Vector3::zeros(); 2], [Vector3::zeros(); 2]);
        let told: Vec<f64> =
            (0..20_000).map(|_| gyro.step(&w, &f, &Surroundings::default(), 1.0).rate[0]).collect();
        let n = told.len() as f64;
        let variance = told.iter().map(|x| x * x).sum::<f64>() / n;
        let lag_one = told.windows(2).map(|x| x[0] * x[1]).sum::<f64>() / n;
        assert!((variance / (2.0 * sigma * sigma) - 1.0).abs() < 0.05);
        assert!((lag_one / variance + 0.5).abs() < 0.03);
    }
}
