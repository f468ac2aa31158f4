//! One round of the search: what every candidate would gain beside what is already described.
//!
//! Candidates are compared by their evidence, −ln of the probability that the candidate gains so much where it is
//! absent, over all the places (grid points, onsets, frequencies) where it was sought: the gain in nats less a penalty
//! that grows with the number of its parameters and places, and not with the length of the record. Family-wise
//! probabilities count all candidates of all sensors; each family of candidates has a share of the level.
use std::collections::HashSet;
use std::sync::{Arc, OnceLock};

use nalgebra::DVector;
use rayon::prelude::*;

use crate::catalogue::{AT_START, Candidate, NoiseChange, Nonlinear, OnsetShape, Search, Signature, Target};
use crate::description::{Term, blocks_of, remainder};
use crate::library::{Entry, Library, NullDistribution, Pair, Purpose};
use crate::minimise::{golden, simplex};
use crate::noise_change::{ChangeFit, PromisedStart, View};
use crate::nominal::{Block, Model};
use crate::price::Price;
use crate::scan::{Scan, Scanner};
use crate::select::{speaks, touches};
use crate::state::{Bench, Case, Key, State};

/// Shares of the level: linear and grid candidates, onsets, frequencies, noise, readings.
const SHARE_LINEAR: f64 = 0.6;
const SHARE_ONSET: f64 = 0.2;
const SHARE_FREQUENCY: f64 = 0.05;
const SHARE_NOISE: f64 = 0.1;
const SHARE_READINGS: f64 = 0.05;
/// Deterministic candidates that are evaluated exactly.
const SHORT_LIST: usize = 8;
/// The same where many are about as good, and how many nats behind that is.
const LONGEST_LIST: usize = 40;
const CLOSE: f64 = 8.0;
/// Evidence below which a candidate is not evaluated exactly.
const LEAST_EVIDENCE: f64 = 1.0;
/// Evidence below which its parameters are left where the grid or the scan has them: refining added 2.4 nats at most to 10 000 promises of
/// less, a tenth of a nat to nine of ten, and nothing is told by less than some nine.
const WORTH_REFINING: f64 = 5.0;
/// Evidence that each of a pair must show beside the other.
const LEAST_BESIDE: f64 = 4.0;
/// Gain with which none of one degree of freedom shows that.
const FURTHER: f64 = 2.5;
/// Changes of noise are fitted exactly unless they promise less than this part of what the best of their block shows, by
/// so many nats: Whittle's likelihood is not off by as much.
const FAR_PART: f64 = 0.5;
const FAR_NATS: f64 = 10.0;
/// How finely a parameter is refined, as a part of the distance between neighbours of the grid.
const REFINED: f64 = 0.02;
/// The same for what was accepted.
const FINELY_REFINED: f64 = 1e-3;
/// Half width of the refinement of an onset of a ramp, as a part of the record.
const ONSET_WIDTH: f64 = 0.05;

/// The effect whose threshold is sought among the readings.
const DEAD_ZONE: &str = "dead_zone";

/// A deterministic candidate evaluated exactly.
#[derive(Clone, Debug)]
pub struct Proposal {
    /// The term.
    pub term: Term,
    /// Gain in log-likelihood.
    pub gain: f64,
    /// How it is judged.
    pub price: Price,
    /// −ln p.
    pub evidence: f64,
}

/// Numbers of candidates and the null distribution, for family-wise probabilities.
pub struct Family {
    null: NullDistribution,
    onsets: usize,
    frequencies: usize,
    noises: usize,
    readings: usize,
}

/// What a change of noise promises, before it is fitted exactly.
struct NoisePromise {
    candidate: usize,
    block: usize,
    source: usize,
    change: NoiseChange,
    starts: Vec<PromisedStart>,
    evidence: f64,
}

/// Where and how much a candidate promises, before it is evaluated exactly.
#[derive(Clone, Debug)]
pub struct Promise {
    /// Its place among the candidates.
    pub candidate: usize,
    starts: Vec<Vec<f64>>,
    evidence: f64,
    ln_places: f64,
    /// Whether it was evaluated exactly.
    evaluated: bool,
}

/// Where a promise led.
#[derive(Clone, Debug)]
pub struct Refined {
    /// Its parameters.
    point: Vec<f64>,
    /// Gain in log-likelihood.
    gain: f64,
    /// Degrees of freedom.
    freedom: usize,
}

impl Family {
    /// Counts candidates and draws the null distribution of those that stand in `library`.
    pub fn new(candidates: &[Candidate], library: &Library) -> Self {
        let count =
            |wanted: fn(&Search) -> bool| candidates.iter().filter(|c| wanted(&c.search)).count().max(1);
        Self {
            null: library.null_distribution(candidates),
            onsets: count(|search| matches!(search, Search::Onset(_))),
            frequencies: count(|search| matches!(search, Search::Frequency)),
            noises: count(|search| matches!(search, Search::Noise(_))),
            readings: count(|search| matches!(search, Search::Readings(_))),
        }
    }

    /// ln of the effective number of grid points of a candidate.
    pub fn ln_places(&self, candidate: usize) -> f64 {
        self.null.ln_places.get(candidate).copied().unwrap_or_default()
    }

    /// ln of the probability that anything shows this evidence where nothing is hidden.
    pub fn ln_p(&self, candidate: &Candidate, evidence: f64) -> f64 {
        let several = |number: usize, share: f64| (number as f64 / share).ln() - evidence;
        let ln_p = match candidate.search {
            Search::Linear(_) | Search::Grid { .. } => self.null.ln_tail(evidence) - SHARE_LINEAR.ln(),
            Search::Onset(_) => several(self.onsets, SHARE_ONSET),
            Search::Frequency => several(self.frequencies, SHARE_FREQUENCY),
            Search::Noise(_) => several(self.noises, SHARE_NOISE),
            Search::Readings(_) => several(self.readings, SHARE_READINGS),
        };
        ln_p.min(0.0)
    }
}

/// The library of the `wanted` candidates under a bench.
pub fn library(bench: &Bench<'_>, wanted: &(dyn Fn(usize) -> bool + Sync)) -> Library {
    Library::new(bench, Purpose::Gains, wanted)
}

/// The best deterministic candidates under a bench, evaluated exactly, best first; `wanted` says which take part.
pub fn deterministic(
    bench: &Bench<'_>,
    library: &Library,
    family: &Family,
    wanted: &(dyn Fn(usize) -> bool + Sync),
) -> Vec<Proposal> {
    let mut promises = promises(bench, library, family, wanted);
    let mut proposals = crate::jump::jumps(bench, wanted);
    evaluate(bench, &mut promises, &mut proposals);
    proposals
}

/// The same of those that stand in the library: of no scan for a time or a frequency, of no threshold and no jumps.
pub fn of_library(bench: &Bench<'_>, library: &Library, family: &Family) -> Vec<Proposal> {
    let mut promises = promises_of_library(bench.case.candidates, library, family);
    promises.retain(|promise| promise.evidence > LEAST_EVIDENCE);
    let mut proposals = Vec::new();
    evaluate(bench, &mut promises, &mut proposals);
    proposals
}

/// What deterministic candidates promise; `wanted` says which take part.
pub fn promises(
    bench: &Bench<'_>,
    library: &Library,
    family: &Family,
    wanted: &(dyn Fn(usize) -> bool + Sync),
) -> Vec<Promise> {
    let mut promises = promises_of_library(bench.case.candidates, library, family);
    promises.extend(promises_of_scans(bench, wanted));
    promises.extend(promises_of_thresholds(bench, wanted));
    promises.retain(|promise| promise.evidence > LEAST_EVIDENCE);
    promises
}

/// Evaluates the best of `promises` exactly that were not before, and adds them to `proposals`, best first.
pub fn evaluate(bench: &Bench<'_>, promises: &mut [Promise], proposals: &mut Vec<Proposal>) {
    promises.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    // And the best of each block, beside which changes of its noise are judged.
    let mut is_led = vec![false; bench.case.model.blocks.len()];
    let leads = |promise: &Promise| {
        let Target::Sensor(sensor) = bench.case.candidates[promise.candidate].target else { return false };
        bench.case.model.block_of(sensor).is_some_and(|block| !std::mem::replace(&mut is_led[block], true))
    };
    let is_lead: Vec<bool> = promises.iter().map(leads).collect();
    let mut best = promises.first().map_or(0.0, |promise| promise.evidence);
    // First those that promise most, then those that promise as much as these show: a scan may promise more than there is.
    for _ in 0..2 {
        let close = promises.partition_point(|promise| promise.evidence > best - CLOSE);
        let listed = close.clamp(SHORT_LIST, LONGEST_LIST);
        let evaluated: Vec<Proposal> = (promises.par_iter_mut().zip(&is_lead).enumerate())
            .filter(|(place, (promise, is_lead))| (**is_lead || *place < listed) && !promise.evaluated)
            .filter(|_| !bench.case.watch.is_cancelled())
            .filter_map(|(_, (promise, _))| {
                promise.evaluated = true;
                bench.refine(promise, (promise.evidence > WORTH_REFINING).then_some(REFINED))
            })
            .collect();
        proposals.extend(evaluated);
        best = proposals.iter().map(|proposal| proposal.evidence).fold(0.0, f64::max);
    }
    proposals.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    // A sensor has an effect once: what a grid finds again with other parameters is no other effect, the first is refined.
    let sought = |term: &Term| matches!(bench.case.candidates[term.candidate].search, Search::Grid { .. });
    let known = |term: &Term| bench.terms.iter().any(|other| other.candidate == term.candidate);
    proposals.retain(|proposal| !(sought(&proposal.term) && known(&proposal.term)));
    // A candidate with several promises stands by its best.
    let mut seen = HashSet::new();
    proposals.retain(|proposal| seen.insert(proposal.term.candidate));
}

/// The best pairs of terms of a library that promise to say more than `least` together, each of them something beside the other, and what
/// they promise to say: at most so many, of two candidates one.
pub fn promising_pairs(
    case: &Case<'_>,
    library: &Library,
    family: &Family,
    least: f64,
    most: usize,
) -> Vec<(f64, [Term; 2])> {
    let cost = |entry: &Entry, gain: f64| {
        let candidate = &case.candidates[entry.candidate];
        let evidence = Price::of(candidate, entry.columns, family.ln_places(entry.candidate)).evidence(gain);
        (evidence > LEAST_BESIDE).then(|| gain - speaks(family.ln_p(candidate, evidence)))
    };
    let shows = |pair: Pair| {
        let [first, second] = pair.entries.map(|place| &library.entries[place]);
        let of_first = cost(first, pair.gain - pair.alone[1])?;
        let of_second = cost(second, pair.gain - pair.alone[0])?;
        let said = pair.gain - of_first - of_second;
        (said > least).then_some((said, [first, second]))
    };
    let mut pairs: Vec<(f64, [&Entry; 2])> =
        library.pairs(least, FURTHER).into_iter().filter_map(shows).collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut seen = HashSet::new();
    pairs.retain(|(_, pair)| seen.insert(pair.map(|entry| entry.candidate)));
    pairs.truncate(most);
    let term = |entry: &Entry| {
        Term::new(entry.candidate, &case.candidates[entry.candidate], &entry.point, case.time_s)
    };
    pairs.into_iter().map(|(said, pair)| (said, pair.map(term))).collect()
}

/// The best terms of a library that promise to say more than `least`, and what they promise: at most so many.
pub fn promising_terms(
    case: &Case<'_>,
    library: &Library,
    family: &Family,
    least: f64,
    most: usize,
) -> Vec<(f64, Term)> {
    let said = |promise: Promise| {
        let said = speaks(family.ln_p(&case.candidates[promise.candidate], promise.evidence));
        (said > least).then_some((said, promise))
    };
    let promises = promises_of_library(case.candidates, library, family);
    let mut promises: Vec<(f64, Promise)> = promises.into_iter().filter_map(said).collect();
    promises.sort_by(|a, b| b.0.total_cmp(&a.0));
    promises.truncate(most);
    let term = |Promise { candidate, starts, .. }: Promise| {
        Term::new(candidate, &case.candidates[candidate], &starts[0], case.time_s)
    };
    promises.into_iter().map(|(said, promise)| (said, term(promise))).collect()
}

/// Refines the non-linear parameters of the terms of `wanted` candidates, each beside the others; whether there were any.
pub fn refine_terms(case: &Case<'_>, state: &mut State, wanted: &dyn Fn(usize) -> bool) -> bool {
    let mut refined = false;
    for place in 0..state.terms.len() {
        let term = &state.terms[place];
        if term.nonlinear.is_empty() || !wanted(term.candidate) {
            continue;
        }
        let mut others = state.terms.clone();
        others.remove(place);
        let bench = Bench::new(case, &others, &state.noises);
        state.terms[place] = bench.refined(&state.terms[place]).0;
        refined = true;
    }
    refined
}

fn promises_of_library(candidates: &[Candidate], library: &Library, family: &Family) -> Vec<Promise> {
    let gains = library.gains();
    let mut promises: Vec<Promise> = Vec::new();
    for (entry, gain) in library.entries.iter().zip(&gains) {
        let ln_places = family.ln_places(entry.candidate);
        let found = Promise {
            candidate: entry.candidate,
            starts: vec![entry.point.clone()],
            evidence: Price::of(&candidates[entry.candidate], gain.freedom, ln_places).evidence(gain.gain),
            ln_places,
            evaluated: false,
        };
        match promises.last_mut() {
            Some(last) if last.candidate == entry.candidate => {
                if found.evidence > last.evidence {
                    *last = found;
                }
            }
            _ => promises.push(found),
        }
    }
    promises
}

fn promises_of_scans(bench: &Bench<'_>, wanted: &(dyn Fn(usize) -> bool + Sync)) -> Vec<Promise> {
    let model = bench.case.model;
    (0..model.blocks.len())
        .into_par_iter()
        .flat_map_iter(|index| -> Vec<Promise> {
            let (Some(whitened), Some(filter)) = (&bench.blocks[index], &bench.filters.of_block[index])
            else {
                return Vec::new();
            };
            let scanner = OnceLock::new();
            // Most of what is asked for concerns a few blocks.
            let scanner = || {
                scanner.get_or_init(|| {
                    let regressors = whitened.columns.get(1..).unwrap_or_default();
                    Scanner::new(&model.blocks[index], filter, &whitened.remainder, regressors)
                })
            };
            let of = |(place, candidate): (usize, &Candidate)| {
                let Target::Sensor(sensor) = candidate.target else { return Vec::new() };
                if !model.blocks[index].sensors.contains(&sensor) || !wanted(place) {
                    return Vec::new();
                }
                let scan = match candidate.search {
                    Search::Onset(shape) => {
                        scanner().onsets(sensor, candidate.port, shape, bench.case.time_s)
                    }
                    Search::Frequency => scanner().frequencies(sensor, candidate.port, &bench.noises),
                    _ => None,
                };
                let Some(Scan { peaks, mut ln_places }) = scan else { return Vec::new() };
                let mut promises = Vec::new();
                let freedom = candidate.amplitudes.len().max(1);
                if matches!(candidate.search, Search::Onset(OnsetShape::Ramp)) {
                    // A drift over the whole record is one place of its own; it pays for itself and not for the scan.
                    ln_places += std::f64::consts::LN_2;
                    let term = Term::new(place, candidate, &[0.0], bench.case.time_s);
                    let gain = bench.gain_of(&term).0;
                    promises.push(Promise {
                        candidate: place,
                        starts: vec![vec![0.0]],
                        evidence: Price::of(candidate, freedom, std::f64::consts::LN_2).evidence(gain),
                        ln_places: std::f64::consts::LN_2,
                        evaluated: false,
                    });
                }
                let gain = peaks.first().map_or(0.0, |peak| peak.gain);
                promises.push(Promise {
                    candidate: place,
                    starts: peaks.iter().map(|peak| vec![peak.at]).collect(),
                    evidence: Price::of(candidate, freedom, ln_places).evidence(gain),
                    ln_places,
                    evaluated: false,
                });
                promises
            };
            bench.case.candidates.par_iter().enumerate().flat_map_iter(of).collect()
        })
        .collect()
}

/// The threshold of a dead zone from the readings themselves, and the number of readings; `left` is what the rest of the description
/// leaves of a block.
///
/// Readings on the wrong side of a threshold miss the input whole, so that the likelihood is a ridge of a few readings' width between
/// the points of any grid. Of readings in the order of their inputs those below the threshold are better described as silent, those
/// above it as answering: it is where the sum of the differences of their squares is largest.
fn threshold(
    candidate: &Candidate,
    signature: &dyn Fn(&[f64]) -> Signature,
    block: &Block,
    left: &[f64],
) -> Option<(f64, usize)> {
    let silent = signature(&[f64::INFINITY]);
    let (_, values) = silent.columns.first()?.parts.first()?;
    let missed = block.project(silent.columns.first()?, candidate.port)?;
    let rows = block.rows();
    let better = |row: usize| -> f64 {
        let of_channel = |channel: usize| {
            let (left, missed) = (left[channel * rows + row], missed[channel * rows + row]);
            (2.0 * left - missed) * missed
        };
        (0..block.channels).map(of_channel).sum()
    };
    let mut inputs: Vec<(f64, f64)> = (values.iter().enumerate())
        .map(|(row, value)| (value.abs(), better(row)))
        .filter(|(input, better)| input.is_finite() && better.is_finite())
        .collect();
    inputs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut sum, mut best) = (0.0, (0.0, None));
    for pair in inputs.windows(2) {
        sum += pair[0].1;
        if sum > best.0 && pair[1].0 > pair[0].0 {
            best = (sum, Some(0.5 * (pair[0].0 + pair[1].0)));
        }
    }
    Some((best.1?, inputs.len()))
}

/// Terms as they are by all readings of `model`: the threshold of a dead zone is between those of them that are silent and those that
/// answer, and the ones that were taken for spikes may be the nearest to it.
pub fn by_all_readings(
    model: &Model,
    candidates: &[Candidate],
    terms: &[Term],
    amplitudes: &DVector<f64>,
) -> Vec<Term> {
    let renewed = |place: usize| {
        let term = &terms[place];
        let candidate = &candidates[term.candidate];
        let (Search::Grid { signature, .. }, Target::Sensor(sensor)) = (&candidate.search, &candidate.target)
        else {
            return None;
        };
        if candidate.effect.id != DEAD_ZONE {
            return None;
        }
        let index = model.block_of(*sensor)?;
        // It has no amplitude, so that those of the others are where they were.
        let others: Vec<Term> = [&terms[..place], &terms[place + 1..]].concat();
        let left = remainder(model, index, &others, amplitudes);
        let (threshold, _) = threshold(candidate, signature, &model.blocks[index], &left)?;
        Some(Term::new(term.candidate, candidate, &[threshold], &model.time_s))
    };
    (0..terms.len()).map(|place| renewed(place).unwrap_or_else(|| terms[place].clone())).collect()
}

/// Thresholds of dead zones.
fn promises_of_thresholds(bench: &Bench<'_>, wanted: &(dyn Fn(usize) -> bool + Sync)) -> Vec<Promise> {
    let case = bench.case;
    let left: Vec<OnceLock<Vec<f64>>> = case.model.blocks.iter().map(|_| OnceLock::new()).collect();
    let is_described = |place: usize| bench.terms.iter().any(|term| term.candidate == place);
    let promise = |(place, candidate): (usize, &Candidate)| {
        let (Search::Grid { signature, .. }, Target::Sensor(sensor)) = (&candidate.search, &candidate.target)
        else {
            return None;
        };
        if candidate.effect.id != DEAD_ZONE || !wanted(place) || is_described(place) {
            return None;
        }
        let index = case.model.block_of(*sensor)?;
        bench.blocks[index].as_ref()?;
        let block = &case.model.blocks[index];
        let left = left[index]
            .get_or_init(|| remainder(case.model, index, &bench.terms, &bench.solution.amplitudes));
        let (threshold, readings) = threshold(candidate, signature, block, left)?;
        let start = vec![threshold];
        let (gain, freedom) = bench.gain_of(&Term::new(place, candidate, &start, case.time_s));
        let ln_places = (readings as f64).ln();
        let evidence = Price::among(freedom, ln_places).evidence(gain);
        Some(Promise { candidate: place, starts: vec![start], evidence, ln_places, evaluated: false })
    };
    case.candidates.par_iter().enumerate().filter_map(promise).collect()
}

impl Bench<'_> {
    /// A term with its non-linear parameters refined from where they are, and its gain.
    pub fn refined(&self, term: &Term) -> (Term, f64) {
        let promise = Promise {
            candidate: term.candidate,
            starts: vec![term.nonlinear.clone()],
            evidence: 0.0,
            ln_places: 0.0,
            evaluated: false,
        };
        self.refine(&promise, Some(FINELY_REFINED))
            .map_or_else(|| (term.clone(), 0.0), |proposal| (proposal.term, proposal.gain))
    }

    /// Evaluates a promise exactly and refines its parameters so finely, or leaves them where they are.
    fn refine(&self, promise: &Promise, refined: Option<f64>) -> Option<Proposal> {
        let candidate = &self.case.candidates[promise.candidate];
        let key = (promise.candidate, promise.starts.clone(), refined, self.keys_beside(promise.candidate));
        let found = self.case.refined.get_or(key, || self.refine_from(promise, refined));
        let Refined { point, gain, freedom } = found?;
        let term = Term::new(promise.candidate, candidate, &point, self.case.time_s);
        let mut price = Price::of(candidate, freedom, promise.ln_places);
        if let Some(gain_of_own) = self.gain_of_own(candidate, &term, gain) {
            price.most = Price { freedom: 1, ..price }.evidence(gain_of_own);
        }
        Some(Proposal { term, gain, price, evidence: price.evidence(gain) })
    }

    /// What a term that has gained so much gains over what its unknown start would by itself, which is a decay as those of other effects are:
    /// only that speaks for this one. `None` where it has none.
    fn gain_of_own(&self, candidate: &Candidate, term: &Term, gain: f64) -> Option<f64> {
        let start = candidate.amplitudes.iter().position(|amplitude| amplitude.name == AT_START)?;
        let columns = Arc::new(term.columns.get(start).cloned().into_iter().collect());
        Some(gain - self.gain_of(&Term { columns, ..term.clone() }).0)
    }

    /// What the gain of a candidate depends on: the blocks that it reaches, or all where terms tie the amplitudes of
    /// several together.
    fn keys_beside(&self, candidate: usize) -> Vec<Key> {
        let (case, model) = (self.case, self.case.model);
        let ties = |term: &Term| blocks_of(model, std::slice::from_ref(term)).len() > 1;
        let all = self.terms.iter().any(ties);
        let reached = |&block: &usize| all || touches(case, candidate, &[block]);
        (0..model.blocks.len()).filter(reached).map(|block| self.key(block)).collect()
    }

    fn refine_from(&self, promise: &Promise, refined: Option<f64>) -> Option<Refined> {
        let candidate = &self.case.candidates[promise.candidate];
        let term_at = |point: &[f64]| Term::new(promise.candidate, candidate, point, self.case.time_s);
        let gain_at = |point: &[f64]| self.gain_of(&term_at(point)).0;
        let at = |start: &Vec<f64>| {
            let ranges = refined.zip(self.ranges(candidate, start));
            ranges.map_or_else(
                || start.clone(),
                |(refined, ranges)| refine_inside(start, &ranges, gain_at, refined).0,
            )
        };
        let refined = promise.starts.iter().map(at).map(|point| {
            let (gain, freedom) = self.gain_of(&term_at(&point));
            Refined { point, gain, freedom }
        });
        refined.reduce(|best, other| if other.gain > best.gain { other } else { best })
    }

    /// Where a candidate's parameters are refined around `start`; `None` where it has none that are.
    fn ranges(&self, candidate: &Candidate, start: &[f64]) -> Option<Vec<(f64, f64)>> {
        let length_s = self.case.time_s.last().copied().unwrap_or(1.0);
        match &candidate.search {
            Search::Grid { parameters, .. } => {
                let of = |(parameter, &value): (&Nonlinear, &f64)| neighbours(&parameter.grid, value);
                Some(parameters.iter().zip(start).map(of).collect())
            }
            Search::Frequency => {
                let half = 0.6 / length_s.max(f64::MIN_POSITIVE);
                Some(vec![(start[0] - half, start[0] + half)])
            }
            Search::Onset(OnsetShape::Ramp) if start.first().is_some_and(|&onset| onset > 0.0) => {
                let half = ONSET_WIDTH * length_s;
                Some(vec![((start[0] - half).max(0.0), (start[0] + half).min(0.99 * length_s))])
            }
            _ => None,
        }
    }

    /// What each `wanted` change of the noise of a source of the given blocks would gain, best first, without those that
    /// promise far less than the best of their block shows.
    pub fn noise_changes(
        &self,
        state: &State,
        blocks: &[usize],
        wanted: &(dyn Fn(usize) -> bool + Sync),
    ) -> Vec<(usize, ChangeFit)> {
        let model = self.case.model;
        let mut promised: Vec<NoisePromise> = (self.case.candidates.par_iter().enumerate())
            .filter_map(|(candidate, of)| {
                let (Search::Noise(change), Target::Sensor(sensor)) = (&of.search, &of.target) else {
                    return None;
                };
                let (change, source) = (*change, model.source_of(*sensor, of.port)?);
                let block = model.block_of_source(source)?;
                let accepted = state.changes.iter().any(|a| a.source == source && a.change == change);
                // The noise of a source of which the user says nothing is no finding.
                if model.sources[source].unknown || accepted || !blocks.contains(&block) || !wanted(candidate)
                {
                    return None;
                }
                let starts = self.promised_change(block, source, change)?;
                let evidence = starts.iter().map(|start| start.evidence).fold(0.0, f64::max);
                (!starts.is_empty()).then_some(NoisePromise {
                    candidate,
                    block,
                    source,
                    change,
                    starts,
                    evidence,
                })
            })
            .collect();
        promised.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let mut leading = vec![None; model.blocks.len()];
        for promise in &promised {
            leading[promise.block].get_or_insert(promise.candidate);
        }
        let (leaders, others): (Vec<NoisePromise>, Vec<NoisePromise>) =
            promised.into_iter().partition(|promise| leading[promise.block] == Some(promise.candidate));
        let fitted = |promises: Vec<NoisePromise>| -> Vec<(usize, usize, ChangeFit)> {
            let fit = |promise: NoisePromise| {
                let fit =
                    self.fitted_change(promise.block, promise.source, promise.change, &promise.starts)?;
                Some((promise.candidate, promise.block, fit))
            };
            promises.into_par_iter().filter_map(fit).collect()
        };
        let mut found = fitted(leaders);
        let shown =
            |block: usize| found.iter().find(|(_, of, _)| *of == block).map_or(0.0, |(_, _, fit)| -fit.ln_p);
        let near = |promise: &NoisePromise| promise.evidence > FAR_PART * shown(promise.block) - FAR_NATS;
        let others: Vec<NoisePromise> = others.into_iter().filter(near).collect();
        found.extend(fitted(others));
        found.sort_by(|(_, _, a), (_, _, b)| a.ln_p.total_cmp(&b.ln_p));
        found.into_iter().map(|(candidate, _, fit)| (candidate, fit)).collect()
    }

    /// The best fit of one change of the noise of a source.
    pub fn fit_change(&self, source: usize, change: NoiseChange) -> Option<ChangeFit> {
        let block = self.case.model.block_of_source(source)?;
        let starts = self.promised_change(block, source, change)?;
        self.fitted_change(block, source, change, &starts)
    }

    /// What a change of a source's noise promises; `None` where there is nothing to whiten, or whoever watches has ended it.
    fn promised_change(
        &self,
        block: usize,
        source: usize,
        change: NoiseChange,
    ) -> Option<Vec<PromisedStart>> {
        if self.case.watch.is_cancelled() {
            return None;
        }
        let view = self.view(block)?;
        let compute = || view.promised(source, &self.case.model.sources[source], change);
        Some(self.case.promised.get_or((self.key(block), source, change), compute))
    }

    fn fitted_change(
        &self,
        block: usize,
        source: usize,
        change: NoiseChange,
        starts: &[PromisedStart],
    ) -> Option<ChangeFit> {
        if self.case.watch.is_cancelled() {
            return None;
        }
        let view = self.view(block)?;
        let fit = || view.fit(source, change, starts);
        self.case.changes.get_or((self.key(block), source, change), fit)
    }

    /// A block under its present noises.
    pub fn view(&self, index: usize) -> Option<View<'_>> {
        let whitened = self.blocks[index].as_ref()?;
        Some(View {
            observations: self.observations(index)?,
            noises: &self.noises,
            filter: self.filters.of_block[index].as_ref()?,
            whitened: &whitened.remainder,
            log_likelihood: whitened.log_likelihood,
        })
    }
}

/// The neighbours of a point of a grid.
fn neighbours(grid: &[f64], value: f64) -> (f64, f64) {
    let at = grid.partition_point(|&point| point < value);
    let low = grid.get(at.saturating_sub(1)).copied().unwrap_or(value);
    let high = grid.get(at + 1).or(grid.last()).copied().unwrap_or(value);
    (low.min(value), high.max(value))
}

/// The point with the largest gain between neighbours; logarithmic where they are positive and far apart.
pub fn refine_inside(
    start: &[f64],
    ranges: &[(f64, f64)],
    gain_at: impl Fn(&[f64]) -> f64,
    refined: f64,
) -> (Vec<f64>, f64) {
    let logarithmic = |range: &(f64, f64)| range.0 > 0.0 && range.1 > 1.2 * range.0;
    let forward = |range: &(f64, f64), value: f64| if logarithmic(range) { value.ln() } else { value };
    let back = |range: &(f64, f64), value: f64| {
        (if logarithmic(range) { value.exp() } else { value }).clamp(range.0, range.1)
    };
    let here = (start.to_vec(), gain_at(start));
    let (point, gain) = match ranges {
        [] => return here,
        [range] => {
            let (low, high) = (forward(range, range.0), forward(range, range.1));
            if high <= low {
                return here;
            }
            let cost = |value: f64| -gain_at(&[back(range, value)]);
            let (value, cost) = golden(low, high, refined * (high - low), cost);
            (vec![back(range, value)], -cost)
        }
        _ => {
            let from: Vec<f64> =
                ranges.iter().zip(start).map(|(range, &value)| forward(range, value)).collect();
            let sides: Vec<f64> = (ranges.iter())
                .map(|range| 0.25 * (forward(range, range.1) - forward(range, range.0)))
                .collect();
            let at = |values: &[f64]| -> Vec<f64> {
                ranges.iter().zip(values).map(|(range, &value)| back(range, value)).collect()
            };
            let outside = |values: &[f64]| -> f64 {
                (ranges.iter().zip(values).zip(&sides))
                    .map(|((range, &value), side)| {
                        let (low, high) = (forward(range, range.0), forward(range, range.1));
                        ((low - value).max(value - high).max(0.0) / side.max(1e-300)).powi(2)
                    })
                    .sum()
            };
            let cost = |values: &[f64]| 10.0 * outside(values) - gain_at(&at(values));
            let (values, _) = simplex(&from, &sides, 1e-3, 60 * ranges.len() as u64, cost);
            let point = at(&values);
            let gain = gain_at(&point);
            (point, gain)
        }
    };
    if gain > here.1 { (point, gain) } else { here }
}
