//! The body's true rate and specific force from recorded attitude and velocity.
//!
//! Both are centred differences over up to sixteen neighbours on either side of each row, of second to 32nd order in the step. The
//! second order takes `1 − (ωh)²/6` of a motion of frequency ω: with sixty rows a period it is wrong by 0.2 %, ten
//! thousand times the noise of a good gyro on a table that swings, and of a vehicle that sways within three rows it has a third.
//! The higher orders let more of the noise of what was recorded through, and are taken as far as the motion is worth it. At the ends and beside missing values there is none: a one-sided difference is that of half a step earlier
//! or later, and a body that turns with 1 rad/s² at steps of 0.1 s would be wrong by 50 mrad/s there. Angles are never
//! differenced (they wrap, and are singular at a pitch of 90°): rotations are, by the logarithm of their quotient.
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::derivative::{FARTHEST_TURN, derivatives};
use super::stamps::sampling_times;
use super::{body_to_ned, earth, specific_force_at_rest};

/// Three columns: x, y, z, one array each.
type Columns = [Vec<f64>; 3];

/// What a rate or force is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// To be compared with readings: as near as can be by mean squares, and none in rows beside ends and missing values where it would be
    /// much worse than elsewhere.
    Prediction,
    /// To see how readings depend on it: the same, in every row that has a neighbour on either side.
    Input,
    /// To see how a velocity beside the reference point depends on it, which is that of the instant: what is left out of a motion goes
    /// with the motion and makes a coefficient wrong, noise hardly does. The widest order, unless noise is a large part of
    /// what comes out, and in every row that has a neighbour on either side.
    Instant,
}

/// Inertial rate in body axes, rad/s, from attitude and, for the turn over the Earth, velocity.
///
/// `time_s`, `attitude_rad` (roll, pitch, yaw) and `velocity_ned` (m/s; none = at rest) have one value a row, NaN =
/// missing; `latitude` in rad. A row has no rate where its attitude or velocity is missing, or the attitude before or after
/// it, or for its `purpose` too many beside these.
pub fn inertial_rate(
    time_s: &[f64],
    attitude_rad: &Columns,
    velocity_ned: Option<&Columns>,
    latitude: f64,
    altitude_m: f64,
    purpose: Use,
) -> Columns {
    let time_s = &*sampling_times(time_s);
    let attitudes: Vec<Option<Rotation3<f64>>> = rows(attitude_rad).map(|row| row.map(rotation)).collect();
    let quotient = |row: usize, other: usize| Some(get(&attitudes, row)?.inverse() * get(&attitudes, other)?);
    let between = |row: usize, other: usize| Some(time_s.get(other)? - time_s.get(row)?);
    // Beside a steady turn at the rate of a row's neighbours, so that the far ones need not be within half a turn: the rate of
    // exp(−Ωτ/2) R(0)ᵀR(τ) exp(−Ωτ/2) at τ = 0 is that of R less Ω, whatever Ω is.
    let steady: Vec<Option<Vector3<f64>>> = (0..time_s.len())
        .map(|row| {
            let (before, after) = (row.checked_sub(1)?, row + 1);
            let turn = turned_by(&quotient(row, after)?) - turned_by(&quotient(row, before)?);
            Some(turn / between(before, after)?)
        })
        .collect();
    // No further than the logarithm is nearly the angle.
    let turned = |row: usize, other: usize| {
        let steady = get(&steady, row)? * between(row, other)?;
        let half = Rotation3::new(-0.5 * steady);
        let turn = turned_by(&(half * quotient(row, other)? * half));
        (row.abs_diff(other) == 1 || turn.norm() < FARTHEST_TURN).then(|| turn + steady)
    };
    let turn_rates = derivatives(time_s, turned, purpose);
    columns(time_s.len(), |row| {
        let here = get(&attitudes, row)?;
        let velocity = velocity_ned.map_or(Some(Vector3::zeros()), |columns| vector(columns, row))?;
        let ned = earth::rotation_ned(latitude) + earth::transport_rate(latitude, altitude_m, &velocity);
        Some(get(&turn_rates, row)? + here.inverse() * ned)
    })
}

/// Specific force in body axes, m/s², from attitude and velocity; arguments and missing values as
/// [`inertial_rate`], of which it needs no attitude but the row's. `f_n = dv/dt + (2 ω_ie + ω_en) × v − g`.
pub fn specific_force(
    time_s: &[f64],
    attitude_rad: &Columns,
    velocity_ned: Option<&Columns>,
    latitude: f64,
    altitude_m: f64,
    purpose: Use,
) -> Columns {
    let Some(velocity_ned) = velocity_ned else {
        return columns(time_s.len(), |row| {
            let attitude = rotation(vector(attitude_rad, row)?);
            Some(specific_force_at_rest(&attitude, latitude, altitude_m))
        });
    };
    let time_s = &*sampling_times(time_s);
    let velocities: Vec<Option<Vector3<f64>>> = rows(velocity_ned).collect();
    let gravity = Vector3::new(0.0, 0.0, earth::gravity(latitude, altitude_m));
    let change = |row: usize, other: usize| Some(get(&velocities, other)? - get(&velocities, row)?);
    let accelerations = derivatives(time_s, change, purpose);
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

/// The logarithm of a rotation, rad. That of a matrix takes the angle by its cosine: it loses half of the digits of a small one, and of
/// one that is 0 but for rounding it may be no number.
fn turned_by(rotation: &Rotation3<f64>) -> Vector3<f64> {
    UnitQuaternion::from_rotation_matrix(rotation).scaled_axis()
}

fn get<T: Copy>(values: &[Option<T>], row: usize) -> Option<T> {
    values.get(row).copied().flatten()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::motion::rate_at_rest;

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
        let rate = inertial_rate(&times(rows), &attitude, None, LATITUDE, 100.0, Use::Prediction);
        let force =
            specific_force(&times(rows), &attitude, Some(&velocity), LATITUDE, 100.0, Use::Prediction);
        for row in 1..rows - 1 {
            assert!((vector(&rate, row).unwrap() - rate_at_rest(&ned, LATITUDE)).norm() < 1e-15);
            assert!(
                (vector(&force, row).unwrap() - specific_force_at_rest(&ned, LATITUDE, 100.0)).norm() < 1e-12
            );
        }
    }

    /// A table that is turned from pose to pose, with a jump of its acceleration at either end: two rows from there it stands.
    #[test]
    fn a_table_that_stands_has_no_rate_of_its_turns() {
        let turn_rows = 40;
        let pose = |row: usize| {
            let (number, within) = (row / 200, row % 200);
            let part = (within as f64 / turn_rows as f64).min(1.0);
            number as f64 + 0.5 * (1.0 - (PI * part).cos())
        };
        let rows = 1000;
        let still = vec![0.3; rows];
        let attitude = [(0..rows).map(pose).collect(), still.clone(), still];
        for purpose in [Use::Prediction, Use::Input, Use::Instant] {
            let rate = inertial_rate(&times(rows), &attitude, None, LATITUDE, 100.0, purpose);
            let stands = |row: &usize| (turn_rows + 2..198).contains(&(row % 200)) && *row > 200;
            for row in (0..rows - 20).filter(stands) {
                let ned = body_to_ned(attitude[0][row], 0.3, 0.3);
                let off = (vector(&rate, row).unwrap() - rate_at_rest(&ned, LATITUDE)).norm();
                assert!(off < 1e-13, "{purpose:?} {row}: {off:e}");
            }
        }
    }

    /// A body of which no velocity is recorded turns where it is.
    #[test]
    fn without_a_velocity_the_force_is_that_of_a_body_in_its_place() {
        let rows = 60;
        let attitude: Columns =
            std::array::from_fn(|axis| (0..rows).map(|row| 0.01 * (axis * row) as f64).collect());
        let at_rest: Columns = std::array::from_fn(|_| vec![0.0; rows]);
        let force =
            |velocity| specific_force(&times(rows), &attitude, velocity, LATITUDE, 100.0, Use::Prediction);
        let (without, with) = (force(None), force(Some(&at_rest)));
        for row in 0..rows {
            let ned = body_to_ned(attitude[0][row], attitude[1][row], attitude[2][row]);
            let expected = specific_force_at_rest(&ned, LATITUDE, 100.0);
            assert!((vector(&without, row).unwrap() - expected).norm() < 1e-12);
            assert!(vector(&with, row).is_none_or(|with| (with - expected).norm() < 1e-12));
        }
    }

    /// Bodies at rest in oblique poses, turned over and turned by less than their angles have digits: quotients of their attitudes
    /// have traces above 3.
    #[test]
    fn a_pose_that_hardly_turns_has_a_rate() {
        let time_s = times(40);
        for (pose, turn) in (0..400).flat_map(|pose| [(pose, 0.0), (pose, 1e-9), (pose, 3e-7)]) {
            let angle = |k: usize| f64::from(pose) * [0.7, 1.3, 2.1][k] % 3.0 - 1.5;
            let start = body_to_ned(2.0 * angle(0), angle(1), 2.0 * angle(2));
            let rate = Vector3::new(turn, -turn, 0.5 * turn);
            let mut attitude = [(); 3].map(|()| Vec::new());
            for time in &time_s {
                let (roll, pitch, yaw) = (start * Rotation3::new(rate * *time)).euler_angles();
                for (column, angle) in attitude.iter_mut().zip([roll, pitch, yaw]) {
                    column.push(angle);
                }
            }
            let found = inertial_rate(&time_s, &attitude, None, LATITUDE, 0.0, Use::Input);
            for (row, time) in time_s.iter().enumerate().take(39).skip(1) {
                let here = start * Rotation3::new(rate * *time);
                let expected = rate + here.inverse() * earth::rotation_ned(LATITUDE);
                let off = (vector(&found, row).unwrap() - expected).norm();
                assert!(off < 1e-12, "pose {pose}, row {row}: {off}");
            }
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
        let found = inertial_rate(&time_s, &attitude, None, LATITUDE, 0.0, Use::Prediction);
        for (row, time) in time_s.iter().enumerate().take(199).skip(1) {
            let ned = start * Rotation3::new(rate * *time);
            let expected = rate + ned.inverse() * earth::rotation_ned(LATITUDE);
            assert!((vector(&found, row).unwrap() - expected).norm() < 1e-9, "row {row}");
        }
    }

    /// A table that turns by 1.2 rad a step, faster and slower, while it tilts: neighbours further than two are more than half a turn away.
    #[test]
    fn a_fast_spin_has_the_rate_of_its_instant() {
        let time_s = times(400);
        let slow = 0.8;
        let yaw = |t: f64| 12.0 * t + 1.5 * (slow * t).sin();
        let pitch = |t: f64| 0.3 * (0.5 * slow * t).cos();
        let column = |of: &dyn Fn(f64) -> f64| -> Vec<f64> { time_s.iter().map(|&t| of(t)).collect() };
        let wrapped = |t: f64| yaw(t).sin().atan2(yaw(t).cos());
        let attitude = [vec![0.0; 400], column(&pitch), column(&wrapped)];
        let found = inertial_rate(&time_s, &attitude, None, LATITUDE, 0.0, Use::Prediction);
        for (row, &t) in time_s.iter().enumerate().take(390).skip(10) {
            let (turn, tilt) = (12.0 + 1.5 * slow * (slow * t).cos(), -0.15 * slow * (0.5 * slow * t).sin());
            let own = Vector3::new(-turn * pitch(t).sin(), tilt, turn * pitch(t).cos());
            let expected = own + body_to_ned(0.0, pitch(t), yaw(t)).inverse() * earth::rotation_ned(LATITUDE);
            let off = (vector(&found, row).unwrap() - expected).norm();
            assert!(off < 2e-7, "row {row}: {off}");
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
        let rate = inertial_rate(&times(rows), &attitude, Some(&velocity), LATITUDE, 0.0, Use::Prediction);
        let force = specific_force(&times(rows), &attitude, Some(&velocity), LATITUDE, 0.0, Use::Prediction);
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
            inertial_rate(
                &times(rows),
                &[vec![0.0; rows], vec![0.0; rows], yaw],
                None,
                0.0,
                0.0,
                Use::Prediction,
            )
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
        let (rows, amplitude, omega) = (200, 0.02, 2.2 / STEP_S);
        let roll: Vec<f64> = times(rows).iter().map(|time| amplitude * (omega * time).sin()).collect();
        let mut attitude = [roll, vec![0.0; rows], vec![0.0; rows]];
        attitude[0][140] = f64::NAN;
        let found = inertial_rate(&times(rows), &attitude, None, 0.0, 0.0, Use::Instant);
        let part = |row: usize| {
            vector(&found, row).map(|rate| rate.x / (amplitude * omega * (omega * row as f64 * STEP_S).cos()))
        };
        assert!((part(20).unwrap() - 0.991).abs() < 0.002, "{:?}", part(20));
        // Beside an end or a missing row with as many neighbours as there are.
        assert_eq!([part(0), part(139), part(140), part(141), part(199)], [None; 5]);
        assert!((part(1).unwrap() - 0.367).abs() < 0.005, "{:?}", part(1));
        assert!((part(142).unwrap() - 0.367).abs() < 0.005, "{:?}", part(142));
        assert!(part(138).is_some() && part(198).is_some());
        // White noise of the angles alone: no order but the lowest.
        let jitter: Vec<f64> =
            (0..rows).map(|k| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0) - 0.5).collect();
        let noise = [vec![0.0; rows], vec![0.0; rows], jitter];
        let found = inertial_rate(&times(rows), &noise, None, 0.0, 0.0, Use::Instant);
        let mean = (noise[2][31] - noise[2][29]) / (2.0 * STEP_S);
        assert!((found[2][30] - mean).abs() < 1e-3 * mean.abs());
    }

    /// Over two steps it would be 658 ppm too small; so it is where there is one neighbour on either side.
    #[test]
    fn a_motion_of_one_hertz_at_a_hundred_is_right_within_a_millionth() {
        let (rows, step_s, omega) = (2000, 0.01, 2.0 * PI);
        let time_s: Vec<f64> = (0..rows).map(|row| row as f64 * step_s).collect();
        let sine = |of: f64| -> Vec<f64> { time_s.iter().map(|time| of * (omega * time).sin()).collect() };
        let level = [vec![0.0; rows], vec![0.0; rows], vec![0.0; rows]];
        let (mut attitude, mut velocity) = (level.clone(), level.clone());
        (attitude[0], velocity[0]) = (sine(0.3), sine(2.0));
        for column in attitude.iter_mut().chain(&mut velocity) {
            column[900] = f64::NAN;
        }
        for purpose in [Use::Prediction, Use::Input, Use::Instant] {
            let rate = inertial_rate(&time_s, &attitude, None, 0.0, 0.0, purpose);
            let force = specific_force(&time_s, &level, Some(&velocity), 0.0, 0.0, purpose);
            let mut taken = 0;
            for (row, time) in time_s.iter().enumerate() {
                let alone = [1, 898, 902, rows - 2].contains(&row) && purpose != Use::Prediction;
                let found = vector(&rate, row).zip(vector(&force, row)).filter(|_| !alone);
                let Some((rate, force)) = found else { continue };
                let cosine = omega * (omega * time).cos();
                assert!((rate.x - earth::ROTATION_RATE - 0.3 * cosine).abs() < 0.3e-6 * omega, "{row}");
                assert!((force.x - 2.0 * cosine).abs() < 2e-6 * omega, "{purpose:?} {row}");
                taken += 1;
            }
            assert!(taken > rows - 80, "{purpose:?}: {taken} rows");
        }
    }

    /// Noise of the angles of 10 µrad is more than the 658 ppm that the second order leaves out, in a row; in all of them it is not.
    #[test]
    fn a_noisy_reference_loses_no_part_of_a_slow_motion() {
        let (rows, step_s, omega, amplitude) = (6000, 0.01, 2.0 * PI, 0.05);
        let time_s: Vec<f64> = (0..rows).map(|row| row as f64 * step_s).collect();
        let jitter = |k: usize| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0) - 0.5;
        let noise_of = |k: usize| 1e-5 * 12.0_f64.sqrt() * jitter(k);
        let roll: Vec<f64> = (time_s.iter().enumerate())
            .map(|(row, time)| amplitude * (omega * time).sin() + noise_of(row))
            .collect();
        let rate = inertial_rate(
            &time_s,
            &[roll, vec![0.0; rows], vec![0.0; rows]],
            None,
            0.0,
            0.0,
            Use::Prediction,
        );
        let (mut product, mut square, mut noise) = (0.0, 0.0, 0.0);
        for (row, time) in time_s.iter().enumerate() {
            let Some(found) = vector(&rate, row) else { continue };
            let truth = amplitude * omega * (omega * time).cos();
            let off = found.x - earth::ROTATION_RATE - truth;
            product += off * truth;
            square += truth * truth;
            noise += off * off;
        }
        let noise = (noise / rows as f64).sqrt();
        // A part of the motion within what the noise itself leaves open.
        assert!((product / square).abs() < 3.0 * noise / square.sqrt(), "{}", product / square);
        // The fourth order has 1.34 of the noise of the second, 7.1e-4 rad/s.
        assert!(noise < 1.0e-3, "{noise}");
    }

    /// Seconds of 1970 in 64 bits: over steps that are rounded, a rate of 1 rad/s would be wrong by 4 · 10⁻⁶ rad/s.
    #[test]
    fn rounded_stamps_do_not_show_in_a_rate() {
        let time_s: Vec<f64> = (0..400).map(|row| 1.7e9 + f64::from(row) * 0.02).collect();
        let yaw = (0..400).map(|row| f64::from(row) * 0.02).collect();
        let rate =
            inertial_rate(&time_s, &[vec![0.0; 400], vec![0.0; 400], yaw], None, 0.0, 0.0, Use::Prediction);
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
        let rate = inertial_rate(&times(rows), &attitude, None, 0.0, 0.0, Use::Prediction);
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
