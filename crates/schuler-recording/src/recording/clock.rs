//! The clock of a recording: what step its rows have, and whether its stamps or an even clock tell when they were taken.
//!
//! Stamps lie in three ways. A clock may be read when a message *arrives*: the sensor samples evenly, the stamps come in bursts
//! or scatter. The intervals may alternate (4 and 6 ms in turn are 200 Hz). Rows may be lost. The three are told apart by what
//! adds up: lost rows make intervals of whole steps; late arrivals make stamps that scatter about an even clock by an amount that
//! does not grow; a clock of truly irregular steps wanders away from any even one.
//!
//! | stamps | step | times of the rows |
//! | --- | --- | --- |
//! | intervals near whole steps | their mean, lost steps counted | the stamps |
//! | scatter that does not grow, intervals not near whole steps | of the even clock | the even clock ([`super::even`]) |
//! | neither | the interval that fits best | the stamps |
use super::even::EvenClock;
use super::grid::missing;
use crate::error::rounded;

/// An interval further than this part of a step from whole steps is irregular.
const FAR_FROM_WHOLE: f64 = 0.3;
/// Stamps of which fewer are irregular are those of the samples.
const FEW_IRREGULAR: f64 = 0.02;
/// A step of the case that is off by more contradicts the stamps.
const CONTRADICTION: f64 = 0.05;
/// A step of the case that is off by more is worth a word.
const WORTH_A_WORD: f64 = 0.005;
/// Intervals whose standard deviation is a larger part of the step are worth a word.
const UNEVEN: f64 = 0.1;
/// Where more steps than this are lost an interval, an even clock of which fewer are lost is nearer.
const MANY_LOST: f64 = 1.0;
/// Of the intervals, at least this part is one step where the step is right, however many rows are lost.
const LEAST_SINGLE: f64 = 0.05;
/// Fewer intervals than this say nothing of a clock but their median.
const LEAST_INTERVALS: usize = 8;
/// A table whose median interval is below this many steps of the case contradicts it, however few rows it has.
const LEAST_MEDIAN_STEPS: f64 = 0.5;
/// The ends of an even clock are known to this part of the scatter of its stamps.
const OF_SCATTER: f64 = 0.25;
/// The ends of unequal intervals are known to so many of their standard deviations.
const OF_DEVIATION: f64 = 2.0;
/// Rounds of counting the lost steps with the mean that the count gives.
const ROUNDS: usize = 4;

/// What the rows of a table follow.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Clock {
    /// Step, s.
    pub(super) step_s: f64,
    /// The even clock that the rows follow, where the stamps are not their times.
    pub(super) even: Option<EvenClock>,
    /// What the user should be told.
    pub(super) note: Option<String>,
}

/// How well a step fits the intervals between the stamps.
#[derive(Clone, Copy, Debug)]
struct Fit {
    /// Mean step, lost ones counted, s.
    mean_s: f64,
    /// Lost steps an interval.
    lost: f64,
    /// Part of the intervals that are not near whole steps.
    irregular: f64,
    /// Part of the intervals that are one step.
    single: f64,
    /// Standard deviation of the intervals of one step, s.
    deviation_s: f64,
}

impl Fit {
    fn of(intervals_s: &[f64], step_s: f64) -> Self {
        let (mut steps, mut span_s, mut irregular) = (0.0, 0.0, 0.0);
        let (mut single, mut sum, mut square) = (0.0, 0.0, 0.0);
        for &interval_s in intervals_s {
            let ratio = interval_s / step_s;
            steps += 1.0 + missing(interval_s, step_s);
            span_s += interval_s;
            irregular += f64::from((ratio - ratio.round().max(1.0)).abs() > FAR_FROM_WHOLE);
            if missing(interval_s, step_s) == 0.0 {
                single += 1.0;
                sum += interval_s - step_s;
                square += (interval_s - step_s).powi(2);
            }
        }
        let count = intervals_s.len().max(1) as f64;
        let variance = square / f64::max(single, 1.0) - (sum / f64::max(single, 1.0)).powi(2);
        Self {
            mean_s: span_s / f64::max(steps, 1.0),
            lost: steps / count - 1.0,
            irregular: irregular / count,
            single: single / count,
            deviation_s: variance.max(0.0).sqrt(),
        }
    }

    /// The fit of the step that `start_s` leads to when lost steps are counted again and again.
    fn settled(intervals_s: &[f64], start_s: f64) -> Self {
        let mut fit = Self::of(intervals_s, start_s);
        for _ in 0..ROUNDS {
            fit = Self::of(intervals_s, fit.mean_s);
        }
        fit
    }

    fn is_regular(&self) -> bool {
        self.irregular < FEW_IRREGULAR
    }
}

impl Clock {
    /// The clock of stamps that never go back, s, in a table whose time column is `column`; `nominal_s` is the step that the case
    /// states.
    ///
    /// # Errors
    /// A stated step that contradicts the stamps: what was found and what was expected.
    pub(super) fn of(stamps_s: &[f64], column: &str, nominal_s: Option<f64>) -> Result<Self, String> {
        let intervals_s: Vec<f64> = stamps_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let median_s = median(&mut intervals_s.clone()).unwrap_or(0.0);
        if intervals_s.len() < LEAST_INTERVALS {
            // A difference of stamps has the digits of their rounding behind its own.
            let largest_s = stamps_s.iter().fold(0.0_f64, |largest, stamp| largest.max(stamp.abs()));
            let median_s = shortest(median_s, 4.0 * f64::EPSILON * largest_s);
            return Self::of_few(&intervals_s, median_s, nominal_s);
        }
        let (own, clear) = Self::own(stamps_s, &intervals_s, median_s, column);
        let Some(nominal_s) = nominal_s else { return Ok(own) };
        let off = |step_s: f64| (step_s / nominal_s - 1.0).abs();
        let under = Fit::of(&intervals_s, nominal_s);
        let fits = under.is_regular() && under.single >= LEAST_SINGLE && off(under.mean_s) <= CONTRADICTION;
        if fits {
            return Ok(Self { step_s: nominal_s, even: None, note: under.note(nominal_s, column, true) });
        }
        if clear && off(own.step_s) <= CONTRADICTION {
            return Ok(own);
        }
        // Neither a sum that is too long nor a step that no interval has is the case's.
        if clear || off(under.mean_s) > CONTRADICTION || under.single < LEAST_SINGLE {
            let span_s =
                stamps_s.last().copied().unwrap_or_default() - stamps_s.first().copied().unwrap_or_default();
            return Err(contradiction(nominal_s, own.step_s, stamps_s.len(), span_s));
        }
        Ok(Self { step_s: nominal_s, even: None, note: under.note(nominal_s, column, true) })
    }

    /// The clock of so few rows that nothing but their median says anything.
    fn of_few(intervals_s: &[f64], median_s: f64, nominal_s: Option<f64>) -> Result<Self, String> {
        let step_s = nominal_s.unwrap_or(median_s);
        if median_s < LEAST_MEDIAN_STEPS * step_s {
            return Err(contradiction(step_s, median_s, intervals_s.len() + 1, intervals_s.iter().sum()));
        }
        Ok(Self { step_s, even: None, note: None })
    }

    /// The clock that the stamps themselves show, and whether they show it clearly.
    fn own(stamps_s: &[f64], intervals_s: &[f64], median_s: f64, column: &str) -> (Self, bool) {
        let positive = |step_s: &f64| *step_s > 0.0;
        let candidates = [Some(median_s), EvenClock::slope(stamps_s)];
        let best = (candidates.into_iter().flatten().filter(positive))
            .map(|start_s| Fit::settled(intervals_s, start_s))
            .min_by(|a, b| a.irregular.total_cmp(&b.irregular));
        let tolerance_s = resolution(stamps_s) / intervals_s.len() as f64;
        let regular = best.filter(Fit::is_regular);
        let stamped = |fit: Fit| {
            let tolerance_s = tolerance_s + OF_DEVIATION * fit.deviation_s / intervals_s.len() as f64;
            let step_s = shortest(fit.mean_s, tolerance_s);
            (Self { step_s, even: None, note: fit.note(step_s, column, false) }, true)
        };
        if let Some(fit) = regular.filter(|fit| fit.lost <= MANY_LOST) {
            return stamped(fit);
        }
        if let Some(even) = EvenClock::of(stamps_s, intervals_s) {
            let tolerance_s = tolerance_s + OF_SCATTER * even.scatter_s() / intervals_s.len() as f64;
            let step_s = shortest(even.step_s, tolerance_s);
            let note = Some(even.note(column, step_s, stamps_s.len()));
            return (Self { step_s, even: Some(even), note }, true);
        }
        if let Some(fit) = regular {
            return stamped(fit);
        }
        let step_s = if median_s > 0.0 { median_s } else { best.map_or(0.0, |fit| fit.mean_s) };
        let note = best.map(|fit| {
            format!(
                "{column}: {:.0} % of the intervals are not near whole steps of {} s, and no even clock describes them",
                100.0 * fit.irregular,
                rounded(step_s)
            )
        });
        (Self { step_s, even: None, note }, false)
    }
}

impl Fit {
    /// What the user should be told of intervals that are not all alike, or not those of the case.
    fn note(&self, step_s: f64, column: &str, stated: bool) -> Option<String> {
        let Self { mean_s, deviation_s, .. } = *self;
        if stated && (mean_s / step_s - 1.0).abs() > WORTH_A_WORD {
            return Some(format!(
                "{column}: the mean step is {mean_s:.6} s; the case states {step_s} s, which is used"
            ));
        }
        (deviation_s > UNEVEN * step_s).then(|| {
            format!("{column}: the intervals scatter by {deviation_s:.2e} s (1 σ); the step of {} s is their mean", rounded(step_s))
        })
    }
}

fn contradiction(found_s: f64, expected_s: f64, rows: usize, span_s: f64) -> String {
    let [expected_s, span_s] = [expected_s, span_s].map(rounded);
    format!("found {found_s}; expected about {expected_s}: {rows} rows of the table span {span_s} s")
}

/// To what a stamp can be read: its last decimal place that is used, or the last bits of the number, s.
fn resolution(stamps_s: &[f64]) -> f64 {
    let largest = stamps_s.iter().fold(0.0_f64, |largest, stamp| largest.max(stamp.abs()));
    let bit_s = 4.0 * f64::EPSILON * largest;
    bit_s.max(crate::motion::last_place(stamps_s, bit_s))
}

/// The shortest decimal number within `tolerance` of `value`.
fn shortest(value: f64, tolerance: f64) -> f64 {
    let tolerance = tolerance.max(4.0 * f64::EPSILON * value.abs());
    (0..17)
        .filter_map(|digits| format!("{value:.digits$e}").parse::<f64>().ok())
        .find(|rounded| (rounded - value).abs() <= tolerance)
        .unwrap_or(value)
}

pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let (_, median, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*median)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from 0 to 1, by the generator SplitMix64.
    fn uniform(mut state: u64) -> impl FnMut() -> f64 {
        move || {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mixed = (state ^ state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64
        }
    }

    fn of(stamps_s: &[f64], nominal_s: Option<f64>) -> Result<Clock, String> {
        Clock::of(stamps_s, "t", nominal_s)
    }

    /// Samples at 200 Hz that arrive in bursts of `burst`, 0.1 ms apart or at once.
    fn bursts(rows: usize, burst: usize, apart_s: f64) -> Vec<f64> {
        let arrival =
            |row: usize| (row / burst + 1) as f64 * burst as f64 * 0.005 + (row % burst) as f64 * apart_s;
        (0..rows).map(arrival).collect()
    }

    #[test]
    fn the_step_of_alternating_intervals_is_their_mean() {
        let stamps: Vec<f64> =
            (0..6000).map(|row| f64::from(row / 2) * 0.01 + f64::from(row % 2) * 0.004).collect();
        let clock = of(&stamps, None).unwrap();
        assert!((clock.step_s - 0.005).abs() < 1e-6 && clock.even.is_none(), "{clock:?}");
        assert!(clock.note.unwrap().contains("scatter"));
        let error = of(&stamps, Some(0.004)).unwrap_err();
        assert!(error.starts_with("found 0.004; expected about 0.005: 6000 rows"), "{error}");
    }

    #[test]
    fn bursts_are_an_even_clock() {
        for (burst, apart_s) in [(2, 1e-4), (5, 1e-4), (5, 0.0), (40, 1e-4), (200, 1e-5)] {
            let clock = of(&bursts(4000, burst, apart_s), None).unwrap();
            assert!((clock.step_s / 0.005 - 1.0).abs() < 1e-4, "{burst}: {clock:?}");
            assert!(clock.even.is_some() && clock.note.is_some());
            assert!(of(&bursts(4000, burst, apart_s), Some(0.005)).unwrap().even.is_some());
            for wrong_s in [0.0025, 0.0045, 0.01, 0.05] {
                let error = of(&bursts(4000, burst, apart_s), Some(wrong_s)).unwrap_err();
                assert!(error.contains("expected about 0.005"), "{burst}: {error}");
            }
        }
    }

    #[test]
    fn late_arrivals_are_an_even_clock_and_steps_that_wander_are_not() {
        let mut uniform = uniform(14);
        let mut late: Vec<f64> = (0..5000).map(|row| f64::from(row) * 0.01 + 0.008 * uniform()).collect();
        late.sort_by(f64::total_cmp);
        let clock = of(&late, None).unwrap();
        assert!((clock.step_s / 0.01 - 1.0).abs() < 1e-4 && clock.even.is_some(), "{clock:?}");
        let mut time_s = 0.0;
        let wandering: Vec<f64> = (0..5000)
            .map(|_| {
                time_s += 0.01 * (0.2 + 1.6 * uniform());
                time_s
            })
            .collect();
        let clock = of(&wandering, None).unwrap();
        assert!(clock.even.is_none() && clock.note.unwrap().contains("no even clock"));
    }

    #[test]
    fn lost_rows_are_no_longer_steps() {
        let mut uniform = uniform(15);
        for lost in [0.05, 0.2, 0.4] {
            let kept = (0..6000).filter(|_| uniform() >= lost);
            let stamps: Vec<f64> = kept.map(|row| f64::from(row) * 0.004).collect();
            let clock = of(&stamps, None).unwrap();
            assert_eq!((clock.step_s, clock.even, clock.note), (0.004, None, None), "{lost}");
        }
    }

    #[test]
    fn a_stated_step_that_is_wrong_by_two_is_refused_and_one_of_few_rows_is_not() {
        let stamps: Vec<f64> = (0..1000).map(|row| f64::from(row) * 0.01).collect();
        for wrong_s in [0.005, 0.02, 0.0091] {
            let error = of(&stamps, Some(wrong_s)).unwrap_err();
            assert!(error.contains("expected about 0.01: 1000 rows of the table span 9.99 s"), "{error}");
        }
        assert_eq!(of(&stamps, Some(0.01)).unwrap().note, None);
        let mut uniform = uniform(16);
        let few: Vec<f64> = (0..4000).filter(|_| uniform() < 0.3).map(|row| f64::from(row) * 0.01).collect();
        assert_eq!(of(&few, Some(0.01)).unwrap().step_s, 0.01);
    }

    #[test]
    fn a_step_is_told_in_as_few_digits_as_the_stamps_allow() {
        for few in [vec![5.0, 5.004, 5.008], vec![1e6, 1_000_000.004, 1_000_000.008], vec![68.9, 68.904]] {
            assert_eq!(of(&few, None).unwrap().step_s, 0.004, "{few:?}");
        }
        assert_eq!(of(&[0.0, 66.0, 135.0], None).unwrap().step_s, median(&mut [66.0, 69.0]).unwrap());
        let stamps: Vec<f64> = (0..3000).map(|row| 1.4036e9 + f64::from(row) * 0.005).collect();
        assert_eq!(of(&stamps, None).unwrap().step_s, 0.005);
        let thirds: Vec<f64> = (0..3000).map(|row| (f64::from(row) * 1e3 / 286.0).floor() / 1e3).collect();
        let step_s = of(&thirds, None).unwrap().step_s;
        assert!((step_s * 286.0 - 1.0).abs() < 2e-4 && step_s != 0.0035, "{step_s}");
    }
}
