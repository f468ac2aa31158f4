//! The stamps of a table made times: in seconds, and with the remedy that the case states for those that come twice or late.
use std::path::PathBuf;

use super::layout::TIME;
use crate::case::{CaseFile, Duplicates, TimeUnit};
use crate::error::{Error, Problem, rounded};
use crate::table::{Chunks, Columns};

/// Seconds since 1970 from 1990 to 2100: stamps of today in whatever unit they are.
const EPOCH_S: std::ops::Range<f64> = 6.3e8..4.1e9;
/// Steps that the sensors read here have, s; whole numbers further apart are of a smaller unit.
const STEPS_S: std::ops::RangeInclusive<f64> = 5e-5..=0.5;
/// Steps that a name's unit may lead to, s.
const CREDIBLE_STEPS_S: std::ops::RangeInclusive<f64> = 1e-6..=1e5;
/// Whole steps from here on are asked for their unit.
const ASKED_FROM: f64 = 2.0;
/// Whole steps from here on, which are no parts or multiples of an hour, are not of seconds.
const NOT_SECONDS_FROM: f64 = 500.0;
const HOUR_S: f64 = 3600.0;
/// Longest step of hours or days, s.
const LONGEST_STEP_S: f64 = 1e6;
/// Steps, of which one may be a jump, that can tell a unit.
const FEWEST_STEPS: usize = 3;
/// How far a step may be from the one that the case states for its unit to be told by that.
const NEAR_STATED: std::ops::Range<f64> = 0.1..10.0;
/// Rows that may come late, as a part of all, before the clock is taken to go back for good.
const MOST_LATE: f64 = 0.1;
const FEW_LATE: usize = 10;

/// Rows of a table whose times are in seconds; those that come twice or late are treated as the case says.
pub(super) struct Timed {
    rest: Chunks,
    path: PathBuf,
    column: String,
    /// Whether rows are counted, and their times are multiples of the stated step.
    counted: bool,
    stated: Option<TimeUnit>,
    /// The step that the case states, s.
    step_s: Option<f64>,
    /// Seconds of a unit, once it is known.
    unit_s: Option<f64>,
    duplicates: Option<Duplicates>,
    last_s: Option<f64>,
    /// The last row with the number of values in each of its sums, where repeated rows are averaged.
    sums: Option<(Columns, Vec<f64>)>,
    width: usize,
    rows: usize,
    repeated: usize,
    late: usize,
    first_late: Option<u64>,
    ended: bool,
}

impl Timed {
    /// Of rows whose first column is the time, or the number of the row where the case has no column of time.
    pub(super) fn new(file: &CaseFile, rest: Chunks) -> Self {
        let source = &file.case.recording;
        Self {
            rest,
            path: file.table_path(),
            column: source.time_name().to_owned(),
            counted: source.time.is_none(),
            stated: source.time_unit,
            step_s: source.step_s,
            unit_s: None,
            duplicates: source.duplicates,
            last_s: None,
            sums: None,
            width: 0,
            rows: 0,
            repeated: 0,
            late: 0,
            first_late: None,
            ended: false,
        }
    }

    /// Makes the times of a chunk seconds.
    fn in_seconds(&mut self, columns: &mut Columns) {
        let Some(stamps) = columns.values.get_mut(TIME).filter(|stamps| !stamps.is_empty()) else {
            return;
        };
        if self.counted {
            let step_s = self.step_s.unwrap_or(1.0);
            for row in stamps.iter_mut() {
                *row *= step_s;
            }
            return;
        }
        let unit_s = self.unit_s.unwrap_or_else(|| {
            let (unit, why) = match self.stated {
                Some(unit) => (unit, None),
                None => guessed(&self.column, stamps, self.step_s),
            };
            let said = why.map(|why| format!("{}: {}: {why}", self.path.display(), self.column));
            columns.warnings.extend(said);
            unit.in_seconds()
        });
        self.unit_s = Some(unit_s);
        if unit_s != 1.0 {
            // Divided, as the reciprocals of these units are whole numbers, so that each is rounded once.
            let per_s = unit_s.recip().round();
            for stamp in stamps.iter_mut() {
                *stamp /= per_s;
            }
        }
    }

    /// What is left of a chunk.
    fn remedied(&mut self, columns: &Columns, duplicates: Duplicates) -> Columns {
        self.width = columns.values.len();
        let mut kept = Columns::none(self.width);
        kept.warnings.clone_from(&columns.warnings);
        kept.infinite.clone_from(&columns.infinite);
        for (index, &line) in columns.lines.iter().enumerate() {
            self.rows += 1;
            let time_s = columns.values[TIME][index];
            let values = || columns.values.iter().map(|values| values[index]);
            match self.last_s {
                Some(last_s) if time_s < last_s => {
                    self.late += 1;
                    self.first_late.get_or_insert(line);
                    continue;
                }
                Some(last_s) if time_s == last_s => {
                    self.repeated += 1;
                    self.add_to_sums(values());
                    continue;
                }
                _ => {}
            }
            self.last_s = Some(time_s);
            match duplicates {
                Duplicates::Drop => push(&mut kept, values(), line),
                Duplicates::Average => {
                    self.flush_into(&mut kept);
                    let mut row = Columns::none(columns.values.len());
                    push(&mut row, values(), line);
                    self.sums = Some((row, values().map(|value| f64::from(!value.is_nan())).collect()));
                }
            }
        }
        kept
    }

    /// Adds a row to the last one, where rows are averaged.
    fn add_to_sums(&mut self, values: impl Iterator<Item = f64>) {
        let Some((row, counts)) = &mut self.sums else { return };
        for ((sum, count), value) in row.values.iter_mut().zip(counts).zip(values) {
            let Some(sum) = sum.first_mut().filter(|_| !value.is_nan()) else { continue };
            *sum = if *count == 0.0 { value } else { *sum + value };
            *count += 1.0;
        }
    }

    fn flush_into(&mut self, kept: &mut Columns) {
        let Some((row, counts)) = self.sums.take() else { return };
        let means = (row.values.iter().zip(counts)).map(|(sum, count)| {
            let sum = sum.first().copied().unwrap_or(f64::NAN);
            if count > 1.0 { sum / count } else { sum }
        });
        push(kept, means, row.lines.first().copied().unwrap_or_default());
    }

    /// What is left when nothing follows.
    fn end(&mut self) -> Option<Result<Columns, Error>> {
        self.ended = true;
        let duplicates = self.duplicates?;
        if self.late > FEW_LATE && self.late as f64 > MOST_LATE * self.rows as f64 {
            let message = format!(
                "found {} of {} rows earlier than rows before them, this one the first; expected a clock that goes on: split the table where it goes back",
                self.late, self.rows
            );
            let line = self.first_late.map(|line| line as usize);
            return Some(Err(Error::one(&self.path, Problem::new(line, &*self.column, message))));
        }
        let mut kept = Columns::none(self.width);
        self.flush_into(&mut kept);
        kept.warnings = self.said(duplicates);
        Some(Ok(kept))
    }

    fn said(&self, duplicates: Duplicates) -> Vec<String> {
        let done = match duplicates {
            Duplicates::Drop => "left out",
            Duplicates::Average => "averaged into one",
        };
        let repeated = format!("rows with the time of the row before are {done}");
        let late = "rows earlier than rows before them are left out".to_owned();
        [(self.repeated, repeated), (self.late, late)]
            .into_iter()
            .filter(|&(count, _)| count > 0)
            .map(|(count, what)| format!("{}: {}: {count} {what}", self.path.display(), self.column))
            .collect()
    }
}

impl Iterator for Timed {
    type Item = Result<Columns, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let mut columns = match self.rest.next() {
            Some(Ok(columns)) => columns,
            Some(Err(error)) => {
                self.ended = true;
                return Some(Err(error));
            }
            None => return self.end(),
        };
        leave_out_empty(&mut columns);
        self.in_seconds(&mut columns);
        let Some(duplicates) = self.duplicates else { return Some(Ok(columns)) };
        Some(Ok(self.remedied(&columns, duplicates)))
    }
}

/// Leaves out rows that have a time and nothing else: they say as much as rows that are not there, and are to give the same answer.
fn leave_out_empty(columns: &mut Columns) {
    if columns.values.len() < 2 {
        return;
    }
    let says = |row: usize| {
        let mut others = columns.values.iter().skip(TIME + 1);
        others.any(|values| values.get(row).is_some_and(|value| !value.is_nan()))
    };
    let kept: Vec<bool> = (0..columns.rows()).map(says).collect();
    if kept.iter().all(|kept| *kept) {
        return;
    }
    for values in &mut columns.values {
        let mut kept = kept.iter();
        values.retain(|_| kept.next() == Some(&true));
    }
    let mut kept = kept.iter();
    columns.lines.retain(|_| kept.next() == Some(&true));
}

fn push(columns: &mut Columns, values: impl Iterator<Item = f64>, line: u64) {
    for (column, value) in columns.values.iter_mut().zip(values) {
        column.push(value);
    }
    columns.lines.push(line);
}

/// The unit of stamps of which nothing is stated, by the name of their column and what they are, and what the user should be told
/// of it, where they are not of seconds, or may not be.
pub fn unit_of_stamps(column: &str, stamps: &[f64]) -> (TimeUnit, Option<String>) {
    guessed(column, stamps, None)
}

/// The same, where the case may state the step, s.
fn guessed(column: &str, stamps: &[f64], step_s: Option<f64>) -> (TimeUnit, Option<String>) {
    let seconds = (TimeUnit::Second, None);
    let present: Vec<f64> = stamps.iter().copied().filter(|stamp| stamp.is_finite()).collect();
    let Some(&first) = present.first() else { return seconds };
    let mut steps: Vec<f64> =
        present.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0).collect();
    let step = super::clock::median(&mut steps).unwrap_or(f64::NAN);
    let or_say = |unit: TimeUnit| format!("; say recording.time_unit = \"{unit}\", or another, to be sure");
    let told = |unit: TimeUnit, why: String| {
        (unit, Some(format!("the stamps are taken for {}{}", why, or_say(unit))))
    };
    let credible =
        |unit: &TimeUnit| !step.is_finite() || CREDIBLE_STEPS_S.contains(&(step * unit.in_seconds()));
    let smaller = || [TimeUnit::Millisecond, TimeUnit::Microsecond, TimeUnit::Nanosecond].into_iter();
    if let Some(unit) = unit_in_name(column).filter(credible) {
        return if unit == TimeUnit::Second {
            seconds
        } else {
            told(unit, format!("{unit}, as their column is called"))
        };
    }
    let of_today = |unit: &TimeUnit| EPOCH_S.contains(&(first * unit.in_seconds()));
    if let Some(unit) = smaller().find(|unit| of_today(unit) && credible(unit)) {
        let year = 1970.0 + first * unit.in_seconds() / 31_556_952.0;
        return told(unit, format!("{unit} since 1970, which begin in {year:.0}"));
    }
    if let Some(step_s) = step_s.filter(|_| steps.len() >= FEWEST_STEPS) {
        let near = |unit: &TimeUnit| NEAR_STATED.contains(&(step * unit.in_seconds() / step_s));
        return match smaller().find(near) {
            Some(unit) => told(unit, format!("{unit}, of which {step} are near recording.step_s = {step_s}")),
            None => seconds,
        };
    }
    let whole = present.iter().all(|stamp| stamp.fract() == 0.0);
    if !whole || !step.is_finite() || step < ASKED_FROM || EPOCH_S.contains(&first) {
        return seconds;
    }
    let of_sensors = |unit: &TimeUnit| STEPS_S.contains(&(step * unit.in_seconds()));
    let Some(unit) = smaller().find(of_sensors) else { return seconds };
    let small_s = rounded(step * unit.in_seconds());
    let of_hours = step <= LONGEST_STEP_S && (HOUR_S % step == 0.0 || step % HOUR_S == 0.0);
    if step < NOT_SECONDS_FROM || of_hours {
        let why = format!("s: whole numbers {step} apart are steps of {step} s, or of {small_s} s in {unit}");
        return told(TimeUnit::Second, why);
    }
    told(unit, format!("{unit}: whole numbers {step} apart are steps of {small_s} s"))
}

/// The unit that stands at the end of the name of a time column: `t [ns]`, `time_us`, `TimeUS`, `stamp(ms)`.
fn unit_in_name(name: &str) -> Option<TimeUnit> {
    let name = name.trim().trim_end_matches([']', ')', '}']);
    let lower = name.to_lowercase();
    let named = |ending: &str| match ending {
        "s" | "sec" | "secs" | "second" | "seconds" => Some(TimeUnit::Second),
        "ms" | "msec" | "millis" | "milliseconds" => Some(TimeUnit::Millisecond),
        "us" | "µs" | "μs" | "usec" | "micros" | "microseconds" => Some(TimeUnit::Microsecond),
        "ns" | "nsec" | "nanos" | "nanoseconds" => Some(TimeUnit::Nanosecond),
        _ => None,
    };
    if let Some((_, ending)) = lower.rsplit_once(['_', ' ', '[', '(', '{', '.', '/', '-']) {
        return named(ending.trim());
    }
    // `TimeUS`, `timeMs`: the unit begins with a capital behind a small letter.
    let at = (name.char_indices().zip(name.chars().skip(1)))
        .filter(|((_, before), after)| before.is_lowercase() && after.is_uppercase())
        .map(|((at, before), _)| at + before.len_utf8())
        .last()?;
    named(&name.get(at..)?.to_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(first: f64, step: f64) -> Vec<f64> {
        (0..50).map(|row| first + step * f64::from(row)).collect()
    }

    #[test]
    fn units_are_read_from_names() {
        for (name, unit) in [
            ("#timestamp [ns]", TimeUnit::Nanosecond),
            ("TimeUS", TimeUnit::Microsecond),
            ("time_boot_ms", TimeUnit::Millisecond),
            ("t (µs)", TimeUnit::Microsecond),
            ("field.header.nsec", TimeUnit::Nanosecond),
            ("t_s", TimeUnit::Second),
        ] {
            assert_eq!(unit_in_name(name), Some(unit), "{name}");
        }
        for name in ["t", "time", "status", "sensor_gyro_0.timestamp", "GPS", "times", "/imu@log_time"] {
            assert_eq!(unit_in_name(name), None, "{name}");
        }
    }

    #[test]
    fn units_are_guessed_from_stamps_and_said() {
        for (first, step, unit) in [
            (1.403_636_579_758e18, 5e6, TimeUnit::Nanosecond),
            (1.403_636_579_758e15, 5e3, TimeUnit::Microsecond),
            (1.403_636_579_758e12, 5.0, TimeUnit::Millisecond),
            (0.0, 2500.0, TimeUnit::Microsecond),
            (183_746_000.0, 4_000_000.0, TimeUnit::Nanosecond),
        ] {
            let (found, said) = guessed("t", &steps(first, step), None);
            assert_eq!(found, unit, "{first} {step}");
            assert!(said.unwrap().contains(&format!("time_unit = \"{unit}\"")));
        }
        for (first, step) in [(0.0, 0.01), (0.0, 1.0), (1.7e9, 1.0), (1.7e9, 3600.0)] {
            assert_eq!(guessed("t", &steps(first, step), None), (TimeUnit::Second, None), "{first} {step}");
        }
        // Eighteen million hours are no step, of nanoseconds they are 18 ms.
        assert_eq!(guessed("t", &steps(0.0, 1.8e7), None).0, TimeUnit::Nanosecond);
    }

    /// Steps of 2 to 500 may be of seconds or of milliseconds: it is said, unless the case states the step.
    #[test]
    fn steps_that_may_be_of_seconds_or_less_are_said_or_told_by_the_stated_step() {
        for (step, other) in
            [(2.0, "ms"), (10.0, "ms"), (66.0, "ms"), (400.0, "ms"), (900.0, "us"), (86_400.0, "us")]
        {
            let stamps = steps(0.0, step);
            let (found, said) = guessed("t", &stamps, None);
            let said = said.unwrap_or_default();
            assert_eq!(found, TimeUnit::Second, "{step}");
            assert!(said.contains(&format!("s in {other}; say recording.time_unit = \"s\"")), "{said}");
            assert_eq!(guessed("t", &stamps, Some(step)), (TimeUnit::Second, None), "{step}");
            let (found, said) = guessed("t", &stamps, Some(step / 1000.0));
            assert_eq!(found, TimeUnit::Millisecond, "{step}");
            assert!(said.is_some_and(|said| said.contains("recording.step_s")), "{step}");
        }
        // Of milliseconds with decimals.
        assert_eq!(guessed("t", &steps(0.25, 10.04), Some(0.01)).0, TimeUnit::Millisecond);
        // A jump is no step.
        assert_eq!(guessed("t", &[0.0, 1e9], Some(1.0)), (TimeUnit::Second, None));
        // A step that fits no unit is not for the unit to mend.
        assert_eq!(guessed("t", &steps(0.0, 50.0), Some(1.0)), (TimeUnit::Second, None));
        // A name that the stamps contradict says nothing.
        assert_eq!(guessed("time_ns", &steps(0.0, 0.01), None).0, TimeUnit::Second);
    }
}
