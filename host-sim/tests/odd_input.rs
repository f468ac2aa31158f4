//! Input that departs from its format, read strictly and leniently, and text that would command a terminal.
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

const CASE: &str = "format = \"schuler-case/1\"\ntitle = \"TITLE\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\n\
    step_s = 1.0\n[[sensor]]\nid = \"ID\"\nkind = \"fog\"\ncolumn = \"x\"\nunit = \"deg/h\"\naxis = [1.0, 0.0, 0.0]\n";

fn schuler(arguments: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A case and a table of two hundred rows, of which line 102 is `bad`.
fn case(directory: &Path, case: &str, bad: Option<&str>) -> PathBuf {
    let mut table = "t,x,y\n".to_owned();
    for row in 0..200_u32 {
        let noise = row.wrapping_mul(2_654_435_761) % 1000;
        let line = format!("{row},{},1", 7.0 + f64::from(noise) * 1e-4);
        writeln!(table, "{}", bad.filter(|_| row == 100).unwrap_or(&line)).unwrap();
    }
    fs::write(directory.join("r.csv"), table).unwrap();
    fs::write(directory.join("case.toml"), case).unwrap();
    directory.join("case.toml")
}

#[test]
fn what_departs_is_refused_by_line_or_left_out_and_told_first() {
    let directory = tempfile::tempdir().unwrap();
    let [identify, lenient, json] = ["identify", "--lenient", "--json"].map(|it| Path::new(it).to_owned());
    let path = case(directory.path(), CASE, Some("100,\"7.0,1"));
    let refused = schuler(&[&identify, &path]);
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(said.contains("r.csv:102: found a quote that does not close"), "{said}");
    let read = schuler(&[&identify, &path, &lenient]);
    assert!(read.status.success(), "{}", text(&read.stderr));
    let first = text(&read.stdout).lines().next().unwrap_or_default().to_owned();
    assert!(first.starts_with("Not read: ") && first.contains("1 rows are left out"), "{first}");
    assert!(first.contains("r.csv:102"), "{first}");
    let answer = text(&schuler(&[&identify, &path, &lenient, &json]).stdout);
    assert!(answer.trim_start_matches(['{', ' ', '\n']).starts_with("\"left_out\""), "{answer}");
    let answer: Value = serde_json::from_str(&answer).unwrap();
    assert_eq!(answer["sensors"][0]["present"], 199);
    // `convert` does the same.
    let out = directory.path().join("out.csv");
    let convert = Path::new("convert");
    assert_eq!(schuler(&[convert, &directory.path().join("r.csv"), &out]).status.code(), Some(2));
    assert!(!out.exists());
    let read = schuler(&[convert, &directory.path().join("r.csv"), &out, &lenient]);
    assert!(text(&read.stdout).starts_with("Not read: "), "{}", text(&read.stdout));
    assert_eq!(fs::read_to_string(&out).unwrap().lines().count(), 200);
}

#[test]
fn unknown_keys_are_refused_or_told_first() {
    let directory = tempfile::tempdir().unwrap();
    let lenient = Path::new("--lenient");
    let path = case(directory.path(), &format!("{CASE}colour = \"red\"\n"), None);
    let scenario = directory.path().join("scenario.toml");
    let known = "format = \"schuler-scenario/1\"\ntitle = \"short\"\n[time]\nduration_s = 60.0\nwords = 3\n[motion]\n\
        kind = \"static\"\n[[gyro]]\nid = \"x\"\nkind = \"fog\"\nunit = \"deg/h\"\naxis = [1.0, 0.0, 0.0]\n";
    fs::write(&scenario, known).unwrap();
    let out = directory.path().join("out");
    let runs: [(&[&Path], &str); 2] = [
        (&[Path::new("identify"), &path], "sensor[0].colour: unknown key"),
        (&[Path::new("simulate"), &scenario, Path::new("--out"), &out], "time.words: unknown key"),
    ];
    for (arguments, expected) in runs {
        let refused = schuler(arguments);
        let said = text(&refused.stderr);
        assert!(refused.status.code() == Some(2) && said.contains(expected), "{said}");
        let read = schuler(&[arguments, &[lenient]].concat());
        let answer = text(&read.stdout);
        assert!(read.status.success(), "{}", text(&read.stderr));
        assert!(answer.starts_with("Not read: ") && answer.contains(expected), "{answer}");
    }
}

#[test]
fn an_attitude_in_degrees_said_radians_is_refused_with_the_way_out() {
    let directory = tempfile::tempdir().unwrap();
    let mut table = "t,x,roll,pitch,yaw\n".to_owned();
    for row in 0..200_u32 {
        let heading = f64::from((300 + row) % 360);
        writeln!(table, "{row},{},0.5,1.0,{heading}", 7.0 + f64::from(row % 7) * 1e-4).unwrap();
    }
    let site = "[site]\nlatitude_deg = 50.0\naltitude_m = 0.0\n";
    let of_motion = |attitude: &str| format!("{site}[motion]\nkind = \"recorded\"\n{attitude}\n[[sensor]]");
    let radians = CASE.replace("[[sensor]]", &of_motion("attitude_rad = [\"roll\", \"pitch\", \"yaw\"]"));
    let degrees = "attitude = { columns = [\"yaw\", \"pitch\", \"roll\"], order = \"zyx\", unit = \"deg\" }";
    let path = case(directory.path(), &radians, None);
    fs::write(directory.path().join("r.csv"), &table).unwrap();
    let identify = Path::new("identify");
    for command in ["identify", "explain"] {
        let refused = schuler(&[Path::new(command), &path]);
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains("case.toml:12: motion.attitude_rad[2]: found 0 after 359"), "{said}");
        assert!(said.contains(degrees), "{said}");
    }
    let path = case(directory.path(), &CASE.replace("[[sensor]]", &of_motion(degrees)), None);
    fs::write(directory.path().join("r.csv"), table).unwrap();
    let read = schuler(&[identify, &path]);
    assert!(read.status.success(), "{}", text(&read.stderr));
}

#[test]
fn no_control_character_reaches_a_terminal_or_a_figure() {
    const ODD: &str = "a\u{1b}[31m\u{7}\u{9b}2J\u{202e}b";
    const ESCAPED: &str = r"a\u001b[31m\u0007\u009b2J\u202eb";
    let control = |text: &str| {
        text.chars()
            .find(|c| c.is_control() && !matches!(c, '\n' | '\t') || ('\u{202a}'..='\u{202e}').contains(c))
    };
    let directory = tempfile::tempdir().unwrap();
    let odd = CASE.replace("TITLE", ESCAPED).replace("ID", ESCAPED);
    let path = case(directory.path(), &odd, None);
    let out = directory.path().join("out");
    let arguments: [&Path; 6] =
        [Path::new("identify"), &path, Path::new("--out"), &out, Path::new("--plot"), Path::new("svg")];
    let output = schuler(&arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let answer = text(&output.stdout);
    assert!(answer.contains("31m") && control(&answer).is_none(), "{answer:?}");
    assert_eq!(control(&text(&output.stderr)), None);
    for entry in fs::read_dir(&out).unwrap() {
        let path = entry.unwrap().path();
        assert_eq!(control(&path.display().to_string()), None);
        if path.extension().is_some_and(|ending| ending == "svg") {
            let svg = fs::read_to_string(&path).unwrap();
            assert!(svg.contains("31m") && control(&svg).is_none());
        }
    }
    let json = text(&schuler(&[&arguments[..2], &[Path::new("--json")]].concat()).stdout);
    assert_eq!(control(&json), None);
    let answer: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(answer["sensors"][0]["id"], ODD);
    // What is wrong is told without them, too: in keys, values, columns, names of files.
    for bad in [
        format!("{CASE}\"{ESCAPED}\" = 1\n"),
        CASE.replace("\"x\"", &format!("\"{ESCAPED}\"")),
        CASE.replace("r.csv", ESCAPED),
        CASE.replace("deg/h", ESCAPED),
    ] {
        let refused = schuler(&[Path::new("identify"), &case(directory.path(), &bad, None)]);
        let said = text(&refused.stderr);
        assert!(refused.status.code() == Some(2) && control(&said).is_none(), "{said:?}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}
