//! What could still hide: of each effect of the mean and each sensor the largest that would not have been found.
//!
//! An effect is found where its evidence passes the posterior that findings need. Its amplitude would be known within σ beside all that
//! is described, from the same sums and weights as the evidence. [`size`] says how many σ pass in how many of a hundred records. Of an
//! effect with parameters in which it is not linear the bound is that which holds in most of their reach.
//!
//! Noises have no bound here: how well a noise is known is a standard deviation of its own.
mod missing;
mod size;

use std::sync::Arc;

use nalgebra::DMatrix;
use rayon::prelude::*;

use self::size::{Sought, Threshold};
use crate::catalogue::{AT_MEAN, AT_START, Candidate, Search, target_name};
use crate::description::{columns, nonlinear_names, sensors_of};
use crate::evidence::fit::{Bench, Description};
use crate::evidence::system::Described;
use crate::explanation::{At, Bound};
use crate::nominal::Model;
use crate::search::beside::{Beside, Normal};
use crate::search::library::Shelf;
use crate::search::reaches::{Reach, reaches};

/// Why an effect has no bound that resembles what is described.
const ALIKE: &str = "it cannot be told from what is described, or from a constant that nobody knows";
/// Why an effect has none that is larger than what is sought.
const BEYOND: &str = "it could be as large as what is sought at most";
/// Why an effect that is there or not may have been missed.
const TOO_SMALL: &str = "what it would change in this recording is too small to be told";

/// The bounds of all effects that are not described, by sensor and effect; of the variants of an effect the one that would add most.
pub fn certificate(bench: &Bench<'_>, library: &[Shelf], best: &Description) -> Vec<Bound> {
    let Some(beside) = Beside::as_trusted(bench, best) else { return Vec::new() };
    let problem = bench.problem;
    let certifier = Certifier {
        beside: &beside,
        described: beside.described(),
        threshold: Threshold::new(problem.config),
    };
    let is_asked = |shelf: &&Shelf| {
        let candidate = &problem.candidates[shelf.candidate];
        !candidate.effect.is_unnamed() && !is_described(bench, best, candidate)
    };
    let shelves: Vec<&Shelf> = library.iter().filter(is_asked).collect();
    let mut hidden: Vec<Hidden> =
        shelves.into_par_iter().flat_map_iter(|shelf| certifier.of_shelf(shelf)).collect();
    let blocks: Vec<usize> = (0..bench.sums.len()).collect();
    let covering = |informations: &[f64]| certifier.covering(informations);
    let shapes: Vec<Reach> = reaches(&beside, &blocks, &covering);
    hidden.par_extend(shapes.par_iter().map(|reach| certifier.of_shape(reach)));
    let mut bounds: Vec<Bound> = hidden.par_iter().map(|it| certifier.bound(it)).collect();
    bounds.extend(missing::bounds(problem));
    in_order(problem.model, worst(bounds))
}

/// Whether a description has an effect of the kind of a candidate, on the same sensor: then its value is told.
fn is_described(bench: &Bench<'_>, description: &Description, candidate: &Candidate) -> bool {
    description.placed.iter().any(|placed| {
        let other = &bench.problem.candidates[placed.term.candidate];
        other.effect.id == candidate.effect.id
            && other.target == candidate.target
            && other.port == candidate.port
    })
}

/// Of each parameter of an effect of a sensor the variant that would add most, and one that cannot be told.
fn worst(bounds: Vec<Bound>) -> Vec<Bound> {
    let mut worst: Vec<Bound> = Vec::new();
    for bound in bounds {
        let is_same = |other: &&mut Bound| {
            (&other.sensor, &other.effect, &other.parameter)
                == (&bound.sensor, &bound.effect, &bound.parameter)
                && other.bound.is_some() == bound.bound.is_some()
        };
        match worst.iter_mut().find(is_same) {
            Some(other) if other.adds_rms < bound.adds_rms => *other = bound,
            Some(_) => {}
            None => worst.push(bound),
        }
    }
    worst
}

/// By sensor, in the order of the case, then by what an effect would add, the largest first.
fn in_order(model: &Model, mut bounds: Vec<Bound>) -> Vec<Bound> {
    let rank = |bound: &Bound| {
        model.sources.iter().position(|source| source.name == bound.sensor).unwrap_or(model.sources.len())
    };
    bounds.sort_by(|a, b| {
        let by_size = || b.adds_rms.unwrap_or(-1.0).total_cmp(&a.adds_rms.unwrap_or(-1.0));
        rank(a).cmp(&rank(b)).then_with(|| a.sensor.cmp(&b.sensor)).then_with(by_size)
    });
    bounds
}

/// An effect as large as could hide.
struct Hidden {
    candidate: usize,
    /// Which of its amplitudes is bounded; none of one that has a delay and no amplitude, or nothing.
    amplitude: Option<usize>,
    /// Its other parameters.
    point: Vec<f64>,
    /// All amplitudes in SI units, or why the recording cannot tell.
    amplitudes: Result<Vec<f64>, &'static str>,
}

struct Certifier<'c> {
    beside: &'c Beside<'c>,
    described: Described<'c>,
    threshold: Threshold<'c>,
}

/// How well the amplitudes of an effect would be known at a point, by the amplitude that is bounded.
#[derive(Clone)]
struct Known {
    /// Standard deviation, whatever the others are; infinite where it cannot be told.
    sigma: f64,
    /// All amplitudes at which this one is hardest to see, of which it is 1.
    direction: Vec<f64>,
    /// Number of amplitudes that are free.
    free: usize,
}

impl Certifier<'_> {
    /// The index among informations that as many are at least as large as a bound is to hold for.
    fn covering(&self, informations: &[f64]) -> usize {
        let mut places: Vec<usize> = (0..informations.len()).collect();
        places.sort_by(|&a, &b| informations[b].total_cmp(&informations[a]));
        let part = self.beside.bench.problem.config.certified_part.clamp(0.0, 1.0);
        let last = (part * places.len() as f64).ceil() as usize;
        places.get(last.saturating_sub(1)).copied().unwrap_or_default()
    }

    fn candidate(&self, candidate: usize) -> &Candidate {
        &self.beside.bench.problem.candidates[candidate]
    }

    fn ln_prior(&self, candidate: usize) -> f64 {
        self.beside.bench.problem.ln_prior[candidate]
    }

    fn of_shelf(&self, shelf: &Shelf) -> Vec<Hidden> {
        if shelf.is_unit {
            return self.of_unit(shelf).into_iter().collect();
        }
        let candidate = self.candidate(shelf.candidate);
        let points: Vec<Vec<Known>> = (shelf.points.iter())
            .map(|(_, regressors)| {
                let normal = self.beside.normal(&self.described, regressors);
                let covariance = normal.as_ref().and_then(Normal::covariance);
                known(candidate.amplitudes.len(), normal.map(|it| it.kept).zip(covariance))
            })
            .collect();
        let is_asked =
            |&index: &usize| ![AT_MEAN, AT_START].contains(&candidate.amplitudes[index].name.as_str());
        let of_amplitude = |index: usize| {
            let information = |known: &Vec<Known>| known[index].sigma.powi(-2);
            let informations: Vec<f64> = points.iter().map(information).collect();
            let chosen = self.covering(&informations);
            let known = &points[chosen][index];
            let sought = Sought {
                candidate,
                ln_prior: self.ln_prior(shelf.candidate) - (points.len() as f64).ln(),
                free: known.free,
                sigma: known.sigma,
                direction: &known.direction,
            };
            let size = known.sigma.is_finite().then(|| self.threshold.size(&sought, &[])).flatten();
            let amplitudes =
                size.map(|size| known.direction.iter().map(|part| size * part).collect()).ok_or(ALIKE);
            let point = shelf.points[chosen].0.clone();
            Hidden { candidate: shelf.candidate, amplitude: Some(index), point, amplitudes }
        };
        (0..candidate.amplitudes.len()).filter(is_asked).map(of_amplitude).collect()
    }

    /// An effect whose amplitudes are 1: a delay, or what is there or not; none of the latter that would be told.
    fn of_unit(&self, shelf: &Shelf) -> Option<Hidden> {
        let ln_odds = self.ln_prior(shelf.candidate) - (shelf.points.len() as f64).ln();
        let root = |regressors: &[_]| -> f64 {
            let normal = self.beside.normal(&self.described, regressors);
            normal.map_or(0.0, |it| it.information.sum().max(0.0).sqrt())
        };
        let hidden = |point: Vec<f64>, amplitudes| {
            Some(Hidden { candidate: shelf.candidate, amplitude: None, point, amplitudes })
        };
        let one_parameter = |(point, regressors): &(Vec<f64>, Arc<Vec<_>>)| match point.as_slice() {
            &[value] if value != 0.0 => Some((value, root(regressors) / value.abs())),
            _ => None,
        };
        let slopes: Vec<(f64, f64)> = shelf.points.iter().filter_map(one_parameter).collect();
        if slopes.is_empty() {
            let is_told = |(_, regressors): &(Vec<f64>, Arc<Vec<_>>)| {
                root(regressors) >= self.threshold.root_of_fixed(ln_odds)
            };
            return if shelf.points.iter().all(is_told) { None } else { hidden(Vec::new(), Err(TOO_SMALL)) };
        }
        // A small delay adds in proportion to itself.
        let nearest = |sign: f64| {
            let same = slopes.iter().filter(|(value, _)| value * sign > 0.0);
            same.min_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).copied()
        };
        let sides = [nearest(1.0), nearest(-1.0)].into_iter().flatten();
        let (value, slope) = sides.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let most = slopes.iter().map(|(value, _)| value.abs()).fold(0.0, f64::max);
        let size = self.threshold.root_of_fitted(ln_odds) / slope;
        if size <= most {
            hidden(vec![size * value.signum()], Ok(vec![1.0]))
        } else {
            hidden(Vec::new(), Err(BEYOND))
        }
    }

    fn of_shape(&self, reach: &Reach) -> Hidden {
        let candidate = self.candidate(reach.candidate);
        let count = candidate.amplitudes.len();
        let direction: Vec<f64> = (0..count).map(|index| f64::from(u8::from(index == 0))).collect();
        let spread = if reach.products.is_empty() { (reach.places.max(1) as f64).ln() } else { 0.0 };
        let sought = Sought {
            candidate,
            ln_prior: self.ln_prior(reach.candidate) - spread,
            free: count,
            sigma: reach.information.sqrt().recip(),
            direction: &direction,
        };
        let size = (reach.information > 0.0).then(|| self.threshold.size(&sought, &reach.products)).flatten();
        let amplitudes = size.map(|size| direction.iter().map(|part| size * part).collect()).ok_or(ALIKE);
        Hidden { candidate: reach.candidate, amplitude: Some(0), point: vec![reach.at], amplitudes }
    }

    fn bound(&self, hidden: &Hidden) -> Bound {
        let problem = self.beside.bench.problem;
        let candidate = self.candidate(hidden.candidate);
        let names = nonlinear_names(candidate);
        let bounded = hidden.amplitude.and_then(|index| candidate.amplitudes.get(index));
        let (parameter, unit) = match (bounded, names.as_slice()) {
            (Some(_), _) if matches!(candidate.search, Search::Frequency) => {
                ("amplitude".to_owned(), bounded.map_or_else(String::new, |it| it.unit.clone()))
            }
            (Some(amplitude), _) => (amplitude.name.clone(), amplitude.unit.clone()),
            (None, [(name, unit)]) => ((*name).to_owned(), (*unit).to_owned()),
            (None, _) => (String::new(), String::new()),
        };
        let known = hidden.amplitudes.as_ref().ok();
        let bound = known.and_then(|amplitudes| match (hidden.amplitude, bounded) {
            (Some(index), Some(amplitude)) => Some((amplitudes.get(index)? * amplitude.in_unit).abs()),
            _ => hidden.point.first().map(|value| value.abs()),
        });
        let at = |((name, unit), value): (&(&str, &str), &f64)| At {
            name: (*name).to_owned(),
            value: *value,
            unit: (*unit).to_owned(),
        };
        let places = names.iter().zip(&hidden.point).filter(|_| known.is_some() && bounded.is_some());
        let (adds_rms, adds_unit) = self.adds(candidate, &hidden.point, known);
        Bound {
            sensor: target_name(problem.model, candidate),
            effect: candidate.effect.id.to_owned(),
            variant: candidate
                .variant
                .iter()
                .map(|(name, word)| ((*name).to_owned(), word.clone()))
                .collect(),
            parameter,
            bound,
            unit,
            at: places.map(at).collect(),
            adds_rms,
            adds_unit,
            largest_plausible: bounded.and_then(|it| it.plausible).map(|[_, most]| most),
            because: hidden.amplitudes.as_ref().err().map(|because| (*because).to_owned()),
        }
    }

    /// Root of the mean square of what an effect adds to the sensor to which it adds most, in the unit in which that is written.
    fn adds(
        &self,
        candidate: &Candidate,
        point: &[f64],
        amplitudes: Option<&Vec<f64>>,
    ) -> (Option<f64>, String) {
        let problem = self.beside.bench.problem;
        let source = |sensor: usize| {
            let source = problem.model.source_of(sensor, candidate.port)?;
            problem.model.sources.get(source)
        };
        let first = sensors_of(candidate).first().and_then(|&sensor| source(sensor));
        let unit = first.map_or("", |source| source.unit.name()).to_owned();
        let Some(amplitudes) = amplitudes else { return (None, unit) };
        let columns = columns(candidate, point, problem.time_s());
        let of_sensor = |sensor: usize| {
            let mut sum = vec![0.0; problem.model.rows];
            for (column, amplitude) in columns.iter().zip(amplitudes) {
                let own = column.parts.iter().filter(|(of, _)| *of == sensor);
                for value in own.map(|(_, values)| values) {
                    let numbers = sum.iter_mut().zip(value.iter()).filter(|(_, value)| value.is_finite());
                    numbers.for_each(|(sum, value)| *sum += amplitude * value);
                }
            }
            let squares: f64 = sum.iter().map(|value| value * value).sum();
            let source = source(sensor)?;
            Some((
                (squares / sum.len().max(1) as f64).sqrt() / source.unit.in_si(),
                source.unit.name().to_owned(),
            ))
        };
        let all = sensors_of(candidate).into_iter().filter_map(of_sensor);
        all.max_by(|a, b| a.0.total_cmp(&b.0)).map_or((None, unit), |(rms, unit)| (Some(rms), unit))
    }
}

/// What is known of each of `count` amplitudes, of which some are kept, with their covariance.
fn known(count: usize, kept_and_covariance: Option<(Vec<usize>, DMatrix<f64>)>) -> Vec<Known> {
    let unknown = || Known { sigma: f64::INFINITY, direction: vec![0.0; count], free: 0 };
    let mut all: Vec<Known> = (0..count).map(|_| unknown()).collect();
    let Some((kept, covariance)) = kept_and_covariance else { return all };
    for (row, &index) in kept.iter().enumerate() {
        let variance = covariance[(row, row)];
        if !(variance > 0.0 && variance.is_finite() && index < count) {
            continue;
        }
        let mut direction = vec![0.0; count];
        for (column, &other) in kept.iter().enumerate() {
            direction[other] = covariance[(row, column)] / variance;
        }
        all[index] = Known { sigma: variance.sqrt(), direction, free: kept.len() };
    }
    all
}
