//! Readings on a lattice of levels, as a coarse output leaves them.
use super::Fault;
use crate::catalogue::ReadingFault;

/// A lattice matters if its step is at least this part of the white noise,
pub const LEAST_STEP: f64 = 1.0;
/// or if the noise of rounding, which is step²/12, is worth so many nats in a record of that length.
const LEAST_OF_ROUNDING: f64 = 10.0;
/// A lattice is coarser than nominal by at least this factor.
const COARSER: f64 = 1.5;
/// Fewest different readings that show a lattice: two lie on one anyhow, and show it if they come again so often.
const FEWEST_OF_LATTICE: usize = 3;
const FEWEST_CROSSINGS: usize = 20;
/// Most levels from the least to the largest reading: with more, the digits of a table are a lattice, unless readings come to a level so
/// often.
const MOST_LEVELS: f64 = 1e5;
const VISITS: usize = 4;
/// Largest number of steps between readings off a lattice, as a part of the step.
pub const OFF_LATTICE: f64 = 1e-3;
/// Rounding of a reading on its way into a table and out of it, as a part of the reading.
const ROUNDING: f64 = 1e-9;

/// Whether the lattice on which all readings lie is coarser than nominal and matters beside the noise.
pub(super) fn coarse(
    sensor: usize,
    values: &[f64],
    lattice: Lattice,
    nominal: f64,
    white: f64,
) -> Option<Fault> {
    let Lattice { step, levels } = lattice;
    let finite: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let crossings = finite.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let is_lattice = levels >= FEWEST_OF_LATTICE || crossings >= FEWEST_CROSSINGS;
    // N readings whose variance is 1 + x of what it is held for: ½N (x − ln(1 + x)) nats.
    let rounding = (step.powi(2) - nominal.powi(2)) / (12.0 * white.powi(2) + nominal.powi(2));
    let worth = 0.5 * finite.len() as f64 * (rounding - rounding.ln_1p());
    let matters = step >= LEAST_STEP * white || worth >= LEAST_OF_ROUNDING;
    (is_lattice && step > COARSER * nominal && matters).then(|| Fault {
        sensor,
        fault: ReadingFault::Quantised,
        // Each reading has fallen into the tolerance about the lattice.
        evidence: finite.len() as f64,
        rows: (0, values.len()),
        parameters: vec![("step", step, true)],
    })
}

/// Levels at equal distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Distance of neighbouring levels.
    pub step: f64,
    /// Number of different readings.
    pub levels: usize,
}

/// The lattice on which all readings lie, if there is one; of readings that take two values only, those two.
pub fn lattice(values: &[f64]) -> Option<Lattice> {
    let mut levels: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let readings = levels.len();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let (first, last) = (*levels.first()?, *levels.last()?);
    let span = last - first;
    // Of neighbouring levels and of how they are rounded, which goes with them: a single reading that is a thousand million times as large
    // as the others must not make these one level.
    let differences = || {
        let of = |pair: &[f64]| (pair[1] - pair[0], ROUNDING * pair[0].abs().max(pair[1].abs()));
        levels.windows(2).map(of).filter(|(difference, rounding)| difference > rounding)
    };
    let step = differences().map(|(difference, _)| difference).fold(f64::INFINITY, f64::min);
    let is_off = |(difference, rounding): (f64, f64)| {
        let steps = difference / step;
        (steps - steps.round()).abs() > 10.0 * (OFF_LATTICE + rounding / step)
    };
    let found = step.is_finite()
        && (span / step <= MOST_LEVELS || readings >= VISITS * levels.len())
        && !differences().any(is_off);
    found.then_some(Lattice { step, levels: levels.len() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gyro that is coarse at rest is so though it was turned fast for a few readings; the digits of a table are no lattice.
    #[test]
    fn a_coarse_output_may_have_been_far_away() {
        let step = 3.87e-6;
        let coarse = |k: usize| {
            let far = if k % 500 == 7 { 500_000.0 + k as f64 } else { 0.0 };
            step * (far + (k * 37 % 5) as f64)
        };
        let found = lattice(&(0..4000).map(coarse).collect::<Vec<f64>>()).unwrap();
        assert!((found.step / step - 1.0).abs() < 1e-6 && found.levels == 13, "{found:?}");
        let digits = |k: usize| 1e-6 * ((k as f64 * 0.618_034).fract() * 1e6).round();
        assert!(lattice(&(0..4000).map(digits).collect::<Vec<f64>>()).is_none());
    }

    /// A value like the largest of 32 bits among readings of another size makes no two levels of them, nor does it hide a coarse output.
    #[test]
    fn a_huge_reading_makes_no_lattice_and_hides_none() {
        for huge in [1e3, 2_147_483_647.0, -1e30] {
            let with_huge = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
                (0..3000).map(|k| if k == 1700 { huge } else { value(k) }).collect()
            };
            let smooth = with_huge(&|k| 8.0 + (k as f64 * 0.618_034).fract());
            assert_eq!(lattice(&smooth), None, "{huge}");
            let coarse = with_huge(&|k| 0.25 * (k * 37 % 5) as f64);
            assert_eq!(lattice(&coarse).map(|it| it.step), Some(0.25), "{huge}");
        }
    }

    /// Two levels lie on a lattice anyhow: what comes again and again is one, a step or a few glitches are none.
    #[test]
    fn two_levels_that_come_again_are_a_lattice() {
        let jitter = |k: usize| (43_758.545_3 * (12.989_8 * k as f64).sin()).rem_euclid(1.0);
        let found = |is_up: &dyn Fn(usize) -> bool| {
            let values: Vec<f64> = (0..2000).map(|k| if is_up(k) { 3.0 } else { 0.0 }).collect();
            coarse(0, &values, lattice(&values).unwrap(), 0.0, 1.0).map(|fault| fault.parameters[0].1)
        };
        assert_eq!(found(&|k| jitter(k) > 0.97), Some(3.0));
        assert_eq!(found(&|k| k > 700), None);
        assert_eq!(found(&|k| k % 300 == 7), None);
    }

    /// Rounding to less than the noise matters where there are so many readings that its variance is seen.
    #[test]
    fn a_step_below_the_noise_matters_in_a_long_record() {
        let found = |rows: usize| {
            let values: Vec<f64> = (0..rows).map(|k| 0.8 * (k % 9) as f64).collect();
            coarse(0, &values, lattice(&values).unwrap(), 0.0, 1.0).is_some()
        };
        // 0.8²/12 of the variance: half of 0.053² a reading, halved again, is 10 nats from 14 600 readings on.
        assert!(!found(14_000));
        assert!(found(16_000));
    }
}
