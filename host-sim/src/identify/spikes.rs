//! Spikes: single readings far from those around them, which no noise model has and which would hide all others.
//!
//! A reading is compared with the median of the eleven around it, and the differences with their own spread, which spikes do not
//! widen (Hampel's identifier). A value like the largest integer is set aside whatever its size; a jump, a ramp, a vibration that
//! lasts is not.

/// Readings on each side that a reading is compared with.
const NEIGHBOURS: usize = 5;
/// Distance from the median of the neighbours, in robust standard deviations. Of 10⁶ normal readings none is as far.
const FAR: f64 = 10.0;
/// Of so many readings around a spike, on each side, no more than so many are spikes, too.
const AROUND: usize = 20;
const MOST_AROUND: usize = 4;
/// Robust standard deviation: of the median of the sizes, and of their 95th percentile.
const OF_MEDIAN: f64 = 1.4826;
const OF_95: f64 = 0.510_2;

/// Makes spikes NaN; returns how many there were.
pub fn set_spikes_aside(values: &mut [f64]) -> usize {
    let present: Vec<usize> = (0..values.len()).filter(|&row| values[row].is_finite()).collect();
    let sizes: Vec<f64> = (0..present.len()).map(|at| distance(values, &present, at)).collect();
    let mut sorted = sizes.clone();
    sorted.sort_by(f64::total_cmp);
    let quantile = |part: f64| sorted.get((part * sorted.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    // Where most readings are equal, their smallest difference is the step of the output.
    let step = sorted.iter().copied().find(|size| *size > 0.0).unwrap_or(f64::NAN);
    let spread = (OF_MEDIAN * quantile(0.5)).max(OF_95 * quantile(0.95)).max(step);
    // A constant but for one reading has no other difference.
    let lone = sorted.iter().filter(|size| **size > 0.0).count() <= 1;
    let least = if lone { 0.0 } else { FAR * spread };
    let far: Vec<bool> = sizes.iter().map(|size| *size > least).collect();
    let mut set_aside = 0;
    for (at, &row) in present.iter().enumerate() {
        let around = far.iter().take(at + AROUND + 1).skip(at.saturating_sub(AROUND));
        if far[at] && around.filter(|far| **far).count() <= MOST_AROUND {
            values[row] = f64::NAN;
            set_aside += 1;
        }
    }
    set_aside
}

/// How far a reading is from the median of those around it.
fn distance(values: &[f64], present: &[usize], at: usize) -> f64 {
    let first = at.saturating_sub(NEIGHBOURS);
    let around = present.iter().take(at + NEIGHBOURS + 1).skip(first);
    let mut around: Vec<f64> = around.map(|&row| values[row]).collect();
    let middle = around.len() / 2;
    let (_, median, _) = around.select_nth_unstable_by(middle, f64::total_cmp);
    (values[present[at]] - *median).abs()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    fn noise(count: usize) -> Vec<f64> {
        StandardNormal.sample_iter(Pcg64::seed_from_u64(11)).take(count).collect()
    }

    #[test]
    fn a_spike_of_any_size_is_set_aside_and_nothing_else() {
        let normal = noise(20_000);
        for size in [20.0, 3e7, 2_147_483_647.0, 1e300, -1e300] {
            let mut values = normal.clone();
            values[1000] = size;
            values[1001] = f64::NAN;
            values[9000] = -size;
            assert_eq!(set_spikes_aside(&mut values), 2, "{size}");
            assert!(values[1000].is_nan() && values[9000].is_nan());
        }
    }

    #[test]
    fn jumps_coarse_readings_and_vibration_stay() {
        let mut jump = noise(5000);
        jump.iter_mut().skip(2500).for_each(|value| *value += 1e3);
        let coarse: Vec<f64> = (0..5000).map(|row| f64::from(u8::from(row % 97 == 0))).collect();
        let mut shaken = noise(5000);
        for (row, value) in shaken.iter_mut().enumerate().skip(2000).take(200) {
            *value += 50.0 * (row as f64 * 2.2).sin();
        }
        for mut values in
            [jump, coarse, shaken, vec![1.0; 100], vec![f64::NAN; 10], Vec::new(), noise(100_000)]
        {
            let before = values.clone();
            assert_eq!(set_spikes_aside(&mut values), 0);
            assert!(values.iter().zip(before).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
        let mut constant = vec![1.0; 100];
        constant[50] = 2_147_483_647.0;
        assert_eq!(set_spikes_aside(&mut constant), 1);
    }
}
