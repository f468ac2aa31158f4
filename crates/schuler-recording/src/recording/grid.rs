//! The steps of a recording: the recorded times, and rows put in where steps are missing.
//!
//! Clocks are not metronomes: a step of 1.0025 s under a nominal 1 s, stamps 66, 67 and 69 s apart under a nominal
//! 66 s. Recorded times are therefore never moved. Two neighbours more than 1.5 nominal steps apart have a gap
//! between them, which is filled with the missing rows: `round(dt / step) − 1` of them, at least one, equally spaced
//! from neighbour to neighbour, so that index differences count steps on both sides of every gap.
use crate::error::Problem;

/// Neighbours further apart than this many nominal steps have a gap between them.
pub const GAP_STEPS: f64 = 1.5;
/// A table whose median step is below this many nominal steps contradicts its case.
const LEAST_MEDIAN_STEPS: f64 = 0.5;
/// Rows that may be put in whatever the length of the table.
const MOST_INSERTED: f64 = 1e6;
/// Rows that may be put in for each recorded one, where that is more.
const MOST_INSERTED_PER_ROW: f64 = 20.0;

/// Steps that are missing between two recorded rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Index of the first row put in.
    pub first: usize,
    /// Number of rows put in.
    pub missing: usize,
    /// Time of the last row before it, s.
    pub after_s: f64,
    /// Time of the first row behind it, s.
    pub before_s: f64,
}

/// The steps of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Grid {
    /// Nominal step, s.
    pub(super) step_s: f64,
    /// Time of each row, recorded or put in, s.
    pub(super) time_s: Vec<f64>,
    /// The gaps, in order.
    pub(super) gaps: Vec<Gap>,
}

impl Grid {
    /// The grid of the recorded times `time_s` in the rows at `lines` of the table, whose time column is `column`.
    ///
    /// # Errors
    /// A time that is missing or does not increase, too few of them, a gap too long to be filled. A problem without
    /// a line is one of the nominal step.
    pub(super) fn new(
        column: &str,
        time_s: &[f64],
        lines: &[u64],
        step_s: Option<f64>,
    ) -> Result<Self, Problem> {
        let problem_at = |row: usize, message: String| {
            Problem::new(lines.get(row).map(|&line| line as usize), column, message)
        };
        for (row, time) in time_s.iter().enumerate() {
            if !time.is_finite() {
                return Err(problem_at(row, format!("row {}: found no time; expected seconds", row + 1)));
            }
        }
        for (row, (before, after)) in time_s.iter().zip(time_s.iter().skip(1)).enumerate() {
            if after <= before {
                let found = format!("row {}: found time {after} after {before}", row + 2);
                return Err(problem_at(row + 1, format!("{found}; expected a time that strictly increases")));
            }
        }
        let median_s =
            median(time_s.iter().zip(time_s.iter().skip(1)).map(|(before, after)| after - before).collect());
        let Some(median_s) = median_s else {
            let message = format!("found {} rows; expected at least two", time_s.len());
            return Err(problem_at(0, message));
        };
        let step_s = step_s.unwrap_or(median_s);
        if median_s < LEAST_MEDIAN_STEPS * step_s {
            return Err(Problem::of_file(format!(
                "found {step_s}; expected about {median_s}, the table's median step"
            )));
        }
        Self::fill(time_s, step_s).map_err(|(row, jump_s)| {
            let found = format!("row {}: found a jump of {jump_s} s", row + 1);
            problem_at(
                row,
                format!(
                    "{found}, {:.0} steps; expected a gap that can be filled: split the table",
                    jump_s / step_s
                ),
            )
        })
    }

    /// Puts the missing rows in; a gap too long for that is given by the row behind it and its length in seconds.
    fn fill(recorded_s: &[f64], step_s: f64) -> Result<Self, (usize, f64)> {
        let allowed = MOST_INSERTED.max(MOST_INSERTED_PER_ROW * recorded_s.len() as f64);
        let mut grid = Self { step_s, time_s: Vec::with_capacity(recorded_s.len()), gaps: Vec::new() };
        let mut inserted = 0.0;
        let mut last: Option<f64> = None;
        for (row, &time) in recorded_s.iter().enumerate() {
            if let Some(after_s) = last.filter(|&last| time - last > GAP_STEPS * step_s) {
                let jump_s = time - after_s;
                let missing = ((jump_s / step_s).round() - 1.0).max(1.0);
                inserted += missing;
                if inserted > allowed {
                    return Err((row, jump_s));
                }
                let missing = missing as usize;
                grid.gaps.push(Gap { first: grid.time_s.len(), missing, after_s, before_s: time });
                let spacing = jump_s / (missing + 1) as f64;
                grid.time_s.extend((1..=missing).map(|k| after_s + spacing * k as f64));
            }
            grid.time_s.push(time);
            last = Some(time);
        }
        Ok(grid)
    }

    /// The column of recorded `values` with NaN in the rows put in.
    pub(super) fn spread(&self, values: Vec<f64>) -> Vec<f64> {
        if self.gaps.is_empty() {
            return values;
        }
        let mut spread = Vec::with_capacity(self.time_s.len());
        let mut values = values.into_iter();
        for gap in &self.gaps {
            let before = gap.first - spread.len();
            spread.extend(values.by_ref().take(before));
            spread.resize(spread.len() + gap.missing, f64::NAN);
        }
        spread.extend(values);
        spread
    }

    /// Which rows were put in.
    pub(super) fn inserted(&self) -> Vec<bool> {
        let mut inserted = vec![false; self.time_s.len()];
        for gap in &self.gaps {
            inserted.iter_mut().skip(gap.first).take(gap.missing).for_each(|row| *row = true);
        }
        inserted
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let (_, median, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*median)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(time_s: &[f64], step_s: Option<f64>) -> Result<Grid, Problem> {
        let lines: Vec<u64> = (2..).take(time_s.len()).collect();
        Grid::new("t", time_s, &lines, step_s)
    }

    #[test]
    fn jitter_is_kept_and_is_no_gap() {
        let time_s = [0.0, 69.0, 135.0, 201.0, 268.0];
        let grid = grid(&time_s, Some(66.0)).unwrap();
        assert_eq!(grid.time_s, time_s);
        assert!(grid.gaps.is_empty());
    }

    #[test]
    fn missing_steps_are_put_in_between_their_neighbours() {
        let grid = grid(&[0.0, 1.0, 4.2, 5.2], Some(1.0)).unwrap();
        assert_eq!(grid.gaps, [Gap { first: 2, missing: 2, after_s: 1.0, before_s: 4.2 }]);
        assert_eq!(grid.time_s.len(), 6);
        assert!((grid.time_s[2] - (1.0 + 3.2 / 3.0)).abs() < 1e-12);
        let spread = grid.spread(vec![10.0, 11.0, 14.0, 15.0]);
        assert_eq!(spread[1], 11.0);
        assert!(spread[2].is_nan() && spread[3].is_nan());
        assert_eq!(&spread[4..], [14.0, 15.0]);
        assert_eq!(grid.inserted(), [false, false, true, true, false, false]);
    }

    #[test]
    fn the_step_is_the_median_where_none_is_given() {
        assert_eq!(grid(&[0.0, 0.01, 0.02, 0.04], None).unwrap().gaps.len(), 1);
    }

    #[test]
    fn a_clock_that_stops_or_jumps_is_named_by_row() {
        let error = grid(&[0.0, 1.0, 1.0], Some(1.0)).unwrap_err();
        assert_eq!((error.line, error.field.as_str()), (Some(4), "t"));
        assert!(
            error.message.contains("row 3") && error.message.contains("strictly increases"),
            "{}",
            error.message
        );
        let error = grid(&[0.0, f64::NAN], Some(1.0)).unwrap_err();
        assert!(error.message.contains("row 2"), "{}", error.message);
        let error = grid(&[0.0, 1.0, 1e300], Some(1.0)).unwrap_err();
        assert!(error.message.contains("jump"), "{}", error.message);
        assert_eq!(grid(&[0.0, 0.01, 0.02], Some(1.0)).unwrap_err().line, None);
        assert!(grid(&[0.0], Some(1.0)).is_err());
        assert!(grid(&[], None).is_err());
    }
}
