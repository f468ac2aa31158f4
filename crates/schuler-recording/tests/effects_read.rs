//! Effects of the user's own: what is read of them, and every mistake by file, line, field and place in the formula.
use std::fs;

use schuler_recording::recording::Stream;
use schuler_recording::{CaseFile, Error, Recording};
use tempfile::TempDir;

const CASE: &str = r#"format = "schuler-case/1"
[recording]
path = "r.csv"
step_s = 1.0
[[sensor]]
id = "gyro_x"
kind = "fog"
column = "counts"
scale = 0.5
unit = "deg/h"
axis = [1.0, 0.0, 0.0]
group = "block"
[[aux]]
column = "T"
quantity = "temperature"
unit = "degF"
scale = 2.0
offset = -1.0
[[effect]]
id = "torsion"
formula = "k * lag(T, tau_s) * `rate x` + c * counts^p"
acts_on = ["gyro_x", "block", "fog"]
unit = "deg/h/K"
plausible = [1e-4, 1e-1]
free = { tau_s = [10.0, 3600.0], p = [1, 2] }
"#;
const TABLE: &str = "counts,T,rate x,other\n1,20,0.1,5\n2,21,,6\n3,22,0.3,7\n";

fn folder(case: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("case.toml"), case).unwrap();
    fs::write(folder.path().join("r.csv"), TABLE).unwrap();
    folder
}

fn read(case: &str) -> Result<Recording, String> {
    let folder = folder(case);
    Recording::read(&folder.path().join("case.toml"))
        .map_err(|error| error.to_string().replace(&format!("{}/", folder.path().display()), ""))
}

#[test]
fn every_key_is_read_and_columns_are_in_the_units_of_the_case() {
    let recording = read(CASE).unwrap();
    let effect = &recording.case.effects[0];
    assert_eq!((effect.id.as_str(), effect.unit.as_str()), ("torsion", "deg/h/K"));
    assert_eq!(effect.plausible, Some([1e-4, 1e-1]));
    assert_eq!((effect.free["tau_s"], effect.free["p"]), ([10.0, 3600.0], [1.0, 2.0]));
    assert_eq!(effect.lines, [Some(20), Some(21)]);
    let columns: Vec<(&str, [f64; 2])> =
        (recording.in_formulas.iter()).map(|it| (it.column.as_str(), [it.values[0], it.values[2]])).collect();
    assert_eq!(columns, [("T", [39.0, 43.0]), ("rate x", [0.1, 0.3]), ("counts", [0.5, 1.5])]);
    assert!(recording.in_formulas[1].values[1].is_nan());
    assert_eq!(recording.warnings.len(), 1, "{:?}", recording.warnings);
}

#[test]
fn a_case_with_effects_is_written_as_it_was_read() {
    let folder = folder(CASE);
    let mut file = CaseFile::read(&folder.path().join("case.toml")).unwrap();
    let text = file.case.to_toml().unwrap();
    let again = CaseFile::parse("case.toml".as_ref(), &text);
    let mut again = again.unwrap_or_else(|error| panic!("{error:#}\n{text}"));
    for effect in [&mut file, &mut again].into_iter().flat_map(|file| &mut file.case.effects) {
        effect.lines = [None; 2];
    }
    assert_eq!(again.case, file.case);
}

#[test]
fn chunks_have_the_columns_of_formulas() {
    let folder = folder(CASE);
    let file = CaseFile::read(&folder.path().join("case.toml")).unwrap();
    let stream = Stream::open(file, |_| Ok::<_, Error>(())).unwrap();
    let chunk = stream.chunks().unwrap().next().unwrap().unwrap();
    assert_eq!(chunk.in_formulas[0].values, [39.0, 41.0, 43.0]);
}

#[test]
fn every_mistake_is_named_by_file_line_field_and_place() {
    let with = |formula: &str| CASE.replace("k * lag(T, tau_s) * `rate x` + c * counts^p", formula);
    for (case, said) in [
        (
            with("k * sine(T)"),
            "case.toml:21: effect[0].formula: character 5: found the function \"sine\"; expected one of sin, cos, exp, log, \
             sqrt, abs, sign, min, max, d, lag, delay, step; did you mean \"sin\"?",
        ),
        (
            with("k * (T"),
            "case.toml:21: effect[0].formula: character 7: found the end; expected \"(\", \")\", \"*\", \"**\", \"+\", \"-\", \"/\", \"^\"",
        ),
        (
            with("k * lag(T)"),
            "case.toml:21: effect[0].formula: character 5: found lag of 1; expected lag of 2 arguments",
        ),
        (
            with("k * `rat x` + tau_s + p"),
            "case.toml:21: effect[0].formula: character 5: found `rat x`; expected a column of the table; did you mean `rate x`?",
        ),
        (
            with("k * othr * tau_s ^ p"),
            "case.toml:21: effect[0].formula: character 3: found k times othr; expected a formula that is linear in its \
             amplitudes: list what is none in `free`, with its range; no column is called othr, but one is called other",
        ),
        (
            with("sin(k * t) * tau_s * p"),
            "case.toml:21: effect[0].formula: character 1: found k within sin(…); expected a formula that is linear",
        ),
        (
            with("k * T * tau_s + p"),
            "case.toml:21: effect[0].formula: character 15: found a part with k added to one without an amplitude; expected \
             nothing where all amplitudes are 0",
        ),
        (
            with("T * tau_s * p"),
            "case.toml:21: effect[0].formula: character 1: found no amplitude; expected a name",
        ),
        (
            with("k * delay(T, t) + k * tau_s * p"),
            "case.toml:21: effect[0].formula: character 14: found a delay that varies; expected a number or a parameter",
        ),
        (
            CASE.replace("\"block\", \"fog\"", "\"gyro_y\""),
            "case.toml:22: effect[0].acts_on[1]: found \"gyro_y\"; expected the id, group or kind of a sensor of the case; \
             did you mean \"gyro_x\"?",
        ),
        (
            CASE.replace("[\"gyro_x\", \"block\", \"fog\"]", "[]"),
            "case.toml:22: effect[0].acts_on: found none; expected at least one id, group or kind of a sensor",
        ),
        (
            CASE.replace("[10.0, 3600.0]", "[10.0, 1.0]"),
            "case.toml:25: effect[0].free.tau_s: found [10, 1]; expected the smallest and the largest value",
        ),
        (
            CASE.replace("p = [1, 2]", "p = [1, 2], taus = [1, 2]"),
            "case.toml:25: effect[0].free.taus: found a name that is not in the formula; expected one that is; did you \
             mean tau_s?",
        ),
        (
            CASE.replace("p = [1, 2]", "T = [1, 2]"),
            "case.toml:25: effect[0].free.T: found the name of a column of the table; expected one of its own",
        ),
        (
            CASE.replace("p = [1, 2]", "t = [1, 2]"),
            "case.toml:25: effect[0].free.t: found u or t, the sensor's input and the time; expected another name",
        ),
        (
            CASE.replace("[1e-4, 1e-1]", "[-1.0, 1.0]"),
            "case.toml:24: effect[0].plausible: found [-1, 1]; expected the smallest and the largest value of magnitudes",
        ),
        (
            CASE.replace("acts_on =", "act_on ="),
            "case.toml:22: effect[0].act_on: unknown key; did you mean `acts_on`?",
        ),
        (
            CASE.replace("id = \"torsion\"", "id = \"\""),
            "case.toml:20: effect[0].id: found \"\"; expected a string that is not",
        ),
        (
            format!("{CASE}[[effect]]\nid = \"torsion\"\nformula = \"k * T\"\nacts_on = [\"fog\"]\n"),
            "case.toml:27: effect[1].id: found \"torsion\", the id of effect[0]; expected a unique id",
        ),
    ] {
        let error = read(&case).expect_err(said);
        assert!(error.starts_with(said), "{error}\nwanted {said}");
    }
}

/// A name that is nearly that of a column is an amplitude where the formula is linear in it, and is noticed.
#[test]
fn an_amplitude_that_is_nearly_a_column_is_said() {
    let case = CASE.replace("c * counts^p", "cunts * counts^p");
    let recording = read(&case).unwrap();
    let said = "effect[0].formula: cunts is no column and taken for an amplitude; a column is called counts";
    assert!(recording.warnings.iter().any(|it| it.contains(said)), "{:?}", recording.warnings);
}
