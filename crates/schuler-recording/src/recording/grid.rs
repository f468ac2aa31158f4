//! The steps of a recording: the times of its rows, and rows put in where steps are missing.
//!
//! Clocks are not metronomes: a step of 1.0025 s under a nominal 1 s, stamps 66, 67 and 69 s apart under a nominal
//! 66 s. Recorded times are therefore not moved, unless they are those of arrival ([`super::clock`]). Two neighbours more than
//! 1.5 steps apart have a gap between them, which is filled with the missing rows: `round(dt / step) − 1` of them, at least one,
//! equally spaced from neighbour to neighbour, so that index differences count steps on both sides of every gap.
use super::clock::Clock;
use super::even::{EvenWalk, Lost, LostRows};
use crate::error::{Problem, rounded};

/// Neighbours further apart than this many nominal steps have a gap between them.
pub const GAP_STEPS: f64 = 1.5;
/// Rows whose stamps show the clock; a million, so that longer tables need not be kept.
const CLOCK_ROWS: usize = 1 << 20;
/// What the case may say of stamps that do not increase.
const REMEDY: &str = "state recording.duplicates, \"drop\" or \"average\", where messages come twice or late";
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
    /// The times until the clock is known, s.
    stamps_s: Vec<f64>,
    /// What follows the rows once it is.
    counter: Option<Counter>,
    start_s: Option<f64>,
    last_s: Option<f64>,
    line: Option<usize>,
    rows: usize,
    /// The first time that is that of the row before, which only an even clock allows.
    repeated: Option<Problem>,
    /// The longest distance: row and line behind it, and its length in seconds.
    longest: (usize, Option<usize>, f64),
}

/// Counts the rows that are missing.
enum Counter {
    Stamped { clock: Clock, missing: f64 },
    Even { clock: Clock, search: Box<LostRows> },
}

/// What the times of a table are.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Times {
    /// Step, s.
    pub(super) step_s: f64,
    /// First time, s.
    pub(super) start_s: f64,
    /// Rows, recorded and to be put in.
    pub(super) rows: usize,
    /// How to go from row to row.
    pub(super) walk: Walk,
    /// What the user should be told.
    pub(super) note: Option<String>,
}

impl Survey {
    /// Of a time column; the clock is that of the first [`CLOCK_ROWS`].
    pub(super) fn new(column: &str, nominal_s: Option<f64>) -> Self {
        Self {
            column: column.to_owned(),
            nominal_s,
            stamps_s: Vec::new(),
            counter: None,
            start_s: None,
            last_s: None,
            line: None,
            rows: 0,
            repeated: None,
            longest: (0, None, 0.0),
        }
    }

    /// Looks at the next times, in the rows at these lines of the table.
    ///
    /// # Errors
    /// A time that is missing or goes back. A problem without a line is one of the nominal step.
    pub(super) fn add(&mut self, time_s: &[f64], lines: &[u64]) -> Result<(), Problem> {
        for (index, &time) in time_s.iter().enumerate() {
            self.rows += 1;
            self.line = lines.get(index).map(|&line| line as usize);
            if !time.is_finite() {
                return Err(self.problem(format!("row {}: found no time; expected seconds", self.rows)));
            }
            if let Some(last_s) = self.last_s {
                self.compare(time, last_s)?;
            }
            self.start_s.get_or_insert(time);
            self.last_s = Some(time);
            match &mut self.counter {
                None => {
                    self.stamps_s.push(time);
                    if self.stamps_s.len() == CLOCK_ROWS {
                        self.settle()?;
                    }
                }
                Some(Counter::Even { search, .. }) => search.add(time),
                Some(Counter::Stamped { .. }) => {}
            }
        }
        Ok(())
    }

    /// What was seen.
    ///
    /// # Errors
    /// Fewer than two rows, a time that comes twice, or a gap too long to be filled. A problem without a line is one of the
    /// nominal step.
    pub(super) fn finish(mut self) -> Result<Times, Problem> {
        if self.counter.is_none() {
            self.settle()?;
        }
        let start_s = self.start_s.unwrap_or_default();
        let (clock, missing, walk) = match self.counter.take() {
            Some(Counter::Even { clock, search }) => {
                let lost = search.lost();
                let missing = lost.iter().map(|&(_, count)| count as f64).sum();
                let walk = Walk::even(&clock, lost);
                (clock, missing, walk)
            }
            Some(Counter::Stamped { clock, missing }) => {
                let walk = Walk::new(clock.step_s);
                (clock, missing, walk)
            }
            None => return Err(self.problem("found no clock; expected increasing times".to_owned())),
        };
        let step_s = clock.step_s;
        let allowed = MOST_INSERTED.max(MOST_INSERTED_PER_ROW * self.rows as f64);
        if missing > allowed {
            let (row, line, jump_s) = self.longest;
            let found =
                format!("row {row}: found a jump of {} s, {:.0} steps", rounded(jump_s), jump_s / step_s);
            let message = format!(
                "{found}; expected a gap that can be filled: split the table, or state its recording.step_s"
            );
            return Err(Problem::new(line, self.column, message));
        }
        let start_s = walk.clone().next(start_s).0;
        Ok(Times { step_s, start_s, rows: self.rows + missing as usize, walk, note: clock.note })
    }

    /// Looks at a time beside the one before.
    fn compare(&mut self, time: f64, last_s: f64) -> Result<(), Problem> {
        let found = || format!("row {}: found time {time} after {last_s}", self.rows);
        if time <= last_s {
            let message = format!("{}; expected a time that strictly increases: {REMEDY}", found());
            let problem = self.problem(message);
            let even = matches!(self.counter, Some(Counter::Even { .. }));
            if time < last_s || self.counter.is_some() && !even {
                return Err(self.repeated.take().unwrap_or(problem));
            }
            self.repeated.get_or_insert(problem);
        }
        let distance_s = time - last_s;
        if distance_s > self.longest.2 {
            self.longest = (self.rows, self.line, distance_s);
        }
        if let Some(Counter::Stamped { clock, missing: all }) = &mut self.counter {
            *all += missing(distance_s, clock.step_s);
        }
        Ok(())
    }

    /// Decides on the clock.
    fn settle(&mut self) -> Result<(), Problem> {
        let stamps_s = std::mem::take(&mut self.stamps_s);
        if stamps_s.len() < 2 {
            return Err(self.problem(format!("found {} rows with values; expected at least two", self.rows)));
        }
        let clock = match Clock::of(&stamps_s, &self.column, self.nominal_s) {
            Ok(clock) => clock,
            // A time that comes twice is the nearer fault.
            Err(message) => return Err(self.repeated.take().unwrap_or_else(|| Problem::of_file(message))),
        };
        self.counter = Some(if let Some(even) = &clock.even {
            let mut search = Box::new(LostRows::new(even.clone()));
            for stamp_s in stamps_s {
                search.add(stamp_s);
            }
            Counter::Even { clock, search }
        } else {
            if let Some(problem) = self.repeated.take() {
                return Err(problem);
            }
            let missing = stamps_s.windows(2).map(|pair| missing(pair[1] - pair[0], clock.step_s)).sum();
            Counter::Stamped { clock, missing }
        });
        Ok(())
    }

    fn problem(&self, message: String) -> Problem {
        Problem::new(self.line, &*self.column, message)
    }
}

/// Rows that are missing between two neighbours.
pub(super) fn missing(distance_s: f64, step_s: f64) -> f64 {
    if distance_s > GAP_STEPS * step_s { ((distance_s / step_s).round() - 1.0).max(1.0) } else { 0.0 }
}

/// Goes from one recorded row to the next over the rows that are missing between them.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Walk {
    /// Along the stamps.
    Stamped {
        step_s: f64,
        last_s: Option<f64>,
        /// Rows put in between the last recorded row and the next.
        put_in: usize,
    },
    /// Along an even clock.
    Even(EvenWalk),
}

impl Default for Walk {
    fn default() -> Self {
        Self::new(0.0)
    }
}

impl Walk {
    /// Along stamps with this step.
    pub(super) fn new(step_s: f64) -> Self {
        Self::Stamped { step_s, last_s: None, put_in: 0 }
    }

    /// Along the even clock of a clock that has one.
    fn even(clock: &Clock, lost: Lost) -> Self {
        clock
            .even
            .clone()
            .map_or_else(|| Self::new(clock.step_s), |even| Self::Even(EvenWalk::new(even, lost)))
    }

    /// The time of the next row, and whether it is put in before the one recorded with the stamp `stamp_s` or is that.
    pub(super) fn next(&mut self, stamp_s: f64) -> (f64, bool) {
        let (step_s, last_s, put_in) = match self {
            Self::Even(walk) => return walk.next(stamp_s),
            Self::Stamped { step_s, last_s, put_in } => (*step_s, last_s, put_in),
        };
        if let Some(last_s) = *last_s {
            let missing = missing(stamp_s - last_s, step_s) as usize;
            if *put_in < missing {
                *put_in += 1;
                return (last_s + (stamp_s - last_s) / (missing + 1) as f64 * *put_in as f64, true);
            }
        }
        *put_in = 0;
        *last_s = Some(stamp_s);
        (stamp_s, false)
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
    /// What the user should be told.
    pub(super) note: Option<String>,
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
        let Times { step_s, rows, mut walk, note, .. } = survey.finish()?;
        let mut grid = Self { step_s, time_s: Vec::with_capacity(rows), gaps: Vec::new(), note };
        for &stamp_s in recorded_s {
            let first = grid.time_s.len();
            let time_s = loop {
                let (time_s, put_in) = walk.next(stamp_s);
                if !put_in {
                    break time_s;
                }
                grid.time_s.push(time_s);
            };
            let missing = grid.time_s.len() - first;
            if missing > 0 {
                let after_s =
                    first.checked_sub(1).and_then(|last| grid.time_s.get(last)).copied().unwrap_or(time_s);
                grid.gaps.push(Gap { first, missing, after_s, before_s: time_s });
            }
            grid.time_s.push(time_s);
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
