//! Recordings that are needed whole: read where the memory suffices, and refused before it is gone where it does not.
use std::fs;
use std::path::Path;

use schuler_recording::{CaseFile, Error, Problem, Recording};

use super::Failure;
use super::session::Session;

const GIGABYTE: f64 = 1e9;

/// What some work takes in all, bytes, as far as it grows with the recording.
#[derive(Clone, Copy, Debug)]
pub(super) struct Need {
    /// For each row.
    pub(super) row: u64,
    /// For each value of the columns that the case names.
    pub(super) value: u64,
}

/// Reads the recording of a case for work that needs it whole.
pub(super) fn recording(file: CaseFile, need: Need, session: &Session) -> Result<Recording, Failure> {
    let waiting = session.waiting("reading");
    let case = file.path.clone();
    let there = available();
    let table = file.open_table()?;
    Recording::of_table_watched(file, table, |rows, columns| {
        waiting.check()?;
        let needed = rows as u64 * (need.row + need.value * columns as u64);
        there
            .filter(|there| needed > *there)
            .map_or(Ok(()), |there| Err(too_long(&case, needed, there).into()))
    })
}

fn too_long(case: &Path, needed: u64, there: u64) -> Error {
    let [needed, there] = [needed, there].map(|bytes| bytes as f64 / GIGABYTE);
    let message = format!(
        "needs the whole recording in memory, more than {needed:.1} GB of which {there:.1} GB are there; \
         expected a shorter one: schuler convert {} PART --from SECONDS --to SECONDS",
        case.display()
    );
    Error::one(case, Problem::new(None, "recording", message))
}

/// Bytes that this process may still take: of the machine, of its control group, of its own limit; none where the system does
/// not say.
fn available() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).ok();
    let machine = read("/proc/meminfo").and_then(|text| Some(1024 * number(&text, "MemAvailable:")?));
    let group = read("/proc/self/cgroup").and_then(|text| {
        let group = text.lines().find_map(|line| line.strip_prefix("0::"))?;
        let of_group =
            |name: &str| read(&format!("/sys/fs/cgroup{group}/{name}"))?.trim().parse::<u64>().ok();
        Some(of_group("memory.max")?.saturating_sub(of_group("memory.current")?))
    });
    let process = read("/proc/self/limits").and_then(|text| {
        let taken = 1024 * number(&read("/proc/self/status")?, "VmSize:")?;
        Some(number(&text, "Max address space")?.saturating_sub(taken))
    });
    [machine, group, process].into_iter().flatten().min()
}

/// The number behind a name at the beginning of a line.
fn number(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_says_is_understood() {
        let meminfo = "MemTotal:       24 kB\nMemAvailable:   17 kB\n";
        assert_eq!(number(meminfo, "MemAvailable:"), Some(17));
        assert_eq!(
            number("Max address space         unlimited            unlimited   bytes", "Max address space"),
            None
        );
        assert_eq!(
            number("Max address space         4096                 unlimited   bytes", "Max address space"),
            Some(4096)
        );
        assert!(!cfg!(target_os = "linux") || available().is_some_and(|bytes| bytes > 1 << 20));
    }

    #[test]
    fn what_to_do_is_said() {
        let message = too_long(Path::new("run/case.toml"), 31_000_000_000, 4_200_000_000).to_string();
        assert!(
            message.starts_with("run/case.toml: recording: needs") && message.contains("31.0 GB"),
            "{message}"
        );
        assert!(message.contains("schuler convert run/case.toml"), "{message}");
    }
}
