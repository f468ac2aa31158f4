//! A reference that is held between its readings, as in tables that were merged from a fast and a slow source.
use std::borrow::Cow;

use schuler_recording::Recording;
use schuler_recording::recording::MotionSeries;

use crate::numeric::spline::{Knot, Spline};

/// Readings that a held reference has at least.
const FEWEST_READINGS: usize = 20;
/// Longest time between two of its readings, s: what stays longer may stand still.
const LONGEST_S: f64 = 1.5;
/// Part of its stays that are at most twice as long as most.
const REGULAR: f64 = 0.9;

/// What a reference may record, and after which an angle begins anew.
const SERIES: [(&str, f64); 4] = [
    ("rate", f64::INFINITY),
    ("specific force", f64::INFINITY),
    ("velocity", f64::INFINITY),
    ("attitude", std::f64::consts::TAU),
];

/// The recording with a spline between the readings of a reference in place of what it holds, and a warning that says so.
pub fn without_held_reference(recording: Cow<'_, Recording>) -> Cow<'_, Recording> {
    let motion = &recording.motion;
    let series = [&motion.rate, &motion.specific_force, &motion.velocity_ned, &motion.attitude_rad];
    let held = series.map(|series| held_rows(series.as_ref()?, recording.step_s));
    if held.iter().all(Option::is_none) {
        return recording;
    }
    let mut recording = recording.into_owned();
    let MotionSeries { rate, specific_force, velocity_ned, attitude_rad } = &mut recording.motion;
    let series = [rate, specific_force, velocity_ned, attitude_rad];
    for (((name, period), series), held) in SERIES.into_iter().zip(series).zip(held) {
        let Some(rows) = held else { continue };
        for values in series.iter_mut().flatten() {
            *values = between_readings(values, &rows, period);
        }
        let part = rows.iter().filter(|held| **held).count() as f64 / rows.len() as f64;
        recording.warnings.push(format!(
            "the reference's {name} repeats its last value in {:.0} % of the rows: it is held between its readings, and \
             taken as smooth between them",
            100.0 * part
        ));
    }
    Cow::Owned(recording)
}

/// Rows that repeat the one before, where that is how the series is sampled.
fn held_rows(series: &[Vec<f64>; 3], step_s: f64) -> Option<Vec<bool>> {
    let rows = series[0].len();
    let repeats = |row: usize| row > 0 && series.iter().all(|values| values[row] == values[row - 1]);
    let held: Vec<bool> = (0..rows).map(repeats).collect();
    // Stays of the reference, each with the row that is read.
    let mut stays: Vec<usize> = Vec::new();
    for held in &held {
        match stays.last_mut() {
            Some(stay) if *held => *stay += 1,
            _ => stays.push(1),
        }
    }
    let mut sorted = stays.clone();
    sorted.sort_unstable();
    let most = *sorted.get(sorted.len() / 2)?;
    let regular = stays.iter().filter(|stay| **stay <= 2 * most).count() as f64;
    let is_held = stays.len() >= FEWEST_READINGS
        && most >= 2
        && most as f64 * step_s <= LONGEST_S
        && regular >= REGULAR * stays.len() as f64;
    is_held.then_some(held)
}

/// A spline through the readings; angles go on by less than half a `period` from reading to reading. After the last reading it is not
/// known.
fn between_readings(values: &[f64], held: &[bool], period: f64) -> Vec<f64> {
    let rows: Vec<usize> = (0..values.len()).filter(|&row| !held[row]).collect();
    let mut knots: Vec<Knot> = Vec::with_capacity(rows.len());
    for &row in rows.iter().filter(|&&row| values[row].is_finite()) {
        let last = knots.last().map_or(values[row], |knot| knot.value);
        let turns = if period.is_finite() { ((values[row] - last) / period).round() * period } else { 0.0 };
        knots.push(Knot { time: row as f64, value: values[row] - turns });
    }
    let Some(end) = knots.last().map(|knot| knot.time as usize) else { return values.to_vec() };
    let spline = Spline::through(&knots);
    let at = |row: usize| match () {
        () if !held[row] => values[row],
        () if row < end => spline.at(row as f64).0,
        () => f64::NAN,
    };
    (0..values.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::{between_readings, held_rows};

    fn series(of: impl Fn(usize) -> f64) -> [Vec<f64>; 3] {
        [(0..500).map(&of).collect(), vec![0.0; 500], vec![0.0; 500]]
    }

    #[test]
    fn a_reference_of_every_fifth_row_is_held() {
        let held = held_rows(&series(|row| (0.1 * (row / 5) as f64).sin()), 0.01).expect("held");
        assert_eq!(held.iter().filter(|held| **held).count(), 400);
        assert!(!held[5] && held[6]);
    }

    #[test]
    fn neither_a_motion_nor_the_positions_of_a_table_are_held() {
        assert!(held_rows(&series(|row| (0.1 * row as f64).sin()), 0.01).is_none());
        assert!(held_rows(&series(|row| (row / 20) as f64), 1.0).is_none());
        assert!(held_rows(&series(|_| 0.0), 0.01).is_none());
    }

    #[test]
    fn between_readings_of_a_turn_the_angle_goes_on() {
        let angle = |row: f64| 0.3 * row;
        let wrapped =
            |row: usize| (angle((row / 4 * 4) as f64) + 3.0).rem_euclid(std::f64::consts::TAU) - 3.0;
        let values: Vec<f64> = (0..200).map(wrapped).collect();
        let held: Vec<bool> = (0..200).map(|row| row % 4 != 0).collect();
        let between = between_readings(&values, &held, std::f64::consts::TAU);
        for row in 8..190 {
            let off = (between[row] - angle(row as f64)) / std::f64::consts::TAU;
            assert!((off - off.round()).abs() < 1e-9, "row {row}");
        }
    }
}
