//! Series on the recording's grid, and what the catalogue does to them: bridging holes, lagging, delaying, differencing.
//!
//! Everything here is O(N), takes times in s, and gives one value a row.
use std::sync::Arc;

/// One value a row, without holes; shared, as many signatures are made of the same few.
pub type Series = Arc<[f64]>;

/// A series varies if its standard deviation is more than this part of its root mean square.
const VARIATION: f64 = 1e-4;
/// Steps that differ by less than this part are equal.
const EQUAL_STEPS: f64 = 1e-6;
/// Both signs occur if each reaches this part of the largest magnitude.
const BOTH_SIGNS: f64 = 0.05;

/// The series with every value that is not finite put between its neighbours in a straight line, and before the first
/// and after the last finite one held. None if no value is finite.
pub fn bridged(time_s: &[f64], values: &[f64]) -> Option<Series> {
    let mut bridged = values.to_vec();
    let mut last: Option<(f64, f64)> = None;
    let mut hole = 0..0;
    for row in 0..bridged.len().min(time_s.len()) {
        let (time, value) = (time_s[row], bridged[row]);
        if !value.is_finite() {
            hole.end = row + 1;
            continue;
        }
        if !hole.is_empty() {
            let (from_s, from) = last.unwrap_or((time - 1.0, value));
            let slope = (value - from) / (time - from_s);
            for inside in hole.clone() {
                bridged[inside] = from + slope * (time_s[inside] - from_s);
            }
        }
        hole = row + 1..row + 1;
        last = Some((time, value));
    }
    let (_, value) = last?;
    bridged[hole].fill(value);
    Some(bridged.into())
}

/// Mean; 0 for an empty series.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Standard deviation about the mean.
pub fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Smallest and largest value.
pub fn extremes(values: &[f64]) -> [f64; 2] {
    values
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], &value| [least.min(value), most.max(value)])
}

/// Largest less smallest value; 0 for an empty series.
pub fn range(values: &[f64]) -> f64 {
    let [least, most] = extremes(values);
    (most - least).max(0.0)
}

/// Whether a series can be told from a constant.
pub fn varies(values: &[f64]) -> bool {
    deviation(values) > VARIATION * rms(values).max(f64::MIN_POSITIVE)
}

/// Whether a series goes well to either side of 0.
pub fn both_signs(values: &[f64]) -> bool {
    let [least, most] = extremes(values);
    let bar = BOTH_SIGNS * most.abs().max(least.abs());
    bar > 0.0 && most >= bar && least <= -bar
}

/// `f` of each value.
pub fn map(values: &[f64], f: impl Fn(f64) -> f64) -> Vec<f64> {
    values.iter().map(|&value| f(value)).collect()
}

/// Product, value by value.
pub fn product(left: &[f64], right: &[f64]) -> Vec<f64> {
    left.iter().zip(right).map(|(left, right)| left * right).collect()
}

/// Cosine and sine of `omega` t.
pub fn waves(time_s: &[f64], omega: f64) -> [Vec<f64>; 2] {
    let of_start = |time: f64| (omega * time).sin_cos();
    let step_s = even_step(time_s);
    let rows = if step_s.is_some() { TOGETHER } else { 1 };
    // On an even grid a turn from some rows to the next ones, and the same turns within them.
    let within: Vec<(f64, f64)> =
        (0..rows).map(|row| (omega * step_s.unwrap_or_default() * row as f64).sin_cos()).collect();
    let mut waves = [Vec::with_capacity(time_s.len()), Vec::with_capacity(time_s.len())];
    for times in time_s.chunks(rows) {
        let (sin, cos) = times.first().map_or((0.0, 1.0), |&start| of_start(start));
        let within = || within.iter().take(times.len());
        waves[0].extend(within().map(|(s, c)| cos * c - sin * s));
        waves[1].extend(within().map(|(s, c)| sin * c + cos * s));
    }
    waves
}

/// Output of a first-order lag with time constant `tau_s`, which starts at rest on the first value:
/// `τ dy/dt = u − y`, exact for an input that is a straight line from row to row.
pub fn lagged(time_s: &[f64], values: &[f64], tau_s: f64) -> Vec<f64> {
    let Some(&first) = values.first() else { return Vec::new() };
    let (mut state, mut before_s, mut before) = (first, time_s.first().copied().unwrap_or_default(), first);
    let mut weights = Weights::new(0.0, tau_s);
    time_s
        .iter()
        .zip(values)
        .map(|(&time, &value)| {
            weights.renew(time - before_s, tau_s);
            // A row waits for the one before in a single product and sum.
            state = weights.decay * state + (weights.before * before + weights.now * value);
            (before_s, before) = (time, value);
            state
        })
        .collect()
}

/// What a lag makes of its state and of an input that is a straight line over a step. Steps are nearly always equal,
/// and an exponential in every row would be most of the work.
struct Weights {
    step_s: f64,
    decay: f64,
    before: f64,
    now: f64,
}

impl Weights {
    fn new(step_s: f64, tau_s: f64) -> Self {
        let step = step_s / tau_s;
        let decay = (-step).exp();
        // Weight of the end of the step; the series avoids 0/0 for small steps.
        let now = if step < 1e-4 { 0.5 * step } else { 1.0 - (1.0 - decay) / step };
        Self { step_s, decay, before: 1.0 - decay - now, now }
    }

    fn renew(&mut self, step_s: f64, tau_s: f64) {
        if (step_s - self.step_s).abs() > EQUAL_STEPS * step_s {
            *self = Self::new(step_s, tau_s);
        }
    }
}

/// The same of an input that is Hermite's cubic over a step: the lag's state is the particular solution
/// u − τ u' + τ² u'' − τ³ u''' at its end, and what decays of the difference at its beginning.
struct SmoothWeights {
    step_s: f64,
    decay: f64,
    /// Of the quotient of differences, and of the derivatives before and now.
    rise: f64,
    before: f64,
    now: f64,
}

impl SmoothWeights {
    fn new(step_s: f64, tau_s: f64) -> Self {
        let decay = (-step_s / tau_s).exp();
        let per_second = step_s.recip();
        // Without the values themselves, whose weights are 1 and −decay.
        let driven = |rise: f64, before: f64, now: f64| {
            let third = 6.0 * (before + now - 2.0 * rise) * (per_second * per_second);
            let second = 2.0 * (3.0 * rise - 2.0 * before - now) * per_second;
            let particular = |first: f64, second: f64| -tau_s * (first - tau_s * (second - tau_s * third));
            particular(now, second + third * step_s) - decay * particular(before, second)
        };
        let (rise, before, now) = (driven(1.0, 0.0, 0.0), driven(0.0, 1.0, 0.0), driven(0.0, 0.0, 1.0));
        Self { step_s, decay, rise, before, now }
    }
}

/// The same for a smooth input and a lag that may be shorter than a step: between rows the input is the cubic with the
/// values and the [derivatives](derivative) of both, of which a straight line would know only the slope half a step ago.
pub fn lagged_smooth(time_s: &[f64], values: &[f64], tau_s: f64) -> Vec<f64> {
    let span_s = time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first);
    let step_s = span_s / (time_s.len().max(2) - 1) as f64;
    // Beyond that the powers of τ cancel badly, and a straight line will do.
    if tau_s > 20.0 * step_s {
        return lagged(time_s, values, tau_s);
    }
    let Some(&first) = values.first() else { return Vec::new() };
    let slopes = derivative(time_s, values);
    let mut weights = SmoothWeights::new(step_s, tau_s);
    let mut per_second = step_s.recip();
    let mut state = first;
    let mut output = vec![first; values.len().min(time_s.len())];
    let rows = output.iter_mut().skip(1).zip(time_s.windows(2)).zip(values.windows(2)).zip(slopes.windows(2));
    for (((output, time_s), values), slopes) in rows {
        let h = time_s[1] - time_s[0];
        if (h - weights.step_s).abs() > EQUAL_STEPS * h {
            weights = SmoothWeights::new(h, tau_s);
            per_second = h.recip();
        }
        let rise = (values[1] - values[0]) * per_second;
        let driven = values[1] - weights.decay * values[0]
            + (weights.rise * rise + weights.before * slopes[0] + weights.now * slopes[1]);
        state = weights.decay * state + driven;
        *output = state;
    }
    output
}

/// The series as it was `delay_s` before (after, where negative), by cubic interpolation through the four rows
/// around. None where that is outside of the recording.
pub fn delayed(time_s: &[f64], values: &[f64], delay_s: f64) -> Vec<Option<f64>> {
    if let Some(step_s) = even_step(time_s) {
        return EvenDelay::new(delay_s / step_s, NARROW_REACH).of(values);
    }
    late_by(time_s, values, |_| delay_s)
}

/// The series as it was `delay_s` of each time before, which is not to grow faster than the time.
fn late_by(time_s: &[f64], values: &[f64], delay_s: impl Fn(f64) -> f64) -> Vec<Option<f64>> {
    let mut place = 0;
    let of_time = |&time: &f64| {
        let wanted = time - delay_s(time);
        while place + 1 < time_s.len() && time_s[place + 1] <= wanted {
            place += 1;
        }
        cubic(time_s, values, place, wanted)
    };
    time_s.iter().map(of_time).collect()
}

/// The series on a clock that loses the part `lost` of the time since the first row (gains it, where negative): what it was so much
/// before each row, by cubic interpolation through the four rows around. None where that is outside of the recording.
pub fn drifted(time_s: &[f64], values: &[f64], lost: f64) -> Vec<Option<f64>> {
    let start_s = time_s.first().copied().unwrap_or_default();
    late_by(time_s, values, |time| lost * (time - start_s))
}

/// [`delayed`] through as many as sixteen rows on either side, for what sways within a few steps: of a swing of 2.2 rad a step in the middle
/// between two rows four rows have 63 %, sixteen 94 % and thirty-two 99 %. A jump of the values rings the longer, too.
pub fn delayed_closely(time_s: &[f64], values: &[f64], delay_s: f64) -> Vec<Option<f64>> {
    match even_step(time_s) {
        Some(step_s) => EvenDelay::new(delay_s / step_s, WIDE_REACH).of(values),
        None => delayed(time_s, values, delay_s),
    }
}

/// The step, if all are equal.
fn even_step(time_s: &[f64]) -> Option<f64> {
    let (first, last) = (time_s.first()?, time_s.last()?);
    let step_s = (last - first) / (time_s.len().max(2) - 1) as f64;
    let equal = |pair: &[f64]| (pair[1] - pair[0] - step_s).abs() < EQUAL_STEPS * step_s;
    (step_s > 0.0 && time_s.windows(2).all(equal)).then_some(step_s)
}

/// Rows on either side that a delayed value is made of.
const NARROW_REACH: usize = 2;
const WIDE_REACH: usize = 16;
/// Rows that are computed together.
const TOGETHER: usize = 64;

/// A delay on an even grid: the same weights in every row.
struct EvenDelay {
    /// Rows from a row to the one before the wanted time.
    rows: isize,
    /// The wanted time is that of the row.
    whole: bool,
    /// Lagrange's weights of one, two … rows on either side.
    weights: Vec<Vec<f64>>,
}

impl EvenDelay {
    /// Part of a step that is rounding.
    const ROUNDING: f64 = 1e-9;

    fn new(steps: f64, reach: usize) -> Self {
        let steps = if (steps - steps.round()).abs() < Self::ROUNDING { steps.round() } else { steps };
        let back = steps.ceil();
        let part = back - steps;
        let weights = (1..=reach).map(|reach| lagrange(part, reach)).collect();
        Self { rows: -back as isize, whole: part == 0.0, weights }
    }

    /// The late values of all rows.
    fn of(&self, values: &[f64]) -> Vec<Option<f64>> {
        let mut late: Vec<Option<f64>> = Vec::with_capacity(values.len());
        let reach = self.weights.len();
        // Rows that have all weights: from the first one on as many as there are windows.
        let first = (reach - 1).checked_add_signed(-self.rows).unwrap_or(0);
        let from = first.saturating_add_signed(self.rows) + 1 - reach;
        let Some(weights) = self.weights.last().filter(|_| !self.whole) else {
            return (0..values.len()).map(|row| self.at(values, row)).collect();
        };
        late.extend((0..first.min(values.len())).map(|row| self.at(values, row)));
        let around = values.get(from..).unwrap_or_default();
        let mut sums = [0.0; TOGETHER];
        // Weight after weight over some rows: row after row the sums would wait for each other.
        let windows = (around.len() + 1).saturating_sub(2 * reach).min(values.len() - late.len());
        for begin in (0..windows).step_by(TOGETHER) {
            let sums = &mut sums[..TOGETHER.min(windows - begin)];
            sums.fill(0.0);
            for (&weight, values) in weights.iter().zip(around[begin..].windows(sums.len())) {
                for (sum, value) in sums.iter_mut().zip(values) {
                    *sum += weight * value;
                }
            }
            late.extend(sums.iter().copied().map(Some));
        }
        late.extend((late.len()..values.len()).map(|row| self.at(values, row)));
        late
    }

    fn at(&self, values: &[f64], row: usize) -> Option<f64> {
        let place = row.checked_add_signed(self.rows)?;
        if self.whole {
            return values.get(place).copied();
        }
        // As many rows as there are on both sides.
        let reach = self.weights.len().min(place + 1).min(values.len().saturating_sub(place + 1));
        let weights = self.weights.get(reach.checked_sub(1)?)?;
        let around = values.get(place + 1 - reach..place + 1 + reach)?;
        Some(weights.iter().zip(around).map(|(weight, value)| weight * value).sum())
    }
}

/// Weights of `reach` nodes on either side of the place `part` between the nodes 0 and 1.
fn lagrange(part: f64, reach: usize) -> Vec<f64> {
    let nodes = || (0..2 * reach).map(|index| index as f64 + 1.0 - reach as f64);
    nodes()
        .map(|node| {
            nodes().filter(|&other| other != node).map(|other| (part - other) / (node - other)).product()
        })
        .collect()
}

/// Value at the time `wanted`, which lies in the step that begins in the row `place`: Lagrange's cubic through the two
/// rows on either side, a straight line in the first and last step.
fn cubic(time_s: &[f64], values: &[f64], place: usize, wanted: f64) -> Option<f64> {
    let (&at, &value) = (time_s.get(place)?, values.get(place)?);
    if wanted == at {
        return Some(value);
    }
    let (&next, &next_value) = (time_s.get(place + 1)?, values.get(place + 1)?);
    if wanted < at || wanted > next {
        return None;
    }
    let line = value + (next_value - value) * (wanted - at) / (next - at);
    let around = place.checked_sub(1).and_then(|first| {
        Some((time_s.get(first..place + 3)?.try_into().ok()?, values.get(first..place + 3)?.try_into().ok()?))
    });
    let Some((times, nodes)): Option<(&[f64; 4], &[f64; 4])> = around else { return Some(line) };
    let step_s = next - at;
    let equal = |other_s: f64| (other_s - step_s).abs() < EQUAL_STEPS * step_s;
    if equal(at - times[0]) && equal(times[3] - next) {
        let x = (wanted - at) / step_s;
        let (x1, x2, x3) = (x + 1.0, x - 1.0, x - 2.0);
        return Some(
            (x1 * x * (nodes[3] * x2 - 3.0 * nodes[2] * x3) + x2 * x3 * (3.0 * nodes[1] * x1 - nodes[0] * x))
                / 6.0,
        );
    }
    let mut sum = 0.0;
    for (i, &node) in nodes.iter().enumerate() {
        let mut weight = 1.0;
        for j in (0..4).filter(|&j| j != i) {
            weight *= (wanted - times[j]) / (times[i] - times[j]);
        }
        sum += weight * node;
    }
    Some(sum)
}

/// Rate of change per second: fourth-order central differences on an even grid, second-order where the steps are not
/// even and beside the ends, one-sided at the ends.
pub fn derivative(time_s: &[f64], values: &[f64]) -> Vec<f64> {
    let rows = values.len().min(time_s.len());
    let quotient = |from: usize, to: usize| {
        if to > from { (values[to] - values[from]) / (time_s[to] - time_s[from]) } else { 0.0 }
    };
    if let (Some(step_s), true) = (even_step(time_s), rows > 4) {
        let per_twelve_steps = (12.0 * step_s).recip();
        let inner =
            values[..rows].windows(5).map(|v| (8.0 * (v[3] - v[1]) - (v[4] - v[0])) * per_twelve_steps);
        let edge = |row: usize| quotient(row.saturating_sub(1), (row + 1).min(rows - 1));
        return ([0, 1].into_iter().map(edge).chain(inner))
            .chain([rows - 2, rows - 1].into_iter().map(edge))
            .collect();
    }
    (0..rows)
        .map(|row| {
            if row < 2 || row + 2 >= rows {
                return quotient(row.saturating_sub(1), (row + 1).min(rows - 1));
            }
            let span_s = time_s[row + 2] - time_s[row - 2];
            let even = (1..=4)
                .all(|k| (time_s[row + k - 2] - time_s[row + k - 3] - span_s / 4.0).abs() < 0.01 * span_s);
            if even {
                (4.0 * quotient(row - 1, row + 1) - quotient(row - 2, row + 2)) / 3.0
            } else {
                quotient(row - 1, row + 1)
            }
        })
        .collect()
}

/// The branch, −1 to 1, on which a play (backlash) of half-width `width` is: 1 while the input has risen by more than
/// the play, −1 while it has fallen. Starts in the middle.
pub fn play_branch(values: &[f64], width: f64) -> Vec<f64> {
    let Some(&first) = values.first() else { return Vec::new() };
    let mut output = first;
    values
        .iter()
        .map(|&value| {
            output = output.clamp(value - width, value + width);
            (value - output) / width
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(rows: usize, step_s: f64) -> Vec<f64> {
        (0..rows).map(|row| row as f64 * step_s).collect()
    }

    #[test]
    fn holes_are_bridged_in_a_straight_line() {
        let nan = f64::NAN;
        let bridged = bridged(&times(6, 2.0), &[nan, 1.0, nan, nan, 4.0, nan]).unwrap();
        assert_eq!(*bridged, [1.0, 1.0, 2.0, 3.0, 4.0, 4.0]);
        assert!(super::bridged(&times(2, 1.0), &[nan, f64::INFINITY]).is_none());
    }

    #[test]
    fn waves_are_cosine_and_sine_on_any_grid() {
        let even = times(300, 0.25);
        let mut uneven = even.clone();
        uneven[7] += 0.1;
        for time_s in [even, uneven] {
            for omega in [0.0, 1e-3, 2.0, 12.0] {
                let [cos, sin] = waves(&time_s, omega);
                let off = |wave: &[f64], exact: fn(f64) -> f64| {
                    let off = wave.iter().zip(&time_s).map(|(wave, &t)| (wave - exact(omega * t)).abs());
                    assert_eq!(wave.len(), time_s.len());
                    off.fold(0.0, f64::max)
                };
                assert!(off(&cos, f64::cos) < 1e-12 && off(&sin, f64::sin) < 1e-12, "{omega} rad/s");
            }
        }
    }

    #[test]
    fn a_lag_follows_a_ramp_at_a_distance_of_its_time_constant() {
        let time_s = times(2001, 0.5);
        let output = lagged(&time_s, &time_s, 30.0);
        for (time, output) in time_s.iter().zip(&output) {
            // y = t − τ (1 − e^(−t/τ)), exact for a ramp.
            assert!((output - (time - 30.0 * (1.0 - (-time / 30.0).exp()))).abs() < 1e-9, "at {time} s");
        }
    }

    #[test]
    fn a_lag_shorter_than_a_step_takes_the_slope_of_now() {
        let omega = 0.5;
        let time_s = times(200, 1.0);
        let values = map(&time_s, |t| (omega * t).sin());
        for tau in [0.001, 0.1, 0.5, 2.0] {
            let x = omega * tau;
            let exact = |t: f64| ((omega * t).sin() - x * (omega * t).cos()) / (1.0 + x * x);
            let output = lagged_smooth(&time_s, &values, tau);
            let error = (30..190).map(|row| (output[row] - exact(time_s[row])).abs()).fold(0.0, f64::max)
                / (x / (1.0 + x * x).sqrt());
            assert!(error < 0.01, "τ {tau} s: off by {error} of the effect");
        }
    }

    #[test]
    fn a_delay_finer_than_a_step_is_exact_for_a_cubic() {
        let cubic = |t: f64| 1.0 + 0.3 * t - 0.02 * t * t + 1e-3 * t * t * t;
        let time_s = times(50, 1.0);
        let values = map(&time_s, cubic);
        for delay_s in [0.001, 0.37, 1.0, 2.6, -0.25] {
            for (row, value) in delayed(&time_s, &values, delay_s).into_iter().enumerate() {
                let time = row as f64 - delay_s;
                let expected = (0.0..=49.0).contains(&time).then(|| cubic(time));
                assert_eq!(value.is_some(), expected.is_some(), "{delay_s} s in row {row}");
                if (1.0..48.0).contains(&time) {
                    assert!((value.unwrap() - expected.unwrap()).abs() < 1e-10, "{delay_s} s in row {row}");
                }
            }
        }
    }

    #[test]
    fn a_sway_within_three_rows_is_delayed_closely_only_by_many_rows() {
        let omega = 2.2;
        let time_s = times(80, 1.0);
        let values = map(&time_s, |t| (omega * t).sin());
        let part = |late: Option<f64>| late.unwrap() / (omega * (40.0 - 0.5)).sin();
        let close = delayed_closely(&time_s, &values, 0.5);
        assert!((part(delayed(&time_s, &values, 0.5)[40]) - 0.634).abs() < 1e-3);
        assert!((part(close[40]) - 0.993).abs() < 1e-3);
        // Beside the ends a straight line, and what lies before the record is not there.
        assert!(close[0].is_none() && (close[1].unwrap() - 0.5 * values[1]).abs() < 1e-12);
        assert!(
            delayed_closely(&time_s, &values, 2.0)[2..]
                .iter()
                .zip(&values)
                .all(|(late, &value)| *late == Some(value))
        );
    }

    #[test]
    fn an_even_grid_gives_what_any_grid_does() {
        let even = times(60, 0.25);
        let mut uneven = even.clone();
        // Too far away to matter to the rows compared, but no even grid any more.
        uneven[59] += 0.1;
        let values = map(&even, |t| (1.3 * t).sin() + 0.1 * t);
        for delay_s in [0.0, 0.01, 0.25, 0.6, 5.0, -0.3, -0.75] {
            let pairs = delayed(&even, &values, delay_s).into_iter().zip(delayed(&uneven, &values, delay_s));
            for (row, (fast, slow)) in pairs.enumerate().take(50) {
                assert_eq!(fast.is_some(), slow.is_some(), "{delay_s} s in row {row}");
                assert!((fast.unwrap_or_default() - slow.unwrap_or_default()).abs() < 1e-12);
            }
        }
        let (fast, slow) = (derivative(&even, &values), derivative(&uneven, &values));
        assert!(fast.iter().zip(&slow).take(50).all(|(fast, slow)| (fast - slow).abs() < 1e-12));
    }

    #[test]
    fn a_derivative_is_that_of_a_fast_sine() {
        let time_s = times(100, 1.0);
        let omega = 2.0 * std::f64::consts::PI * 0.1;
        let rate = derivative(&time_s, &map(&time_s, |t| (omega * t).sin()));
        for row in 2..98 {
            assert!((rate[row] - omega * (omega * time_s[row]).cos()).abs() < 0.01 * omega);
        }
    }

    #[test]
    fn a_play_is_on_either_branch_once_the_input_has_turned_by_its_width() {
        let branch = play_branch(&[0.0, 0.5, 2.0, 1.0, -1.0, -1.5, 0.5], 1.0);
        assert_eq!(branch, [0.0, 0.5, 1.0, 0.0, -1.0, -1.0, 1.0]);
    }

    #[test]
    fn signs_and_variation() {
        let values = [-4.0, 3.0, -2.0, 1.0, 0.0];
        assert!(both_signs(&values) && !both_signs(&[0.0, 1.0, -0.01]));
        assert!(varies(&values) && !varies(&[5.0; 9]) && !varies(&[0.0; 9]));
    }
}
