//! All candidates' signatures through the filter, once: scores, norms and correlations, from which everything else is
//! linear algebra.
//!
//! Every point of a candidate's grid is an *entry* of one or more columns. Its scores with the data and its products with
//! the regressors are those of the column itself with R⁻¹ of them, one adjoint pass each. Its products with the other
//! columns of its entry are of whitened columns, which live in single precision until they are taken; what is decided by
//! them is computed again exactly. All these products are kept by the noises and by what they were taken with, so that the
//! signature of an entry is made again only for noises or regressors that are new. The correlations of all columns, which
//! the null distribution and pairs of entries need, are those of their sketches: rows with random signs summed into `SKETCH` places
//! (Charikar, Chen & Farach-Colton 2004), by which a correlation ρ has a standard deviation of (1 − ρ²)/√`SKETCH`; a record
//! that is no longer is exact. Memory is that of a few columns, of R⁻¹ of the data and of each regressor at each sensor, the products, the sketches and, where
//! pairs are sought, their correlations twice over, and the work grows as the length.
use std::borrow::Cow;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use nalgebra::{DMatrix, DVector};
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::catalogue::{Candidate, Column, OnsetShape, Port, Search, Signature};
use crate::description::{Delays, Term, columns, sensors_of};
use crate::inputs::series::Series;
use crate::least_squares::{dot, solve, solve_seen};
use crate::nominal::{Block, Model};
use crate::price::{continuous, ln_number_of_mean, ln_places_at};
use crate::state::{Bench, Described, Whitened};
use crate::statistics::ln_chi_squared_tail;

/// Ports of a sensor.
const PORTS: usize = 3;
/// Rows that are multiplied at a time.
const TILE_ROWS: usize = 1024;
/// Columns that are whitened at a time by each thread.
const BATCH: usize = 8;
/// Length of a column's sketch.
const SKETCH: usize = 4096;
/// Columns of a block from which on draws are made of the sketches themselves and not of a root of their correlations.
const MANY_COLUMNS: usize = 1500;
/// Values of signatures over several blocks that are kept at a time.
const SHARED_VALUES: usize = 1 << 24;
/// Part of a column's norm that must be left when what is already described is taken out.
const SEEN: f64 = 1e-4;
/// Eigenvalue below which a combination of an entry's columns is not seen.
const SEEN_COMBINATION: f64 = 1e-5;
/// Ratio of squared lengths by sketches and by exact products up to which a column takes part in pairs.
const MOST_APART: f64 = 2.0;
/// Added to the diagonal so that a normal matrix of collinear columns has a root.
const JITTER: f64 = 1e-5;
/// Records drawn for the null distribution.
const DRAWS: usize = 600;
/// Records that are drawn in one product of matrices.
const DRAWN_TOGETHER: usize = 25;
/// Order statistic beyond which the tail is taken as exponential.
const TAIL_DRAWS: usize = 20;
/// Onsets that take part in pairs.
const ONSETS: usize = 24;
/// Part of a signature that must be left beside another for a pair of them: two that are more alike would stand for their difference,
/// which is neither.
pub const FURTHEST_ALIKE: f64 = 0.05;
/// Seed of the draws.
const SEED: u64 = 0x5c1d;

/// A candidate at a point of its grid.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Its place among the candidates.
    pub candidate: usize,
    /// The number of the point.
    pub number: usize,
    /// The point.
    pub point: Vec<f64>,
    /// Its first column.
    pub first: usize,
    /// Its number of columns.
    pub columns: usize,
    /// Whether its amplitudes are 1.
    pub unit_amplitude: bool,
}

/// Whitened columns of a block, reduced.
struct BlockSums {
    /// Place in `scores` by column; regressors first.
    place: Vec<Option<usize>>,
    scores: DVector<f64>,
    /// Products with the regressors, and with the columns of the same entry from its first to itself.
    with_regressors: Vec<Vec<f64>>,
    with_entry: Vec<Vec<f64>>,
    sketches: Vec<Vec<f32>>,
    /// Correlations of all columns by their sketches, once they were asked for.
    correlations: OnceLock<DMatrix<f64>>,
}

/// The library under one set of noises, beside given regressors.
pub struct Library {
    /// The entries.
    pub entries: Vec<Entry>,
    /// Columns of the constants and of each term of the description.
    constants: Range<usize>,
    terms: Vec<Range<usize>>,
    /// Columns beside which the entries are, and what they gain.
    regressors: Vec<usize>,
    described: f64,
    blocks: Vec<BlockSums>,
    prepared: Vec<Prepared>,
}

/// An entry in one block, what is described taken out: orthonormal columns.
struct Direction {
    entry: usize,
    scores: DVector<f64>,
    /// Places of the entry's columns in the block, and what makes orthonormal columns of those of unit length.
    places: Vec<usize>,
    root: DMatrix<f64>,
}

impl Direction {
    fn alone(&self) -> f64 {
        0.5 * self.scores.norm_squared()
    }

    /// What both gain, by the correlations of the block's columns; none where they are nearly the same.
    fn gain_with(&self, other: &Self, correlations: &DMatrix<f64>) -> Option<f64> {
        if let ([own], [others]) = (self.places.as_slice(), other.places.as_slice()) {
            let between = self.root[(0, 0)] * correlations[(*own, *others)] * other.root[(0, 0)];
            let (left, beside) = (1.0 - between * between, other.scores[0] - between * self.scores[0]);
            return (left >= FURTHEST_ALIKE).then(|| self.alone() + 0.5 * beside * beside / left);
        }
        let of_columns = DMatrix::from_fn(self.places.len(), other.places.len(), |i, j| {
            correlations[(self.places[i], other.places[j])]
        });
        let between = &self.root * of_columns * other.root.transpose();
        let beside = &other.scores - between.transpose() * &self.scores;
        let left = DMatrix::identity(beside.len(), beside.len()) - between.transpose() * between;
        if left.symmetric_eigenvalues().min() < FURTHEST_ALIKE {
            return None;
        }
        let further = left.cholesky()?.solve(&beside).dot(&beside);
        Some(self.alone() + 0.5 * further)
    }
}

/// An entry with the regressors projected out.
struct Prepared {
    /// G_er G_rr⁻¹.
    projection: DMatrix<f64>,
    normal: DMatrix<f64>,
    rank: usize,
    /// Inverse of the normal matrix.
    inverse: DMatrix<f64>,
}

/// How joint scores of unit variance come from independent normals.
enum Root<'s> {
    /// By Cholesky's root of their correlations.
    Correlations(DMatrix<f64>),
    /// By the sketches of their columns.
    Sketches(&'s [Vec<f32>]),
}

impl Root<'_> {
    /// Scores, one column a draw, each from a source of its own.
    fn draw(&self, size: usize, random: &mut [Pcg64]) -> DMatrix<f64> {
        match self {
            Self::Correlations(root) => root * normals(size, random),
            Self::Sketches(sketches) => {
                let normal = |random: &mut Pcg64| -> Vec<f32> {
                    (0..sketches.first().map_or(0, Vec::len)).map(|_| StandardNormal.sample(random)).collect()
                };
                let independent: Vec<Vec<f32>> = random.iter_mut().map(normal).collect();
                let of = |sketch: &Vec<f32>| -> Vec<f64> {
                    independent.iter().map(|normals| tiled_dot(sketch, normals)).collect()
                };
                DMatrix::from_row_iterator(size, independent.len(), sketches.iter().flat_map(of))
            }
        }
    }
}

/// Independent normals, one column for each source.
fn normals(rows: usize, random: &mut [Pcg64]) -> DMatrix<f64> {
    let columns = random.len();
    let values = random.iter_mut().flat_map(|random| (0..rows).map(|_| StandardNormal.sample(random)));
    DMatrix::from_iterator(rows, columns, values)
}

/// What an entry gains.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// Gain in log-likelihood.
    pub gain: f64,
    /// Degrees of freedom.
    pub freedom: usize,
}

/// Two entries of a block, and what they gain.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Their places in the library.
    pub entries: [usize; 2],
    /// Gain of both, by the correlation of their sketches.
    pub gain: f64,
    /// Gain of each alone.
    pub alone: [f64; 2],
}

/// What a library is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// What each entry gains.
    Gains,
    /// What the best of all would gain where nothing is hidden, and so with their correlations.
    NullDistribution,
    /// What one entry or two gain in the place of others, onsets at some times among them.
    Pairs,
}

/// Null distribution of the best of all candidates.
pub struct NullDistribution {
    /// ln of the effective number of points of each candidate's grid.
    pub ln_places: Vec<f64>,
    /// −ln p of the best candidate of each drawn record, increasing.
    best: Vec<f64>,
    /// Number of candidates.
    candidates: usize,
}

/// Points of a candidate's grid: all combinations of its parameters' points.
pub fn grid_points(candidate: &Candidate) -> Vec<Vec<f64>> {
    match &candidate.search {
        Search::Linear(_) => vec![Vec::new()],
        Search::Grid { parameters, .. } => parameters.iter().fold(vec![Vec::new()], |points, parameter| {
            points
                .iter()
                .flat_map(|point| {
                    parameter.grid.iter().map(move |&value| {
                        let mut longer = point.clone();
                        longer.push(value);
                        longer
                    })
                })
                .collect()
        }),
        Search::Onset(_) | Search::Frequency | Search::Noise(_) | Search::Readings(_) => Vec::new(),
    }
}

impl Library {
    /// Scores of all candidates beside the constants and `terms`, over every block that has a filter.
    pub fn new(bench: &Bench<'_>, purpose: Purpose, wanted: &(dyn Fn(usize) -> bool + Sync)) -> Self {
        let (model, candidates, terms) = (bench.case.model, bench.case.candidates, &bench.terms);
        let constants = 0..model.constants.len();
        let mut regressors = constants.end;
        let of_term = |term: &Term| {
            regressors += term.amplitudes();
            regressors - term.amplitudes()..regressors
        };
        let of_terms: Vec<Range<usize>> = terms.iter().map(of_term).collect();
        let delays = Delays::new(terms);
        let mut entries = Vec::new();
        let mut first = regressors;
        for (index, candidate) in candidates.iter().enumerate().filter(|(index, _)| wanted(*index)) {
            let unit_amplitude = matches!(candidate.search, Search::Grid { unit_amplitude: true, .. });
            let points = match &candidate.search {
                Search::Onset(shape) if purpose == Purpose::Pairs => onsets(*shape, bench.case.time_s),
                _ => grid_points(candidate),
            };
            for (number, point) in points.into_iter().enumerate() {
                let columns = candidate.amplitudes.len().max(1);
                entries.push(Entry { candidate: index, number, point, first, columns, unit_amplitude });
                first += columns;
            }
        }
        let blocks_of: Vec<Vec<usize>> = (entries.iter())
            .map(|entry| blocks_of(model, &sensors_of(&candidates[entry.candidate])))
            .collect();
        let longest = model.blocks.iter().map(|block| block.data.len()).max().unwrap_or_default();
        let signs = if purpose == Purpose::Gains { Vec::new() } else { signs(longest) };
        let mut builders: Vec<Builder<'_>> = (0..model.blocks.len())
            .into_par_iter()
            .filter_map(|index| {
                let mut builder = Builder::new(bench, index, &delays, &signs)?;
                // What acts on this block alone; what acts on several is made once for all.
                let (known, new): (Vec<&Entry>, Vec<&Entry>) = (entries.iter().zip(&blocks_of))
                    .filter_map(|(entry, blocks)| (*blocks == [index]).then_some(entry))
                    .partition(|entry| builder.knows(entry));
                builder.recall(&known);
                let at_once = (BATCH * rayon::current_num_threads()).max(1);
                for entries in batches(&new, at_once) {
                    builder.take(entries, candidates, &signatures(model, &delays, candidates, entries));
                }
                Some(builder)
            })
            .collect();
        let (known, new): (Vec<&Entry>, Vec<&Entry>) = (entries.iter().zip(&blocks_of))
            .filter_map(|(entry, blocks)| (blocks.len() > 1).then_some(entry))
            .partition(|entry| builders.iter().all(|builder| builder.knows(entry)));
        for builder in &mut builders {
            builder.recall(&known);
        }
        let together = (SHARED_VALUES / (longest * model.blocks.len()).max(1)).clamp(2, 4 * BATCH);
        for entries in new.chunks(together) {
            let signatures = signatures(model, &delays, candidates, entries);
            builders.par_iter_mut().for_each(|builder| builder.take(entries, candidates, &signatures));
        }
        let blocks = builders.into_iter().map(|builder| builder.finish(first)).collect();
        let mut library = Self {
            entries,
            constants,
            terms: of_terms,
            regressors: Vec::new(),
            described: 0.0,
            blocks,
            prepared: Vec::new(),
        };
        library.leave_out(&[]);
        library
    }

    /// What the constants and the terms that are not left out gain.
    pub fn described(&self) -> f64 {
        self.described
    }

    /// Leaves out some terms of the description, by their places in it, and takes in those that were left out before.
    pub fn leave_out(&mut self, terms: &[usize]) {
        let stays =
            |(place, columns): (usize, &Range<usize>)| (!terms.contains(&place)).then(|| columns.clone());
        let of_terms = self.terms.iter().enumerate().filter_map(stays);
        let regressors: Vec<usize> = self.constants.clone().chain(of_terms.flatten()).collect();
        let own = self.normal(&regressors, &regressors);
        let inverse = if regressors.is_empty() {
            DMatrix::zeros(0, 0)
        } else {
            solve(&own, &DVector::zeros(regressors.len())).covariance
        };
        let scores = DVector::from_fn(regressors.len(), |i, _| self.score(regressors[i]));
        self.described = 0.5 * scores.dot(&(&inverse * &scores));
        self.prepared = (self.entries.par_iter())
            .map(|entry| {
                let columns: Vec<usize> = (entry.first..entry.first + entry.columns).collect();
                let before = self.normal(&columns, &columns);
                let cross = self.normal(&columns, &regressors);
                let projection = &cross * &inverse;
                let mut normal = &before - &projection * cross.transpose();
                for i in 0..columns.len() {
                    if normal[(i, i)] < SEEN * before[(i, i)] {
                        normal.row_mut(i).fill(0.0);
                        normal.column_mut(i).fill(0.0);
                    }
                }
                let solution = solve_seen(&normal, &DVector::zeros(columns.len()), SEEN_COMBINATION);
                let rank = if entry.unit_amplitude { usize::from(normal.sum() > 0.0) } else { solution.rank };
                Prepared { projection, normal, rank, inverse: solution.covariance }
            })
            .collect();
        self.regressors = regressors;
    }

    /// Product of a column with the data.
    fn score(&self, column: usize) -> f64 {
        self.blocks.iter().filter_map(|block| block.place[column].map(|place| block.scores[place])).sum()
    }

    fn normal(&self, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
        let mut normal = DMatrix::zeros(rows.len(), columns.len());
        for block in &self.blocks {
            for (i, &row) in rows.iter().enumerate() {
                let Some(row) = block.place[row] else { continue };
                for (j, &column) in columns.iter().enumerate() {
                    let Some(column) = block.place[column] else { continue };
                    normal[(i, j)] += block.product(row, column);
                }
            }
        }
        normal
    }

    /// Gains of all entries.
    pub fn gains(&self) -> Vec<Gain> {
        let scores: Vec<&DVector<f64>> = self.blocks.iter().map(|block| &block.scores).collect();
        self.gains_of(&scores, false)
    }

    fn gains_of(&self, scores: &[&DVector<f64>], drawn: bool) -> Vec<Gain> {
        let sum = |column: usize| -> f64 {
            let parts = self.blocks.iter().zip(scores);
            parts.filter_map(|(block, scores)| block.place[column].map(|place| scores[place])).sum()
        };
        let regressors = DVector::from_fn(self.regressors.len(), |i, _| sum(self.regressors[i]));
        (self.entries.iter().zip(&self.prepared))
            .map(|(entry, prepared)| {
                if prepared.rank == 0 {
                    return Gain { gain: 0.0, freedom: 1 };
                }
                let mut scores = DVector::from_fn(entry.columns, |i, _| sum(entry.first + i));
                if !self.regressors.is_empty() {
                    scores -= &prepared.projection * &regressors;
                }
                let gain = if entry.unit_amplitude && !drawn {
                    scores.sum() - 0.5 * prepared.normal.sum()
                } else if entry.unit_amplitude {
                    0.5 * scores.sum().powi(2) / prepared.normal.sum()
                } else {
                    0.5 * scores.dot(&(&prepared.inverse * &scores))
                };
                Gain { gain: gain.max(0.0), freedom: prepared.rank }
            })
            .collect()
    }

    /// The pairs of entries of one block and different candidates that gain at least `least` together, and `further` beside each alone.
    ///
    /// With orthonormal whitened columns, what is described taken out, and their scores u₁ and u₂ the gain is
    /// ½|u₁|² + ½ dᵀ(I − MᵀM)⁻¹d, d = u₂ − Mᵀu₁, where M = Q₁ᵀQ₂ is taken from the sketches.
    pub fn pairs(&self, least: f64, further: f64) -> Vec<Pair> {
        let mut pairs: Vec<Pair> = Vec::new();
        for block in &self.blocks {
            let correlations = self.correlations(block);
            let directions = self.directions(block, &correlations);
            let of_one = |(place, first): (usize, &Direction)| -> Vec<Pair> {
                let candidate = |direction: &Direction| self.entries[direction.entry].candidate;
                directions[..place]
                    .iter()
                    .filter(|other| candidate(other) != candidate(first))
                    .filter_map(|other| {
                        let gain = first.gain_with(other, &correlations)?;
                        let alone = [other.alone(), first.alone()];
                        let least = least.max(alone[0] + further).max(alone[1] + further);
                        (gain >= least).then_some(Pair { entries: [other.entry, first.entry], gain, alone })
                    })
                    .collect()
            };
            pairs.par_extend(directions.par_iter().enumerate().flat_map_iter(of_one));
        }
        pairs
    }

    /// Correlations of the columns of a block, those of what is described taken out.
    fn correlations(&self, block: &BlockSums) -> DMatrix<f64> {
        let mut left = block.correlations.get_or_init(|| normal_matrix(&block.sketches)).clone();
        for place in self.regressors.iter().filter_map(|&column| block.place[column]) {
            let (column, length) = (left.column(place).into_owned(), left[(place, place)]);
            if length > SEEN {
                left.ger(-1.0 / length, &column, &column, 1.0);
            }
        }
        left
    }

    /// The entries of a block, orthonormal; by the correlations of its columns as well, which are not exact.
    fn directions(&self, block: &BlockSums, correlations: &DMatrix<f64>) -> Vec<Direction> {
        // What is described may act on other blocks as well.
        let described = DVector::from_fn(self.regressors.len(), |i, _| self.score(self.regressors[i]));
        let direction = |(index, (entry, prepared)): (usize, (&Entry, &Prepared))| {
            if prepared.rank == 0 || entry.unit_amplitude {
                return None;
            }
            let columns = entry.first..entry.first + entry.columns;
            let places: Vec<usize> = columns.map(|column| block.place[column]).collect::<Option<_>>()?;
            let mut scores = DVector::from_fn(entry.columns, |i, _| block.scores[places[i]]);
            if !self.regressors.is_empty() {
                scores -= &prepared.projection * &described;
            }
            let eigen = prepared.inverse.clone().symmetric_eigen();
            let roots = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
            let root = &eigen.eigenvectors * roots * eigen.eigenvectors.transpose();
            let mut of_unit = root.clone();
            for (mut column, &place) in of_unit.column_iter_mut().zip(&places) {
                column *= block.product(place, place).max(0.0).sqrt();
            }
            let own =
                DMatrix::from_fn(entry.columns, entry.columns, |i, j| correlations[(places[i], places[j])]);
            let of_unit = unit_root(&(&of_unit * own * of_unit.transpose()))? * of_unit;
            Some(Direction { entry: index, scores: root * scores, places, root: of_unit })
        };
        self.entries.par_iter().zip(&self.prepared).enumerate().filter_map(direction).collect()
    }

    /// The distribution of the best candidate where nothing is hidden: whitened innovations are then independent
    /// standard normals, and the scores jointly normal with the columns' normal matrix.
    pub fn null_distribution(&self, candidates: &[Candidate]) -> NullDistribution {
        let roots: Vec<Root<'_>> = self.blocks.par_iter().map(BlockSums::root).collect();
        let drawn: Vec<Vec<f64>> = (0..DRAWS.div_ceil(DRAWN_TOGETHER))
            .into_par_iter()
            .flat_map_iter(|batch| {
                let first = batch * DRAWN_TOGETHER;
                let mut random: Vec<Pcg64> = (first..DRAWS.min(first + DRAWN_TOGETHER))
                    .map(|draw| Pcg64::seed_from_u64(SEED + draw as u64))
                    .collect();
                let scores: Vec<DMatrix<f64>> = (roots.iter().zip(&self.blocks))
                    .map(|(root, block)| {
                        let mut joint = root.draw(block.scores.len(), &mut random);
                        for (i, mut row) in joint.row_iter_mut().enumerate() {
                            row *= block.product(i, i).max(0.0).sqrt();
                        }
                        joint
                    })
                    .collect();
                (0..random.len())
                    .map(|draw| {
                        let own: Vec<DVector<f64>> =
                            scores.iter().map(|scores| scores.column(draw).into_owned()).collect();
                        let views: Vec<&DVector<f64>> = own.iter().collect();
                        let mut least = vec![0.0_f64; candidates.len()];
                        for (entry, gain) in self.entries.iter().zip(self.gains_of(&views, true)) {
                            let evidence = -ln_chi_squared_tail(2.0 * gain.gain, gain.freedom);
                            least[entry.candidate] = least[entry.candidate].max(evidence);
                        }
                        least
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        let ln_places: Vec<f64> = (0..candidates.len())
            .map(|candidate| {
                let mean = drawn.iter().map(|least| least[candidate]).sum::<f64>() / DRAWS as f64;
                // −ln of the least of K independent p-values has the mean Σ 1/k, which is ψ(K + 1) + γ.
                ln_number_of_mean(mean)
            })
            .collect();
        let mut with_entries: Vec<usize> = self.entries.iter().map(|entry| entry.candidate).collect();
        with_entries.dedup();
        let mut best: Vec<f64> = (drawn.iter())
            .map(|least| {
                let each = least.iter().enumerate().map(|(candidate, &alone)| {
                    alone - ln_places_at(alone, ln_places[candidate], continuous(&candidates[candidate]))
                });
                each.fold(0.0, f64::max)
            })
            .collect();
        best.sort_by(f64::total_cmp);
        NullDistribution { ln_places, best, candidates: with_entries.len() }
    }
}

impl NullDistribution {
    /// ln of the probability that the best of all candidates shows at least this −ln p where nothing is hidden.
    pub fn ln_tail(&self, evidence: f64) -> f64 {
        let bonferroni = (self.candidates.max(1) as f64).ln() - evidence;
        let exceeding = self.best.len() - self.best.partition_point(|&best| best < evidence);
        let drawn = if exceeding >= TAIL_DRAWS {
            (exceeding as f64 / DRAWS as f64).ln()
        } else {
            let edge = self.best.len().checked_sub(TAIL_DRAWS).and_then(|at| self.best.get(at));
            edge.map_or(0.0, |edge| (TAIL_DRAWS as f64 / DRAWS as f64).ln() - (evidence - edge))
        };
        drawn.min(bonferroni).min(0.0)
    }
}

/// The signatures of entries, as late as the readings that they are in.
fn signatures<'c>(
    model: &Model,
    delays: &Delays,
    candidates: &'c [Candidate],
    entries: &[&Entry],
) -> Vec<Cow<'c, Signature>> {
    let of = |entry: &&Entry| {
        let candidate = &candidates[entry.candidate];
        let signature = match &candidate.search {
            Search::Linear(signature) => Cow::Borrowed(signature),
            Search::Grid { signature, .. } => Cow::Owned(signature(&entry.point)),
            Search::Onset(_) => {
                Cow::Owned(Signature { columns: columns(candidate, &entry.point, &model.time_s) })
            }
            _ => Cow::Owned(Signature::default()),
        };
        if delays.is_empty() || !candidate.effect.is_of_the_motion() {
            return signature;
        }
        let late = signature.columns.iter().map(|column| delays.late(model, true, column).into_owned());
        Cow::Owned(Signature { columns: late.collect() })
    };
    entries.par_iter().map(of).collect()
}

/// The blocks in which some of `sensors` are.
fn blocks_of(model: &Model, sensors: &[usize]) -> Vec<usize> {
    let has = |&index: &usize| model.blocks[index].sensors.iter().any(|sensor| sensors.contains(sensor));
    (0..model.blocks.len()).filter(has).collect()
}

/// Some of all onsets, s.
fn onsets(shape: OnsetShape, time_s: &[f64]) -> Vec<Vec<f64>> {
    let length_s = time_s.last().copied().unwrap_or_default();
    // A drift may begin with the record, a step at that time is a constant.
    let first = usize::from(shape == OnsetShape::Step);
    (first..ONSETS).map(|place| vec![length_s * place as f64 / ONSETS as f64]).collect()
}

/// What makes columns orthonormal by their sketches that are so, some of them nothing, by exact products; none where the two differ much.
fn unit_root(nearly_unit: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let eigen = nearly_unit.clone().symmetric_eigen();
    let is_near = |&value: &f64| value < SEEN_COMBINATION || MOST_APART.recip() < value && value < MOST_APART;
    eigen.eigenvalues.iter().all(is_near).then(|| {
        let root = |value: f64| if value < SEEN_COMBINATION { 0.0 } else { value.sqrt().recip() };
        let roots = DMatrix::from_diagonal(&eigen.eigenvalues.map(root));
        &eigen.eigenvectors * roots * eigen.eigenvectors.transpose()
    })
}

/// Random signs.
fn signs(number: usize) -> Vec<f32> {
    let mut random = Pcg64::seed_from_u64(SEED);
    let mut signs = Vec::with_capacity(number);
    while signs.len() < number {
        let bits = random.next_u64();
        signs.extend(
            (0..64.min(number - signs.len())).map(|bit| if bits >> bit & 1 == 0 { 1.0 } else { -1.0 }),
        );
    }
    signs
}

/// Rows with random signs summed into the places of a sketch; of unit length. None without signs.
fn sketch(column: &[f32], signs: &[f32]) -> Vec<f32> {
    if signs.is_empty() {
        return Vec::new();
    }
    let mut sketch = vec![0.0; SKETCH.min(column.len())];
    for (values, signs) in column.chunks(SKETCH).zip(signs.chunks(SKETCH)) {
        for ((place, value), sign) in sketch.iter_mut().zip(values).zip(signs) {
            *place += sign * value;
        }
    }
    let length = tiled_dot(&sketch, &sketch).sqrt();
    if length > 0.0 {
        for place in &mut sketch {
            *place = (f64::from(*place) / length) as f32;
        }
    }
    sketch
}

/// Columns of an entry that reach a block, by their places in the entry.
type Reached<'s> = Vec<(usize, Cow<'s, [f64]>)>;

/// Sums of products of the whitened columns of an entry that reach a block.
#[derive(Clone, Debug, Default)]
struct OfEntry {
    /// The columns, by their places in the entry.
    columns: Vec<usize>,
    /// Products of each with those up to itself.
    among: Vec<Vec<f64>>,
    /// Their sketches, once they were asked for.
    sketches: Option<Arc<Vec<Vec<f32>>>>,
    /// Products of each with what is described, by its place in [`Known::described`].
    with: HashMap<usize, Vec<f64>>,
}

/// What is known of a block under given noises.
#[derive(Debug, Default)]
struct Known {
    described: Vec<Described>,
    /// By candidate and number of the point.
    entries: HashMap<(usize, usize), OfEntry>,
}

/// Sums of products of whitened columns of entries among themselves and with what was described so far.
#[derive(Debug, Default)]
pub struct Products(Mutex<Known>);

impl Products {
    fn known(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds to what is known of entries, to which another search may have added meanwhile.
    fn learn(&self, entries: &[&Entry], products: Vec<OfEntry>) {
        let all = &mut self.known().entries;
        for (entry, OfEntry { columns, among, sketches, with }) in entries.iter().zip(products) {
            let known = all.entry((entry.candidate, entry.number)).or_default();
            (known.columns, known.among) = (columns, among);
            known.sketches = sketches.or(known.sketches.take());
            known.with.extend(with);
        }
    }

    /// Places of what is described.
    fn places(&self, described: Vec<Described>) -> Vec<usize> {
        let all = &mut self.known().described;
        let place = |one: Described| {
            all.iter().position(|other| *other == one).unwrap_or_else(|| {
                all.push(one);
                all.len() - 1
            })
        };
        described.into_iter().map(place).collect()
    }
}

/// Entries in runs of at least `columns` columns, but for the last.
fn batches<'e, 'l>(entries: &'e [&'l Entry], columns: usize) -> impl Iterator<Item = &'e [&'l Entry]> {
    let mut number = 0;
    entries.split_inclusive(move |entry| {
        number += entry.columns;
        let full = number >= columns;
        number = if full { 0 } else { number };
        full
    })
}

/// Takes the columns of a block in, some entries after the others.
struct Builder<'b> {
    block: &'b Block,
    whitened: &'b Whitened,
    signs: &'b [f32],
    products: Arc<Products>,
    /// Places of the data and of the regressors among all that was described.
    described: Vec<usize>,
    /// R⁻¹ of the data, and of the regressors, where it was asked for; and what it is by the readings of each sensor at each port.
    adjoints: Vec<OnceLock<Vec<f64>>>,
    at_sensors: Vec<OnceLock<Option<Vec<f64>>>>,
    ids: Vec<usize>,
    scores: Vec<f64>,
    with_regressors: Vec<Vec<f64>>,
    with_entry: Vec<Vec<f64>>,
    sketches: Vec<Vec<f32>>,
}

impl<'b> Builder<'b> {
    fn new(bench: &'b Bench<'_>, index: usize, delays: &Delays, signs: &'b [f32]) -> Option<Self> {
        let block = &bench.case.model.blocks[index];
        let whitened = &**bench.blocks[index].as_ref()?;
        let noises = block.sources.iter().map(|&source| bench.noises[source].clone()).collect();
        let key = (index, noises, delays.among(&block.sensors));
        let products = bench.case.products.get_or(key, Arc::default);
        let mut builder = Self {
            block,
            whitened,
            signs,
            described: products.places(bench.case.described(index, &bench.terms)),
            adjoints: vec![OnceLock::new(); whitened.columns.len()],
            at_sensors: vec![OnceLock::new(); whitened.columns.len() * block.sensors.len() * PORTS],
            products,
            ids: Vec::new(),
            scores: Vec::new(),
            with_regressors: Vec::new(),
            with_entry: Vec::new(),
            sketches: Vec::new(),
        };
        // Not the places of `projected`, which may be those of an earlier description in which this block was the same.
        let regressors = bench.places[index].iter().zip(&whitened.projected.columns);
        for (own, (place, column)) in regressors.enumerate() {
            let with_regressors = whitened.sums.normal.row(own).iter().copied().collect();
            let single =
                if signs.is_empty() { Vec::new() } else { whitened.filter.whiten_single(&[column]).concat() };
            let sketch = sketch(&single, signs);
            builder.push(*place, whitened.sums.scores[own], with_regressors, Vec::new(), sketch);
        }
        Some(builder)
    }

    /// Whether all that is needed of an entry is known.
    fn knows(&self, entry: &Entry) -> bool {
        let known = self.products.known();
        let of_entry = known.entries.get(&(entry.candidate, entry.number));
        let all = |of: &OfEntry| self.described.iter().all(|place| of.with.contains_key(place));
        of_entry.is_some_and(|of| self.is_sketched(of) && all(of))
    }

    /// Whether an entry has the sketches that are asked for.
    fn is_sketched(&self, of_entry: &OfEntry) -> bool {
        self.signs.is_empty() || of_entry.sketches.is_some()
    }

    /// Takes entries with their signatures, which are whitened and multiplied where that was not done before.
    fn take(&mut self, entries: &[&Entry], candidates: &[Candidate], signatures: &[Cow<'_, Signature>]) {
        let known: Vec<Option<OfEntry>> = {
            let all = self.products.known();
            entries.iter().map(|entry| all.entries.get(&(entry.candidate, entry.number)).cloned()).collect()
        };
        let asked = |known: &Option<OfEntry>| !known.as_ref().is_some_and(|known| self.is_sketched(known));
        // Those that are to be whitened.
        let reached: Vec<Reached<'_>> = ((entries, signatures, &known).into_par_iter())
            .map(
                |(entry, signature, known)| {
                    if asked(known) { self.reached(entry, candidates, signature) } else { Vec::new() }
                },
            )
            .collect();
        let unknown: Vec<&[f64]> =
            reached.iter().flat_map(|columns| columns.iter().map(|(_, values)| values.as_ref())).collect();
        let mut whitened = (unknown.par_chunks(BATCH))
            .flat_map_iter(|batch| self.whitened.filter.whiten_single(batch))
            .collect::<Vec<Vec<f32>>>()
            .into_iter();
        let own: Vec<Vec<Vec<f32>>> =
            reached.iter().map(|columns| whitened.by_ref().take(columns.len()).collect()).collect();
        let products: Vec<OfEntry> = ((entries, signatures, &reached, known, own).into_par_iter())
            .map(|(entry, signature, columns, known, own)| {
                let of = |place: usize| -> Vec<f64> {
                    own[..=place].iter().map(|other| tiled_dot(&own[place], other)).collect()
                };
                let is_asked = asked(&known);
                let mut products = known.unwrap_or_else(|| OfEntry {
                    columns: columns.iter().map(|(place, _)| *place).collect(),
                    among: (0..own.len()).map(of).collect(),
                    ..OfEntry::default()
                });
                if is_asked && !self.signs.is_empty() {
                    let sketches = own.iter().map(|column| sketch(column, self.signs)).collect();
                    products.sketches = Some(Arc::new(sketches));
                }
                let port = candidates[entry.candidate].port;
                let columns: Vec<&Column> =
                    products.columns.iter().map(|&place| &signature.columns[place]).collect();
                for (number, place) in self.described.iter().enumerate() {
                    let with = |column: &&Column| self.product(number, column, port);
                    products.with.entry(*place).or_insert_with(|| columns.iter().map(with).collect());
                }
                products
            })
            .collect();
        self.products.learn(entries, products);
        self.recall(entries);
    }

    /// The columns of an entry that reach the block.
    fn reached<'s>(&self, entry: &Entry, candidates: &[Candidate], signature: &'s Signature) -> Reached<'s> {
        let port = candidates[entry.candidate].port;
        let columns = signature.columns.iter().enumerate().take(entry.columns);
        columns.filter_map(|(place, column)| Some((place, self.block.project(column, port)?))).collect()
    }

    /// The product of a column with the data, which come first, or with a regressor: by what these are at the sensors, so that the channels need
    /// not be made of it. Where a row of it is no number, neither is the sum: then the channels are made, in which such a row counts as 0.
    fn product(&self, number: usize, column: &Column, port: Port) -> f64 {
        let of_part = |(sensor, values): &(usize, Series)| match self.at_sensor(number, *sensor, port) {
            Some(scores) if values.len() == scores.len() => dot(values, scores),
            Some(_) => f64::NAN,
            None => 0.0,
        };
        let product: f64 = column.parts.iter().map(of_part).sum();
        if product.is_finite() {
            return product;
        }
        self.block.project(column, port).map_or(0.0, |channels| dot(&channels, self.adjoint(number)))
    }

    /// R⁻¹ of the data or of a regressor, by the readings of a sensor at a port; `None` where they do not reach the channels.
    fn at_sensor(&self, number: usize, sensor: usize, port: Port) -> Option<&[f64]> {
        let place = self.block.sensors.iter().position(|&own| own == sensor)?;
        if self.block.is_of_one_sensor() {
            return Some(self.adjoint(number));
        }
        let at = (number * self.block.sensors.len() + place) * PORTS + port as usize;
        let compute = || self.block.back_project(self.adjoint(number), sensor, port);
        self.at_sensors[at].get_or_init(compute).as_deref()
    }

    /// Takes entries whose products are known.
    fn recall(&mut self, entries: &[&Entry]) {
        let products = Arc::clone(&self.products);
        let known = products.known();
        for entry in entries {
            let Some(of_entry) = known.entries.get(&(entry.candidate, entry.number)) else { continue };
            for (own, (place, among)) in of_entry.columns.iter().zip(&of_entry.among).enumerate() {
                let mut with = self.described.iter().map(|place| of_entry.with[place][own]);
                let score = with.next().unwrap_or_default();
                let with = with.collect();
                let of_all = of_entry.sketches.as_ref().filter(|_| !self.signs.is_empty());
                let sketch = of_all.and_then(|all| all.get(own).cloned()).unwrap_or_default();
                self.push(entry.first + place, score, with, among.clone(), sketch);
            }
        }
    }

    /// R⁻¹ of the data, which come first, or of a regressor.
    fn adjoint(&self, number: usize) -> &[f64] {
        let compute = || self.whitened.filter.adjoint(&self.whitened.columns[number]);
        self.adjoints[number].get_or_init(compute)
    }

    fn push(
        &mut self,
        id: usize,
        score: f64,
        with_regressors: Vec<f64>,
        with_entry: Vec<f64>,
        sketch: Vec<f32>,
    ) {
        self.ids.push(id);
        self.scores.push(score);
        self.with_regressors.push(with_regressors);
        self.with_entry.push(with_entry);
        self.sketches.push(sketch);
    }

    /// The sums, `all` columns being in the library.
    fn finish(self, all: usize) -> BlockSums {
        let mut place = vec![None; all];
        for (index, &id) in self.ids.iter().enumerate() {
            place[id] = Some(index);
        }
        BlockSums {
            place,
            scores: DVector::from_vec(self.scores),
            with_regressors: self.with_regressors,
            with_entry: self.with_entry,
            sketches: self.sketches,
            correlations: OnceLock::new(),
        }
    }
}

impl BlockSums {
    /// Product of two columns; 0 where it was not needed.
    fn product(&self, a: usize, b: usize) -> f64 {
        let (low, high) = (a.min(b), a.max(b));
        if let Some(&product) = self.with_regressors[high].get(low) {
            return product;
        }
        let own = &self.with_entry[high];
        (low + own.len()).checked_sub(high + 1).and_then(|at| own.get(at)).copied().unwrap_or_default()
    }

    /// How joint scores are drawn.
    fn root(&self) -> Root<'_> {
        let size = self.sketches.len();
        if size > MANY_COLUMNS {
            return Root::Sketches(&self.sketches);
        }
        let mut correlation = normal_matrix(&self.sketches);
        for i in 0..size {
            correlation[(i, i)] = 1.0 + JITTER;
        }
        // Rounded correlations of many columns that are nearly collinear may have no root.
        correlation
            .cholesky()
            .map_or(Root::Sketches(&self.sketches), |root| Root::Correlations(root.unpack()))
    }
}

/// Sums of products of columns in single precision over tiles that fit into the cache.
fn normal_matrix(columns: &[Vec<f32>]) -> DMatrix<f64> {
    let size = columns.len();
    let rows: Vec<Vec<f64>> = (columns.par_iter().enumerate())
        .map(|(i, column)| columns[..=i].iter().map(|other| tiled_dot(column, other)).collect())
        .collect();
    let mut normal = DMatrix::from_fn(size, size, |i, j| rows[i].get(j).copied().unwrap_or_default());
    normal.fill_upper_triangle_with_lower_triangle();
    normal
}

/// Sum of products, in single precision within a tile.
fn tiled_dot(a: &[f32], b: &[f32]) -> f64 {
    a.chunks(TILE_ROWS).zip(b.chunks(TILE_ROWS)).map(|(a, b)| f64::from(dot_single(a, b))).sum()
}

/// Sum of products over a tile.
fn dot_single(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut sums = [0.0_f32; LANES];
    let (a_lanes, b_lanes) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let (a_rest, b_rest) = (a_lanes.remainder(), b_lanes.remainder());
    for (a, b) in a_lanes.zip(b_lanes) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sketches_keep_correlations() {
        let rows = 40 * SKETCH;
        let wave = |period: f64| -> Vec<f32> {
            (0..rows).map(|row| (std::f64::consts::TAU * row as f64 / period).sin() as f32).collect()
        };
        // Periods that fall on the places of the sketch are the worst.
        let (a, b) = (wave(SKETCH as f64), wave(SKETCH as f64 / 2.0));
        let near: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a + 0.1 * b).collect();
        let signs = signs(rows);
        let sketches = [&a, &b, &near].map(|column| sketch(column, &signs));
        let bound = 5.0 / (SKETCH as f64).sqrt();
        assert!(tiled_dot(&sketches[0], &sketches[1]).abs() < bound);
        let exact = 1.01_f64.sqrt().recip();
        let found = tiled_dot(&sketches[0], &sketches[2]);
        assert!((found - exact).abs() < bound * (1.0 - exact * exact), "{found} {exact}");
        // A record that is no longer than a sketch is exact.
        let (a, near) = (&a[..1000], &near[..1000]);
        let correlation = |a: &[f32], b: &[f32]| tiled_dot(a, b) / (tiled_dot(a, a) * tiled_dot(b, b)).sqrt();
        let found = tiled_dot(&sketch(a, &signs), &sketch(near, &signs));
        assert!((found - correlation(a, near)).abs() < 1e-6);
    }
}
