//! Runs of equal readings.
use statrs::function::erf::erf;

use super::Fault;
use crate::catalogue::ReadingFault;

/// Shortest run of equal readings that may be a stuck output.
const SHORTEST_RUN: usize = 5;
/// Evidence of a stuck output, nats.
const LEAST_STUCK: f64 = 20.0;

/// How often readings repeat without being stuck.
#[derive(Clone, Copy, Debug)]
pub(super) struct Repeats {
    /// Whether the noise alone would move the output.
    pub moves: bool,
    /// Probability that the next reading is the same while the input stands still.
    pub at_rest: f64,
}

/// Probability that a reading rounded to `step` repeats at a constant input, at most: noise of standard deviation `white`
/// stays within half a step of the middle of one.
pub(super) fn same_at_rest(step: f64, white: f64) -> f64 {
    if step > 0.0 && white > 0.0 { erf(step / (8.0_f64.sqrt() * white)) } else { 0.0 }
}

/// The longest run of equal readings.
pub(super) fn stuck(sensor: usize, values: &[f64], repeats: Repeats, mask: &mut [bool]) -> Option<Fault> {
    let mut longest = (0, 0);
    let (mut equal, mut pairs) = (0usize, 0usize);
    let mut start = 0;
    let mut last: Option<f64> = None;
    for (row, &value) in values.iter().enumerate() {
        if !value.is_finite() {
            continue;
        }
        // Two alike on both sides of a stay at a limit are no run.
        if mask[row] {
            last = None;
            continue;
        }
        if let Some(before) = last {
            pairs += 1;
            if before == value {
                equal += 1;
                if row - start > longest.1 - longest.0 {
                    longest = (start, row);
                }
            } else {
                start = row;
            }
        } else {
            start = row;
        }
        last = Some(value);
    }
    let (first, end) = longest;
    let length = values[first..end].iter().filter(|value| value.is_finite()).count();
    if length < SHORTEST_RUN {
        return None;
    }
    let present = values.iter().filter(|value| value.is_finite()).count();
    if length + 1 >= present {
        // It never moved at all.
        mask.fill(true);
        return repeats.moves.then(|| Fault {
            sensor,
            fault: ReadingFault::Stuck,
            evidence: present as f64,
            rows: (first, end + 1),
            parameters: vec![("onset_s", first as f64, false)],
        });
    }
    let outside = pairs.saturating_sub(length);
    let elsewhere = (equal.saturating_sub(length) as f64 + 1.0) / (outside as f64 + 2.0);
    // A record that moves most of the time says nothing of how readings repeat where it stands still.
    let p = elsewhere.max(repeats.at_rest);
    let evidence = -(pairs as f64).ln() - length as f64 * p.ln();
    if evidence < LEAST_STUCK {
        return None;
    }
    mask[first..=end].fill(true);
    Some(Fault {
        sensor,
        fault: ReadingFault::Stuck,
        evidence,
        rows: (first, end + 1),
        parameters: vec![("onset_s", first as f64, false)],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A coarse output that stands still between manoeuvres repeats itself; one as fine as its noise does not.
    #[test]
    fn coarse_readings_at_rest_are_not_stuck() {
        let mut values: Vec<f64> = (0..2000).map(|k| f64::from((k * 7919) % 997)).collect();
        values[900..940].fill(3.0);
        let found = |step: f64, white: f64| {
            let repeats = Repeats { moves: true, at_rest: same_at_rest(step, white) };
            stuck(0, &values, repeats, &mut vec![false; values.len()]).is_some()
        };
        assert!(found(1.0, 5.0));
        assert!(!found(1.0, 0.28));
    }

    /// Where no readings are equal by chance a few that are show more than many where some are.
    #[test]
    fn a_short_run_is_stuck_where_no_others_are_equal() {
        let run = |equal: usize| {
            let mut values: Vec<f64> = (0..2000).map(|k| f64::from((k * 7919) % 1999)).collect();
            values.truncate(2000 - equal);
            values.extend(vec![0.5; equal]);
            let repeats = Repeats { moves: true, at_rest: 0.0 };
            stuck(0, &values, repeats, &mut vec![false; values.len()]).map(|fault| fault.rows)
        };
        assert_eq!(run(17), Some((1983, 2000)));
        assert_eq!(run(6), Some((1994, 2000)));
        assert_eq!(run(4), None);
    }
}
