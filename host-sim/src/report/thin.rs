//! Long series with the same outline and few points: of each bucket of rows the smallest and the largest value, in the
//! order in which they come.
//!
//! All series of a plot share their places to the right, so a bucket has two: both are there for every series.

/// Buckets; a plot is some 1000 pixels wide, and the rest is for looking closer.
const BUCKETS: usize = 2000;
/// Points of a cloud.
const CLOUD: usize = 1500;

/// The rows at which a thinned plot has its points, and what each series is there.
pub(super) fn thin(x: &[f64], series: &[&[f64]]) -> (Vec<f64>, Vec<Vec<f64>>) {
    if x.len() <= 2 * BUCKETS {
        return (x.to_vec(), series.iter().map(|y| padded(y, x.len())).collect());
    }
    let edges: Vec<usize> = (0..=BUCKETS).map(|bucket| bucket * x.len() / BUCKETS).collect();
    let buckets: Vec<(usize, usize)> = edges.windows(2).map(|edge| (edge[0], edge[1])).collect();
    let places = buckets.iter().flat_map(|&(from, to)| {
        let middle = from + (to - from) / 2;
        [x.get(from).copied().unwrap_or(f64::NAN), x.get(middle).copied().unwrap_or(f64::NAN)]
    });
    let outline = |y: &[f64]| {
        let both =
            buckets.iter().flat_map(|&(from, to)| extremes(y.get(from..to.min(y.len())).unwrap_or(&[])));
        both.collect()
    };
    (places.collect(), series.iter().map(|y| outline(y)).collect())
}

/// The smallest and the largest value in the order in which they come; NaN where nothing is there.
fn extremes(values: &[f64]) -> [f64; 2] {
    let present = || values.iter().enumerate().filter(|(_, value)| value.is_finite());
    let smallest = present().min_by(|a, b| a.1.total_cmp(b.1));
    let largest = present().max_by(|a, b| a.1.total_cmp(b.1));
    match (smallest, largest) {
        (Some((early, low)), Some((late, high))) if early <= late => [*low, *high],
        (Some((_, low)), Some((_, high))) => [*high, *low],
        _ => [f64::NAN; 2],
    }
}

/// Rows of a cloud of points, evenly chosen from those for which `there` holds.
pub(super) fn cloud(rows: usize, there: impl Fn(usize) -> bool) -> Vec<usize> {
    let all: Vec<usize> = (0..rows).filter(|row| there(*row)).collect();
    if all.len() <= CLOUD {
        return all;
    }
    (0..CLOUD).filter_map(|k| all.get(k * all.len() / CLOUD).copied()).collect()
}

fn padded(values: &[f64], length: usize) -> Vec<f64> {
    let mut values = values.to_vec();
    values.resize(length, f64::NAN);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_spike_is_kept_and_gaps_stay_gaps() {
        let x: Vec<f64> = (0..86_400).map(f64::from).collect();
        let mut y: Vec<f64> = x.iter().map(|t| (t / 500.0).sin()).collect();
        y[12_345] = 40.0;
        y[54_321] = -40.0;
        y[60_000..61_000].fill(f64::NAN);
        let (places, series) = thin(&x, &[&y, &y[..100]]);
        assert_eq!((places.len(), series[0].len()), (2 * BUCKETS, 2 * BUCKETS));
        assert!(places.windows(2).all(|w| w[0] < w[1]));
        let at = |value: f64| places[series[0].iter().position(|y| *y == value).unwrap()];
        assert!((at(40.0) - 12_345.0).abs() < 44.0 && (at(-40.0) - 54_321.0).abs() < 44.0);
        let holes = places.iter().zip(&series[0]).filter(|(_, y)| y.is_nan()).map(|(x, _)| *x);
        assert!(holes.clone().count() > 30 && holes.clone().all(|x| (59_900.0..61_000.0).contains(&x)));
        assert!(series[1][10..].iter().all(|y| y.is_nan()));
    }

    #[test]
    fn short_series_stay_as_they_are() {
        let x = [0.0, 1.0, 2.0];
        assert_eq!(thin(&x, &[&[5.0, 6.0, 7.0]]), (x.to_vec(), vec![vec![5.0, 6.0, 7.0]]));
        assert_eq!(cloud(5, |row| row != 2), [0, 1, 3, 4]);
        assert_eq!(cloud(100_000, |_| true).len(), CLOUD);
    }
}
