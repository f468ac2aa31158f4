//! Everything in a case on which an effect may depend, on the recording's grid, without holes.
//!
//! | module | gives |
//! | --- | --- |
//! | [`series`] | shared series, and what is done to them: bridging, lag, delay, derivative, play |
//! | [`grade`] | how good each sensor is |
//! | [`held`] | a reference that is held between its readings |
//! | [`smoother`] | a quantity and its rate from noisy measurements |
//! | [`thermometer`] | temperature and its rate from quantised readings |
//! | [`motion`] | what the body did, in body axes |
//! | [`redundant`] | what it did where only redundant sensors say so |
//! | [`place`] | where an effect can act, with axes and true input |
//!
//! SI units and radians; temperature in °C, its rate in K/s.
pub mod grade;
pub mod held;
pub mod motion;
pub mod place;
pub mod redundant;
pub mod resets;
pub mod series;
pub mod smoother;
pub mod thermometer;

use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use nalgebra::Vector3;
use rayon::prelude::*;
use schuler_recording::Recording;
use schuler_recording::case::{self, MotionKind, Quantity};
use schuler_recording::recording::{AuxiliarySeries, Gap};

pub use motion::BodyMotion;
pub use place::{Axes, Place};
pub use series::Series;
pub use thermometer::Thermometer;

use crate::catalogue::Port;
use crate::nominal;
use crate::numeric::statistics::median;
use motion::{Vectors, along};
use series::{bridged, map, mean, range};

/// A gap longer than this, s, and than [`RESTART_STEPS`] steps is a switch-off.
const RESTART_S: f64 = 300.0;
/// See [`RESTART_S`].
const RESTART_STEPS: usize = 20;
/// A gap of so many steps, and longer than this, s, may hide a switch-off that was short: instruments do not start in less, and a logger
/// that drops a few readings switches nothing off. The most of them, the longest, that are asked.
const SHORT_RESTART_STEPS: usize = 3;
const SHORT_RESTART_S: f64 = 5.0;
const MOST_RESTARTS: usize = 12;
/// Part of its usual voltage below which a supply is off.
const OFF: f64 = 0.1;
/// An auxiliary quantity varies if it moves by more than this many of its steps.
const AUXILIARY_STEPS: f64 = 3.0;
/// Or if it changes more seldom than in this part of the rows: it was switched, and does not flicker.
const SWITCHED: f64 = 0.01;
/// Part of the squared changes of a quantity's readings from row to row that what is smooth in them has at most where the rest is noise.
const NOISY: f64 = 0.9;
/// Most pairs of thermometers that are tried as gradients at one place.
const MOST_GRADIENTS: usize = 6;

/// The recorded and derived quantities of a case.
#[derive(Clone, Debug)]
pub struct Inputs<'r> {
    /// The recording.
    pub recording: &'r Recording,
    /// Time from the first row, s, by the grid.
    pub time_s: Series,
    /// Motion of the body.
    pub motion: BodyMotion,
    /// Where an effect can act.
    pub places: Vec<Place>,
    /// The thermometers.
    pub thermometers: Vec<Thermometer>,
    /// The other recorded quantities.
    pub auxiliaries: Vec<AuxiliaryInput>,
    /// Row in which each run from switch-on to switch-off begins; the first is 0.
    pub run_starts: Vec<usize>,
    /// The same with the gaps that may hide a short switch-off.
    pub possible_run_starts: Vec<usize>,
    /// Differences of temperatures that were asked for, by their columns.
    differences: Arc<Mutex<Vec<Difference>>>,
    /// What white levels may go with, where that was asked for.
    loudness: OnceLock<Arc<[Loudness]>>,
}

/// Columns of two thermometers, their difference, K, and its mean variance, K².
type Difference = ([String; 2], (Series, f64));

/// A recorded quantity other than a temperature.
#[derive(Clone, Debug)]
pub struct AuxiliaryInput {
    /// Its column.
    pub column: String,
    /// What it is.
    pub quantity: Quantity,
    /// Its unit (SI where that is known).
    pub unit: String,
    /// The sensor or group it sits at.
    pub near: Option<String>,
    /// Its values, gaps bridged.
    pub values: Series,
    /// Whether it varies by more than its quantisation.
    pub varies: bool,
    /// Whether the values are not its readings, but what changes smoothly in them.
    pub smoothed: bool,
}

impl AuxiliaryInput {
    /// The readings, and what changes smoothly in them where much of their changes from row to row is noise. Whether that is the quantity's
    /// or its meter's, only what depends on it can tell; of the meter's the dependence would show attenuated.
    fn of(series: &AuxiliarySeries, time_s: &Series) -> impl Iterator<Item = Self> + use<> {
        let AuxiliarySeries { auxiliary, values: readings, .. } = series;
        let one = |values: Series, varies: bool, smoothed: bool| Self {
            column: auxiliary.column.clone(),
            quantity: auxiliary.quantity,
            unit: auxiliary.unit.clone(),
            near: auxiliary.near.clone(),
            values,
            varies,
            smoothed,
        };
        let read = bridged(time_s, readings).map(|values| {
            let varies = series::varies(&values) && beyond_steps(&values, readings);
            one(values, varies, false)
        });
        let changes = |values: &[f64]| values.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>();
        let smoothed = read.as_ref().filter(|read| read.varies).and_then(|read| {
            let (smoothed, step, _) = thermometer::smoothed(time_s, readings)?;
            let is_other = changes(&smoothed.value) < NOISY * changes(&read.values);
            let moves = thermometer::moves(&smoothed.value, &smoothed.value_variance, step);
            (is_other && moves).then(|| one(smoothed.value.into(), true, true))
        });
        read.into_iter().chain(smoothed)
    }
}

/// A difference of two temperatures.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// The thermometers, second less first.
    pub columns: [String; 2],
    /// Distance between them, m, where it is known.
    pub distance_m: Option<f64>,
    /// Difference over distance, K/m; difference, K, where the distance is not known.
    pub values: Series,
}

/// A quantity that a white level may go with.
#[derive(Clone, Debug)]
pub struct Loudness {
    /// Name.
    pub name: &'static str,
    /// Unit of the values.
    pub unit: &'static str,
    /// One value a row.
    pub values: Series,
    /// The rows, that with the largest value first.
    pub descending: Arc<[usize]>,
}

impl Loudness {
    fn new(name: &'static str, unit: &'static str, values: Series) -> Self {
        let mut rows: Vec<usize> = (0..values.len()).collect();
        rows.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
        Self { name, unit, values, descending: rows.into() }
    }
}

/// A named series on which the residual may depend.
#[derive(Clone, Debug)]
pub struct Condition<'a> {
    /// Name.
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// One value a row.
    pub values: &'a [f64],
    /// Whether it is of the body's motion.
    pub of_motion: bool,
}

/// Rows from which on a recorded supply is off, to that in which it is on again; none of one that is off more often than runs are counted.
fn times_off(recording: &Recording) -> Vec<Range<usize>> {
    let of_supply = |series: &AuxiliarySeries| -> Vec<Range<usize>> {
        let mut present: Vec<f64> = series.values.iter().copied().filter(|value| value.is_finite()).collect();
        let on = OFF * median(&mut present);
        // A voltage of both signs is a signal's.
        if present.iter().any(|&value| value <= -on) {
            return Vec::new();
        }
        let mut off = None;
        let ends = |(row, &value): (usize, &f64)| {
            if value < on {
                off.get_or_insert(row);
                None
            } else if value.is_finite() {
                off.take().map(|from| from..row)
            } else {
                None
            }
        };
        let off: Vec<Range<usize>> = series.values.iter().enumerate().filter_map(ends).collect();
        if off.len() > MOST_RESTARTS { Vec::new() } else { off }
    };
    let supplies = recording.auxiliaries.iter().filter(|it| it.auxiliary.quantity == Quantity::Voltage);
    supplies.flat_map(of_supply).collect()
}

/// First rows of the runs from switch-on to switch-off, and of those that there may be: as the case states, or guessed from supplies
/// that are off and from gaps.
fn run_starts(recording: &Recording) -> (Vec<usize>, Vec<usize>) {
    if let Some(stated_s) = &recording.case.recording.switched_on_s {
        let row_of = |stated_s: &f64| recording.time_s.partition_point(|time_s| time_s < stated_s);
        let rows = || stated_s.iter().map(row_of).filter(|&row| row < recording.len());
        return (in_order(rows()), in_order(rows()));
    }
    let off = times_off(recording);
    let length_s = |gap: &Gap| gap.before_s - gap.after_s;
    let end = |gap: &Gap| gap.first + gap.missing;
    let long = |gap: &&Gap| gap.missing >= RESTART_STEPS && length_s(gap) > RESTART_S;
    let after_long_gaps = recording.gaps.iter().filter(long).map(end);
    let short = |gap: &&Gap| gap.missing >= SHORT_RESTART_STEPS && length_s(gap) > SHORT_RESTART_S;
    let mut gaps: Vec<&Gap> = recording.gaps.iter().filter(short).collect();
    gaps.sort_by_key(|gap| std::cmp::Reverse(gap.missing));
    let longest = gaps.into_iter().take(MOST_RESTARTS).map(end);
    let starts = in_order(after_long_gaps.chain(off.iter().map(|off| off.end)));
    (starts, in_order(longest.chain(off.iter().map(|off| off.start))))
}

/// Starts of runs, of which the record's is the first, each once.
fn in_order(starts: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut starts: Vec<usize> = std::iter::once(0).chain(starts).collect();
    starts.sort_unstable();
    starts.dedup();
    starts
}

impl<'r> Inputs<'r> {
    /// Everything that the recording gives.
    pub fn new(recording: &'r Recording) -> Self {
        let time_s: Series = recording.elapsed_s().collect();
        let motion = BodyMotion::new(recording, &time_s);
        let places = place::places(recording, &motion, &time_s);
        let thermometers = (recording.auxiliaries.par_iter())
            .filter(|series| series.auxiliary.quantity == Quantity::Temperature)
            .filter_map(|series| {
                let auxiliary = &series.auxiliary;
                let near = auxiliary.near.as_deref();
                Thermometer::new(&auxiliary.column, near, auxiliary.position_m, &time_s, &series.values)
            })
            .collect();
        let auxiliaries = (recording.auxiliaries.par_iter())
            .filter(|series| series.auxiliary.quantity != Quantity::Temperature)
            .flat_map_iter(|series| AuxiliaryInput::of(series, &time_s))
            .collect();
        let (run_starts, possible_run_starts) = run_starts(recording);
        Self {
            recording,
            time_s,
            motion,
            places,
            thermometers,
            auxiliaries,
            run_starts,
            possible_run_starts,
            differences: Arc::default(),
            loudness: OnceLock::new(),
        }
    }

    /// Length of the record, s.
    pub fn duration_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or_default()
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.time_s.len()
    }

    /// Time since the last switch-on, s, in every row.
    pub fn since_switch_on_s(&self) -> Vec<f64> {
        let mut starts = self.run_starts.iter().copied().peekable();
        let mut start_s = 0.0;
        (self.time_s.iter().enumerate())
            .map(|(row, &time)| {
                while starts.next_if(|&start| start <= row).is_some() {
                    start_s = time;
                }
                time - start_s
            })
            .collect()
    }

    /// Specific force along a direction, m/s².
    pub fn force_along(&self, direction: &Vector3<f64>) -> Option<Vec<f64>> {
        self.motion.force.as_ref().map(|force| along(direction, force))
    }

    /// Inertial rate along a direction, rad/s.
    pub fn rate_along(&self, direction: &Vector3<f64>) -> Option<Vec<f64>> {
        self.motion.rate.as_ref().map(|rate| along(direction, rate))
    }

    /// Angular acceleration along a direction, rad/s².
    pub fn angular_acceleration_along(&self, direction: &Vector3<f64>) -> Option<Vec<f64>> {
        self.motion.angular_acceleration.as_ref().map(|rate| along(direction, rate))
    }

    /// What a sensor of the place's kind would measure along another direction, SI.
    pub fn input_along(&self, place: &Place, direction: &Vector3<f64>) -> Option<Vec<f64>> {
        place::vectors_of(&self.motion, place.dimension()).map(|vectors| along(direction, vectors))
    }

    /// The thermometers that tell the temperature of a place: those at it; else at its group; else at another sensor
    /// of its group; else those that sit nowhere in particular; else all but those at the electronics; else those
    /// that only their name lets guess to be at the electronics.
    pub fn thermometers_at(&self, place: &Place) -> Vec<&Thermometer> {
        let id = &self.recording.sensors[place.sensor].sensor.id;
        let mates: Vec<&str> = (self.recording.sensors.iter())
            .filter(|series| place.group.is_some() && series.sensor.group == place.group)
            .map(|series| series.sensor.id.as_str())
            .collect();
        let nominal = self.nominal_temperature(place).map(|(column, _)| column);
        let near = |thermometer: &Thermometer, names: &[&str]| {
            thermometer.near.as_deref().is_some_and(|near| names.contains(&near))
        };
        // Where nothing else tells the temperature, a guess from a name does not leave the place without one.
        let guessed = |it: &Thermometer| it.near.is_none() && at_electronics(it);
        let ranks: [&dyn Fn(&Thermometer) -> bool; 7] = [
            &|thermometer| near(thermometer, &[place.name.as_str()]) || nominal == Some(&*thermometer.column),
            &|thermometer| near(thermometer, &[id]),
            &|thermometer| near(thermometer, &[place.group.as_deref().unwrap_or_default()]),
            &|thermometer| near(thermometer, &mates),
            &|thermometer| thermometer.near.is_none() && !at_electronics(thermometer),
            &|thermometer| !at_electronics(thermometer),
            &guessed,
        ];
        ranks
            .iter()
            .map(|rank| self.thermometers.iter().filter(|thermometer| rank(thermometer)).collect::<Vec<_>>())
            .find(|found| !found.is_empty())
            .unwrap_or_default()
    }

    /// What the sensor of a place reads, as its input by what the user believes of it; NaN where it is missing.
    pub fn readings_of(&self, place: &Place) -> Vec<f64> {
        nominal::of_input(self.recording, &[], place.sensor)
    }

    /// The thermometers at the electronics of a place, by their name.
    pub fn electronics_at(&self, place: &Place) -> Vec<&Thermometer> {
        let own: Vec<&str> = self.thermometers_at(place).iter().map(|own| own.column.as_str()).collect();
        (self.thermometers.iter())
            .filter(|thermometer| at_electronics(thermometer) && !own.contains(&thermometer.column.as_str()))
            .collect()
    }

    /// The thermometers that are neither at the place, nor at the electronics, nor at another sensor.
    pub fn other_thermometers(&self, place: &Place) -> Vec<&Thermometer> {
        let own: Vec<&str> = self.thermometers_at(place).iter().map(|own| own.column.as_str()).collect();
        (self.thermometers.iter())
            .filter(|thermometer| {
                let at_sensor = (self.recording.sensors.iter())
                    .any(|series| thermometer.near.as_deref() == Some(series.sensor.id.as_str()));
                !own.contains(&thermometer.column.as_str()) && !at_sensor && !at_electronics(thermometer)
            })
            .collect()
    }

    /// Differences of two thermometers near a place: its own against each other and against all others but those at the
    /// electronics, the others of its group first, then the nearest. Always the one that the case names later less the one that it names
    /// earlier, so that a gradient has one sign for all sensors.
    pub fn gradients_at(&self, place: &Place) -> Vec<Gradient> {
        let own = self.thermometers_at(place);
        let mates: Vec<Option<&str>> = (self.recording.sensors.iter())
            .filter(|series| place.group.is_some() && series.sensor.group == place.group)
            .map(|series| Some(series.sensor.id.as_str()))
            .chain([None])
            .chain(place.group.as_deref().map(Some))
            .collect();
        let distance = |thermometer: &Thermometer| -> f64 {
            let to = |own: &&Thermometer| {
                let (a, b) = own.position_m.zip(thermometer.position_m)?;
                Some((Vector3::from(b) - Vector3::from(a)).norm())
            };
            own.iter().filter_map(to).fold(f64::INFINITY, f64::min)
        };
        let mut others: Vec<(bool, f64, &Thermometer)> = (self.thermometers.iter())
            .filter(|it| !at_electronics(it) && own.iter().all(|own| own.column != it.column))
            .map(|it| (!mates.contains(&it.near.as_deref()), distance(it), it))
            .collect();
        others.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut near: Vec<&Thermometer> = own.clone();
        near.extend(others.into_iter().map(|(_, _, thermometer)| thermometer));
        let named = |thermometer: &Thermometer| {
            self.thermometers.iter().position(|it| it.column == thermometer.column)
        };
        let mut gradients = Vec::new();
        for (index, one) in near.iter().enumerate().take(own.len()) {
            for other in near.iter().skip(index + 1) {
                let (first, second) = if named(one) < named(other) { (one, other) } else { (other, one) };
                let distance_m = (first.position_m.zip(second.position_m))
                    .map(|(a, b)| (Vector3::from(b) - Vector3::from(a)).norm())
                    .filter(|&distance| distance > 0.0);
                let over = distance_m.unwrap_or(1.0);
                let (difference, variance) = self.difference(first, second);
                let steps = first.quantisation.max(second.quantisation);
                if range(&difference) > steps && series::deviation(&difference) > variance.sqrt() {
                    let columns = [first.column.clone(), second.column.clone()];
                    let values = map(&difference, |difference| difference / over).into();
                    gradients.push(Gradient { columns, distance_m, values });
                }
            }
        }
        gradients.truncate(MOST_GRADIENTS);
        gradients
    }

    /// The difference of two temperatures, K, and its mean variance, K².
    fn difference(&self, first: &Thermometer, second: &Thermometer) -> (Series, f64) {
        let known = || self.differences.lock().unwrap_or_else(PoisonError::into_inner);
        let columns = [&first.column, &second.column];
        if let Some((_, found)) = known().iter().find(|(of, _)| of.each_ref() == columns) {
            return found.clone();
        }
        let readings = |it: &Thermometer| self.recording.auxiliary(&it.column).map(|series| &series.values);
        let readings = match (readings(first), readings(second)) {
            (Some(first), Some(second)) => first.iter().zip(second).map(|(a, b)| b - a).collect(),
            _ => Vec::new(),
        };
        let found = Thermometer::difference(first, second, &self.time_s, &readings);
        known().push((columns.map(Clone::clone), found.clone()));
        found
    }

    /// The reference temperature of a place, °C, and whether the nominal model gives it; without it the mean.
    pub fn reference(&self, place: &Place, thermometer: &Thermometer) -> (f64, bool) {
        match self.nominal_temperature(place) {
            Some((_, reference)) => (reference, true),
            None => (mean(&thermometer.temperature), false),
        }
    }

    fn nominal_temperature(&self, place: &Place) -> Option<(&'r str, f64)> {
        let nominal = &self.recording.sensors[place.sensor].sensor.nominal;
        let dependence = nominal.temperature_bias.as_ref().filter(|_| place.port == Port::Output)?;
        Some((dependence.column.as_str(), dependence.reference_deg_c))
    }

    /// Whether the motion is that of a Schuler loop.
    pub fn is_loop(&self) -> bool {
        self.recording.case.motion.kind == MotionKind::VelocityError
    }

    /// What the white level of a sensor may go with: how fast the body turns, how fast it goes, and what shakes it.
    pub fn loudness(&self) -> &Arc<[Loudness]> {
        self.loudness.get_or_init(|| self.of_motion())
    }

    fn of_motion(&self) -> Arc<[Loudness]> {
        let motion = &self.motion;
        let norm = |vectors: &Vectors, of: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let [x, y, z] = vectors;
            let rows = x.iter().zip(&**y).zip(&**z);
            rows.map(|((x, y), z)| of((x * x + y * y + z * z).sqrt())).collect()
        };
        let weight = motion::gravity(self.recording);
        let of_body = [
            ("turn rate", "rad/s", motion.rate.as_ref().map(|rate| norm(rate, &|it| it))),
            (
                "angular acceleration",
                "rad/s^2",
                motion.angular_acceleration.as_ref().map(|it| norm(it, &|it| it)),
            ),
            ("speed", "m/s", motion.velocity.as_ref().map(|velocity| norm(velocity, &|it| it))),
            (
                "change of the specific force",
                "m/s^2",
                motion.force.as_ref().map(|f| norm(f, &|it| (it - weight).abs())),
            ),
        ];
        let of_body = of_body.into_iter().filter(|_| !motion.estimated);
        of_body
            .filter_map(|(name, unit, values)| Some(Loudness::new(name, unit, values?.into())))
            .filter(|loudness| series::varies(&loudness.values))
            .collect()
    }

    /// Every series on which a residual may be tested for dependence.
    pub fn conditions<'s>(&'s self) -> Vec<Condition<'s>> {
        let mut conditions: Vec<Condition<'s>> = Vec::new();
        let mut add = |name: String, unit: &str, values: &'s [f64], of_motion: bool| {
            if series::varies(values) {
                conditions.push(Condition { name, unit: unit.to_owned(), values, of_motion });
            }
        };
        for thermometer in self.thermometers.iter().filter(|thermometer| thermometer.varies()) {
            let name = named("temperature", &thermometer.column);
            add(name.clone(), "degC", &thermometer.temperature, false);
            if thermometer.rate_varies() {
                add(format!("rate of {name}"), "K/s", &thermometer.rate, false);
            }
        }
        for auxiliary in self.auxiliaries.iter().filter(|it| it.varies && !it.smoothed) {
            let name = named(&auxiliary.quantity.to_string(), &auxiliary.column);
            add(name, &auxiliary.unit, &auxiliary.values, false);
        }
        let motion = &self.motion;
        let of_body = [
            ("rate", "rad/s", &motion.rate),
            ("specific force", "m/s^2", &motion.force),
            ("velocity", "m/s", &motion.velocity),
        ];
        for (name, unit, vectors) in of_body {
            for (axis, values) in ["x", "y", "z"].iter().zip(vectors.iter().flatten()) {
                add(format!("{name} {axis}"), unit, values, true);
            }
        }
        for (name, values) in ["roll", "pitch", "heading"].iter().zip(motion.attitude.iter().flatten()) {
            add((*name).to_owned(), "rad", values, true);
        }
        conditions
    }
}

/// A quantity in a column, which mostly says by its name what it holds.
fn named(quantity: &str, column: &str) -> String {
    if quantity == "other" || column.contains(quantity) {
        column.to_owned()
    } else {
        format!("{quantity} {column}")
    }
}

/// Whether a quantity moves by more than its reading flickers: over several of its steps, or by being switched.
fn beyond_steps(values: &[f64], readings: &[f64]) -> bool {
    let step = thermometer::step_of(readings);
    let changes = values.windows(2).filter(|pair| pair[0] != pair[1]).count();
    range(values) >= (AUXILIARY_STEPS - 1e-6) * step || (changes as f64) < SWITCHED * values.len() as f64
}

/// Whether a thermometer is at the electronics, as the case states or, where it states nothing, its name lets guess.
fn at_electronics(thermometer: &Thermometer) -> bool {
    case::at_electronics(&thermometer.column, thermometer.near.as_deref())
}
