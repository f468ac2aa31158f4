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

/// A run of equal readings.
#[derive(Clone, Copy)]
struct Run {
    /// Row of its first reading, which may be the last that was live.
    first: usize,
    /// Row of its last reading.
    last: usize,
    /// How many of its readings equal the one before; 1 at least.
    equal: usize,
}

/// The runs of equal readings that are too long for chance, as one fault.
///
/// Neighbours are equal by chance as often as they are outside of the runs. Which runs these are is decided by length: all down to the
/// shortest length of which chance would still show a run in the whole record with a probability of e⁻²⁰ at most.
pub(super) fn stuck(sensor: usize, values: &[f64], repeats: Repeats, mask: &mut [bool]) -> Option<Fault> {
    let (mut runs, pairs) = runs(values, mask);
    let onset = |run: &Run| ("onset_s", run.first as f64, false);
    let present = values.iter().filter(|value| value.is_finite()).count();
    runs.sort_by_key(|run| std::cmp::Reverse(run.equal));
    let longest = runs.first().filter(|run| run.equal >= SHORTEST_RUN)?;
    if longest.equal + 1 >= present {
        // It never moved at all.
        mask.fill(true);
        return repeats.moves.then(|| Fault {
            sensor,
            fault: ReadingFault::Stuck,
            evidence: present as f64,
            rows: (longest.first, longest.last + 1),
            parameters: vec![onset(longest)],
        });
    }
    let equal: usize = runs.iter().map(|run| run.equal).sum();
    let evidence = |number: usize| {
        let within: usize = runs[..number].iter().map(|run| run.equal).sum();
        let elsewhere = ((equal - within) as f64 + 1.0) / (pairs.saturating_sub(within) as f64 + 2.0);
        // A record that moves most of the time says nothing of how readings repeat where it stands still.
        let p = elsewhere.max(repeats.at_rest);
        -(pairs as f64).ln() - runs[number - 1].equal as f64 * p.ln()
    };
    let is_last_of_its_length =
        |&number: &usize| runs.get(number).is_none_or(|next| next.equal < runs[number - 1].equal);
    let number = (1..=runs.iter().take_while(|run| run.equal >= SHORTEST_RUN).count())
        .filter(is_last_of_its_length)
        .rfind(|&number| evidence(number) >= LEAST_STUCK)?;
    let mut stays = runs[..number].to_vec();
    stays.sort_by_key(|run| run.first);
    for run in &stays {
        mask[run.first..=run.last].fill(true);
    }
    let mut parameters = vec![onset(&stays[0])];
    if number > 1 {
        parameters.push(("count", number as f64, false));
    }
    let rows = (stays[0].first, stays[number - 1].last + 1);
    Some(Fault { sensor, fault: ReadingFault::Stuck, evidence: evidence(number), rows, parameters })
}

/// The runs of equal readings, and the number of pairs of neighbours.
fn runs(values: &[f64], mask: &[bool]) -> (Vec<Run>, usize) {
    let (mut runs, mut pairs): (Vec<Run>, usize) = (Vec::new(), 0);
    let mut before: Option<(usize, f64)> = None;
    for (row, &value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        // Two alike on both sides of a stay at a limit are no run.
        if mask[row] {
            before = None;
            continue;
        }
        if let Some((first, other)) = before.replace((row, value)) {
            pairs += 1;
            match runs.last_mut().filter(|run| run.last == first) {
                _ if other != value => {}
                Some(run) => (run.last, run.equal) = (row, run.equal + 1),
                None => runs.push(Run { first, last: row, equal: 1 }),
            }
        }
    }
    (runs, pairs)
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

    /// An output that is stuck again and again is, each time; a coarse one that repeats itself for as long as chance makes it does not.
    #[test]
    fn every_stay_is_found() {
        let mut values: Vec<f64> = (0..3000).map(|k| f64::from((k * 7919) % 2999)).collect();
        for stay in 0..25 {
            let held = values[100 * stay];
            values[100 * stay..100 * stay + 11].fill(held);
        }
        let repeats = Repeats { moves: true, at_rest: 0.0 };
        let mut mask = vec![false; values.len()];
        let fault = stuck(0, &values, repeats, &mut mask).expect("it is stuck");
        assert_eq!((fault.rows, fault.parameters[1]), ((0, 2411), ("count", 25.0, false)));
        assert_eq!(mask.iter().filter(|masked| **masked).count(), 25 * 11);
        let mut state = 1_u32;
        let mut coarse = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 31)
        };
        let values: Vec<f64> = (0..20_000).map(|_| coarse()).collect();
        assert!(stuck(0, &values, repeats, &mut vec![false; values.len()]).is_none());
    }
}
