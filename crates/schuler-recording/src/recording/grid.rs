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
/// Rows whose median step is the nominal one where the case gives none; a million, so that longer tables need not be kept.
const MEDIAN_ROWS: usize = 1 << 20;
/// Rows that may be put in whatever the length of the table: one wrong time stamp must not make gigabytes of a small file.
const MOST_INSERTED: f64 = 2e5;
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

/// What the times of a table say, looked at in order and not kept.
pub(super) struct Survey {
    column: String,
    nominal_s: Option<f64>,
    /// Nominal step once it is known, s.
    step_s: Option<f64>,
    /// Distances of the rows until then, s.
    distances_s: Vec<f64>,
    start_s: Option<f64>,
    last_s: Option<f64>,
    line: Option<usize>,
    rows: usize,
    missing: f64,
    /// The longest distance: row and line behind it, and its length in seconds.
    longest: (usize, Option<usize>, f64),
}

/// What the times of a table are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Times {
    /// Nominal step, s.
    pub(super) step_s: f64,
    /// First time, s.
    pub(super) start_s: f64,
    /// Rows, recorded and to be put in.
    pub(super) rows: usize,
}

impl Survey {
    /// Of a time column; without a nominal step, that is the median of the first [`MEDIAN_ROWS`].
    pub(super) fn new(column: &str, nominal_s: Option<f64>) -> Self {
        Self {
            column: column.to_owned(),
            nominal_s,
            step_s: None,
            distances_s: Vec::new(),
            start_s: None,
            last_s: None,
            line: None,
            rows: 0,
            missing: 0.0,
            longest: (0, None, 0.0),
        }
    }

    /// Looks at the next times, in the rows at these lines of the table.
    ///
    /// # Errors
    /// A time that is missing or does not increase. A problem without a line is one of the nominal step.
    pub(super) fn add(&mut self, time_s: &[f64], lines: &[u64]) -> Result<(), Problem> {
        for (index, &time) in time_s.iter().enumerate() {
            self.rows += 1;
            self.line = lines.get(index).map(|&line| line as usize);
            if !time.is_finite() {
                return Err(self.problem(format!("row {}: found no time; expected seconds", self.rows)));
            }
            if let Some(last_s) = self.last_s {
                if time <= last_s {
                    let found = format!("row {}: found time {time} after {last_s}", self.rows);
                    return Err(self.problem(format!("{found}; expected a time that strictly increases")));
                }
                self.add_distance(time - last_s)?;
            }
            self.start_s.get_or_insert(time);
            self.last_s = Some(time);
        }
        Ok(())
    }

    /// What was seen.
    ///
    /// # Errors
    /// Fewer than two rows, or a gap too long to be filled. A problem without a line is one of the nominal step.
    pub(super) fn finish(mut self) -> Result<Times, Problem> {
        let step_s = match self.step_s {
            Some(step_s) => step_s,
            None => self.settle()?,
        };
        let allowed = MOST_INSERTED.max(MOST_INSERTED_PER_ROW * self.rows as f64);
        if self.missing > allowed {
            let (row, line, jump_s) = self.longest;
            let found = format!("row {row}: found a jump of {jump_s} s, {:.0} steps", jump_s / step_s);
            let message = format!("{found}; expected a gap that can be filled: split the table");
            return Err(Problem::new(line, self.column, message));
        }
        let start_s = self.start_s.unwrap_or_default();
        Ok(Times { step_s, start_s, rows: self.rows + self.missing as usize })
    }

    fn add_distance(&mut self, distance_s: f64) -> Result<(), Problem> {
        if distance_s > self.longest.2 {
            self.longest = (self.rows, self.line, distance_s);
        }
        if let Some(step_s) = self.step_s {
            self.missing += missing(distance_s, step_s);
        } else {
            self.distances_s.push(distance_s);
            if self.distances_s.len() == MEDIAN_ROWS {
                self.settle()?;
            }
        }
        Ok(())
    }

    /// Decides on the nominal step.
    fn settle(&mut self) -> Result<f64, Problem> {
        let mut distances_s = std::mem::take(&mut self.distances_s);
        let Some(median_s) = median(&mut distances_s) else {
            return Err(self.problem(format!("found {} rows; expected at least two", self.rows)));
        };
        let step_s = self.nominal_s.unwrap_or(median_s);
        if median_s < LEAST_MEDIAN_STEPS * step_s {
            let message = format!("found {step_s}; expected about {median_s}, the table's median step");
            return Err(Problem::of_file(message));
        }
        self.missing = distances_s.iter().map(|&distance_s| missing(distance_s, step_s)).sum();
        self.step_s = Some(step_s);
        Ok(step_s)
    }

    fn problem(&self, message: String) -> Problem {
        Problem::new(self.line, &*self.column, message)
    }
}

/// Rows that are missing between two neighbours.
fn missing(distance_s: f64, step_s: f64) -> f64 {
    if distance_s > GAP_STEPS * step_s { ((distance_s / step_s).round() - 1.0).max(1.0) } else { 0.0 }
}

/// Goes from one recorded row to the next over the rows that are missing between them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    step_s: f64,
    last_s: Option<f64>,
    /// Rows put in between the last recorded row and the next.
    put_in: usize,
}

impl Walk {
    pub(super) fn new(step_s: f64) -> Self {
        Self { step_s, last_s: None, put_in: 0 }
    }

    /// The time of the row that is to be put in before the one recorded at `time`; none when it is the turn of that.
    pub(super) fn before(&mut self, time: f64) -> Option<f64> {
        if let Some(last_s) = self.last_s {
            let missing = missing(time - last_s, self.step_s) as usize;
            if self.put_in < missing {
                self.put_in += 1;
                return Some(last_s + (time - last_s) / (missing + 1) as f64 * self.put_in as f64);
            }
        }
        self.put_in = 0;
        self.last_s = Some(time);
        None
    }
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
        recorded_s: &[f64],
        lines: &[u64],
        nominal_s: Option<f64>,
    ) -> Result<Self, Problem> {
        let mut survey = Survey::new(column, nominal_s);
        survey.add(recorded_s, lines)?;
        let Times { step_s, rows, .. } = survey.finish()?;
        let mut grid = Self { step_s, time_s: Vec::with_capacity(rows), gaps: Vec::new() };
        let mut walk = Walk::new(step_s);
        for &time in recorded_s {
            let (first, after_s) = (grid.time_s.len(), walk.last_s.unwrap_or(time));
            while let Some(put_in) = walk.before(time) {
                grid.time_s.push(put_in);
            }
            let missing = grid.time_s.len() - first;
            if missing > 0 {
                grid.gaps.push(Gap { first, missing, after_s, before_s: time });
            }
            grid.time_s.push(time);
        }
        Ok(grid)
    }

    /// The column of recorded `values` with NaN in the rows put in.
    pub(super) fn spread(&self, values: Vec<f64>) -> Vec<f64> {
        if self.gaps.is_empty() {
            return values;
        }
        let missing: usize = self.gaps.iter().map(|gap| gap.missing).sum();
        let mut spread = Vec::with_capacity(values.len() + missing);
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

fn median(values: &mut [f64]) -> Option<f64> {
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
