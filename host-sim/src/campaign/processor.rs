//! Processor time of other processes, from what Linux says of them in `/proc`. Elsewhere there is
//! none, and callers take elapsed time.
use std::fs;

/// Units of time in `/proc/PID/stat`, of a second. `USER_HZ` is 100 on every architecture that
/// Rust's standard library supports.
const TICKS: f64 = 100.0;
/// Place of a process's own user time among the fields behind its name, which ends in a bracket;
/// its system time is next, then both of the children that it has waited for (proc_pid_stat(5):
/// fields 14 to 17).
const USER_TIME: usize = 11;

/// Seconds of all processes that this one has waited for.
pub fn waited_for() -> Option<f64> {
    let [_, children] = times(&fs::read_to_string("/proc/self/stat").ok()?)?;
    Some(children)
}

/// Seconds of a process that runs.
pub fn running(process: u32) -> Option<f64> {
    let [own, _] = times(&fs::read_to_string(format!("/proc/{process}/stat")).ok()?)?;
    Some(own)
}

/// Seconds of a process itself and of those that it has waited for.
fn times(stat: &str) -> Option<[f64; 2]> {
    let (_, behind_name) = stat.rsplit_once(')')?;
    let fields: Vec<&str> = behind_name.split_whitespace().collect();
    let ticks = |place: usize| fields.get(place)?.parse::<f64>().ok();
    let seconds = |place: usize| Some((ticks(place)? + ticks(place + 1)?) / TICKS);
    Some([seconds(USER_TIME)?, seconds(USER_TIME + 2)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_stand_behind_a_name_that_may_have_brackets() {
        let stat = "17 (a) b) S 1 17 17 0 -1 4194560 900 0 0 0 250 50 7 3 20 0 1 0 100 1000 10";
        assert_eq!(times(stat), Some([3.0, 0.1]));
        assert_eq!(times("17 (a) S 1"), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_child_that_was_waited_for_counts() {
        let before = waited_for().unwrap();
        let busy = "i=0; while [ $i -lt 100000 ]; do i=$((i+1)); done";
        assert!(std::process::Command::new("sh").args(["-c", busy]).status().unwrap().success());
        assert!(waited_for().unwrap() > before);
    }
}
