//! All candidates' signatures through the filter, once: scores, norms and correlations, from which everything else is
//! linear algebra.
//!
//! Every point of a candidate's grid is an *entry* of one or more columns. A block keeps the whitened columns in single
//! precision while it forms their normal matrix; what is decided by them is computed again exactly.
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::catalogue::{Candidate, Column, Search};
use crate::description::{Filters, Term, sensors_of};
use crate::least_squares::{solve, solve_seen};
use crate::nominal::Model;
use crate::statistics::ln_chi_squared_tail;

/// Rows that are multiplied at a time.
const TILE_ROWS: usize = 1024;
/// Part of a column's norm that must be left when what is already described is taken out.
const SEEN: f64 = 1e-4;
/// Eigenvalue below which a combination of an entry's columns is not seen.
const SEEN_COMBINATION: f64 = 1e-5;
/// Added to the diagonal so that a normal matrix of collinear columns has a root.
const JITTER: f64 = 1e-5;
/// Records drawn for the null distribution.
const DRAWS: usize = 600;
/// Order statistic beyond which the tail is taken as exponential.
const TAIL_DRAWS: usize = 20;
/// Seed of the draws.
const SEED: u64 = 0x5c1d;
const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;

/// A candidate at a point of its grid.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Its place among the candidates.
    pub candidate: usize,
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
    /// Place in `scores` by column.
    place: Vec<Option<usize>>,
    scores: DVector<f64>,
    normal: DMatrix<f64>,
}

/// The library under one set of noises, beside given regressors.
pub struct Library {
    /// The entries.
    pub entries: Vec<Entry>,
    regressors: usize,
    blocks: Vec<BlockSums>,
    prepared: Vec<Prepared>,
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

/// Norms of a block's columns and the Cholesky root of their correlations.
type Root = (DVector<f64>, Option<Cholesky<f64, Dyn>>);

/// What an entry gains.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// Gain in log-likelihood.
    pub gain: f64,
    /// Degrees of freedom.
    pub freedom: usize,
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
    pub fn new(
        model: &Model,
        filters: &Filters,
        whitened: &[Option<Vec<f64>>],
        candidates: &[Candidate],
        terms: &[Term],
        correlations: bool,
        wanted: &(dyn Fn(usize) -> bool + Sync),
    ) -> Self {
        let regressors = model.constants.len() + terms.iter().map(Term::amplitudes).sum::<usize>();
        let mut entries = Vec::new();
        let mut first = regressors;
        for (index, candidate) in candidates.iter().enumerate().filter(|(index, _)| wanted(*index)) {
            let unit_amplitude = matches!(candidate.search, Search::Grid { unit_amplitude: true, .. });
            for point in grid_points(candidate) {
                let columns = candidate.amplitudes.len().max(1);
                entries.push(Entry { candidate: index, point, first, columns, unit_amplitude });
                first += columns;
            }
        }
        let blocks = (0..model.blocks.len())
            .into_par_iter()
            .filter_map(|block| {
                let whitened = whitened[block].as_ref()?;
                BlockSums::new(
                    model,
                    filters,
                    block,
                    whitened,
                    candidates,
                    &entries,
                    terms,
                    first,
                    correlations,
                )
            })
            .collect();
        let mut library = Self { entries, regressors, blocks, prepared: Vec::new() };
        library.prepare();
        library
    }

    fn prepare(&mut self) {
        let regressors: Vec<usize> = (0..self.regressors).collect();
        let own = self.normal(&regressors, &regressors);
        let inverse = if self.regressors > 0 {
            solve(&own, &DVector::zeros(self.regressors)).covariance
        } else {
            DMatrix::zeros(0, 0)
        };
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
    }

    fn normal(&self, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
        let mut normal = DMatrix::zeros(rows.len(), columns.len());
        for block in &self.blocks {
            for (i, &row) in rows.iter().enumerate() {
                let Some(row) = block.place[row] else { continue };
                for (j, &column) in columns.iter().enumerate() {
                    let Some(column) = block.place[column] else { continue };
                    normal[(i, j)] += block.normal[(row, column)];
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
        let regressors = DVector::from_fn(self.regressors, |i, _| sum(i));
        (self.entries.iter().zip(&self.prepared))
            .map(|(entry, prepared)| {
                if prepared.rank == 0 {
                    return Gain { gain: 0.0, freedom: 1 };
                }
                let mut scores = DVector::from_fn(entry.columns, |i, _| sum(entry.first + i));
                if self.regressors > 0 {
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

    /// The distribution of the best candidate where nothing is hidden: whitened innovations are then independent
    /// standard normals, and the scores jointly normal with the columns' normal matrix.
    pub fn null_distribution(&self, candidates: usize) -> NullDistribution {
        let roots: Vec<Root> = (self.blocks.par_iter())
            .map(|block| {
                let scale = block.normal.diagonal().map(|d| if d > 0.0 { d.sqrt() } else { 0.0 });
                let size = scale.len();
                let correlation = DMatrix::from_fn(size, size, |i, j| {
                    let product = scale[i] * scale[j];
                    let value = if product > 0.0 { block.normal[(i, j)] / product } else { 0.0 };
                    if i == j { 1.0 + JITTER } else { value }
                });
                (scale, correlation.cholesky())
            })
            .collect();
        let drawn: Vec<Vec<f64>> = (0..DRAWS)
            .into_par_iter()
            .map(|draw| {
                let mut random = Pcg64::seed_from_u64(SEED + draw as u64);
                let scores: Vec<DVector<f64>> = (roots.iter())
                    .map(|(scale, root)| {
                        let independent =
                            DVector::from_fn(scale.len(), |_, _| StandardNormal.sample(&mut random));
                        let joint = match root {
                            Some(root) => root.l_dirty().lower_triangle() * independent,
                            None => independent,
                        };
                        joint.component_mul(scale)
                    })
                    .collect();
                let views: Vec<&DVector<f64>> = scores.iter().collect();
                let mut least = vec![0.0_f64; candidates];
                for (entry, gain) in self.entries.iter().zip(self.gains_of(&views, true)) {
                    let evidence = -ln_chi_squared_tail(2.0 * gain.gain, gain.freedom);
                    least[entry.candidate] = least[entry.candidate].max(evidence);
                }
                least
            })
            .collect();
        let ln_places: Vec<f64> = (0..candidates)
            .map(|candidate| {
                let mean = drawn.iter().map(|least| least[candidate]).sum::<f64>() / DRAWS as f64;
                // −ln of the least of K independent p-values has the mean Σ 1/k, which is ψ(K + 1) + γ.
                ln_number_of_mean(mean)
            })
            .collect();
        let has_entries: Vec<bool> =
            (0..candidates).map(|candidate| self.entries.iter().any(|e| e.candidate == candidate)).collect();
        let mut best: Vec<f64> = (drawn.iter())
            .map(|least| {
                let each = least.iter().zip(&ln_places).map(|(evidence, places)| evidence - places);
                each.fold(0.0, f64::max)
            })
            .collect();
        best.sort_by(f64::total_cmp);
        NullDistribution { ln_places, best, candidates: has_entries.iter().filter(|&&has| has).count() }
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

impl BlockSums {
    #[expect(clippy::too_many_arguments)]
    fn new(
        model: &Model,
        filters: &Filters,
        block_index: usize,
        data: &[f64],
        candidates: &[Candidate],
        entries: &[Entry],
        terms: &[Term],
        all: usize,
        correlations: bool,
    ) -> Option<Self> {
        let block = &model.blocks[block_index];
        let filter = filters.of_block[block_index].as_ref()?;
        let mut ids = Vec::new();
        let mut whitened: Vec<Vec<f32>> = Vec::new();
        let mut waiting: Vec<Vec<f64>> = Vec::new();
        let run = |waiting: &mut Vec<Vec<f64>>, whitened: &mut Vec<Vec<f32>>| {
            let views: Vec<&[f64]> = waiting.iter().map(Vec::as_slice).collect();
            whitened.append(&mut filter.whiten_single(&views));
            waiting.clear();
        };
        let projected = crate::description::project(model, block_index, terms);
        ids.extend(projected.places);
        waiting.extend(projected.columns);
        run(&mut waiting, &mut whitened);
        let regressors = ids.len();
        let mut groups = vec![0; regressors];
        for (number, entry) in entries.iter().enumerate() {
            let candidate = &candidates[entry.candidate];
            if !sensors_of(candidate).iter().any(|sensor| block.sensors.contains(sensor)) {
                continue;
            }
            let generated;
            let columns: &[Column] = match &candidate.search {
                Search::Linear(signature) => &signature.columns,
                Search::Grid { signature, .. } => {
                    generated = signature(&entry.point).columns;
                    &generated
                }
                _ => &[],
            };
            for (index, column) in columns.iter().enumerate().take(entry.columns) {
                if let Some(values) = block.project(column, candidate.port) {
                    ids.push(entry.first + index);
                    groups.push(number);
                    waiting.push(values);
                }
            }
            if waiting.len() >= 8 {
                run(&mut waiting, &mut whitened);
            }
        }
        run(&mut waiting, &mut whitened);
        let mut place = vec![None; all];
        for (index, &id) in ids.iter().enumerate() {
            place[id] = Some(index);
        }
        let scores = DVector::from_iterator(
            ids.len(),
            whitened
                .iter()
                .map(|column| column.iter().zip(data).map(|(a, b)| f64::from(*a) * b).sum::<f64>()),
        );
        let normal =
            normal_matrix(&whitened, |i, j| correlations || j < regressors || groups[i] == groups[j]);
        Some(Self { place, scores, normal })
    }
}

/// ln K for which ψ(K + 1) + γ = `mean`.
fn ln_number_of_mean(mean: f64) -> f64 {
    let target = mean - EULER_GAMMA;
    let (mut low, mut high) = (0.0_f64, 20.0_f64);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if statrs::function::gamma::digamma(middle.exp() + 1.0) < target {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Sums of products of columns, those that are needed, in single precision over tiles that fit into the cache.
fn normal_matrix(columns: &[Vec<f32>], needed: impl Fn(usize, usize) -> bool + Sync) -> DMatrix<f64> {
    let size = columns.len();
    let rows = columns.first().map_or(0, Vec::len);
    let tiles = rows.div_ceil(TILE_ROWS);
    let share = tiles.div_ceil(rayon::current_num_threads().max(1)).max(1);
    let parts: Vec<DMatrix<f64>> = (0..tiles.div_ceil(share))
        .into_par_iter()
        .map(|part| {
            let mut normal = DMatrix::zeros(size, size);
            for tile in part * share..((part + 1) * share).min(tiles) {
                let range = tile * TILE_ROWS..((tile + 1) * TILE_ROWS).min(rows);
                for i in 0..size {
                    let a = &columns[i][range.clone()];
                    for j in (0..=i).filter(|&j| needed(i, j)) {
                        normal[(i, j)] += f64::from(dot(a, &columns[j][range.clone()]));
                    }
                }
            }
            normal
        })
        .collect();
    let mut normal = parts.into_iter().fold(DMatrix::zeros(size, size), |sum, part| sum + part);
    normal.fill_upper_triangle_with_lower_triangle();
    normal
}

/// Sum of products over a tile.
fn dot(a: &[f32], b: &[f32]) -> f32 {
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
