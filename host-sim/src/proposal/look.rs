//! A table as far as a proposal needs it: time, rate, columns of numbers.
use std::path::{Path, PathBuf};

use schuler_recording::case::TimeUnit;
use schuler_recording::recording::unit_of_stamps;
use schuler_recording::table::{self, TableReader};
use schuler_recording::{Error, Leniency, Problem};

use super::column::{Guess, What, guess, key};

/// Part of a column's cells that must be numbers.
const LEAST_NUMBERS: f64 = 0.05;
/// Names of time, the likeliest first.
const TIMES: [&str; 14] = [
    "t",
    "time",
    "ts",
    "timestamp",
    "times",
    "tsec",
    "timesec",
    "timeseconds",
    "seconds",
    "datetime",
    "stamp",
    "elapsed",
    "sampletime",
    "date",
];
/// Names of counters of rows, which are whole numbers one after another and no time.
const COUNTERS: [&str; 14] = [
    "", "sample", "samples", "index", "row", "n", "k", "i", "count", "counter", "frame", "seq", "id",
    "unnamed0",
];
/// Rows that are read to learn what a table holds are all of it, but of its columns no more than this many.
const MOST_COLUMNS: usize = 400;

/// Difference between mean and median step, as a part of the median, from which on both are told.
const ANOTHER_MEAN: f64 = 0.01;

/// When the rows of a table are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Times<'t> {
    /// As the column says that looks like a time.
    #[default]
    Guessed,
    /// As this column says.
    Column(&'t str),
    /// Evenly spaced by this step, s, from 0.
    Step(f64),
}

impl<'t> Times<'t> {
    /// As the options of a command say, of which it takes one at most.
    pub fn stated(column: Option<&'t str>, step_s: Option<f64>) -> Self {
        match (step_s, column) {
            (Some(step_s), _) => Self::Step(step_s),
            (None, Some(column)) => Self::Column(column),
            (None, None) => Self::Guessed,
        }
    }

    fn column(self) -> Option<&'t str> {
        if let Self::Column(column) = self { Some(column) } else { None }
    }
}

/// What is known of a table.
#[derive(Clone, Debug)]
pub struct Look {
    /// The file.
    pub path: PathBuf,
    /// Name of the time column; none where the rows are evenly spaced by a step that was stated.
    pub time: Option<String>,
    /// Unit of its stamps.
    pub time_unit: TimeUnit,
    /// Why they are taken for that, where it is not seconds or may not be.
    pub why_unit: Option<String>,
    /// First and last time, s.
    pub span_s: [f64; 2],
    /// Median distance of rows, or the step that was stated, s.
    pub step_s: f64,
    /// Number of rows.
    pub rows: usize,
    /// The columns of numbers that are not constant.
    pub columns: Vec<Column>,
    /// What was left out, and why.
    pub left_out: Vec<String>,
    /// Whether a row comes with the time of the one before, or an earlier one.
    pub repeats: bool,
}

/// A column of numbers.
#[derive(Clone, Debug)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// What it seems to be.
    pub guess: Guess,
    /// Its values.
    pub values: Vec<f64>,
}

/// Looks at a table, whose rows are at `times`.
///
/// # Errors
/// A table that cannot be read, that has no names, no time, or nothing beside it.
pub fn look_at(path: &Path, times: Times<'_>) -> Result<Look, Error> {
    // Columns of texts are left out of a proposal, and no reason to refuse a table.
    look_in(table::open_with(path, Leniency::Lenient)?, path, times)
}

/// Looks at a table that is open, which is called `path`.
///
/// # Errors
/// As [`look_at`].
pub fn look_in(table: Box<dyn TableReader>, path: &Path, times: Times<'_>) -> Result<Look, Error> {
    let time = times.column();
    let wanted =
        wanted(&*table, time).map_err(|message| Error::one(path, Problem::new(None, "--time", message)))?;
    let names: Vec<String> = wanted.iter().map(|&index| table.names()[index].clone()).collect();
    if names.iter().all(|name| name.trim().parse::<f64>().is_ok()) {
        let message =
            "found numbers where the names of the columns should be; expected a first line with names";
        return Err(Error::one(path, Problem::new(Some(1), "", message)));
    }
    let columns = table.read(&wanted)?;
    let rows = columns.rows();
    let (at, seconds, step_s, time_unit, why_unit) = if let Times::Step(step_s) = times {
        let seconds: Vec<f64> = (0..rows).map(|row| row as f64 * step_s).collect();
        (None, seconds, step_s, TimeUnit::Second, None)
    } else {
        let at = time_of(&names, &columns.values, time)
            .map_err(|message| Error::one(path, Problem::new(None, time.unwrap_or_default(), message)))?;
        let stamps = &columns.values[at];
        let (time_unit, why_unit) = unit_of_stamps(&names[at], stamps);
        let seconds: Vec<f64> = (stamps.iter().filter(|stamp| stamp.is_finite()))
            .map(|stamp| stamp * time_unit.in_seconds())
            .collect();
        let step_s = median_step(&seconds);
        (Some(at), seconds, step_s, time_unit, why_unit)
    };
    let mut look = Look {
        path: path.to_owned(),
        time: at.map(|at| names[at].clone()),
        time_unit,
        why_unit,
        span_s: [seconds.first(), seconds.last()].map(|time| time.copied().unwrap_or_default()),
        step_s,
        rows,
        columns: Vec::new(),
        left_out: Vec::new(),
        repeats: seconds.windows(2).any(|pair| pair[1] <= pair[0]),
    };
    for (index, (name, values)) in names.iter().zip(&columns.values).enumerate() {
        if Some(index) == at {
            continue;
        }
        let mut numbers = values.iter().copied().filter(|value| value.is_finite());
        let first = numbers.next();
        let count = values.iter().filter(|value| value.is_finite()).count();
        if (count as f64) < LEAST_NUMBERS * values.len() as f64 || first.is_none() {
            look.left_out.push(format!("{name} (no numbers)"));
        } else if numbers.all(|value| Some(value) == first) {
            look.left_out.push(format!("{name} (constant)"));
        } else if counts_rows(name, values) {
            look.left_out.push(format!("{name} (counts the rows)"));
        } else if increases(values)
            && TIMES.contains(&key(name).as_str())
            && guess(name, values).what == What::Other
        {
            look.left_out.push(format!("{name} (another time)"));
        } else {
            look.columns.push(Column {
                name: name.clone(),
                guess: guess(name, values),
                values: values.clone(),
            });
        }
    }
    if look.columns.is_empty() {
        let beside = if at.is_some() { "beside the time " } else { "" };
        let message = format!("found nothing {beside}that changes: {}", names.join(", "));
        return Err(Error::one(path, Problem::of_file(message)));
    }
    Ok(look)
}

/// The columns that stand in the same rows as the time.
fn wanted(table: &dyn TableReader, time: Option<&str>) -> Result<Vec<usize>, String> {
    let all = table.all();
    let mut wanted = match (all, time) {
        (Ok(all), None) => all,
        (Ok(mut all), Some(time)) => {
            let at = table.index(time)?;
            all.retain(|&index| index != at);
            all.insert(0, at);
            all
        }
        (Err(message), None) => return Err(message),
        (Err(_), Some(time)) => {
            // Of a log: the topic of the time.
            let at = table.index(time)?;
            let topic = time.rfind(['.', '@']).map_or(time, |end| &time[..end]);
            let of_topic =
                |name: &String| name.strip_prefix(topic).is_some_and(|rest| rest.starts_with(['.', '@']));
            let mut wanted = vec![at];
            let names = table.names().iter().enumerate();
            wanted
                .extend(names.filter(|(index, name)| *index != at && of_topic(name)).map(|(index, _)| index));
            wanted
        }
    };
    wanted.truncate(MOST_COLUMNS);
    Ok(wanted)
}

/// The place of the time among the columns.
fn time_of(names: &[String], values: &[Vec<f64>], stated: Option<&str>) -> Result<usize, String> {
    if stated.is_some() {
        // It was asked for first.
        return Ok(0);
    }
    let keys: Vec<String> = names.iter().map(|name| key(name)).collect();
    let named = TIMES.iter().find_map(|time| {
        (0..names.len()).find(|&it| {
            let own = names[it].rsplit(['.', '/', '@']).next().unwrap_or_default();
            // A temperature may be a T that rises.
            let is_quantity = guess(&names[it], &values[it]).what != What::Other;
            (keys[it] == *time || key(own) == *time) && goes_up(&values[it]) && !is_quantity
        })
    });
    let counters: Vec<usize> = (0..names.len()).filter(|&it| counts_rows(&names[it], &values[it])).collect();
    let rises = || (0..names.len()).find(|it| increases(&values[*it]) && !counters.contains(it));
    named.or_else(rises).ok_or_else(|| {
        let why = match counters.first() {
            Some(&counter) => format!("{} counts the rows, and no other increases from row to row", names[counter]),
            None => "none increases from row to row".to_owned(),
        };
        format!(
            "found no column that is a time, as {why}: {}; expected one, or, for rows that are evenly spaced, their step \
             in seconds: state --step-s, in a case recording.step_s",
            names.join(", ")
        )
    })
}

/// Whether a column is called as a counter of rows and counts them.
fn counts_rows(name: &str, values: &[f64]) -> bool {
    let up_by_one = |pair: &[f64]| pair[1] - pair[0] == 1.0;
    COUNTERS.contains(&key(name).as_str())
        && values.len() > 1
        && values.iter().all(|value| value.fract() == 0.0)
        && values.windows(2).all(up_by_one)
}

/// Whether values increase from each row to the next.
fn increases(values: &[f64]) -> bool {
    values.len() > 1 && values.windows(2).all(|pair| pair[1] > pair[0])
}

/// Whether they do on the whole, as stamps do of which some come late.
fn goes_up(values: &[f64]) -> bool {
    let up = values.windows(2).filter(|pair| pair[1] >= pair[0]).count();
    values.len() > 1 && up as f64 >= 0.9 * (values.len() - 1) as f64 && values.first() < values.last()
}

fn median_step(seconds: &[f64]) -> f64 {
    let mut steps: Vec<f64> = seconds.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or_default()
}

/// A table in a sentence.
pub fn said(look: &Look) -> String {
    let [from, to] = look.span_s;
    let mean_s = (to - from) / (look.rows.max(2) - 1) as f64;
    // They differ where rows come in bursts or are lost.
    let mean = if (mean_s - look.step_s).abs() > ANOTHER_MEAN * look.step_s {
        format!(" by the median, {mean_s:.6} s on the mean")
    } else {
        String::new()
    };
    let why = look.why_unit.as_ref().map(|why| format!("; {why}")).unwrap_or_default();
    let Some(time) = &look.time else {
        return format!(
            "{}: {} rows without a time, taken to be evenly spaced by the stated step of {} s: {from} to {to:.6} s",
            look.path.display(),
            look.rows,
            look.step_s
        );
    };
    format!(
        "{}: {} rows, {from:.6} to {to:.6} s by {}, a row each {:.6} s{mean}{why}",
        look.path.display(),
        look.rows,
        time,
        look.step_s
    )
}
