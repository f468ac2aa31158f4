//! Other descriptions of the same: terms in the place of some of those that a search found one by one.
//!
//! A search that takes one term at a time may take one that looks like the sum of two, beside which neither shows: a lag for a constant
//! and a drift. Where sources meet in fewer channels than there are of them there is more of that kind: an effect of one sensor is the sum of
//! the same effect of two others, each of another size, and what two sensors do together looks like what a third would do. In the place of one
//! item, and where sources meet of any two, the best terms are sought that promise as much. What they promise is linear algebra with the
//! library's products and sketches beside the items that stay ([`Library::leave_out`]); the best are fitted exactly.
use rayon::prelude::*;

use crate::budget::{Budget, of_round};
use crate::catalogue::NoiseChange;
use crate::description::Term;
use crate::library::{FURTHEST_ALIKE, Library, Purpose};
use crate::nominal::Model;
use crate::price::Price;
use crate::search::{Family, Proposal, deterministic, library, of_library, promising_pairs, promising_terms};
use crate::select::{
    Found, Item, Start, add_term, blocks_with, identity, is_at, is_of_slow_noise, several_sources, shown,
    speaks, without_all,
};
use crate::state::{Accepted, Bench, Case, State, refitted};

/// Nats less than what they replace that others may promise, as more may be found beside them.
const BEHIND: f64 = 5.0;
/// Pairs, and single terms, that are considered in the place of the same items.
const PAIRS_CONSIDERED: usize = 8;
const TERMS_CONSIDERED: usize = 3;
/// Those of all that are fitted exactly, and those of them from which the search goes on.
const TRIED: usize = 12;
const FOLLOWED: usize = 4;
/// Terms up to which any two are left out together.
const MOST_IN_TWOS: usize = 10;
/// Terms that are fitted beside a constant, and those of them from which the search goes on.
const TRIED_BESIDE_A_CONSTANT: usize = 8;
const FOLLOWED_BESIDE_A_CONSTANT: usize = 2;
/// Part of a signature that must be left beside a constant: with less the reference is so far that nothing of the two is known apart.
const FURTHEST_FROM_REFERENCE: f64 = 1e-3;
/// The effect that is the same at all times.
const CONSTANT: &str = "bias_constant";

/// Two terms that describe together what one of the description does.
#[derive(Clone, Debug)]
pub struct PairInstead {
    /// Candidate of the one.
    pub of: usize,
    /// The two.
    pub terms: [Term; 2],
    /// How much less the description with them is worth, nats.
    pub behind_nats: f64,
}

impl PairInstead {
    /// Whether `state`, which may be a better one than that it was compared with, has the one and neither of the two.
    pub fn stands_beside(&self, state: &State) -> bool {
        let has = |candidate: usize| state.terms.iter().any(|term| term.candidate == candidate);
        has(self.of) && !self.terms.iter().any(|term| has(term.candidate))
    }
}

/// The two terms that `other` has for one of `state`, all of one sensor, where that is all in which they differ.
pub fn two_for_one(case: &Case<'_>, state: &State, other: &State, behind_nats: f64) -> Option<PairInstead> {
    let only_in = |a: &State, b: &State| -> Vec<Term> {
        let is_in_b = |term: &&Term| b.terms.iter().any(|other| other.candidate == term.candidate);
        a.terms.iter().filter(|term| !is_in_b(term)).cloned().collect()
    };
    let of = only_in(state, other).try_into().ok().map(|[one]: [Term; 1]| one.candidate)?;
    let terms: [Term; 2] = only_in(other, state).try_into().ok()?;
    let target = |candidate: usize| &case.candidates[candidate].target;
    let of_one_sensor = terms.iter().all(|term| target(term.candidate) == target(of));
    let alike = identity(state).1 == identity(other).1 && state.terms.len() + 1 == other.terms.len();
    (alike && of_one_sensor).then_some(PairInstead { of, terms, behind_nats })
}

/// Where terms may stand for each other: sources that meet in the channels of a block together, all others each for itself.
pub fn places_of(model: &Model) -> Vec<Vec<usize>> {
    let meeting: Vec<Vec<usize>> =
        several_sources(model).map(|block| model.blocks[block].sources.clone()).collect();
    let meets = |source: &usize| meeting.iter().any(|sources| sources.contains(source));
    let alone = (0..model.sources.len()).filter(|source| !meets(source)).map(|source| vec![source]);
    alone.chain(meeting.iter().cloned()).collect()
}

/// Whether slow noise of a place is several terms in another description, that which terms first led to: together they look like it, and
/// those that were found one after the other may have begun with one that looks like two of them.
pub fn may_be_noise(case: &Case<'_>, with_noise: &State, of_terms: &State, place: &[usize]) -> bool {
    let own = of_terms.terms.iter().filter(|term| is_of(case, term.candidate, place));
    let is_slow_there = |change: &Accepted| place.contains(&change.source) && is_of_slow_noise(change);
    with_noise.changes.iter().any(is_slow_there)
        && own.count() > 1
        && identity(with_noise) != identity(of_terms)
}

/// Whether a candidate is about an output, or the input, that one of some sources is.
fn is_of(case: &Case<'_>, candidate: usize, sources: &[usize]) -> bool {
    sources.iter().any(|&source| is_at(case, candidate, source))
}

/// Log-likelihood of the residuals alone, which is what libraries know of.
fn of_residuals(state: &State) -> f64 {
    state.log_likelihood - state.told_beside
}

/// What other descriptions are sought with.
#[derive(Clone, Copy)]
pub struct Others<'o, 'c> {
    /// The case.
    pub case: &'o Case<'c>,
    /// For family-wise probabilities.
    pub family: &'o Family,
    /// ln of the family-wise level.
    pub ln_level: f64,
}

/// Terms that promise to describe what some items do.
struct Promised {
    /// Place of the description without those of the items that are no columns beside which entries are.
    base: usize,
    /// The other items, by their places in that description.
    left_out: Vec<Item>,
    terms: Vec<Term>,
    /// What they promise to say more than the items do, nats.
    more: f64,
    /// What the description is to be worth with them, nats.
    least: f64,
}

impl Others<'_, '_> {
    /// Descriptions with other terms in the place of some of what a place has.
    pub fn instead(&self, found: &Found<'_>, place: &[usize], budget: &mut Budget) -> Vec<Start> {
        let (state, _, prices) = found;
        let mut starts = self.two_instead((state, prices), place, budget);
        for &source in place {
            starts.extend(self.beside_a_constant((state, prices), source, budget));
        }
        starts
    }

    /// Descriptions in which the terms of a place, one of them, or an oscillation are replaced by two that promise as much together; where
    /// sources meet, also slow noise, a term together with another or with noise, and by one term.
    ///
    /// An oscillating error imitates whatever two terms have the frequency of a motion, a lag and a scale factor. Other changes of noise stay
    /// where no sources meet: slow noise is imitated by whatever shapes it takes.
    pub fn two_instead(
        &self,
        (state, prices): (&State, &[Price]),
        place: &[usize],
        budget: &mut Budget,
    ) -> Vec<Start> {
        let Self { case, family, .. } = *self;
        let bases = bases(case, state, place);
        if bases.is_empty() {
            return Vec::new();
        }
        let blocks = blocks_with(case.model, place[0]);
        let all = shown(case, state, prices, family);
        let cost = |item: Item| {
            let of_item = all.iter().filter(|(other, _)| *other == item);
            of_item.map(|(_, shown)| shown.cost()).sum::<f64>()
        };
        let mut starts: Vec<Start> = Vec::new();
        let mut promised: Vec<Promised> = Vec::new();
        for aside in bases {
            if case.watch.is_cancelled() || !budget.affords(of_round(case, state, &blocks)) {
                break;
            }
            let mut base = (state.clone(), prices.to_vec());
            if let Some(item) = aside {
                base = without_all(case, state, prices, &[item]);
                base.0 = refitted(case, &base.0, Some(&blocks)).0;
            }
            starts.push(base);
            promised.extend(self.promised(state, &starts, place, aside, &cost));
        }
        self.best_of(state, &starts, promised)
    }

    /// Terms that promise to describe what `aside`, which the last of `starts` has no more, and some of the place's terms do in `state`.
    /// `cost` is of an item of `state`.
    fn promised(
        &self,
        state: &State,
        starts: &[Start],
        place: &[usize],
        aside: Option<Item>,
        cost: &impl Fn(Item) -> f64,
    ) -> Vec<Promised> {
        let Self { case, family, .. } = *self;
        let Some((at_base, (base, _))) = starts.iter().enumerate().next_back() else { return Vec::new() };
        let meet = place.len() > 1;
        let is_of_place = |candidate: usize| is_of(case, candidate, place);
        let bench = Bench::new(case, &base.terms, &base.noises);
        let mut library = Library::new(&bench, Purpose::Pairs, &is_of_place);
        let whole = library.described();
        let of_aside = of_residuals(state) - of_residuals(base);
        let mut promised = Vec::new();
        for left_out in sets(&linear_terms(case, state, place), aside, meet) {
            if case.watch.is_cancelled() {
                break;
            }
            let costs =
                aside.map_or(0.0, cost) + left_out.iter().map(|&at| cost(Item::Term(at))).sum::<f64>();
            // Terms behind one that is aside are a place further to the front.
            let moved =
                |&at: &usize| at - usize::from(matches!(aside, Some(Item::Term(other)) if other < at));
            let left_out: Vec<usize> = left_out.iter().map(moved).collect();
            library.leave_out(&left_out);
            let by_them = of_aside + whole - library.described() - costs;
            let pairs = promising_pairs(case, &library, family, by_them - BEHIND, PAIRS_CONSIDERED);
            let singles =
                meet.then(|| promising_terms(case, &library, family, by_them - BEHIND, TERMS_CONSIDERED));
            let singles = singles.into_iter().flatten().map(|(said, term)| (said, vec![term]));
            let others = pairs.into_iter().map(|(said, pair)| (said, pair.to_vec())).chain(singles);
            let is_new = |(_, terms): &(f64, Vec<Term>)| {
                let again =
                    |term: &Term| left_out.iter().any(|&at| base.terms[at].candidate == term.candidate);
                !terms.iter().all(again)
            };
            promised.extend(others.filter(is_new).map(|(said, terms)| Promised {
                base: at_base,
                left_out: left_out.iter().copied().map(Item::Term).collect(),
                terms,
                more: said - by_them,
                least: state.log_likelihood - costs - BEHIND,
            }));
        }
        promised
    }

    /// The best descriptions, fitted exactly, of those that promise to be as good as `state`.
    fn best_of(&self, state: &State, starts: &[Start], mut promised: Vec<Promised>) -> Vec<Start> {
        let without = |base: usize, left_out: &[Item]| {
            let (state, prices) = &starts[base];
            without_all(self.case, state, prices, left_out)
        };
        promised.sort_by(|a, b| b.more.total_cmp(&a.more));
        // One for two of which the other comes back is one for one.
        let mut seen = vec![identity(state)];
        promised.retain(|Promised { base, left_out, terms, .. }| {
            let mut with = without(*base, left_out).0;
            with.terms.extend(terms.iter().cloned());
            let own = identity(&with);
            let is_new = !seen.contains(&own);
            seen.push(own);
            is_new
        });
        promised.truncate(TRIED);
        let exact = |Promised { base, left_out, terms, least, .. }: &Promised| {
            let (worth, start) = self.with(&without(*base, left_out), terms, FURTHEST_ALIKE)?;
            (worth > *least).then_some((worth - least, start))
        };
        followed(promised.par_iter().filter_map(exact).collect(), FOLLOWED)
    }

    /// Descriptions in which the terms of a source, or the slow noise of one without terms, are replaced by a constant and one term more.
    ///
    /// What depends on a quantity counted from a reference, where the readings have no error in the mean, shows with a constant beside it only:
    /// neither shows alone, and far from the reference the two are more alike than those of other pairs may be.
    fn beside_a_constant(
        &self,
        (state, prices): (&State, &[Price]),
        source: usize,
        budget: &mut Budget,
    ) -> Vec<Start> {
        let Self { case, family, .. } = *self;
        let wanted = |candidate: usize| is_of(case, candidate, &[source]);
        let is_constant =
            |candidate: usize| wanted(candidate) && case.candidates[candidate].effect.id == CONSTANT;
        let Some(constant) = (0..case.candidates.len()).find(|&candidate| is_constant(candidate)) else {
            return Vec::new();
        };
        let is_noise = |change: &Accepted| change.source == source && is_of_slow_noise(change);
        let terms = (0..state.terms.len()).filter(|&place| wanted(state.terms[place].candidate));
        let mut replaced: Vec<Item> = terms.map(Item::Term).collect();
        if replaced.is_empty() {
            replaced.extend(state.changes.iter().position(is_noise).map(Item::Change));
        }
        let blocks = blocks_with(case.model, source);
        let has_constant = state.terms.iter().any(|term| term.candidate == constant);
        if has_constant || replaced.is_empty() || !budget.affords(of_round(case, state, &blocks)) {
            return Vec::new();
        }
        let all = shown(case, state, prices, family);
        let of_them = all.iter().filter(|(item, _)| replaced.contains(item));
        let costs: f64 = of_them.map(|(_, shown)| shown.cost()).sum();
        let least = state.log_likelihood - costs - BEHIND;
        let (less, less_prices) = without_all(case, state, prices, &replaced);
        let less = (refitted(case, &less, Some(&blocks)).0, less_prices);
        let constant = Term::new(constant, &case.candidates[constant], &[], case.time_s);
        let terms = [less.0.terms.as_slice(), std::slice::from_ref(&constant)].concat();
        let bench = Bench::new(case, &terms, &less.0.noises);
        let beside = of_library(&bench, &library(&bench, &wanted), family);
        let exact = |proposal: Proposal| {
            let (worth, start) =
                self.with(&less, &[constant.clone(), proposal.term], FURTHEST_FROM_REFERENCE)?;
            (worth > least).then_some((worth, start))
        };
        let exact = beside.into_par_iter().take(TRIED_BESIDE_A_CONSTANT).filter_map(exact).collect();
        followed(exact, FOLLOWED_BESIDE_A_CONSTANT)
    }

    /// A description with one or two more terms, each at its best and significant beside the other, and its log-likelihood less what these
    /// cost.
    fn with(&self, (less, prices): &Start, terms: &[Term], furthest_alike: f64) -> Option<(f64, Start)> {
        let Self { case, family, ln_level } = *self;
        let at_its_best = |term: &Term, beside: Option<&Term>| {
            let terms = less.terms.iter().chain(beside).cloned().collect::<Vec<_>>();
            let bench = Bench::new(case, &terms, &less.noises);
            let wanted = |candidate: usize| candidate == term.candidate;
            deterministic(&bench, &library(&bench, &wanted), family, &wanted).into_iter().next()
        };
        let proposals = match terms {
            [first, second] => {
                let second = at_its_best(second, Some(first))?;
                let first = at_its_best(first, Some(&second.term))?;
                let bench = Bench::new(case, &less.terms, &less.noises);
                let apart = bench.angle_deg(&first.term, &second.term).to_radians().sin().powi(2);
                (apart >= furthest_alike).then(|| vec![first, second])?
            }
            [one] => vec![at_its_best(one, None)?],
            _ => return None,
        };
        let ln_p =
            |proposal: &Proposal| family.ln_p(&case.candidates[proposal.term.candidate], proposal.evidence);
        if !proposals.iter().all(|proposal| ln_p(proposal) <= ln_level) {
            return None;
        }
        let cost: f64 = proposals.iter().map(|proposal| proposal.gain - speaks(ln_p(proposal))).sum();
        let (mut with, mut prices) = (less.clone(), prices.clone());
        for proposal in proposals {
            add_term(&mut with, &mut prices, proposal);
        }
        let (with, _) = refitted(case, &with, None);
        Some((with.log_likelihood - cost, (with, prices)))
    }
}

/// Terms of a place with amplitudes, by their places in the description: columns of a library, which can be left out of it.
fn linear_terms(case: &Case<'_>, state: &State, place: &[usize]) -> Vec<usize> {
    let is_wanted = |term: &Term| is_of(case, term.candidate, place) && term.amplitudes() > 0;
    (0..state.terms.len()).filter(|&at| is_wanted(&state.terms[at])).collect()
}

/// Items of a place that are set aside each for a library of its own, terms without amplitudes and noises; and nothing, where it has terms
/// with amplitudes.
fn bases(case: &Case<'_>, state: &State, place: &[usize]) -> Vec<Option<Item>> {
    let is_unit = |term: &Term| is_of(case, term.candidate, place) && term.amplitudes() == 0;
    let units = (0..state.terms.len()).filter(|&at| is_unit(&state.terms[at]));
    let is_replaced = |change: &Accepted| {
        let is_oscillation = change.change == NoiseChange::ExponentialCosine;
        place.contains(&change.source) && (is_oscillation || place.len() > 1 && is_of_slow_noise(change))
    };
    let noises = (0..state.changes.len()).filter(|&at| is_replaced(&state.changes[at]));
    let nothing = (!linear_terms(case, state, place).is_empty()).then_some(None);
    nothing.into_iter().chain(units.map(Item::Term).chain(noises.map(Item::Change)).map(Some)).collect()
}

/// The terms that are left out together: each, all, and any two where sources meet; beside noise that is aside none, and each where sources meet.
fn sets(terms: &[usize], aside: Option<Item>, meet: bool) -> Vec<Vec<usize>> {
    let each = terms.iter().map(|&term| vec![term]);
    let mut sets: Vec<Vec<usize>> = match aside {
        Some(_) => std::iter::once(Vec::new()).chain(each.filter(|_| meet)).collect(),
        None => each.collect(),
    };
    if meet && aside.is_none() && terms.len() <= MOST_IN_TWOS {
        for (at, &second) in terms.iter().enumerate() {
            sets.extend(terms[..at].iter().map(|&first| vec![first, second]));
        }
    }
    let are_all_terms = !matches!(aside, Some(Item::Change(_)));
    if are_all_terms && !sets.iter().any(|set| set == terms) {
        sets.push(terms.to_vec());
    }
    sets
}

/// Of descriptions and what they are worth so many of the best.
fn followed(mut starts: Vec<(f64, Start)>, most: usize) -> Vec<Start> {
    starts.sort_by(|a, b| b.0.total_cmp(&a.0));
    starts.into_iter().take(most).map(|(_, start)| start).collect()
}
