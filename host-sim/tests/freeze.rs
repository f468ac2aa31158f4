//! Freezing from end to end, as a user runs it: a record that is stopped goes on, and two engines
//! are compared.
use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use host_sim::campaign::freeze::record::{Outcome, Record};
use serde_json::{Value, json};

const PLAN: &str = r#"
format = "schuler-plan/1"
title = "Two cases"
most_rows = 1200
gain_nats = [80.0, 80.0]
inexact = 0.0
[[group]]
name = "nothing"
cases = 1
settings = ["bench"]
[[group]]
name = "step"
cases = 1
effects = ["bias_step"]
settings = ["bench"]
"#;

fn schuler(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output();
    output.unwrap_or_else(|error| panic!("{error}"))
}

fn done(arguments: &[&str]) -> String {
    let output = schuler(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap_or_else(|| panic!("{}", path.display()))
}

#[test]
fn a_record_of_a_plan_goes_on_where_it_was_stopped_and_is_compared() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("two.toml"), folder.path().join("first/two.jsonl"));
    std::fs::write(&plan, PLAN).unwrap();
    let all =
        ["campaign", "freeze", "--plan", text(&plan), "--seed", "3", "--commit", "abc", "--out", text(&out)];
    done(&[&all[..], &["--most", "1"]].concat());
    let begun = Record::read(&out).unwrap();
    assert_eq!((begun.rows.len(), begun.header.cases, begun.header.set.as_str()), (1, 2, "two"));
    done(&all);
    let whole = Record::read(&out).unwrap();
    assert_eq!((whole.rows.len(), &whole.rows[0]), (2, &begun.rows[0]));
    let step = whole.rows.iter().find(|row| row.group == "step").unwrap();
    assert_eq!(step.truth.as_ref().unwrap()[0].effect, "bias_step");
    assert_eq!(step.score.as_ref().unwrap().effects, [Outcome::Right]);
    // A record of another commit is not mixed with this one.
    let other = all.map(|word| if word == "abc" { "abd" } else { word });
    assert_eq!(schuler(&other).status.code(), Some(2));

    let compared: Value = serde_json::from_str(&done(&[
        "--json",
        "campaign",
        "compare",
        text(&out),
        text(out.parent().unwrap()),
    ]))
    .unwrap();
    assert_eq!((&compared["cases"], &compared["differences"]), (&json!(2), &json!([])));
    assert_eq!(compared["figures"][0]["rates"][0]["hits"], 1);
}

#[test]
fn cases_of_others_are_judged_by_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let (cases, truth) = (folder.path().join("cases"), folder.path().join("answers"));
    for name in ["a", "b"] {
        let place = cases.join(name);
        std::fs::create_dir_all(&place).unwrap();
        let mut table = "t,gyro\n".to_owned();
        let mut random = 1_u32;
        for k in 0..600 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = f64::from(random >> 8) / f64::from(1 << 24) - 0.5;
            let jump = if k < 300 { 0.0 } else { 1.0 };
            writeln!(table, "{k},{}", 0.1 * noise + jump).unwrap();
        }
        std::fs::write(place.join("recording.csv"), table).unwrap();
        let case = "format = \"schuler-case/1\"\ntitle = \"Gyro\"\n\
            recording = { path = \"recording.csv\", time = \"t\", step_s = 1.0 }\n\
            motion = { kind = \"static\", attitude_deg = { roll = 0.0, pitch = 0.0, heading = 90.0 } }\n\
            site = { latitude_deg = 0.0, altitude_m = 0.0 }\n\
            [[sensor]]\nid = \"gyro\"\nkind = \"mems_gyro\"\ncolumn = \"gyro\"\nunit = \"deg/s\"\n\
            axis = [0.0, 0.0, 1.0]\nnominal = { bias = 0.0, white = 0.03 }\n";
        std::fs::write(place.join("case.toml"), case).unwrap();
        let hidden = json!({ "sensor": "gyro", "effect": "bias_step", "gain_nats": 900.0, "onset_s": 300.0,
            "parameters": { "coefficient": 1.0_f64.to_radians() } });
        let (kind, effects) = if name == "a" { ("hidden", json!([hidden])) } else { ("null", json!([])) };
        let answer =
            json!({ "kind": kind, "family": "at rest", "step_s": 1.0, "rows": 600, "effects": effects });
        std::fs::create_dir_all(&truth).unwrap();
        std::fs::write(truth.join(format!("{name}.json")), answer.to_string()).unwrap();
    }
    let out = folder.path().join("theirs.jsonl");
    let told = ["--truth", text(&truth), "--set", "theirs", "--commit", "abc", "--out", text(&out)];
    done(&[&["campaign", "freeze", "--cases", text(&cases)], &told[..]].concat());
    let record = Record::read(&out).unwrap();
    let scores: Vec<_> = record.rows.iter().map(|row| row.score.as_ref().unwrap()).collect();
    assert_eq!(scores[0].effects, [Outcome::Right]);
    assert!(scores[0].parameters[0].deviations.unwrap() < 3.0, "{:?}", scores[0].parameters);
    // The same recording, of which its maker says that nothing is hidden in it.
    assert_eq!(scores[1].false_findings, ["gyro bias_step"]);
    // Where the engine does not come to an end it is ended, and the record says so.
    let ended = folder.path().join("ended.jsonl");
    done(&["campaign", "freeze", "--cases", text(&cases), "--limit-s=-1", "--out", text(&ended)]);
    let failure = Record::read(&ended).unwrap().rows[0].failure.clone().unwrap();
    assert!(failure.contains("ended after"), "{failure}");
    assert!(!failure.contains(text(folder.path())), "{failure}");
}
