//! `schuler demo`: the way from a mismatch to a better flight.
//!
//! A flight is simulated with physics that another scenario, the nominal one, does not have. What explains the recording reads the case and
//! the recording, never the scenario that made them. What is found goes into the nominal scenario, which is simulated again, and into a
//! compensation block, with which the next flight is flown.
use std::fmt::Write;
use std::path::{Path, PathBuf};

use schuler_core::identification::Method;
use schuler_explain::config::Config;
use schuler_explain::explanation::Finding;
use schuler_explain::export::compensation::Deployed;
use schuler_link::block::{self, BlockBytes};
use schuler_recording::Recording;
use serde::Serialize;

use super::super::session::Session;
use super::super::{Failure, explain, fly, into, simulate, text};
use super::{Arguments, TILT, channel_of, scaled, truth};
use crate::emulator::TargetError;
use crate::flight::mission::FlightError;
use crate::flight::summary::TruthState;
use crate::flight::{Channel, Flown, LoopStates, On, Summary, figures};
use crate::output;
use crate::plot::{Colour, Figure, Panel};
use crate::scenario::ScenarioFile;
use crate::simulation;

/// What the simulation believes.
const NOMINAL: &str = include_str!("../../../scenarios/warm_platform.toml");
/// What happens.
const TRUE: &str = include_str!("../../../scenarios/warm_platform_true.toml");
/// The output that is recorded.
const VELOCITY: &str = "velocity_error";
/// Largest error of the vertical that is shown, arc seconds.
const SCALE: f64 = 30.0;
/// Rows until the filter has settled, after which its errors are counted.
const SETTLED: usize = 3600;

/// What the demonstration came to.
#[derive(Serialize)]
pub(in crate::command) struct Answer {
    format: &'static str,
    seed: u64,
    hours: f64,
    findings: Vec<Told>,
    /// Error of prediction on data that the fit never saw, of what the simulation expects, before and after.
    held_out: [f64; 2],
    /// How far the simulation is from the recorded velocity before and after, m/s rms.
    simulation: [f64; 2],
    /// What of the description is not in the scenario, and why.
    not_in_the_scenario: Vec<String>,
    compensation: Vec<Deployed>,
    /// Error of the vertical of the next flight, without the block and with it.
    tilt: [TruthState; 2],
    board: Board,
    files: Vec<PathBuf>,
}

#[derive(Serialize)]
struct Told {
    sensor: String,
    effect: String,
    sentence: String,
    probability: f64,
}

/// The flight on the emulated board.
#[derive(Serialize)]
struct Board {
    /// Steps that were flown there.
    steps: usize,
    /// Steps whose outputs are not those of this machine, bit for bit.
    different: usize,
    /// Why it was not flown there.
    #[serde(skip_serializing_if = "Option::is_none")]
    because: Option<String>,
}

/// Simulates, explains, puts back, flies and writes everything.
pub(in crate::command) fn made(arguments: &Arguments, session: &Session) -> Result<Answer, Failure> {
    let out = &arguments.out;
    let seed =
        arguments.seed.unwrap_or(ScenarioFile::parse("warm_platform.toml".as_ref(), NOMINAL)?.scenario.seed);
    let (nominal, case) = (out.join("nominal.toml"), out.join(simulation::CASE));
    output::make_directory_of(&nominal)?;
    output::write(&nominal, NOMINAL.as_bytes())?;
    let recorded = simulated(TRUE, seed, out, session)?;
    let mut files = vec![case.clone(), out.join(simulation::RECORDING), nominal.clone()];

    let (report, model) = explain::explained(&recorded, &case, &Config::default(), session)?;
    let page = out.join("explanation.html");
    output::write(&page, report.html().as_bytes())?;
    let taken = into::write(&model, &nominal, out, session.leniency())?;
    let put_back = schuler_recording::file::text(&taken.path, "read the scenario")?;
    let deployment = explain::deployed(&report.explanation, &recorded, &case)?;
    let compensation = block::encode(&deployment.block);
    let block = out.join("compensation.block");
    output::write(&block, &compensation)?;
    files.extend([page, taken.path, block]);

    // Other noise than that of the recording, the same before and after.
    let simulations = [
        simulated(NOMINAL, seed + 1, &out.join("nominal"), session)?,
        simulated(&put_back, seed + 1, &out.join("put_back"), session)?,
    ];
    let next = Next::of(simulated(TRUE, seed + 2, &out.join("next"), session)?, &out.join("next"))?;
    let flights = [next.flown(None, session)?, next.flown(Some(&compensation), session)?];
    let board = next.on_board(&flights[1], arguments.on, session)?;

    let figure = Figure {
        title: "A flight, its simulation and the next flight, before and after".to_owned(),
        panels: panels(&recorded, &simulations, &flights, &next.truth),
    };
    files.extend(figure.write(out, "closed_circle", &arguments.plot)?);
    let [before, after] = &flights;
    let held_out = &report.explanation.fit.held_out;
    let distance = |simulation: &Recording| rms(velocity(&recorded), velocity(simulation));
    let answer = Answer {
        format: "schuler-demo/2",
        seed,
        hours: recorded.len() as f64 * recorded.step_s / 3600.0,
        findings: report
            .explanation
            .findings
            .iter()
            .zip(report.sentences())
            .map(|(it, sentence)| told(it, sentence))
            .collect(),
        held_out: [held_out.before.rmse, held_out.after.rmse],
        simulation: [distance(&simulations[0]), distance(&simulations[1])],
        not_in_the_scenario: taken.left_out,
        compensation: deployment.findings,
        tilt: [next.tilt(before)?, next.tilt(after)?],
        board,
        files,
    };
    fly::write_json(&out.join("demo.json"), &answer)?;
    Ok(answer)
}

/// Simulates a scenario into a directory and reads what was recorded.
fn simulated(scenario: &str, seed: u64, out: &Path, session: &Session) -> Result<Recording, Failure> {
    let mut scenario = ScenarioFile::parse("scenario.toml".as_ref(), scenario)?.scenario;
    scenario.seed = seed;
    Ok(Recording::read(&simulate::simulated(&scenario, session)?.write(out)?.case)?)
}

fn told(finding: &Finding, sentence: String) -> Told {
    let Finding { sensor, effect, probability, .. } = finding;
    Told { sensor: sensor.clone(), effect: effect.clone(), sentence, probability: *probability }
}

fn velocity(recording: &Recording) -> &[f64] {
    recording.sensor(VELOCITY).map(|series| series.values.as_slice()).unwrap_or_default()
}

/// Root mean square of the difference, where both are there.
fn rms(a: &[f64], b: &[f64]) -> f64 {
    let squares: Vec<f64> =
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).filter(|square| square.is_finite()).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// The flight after the one that was explained: the same physics, other noise.
struct Next {
    case: PathBuf,
    recording: Recording,
    channel: Channel,
    truth: Vec<LoopStates>,
}

impl Next {
    /// Of what was simulated into a directory.
    fn of(recording: Recording, directory: &Path) -> Result<Self, Failure> {
        let case = directory.join(simulation::CASE);
        let mut channel = channel_of(&recording, &case)?;
        // Retuned, the filter would take some of the physics for noise.
        channel.config.identification.method = Method::Off;
        let truth = truth(&case, &channel.name, &recording)?;
        Ok(Self { case, recording, channel, truth })
    }

    fn flown(&self, compensation: Option<&BlockBytes>, session: &Session) -> Result<Flown, Failure> {
        let mut channel = self.channel.clone();
        channel.compensation = compensation.cloned();
        fly::flown(channel, &self.recording, On::Host, &self.case, session)
    }

    /// Error of the vertical once the filter has settled.
    fn tilt(&self, flown: &Flown) -> Result<TruthState, Failure> {
        let truth = Summary::from(flown, Some(&self.truth), SETTLED).truth;
        let tilt = truth.and_then(|it| it.states.into_iter().nth(TILT));
        Ok(tilt.ok_or_else(|| anyhow::anyhow!("the flight has no outputs"))?)
    }

    /// Flies the same on the emulated board, unless only this machine was asked for, and compares the bits. Where there is no emulator,
    /// that is said, unless the board was asked for.
    fn on_board(&self, host: &Flown, asked: Option<On>, session: &Session) -> Result<Board, Failure> {
        let nothing = |because: String| Board { steps: 0, different: 0, because: Some(because) };
        if asked == Some(On::Host) {
            return Ok(nothing("this machine was asked for".to_owned()));
        }
        let waiting = session.waiting("flying on the board");
        let on = asked.unwrap_or(On::Qemu);
        let flown = Flown::of(host.channel.clone(), &self.recording, on, |_| waiting.check());
        drop(waiting);
        match flown {
            Ok(board) => {
                let pairs = host.outputs.iter().zip(&board.outputs);
                // Both are of one type, whose numbers are printed to their last bit.
                let different =
                    pairs.filter(|(host, board)| format!("{host:?}") != format!("{board:?}")).count();
                Ok(Board { steps: board.outputs.len(), different, because: None })
            }
            Err(FlightError::Target(
                error @ (TargetError::MissingTool { .. } | TargetError::Build(_) | TargetError::Run(_)),
            )) if asked.is_none() => {
                Ok(nothing(error.to_string().lines().next().unwrap_or_default().to_owned()))
            }
            Err(error) => Err(fly::failure(error, &self.case)),
        }
    }
}

/// Before and after: the velocity and its simulations, and the error of the vertical in the next flight.
fn panels(
    recorded: &Recording,
    simulations: &[Recording; 2],
    flights: &[Flown; 2],
    truth: &[LoopStates],
) -> Vec<Panel> {
    let x: Vec<f64> = recorded.elapsed_s().map(|time_s| time_s / 3600.0).collect();
    let of = |recording: &Recording| velocity(recording).to_vec();
    let [nominal, put_back] = simulations;
    let [before, after] = flights;
    vec![
        Panel::new("time, h", "velocity error, m/s")
            .line("recorded", &x, of(recorded), Colour::Black)
            .line("simulated, nominal", &x, of(nominal), Colour::Orange)
            .line("simulated, with what was found", &x, of(put_back), Colour::Green),
        scaled(figures::tilt_error(before, truth, "without compensation, arc seconds"), SCALE),
        scaled(figures::tilt_error(after, truth, "with compensation, arc seconds"), SCALE),
    ]
}

pub(super) fn words(answer: &Answer) -> String {
    let mut text = String::new();
    let mut line = |words: std::fmt::Arguments<'_>| {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "{words}");
    };
    line(format_args!(
        "A flight of {:.0} h was simulated with physics that the nominal scenario does not have (seed {}).",
        answer.hours, answer.seed
    ));
    line(format_args!("Found from case and recording alone:"));
    for (k, finding) in answer.findings.iter().enumerate() {
        line(format_args!("  {}. {}", k + 1, finding.sentence));
    }
    let [before, after] = answer.held_out;
    line(format_args!(
        "On data that the fit never saw, the error of prediction falls from {before:.3} to {after:.3} of what is expected."
    ));
    let [before, after] = answer.simulation;
    line(format_args!(
        "Put back and simulated again, the simulation is {after:.2} m/s rms from the recording; before it was {before:.2} m/s."
    ));
    let is_told = |words: &&String| {
        answer.findings.iter().any(|it| words.starts_with(&format!("{} of {}", it.effect, it.sensor)))
    };
    for left_out in answer.not_in_the_scenario.iter().filter(is_told) {
        line(format_args!("  Not put back: {left_out}."));
    }
    line(format_args!(
        "The next flight, error of the vertical, and how often that is beyond 3 sigma (0.3 % is right):"
    ));
    for (how, tilt) in ["without compensation", "with compensation"].into_iter().zip(&answer.tilt) {
        let (rmse, unit) = text::spoken(tilt.rmse, tilt.unit);
        line(format_args!("  {how:<20} {rmse:5.2} {unit} rms, {:.1} %", 100.0 * tilt.beyond_three_sigma));
    }
    for it in &answer.compensation {
        if let Some(because) = &it.because {
            line(format_args!(
                "  {} of {} is not compensated in flight, because {because}.",
                it.effect, it.sensor
            ));
        }
    }
    line(format_args!("{}", board_words(&answer.board)));
    let directory = answer.files.first().and_then(|file| file.parent()).unwrap_or(Path::new("."));
    line(format_args!(
        "Picture, page, scenario and block: {}/closed_circle, explanation.html, scenario.toml, compensation.block",
        directory.display()
    ));
    text
}

fn board_words(board: &Board) -> String {
    match (&board.because, board.different) {
        (Some(because), _) => format!("On the emulated board it was not flown: {because}."),
        (None, 0) => format!("On the emulated board: the same bits in all {} steps.", board.steps),
        (None, different) => {
            format!(
                "On the emulated board: other bits in {different} of {} steps, which is wrong.",
                board.steps
            )
        }
    }
}
