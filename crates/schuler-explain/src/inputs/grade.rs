//! The grade of each sensor: as its case states it, or guessed from its kind and its noise, which is said.
//!
//! The guess needs the density of the white noise, σ √Δt, with σ the standard deviation of one sample: stated as `white`, or of the
//! second differences of the readings. The motion of the body makes the latter too large, so that a guess is rather too
//! coarse than too fine. An accelerometer is of the grade of the gyros that it is built in with, whatever it reads: a wrong unit is
//! then told by what is plausible of it.
//!
//! Input: readings in SI units. Densities in rad/√s and m/s/√s.
use std::f64::consts::PI;

use schuler_recording::Recording;
use schuler_recording::case::{Grade, SensorKind};
use schuler_recording::recording::SensorSeries;
use schuler_recording::unit::{Dimension, STANDARD_GRAVITY};

use crate::numeric::statistics::median;

/// 1 °/√h, rad/√s.
const DEGREE_PER_ROOT_HOUR: f64 = PI / 180.0 / 60.0;
/// 1 µg/√Hz, m/s/√s.
const MICRO_G_PER_ROOT_HERTZ: f64 = STANDARD_GRAVITY * 1e-6;
/// Noise of gyros up to which they are of navigation and of tactical grade, rad/√s. The first is the geometric mean of what is usual of the
/// two (see [`Grade`]); the second lies between the best micromechanical gyros, 0.15 °/√h, and the usual ones from 0.25 °/√h on.
const OF_GYROS: [f64; 2] = [0.01 * DEGREE_PER_ROOT_HOUR, 0.2 * DEGREE_PER_ROOT_HOUR];
/// The same of accelerometers, m/s/√s: the geometric means.
const OF_ACCELEROMETERS: [f64; 2] = [45.0 * MICRO_G_PER_ROOT_HERTZ, 316.0 * MICRO_G_PER_ROOT_HERTZ];
/// Median of the magnitude of a normal deviate, in σ.
const MEDIAN_MAGNITUDE: f64 = 0.6745;
/// Variance of a second difference of white noise, in σ².
const OF_SECOND_DIFFERENCE: f64 = 6.0;
/// Sensors that a note lists.
const LISTED: usize = 6;

/// The grade of each sensor of a recording, in its order: stated or guessed; none of velocities and of sensors of other
/// kinds.
pub fn grades(recording: &Recording) -> Vec<Option<Grade>> {
    let gyros: Vec<Option<Grade>> =
        recording.sensors.iter().map(|it| of_gyro(it, recording.step_s)).collect();
    let with_gyros = || recording.sensors.iter().zip(&gyros);
    (with_gyros())
        .map(|(series, &of_gyro)| {
            let sensor = &series.sensor;
            if sensor.kind != SensorKind::Accelerometer {
                return of_gyro;
            }
            let mates = with_gyros()
                .filter(|(mate, _)| sensor.group.is_some() && mate.sensor.group == sensor.group)
                .filter_map(|(_, grade)| *grade);
            let built_in_with = mates.max().or_else(|| gyros.iter().flatten().copied().max());
            let by_noise = || by_density(density(series, recording.step_s), OF_ACCELEROMETERS);
            sensor.grade.or(built_in_with).or_else(by_noise)
        })
        .collect()
}

/// What the user should be told of grades that are guessed; nothing where all are stated.
pub fn said(recording: &Recording) -> Option<String> {
    let grades = grades(recording);
    let guessed =
        || recording.sensors.iter().zip(&grades).filter(|(series, _)| series.sensor.grade.is_none());
    let of_grade = |&(name, grade): &(&str, Grade)| {
        let ids: Vec<&str> = guessed()
            .filter(|(_, guess)| **guess == Some(grade))
            .map(|(series, _)| series.sensor.id.as_str())
            .collect();
        let more =
            if ids.len() > LISTED { format!(" and {} more", ids.len() - LISTED) } else { String::new() };
        let first = ids.get(..LISTED).unwrap_or(&ids).join(", ");
        (!ids.is_empty()).then(|| format!("{name} ({first}{more})"))
    };
    let told: Vec<String> = Grade::NAMES.iter().filter_map(of_grade).collect();
    (!told.is_empty()).then(|| {
        format!(
            "grade of sensors, guessed from kind and noise: {}; state `grade` in the case where it is another",
            told.join(", ")
        )
    })
}

/// The grade of a gyro. Spinning wheels and light are never micromechanical; what is micromechanical is never of navigation grade.
fn of_gyro(series: &SensorSeries, step_s: f64) -> Option<Grade> {
    let sensor = &series.sensor;
    if sensor.kind.dimension() != Dimension::AngularRate {
        return None;
    }
    let guess = || by_density(density(series, step_s), OF_GYROS);
    let [best, worst] = match sensor.kind {
        SensorKind::MemsGyro => [Grade::Tactical, Grade::Mems],
        _ => [Grade::Navigation, Grade::Tactical],
    };
    sensor.grade.or_else(|| Some(guess().unwrap_or(worst).clamp(best, worst)))
}

fn by_density(density: Option<f64>, [navigation, tactical]: [f64; 2]) -> Option<Grade> {
    density.map(|density| match density {
        it if it <= navigation => Grade::Navigation,
        it if it <= tactical => Grade::Tactical,
        _ => Grade::Mems,
    })
}

/// Density of the white noise of a sensor, SI unit · √s; none where it is neither stated nor seen.
fn density(series: &SensorSeries, step_s: f64) -> Option<f64> {
    let stated = series.sensor.nominal.white;
    let sigma = if stated > 0.0 { stated } else { noise_of(&series.values)? };
    Some(sigma * step_s.sqrt())
}

/// Standard deviation of white noise in readings: the median magnitude of their second differences, or where most of these vanish, as
/// those of coarse readings do, their root mean square.
fn noise_of(values: &[f64]) -> Option<f64> {
    let differences = values.windows(3).map(|of| of[2] - 2.0 * of[1] + of[0]);
    let mut magnitudes: Vec<f64> = differences.map(f64::abs).filter(|it| it.is_finite()).collect();
    let mean_square = magnitudes.iter().map(|it| it * it).sum::<f64>() / magnitudes.len() as f64;
    let middle = median(&mut magnitudes);
    let deviation = if middle > 0.0 { middle / MEDIAN_MAGNITUDE } else { mean_square.sqrt() };
    (deviation > 0.0).then(|| deviation / OF_SECOND_DIFFERENCE.sqrt())
}
