//! Values of a table between its rows.
use std::ops::Range;

/// A difference of two rows is a step if its slope is more than this many times that of every difference near it …
const STEEPER: f64 = 10.0;
/// … and if it is more than this part of all that the values range over: the last digit of a printed value is none.
const PART_OF_RANGE: f64 = 0.02;
/// How near a time has to be to that of a row, as a part of the distance of rows, to be that row.
const SAME: f64 = 1e-6;

/// `values`, which are in rows at increasing times `time_s`, at the increasing times `at_s`.
///
/// Cubic through the four nearest rows (Lagrange), through fewer where there are no four. Nothing goes over a step: neither between two rows
/// of one time, nor where values jump, nor where one is missing (NaN). Between the two rows of a jump, and beyond the first and the last row,
/// the result is NaN.
pub(super) fn interpolated(time_s: &[f64], values: &[f64], at_s: &[f64]) -> Vec<f64> {
    let least = PART_OF_RANGE * range(values);
    let mut row = 0;
    let mut smooth = smooth_from(time_s, values, 0, least);
    let at = |&at_s: &f64| {
        // The last row that is not after the time: of two rows of one time that after the step.
        while time_s.get(row + 1).is_some_and(|&next_s| next_s <= at_s) {
            row += 1;
        }
        if row >= smooth.end {
            smooth = smooth_from(time_s, values, row, least);
        }
        let (Some(&before_s), Some(&before)) = (time_s.get(row), values.get(row)) else { return f64::NAN };
        let (Some(&after_s), Some(&after)) = (time_s.get(row + 1), values.get(row + 1)) else {
            let same_s = SAME * (before_s - time_s[row.saturating_sub(1)]).abs();
            return if (at_s - before_s).abs() <= same_s { before } else { f64::NAN };
        };
        let same_s = SAME * (after_s - before_s);
        if (at_s - before_s).abs() <= same_s {
            return before;
        }
        if after_s - at_s <= same_s {
            return after;
        }
        if at_s < before_s || row + 1 >= smooth.end {
            return f64::NAN;
        }
        let first = row.saturating_sub(1).min(smooth.end.saturating_sub(4)).max(smooth.start);
        let four = first..(first + 4).min(smooth.end);
        polynomial(&time_s[four.clone()], &values[four], at_s)
    };
    at_s.iter().map(at).collect()
}

/// The rows from `first` on up to the next step.
fn smooth_from(time_s: &[f64], values: &[f64], first: usize, least: f64) -> Range<usize> {
    let mut last = first;
    while last + 1 < values.len() && !is_step(time_s, values, last, least) {
        last += 1;
    }
    first..last + 1
}

/// Whether there is a step between a row and the next.
fn is_step(time_s: &[f64], values: &[f64], row: usize, least: f64) -> bool {
    let slope = |row: usize| -> Option<f64> {
        let slope = (values.get(row + 1)? - values.get(row)?) / (time_s.get(row + 1)? - time_s.get(row)?);
        Some(slope.abs())
    };
    let Some(own) = slope(row).filter(|slope| slope.is_finite()) else { return true };
    let change = (values[row + 1] - values[row]).abs();
    let beside = [row.checked_sub(2), row.checked_sub(1), row.checked_add(1), row.checked_add(2)];
    let near = beside.into_iter().flatten().filter_map(slope).filter(|slope| slope.is_finite());
    let mut steepest = None::<f64>;
    near.for_each(|slope| steepest = Some(steepest.map_or(slope, |most| most.max(slope))));
    change > least && steepest.is_some_and(|steepest| own > STEEPER * steepest)
}

/// The polynomial through all points, at a time.
fn polynomial(time_s: &[f64], values: &[f64], at_s: f64) -> f64 {
    let weight = |own: usize| -> f64 {
        let others = time_s.iter().enumerate().filter(|&(other, _)| other != own);
        others.map(|(_, other_s)| (at_s - other_s) / (time_s[own] - other_s)).product()
    };
    values.iter().enumerate().map(|(own, value)| weight(own) * value).sum()
}

fn range(values: &[f64]) -> f64 {
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    if high > low { high - low } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_met_between_uneven_rows() {
        let cubic = |t: f64| 0.3 * t.powi(3) - 2.0 * t * t + t - 4.0;
        let time_s = [0.0, 0.4, 1.0, 1.1, 1.9, 2.5, 3.0];
        let values = time_s.map(cubic);
        let at_s: Vec<f64> = (0..=30).map(|k| 0.1 * f64::from(k)).collect();
        for (at, value) in at_s.iter().zip(interpolated(&time_s, &values, &at_s)) {
            assert!((value - cubic(*at)).abs() < 1e-12, "{at}: {value}");
        }
        let beyond = interpolated(&time_s, &values, &[-0.1, 3.1]);
        assert!(beyond.iter().all(|value| value.is_nan()));
    }

    #[test]
    fn a_step_is_not_bridged() {
        // A sine that jumps by 5 between the rows at 2.0 and 2.1 s, and again between two rows of one time.
        let mut time_s: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k)).collect();
        time_s.insert(41, time_s[40]);
        let level = |row: usize| {
            if row > 40 {
                -3.0
            } else if row > 20 {
                5.0
            } else {
                0.0
            }
        };
        let values: Vec<f64> = time_s.iter().enumerate().map(|(row, t)| t.sin() + level(row)).collect();
        let at_s: Vec<f64> = (0..590).map(|k| 0.01 * f64::from(k)).collect();
        for (&at, value) in at_s.iter().zip(interpolated(&time_s, &values, &at_s)) {
            let level = if at >= 4.0 - 1e-9 {
                -3.0
            } else if at > 2.05 {
                5.0
            } else {
                0.0
            };
            if at > 2.0 + 1e-6 && at < 2.1 - 1e-6 {
                assert!(value.is_nan(), "{at}: {value}");
            } else {
                assert!((value - at.sin() - level).abs() < 2e-5, "{at}: {value}");
            }
        }
    }

    #[test]
    fn rounded_values_are_no_steps_and_missing_ones_are_not_filled() {
        let time_s: Vec<f64> = (0..400).map(f64::from).collect();
        // Printed to three decimals, of which one lasts for several rows.
        let mut values: Vec<f64> = time_s.iter().map(|t| (1e3 * (t / 150.0).sin()).round() / 1e3).collect();
        values[100] = f64::NAN;
        let at_s: Vec<f64> = (0..399).map(|k| f64::from(k) + 0.5).collect();
        let missing: Vec<usize> = (interpolated(&time_s, &values, &at_s).iter().enumerate())
            .filter(|(_, value)| value.is_nan())
            .map(|(row, _)| row)
            .collect();
        assert_eq!(missing, [99, 100]);
    }
}
