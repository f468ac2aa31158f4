//! An effect against its cause: what the residual is without the other effects, where the cause is small and where it
//! is large.
//!
//! Means over bins of equally many values of the cause. Their uncertainty allows for the correlation of the remainder:
//! n correlated values are worth n/(1 + 2 Σ r_j), the sum to the first negative autocorrelation (Geyer 1992).
use schuler_recording::unit::Unit;

use super::autocorrelation::autocorrelation;
use super::{Part, mean, present};
use crate::catalogue::Amplitude;

/// Bins.
const BINS: usize = 30;
/// Fewer values than this in a bin say little.
const LEAST_IN_BIN: usize = 10;
/// The correlation of the remainder is followed over this part of the recording.
const LONGEST_PART: usize = 5;

/// What an effect depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// In words or letters, e.g. `Ṫ`.
    pub name: String,
    /// Unit of the values.
    pub unit: String,
    /// One for each row; NaN = missing.
    pub values: Vec<f64>,
}

/// A finding against its cause.
#[derive(Clone, Debug)]
pub struct Dependence {
    /// Its place among the findings of the explanation.
    pub finding: usize,
    /// What it depends on.
    pub cause: Cause,
    /// The residual without the other findings, in the SI unit of the sensor.
    pub residual: Vec<f64>,
    /// What the finding says.
    pub explained: Vec<f64>,
    /// Means over bins of the cause, in its order.
    pub bins: Vec<Bin>,
}

/// The mean over neighbouring values of the cause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Mean cause.
    pub cause: f64,
    /// Mean residual without the other findings.
    pub residual: f64,
    /// Standard deviation of that mean.
    pub sigma: f64,
    /// What the finding says.
    pub explained: f64,
}

impl Cause {
    /// The cause of an effect that is linear in its one amplitude: its signature, in the unit in which the amplitude of
    /// the answer times the cause gives `unit` of the sensor. `formula` is that of the catalogue, `k·cause`.
    pub fn of_signature(formula: &str, amplitude: &Amplitude, signature: &[f64], unit: Unit) -> Self {
        let name = formula.split_once('·').map_or(formula, |(_, cause)| cause);
        let name = name.split_once(", ").map_or(name, |(cause, _)| cause);
        let per = amplitude.unit.strip_prefix(unit.name()).and_then(|rest| rest.strip_prefix('/'));
        let factor = 1.0 / (amplitude.in_unit * unit.in_si());
        let (unit, factor) = match per {
            Some(per) => (per.trim_start_matches('(').trim_end_matches(')').to_owned(), factor),
            // ppm, arc seconds: the cause keeps the unit of the sensor.
            None => (unit.name().to_owned(), 1.0 / unit.in_si()),
        };
        Self { name: name.to_owned(), unit, values: signature.iter().map(|value| value * factor).collect() }
    }
}

impl Dependence {
    /// `None` where there is no cause or it does not vary. `repeats` is how many values of the remainder are worth one.
    pub(super) fn of(part: Part, remainder: &[f64], repeats: f64) -> Option<Self> {
        let Part { finding, values: explained, cause } = part;
        let mut cause = cause?;
        cause.values.resize(remainder.len(), f64::NAN);
        let residual: Vec<f64> = remainder.iter().zip(&explained).map(|(r, e)| r + e).collect();
        let mut rows: Vec<[f64; 3]> = (cause.values.iter().zip(&residual).zip(&explained))
            .map(|((x, y), e)| [*x, *y, *e])
            .filter(|row| row.iter().all(|value| value.is_finite()))
            .collect();
        rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let varies = rows.first().zip(rows.last()).is_some_and(|(first, last)| first[0] < last[0]);
        if !varies {
            return None;
        }
        let spread = super::spread(remainder);
        let bins = bins(&rows).map(|bin| {
            let count = bin.len() as f64;
            let mean = |column: usize| bin.iter().map(|row| row[column]).sum::<f64>() / count;
            let sigma = spread * (repeats / count).sqrt().min(1.0);
            Bin { cause: mean(0), residual: mean(1), sigma, explained: mean(2) }
        });
        let bins = bins.collect();
        Some(Self { finding, cause, residual, explained, bins })
    }
}

/// Bins of about equally many rows; rows with the same cause stay together.
fn bins(rows: &[[f64; 3]]) -> impl Iterator<Item = &[[f64; 3]]> {
    let size = (rows.len() / BINS).max(LEAST_IN_BIN);
    let mut rest = rows;
    std::iter::from_fn(move || {
        let end = rest.get(size.min(rest.len()).checked_sub(1)?)?[0];
        let count = rest.partition_point(|row| row[0] <= end);
        let (bin, others) = rest.split_at(count);
        rest = others;
        Some(bin)
    })
}

/// How many neighbouring values of a series are worth one independent value, at least 1.
pub(super) fn repeats(values: &[f64]) -> f64 {
    let mean = mean(values);
    let centred: Vec<f64> = values.iter().map(|value| value - mean).collect();
    if present(&centred).all(|value| value == 0.0) {
        return 1.0;
    }
    let found = autocorrelation(&centred, 1.0, values.len() / LONGEST_PART);
    1.0 + 2.0 * found.correlation.iter().take_while(|r| **r > 0.0).sum::<f64>()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    pub fn white(count: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        (0..count).map(|_| StandardNormal.sample(&mut random)).collect()
    }

    /// First-order Markov noise of variance one.
    pub fn markov(count: usize, tau: f64, seed: u64) -> Vec<f64> {
        let transition = f64::exp(-1.0 / tau);
        let drive = (1.0 - transition * transition).sqrt();
        let mut state = white(1, seed + 1000)[0];
        (white(count, seed).iter())
            .map(|noise| {
                state = transition * state + drive * noise;
                state
            })
            .collect()
    }

    #[test]
    fn correlated_values_are_worth_fewer() {
        let found = repeats(&white(20_000, 1));
        assert!((0.9..1.2).contains(&found), "{found}");
        // (1 + φ)/(1 − φ) = 2τ for first-order Markov noise.
        let found = repeats(&markov(200_000, 20.0, 1));
        assert!((36.0..44.0).contains(&found), "{found}");
    }

    #[test]
    fn the_means_lie_about_the_effect_as_their_sigma_says() {
        let (rows, tau) = (40_000, 20.0);
        let (mut beyond, mut all) = (0.0, 0.0);
        for seed in 0..10 {
            // The cause is in no step with the noise, as a random one.
            let values = markov(rows, 300.0, 100 + seed);
            let explained: Vec<f64> = values.iter().map(|x| 0.3 * x).collect();
            let remainder = markov(rows, tau, seed);
            let cause = Some(Cause { name: "x".into(), unit: "K".into(), values });
            let part = Part { finding: 0, values: explained, cause };
            let found = Dependence::of(part, &remainder, repeats(&remainder)).unwrap();
            assert!((29..=31).contains(&found.bins.len()), "{}", found.bins.len());
            for bin in found.bins {
                assert!((bin.explained - 0.3 * bin.cause).abs() < 1e-9);
                beyond += f64::from(u8::from((bin.residual - bin.explained).abs() > 2.0 * bin.sigma));
                all += 1.0;
            }
        }
        // 4.6 % were the bins independent; a bin also gathers values far apart, which are worth more.
        assert!(beyond / all < 0.1, "{}", beyond / all);
    }

    #[test]
    fn a_cause_that_repeats_its_values_keeps_them_together() {
        let values: Vec<f64> = (0..900).map(|k| f64::from(k % 3)).collect();
        let part = Part {
            finding: 2,
            values: values.clone(),
            cause: Some(Cause { name: "x".into(), unit: String::new(), values }),
        };
        let found = Dependence::of(part.clone(), &vec![0.0; 900], 1.0).unwrap();
        assert_eq!(found.bins.iter().map(|bin| bin.cause).collect::<Vec<_>>(), [0.0, 1.0, 2.0]);
        let constant = Part { cause: part.cause.map(|c| Cause { values: vec![1.0; 900], ..c }), ..part };
        assert!(Dependence::of(constant, &vec![0.0; 900], 1.0).is_none());
    }

    #[test]
    fn the_signature_becomes_the_cause_in_its_unit() {
        let amplitude = Amplitude {
            name: "coefficient".into(),
            unit: "deg/h/(K/h)".into(),
            // 1 (rad/s)/(K/s) in deg/h/(K/h).
            in_unit: 1.0 / Unit::DegreePerHour.in_si() / 3600.0,
            plausible: None,
        };
        // 2 K/h.
        let cause = Cause::of_signature("k·Ṫ", &amplitude, &[2.0 / 3600.0], Unit::DegreePerHour);
        assert_eq!((cause.name.as_str(), cause.unit.as_str()), ("Ṫ", "K/h"));
        assert!((cause.values[0] - 2.0).abs() < 1e-12, "{}", cause.values[0]);
        let ppm = Amplitude { unit: "ppm".into(), in_unit: 1e6, ..amplitude };
        let cause =
            Cause::of_signature("k·u", &ppm, &[Unit::DegreePerHour.in_si() * 7.0], Unit::DegreePerHour);
        assert_eq!((cause.name.as_str(), cause.unit.as_str()), ("u", "deg/h"));
        assert!((cause.values[0] - 7.0).abs() < 1e-12);
    }
}
