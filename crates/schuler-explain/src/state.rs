//! Where the selection stands: terms, noises and which of their parameters are free, and everything whitened under it.
use std::borrow::Cow;
use std::collections::VecDeque;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::catalogue::{Candidate, NoiseChange, Port, Search};
use crate::common_motion::CommonMotion;
use crate::description::{
    Delays, Filters, Projected, Sums, Term, at_sensors, blocks_of, evaluate, places, project, solve_or_none,
    take_off,
};
use crate::jump::Decoded;
use crate::least_squares::{Solution, dot, solve};
use crate::library::Products;
use crate::noise::{Knob, Noise};
use crate::noise_change::{ChangeFit, PromisedStart};
use crate::noise_fit::{NoiseFit, Observations, SourceKnob, polish};
use crate::nominal::Model;
use crate::search::Refined;
use crate::spectrum::Spectrum;
use crate::watch::Watch;
use crate::whiten::Filter;

/// Values of whitened blocks, the gains of their filters among them, that are kept beside those in use.
const KEPT_VALUES: usize = 1 << 25;

/// What is searched.
pub struct Case<'c> {
    /// The nominal model.
    pub model: &'c Model,
    /// The candidates.
    pub candidates: &'c [Candidate],
    /// Time from the first row, s.
    pub time_s: &'c [f64],
    /// Who watches.
    pub watch: &'c dyn Watch,
    /// Blocks whitened before, the last one used first: most descriptions differ from the one before in one block.
    kept: Mutex<VecDeque<(Key, Arc<Whitened>)>>,
    /// Noises that were fitted, by what they were fitted to and their free parameters.
    fits: Memo<(Key, Vec<SourceKnob>), NoiseFit>,
    /// What changes of a source's noise promised.
    pub(crate) promised: Memo<(Key, usize, NoiseChange), Vec<PromisedStart>>,
    /// Changes of a source's noise that were fitted.
    pub(crate) changes: Memo<(Key, usize, NoiseChange), Option<ChangeFit>>,
    /// Standard deviations of the logarithms of free noise parameters.
    pub(crate) sigmas: Memo<(Key, Vec<SourceKnob>), DVector<f64>>,
    /// Histories of the jumps of a sensor.
    pub(crate) jumps: Memo<(Key, usize), Option<Decoded>>,
    /// Where promises of candidates led.
    pub(crate) refined: Memo<Sought, Option<Refined>>,
    /// Sums of products of whitened signatures, which depend on the noises and the delays of a block alone.
    pub(crate) products: Memo<(usize, Vec<Noise>, Delays), Arc<Products>>,
}

/// What was computed before. The same descriptions come up again: when an item is taken out to see what it shows, when
/// the search is done in another order, and when the findings are told.
pub struct Memo<K, V>(Mutex<Vec<(K, V)>>);

impl<K: PartialEq, V: Clone> Memo<K, V> {
    fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// The value of a key, computed if it was not.
    pub fn get_or(&self, key: K, compute: impl FnOnce() -> V) -> V {
        self.get_or_if(key, compute, |_| true)
    }

    /// The same, kept if it `is_final`.
    fn get_or_if(&self, key: K, compute: impl FnOnce() -> V, is_final: impl FnOnce(&V) -> bool) -> V {
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, value)) = known().iter().find(|(other, _)| *other == key) {
            return value.clone();
        }
        let value = compute();
        if is_final(&value) {
            known().push((key, value.clone()));
        }
        value
    }
}

/// What tells a term from all others: its candidate, its parameters, and a mark of the readings that it was made from.
type Name = (usize, Vec<f64>, u64);

/// What a whitened block depends on: its place, its noises, and the terms that reach it.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    block: usize,
    noises: Vec<Noise>,
    terms: Vec<Name>,
}

/// A candidate, the points from which its parameters are refined, how finely if at all, and what its gain depends on.
type Sought = (usize, Vec<Vec<f64>>, Option<f64>, Vec<Key>);

/// What a block's signatures are multiplied with.
#[derive(Clone, Debug, PartialEq)]
pub enum Described {
    /// The data less the terms of unit amplitude.
    Data(Vec<Name>),
    /// A constant, by its place among the model's.
    Constant(usize),
    /// A column of a term, by its place among the term's.
    Column(Name, usize),
}

impl<'c> Case<'c> {
    /// A case to be searched.
    pub fn new(
        model: &'c Model,
        candidates: &'c [Candidate],
        time_s: &'c [f64],
        watch: &'c dyn Watch,
    ) -> Self {
        Self {
            model,
            candidates,
            time_s,
            watch,
            kept: Mutex::new(VecDeque::new()),
            fits: Memo::new(),
            promised: Memo::new(),
            changes: Memo::new(),
            sigmas: Memo::new(),
            jumps: Memo::new(),
            refined: Memo::new(),
            products: Memo::new(),
        }
    }

    /// What tells terms of a candidate apart whose signature was made from the readings and not from parameters.
    fn mark(&self, term: &Term) -> u64 {
        let of_readings = |candidate: &Candidate| matches!(candidate.search, Search::Readings(_));
        if !self.candidates.get(term.candidate).is_some_and(of_readings) {
            return 0;
        }
        let mut hasher = DefaultHasher::new();
        for (sensor, values) in term.columns.iter().flat_map(|column| &column.parts) {
            sensor.hash(&mut hasher);
            for value in &**values {
                value.to_bits().hash(&mut hasher);
            }
        }
        hasher.finish()
    }

    /// What a block depends on under a description.
    fn key(&self, index: usize, terms: &[Term], noises: &[Noise]) -> Key {
        let block = &self.model.blocks[index];
        let reaches = |term: &&Term| term.columns.iter().any(|c| block.is_reached(c, term.port));
        Key {
            block: index,
            noises: block.sources.iter().map(|&source| noises[source].clone()).collect(),
            terms: terms.iter().filter(reaches).map(|term| self.name(term)).collect(),
        }
    }

    fn name(&self, term: &Term) -> Name {
        (term.candidate, term.nonlinear.clone(), self.mark(term))
    }

    /// The data of a block and its regressors, in the order of its whitened columns.
    pub(crate) fn described(&self, index: usize, terms: &[Term]) -> Vec<Described> {
        let block = &self.model.blocks[index];
        let reached = |term: &Term| -> Vec<usize> {
            let columns = term.columns.iter().enumerate();
            columns
                .filter(|(_, column)| block.is_reached(column, term.port))
                .map(|(place, _)| place)
                .collect()
        };
        let (taken_off, fitted): (Vec<&Term>, Vec<&Term>) =
            (terms.iter()).filter(|term| !reached(term).is_empty()).partition(|term| term.unit_amplitude);
        let data = Described::Data(taken_off.into_iter().map(|term| self.name(term)).collect());
        let constants = (self.model.constants.iter().enumerate())
            .filter(|(_, column)| block.is_reached(column, Port::Output))
            .map(|(place, _)| Described::Constant(place));
        let columns = fitted.into_iter().flat_map(|term| {
            let name = self.name(term);
            reached(term).into_iter().map(move |place| Described::Column(name.clone(), place))
        });
        std::iter::once(data).chain(constants).chain(columns).collect()
    }

    /// A block whitened; `None` where its noises are singular.
    fn whitened(&self, index: usize, terms: &[Term], noises: &[Noise]) -> Option<Arc<Whitened>> {
        let block = &self.model.blocks[index];
        let key = self.key(index, terms, noises);
        {
            let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(place) = kept.iter().position(|(other, _)| *other == key)
                && let Some(found) = kept.remove(place)
            {
                let whitened = Arc::clone(&found.1);
                kept.push_front(found);
                return Some(whitened);
            }
        }
        let described = self.described(index, terms);
        let delays = Delays::new(terms).among(&block.sensors);
        // Under the same noises the filter is the same, and so are the columns that another description has as well.
        let alike = self.kept_under(&key, &delays);
        let filter = match &alike {
            Some(alike) => Arc::clone(&alike.filter),
            None => Arc::new(block.filter(noises)?),
        };
        let places: Vec<Option<usize>> = match &alike {
            Some(alike) => {
                let place = |one: &Described| alike.described.iter().position(|other| other == one);
                described.iter().map(place).collect()
            }
            None => vec![None; described.len()],
        };
        let projected = project(self.model, index, terms);
        let views = std::iter::once(&projected.data).chain(&projected.columns).map(Vec::as_slice);
        let new: Vec<&[f64]> =
            views.zip(&places).filter(|(_, place)| place.is_none()).map(|(view, _)| view).collect();
        let mut whitened_now = filter.whiten(&new).into_iter();
        let columns: Vec<Vec<f64>> = (places.iter())
            .map(|place| match (place, &alike) {
                (Some(place), Some(alike)) => alike.columns[*place].clone(),
                _ => whitened_now.next().unwrap_or_default(),
            })
            .collect();
        let sums = Sums::beside(&filter, &columns, |i, j| {
            let (alike, i, j) = (alike.as_ref()?, places[i]?, places[j]?);
            Some(alike.sums.product(i, j))
        });
        let solution = sums.solution();
        let log_likelihood = sums.log_likelihood + solution.gain;
        let (data, regressors) = columns.split_first()?;
        let mut remainder = data.clone();
        take_off(&mut remainder, regressors, solution.amplitudes.iter().copied());
        let (common, told_beside) = self.told_beside(index, terms, noises, &solution.amplitudes);
        let whitened = Arc::new(Whitened {
            filter,
            projected,
            described,
            delays,
            columns,
            sums,
            remainder,
            spectrum: OnceLock::new(),
            common: common.map_or_else(OnceLock::new, |common| Some(common).into()),
            log_likelihood,
            told_beside,
        });
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.push_front((key, Arc::clone(&whitened)));
        let (mut values, mut number) = (0, 0);
        kept.retain(|(_, whitened)| {
            values += (2 * whitened.columns.len() + 1) * whitened.remainder.len() + whitened.filter.values();
            number += 1;
            values <= KEPT_VALUES || number == 1
        });
        Some(whitened)
    }

    /// What the readings of a block of redundant sensors tell of terms, at amplitudes as [`Projected::columns`], and noises beside the residuals,
    /// log-likelihood; and the readings without the terms, if it took them.
    ///
    /// Noises are judged by the readings without the terms. Of terms only lines: noise of a narrow band that may stand for one is told of by the
    /// same readings. What is slow has all its power in a few of a band's frequencies, of which the motion may have as much.
    fn told_beside(
        &self,
        index: usize,
        terms: &[Term],
        noises: &[Noise],
        amplitudes: &DVector<f64>,
    ) -> (Option<CommonMotion>, f64) {
        let Some(common) = self.model.common_motion_of(index) else { return (None, 0.0) };
        let without = |wanted: &dyn Fn(&Term) -> bool| {
            common.without(&at_sensors(self.model, index, terms, amplitudes, wanted))
        };
        let nominal = self.model.nominal_noises();
        let is_line = |term: &Term| matches!(self.candidates[term.candidate].search, Search::Frequency);
        let of_lines = if terms.iter().any(is_line) {
            without(&is_line).beside_residual(&nominal) - common.beside_residual(&nominal)
        } else {
            0.0
        };
        if common.sources.iter().all(|&source| noises[source] == nominal[source]) {
            return (None, of_lines);
        }
        let left = without(&|_| true);
        let of_noises = left.beside_residual(noises) - left.beside_residual(&nominal);
        (Some(left), of_lines + of_noises)
    }

    /// The block as it was whitened last under the same noises, with the same delays.
    fn kept_under(&self, key: &Key, delays: &Delays) -> Option<Arc<Whitened>> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let alike = kept.iter().find(|(other, whitened)| {
            other.block == key.block && other.noises == key.noises && whitened.delays == *delays
        });
        alike.map(|(_, whitened)| Arc::clone(whitened))
    }
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
    /// What of it readings tell of terms and noises beside the residuals ([`Whitened::told_beside`]).
    pub told_beside: f64,
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
    /// The filter.
    pub filter: Arc<Filter>,
    /// Data and regressors.
    pub projected: Projected,
    /// What they are, data first, and the delays that move them.
    described: Vec<Described>,
    delays: Delays,
    /// The same, whitened, data first.
    pub columns: Vec<Vec<f64>>,
    /// Sums of the whitened columns.
    pub sums: Sums,
    /// Whitened residual after the regressors.
    pub remainder: Vec<f64>,
    spectrum: OnceLock<Spectrum>,
    /// The readings without the terms, if they are redundant.
    common: OnceLock<Option<CommonMotion>>,
    /// Log-likelihood with the regressors at this block's best.
    pub log_likelihood: f64,
    /// What the readings tell of the terms and the noises beside the residuals.
    pub told_beside: f64,
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
    pub blocks: Vec<Option<Arc<Whitened>>>,
    /// Places of each block's regressors among all amplitudes.
    pub places: Vec<Vec<usize>>,
    /// Log-likelihood with all amplitudes at their best, and with what the readings of redundant sensors tell beside it.
    pub log_likelihood: f64,
    /// What of it they tell.
    pub told_beside: f64,
    /// The amplitudes.
    pub solution: Solution,
    normal: DMatrix<f64>,
    scores: DVector<f64>,
}

impl<'c> Bench<'c> {
    /// Whitens all blocks.
    pub fn new(case: &'c Case<'c>, terms: &[Term], noises: &[Noise]) -> Self {
        let model = case.model;
        let blocks: Vec<Option<Arc<Whitened>>> = (0..model.blocks.len())
            .into_par_iter()
            .map(|index| case.whitened(index, terms, noises))
            .collect();
        let filters = Filters {
            of_block: blocks
                .iter()
                .map(|block| block.as_ref().map(|block| Arc::clone(&block.filter)))
                .collect(),
        };
        let places: Vec<Vec<usize>> =
            (0..model.blocks.len()).map(|index| places(model, index, terms)).collect();
        let size = model.constants.len() + terms.iter().map(Term::amplitudes).sum::<usize>();
        let (mut normal, mut scores) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let told_beside = blocks.iter().flatten().map(|block| block.told_beside).sum();
        let mut log_likelihood = told_beside;
        for (block, places) in blocks.iter().zip(&places) {
            let Some(block) = block else { continue };
            let sums = &block.sums;
            log_likelihood += sums.log_likelihood;
            for (i, &row) in places.iter().enumerate() {
                scores[row] += sums.scores[i];
                for (j, &column) in places.iter().enumerate() {
                    normal[(row, column)] += sums.normal[(i, j)];
                }
            }
        }
        let solution = solve_or_none(&normal, &scores);
        log_likelihood += solution.gain;
        Self {
            case,
            filters,
            noises: noises.to_vec(),
            terms: terms.to_vec(),
            blocks,
            places,
            log_likelihood,
            told_beside,
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
    ///
    /// A delay moves what is there of the motion, so that all is computed anew beside it.
    pub fn with_term(&self, term: &Term) -> (f64, Solution) {
        let delays = Delays::new(std::slice::from_ref(term));
        if self.terms.iter().any(|other| delays.move_term(other)) {
            let mut terms = self.terms.clone();
            terms.push(term.clone());
            let filtered = (0..self.blocks.len()).filter(|&block| self.filters.of_block[block].is_some());
            let blocks: Vec<usize> = filtered.collect();
            return match evaluate(self.case.model, &self.filters, &terms, &blocks) {
                Some(all) => {
                    let with = all.log_likelihood + self.told_beside;
                    (with - self.log_likelihood, all.solution)
                }
                None => (f64::NEG_INFINITY, self.solution.clone()),
            };
        }
        let (joint, scores, offset) = self.with(term);
        if scores.is_empty() {
            return (offset, self.solution.clone());
        }
        let solution = solve(&joint, &scores);
        (solution.gain + offset - self.solution.gain, solution)
    }

    /// The same with what the readings of redundant sensors tell of the term beside their residuals.
    pub fn gain_by_readings(&self, term: &Term) -> f64 {
        let model = self.case.model;
        let reached = blocks_of(model, std::slice::from_ref(term));
        if reached.iter().all(|&block| model.common_motion_of(block).is_none()) {
            return self.gain_of(term).0;
        }
        let terms = [self.terms.as_slice(), std::slice::from_ref(term)].concat();
        Bench::new(self.case, &terms, &self.noises).log_likelihood - self.log_likelihood
    }

    /// What a term at its fitted amplitudes gains in a block at most: half its whitened energy there. Without bound where its
    /// amplitude is no coefficient, as of a delay.
    pub fn energy_in(&self, block: usize, place: usize) -> f64 {
        let Some(term) = self.terms.get(place).filter(|term| !term.unit_amplitude) else {
            return f64::INFINITY;
        };
        let Some(Some(whitened)) = self.blocks.get(block) else { return 0.0 };
        let before: usize = self.terms[..place].iter().map(Term::amplitudes).sum();
        let first = self.case.model.constants.len() + before;
        let own = first..first + term.columns.len();
        let of_term = || self.places[block].iter().enumerate().filter(|(_, place)| own.contains(*place));
        let amplitude = |place: &usize| self.solution.amplitudes.get(*place).copied().unwrap_or_default();
        let products = of_term().flat_map(|(i, a)| {
            of_term().map(move |(j, b)| amplitude(a) * amplitude(b) * whitened.sums.normal[(i, j)])
        });
        0.5 * products.sum::<f64>()
    }

    /// The smallest angle between the whitened signatures of two terms, degrees, what is described taken out of both.
    pub fn angle_deg(&self, a: &Term, b: &Term) -> f64 {
        let (model, delays) = (self.case.model, Delays::new(&self.terms));
        let whole = |term: &Term| Term { unit_amplitude: false, ..delays.late_term(model, term) };
        let (a, b) = (whole(a), whole(b));
        let columns = Arc::new(a.columns.iter().chain(&*b.columns).cloned().collect());
        let both = Term { columns, ..a.clone() };
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
        let model = self.case.model;
        let parts: Option<Vec<_>> =
            columns.map(|(column, port)| model.blocks[0].project(column, port)).collect();
        let Some(parts) = parts else { return normal };
        let views: Vec<&[f64]> = parts.iter().map(AsRef::as_ref).collect();
        let whitened = filter.whiten(&views);
        for (i, column) in whitened.iter().enumerate() {
            for (j, &other) in self.places[0].iter().enumerate() {
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
        let delays = Delays::new(&self.terms);
        let columns: Vec<_> = (term.columns.iter())
            .map(|column| delays.late(self.case.model, term.of_the_motion, column))
            .collect();
        for (index, block) in self.blocks.iter().enumerate() {
            let (Some(block), Some(filter)) = (block, &self.filters.of_block[index]) else { continue };
            let parts: Vec<(usize, Cow<'_, [f64]>)> = (columns.iter().enumerate())
                .filter_map(|(place, column)| {
                    Some((place, self.case.model.blocks[index].project(column, term.port)?))
                })
                .collect();
            if parts.is_empty() {
                continue;
            }
            let views: Vec<&[f64]> = parts.iter().map(|(_, values)| values.as_ref()).collect();
            let whitened = filter.whiten(&views);
            let data = &block.columns[0];
            if term.unit_amplitude {
                for column in &whitened {
                    offset += dot(column, data);
                    offset -= 0.5 * whitened.iter().map(|other| dot(column, other)).sum::<f64>();
                    for (i, &row) in self.places[index].iter().enumerate() {
                        scores[row] -= dot(column, &block.columns[i + 1]);
                    }
                }
                continue;
            }
            for ((place, _), column) in parts.iter().zip(&whitened) {
                let row = before + place;
                scores[row] += dot(column, data);
                for (i, &other) in self.places[index].iter().enumerate() {
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
    pub fn spectrum(&self, block: usize) -> Option<&Spectrum> {
        let whitened = self.blocks[block].as_ref()?;
        let (block, filter) = (&self.case.model.blocks[block], &whitened.filter);
        Some(
            whitened.spectrum.get_or_init(|| Spectrum::new(block, filter, &self.noises, &whitened.remainder)),
        )
    }

    /// What the noises of a block are fitted to.
    pub fn observations(&self, block: usize) -> Option<Observations<'_>> {
        let whitened = self.blocks[block].as_ref()?;
        let common = || {
            let common = self.case.model.common_motion_of(block)?;
            let amplitudes = whitened.sums.solution().amplitudes;
            Some(common.without(&at_sensors(self.case.model, block, &self.terms, &amplitudes, &|_| true)))
        };
        Some(Observations {
            block: &self.case.model.blocks[block],
            spectrum: self.spectrum(block)?,
            projected: &whitened.projected,
            common: whitened.common.get_or_init(common).as_ref(),
        })
    }

    /// What a block depends on.
    pub fn key(&self, block: usize) -> Key {
        self.case.key(block, &self.terms, &self.noises)
    }
}

/// The state of `terms` with its free noise parameters at the maximum of the likelihood; blocks outside `only` keep
/// their noises.
pub fn refitted<'c>(case: &'c Case<'c>, state: &State, only: Option<&[usize]>) -> (State, Bench<'c>) {
    refitted_above(case, state, only, f64::NEG_INFINITY)
}

/// The same where it is enough to know that the log-likelihood stays below `least`, if it does: a fit that shows so ends there.
pub fn refitted_above<'c>(
    case: &'c Case<'c>,
    state: &State,
    only: Option<&[usize]>,
    least: f64,
) -> (State, Bench<'c>) {
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
            let whitened = bench.blocks[index].as_ref()?;
            let observations = bench.observations(index)?;
            let here = whitened.log_likelihood + observations.beside_residuals(&state.noises);
            let least = here + least - bench.log_likelihood;
            let fit = case.fits.get_or_if(
                (bench.key(index), free.clone()),
                || {
                    let known = (whitened.log_likelihood, whitened.sums.solution().amplitudes);
                    polish(observations, &state.noises, &free, least, Some(known))
                },
                // One that ended early is no maximum.
                |fit| fit.log_likelihood >= least,
            );
            (fit.log_likelihood > here).then_some((index, fit))
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
    (state.log_likelihood, state.told_beside) = (bench.log_likelihood, bench.told_beside);
    (state, bench)
}
