//! How rows of the catalogue make their candidates: amplitudes in the sensor's unit, grids, instruments.
use schuler_recording::case::{Grade, SensorKind};
use schuler_recording::unit::{Dimension, STANDARD_GRAVITY, Unit};

use super::{
    AT_MEAN, AT_START, Amplitude, Candidate, Column, Effect, IN_COMMON, Nonlinear, Port, Search, Signature,
    Target,
};
use crate::inputs::series::{Series, map};
use crate::inputs::{Inputs, Place};

/// Sensors of one dimension of which every set may have something in common; of more there are too many sets.
const MOST_IN_COMMON: usize = 6;
/// How much larger than those of navigation grade the errors of tactical and of micromechanical sensors can be.
const TACTICAL: f64 = 10.0;
const MICROMECHANICAL: f64 = 1e3;
/// The same of errors that are rates of turn: 100 °/h of tactical grade where 1 °/h is of navigation grade, and of micromechanical gyros
/// ±20 °/s at rest and as much over the range of temperature (data sheet of the MPU-6000).
const TACTICAL_RATES: f64 = 100.0;
const MICROMECHANICAL_RATES: f64 = 1e5;
/// Columns below this part of the largest one are left out of a signature: the motion does not show them.
const LEAST_COLUMN: f64 = 1e-4;

/// What a coefficient is per: text in the unit, and its value in SI.
#[derive(Clone, Copy, Debug)]
pub(super) struct Per(pub(super) &'static str, pub(super) f64);

/// Per nothing.
pub(super) const ITSELF: Per = Per("", 1.0);
pub(super) const KELVIN: Per = Per("K", 1.0);
pub(super) const KELVIN_SQUARED: Per = Per("K^2", 1.0);
pub(super) const KELVIN_CUBED: Per = Per("K^3", 1.0);
pub(super) const KELVIN_PER_HOUR: Per = Per("(K/h)", 1.0 / 3600.0);
pub(super) const KELVIN_PER_METRE: Per = Per("(K/m)", 1.0);
pub(super) const HOUR: Per = Per("h", 3600.0);
pub(super) const VOLT: Per = Per("V", 1.0);
pub(super) const KILOPASCAL: Per = Per("kPa", 1e3);
pub(super) const GAUSS: Per = Per("G", 1e-4);
pub(super) const MILLIRADIAN: Per = Per("mrad", 1e-3);
pub(super) const G: Per = Per("g", STANDARD_GRAVITY);
pub(super) const G_SQUARED: Per = Per("g^2", STANDARD_GRAVITY * STANDARD_GRAVITY);
pub(super) const G_CUBED: Per = Per("g^3", STANDARD_GRAVITY * STANDARD_GRAVITY * STANDARD_GRAVITY);
pub(super) const G_KELVIN: Per = Per("g/K", STANDARD_GRAVITY);
pub(super) const RATE_SQUARED: Per = Per("(rad/s)^2", 1.0);
pub(super) const RATE_CUBED: Per = Per("(rad/s)^3", 1.0);
pub(super) const VELOCITY_SQUARED: Per = Per("(m/s)^2", 1.0);
pub(super) const VELOCITY_CUBED: Per = Per("(m/s)^3", 1.0);

/// Plausible magnitudes of a coefficient: °/h per unit for gyros, µg per unit for accelerometers, m/s for velocities.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plausible {
    pub(super) gyro: Option<[f64; 2]>,
    pub(super) accelerometer: Option<[f64; 2]>,
    pub(super) velocity: Option<[f64; 2]>,
}

impl Plausible {
    /// Nothing is known.
    pub(super) const UNKNOWN: Self = Self { gyro: None, accelerometer: None, velocity: None };

    /// Of gyros and accelerometers.
    pub(super) const fn inertial(gyro: [f64; 2], accelerometer: [f64; 2]) -> Self {
        Self { gyro: Some(gyro), accelerometer: Some(accelerometer), velocity: None }
    }

    /// Of gyros.
    pub(super) const fn gyro(gyro: [f64; 2]) -> Self {
        Self { gyro: Some(gyro), accelerometer: None, velocity: None }
    }

    /// Of accelerometers.
    pub(super) const fn accelerometer(accelerometer: [f64; 2]) -> Self {
        Self { gyro: None, accelerometer: Some(accelerometer), velocity: None }
    }

    /// In the unit of the place.
    fn at(&self, place: &Place) -> Option<[f64; 2]> {
        let (range, unit) = match place.dimension() {
            Dimension::AngularRate => (self.gyro, Unit::DegreePerHour),
            Dimension::Acceleration => (self.accelerometer, Unit::MicroG),
            Dimension::Velocity => (self.velocity, Unit::MetrePerSecond),
            Dimension::Other => return None,
        };
        let factor = match place.dimension() {
            Dimension::AngularRate => of_grade(place, TACTICAL_RATES, MICROMECHANICAL_RATES),
            _ => of_grade(place, TACTICAL, MICROMECHANICAL),
        };
        range.map(|[least, most]| [least, factor * most].map(|it| it * unit.in_si() / place.unit.in_si()))
    }
}

/// What the largest magnitude of navigation grade is to be multiplied by for a sensor.
fn of_grade(of: &Place, tactical: f64, micromechanical: f64) -> f64 {
    match of.grade {
        Some(Grade::Mems) => micromechanical,
        _ if of.micromechanical => micromechanical,
        Some(Grade::Tactical) => tactical,
        _ => 1.0,
    }
}

/// A plausible range of a number whose unit is not the sensor's, wider upwards where the grade of the sensor is less.
pub(super) fn widened(place: &Place, [least, most]: [f64; 2]) -> [f64; 2] {
    [least, most * of_grade(place, TACTICAL, MICROMECHANICAL)]
}

/// The amplitude `name` of a signature at `place` that is per `per` (whose values in the signature are SI).
pub(super) fn amplitude(place: &Place, name: &str, per: Per, plausible: Plausible) -> Amplitude {
    let unit = place.unit.name();
    Amplitude {
        name: name.to_owned(),
        unit: if per.0.is_empty() { unit.to_owned() } else { format!("{unit}/{}", per.0) },
        in_unit: per.1 / place.unit.in_si(),
        plausible: plausible.at(place),
    }
}

/// The amplitude `coefficient`.
pub(super) fn coefficient(place: &Place, per: Per, plausible: Plausible) -> Amplitude {
    amplitude(place, "coefficient", per, plausible)
}

/// An amplitude whose unit does not depend on the sensor's, e.g. ppm, with the plausible range in that unit.
pub(super) fn number(name: &str, unit: &str, in_unit: f64, plausible: Option<[f64; 2]>) -> Amplitude {
    Amplitude { name: name.to_owned(), unit: unit.to_owned(), in_unit, plausible }
}

/// A unit to a power: `V^3`, `(rad/s)^2`.
pub(super) fn to_the(unit: &str, power: usize) -> String {
    if unit.contains(['/', ' ', '^']) { format!("({unit})^{power}") } else { format!("{unit}^{power}") }
}

/// The amplitude `coefficient` in ppm.
pub(super) fn ppm(place: &Place, plausible: [f64; 2]) -> Amplitude {
    number("coefficient", "ppm", 1e6, Some(widened(place, plausible)))
}

/// The amplitude `coefficient` in arcseconds.
pub(super) fn arcseconds(place: &Place, plausible: [f64; 2]) -> Amplitude {
    number("coefficient", "arcsec", RADIAN_IN_ARCSECONDS, Some(widened(place, plausible)))
}

/// One radian in arcseconds.
pub(super) const RADIAN_IN_ARCSECONDS: f64 = 648_000.0 / std::f64::consts::PI;

/// A candidate but for where it acts.
pub(super) struct Draft {
    pub(super) variant: Vec<(&'static str, String)>,
    pub(super) search: Search,
    pub(super) amplitudes: Vec<Amplitude>,
}

impl Draft {
    /// A search without a signature, or with its own.
    pub(super) fn new(search: Search, amplitudes: Vec<Amplitude>) -> Self {
        Self { variant: Vec::new(), search, amplitudes }
    }

    /// One column at one place.
    pub(super) fn linear(place: &Place, values: impl Into<Series>, amplitude: Amplitude) -> Self {
        Self::new(Search::Linear(Signature { columns: vec![at(place, values)] }), vec![amplitude])
    }

    /// A quantity about a zero that is not known: [`with_free_reference`](Self::with_free_reference) where nothing
    /// multiplies it.
    pub(super) fn with_free_zero(self, place: &Place, rows: usize) -> Self {
        self.with_free_reference(
            place,
            vec![1.0; rows],
            amplitude(place, AT_MEAN, ITSELF, Plausible::UNKNOWN),
        )
    }

    /// Another reference than the one taken adds a multiple of what multiplies the quantity, `factor`: where the
    /// reference is not known, that multiple is an amplitude of its own, so that it is not taken for another effect.
    /// `at_mean` is that amplitude, in the unit of what it multiplies.
    pub(super) fn with_free_reference(
        mut self,
        place: &Place,
        factor: impl Into<Series>,
        at_mean: Amplitude,
    ) -> Self {
        let shift = at(place, factor);
        self.search = match self.search {
            Search::Linear(mut signature) => {
                signature.columns.push(shift);
                Search::Linear(signature)
            }
            Search::Grid { parameters, signature, unit_amplitude } => Search::Grid {
                parameters,
                signature: Box::new(move |point| {
                    let mut at_point = signature(point);
                    at_point.columns.push(shift.clone());
                    at_point
                }),
                unit_amplitude,
            },
            other => other,
        };
        self.amplitudes.push(at_mean);
        self
    }

    /// A lag whose time constant is the first parameter, and of which it is not known where it starts: what that is off decays with the time
    /// constant.
    pub(super) fn with_unknown_start(mut self, place: &Place, time_s: Series) -> Self {
        let sensor = place.sensor;
        let start_s = time_s.first().copied().unwrap_or_default();
        self.search = match self.search {
            Search::Grid { parameters, signature, unit_amplitude } => Search::Grid {
                parameters,
                signature: Box::new(move |point| {
                    let mut at_point = signature(point);
                    let decay = |tau_s: &f64| map(&time_s, |time| ((start_s - time) / tau_s).exp());
                    at_point.columns.extend(point.first().map(|tau_s| Column::on(sensor, decay(tau_s))));
                    at_point
                }),
                unit_amplitude,
            },
            other => other,
        };
        self.amplitudes.push(amplitude(place, AT_START, ITSELF, Plausible::UNKNOWN));
        self
    }

    /// Several columns at one place.
    pub(super) fn columns(place: &Place, columns: Vec<(Vec<f64>, Amplitude)>) -> Self {
        let (columns, amplitudes) =
            columns.into_iter().map(|(values, amplitude)| (at(place, values), amplitude)).unzip();
        Self::new(Search::Linear(Signature { columns }), amplitudes)
    }

    /// One column at one place that depends on a parameter not linearly.
    pub(super) fn grid(
        place: &Place,
        parameter: Nonlinear,
        amplitude: Amplitude,
        values: impl Fn(f64) -> Vec<f64> + Send + Sync + 'static,
    ) -> Self {
        let sensor = place.sensor;
        let signature = move |parameters: &[f64]| {
            let values = parameters.first().map_or_else(Vec::new, |&parameter| values(parameter));
            Signature { columns: vec![Column::on(sensor, values)] }
        };
        let search = Search::Grid {
            parameters: vec![parameter],
            signature: Box::new(signature),
            unit_amplitude: false,
        };
        Self::new(search, vec![amplitude])
    }

    /// One column at one place that is known but for a parameter: it is there as it is, without an amplitude.
    pub(super) fn whole(
        place: &Place,
        parameter: Nonlinear,
        values: impl Fn(f64) -> Vec<f64> + Send + Sync + 'static,
    ) -> Self {
        let mut draft = Self::grid(place, parameter, number("part", "1", 1.0, None), values);
        if let Search::Grid { unit_amplitude, .. } = &mut draft.search {
            *unit_amplitude = true;
        }
        draft
    }

    /// The same, with a word that says which of several it is.
    pub(super) fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.variant.push((name, value.into()));
        self
    }

    /// The same at its target.
    pub(super) fn of(self, effect: &'static Effect, target: Target, port: Port) -> Candidate {
        let Self { variant, search, amplitudes } = self;
        Candidate { effect, target, port, variant, search, amplitudes, noise_factor: 1.0 }
    }
}

/// A column at one place.
fn at(place: &Place, values: impl Into<Series>) -> Column {
    Column::on(place.sensor, values)
}

/// The candidates at every place on whose kind the effect acts.
pub(super) fn at_each_place(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    drafts: impl Fn(&Place) -> Vec<Draft>,
) -> Vec<Candidate> {
    (inputs.places.iter())
        .filter(|place| (effect.acts_on)(place.kind))
        .flat_map(|place| {
            let target = || Target::Sensor(place.sensor);
            drafts(place).into_iter().map(move |draft| draft.of(effect, target(), place.port))
        })
        .collect()
}

/// The same but for the velocity of a Schuler loop, which is read by radio or log and has no errors of this kind.
pub(super) fn at_each_instrument_place(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    drafts: impl Fn(&Place) -> Vec<Draft>,
) -> Vec<Candidate> {
    at_each_place(effect, inputs, |place| {
        if inputs.is_loop() && place.port == Port::Output { Vec::new() } else { drafts(place) }
    })
}

/// The candidates of an effect that several sensors of one dimension have in common, for every set of them: each has its own of the
/// `amplitudes`.
pub(super) fn in_common(
    effect: &'static Effect,
    inputs: &Inputs<'_>,
    search: impl Fn() -> Search,
    amplitudes: impl Fn(&Place) -> Vec<Amplitude>,
) -> Vec<Candidate> {
    let of_set = |places: &[&Place]| {
        let own = |place: &&Place| -> Vec<Amplitude> {
            let named = |it: Amplitude| Amplitude { name: format!("{}_{}", it.name, place.name), ..it };
            amplitudes(place).into_iter().map(named).collect()
        };
        let names: Vec<&str> = places.iter().map(|place| place.name.as_str()).collect();
        let sensors = places.iter().map(|place| place.sensor).collect();
        let target = Target::Group { name: names.join(IN_COMMON), sensors };
        Draft::new(search(), places.iter().flat_map(own).collect()).of(effect, target, Port::Output)
    };
    let of_dimension = |dimension: Dimension| {
        let is_of_it = |place: &&Place| place.dimension() == dimension && (effect.acts_on)(place.kind);
        let places: Vec<&Place> = inputs.places.iter().filter(is_of_it).collect();
        let number = if places.len() > MOST_IN_COMMON || inputs.is_loop() { 0 } else { places.len() };
        let sets = (0..1_usize << number).map(move |set| {
            let of_set = |(place, _): &(usize, &&Place)| set >> place & 1 == 1;
            places.iter().enumerate().filter(of_set).map(|(_, place)| *place).collect::<Vec<&Place>>()
        });
        sets.filter(|set| set.len() > 1)
    };
    let dimensions = [Dimension::AngularRate, Dimension::Acceleration, Dimension::Velocity];
    dimensions.into_iter().flat_map(of_dimension).map(|set| of_set(&set)).collect()
}

/// Sensors that share an effect: a group, or a sensor that belongs to none.
pub(super) struct Instrument<'i> {
    pub(super) target: Target,
    pub(super) places: Vec<&'i Place>,
}

impl Instrument<'_> {
    /// Those of its sensors that measure one dimension, for each dimension that has a unit; in units of free text nothing is in
    /// common.
    pub(super) fn by_dimension(&self) -> Vec<Self> {
        let of = |dimension: Dimension| {
            let is_of_it = |place: &&Place| place.dimension() == dimension;
            let places: Vec<&Place> = self.places.iter().copied().filter(is_of_it).collect();
            let target = match &self.target {
                Target::Group { name, .. } => {
                    let sensors = places.iter().map(|place| place.sensor).collect();
                    Target::Group { name: name.clone(), sensors }
                }
                target @ Target::Sensor(_) => target.clone(),
            };
            (!places.is_empty()).then_some(Self { target, places })
        };
        let dimensions = [Dimension::AngularRate, Dimension::Acceleration, Dimension::Velocity];
        dimensions.into_iter().filter_map(of).collect()
    }
}

/// Every instrument, with those of its sensors on which the effect acts and which `has` what is needed.
pub(super) fn instruments<'i>(
    effect: &'static Effect,
    inputs: &'i Inputs<'_>,
    has: impl Fn(&Place) -> bool,
) -> Vec<Instrument<'i>> {
    let mut instruments: Vec<Instrument<'i>> = Vec::new();
    for place in inputs.places.iter().filter(|place| (effect.acts_on)(place.kind) && has(place)) {
        let group = place.group.as_deref().filter(|_| !inputs.is_loop());
        let known = instruments.iter_mut().find(
            |known| matches!(&known.target, Target::Group { name, .. } if Some(name.as_str()) == group),
        );
        match (known, group) {
            (Some(known), _) => known.places.push(place),
            (None, group) => {
                let target = match group {
                    Some(name) => Target::Group { name: name.to_owned(), sensors: Vec::new() },
                    None => Target::Sensor(place.sensor),
                };
                instruments.push(Instrument { target, places: vec![place] });
            }
        }
    }
    for instrument in &mut instruments {
        if let Target::Group { sensors, .. } = &mut instrument.target {
            *sensors = instrument.places.iter().map(|place| place.sensor).collect();
        }
    }
    instruments
}

/// Columns that the motion shows, with their amplitudes; the others are left out.
pub(super) fn seen(columns: Vec<(Column, Amplitude)>) -> (Signature, Vec<Amplitude>) {
    let size = |column: &Column| {
        column
            .parts
            .iter()
            .flat_map(|(_, values)| &**values)
            .fold(0.0_f64, |most, value| most.max(value.abs()))
    };
    let largest = columns.iter().map(|(column, _)| size(column)).fold(0.0, f64::max);
    let (columns, amplitudes) =
        columns.into_iter().filter(|(column, _)| size(column) > LEAST_COLUMN * largest).unzip();
    (Signature { columns }, amplitudes)
}

/// `per_decade` points in each decade from `low` to `high`, both included; none if `low` is not below `high`.
pub(super) fn logarithmic(low: f64, high: f64, per_decade: f64) -> Vec<f64> {
    if !(low > 0.0 && high > low) {
        return Vec::new();
    }
    let steps = ((high / low).log10() * per_decade).ceil().max(1.0);
    (0..=steps as usize).map(|k| low * (high / low).powf(k as f64 / steps)).collect()
}

/// The parameter `tau_s`, from `low` to `high` as far as steps and length of the record show it; none if they do not.
pub(super) fn time_constant(inputs: &Inputs<'_>, low: f64, high: f64) -> Option<Nonlinear> {
    let duration_s = inputs.duration_s();
    // In a short record what is faster shows as well.
    let low = low.min(duration_s / 100.0).max(2.0 * inputs.recording.step_s);
    let grid = logarithmic(low, high.min(duration_s), 4.0);
    (grid.len() > 1).then_some(Nonlinear { name: "tau_s", unit: "s", grid })
}

pub(super) const fn any(_: SensorKind) -> bool {
    true
}

pub(super) const fn gyros(kind: SensorKind) -> bool {
    matches!(kind.dimension(), Dimension::AngularRate)
}

pub(super) const fn tuned_gyros(kind: SensorKind) -> bool {
    matches!(kind, SensorKind::Dtg)
}

pub(super) const fn accelerometers(kind: SensorKind) -> bool {
    matches!(kind.dimension(), Dimension::Acceleration)
}

pub(super) const fn inertial(kind: SensorKind) -> bool {
    gyros(kind) || accelerometers(kind)
}

pub(super) const fn velocities(kind: SensorKind) -> bool {
    matches!(kind.dimension(), Dimension::Velocity)
}

/// Sensors whose lever arm shows in their reading.
pub(super) const fn displaced(kind: SensorKind) -> bool {
    accelerometers(kind) || velocities(kind)
}
