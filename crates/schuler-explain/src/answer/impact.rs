//! What findings do to a navigation solution.
use schuler_recording::case::SensorKind;
use schuler_recording::unit::STANDARD_GRAVITY;

use super::arrays::findings_of;
use crate::catalogue::Port;
use crate::evidence::late::late_columns;
use crate::exact::OverRows;
use crate::explanation::{Finding, Impact};

/// Time after which the errors are told, s.
const AFTER_S: f64 = 3600.0;
/// Shortest time over which something is told, s.
const LEAST_S: f64 = 60.0;
/// Mean radius of the Earth, m.
const EARTH_RADIUS_M: f64 = 6_371_000.0;

/// What a finding adds to an inertial sensor, in SI units.
struct Error {
    finding: usize,
    sensor: String,
    is_gyro: bool,
    values: Vec<f64>,
}

/// What each finding does, and what all of the sensor with the largest error do together; absent where they are of no inertial sensor.
pub fn impacts(after: &OverRows<'_>, findings: &[Finding]) -> (Vec<Option<Impact>>, Option<Impact>) {
    let errors = errors(after, findings);
    let time_s = &after.bench.problem.model.time_s;
    let since = |finding: usize| findings.get(finding).map_or(0.0, |it| it.interval_s[0]);
    let worst =
        |impacts: Vec<Impact>| impacts.into_iter().max_by(|a, b| a.position_m.total_cmp(&b.position_m));
    let of_finding = |index: usize| {
        let own = errors.iter().filter(|error| error.finding == index);
        worst(own.filter_map(|error| impact(&[error], since(index), time_s)).collect())
    };
    let mut sensors: Vec<(&str, bool)> = errors.iter().map(|it| (it.sensor.as_str(), it.is_gyro)).collect();
    sensors.sort_unstable();
    sensors.dedup();
    let of_sensor = |(sensor, is_gyro): (&str, bool)| {
        let own: Vec<&Error> =
            errors.iter().filter(|it| it.sensor == sensor && it.is_gyro == is_gyro).collect();
        let begins = own.iter().map(|error| since(error.finding)).fold(f64::INFINITY, f64::min);
        impact(&own, begins, time_s)
    };
    let all = worst(sensors.into_iter().filter_map(of_sensor).collect());
    ((0..findings.len()).map(of_finding).collect(), all)
}

fn errors(after: &OverRows<'_>, findings: &[Finding]) -> Vec<Error> {
    let problem = after.bench.problem;
    let model = problem.model;
    let terms = after.description.placed.iter().map(|placed| &placed.term);
    let places = findings_of(model, &problem.candidates, terms, findings);
    let mut errors: Vec<Error> = Vec::new();
    for ((placed, amplitudes), finding) in after.description.placed.iter().zip(&after.amplitudes).zip(places)
    {
        let Some(finding) = finding else { continue };
        for (column, amplitude) in late_columns(model, &placed.delays, &placed.term).iter().zip(amplitudes) {
            for (sensor, values) in &column.parts {
                let kind = problem.inputs.recording.sensors.get(*sensor).map(|it| it.sensor.kind);
                let Some(is_gyro) = kind.and_then(|kind| is_gyro(placed.term.port, kind)) else { continue };
                let name =
                    model.source_of(*sensor, placed.term.port).map(|it| model.sources[it].name.clone());
                let sensor = name.unwrap_or_default();
                let more = values.iter().map(|value| if value.is_finite() { amplitude * value } else { 0.0 });
                match errors.iter_mut().find(|it| it.finding == finding && it.sensor == sensor) {
                    Some(known) => known.values.iter_mut().zip(more).for_each(|(sum, more)| *sum += more),
                    None => errors.push(Error { finding, sensor, is_gyro, values: more.collect() }),
                }
            }
        }
    }
    errors
}

/// Whether what enters there is an error of a gyro, or of an accelerometer; none of other sensors.
fn is_gyro(port: Port, kind: SensorKind) -> Option<bool> {
    match (port, kind) {
        (Port::Gyro, _)
        | (Port::Output, SensorKind::Dtg | SensorKind::Fog | SensorKind::Rlg | SensorKind::MemsGyro) => {
            Some(true)
        }
        (Port::Accelerometer, _) | (Port::Output, SensorKind::Accelerometer) => Some(false),
        _ => None,
    }
}

/// What errors of one sensor do from a time on.
fn impact(errors: &[&Error], since_s: f64, time_s: &[f64]) -> Option<Impact> {
    let first = errors.first()?;
    let (mut position, mut velocity, mut tilt, mut after_s) = (0.0, 0.0, 0.0, 0.0);
    for (row, pair) in time_s.windows(2).enumerate() {
        let [from, to] = [pair[0], pair[1]];
        if from < since_s {
            continue;
        }
        if to - since_s > AFTER_S {
            break;
        }
        let error: f64 = errors.iter().filter_map(|it| it.values.get(row)).sum();
        let (gyro, accelerometer) = if first.is_gyro { (error, 0.0) } else { (0.0, error) };
        let step = to - from;
        tilt += (gyro + velocity / EARTH_RADIUS_M) * step;
        velocity += (accelerometer - STANDARD_GRAVITY * tilt) * step;
        position += velocity * step;
        after_s = to - since_s;
    }
    (after_s >= LEAST_S).then(|| Impact {
        sensor: first.sensor.clone(),
        after_s,
        position_m: f64::abs(position),
        attitude_deg: f64::abs(tilt).to_degrees(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant drift ε makes R ε (t − sin ωt/ω), a constant error a of an accelerometer a (1 − cos ωt)/ω², ω² = g/R.
    #[test]
    fn an_hour_with_a_constant_error_is_as_in_closed_form() {
        let time_s: Vec<f64> = (0..5000).map(f64::from).collect();
        let error = |is_gyro, value: f64| Error {
            finding: 0,
            sensor: "sensor".to_owned(),
            is_gyro,
            values: vec![value; time_s.len()],
        };
        let (omega, t) = ((STANDARD_GRAVITY / EARTH_RADIUS_M).sqrt(), AFTER_S);
        let drift = 0.01_f64.to_radians() / 3600.0;
        let of_gyro = impact(&[&error(true, drift)], 0.0, &time_s).expect("an hour");
        let expected = EARTH_RADIUS_M * drift * (t - (omega * t).sin() / omega);
        assert!((of_gyro.position_m / expected - 1.0).abs() < 2e-3, "{of_gyro:?} {expected}");
        let bias = 1e-4 * STANDARD_GRAVITY;
        let of_bias = impact(&[&error(false, bias)], 0.0, &time_s).expect("an hour");
        let expected = bias * (1.0 - (omega * t).cos()) / omega.powi(2);
        assert!((of_bias.position_m / expected - 1.0).abs() < 2e-3, "{of_bias:?} {expected}");
        assert!(impact(&[&error(false, bias)], 4980.0, &time_s).is_none());
    }
}
