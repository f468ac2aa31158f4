//! The scenarios that come with the simulator: each is read without a warning, runs, and gives a case that reads back.
use std::path::Path;

use host_sim::calibration_table::scenario::{self, CalibrationScenario};
use host_sim::flight::{self, Flown, LoopStates, LoopTruth, On, Summary};
use host_sim::scenario::ScenarioFile;
use host_sim::simulation;
use schuler_core::identification::Method;
use schuler_recording::Recording;
use schuler_recording::case::Sensor;

#[test]
fn every_scenario_runs_and_reads_back() {
    let scenarios = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios");
    let (mut seen, mut runs) = (0, 0);
    for entry in std::fs::read_dir(scenarios).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        if text.contains(scenario::FORMAT) {
            let (_, warnings) = CalibrationScenario::parse(&path, &text).unwrap();
            assert!(warnings.is_empty(), "{}: {warnings:?}", path.display());
            runs += 1;
            continue;
        }
        let file = ScenarioFile::read(&path).unwrap();
        assert!(file.warnings.is_empty(), "{}: {:?}", path.display(), file.warnings);
        let mut scenario = file.scenario;
        scenario.duration_s = scenario.duration_s.min(300.0 * scenario.step_s);
        let simulated = simulation::run(&scenario, |_| Ok(())).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let written = simulated.write(directory.path()).unwrap();
        let recording = Recording::read(&written.case).unwrap();
        assert!(recording.warnings.is_empty(), "{}: {:?}", path.display(), recording.warnings);
        assert_eq!(recording.len(), simulation::steps(&scenario), "{}", path.display());
        let (read, wrote) = (&recording.case, &simulated.case);
        assert_eq!(read.motion, wrote.motion, "{}", path.display());
        assert_eq!(read.schuler_loop, wrote.schuler_loop, "{}", path.display());
        assert_eq!(read.auxiliaries, wrote.auxiliaries, "{}", path.display());
        assert_eq!(read.sensors.len(), wrote.sensors.len(), "{}", path.display());
        for (read, wrote) in read.sensors.iter().zip(&wrote.sensors) {
            let told = |sensor: &Sensor| (sensor.id.clone(), sensor.unit, sensor.nominal.clone());
            assert_eq!(told(read), told(wrote), "{}", path.display());
        }
        for series in &recording.sensors {
            assert_eq!(series.quality.missing, 0, "{}: {}", path.display(), series.sensor.id);
        }
        seen += 1;
    }
    // The calibration runs are made in `tests/calibrate.rs`.
    assert!(seen >= 6 && runs >= 3, "{seen} and {runs}");
}

/// The filter that knows the noise of the simulated loop is consistent: the physics and the filter's model, written apart
/// from each other, agree.
#[test]
fn a_filter_that_knows_the_noise_is_consistent_with_the_simulated_loop() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/schuler_loop.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let known = text
        .replace("{ sigma = 3.1e-4, tau_s = 600.0 }", "{ sigma = 9.80665e-4, tau_s = 60.0 }")
        .replace("{ sigma = 1.53e-7, tau_s = 18000.0 }", "{ sigma = 4.84814e-7, tau_s = 1800.0 }");
    assert_ne!(text, known);
    let mut scenario = ScenarioFile::parse(&path, &known).unwrap().scenario;
    let runs = 12;
    let (mut nees, mut beyond, mut nis, mut white) = (0.0, 0.0, 0.0, 0);
    for seed in 0..runs {
        scenario.seed = 100 + seed;
        let directory = tempfile::tempdir().unwrap();
        let written = simulation::run(&scenario, |_| Ok(())).unwrap().write(directory.path()).unwrap();
        let recording = Recording::read(&written.case).unwrap();
        let mut channel = flight::plan(&recording).unwrap().remove(0);
        channel.config.identification.method = Method::Off;
        let mut truth = LoopTruth::beside(&written.case, &channel.name).unwrap().unwrap();
        let truth: Vec<LoopStates> = recording.time_s.iter().map(|t| truth.at(*t).unwrap()).collect();
        let flown = Flown::of(channel, &recording, On::Host, |_| Ok(())).unwrap();
        let summary = Summary::of(&flown, Some(&truth));
        let filter = summary.filter.unwrap();
        let tilt = &summary.truth.unwrap().states[1];
        nees += tilt.nees / runs as f64;
        beyond += tilt.beyond_three_sigma / runs as f64;
        nis += filter.nis.mean / runs as f64;
        white += u32::from(filter.whiteness.p_value > 0.01);
    }
    // 12 runs of 16 200 s with a correlation time of about 600 s: standard deviation of the mean NEES about 0.07.
    assert!((0.85..1.2).contains(&nees), "NEES {nees}");
    assert!(beyond < 0.008, "beyond 3 sigma {beyond}");
    // 12 × 21 600 innovations: standard deviation 0.0028.
    assert!((nis - 1.0).abs() < 0.01, "NIS {nis}");
    assert!(white >= 11, "{white} of {runs} white");
}
