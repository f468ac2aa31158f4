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
use schuler_core::reading::Reading;
use schuler_link::block::BlockBytes;
use schuler_recording::case::{Markov, SensorKind};
use schuler_recording::recording::SensorSeries;
use schuler_recording::{Problem, Recording};

use super::sensors::{Instruments, Place, reading};
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

/// One run of the flight module.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// What it is: the id of the sensor, `north`, `east` or `gyros`.
    pub name: String,
    /// What the module is told before the flight.
    pub config: ModuleConfig,
    /// Time of each step in the recording, s.
    pub time_s: Vec<f64>,
    /// What the module is told each step.
    pub inputs: Vec<StepInput>,
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
}

/// The channels of a recording.
///
/// # Errors
/// What the case would have to give; the field is that of the case.
pub fn plan(recording: &Recording) -> Result<Vec<Channel>, Problem> {
    let gyros = block(recording);
    let instruments = Instruments::of(recording, gyros.as_ref());
    let velocities = velocities(recording)?;
    let has_velocity = !velocities.is_empty();
    let thermometers = instruments.thermometer_columns();
    if !has_velocity && gyros.is_none() && thermometers.is_empty() {
        let kind = recording.case.motion.kind;
        let found = format!(
            "found \"{kind}\" without a velocity difference, without five gyros and without a thermometer"
        );
        let expected = "expected velocity_error; or recorded velocity_ned and attitude_rad beside doppler sensors; \
            or an ins_velocity beside a doppler or gnss_velocity; or five gyros; or an aux of quantity temperature";
        return Err(Problem::new(None, "motion.kind", format!("{found}; {expected}")));
    }
    let start_s = recording.time_s.first().copied().unwrap_or_default();
    let time_ms: Vec<u64> =
        recording.time_s.iter().map(|t| ((t - start_s + recording.step_s) * 1000.0).round() as u64).collect();

    let name = if gyros.is_some() { "gyros" } else { "thermometers" };
    let alone =
        Velocity { name: name.to_owned(), values: Vec::new(), noise: DEFAULT_VELOCITY_NOISE, pair: None };
    let runs = if has_velocity { velocities } else { vec![alone] };
    let channels = runs.into_iter().enumerate().map(|(index, velocity)| {
        let gyros = gyros.as_ref().filter(|_| index == 0);
        let instruments = if index == 0 { instruments.clone() } else { Instruments::default() };
        let inputs = (time_ms.iter().enumerate())
            .map(|(row, &time_ms)| {
                let mut input = StepInput::without_readings(time_ms);
                let read = |values: &[f64]| {
                    let reading = reading(Some(values), row);
                    Reading { value: reading.value as f32, age_ms: reading.age_ms, quality: reading.quality }
                };
                input.velocity_error = read(&velocity.values);
                if let Some(pair) = &velocity.pair {
                    input.radio_velocity = read(&pair.radio);
                    input.inertial_velocity = read(&pair.inertial);
                }
                instruments.read(row, &mut input);
                input
            })
            .collect();
        let mut config = config(recording, velocity.noise, gyros);
        config.thermometers = instruments.thermometer_configs();
        config.health = velocity.pair.as_ref().map(|it| it.config(recording.step_s, config.max_age_ms));
        Channel {
            config,
            has_health: velocity.pair.is_some(),
            name: velocity.name,
            time_s: recording.time_s.clone(),
            inputs,
            has_velocity,
            gyros: gyros.map(|five| five.map(|series| series.sensor.id.clone())),
            sensors: instruments.corrected(),
            thermometers: instruments.thermometer_columns(),
            compensation: None,
        }
    });
    Ok(channels.collect())
}

/// The five gyros: all that there are, or those of the one group that has exactly five.
fn block(recording: &Recording) -> Option<[&SensorSeries; GYROS]> {
    use SensorKind::{Dtg, Fog, MemsGyro, Rlg};
    let gyros: Vec<&SensorSeries> = recording
        .sensors
        .iter()
        .filter(|series| matches!(series.sensor.kind, Dtg | Fog | Rlg | MemsGyro))
        .filter(|series| series.sensor.axis.is_some())
        .collect();
    let of_group = |group: Option<&String>| -> Vec<&SensorSeries> {
        gyros.iter().copied().filter(|series| series.sensor.group.as_ref() == group).collect()
    };
    let groups: BTreeSet<&String> = gyros.iter().filter_map(|series| series.sensor.group.as_ref()).collect();
    let mut fives = groups.into_iter().filter_map(|group| of_group(Some(group)).try_into().ok());
    match (fives.next(), fives.next()) {
        (Some(five), None) => Some(five),
        _ => gyros.try_into().ok(),
    }
}

fn config(
    recording: &Recording,
    velocity_noise: f64,
    gyros: Option<&[&SensorSeries; GYROS]>,
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
        config.isolation = isolation(recording, five);
    }
    config
}

fn isolation(recording: &Recording, five: &[&SensorSeries; GYROS]) -> IsolationConfig {
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
            (recording.len() / 10).min(LONGEST_CALIBRATION) as u32
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
    use schuler_recording::CaseFile;
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
        let channels = plan(&recording(&case, table)).unwrap();
        assert_eq!(channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["north", "east"]);
        let first: Vec<f32> = channels.iter().map(|c| c.inputs[0].velocity_error.value).collect();
        assert!((first[0] - 0.25).abs() < 1e-6 && (first[1] - 0.5).abs() < 1e-6, "{first:?}");
        // A missing beam is a missing velocity.
        assert_eq!(channels[0].inputs[1].velocity_error.quality, schuler_core::reading::Quality::Missing);
        assert_eq!(channels[0].inputs.iter().map(|i| i.time_ms).collect::<Vec<_>>(), [1000, 2000, 3000]);
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
