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
use super::readout::{Nonlinearity, REFERENCE_TEMPERATURE, Readout, Surroundings};
use super::rotor::{ClosedLoop, Excitation, Harmonics, Response, Rotor, Unstable};

pub use design::GyroDesign;

mod design;
#[cfg(test)]
mod tests;

const I: Complex<f64> = Complex::new(0.0, 1.0);

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
