//! Real recordings: what the explanation says, what it gains where it was not fitted, and whether calculations that share
//! no code with it agree.
//!
//! `tests/real/*.py` are those calculations (numpy, scipy, statsmodels, in the virtual environment of the other oracle). For
//! each case they give estimates with standard deviations, the names that describe rightly what is there, and those
//! without which an explanation is none. The recordings are looked for in `SCHULER_DATA`, else in `../shared/data` beside
//! the project.
//!
//! Where they agree they must go on agreeing. `cargo test -p schuler-tests explain_real:: -- --ignored --nocapture` prints where the others
//! differ.
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding, Member, Parameter};
use schuler_recording::Recording;
use schuler_tests::python::python;
use serde_json::Value;

/// How many combined standard deviations two estimates may be apart.
const LARGEST_DISTANCE: f64 = 3.0;

/// Recordings of which every name is borne out, every value that can be compared agrees, and nothing is missing.
const AGREED: [&str; 2] = ["quartz_gravimeter/segment_62h", "mems_hot_cold/cold"];

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Folder of the recordings, if it is there.
fn recordings() -> Option<PathBuf> {
    let root =
        std::env::var_os("SCHULER_DATA").map_or_else(|| project().join("../shared/data"), PathBuf::from);
    if root.is_dir() {
        return root.canonicalize().ok();
    }
    eprintln!("SKIPPED: no real recordings at {} (set SCHULER_DATA)", root.display());
    None
}

fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}:\n{said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// What was calculated without us about one case.
///
/// A value means what it does beside what else is fitted. An estimate may say which `beside` of the case's `optional` effects it
/// was made, and counts for an explanation that names these of the sensor and its instrument and no others; and `without` which sensors'
/// having that effect, as in a redundant set only differences are seen. Given more than once for
/// the same names, beside what an explanation may hold and not name (as too little to be told), the nearest counts. What an explanation
/// shares between a sensor and its instrument is added up by the rules of `also`.
struct Independent {
    estimates: Vec<Value>,
    optional: Vec<String>,
    names: BTreeMap<String, Vec<String>>,
    required: Vec<(String, String)>,
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

fn independent(case: &Value) -> Independent {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let names = case["names"].as_object().into_iter().flatten();
    Independent {
        estimates: list(&case["estimates"]),
        optional: list(&case["optional"]).iter().map(text).collect(),
        names: names
            .map(|(sensor, effects)| (sensor.clone(), list(effects).iter().map(text).collect()))
            .collect(),
        required: list(&case["required"]).iter().map(|pair| (text(&pair[0]), text(&pair[1]))).collect(),
    }
}

/// Factor from `unit` to SI (temperatures and ratios as they are); a quotient is one of its parts.
fn in_si(unit: &str) -> Option<f64> {
    let degree = std::f64::consts::PI / 180.0;
    let units = [
        ("rad/s", 1.0),
        ("deg/s", degree),
        ("deg/h", degree / 3600.0),
        ("m/s^2", 1.0),
        ("mm/s^2", 1e-3),
        ("mg", 9.80665e-3),
        ("ug", 9.80665e-6),
        ("g", 9.80665),
        ("m/s", 1.0),
        ("ppm", 1e-6),
        ("arcsec", degree / 3600.0),
        ("mrad", 1e-3),
        ("rad", 1.0),
        ("deg", degree),
        ("g^2", 9.80665 * 9.80665),
        ("K^2", 1.0),
        ("K", 1.0),
        ("Hz", 1.0),
        ("sqrt(s", 1.0),
        ("ms", 1e-3),
        ("s", 1.0),
        ("h", 3600.0),
        ("m", 1.0),
        ("1", 1.0),
        ("", 1.0),
    ];
    let unit = unit.trim_start_matches('(').trim_end_matches(')');
    let whole = |unit: &str| units.iter().find(|(name, _)| *name == unit).map(|&(_, factor)| factor);
    whole(unit).or_else(|| {
        // From the right: in deg/h/(K/h) the numerator is deg/h.
        unit.rmatch_indices('/')
            .find_map(|(slash, _)| Some(whole(&unit[..slash])? / in_si(&unit[slash + 1..])?))
    })
}

/// The finding's word of the name, e.g. which column or axis.
fn word<'f>(finding: &'f Finding, name: &str) -> Option<&'f str> {
    finding.parameters.iter().find(|parameter| parameter.name == name)?.text.as_deref()
}

/// Value and standard deviation of a parameter in SI.
fn value_in_si(parameter: &Parameter) -> Option<(f64, f64)> {
    let unit = in_si(parameter.unit.as_deref()?)?;
    Some((parameter.value? * unit, parameter.sigma? * unit))
}

/// Whether an estimate was made beside what the explanation names of the sensor and of the instrument that it is part of.
fn of_the_same_structure(independent: &Independent, findings: &[Finding], estimate: &Value) -> bool {
    let Some(beside) = estimate["beside"].as_array() else { return true };
    let sensor = text(&estimate["sensor"]);
    let meet = |other: &str| other.starts_with(&sensor) || sensor.starts_with(other);
    independent.optional.iter().all(|effect| {
        let named = findings.iter().any(|finding| finding.effect == *effect && meet(&finding.sensor));
        named == beside.iter().any(|other| other == effect.as_str())
    })
}

/// Whether the explanation names the estimate's effect of a sensor of which it was made as if that had none.
fn is_named_elsewhere(findings: &[Finding], estimate: &Value) -> bool {
    let without = estimate["without"].as_array();
    without.into_iter().flatten().any(|sensor| {
        let is_it = |finding: &Finding| {
            *sensor == finding.sensor.as_str() && estimate["effect"] == finding.effect.as_str()
        };
        findings.iter().any(is_it)
    })
}

/// What other findings add to a parameter that an estimate is of, and its variance, in SI.
fn shared(findings: &[Finding], estimate: &Value) -> (f64, f64) {
    let rules = estimate["also"].as_array().into_iter().flatten();
    let parts = rules.filter_map(|rule| {
        let finding = findings.iter().find(|finding| {
            rule["sensor"] == finding.sensor.as_str() && rule["effect"] == finding.effect.as_str()
        })?;
        let parameter =
            finding.parameters.iter().find(|parameter| rule["parameter"] == parameter.name.as_str())?;
        let ((value, sigma), factor) = (value_in_si(parameter)?, rule["factor"].as_f64()?);
        Some((factor * value, (factor * sigma).powi(2)))
    });
    parts.fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
}

/// What other steps of the same sensor add to an estimate of how far its level changes within a tenth of a second, the time that
/// the calculation averages over, and their variance, in SI.
fn within_the_change(findings: &[Finding], finding: &Finding, estimate: &Value) -> (f64, f64) {
    const CHANGE_S: f64 = 0.1;
    let Some(change_s) = estimate["onset_s"].as_f64() else { return (0.0, 0.0) };
    let number = |finding: &Finding, name: &str| {
        finding.parameters.iter().find(|parameter| parameter.name == name).and_then(value_in_si)
    };
    let others = findings.iter().filter(|other| {
        let onset_s = number(other, "onset_s").map_or(f64::INFINITY, |(onset_s, _)| onset_s);
        !std::ptr::eq(*other, finding)
            && (&other.sensor, &other.effect) == (&finding.sensor, &finding.effect)
            && (onset_s - change_s).abs() <= CHANGE_S
    });
    let parts = others.filter_map(|other| number(other, "coefficient"));
    parts.fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1.powi(2)))
}

/// Distance in combined standard deviations to the nearest independent estimate of the same parameter.
fn distance(
    independent: &Independent,
    findings: &[Finding],
    finding: &Finding,
    parameter: &Parameter,
) -> Option<f64> {
    let (value, sigma) = value_in_si(parameter)?;
    let same = independent.estimates.iter().filter(|estimate| {
        estimate["sensor"] == finding.sensor.as_str()
            && estimate["effect"] == finding.effect.as_str()
            && estimate["parameter"] == parameter.name.as_str()
            && ["axis", "column"].iter().all(|key| match (estimate[*key].as_str(), word(finding, key)) {
                (Some(theirs), Some(ours)) => theirs == ours,
                _ => true,
            })
            && of_the_same_structure(independent, findings, estimate)
            && !is_named_elsewhere(findings, estimate)
    });
    let distances = same.filter_map(|estimate| {
        let factor = in_si(estimate["unit"].as_str()?)?;
        let (theirs, spread) = (estimate["value"].as_f64()? * factor, estimate["sigma"].as_f64()? * factor);
        let (more, variance) = shared(findings, estimate);
        let (steps, of_steps) = within_the_change(findings, finding, estimate);
        let apart = (value + more + steps - theirs).abs();
        Some(apart / (sigma * sigma + variance + of_steps + spread * spread).sqrt())
    });
    distances.min_by(f64::total_cmp)
}

fn described(independent: &Independent, findings: &[Finding], finding: &Finding) -> String {
    let mut line = format!("{} {}", finding.sensor, finding.effect);
    if !finding.rivals().is_empty() {
        let rivals = finding.rivals().iter().map(|rival| format!("{} {}", rival.sensor, rival.effect));
        let _ = write!(line, " [{}]", rivals.collect::<Vec<_>>().join(", "));
    }
    for parameter in &finding.parameters {
        let unit = parameter.unit.as_deref().unwrap_or_default();
        match (parameter.value, &parameter.text) {
            (Some(value), _) => {
                let sigma = parameter.sigma.unwrap_or(f64::NAN);
                let _ = write!(line, ", {} {value:.4e} ± {sigma:.1e} {unit}", parameter.name);
                if let Some(distance) = distance(independent, findings, finding, parameter) {
                    let _ = write!(line, " ({distance:.1} σ from the independent value)");
                }
            }
            (None, Some(text)) => {
                let _ = write!(line, ", {} {text}", parameter.name);
            }
            (None, None) => {}
        }
    }
    let [from, to] = finding.interval_s;
    let _ = write!(line, "; {from:.0} to {to:.0} s, {:.1} nats", finding.evidence.gain_nats);
    line
}

/// Coloured noise has other values in another structure, and another line is another finding, not another value.
fn comparable(finding: &Finding, parameter: &Parameter) -> bool {
    let coloured = finding.effect.starts_with("noise_") && finding.effect != "noise_white";
    !coloured && parameter.name != "frequency_hz"
}

/// Where explanation and calculation differ.
fn disagreements(case: &str, independent: &Independent, explanation: &Explanation) -> Vec<String> {
    let (mut wrong, findings) = (Vec::new(), explanation.findings.as_slice());
    for finding in findings {
        let is_of = |sensor: &String, effect: &String| {
            independent.names.get(sensor).is_some_and(|names| names.contains(effect))
        };
        // What sensors have in common must be right of each of them.
        let is_right = |member: &Member| match finding.sensors.as_slice() {
            sensors if !sensors.is_empty() && member.sensor == finding.sensor => {
                sensors.iter().all(|sensor| is_of(sensor, &member.effect))
            }
            _ => is_of(&member.sensor, &member.effect),
        };
        if !finding.class.iter().any(is_right) {
            wrong.push(format!("{case}: WRONG NAME: {}", described(independent, findings, finding)));
        }
        for parameter in finding.parameters.iter().filter(|parameter| comparable(finding, parameter)) {
            let distance = distance(independent, findings, finding, parameter);
            if distance.is_some_and(|distance| distance > LARGEST_DISTANCE) {
                let name = &parameter.name;
                wrong.push(format!(
                    "{case}: OTHER VALUE of {name}: {}",
                    described(independent, findings, finding)
                ));
            }
        }
    }
    for (sensor, effect) in &independent.required {
        // Several names for what cannot be told apart, e.g. a line and a narrow band of noise.
        let named =
            |member: &Member| member.sensor == *sensor && effect.split('|').any(|name| member.effect == name);
        let found = |finding: &Finding| finding.class.iter().any(named);
        if !findings.iter().any(found) {
            wrong.push(format!("{case}: MISSING: {sensor} {effect}"));
        }
    }
    wrong
}

/// Explains the cases of `script` that are `wanted`, prints the table, and fails where explanation and calculation differ.
fn check(script: &str, wanted: impl Fn(&str) -> bool) {
    let Some(root) = recordings() else { return };
    let (python, folder) = (python(), Path::new(env!("CARGO_TARGET_TMPDIR")).join("real-cases").join(script));
    let of = |name: &str| {
        let mut command = Command::new(python);
        command.arg(project().join("tests/real").join(format!("{name}.py"))).env("SCHULER_DATA", &root);
        command
    };
    run(of("make_cases").arg(&folder));
    let answer = run(of(script).arg(&folder));
    let answer: Value = serde_json::from_str(&answer).expect("the script prints JSON");
    let mut wrong = Vec::new();
    let cases = answer["cases"].as_object().into_iter().flatten();
    let cases: Vec<_> = cases.filter(|(case, _)| wanted(case)).collect();
    assert!(!cases.is_empty(), "{script} calculates none of the cases that are asked for");
    for (case, calculated) in cases {
        let independent = independent(calculated);
        let beside = root.join(format!("{case}.toml"));
        let path = if beside.exists() { beside } else { folder.join(format!("{case}.toml")) };
        let recording = Recording::read(&path).unwrap_or_else(|error| panic!("{error:#}"));
        let start = Instant::now();
        let explanation = explain(&recording, &Config::default());
        let explanation = explanation.unwrap_or_else(|error| panic!("{case}: {error}"));
        let held_out = &explanation.fit.held_out;
        println!(
            "\n{case}: {:?}; held-out gain {:.3} nats per sample; {:.1} s",
            explanation.verdict,
            held_out.before.nll_per_sample - held_out.after.nll_per_sample,
            start.elapsed().as_secs_f64()
        );
        for finding in &explanation.findings {
            println!("    {}", described(&independent, &explanation.findings, finding));
        }
        if let Some(remainder) = &explanation.remainder {
            println!("    remains: {}: {}", remainder.sensor, remainder.what);
        }
        for remark in calculated["remarks"].as_array().into_iter().flatten() {
            println!("    independently: {}", text(remark));
        }
        wrong.extend(disagreements(case, &independent, &explanation));
    }
    assert!(wrong.is_empty(), "explanation and calculation differ:\n{}", wrong.join("\n"));
}

fn has_agreed(case: &str) -> bool {
    AGREED.contains(&case)
}

#[test]
fn a_quartz_gravimeter_over_62_hours() {
    check("gravimeter", has_agreed);
}

#[test]
fn a_unit_in_the_cold() {
    check("thermal", has_agreed);
}

#[test]
#[ignore = "explanation and calculation still differ"]
fn what_still_differs() {
    // Of the gyro array in fast motion, and of all its units, nothing but the clipping was calculated.
    let scripts = ["gravimeter", "thermal", "poses", "doppler", "motion", "static_mems", "gyro_array"];
    let checks = scripts.map(|script| std::panic::catch_unwind(|| check(script, |case| !has_agreed(case))));
    assert!(checks.iter().all(Result::is_ok), "see above");
}
