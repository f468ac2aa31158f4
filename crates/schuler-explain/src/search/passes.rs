//! The search, and again on sums that are whitened by what it found.
use super::beam::{Beam, search};
use super::crowds;
use super::levels::{levels, with_level};
use super::library::{Shelf, library, whitened_again};
use super::moves::{nothing, structure, take_back};
use crate::evidence::fit::{Bench, Description};
use crate::explain::Error;
use crate::noise::fit::SourceKnob;
use crate::noise::weights::Covariances;
use crate::problem::Problem;

/// Passes in which the record is whitened anew by the noise that was found.
const PASSES: usize = 2;
/// Times that bands are made narrow where lines crowd.
const RESOLVED: usize = 4;

/// What a search came to.
pub struct Searched<'s> {
    /// What its descriptions are made of.
    pub bench: Bench<'s>,
    /// Signatures of fixed shape.
    pub library: Vec<Shelf>,
    /// Its descriptions.
    pub beam: Beam,
}

/// The search, again with the record whitened by what was found where that is far from what it was whitened by, and where the
/// innovations have another level in part of the rows.
///
/// # Errors
/// Where not even a description with nothing in it can be computed.
pub fn searched<'b>(problem: &'b Problem<'b>, nuisances: &[SourceKnob]) -> Result<Searched<'b>, Error> {
    let singular = || Error::NothingToCompare("no description of the record can be computed".to_owned());
    let noises = problem.model.nominal_noises();
    let first = Bench::new(problem, &noises, vec![Vec::new(); problem.model.blocks.len()]);
    let start = nothing(&first, &noises, nuisances).ok_or_else(singular)?;
    let mut now = Searched::resolved(first, start);
    for _ in 1..PASSES {
        let best = &now.beam.descriptions[0];
        if !is_far(&now.bench, best) {
            break;
        }
        let again = Bench::new(problem, &best.noises, now.bench.resolved.clone());
        let start = whitened_again(&again, best);
        let Some(start) = again.fitted_whole(&start) else { break };
        now = Searched::resolved(again, start);
    }
    for _ in 0..problem.config.most_levels {
        let Some(leveled) = now.with_level() else { break };
        now = leveled;
    }
    Ok(now)
}

impl<'s> Searched<'s> {
    fn new(bench: Bench<'s>, start: Description) -> Self {
        Self::until(bench, start, &|_, _| false)
    }

    /// The search from a description on, until the best is one that `ends` it.
    fn until(bench: Bench<'s>, start: Description, ends: &dyn Fn(&Bench<'_>, &Description) -> bool) -> Self {
        let library = library(bench.problem, &bench.sums);
        let beam = search(&bench, &library, start, ends);
        Self { bench, library, beam }
    }

    /// The search on bands that are narrow where it found lines that crowd.
    fn resolved(mut bench: Bench<'s>, mut start: Description) -> Self {
        for _ in 0..RESOLVED {
            let now = Self::until(bench, start, &crowds::is_crowded);
            let Some(next) = crowds::resolved(&now.bench, &now.beam.descriptions[0]) else { return now };
            (bench, start) = next;
        }
        Self::new(bench, start)
    }

    /// The search with the level that the best description promises, if that is better; the record without it is an alternative.
    fn with_level(&self) -> Option<Self> {
        let problem = self.bench.problem;
        let best = &self.beam.descriptions[0];
        let level = levels(&self.bench, best).into_iter().next().filter(|level| level.ln_gain > 0.0)?;
        let (bench, start) =
            with_level(best, &level, &|noises| Bench::new(problem, noises, self.bench.resolved.clone()))?;
        let mut leveled = Self::new(bench, start);
        let found = &leveled.beam.descriptions[0];
        if found.ln_evidence <= best.ln_evidence {
            return None;
        }
        let mut rest = found.clone();
        let place = rest.changes.iter().position(|change| *change == level.change)?;
        let change = rest.changes.remove(place);
        take_back(&leveled.bench, &mut rest, &change);
        let rest = self.bench.fitted_whole(&whitened_again(&self.bench, &rest));
        let without = self.beam.descriptions.iter().chain(rest.as_ref());
        leveled.beam.others.extend(self.beam.others.iter().cloned());
        leveled.beam.others.extend(without.map(|it| (structure(it), it.ln_evidence)));
        Some(leveled)
    }
}

/// Whether the noise of a description is far from what the record was whitened by.
fn is_far(bench: &Bench<'_>, description: &Description) -> bool {
    let limit = bench.problem.config.whiten_again_at.ln();
    bench.problem.model.blocks.iter().zip(&bench.sums).any(|(block, sums)| {
        let Some(sums) = sums else { return false };
        let width = sums.width() as f64;
        Covariances::new(block, sums, &description.noises).is_some_and(|covariances| {
            covariances.ln_determinant.iter().any(|value| (value / width).abs() > limit)
        })
    })
}
