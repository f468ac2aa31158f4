//! What surrounds the sensors: temperature field, supply, magnetic field, vibration.
use nalgebra::{UnitQuaternion, Vector3};

use super::heat::{Bar, Conduction};
use super::readout::{REFERENCE_TEMPERATURE, REFERENCE_VOLTAGE, Surroundings};

/// A quantity given over time: straight lines between points, held beyond them, and a sine on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Times (s, increasing) and values.
    pub points: Vec<(f64, f64)>,
    /// Amplitude of a sine.
    pub amplitude: f64,
    /// Its period, s.
    pub period_s: f64,
}

impl Profile {
    /// A constant.
    pub fn constant(value: f64) -> Self {
        Self { points: vec![(0.0, value)], amplitude: 0.0, period_s: 0.0 }
    }

    /// The value at a time.
    pub fn at(&self, time_s: f64) -> f64 {
        let next = self.points.partition_point(|(t, _)| *t <= time_s);
        let base = match (next.checked_sub(1).and_then(|i| self.points.get(i)), self.points.get(next)) {
            (Some((t0, v0)), Some((t1, v1))) => v0 + (v1 - v0) * (time_s - t0) / (t1 - t0),
            (Some((_, v)), None) | (None, Some((_, v))) => *v,
            (None, None) => 0.0,
        };
        if self.amplitude == 0.0 {
            base
        } else {
            base + self.amplitude * (std::f64::consts::TAU * time_s / self.period_s).sin()
        }
    }
}

/// The body that carries the sensors, as a conductor of heat.
#[derive(Clone, Debug, PartialEq)]
pub enum Thermal {
    /// The same temperature everywhere, °C.
    Uniform(Profile),
    /// Heat conducted along a bar.
    Bar {
        /// The bar.
        bar: Bar,
        /// Temperature at the start, °C.
        initial: f64,
        /// Temperature of the surroundings, °C.
        ambient: Profile,
        /// Heat sources: position (m) and power (W).
        heaters: Vec<(f64, Profile)>,
    },
}

/// Everything that surrounds the sensors.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentDesign {
    /// Temperature.
    pub thermal: Thermal,
    /// Where the electronics sit, m along the bar; none: at each sensor.
    pub electronics_position_m: Option<f64>,
    /// Supply voltage, V.
    pub voltage: Profile,
    /// Magnetic flux density in navigation axes, T.
    pub magnetic_field: Vector3<f64>,
    /// Direction of the vibration in body axes.
    pub vibration_direction: Vector3<f64>,
    /// Its root mean square, m/s².
    pub vibration_rms: Profile,
    /// Its frequency, Hz.
    pub vibration_hz: f64,
}

impl Default for EnvironmentDesign {
    fn default() -> Self {
        Self {
            thermal: Thermal::Uniform(Profile::constant(REFERENCE_TEMPERATURE)),
            electronics_position_m: None,
            voltage: Profile::constant(REFERENCE_VOLTAGE),
            magnetic_field: Vector3::zeros(),
            vibration_direction: Vector3::z(),
            vibration_rms: Profile::constant(0.0),
            vibration_hz: 0.0,
        }
    }
}

/// Length over which an instrument feels a temperature gradient, m.
const INSTRUMENT_LENGTH_M: f64 = 0.03;

/// The surroundings at work.
#[derive(Clone, Debug)]
pub struct Environment {
    design: EnvironmentDesign,
    field: Option<Conduction>,
    time_s: f64,
}

impl Environment {
    /// At time zero.
    pub fn new(design: EnvironmentDesign) -> Self {
        let field = match &design.thermal {
            Thermal::Uniform(_) => None,
            Thermal::Bar { bar, initial, .. } => Some(Conduction::new(*bar, *initial)),
        };
        Self { design, field, time_s: 0.0 }
    }

    /// Moves on by a step.
    pub fn advance(&mut self, step_s: f64) {
        let (start, end) = (self.time_s, self.time_s + step_s);
        if let (Some(field), Thermal::Bar { ambient, heaters, .. }) = (&mut self.field, &self.design.thermal)
        {
            let middle = 0.5 * (start + end);
            field.set_heaters(heaters.iter().map(|(position, power)| (*position, power.at(middle))));
            field.advance(step_s, ambient.at(start), ambient.at(end));
        }
        self.time_s = end;
    }

    /// Temperature at a place, °C.
    pub fn temperature(&self, position_m: f64) -> f64 {
        match (&self.field, &self.design.thermal) {
            (Some(field), _) => field.at(position_m),
            (None, Thermal::Uniform(profile)) => profile.at(self.time_s),
            (None, Thermal::Bar { initial, .. }) => *initial,
        }
    }

    /// Temperature of the air around, °C.
    pub fn ambient(&self) -> f64 {
        match &self.design.thermal {
            Thermal::Uniform(profile) | Thermal::Bar { ambient: profile, .. } => profile.at(self.time_s),
        }
    }

    /// Supply voltage now, V.
    pub fn voltage(&self) -> f64 {
        self.design.voltage.at(self.time_s)
    }

    /// Root mean square of the vibration now, m/s².
    pub fn vibration_rms(&self) -> f64 {
        self.design.vibration_rms.at(self.time_s)
    }

    /// Magnetic flux density in body axes, T.
    pub fn magnetic_field(&self, attitude: &UnitQuaternion<f64>) -> Vector3<f64> {
        attitude.inverse() * self.design.magnetic_field
    }

    /// What surrounds an instrument at a place of the bar, the body in an attitude.
    pub fn around(&self, position_m: f64, attitude: &UnitQuaternion<f64>) -> Surroundings {
        let gradient = self.field.as_ref().map_or(0.0, |f| f.gradient(position_m, INSTRUMENT_LENGTH_M));
        let amplitude = self.vibration_rms() * std::f64::consts::SQRT_2;
        Surroundings {
            temperature: self.temperature(position_m),
            gradient,
            electronics: self.temperature(self.design.electronics_position_m.unwrap_or(position_m)),
            voltage: self.voltage(),
            magnetic_field: self.magnetic_field(attitude),
            vibration: self.design.vibration_direction.normalize() * amplitude,
            vibration_hz: self.design.vibration_hz,
            parasitic: 0.0,
            pickoff_command: [0.0; 2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_goes_straight_between_its_points_and_holds_beyond() {
        let profile = Profile { points: vec![(10.0, 1.0), (20.0, 3.0)], amplitude: 0.5, period_s: 40.0 };
        let sine = |t: f64| 0.5 * (std::f64::consts::TAU * t / 40.0).sin();
        for (t, base) in [(0.0, 1.0), (10.0, 1.0), (15.0, 2.0), (20.0, 3.0), (99.0, 3.0)] {
            assert!((profile.at(t) - base - sine(t)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_gradient_follows_the_rate_of_temperature_in_a_bar_heated_from_one_end() {
        // Quasi-steady: every slice beyond x warms at the ramp's rate, fed through x: ∂T/∂x = −ρc (L − x) Ṫ/k.
        let bar = Bar {
            length_m: 0.2,
            section_m2: 4e-3,
            conductivity: 160.0,
            capacity: 2.43e6,
            film_left: f64::INFINITY,
            film_right: 0.0,
            side: 0.0,
            cells: 40,
        };
        let rate = 10.0 / 3600.0;
        let ambient = Profile { points: vec![(0.0, 20.0), (3600.0, 30.0)], amplitude: 0.0, period_s: 0.0 };
        let design = EnvironmentDesign {
            thermal: Thermal::Bar { bar, initial: 20.0, ambient, heaters: vec![] },
            ..EnvironmentDesign::default()
        };
        let mut environment = Environment::new(design);
        (0..3600).for_each(|_| environment.advance(1.0));
        let around = environment.around(0.05, &UnitQuaternion::identity());
        let expected = -2.43e6 * 0.15 * rate / 160.0;
        assert!((around.gradient / expected - 1.0).abs() < 0.01, "{} {expected}", around.gradient);
    }
}
