//! From the form of an effect to its signals in a case.
use nalgebra::Vector3;
use schuler_recording::motion::earth;
use schuler_recording::unit::Dimension;

use super::given::{Given, factor};
use super::signal::{
    Factor, Function, LONG_LAG_STEPS, Memory, NARROW, Outside, Product, Signal, WIDE, Weighted,
};
use crate::catalogue::{
    AT_MEAN, AT_START, Candidate, EQUATORIAL_FIELD, Form, GyroAxis, InFlight, Part, rate_over_earth,
    schuler_rate,
};
use crate::description::nonlinear_names;
use crate::inputs::motion::Vectors;
use crate::inputs::series::{both_signs, derivative, mean};
use crate::inputs::{AuxiliaryInput, Gradient, Inputs, Place, Series, Thermometer};

/// Name, unit and meaning of the body's vectors.
const RATE: (&str, &str, &str) = ("rate", "rad/s", "inertial rate");
const FORCE: (&str, &str, &str) = ("force", "m/s^2", "specific force");
const VELOCITY: (&str, &str, &str) = ("velocity", "m/s", "velocity");
const ANGULAR_ACCELERATION: (&str, &str, &str) = ("angular_acceleration", "rad/s^2", "angular acceleration");
const RATE_OVER_EARTH: (&str, &str, &str) = ("rate_over_earth", "rad/s", "rate over the Earth");
const NORTH: (&str, &str, &str) = ("north", "1", "direction of north");
const DOWN: (&str, &str, &str) = ("down", "1", "direction of down");

/// The signals of an effect with its parameters at given values.
pub struct Resolver<'r> {
    /// What was recorded.
    pub inputs: &'r Inputs<'r>,
    /// The effect in the case.
    pub candidate: &'r Candidate,
    /// Its non-linear parameters.
    pub nonlinear: &'r [f64],
    /// The inputs that signals have so far.
    pub given: &'r mut Given,
}

impl<'r> Resolver<'r> {
    /// The signal of the amplitude at `index` at a sensor whose fitted values are `values`; none where the effect has no form.
    pub fn signal(&mut self, index: usize, sensor: usize, values: &[f64]) -> Option<Signal> {
        let inputs = self.inputs;
        let of_sensor = |place: &&Place| place.sensor == sensor && place.port == self.candidate.port;
        let place = inputs.places.iter().find(of_sensor)?;
        let amplitude = self.candidate.amplitudes.get(index)?.name.as_str();
        if amplitude == AT_START {
            let tau_s = self.parameter("tau_s")?;
            let decay = Factor { function: Function::Decay { tau_s }, ..self.time() };
            return Some(Signal::product(vec![decay]));
        }
        let is_mean = amplitude == AT_MEAN;
        match self.candidate.effect.form {
            Form::Term => self.product(place, self.parts()?, is_mean),
            Form::Step => {
                let onset = Factor { reference: self.parameter("onset_s")?, ..self.time() };
                Some(Signal::product(vec![Factor { function: Function::Step, ..onset }]))
            }
            Form::Drift => {
                let reference = self.parameter("onset_s").unwrap_or_default();
                let since = Factor { reference, function: Function::Ramp, ..self.time() };
                Some(Signal::product(vec![since]))
            }
            Form::WarmUp => self.warm_up(),
            Form::Runs => self.run(amplitude),
            Form::Waves => self.wave(amplitude),
            Form::Lag(_) if is_mean => Some(Signal::product(Vec::new())),
            Form::Lag(parts) => {
                let tau_s = self.parameter("tau_s")?;
                Some(self.product(place, parts.to_vec(), false)?.through(Memory::Lag { tau_s }))
            }
            Form::Branch => {
                let half_width = self.parameter("width")?;
                let name = self.temperature(self.thermometer()?);
                Some(Signal::product(vec![Factor::of(name)]).through(Memory::Branch { half_width }))
            }
            Form::Recorded | Form::RecordedSquare | Form::MagneticField if is_mean => {
                Some(Signal::product(Vec::new()))
            }
            Form::Recorded => self.recorded(),
            Form::RecordedSquare => {
                let mut quantity = self.quantity(self.text("column")?, self.is_smoothed())?.0;
                quantity.function = Function::Power { exponent: 2 };
                Some(Signal::product(vec![quantity]))
            }
            Form::MagneticField if self.text("column").is_some() => self.recorded(),
            Form::MagneticField => self.dipole(),
            Form::Mounting => self.mounting(place, amplitude),
            Form::DeadZone => {
                let threshold = self.parameter("threshold")?;
                self.of_input(place, Function::DeadZone { threshold })
            }
            Form::Clipped => {
                let limit = self.parameter("limit")?;
                self.of_input(place, Function::Clipped { limit })
            }
            Form::Heating => self.heating(place),
            Form::AngularAcceleration => {
                let axis = match self.text("axis") {
                    Some("other") => place.axes.other,
                    _ => place.axes.input,
                };
                let vectors = inputs.motion.angular_acceleration.as_ref()?;
                let of = self.given.along(ANGULAR_ACCELERATION, &axis, vectors);
                Some(Signal::product(vec![factor(of, 1)]))
            }
            Form::Delay => {
                let delay_s = self.parameter("delay_s")?;
                let reach = if place.dimension() == Dimension::Velocity { WIDE } else { NARROW };
                let outside = Outside::StraightOn;
                let input = self.of_input(place, Function::Power { exponent: 1 })?;
                Some(input.through(Memory::Delay { delay_s, reach, outside, less_now: true }))
            }
            Form::Bandwidth => self.bandwidth(place),
            Form::LeverArm => self.lever_arm(place, amplitude),
            Form::EarthRate => self.earth_rate(place),
            Form::Gravity => {
                let of = self.given.along(DOWN, &-place.axes.input, inputs.motion.down.as_ref()?);
                Some(Signal::product(vec![factor(of, 1)]))
            }
            Form::Proportional => {
                let input = place.input.as_ref()?;
                let (of_input, of_both) =
                    input.iter().zip(values).fold((0.0, 0.0), |(u2, uv), (u, v)| (u2 + u * u, uv + u * v));
                let mut signal = self.of_input(place, Function::Power { exponent: 1 })?;
                signal.sum.iter_mut().for_each(|product| product.coefficient = of_both / of_input);
                Some(signal)
            }
            Form::Values => None,
        }
    }

    fn parameter(&self, name: &str) -> Option<f64> {
        let place = nonlinear_names(self.candidate).iter().position(|(known, _)| *known == name)?;
        self.nonlinear.get(place).copied()
    }

    fn text(&self, name: &str) -> Option<&'r str> {
        let mut variant = self.candidate.variant.iter();
        variant.find(|(known, _)| *known == name).map(|(_, text)| text.as_str())
    }

    fn is_smoothed(&self) -> bool {
        self.text("readings").is_some()
    }

    fn time(&mut self) -> Factor {
        Factor::of(self.given.put("time_s", "s", "time from the first row", &self.inputs.time_s))
    }

    fn parts(&self) -> Option<Vec<Part>> {
        match self.candidate.effect.in_flight {
            InFlight::Term(parts) => Some(parts.to_vec()),
            InFlight::ByAxis(products) => {
                let axis = self.text("axis")?;
                products.iter().find(|(name, _)| *name == axis).map(|(_, parts)| parts.to_vec())
            }
            InFlight::Never(_) => None,
        }
    }

    /// The product of parts; at the mean of a temperature without it.
    fn product(&mut self, place: &Place, parts: Vec<Part>, is_mean: bool) -> Option<Signal> {
        let of_temperature = |part: &Part| matches!(part, Part::Temperature(_) | Part::TemperatureDifference);
        let kept = parts.into_iter().filter(|part| *part != Part::One && !(is_mean && of_temperature(part)));
        let factors: Option<Vec<Factor>> = kept.map(|part| self.part(place, part)).collect();
        Some(Signal::product(factors?))
    }

    fn part(&mut self, place: &Place, part: Part) -> Option<Factor> {
        let inputs = self.inputs;
        let (rate, force) = (inputs.motion.rate.as_ref(), inputs.motion.force.as_ref());
        let axis = |axis: GyroAxis| match axis {
            GyroAxis::Input => place.axes.input,
            GyroAxis::Other => place.axes.other,
            GyroAxis::Spin => place.axes.spin,
        };
        Some(match part {
            Part::One => return None,
            Part::Temperature(exponent) => {
                let thermometer = self.thermometer()?;
                let reference = self.reference(place, thermometer);
                let input = self.temperature(thermometer);
                Factor { reference, function: Function::Power { exponent }, ..Factor::of(input) }
            }
            Part::TemperatureRate => {
                let thermometer = self.thermometer()?;
                let is = format!("rate of the smoothed temperature in column {}", thermometer.column);
                let wanted = format!("rate_of_{}", thermometer.column);
                Factor::of(self.given.put(&wanted, "K/s", &is, &thermometer.rate))
            }
            Part::TemperatureDifference => self.difference(place)?,
            Part::Input(exponent) => self.input(place, Function::Power { exponent })?,
            Part::InputMagnitude => self.input(place, Function::Magnitude)?,
            Part::InputAcross => factor(self.own_quantity(place, &self.across(place)?)?, 1),
            Part::ForceAcross => factor(self.given.along(FORCE, &self.across(place)?, force?), 1),
            Part::Force(of) => factor(self.given.along(FORCE, &axis(of), force?), 1),
            Part::Rate(of) => factor(self.given.along(RATE, &axis(of), rate?), 1),
        })
    }

    // ── The input, and motion ───────────────────────────────────────────────────────────────────────────────────────

    /// A function of the sensor's own input.
    fn input(&mut self, place: &Place, function: Function) -> Option<Factor> {
        let series = self.inputs.recording.sensors.get(place.sensor)?;
        let of = if series.predicted.is_some() {
            let is = format!("what the simulation says that {} reads", place.name);
            let name = format!("input_{}", place.name);
            let input = self.given.put(&name, place.unit.si().name(), &is, place.input.as_ref()?);
            vec![Weighted { input, weight: 1.0 }]
        } else {
            place.input.as_ref()?;
            self.own_quantity(place, &place.axes.input)?
        };
        Some(Factor::new(of, 0.0, function))
    }

    fn of_input(&mut self, place: &Place, function: Function) -> Option<Signal> {
        Some(Signal::product(vec![self.input(place, function)?]))
    }

    /// The quantity that a sensor measures, along a direction.
    fn own_quantity(&mut self, place: &Place, direction: &Vector3<f64>) -> Option<Vec<Weighted>> {
        let motion = &self.inputs.motion;
        let (name, vectors): (_, &Vectors) = match place.dimension() {
            Dimension::AngularRate => (RATE, motion.rate.as_ref()?),
            Dimension::Acceleration => (FORCE, motion.force.as_ref()?),
            Dimension::Velocity => (VELOCITY, motion.velocity.as_ref()?),
            Dimension::Other => return None,
        };
        Some(self.given.along(name, direction, vectors))
    }

    /// The direction across the axis that the parameter `axis` names.
    fn across(&self, place: &Place) -> Option<Vector3<f64>> {
        let axis = self.text("axis")?;
        place.axes.across().into_iter().find(|(name, _)| *name == axis).map(|(_, direction)| direction)
    }

    fn mounting(&mut self, place: &Place, amplitude: &str) -> Option<Signal> {
        let about = match amplitude {
            "angle_x" => Vector3::x(),
            "angle_y" => Vector3::y(),
            "angle_z" => Vector3::z(),
            _ => return self.product(place, vec![Part::InputAcross], false),
        };
        let of = self.own_quantity(place, &about.cross(&place.axes.input))?;
        Some(Signal::product(vec![factor(of, 1)]))
    }

    fn heating(&mut self, place: &Place) -> Option<Signal> {
        let (tau_s, rate) = (self.parameter("tau_s")?, self.inputs.motion.rate.as_ref()?);
        let mut axes = vec![place.axes.input];
        axes.extend((self.text("axis") == Some("both")).then_some(place.axes.other));
        let powers = axes.iter().map(|axis| Product {
            coefficient: 1.0,
            factors: vec![factor(self.given.along(RATE, axis, rate), 2)],
        });
        Some(Signal { sum: powers.collect(), memory: Some(Memory::Lag { tau_s }) })
    }

    fn bandwidth(&mut self, place: &Place) -> Option<Signal> {
        let (tau_s, time_s) = (self.parameter("tau_s")?, &self.inputs.time_s);
        let step_s = self.inputs.duration_s() / (time_s.len().max(2) - 1) as f64;
        let input = self.of_input(place, Function::Power { exponent: 1 })?;
        // Of a long lag the loss is not told by a cubic from row to row.
        (tau_s <= LONG_LAG_STEPS * step_s).then(|| input.through(Memory::Bandwidth { tau_s }))
    }

    fn lever_arm(&mut self, place: &Place, amplitude: &str) -> Option<Signal> {
        let arm = match amplitude {
            "arm_x_m" => Vector3::x(),
            "arm_y_m" => Vector3::y(),
            "arm_z_m" => Vector3::z(),
            _ => return None,
        };
        let (motion, axis) = (&self.inputs.motion, place.axes.input);
        let rate = motion.rate.as_ref()?;
        // a·(x × r) = x·(r × a).
        let turned = arm.cross(&axis);
        if place.dimension() == Dimension::Velocity {
            let over_earth = rate_over_earth(self.inputs, motion.instant_rate.as_ref().unwrap_or(rate));
            let of = self.given.along(RATE_OVER_EARTH, &turned, &over_earth);
            return Some(Signal::product(vec![factor(of, 1)]));
        }
        // ω × (ω × r) = ω (ω·r) − r ω².
        let accelerations =
            self.given.along(ANGULAR_ACCELERATION, &turned, motion.angular_acceleration.as_ref()?);
        let of_axis = factor(self.given.along(RATE, &axis, rate), 1);
        let of_arm = factor(self.given.along(RATE, &arm, rate), 1);
        let mut sum = vec![
            Product { coefficient: 1.0, factors: vec![factor(accelerations, 1)] },
            Product { coefficient: 1.0, factors: vec![of_axis, of_arm] },
        ];
        let along = axis.dot(&arm);
        if along != 0.0 {
            for body in [Vector3::x(), Vector3::y(), Vector3::z()] {
                let square = factor(self.given.along(RATE, &body, rate), 2);
                sum.push(Product { coefficient: -along, factors: vec![square] });
            }
        }
        Some(Signal { sum, memory: None })
    }

    /// −Ω cos φ·(down × north)·a of a heading, −Ω (sin φ north + cos φ down)·a of a latitude.
    fn earth_rate(&mut self, place: &Place) -> Option<Signal> {
        let (motion, axis) = (&self.inputs.motion, place.axes.input);
        let (north, down) = (motion.north.as_ref()?, motion.down.as_ref()?);
        let (sin, cos) = self.inputs.recording.case.site?.latitude_deg.to_radians().sin_cos();
        let omega = earth::ROTATION_RATE;
        if self.text("angle") == Some("latitude") {
            let mut of = self.given.along(NORTH, &(-omega * sin * axis), north);
            of.extend(self.given.along(DOWN, &(-omega * cos * axis), down));
            return Some(Signal::product(vec![factor(of, 1)]));
        }
        // a·(down × north) = Σ down_i (north × a)_i, a sum of products.
        let body = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut sum = Vec::new();
        for direction in body {
            // (north × a)·e = north·(a × e).
            let of_north = self.given.along(NORTH, &axis.cross(&direction), north);
            let of_down = self.given.along(DOWN, &direction, down);
            if !of_north.is_empty() {
                let factors = vec![factor(of_down, 1), factor(of_north, 1)];
                sum.push(Product { coefficient: -omega * cos, factors });
            }
        }
        Some(Signal { sum, memory: None })
    }

    fn dipole(&mut self) -> Option<Signal> {
        let inputs = self.inputs;
        let (sin, cos) = inputs.recording.case.site?.latitude_deg.to_radians().sin_cos();
        let axis = match self.text("axis")? {
            "x" => Vector3::x(),
            "y" => Vector3::y(),
            _ => Vector3::z(),
        };
        let (north, down) = (inputs.motion.north.as_ref()?, inputs.motion.down.as_ref()?);
        let mut of = self.given.along(NORTH, &(EQUATORIAL_FIELD * cos * axis), north);
        of.extend(self.given.along(DOWN, &(2.0 * EQUATORIAL_FIELD * sin * axis), down));
        Some(Signal::product(vec![factor(of, 1)]))
    }

    // ── Time ────────────────────────────────────────────────────────────────────────────────────────────────────────

    fn warm_up(&mut self) -> Option<Signal> {
        let tau_s = self.parameter("tau_s")?;
        let again = self.text("switched_on").is_some_and(|way| way != "before the record");
        let since = if again {
            let values: Series = self.inputs.since_switch_on_s().into();
            Factor::of(self.given.put("since_switch_on_s", "s", "time since the last switch-on", &values))
        } else {
            self.time()
        };
        Some(Signal::product(vec![Factor { function: Function::Decay { tau_s }, ..since }]))
    }

    fn run(&mut self, amplitude: &str) -> Option<Signal> {
        let run: usize = amplitude.strip_prefix("coefficient_run_")?.parse().ok()?;
        let starts = &self.inputs.possible_run_starts;
        let begin = |run: usize| starts.get(run).and_then(|row| self.inputs.time_s.get(*row)).copied();
        let (from, to) = (begin(run.checked_sub(1)?)?, begin(run));
        let time = self.time();
        let since = |reference: f64, coefficient: f64| Product {
            coefficient,
            factors: vec![Factor { reference, function: Function::Step, ..time.clone() }],
        };
        let sum = std::iter::once(since(from, 1.0)).chain(to.map(|to| since(to, -1.0)));
        Some(Signal { sum: sum.collect(), memory: None })
    }

    fn wave(&mut self, amplitude: &str) -> Option<Signal> {
        let of_earth = amplitude.ends_with("_day");
        let frequency_hz = match self.parameter("frequency_hz") {
            Some(frequency_hz) => frequency_hz,
            None if of_earth => earth::ROTATION_RATE / std::f64::consts::TAU,
            None => schuler_rate(self.inputs) / std::f64::consts::TAU,
        };
        let function = match amplitude.trim_end_matches("_day") {
            "a" => Function::Cosine { frequency_hz },
            "b" => Function::Sine { frequency_hz },
            _ => return None,
        };
        Some(Signal::product(vec![Factor { function, ..self.time() }]))
    }

    // ── Temperatures ────────────────────────────────────────────────────────────────────────────────────────────────

    fn thermometer(&self) -> Option<&'r Thermometer> {
        let column = self.text("column")?;
        self.inputs.thermometers.iter().find(|it| it.column == column)
    }

    fn reference(&self, place: &Place, thermometer: &Thermometer) -> f64 {
        if let Some(searched) = self.parameter("reference_degC") {
            return searched;
        }
        if self.text("reference").is_some() {
            return mean(&thermometer.temperature);
        }
        self.inputs.reference(place, thermometer).0
    }

    fn difference(&mut self, place: &Place) -> Option<Factor> {
        let (to, from) = self.text("column")?.split_once(" - ")?;
        let is_it = |it: &Gradient| it.columns[0] == from && it.columns[1] == to;
        let gradient = self.inputs.gradients_at(place).into_iter().find(is_it)?;
        let reference = if self.text("reference").is_some() { mean(&gradient.values) } else { 0.0 };
        let over = gradient.distance_m.unwrap_or(1.0);
        let values: Series = gradient.values.iter().map(|value| value * over).collect();
        let is = format!("smoothed temperature in column {to} less that in column {from}");
        let (wanted, weight) = (format!("{to}_less_{from}"), over.recip());
        let input = self.given.put(&wanted, "K", &is, &values);
        Some(Factor::new(vec![Weighted { input, weight }], reference, Function::Power { exponent: 1 }))
    }

    fn temperature(&mut self, thermometer: &Thermometer) -> String {
        let is = format!("temperature in column {}, smoothed", thermometer.column);
        let wanted = format!("temperature_{}", thermometer.column);
        self.given.put(&wanted, "degC", &is, &thermometer.temperature)
    }

    // ── Recorded quantities ─────────────────────────────────────────────────────────────────────────────────────────

    /// A recorded quantity as a factor, with its values.
    fn quantity(&mut self, column: &str, smoothed: bool) -> Option<(Factor, Series)> {
        let inputs = self.inputs;
        let is_it = |it: &&AuxiliaryInput| it.column == column && it.smoothed == smoothed;
        if let Some(quantity) = inputs.auxiliaries.iter().find(is_it) {
            let series = inputs.recording.auxiliary(column)?;
            let name = self.given.recorded(series, &quantity.values, smoothed);
            return Some((Factor::of(name), quantity.values.clone()));
        }
        let thermometer = inputs.thermometers.iter().find(|it| it.column == column)?;
        Some((Factor::of(self.temperature(thermometer)), thermometer.temperature.clone()))
    }

    fn recorded(&mut self) -> Option<Signal> {
        let (column, smoothed) = (self.text("column")?, self.is_smoothed());
        let (quantity, values) = self.quantity(column, smoothed)?;
        let Some(function) = self.text("function") else {
            let reference = mean(&values);
            let signal = Signal::product(vec![Factor { reference, ..quantity }]);
            let lag = self.parameter("tau_s").map(|tau_s| Memory::Lag { tau_s });
            return Some(Signal { memory: lag, ..signal });
        };
        // One of both signs is taken as it is, another about its mean.
        let reference = if both_signs(&values) { 0.0 } else { mean(&values) };
        let about = Factor { reference, ..quantity.clone() };
        let of = |function: Function| Factor { function, ..about.clone() };
        let power = |exponent: u8| Some(Signal::product(vec![of(Function::Power { exponent })]));
        match function {
            "square" => power(2),
            "cube" => power(3),
            "abs" => Some(Signal::product(vec![of(Function::Magnitude)])),
            "odd_square" => Some(Signal::product(vec![about.clone(), of(Function::Magnitude)])),
            "sign" => Some(Signal::product(vec![Factor { function: Function::Sign, ..quantity }])),
            "rate" => {
                let rate: Series = derivative(&self.inputs.time_s, &values).into();
                let unit = self.inputs.recording.auxiliary(column).map(|it| it.auxiliary.unit.as_str());
                let unit = format!("{}/s", unit.filter(|unit| !unit.is_empty()).unwrap_or("1"));
                let kind = if smoothed { "smoothed column" } else { "column" };
                let is = format!("rate of {kind} {column}");
                Some(Signal::product(vec![Factor::of(self.given.put(
                    &format!("rate_of_{column}"),
                    &unit,
                    &is,
                    &rate,
                ))]))
            }
            "product" => {
                let (other, values) = self.quantity(self.text("with")?, false)?;
                let reference = if both_signs(&values) { 0.0 } else { mean(&values) };
                Some(Signal::product(vec![about, Factor { reference, ..other }]))
            }
            "delay" => {
                let delay_s = self.parameter("delay_s")?;
                let memory =
                    Memory::Delay { delay_s, reach: NARROW, outside: Outside::First, less_now: false };
                Some(Signal::product(vec![about]).through(memory))
            }
            _ => None,
        }
    }
}
