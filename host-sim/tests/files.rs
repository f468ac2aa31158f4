//! What the command does to files: nothing that it reads is replaced, nothing leaves `--out`, and nothing half-written stays.
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Ids that would be paths, options or commands to a terminal.
const ODD_IDS: [&str; 8] =
    ["../../escaped", "/tmp/escaped", "a/b", "..", ".hidden", "-rf", "C:\\\\escaped", "\\u001b[31mred"];
/// How long a stopped run may take.
const SOON: Duration = Duration::from_secs(1);

fn schuler<I: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = I>) -> Output {
    Command::new(env!("CARGO_BIN_EXE_schuler")).args(arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A sensor at rest for each id, and a table of some noise.
fn case(directory: &Path, ids: &[&str]) -> PathBuf {
    let mut case = "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\nstep_s = 1.0\n\
        [site]\nlatitude_deg = 50.0\naltitude_m = 0.0\n[motion]\nkind = \"static\"\n\
        attitude_deg = { roll = 0.0, pitch = 0.0, heading = 0.0 }\n"
        .to_owned();
    for id in ids {
        writeln!(
            case,
            "[[sensor]]\nid = \"{id}\"\nkind = \"fog\"\ncolumn = \"x\"\nunit = \"deg/h\"\naxis = [1.0, 0.0, 0.0]\n\
             [sensor.nominal]\nwhite = 0.1"
        )
        .unwrap();
    }
    let mut table = "t,x\n".to_owned();
    for row in 0..200_u32 {
        let noise = row.wrapping_mul(2_654_435_761) % 1000;
        writeln!(table, "{row},{}", 7.0 + f64::from(noise) * 1e-4).unwrap();
    }
    fs::write(directory.join("r.csv"), table).unwrap();
    fs::write(directory.join("case.toml"), case).unwrap();
    directory.join("case.toml")
}

/// Every file below a directory with its bytes.
fn tree(directory: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(tree(&path));
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}

/// Runs the command, which must refuse the run as bad input, and leave every file as it was and none more.
fn refused(directory: &Path, arguments: &[&Path]) {
    let before = tree(directory);
    let output = schuler(arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
    assert!(said(&output).contains("this run reads it"), "{arguments:?}: {}", said(&output));
    assert!(before == tree(directory), "{arguments:?}: files have changed");
}

#[test]
fn no_command_replaces_what_it_reads() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let case = case(directory.path(), &["x"]);
    fs::create_dir(at("d")).unwrap();
    fs::hard_link(at("r.csv"), at("hard.csv")).unwrap();
    let mut names = vec![at("r.csv"), at("hard.csv"), at("d/../r.csv")];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(at("r.csv"), at("soft.csv")).unwrap();
        names.push(at("soft.csv"));
    }
    let [convert, explain, report, block] =
        ["convert", "explain", "--report", "--compensation"].map(|it| Path::new(it).to_owned());
    for name in &names {
        refused(directory.path(), &[&convert, &at("r.csv"), name]);
        refused(directory.path(), &[&explain, &case, &report, name]);
        refused(directory.path(), &[&explain, &case, &block, name]);
    }
    refused(directory.path(), &[&explain, &case, &report, &case]);
    refused(directory.path(), &[&convert, &case, directory.path()]);
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/demo.toml");
    for name in ["scenario.toml", "case.toml", "truth.csv.gz", "recording.csv.gz"] {
        let own = tempfile::tempdir().unwrap();
        let path = own.path().join(name);
        fs::copy(&scenario, &path).unwrap();
        refused(own.path(), &[Path::new("simulate"), &path, Path::new("--out"), own.path()]);
    }
}

#[test]
fn nothing_in_a_case_leads_out_of_the_directory() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("a/b");
    fs::create_dir_all(&place).unwrap();
    let identified = case(&place, &ODD_IDS);
    let escaped = Path::new("/tmp/escaped_noise.svg");
    assert!(!escaped.exists());
    let before = tree(directory.path());
    let out = place.join("out");
    let output = schuler([
        Path::new("identify"),
        &identified,
        Path::new("--out"),
        &out,
        Path::new("--plot"),
        Path::new("svg"),
    ]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(!escaped.exists());
    let made: Vec<PathBuf> =
        tree(directory.path()).into_keys().filter(|path| !before.contains_key(path)).collect();
    // One figure a sensor and the results.
    assert_eq!(made.len(), ODD_IDS.len() + 1, "{made:?}");
    assert!(made.iter().all(|path| path.parent() == Some(&out)), "{made:?}");
}

#[test]
fn a_flight_stays_in_its_directory_whatever_the_id() {
    for id in ODD_IDS {
        let directory = tempfile::tempdir().unwrap();
        let text = format!(
            "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\nstep_s = 1.0\n[site]\n\
             latitude_deg = 0.0\naltitude_m = 0.0\n[motion]\nkind = \"velocity_error\"\n[loop]\nradius_m = 6371000.0\n\
             gravity = 9.80665\nvelocity_white = 0.1\n[loop.accelerometer]\nsigma = 0.00031\ntau_s = 600.0\n[loop.gyro]\n\
             sigma = 1.53e-07\ntau_s = 18000.0\n[[sensor]]\nid = \"{id}\"\nkind = \"ins_velocity\"\n\
             column = \"v\"\nunit = \"m/s\"\n"
        );
        let place = directory.path().join("a/b");
        fs::create_dir_all(&place).unwrap();
        fs::write(place.join("case.toml"), text).unwrap();
        let table = (0..200).fold("t,v\n".to_owned(), |table, row| table + &format!("{row},0.{}\n", row % 7));
        fs::write(place.join("r.csv"), table).unwrap();
        let before = tree(directory.path());
        let out = place.join("out");
        let output = schuler([
            Path::new("fly"),
            &place.join("case.toml"),
            Path::new("--out"),
            &out,
            Path::new("--plot"),
            Path::new("svg"),
        ]);
        assert!(output.status.success(), "{id}: {}", said(&output));
        let made: Vec<PathBuf> =
            tree(directory.path()).into_keys().filter(|path| !before.contains_key(path)).collect();
        assert!(made.len() > 3 && made.iter().all(|path| path.parent() == Some(&out)), "{id}: {made:?}");
    }
}

#[cfg(unix)]
mod unix {
    use std::io::Read;
    use std::os::unix::fs::{FileTypeExt, PermissionsExt};

    use super::*;

    fn fifo(path: &Path) {
        assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
    }

    #[test]
    fn fifos_are_written_to_and_stay_fifos() {
        let directory = tempfile::tempdir().unwrap();
        case(directory.path(), &["x"]);
        let [table, pipe] = ["r.csv", "pipe"].map(|name| directory.path().join(name));
        fifo(&pipe);
        let is_fifo = || fs::metadata(&pipe).unwrap().file_type().is_fifo();
        let arguments = [Path::new("convert"), &table, &pipe, Path::new("--format"), Path::new("csv")]
            .map(Path::to_owned);
        let output = schuler(&arguments);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains("is a FIFO that nobody reads"), "{}", said(&output));
        assert!(is_fifo());
        let path = pipe.clone();
        let reader = std::thread::spawn(move || {
            let mut text = String::new();
            fs::File::open(path).unwrap().read_to_string(&mut text).unwrap();
            text
        });
        // The reader waits in `open` until somebody writes; until it is there, the command refuses.
        let began = Instant::now();
        while !schuler(&arguments).status.success() {
            assert!(began.elapsed() < Duration::from_secs(20), "no reader");
        }
        assert_eq!(reader.join().unwrap().lines().count(), 201);
        assert!(is_fifo());
    }

    #[test]
    fn new_files_follow_the_mask_and_old_ones_keep_their_mode() {
        let directory = tempfile::tempdir().unwrap();
        case(directory.path(), &["x"]);
        let convert = |mask: &str, to: &str| {
            let line = format!("umask {mask}; exec \"$0\" convert r.csv {to}");
            let output = Command::new("sh")
                .args(["-c", &line, env!("CARGO_BIN_EXE_schuler")])
                .current_dir(directory.path())
                .output()
                .unwrap();
            let mode = fs::metadata(directory.path().join(to)).unwrap().permissions().mode() & 0o777;
            (output.status.code(), mode)
        };
        assert_eq!(convert("077", "private.csv"), (Some(0), 0o600));
        assert_eq!(convert("002", "shared.csv"), (Some(0), 0o664));
        assert_eq!(convert("022", "private.csv"), (Some(0), 0o600));
        fs::set_permissions(directory.path().join("shared.csv"), PermissionsExt::from_mode(0o444)).unwrap();
        assert_eq!(convert("022", "shared.csv"), (Some(2), 0o444));
    }

    /// Sends a signal and gives status and time until the end.
    fn ended(mut child: Child, signal: &str) -> (Option<i32>, Duration) {
        let began = Instant::now();
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        (child.wait().unwrap().code(), began.elapsed())
    }

    #[test]
    fn a_stopped_run_leaves_no_draft() {
        let directory = tempfile::tempdir().unwrap();
        let table = directory.path().join("long.csv");
        let mut text = "t,a,b,c\n".to_owned();
        for row in 0..1_000_000_u32 {
            writeln!(text, "{row},{0},{0},{0}", f64::from(row).sqrt()).unwrap();
        }
        fs::write(&table, text).unwrap();
        for signal in ["-TERM", "-INT", "-HUP"] {
            let out = directory.path().join("out");
            let child = Command::new(env!("CARGO_BIN_EXE_schuler"))
                .arg("convert")
                .args([&table, &out.join("long.csv.gz")])
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let began = Instant::now();
            while fs::read_dir(&out).map_or(0, Iterator::count) == 0 {
                assert!(began.elapsed() < Duration::from_secs(20), "no draft");
            }
            let (status, took) = ended(child, signal);
            assert_eq!(status, Some(130), "{signal}");
            assert!(took < SOON, "{signal}: {took:?}");
            assert_eq!(fs::read_dir(&out).unwrap().count(), 0, "{signal}");
        }
    }

    #[test]
    fn identify_is_ended_within_a_second() {
        let directory = tempfile::tempdir().unwrap();
        let case = case(directory.path(), &["x"]);
        let mut table = "t,x\n".to_owned();
        for row in 0..400_000_u32 {
            let noise = row.wrapping_mul(2_654_435_761) % 1_000_003;
            writeln!(table, "{row},{}", f64::from(noise) * 1e-6).unwrap();
        }
        fs::write(directory.path().join("r.csv"), table).unwrap();
        for pause_ms in [400, 1500] {
            let mut child = Command::new(env!("CARGO_BIN_EXE_schuler"))
                .args([Path::new("identify"), &case, Path::new("--lags"), Path::new("200000")])
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            std::thread::sleep(Duration::from_millis(pause_ms));
            assert_eq!(child.try_wait().unwrap(), None, "it must be at work to be stopped");
            let (status, took) = ended(child, "-INT");
            assert_eq!(status, Some(130));
            assert!(took < SOON, "{took:?}");
        }
    }

    /// Three and a half days of three gyros at one row a second, at every stage: reading, searching, judging.
    #[test]
    fn explain_is_ended_within_a_second() {
        let directory = tempfile::tempdir().unwrap();
        let case = case(directory.path(), &["x", "y", "z"]);
        let mut table = "t,x\n".to_owned();
        for row in 0..300_000_u32 {
            let noise = row.wrapping_mul(2_654_435_761) % 1_000_003;
            writeln!(table, "{row},{}", 7.0 + f64::from(noise) * 1e-6).unwrap();
        }
        fs::write(directory.path().join("r.csv"), table).unwrap();
        for pause_ms in [100, 400, 800, 1500] {
            let mut child = Command::new(env!("CARGO_BIN_EXE_schuler"))
                .args([Path::new("explain"), &case])
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            std::thread::sleep(Duration::from_millis(pause_ms));
            if child.try_wait().unwrap().is_some() {
                // A fast machine is done by then; it was at work for the first pauses.
                assert!(pause_ms > 400, "it must be at work to be stopped");
                break;
            }
            let (status, took) = ended(child, "-INT");
            assert_eq!(status, Some(130), "after {pause_ms} ms");
            assert!(took < SOON, "after {pause_ms} ms: {took:?}");
        }
    }

    #[test]
    fn what_has_no_end_is_refused_at_once() {
        let directory = tempfile::tempdir().unwrap();
        let case = case(directory.path(), &["x"]);
        let pipe = directory.path().join("pipe.csv");
        fifo(&pipe);
        let text = fs::read_to_string(&case).unwrap();
        let [zero, fifo] = [Path::new("/dev/zero"), &pipe];
        for (name, source) in [("a.toml", zero), ("b.toml", fifo)] {
            let path = source.to_str().unwrap();
            fs::write(directory.path().join(name), text.replace("\"r.csv\"", &format!("\"{path}\"")))
                .unwrap();
        }
        let out = directory.path().join("out.csv");
        let began = Instant::now();
        for source in [zero, fifo, &directory.path().join("a.toml"), &directory.path().join("b.toml")] {
            let runs = [
                schuler([Path::new("convert"), source, &out]),
                schuler([Path::new("identify"), source]),
                schuler([Path::new("explain"), source]),
                schuler([Path::new("simulate"), source, Path::new("--out"), &out]),
                schuler([Path::new("campaign"), source]),
                schuler([Path::new("fly"), &case, Path::new("--compensation"), source]),
            ];
            for output in runs {
                assert_eq!(output.status.code(), Some(2), "{source:?}: {}", said(&output));
            }
        }
        assert!(began.elapsed() < Duration::from_secs(20));
    }
}
