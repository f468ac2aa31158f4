//! The body's true rate and specific force from recorded attitude and velocity.
//!
//! Both are centred differences over up to three neighbours on either side of each row, of second, fourth or sixth order in
//! the step. The second order takes `1 − (ωh)²/6` of a motion of frequency ω: with sixty rows a period it is wrong by 0.2 %, ten
//! thousand times the noise of a good gyro on a table that swings. The higher orders let more of the noise of the recorded angles
//! through, and are taken where the motion is worth it, not where the angles are coarse. At the ends and beside missing values
//! there is none: a one-sided difference is that of half a step earlier or later, and a body
//! that turns with 1 rad/s² at steps of 0.1 s would be wrong by 50 mrad/s there. Angles are never differenced (they wrap, and are
//! singular at a pitch of 90°): rotations are, by the logarithm of their quotient.
use nalgebra::{Rotation3, Vector3};

use super::stamps::sampling_times;
use super::{body_to_ned, earth};

/// Three columns: x, y, z, one array each.
type Columns = [Vec<f64>; 3];

/// Inertial rate in body axes, rad/s, from attitude and, for the turn over the Earth, velocity.
///
/// `time_s`, `attitude_rad` (roll, pitch, yaw) and `velocity_ned` (m/s; none = at rest) have one value a row, NaN =
/// missing; `latitude` in rad. A row has no rate where its attitude or velocity is missing, or the attitude before or after
/// it.
pub fn inertial_rate(
    time_s: &[f64],
    attitude_rad: &Columns,
    velocity_ned: Option<&Columns>,
    latitude: f64,
    altitude_m: f64,
) -> Columns {
    let time_s = &*sampling_times(time_s);
    let attitudes: Vec<Option<Rotation3<f64>>> = rows(attitude_rad).map(|row| row.map(rotation)).collect();
    let turned = |row: usize, other: usize| {
        Some((get(&attitudes, row)?.inverse() * get(&attitudes, other)?).scaled_axis())
    };
    let turn_rates = derivatives(time_s, turned);
    columns(time_s.len(), |row| {
        let here = get(&attitudes, row)?;
        let velocity = velocity_ned.map_or(Some(Vector3::zeros()), |columns| vector(columns, row))?;
        let ned = earth::rotation_ned(latitude) + earth::transport_rate(latitude, altitude_m, &velocity);
        Some(get(&turn_rates, row)? + here.inverse() * ned)
    })
}

/// The body's rate over the ground at the instant of each row, rad/s in body axes, from attitude; arguments and missing values as
/// [`inertial_rate`], beside ends and missing rows of a lower order.
///
/// What is beside the reference point moves with ω × r of the instant. A vehicle that sways within a few steps has the peaks of its
/// rate between the rows, and a derivative of low order lacks them: at 2.2 rad a step the second order takes 37 % of a swing, the
/// sixteenth, which this is, 93 %. Where white noise of the angles would be more than [`MOST_NOISE`] of its mean square it is
/// the second.
pub fn turn_rate(time_s: &[f64], attitude_rad: &Columns) -> Columns {
    let time_s = &*sampling_times(time_s);
    let attitudes: Vec<Option<Rotation3<f64>>> = rows(attitude_rad).map(|row| row.map(rotation)).collect();
    let turned = |row: usize, other: usize| {
        Some((get(&attitudes, row)?.inverse() * get(&attitudes, other)?).scaled_axis())
    };
    // Turns to the rows on either side, before and after, nearest first; no further than the logarithm is nearly the angle.
    let turns = |row: usize, reach: usize| -> Vec<[Vector3<f64>; 2]> {
        let near = |other: usize| turned(row, other).filter(|turn| turn.norm() < FARTHEST_TURN);
        (1..=reach).map_while(|k| Some([near(row.checked_sub(k)?)?, near(row + k)?])).collect()
    };
    let rate = |row: usize, reach: usize| {
        let turns = turns(row, reach);
        let slopes = turns
            .iter()
            .zip(1..)
            .map(|([before, after], k)| (after - before) / (time_s[row + k] - time_s[row - k]));
        (!turns.is_empty()).then(|| {
            flattest(turns.len())
                .into_iter()
                .zip(slopes)
                .map(|(weight, slope)| weight * slope)
                .sum::<Vector3<f64>>()
        })
    };
    // Of the rows that have all neighbours: what white noise alone would be in the last difference, which takes least of a motion.
    let through: f64 =
        (flattest(WIDEST_REACH).iter().zip(1..)).map(|(weight, k)| (weight / f64::from(k)).powi(2)).sum();
    let (mut noise, mut mean_square) = (0.0, 0.0);
    for row in WIDEST_REACH..time_s.len().saturating_sub(WIDEST_REACH) {
        let turns = turns(row, WIDEST_REACH);
        if turns.len() == WIDEST_REACH {
            let differences =
                turns.iter().zip(LAST_DIFFERENCE).map(|(turn, weight)| weight * (turn[0] + turn[1]));
            let variance = differences.sum::<Vector3<f64>>().norm_squared() / LAST_DIFFERENCE_SQUARES;
            noise += 2.0 * through * variance / (time_s[row + 1] - time_s[row - 1]).powi(2);
            mean_square += rate(row, WIDEST_REACH).map_or(0.0, |rate| rate.norm_squared());
        }
    }
    let reach = if noise > MOST_NOISE * mean_square { 1 } else { WIDEST_REACH };
    columns(time_s.len(), |row| rate(row, reach))
}

/// Neighbours on either side for the rate of the instant.
const WIDEST_REACH: usize = 8;
/// Weights of the rows beside the middle in the sixteenth difference, and the sum of the squares of all.
const LAST_DIFFERENCE: [f64; WIDEST_REACH] = [-11_440.0, 8008.0, -4368.0, 1820.0, -560.0, 120.0, -16.0, 1.0];
const LAST_DIFFERENCE_SQUARES: f64 = 601_080_390.0;
/// Turn of a neighbour that is still used for it, rad.
const FARTHEST_TURN: f64 = 1.0;
/// Part of the rate's mean square that may be noise of the angles.
const MOST_NOISE: f64 = 0.25;

/// Weights of slopes over 1 … `reach` rows on either side in the derivative whose error is of the highest order:
/// 2 (−1)^(k+1) (N!)² / ((N − k)! (N + k)!) (Fornberg, Math. Comp. 51, 1988).
fn flattest(reach: usize) -> Vec<f64> {
    let mut weight = -2.0;
    (1..=reach)
        .map(|k| {
            weight *= -((reach + 1 - k) as f64) / (reach + k) as f64;
            weight
        })
        .collect()
}

/// Specific force in body axes, m/s², from attitude and velocity; arguments and missing values as
/// [`inertial_rate`], of which it needs no attitude but the row's. `f_n = dv/dt + (2 ω_ie + ω_en) × v − g`.
pub fn specific_force(
    time_s: &[f64],
    attitude_rad: &Columns,
    velocity_ned: &Columns,
    latitude: f64,
    altitude_m: f64,
) -> Columns {
    let time_s = &*sampling_times(time_s);
    let velocities: Vec<Option<Vector3<f64>>> = rows(velocity_ned).collect();
    let gravity = Vector3::new(0.0, 0.0, earth::gravity(latitude, altitude_m));
    let accelerations =
        derivatives(time_s, |row, other| Some(get(&velocities, other)? - get(&velocities, row)?));
    columns(time_s.len(), |row| {
        let attitude = rotation(vector(attitude_rad, row)?);
        let velocity = get(&velocities, row)?;
        let acceleration = get(&accelerations, row)?;
        let turn =
            2.0 * earth::rotation_ned(latitude) + earth::transport_rate(latitude, altitude_m, &velocity);
        Some(attitude.inverse() * (acceleration + turn.cross(&velocity) - gravity))
    })
}

/// The vector in `row`, if none of its components is missing.
pub(super) fn vector([x, y, z]: &Columns, row: usize) -> Option<Vector3<f64>> {
    let vector = Vector3::new(*x.get(row)?, *y.get(row)?, *z.get(row)?);
    vector.iter().all(|component| component.is_finite()).then_some(vector)
}

pub(super) fn rotation(roll_pitch_yaw: Vector3<f64>) -> Rotation3<f64> {
    body_to_ned(roll_pitch_yaw.x, roll_pitch_yaw.y, roll_pitch_yaw.z)
}

/// The columns of `value` for each of `rows` rows, NaN where it has none.
pub(super) fn columns(rows: usize, value: impl Fn(usize) -> Option<Vector3<f64>>) -> Columns {
    let mut columns = [(); 3].map(|()| Vec::with_capacity(rows));
    for row in 0..rows {
        let vector = value(row).unwrap_or_else(|| Vector3::repeat(f64::NAN));
        for (column, component) in columns.iter_mut().zip(vector.iter()) {
            column.push(*component);
        }
    }
    columns
}

fn rows(columns: &Columns) -> impl Iterator<Item = Option<Vector3<f64>>> {
    (0..columns[0].len()).map(|row| vector(columns, row))
}

fn get<T: Copy>(values: &[Option<T>], row: usize) -> Option<T> {
    values.get(row).copied().flatten()
}

/// Slopes over one to four rows on either side, of which the derivatives of second to eighth order are made (Richardson):
/// error of order 2, 4, 6, 8.
const OF_SLOPES: [[f64; 4]; 4] = [
    [1.0, 0.0, 0.0, 0.0],
    [4.0 / 3.0, -1.0 / 3.0, 0.0, 0.0],
    [3.0 / 2.0, -3.0 / 5.0, 1.0 / 10.0, 0.0],
    [8.0 / 5.0, -4.0 / 5.0, 8.0 / 35.0, -1.0 / 35.0],
];

/// Square of the part of a slope that is rounding of its digits.
const DIGITS: f64 = 1e-24;

/// Derivative in every row of what differs by `change(row, other)` between two rows; none where a neighbour is missing.
///
/// What the next order adds is what this one leaves out of the motion, and noise; what the one after that adds is nearly noise
/// alone, and the ratio of the two for white noise is known. The order is raised as long as the motion that it saves is
/// more than the noise that it adds, by mean squares over the whole recording.
fn derivatives(
    time_s: &[f64],
    change: impl Fn(usize, usize) -> Option<Vector3<f64>>,
) -> Vec<Option<Vector3<f64>>> {
    let slope = |row: usize, reach: usize| {
        let (before, after) = (row.checked_sub(reach)?, row + reach);
        let span_s = time_s.get(after)? - time_s.get(before)?;
        Some((change(row, after)? - change(row, before)?) / span_s)
    };
    let slopes: [Vec<Option<Vector3<f64>>>; 4] =
        std::array::from_fn(|index| (0..time_s.len()).map(|row| slope(row, index + 1)).collect());
    let combined = |row: usize, weights: &[f64; 4]| {
        let mut sum = Vector3::zeros();
        for (slopes, &weight) in slopes.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            sum += get(slopes, row)? * weight;
        }
        Some(sum)
    };
    let plain = slopes[0].iter().flatten().count();
    // None where so few rows have all their neighbours that they say nothing of the others, which would be lost.
    let mean_square = |weights: &[f64; 4]| {
        let squares: Vec<f64> =
            (0..time_s.len()).filter_map(|row| Some(combined(row, weights)?.norm_squared())).collect();
        (!squares.is_empty() && 2 * squares.len() >= plain)
            .then(|| squares.iter().sum::<f64>() / squares.len() as f64)
    };
    let added = |order: usize| {
        std::array::from_fn::<f64, 4, _>(|index| OF_SLOPES[order + 1][index] - OF_SLOPES[order][index])
    };
    let rounding = DIGITS * mean_square(&OF_SLOPES[0]).unwrap_or_default();
    let mut order = 0;
    while order + 2 < OF_SLOPES.len() {
        let (Some(adds), Some(adds_next)) = (mean_square(&added(order)), mean_square(&added(order + 1)))
        else {
            break;
        };
        // Variance of white noise in the angles, in units of what a single slope makes of it.
        let noise = adds_next / noise_through(&added(order + 1));
        let motion = adds - noise * noise_through(&added(order));
        let costs = noise * (noise_through(&OF_SLOPES[order + 1]) - noise_through(&OF_SLOPES[order]));
        if adds <= rounding || motion <= costs {
            break;
        }
        order += 1;
    }
    (0..time_s.len()).map(|row| combined(row, &OF_SLOPES[order])).collect()
}

/// Variance that combined slopes have by white noise, relative to that of the slope over one row on either side.
fn noise_through(weights: &[f64; 4]) -> f64 {
    weights.iter().enumerate().map(|(index, weight)| (weight / (index as f64 + 1.0)).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::motion::{rate_at_rest, specific_force_at_rest};

    const LATITUDE: f64 = 0.97;
    const STEP_S: f64 = 0.1;

    fn times(rows: usize) -> Vec<f64> {
        (0..rows).map(|row| row as f64 * STEP_S).collect()
    }

    #[test]
    fn at_rest_the_rate_is_the_earths_and_the_force_is_gravity() {
        let rows = 5;
        let attitude = [vec![0.1; rows], vec![-0.2; rows], vec![2.9; rows]];
        let velocity = [vec![0.0; rows], vec![0.0; rows], vec![0.0; rows]];
        let ned = body_to_ned(0.1, -0.2, 2.9);
        let rate = inertial_rate(&times(rows), &attitude, None, LATITUDE, 100.0);
        let force = specific_force(&times(rows), &attitude, &velocity, LATITUDE, 100.0);
        for row in 1..rows - 1 {
            assert!((vector(&rate, row).unwrap() - rate_at_rest(&ned, LATITUDE)).norm() < 1e-15);
            assert!(
                (vector(&force, row).unwrap() - specific_force_at_rest(&ned, LATITUDE, 100.0)).norm() < 1e-12
            );
        }
    }

    /// A body that turns about one fixed axis of its own at a constant rate: the rate is known in closed form, and the
    /// yaw passes ±π on the way.
    #[test]
    fn a_turn_about_a_fixed_axis_is_recovered_through_the_wrap_and_upside_down() {
        let rate = Vector3::new(0.3, -0.5, 0.8);
        let start = body_to_ned(0.2, 0.1, 3.0);
        let time_s = times(200);
        let mut attitude = [(); 3].map(|()| Vec::new());
        for time in &time_s {
            let (roll, pitch, yaw) = (start * Rotation3::new(rate * *time)).euler_angles();
            for (column, angle) in attitude.iter_mut().zip([roll, pitch, yaw]) {
                column.push(angle);
            }
        }
        assert!(attitude[2].windows(2).any(|pair| (pair[1] - pair[0]).abs() > PI), "the yaw must wrap");
        let found = inertial_rate(&time_s, &attitude, None, LATITUDE, 0.0);
        for (row, time) in time_s.iter().enumerate().take(199).skip(1) {
            let ned = start * Rotation3::new(rate * *time);
            let expected = rate + ned.inverse() * earth::rotation_ned(LATITUDE);
            assert!((vector(&found, row).unwrap() - expected).norm() < 1e-9, "row {row}");
        }
    }

    /// North at constant speed over the ellipsoid: the body's rate is the Earth's and the frame's, the force gravity
    /// and Coriolis.
    #[test]
    fn a_level_body_going_north_feels_transport_rate_and_coriolis() {
        let (rows, speed) = (4, 250.0);
        let zeros = || vec![0.0; rows];
        let velocity = [vec![speed; rows], zeros(), zeros()];
        let attitude = [zeros(), zeros(), zeros()];
        let rate = inertial_rate(&times(rows), &attitude, Some(&velocity), LATITUDE, 0.0);
        let force = specific_force(&times(rows), &attitude, &velocity, LATITUDE, 0.0);
        let (sin, cos) = LATITUDE.sin_cos();
        let (omega, turn) = (earth::ROTATION_RATE, speed / earth::meridian_radius(LATITUDE));
        let expected = Vector3::new(omega * cos, -turn, -omega * sin);
        assert!((vector(&rate, 1).unwrap() - expected).norm() < 1e-14);
        // (2ω + ω_en) × v = [0, −2ω sin φ · v, turn · v].
        let expected =
            Vector3::new(0.0, -2.0 * omega * sin * speed, turn * speed - earth::gravity(LATITUDE, 0.0));
        assert!((vector(&force, 1).unwrap() - expected).norm() < 1e-10);
    }

    /// Yaw that swings with forty rows a period: the second order alone would be wrong by 0.4 %. Between rows that are noisy the
    /// plain difference stays, which lets least of it through.
    #[test]
    fn a_swing_is_recovered_beyond_the_second_order_unless_the_angles_are_noisy() {
        let (rows, amplitude) = (400, 0.3);
        let omega = 2.0 * PI / (40.0 * STEP_S);
        let found = |noise: f64| {
            let jitter = |k: usize| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0) - 0.5;
            let yaw = (times(rows).iter().enumerate())
                .map(|(k, time)| amplitude * (omega * time).sin() + noise * jitter(k))
                .collect();
            inertial_rate(&times(rows), &[vec![0.0; rows], vec![0.0; rows], yaw], None, 0.0, 0.0)
        };
        let worst = |rate: &Columns| {
            (times(rows).iter().enumerate())
                .filter_map(|(row, time)| {
                    Some((vector(rate, row)?.z - amplitude * omega * (omega * time).cos()).abs())
                })
                .fold(0.0, f64::max)
        };
        let largest = amplitude * omega;
        assert!(worst(&found(0.0)) < 1e-6 * largest);
        // Noise of a quarter of the largest turn in a step.
        let noisy = found(0.01);
        assert!(vector(&noisy, 1).is_some(), "the plain difference needs one neighbour");
    }

    /// A roll that sways once in 2.9 steps, as an underwater vehicle's does at one row a second: the second order takes 37 % of its rate.
    #[test]
    fn a_sway_within_three_steps_has_the_rate_of_the_instant() {
        let (rows, amplitude, omega) = (60, 0.02, 2.2 / STEP_S);
        let roll: Vec<f64> = times(rows).iter().map(|time| amplitude * (omega * time).sin()).collect();
        let mut attitude = [roll, vec![0.0; rows], vec![0.0; rows]];
        attitude[0][40] = f64::NAN;
        let found = turn_rate(&times(rows), &attitude);
        let part = |row: usize| {
            vector(&found, row).map(|rate| rate.x / (amplitude * omega * (omega * row as f64 * STEP_S).cos()))
        };
        assert!((part(20).unwrap() - 0.927).abs() < 0.005, "{:?}", part(20));
        // Beside an end or a missing row with as many neighbours as there are.
        assert_eq!([part(0), part(39), part(40), part(41), part(59)], [None; 5]);
        assert!((part(1).unwrap() - 0.367).abs() < 0.005, "{:?}", part(1));
        assert!((part(42).unwrap() - 0.367).abs() < 0.005, "{:?}", part(42));
        assert!(part(38).is_some() && part(58).is_some());
        // White noise of the angles alone: no order but the lowest.
        let jitter: Vec<f64> =
            (0..rows).map(|k| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0) - 0.5).collect();
        let noise = [vec![0.0; rows], vec![0.0; rows], jitter];
        let (wide, narrow) =
            (turn_rate(&times(rows), &noise), inertial_rate(&times(rows), &noise, None, 0.0, 0.0));
        assert!((wide[2][30] - narrow[2][30]).abs() < 1e-4 * narrow[2][30].abs());
    }

    /// Seconds of 1970 in 64 bits: over steps that are rounded, a rate of 1 rad/s would be wrong by 4 · 10⁻⁶ rad/s.
    #[test]
    fn rounded_stamps_do_not_show_in_a_rate() {
        let time_s: Vec<f64> = (0..400).map(|row| 1.7e9 + f64::from(row) * 0.02).collect();
        let yaw = (0..400).map(|row| f64::from(row) * 0.02).collect();
        let rate = inertial_rate(&time_s, &[vec![0.0; 400], vec![0.0; 400], yaw], None, 0.0, 0.0);
        for row in 10..390 {
            let turn = vector(&rate, row).unwrap() - Vector3::new(earth::ROTATION_RATE, 0.0, 0.0);
            assert!((turn.z - 1.0).abs() < 1e-9, "row {row}: {}", turn.z - 1.0);
        }
    }

    /// At a changing rate a one-sided difference would be that of another time.
    #[test]
    fn rows_at_the_ends_and_beside_missing_ones_have_no_rate() {
        let (rows, growth) = (9, 1.0);
        let yaw = times(rows).iter().map(|time| 0.5 * growth * time * time).collect();
        let mut attitude = [vec![0.0; rows], vec![0.0; rows], yaw];
        attitude[1][4] = f64::NAN;
        let rate = inertial_rate(&times(rows), &attitude, None, 0.0, 0.0);
        for row in 0..rows {
            let found = vector(&rate, row).map(|rate| rate.z);
            if [0, 3, 4, 5, 8].contains(&row) {
                assert_eq!(found, None, "row {row}");
            } else {
                assert!((found.unwrap() - growth * row as f64 * STEP_S).abs() < 1e-12, "row {row}");
            }
        }
    }
}
