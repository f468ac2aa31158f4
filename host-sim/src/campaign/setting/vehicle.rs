//! Motion of a vehicle.
use crate::campaign::draw::Draw;
use crate::physics::motion::{Motion, Sway, Vehicle, VehicleStep};

/// Legs of a vehicle over a duration; speeds stay between two values, headings are free or, on a platform's course, nearly
/// straight.
pub(super) fn legs(
    duration_s: f64,
    unit_s: f64,
    slowest: f64,
    fastest: f64,
    turns: f64,
    draw: &mut Draw,
) -> (f64, Vec<VehicleStep>) {
    let start = draw.between(slowest, fastest);
    let mut speed = start;
    let mut steps = Vec::new();
    let mut time = 0.0;
    while time < duration_s {
        let leg_s = unit_s * draw.between(0.4, 1.6);
        let mut leg =
            VehicleStep { duration_s: leg_s, speed_change: 0.0, heading_change: 0.0, height_change: 0.0 };
        let which = draw.between(0.0, 1.0);
        if which < 0.4 {
            let wanted = draw.between(slowest, fastest);
            leg.speed_change = wanted - speed;
            speed = wanted;
        } else if which < 0.8 {
            leg.heading_change = turns * draw.between(-1.5, 1.5);
        }
        time += leg_s;
        steps.push(leg);
    }
    (start, steps)
}

/// A vehicle on a northerly course whose platform stays level.
pub(super) fn platform(duration_s: f64, unit_s: f64, fastest: f64, draw: &mut Draw) -> Motion {
    let (speed, steps) = legs(duration_s, unit_s, 0.1 * fastest, fastest, 0.2, draw);
    Motion::Vehicle(Vehicle {
        speed,
        heading: draw.between(-0.5, 0.5),
        bank_share: 0.0,
        sway: Sway::default(),
        level_platform: true,
        steps,
    })
}
