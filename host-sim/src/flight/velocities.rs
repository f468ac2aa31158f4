//! The velocities of a case: the error that the filter measures, and the radio and inertial velocities behind it.
use nalgebra::{Matrix3, Vector3};
use schuler_core::health::HealthConfig;
use schuler_core::module::HEALTH_LEVELS;
use schuler_recording::case::{MotionKind, SensorKind};
use schuler_recording::motion::body_to_ned;
use schuler_recording::recording::SensorSeries;
use schuler_recording::{Problem, Recording};

/// Velocity noise where the case gives none, m/s.
pub(super) const DEFAULT_VELOCITY_NOISE: f64 = 0.1;
/// Axes of radio sensors whose least singular value is below this do not span space.
const LEAST_SINGULAR_VALUE: f64 = 0.05;
/// Two axes are one when the cosine between them is above this.
const PARALLEL: f64 = 0.9999;
/// Least noise of a residual that the health monitor is told, m/s.
const LEAST_RESIDUAL_NOISE: f64 = 1e-3;
/// A degraded level and a jump, in units of the radio's normal error.
const DEGRADED: f64 = 3.0;
/// Mean time between faults and mean length of one, s; the specification's.
const FAULT_INTERVAL_AND_LENGTH_S: [f64; 2] = [1800.0, 120.0];
/// The longest silence that is bridged, s, but no more steps than the monitor can.
const BRIDGED_S: f64 = 600.0;
const BRIDGED_STEPS: f64 = 1000.0;

/// A velocity error in one direction.
pub(super) struct Velocity {
    pub(super) name: String,
    pub(super) values: Vec<f64>,
    pub(super) noise: f64,
    pub(super) pair: Option<Pair>,
}

/// Velocities of a radio and an inertial sensor along the same axis.
pub(super) struct Pair {
    pub(super) radio: Vec<f64>,
    pub(super) inertial: Vec<f64>,
    /// What the case believes of the radio.
    white: f64,
    markov: Option<(f64, f64)>,
}

impl Pair {
    /// What the health monitor is told: the radio's correlated error is its Markov part, or as large as its white noise where the
    /// case gives none; the rest is the specification's.
    pub(super) fn config(&self, step_s: f64, max_age_ms: u32) -> HealthConfig<f32, HEALTH_LEVELS> {
        let mut config = HealthConfig::<f64, HEALTH_LEVELS>::doppler_against_inertial();
        let (sigma, tau_s) = self.markov.unwrap_or((self.white, config.radio.tau_s));
        let chain = FAULT_INTERVAL_AND_LENGTH_S.map(|mean_s| (step_s / mean_s).min(0.5));
        let transition = [[1.0 - chain[0], chain[0]], [chain[1], 1.0 - chain[1]]];
        config.step_s = step_s;
        config.radio.tau_s = tau_s;
        config.radio.sigma = [sigma, DEGRADED * sigma];
        config.radio.transition = transition;
        config.jump.sigma = DEGRADED * sigma;
        config.jump.transition = transition;
        config.residual_sigma = self.white.max(LEAST_RESIDUAL_NOISE);
        config.restart_after_s = BRIDGED_S.min(BRIDGED_STEPS * step_s);
        config.max_age_ms = max_age_ms;
        single(&config)
    }
}

/// The same in single precision.
fn single(config: &HealthConfig<f64, HEALTH_LEVELS>) -> HealthConfig<f32, HEALTH_LEVELS> {
    use schuler_core::health::{
        AlarmThresholds, InertialErrorModel, JumpModel, MemoryModel, RadioErrorModel,
    };
    let row = |row: [f64; 2]| row.map(|value| value as f32);
    let HealthConfig { radio, jump, inertial, .. } = config;
    HealthConfig {
        memory: config.memory.map(|it| MemoryModel {
            repeat: it.repeat as f32,
            fail: it.fail as f32,
            recover: it.recover as f32,
        }),
        step_s: config.step_s as f32,
        radio: RadioErrorModel {
            tau_s: radio.tau_s as f32,
            sigma: row(radio.sigma),
            normal_levels: radio.normal_levels,
            transition: radio.transition.map(row),
            initial: row(radio.initial),
        },
        jump: JumpModel {
            sigma: jump.sigma as f32,
            transition: jump.transition.map(row),
            initial: row(jump.initial),
            attribution_limit_s: jump.attribution_limit_s as f32,
        },
        inertial: InertialErrorModel {
            random_walk: inertial.random_walk as f32,
            initial_sigma: inertial.initial_sigma as f32,
            drift_sigma: inertial.drift_sigma as f32,
            drift_random_walk: inertial.drift_random_walk as f32,
            bound: inertial.bound as f32,
        },
        residual_sigma: config.residual_sigma as f32,
        alarm: AlarmThresholds { set: config.alarm.set as f32, clear: config.alarm.clear as f32 },
        out_of_model_sigma: config.out_of_model_sigma as f32,
        unobserved_after_s: config.unobserved_after_s as f32,
        restart_after_s: config.restart_after_s as f32,
        max_age_ms: config.max_age_ms,
    }
}

/// The velocities of a recording.
pub(super) fn velocities(recording: &Recording) -> Result<Vec<Velocity>, Problem> {
    if recording.case.motion.kind == MotionKind::VelocityError {
        let of_loop = recording.case.schuler_loop.map(|it| it.velocity_white).unwrap_or_default();
        return Ok(of_kind(recording, SensorKind::InsVelocity)
            .into_iter()
            .map(|series| Velocity {
                name: series.sensor.id.clone(),
                values: series.values.clone(),
                noise: noise(series, of_loop),
                pair: None,
            })
            .collect());
    }
    let doppler = of_kind(recording, SensorKind::Doppler);
    let radio = if doppler.is_empty() { of_kind(recording, SensorKind::GnssVelocity) } else { doppler };
    match (&recording.motion.velocity_ned, &recording.motion.attitude_rad) {
        (Some(velocity), Some(attitude)) if !radio.is_empty() => {
            against_radio(recording, &radio, velocity, attitude)
        }
        _ => Ok(pairs(recording)),
    }
}

fn of_kind(recording: &Recording, kind: SensorKind) -> Vec<&SensorSeries> {
    recording.sensors.iter().filter(|series| series.sensor.kind == kind).collect()
}

/// Each inertial velocity against the first radio velocity along the same axis.
fn pairs(recording: &Recording) -> Vec<Velocity> {
    let mut radios = of_kind(recording, SensorKind::Doppler);
    radios.extend(of_kind(recording, SensorKind::GnssVelocity));
    let along = |a: &SensorSeries, b: &SensorSeries| match (a.sensor.axis, b.sensor.axis) {
        (Some(a), Some(b)) => Vector3::from(a).dot(&Vector3::from(b)) > PARALLEL,
        (None, None) => true,
        _ => false,
    };
    of_kind(recording, SensorKind::InsVelocity)
        .into_iter()
        .filter_map(|inertial| {
            let radio = radios.iter().copied().find(|radio| along(radio, inertial))?;
            let (radio_values, inertial_values) = (calibrated(radio), calibrated(inertial));
            let white = noise(radio, 0.0);
            Some(Velocity {
                name: inertial.sensor.id.clone(),
                values: inertial_values.iter().zip(&radio_values).map(|(i, r)| i - r).collect(),
                noise: white,
                pair: Some(Pair {
                    radio: radio_values,
                    inertial: inertial_values,
                    white,
                    markov: radio.sensor.nominal.markov.map(|it| (it.sigma, it.tau_s)),
                }),
            })
        })
        .collect()
}

/// Readings less the nominal bias and scale-factor error.
fn calibrated(series: &SensorSeries) -> Vec<f64> {
    let nominal = &series.sensor.nominal;
    let scale = 1.0 + nominal.scale_factor_ppm * 1e-6;
    series.values.iter().map(|value| (value - nominal.bias) / scale).collect()
}

/// Inertial velocity against the radio's, north and east.
fn against_radio(
    recording: &Recording,
    radio: &[&SensorSeries],
    velocity: &[Vec<f64>; 3],
    attitude: &[Vec<f64>; 3],
) -> Result<Vec<Velocity>, Problem> {
    let axes: Vec<Vector3<f64>> =
        radio.iter().map(|series| Vector3::from(series.sensor.axis.unwrap_or_default())).collect();
    let normal: Matrix3<f64> = axes.iter().map(|axis| axis * axis.transpose()).sum();
    let spans = normal.symmetric_eigenvalues().min() > LEAST_SINGULAR_VALUE.powi(2);
    let (Some(inverse), true) = (normal.try_inverse(), spans) else {
        let found = format!("found {} {} axes that do not span space", radio.len(), radio[0].sensor.kind);
        return Err(Problem::new(
            None,
            "sensor",
            format!("{found}; expected three beams or body components"),
        ));
    };
    let white = radio.iter().map(|series| noise(series, 0.0)).fold(0.0, f64::max);
    // The beams' Markov errors are as one: the largest and the fastest of them is the safe side.
    let markov = radio
        .iter()
        .filter_map(|series| series.sensor.nominal.markov)
        .map(|it| (it.sigma, it.tau_s))
        .reduce(|a, b| (a.0.max(b.0), a.1.min(b.1)));
    let beams: Vec<Vec<f64>> = radio.iter().map(|series| calibrated(series)).collect();
    let mut told = [Vec::with_capacity(recording.len()), Vec::with_capacity(recording.len())];
    for row in 0..recording.len() {
        // Least squares over the beams; one that is missing leaves no velocity.
        let along =
            beams.iter().zip(&axes).map(|(beam, axis)| axis * beam.get(row).copied().unwrap_or(f64::NAN));
        let body = inverse * along.sum::<Vector3<f64>>();
        let at = |columns: &[Vec<f64>; 3], k: usize| columns[k].get(row).copied().unwrap_or(f64::NAN);
        let turned = body_to_ned(at(attitude, 0), at(attitude, 1), at(attitude, 2)) * body;
        for (k, told) in told.iter_mut().enumerate() {
            told.push(turned[k]);
        }
    }
    let channels =
        ["north", "east"].iter().zip(told).zip(velocity).map(|((name, radio), inertial)| Velocity {
            name: (*name).to_owned(),
            values: inertial.iter().zip(&radio).map(|(i, r)| i - r).collect(),
            noise: white,
            pair: Some(Pair { radio, inertial: inertial.clone(), white, markov }),
        });
    Ok(channels.collect())
}

/// White noise of a velocity with that of its quantisation.
fn noise(series: &SensorSeries, otherwise: f64) -> f64 {
    let sensor = &series.sensor;
    let white = [sensor.nominal.white, otherwise].into_iter().find(|w| *w > 0.0);
    white.unwrap_or(DEFAULT_VELOCITY_NOISE).hypot(sensor.quantisation / 12f64.sqrt())
}
