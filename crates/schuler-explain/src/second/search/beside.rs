//! What a signature would gain beside what is described, in closed form under given weights.
use nalgebra::{DMatrix, DVector};

use crate::catalogue::Candidate;
use crate::second::evidence::amplitude::{ln_gain, ln_plausibility};
use crate::second::evidence::fit::{Bench, Description};
use crate::second::evidence::regressor::Regressor;
use crate::second::evidence::system::{Described, Solved, System, root_of};
use crate::second::noise::weights::{Covariances, Weights};

/// A description under weights of its own or under those of full trust.
pub struct Beside<'b> {
    /// What descriptions are made of.
    pub bench: &'b Bench<'b>,
    /// What is described.
    pub description: &'b Description,
    /// What the bands of each block count.
    pub weights: Vec<Option<Weights>>,
    /// Amplitudes of what is described under these weights.
    pub solved: Solved,
}

impl<'b> Beside<'b> {
    /// Under the weights of the description.
    pub fn as_trusted(bench: &'b Bench<'b>, description: &'b Description) -> Option<Self> {
        Self::new(bench, description, description.weights.clone())
    }

    /// Under full trust in its noises.
    pub fn trusting(bench: &'b Bench<'b>, description: &'b Description) -> Option<Self> {
        let of_block = |(index, sums): (usize, &Option<_>)| {
            let sums = sums.as_ref()?;
            let block = &bench.problem.model.blocks[index];
            Some(Covariances::new(block, sums, &description.noises)?.full_weights(sums))
        };
        Self::new(bench, description, bench.sums.iter().enumerate().map(of_block).collect())
    }

    fn new(
        bench: &'b Bench<'b>,
        description: &'b Description,
        weights: Vec<Option<Weights>>,
    ) -> Option<Self> {
        let system = System { sums: &bench.sums, weights: &weights };
        let solved = system.solve(&description.described(bench))?;
        Some(Self { bench, description, weights, solved })
    }

    /// The blocks with their weights.
    pub fn system(&self) -> System<'_> {
        System { sums: &self.bench.sums, weights: &self.weights }
    }

    /// Constants and effects that are described.
    pub fn described(&self) -> Described<'_> {
        self.description.described(self.bench)
    }

    /// Logarithm of what the evidence is multiplied by where a signature is added; −∞ of one that cannot be told from what is
    /// described.
    pub fn ln_gain(&self, described: &Described<'_>, regressors: &[Regressor], candidate: &Candidate, is_unit: bool) -> f64 {
        let system = self.system();
        let config = self.bench.problem.config;
        let count = regressors.len();
        if regressors.iter().any(|regressor| regressor.parts.is_empty()) || count == 0 {
            return f64::NEG_INFINITY;
        }
        let mut scores = DVector::zeros(count);
        let mut information = DMatrix::zeros(count, count);
        let mut whole = DVector::zeros(count);
        for (i, regressor) in regressors.iter().enumerate() {
            let blocks: Vec<bool> = (described.regressors.iter())
                .map(|other| other.parts.iter().any(|part| regressor.reaches(part.block)))
                .collect();
            let with: Vec<f64> = (described.regressors.iter().zip(&blocks))
                .map(|(other, meets)| if *meets { system.product(regressor, other) } else { 0.0 })
                .collect();
            let taken: f64 = with.iter().zip(self.solved.amplitudes.iter()).map(|(a, b)| a * b).sum();
            scores[i] = system.score(regressor) - taken;
            let of_free = DVector::from_iterator(self.solved.free.len(), self.solved.free.iter().map(|&k| with[k]));
            let projected = self.solved.root.solve(&of_free);
            for (j, other) in regressors.iter().enumerate().take(i + 1) {
                information[(i, j)] += system.product(regressor, other);
                if i == j {
                    whole[i] = information[(i, i)];
                    information[(i, i)] -= projected.dot(&of_free);
                } else {
                    let of_other = (described.regressors.iter().enumerate())
                        .filter(|(k, _)| self.solved.free.contains(k))
                        .map(|(_, known)| system.product(other, known));
                    let of_other = DVector::from_iterator(self.solved.free.len(), of_other);
                    information[(i, j)] -= projected.dot(&of_other);
                }
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        let is_left = |i: usize| information[(i, i)] > config.least_information_left * whole[i];
        if !(0..count).all(is_left) {
            return f64::NEG_INFINITY;
        }
        if is_unit {
            return scores.sum() - 0.5 * information.sum();
        }
        let Some(root) = root_of(&information) else { return f64::NEG_INFINITY };
        let amplitudes = root.solve(&scores);
        let squares = amplitudes.dot(&scores).max(0.0);
        ln_gain(squares, count, config) + ln_plausibility(&candidate.amplitudes, amplitudes.as_slice(), config)
    }
}
