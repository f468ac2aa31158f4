//! From a case to what the flight module is told: one channel for each run of the module.
//!
//! | in the case | channels |
//! | --- | --- |
//! | `motion.kind = "velocity_error"` | one, from the sensor of kind `ins_velocity` |
//! | recorded `velocity_ned` and `attitude_rad` beside three or more `doppler` sensors | north and east: the inertial velocity minus the Doppler velocity, turned into north-east-down by the recorded attitude |
//! | exactly five gyros, or one group of exactly five | isolation in the first channel, or alone where there is no velocity |
//!
//! What a case does not say has these defaults: noise of accelerometer and gyro as [`ModuleConfig::default`]
//! (10⁻⁴ g over 60 s, 0.1 °/h over 1800 s); noise of the velocity 0.1 m/s; velocity error at the start ten times the
//! velocity noise, at least 0.1 m/s; tilt at the start 10⁻⁴ rad; noise of a gyro 0.02 °/h; range of a gyro 10 rad/s;
//! relative error of a gyro 10⁻⁵, micromechanical 10⁻². Where a gyro is `relative`, the constant parity of the block is
//! measured over the first tenth of the recording, at most 3600 steps, in which no fault is detected; otherwise the
//! nominal biases are taken for exact.
//! A missing reading, and a step that the recording lacks, is a reading of quality missing; a quantised reading has the
//! variance of its step added to its white noise.
use std::collections::BTreeSet;

use nalgebra::{Matrix3, Vector3};
use schuler_core::filter::{FilterConfig, MarkovNoise};
use schuler_core::isolation::IsolationConfig;
use schuler_core::module::{Command, GYROS, ModuleConfig, StepInput};
use schuler_core::reading::Reading;
use schuler_recording::case::{Markov, MotionKind, SensorKind};
use schuler_recording::motion::body_to_ned;
use schuler_recording::recording::SensorSeries;
use schuler_recording::{Problem, Recording};

use crate::physics::earth;

/// Velocity noise where the case gives none, m/s.
const DEFAULT_VELOCITY_NOISE: f64 = 0.1;
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
/// Doppler axes whose least singular value is below this do not span space.
const LEAST_SINGULAR_VALUE: f64 = 0.05;

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
}

/// A velocity error in one direction.
struct Velocity {
    name: String,
    values: Vec<f64>,
    noise: f64,
}

/// The channels of a recording.
///
/// # Errors
/// What the case would have to give; the field is that of the case.
pub fn plan(recording: &Recording) -> Result<Vec<Channel>, Problem> {
    let gyros = block(recording);
    let velocities = velocities(recording)?;
    if velocities.is_empty() && gyros.is_none() {
        let kind = recording.case.motion.kind;
        let found = format!("found \"{kind}\" without a velocity difference and without five gyros");
        let expected = "expected velocity_error; or recorded velocity_ned and attitude_rad beside doppler sensors; or five gyros";
        return Err(Problem::new(None, "motion.kind", format!("{found}; {expected}")));
    }
    let start_s = recording.time_s.first().copied().unwrap_or_default();
    let time_ms: Vec<u64> =
        recording.time_s.iter().map(|t| ((t - start_s + recording.step_s) * 1000.0).round() as u64).collect();

    let alone = Velocity { name: "gyros".to_owned(), values: Vec::new(), noise: DEFAULT_VELOCITY_NOISE };
    let has_velocity = !velocities.is_empty();
    let runs = if has_velocity { velocities } else { vec![alone] };
    let channels = runs.into_iter().enumerate().map(|(index, velocity)| {
        let gyros = gyros.as_ref().filter(|_| index == 0);
        let inputs = time_ms
            .iter()
            .enumerate()
            .map(|(row, &time_ms)| StepInput {
                time_ms,
                velocity_error: finite(&velocity.values, row)
                    .map_or_else(Reading::missing, |value| Reading::good(value as f32)),
                gyros: gyros.map_or([Reading::missing(); GYROS], |five| {
                    five.map(|series| {
                        finite(&series.values, row).map_or_else(Reading::missing, Reading::good)
                    })
                }),
                command: Command::None,
            })
            .collect();
        Channel {
            config: config(recording, velocity.noise, gyros),
            name: velocity.name,
            time_s: recording.time_s.clone(),
            inputs,
            has_velocity,
            gyros: gyros.map(|five| five.map(|series| series.sensor.id.clone())),
        }
    });
    Ok(channels.collect())
}

/// The value in a row, if there is one.
fn finite(values: &[f64], row: usize) -> Option<f64> {
    values.get(row).copied().filter(|value| value.is_finite())
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

fn velocities(recording: &Recording) -> Result<Vec<Velocity>, Problem> {
    if recording.case.motion.kind == MotionKind::VelocityError {
        let of_loop = recording.case.schuler_loop.map(|it| it.velocity_white).unwrap_or_default();
        return Ok(recording
            .sensors
            .iter()
            .filter(|series| series.sensor.kind == SensorKind::InsVelocity)
            .map(|series| Velocity {
                name: series.sensor.id.clone(),
                values: series.values.clone(),
                noise: noise(series, of_loop),
            })
            .collect());
    }
    let doppler: Vec<&SensorSeries> =
        recording.sensors.iter().filter(|series| series.sensor.kind == SensorKind::Doppler).collect();
    let (Some(velocity), Some(attitude)) = (&recording.motion.velocity_ned, &recording.motion.attitude_rad)
    else {
        return Ok(Vec::new());
    };
    if doppler.is_empty() {
        return Ok(Vec::new());
    }
    against_doppler(recording, &doppler, velocity, attitude)
}

/// Inertial velocity minus Doppler velocity, north and east.
fn against_doppler(
    recording: &Recording,
    doppler: &[&SensorSeries],
    velocity: &[Vec<f64>; 3],
    attitude: &[Vec<f64>; 3],
) -> Result<Vec<Velocity>, Problem> {
    let axes: Vec<Vector3<f64>> =
        doppler.iter().map(|series| Vector3::from(series.sensor.axis.unwrap_or_default())).collect();
    let normal: Matrix3<f64> = axes.iter().map(|axis| axis * axis.transpose()).sum();
    let spans = normal.symmetric_eigenvalues().min() > LEAST_SINGULAR_VALUE.powi(2);
    let (Some(inverse), true) = (normal.try_inverse(), spans) else {
        let found = format!("found {} doppler axes that do not span space", doppler.len());
        return Err(Problem::new(
            None,
            "sensor",
            format!("{found}; expected three beams or body components"),
        ));
    };
    let sigma = doppler.iter().map(|series| noise(series, 0.0)).fold(0.0, f64::max);
    let mut errors = [Vec::with_capacity(recording.len()), Vec::with_capacity(recording.len())];
    for row in 0..recording.len() {
        // Least squares over the beams; one that is missing leaves no velocity.
        let beams = doppler.iter().zip(&axes).map(|(series, axis)| {
            let nominal = &series.sensor.nominal;
            let value = series.values.get(row).copied().unwrap_or(f64::NAN);
            axis * ((value - nominal.bias) / (1.0 + nominal.scale_factor_ppm * 1e-6))
        });
        let body = inverse * beams.sum::<Vector3<f64>>();
        let at = |columns: &[Vec<f64>; 3], k: usize| columns[k].get(row).copied().unwrap_or(f64::NAN);
        let turn = body_to_ned(at(attitude, 0), at(attitude, 1), at(attitude, 2));
        let told = turn * body;
        for (k, error) in errors.iter_mut().enumerate() {
            error.push(at(velocity, k) - told[k]);
        }
    }
    let [north, east] = errors;
    let channel = |name: &str, values| Velocity { name: name.to_owned(), values, noise: sigma };
    Ok(vec![channel("north", north), channel("east", east)])
}

/// White noise of a velocity with that of its quantisation.
fn noise(series: &SensorSeries, otherwise: f64) -> f64 {
    let sensor = &series.sensor;
    let white = [sensor.nominal.white, otherwise].into_iter().find(|w| *w > 0.0);
    white.unwrap_or(DEFAULT_VELOCITY_NOISE).hypot(sensor.quantisation / 12f64.sqrt())
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
