//! When the rows of a recording were taken, as far as their time stamps say.
//!
//! A clock's stamps are rounded: to 2.4 · 10⁻⁷ s where seconds since 1970 stand in 64 bits, to a millisecond in many logs. A
//! recording at 50 Hz with such seconds of 1970 has steps that are wrong by 6 parts in a million, and in a pattern that repeats: a rate
//! of 1 rad/s that is derived from angles over these steps has lines of 10⁻⁶ rad/s, a hundred times the noise of a good gyro's hour.
use std::borrow::Cow;

/// Finest decimal place of seconds that is looked for.
const FINEST_PLACE: i32 = 9;
/// Rounding of a stamp in units of its last bit: of the number itself, and of what it was converted from.
const LAST_BITS: f64 = 4.0;
/// How much more than a unit of the last place rounded stamps may scatter about an even grid, whose step is estimated from them.
const SLACK: f64 = 1.01;

/// Times of the rows, s: those of an even grid where the stamps do not differ from it by more than they are rounded, and the stamps
/// themselves otherwise.
pub(super) fn sampling_times(time_s: &[f64]) -> Cow<'_, [f64]> {
    let (Some(&first), Some(&last)) = (time_s.first(), time_s.last()) else { return Cow::Borrowed(time_s) };
    let steps = (time_s.len() - 1) as f64;
    if last <= first || time_s.iter().any(|time| !time.is_finite()) {
        return Cow::Borrowed(time_s);
    }
    let bit_s = LAST_BITS * f64::EPSILON * first.abs().max(last.abs());
    let unit_s = last_place(time_s, bit_s).max(bit_s);
    // Least squares of the deviations from the line between the ends, over a place that is counted from the middle.
    let (middle, mean_step_s) = (0.5 * steps, (last - first) / steps);
    let deviation = |row: usize| time_s[row] - first - row as f64 * mean_step_s;
    let (mut sum, mut moment, mut square) = (0.0, 0.0, 0.0);
    for row in 0..time_s.len() {
        let place = row as f64 - middle;
        sum += deviation(row);
        moment += place * deviation(row);
        square += place * place;
    }
    let (offset_s, tilt_s) = (sum / time_s.len() as f64, moment / square);
    let off = |row: usize| deviation(row) - offset_s - tilt_s * (row as f64 - middle);
    let (least, most) = (0..time_s.len())
        .map(off)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), off| (least.min(off), most.max(off)));
    if most - least > SLACK * unit_s + bit_s {
        return Cow::Borrowed(time_s);
    }
    Cow::Owned((0..time_s.len()).map(|row| row as f64 * (mean_step_s + tilt_s)).collect())
}

/// The largest decimal place of seconds of which all stamps are multiples to within `bit_s`; 0 without one.
pub(crate) fn last_place(time_s: &[f64], bit_s: f64) -> f64 {
    (0..=FINEST_PLACE)
        .map(|place| 10.0_f64.powi(place))
        .find(|per_s| {
            let whole = |time: &f64| ((time * per_s).round() / per_s - time).abs() <= bit_s;
            time_s.iter().all(whole)
        })
        .map_or(0.0, f64::recip)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(step_s: f64) -> impl Fn(usize) -> f64 {
        move |row| row as f64 * step_s
    }

    fn differs(times: &[f64], truth: impl Fn(usize) -> f64) -> f64 {
        let offset = times[0];
        times.iter().enumerate().map(|(row, time)| (time - offset - truth(row)).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn seconds_since_1970_lose_the_rounding_of_their_last_bits() {
        let stamps: Vec<f64> = (0..5000).map(|row| 1.7e9 + f64::from(row) * 0.02).collect();
        assert!(differs(&stamps, even(0.02)) > 5e-8);
        assert!(differs(&sampling_times(&stamps), even(0.02)) < 5e-10);
    }

    #[test]
    fn milliseconds_of_a_step_that_is_none_lose_their_rounding() {
        let step_s = 1.0 / 286.0;
        let stamps: Vec<f64> = (0..20_000).map(|row| (f64::from(row) * step_s * 1e3).floor() / 1e3).collect();
        assert!(differs(&sampling_times(&stamps), even(step_s)) < 5e-6);
    }

    #[test]
    fn jitter_and_lost_clocks_stay() {
        let jitter = |row: i32| 2e-3 * (f64::from(row) * 12.989_8).sin();
        let stamps: Vec<f64> = (0..1000).map(|row| f64::from(row) * 0.1 + jitter(row)).collect();
        assert_eq!(*sampling_times(&stamps), *stamps);
        let mut jumps: Vec<f64> = (0..1000).map(|row| f64::from(row) * 0.1).collect();
        jumps.iter_mut().skip(500).for_each(|time| *time += 0.31);
        assert_eq!(*sampling_times(&jumps), *jumps);
        assert!(sampling_times(&[]).is_empty());
        assert_eq!(*sampling_times(&[5.0]), [5.0]);
        assert!(sampling_times(&[0.0, f64::NAN, 2.0])[1].is_nan());
    }
}
