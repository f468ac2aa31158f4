//! Amplitudes, trust and noise of a description in turn, and its evidence.
//!
//! ln E = Σ ln mean over ν of L(ν) of each block + prior of the amplitudes + ½ k ln 2π − ½ ln det of their information (Laplace) + what
//! parameters that are not linear and those of the noise cost + prior odds. Constants that nobody knows have a flat prior.
use std::borrow::Cow;
use std::sync::Arc;

use nalgebra::DVector;

use super::amplitude::{ln_plausibility, ln_prior};
use super::regressor::{Regressor, regressors};
use super::system::{Described, Solved, System, left_beside, root_of};
use crate::bands::sums::Sums;
use crate::catalogue::{Column, NoiseChange, Port};
use crate::description::{Delays, Term};
use crate::evidence::late::{delays_of, late_columns};
use crate::noise::fit::{Observed, SourceKnob};
use crate::noise::trust::ln_mean;
use crate::noise::weights::{Covariances, Weights};
use crate::noise::{Knob, Noise};
use crate::nominal::{Block, Source};
use crate::problem::Problem;

/// A deterministic effect in a description.
#[derive(Clone)]
pub struct Placed {
    /// The candidate with its parameters.
    pub term: Term,
    /// Its whitened columns; those without parts are described by something else.
    pub regressors: Arc<Vec<Regressor>>,
    /// Mean of the evidence over the parameters in which it is not linear, less the largest, nats.
    pub ln_spread: f64,
    /// How late it comes by the delays that are described.
    pub delays: Delays,
    /// Factor by which it multiplies the stated noise of its sensors; 1 where it leaves that as it is.
    pub noise_factor: f64,
}

impl Placed {
    /// An effect that no delay moves and that leaves the stated noise as it is.
    pub fn new(term: Term, regressors: Arc<Vec<Regressor>>, ln_spread: f64) -> Self {
        Self { term, regressors, ln_spread, delays: Delays::default(), noise_factor: 1.0 }
    }

    /// Whether it multiplies the noise of a source; where nothing is stated there is nothing to multiply.
    pub fn scales(&self, source: &Source) -> bool {
        self.noise_factor != 1.0
            && !source.unknown
            && source.port == self.term.port
            && self.term.sensors().contains(&source.sensor)
    }

    /// Places of the columns that nothing else describes.
    fn kept(&self) -> impl Iterator<Item = usize> {
        let kept = |(place, regressor): (usize, &Regressor)| (!regressor.parts.is_empty()).then_some(place);
        self.regressors.iter().enumerate().filter_map(kept)
    }
}

/// Another noise in a description.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Its place among the candidates.
    pub candidate: usize,
    /// The source.
    pub source: usize,
    /// What changes.
    pub kind: NoiseChange,
    /// Its parameters.
    pub knobs: Vec<Knob>,
    /// What those cost that the sums do not fit: where a level begins and its ratio.
    pub ln_cost: f64,
}

impl Change {
    /// Whether it is a white level in part of the rows, by which the record is whitened.
    pub fn is_level(&self) -> bool {
        self.knobs.contains(&Knob::StepRatio)
    }
}

/// What is known of a block under a description.
#[derive(Clone)]
pub struct BlockFit {
    /// Degrees of freedom of the levels of its bands that fit best.
    pub nu: f64,
    /// Mean of the likelihood over them, as a logarithm.
    pub log_likelihood: f64,
    /// What its free noise parameters cost.
    pub occam: f64,
    /// Standard deviations of their logarithms.
    pub sigmas: Vec<(SourceKnob, f64)>,
}

/// A set of items with everything that follows from it.
#[derive(Clone)]
pub struct Description {
    /// Deterministic effects.
    pub placed: Vec<Placed>,
    /// Changes of the noise.
    pub changes: Vec<Change>,
    /// Noise of every source.
    pub noises: Vec<Noise>,
    /// Noise parameters that are free because the case says nothing of them.
    pub nuisances: Vec<SourceKnob>,
    /// One a block.
    pub blocks: Vec<Option<BlockFit>>,
    /// What the bands of each block count.
    pub weights: Vec<Option<Weights>>,
    /// Amplitudes of the constants, then of every effect.
    pub amplitudes: DVector<f64>,
    /// Logarithm of the evidence.
    pub ln_evidence: f64,
}

/// What descriptions are made of and judged by.
pub struct Bench<'b> {
    /// What is explained.
    pub problem: &'b Problem<'b>,
    /// Sums of each block; none of one that is singular.
    pub sums: Vec<Option<Sums>>,
    /// Constants that nobody knows.
    pub constants: Vec<Regressor>,
    /// Their places among those of the model; those that reach nothing are left out.
    pub constant_places: Vec<usize>,
    /// Frequencies about which the bands of each block are narrow, rad a row.
    pub resolved: Vec<Vec<f64>>,
}

impl Description {
    /// Whether a candidate, by its place among all, is among the deterministic effects.
    pub fn has(&self, candidate: usize) -> bool {
        self.placed.iter().any(|placed| placed.term.candidate == candidate)
    }

    /// The noise of a source as the case states it, times what the effects multiply it by.
    pub fn stated(&self, problem: &Problem<'_>, source: usize) -> Noise {
        let source = &problem.model.sources[source];
        let of_it = |placed: &&Placed| placed.scales(source);
        source.nominal.times(self.placed.iter().filter(of_it).map(|placed| placed.noise_factor).product())
    }

    /// Constants and effects, in the order of the amplitudes.
    pub fn described<'d>(&'d self, bench: &'d Bench<'_>) -> Described<'d> {
        let mut described = Described::default();
        for constant in &bench.constants {
            described.regressors.push(constant);
            described.is_unit.push(false);
        }
        for placed in &self.placed {
            for regressor in placed.regressors.iter() {
                described.regressors.push(regressor);
                described.is_unit.push(placed.term.unit_amplitude);
            }
        }
        described
    }

    /// The free noise parameters of a block.
    pub fn free_in(&self, problem: &Problem<'_>, block: usize) -> Vec<SourceKnob> {
        let changed = self.changes.iter().flat_map(|it| it.knobs.iter().map(|&knob| (it.source, knob)));
        let changed = changed.filter(|(_, knob)| *knob != Knob::StepRatio);
        let mut free: Vec<SourceKnob> = Vec::new();
        for knob in self.nuisances.iter().copied().chain(changed) {
            if problem.model.blocks[block].sources.contains(&knob.0) && !free.contains(&knob) {
                free.push(knob);
            }
        }
        free
    }

    /// Amplitudes of the columns of each effect: 1 of those that have none, 0 of those that something else describes.
    pub fn amplitudes_of_effects(&self, bench: &Bench<'_>) -> Vec<Vec<f64>> {
        self.amplitudes_of_effects_at(bench, &self.amplitudes)
    }

    /// The same at given amplitudes of all regressors.
    pub fn amplitudes_of_effects_at(&self, bench: &Bench<'_>, amplitudes: &DVector<f64>) -> Vec<Vec<f64>> {
        let mut all = amplitudes.iter().skip(bench.constants.len());
        let mut of_effect = |placed: &Placed| {
            let own = placed.regressors.iter().zip(all.by_ref());
            own.map(|(regressor, value)| if regressor.parts.is_empty() { 0.0 } else { *value }).collect()
        };
        self.placed.iter().map(&mut of_effect).collect()
    }
}

impl<'b> Bench<'b> {
    /// The sums of all blocks whitened by given noises, with narrow bands about the frequencies `resolved` of each block.
    pub fn new(problem: &'b Problem<'b>, noises: &[Noise], resolved: Vec<Vec<f64>>) -> Self {
        let model = problem.model;
        let of_block =
            |(block, resolved): (&Block, &Vec<f64>)| Sums::new(block, noises, resolved, problem.config);
        let sums: Vec<Option<Sums>> = model.blocks.iter().zip(&resolved).map(of_block).collect();
        let (constant_places, constants) = regressors(model, &sums, &model.constants, Port::Output)
            .into_iter()
            .enumerate()
            .filter(|(_, constant)| !constant.parts.is_empty())
            .unzip();
        Self { problem, sums, constants, constant_places, resolved }
    }

    /// The description fitted in every block.
    pub fn fitted_whole(&self, description: &Description) -> Option<Description> {
        let is_there = |&block: &usize| self.sums[block].is_some();
        let blocks: Vec<usize> = (0..self.sums.len()).filter(is_there).collect();
        self.fitted(description, &blocks)
    }

    /// The description fitted where `touched`: the better of what two starts lead to, from full trust and from the weights that it
    /// has. None where it cannot be told from a part of itself.
    pub fn fitted(&self, description: &Description, touched: &[usize]) -> Option<Description> {
        let description = &*self.as_late(description);
        let trusting = self.with_full_trust(description, touched)?;
        let first = self.converged(trusting, touched);
        let is_robust =
            |&block: &usize| description.blocks[block].as_ref().is_some_and(|fit| fit.nu.is_finite());
        let second =
            if touched.iter().any(is_robust) { self.converged(description.clone(), touched) } else { None };
        match (first, second) {
            (Some(first), Some(second)) if second.ln_evidence > first.ln_evidence => Some(second),
            (Some(first), _) => Some(first),
            (None, second) => second,
        }
    }

    /// The description with the effects of the motion as late as its delays make the readings.
    fn as_late<'d>(&self, description: &'d Description) -> Cow<'d, Description> {
        let delays = delays_of(description.placed.iter());
        let of_term = |term: &Term| {
            if delays.move_term(term) { delays.among(&term.sensors()) } else { Delays::default() }
        };
        if description.placed.iter().all(|placed| placed.delays == of_term(&placed.term)) {
            return Cow::Borrowed(description);
        }
        let mut late = description.clone();
        for placed in &mut late.placed {
            let delays = of_term(&placed.term);
            if placed.delays != delays {
                let columns = late_columns(self.problem.model, &delays, &placed.term);
                placed.regressors = self.whitened_as(&columns, placed);
                placed.delays = delays;
            }
        }
        Cow::Owned(late)
    }

    /// The columns of an effect whitened; those that something else describes stay left out.
    pub fn whitened_as(&self, columns: &[Column], placed: &Placed) -> Arc<Vec<Regressor>> {
        let whitened = regressors(self.problem.model, &self.sums, columns, placed.term.port);
        let as_before = |(now, before): (Regressor, &Regressor)| {
            if before.parts.is_empty() { Regressor::default() } else { now }
        };
        Arc::new(whitened.into_iter().zip(placed.regressors.iter()).map(as_before).collect())
    }

    fn with_full_trust(&self, description: &Description, touched: &[usize]) -> Option<Description> {
        let mut trusting = description.clone();
        for &block in touched {
            let Some(sums) = &self.sums[block] else { continue };
            let covariances = Covariances::new(&self.problem.model.blocks[block], sums, &trusting.noises)?;
            trusting.weights[block] = Some(covariances.full_weights(sums));
            if let Some(fit) = &mut trusting.blocks[block] {
                fit.nu = f64::INFINITY;
            }
        }
        Some(trusting)
    }

    fn converged(&self, mut description: Description, touched: &[usize]) -> Option<Description> {
        let config = self.problem.config;
        let mut reached = f64::NEG_INFINITY;
        for round in 0..config.fit_rounds {
            let solved = self.solve(&description)?;
            description.amplitudes = solved.amplitudes;
            let mut total = 0.0;
            for &block in touched {
                total += self.fit_block(&mut description, block, round)?;
            }
            let gained = total - reached;
            reached = total;
            if gained.abs() < config.fit_tolerance {
                break;
            }
        }
        let solved = self.solve(&description)?;
        description.amplitudes.clone_from(&solved.amplitudes);
        description.ln_evidence = self.ln_evidence(&description, &solved)?;
        description.ln_evidence.is_finite().then_some(description)
    }

    /// Amplitudes under the weights of a description.
    pub fn solve(&self, description: &Description) -> Option<Solved> {
        let system = System { sums: &self.sums, weights: &description.weights };
        system.solve(&description.described(self))
    }

    /// Half the weighted squares that are left, with the sign turned, where an effect has other parameters, under the weights of a
    /// description: what its log-likelihood changes by. A delay moves the other effects of the motion.
    pub fn gain_at(&self, description: &Description, place: usize, point: &[f64]) -> f64 {
        let problem = self.problem;
        let mut moved = description.clone();
        let placed = &mut moved.placed[place];
        let candidate = &problem.candidates[placed.term.candidate];
        placed.term = placed.term.at(candidate, point, problem.time_s());
        let columns = late_columns(problem.model, &placed.delays, &placed.term);
        placed.regressors = self.whitened_as(&columns, placed);
        let moved = self.as_late(&moved);
        let Some(solved) = self.solve(&moved) else { return f64::NEG_INFINITY };
        let system = System { sums: &self.sums, weights: &description.weights };
        let described = moved.described(self);
        let of_block = |(index, weights): (usize, &Option<Weights>)| {
            let Some(weights) = weights else { return 0.0 };
            let power = system.power_left(index, &described, &solved.amplitudes);
            weights.of_channels.iter().zip(&power).map(|(weight, power)| weight.dot(power)).sum::<f64>()
        };
        -0.5 * description.weights.iter().enumerate().map(of_block).sum::<f64>()
    }

    /// Noise and trust of a block beside given amplitudes; its log-likelihood.
    fn fit_block(&self, description: &mut Description, index: usize, round: usize) -> Option<f64> {
        let config = self.problem.config;
        let Some(sums) = &self.sums[index] else { return Some(0.0) };
        let block = &self.problem.model.blocks[index];
        let system = System { sums: &self.sums, weights: &description.weights };
        let power = system.power_left(index, &description.described(self), &description.amplitudes);
        let free = description.free_in(self.problem, index);
        let mut nu = description.blocks[index].as_ref().map_or(f64::INFINITY, |fit| fit.nu);
        let (mut cost, mut sigmas) = (0.0, Vec::new());
        if !free.is_empty() {
            let noise_level_range = config.noise_level_range;
            let observed = Observed { block, sums, power: &power, nu, noise_level_range };
            let tolerance = if round == 0 { 0.1 } else { 0.5 * config.fit_tolerance };
            let fitted = observed.fit(&description.noises, &free, tolerance)?;
            description.noises = fitted.noises;
            cost = fitted.ln_cost;
            sigmas = free.iter().copied().zip(fitted.sigmas).collect();
        }
        let covariances = Covariances::new(block, sums, &description.noises)?;
        let by_trust: Vec<f64> =
            config.trust.iter().map(|&nu| covariances.log_likelihood(sums, &power, nu)).collect();
        if let Some(best) = (0..by_trust.len()).max_by(|&a, &b| by_trust[a].total_cmp(&by_trust[b])) {
            nu = config.trust[best];
        }
        description.weights[index] = Some(covariances.weights(sums, &power, nu));
        let log_likelihood = ln_mean(by_trust.iter().copied());
        description.blocks[index] = Some(BlockFit { nu, log_likelihood, occam: cost, sigmas });
        Some(log_likelihood)
    }

    /// The evidence of a description whose blocks are fitted.
    fn ln_evidence(&self, description: &Description, solved: &Solved) -> Option<f64> {
        let (problem, config) = (self.problem, self.problem.config);
        let mut sum: f64 =
            (description.blocks.iter().flatten()).map(|fit| fit.log_likelihood + fit.occam).sum();
        sum -= self.sums.iter().flatten().map(|sums| sums.half_log_determinant).sum::<f64>();
        sum -= 0.5 * solved.root.ln_determinant();
        let constants = self.constants.len();
        let of_constants = solved.normal.view((0, 0), (constants, constants)).into_owned();
        let constant_root = if constants > 0 { Some(root_of(&of_constants)?) } else { None };
        let mut first = constants;
        let mut amplitude_at = constants;
        for placed in &description.placed {
            let own: Vec<usize> = placed.kept().collect();
            let values: Vec<f64> =
                own.iter().map(|place| description.amplitudes[amplitude_at + place]).collect();
            amplitude_at += placed.regressors.len();
            let count = own.len();
            let candidate = &problem.candidates[placed.term.candidate];
            sum += placed.ln_spread + problem.ln_prior[placed.term.candidate];
            if placed.term.unit_amplitude {
                continue;
            }
            let products = solved.normal.view((first, first), (count, count)).into_owned();
            let with_constants = solved.normal.view((0, first), (constants, count)).into_owned();
            first += count;
            let information = match &constant_root {
                Some(root) => left_beside(products, &with_constants, root),
                None => products,
            };
            let amplitudes = DVector::from_column_slice(&values);
            let squares = (information.clone() * &amplitudes).dot(&amplitudes).max(0.0);
            sum += ln_prior(squares, count, config) + 0.5 * root_of(&information)?.ln_determinant();
            sum += 0.5 * count as f64 * (2.0 * std::f64::consts::PI).ln();
            let of_own = own.iter().filter_map(|&place| candidate.amplitudes.get(place));
            sum += ln_plausibility(of_own, &values, config);
        }
        let of_changes = description.changes.iter();
        sum += of_changes.map(|it| problem.ln_prior[it.candidate] + it.ln_cost).sum::<f64>();
        Some(sum)
    }
}
