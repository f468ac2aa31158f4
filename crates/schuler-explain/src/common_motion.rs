//! What readings of redundant sensors tell of their noise beside their residuals.
//!
//! Readings y = A m + n of one motion m have the residuals p = V y, V A = 0, which know nothing of m, and tell of the noises N (diagonal)
//! only V N Vᵀ: of two sensors the sum. The readings tell more, because whatever the motion is, all of them have it. In a band of K
//! frequencies their spectra are A M Aᵀ + N, with a motion M in r directions of which nothing is known. The weighted mean
//! u = (Aᵀ N⁻¹ A)⁻¹ Aᵀ N⁻¹ y is uncorrelated with p, and Whittle's likelihood over all M is that of the residuals and
//!
//! ```text
//!   −(K − r) ln det Ŝᵤ(N),
//! ```
//!
//! Ŝᵤ the spectrum of u: the right weights are those with which the mean has the least power. Where the motion is many times the noise
//! this says nothing. What a description says of the readings is taken off them first ([`CommonMotion::without`]): a line in one sensor is
//! noise of its own otherwise.
use std::ops::RangeInclusive;

use nalgebra::{Complex, DMatrix, DVector, Matrix3, Matrix3xX, MatrixXx3, Vector3};
use schuler_fourier::Forward;
use schuler_recording::Recording;

use crate::inputs::redundant::{RANK_TOLERANCE, axis_of};
use crate::inputs::series::{bridged, mean};
use crate::noise::{Knob, Noise};
use crate::nominal::{Block, Model, of_input};
use crate::numeric::minimise::simplex;

/// First frequency that the taper keeps apart from the mean.
const FIRST: usize = 3;
/// Frequencies of a band: at least, and as a part of its own.
const BINS: usize = 12;
const WIDTH: f64 = 0.1;
/// Independent frequencies under the taper, sin², as a part of those without.
const TAPERED: f64 = 18.0 / 35.0;
/// Part of the rows in which all sensors must have readings.
const LEAST_PRESENT: f64 = 0.5;
/// By how much the user's belief may be wrong, ln of a parameter, 1 σ.
const BELIEF: f64 = 1.0;
/// First side of the simplex, and the spread of its costs at which it ends.
const SIDE: f64 = 0.5;
const SPREAD: f64 = 0.01;
/// Iterations of the simplex for each parameter.
const ITERATIONS: u64 = 60;
/// Times that all sensors are gone through, and nats below which nothing more is to be had.
const ROUNDS: usize = 6;
const ENOUGH: f64 = 0.3;

/// Redundant sensors, seen beside the motion that they have in common.
#[derive(Clone, Debug)]
pub struct CommonMotion {
    /// Their sources.
    pub sources: Vec<usize>,
    /// Their axes in the directions that they span; 0 in those that they do not.
    axes: MatrixXx3<f64>,
    /// 1 in the directions that they do not span.
    unseen: Matrix3<f64>,
    step_s: f64,
    bands: Vec<Band>,
}

/// Readings of redundant sensors as their spectra are made of them.
#[derive(Debug)]
struct Readings {
    /// Rows that all have.
    present: Vec<bool>,
    time_s: Vec<f64>,
    /// Of the taper over these rows.
    energy: f64,
    transforms: Vec<Vec<Complex<f64>>>,
    /// Bins of each band, and what each is multiplied with: steep spectra are flat over a band as parts of what is believed.
    bins: Vec<(RangeInclusive<usize>, Vec<f64>)>,
    /// Directions of the motion.
    directions: f64,
}

/// Spectra of the readings in a band.
#[derive(Clone, Debug)]
struct Band {
    /// Middle, rad a step.
    omega: f64,
    /// Number of independent frequencies.
    weight: f64,
    /// The same less that of directions, of which the motion takes one each.
    beside: f64,
    /// The readings' spectra and cross-spectra, in units in which white noise of σ = 1 has 1.
    estimate: DMatrix<Complex<f64>>,
}

/// A band as one sensor is seen beside the others.
struct BesideOthers<'b> {
    band: &'b Band,
    /// The mean of the others: its spectrum, and its gain P a for a unit of the innovation's power.
    mean: Matrix3<Complex<f64>>,
    gain: Vector3<f64>,
    /// The sensor's reading less what that mean makes of it: power, with the mean, and the power expected but for its own noise.
    power: f64,
    with_mean: Vector3<Complex<f64>>,
    expected: f64,
}

impl CommonMotion {
    /// The blocks of redundant sensors of a model, by their readings without those in `masked`; not those whose sensors have too few rows in
    /// common.
    pub fn of_model(model: &Model, recording: &Recording, masked: &[Vec<bool>]) -> Vec<Self> {
        let redundant = model.blocks.iter().filter(|block| block.is_redundant());
        redundant.filter_map(|block| Self::of_block(block, model, recording, masked)).collect()
    }

    fn of_block(block: &Block, model: &Model, recording: &Recording, masked: &[Vec<bool>]) -> Option<Self> {
        let sources = &model.sources;
        let sensors: Vec<usize> = block.sources.iter().map(|&source| sources[source].sensor).collect();
        let along: Vec<_> =
            sensors.iter().map(|&sensor| axis_of(&recording.sensors[sensor].sensor).transpose()).collect();
        let along = MatrixXx3::from_rows(&along);
        let eigen = (along.transpose() * &along).symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let seen =
            eigen.eigenvalues.map(|value| f64::from(value > (RANK_TOLERANCE * RANK_TOLERANCE) * largest));
        let axes = &along * eigen.eigenvectors * Matrix3::from_diagonal(&seen);
        let unseen = Matrix3::from_diagonal(&seen.map(|seen| 1.0 - seen));
        let step_s = recording.step_s;
        let nominal = |omega: f64| -> f64 {
            block.sources.iter().map(|&source| sources[source].nominal.spectrum(omega, step_s)).sum()
        };
        let readings = Readings::new(recording, masked, &sensors, seen.sum(), &nominal)?;
        let bands = readings.bands(&[]);
        Some(Self { sources: block.sources.clone(), axes, unseen, step_s, bands })
    }

    /// The noises at the maximum of the likelihood of the readings and of what the user believes, found sensor by sensor; those of other
    /// sources as they are.
    pub fn fitted(&self, believed: &[Noise]) -> Vec<Noise> {
        let mut noises = believed.to_vec();
        for _ in 0..ROUNDS {
            let mut gained = 0.0;
            for place in 0..self.sources.len() {
                gained += self.fit_one(place, believed, &mut noises);
            }
            if gained < ENOUGH {
                break;
            }
        }
        noises
    }

    /// Fits the noise of one sensor beside those of the others; what it gains.
    fn fit_one(&self, place: usize, believed: &[Noise], noises: &mut [Noise]) -> f64 {
        let source = self.sources[place];
        let knobs = noises[source].knobs();
        let bands: Vec<BesideOthers<'_>> =
            self.bands.iter().filter_map(|band| self.beside_others(place, noises, band)).collect();
        let (belief, start) = (logs_of(&believed[source], &knobs), logs_of(&noises[source], &knobs));
        let cost = |logs: &[f64]| {
            let noise = with_logs(&noises[source], &knobs, logs);
            let away: f64 =
                logs.iter().zip(&belief).map(|(log, belief)| ((log - belief) / BELIEF).powi(2)).sum();
            let seen: f64 = bands
                .iter()
                .map(|seen| seen.log_likelihood(noise.spectrum(seen.band.omega, self.step_s)))
                .sum();
            0.5 * away - seen
        };
        let before = cost(&start);
        let (best, least) =
            simplex(&start, &vec![SIDE; knobs.len()], SPREAD, ITERATIONS * knobs.len() as u64, cost);
        noises[source] = with_logs(&noises[source], &knobs, &best);
        before - least
    }

    fn powers(&self, noises: &[Noise], omega: f64) -> Vec<f64> {
        self.sources.iter().map(|&source| noises[source].spectrum(omega, self.step_s)).collect()
    }

    /// Weights of the mean of noises of the given powers, without one sensor, and its noise's power; `None` where the sensors do not span
    /// the directions.
    fn mean_of(&self, powers: &[f64], without: Option<usize>) -> Option<(Matrix3xX<f64>, Matrix3<f64>)> {
        let weight = |place: usize| if without == Some(place) { 0.0 } else { powers[place].recip() };
        let weighted =
            Matrix3xX::from_fn(powers.len(), |row, column| weight(column) * self.axes[(column, row)]);
        let information = &weighted * &self.axes;
        let scale = information.trace();
        let noise = (information + self.unseen * scale).try_inverse()?;
        (noise.amax() * scale < RANK_TOLERANCE.powi(-2)).then(|| (noise * weighted, noise))
    }

    /// Spectrum of a mean; 1 in the directions that the sensors do not span.
    fn spectrum_of(&self, weights: &Matrix3xX<f64>, band: &Band) -> Matrix3<Complex<f64>> {
        let weights = weights.map(Complex::from);
        &weights * &band.estimate * weights.transpose() + self.unseen.map(Complex::from)
    }

    fn beside_others<'b>(&self, place: usize, noises: &[Noise], band: &'b Band) -> Option<BesideOthers<'b>> {
        let powers = self.powers(noises, band.omega);
        let (weights, noise) = self.mean_of(&powers, Some(place))?;
        let axis = self.axes.row(place).transpose();
        let mut innovation = -(axis.transpose() * &weights);
        innovation[place] += 1.0;
        let seen = &band.estimate * innovation.transpose().map(Complex::from);
        let gain = noise * axis;
        Some(BesideOthers {
            band,
            mean: self.spectrum_of(&weights, band),
            gain,
            power: innovation.iter().zip(&seen).map(|(weight, seen)| weight * seen.re).sum(),
            with_mean: weights.map(Complex::from) * seen,
            expected: axis.dot(&gain),
        })
    }
}

/// Transforms of series of so many rows, which zeros fill up to a power of two.
fn transforms<'v>(rows: usize, series: impl Iterator<Item = &'v [f64]>) -> Vec<Vec<Complex<f64>>> {
    let forward = Forward::new(rows.next_power_of_two());
    series.map(|values| forward.transform(values.iter().copied())).collect()
}

/// Bins of the bands of a transform of real numbers, from one on up to the highest frequency: at least so many, and so many that a band is
/// as wide as this part of its frequency.
fn bands(
    length: usize,
    from: usize,
    least: usize,
    width: f64,
) -> impl Iterator<Item = RangeInclusive<usize>> {
    let half = length / 2;
    let mut first = from;
    std::iter::from_fn(move || {
        let bins = least.max(1 + (width * first as f64) as usize);
        let last = (first + bins - 1).min(half.saturating_sub(1));
        let band = first..=last;
        first = last + 1;
        (!band.is_empty()).then_some(band)
    })
}

/// Logarithms of parameters.
fn logs_of(noise: &Noise, knobs: &[Knob]) -> Vec<f64> {
    knobs.iter().map(|&knob| noise.get(knob).max(f64::MIN_POSITIVE).ln()).collect()
}

/// A noise whose parameters have given logarithms.
fn with_logs(noise: &Noise, knobs: &[Knob], logs: &[f64]) -> Noise {
    let mut noise = noise.clone();
    for (&knob, log) in knobs.iter().zip(logs) {
        noise.set(knob, log.exp());
    }
    noise
}

impl BesideOthers<'_> {
    /// Log-likelihood of a power of the sensor's noise, up to a constant.
    fn log_likelihood(&self, noise: f64) -> f64 {
        let expected = self.expected + noise;
        let gain = (self.gain / expected).map(Complex::from);
        let mixed = gain * self.with_mean.adjoint();
        let mean = self.mean + mixed + mixed.adjoint() + gain * gain.transpose() * Complex::from(self.power);
        let power = mean.determinant().re;
        let sum = -self.band.weight * (expected.ln() + self.power / expected) - self.band.beside * power.ln();
        if sum.is_finite() { sum } else { 0.0 }
    }
}

impl Readings {
    /// `nominal` is the sum of the spectra of the noises that the user believes in; `None` where too few rows are common to all.
    fn new(
        recording: &Recording,
        masked: &[Vec<bool>],
        sensors: &[usize],
        directions: f64,
        nominal: &dyn Fn(f64) -> f64,
    ) -> Option<Self> {
        let rows = recording.len();
        let values: Vec<Vec<f64>> =
            sensors.iter().map(|&sensor| of_input(recording, masked, sensor)).collect();
        // A hole of one is one of all: the motion across it is then bridged in the same way.
        let present: Vec<bool> =
            (0..rows).map(|row| values.iter().all(|values| values[row].is_finite())).collect();
        if (present.iter().filter(|&&present| present).count() as f64) < LEAST_PRESENT * rows as f64 {
            return None;
        }
        let energy = (0..rows).filter(|&row| present[row]).map(|row| taper(row, rows).powi(2)).sum();
        let length = rows.next_power_of_two();
        let of_bins = |bins: RangeInclusive<usize>| {
            let at_middle = nominal(omega(middle(&bins), length));
            let parts = bins.clone().map(|bin| at_middle / nominal(omega(bin as f64, length))).collect();
            (bins, parts)
        };
        let bins = bands(length, FIRST, BINS, WIDTH).map(of_bins).collect();
        let time_s = recording.elapsed_s().collect();
        let mut readings = Self { present, time_s, energy, transforms: Vec::new(), bins, directions };
        let tapered: Vec<Vec<f64>> = values.iter().map(|own| readings.tapered(own)).collect::<Option<_>>()?;
        readings.transforms = transforms(rows, tapered.iter().map(Vec::as_slice));
        Some(readings)
    }

    /// A series of a sensor, of which only the rows that all have are there; `None` where it has no number in any of them.
    fn tapered(&self, values: &[f64]) -> Option<Vec<f64>> {
        let rows = self.present.len();
        let value = |row: usize| if self.present[row] { values[row] } else { f64::NAN };
        let values = bridged(&self.time_s, &(0..rows).map(value).collect::<Vec<f64>>())?;
        let mean = mean(&values);
        let tapered = values.iter().enumerate().map(|(row, value)| taper(row, rows) * (value - mean));
        Some(tapered.collect())
    }

    /// Spectra in bands, less what has some transforms.
    fn bands(&self, less: &[Option<Vec<Complex<f64>>>]) -> Vec<Band> {
        let rows = self.present.len();
        let length = rows.next_power_of_two();
        let independent = TAPERED * rows as f64 / length as f64;
        let left = |sensor: usize, bin: usize| {
            let less = less.get(sensor).and_then(Option::as_ref);
            self.transforms[sensor][bin] - less.map_or(Complex::ZERO, |less| less[bin])
        };
        let sensors = self.transforms.len();
        let of_bins = |(bins, parts): &(RangeInclusive<usize>, Vec<f64>)| {
            let number = parts.len() as f64;
            let mut sums = DMatrix::zeros(sensors, sensors);
            let mut here = DVector::zeros(sensors);
            for (bin, part) in bins.clone().zip(parts) {
                here.iter_mut().enumerate().for_each(|(sensor, here)| *here = left(sensor, bin));
                sums.gerc(Complex::from(part / (number * self.energy)), &here, &here, Complex::from(1.0));
            }
            Band {
                omega: omega(middle(bins), length),
                weight: number * independent,
                beside: (number * independent - self.directions).max(0.0),
                estimate: sums,
            }
        };
        self.bins.iter().map(of_bins).collect()
    }
}

fn taper(row: usize, rows: usize) -> f64 {
    (std::f64::consts::PI * (row as f64 + 0.5) / rows as f64).sin().powi(2)
}

/// Angular frequency of a bin, rad a step.
fn omega(bin: f64, length: usize) -> f64 {
    std::f64::consts::TAU * bin / length as f64
}

fn middle(bins: &RangeInclusive<usize>) -> f64 {
    0.5 * (bins.start() + bins.end()) as f64
}
