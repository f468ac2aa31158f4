//! Where the selection stands: terms, noises and which of their parameters are free, and everything whitened under it.
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::catalogue::{Candidate, NoiseChange};
use crate::description::{Filters, Projected, Sums, Term, project};
use crate::least_squares::{Solution, solve};
use crate::noise::{Knob, Noise};
use crate::noise_fit::{SourceKnob, polish, whitened_remainder};
use crate::nominal::Model;
use crate::spectrum::Spectrum;

/// What is searched.
pub struct Case<'c> {
    /// The nominal model.
    pub model: &'c Model,
    /// The candidates.
    pub candidates: &'c [Candidate],
    /// Time from the first row, s.
    pub time_s: &'c [f64],
}

/// A noise change that was accepted.
#[derive(Clone, Debug)]
pub struct Accepted {
    /// Its place among the candidates.
    pub candidate: usize,
    /// The source.
    pub source: usize,
    /// What changed.
    pub change: NoiseChange,
    /// Its parameters.
    pub knobs: Vec<Knob>,
    /// Degrees of freedom by which it is judged.
    pub freedom: usize,
    /// ln of the number of places where it was sought.
    pub ln_places: f64,
}

/// A description under selection.
#[derive(Clone, Debug)]
pub struct State {
    /// Deterministic terms.
    pub terms: Vec<Term>,
    /// Noise of every source.
    pub noises: Vec<Noise>,
    /// Noise changes that are findings.
    pub changes: Vec<Accepted>,
    /// Noise parameters that are fitted because the user says nothing of them.
    pub nuisances: Vec<SourceKnob>,
    /// Log-likelihood.
    pub log_likelihood: f64,
}

impl State {
    /// The free noise parameters of the sources of a block.
    pub fn free_in(&self, model: &Model, block: usize) -> Vec<SourceKnob> {
        let changed =
            self.changes.iter().flat_map(|change| change.knobs.iter().map(|&knob| (change.source, knob)));
        let mut free: Vec<SourceKnob> = changed.chain(self.nuisances.iter().copied()).collect();
        free.retain(|(source, _)| model.blocks[block].sources.contains(source));
        free.sort_by_key(|(source, knob)| (*source, format!("{knob:?}")));
        free.dedup();
        free
    }
}

/// A block whitened under a state.
pub struct Whitened {
    /// Data and regressors.
    pub projected: Projected,
    /// The same, whitened, data first.
    pub columns: Vec<Vec<f64>>,
    /// Whitened residual after the regressors.
    pub remainder: Vec<f64>,
    /// Log-likelihood with the regressors at this block's best.
    pub log_likelihood: f64,
}

/// All blocks whitened under a state.
pub struct Bench<'c> {
    /// What is searched.
    pub case: &'c Case<'c>,
    /// The filters.
    pub filters: Filters,
    /// The noises.
    pub noises: Vec<Noise>,
    /// The terms.
    pub terms: Vec<Term>,
    /// One a block; `None` where the filter is singular.
    pub blocks: Vec<Option<Whitened>>,
    /// Log-likelihood with all amplitudes at their best.
    pub log_likelihood: f64,
    /// The amplitudes.
    pub solution: Solution,
    normal: DMatrix<f64>,
    scores: DVector<f64>,
}

impl<'c> Bench<'c> {
    /// Whitens all blocks.
    pub fn new(case: &'c Case<'c>, terms: &[Term], noises: &[Noise]) -> Self {
        let model = case.model;
        let filters = Filters::new(model, noises);
        let blocks: Vec<Option<Whitened>> = (filters.of_block.par_iter().enumerate())
            .map(|(index, filter)| {
                let filter = filter.as_ref()?;
                let projected = project(model, index, terms);
                let views: Vec<&[f64]> =
                    std::iter::once(&projected.data).chain(&projected.columns).map(Vec::as_slice).collect();
                let columns = filter.whiten(&views);
                let log_likelihood = Sums::of_whitened(filter, &columns).best();
                let remainder = whitened_remainder(filter, &projected);
                Some(Whitened { projected, columns, remainder, log_likelihood })
            })
            .collect();
        let size = model.constants.len() + terms.iter().map(Term::amplitudes).sum::<usize>();
        let (mut normal, mut scores) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let mut log_likelihood = 0.0;
        for (filter, block) in filters.of_block.iter().zip(&blocks) {
            let (Some(filter), Some(block)) = (filter, block) else { continue };
            let sums = Sums::of_whitened(filter, &block.columns);
            log_likelihood += sums.log_likelihood;
            for (i, &row) in block.projected.places.iter().enumerate() {
                scores[row] += sums.scores[i];
                for (j, &column) in block.projected.places.iter().enumerate() {
                    normal[(row, column)] += sums.normal[(i, j)];
                }
            }
        }
        let solution = if size > 0 {
            solve(&normal, &scores)
        } else {
            Solution { gain: 0.0, amplitudes: DVector::zeros(0), covariance: DMatrix::zeros(0, 0), rank: 0 }
        };
        log_likelihood += solution.gain;
        Self {
            case,
            filters,
            noises: noises.to_vec(),
            terms: terms.to_vec(),
            blocks,
            log_likelihood,
            solution,
            normal,
            scores,
        }
    }

    /// What the log-likelihood gains by `term`, all amplitudes at their best; and the term's amplitudes' rank.
    pub fn gain_of(&self, term: &Term) -> (f64, usize) {
        let (gain, solution) = self.with_term(term);
        let freedom =
            if term.unit_amplitude { 1 } else { solution.rank.saturating_sub(self.solution.rank).max(1) };
        (gain, freedom)
    }

    /// What the log-likelihood gains by `term`, and all amplitudes, the term's last.
    pub fn with_term(&self, term: &Term) -> (f64, Solution) {
        let (joint, scores, offset) = self.with(term);
        if scores.is_empty() {
            return (offset, self.solution.clone());
        }
        let solution = solve(&joint, &scores);
        (solution.gain + offset - self.solution.gain, solution)
    }

    /// The smallest angle between the whitened signatures of two terms, degrees, what is described taken out of both.
    pub fn angle_deg(&self, a: &Term, b: &Term) -> f64 {
        let whole = |term: &Term| Term { unit_amplitude: false, ..term.clone() };
        let (a, b) = (whole(a), whole(b));
        let both = Term { columns: a.columns.iter().chain(&b.columns).cloned().collect(), ..a.clone() };
        let ports_differ = a.port != b.port;
        if ports_differ && self.case.model.blocks.len() > 1 {
            return 90.0;
        }
        let before = self.scores.len();
        let (n, m) = (a.columns.len(), b.columns.len());
        let normal = if ports_differ { self.crossed(&a, &b) } else { self.with(&both).0 };
        let own = normal.view((before, before), (n + m, n + m)).into_owned();
        let cross = normal.view((before, 0), (n + m, before)).into_owned();
        let inside = if before > 0 {
            &cross * &self.solution.covariance * cross.transpose()
        } else {
            own.clone() * 0.0
        };
        let left = own - inside;
        let half = |start: usize, size: usize| {
            let part = left.view((start, start), (size, size)).into_owned();
            part.symmetric_eigen()
        };
        let (first, second) = (half(0, n), half(n, m));
        let inverse_root = |eigen: &nalgebra::SymmetricEigen<f64, nalgebra::Dyn>| {
            let largest = eigen.eigenvalues.amax();
            let inverse = eigen.eigenvalues.map(|v| if v > 1e-9 * largest { v.sqrt().recip() } else { 0.0 });
            &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose()
        };
        let between = inverse_root(&first) * left.view((0, n), (n, m)) * inverse_root(&second);
        let cosine = between.svd(false, false).singular_values.amax();
        cosine.clamp(0.0, 1.0).acos().to_degrees()
    }

    /// The normal matrix with two terms that enter at different ports of one block.
    fn crossed(&self, a: &Term, b: &Term) -> DMatrix<f64> {
        let before = self.scores.len();
        let (n, m) = (a.columns.len(), b.columns.len());
        let size = before + n + m;
        let mut normal = DMatrix::zeros(size, size);
        normal.view_mut((0, 0), (before, before)).copy_from(&self.normal);
        let (Some(Some(block)), Some(Some(filter))) = (self.blocks.first(), self.filters.of_block.first())
        else {
            return normal;
        };
        let columns =
            a.columns.iter().map(|column| (column, a.port)).chain(b.columns.iter().map(|c| (c, b.port)));
        let parts: Vec<Vec<f64>> = columns
            .map(|(column, port)| self.case.model.blocks[0].project(column, port).unwrap_or_default())
            .collect();
        if parts.iter().any(Vec::is_empty) {
            return normal;
        }
        let views: Vec<&[f64]> = parts.iter().map(Vec::as_slice).collect();
        let whitened = filter.whiten(&views);
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        for (i, column) in whitened.iter().enumerate() {
            for (j, &other) in block.projected.places.iter().enumerate() {
                let sum = dot(column, &block.columns[j + 1]);
                normal[(before + i, other)] = sum;
                normal[(other, before + i)] = sum;
            }
            for (j, second) in whitened.iter().enumerate() {
                normal[(before + i, before + j)] = dot(column, second);
            }
        }
        normal
    }

    /// Normal matrix and scores with the term, and the change of the log-likelihood at amplitudes of zero.
    fn with(&self, term: &Term) -> (DMatrix<f64>, DVector<f64>, f64) {
        let before = self.scores.len();
        let size = before + term.amplitudes();
        let mut normal = DMatrix::zeros(size, size);
        normal.view_mut((0, 0), (before, before)).copy_from(&self.normal);
        let mut scores = DVector::zeros(size);
        scores.rows_mut(0, before).copy_from(&self.scores);
        let mut offset = 0.0;
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        for (index, block) in self.blocks.iter().enumerate() {
            let (Some(block), Some(filter)) = (block, &self.filters.of_block[index]) else { continue };
            let parts: Vec<(usize, Vec<f64>)> = (term.columns.iter().enumerate())
                .filter_map(|(place, column)| {
                    Some((place, self.case.model.blocks[index].project(column, term.port)?))
                })
                .collect();
            if parts.is_empty() {
                continue;
            }
            let views: Vec<&[f64]> = parts.iter().map(|(_, values)| values.as_slice()).collect();
            let whitened = filter.whiten(&views);
            let data = &block.columns[0];
            if term.unit_amplitude {
                for column in &whitened {
                    offset += dot(column, data);
                    offset -= 0.5 * whitened.iter().map(|other| dot(column, other)).sum::<f64>();
                    for (i, &row) in block.projected.places.iter().enumerate() {
                        scores[row] -= dot(column, &block.columns[i + 1]);
                    }
                }
                continue;
            }
            for ((place, _), column) in parts.iter().zip(&whitened) {
                let row = before + place;
                scores[row] += dot(column, data);
                for (i, &other) in block.projected.places.iter().enumerate() {
                    let sum = dot(column, &block.columns[i + 1]);
                    normal[(row, other)] += sum;
                    normal[(other, row)] += sum;
                }
                for ((other, _), second) in parts.iter().zip(&whitened) {
                    normal[(row, before + other)] += dot(column, second);
                }
            }
        }
        (normal, scores, offset)
    }

    /// Spectrum of a block's residual.
    pub fn spectrum(&self, block: usize) -> Option<Spectrum> {
        let (whitened, filter) = (self.blocks[block].as_ref()?, self.filters.of_block[block].as_ref()?);
        Some(Spectrum::new(&self.case.model.blocks[block], filter, &self.noises, &whitened.remainder))
    }
}

/// The state of `terms` with its free noise parameters at the maximum of the likelihood; blocks outside `only` keep
/// their noises.
pub fn refitted<'c>(case: &'c Case<'c>, state: &State, only: Option<&[usize]>) -> (State, Bench<'c>) {
    let mut bench = Bench::new(case, &state.terms, &state.noises);
    let mut state = state.clone();
    let mut moved = false;
    let fits: Vec<_> = (0..case.model.blocks.len())
        .into_par_iter()
        .filter_map(|index| {
            let free = state.free_in(case.model, index);
            if free.is_empty() || only.is_some_and(|only| !only.contains(&index)) {
                return None;
            }
            let spectrum = bench.spectrum(index)?;
            let whitened = bench.blocks[index].as_ref()?;
            let block = &case.model.blocks[index];
            let fit = polish(block, &spectrum, &whitened.projected, &state.noises, &free);
            (fit.log_likelihood > whitened.log_likelihood).then_some((index, fit))
        })
        .collect();
    for (index, fit) in fits {
        moved = true;
        for &source in &case.model.blocks[index].sources {
            state.noises[source] = fit.noises[source].clone();
        }
    }
    if moved {
        bench = Bench::new(case, &state.terms, &state.noises);
    }
    state.log_likelihood = bench.log_likelihood;
    (state, bench)
}
