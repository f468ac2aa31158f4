//! Temperature and its rate from a thermometer, without the attenuation that a noisy cause brings on its coefficient.
//!
//! A thermometer reads in steps of q and stays on a step for minutes. Where its steps are clean, only the instants at
//! which the reading changes say much: the temperature then is at the threshold between the two levels
//! (TEMPERATURE M1); a reading that stays says that the temperature is within the step (M3). Where noise makes the
//! reading flicker between levels, or there are no steps, every reading counts. Either way the
//! [smoother](super::smoother) does the rest, with its process noise, and the measurement noise that the case does not
//! give, by maximum likelihood.
//!
//! Output: T in °C, dT/dt in K/s, and their variances, in every row, gaps bridged.
use super::series::{self, Series};
use super::smoother::{Measurement, Smoothed, process_and_factor, process_noise, smooth};

/// Part of rows in which the level changes beyond which readings are taken one by one: noise of 0.25 steps makes
/// so many, and where the temperature itself does, the errors of its steps are as good as white.
const CHANGES_PER_ROW: f64 = 0.28;
/// Changes to and fro across one threshold, each within this time of the one before, are one crossing, s, for as long as a reading that
/// stays counts once.
const CLUSTER_S: f64 = 120.0;
/// A reading that stays counts every so often, s, and as often as what the temperature does elsewhere would take it off its step.
const HOLD_S: f64 = 900.0;
/// Standard deviations of a threshold's crossing that are tried, in steps.
const CROSSING_SIGMA: [f64; 4] = [0.01, 0.03, 0.1, 0.25];
/// A quantity is read in steps if no more different values occur than this part of its readings.
const DISTINCT_VALUES: f64 = 0.25;
/// Most different values that are looked at for a step.
const MOST_DISTINCT: usize = 20_000;
/// How far a difference of two levels may be from a whole number of steps, in steps.
const STEP_TOLERANCE: f64 = 0.02;
/// Readings without steps of which fewer than this part differ from the one before are held from sample to sample.
const HELD: f64 = 0.5;
/// Readings beyond which those of a record without steps are averaged in blocks to find the noise.
const MOST_READINGS: usize = 20_000;
/// Least variance of a reading, relative to the square of the range.
const LEAST_VARIANCE: f64 = 1e-12;

/// Temperature at a place.
#[derive(Clone, Debug)]
pub struct Thermometer {
    /// Its column.
    pub column: String,
    /// The sensor, group or thing it sits at.
    pub near: Option<String>,
    /// Where it sits in body axes, m.
    pub position_m: Option<[f64; 3]>,
    /// Temperature, °C.
    pub temperature: Series,
    /// Its rate, K/s.
    pub rate: Series,
    /// Variance of the temperature, K².
    pub temperature_variance: Series,
    /// Variance of the rate, (K/s)².
    pub rate_variance: Series,
    /// Step of its readings, K; 0 where there is none.
    pub quantisation: f64,
    /// Whether it was estimated from the instants at which its readings change, as every reading by itself says little.
    pub by_its_steps: bool,
}

impl Thermometer {
    /// What the readings of a thermometer say; none if there are no readings.
    pub fn new(
        column: &str,
        near: Option<&str>,
        position_m: Option<[f64; 3]>,
        time_s: &[f64],
        readings: &[f64],
    ) -> Option<Self> {
        let (smoothed, quantisation, by_its_steps) = smoothed(time_s, readings)?;
        Some(Self {
            column: column.to_owned(),
            near: near.map(str::to_owned),
            position_m,
            temperature: smoothed.value.into(),
            rate: smoothed.rate.into(),
            temperature_variance: smoothed.value_variance.into(),
            rate_variance: smoothed.rate_variance.into(),
            quantisation,
            by_its_steps,
        })
    }

    /// The difference of two temperatures, K, and its mean variance, K²; `readings` are the differences of their readings.
    ///
    /// It changes less, and otherwise, than the two do: smoothed by itself it has less noise than the difference of what each is
    /// smoothed to. Of a thermometer that is known by its steps the readings' difference says little.
    pub fn difference(first: &Self, second: &Self, time_s: &[f64], readings: &[f64]) -> (Series, f64) {
        let step = first.quantisation.hypot(second.quantisation);
        let smoothed = if first.by_its_steps || second.by_its_steps {
            None
        } else {
            estimate(time_s, readings, step, false)
        };
        if let Some(smoothed) = smoothed {
            return (smoothed.value.into(), series::mean(&smoothed.value_variance));
        }
        let difference =
            first.temperature.iter().zip(&*second.temperature).map(|(first, second)| second - first);
        let variances = [first, second].map(|it| series::mean(&it.temperature_variance));
        (difference.collect(), variances.iter().sum())
    }

    /// Whether the temperature moves by more than its steps and its uncertainty.
    pub fn varies(&self) -> bool {
        moves(&self.temperature, &self.temperature_variance, self.quantisation)
    }

    /// Whether its rate does.
    pub fn rate_varies(&self) -> bool {
        self.varies() && self.is_known_about(series::mean(&self.rate))
    }

    /// Whether its rate is known to be other than 0. A steady one acts like a constant bias, and no less than that.
    pub fn rate_shows(&self) -> bool {
        self.varies() && self.is_known_about(0.0)
    }

    /// Whether most of what its rate is beside a value, in the mean square, it is where that is more than its uncertainty. Where a temperature
    /// dwells little is known of a rate that is next to nothing, and that is no reason to doubt the rate of the ramps.
    fn is_known_about(&self, value: f64) -> bool {
        let rows = self.rate.iter().zip(&*self.rate_variance);
        let (mut known, mut all) = (0.0, 0.0);
        for (square, variance) in rows.map(|(rate, variance)| ((rate - value).powi(2), *variance)) {
            all += square;
            known += if square > variance { square } else { 0.0 };
        }
        known > 0.5 * all
    }

    /// Part of the variance of the true rate that its estimate has. A coefficient on the estimate is not attenuated
    /// by it (the estimate is a posterior mean); one on a raw difference is.
    pub fn reliability_of_rate(&self) -> f64 {
        let known = series::deviation(&self.rate).powi(2);
        let unknown = series::mean(&self.rate_variance);
        if known > 0.0 { known / (known + unknown) } else { 0.0 }
    }
}

/// Step of the readings; 0 if there is none.
pub fn step_of(readings: &[f64]) -> f64 {
    let mut levels: Vec<f64> = readings.iter().copied().filter(|reading| reading.is_finite()).collect();
    let count = levels.len();
    levels.sort_unstable_by(f64::total_cmp);
    levels.dedup();
    let (Some(&least), Some(&most)) = (levels.first(), levels.last()) else { return 0.0 };
    if levels.len() < 2
        || levels.len() > MOST_DISTINCT
        || levels.len() as f64 > DISTINCT_VALUES * count as f64
    {
        return 0.0;
    }
    // Levels that differ by rounding in the table are one.
    let rounding = 1e-9 * (most - least).max(most.abs().max(least.abs()) * 1e-3);
    let differences: Vec<f64> = (levels.windows(2).map(|pair| pair[1] - pair[0]))
        .filter(|&difference| difference > rounding)
        .collect();
    let Some(smallest) = differences.iter().copied().min_by(f64::total_cmp) else { return 0.0 };
    let mut steps = 0.0;
    for difference in &differences {
        let multiple = difference / smallest;
        if (multiple - multiple.round()).abs() > STEP_TOLERANCE * multiple.max(1.0) {
            return 0.0;
        }
        steps += multiple.round();
    }
    (most - least) / steps
}

/// Whether readings stay on each of their steps long enough for the instants of change to say more than the readings.
fn has_clean_steps(readings: &[f64], step: f64) -> bool {
    let values: Vec<f64> = readings.iter().copied().filter(|reading| reading.is_finite()).collect();
    let changes = values.windows(2).filter(|pair| pair[0] != pair[1]).count() as f64;
    step > 0.0 && changes <= CHANGES_PER_ROW * values.len() as f64
}

/// Whether a quantity moves by more than its steps and its uncertainty.
pub fn moves(values: &[f64], variances: &[f64], step: f64) -> bool {
    series::range(values) > 3.0 * step && series::deviation(values) > 2.0 * series::mean(variances).sqrt()
}

/// A quantity that changes smoothly, from its readings; their step, and whether it was estimated from the instants at which they change. None
/// if there are no readings.
pub fn smoothed(time_s: &[f64], readings: &[f64]) -> Option<(Smoothed, f64, bool)> {
    let step = step_of(readings);
    let by_its_steps = has_clean_steps(readings, step);
    Some((estimate(time_s, readings, step, by_its_steps)?, step, by_its_steps))
}

/// Smoothed quantity of readings with the given step.
fn estimate(time_s: &[f64], readings: &[f64], step: f64, by_its_steps: bool) -> Option<Smoothed> {
    let rows: Vec<usize> = (0..readings.len()).filter(|&row| readings[row].is_finite()).collect();
    let (&first, _) = (rows.first()?, rows.last()?);
    let values: Vec<f64> = rows.iter().map(|&row| readings[row]).collect();
    let span = series::range(&values);
    if span == 0.0 {
        let rows = readings.len();
        return Some(Smoothed {
            value: vec![readings[first]; rows],
            rate: vec![0.0; rows],
            value_variance: vec![step * step / 12.0; rows],
            rate_variance: vec![0.0; rows],
        });
    }
    let scale = span.max(step);
    let changes = values.windows(2).filter(|pair| pair[0] != pair[1]).count() as f64;
    if by_its_steps {
        let with = |hold_s: f64| {
            CROSSING_SIGMA
                .iter()
                .map(|sigma| {
                    let measurements = crossings(time_s, readings, &rows, step, sigma * step, hold_s);
                    let (process, cost) = process_noise(time_s, &measurements, scale);
                    (measurements, process, cost)
                })
                .min_by(|a, b| a.2.total_cmp(&b.2))
        };
        let (mut measurements, mut process, _) = with(HOLD_S)?;
        // The variance of a temperature whose rate is a random walk grows by process · t³/3.
        let off_step_s = (3.0 * step * step / process).cbrt();
        if off_step_s < HOLD_S {
            (measurements, process, _) = with(off_step_s)?;
        }
        return Some(smooth(time_s, &measurements, process, scale));
    }
    let rows =
        if step == 0.0 && changes < HELD * values.len() as f64 { fresh(readings, &rows) } else { rows };
    let (process, variance) = noise_of(time_s, readings, &rows, step, scale);
    let measurements: Vec<Measurement> =
        rows.iter().map(|&row| Measurement { row, before_s: 0.0, value: readings[row], variance }).collect();
    Some(smooth(time_s, &measurements, process, scale))
}

/// The rows in which a thermometer that is read less often than the rows has a new value.
fn fresh(readings: &[f64], rows: &[usize]) -> Vec<usize> {
    let changed = rows.windows(2).filter(|pair| readings[pair[0]] != readings[pair[1]]).map(|pair| pair[1]);
    rows.first().copied().into_iter().chain(changed).collect()
}

/// Thresholds crossed, and readings that stay for so long.
fn crossings(
    time_s: &[f64],
    readings: &[f64],
    rows: &[usize],
    step: f64,
    sigma: f64,
    hold_s: f64,
) -> Vec<Measurement> {
    let mut measurements = Vec::new();
    let held =
        |row: usize| Measurement { row, before_s: 0.0, value: readings[row], variance: step * step / 12.0 };
    let (Some(&first), Some(&last)) = (rows.first(), rows.last()) else { return measurements };
    measurements.push(held(first));
    let mut entered_s = time_s[first];
    let changes: Vec<(usize, usize)> = (rows.windows(2))
        .filter(|pair| readings[pair[0]] != readings[pair[1]])
        .map(|pair| (pair[0], pair[1]))
        .collect();
    let mut next = 0;
    while next < changes.len() {
        // The changes to and fro across one threshold.
        let (before, after) = changes[next];
        let (old, new) = (readings[before], readings[after]);
        let mut end = next + 1;
        while let Some(&(from, to)) = changes.get(end) {
            let same = readings[to] == old || readings[to] == new;
            let long = time_s[to] - time_s[before] > hold_s;
            if !same || long || time_s[to] - time_s[changes[end - 1].1] > CLUSTER_S {
                break;
            }
            end += 1;
            debug_assert!(from < to);
        }
        let cluster = &changes[next..end];
        let middle = |&(from, to): &(usize, usize)| 0.5 * (time_s[from] + time_s[to]);
        let (start_s, end_s) = (middle(&cluster[0]), middle(&cluster[cluster.len() - 1]));
        let crossed = cluster.len() % 2 == 1;
        let at_s = if crossed {
            // The time at which an unbroken crossing would have spent as long on the old side.
            let on_old: f64 =
                cluster.windows(2).skip(1).step_by(2).map(|pair| middle(&pair[1]) - middle(&pair[0])).sum();
            start_s + on_old
        } else {
            0.5 * (start_s + end_s)
        };
        hold(time_s, rows, [entered_s, start_s], hold_s, &held, &mut measurements);
        let jump = (new - old).abs();
        // A jump over several levels says only that the temperature was in the middle within the width of a step.
        let wide = if jump > 1.5 * step { step * step / 24.0 } else { 0.0 };
        // Time is known to a row; a hole between the two readings makes it worse.
        let blind_s = time_s[cluster[0].1] - time_s[cluster[0].0];
        let typical_s = (time_s[last] - time_s[first]) / (rows.len() - 1).max(1) as f64;
        let blind = if blind_s > 3.0 * typical_s { jump * jump / 12.0 } else { 0.0 };
        let turned = if crossed { 0.0 } else { (0.25 * step).powi(2) };
        let row = (time_s.partition_point(|&time| time < at_s)).min(time_s.len() - 1);
        measurements.push(Measurement {
            row,
            before_s: time_s[row] - at_s,
            value: 0.5 * (old + new),
            variance: sigma * sigma + wide + blind + turned,
        });
        entered_s = end_s;
        next = end;
    }
    hold(time_s, rows, [entered_s, time_s[last]], hold_s, &held, &mut measurements);
    measurements.push(held(last));
    measurements
}

/// Readings that stay from one time to another: one in the middle of every `hold_s`, if it stays as long.
fn hold(
    time_s: &[f64],
    rows: &[usize],
    [from_s, to_s]: [f64; 2],
    hold_s: f64,
    held: &impl Fn(usize) -> Measurement,
    measurements: &mut Vec<Measurement>,
) {
    let count = ((to_s - from_s) / hold_s).floor().min(rows.len() as f64);
    for k in 0..count as usize {
        let at_s = from_s + (to_s - from_s) * (k as f64 + 0.5) / count;
        let row = rows.get(rows.partition_point(|&row| time_s[row] < at_s));
        // Not the first reading after a gap over and over.
        let is_there = |row: &&usize| time_s[**row] < to_s && time_s[**row] - at_s < hold_s;
        measurements.extend(row.filter(is_there).map(|&row| held(row)));
    }
}

/// Process noise and variance of a reading for readings that all count.
fn noise_of(time_s: &[f64], readings: &[f64], rows: &[usize], step: f64, scale: f64) -> (f64, f64) {
    // Half the mean square of second differences over 3 is the variance of white noise on a smooth quantity.
    let second: Vec<f64> = rows
        .windows(3)
        .map(|three| readings[three[0]] - 2.0 * readings[three[1]] + readings[three[2]])
        .collect();
    let least = (step * step / 12.0).max(LEAST_VARIANCE * scale * scale);
    let start = (series::rms(&second).powi(2) / 6.0).max(least);
    let averaged: Vec<Measurement> = rows
        .chunks(rows.len().div_ceil(MOST_READINGS))
        .map(|chunk| {
            let mean = |of: &dyn Fn(usize) -> f64| {
                chunk.iter().map(|&row| of(row)).sum::<f64>() / chunk.len() as f64
            };
            let row = chunk[chunk.len() - 1];
            Measurement {
                row,
                before_s: time_s[row] - mean(&|row| time_s[row]),
                value: mean(&|row| readings[row]),
                variance: start / chunk.len() as f64,
            }
        })
        .collect();
    let (process, factor) = process_and_factor(time_s, &averaged, scale, least / start);
    (process, start * factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64Mcg;
    use std::f64::consts::TAU;

    /// A daily cycle with a warm-up: temperature and its rate.
    fn daily(time_s: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (day, tau) = (TAU / 86_400.0, 3000.0);
        let shape = |t: f64| {
            22.0 + 5.0 * (day * t).sin() + 0.8 * (3.3 * day * t).cos() + 6.0 * (1.0 - (-t / tau).exp())
        };
        let rate = |t: f64| {
            5.0 * day * (day * t).cos() - 0.8 * 3.3 * day * (3.3 * day * t).sin()
                + 6.0 / tau * (-t / tau).exp()
        };
        (series::map(time_s, shape), series::map(time_s, rate))
    }

    fn quantised(values: &[f64], step: f64, noise: f64, seed: u64) -> Vec<f64> {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        values
            .iter()
            .map(|value| {
                let error: f64 = noise * rng.sample::<f64, _>(StandardNormal);
                let read = value + error;
                if step > 0.0 { (read / step).round() * step } else { read }
            })
            .collect()
    }

    /// Coefficient of the true rate on an estimate of it: 1 where a coefficient found on the estimate is right.
    fn slope(truth: &[f64], estimate: &[f64]) -> f64 {
        let (a, b) = (series::mean(truth), series::mean(estimate));
        let product: f64 = truth.iter().zip(estimate).map(|(t, e)| (t - a) * (e - b)).sum();
        product / estimate.iter().map(|e| (e - b).powi(2)).sum::<f64>()
    }

    #[test]
    fn a_coefficient_on_the_rate_is_not_attenuated_and_one_on_the_raw_difference_is() {
        let time_s: Vec<f64> = (0..86_400).map(f64::from).collect();
        let (temperature, rate) = daily(&time_s);
        for (step, noise, step_s) in [
            (0.0625, 0.0, 1),
            (0.0625, 0.006, 1),
            (0.0625, 0.01, 1),
            (0.0625, 0.014, 1),
            (0.0625, 0.017, 1),
            (0.0625, 0.02, 1),
            (0.0625, 0.03, 1),
            (0.25, 0.0, 1),
            (0.0, 0.02, 1),
            (0.0625, 0.0, 10),
        ] {
            let keep = |values: &[f64]| -> Vec<f64> { values.iter().copied().step_by(step_s).collect() };
            let (time_s, temperature, rate) = (keep(&time_s), keep(&temperature), keep(&rate));
            let readings = quantised(&temperature, step, noise, 7);
            let thermometer = Thermometer::new("t", None, None, &time_s, &readings).unwrap();
            assert!((thermometer.quantisation - step).abs() <= 1e-9 * step, "{}", thermometer.quantisation);
            let smoothed = slope(&rate, &thermometer.rate);
            let raw = slope(&rate, &series::derivative(&time_s, &readings));
            let error: Vec<f64> = rate.iter().zip(&*thermometer.rate).map(|(t, e)| t - e).collect();
            println!(
                "step {step} K, noise {noise} K, every {step_s} s: slope {smoothed:.4}, raw {raw:.4}, error {:.3} of {:.3} K/h, said {:.3}",
                3600.0 * series::rms(&error),
                3600.0 * series::deviation(&rate),
                3600.0 * series::mean(&thermometer.rate_variance).sqrt(),
            );
            assert!((smoothed - 1.0).abs() < 0.05, "step {step}, noise {noise}: {smoothed}");
            assert!(thermometer.rate_varies() && thermometer.reliability_of_rate() > 0.8);
            if step_s == 1 {
                assert!(raw < 0.2, "the raw difference should be useless: {raw}");
            }
        }
    }

    /// A chamber that is switched between ramps and soaks, felt through a wall of 600 s.
    fn chamber(time_s: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let knots =
            [(0.0, 20.0), (5400.0, 20.0), (10_800.0, 50.0), (14_400.0, 50.0), (21_600.0, 10.0), (1e9, 10.0)];
        through_wall(time_s, &knots)
    }

    /// Temperature and rate behind a wall of 600 s, outside of which straight lines join the knots.
    fn through_wall(time_s: &[f64], knots: &[(f64, f64)]) -> (Vec<f64>, Vec<f64>) {
        let outside = series::map(time_s, |t| {
            let next = knots.iter().position(|&(at, _)| at > t).unwrap();
            let ((t0, a), (t1, b)) = (knots[next - 1], knots[next]);
            a + (b - a) * (t - t0) / (t1 - t0)
        });
        let inside = series::lagged(time_s, &outside, 600.0);
        let rate = outside.iter().zip(&inside).map(|(outside, inside)| (outside - inside) / 600.0).collect();
        (inside, rate)
    }

    #[test]
    fn a_coefficient_on_the_rate_is_right_where_heating_is_switched() {
        let time_s: Vec<f64> = (0..28_800).map(f64::from).collect();
        let (temperature, rate) = chamber(&time_s);
        for (step, noise) in [
            (0.0625, 0.0),
            (0.0625, 0.006),
            (0.0625, 0.03),
            (0.25, 0.0),
            (0.25, 0.05),
            (1.0, 0.0),
            (0.0, 0.05),
        ] {
            let readings = quantised(&temperature, step, noise, 11);
            let thermometer = Thermometer::new("t", None, None, &time_s, &readings).unwrap();
            let error: Vec<f64> = rate.iter().zip(&*thermometer.rate).map(|(t, e)| t - e).collect();
            let found = slope(&rate, &thermometer.rate);
            println!(
                "chamber: step {step} K, noise {noise} K: slope {found:.4}, error {:.3} of {:.3} K/h, said {:.3}",
                3600.0 * series::rms(&error),
                3600.0 * series::deviation(&rate),
                3600.0 * series::mean(&thermometer.rate_variance).sqrt()
            );
            assert!((found - 1.0).abs() < 0.05, "step {step}, noise {noise}: {found}");
        }
    }

    /// Slow ramps and dwells over days, seen in small steps that noise makes flicker.
    #[test]
    fn a_coefficient_on_the_rate_is_right_where_small_steps_flicker() {
        let time_s: Vec<f64> = (0..50_000).map(|k| 5.0 * f64::from(k)).collect();
        let knots =
            [(0.0, 41.0), (2e4, 41.0), (7e4, 60.0), (1e5, 60.0), (1.4e5, 45.0), (2e5, 62.0), (1e9, 62.0)];
        let (temperature, rate) = through_wall(&time_s, &knots);
        for noise in [0.0, 0.002, 0.004, 0.005, 0.0055, 0.006, 0.008] {
            let readings = quantised(&temperature, 0.02, noise, 3);
            let thermometer = Thermometer::new("t", None, None, &time_s, &readings).unwrap();
            let error: Vec<f64> = rate.iter().zip(&*thermometer.rate).map(|(t, e)| t - e).collect();
            let found = slope(&rate, &thermometer.rate);
            let changes = readings.windows(2).filter(|pair| pair[0] != pair[1]).count() as f64 / 5e4;
            println!(
                "flicker: noise {noise} K, {changes:.3} changes a row: slope {found:.4}, error {:.3} of {:.3} K/h, said {:.3}",
                3600.0 * series::rms(&error),
                3600.0 * series::deviation(&rate),
                3600.0 * series::mean(&thermometer.rate_variance).sqrt()
            );
            assert!((found - 1.0).abs() < 0.05 && thermometer.rate_shows(), "noise {noise}: {found}");
        }
    }

    #[test]
    fn a_thermometer_read_less_often_than_the_rows_is_not_a_staircase() {
        let time_s: Vec<f64> = (0..86_400).map(f64::from).collect();
        let (temperature, rate) = daily(&time_s);
        let mut readings = quantised(&temperature, 0.0, 0.005, 5);
        for row in 0..readings.len() {
            readings[row] = readings[row - row % 60];
        }
        let thermometer = Thermometer::new("t", None, None, &time_s, &readings).unwrap();
        let error: Vec<f64> = rate.iter().zip(&*thermometer.rate).map(|(t, e)| t - e).collect();
        assert!((slope(&rate, &thermometer.rate) - 1.0).abs() < 0.01);
        assert!(series::rms(&error) < 0.05 * series::deviation(&rate));
    }

    #[test]
    fn a_constant_or_absent_temperature_is_no_cause() {
        let time_s: Vec<f64> = (0..5000).map(f64::from).collect();
        let readings = quantised(&vec![25.02; 5000], 0.0625, 0.02, 3);
        let constant = Thermometer::new("t", None, None, &time_s, &readings).unwrap();
        assert!(!constant.varies() && !constant.rate_varies());
        let still = Thermometer::new("t", None, None, &time_s, &vec![25.0; 5000]).unwrap();
        assert!(!still.varies());
        assert!(Thermometer::new("t", None, None, &time_s, &vec![f64::NAN; 5000]).is_none());
    }

    /// A unit that is warm after some minutes and stays so: its reading stays as well, and says where it is.
    #[test]
    fn a_temperature_that_stays_after_one_that_was_fast_is_known() {
        let time_s: Vec<f64> = (0..6000).map(f64::from).collect();
        let temperature = series::map(&time_s, |t| 32.0 - 7.5 * (-t / 120.0).exp());
        for (noise, end) in [(0.0, 32.0), (0.01, 32.0), (0.01, 31.97)] {
            let readings = quantised(&series::map(&temperature, |t| t - 32.0 + end), 0.0625, noise, 4);
            let thermometer = Thermometer::new("t", None, None, &time_s, &readings).unwrap();
            let pairs = temperature.iter().zip(&*thermometer.temperature);
            let error = pairs.map(|(t, e)| (t - 32.0 + end - e).abs());
            assert!(thermometer.varies() && error.fold(0.0, f64::max) < 0.1, "noise {noise}");
            let largest = thermometer.temperature_variance.iter().copied().fold(0.0, f64::max).sqrt();
            assert!(largest < 0.0625, "noise {noise}: {largest} K");
        }
    }

    #[test]
    fn a_gap_is_bridged_with_a_rate_that_says_how_uncertain_it_is() {
        let time_s: Vec<f64> = (0..86_400).step_by(10).map(f64::from).collect();
        let (temperature, _) = daily(&time_s);
        let mut readings = quantised(&temperature, 0.0625, 0.0, 1);
        readings[4000..4400].fill(f64::NAN);
        let thermometer = Thermometer::new("t", None, None, &time_s, &readings).unwrap();
        assert!((thermometer.temperature[4200] - temperature[4200]).abs() < 0.2);
        assert!(thermometer.rate_variance[4200] > 2.0 * thermometer.rate_variance[3000]);
    }

    #[test]
    fn the_step_of_readings_is_found() {
        assert!(
            (step_of(&[20.0, 20.25, 20.25, 20.75, 20.0, 20.0, 20.0, 20.0, 20.25, 20.75, 20.75, 20.75])
                - 0.25)
                .abs()
                < 1e-12
        );
        let smooth: Vec<f64> = (0..100).map(|k| (f64::from(k) * 0.1).sin()).collect();
        assert_eq!(step_of(&smooth), 0.0);
        assert_eq!(step_of(&[1.0; 5]), 0.0);
    }
}
