//! The exported model is run, in Python, C and Rust: it adds what the engine has fitted.
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::catalogue::{CATALOGUE, Candidate, SETUP, Search};
use schuler_explain::config::Config;
use schuler_explain::diagnostics::CaseArrays;
use schuler_explain::explain::explain_watched;
use schuler_explain::explanation::Explanation;
use schuler_explain::export::model::given::Given;
use schuler_explain::export::model::resolve::Resolver;
use schuler_explain::export::model::signal::Memory;
use schuler_explain::export::model::{FORMAT, Model, Output, TIME, Term, c, python, rust};
use schuler_explain::inputs::Inputs;
use schuler_explain::watch::Unwatched;
use schuler_recording::Recording;

/// A body that turns and shakes for five minutes, with everything that an effect may depend on.
const TURNING: &str = r#"
format = "schuler-case/1"
title = "Everything */ \"at once\""
[recording]
path = "recording.csv"
time = "t"
step_s = 0.1
[site]
latitude_deg = 50.0
[motion]
kind = "recorded"
rate = ["wx", "wy", "wz"]
specific_force = ["fx", "fy", "fz"]
attitude_rad = ["roll", "pitch", "yaw"]
velocity_ned = ["vn", "ve", "vd"]
[[sensor]]
id = "g"
kind = "dtg"
column = "g"
unit = "deg/h"
axis = [0.8, 0.6, 0.0]
spin_axis = [0.0, 0.0, 1.0]
group = "unit"
nominal = { white = 1.0, temperature_bias = { column = "T", reference_degC = 20.0, coefficients = [0.0] } }
[[sensor]]
id = "a"
kind = "accelerometer"
column = "a"
unit = "ug"
axis = [1.0, 0.0, 0.0]
group = "unit"
nominal = { white = 10.0 }
[[sensor]]
id = "int"
kind = "accelerometer"
column = "b"
unit = "m/s^2"
axis = [0.0, 0.6, 0.8]
group = "unit"
nominal = { white = 1e-4 }
[[sensor]]
id = "d"
kind = "doppler"
column = "d"
unit = "m/s"
axis = [1.0, 0.0, 0.0]
nominal = { white = 0.01 }
[[sensor]]
id = "moment"
kind = "other"
column = "m"
unit = "N m"
nominal = { white = 0.01 }
[[aux]]
column = "T"
quantity = "temperature"
unit = "degC"
near = "g"
position_m = [0.0, 0.0, 0.0]
[[aux]]
column = "T2"
quantity = "temperature"
unit = "degC"
position_m = [0.0, 0.1, 0.0]
[[aux]]
column = "T_electronics"
quantity = "temperature"
unit = "degC"
[[aux]]
column = "V"
quantity = "voltage"
unit = "V"
[[aux]]
column = "p"
quantity = "pressure"
unit = "Pa"
[[aux]]
column = "vib"
quantity = "vibration_rms"
unit = "m/s^2"
[[aux]]
column = "pickoff"
quantity = "other"
unit = "rad"
near = "g"
[[aux]]
column = "I"
quantity = "current"
unit = "A"
[[aux]]
column = "n"
quantity = "speed"
unit = "1/s"
"#;

/// Name of a column and its value by time.
type ColumnOf = (&'static str, fn(f64) -> f64);

const COLUMNS: &[ColumnOf] = &[
    ("g", |t| (0.9 * t).sin()),
    ("a", |t| (0.8 * t).sin()),
    ("b", |t| (0.7 * t).sin()),
    ("d", |t| (0.6 * t).sin()),
    ("m", |t| (0.5 * t).sin()),
    ("wx", |t| 0.3 * (0.5 * t).sin()),
    ("wy", |t| 0.2 * (0.7 * t).cos()),
    ("wz", |t| 0.1 + 0.05 * (0.3 * t).sin()),
    ("fx", |t| 3.0 * (0.2 * t).sin()),
    ("fy", |t| 2.0 * (0.3 * t).cos()),
    ("fz", |t| -9.8 + (0.25 * t).sin()),
    ("roll", |t| 0.1 * (0.1 * t).sin()),
    ("pitch", |t| 0.2 * (0.07 * t).sin()),
    ("yaw", |t| 0.01 * t),
    ("vn", |t| 5.0 + (0.4 * t).sin()),
    ("ve", |t| (0.3 * t).cos()),
    ("vd", |t| 0.1 * (0.2 * t).sin()),
    ("T", |t| 25.0 + 8.0 * (TAU * t / 200.0).sin()),
    ("T2", |t| 28.0 + 8.0 * (TAU * t / 200.0).sin() + (TAU * t / 75.0).sin()),
    ("T_electronics", |t| 40.0 + 4.0 * (TAU * t / 75.0).sin()),
    ("V", |t| 5.0 + 0.1 * (TAU * t / 75.0).sin()),
    ("p", |t| 1e5 + 300.0 * (TAU * t / 90.0).sin()),
    ("vib", |t| 2.0 + (0.01 * t).sin()),
    ("pickoff", |t| 1e-3 * (TAU * t / 60.0).sin()),
    ("I", |t| 0.2 + 0.05 * (TAU * t / 55.0).sin()),
    ("n", |t| 3.0 * (TAU * t / 45.0).sin()),
];

/// Effects that have no formula.
const WITHOUT_FORMULA: [&str; 6] =
    ["coning_sculling", "earth_tide", "axes_swapped", "reference_noise", "clock_drift", "heading_off"];

fn recording(folder: &Path, case: &str, table: &str) -> Recording {
    std::fs::write(folder.join("recording.csv"), table).unwrap();
    std::fs::write(folder.join("case.toml"), case).unwrap();
    Recording::read(&folder.join("case.toml")).unwrap()
}

/// A table of columns over rows.
fn table(columns: &[ColumnOf], rows: usize, step_s: f64, added: impl Fn(&str, usize, f64) -> f64) -> String {
    let mut text = String::from("t");
    for (name, _) in columns {
        let _ = write!(text, ",{name}");
    }
    for row in 0..rows {
        let t = row as f64 * step_s;
        let _ = write!(text, "\n{t:.3}");
        for (name, value) in columns {
            let _ = write!(text, ",{}", value(t) + added(name, row, t));
        }
    }
    text + "\n"
}

/// Points in the middle of a candidate's grid.
fn middle(candidate: &Candidate) -> Vec<f64> {
    match &candidate.search {
        Search::Grid { parameters, .. } => {
            parameters.iter().map(|parameter| parameter.grid[parameter.grid.len() / 2]).collect()
        }
        _ => Vec::new(),
    }
}

/// A model of every candidate in a recording, each at an output of its own, with what it should add.
fn of_everything(inputs: &Inputs<'_>) -> (Model, Vec<Vec<f64>>, Vec<&'static str>) {
    let mut given = Given::default();
    given.put(TIME, "s", "time", &inputs.time_s);
    let mut model = Model { format: FORMAT, title: inputs.recording.case.title.clone(), ..Model::default() };
    let (mut expected, mut without) = (Vec::new(), Vec::new());
    for effect in CATALOGUE.iter().chain(SETUP.iter().copied()) {
        for candidate in (effect.candidates)(effect, inputs) {
            let nonlinear = middle(&candidate);
            let signature = match &candidate.search {
                Search::Linear(signature) => signature.clone(),
                Search::Grid { signature, .. } => signature(&nonlinear),
                _ => continue,
            };
            for (index, column) in signature.columns.iter().enumerate() {
                for (sensor, values) in &column.parts {
                    let resolver = &mut Resolver {
                        inputs,
                        candidate: &candidate,
                        nonlinear: &nonlinear,
                        given: &mut given,
                    };
                    let Some(signal) = resolver.signal(index, *sensor, values) else {
                        without.push(effect.id);
                        continue;
                    };
                    let output = format!("{} {}", effect.id, expected.len());
                    model.outputs.push(Output {
                        sensor: output.clone(),
                        unit: "SI",
                        written_unit: "SI".into(),
                        written_unit_in_si: 1.0,
                        enters: "added to its reading",
                    });
                    model.terms.push(Term {
                        finding: 0,
                        effect: effect.id.to_owned(),
                        sentence: effect.sentence.to_owned(),
                        output,
                        parameter: candidate.amplitudes[index].name.clone(),
                        amplitude: -2.5,
                        signal,
                        is_table: false,
                    });
                    expected.push(values.iter().map(|value| -2.5 * value).collect());
                }
            }
        }
    }
    model.inputs = given.inputs;
    without.sort_unstable();
    without.dedup();
    (model, expected, without)
}

/// Largest difference as a part of the largest value.
fn off(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let size = expected.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
    found.iter().zip(expected).fold(0.0, |most, (a, b)| {
        let off = (a - b).abs() / size;
        if off.is_nan() { f64::INFINITY } else { most.max(off) }
    })
}

/// Compares the columns of a program with those of the model.
fn agrees(what: &str, model: &Model, found: &[Vec<f64>], expected: &[Vec<f64>], within: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for ((found, expected), output) in found.iter().zip(expected).zip(&model.outputs) {
        let off = off(found, expected);
        assert!(off < within, "{what}: {} is off by {off:.1e} of its size", output.sensor);
    }
}

fn succeeds(command: &mut Command) -> Vec<u8> {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {said}");
    output.stdout
}

/// Python with numpy: the one that `SCHULER_PYTHON` names, that of the workspace's checks, or the system's.
fn python_with_numpy(test: &str) -> Option<PathBuf> {
    let of_checks = Path::new(env!("CARGO_TARGET_TMPDIR")).parent()?.join("oracle-venv/bin/python");
    let named = std::env::var_os("SCHULER_PYTHON").map(PathBuf::from);
    let found = named.into_iter().chain([of_checks, PathBuf::from("python3")]).find(|python| {
        Command::new(python).args(["-c", "import numpy"]).output().is_ok_and(|it| it.status.success())
    });
    if found.is_none() {
        eprintln!("SKIPPED: {test} needs Python with numpy; SCHULER_PYTHON may name one");
    }
    found
}

/// Whether a compiler is there, said aloud where it is not.
fn has(compiler: &str, test: &str) -> bool {
    let found = Command::new(compiler).arg("--version").output().is_ok();
    if !found {
        eprintln!("SKIPPED: {test} needs {compiler}");
    }
    found
}

/// What the Python module adds.
fn in_python(python: &Path, folder: &Path, model: &Model) -> Vec<Vec<f64>> {
    std::fs::write(folder.join("model.py"), python::source(model)).unwrap();
    let mut inputs = model.inputs.iter().map(|it| it.name.as_str()).collect::<Vec<_>>().join(",");
    for row in 0..model.inputs[0].values.len() {
        let values: Vec<String> = model.inputs.iter().map(|it| format!("{:?}", it.values[row])).collect();
        let _ = write!(inputs, "\n{}", values.join(","));
    }
    std::fs::write(folder.join("inputs.csv"), inputs + "\n").unwrap();
    columns_of(&succeeds(Command::new(python).arg("model.py").arg("inputs.csv").current_dir(folder)), model)
}

/// What another program reads out of the model as data, beside the inputs that [`in_python`] has written.
fn as_data(python: &Path, folder: &Path, model: &Model) -> Vec<Vec<f64>> {
    std::fs::write(folder.join("model.json"), serde_json::to_vec(model).unwrap()).unwrap();
    let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/read_model.py");
    let mut read = Command::new(python);
    columns_of(&succeeds(read.arg(reader).args(["model.json", "inputs.csv"]).current_dir(folder)), model)
}

/// The columns of a table that was printed, but for the time.
fn columns_of(said: &[u8], model: &Model) -> Vec<Vec<f64>> {
    let text = String::from_utf8_lossy(said);
    let mut columns = vec![Vec::new(); model.outputs.len()];
    for line in text.lines().skip(1) {
        let values = line.split(',').skip(1).map(|value| value.parse::<f64>().unwrap());
        columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
    }
    columns
}

/// The inputs as bytes, one after the other, and what a program makes of them.
fn through(program: &Path, folder: &Path, model: &Model) -> Vec<Vec<f64>> {
    let bytes: Vec<u8> =
        model.inputs.iter().flat_map(|it| &*it.values).flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(folder.join("inputs.bin"), bytes).unwrap();
    succeeds(Command::new(program).current_dir(folder));
    let bytes = std::fs::read(folder.join("outputs.bin")).unwrap();
    let values: Vec<f64> =
        bytes.chunks_exact(8).map(|it| f64::from_le_bytes(it.try_into().unwrap())).collect();
    values.chunks(model.inputs[0].values.len()).map(<[f64]>::to_vec).collect()
}

/// What the C file adds.
fn in_c(folder: &Path, model: &Model) -> Vec<Vec<f64>> {
    let (inputs, outputs, rows) = (model.inputs.len(), model.outputs.len(), model.inputs[0].values.len());
    std::fs::write(folder.join("model.c"), c::source(model)).unwrap();
    let list = |name: &str, number: usize| {
        (0..number).map(|k| format!("{name}[{k}]")).collect::<Vec<_>>().join(", ")
    };
    let main = format!(
        "#include \"model.c\"\n#include <stdio.h>\nstatic double x[{inputs}][{rows}], y[{outputs}][{rows}];\n\
         int main(void)\n{{\n    FILE *file = fopen(\"inputs.bin\", \"rb\");\n    \
         if (file == NULL || fread(x, sizeof x, 1, file) != 1) return 1;\n    \
         const struct schuler_inputs in = {{ {rows}, {} }};\n    const struct schuler_outputs out = {{ {} }};\n    \
         schuler_add(&in, &out);\n    file = fopen(\"outputs.bin\", \"wb\");\n    \
         return file == NULL || fwrite(y, sizeof y, 1, file) != 1 || fclose(file) != 0;\n}}\n",
        list("x", inputs),
        list("y", outputs)
    );
    std::fs::write(folder.join("main.c"), main).unwrap();
    let program = folder.join("with_c");
    succeeds(
        Command::new("gcc")
            .args(["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "main.c", "-lm", "-o"])
            .arg(&program)
            .current_dir(folder),
    );
    through(&program, folder, model)
}

/// What the Rust module adds, which is compiled without the standard library as well.
fn in_rust(folder: &Path, model: &Model) -> Vec<Vec<f64>> {
    std::fs::write(folder.join("model.rs"), rust::source(model)).unwrap();
    std::fs::write(folder.join("without_std.rs"), "#![no_std]\n#![deny(warnings)]\npub mod model;\n")
        .unwrap();
    let rustc = || {
        let mut rustc = Command::new("rustc");
        rustc.args(["--edition", "2021", "-O"]).current_dir(folder);
        rustc
    };
    succeeds(rustc().args(["--crate-type", "lib", "--emit", "metadata", "without_std.rs"]));
    let rows = model.inputs[0].values.len();
    let inputs: Vec<String> =
        model.inputs.iter().enumerate().map(|(k, it)| format!("{}: &x[{k}]", it.name)).collect();
    let source = rust::source(model);
    let (_, outputs) = source.split_once("pub struct Outputs<'a> {").unwrap();
    let fields = outputs.split_once("\n}").unwrap().0.lines().filter_map(|line| {
        line.trim().strip_prefix("pub ")?.split_once(':').map(|(name, _)| name.to_owned())
    });
    let outputs: Vec<String> = fields.map(|name| format!("{name}: y.next().unwrap()")).collect();
    let main = format!(
        "mod model;\nstruct Std;\nimpl model::Maths for Std {{\n    fn exp(x: f64) -> f64 {{ x.exp() }}\n    \
         fn cos(x: f64) -> f64 {{ x.cos() }}\n    fn sin(x: f64) -> f64 {{ x.sin() }}\n}}\n\
         fn main() {{\n    let bytes = std::fs::read(\"inputs.bin\").unwrap();\n    \
         let all: Vec<f64> = bytes.chunks_exact(8).map(|it| f64::from_le_bytes(it.try_into().unwrap())).collect();\n    \
         let x: Vec<&[f64]> = all.chunks({rows}).collect();\n    let mut out = vec![0.0; {rows} * {}];\n    \
         {{\n        let mut y = out.chunks_mut({rows});\n        let inputs = model::Inputs {{ {} }};\n        \
         let mut outputs = model::Outputs {{ {} }};\n        model::add::<Std>(&inputs, &mut outputs);\n    }}\n    \
         let bytes: Vec<u8> = out.iter().flat_map(|value| value.to_le_bytes()).collect();\n    \
         std::fs::write(\"outputs.bin\", bytes).unwrap();\n}}\n",
        model.outputs.len(),
        inputs.join(", "),
        outputs.join(", ")
    );
    std::fs::write(folder.join("main.rs"), main).unwrap();
    let program = folder.join("with_rust");
    succeeds(rustc().arg("main.rs").arg("-o").arg(&program));
    through(&program, folder, model)
}

/// Every effect of the catalogue that has a signature, from one body that turns.
#[test]
fn every_effect_adds_in_every_language_what_its_signature_says() {
    const NAME: &str = "every_effect_adds_in_every_language_what_its_signature_says";
    let folder = tempfile::tempdir().unwrap();
    let recording = recording(folder.path(), TURNING, &table(COLUMNS, 3000, 0.1, |_, _, _| 0.0));
    let inputs = Inputs::new(&recording);
    let (model, expected, without) = of_everything(&inputs);
    let named: std::collections::BTreeSet<&str> =
        model.terms.iter().map(|term| term.effect.as_str()).collect();
    println!("{} signals of {} effects", model.terms.len(), named.len());
    assert!(named.len() > 40, "{named:?}");
    assert!(without.iter().all(|id| WITHOUT_FORMULA.contains(id)), "without a formula: {without:?}");
    let own: Vec<Vec<f64>> = model.outputs.iter().map(|output| model.added(&output.sensor)).collect();
    agrees("signals", &model, &own, &expected, 1e-9);
    if let Some(python) = python_with_numpy(NAME) {
        agrees("Python", &model, &in_python(&python, folder.path(), &model), &expected, 1e-6);
        let is_read = |term: &Term| {
            !matches!(term.signal.memory, Some(Memory::Delay { .. } | Memory::Bandwidth { .. }))
        };
        let mut read = as_data(&python, folder.path(), &model);
        let left_out = model.terms.iter().map(|term| !is_read(term));
        for ((read, expected), _) in read.iter_mut().zip(&expected).zip(left_out).filter(|it| it.1) {
            assert!(read.iter().all(|value| *value == 0.0));
            read.clone_from(expected);
        }
        agrees("JSON", &model, &read, &expected, 1e-6);
    }
    if has("gcc", NAME) {
        agrees("C", &model, &in_c(folder.path(), &model), &expected, 1e-6);
    }
    if has("rustc", NAME) {
        agrees("Rust", &model, &in_rust(folder.path(), &model), &expected, 1e-6);
    }
}

const STANDING: &str = r#"
format = "schuler-case/1"
title = "Two gyros on a bench"
[recording]
path = "recording.csv"
time = "t"
step_s = 1.0
[site]
latitude_deg = 55.0
[motion]
kind = "static"
attitude_deg = { roll = 0.0, pitch = 0.0, heading = 30.0 }
[[sensor]]
id = "gyro_x"
kind = "fog"
column = "gyro_x"
unit = "deg/h"
axis = [1.0, 0.0, 0.0]
relative = true
nominal = { white = 0.05 }
[[sensor]]
id = "gyro_y"
kind = "fog"
column = "gyro_y"
unit = "deg/h"
axis = [0.0, 1.0, 0.0]
relative = true
nominal = { white = 0.05 }
[[aux]]
column = "temp_x"
quantity = "temperature"
unit = "degC"
near = "gyro_x"
[[aux]]
column = "volts"
quantity = "voltage"
unit = "V"
"#;

fn explained(recording: &Recording) -> (Explanation, CaseArrays) {
    explain_watched(recording, &Config::default(), &Unwatched).unwrap()
}

/// Two gyros of white noise, one with the rate of its temperature and a step, the other with its supply.
fn standing(folder: &Path, rows: usize) -> Recording {
    let mut random = Pcg64::seed_from_u64(5);
    let noise: Vec<[f64; 3]> =
        (0..rows).map(|_| [(); 3].map(|()| StandardNormal.sample(&mut random))).collect();
    let columns: &[ColumnOf] = &[
        ("gyro_x", |t| 3.0 + 0.02 * 4.0 * TAU / 5000.0 * 3600.0 * (TAU * t / 5000.0).cos()),
        ("gyro_y", |t| -1.0 + 0.3 * (TAU * t / 1700.0).sin()),
        ("temp_x", |t| 30.0 + 4.0 * (TAU * t / 5000.0).sin()),
        ("volts", |t| 5.0 + 0.5 * (TAU * t / 1700.0).sin()),
    ];
    let added = |name: &str, row: usize, t: f64| match name {
        "gyro_x" => 0.05 * noise[row][0] + if t >= 6200.0 { 0.1 } else { 0.0 },
        "gyro_y" => 0.05 * noise[row][1],
        "temp_x" => 0.002 * noise[row][2],
        _ => 0.0,
    };
    recording(folder, STANDING, &table(columns, rows, 1.0, added))
}

/// The model of an answer is put into the prediction: what is left has the likelihood that the answer promised.
#[test]
fn readings_less_the_exported_model_have_the_likelihood_of_the_answer() {
    const NAME: &str = "readings_less_the_exported_model_have_the_likelihood_of_the_answer";
    let folder = tempfile::tempdir().unwrap();
    let recording = standing(folder.path(), 10_000);
    let (explanation, arrays) = explained(&recording);
    let told: Vec<String> =
        explanation.findings.iter().map(|it| format!("{} {}", it.sensor, it.effect)).collect();
    assert_eq!(told.len(), 3, "{told:?}");
    let model = &arrays.model;
    assert!(model.left_out.is_empty() && model.noise.is_empty(), "{:?}", model.cautions());
    assert!(model.terms.iter().all(|term| !term.is_table), "{:?}", model.cautions());
    let mut ways = vec![("signals", model.outputs.iter().map(|it| model.added(&it.sensor)).collect())];
    if let Some(python) = python_with_numpy(NAME) {
        ways.push(("Python", in_python(&python, folder.path(), model)));
    }
    if has("gcc", NAME) {
        ways.push(("C", in_c(folder.path(), model)));
    }
    if has("rustc", NAME) {
        ways.push(("Rust", in_rust(folder.path(), model)));
    }
    for (way, added) in ways {
        for (output, added) in model.outputs.iter().zip(added) {
            let sensor = arrays.sensors.iter().find(|it| it.sensor == output.sensor).unwrap();
            let mut explained = vec![0.0; added.len()];
            for part in &sensor.parts {
                explained.iter_mut().zip(&part.values).for_each(|(sum, value)| *sum += value);
            }
            let apart = off(&added, &explained);
            assert!(apart < 1e-6, "{way}: {} is off by {apart:.1e}", output.sensor);
            // White noise of 0.05 °/h: what is left over its deviation are the innovations.
            let white = 0.05 * output.written_unit_in_si;
            let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|it| it * it).sum::<f64>();
            let promised = squares(&mut sensor.innovation_after.iter().copied());
            let left = sensor.residual.iter().zip(&added).map(|(residual, added)| (residual - added) / white);
            let left = squares(&mut left.into_iter());
            assert!((left / promised - 1.0).abs() < 1e-6, "{way}: {} {left} {promised}", output.sensor);
        }
    }
}

/// What is found does not depend on how many threads seek it, nor on which of them is first.
#[test]
fn the_answer_is_the_same_by_one_thread_and_by_several() {
    let folder = tempfile::tempdir().unwrap();
    let recording = standing(folder.path(), 10_000);
    let answer = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        serde_json::to_string(&pool.install(|| explained(&recording).0)).unwrap()
    };
    let one = answer(1);
    for threads in [2, 3, 4] {
        assert_eq!(answer(threads), one, "{threads} threads");
    }
}

/// A model that is added to the prediction of a second explanation leaves nothing to be found, at the likelihood that the first one promised.
#[test]
fn a_simulation_with_the_model_leaves_nothing_to_explain() {
    let folder = tempfile::tempdir().unwrap();
    let rows = 10_000;
    let recording = standing(folder.path(), rows);
    let (first, arrays) = explained(&recording);
    let model = &arrays.model;
    let with_model: Vec<(String, Vec<f64>)> = (recording.sensors.iter())
        .map(|series| {
            let id = &series.sensor.id;
            let unit = series.written_unit.in_si();
            let constant = series.values.iter().sum::<f64>() / rows as f64;
            (id.clone(), model.added(id).iter().map(|added| (added + constant) / unit).collect())
        })
        .collect();
    let text = std::fs::read_to_string(folder.path().join("recording.csv")).unwrap();
    let mut lines = text.lines();
    let mut table = format!("{},sim_gyro_x,sim_gyro_y\n", lines.next().unwrap());
    for (row, line) in lines.enumerate() {
        let _ = writeln!(table, "{line},{:?},{:?}", with_model[0].1[row], with_model[1].1[row]);
    }
    let case = STANDING
        .replace("column = \"gyro_x\"", "column = \"gyro_x\"\npredicted = \"sim_gyro_x\"")
        .replace("column = \"gyro_y\"", "column = \"gyro_y\"\npredicted = \"sim_gyro_y\"");
    let case = case.replace("[site]", "[simulation]\n[site]");
    let again = self::recording(folder.path(), &case, &table);
    let (second, _) = explained(&again);
    let named = |of: &Explanation| of.findings.iter().map(|it| it.sentence.clone()).collect::<Vec<_>>();
    assert!(second.findings.is_empty(), "{:#?} after {:#?}", named(&second), named(&first));
    let (promised, found) = (first.fit.train.after.nll_per_sample, second.fit.train.before.nll_per_sample);
    assert!((found / promised - 1.0).abs() < 1e-3, "{found}, and {promised} was promised");
}
