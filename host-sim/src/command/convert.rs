//! `schuler convert IN OUT`.
use std::path::{Path, PathBuf};

use schuler_recording::case::Simulation;
use schuler_recording::table::{self, Copied, Span, TableReader};
use schuler_recording::{Error, Problem};
use serde::Serialize;

use super::Failure;
use super::session::Session;
use crate::output;

/// How the name of a case ends.
const CASE: &str = "toml";

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  The messages of one topic of a flight log, as Parquet:
    schuler convert flight.ulg flight.parquet --columns 'sensor_gyro_0.*'

  One minute of one sensor, to look at:
    schuler convert flight.ulg minute.csv --columns 'sensor_gyro_0.*' --from 100 --to 160

  A case with its table, as Parquet in another directory:
    schuler convert run_17/case.toml out/run_17";

/// What to convert.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Table (text, Parquet, MCAP, ROS bag, ULog, DataFlash, MAVLink, NumPy, MATLAB, HDF5), or a case with its table.
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// File to write, .csv, .csv.gz or .parquet; of a case the directory, which is made if it is not there.
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Format to write; without it what the name says, of a case Parquet.
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Columns to write, the first of them the time; NAME* is every column that begins so. All, without it; of a case
    /// those that it names.
    #[arg(long, value_delimiter = ',', value_name = "COLUMN")]
    columns: Vec<String>,
    /// Leave out rows before this time, in seconds as in the first column.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    from: Option<f64>,
    /// Leave out rows after this time.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    to: Option<f64>,
}

/// Names of the formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// Comma-separated values.
    Csv,
    /// Gzipped comma-separated values.
    CsvGz,
    /// Parquet.
    Parquet,
}

impl From<Format> for table::Format {
    fn from(name: Format) -> Self {
        match name {
            Format::Csv => Self::Csv,
            Format::CsvGz => Self::CsvGz,
            Format::Parquet => Self::Parquet,
        }
    }
}

#[derive(Serialize)]
struct Answer {
    format: &'static str,
    table: PathBuf,
    #[serde(skip_serializing_if = "Option::is_none")]
    case: Option<PathBuf>,
    rows: u64,
    columns: Vec<String>,
    span_s: Option<[f64; 2]>,
    warnings: Vec<String>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    let is_case = arguments.input.extension().is_some_and(|ending| ending == CASE);
    let answer = if is_case { of_case(arguments, session)? } else { of_table(arguments, session)? };
    session.warn(&answer.warnings);
    session.answer(&answer, words)
}

fn of_table(arguments: &Arguments, session: &Session) -> Result<Answer, Failure> {
    let path = &arguments.output;
    let format =
        arguments.format.map(table::Format::from).or_else(|| table::Format::of(path)).ok_or_else(|| {
            let endings = table::Format::ALL.map(table::Format::ending).join(", ");
            Error::one(
                path,
                Problem::of_file(format!("found another ending; expected one of {endings}, or --format")),
            )
        })?;
    output::protect(&arguments.input);
    let table = table::open_with(&arguments.input, session.leniency())?;
    let wanted = chosen(&*table, &arguments.columns)
        .map_err(|message| Error::one(&arguments.input, Problem::new(None, "--columns", message)))?;
    write(table, &wanted, None, (path, format), arguments, session)
}

/// Converts a case: the columns that it names, and the case with the new table's name.
fn of_case(arguments: &Arguments, session: &Session) -> Result<Answer, Failure> {
    let mut file = session.case(&arguments.input)?;
    let table_path = file.table_path();
    let table = file.open_table()?;
    let format = arguments.format.map_or(table::Format::Parquet, table::Format::from);
    let columns = if arguments.columns.is_empty() {
        let mut columns: Vec<String> = file.case.columns().into_iter().map(str::to_owned).collect();
        let motion = file.case.motion.columns().filter(|column| table.index(column).is_ok());
        columns.extend(motion.map(str::to_owned));
        let names = file.case.names_in_formulas().into_iter();
        columns.extend(names.filter(|name| table.index(name).is_ok()).map(str::to_owned));
        columns
    } else {
        arguments.columns.clone()
    };
    let wanted = chosen(&*table, &columns)
        .map_err(|message| Error::one(&arguments.input, Problem::new(None, "", message)))?;
    let name = table_path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = table::Format::ALL.iter().find_map(|format| name.strip_suffix(format.ending()));
    let stem = stem.map_or_else(|| Path::new(&name).with_extension(""), PathBuf::from);
    let name = PathBuf::from(format!("{}{}", stem.display(), format.ending()));
    let case = arguments.output.join(file.path.file_name().unwrap_or_default());
    output::check(&case)?;
    let source = &file.case.recording;
    let step_s = source.step_s.filter(|_| source.time.is_none());
    let path = arguments.output.join(&name);
    let mut answer = write(table, &wanted, step_s, (&path, format), arguments, session)?;
    answer.warnings.extend(file.warnings.iter().map(|warning| format!("{}: {warning}", file.path.display())));
    file.case.recording.path = name;
    if let Some(span) = answer.span_s {
        file.case.recording.keep_switching_on(span);
        if step_s.is_some() {
            file.case.recording.begin_at(span[0]);
        }
    }
    // The simulation stays where it is.
    let simulation = file.simulation_path().map(|path| path.canonicalize().unwrap_or(path));
    if let (Some(path), Some(Simulation { table: Some(table), .. })) = (simulation, &mut file.case.simulation)
    {
        table.path = path;
    }
    output::write_case(&case, &file.case)?;
    answer.case = Some(case);
    Ok(answer)
}

/// Indices of the columns with these names, each once; a name may end in `*`.
fn chosen(table: &dyn TableReader, names: &[String]) -> Result<Vec<usize>, String> {
    if names.is_empty() {
        return table.all();
    }
    let mut wanted = Vec::new();
    for name in names {
        // A column may have the star in its name.
        match (table.index(name), name.strip_suffix('*')) {
            (Ok(index), _) => wanted.push(index),
            (Err(_), Some(beginning)) => {
                let found = table.names().iter().enumerate().filter(|(_, name)| name.starts_with(beginning));
                let before = wanted.len();
                wanted.extend(found.map(|(index, _)| index));
                if wanted.len() == before {
                    return Err(format!("found \"{name}\"; expected the beginning of a column of the table"));
                }
            }
            (Err(message), None) => return Err(message),
        }
    }
    let mut seen = std::collections::HashSet::new();
    wanted.retain(|index| seen.insert(*index));
    Ok(wanted)
}

fn write(
    table: Box<dyn TableReader>,
    wanted: &[usize],
    step_s: Option<f64>,
    to: (&Path, table::Format),
    arguments: &Arguments,
    session: &Session,
) -> Result<Answer, Failure> {
    let (path, format) = to;
    let of_s = (arguments.from.is_some() || arguments.to.is_some())
        .then(|| [arguments.from.unwrap_or(f64::NEG_INFINITY), arguments.to.unwrap_or(f64::INFINITY)]);
    let columns = wanted.iter().filter_map(|&index| table.names().get(index).cloned()).collect();
    let waiting = session.waiting("converting");
    output::check(path)?;
    output::make_directory_of(path)?;
    let Copied { rows, span_s, warnings, .. } = output::atomically(path, |file| {
        let copied = table::copy(table, wanted, Span { of_s, step_s }, (file, path), format, |_| {
            waiting.check().map_err(Failure::from)
        })?;
        if copied.rows == 0 && copied.left_out > 0 {
            let message = format!("found none of {} rows in it; expected at least one", copied.left_out);
            return Err(Error::one(&arguments.input, Problem::new(None, "--from, --to", message)).into());
        }
        Ok::<_, Failure>(copied)
    })?;
    let table = path.to_owned();
    Ok(Answer { format: "schuler-conversion/1", table, case: None, rows, columns, span_s, warnings })
}

fn words(it: &Answer) -> String {
    let span = it.span_s.map(|[from, to]| format!(", {from} to {to} s")).unwrap_or_default();
    let head = format!("{} rows of {} columns{span}\n", it.rows, it.columns.len());
    [Some(&it.table), it.case.as_ref()]
        .into_iter()
        .flatten()
        .fold(head, |text, path| text + "  " + &path.display().to_string() + "\n")
}
