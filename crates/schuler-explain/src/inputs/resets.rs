//! A reference that is set anew in one row, as a heading that a filter corrects: a body does not turn so, and what is derived over it
//! is nobody's.
use std::borrow::Cow;
use std::f64::consts::TAU;

use schuler_recording::Recording;

/// Rows on either side beside which a reset stands alone.
const NEIGHBOURS: usize = 8;
/// How far it stands out of them, and of what a change differs from those beside it elsewhere.
const ALONE: f64 = 8.0;
const ABOVE_OTHERS: f64 = 10.0;
/// Part of the changes that are judged to be others.
const OTHERS: f64 = 0.99;
/// Fewest rows in which one is seen, and most resets: a few, or one in so many rows. What is set anew more often is how it is read.
const FEWEST_ROWS: usize = 100;
const MOST: usize = 3;
const ROWS_OF_ONE: usize = 1000;

/// The recording without the rows of attitude and velocity in which they are set anew, and a warning that says so.
pub fn without_resets(recording: Cow<'_, Recording>) -> Cow<'_, Recording> {
    let motion = &recording.motion;
    let all = [("attitude", &motion.attitude_rad, Some(TAU)), ("velocity", &motion.velocity_ned, None)];
    let found = all.map(|(name, series, period)| {
        let of_axis = |values: &Vec<f64>| resets(values, period);
        let mut rows: Vec<usize> = series.iter().flatten().flat_map(of_axis).collect();
        rows.sort_unstable();
        rows.dedup();
        (name, rows)
    });
    if found.iter().all(|(_, rows)| rows.is_empty()) {
        return recording;
    }
    let mut recording = recording.into_owned();
    let [attitude, velocity] = found.map(|(name, rows)| {
        let start_s = recording.time_s.first().copied().unwrap_or_default();
        let times: Vec<String> = (rows.iter().take(MOST))
            .filter_map(|&row| Some(format!("{:.3} s", recording.time_s.get(row)? - start_s)))
            .collect();
        let more =
            if rows.len() > MOST { format!(" and {} times more", rows.len() - MOST) } else { String::new() };
        if !rows.is_empty() {
            recording.warnings.push(format!(
                "the reference's {name} is set anew at {}{more}: nothing is derived over that",
                times.join(", ")
            ));
        }
        rows
    });
    let motion = &mut recording.motion;
    for (series, rows) in [(&mut motion.attitude_rad, attitude), (&mut motion.velocity_ned, velocity)] {
        for values in series.iter_mut().flatten() {
            for &row in &rows {
                values.get_mut(row).into_iter().for_each(|value| *value = f64::NAN);
            }
        }
    }
    Cow::Owned(recording)
}

/// The rows from which on a series, whose values begin anew after a `period`, goes on from elsewhere.
fn resets(values: &[f64], period: Option<f64>) -> Vec<usize> {
    let within = |change: f64| period.map_or(change, |period| change - period * (change / period).round());
    let changes: Vec<f64> = values.windows(2).map(|pair| within(pair[1] - pair[0])).collect();
    // By what a change differs from those beside it: a step of the rate does so twice, a reset thrice, and most in the middle.
    let bends: Vec<f64> = changes.windows(3).map(|of| (of[1] - 0.5 * (of[0] + of[2])).abs()).collect();
    let mut sorted: Vec<f64> = bends.iter().copied().filter(|bend| bend.is_finite()).collect();
    if sorted.len() < FEWEST_ROWS {
        return Vec::new();
    }
    let rank = (OTHERS * (sorted.len() - 1) as f64) as usize;
    let (_, &mut others, _) = sorted.select_nth_unstable_by(rank, f64::total_cmp);
    let is_alone = |&index: &usize| {
        let bend = bends[index];
        let near = &bends[index.saturating_sub(NEIGHBOURS)..(index + NEIGHBOURS + 1).min(bends.len())];
        let centre = index.min(NEIGHBOURS);
        let beside = near.iter().enumerate().filter(|(at, _)| at.abs_diff(centre) > 1);
        let beside_it = near.iter().enumerate().filter(|(at, _)| at.abs_diff(centre) == 1);
        bend > ABOVE_OTHERS * others
            && bend > 0.0
            && beside.clone().count() >= NEIGHBOURS
            && beside.into_iter().all(|(_, other)| ALONE * other < bend)
            && beside_it.into_iter().all(|(_, other)| 1.5 * other < bend)
    };
    // The bend at k is that of the change from row k + 1 to row k + 2.
    let rows: Vec<usize> = (0..bends.len()).filter(is_alone).map(|index| index + 2).collect();
    if rows.len() > MOST.max(values.len() / ROWS_OF_ONE) { Vec::new() } else { rows }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(of: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..2000).map(|row| of(f64::from(row))).collect()
    }

    #[test]
    fn a_reset_is_seen_and_a_motion_is_none() {
        let jitter = |row: f64| (43_758.545_3 * (12.989_8 * row).sin()).rem_euclid(1.0) - 0.5;
        let swing = |row: f64| 0.5 * (0.02 * row).sin() + 1e-5 * jitter(row);
        let set_at = |row: f64, size: f64| if row >= 700.0 { swing(row) + size } else { swing(row) };
        assert_eq!(resets(&series(|row| set_at(row, 0.02)), Some(TAU)), [700]);
        assert_eq!(resets(&series(|row| set_at(row, TAU)), Some(TAU)), [0_usize; 0], "a whole turn");
        assert!(resets(&series(swing), Some(TAU)).is_empty());
        // A table that starts to turn, one that jerks on for a while, noise, angles of coarse steps, and one that is held.
        for motion in [
            &(|row: f64| if row > 700.0 { 0.01 * (row - 700.0) } else { 0.0 }) as &dyn Fn(f64) -> f64,
            &|row| 0.02 * (row - 700.0).clamp(0.0, 3.0),
            &|row| jitter(row),
            &|row| (row / 40.0).floor() * 0.01,
            &|row| (0.3 * (row / 5.0).floor()).sin(),
        ] {
            assert!(resets(&series(motion), None).is_empty());
        }
    }
}
