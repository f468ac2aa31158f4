//! From a case to what the flight module is told: one channel for each run of the module.
//!
//! | in the case | channels |
//! | --- | --- |
//! | `motion.kind = "velocity_error"` | one, from the sensor of kind `ins_velocity` |
//! | recorded `velocity_ned` and `attitude_rad` beside three or more `doppler` (or else `gnss_velocity`) sensors | north and east: the inertial velocity minus the radio's, turned into north-east-down by the recorded attitude; the health monitor listens to both |
//! | otherwise, a sensor of kind `ins_velocity` and a `doppler` or `gnss_velocity` along the same axis | one for each such pair: their difference, and the health monitor on both |
//! | exactly five gyros, or one group of exactly five | isolation in the first channel, or alone where there is no velocity |
//! | other gyros, and accelerometers, by the body axis that is nearest | inputs of the compensation in the first channel |
//! | the first four recorded temperatures, those `near` a sensor before others | temperature and its rate in the first channel, or alone |
//!
//! What a case does not say has these defaults: noise of accelerometer and gyro as [`ModuleConfig::default`]
//! (10⁻⁴ g over 60 s, 0.1 °/h over 1800 s); noise of the velocity 0.1 m/s; velocity error at the start ten times the
//! velocity noise, at least 0.1 m/s; tilt at the start 10⁻⁴ rad; noise of a gyro 0.02 °/h; range of a gyro 10 rad/s;
//! relative error of a gyro 10⁻⁵, micromechanical 10⁻²; quantum of a thermometer, the median distance of its values; correlated
//! error of a radio velocity, that of its white noise over 10 s, degraded and jumping threefold. Where a gyro is `relative`, the constant parity of the block is
//! measured over the first tenth of the recording, at most 3600 steps, in which no fault is detected; otherwise the
//! nominal biases are taken for exact.
//! A missing reading, and a step that the recording lacks, is a reading of quality missing; a quantised reading has the
//! variance of its step added to its white noise.
use std::collections::BTreeSet;

use schuler_core::filter::{FilterConfig, MarkovNoise};
use schuler_core::isolation::IsolationConfig;
use schuler_core::module::{GYROS, ModuleConfig, StepInput};
use schuler_link::block::BlockBytes;
use schuler_recording::case::{Markov, SensorKind};
use schuler_recording::recording::{SensorSeries, Stream};
use schuler_recording::{CaseFile, Error, Problem, Recording};

use super::sensors::{Instruments, Levels, Place, is_gyro, reading, single};
use super::velocities::{DEFAULT_VELOCITY_NOISE, Velocity, velocities};
use crate::physics::earth;

/// Velocity error at the start in units of the velocity noise.
const INITIAL_VELOCITY: f64 = 10.0;
/// Least velocity error at the start, m/s.
const LEAST_INITIAL_VELOCITY: f64 = 0.1;
/// Gyro noise per reading where the case gives none: 0.02 °/h, rad/s.
const DEFAULT_GYRO_NOISE: f64 = 0.02 * std::f64::consts::PI / 180.0 / 3600.0;
/// Range of a gyro, of which cases do not speak, rad/s.
const GYRO_RANGE: f64 = 10.0;
/// Error of a gyro relative to the rate, of which cases do not speak: scale and alignment after calibration.
const FINE_RELATIVE_ERROR: f64 = 1e-5;
/// The same for micromechanical gyros.
const COARSE_RELATIVE_ERROR: f64 = 1e-2;
/// Above this many standard deviations of leaked rate the cumulative sums are suspended.
const LEAK: f64 = 0.045;
/// Longest time over which the constant parity is measured at the start, samples; a tenth of a shorter recording. A
/// constant that is off by more than a few hundredths of σ makes the slow sums raise false alarms.
const LONGEST_CALIBRATION: usize = 3600;
/// A measured constant above this many standard deviations is a fault.
const OFFSET_LIMIT: f64 = 20.0;

/// One run of the flight module over a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// What it is: the id of the sensor, `north`, `east` or `gyros`.
    pub name: String,
    /// What the module is told before the flight.
    pub config: ModuleConfig,
    /// Whether there is a velocity.
    pub has_velocity: bool,
    /// Ids of the five gyros, if there are.
    pub gyros: Option<[String; GYROS]>,
    /// Ids of the inertial sensors at the module's inputs.
    pub sensors: Vec<(String, Place)>,
    /// Columns of the thermometers.
    pub thermometers: Vec<String>,
    /// Whether there are a radio and an inertial velocity.
    pub has_health: bool,
    /// What the module corrects by.
    pub compensation: Option<BlockBytes>,
    /// Which of the recording's velocities it is.
    velocity: usize,
    instruments: Instruments,
    /// Time of the recording's first row, s.
    start_s: f64,
}

/// One step of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Its time in the recording, s.
    pub time_s: f64,
    /// What the module is told.
    pub input: StepInput,
}

impl Channel {
    /// The steps of a recording's rows, all of them or some.
    ///
    /// # Errors
    /// As [`plan`], if the recording is another one than was planned.
    pub fn steps(&self, recording: &Recording) -> Result<Vec<Step>, Problem> {
        let velocity = velocities(recording)?.into_iter().nth(self.velocity);
        let read = |values: &[f64], row: usize| single(reading(Some(values), row));
        let step = |(row, &time_s): (usize, &f64)| {
            let time_ms = ((time_s - self.start_s + recording.step_s) * 1000.0).round() as u64;
            let mut input = StepInput::without_readings(time_ms);
            if let Some(velocity) = &velocity {
                input.velocity_error = read(&velocity.values, row);
                if let Some(pair) = &velocity.pair {
                    input.radio_velocity = read(&pair.radio, row);
                    input.inertial_velocity = read(&pair.inertial, row);
                }
            }
            self.instruments.read(recording, row, &mut input);
            Step { time_s, input }
        };
        Ok(recording.time_s.iter().enumerate().map(step).collect())
    }

    /// The steps of a recording of any length.
    ///
    /// # Errors
    /// A table that cannot be read any more, and so for each step.
    pub fn stream<'s>(
        &'s self,
        recording: &'s Stream,
    ) -> Result<impl Iterator<Item = Result<Step, Error>> + 's, Error> {
        let path = &recording.file().path;
        Ok(recording.chunks()?.flat_map(move |chunk| {
            let steps = chunk.and_then(|it| self.steps(&it).map_err(|problem| Error::one(path, problem)));
            match steps {
                Ok(steps) => steps.into_iter().map(Ok).collect(),
                Err(error) => vec![Err(error)],
            }
        }))
    }
}

/// The channels of a recording.
///
/// # Errors
/// What the case would have to give; the field is that of the case.
pub fn plan(recording: &Recording) -> Result<Vec<Channel>, Problem> {
    let mut levels = Vec::new();
    Levels::add(&mut levels, recording);
    let start_s = recording.time_s.first().copied().unwrap_or_default();
    channels(recording, start_s, recording.len(), &levels)
}

/// The channels of a recording of any length, which is gone through for that; `watch` is told the number of rows so far.
///
/// # Errors
/// As [`plan`]; what is wrong with the table; an error of `watch`.
pub fn plan_stream<E: From<Error>>(
    file: CaseFile,
    mut watch: impl FnMut(usize) -> Result<(), E>,
) -> Result<(Stream, Vec<Channel>), E> {
    let (mut levels, mut rows) = (Vec::new(), 0);
    let stream = Stream::open(file, |chunk| {
        Levels::add(&mut levels, chunk);
        rows += chunk.len();
        watch(rows)
    })?;
    let planned =
        channels(stream.head(), stream.start_s(), stream.rows(), &levels).map_err(|mut problem| {
            problem.line = problem.line.or_else(|| stream.file().lines.get(&problem.field));
            Error::one(&stream.file().path, problem)
        })?;
    Ok((stream, planned))
}

/// The channels of a recording of so many rows, given without them.
fn channels(
    recording: &Recording,
    start_s: f64,
    rows: usize,
    levels: &[Levels],
) -> Result<Vec<Channel>, Problem> {
    let gyros = block(recording);
    let instruments = Instruments::of(recording, gyros.as_ref(), levels);
    let velocities = velocities(recording)?;
    let has_velocity = !velocities.is_empty();
    let thermometers = instruments.thermometer_columns(recording);
    if !has_velocity && gyros.is_none() && thermometers.is_empty() {
        let kind = recording.case.motion.kind;
        let found = format!(
            "found \"{kind}\" without a velocity difference, without five gyros and without a thermometer"
        );
        let expected = "expected velocity_error; or recorded velocity_ned and attitude_rad beside doppler sensors; \
            or an ins_velocity beside a doppler or gnss_velocity; or five gyros; or an aux of quantity temperature";
        return Err(Problem::new(None, "motion.kind", format!("{found}; {expected}")));
    }

    let name = if gyros.is_some() { "gyros" } else { "thermometers" };
    let alone =
        Velocity { name: name.to_owned(), values: Vec::new(), noise: DEFAULT_VELOCITY_NOISE, pair: None };
    let runs = if has_velocity { velocities } else { vec![alone] };
    let channels = runs.into_iter().enumerate().map(|(index, velocity)| {
        let gyros = gyros.filter(|_| index == 0).map(|five| five.map(|it| &recording.sensors[it]));
        let instruments = if index == 0 { instruments.clone() } else { Instruments::default() };
        let mut config = config(recording, velocity.noise, gyros.as_ref(), rows);
        config.thermometers = instruments.thermometer_configs(levels);
        config.health = velocity.pair.as_ref().map(|it| it.config(recording.step_s, config.max_age_ms));
        Channel {
            config,
            has_health: velocity.pair.is_some(),
            name: velocity.name,
            has_velocity,
            gyros: gyros.map(|five| five.map(|series| series.sensor.id.clone())),
            sensors: instruments.corrected(recording),
            thermometers: instruments.thermometer_columns(recording),
            compensation: None,
            velocity: index,
            instruments,
            start_s,
        }
    });
    Ok(channels.collect())
}

/// The five gyros, by their index: all that there are, or those of the one group that has exactly five.
fn block(recording: &Recording) -> Option<[usize; GYROS]> {
    let gyros: Vec<(usize, Option<&String>)> = (recording.sensors.iter().enumerate())
        .filter(|(_, series)| is_gyro(series.sensor.kind) && series.sensor.axis.is_some())
        .map(|(index, series)| (index, series.sensor.group.as_ref()))
        .collect();
    let of_group = |group: &String| -> Vec<usize> {
        gyros.iter().filter(|(_, of)| *of == Some(group)).map(|(index, _)| *index).collect()
    };
    let groups: BTreeSet<&String> = gyros.iter().filter_map(|(_, group)| *group).collect();
    let mut fives = groups.into_iter().filter_map(|group| of_group(group).try_into().ok());
    match (fives.next(), fives.next()) {
        (Some(five), None) => Some(five),
        _ => gyros.iter().map(|(index, _)| *index).collect::<Vec<_>>().try_into().ok(),
    }
}

fn config(
    recording: &Recording,
    velocity_noise: f64,
    gyros: Option<&[&SensorSeries; GYROS]>,
    rows: usize,
) -> ModuleConfig {
    let default = ModuleConfig::default();
    let nominal = recording.case.schuler_loop;
    let gravity = nominal.map(|it| it.gravity).or_else(|| {
        recording.case.site.map(|site| earth::gravity(site.latitude_deg.to_radians(), site.altitude_m))
    });
    let markov = |given: Option<Markov>, default: MarkovNoise<f32>| {
        given.map_or(default, |it| MarkovNoise { sigma: it.sigma as f32, tau_s: it.tau_s as f32 })
    };
    let mut config = ModuleConfig {
        filter: FilterConfig {
            radius_m: nominal.map_or(earth::MEAN_RADIUS, |it| it.radius_m) as f32,
            gravity: gravity.map_or(default.filter.gravity, |g| g as f32),
            step_s: recording.step_s as f32,
            accelerometer: markov(nominal.and_then(|it| it.accelerometer), default.filter.accelerometer),
            gyro: markov(nominal.and_then(|it| it.gyro), default.filter.gyro),
            velocity_noise: velocity_noise as f32,
            initial_velocity_sigma: (INITIAL_VELOCITY * velocity_noise).max(LEAST_INITIAL_VELOCITY) as f32,
            ..default.filter
        },
        max_age_ms: (1500.0 * recording.step_s).round() as u32,
        ..default
    };
    if let Some(five) = gyros {
        config.isolation = isolation(five, rows);
    }
    config
}

fn isolation(five: &[&SensorSeries; GYROS], rows: usize) -> IsolationConfig {
    let sigma = five.map(|series| {
        let nominal = &series.sensor.nominal;
        let white = if nominal.white > 0.0 { nominal.white } else { DEFAULT_GYRO_NOISE };
        white.hypot(series.sensor.quantisation / 12f64.sqrt())
    });
    let coarse = five.iter().any(|series| series.sensor.kind == SensorKind::MemsGyro);
    let relative_error = if coarse { COARSE_RELATIVE_ERROR } else { FINE_RELATIVE_ERROR };
    let precision = sigma.iter().map(|s| 1.0 / (s * s)).sum::<f64>().sqrt();
    IsolationConfig {
        axes: five.map(|series| series.sensor.axis.unwrap_or_default()),
        sigma,
        range: GYRO_RANGE,
        offset: five.map(|series| series.sensor.nominal.bias),
        calibration_samples: if five.iter().any(|series| series.sensor.relative) {
            (rows / 10).min(LONGEST_CALIBRATION) as u32
        } else {
            0
        },
        offset_limit: OFFSET_LIMIT * sigma.iter().copied().fold(0.0, f64::max),
        relative_error,
        rate_limit: LEAK / (relative_error * precision),
        ..IsolationConfig::CONE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn recording(case: &str, table: &str) -> Recording {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("r.csv"), table).unwrap();
        let path = directory.path().join("case.toml");
        std::fs::write(&path, case).unwrap();
        Recording::of_case(CaseFile::read(Path::new(&path)).unwrap()).unwrap()
    }

    const DOPPLER: &str = r#"
format = "schuler-case/1"
[recording]
path = "r.csv"
time = "t"
step_s = 1.0
[site]
latitude_deg = 30.0
[motion]
kind = "recorded"
velocity_ned = ["vn", "ve", "vd"]
attitude_rad = ["roll", "pitch", "yaw"]
"#;

    fn doppler(id: &str, axis: &str) -> String {
        format!(
            "[[sensor]]\nid = \"{id}\"\nkind = \"doppler\"\ncolumn = \"{id}\"\nunit = \"m/s\"\naxis = {axis}\n[sensor.nominal]\nwhite = 0.02\n"
        )
    }

    #[test]
    fn doppler_beams_are_turned_into_north_and_east() {
        // Heading east: forward is east, starboard is south.
        let case = [
            DOPPLER.to_owned(),
            doppler("x", "[1.0, 0.0, 0.0]"),
            doppler("y", "[0.0, 1.0, 0.0]"),
            doppler("z", "[0.0, 0.0, 1.0]"),
        ]
        .concat();
        let table = "t,vn,ve,vd,roll,pitch,yaw,x,y,z\n0,0.5,2.5,0,0,0,1.5707963267948966,2,-0.25,0\n\
                     1,0.5,2.5,0,0,0,1.5707963267948966,,-0.25,0\n2,0.5,2.5,0,0,0,1.5707963267948966,2,-0.25,0\n";
        let recording = recording(&case, table);
        let channels = plan(&recording).unwrap();
        assert_eq!(channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["north", "east"]);
        let steps: Vec<Vec<Step>> = channels.iter().map(|c| c.steps(&recording).unwrap()).collect();
        let first: Vec<f32> = steps.iter().map(|steps| steps[0].input.velocity_error.value).collect();
        assert!((first[0] - 0.25).abs() < 1e-6 && (first[1] - 0.5).abs() < 1e-6, "{first:?}");
        // A missing beam is a missing velocity.
        assert_eq!(steps[0][1].input.velocity_error.quality, schuler_core::reading::Quality::Missing);
        assert_eq!(steps[0].iter().map(|s| s.input.time_ms).collect::<Vec<_>>(), [1000, 2000, 3000]);
        let filter = &channels[0].config.filter;
        assert!((filter.gravity - 9.7932).abs() < 1e-3 && (filter.velocity_noise - 0.02).abs() < 1e-6);
    }

    #[test]
    fn beams_in_one_plane_are_refused() {
        let case = [
            DOPPLER.to_owned(),
            doppler("x", "[1.0, 0.0, 0.0]"),
            doppler("y", "[0.0, 1.0, 0.0]"),
            doppler("z", "[0.6, 0.8, 0.0]"),
        ]
        .concat();
        let table = "t,vn,ve,vd,roll,pitch,yaw,x,y,z\n0,0,0,0,0,0,0,0,0,0\n1,0,0,0,0,0,0,0,0,0\n";
        assert!(plan(&recording(&case, table)).unwrap_err().message.contains("do not span space"));
    }

    #[test]
    fn a_case_without_anything_to_fly_says_so() {
        let case = DOPPLER.replace(
            "kind = \"recorded\"\nvelocity_ned = [\"vn\", \"ve\", \"vd\"]\nattitude_rad = [\"roll\", \"pitch\", \"yaw\"]",
            "kind = \"unknown\"",
        ) + &doppler("x", "[1.0, 0.0, 0.0]");
        let problem = plan(&recording(&case, "t,x\n0,1\n1,2\n")).unwrap_err();
        assert_eq!(problem.field, "motion.kind");
    }
}
