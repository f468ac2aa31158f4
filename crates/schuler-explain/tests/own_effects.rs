//! Effects that a case defines by formulas, on records whose truth is known.
use std::fmt::Write;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::catalogue::{HAS_NO_TERM, InFlight};
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding};
use schuler_explain::export::compensation::{Stations, deploy};
use schuler_recording::Recording;

const ROWS: usize = 6000;
const STEP_S: f64 = 0.1;
const K: f64 = 1e-4;
const TAU_S: f64 = 40.0;
const WHITE: f64 = 0.02;

const SENSOR: &str = r#"
[[sensor]]
id = "gyro_x"
kind = "fog"
column = "gyro"
unit = "deg/s"
predicted = "rate"
[sensor.nominal]
white = 0.02
[[aux]]
column = "temp"
quantity = "temperature"
unit = "degC"
"#;

const TORSION: &str = r#"
[[effect]]
id = "torsion"
formula = "k * lag(temp, tau_s) * rate"
acts_on = ["fog"]
free = { tau_s = [5.0, 400.0] }
unit = "1/K"
plausible = [1e-6, 1e-2]
"#;

fn times() -> impl Iterator<Item = f64> {
    (0..ROWS).map(|row| STEP_S * row as f64)
}

/// Rate, deg/s, and temperature, °C.
fn rate_and_temperature() -> [Vec<f64>; 2] {
    let rate = times().map(|t| 30.0 * (0.9 * t).sin() + 20.0 * (0.23 * t).cos() + 5.0).collect();
    let temperature = times().map(|t| 25.0 + 10.0 * (0.05 * t).sin() + 3.0 * (0.21 * t).cos()).collect();
    [rate, temperature]
}

/// A gyro that reads its rate and `adds`, with noise.
fn recorded(effect: &str, seed: u64, adds: impl Fn(&[f64], &[f64]) -> Vec<f64>) -> Recording {
    recorded_by(SENSOR, effect, seed, adds)
}

/// The same of another sensor.
fn recorded_by(
    sensor: &str,
    effect: &str,
    seed: u64,
    adds: impl Fn(&[f64], &[f64]) -> Vec<f64>,
) -> Recording {
    let [rate, temperature] = rate_and_temperature();
    let added = adds(&rate, &temperature);
    let mut random = Pcg64::seed_from_u64(seed);
    let mut table = "rate,temp,gyro,zero\n".to_owned();
    for row in 0..ROWS {
        let noise: f64 = StandardNormal.sample(&mut random);
        let gyro = rate[row] + added[row] + WHITE * noise;
        writeln!(table, "{},{},{gyro},{}", rate[row], temperature[row], row % 100).unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    let head = format!("format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\nstep_s = {STEP_S}\n");
    std::fs::write(folder.path().join("case.toml"), head + sensor + effect).unwrap();
    std::fs::write(folder.path().join("r.csv"), table).unwrap();
    Recording::read(&folder.path().join("case.toml")).unwrap_or_else(|error| panic!("{error:#}"))
}

fn nothing(rate: &[f64], _: &[f64]) -> Vec<f64> {
    vec![0.0; rate.len()]
}

fn torsion(rate: &[f64], temperature: &[f64]) -> Vec<f64> {
    // τ Ṫ_lag = T − T_lag over a step in which T goes straight, which is exact; at rest before the first row.
    let kept = (-STEP_S / TAU_S).exp();
    let mut late = temperature[0];
    let mut added = vec![K * late * rate[0]];
    for (pair, rate) in temperature.windows(2).zip(&rate[1..]) {
        let slope = (pair[1] - pair[0]) / STEP_S;
        late = pair[1] - slope * TAU_S + (late - pair[0] + slope * TAU_S) * kept;
        added.push(K * late * rate);
    }
    added
}

fn said(recording: &Recording) -> Explanation {
    explain(recording, &Config::default()).unwrap()
}

fn agrees(finding: &Finding, name: &str, truth: f64, unit: &str) {
    let parameter = finding.parameters.iter().find(|it| it.name == name);
    let parameter = parameter.unwrap_or_else(|| panic!("{name} of {}", finding.sentence));
    let (value, sigma) = (parameter.value.unwrap(), parameter.sigma.unwrap());
    assert!(
        (value - truth).abs() < 3.0 * sigma && sigma < 0.2 * truth.abs(),
        "{value} ± {sigma} for {truth}"
    );
    assert_eq!(parameter.unit.as_deref().unwrap_or_default(), unit);
}

#[test]
fn a_concealed_effect_of_a_formulas_own_shape_is_found_under_its_id() {
    let explanation = said(&recorded(TORSION, 3, torsion));
    let [finding] = explanation.findings.as_slice() else {
        panic!("{:?}", explanation.findings.iter().map(|it| &it.sentence).collect::<Vec<_>>());
    };
    assert_eq!((finding.sensor.as_str(), finding.effect.as_str()), ("gyro_x", "torsion"));
    agrees(finding, "k", K, "1/K");
    agrees(finding, "tau_s", TAU_S, "s");
    let expected = "gyro_x shows torsion, k * lag(temp, tau_s) * rate: k ";
    assert!(finding.sentence.starts_with(expected), "{}", finding.sentence);
}

#[test]
fn nothing_is_told_of_a_record_without_it() {
    for seed in 0..3 {
        let explanation = said(&recorded(TORSION, 100 + seed, nothing));
        let told: Vec<&str> = explanation.findings.iter().map(|it| it.sentence.as_str()).collect();
        assert!(told.is_empty(), "{told:?}");
    }
}

/// What a row of the catalogue describes is told by its name, and not by a formula that could bend to it.
#[test]
fn the_catalogue_competes() {
    let explanation = said(&recorded(TORSION, 5, |rate, _| rate.iter().map(|rate| 2e-3 * rate).collect()));
    let effects: Vec<&str> = explanation.findings.iter().map(|it| it.effect.as_str()).collect();
    assert_eq!(effects, ["scale_factor"]);
}

#[test]
fn several_amplitudes_have_a_value_each() {
    let effect = "[[effect]]\nid = \"drag\"\nformula = \"a * rate * abs(rate) + b * d(temp) * u\"\n\
                  acts_on = [\"gyro_x\"]\n";
    let explanation = said(&recorded(effect, 7, |rate, _| {
        let slope = times().map(|t| 0.5 * (0.05 * t).cos() - 0.63 * (0.21 * t).sin());
        rate.iter().zip(slope).map(|(rate, slope)| 1e-5 * rate * rate.abs() + 3e-3 * slope * rate).collect()
    }));
    let finding = explanation.findings.iter().find(|it| it.effect == "drag");
    let told = || explanation.findings.iter().map(|it| &it.sentence).collect::<Vec<_>>();
    let finding = finding.unwrap_or_else(|| panic!("{:?}", told()));
    agrees(finding, "a", 1e-5, "");
    agrees(finding, "b", 3e-3, "");
}

#[test]
fn what_cannot_be_sought_is_named_by_line_and_field() {
    let refused = |effect: &str| {
        let error = explain(&recorded(effect, 1, nothing), &Config::default()).unwrap_err();
        (error.problem().line, error.to_string())
    };
    for id in ["bias_step", "noise_of_my_own"] {
        let (line, said) = refused(&TORSION.replace("\"torsion\"", &format!("\"{id}\"")));
        assert_eq!(line, Some(20), "{said}");
        let expected =
            format!("effect[0].id: found \"{id}\", an effect of the catalogue; expected a name of its own");
        assert_eq!(said, expected);
    }
    let with = |formula: &str| TORSION.replace("k * lag(temp, tau_s) * rate", formula);
    let (line, said) = refused(&with("k * lag(temp, tau_s) / zero"));
    assert_eq!(line, Some(21), "{said}");
    let expected = "effect[0].formula: character 22: found a division by zero in 60 rows, the first of them row 1, at 0 s";
    assert!(said.starts_with(expected), "{said}");
    let (_, said) = refused(&with("k * sqrt(temp - tau_s)"));
    assert!(said.contains("character 5: found the square root of a number below zero in"), "{said}");
    // A sensor of another kind, which no simulator predicts.
    let sensor = SENSOR.replace("kind = \"fog\"", "kind = \"other\"").replace("predicted = \"rate\"\n", "");
    let effect = with("k * lag(temp, tau_s) * u").replace("\"fog\"", "\"gyro_x\"");
    let said =
        explain(&recorded_by(&sensor, &effect, 1, nothing), &Config::default()).unwrap_err().to_string();
    let expected =
        "effect[0].formula: character 24: found u, the sensor's input, which the case does not tell";
    assert!(said.starts_with(expected), "{said}");
}

#[test]
fn the_flight_module_has_no_term_for_it() {
    let recording = recorded(TORSION, 3, torsion);
    let effect = schuler_explain::catalogue::named("torsion");
    assert!(effect.is_none());
    let explanation = said(&recording);
    let exported = deploy(&explanation, &recording, &Stations::default());
    let InFlight::Never(because) = HAS_NO_TERM else { panic!("a term") };
    let of_it = exported.findings.iter().find(|it| it.effect == "torsion").unwrap();
    assert_eq!(of_it.because.as_deref(), Some(because));
}
