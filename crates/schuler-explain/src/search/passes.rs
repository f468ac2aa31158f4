//! The search, and again on sums that are whitened by what it found.
use super::beam::{Beam, Ends};
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

/// The search, of a record that is whitened by what is found, and where the innovations have another level in part of the rows. What
/// takes the place of what is sought only where the whitening stays as it is.
///
/// # Errors
/// Where not even a description with nothing in it can be computed.
pub fn searched<'b>(problem: &'b Problem<'b>, nuisances: &[SourceKnob]) -> Result<Searched<'b>, Error> {
    let singular = || Error::NothingToCompare("no description of the record can be computed".to_owned());
    let noises = problem.model.nominal_noises();
    let first = Bench::new(problem, &noises, vec![Vec::new(); problem.model.blocks.len()]);
    let start = nothing(&first, &noises, nuisances).ok_or_else(singular)?;
    let mut now = Searched::ascended(first, start);
    for _ in 1..PASSES {
        let best = now.beam.best();
        if !is_far(&now.bench, best) {
            break;
        }
        let again = Bench::new(problem, &best.noises, now.bench.resolved.clone());
        let start = whitened_again(&again, best);
        let Some(start) = again.fitted_whole(&start) else { break };
        now = Searched::ascended(again, start);
    }
    now = now.settled();
    let mut is_settled = true;
    for _ in 0..problem.config.most_levels {
        let Some(leveled) = now.with_level() else { break };
        (now, is_settled) = (leveled, false);
    }
    Ok(if is_settled { now } else { now.settled() })
}

impl<'s> Searched<'s> {
    /// The ascent from a description on, on bands that are narrow where it found lines that crowd.
    fn ascended(mut bench: Bench<'s>, mut start: Description) -> Self {
        let mut round = 0;
        loop {
            let library = library(bench.problem, &bench.sums);
            let mut beam = Beam::new(start);
            beam.ascend(&bench, &library, ends(round));
            match crowds::resolved(&bench, beam.best()) {
                Some(next) if round < RESOLVED => (bench, start) = next,
                _ => return Self { bench, library, beam },
            }
            round += 1;
        }
    }

    /// The search from the best description on; where it finds lines that crowd, the ascent on narrower bands and the search there.
    fn settled(mut self) -> Self {
        let mut round = 0;
        loop {
            self.beam.search(&self.bench, &self.library, ends(round));
            let Some((bench, start)) = crowds::resolved(&self.bench, self.beam.best()) else { return self };
            if round == RESOLVED {
                return self;
            }
            let others = self.beam.others;
            self = Self::ascended(bench, start);
            self.beam.others = others;
            round += 1;
        }
    }

    /// The search with the level that the best description promises, if that is better; the record without it is an alternative.
    fn with_level(&self) -> Option<Self> {
        let problem = self.bench.problem;
        let best = self.beam.best();
        let level = levels(&self.bench, best).into_iter().next().filter(|level| level.ln_gain > 0.0)?;
        let (bench, start) =
            with_level(best, &level, &|noises| Bench::new(problem, noises, self.bench.resolved.clone()))?;
        let mut leveled = Self::ascended(bench, start);
        let found = leveled.beam.best();
        if found.ln_evidence <= best.ln_evidence {
            return None;
        }
        let mut rest = found.clone();
        let place = rest.changes.iter().position(|change| *change == level.change)?;
        let change = rest.changes.remove(place);
        take_back(&leveled.bench, &mut rest, &change);
        let rest = self.bench.fitted_whole(&whitened_again(&self.bench, &rest));
        leveled.beam.others.extend(self.beam.scored());
        leveled.beam.others.extend(rest.map(|it| (structure(&it), it.ln_evidence)));
        Some(leveled)
    }
}

/// What ends a search in a round: lines that crowd, but in the last.
fn ends(round: usize) -> &'static Ends<'static> {
    if round < RESOLVED { &crowds::is_crowded } else { &|_, _| false }
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
