//! From a case to what the flight module is told: one channel for each run of the module.
//!
//! | in the case | channels |
//! | --- | --- |
//! | `motion.kind = "velocity_error"` | one, from the sensor of kind `ins_velocity` |
//! | recorded `velocity_ned` and `attitude_rad` beside three or more `doppler` sensors | north and east: the inertial velocity minus the Doppler velocity, turned into north-east-down by the recorded attitude |
//! | exactly five gyros | isolation in the first channel, or alone where there is no velocity |
//!
//! What a case does not say has these defaults: noise of accelerometer and gyro as [`ModuleConfig::default`]
//! (10⁻⁴ g over 60 s, 0.1 °/h over 1800 s); noise of the velocity 0.1 m/s; velocity error at the start ten times the
//! velocity noise, at least 0.1 m/s; tilt at the start 10⁻⁴ rad; noise of a gyro 0.02 °/h; range of a gyro 10 rad/s.
//! A missing reading, and a step that the recording lacks, is a reading of quality missing; a quantised reading has the
//! variance of its step added to its white noise.
use nalgebra::{DMatrix, DVector, Vector3};
use schuler_core::filter::{FilterConfig, MarkovNoise};
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
        let expected =
            "expected velocity_error; or recorded velocity_ned and attitude_rad beside doppler sensors; or exactly five gyros";
        return Err(Problem::new(None, "motion.kind", format!("{found}; {expected}")));
    }
    let start_s = recording.time_s.first().copied().unwrap_or_default();
    let time_ms: Vec<u64> = recording
        .time_s
        .iter()
        .map(|t| ((t - start_s + recording.step_s) * 1000.0).round() as u64)
        .collect();

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
                velocity_error: velocity.values.get(row).map_or_else(Reading::missing, |v| reading(*v as f32)),
                gyros: match gyros {
                    Some(five) => five.map(|series| series.values.get(row).map_or_else(Reading::missing, |v| reading(*v))),
                    None => [Reading::missing(); GYROS],
                },
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

fn reading<T: num_like::Finite>(value: T) -> Reading<T> {
    if value.finite() { Reading::good(value) } else { Reading::missing() }
}

/// What `reading` needs of a number.
mod num_like {
    pub(super) trait Finite: nalgebra::Scalar + num_traits::Zero {
        fn finite(&self) -> bool;
    }

    impl Finite for f32 {
        fn finite(&self) -> bool {
            self.is_finite()
        }
    }

    impl Finite for f64 {
        fn finite(&self) -> bool {
            self.is_finite()
        }
    }
}

/// The five gyros, if there are exactly five.
fn block(recording: &Recording) -> Option<[&SensorSeries; GYROS]> {
    let gyros: Vec<&SensorSeries> = recording
        .sensors
        .iter()
        .filter(|series| {
            use SensorKind::{Dtg, Fog, MemsGyro, Rlg};
            matches!(series.sensor.kind, Dtg | Fog | Rlg | MemsGyro) && series.sensor.axis.is_some()
        })
        .collect();
    gyros.try_into().ok()
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
    let axes = DMatrix::from_fn(doppler.len(), 3, |row, column| {
        doppler[row].sensor.axis.map_or(0.0, |axis| axis[column])
    });
    let least = axes.clone().svd(false, false).singular_values.min();
    let inverse = axes.pseudo_inverse(1e-9).map_err(|_| ());
    let (Ok(inverse), true) = (inverse, doppler.len() >= 3 && least > LEAST_SINGULAR_VALUE) else {
        let found = format!("found {} doppler axes that do not span space", doppler.len());
        return Err(Problem::new(None, "sensor", format!("{found}; expected three beams or body components")));
    };
    let sigma = doppler.iter().map(|series| noise(series, 0.0)).fold(0.0, f64::max);
    let mut errors = [Vec::with_capacity(recording.len()), Vec::with_capacity(recording.len())];
    for row in 0..recording.len() {
        let measured = DVector::from_fn(doppler.len(), |k, _| {
            let sensor = &doppler[k].sensor;
            let value = doppler[k].values.get(row).copied().unwrap_or(f64::NAN);
            (value - sensor.nominal.bias) / (1.0 + sensor.nominal.scale_factor_ppm * 1e-6)
        });
        let body = &inverse * measured;
        let at = |columns: &[Vec<f64>; 3], k: usize| columns[k].get(row).copied().unwrap_or(f64::NAN);
        let turn = body_to_ned(at(attitude, 0), at(attitude, 1), at(attitude, 2));
        let told = turn * Vector3::new(body[0], body[1], body[2]);
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

fn config(recording: &Recording, velocity_noise: f64, gyros: Option<&[&SensorSeries; GYROS]>) -> ModuleConfig {
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
        let isolation = &mut config.isolation;
        isolation.range = GYRO_RANGE;
        for ((series, axis), sigma) in five.iter().zip(&mut isolation.axes).zip(&mut isolation.sigma) {
            *axis = series.sensor.axis.unwrap_or_default();
            let nominal = &series.sensor.nominal;
            let white = if nominal.white > 0.0 { nominal.white } else { DEFAULT_GYRO_NOISE };
            *sigma = white.hypot(series.sensor.quantisation / 12f64.sqrt());
        }
    }
    config
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
