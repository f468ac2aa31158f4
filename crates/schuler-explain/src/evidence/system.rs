//! Scores and products of regressors under given weights, the amplitudes that follow, and the power that is left.
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::regressor::Regressor;
use crate::bands::sums::Sums;
use crate::noise::weights::Weights;

/// The blocks with what their bands count.
#[derive(Clone, Copy)]
pub struct System<'s> {
    /// Sums of each block.
    pub sums: &'s [Option<Sums>],
    /// Weights of each block.
    pub weights: &'s [Option<Weights>],
}

impl System<'_> {
    /// Score of a regressor with the data: the derivative of the log-likelihood by its amplitude at 0.
    pub fn score(&self, regressor: &Regressor) -> f64 {
        let of_part = |part: &super::regressor::Part| {
            let (Some(sums), Some(weights)) = (&self.sums[part.block], &self.weights[part.block]) else {
                return 0.0;
            };
            sums.with_channels(part.series, |with| {
                let mut sum = 0.0;
                for (channel, with) in with.iter().enumerate() {
                    let weights = weights.of_place_and_channel.iter();
                    sum += with.iter().zip(weights).map(|(a, w)| a * w[(part.place, channel)]).sum::<f64>();
                }
                sum
            })
        };
        regressor.parts.iter().map(of_part).sum()
    }

    /// Product of two regressors.
    pub fn product(&self, a: &Regressor, b: &Regressor) -> f64 {
        let mut sum = 0.0;
        for first in &a.parts {
            for second in b.parts.iter().filter(|second| second.block == first.block) {
                let (Some(sums), Some(weights)) = (&self.sums[first.block], &self.weights[first.block])
                else {
                    continue;
                };
                let products = sums.products(first.series, second.series);
                let weights = weights.of_places.iter();
                sum += products
                    .iter()
                    .zip(weights)
                    .map(|(p, w)| p * w[(first.place, second.place)])
                    .sum::<f64>();
            }
        }
        sum
    }

    /// Amplitudes of what is described at their best.
    pub fn solve(&self, described: &Described<'_>) -> Option<Solved> {
        let all = &described.regressors;
        let is_free = |&index: &usize| !described.is_unit[index] && !all[index].parts.is_empty();
        let free: Vec<usize> = (0..all.len()).filter(is_free).collect();
        let normal = DMatrix::from_fn(free.len(), free.len(), |i, j| {
            if j <= i { self.product(all[free[i]], all[free[j]]) } else { 0.0 }
        });
        let normal = symmetric(normal);
        let units: Vec<usize> = (0..all.len()).filter(|&index| described.is_unit[index]).collect();
        let score = |i: usize| {
            let of_units: f64 = units.iter().map(|&unit| self.product(all[free[i]], all[unit])).sum();
            self.score(all[free[i]]) - of_units
        };
        let scores = DVector::from_fn(free.len(), |i, _| score(i));
        let root = root_of(&normal)?;
        let solution = root.solve(&scores);
        let mut amplitudes = DVector::from_element(all.len(), 1.0);
        for (&index, value) in free.iter().zip(solution.iter()) {
            amplitudes[index] = *value;
        }
        Some(Solved { amplitudes, free, normal, root })
    }

    /// Products of the channels of a block by band, what is described taken out.
    pub fn power_left(
        &self,
        block: usize,
        described: &Described<'_>,
        amplitudes: &DVector<f64>,
    ) -> Vec<DMatrix<f64>> {
        let Some(sums) = &self.sums[block] else { return Vec::new() };
        let mut power = sums.between_channels.clone();
        let parts: Vec<(f64, super::regressor::Part)> = (described.regressors.iter().zip(amplitudes.iter()))
            .flat_map(|(regressor, amplitude)| regressor.parts.iter().map(|part| (*amplitude, *part)))
            .filter(|(_, part)| part.block == block)
            .collect();
        for (index, (amplitude, part)) in parts.iter().enumerate() {
            let vector = &sums.vectors[part.place];
            sums.with_channels(part.series, |with| {
                for (band, power) in power.iter_mut().enumerate() {
                    let of_channels = DVector::from_fn(with.len(), |channel, _| with[channel][band]);
                    power.ger(-amplitude, vector, &of_channels, 1.0);
                    power.ger(-amplitude, &of_channels, vector, 1.0);
                }
            });
            for (place, (other_amplitude, other)) in parts[..=index].iter().enumerate() {
                let products = sums.products(part.series, other.series);
                let other_vector = &sums.vectors[other.place];
                for (power, product) in power.iter_mut().zip(products.iter()) {
                    let both = amplitude * other_amplitude * product;
                    if place == index {
                        power.ger(both, vector, vector, 1.0);
                    } else {
                        power.ger(both, vector, other_vector, 1.0);
                        power.ger(both, other_vector, vector, 1.0);
                    }
                }
            }
        }
        power
    }

    /// Coefficients of the channels of a block, what is described taken out.
    pub fn left(&self, block: usize, described: &Described<'_>, amplitudes: &DVector<f64>) -> Vec<Vec<f64>> {
        let Some(sums) = &self.sums[block] else { return Vec::new() };
        let mut channels = sums.channels.clone();
        for (regressor, amplitude) in described.regressors.iter().zip(amplitudes.iter()) {
            add(sums, block, regressor, -amplitude, &mut channels);
        }
        channels
    }
}

/// Adds a multiple of a regressor to the coefficients of a block's channels.
pub fn add(sums: &Sums, block: usize, regressor: &Regressor, amplitude: f64, channels: &mut [Vec<f64>]) {
    for part in regressor.parts.iter().filter(|part| part.block == block) {
        for (channel, coefficients) in channels.iter_mut().enumerate() {
            sums.add(part.series, amplitude * sums.vectors[part.place][channel], coefficients);
        }
    }
}

/// Regressors that are described together.
#[derive(Default)]
pub struct Described<'d> {
    /// The regressors.
    pub regressors: Vec<&'d Regressor>,
    /// Whether the amplitude of each is 1 and not free.
    pub is_unit: Vec<bool>,
}

/// Amplitudes.
pub struct Solved {
    /// One a regressor.
    pub amplitudes: DVector<f64>,
    /// The regressors whose amplitudes are free.
    pub free: Vec<usize>,
    /// Products of these.
    pub normal: DMatrix<f64>,
    /// Root of the products.
    pub root: Root,
}

/// Root of a normal matrix whose rows and columns are brought to unit length.
pub struct Root {
    lengths: DVector<f64>,
    root: Cholesky<f64, Dyn>,
}

impl Root {
    /// Solution for a right-hand side.
    pub fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        self.root.solve(&right.component_div(&self.lengths)).component_div(&self.lengths)
    }

    /// Logarithm of the determinant.
    pub fn ln_determinant(&self) -> f64 {
        let diagonal = self.root.l_dirty().diagonal();
        2.0 * diagonal.iter().zip(self.lengths.iter()).map(|(a, b)| (a * b).ln()).sum::<f64>()
    }
}

/// What is left of the information `own` where others are free, of which `between` are the products with it.
pub fn left_beside(own: DMatrix<f64>, between: &DMatrix<f64>, others: &Root) -> DMatrix<f64> {
    let columns: Vec<DVector<f64>> =
        between.column_iter().map(|column| others.solve(&column.into_owned())).collect();
    own - between.tr_mul(&DMatrix::from_columns(&columns))
}

/// Root of a normal matrix; none of one that is singular.
pub fn root_of(normal: &DMatrix<f64>) -> Option<Root> {
    let lengths = normal.diagonal().map(|value| value.max(0.0).sqrt());
    if lengths.iter().any(|length| !(*length > 0.0 && length.is_finite())) {
        return None;
    }
    let scaled = DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| {
        let jitter = if i == j { 1e-11 } else { 0.0 };
        normal[(i, j)] / (lengths[i] * lengths[j]) + jitter
    });
    Some(Root { lengths, root: scaled.cholesky()? })
}

/// The matrix of which `lower` is the lower triangle.
pub fn symmetric(mut lower: DMatrix<f64>) -> DMatrix<f64> {
    lower.fill_upper_triangle_with_lower_triangle();
    lower
}
