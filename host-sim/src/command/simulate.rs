//! `schuler simulate SCENARIO.toml --out DIR`.
use std::path::PathBuf;

use schuler_recording::{Error, file};
use serde::Serialize;

use super::Failure;
use super::session::Session;
use crate::calibration_table;
use crate::calibration_table::recorded::seconds;
use crate::calibration_table::scenario::CalibrationScenario;
use crate::output;
use crate::plot::{Colour, Figure, Format, Panel};
use crate::scenario::{Scenario, ScenarioFile};
use crate::simulation::{self, CASE, Columns, RECORDING, Simulated, TRUTH};

/// Panels of one figure.
const PANELS: usize = 6;
/// Name under which the scenario is kept beside what it gave.
const SCENARIO: &str = "scenario.toml";

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  A recording, its case and the truth, from a scenario; the same seed gives the same bytes:
    schuler simulate host-sim/scenarios/demo.toml --out out/flight

  The same flight with other noise, and drawn:
    schuler simulate host-sim/scenarios/demo.toml --seed 7 --plot png --out out/flight_7";

/// What to simulate.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Scenario file.
    scenario: PathBuf,
    /// Directory for recording, case and truth; it is made if it is not there.
    #[arg(long, short)]
    out: PathBuf,
    /// Seed instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Also draw the outputs and their errors, in these forms.
    #[arg(long, value_enum, value_delimiter = ',')]
    plot: Vec<Format>,
}

#[derive(Serialize)]
struct Answer {
    format: &'static str,
    title: String,
    seed: u64,
    steps: usize,
    step_s: f64,
    case: PathBuf,
    recording: PathBuf,
    truth: PathBuf,
    figures: Vec<PathBuf>,
    warnings: Vec<String>,
}

pub(super) fn run(arguments: &Arguments, session: &Session) -> Result<(), Failure> {
    output::protect(&arguments.scenario);
    for name in [CASE, RECORDING, TRUTH, calibration_table::recorded::TRUTH, SCENARIO] {
        output::check(&arguments.out.join(name))?;
    }
    if let Some(answer) = calibration_run(arguments, session)? {
        return session.answer(&answer, words);
    }
    let text = file::text(&arguments.scenario, "read the scenario")?;
    let file = ScenarioFile::parse_with(&arguments.scenario, &text, session.leniency())?;
    let warnings: Vec<String> =
        file.warnings.iter().map(|warning| format!("{}: {warning}", file.path.display())).collect();
    session.warn(&warnings);
    let mut scenario = file.scenario;
    scenario.seed = arguments.seed.unwrap_or(scenario.seed);
    let simulated = simulated(&scenario, session)?;
    let written = simulated.write(&arguments.out)?;
    output::write(&arguments.out.join(SCENARIO), file.text.as_bytes())?;
    let figures = draw(&scenario, &simulated, arguments)?;
    let answer = Answer {
        format: "schuler-simulation/1",
        title: scenario.title.clone(),
        seed: scenario.seed,
        steps: simulation::steps(&scenario),
        step_s: scenario.step_s,
        case: written.case,
        recording: written.recording,
        truth: written.truth,
        figures,
        warnings,
    };
    session.answer(&answer, words)
}

fn words(it: &Answer) -> String {
    let head = format!("{}\n{} steps of {} s, seed {}\n", it.title, it.steps, it.step_s, it.seed);
    let paths = [&it.case, &it.recording, &it.truth].into_iter().chain(&it.figures);
    paths.fold(head, |text, path| text + "  " + &path.display().to_string() + "\n")
}

/// A calibration run on a table, if the scenario is one.
fn calibration_run(arguments: &Arguments, session: &Session) -> Result<Option<Answer>, Failure> {
    let path = &arguments.scenario;
    let text = file::text(path, "read the scenario")?;
    if !CalibrationScenario::is_one(&text) {
        return Ok(None);
    }
    let (mut scenario, warnings) = CalibrationScenario::parse_with(path, &text, session.leniency())?;
    let warnings: Vec<String> =
        warnings.iter().map(|warning| format!("{}: {warning}", path.display())).collect();
    session.warn(&warnings);
    scenario.seed = arguments.seed.unwrap_or(scenario.seed);
    let progress = session.progress("simulating", seconds(&scenario.table));
    let simulated = scenario.simulated(|second| progress.stride(second))?;
    drop(progress);
    let (written, steps) = simulated.write(&arguments.out)?;
    output::write(&arguments.out.join(SCENARIO), text.as_bytes())?;
    let figures = if arguments.plot.is_empty() {
        Vec::new()
    } else {
        simulated.figure().write(&arguments.out, "outputs_1", &arguments.plot)?
    };
    Ok(Some(Answer {
        format: "schuler-simulation/1",
        title: scenario.title,
        seed: scenario.seed,
        steps,
        step_s: 1.0 / scenario.table.samples_per_second as f64,
        case: written.case,
        recording: written.recording,
        truth: written.truth,
        figures,
        warnings,
    }))
}

/// Runs a scenario with a progress bar.
pub(super) fn simulated(scenario: &Scenario, session: &Session) -> Result<Simulated, Failure> {
    let progress = session.progress("simulating", simulation::steps(scenario));
    Ok(simulation::run(scenario, |step| progress.at(step))?)
}

/// Outputs and errors of every instrument.
fn draw(scenario: &Scenario, simulated: &Simulated, arguments: &Arguments) -> Result<Vec<PathBuf>, Error> {
    if arguments.plot.is_empty() {
        return Ok(Vec::new());
    }
    let hours = |columns: &Columns| -> Vec<f64> {
        columns.get("t").unwrap_or_default().iter().map(|t| t / 3600.0).collect()
    };
    let (x, x_truth) = (hours(&simulated.recording), hours(&simulated.truth));
    let mut panels = Vec::new();
    for sensor in &simulated.case.sensors {
        let unit = sensor.unit;
        if let Some(values) = simulated.recording.get(&sensor.column) {
            let label = format!("{}, {unit}", sensor.id);
            panels.push(Panel::new("time, h", &label).line("output", &x, values.to_vec(), Colour::Blue));
        }
        if let Some(error) = simulated.truth.get(&format!("{}.error", sensor.id)) {
            let values = error.iter().map(|v| v / unit.in_si()).collect();
            let label = format!("error of {}, {unit}", sensor.id);
            panels.push(Panel::new("time, h", &label).line("error", &x_truth, values, Colour::Red));
        }
    }
    for auxiliary in &simulated.case.auxiliaries {
        if let Some(values) = simulated.recording.get(&auxiliary.column) {
            let label = format!("{}, {}", auxiliary.column, auxiliary.unit);
            panels.push(Panel::new("time, h", &label).line("", &x, values.to_vec(), Colour::Green));
        }
    }
    let mut written = Vec::new();
    for (index, panels) in panels.chunks(PANELS).enumerate() {
        let figure = Figure { title: scenario.title.clone(), panels: panels.to_vec() };
        written.extend(figure.write(&arguments.out, &format!("outputs_{}", index + 1), &arguments.plot)?);
    }
    Ok(written)
}
