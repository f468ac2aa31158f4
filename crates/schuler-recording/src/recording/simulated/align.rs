//! The clock of a simulator against that of a recording, by the likeness of what both say.
//!
//! First the offset, among all at which enough of both overlaps, by the correlation of means over a few thousand bins; then offset and rate
//! by Gauss–Newton on the rows. A sensor's own scale and bias are free all the time: they are physics, not clock.
use std::fmt;

use super::interpolate::interpolated;

/// Bins of the longer of the two.
const BINS: f64 = 4096.0;
/// Part of the shorter one that has to overlap.
const LEAST_OVERLAP: f64 = 0.3;
/// Fewest bins that have to.
const FEWEST: usize = 16;
/// Square of the correlation below which nothing is alike.
const LEAST_ALIKE: f64 = 0.1;
/// Rows that are refined with.
const MOST_ROWS: usize = 20_000;
const ITERATIONS: usize = 30;
/// Largest rate against 1, and how many of its standard deviations it must have to be one.
const MOST_RATE: f64 = 0.05;
const RATE_SIGMAS: f64 = 4.0;
/// Least part of a sensor's variance that is taken to be noise.
const ROUNDING: f64 = 1e-18;

/// A sensor's readings and what the simulator says of them, each on its own rows.
#[derive(Clone, Copy)]
pub(super) struct Pair<'p> {
    pub(super) recorded: &'p [f64],
    pub(super) simulated: &'p [f64],
}

/// The simulator's time at a time t of the recording: t + offset + rate · (t − start).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shift {
    pub(super) start_s: f64,
    pub(super) offset_s: f64,
    pub(super) rate: f64,
}

impl Shift {
    pub(super) fn apply(&self, time_s: f64) -> f64 {
        time_s + self.offset_s + self.rate * (time_s - self.start_s)
    }
}

impl fmt::Display for Shift {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { offset_s, rate, .. } = self;
        write!(f, "the simulator's clock is taken to be {offset_s:+.6} s from the recording's at its start")?;
        match rate {
            0.0 => f.write_str(" and to run at its rate"),
            rate => write!(f, " and its rate to be {:+.1} ppm off", 1e6 * rate),
        }
    }
}

/// What is alike in pairs of series whose rows are at `recorded_s` and at `simulated_s`; none where nothing is.
pub(super) fn shift(recorded_s: &[f64], simulated_s: &[f64], pairs: &[Pair<'_>]) -> Option<Shift> {
    let (&start_s, &begin_s) = (recorded_s.first()?, simulated_s.first()?);
    let span = |time_s: &[f64]| time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first);
    let (recorded, simulated) = (span(recorded_s), span(simulated_s));
    let bin_s = recorded.max(simulated) / BINS;
    let bin_s = bin_s.max(step(recorded, recorded_s.len())).max(step(simulated, simulated_s.len()));
    if bin_s.is_nan() || bin_s <= 0.0 {
        return None;
    }
    let binned: Vec<[Vec<f64>; 2]> = (pairs.iter())
        .map(|pair| [bins(recorded_s, pair.recorded, bin_s), bins(simulated_s, pair.simulated, bin_s)])
        .collect();
    let lengths = [(recorded / bin_s) as i64 + 1, (simulated / bin_s) as i64 + 1];
    let least = ((LEAST_OVERLAP * lengths[0].min(lengths[1]) as f64) as i64)
        .max(i64::try_from(FEWEST).unwrap_or(i64::MAX));
    // Bin k of the recording is bin k + lag of the simulation.
    let lags = least - lengths[0]..=lengths[1] - least;
    let gain = |lag: i64| -> f64 { binned.iter().map(|pair| alike(pair, lag)).sum() };
    let (lag, gain) = lags.map(|lag| (lag, gain(lag))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    if gain <= 0.0 {
        return None;
    }
    let coarse = Shift { start_s, offset_s: begin_s - start_s + lag as f64 * bin_s, rate: 0.0 };
    Some(refined(coarse, [recorded_s, simulated_s], pairs, bin_s))
}

fn step(span: f64, rows: usize) -> f64 {
    span / rows.saturating_sub(1).max(1) as f64
}

/// Means over bins from the first row on; NaN where there are none.
fn bins(time_s: &[f64], values: &[f64], bin_s: f64) -> Vec<f64> {
    let start_s = time_s.first().copied().unwrap_or_default();
    let mut sums: Vec<(f64, f64)> = Vec::new();
    for (time, value) in time_s.iter().zip(values).filter(|(_, value)| value.is_finite()) {
        let bin = ((time - start_s) / bin_s) as usize;
        if sums.len() <= bin {
            sums.resize(bin + 1, (0.0, 0.0));
        }
        if let Some((sum, count)) = sums.get_mut(bin) {
            (*sum, *count) = (*sum + value, *count + 1.0);
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count).collect()
}

/// What a line through one as a function of the other gains, in nats for white noise; 0 where they are not alike.
fn alike([recorded, simulated]: &[Vec<f64>; 2], lag: i64) -> f64 {
    let rows = recorded.iter().enumerate().filter_map(|(row, &y)| {
        let beside = usize::try_from(i64::try_from(row).ok()? + lag).ok()?;
        let x = *simulated.get(beside)?;
        (x.is_finite() && y.is_finite()).then_some([1.0, x, y, x * x, x * y, y * y])
    });
    let [n, x, y, xx, xy, yy] = rows.fold([0.0; 6], |mut sums, row| {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
        sums
    });
    let [xx, xy, yy] = [n * xx - x * x, n * xy - x * y, n * yy - y * y];
    let square = xy * xy / (xx * yy);
    if n < FEWEST as f64 || square.is_nan() || square <= LEAST_ALIKE {
        0.0
    } else {
        -0.5 * n * (1.0 - square.min(1.0 - 1e-12)).ln()
    }
}

/// Offset and rate by Gauss–Newton, as long as they stay near where they began.
fn refined(coarse: Shift, [recorded_s, simulated_s]: [&[f64]; 2], pairs: &[Pair<'_>], bin_s: f64) -> Shift {
    let stride = recorded_s.len().div_ceil(MOST_ROWS);
    let time_s: Vec<f64> = recorded_s.iter().copied().step_by(stride).collect();
    let readings: Vec<Vec<f64>> =
        pairs.iter().map(|pair| pair.recorded.iter().copied().step_by(stride).collect()).collect();
    let delta_s = 0.25
        * step(
            simulated_s.last().zip(simulated_s.first()).map_or(0.0, |(last, first)| last - first),
            simulated_s.len(),
        );
    let mut with_rate = true;
    let mut now = coarse;
    let mut iteration = 0;
    while iteration < ITERATIONS {
        iteration += 1;
        let at = |by_s: f64| -> Vec<f64> { time_s.iter().map(|&time| now.apply(time) + by_s).collect() };
        let (before_s, at_s, after_s) = (at(-delta_s), at(0.0), at(delta_s));
        let mut sums = Sums::default();
        for (pair, readings) in pairs.iter().zip(&readings) {
            let of = |at_s: &[f64]| interpolated(simulated_s, pair.simulated, at_s);
            let changes = of(&after_s).into_iter().zip(of(&before_s));
            let slope: Vec<f64> = changes.map(|(after, before)| (after - before) / (2.0 * delta_s)).collect();
            sums.add(&time_s, now.start_s, readings, &of(&at_s), &slope);
        }
        let Some(([offset_s, rate], [_, rate_sigma])) = sums.solved(with_rate) else { return coarse };
        now.offset_s += offset_s;
        now.rate += rate;
        let is_far = (now.offset_s - coarse.offset_s).abs() > 4.0 * bin_s + MOST_RATE * span_of(&time_s);
        if is_far || now.rate.abs() > MOST_RATE {
            return coarse;
        }
        let span_s = span_of(&time_s);
        if offset_s.abs().max(rate.abs() * span_s) < 1e-4 * delta_s {
            if with_rate && now.rate.abs() < RATE_SIGMAS * rate_sigma {
                // A rate that is not seen would be an offset's error at the other end.
                (with_rate, now.rate, iteration) = (false, 0.0, 0);
                continue;
            }
            break;
        }
    }
    now
}

fn span_of(time_s: &[f64]) -> f64 {
    time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first)
}

/// Normal equations of an offset and a rate, all sensors together, each with its scale and bias taken out and by its own scatter.
#[derive(Default)]
struct Sums {
    square: [[f64; 2]; 2],
    with_left: [f64; 2],
}

impl Sums {
    fn add(&mut self, time_s: &[f64], start_s: f64, readings: &[f64], simulated: &[f64], slope: &[f64]) {
        // Columns: 1, s, ṡ, (t − start)·ṡ; the reading last.
        let mut sums = [[0.0; 5]; 5];
        let rows = time_s.iter().zip(readings).zip(simulated).zip(slope);
        for (((time, reading), simulated), slope) in rows {
            let row = [1.0, *simulated, *slope, (time - start_s) * slope, *reading];
            if row.iter().all(|value| value.is_finite()) {
                for (i, sums) in sums.iter_mut().enumerate() {
                    sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += row[i] * value);
                }
            }
        }
        let n = sums[0][0];
        // Gauss: bias and scale are taken out of the rest. The scale first, which the slopes are to be multiplied with.
        let (mut scale, mut scatter) = (0.0, 0.0);
        for pivot in 0..2 {
            if sums[pivot][pivot] <= 0.0 {
                return;
            }
            if pivot == 1 {
                scale = sums[1][4] / sums[1][1];
                scatter = sums[4][4] / n.max(1.0);
            }
            for row in pivot + 1..5 {
                let factor = sums[row][pivot] / sums[pivot][pivot];
                let of_pivot = sums[pivot];
                for (value, pivot) in sums[row].iter_mut().zip(of_pivot).skip(pivot) {
                    *value -= factor * pivot;
                }
            }
        }
        // Without noise nothing is left but rounding, by which nothing can be divided.
        let variance = (sums[4][4] / n.max(1.0)).max(ROUNDING * scatter);
        if variance.is_nan() || variance <= 0.0 || n < FEWEST as f64 {
            return;
        }
        for i in 0..2 {
            for j in 0..2 {
                self.square[i][j] += scale * scale * sums[2 + i][2 + j] / variance;
            }
            self.with_left[i] += scale * sums[2 + i][4] / variance;
        }
    }

    /// Values and standard deviations of offset, s, and rate.
    fn solved(&self, with_rate: bool) -> Option<([f64; 2], [f64; 2])> {
        let [[a, b], [_, d]] = self.square;
        if !with_rate {
            return (a > 0.0).then(|| ([self.with_left[0] / a, 0.0], [a.recip().sqrt(), 0.0]));
        }
        let determinant = a * d - b * b;
        (determinant > 1e-12 * a * d).then(|| {
            let [left, right] = self.with_left;
            let solution = [(d * left - b * right) / determinant, (a * right - b * left) / determinant];
            (solution, [(d / determinant).sqrt(), (a / determinant).sqrt()])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(t: f64) -> f64 {
        (0.7 * t).sin() + 0.5 * (0.231 * t + 1.0).cos() + 0.2 * (2.1 * t).sin()
    }

    /// Noise without a generator: the fractional part of a large sine.
    fn noise(row: usize) -> f64 {
        let x = (row as f64 * 12.9898).sin() * 43_758.547;
        x - x.floor() - 0.5
    }

    fn found(offset_s: f64, rate: f64, noisy: f64) -> Shift {
        let recorded_s: Vec<f64> = (0..6000).map(|k| 1000.0 + 0.02 * f64::from(k)).collect();
        let simulated_s: Vec<f64> = (0..20_000).map(|k| 0.01 * f64::from(k)).collect();
        let simulated: Vec<f64> = simulated_s.iter().map(|&t| signal(t)).collect();
        let truth = Shift { start_s: 1000.0, offset_s: offset_s - 1000.0, rate };
        let recorded: Vec<f64> = (recorded_s.iter().enumerate())
            .map(|(row, &t)| 3.0 + 1.1 * signal(truth.apply(t)) + noisy * noise(row))
            .collect();
        shift(&recorded_s, &simulated_s, &[Pair { recorded: &recorded, simulated: &simulated }]).unwrap()
    }

    #[test]
    fn offset_and_rate_of_a_clock_are_found() {
        let shift = found(23.4567, 150e-6, 0.05);
        assert!((shift.offset_s + 1000.0 - 23.4567).abs() < 2e-3, "{shift}");
        assert!((shift.rate - 150e-6).abs() < 3e-5, "{shift}");
    }

    #[test]
    fn a_rate_that_is_not_there_is_none() {
        let shift = found(5.0, 0.0, 0.3);
        assert_eq!(shift.rate, 0.0);
        assert!((shift.offset_s + 995.0).abs() < 5e-3, "{shift}");
    }

    #[test]
    fn what_is_not_alike_has_no_clock() {
        let time_s: Vec<f64> = (0..2000).map(f64::from).collect();
        let noises = |from: usize| -> Vec<f64> { (from..from + 2000).map(noise).collect() };
        let (recorded, simulated) = (noises(0), noises(777_777));
        let pair = Pair { recorded: &recorded, simulated: &simulated };
        assert_eq!(shift(&time_s, &time_s, &[pair]), None);
    }
}
