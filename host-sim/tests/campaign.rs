//! Campaigns from end to end: cases are what their seeds say, nominal models are true, seals hold, and scoring judges those who
//! know nothing and those who know everything as it must.
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use host_sim::campaign::answer::Answer;
use host_sim::campaign::effect::{EFFECTS, Family};
use host_sim::campaign::files::Files;
use host_sim::campaign::maker::{Made, make};
use host_sim::campaign::oracle::{self, half_square};
use host_sim::campaign::plan::{Bars, Group, Plan, PlanFile};
use host_sim::campaign::run::{Campaign, seed_in};
use host_sim::campaign::seed_of;
use host_sim::campaign::setting::{Kind, Setting};
use host_sim::campaign::summary::{Standing, summary};
use host_sim::campaign::{draw::Draw, maker};
use host_sim::simulation;
use schuler_recording::Recording;
use schuler_recording::motion::{Prediction, predict};
use serde_json::{Value, json};

fn group(identifiers: &[&str], settings: &[Kind]) -> Group {
    Group {
        name: "test".into(),
        cases: 1,
        families: vec![],
        identifiers: identifiers.iter().map(|it| (*it).to_owned()).collect(),
        settings: settings.to_vec(),
        effects: 1,
        most_rows: 6000,
        gain_nats: [50.0, 50.0],
        inexact: 0.0,
    }
}

fn made(group: &Group, seed: u64) -> Made {
    make(group, 0, seed, &|| Ok(())).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_case_is_its_seed_and_nothing_else() {
    let group = group(&["bias_temperature", "time_delay", "noise_markov"], &[]);
    for seed in [3, 4] {
        let (a, b) = (made(&group, seed), made(&group, seed));
        assert_eq!(a.answer, b.answer);
        assert_eq!(a.simulated, b.simulated);
    }
    assert_ne!(made(&group, 3).answer, made(&group, 4).answer);
    assert_ne!(seed_of(1, 0), seed_of(1, 1));
}

#[test]
fn an_effect_proportional_to_its_size_has_the_gain_that_was_asked_for() {
    for (effect, kind) in [
        ("bias_step", Kind::Bench),
        ("bias_temperature", Kind::Channel),
        ("scale_factor", Kind::Table),
        ("g_mass_unbalance", Kind::Tumble),
        ("lever_arm", Kind::Drive),
        ("misalignment", Kind::Log),
        ("bias_drift_linear", Kind::Block),
        ("schuler_oscillation", Kind::Radio),
    ] {
        let rows = Group { most_rows: 8000, ..group(&[effect], &[kind]) };
        let it = &made(&rows, 5).answer.effects[0];
        let expected = it.expected_gain_nats;
        // A level platform's misalignment and a sphere's curvature are the only departures from proportion.
        assert!((expected / 50.0 - 1.0).abs() < 0.02, "{effect}: {expected}");
        // What happened is within five standard deviations of the average: variance of the gain is twice its average.
        assert!(
            (it.gain_nats - expected).abs() < 5.0 * (2.0 * expected).sqrt(),
            "{effect}: {}",
            it.gain_nats
        );
    }
}

#[test]
fn an_oracle_places_a_strong_onset_and_not_a_weak_one() {
    let off = |effect: &str, kind: Kind, gain: f64| {
        let rows = Group { gain_nats: [gain; 2], ..group(&[effect], &[kind]) };
        let made = made(&rows, 7);
        let it = &made.answer.effects[0];
        let [from, _] = it.interval_s.expect("local in time");
        (it.oracle_onset_s.expect("an onset") - from).abs() / (made.answer.rows as f64 * made.answer.step_s)
    };
    for (effect, kind) in [
        ("bias_step", Kind::Bench),
        ("bias_step", Kind::Channel),
        ("bias_step", Kind::Block),
        ("noise_variance_step", Kind::Bench),
    ] {
        let strong = off(effect, kind, 3000.0);
        assert!(strong < 0.003, "{effect} in {kind:?}: {strong} of the record");
    }
    // What gains three nats could as well begin elsewhere.
    let weak = off("bias_step", Kind::Bench, 3.0);
    assert!(weak > 0.02, "{weak} of the record");
}

#[test]
fn every_effect_can_be_concealed_in_each_of_its_settings() {
    let mut impossible = Vec::new();
    for entry in EFFECTS {
        for kind in entry.kinds {
            let group = Group { gain_nats: [20.0, 400.0], ..group(&[entry.effect], &[*kind]) };
            let group = Group { most_rows: 7000, ..group };
            match make(&group, 0, 11, &|| Ok(())) {
                Ok(made) => {
                    let it = &made.answer.effects[0];
                    assert!(it.gain_nats.is_finite(), "{} in {kind:?}: {it:?}", entry.effect);
                    for p in &it.parameters {
                        assert!(p.value.is_finite() && p.value != 0.0, "{} in {kind:?}: {p:?}", entry.effect);
                    }
                }
                Err(error) => impossible.push(format!("{} in {kind:?}: {error}", entry.effect)),
            }
        }
    }
    assert!(impossible.is_empty(), "{impossible:#?}");
}

/// What has no maker stands here with the reason; a new row of the catalogue needs a maker or a line.
#[test]
fn every_identifier_of_the_catalogue_can_be_concealed() {
    let without: Vec<&str> = schuler_explain::catalogue::CATALOGUE
        .iter()
        .map(|effect| effect.id)
        .filter(|id| !EFFECTS.iter().any(|entry| entry.effect == *id))
        .collect();
    // Its lines take days to tell from a daily temperature; no setting lasts so long.
    assert_eq!(without, ["earth_tide"]);
    for entry in EFFECTS.iter().filter(|entry| entry.family != Family::Outside) {
        let known = schuler_explain::catalogue::CATALOGUE.iter().any(|effect| effect.id == entry.effect);
        assert!(known, "{}", entry.effect);
    }
}

/// What the case predicts, made by other code, agrees with what silent instruments without effects say, far below any noise.
#[test]
fn nominal_models_are_true() {
    let mut untrue = Vec::new();
    for kind in Kind::ALL {
        for seed in 0..8 {
            let mut draw = Draw::new(seed, "test");
            let setting = Setting::draw(kind, 5500, seed, &mut draw);
            let simulated = simulation::run(&oracle::silent(&setting.scenario), |_| Ok(())).unwrap();
            let rows = simulation::steps(&setting.scenario);
            let directory = tempfile::tempdir().unwrap();
            let mut simulated = simulated;
            for sensor in simulated.case.sensors.iter_mut().filter(|s| s.id == "ins") {
                sensor.axis = Some([1.0, 0.0, 0.0]);
            }
            simulated.write_public(directory.path()).unwrap();
            let recording = Recording::read(&directory.path().join("case.toml")).unwrap();
            // Silent instruments that measure the same read the same.
            let is_new = |warning: &&String| !warning.contains("have the same readings, bit for bit");
            let warnings: Vec<&String> = recording.warnings.iter().filter(is_new).collect();
            assert!(warnings.is_empty(), "{warnings:?}");
            let told = oracle::outputs(&setting, &simulated, rows);
            let left: Vec<(String, Vec<f64>)> = told
                .iter()
                .map(|(id, values)| {
                    let sensor = &recording.sensor(id).unwrap().sensor;
                    let bias = sensor.nominal.bias;
                    // Redundant sensors are compared with each other, and a loop's error with nothing.
                    let predicted = predict(&recording, sensor).unwrap_or(Prediction::Constant(0.0));
                    (id.clone(), values.iter().enumerate().map(|(k, v)| v - predicted.at(k) - bias).collect())
                })
                .collect();
            // What is not recorded need not agree: a tuned gyro's loop while the table turns.
            let mask = oracle::mask(&setting.scenario.gaps, setting.scenario.step_s, rows);
            let time: Vec<f64> = (1..=rows).map(|k| k as f64 * setting.scenario.step_s).collect();
            for view in oracle::views(&setting, |id| setting.noise_of(id)) {
                let series: Vec<f64> = view.of(&left, rows).iter().zip(&mask).map(|(v, m)| v + m).collect();
                let white = view.whiten(&time, &[&series]);
                let nats = half_square(&white[0]);
                // The loop's tilt at the start is a state, not a misfit: the filter has it within its first minutes.
                let most = if kind == Kind::Channel { 3.0 } else { 0.3 };
                if nats >= most {
                    untrue.push(format!("{kind:?} seed {seed} {:?}: {nats} nats", view.weights));
                }
            }
        }
    }
    assert!(untrue.is_empty(), "{untrue:#?}");
}

/// The figures of the noise are those of the readings: whitened by them, the noise is white and its variance one.
#[test]
fn nominal_noise_is_true() {
    let mut untrue = Vec::new();
    for kind in Kind::ALL.into_iter().filter(|kind| *kind != Kind::Channel) {
        let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
        for seed in 0..8 {
            let setting = Setting::draw(kind, 5500, seed, &mut Draw::new(seed, "test"));
            let rows = simulation::steps(&setting.scenario);
            let run = |scenario| {
                let simulated = simulation::run(&scenario, |_| Ok(())).unwrap();
                oracle::outputs(&setting, &simulated, rows)
            };
            // Rounding is told apart; where it is told, it is noise as well.
            let told = run(setting.scenario.clone());
            let noise = oracle::difference_or_missing(&told, &run(oracle::silent(&setting.scenario)));
            let time: Vec<f64> = (1..=rows).map(|k| k as f64 * setting.scenario.step_s).collect();
            for view in oracle::views(&setting, |id| setting.noise_of(id)) {
                let series = view.of(&noise, rows);
                let white = view.whiten(&time, &[&series]);
                let told: Vec<f64> = white[0].iter().copied().filter(|e| e.is_finite()).collect();
                squares += told.iter().map(|e| e * e).sum::<f64>();
                products += told.windows(2).map(|e| e[0] * e[1]).sum::<f64>();
                count += told.len() as f64;
            }
        }
        // Four standard deviations.
        let (variance, correlation) = (squares / count - 1.0, products / count);
        if variance.abs() > 4.0 * (2.0 / count).sqrt() || correlation.abs() > 4.0 / count.sqrt() {
            untrue.push(format!(
                "{kind:?}: variance 1 + {variance}, correlation {correlation}, {count} readings"
            ));
        }
    }
    assert!(untrue.is_empty(), "{untrue:#?}");
}

const PLAN: &str = r#"
format = "schuler-plan/1"
title = "Test"
most_rows = 2500
gain_nats = [20, 200]
[[group]]
name = "nothing"
cases = 3
[[group]]
name = "terms"
cases = 5
effects = ["bias_step", "bias_temperature", "scale_factor", "noise_white"]
settings = ["bench", "log", "radio"]
[[group]]
name = "several"
cases = 2
effects = ["bias_step", "bias_drift_linear", "bias_temperature"]
settings = ["block"]
at_once = 3
[[group]]
name = "outside"
cases = 2
families = ["outside"]
settings = ["bench"]
"#;

fn plan(directory: &Path) -> PlanFile {
    let path = directory.join("plan.toml");
    std::fs::write(&path, PLAN).unwrap();
    Plan::read(&path).unwrap()
}

/// The number of a case from the path of its file.
fn index(case: &Path) -> usize {
    case.parent().unwrap().file_name().unwrap().to_string_lossy().parse().unwrap()
}

#[expect(clippy::unnecessary_wraps, reason = "an explainer may fail")]
fn knows_nothing(_: &Path) -> anyhow::Result<Value> {
    Ok(json!({ "format": "schuler-explanation/1", "verdict": "no_mismatch", "findings": [] }))
}

/// Makes the case again and tells what was concealed.
fn knows_everything(plan: &PlanFile, seed: u64, case: &Path) -> Value {
    let index = index(case);
    let group = plan.plan.group(index).unwrap();
    let made = maker::make(group, index, seed_of(seed, index), &|| Ok(())).unwrap();
    let findings: Vec<Value> = made
        .answer
        .effects
        .iter()
        .map(|it| {
            let parameters: Vec<Value> = it
                .parameters
                .iter()
                .map(|p| json!({ "name": p.name, "value": p.value * 1.01, "sigma": p.value.abs() * 0.01, "unit": p.unit }))
                .collect();
            json!({ "sensor": it.sensor, "effect": it.effect, "class": [it.effect], "parameters": parameters,
                    "interval_s": it.interval_s.unwrap_or([0.0, 1e9]) })
        })
        .collect();
    let samples = made.gain.iter().filter(|g| g.is_finite()).count() as f64;
    let gain: f64 = made.gain.iter().filter(|g| g.is_finite()).sum();
    json!({ "format": "schuler-explanation/1", "verdict": "explained", "findings": findings,
            "fit": { "held_out": { "before": { "nll_per_sample": gain / samples }, "after": { "nll_per_sample": 0.0 },
                                   "intervals_s": [[0.0, 1e9]], "samples": samples } } })
}

#[test]
fn scoring_judges_ignorance_and_knowledge_and_no_case_is_run_twice() {
    let directory = tempfile::tempdir().unwrap();
    let plan = plan(directory.path());
    let all: Vec<usize> = (0..plan.plan.cases()).collect();
    let bars = Bars { gain_nats: 5.0, ..Bars::default() };
    let figures = |scores: &[_]| summary(scores, &bars).families.remove(0).figures;

    let nothing = directory.path().join("nothing");
    let campaign = Campaign { plan: &plan, seed: 9, cases: &all, directory: &nothing, keep: false };
    let scores = campaign.run(&knows_nothing, &|_| (), &|| Ok(())).unwrap();
    let found = figures(&scores);
    assert_eq!((found[0].value, found[0].standing), (0.0, Standing::Missed));
    assert_eq!((found[1].value, found[1].count), (0.0, 3));
    assert!(found[5].value > 15.0, "{:?}", found[5]);
    assert!(!nothing.join("cases").join("0000").exists());

    let everything: PathBuf = directory.path().join("everything");
    let asked = AtomicUsize::new(0);
    let explainer = |case: &Path| {
        asked.fetch_add(1, Ordering::Relaxed);
        // Before the answer may be known, its seal is there and it is not.
        let seals = everything.join("seals").join(format!("{:04}.txt", index(case)));
        assert!(
            seals.exists() && !everything.join("answers").join(format!("{:04}.json", index(case))).exists()
        );
        Ok(knows_everything(&plan, 9, case))
    };
    let campaign = Campaign { plan: &plan, seed: 9, cases: &all, directory: &everything, keep: true };
    let scores = campaign.run(&explainer, &|_| (), &|| Ok(())).unwrap();
    let found = figures(&scores);
    // Where everything is found, half are found somewhere below the smallest gain.
    for figure in found.iter().filter(|figure| figure.interval[0] > 0.0 || figure.count == 3) {
        assert!(figure.standing == Standing::Reached, "{figure:?}");
    }
    assert_eq!((found[0].value, found[2].value, found[3].value, found[4].value), (1.0, 0.0, 1.0, 1.0));
    assert!(
        scores
            .iter()
            .flat_map(|s| &s.effects)
            .flat_map(|e| &e.parameters)
            .all(|p| { p.deviations().is_some_and(|d| (d - 1.0).abs() < 1e-6) })
    );
    assert_eq!(scores.iter().filter(|s| s.family == Family::Outside).count(), 2);

    assert_eq!(asked.load(Ordering::Relaxed), all.len());
    std::fs::remove_file(everything.join("results").join("0004.json")).unwrap();
    let again = |case: &Path| {
        asked.fetch_add(1, Ordering::Relaxed);
        Ok(knows_everything(&plan, 9, case))
    };
    let rerun = campaign.run(&again, &|_| (), &|| Ok(())).unwrap();
    assert_eq!(asked.load(Ordering::Relaxed), all.len() + 1);
    assert_eq!(
        rerun.iter().map(|s| &s.effects).collect::<Vec<_>>(),
        scores.iter().map(|s| &s.effects).collect::<Vec<_>>()
    );
    assert_eq!(seed_in(&everything, &plan, None).unwrap(), Some(9));
    assert!(seed_in(&everything, &plan, Some(10)).is_err());

    // An answer that is changed afterwards does not fit its seal.
    let files = Files { directory: everything.clone() };
    let answer: Answer = files.open(4).unwrap();
    assert_eq!(answer.index, 4);
    let text = std::fs::read_to_string(files.answer(4)).unwrap();
    std::fs::write(files.answer(4), text.replace("\\\"index\\\": 4", "\\\"index\\\": 5")).unwrap();
    assert!(files.open(4).unwrap_err().to_string().contains("not the one that was sealed"));
}

#[test]
fn a_campaign_can_be_stopped_and_its_results_are_whole() {
    let directory = tempfile::tempdir().unwrap();
    let plan = plan(directory.path());
    let out = directory.path().join("out");
    let done = AtomicUsize::new(0);
    let campaign =
        Campaign { plan: &plan, seed: 9, cases: &[0, 1, 2, 3, 4, 5], directory: &out, keep: false };
    let stopped = campaign.run(
        &knows_nothing,
        &|_| {
            done.fetch_add(1, Ordering::Relaxed);
        },
        &|| {
            if done.load(Ordering::Relaxed) >= 2 { Err(host_sim::output::Interrupted) } else { Ok(()) }
        },
    );
    assert!(stopped.is_err());
    let whole = std::fs::read_dir(out.join("results"))
        .unwrap()
        .flatten()
        .filter(|entry| serde_json::from_slice::<Value>(&std::fs::read(entry.path()).unwrap()).is_ok());
    assert!(whole.count() >= 2);
}

#[test]
fn the_plans_that_come_with_the_project_are_plans() {
    let plans = Path::new(env!("CARGO_MANIFEST_DIR")).join("plans");
    let small = Plan::read(&plans.join("small.toml")).unwrap();
    let full = Plan::read(&plans.join("full.toml")).unwrap();
    assert!(small.warnings.is_empty() && full.warnings.is_empty());
    assert!(full.plan.cases() >= 1000 && small.plan.cases() <= 80);
    // Whoever runs them gets cases that nobody has seen.
    assert!(small.plan.seed.is_none() && full.plan.seed.is_none());
}
