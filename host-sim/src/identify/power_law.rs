//! The five power laws of the Allan variance, fitted: quantisation, random walk, bias instability, rate random walk
//! and ramp.
//!
//! σ²(τ) = 3Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 + R² τ²/2. Source: IEEE Std 952, annex C.
//!
//! The octaves of the overlapping Allan variance are fitted by least squares on their relative errors (weight: half
//! the equivalent degrees of freedom, within limits), for every subset of the terms with squares that are not negative; a term stays
//! only if it lowers χ² enough. Octaves are not independent, so neither the standard deviations nor the fit's quality
//! are taken from χ²: series with the fitted power laws are drawn and fitted again, always with the same seed.
use std::f64::consts::{LN_2, PI};

use nalgebra::{SMatrix, SVector};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_fourier::{Complex, Inverse};

use super::allan::{AllanPoint, allan_variances};

/// Number of terms.
pub const TERMS: usize = 5;
/// Every further term must lower χ² by this: then about one white series in twenty shows a false term.
const LEAST_GAIN: f64 = 13.0;
/// Degrees of freedom beyond which an octave weighs no more. In long series the shortest averaging times have a hundred
/// thousand, and would bend all terms to follow them wherever the noise is not exactly of power laws.
const MOST_DEGREES: f64 = 1000.0;
/// Passes of the fit, whose weights depend on the fitted variance.
const PASSES: usize = 4;
/// Fewer octaves than this are not fitted.
const LEAST_OCTAVES: usize = 3;
/// Series drawn for the standard deviations: as many as this work allows (in values), within the limits.
const DRAWN_VALUES: usize = 20_000_000;
const MOST_DRAWN: usize = 100;
const LEAST_DRAWN: usize = 24;
const SEED: u64 = 0x5c48_756c_6572;
/// Factor from the standard deviation to the 95 % bound of one side.
const ONE_SIDED_95: f64 = 1.645;

/// Squares of the coefficients: Q², N², B², K², R² in SI units.
pub type Squares = [f64; TERMS];

/// The fitted power laws.
#[derive(Clone, Debug, PartialEq)]
pub struct PowerLaws {
    /// Squares of the coefficients Q, N, B, K, R; 0 where the term was not found.
    pub squares: Squares,
    /// Standard deviations of the coefficients themselves; 0 where the term was not found.
    pub sigmas: [f64; TERMS],
    /// What each coefficient is below, with 95 % probability.
    pub limits: [f64; TERMS],
    /// How often noise of exactly these power laws is fitted as badly as the series; small = something else is in it.
    pub p_value: f64,
}

/// Variance of each term at `tau_s` for a coefficient of one.
fn basis(tau_s: f64) -> Squares {
    [3.0 / (tau_s * tau_s), 1.0 / tau_s, 2.0 * LN_2 / PI, tau_s / 3.0, tau_s * tau_s / 2.0]
}

/// Allan variance of power laws at `tau_s`.
pub fn variance(squares: &Squares, tau_s: f64) -> f64 {
    basis(tau_s).iter().zip(squares).map(|(basis, square)| basis * square).sum()
}

/// The power laws of a series with the Allan deviation `points`; `None` where there are too few. What is missing in `values` (NaN)
/// is missing in the series drawn, too.
pub fn fit_power_laws(points: &[AllanPoint], values: &[f64], step_s: f64) -> Option<PowerLaws> {
    let octaves: Vec<Octave> = points
        .iter()
        .filter(|point| point.factor.is_power_of_two() && point.deviation > 0.0)
        .map(|point| Octave {
            factor: point.factor,
            basis: basis(point.tau_s),
            variance: point.deviation * point.deviation,
            weight: point.degrees_of_freedom.min(MOST_DEGREES) / 2.0,
        })
        .collect();
    if octaves.len() < LEAST_OCTAVES {
        return None;
    }
    let (support, squares, misfit) = select(&octaves)?;
    let drawn = redraw(&octaves, support, &squares, values, step_s);
    let as_bad = drawn.iter().filter(|(_, drawn_misfit)| *drawn_misfit >= misfit).count();
    let p_value = (as_bad + 1) as f64 / (drawn.len() + 1) as f64;
    let usual_misfit = drawn.iter().map(|(_, misfit)| misfit).sum::<f64>() / drawn.len() as f64;
    // Where the fit is worse than power laws alone make it, its coefficients are less certain by as much (Birge).
    let birge = (misfit / usual_misfit).max(1.0).sqrt();
    let mut sigmas = [0.0; TERMS];
    for (term, (sigma, square)) in sigmas.iter_mut().zip(&squares).enumerate() {
        if *square > 0.0 {
            let spread: f64 = drawn.iter().map(|(redrawn, _)| (redrawn[term] - square).powi(2)).sum();
            // d(c) = d(c²)/(2c); about the fitted value, so that the fit's own bias counts.
            *sigma = birge * (spread / drawn.len() as f64).sqrt() / (2.0 * square.sqrt());
        }
    }
    let mut limits = [0.0; TERMS];
    for (term, limit) in limits.iter_mut().enumerate() {
        let found = squares[term].sqrt() + ONE_SIDED_95 * sigmas[term];
        let alone = points
            .iter()
            .map(|point| bound_95(point) / basis(point.tau_s)[term].sqrt())
            .fold(f64::INFINITY, f64::min);
        *limit = if squares[term] > 0.0 { found } else { alone };
    }
    Some(PowerLaws { squares, sigmas, limits, p_value })
}

/// Deviation that the true one is below with 95 % probability.
fn bound_95(point: &AllanPoint) -> f64 {
    super::allan::interval(point.deviation, point.degrees_of_freedom, 0.9).1
}

/// One octave of the Allan variance, with the weight of its relative error.
struct Octave {
    factor: usize,
    basis: Squares,
    variance: f64,
    weight: f64,
}

impl Octave {
    fn model(&self, squares: &Squares) -> f64 {
        self.basis.iter().zip(squares).map(|(basis, square)| basis * square).sum()
    }
}

/// Which terms are in a fit.
type Support = [bool; TERMS];

/// The best subset of terms, its squares and its misfit.
fn select(octaves: &[Octave]) -> Option<(Support, Squares, f64)> {
    (1_u32..1 << TERMS)
        .filter_map(|bits| {
            let support: Support = std::array::from_fn(|term| bits >> term & 1 == 1);
            let squares = solve(octaves, support)?;
            let feasible = support.iter().zip(&squares).all(|(&used, &square)| !used || square > 0.0);
            let misfit = misfit(octaves, &squares);
            (feasible && misfit.is_finite()).then_some((support, squares, misfit))
        })
        .min_by(|a, b| penalised(a.0, a.2).total_cmp(&penalised(b.0, b.2)))
}

/// A misfit with what each term in use costs.
fn penalised(support: Support, misfit: f64) -> f64 {
    misfit + LEAST_GAIN * support.iter().filter(|&&used| used).count() as f64
}

/// χ² of the logarithms of the variances, which are nearer to normal than the variances.
fn misfit(octaves: &[Octave], squares: &Squares) -> f64 {
    octaves.iter().map(|octave| octave.weight * (octave.variance / octave.model(squares)).ln().powi(2)).sum()
}

/// Least squares of the terms in `support`; squares may come out negative.
fn solve(octaves: &[Octave], support: Support) -> Option<Squares> {
    let used = support.iter().filter(|&&used| used).count();
    if used > octaves.len() {
        return None;
    }
    let mut squares = [0.0; TERMS];
    for pass in 0..PASSES {
        // Every octave is divided by its fitted variance: the errors are relative.
        let rows = octaves.iter().map(|octave| {
            let fitted = if pass == 0 { 0.0 } else { octave.model(&squares) };
            let scale = octave.weight.sqrt() / if fitted > 0.0 { fitted } else { octave.variance };
            let terms = octave.basis.iter().zip(support);
            let terms = terms.map(|(&basis, used)| if used { scale * basis } else { 0.0 });
            (SVector::<f64, TERMS>::from_iterator(terms), scale * octave.variance)
        });
        let (mut normal, mut target) =
            (SMatrix::<f64, TERMS, TERMS>::zeros(), SVector::<f64, TERMS>::zeros());
        for (row, value) in rows {
            normal += row * row.transpose();
            target += row * value;
        }
        // The terms' units differ by many powers of ten: they are scaled to a diagonal of ones. A term that is not
        // used has a one and nothing else.
        let size = normal.diagonal().map(|square| if square > 0.0 { square.sqrt() } else { 1.0 });
        normal.component_div_assign(&(size * size.transpose()));
        for term in 0..TERMS {
            normal[(term, term)] = 1.0;
        }
        let solution = normal.cholesky()?.solve(&target.component_div(&size)).component_div(&size);
        squares = solution.into();
    }
    squares.iter().all(|square| square.is_finite()).then_some(squares)
}

/// Squares and misfits fitted to series drawn from the power laws.
fn redraw(
    octaves: &[Octave],
    support: Support,
    squares: &Squares,
    values: &[f64],
    step_s: f64,
) -> Vec<(Squares, f64)> {
    let count = values.len();
    let draws = (DRAWN_VALUES / count.max(1)).clamp(LEAST_DRAWN, MOST_DRAWN);
    let factors: Vec<usize> = octaves.iter().map(|octave| octave.factor).collect();
    (0..draws as u64)
        .into_par_iter()
        .filter_map(|draw| {
            let mut series = simulate(squares, count, step_s, &mut Pcg64::seed_from_u64(SEED ^ draw << 32));
            for (drawn, value) in series.iter_mut().zip(values) {
                if !value.is_finite() {
                    *drawn = f64::NAN;
                }
            }
            let redrawn: Vec<Octave> = octaves
                .iter()
                .zip(allan_variances(&series, &factors))
                .filter_map(|(octave, variance)| {
                    let Octave { factor, basis, weight, .. } = *octave;
                    Some(Octave { factor, basis, weight, variance: variance? })
                })
                .collect();
            let squares = solve(&redrawn, support)?;
            Some((squares, misfit(&redrawn, &squares)))
        })
        .filter(|(_, misfit)| misfit.is_finite())
        .collect()
}

/// A series of `count` steps with the given power laws.
pub(super) fn simulate(squares: &Squares, count: usize, step_s: f64, random: &mut Pcg64) -> Vec<f64> {
    let [quantisation, white, flicker, walk, ramp] = squares.map(f64::sqrt);
    let mut normals = |used: f64| -> Vec<f64> {
        let count = if used > 0.0 { count + 1 } else { 0 };
        StandardNormal.sample_iter(&mut *random).take(count).collect()
    };
    let mut series: Vec<f64> = (0..count).map(|row| ramp * step_s * row as f64).collect();
    for (value, phases) in series.iter_mut().zip(normals(quantisation).windows(2)) {
        *value += quantisation * (phases[1] - phases[0]) / step_s;
    }
    for (value, normal) in series.iter_mut().zip(normals(white)) {
        *value += white / step_s.sqrt() * normal;
    }
    let mut walked = 0.0;
    for (value, normal) in series.iter_mut().zip(normals(walk)) {
        walked += walk * step_s.sqrt() * normal;
        *value += walked;
    }
    if flicker > 0.0 {
        for (value, noise) in series.iter_mut().zip(simulate_flicker(count, random)) {
            *value += flicker * noise;
        }
    }
    series
}

/// Noise with the two-sided spectrum 1/(2π f): B = 1.
fn simulate_flicker(count: usize, random: &mut Pcg64) -> Vec<f64> {
    // Twice as long as needed, so that the ends of the period do not meet in the series.
    let length = (2 * count.max(2)).next_power_of_two();
    let last = length / 2;
    let spectrum = (0..=last).map(|bin| {
        let mut normal = || -> f64 { StandardNormal.sample(random) };
        // The variance of a bin is S(f) · length/Δ, with f = bin/(length Δ); the inverse transform divides by length.
        let amplitude = if bin == 0 { 0.0 } else { (1.0 / (4.0 * PI * bin as f64)).sqrt() };
        let imaginary = if bin == 0 || bin == last { 0.0 } else { normal() };
        Complex::new(normal(), imaginary) * amplitude
    });
    let mut series = Inverse::new(length).transform(spectrum);
    series.truncate(count);
    series
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::allan::overlapping_allan;

    fn mean_variance(squares: &Squares, factor: usize) -> f64 {
        let series = 256;
        let total: f64 = (0..series)
            .map(|seed| {
                let drawn = simulate(squares, 8192, 0.5, &mut Pcg64::seed_from_u64(seed));
                allan_variances(&drawn, &[factor])[0].unwrap()
            })
            .sum();
        total / f64::from(series as u32)
    }

    #[test]
    fn each_simulated_power_law_has_its_allan_variance() {
        for term in 0..TERMS {
            let mut squares = [0.0; TERMS];
            squares[term] = 4.0;
            for factor in [4, 16, 64, 256] {
                let expected = variance(&squares, 0.5 * factor as f64);
                let found = mean_variance(&squares, factor);
                // Flicker and random walk in steps differ from continuous ones by O(1/m²) at short averaging times.
                assert!(
                    (found / expected - 1.0).abs() < 0.06,
                    "term {term}, m = {factor}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn known_coefficients_are_within_three_standard_deviations() {
        // N = 2e-5 /√s, B = 3e-6, K = 2e-8 √(1/s) for 40 000 steps of 1 s.
        let truth: Squares = [0.0, 4e-10, 9e-12, 4e-16, 0.0];
        let (mut outside, mut missed, cases) = (0, 0, 24);
        for seed in 0..cases {
            let series = simulate(&truth, 40_000, 1.0, &mut Pcg64::seed_from_u64(1000 + seed));
            let fit = fit_power_laws(&overlapping_allan(&series, 1.0), &series, 1.0).unwrap();
            let white = (fit.squares[1].sqrt() - truth[1].sqrt()).abs();
            assert!(white < 5.0 * fit.sigmas[1], "{fit:?}");
            outside += u32::from(white > 3.0 * fit.sigmas[1]);
            missed += u32::from(fit.squares[2] == 0.0 && fit.squares[3] == 0.0);
            for term in [2, 3] {
                if fit.squares[term] > 0.0 {
                    outside += u32::from(
                        (fit.squares[term].sqrt() - truth[term].sqrt()).abs() > 3.0 * fit.sigmas[term],
                    );
                } else {
                    assert!(fit.limits[term] > truth[term].sqrt(), "the limit must hold: {fit:?}");
                }
            }
        }
        println!(
            "{outside} of about 60 coefficients outside 3 sigma, {missed} of {cases} without a slow term"
        );
        assert!(outside <= 3 && missed == 0, "{outside} {missed}");
    }

    #[test]
    fn white_noise_alone_is_white_noise_alone() {
        let (mut false_terms, mut rejected, cases) = (0, 0, 60);
        for seed in 0..cases {
            let series = simulate(&[0.0, 1.0, 0.0, 0.0, 0.0], 4000, 1.0, &mut Pcg64::seed_from_u64(seed));
            let fit = fit_power_laws(&overlapping_allan(&series, 1.0), &series, 1.0).unwrap();
            false_terms += u32::from(fit.squares.iter().filter(|&&square| square > 0.0).count() > 1);
            rejected += u32::from(fit.p_value < 0.05);
        }
        println!("{false_terms} of {cases} with a false term, {rejected} rejected at 5 %");
        assert!(false_terms <= 7, "{false_terms}");
        assert!(rejected <= 8, "{rejected}");
    }

    #[test]
    fn noise_that_is_no_power_law_is_refused() {
        // A first-order process in the middle of the range: a hump that five straight lines cannot follow.
        let mut random = Pcg64::seed_from_u64(7);
        let mut state = 0.0;
        let series: Vec<f64> = (0..40_000)
            .map(|_| {
                let (driven, white): (f64, f64) =
                    (StandardNormal.sample(&mut random), StandardNormal.sample(&mut random));
                state += -state / 100.0 + (2.0_f64 / 100.0).sqrt() * driven;
                state + 0.1 * white
            })
            .collect();
        let fit = fit_power_laws(&overlapping_allan(&series, 1.0), &series, 1.0).unwrap();
        assert!(fit.p_value < 0.05, "{fit:?}");
    }
}
