//! What a signature would gain beside what is described, in closed form under given weights.
use nalgebra::{DMatrix, DVector};

use crate::catalogue::Candidate;
use crate::evidence::amplitude::{ln_gain, ln_plausibility};
use crate::evidence::fit::{Bench, Description};
use crate::evidence::regressor::Regressor;
use crate::evidence::system::{Described, Solved, System, root_of};
use crate::noise::weights::{Covariances, Weights};

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
    pub fn ln_gain(
        &self,
        described: &Described<'_>,
        regressors: &[Regressor],
        candidate: &Candidate,
        is_unit: bool,
    ) -> f64 {
        let config = self.bench.problem.config;
        let Some(own) = self.normal(described, regressors) else { return f64::NEG_INFINITY };
        if is_unit {
            return own.scores.sum() - 0.5 * own.information.sum();
        }
        let Some(amplitudes) = own.amplitudes() else { return f64::NEG_INFINITY };
        let squares = amplitudes.dot(&own.scores).max(0.0);
        let of_kept = own.kept.iter().filter_map(|&place| candidate.amplitudes.get(place));
        ln_gain(squares, own.kept.len(), config) + ln_plausibility(of_kept, amplitudes.as_slice(), config)
    }

    /// Scores and information of regressors beside what is described. Those that are described already are left out, as the reference
    /// of a quantity where the sensor's constant is free; none where the first of them is.
    pub fn normal(&self, described: &Described<'_>, regressors: &[Regressor]) -> Option<Normal> {
        let (system, count, free) = (self.system(), regressors.len(), self.solved.free.len());
        let (mut scores, mut information) = (DVector::zeros(count), DMatrix::zeros(count, count));
        let mut with_free = DMatrix::zeros(free, count);
        for (i, regressor) in regressors.iter().enumerate() {
            let meets = |other: &&Regressor| other.parts.iter().any(|part| regressor.reaches(part.block));
            let with: Vec<f64> = (described.regressors.iter())
                .map(|other| if meets(other) { system.product(regressor, other) } else { 0.0 })
                .collect();
            let taken: f64 = with.iter().zip(self.solved.amplitudes.iter()).map(|(a, b)| a * b).sum();
            scores[i] = system.score(regressor) - taken;
            for (place, &number) in self.solved.free.iter().enumerate() {
                with_free[(place, i)] = with[number];
            }
            for (j, other) in regressors.iter().enumerate().take(i + 1) {
                information[(i, j)] = system.product(regressor, other);
            }
        }
        information.fill_upper_triangle_with_lower_triangle();
        let whole = information.diagonal();
        if free > 0 {
            for i in 0..count {
                let projected = self.solved.root.solve(&with_free.column(i).into_owned());
                for j in 0..count {
                    information[(i, j)] -= projected.dot(&with_free.column(j));
                }
            }
        }
        let least = self.bench.problem.config.least_information_left;
        let is_left = |&i: &usize| whole[i] > 0.0 && information[(i, i)] > least * whole[i];
        let kept: Vec<usize> = (0..count).filter(is_left).collect();
        if kept.first() != Some(&0) {
            return None;
        }
        if kept.len() < count {
            scores = scores.select_rows(&kept);
            information = information.select_rows(&kept).select_columns(&kept);
        }
        Some(Normal { kept, scores, information })
    }
}

/// Scores and information of regressors beside what is described.
pub struct Normal {
    /// Places of the regressors that are not left out.
    pub kept: Vec<usize>,
    /// Derivatives of the log-likelihood by the amplitudes at 0.
    pub scores: DVector<f64>,
    /// Its second derivatives, with the sign turned.
    pub information: DMatrix<f64>,
}

impl Normal {
    /// Amplitudes at their best.
    pub fn amplitudes(&self) -> Option<DVector<f64>> {
        Some(root_of(&self.information)?.solve(&self.scores))
    }

    /// Covariance of the amplitudes.
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        let root = root_of(&self.information)?;
        let size = self.kept.len();
        let column = |i: usize| root.solve(&DVector::from_fn(size, |j, _| f64::from(u8::from(i == j))));
        Some(DMatrix::from_columns(&(0..size).map(column).collect::<Vec<_>>()))
    }
}
