//! What surrounds the instruments: temperatures, thermometers, other recorded quantities, stretches that are missing.
use schuler_recording::case::{ELECTRONICS as AT_ELECTRONICS, Quantity};

use super::{ELECTRONICS, FAR_THERMOMETER, THERMOMETER};
use crate::campaign::draw::Draw;
use crate::physics::environment::{Profile, Thermal};
use crate::physics::heat::Bar;
use crate::scenario::{QuantityEntry, Scenario, ThermometerEntry};

/// A bar whose temperature follows the surroundings within a share of the record.
fn bar(duration_s: f64, draw: &mut Draw) -> Bar {
    let length_m = if duration_s < 7200.0 { 0.08 } else { 0.2 };
    let capacity = 2.43e6;
    let film_left = (capacity * length_m / (duration_s * draw.log_between(0.01, 0.1))).max(15.0);
    Bar {
        length_m,
        section_m2: 6e-3,
        conductivity: 160.0,
        capacity,
        film_left,
        film_right: 0.0,
        side: 0.0,
        cells: 12,
    }
}

/// Temperature programmes, thermometers and other recorded quantities.
pub(super) fn surroundings(scenario: &mut Scenario, near: Option<&str>, draw: &mut Draw) {
    let duration = scenario.duration_s;
    let bar = bar(duration, draw);
    let start = draw.between(15.0, 30.0);
    let programme = draw.between(0.0, 1.0);
    let mut power = Profile::constant(0.0);
    let ambient = if programme < 0.4 {
        let corners = 3 + draw.index(5);
        let mut points = vec![(0.0, start)];
        for k in 1..=corners {
            let level = start + draw.between(-15.0, 20.0);
            let at = duration * k as f64 / (corners + 1) as f64;
            points.push((
                at - duration * draw.between(0.0, 0.5) / (corners + 1) as f64,
                points[points.len() - 1].1,
            ));
            points.push((at, level));
        }
        points.dedup_by(|b, a| b.0 <= a.0);
        Profile { points, amplitude: 0.0, period_s: 1.0 }
    } else if programme < 0.7 {
        let period_s = duration * draw.between(0.25, 0.9);
        Profile { points: vec![(0.0, start)], amplitude: draw.between(3.0, 10.0), period_s }
    } else if programme < 0.9 {
        draw.wander(start, 4.0, duration / 24.0, duration)
    } else {
        power = Profile::constant(draw.between(4.0, 12.0) * bar.film_left * bar.section_m2);
        Profile::constant(start)
    };
    let position = draw.between(0.2, 0.5) * bar.length_m;
    let far = position + 0.4 * bar.length_m;
    let (quantisation, white, tau_s) =
        (draw.pick([0.0, 0.01, 0.0625]), draw.log_between(0.001, 0.02), draw.between(0.0, 30.0));
    let thermometer = |column: &str, near: Option<&str>, position_m: f64| ThermometerEntry {
        column: column.to_owned(),
        near: near.map(str::to_owned),
        position_m,
        tau_s: tau_s.min(0.002 * duration),
        white,
        quantisation,
    };
    scenario.recorded.thermometers.push(thermometer(THERMOMETER, near, position));
    if draw.chance(0.4) {
        scenario.recorded.thermometers.push(thermometer(FAR_THERMOMETER, None, far));
    }
    let mut heaters = vec![(position, power)];
    if draw.chance(0.3) {
        // The electronics have a life of their own: a load that is switched.
        let mut points = vec![(0.0, 2.0)];
        for k in 1..8 {
            let at = duration * f64::from(k) / 8.0;
            let level = draw.between(0.0, 1.0) * 4.0 * bar.film_left * bar.section_m2;
            points.push((at - 0.001 * duration, points[points.len() - 1].1));
            points.push((at, level));
        }
        let place = 0.95 * bar.length_m;
        heaters.push((place, Profile { points, amplitude: 0.0, period_s: 1.0 }));
        scenario.environment.electronics_position_m = Some(place);
        scenario.recorded.thermometers.push(thermometer(ELECTRONICS, Some(AT_ELECTRONICS), place));
    }
    for gyro in &mut scenario.gyros {
        gyro.position_m = position;
    }
    for fog in &mut scenario.fogs {
        fog.position_m = position;
    }
    for accelerometer in &mut scenario.accelerometers {
        accelerometer.position_m = position;
    }
    scenario.environment.thermal = Thermal::Bar { bar, initial: ambient.at(0.0), ambient, heaters };
    if draw.chance(0.5) {
        scenario.environment.voltage = draw.wander(27.0, 0.4, duration / 40.0, duration);
        scenario.recorded.voltage = true;
    }
    for (column, quantity, unit, about, spread) in [
        ("pressure", Quantity::Pressure, "Pa", 100_800.0, 300.0),
        ("load_current", Quantity::Current, "A", 2.0, 0.3),
        ("humidity", Quantity::Other, "%", 45.0, 6.0),
    ] {
        if draw.chance(0.4) {
            let every_s = duration / draw.between(15.0, 60.0);
            scenario.recorded.quantities.push(QuantityEntry {
                column: column.to_owned(),
                quantity,
                unit: unit.to_owned(),
                near: None,
                profile: draw.wander(about, spread, every_s, duration),
                recorded: true,
            });
        }
    }
}

/// Stretches that are missing.
pub(super) fn gaps(scenario: &mut Scenario, draw: &mut Draw) {
    if draw.chance(0.25) {
        for _ in 0..=draw.index(3) {
            let length = scenario.duration_s * draw.log_between(0.002, 0.03);
            scenario.gaps.push((draw.between(0.05, 0.9) * scenario.duration_s, length));
        }
    }
}
