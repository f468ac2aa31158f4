//! `schuler demo --identification`: a filter that is believed ten times wrong retunes itself, and names the gyro that fails.
use std::path::PathBuf;

use schuler_core::identification::Method;
use schuler_recording::Recording;
use serde::Serialize;

use super::super::session::Session;
use super::super::{Failure, fly, simulate, text};
use super::{Arguments, TILT, channel_of, scaled, truth};
use crate::flight::summary::{NoiseSummary, TruthState};
use crate::flight::{Channel, Flown, LoopStates, Summary, figures};
use crate::plot::Figure;
use crate::scenario::ScenarioFile;

const SCENARIO: &str = include_str!("../../../scenarios/demo.toml");
const SCENARIO_NAME: &str = "demo.toml";
/// Largest error of the vertical that is shown, arc seconds: 5 of its usual ones; the first minutes go beyond it.
const SCALE: f64 = 100.0;

/// What the demonstration found.
#[derive(Serialize)]
pub(in crate::command) struct Answer {
    format: &'static str,
    on: &'static str,
    seed: u64,
    hours: f64,
    /// The filter that believes the data sheet to the end, after the other was first retuned.
    mistuned: Comparison,
    /// The same of the filter that is retuned in flight.
    retuned: Comparison,
    /// Whole summary of the retuned flight.
    flight: Summary,
    fault: FaultFound,
    files: Vec<PathBuf>,
}

#[derive(Serialize)]
struct Comparison {
    accelerometer: NoiseSummary,
    gyro: NoiseSummary,
    nis_mean: f64,
    tilt: TruthState,
}

#[derive(Serialize)]
struct FaultFound {
    /// Gyro that the scenario lets fail, and when, s.
    failed: String,
    onset_s: f64,
    /// Gyro that the module isolated, and when, s.
    isolated: Option<String>,
    isolated_at_s: Option<f64>,
    alarms_before_the_fault: usize,
}

/// Simulates, flies and writes everything.
pub(in crate::command) fn made(arguments: &Arguments, session: &Session) -> Result<Answer, Failure> {
    let on = arguments.on.unwrap_or_default();
    let file = ScenarioFile::parse(SCENARIO_NAME.as_ref(), SCENARIO)?;
    let mut scenario = file.scenario;
    scenario.seed = arguments.seed.unwrap_or(scenario.seed);
    let simulated = simulate::simulated(&scenario, session)?;
    let written = simulated.write(&arguments.out)?;
    let mut files = vec![written.case.clone(), written.recording, written.truth];

    let recording = Recording::read(&written.case)?;
    let channel = channel_of(&recording, &written.case)?;
    let truth = truth(&written.case, &channel.name, &recording)?;
    let fly = |method: Method| -> Result<Flown, Failure> {
        let mut channel: Channel = channel.clone();
        channel.config.identification.method = method;
        fly::flown(channel, &recording, on, &written.case, session)
    };
    let mistuned = fly(Method::Off)?;
    let retuned = fly(Method::Likelihood)?;

    let mut products = fly::Products::of(
        &retuned.channel,
        retuned.steps.len(),
        true,
        Some(&arguments.out),
        &arguments.plot,
    )?;
    for ((step, output), truth) in retuned.iter().zip(&truth) {
        products.add(step, output, Some(truth))?;
    }
    let (summary, flown) = products.finish()?;
    let first_retuned = summary
        .identification
        .as_ref()
        .and_then(|it| it.retuned_at_s.first().copied())
        .unwrap_or(scenario.duration_s);
    files.extend(flown);
    let comparison = Figure {
        title: "Error of the vertical against what the filter believes of it".to_owned(),
        panels: vec![
            scaled(figures::tilt_error(&mistuned, &truth, "data sheet, arc seconds"), SCALE),
            scaled(figures::tilt_error(&retuned, &truth, "retuned in flight, arc seconds"), SCALE),
        ],
    };
    files.extend(comparison.write(&arguments.out, "before_and_after", &arguments.plot)?);

    let fault = scenario.faults.first();
    let onset_s = fault.map_or(f64::INFINITY, |f| f.fault.onset_s);
    let verdicts = summary.gyros.as_ref().map(|it| it.verdicts.as_slice()).unwrap_or_default();
    let isolated = verdicts.iter().find(|change| change.verdict == "fault" && change.time_s >= onset_s);
    let answer = Answer {
        format: "schuler-demo/1",
        on: on.name(),
        seed: scenario.seed,
        hours: scenario.duration_s / 3600.0,
        mistuned: compared(&mistuned, &truth, first_retuned)?,
        retuned: compared(&retuned, &truth, first_retuned)?,
        fault: FaultFound {
            failed: fault.map(|f| f.sensor.clone()).unwrap_or_default(),
            onset_s,
            isolated: isolated.and_then(|change| change.gyro.clone()),
            isolated_at_s: isolated.map(|change| change.time_s),
            alarms_before_the_fault: verdicts
                .iter()
                .filter(|change| change.verdict != "no_fault" && change.time_s < onset_s)
                .count(),
        },
        flight: summary,
        files,
    };
    fly::write_json(&arguments.out.join("demo.json"), &answer)?;
    Ok(answer)
}

/// Both filters over the same time: from the first retuning on.
fn compared(flown: &Flown, truth: &[LoopStates], from_s: f64) -> Result<Comparison, Failure> {
    let from = flown.steps.partition_point(|step| step.time_s < from_s);
    let summary = Summary::from(flown, Some(truth), from);
    let nothing = || anyhow::anyhow!("the flight has no outputs");
    let identification = summary.identification.ok_or_else(nothing)?;
    let tilt = summary.truth.and_then(|it| it.states.into_iter().nth(TILT)).ok_or_else(nothing)?;
    Ok(Comparison {
        accelerometer: identification.accelerometer,
        gyro: identification.gyro,
        nis_mean: summary.filter.map_or(f64::NAN, |it| it.nis.mean),
        tilt,
    })
}

pub(super) fn words(answer: &Answer) -> String {
    let tilt = |it: &Comparison| {
        let (rmse, unit) = text::spoken(it.tilt.rmse, it.tilt.unit);
        format!(
            "error of the vertical {rmse:.2} {unit} rms, beyond 3 sigma {:.1} % of the time (0.3 % is right)",
            100.0 * it.tilt.beyond_three_sigma
        )
    };
    let noise = |it: &Comparison| {
        format!(
            "    accelerometer {}\n    gyro {}",
            text::noise_line(&it.accelerometer, "m/s^2"),
            text::noise_line(&it.gyro, "rad/s")
        )
    };
    let fault = &answer.fault;
    let found = match (&fault.isolated, fault.isolated_at_s) {
        (Some(gyro), Some(at)) => format!(
            "{gyro} was named {:.0} s later{}",
            at - fault.onset_s,
            if *gyro == fault.failed { "" } else { ", which is wrong" }
        ),
        _ => "no gyro was named".to_owned(),
    };
    format!(
        "A flight of {:.0} h was simulated: rotors, pendulum, heat and the Schuler loop (seed {}), and flown on {}.\n\
         \n\
         With the noise of the data sheet, which is wrong by ten:\n{}\n    {}\n\
         With the noise found in flight:\n{}\n    {}\n\
         \n\
         Of five gyros, {} failed at {:.0} s; {found}. Alarms before that: {}.\n\
         \n\
         Everything is in {}.\n",
        answer.hours,
        answer.seed,
        if answer.on == "host" { "this machine" } else { "the emulated target" },
        noise(&answer.mistuned),
        tilt(&answer.mistuned),
        noise(&answer.retuned),
        tilt(&answer.retuned),
        fault.failed,
        fault.onset_s,
        fault.alarms_before_the_fault,
        answer.files.first().and_then(|f| f.parent()).map(|d| d.display().to_string()).unwrap_or_default(),
    )
}
