//! Which terms and noise changes stay: forward selection with backward pruning.
//!
//! A round compares three ways on: the best deterministic term under the present noises, the best change of noise
//! alone, and both together. The nominal noise may have swallowed an effect, and an effect that was left out looks like
//! noise of another structure, so that each is judged beside the other: of the three the one with the most evidence is
//! taken, and what enters must be significant, family-wise, beside everything that is there. What is no longer
//! significant after something else entered leaves again.
//!
//! Several effects together look like noise of another structure, and may gain more as such than any of them alone. Where
//! a change of noise was taken, the search is therefore done once more with terms first and noise after, and the better
//! description of the two stands: the one with the larger log-likelihood less what its items cost. In the same way one
//! change of noise may imitate two of other sources in the same channel, and gain more than either: where sources meet and
//! a change was taken, the search goes on from the description without it, and once from all parts that the user names, with the
//! values that fit best together. A search that would go on as the search from nothing did ends where it meets its way.
//!
//! What a whole instrument has in common may take what is one sensor's own, and leave its opposite on another: the search goes on without
//! each term on a sensor that stands beside one on its instrument.
//!
//! Two terms may look like a third, beside which neither shows. Others are sought in the place of what was found, and the search goes on from
//! the best of them ([`crate::instead`]). So it does where the best description has slow noise in the place of several terms of the one
//! that terms first led to, and which may have begun with such a third.
//!
//! All that has a budget of work ([`crate::budget`]): the search from nothing has two thirds of it, all others share what it leaves.
use rayon::prelude::*;

use crate::budget::{Budget, of_round};
use crate::catalogue::{Candidate, NoiseChange, ReadingFault, Search, Target};
use crate::description::{Term, blocks_of};
use crate::explanation::Fit;
use crate::hold_out::hold_out;
use crate::instead::{Others, PairInstead, may_be_noise, places_of, two_for_one};
use crate::jump::{jumps, shown_beside};
use crate::library::{Library, Purpose};
use crate::noise::Knob;
use crate::noise_change::ChangeFit;
use crate::noise_fit::whittle_jointly;
use crate::nominal::Model;
use crate::price::Price;
use crate::search::{Family, Promise, Proposal, deterministic, evaluate, library, promises, refine_terms};
use crate::state::{Accepted, Bench, Case, State, refitted, refitted_above};
use crate::watch::Phase;

/// Findings at which the search ends, whatever there is left: what is significant decides, and not a number.
pub const MOST_FINDINGS: usize = 32;
/// Most terms that are taken before a change of noise is asked.
const MOST_TERMS_FIRST: usize = 4;
/// Part of the budget that the search from nothing leaves.
const FOR_OTHERS: f64 = 1.0 / 3.0;
/// Part of what that leaves which is for others in the place of what was found.
const FOR_PAIRS: f64 = 0.2;
/// Nats by which another description by way of a pair, or without a term, must be the better one: where they are nearly as good, what was
/// found one by one stands.
const WORTH_OTHER_TERMS: f64 = 1.0;
/// Rounds of seeking others in the place of what is found, where sources meet and each may be the better description.
const ROUNDS_WHERE_SOURCES_MEET: usize = 3;
/// Rounds, those that take something back included.
const MOST_ROUNDS: usize = 2 * MOST_FINDINGS;
/// Findings in whose number the progress is told, as it is not known how many there will be.
const USUAL_ROUNDS: f64 = 3.0;
/// Evidence of a noise change from which on terms are sought beside it.
const NOISE_WORTH_TRYING: f64 = 6.0;
/// Terms that are tried together with a noise change.
const TRIED_TOGETHER: usize = 3;
/// Proposals that are judged with the free noise parameters refitted.
const JUDGED_BESIDE_FREE_NOISE: usize = 6;
/// Nats within which two descriptions of the same items are one.
const SAME_NATS: f64 = 0.05;
/// Nats, above the price of its search, from which on an item is significant whatever its family.
const BEYOND_DOUBT: f64 = 50.0;
/// The effect that is a decay from the start on.
const WARMUP: &str = "bias_warmup";
/// Most parts of a noise of which the user says nothing.
const MOST_UNKNOWN_PARTS: usize = 2;

/// A finding: a term or a noise change by its place in the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// Place in [`State::terms`].
    Term(usize),
    /// Place in [`State::changes`].
    Change(usize),
}

/// What an item shows beside all others.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Gain in log-likelihood, nats.
    pub gain: f64,
    /// −ln p over the places searched.
    pub evidence: f64,
    /// ln of the family-wise probability.
    pub ln_p: f64,
}

impl Shown {
    /// Its gain that does not speak for it, nats.
    pub fn cost(&self) -> f64 {
        self.gain - speaks(self.ln_p)
    }
}

/// What was selected.
pub struct Selection<'c> {
    /// The description.
    pub state: State,
    /// It, whitened.
    pub bench: Bench<'c>,
    /// For family-wise probabilities.
    pub family: Family,
    /// What each item shows.
    pub shown: Vec<(Item, Shown)>,
    /// By what its terms are judged.
    prices: Vec<Price>,
    /// Pairs of terms in the place of one of its terms that are nearly as good.
    pub pairs: Vec<PairInstead>,
    /// Nothing but constants and nuisances.
    pub null: State,
    /// Whether the search ended at its budget of work.
    pub exceeded: bool,
}

/// Way on.
enum Move {
    Term(Box<Proposal>),
    Noise(usize, Box<ChangeFit>),
    Both(Box<Proposal>, usize, Box<ChangeFit>),
}

/// Selects from `start`, at the family-wise `level`.
pub fn select<'c>(case: &'c Case<'c>, start: &State, level: f64) -> Selection<'c> {
    let start = unknown_structure(case, start.clone());
    let (null, bench) = refitted(case, &start, None);
    let whole = Library::new(&bench, Purpose::NullDistribution, &|_| true);
    let family = Family::new(case.candidates, &whole);
    let first = Promised::new(&bench, &whole, &family);
    drop((bench, whole));
    let ln_level = level.ln();
    let valued = |found: Found<'c>, budget: &mut Budget| {
        let found = merged(case, found, &family, ln_level, budget);
        (worth(case, &found, &family), found)
    };
    let from_nothing = |way: Way, visited: &[Visited], budget: &mut Budget| {
        let walk = Walk { way, promised: first.clone(), stale: Vec::new(), visited };
        forward(case, (null.clone(), Vec::new()), &family, ln_level, walk, budget)
    };
    let mut budget = Budget::new(case.model);
    let aside = budget.set_aside(FOR_OTHERS);
    let Walked { found, visited, .. } = from_nothing(Way::Best, &[], &mut budget);
    let straight = valued(found, &mut budget);
    let mut budget = budget.with(aside);
    let mut for_pairs = budget.set_aside(FOR_PAIRS);
    // From another description, pruned.
    let from = |start: State, prices: Vec<Price>, way: Way, budget: &mut Budget| {
        let (start, _, prices) = pruned(case, start, prices, &family, ln_level);
        let stale = changed_blocks(case.model, &null, &start);
        let walk = Walk { way, promised: first.clone(), stale, visited: &visited };
        forward(case, (start, prices), &family, ln_level, walk, budget)
    };
    let (best, _, prices) = &straight.1;
    let terms_first = if budget.exceeded { Way::TermsThenAllNoise } else { Way::TermsFirst };
    let (others, [share, rest]) = ways_beside(case, best, terms_first, &mut budget);
    let searched = |way: Way| {
        let mut budget = if way == terms_first { share } else { rest };
        let mut least = straight.0;
        let walked = match way {
            Way::Best | Way::TermsFirst | Way::TermsThenAllNoise => from_nothing(way, &visited, &mut budget),
            Way::Without(candidate) => {
                let (item, mut prices) = (item_of(best, candidate), prices.clone());
                if let Some(Item::Term(place)) = item {
                    prices.remove(place);
                    least += WORTH_OTHER_TERMS;
                }
                let less = item.map_or_else(|| best.clone(), |item| without(case, best, item).0);
                from(less, prices, way, &mut budget)
            }
            Way::Parts(block) => from(parts(case, &null, block), Vec::new(), way, &mut budget),
        };
        let of_terms = (way == terms_first).then(|| (walked.found.0.clone(), walked.found.2.clone()));
        let found = (!walked.joined).then(|| valued(walked.found, &mut budget));
        (found.filter(|(worth, _)| *worth > least), of_terms, budget.exceeded)
    };
    let searched: Vec<_> = others.into_par_iter().map(searched).collect();
    let mut exceeded = budget.exceeded || searched.iter().any(|(.., exceeded)| *exceeded);
    let (mut best, mut of_terms) = (straight, None);
    for (found, with_terms, _) in searched {
        best = found.filter(|found| found.0 > best.0).unwrap_or(best);
        of_terms = of_terms.or(with_terms);
    }
    let mut pairs = Vec::new();
    let others = Others { case, family: &family, ln_level };
    let places = places_of(case.model);
    // In all places of the best first, and then of what terms first led to, with what is left of the budget.
    for (is_of_best, place) in places.iter().map(|it| (true, it)).chain(places.iter().map(|it| (false, it))) {
        let rounds = if is_of_best && place.len() > 1 { ROUNDS_WHERE_SOURCES_MEET } else { 1 };
        for _ in 0..rounds {
            let starts = if is_of_best {
                others.instead(&best.1, place, &mut for_pairs)
            } else {
                let may_be_noise = |it: &&Start| may_be_noise(case, &best.1.0, &it.0, place);
                of_terms.as_ref().filter(may_be_noise).map_or_else(Vec::new, |(state, prices)| {
                    others.two_instead((state, prices), place, &mut for_pairs)
                })
            };
            let before = best.0;
            for (start, prices) in starts {
                let walked = from(start, prices, Way::Best, &mut for_pairs);
                if walked.joined {
                    continue;
                }
                let other = valued(walked.found, &mut for_pairs);
                if other.0 > best.0 + WORTH_OTHER_TERMS {
                    best = other;
                } else if is_of_best {
                    pairs.extend(two_for_one(case, &best.1.0, &other.1.0, best.0 - other.0));
                }
            }
            if best.0 <= before {
                break;
            }
        }
    }
    exceeded |= for_pairs.exceeded;
    let (_, (state, bench, prices)) = best;
    pairs.retain(|pair| pair.stands_beside(&state));
    let shown = shown_up_to(case, &state, &prices, &family, f64::INFINITY);
    Selection { state, bench, family, shown, prices, pairs, null, exceeded }
}

/// The ways that a search goes beside that which led to `best`, and the budgets of the one that takes terms first and of each other.
fn ways_beside(
    case: &Case<'_>,
    best: &State,
    terms_first: Way,
    budget: &mut Budget,
) -> (Vec<Way>, [Budget; 2]) {
    let mut others = Vec::new();
    if !best.changes.is_empty() {
        others.push(terms_first);
    }
    for index in several_sources(case.model) {
        let sources = &case.model.blocks[index].sources;
        let own = best.changes.iter().filter(|change| sources.contains(&change.source));
        let without: Vec<Way> = own.map(|change| Way::Without(change.candidate)).collect();
        if !without.is_empty() {
            others.extend(without);
            others.push(Way::Parts(index));
        }
    }
    // Terms first are what several effects together want: they have as much as all other ways. What goes on from another description
    // begins with a round's work on it.
    let first = usize::from(others.contains(&terms_first));
    let left: Vec<Way> = left_by_instruments(case, best).map(Way::Without).collect();
    let blocks: Vec<usize> = (0..case.model.blocks.len()).collect();
    let round = of_round(case, best, &blocks);
    let share = budget.shared_among(if others.len() + left.len() > first { 1 + first } else { 1 });
    let of_each = |more: usize| share.shared_among(others.len() - first + more);
    let affordable = (0..=left.len()).rev().find(|&more| of_each(more).affords(round));
    let rest = of_each(affordable.unwrap_or_default());
    if affordable.is_none() {
        budget.exceeded |= others.iter().any(|way| *way != terms_first);
        others.retain(|way| *way == terms_first);
    }
    // The last entered showed least.
    others.extend(left.into_iter().rev().take(affordable.unwrap_or_default()));
    (others, [share, rest])
}

/// What was selected, judged in another case of the same candidates: what is no longer significant leaves.
pub fn judged_again<'c>(case: &'c Case<'c>, selection: Selection<'_>, level: f64) -> Selection<'c> {
    let Selection { state, family, prices, pairs, null, exceeded, .. } = selection;
    let ((state, _), (null, _)) = (refitted(case, &state, None), refitted(case, &null, None));
    let (state, bench, prices) = pruned(case, state, prices, &family, level.ln());
    let shown = shown_up_to(case, &state, &prices, &family, f64::INFINITY);
    Selection { state, bench, family, shown, prices, pairs, null, exceeded }
}

impl Selection<'_> {
    /// The description without some items, everything else as it was, and what some of them cost, nats.
    pub fn without(&self, case: &Case<'_>, items: &[Item], saved: &[Item]) -> (State, f64) {
        let costs = self.shown.iter().filter(|(item, _)| saved.contains(item)).map(|(_, shown)| shown.cost());
        (without_all(case, &self.state, &self.prices, items).0, costs.sum())
    }

    /// The slow noise that was selected of a source, and the shapes in time of it that nothing recorded causes.
    pub fn uncaused(&self, case: &Case<'_>, source: usize) -> (Vec<Item>, Vec<Item>) {
        let State { terms, changes, .. } = &self.state;
        let terms = (0..terms.len()).filter(|&place| is_uncaused(case, &terms[place], source));
        let is_noise = |change: &Accepted| change.source == source && is_of_slow_noise(change);
        let noises = (0..changes.len()).filter(|&place| is_noise(&changes[place]));
        (noises.map(Item::Change).collect(), terms.map(Item::Term).collect())
    }
}

/// A description without some of its items, everything else as it was, and the prices of what is left.
pub fn without_all(case: &Case<'_>, state: &State, prices: &[Price], items: &[Item]) -> (State, Vec<Price>) {
    let (mut less, mut less_prices) = (state.clone(), prices.to_vec());
    let place = |item: &Item| match *item {
        Item::Term(place) | Item::Change(place) => place,
    };
    let mut items = items.to_vec();
    // The last first, so that the places of the others stay.
    items.sort_by_key(|item| std::cmp::Reverse(place(item)));
    for item in items {
        less = taken_out(case, &less, item);
        if let Item::Term(place) = item {
            less_prices.remove(place);
        }
    }
    (less, less_prices)
}

/// What a round takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// What shows most.
    Best,
    /// Terms while there are any, then what shows most.
    TermsFirst,
    /// Terms, in a redundant set as many as it has sensors; then all parts of the noises at once, and then what shows most. Many sensors
    /// with an error and another noise each are more than a search finds one by one within its budget.
    TermsThenAllNoise,
    /// From the best description without the item that is this candidate: what shows most but for it.
    Without(usize),
    /// What shows most beside the nominal parts of the noises of a block with other values.
    Parts(usize),
}

/// The blocks in whose channels several sources meet.
pub fn several_sources(model: &Model) -> impl Iterator<Item = usize> + '_ {
    (0..model.blocks.len()).filter(|&block| model.blocks[block].channels < model.blocks[block].sources.len())
}

/// Terms on a sensor beside a term on its whole instrument: it may have taken what is another sensor's own, and left this.
fn left_by_instruments<'s>(case: &'s Case<'_>, state: &'s State) -> impl Iterator<Item = usize> + 's {
    let target = |term: &Term| &case.candidates[term.candidate].target;
    let on_instrument = move |sensor: usize| {
        let holds =
            |term: &Term| matches!(target(term), Target::Group { sensors, .. } if sensors.contains(&sensor));
        state.terms.iter().any(holds)
    };
    let is_left =
        move |term: &&Term| matches!(*target(term), Target::Sensor(sensor) if on_instrument(sensor));
    state.terms.iter().filter(is_left).map(|term| term.candidate)
}

/// All parts of the noises of a block that the user names, as changes, with the values that fit best together.
fn parts(case: &Case<'_>, null: &State, block: usize) -> State {
    let mut state = null.clone();
    for &source in &case.model.blocks[block].sources {
        let origin = &case.model.sources[source];
        for change in [NoiseChange::White, NoiseChange::Markov, NoiseChange::ExponentialCosine] {
            let is_of_change = |knob: &Knob| match knob {
                Knob::White => change == NoiseChange::White,
                Knob::MarkovSigma(_) | Knob::MarkovTau(_) => change == NoiseChange::Markov,
                Knob::CosineSigma(_) | Knob::CosineAlpha(_) | Knob::CosineBeta(_) => {
                    change == NoiseChange::ExponentialCosine
                }
                _ => false,
            };
            let knobs: Vec<Knob> = state.noises[source].knobs().into_iter().filter(is_of_change).collect();
            let is_it = |candidate: &Candidate| {
                let Target::Sensor(sensor) = candidate.target else { return false };
                matches!(candidate.search, Search::Noise(other) if other == change)
                    && case.model.source_of(sensor, candidate.port) == Some(source)
            };
            if let Some(candidate) = case.candidates.iter().position(is_it)
                && !(knobs.is_empty() || origin.unknown)
            {
                let freedom = knobs.len();
                state.changes.push(Accepted { candidate, source, change, knobs, freedom, ln_places: 0.0 });
            }
        }
    }
    let bench = Bench::new(case, &state.terms, &state.noises);
    if let Some(spectrum) = bench.spectrum(block) {
        let free = state.free_in(case.model, block);
        state.noises = whittle_jointly(&case.model.blocks[block], spectrum, &state.noises, &free);
    }
    refitted(case, &state, Some(&[block])).0
}

/// What terms promise under a description, and what those that were evaluated show.
#[derive(Clone)]
struct Promised {
    promises: Vec<Promise>,
    proposals: Vec<Proposal>,
}

impl Promised {
    /// All terms, under a description with its library.
    fn new(bench: &Bench<'_>, library: &Library, family: &Family) -> Self {
        let mut promises = promises(bench, library, family, &|_| true);
        let mut proposals = jumps(bench, &|_| true);
        evaluate(bench, &mut promises, &mut proposals);
        Self { promises, proposals }
    }

    /// The same after a round, which leaves what it does not touch as it was.
    fn renew(&mut self, bench: &Bench<'_>, family: &Family, touched: &(dyn Fn(usize) -> bool + Sync)) {
        self.promises.retain(|promise| !touched(promise.candidate));
        self.proposals.retain(|proposal| !touched(proposal.term.candidate));
        self.promises.extend(promises(bench, &library(bench, touched), family, touched));
        self.proposals.extend(jumps(bench, touched));
        evaluate(bench, &mut self.promises, &mut self.proposals);
    }
}

/// Where a search came by: the candidates of a description, terms and changes, and its log-likelihood.
type Visited = ((Vec<usize>, Vec<usize>), f64);

/// How a search goes: what its rounds take, what terms promise where it begins, but for those of some blocks, and where the search from
/// nothing came by.
struct Walk<'v> {
    way: Way,
    promised: Promised,
    stale: Vec<usize>,
    visited: &'v [Visited],
}

/// Where a search led.
struct Walked<'c> {
    found: Found<'c>,
    /// Where it came by.
    visited: Vec<Visited>,
    /// Whether it ended where it would have gone on as the search from nothing did.
    joined: bool,
}

/// A description and the prices of its terms.
pub type Start = (State, Vec<Price>);

/// A description, whitened, and the prices of its terms.
pub type Found<'c> = (State, Bench<'c>, Vec<Price>);

/// What an item of a family-wise probability p says for a description, nats: less than −ln p, as whatever is supposed of its size, that there
/// is nothing is behind by a factor of −1/(e p ln p) at most (Sellke, Bayarri, Berger, Am. Stat. 55, 2001, 62). What is told by two items has
/// to pay for the size of the second.
pub fn speaks(ln_p: f64) -> f64 {
    // The gain of what is beyond doubt is at least what is told; its logarithm is that of where doubt ends.
    let against = (-ln_p).max(1.0);
    against - against.min(BEYOND_DOUBT).ln() - 1.0
}

/// Log-likelihood less what the items cost: of each the difference of its gain and of what it says against there being nothing.
fn worth(case: &Case<'_>, (state, _, prices): &Found<'_>, family: &Family) -> f64 {
    let shown = shown(case, state, prices, family);
    state.log_likelihood - shown.iter().map(|(_, shown)| shown.cost()).sum::<f64>()
}

/// Rounds of the search from a description and the prices of its terms.
fn forward<'c>(
    case: &'c Case<'c>,
    (mut state, mut prices): (State, Vec<Price>),
    family: &Family,
    ln_level: f64,
    Walk { way, mut promised, mut stale, visited: straight }: Walk<'_>,
    budget: &mut Budget,
) -> Walked<'c> {
    let mut bench = Bench::new(case, &state.terms, &state.noises);
    let mut terms_only = matches!(way, Way::TermsFirst | Way::TermsThenAllNoise);
    let mut most_terms_first = MOST_TERMS_FIRST;
    if way == Way::TermsThenAllNoise {
        let sources = several_sources(case.model).map(|block| case.model.blocks[block].sources.len());
        most_terms_first = sources.fold(most_terms_first, usize::max);
    }
    let mut noises: Vec<(usize, ChangeFit)> = Vec::new();
    // Blocks whose changes of noise are to be fitted anew.
    let mut unfitted: Vec<usize> = (0..case.model.blocks.len()).collect();
    let mut visited: Vec<Visited> = vec![(identity(&state), state.log_likelihood)];
    let mut joined = false;
    for round in 0..MOST_ROUNDS {
        if state.terms.len() + state.changes.len() >= MOST_FINDINGS || case.watch.is_cancelled() {
            break;
        }
        // One that leaves an item out goes on by itself.
        let goes_on_alike = !(terms_only || matches!(way, Way::Without(_)));
        joined = goes_on_alike
            && straight.iter().any(|(items, log_likelihood)| {
                *items == identity(&state) && (log_likelihood - state.log_likelihood).abs() < SAME_NATS
            });
        // The first asks all changes of noise.
        let work = of_round(case, &state, if round == 0 { &unfitted } else { &stale });
        if joined || !budget.affords(work) {
            break;
        }
        if !stale.is_empty() {
            promised.renew(&bench, family, &|candidate| touches(case, candidate, &stale));
            stale.clear();
        }
        case.watch.progress(Phase::Search, round as f64 / (round as f64 + USUAL_ROUNDS));
        let proposals = &mut promised.proposals;
        judge_beside_free_noise(case, &state, &bench, proposals);
        for proposal in swallowed(case, &state, &bench, family) {
            let known = |other: &Proposal| other.term.candidate == proposal.term.candidate;
            match proposals.iter_mut().find(|other| known(other)) {
                Some(other) if other.evidence < proposal.evidence => *other = proposal,
                Some(_) => {}
                None => proposals.push(proposal),
            }
        }
        let wanted = |candidate: usize| way != Way::Without(candidate);
        proposals.retain(|proposal| wanted(proposal.term.candidate));
        proposals.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let mut chosen = None;
        if terms_only {
            // A mean that comes and goes follows whatever several terms do together.
            let is_jump = |proposal: &Proposal| case.candidates[proposal.term.candidate].is_jump();
            let best = proposals.iter().find(|proposal| !is_jump(proposal)).cloned();
            chosen = choose(case, &state, &bench, family, (best.as_slice(), &[], &wanted), ln_level);
            terms_only = chosen.is_some() && state.terms.len() < most_terms_first;
            if way == Way::TermsThenAllNoise && !terms_only && state.changes.is_empty() {
                for block in several_sources(case.model) {
                    state = parts(case, &state, block);
                }
                (state, bench, prices) = pruned(case, state, prices, family, ln_level);
                visited.push((identity(&state), state.log_likelihood));
                stale = (0..case.model.blocks.len()).collect();
                continue;
            }
        }
        if !terms_only {
            noises.retain(|(_, fit)| {
                !unfitted.iter().any(|&block| case.model.blocks[block].sources.contains(&fit.source))
            });
            noises.extend(bench.noise_changes(&state, &unfitted, &wanted));
            noises.sort_by(|a, b| a.1.ln_p.total_cmp(&b.1.ln_p));
            unfitted.clear();
            chosen = choose(case, &state, &bench, family, (proposals, &noises, &wanted), ln_level);
        }
        let Some(chosen) = chosen else { break };
        let (mut next, mut next_prices) = (state.clone(), prices.clone());
        match chosen {
            Move::Term(proposal) => add_term(&mut next, &mut next_prices, *proposal),
            Move::Noise(candidate, fit) => add_change(&mut next, candidate, *fit),
            Move::Both(proposal, candidate, fit) => {
                add_change(&mut next, candidate, *fit);
                add_term(&mut next, &mut next_prices, *proposal);
            }
        }
        let (mut next, _) = refitted(case, &next, None);
        let moved = changed_blocks(case.model, &state, &next);
        let touched = |candidate: usize| touches(case, candidate, &moved);
        // What promised little by itself was taken where the grid has it, and others move what is beside them.
        if refine_terms(case, &mut next, &touched) {
            next = refitted(case, &next, None).0;
        }
        let (next, next_bench, next_prices) = pruned(case, next, next_prices, family, ln_level);
        // What was there before would come round again.
        if visited.iter().any(|(items, _)| *items == identity(&next)) {
            break;
        }
        visited.push((identity(&next), next.log_likelihood));
        stale = changed_blocks(case.model, &state, &next);
        unfitted.extend(&stale);
        (state, bench, prices) = (next, next_bench, next_prices);
    }
    Walked { found: (state, bench, prices), visited, joined }
}

/// Where noise parameters are free, the best proposals are judged with them refitted: fixed at values that have
/// swallowed an effect they would hide it. Where sensors are redundant, with what their readings tell beside the residuals.
fn judge_beside_free_noise(case: &Case<'_>, state: &State, bench: &Bench<'_>, proposals: &mut [Proposal]) {
    proposals.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    let judged: Vec<Option<f64>> = (proposals.par_iter().take(JUDGED_BESIDE_FREE_NOISE))
        .map(|proposal| {
            let blocks = blocks_of(case.model, std::slice::from_ref(&proposal.term));
            let is_known = |&block: &usize| {
                state.free_in(case.model, block).is_empty() && case.model.common_motion_of(block).is_none()
            };
            if blocks.iter().all(is_known) {
                return None;
            }
            let mut with = state.clone();
            with.terms.push(proposal.term.clone());
            let (with, _) = refitted(case, &with, Some(&blocks));
            Some(with.log_likelihood - bench.log_likelihood)
        })
        .collect();
    for (proposal, gain) in proposals.iter_mut().zip(judged) {
        if let Some(gain) = gain {
            proposal.gain = gain;
            proposal.evidence = proposal.price.evidence(gain);
        }
    }
}

/// What noise that was accepted may have swallowed: terms that show most under the noise that the user believes, judged
/// beside the accepted noise fitted anew.
///
/// Slow noise imitates a constant, and steps between conditions: under the noise fitted to it such a term gains next to
/// nothing and would never be tried, though both fitted together leave much less noise. Where it was noise after all,
/// they do not, and the term is refused as any other.
fn swallowed(case: &Case<'_>, state: &State, bench: &Bench<'_>, family: &Family) -> Vec<Proposal> {
    let mut noises = state.noises.clone();
    let mut blocks: Vec<usize> = Vec::new();
    for change in state.changes.iter().filter(|change| is_of_slow_noise(change)) {
        noises[change.source] = case.model.sources[change.source].nominal.clone();
        blocks.extend(case.model.block_of_source(change.source));
    }
    blocks.sort_unstable();
    blocks.dedup();
    if blocks.is_empty() {
        return Vec::new();
    }
    let nominal = Bench::new(case, &state.terms, &noises);
    let mut tried: Vec<Proposal> = Vec::new();
    for &block in &blocks {
        let touched = |candidate: usize| touches(case, candidate, &[block]);
        let shown = deterministic(&nominal, &library(&nominal, &touched), family, &touched);
        for proposal in shown.into_iter().take(TRIED_TOGETHER) {
            if tried.iter().all(|other| other.term.candidate != proposal.term.candidate) {
                tried.push(proposal);
            }
        }
    }
    let judged = tried.into_par_iter().map(|mut proposal| {
        let own = blocks_of(case.model, std::slice::from_ref(&proposal.term));
        let mut with = state.clone();
        with.terms.push(proposal.term.clone());
        let (with, _) = refitted(case, &with, Some(&own));
        proposal.gain = with.log_likelihood - bench.log_likelihood;
        proposal.evidence = proposal.price.evidence(proposal.gain);
        proposal
    });
    judged.collect()
}

/// Whether a noise parameter is of a part that remembers.
fn is_slow(knob: Knob) -> bool {
    !matches!(knob, Knob::White | Knob::Angle | Knob::StepRatio)
}

/// Whether a change of noise has such parameters.
pub fn is_of_slow_noise(change: &Accepted) -> bool {
    change.knobs.iter().any(|&knob| is_slow(knob))
}

/// Noise parts for sources of which the user says nothing: what Schwarz's criterion asks for, as nuisances.
fn unknown_structure(case: &Case<'_>, mut state: State) -> State {
    let changes = [NoiseChange::Markov, NoiseChange::ExponentialCosine, NoiseChange::RandomWalk];
    for _ in 0..MOST_UNKNOWN_PARTS {
        let (fitted, bench) = refitted(case, &state, None);
        state = fitted;
        let mut added = false;
        for (source, _) in case.model.sources.iter().enumerate().filter(|(_, origin)| origin.unknown) {
            let best =
                changes.iter().filter_map(|&change| bench.fit_change(source, change)).max_by(|a, b| {
                    let score = |fit: &ChangeFit| {
                        fit.gain - 0.5 * fit.knobs.len() as f64 * (case.model.rows as f64).ln()
                    };
                    score(a).total_cmp(&score(b))
                });
            if let Some(fit) = best
                && fit.gain > 0.5 * fit.knobs.len() as f64 * (case.model.rows as f64).ln()
            {
                state.noises[source] = fit.noises[source].clone();
                for knob in fit.knobs {
                    if !state.nuisances.contains(&(source, knob)) {
                        state.nuisances.push((source, knob));
                    }
                }
                added = true;
            }
        }
        if !added {
            break;
        }
    }
    state
}

/// The blocks in whose channels a source is.
pub fn blocks_with(model: &Model, source: usize) -> Vec<usize> {
    (0..model.blocks.len()).filter(|&block| model.blocks[block].sources.contains(&source)).collect()
}

/// Whether a candidate reaches one of `blocks`.
pub fn touches(case: &Case<'_>, candidate: usize, blocks: &[usize]) -> bool {
    let reaches = |sensor: &usize| case.model.block_of(*sensor).is_some_and(|block| blocks.contains(&block));
    match &case.candidates[candidate].target {
        Target::Sensor(sensor) => reaches(sensor),
        Target::Group { sensors, .. } => sensors.iter().any(reaches),
    }
}

/// Adds a term.
pub fn add_term(state: &mut State, prices: &mut Vec<Price>, proposal: Proposal) {
    prices.push(proposal.price);
    state.terms.push(proposal.term);
}

/// Adds a change of noise.
pub fn add_change(state: &mut State, candidate: usize, fit: ChangeFit) {
    state.noises[fit.source] = fit.noises[fit.source].clone();
    state.changes.push(Accepted {
        candidate,
        source: fit.source,
        change: fit.change,
        knobs: fit.knobs,
        freedom: fit.freedom,
        ln_places: fit.ln_places,
    });
}

/// The item of a description that a candidate is.
fn item_of(state: &State, candidate: usize) -> Option<Item> {
    let change = state.changes.iter().position(|change| change.candidate == candidate).map(Item::Change);
    change.or_else(|| state.terms.iter().position(|term| term.candidate == candidate).map(Item::Term))
}

/// The candidates that a state consists of, whatever their order.
pub fn identity(state: &State) -> (Vec<usize>, Vec<usize>) {
    let mut terms: Vec<usize> = state.terms.iter().map(|term| term.candidate).collect();
    let mut changes: Vec<usize> = state.changes.iter().map(|change| change.candidate).collect();
    terms.sort_unstable();
    changes.sort_unstable();
    (terms, changes)
}

/// The blocks whose description differs.
fn changed_blocks(model: &Model, a: &State, b: &State) -> Vec<usize> {
    let differing: Vec<Term> =
        (a.terms.iter().filter(|term| b.terms.iter().all(|t| t.candidate != term.candidate)))
            .chain(b.terms.iter().filter(|term| a.terms.iter().all(|t| t.candidate != term.candidate)))
            .cloned()
            .collect();
    let mut blocks = blocks_of(model, &differing);
    for (index, block) in model.blocks.iter().enumerate() {
        if block.sources.iter().any(|&source| a.noises[source] != b.noises[source]) {
            blocks.push(index);
        }
    }
    // A term over several blocks ties their amplitudes together.
    for terms in [&a.terms, &b.terms] {
        for term in terms {
            let own = blocks_of(model, std::slice::from_ref(term));
            if own.len() > 1 && own.iter().any(|block| blocks.contains(block)) {
                blocks.extend(own);
            }
        }
    }
    blocks.sort_unstable();
    blocks.dedup();
    blocks
}

/// Terms and changes of noise by their evidence, and which candidates may be taken.
type Ways<'w> = (&'w [Proposal], &'w [(usize, ChangeFit)], &'w (dyn Fn(usize) -> bool + Sync));

/// The way on with the most evidence, if it is significant.
fn choose(
    case: &Case<'_>,
    state: &State,
    bench: &Bench<'_>,
    family: &Family,
    (proposals, noises, wanted): Ways<'_>,
    ln_level: f64,
) -> Option<Move> {
    let ln_p_of =
        |proposal: &Proposal, evidence| family.ln_p(&case.candidates[proposal.term.candidate], evidence);
    let mut best: Option<(f64, Move)> = None;
    let mut consider = |score: f64, way: Move| {
        if best.as_ref().is_none_or(|best| score > best.0) {
            best = Some((score, way));
        }
    };
    if let Some(proposal) = proposals.first()
        && ln_p_of(proposal, proposal.evidence) <= ln_level
    {
        consider(proposal.evidence, Move::Term(Box::new(proposal.clone())));
    }
    if let Some((candidate, fit)) = noises.first()
        && family.ln_p(&case.candidates[*candidate], -fit.ln_p) <= ln_level
    {
        consider(-fit.ln_p, Move::Noise(*candidate, Box::new(fit.clone())));
    }
    // Both: per block, terms beside the best change of its noise.
    let leading: Vec<(usize, usize, &ChangeFit)> = (case.model.blocks.iter().enumerate())
        .filter_map(|(index, block)| {
            let own = noises.iter().find(|(_, fit)| block.sources.contains(&fit.source));
            let (candidate, fit) = own.filter(|(_, fit)| -fit.ln_p > NOISE_WORTH_TRYING)?;
            Some((index, *candidate, fit))
        })
        .collect();
    let beside_noise = |(index, candidate, fit): (usize, usize, &ChangeFit)| {
        let mut noisy = state.clone();
        add_change(&mut noisy, candidate, fit.clone());
        let (noisy, noisy_bench) = refitted(case, &noisy, Some(&[index]));
        let touched = |candidate: usize| wanted(candidate) && touches(case, candidate, &[index]);
        let judge = |proposal: &Proposal| {
            let mut both = noisy.clone();
            both.terms.push(proposal.term.clone());
            let (both, _) = refitted(case, &both, Some(&[index]));
            let alone = bench.gain_by_readings(&proposal.term);
            let of_term = both.log_likelihood - noisy.log_likelihood;
            let of_both = both.log_likelihood - bench.log_likelihood;
            let of_noise = fit.change.counted(of_both - alone, both.told_beside - state.told_beside);
            let term_evidence = proposal.price.evidence(of_term);
            let noise_evidence = fit.price().evidence(of_noise);
            let noise_remains = family.ln_p(&case.candidates[candidate], noise_evidence) <= ln_level;
            let significant = noise_remains && ln_p_of(proposal, term_evidence) <= ln_level;
            let found = significant.then(|| {
                let score = alone + noise_evidence - (of_term - term_evidence);
                let fit = ChangeFit { noises: both.noises, ..fit.clone() };
                (score, Move::Both(Box::new(proposal.clone()), candidate, Box::new(fit)))
            });
            (noise_remains, found)
        };
        // A change of noise that shows less than a term, and nothing beside it, was the term. If there is noise of another structure
        // as well, it shows once the term is described; to seek terms beside this one is most of a round's work. Where several sources
        // meet the term may be another's that looks the same under the wrong noise.
        let alone = case.model.blocks[index].sources.len() == 1;
        let strongest = proposals.iter().find(|proposal| alone && touched(proposal.term.candidate));
        let is_the_term = |term: &Proposal| {
            term.evidence > -fit.ln_p && ln_p_of(term, term.evidence) <= ln_level && !judge(term).0
        };
        if strongest.is_some_and(is_the_term) {
            return Vec::new();
        }
        let beside = deterministic(&noisy_bench, &library(&noisy_bench, &touched), family, &touched);
        let under_nominal = proposals.iter().filter(|proposal| touched(proposal.term.candidate)).cloned();
        let mut tried: Vec<Proposal> = Vec::new();
        for proposal in beside.into_iter().take(TRIED_TOGETHER).chain(under_nominal.take(TRIED_TOGETHER)) {
            if tried.iter().all(|other| other.term.candidate != proposal.term.candidate) {
                tried.push(proposal);
            }
        }
        tried.par_iter().map(|proposal| judge(proposal).1).collect::<Vec<_>>()
    };
    let both: Vec<Vec<_>> = leading.into_par_iter().map(beside_noise).collect();
    for (score, way) in both.into_iter().flatten().flatten() {
        consider(score, way);
    }
    best.map(|(_, way)| way)
}

/// The state without an item, refitted.
pub fn without<'c>(case: &'c Case<'c>, state: &State, item: Item) -> (State, Bench<'c>) {
    refitted(case, &taken_out(case, state, item), None)
}

/// The state without an item, everything else as it was.
fn taken_out(case: &Case<'_>, state: &State, item: Item) -> State {
    let mut less = state.clone();
    match item {
        Item::Term(place) => {
            less.terms.remove(place);
        }
        Item::Change(place) => {
            let change = less.changes.remove(place);
            let own = &mut less.noises[change.source];
            let mut reset = case.model.sources[change.source].nominal.clone();
            // Other changes of the same source stay as far as they are of other parts.
            for other in less.changes.iter().filter(|other| other.source == change.source) {
                reset.adopt(own, &other.knobs);
            }
            *own = reset;
            let source = change.source;
            for other in less.changes.iter_mut().filter(|other| other.source == source) {
                let noise = &less.noises[source];
                other.knobs.retain(|&knob| noise.get(knob) > 0.0);
            }
        }
    }
    less
}

/// The state without items that are no longer significant.
pub fn pruned<'c>(
    case: &'c Case<'c>,
    mut state: State,
    mut prices: Vec<Price>,
    family: &Family,
    ln_level: f64,
) -> (State, Bench<'c>, Vec<Price>) {
    loop {
        let mut weak = shown(case, &state, &prices, family);
        weak.retain(|(_, shown)| shown.ln_p > ln_level);
        weak.sort_by(|a, b| b.1.ln_p.total_cmp(&a.1.ln_p));
        if weak.is_empty() {
            let bench = Bench::new(case, &state.terms, &state.noises);
            return (state, bench, prices);
        }
        let weak: Vec<Item> = weak.into_iter().map(|(item, _)| item).collect();
        (state, prices) = without_weak(case, &state, &prices, &weak, family, ln_level);
    }
}

/// The state without the first of its insignificant items, the weakest first: one by one, as another may become significant by what it
/// leaves. Several leave at once where even all that they show together would make none of them significant.
fn without_weak(
    case: &Case<'_>,
    state: &State,
    prices: &[Price],
    weak: &[Item],
    family: &Family,
    ln_level: f64,
) -> (State, Vec<Price>) {
    let mut number = weak.len();
    loop {
        let (less, less_prices) = without_all(case, state, prices, &weak[..number]);
        let (less, _) = refitted(case, &less, None);
        let together = state.log_likelihood - less.log_likelihood;
        let is_weak = |&item: &Item| {
            let (candidate, price) = priced(state, prices, item);
            family.ln_p(&case.candidates[candidate], price.evidence(together)) > ln_level
        };
        if number == 1 || weak[..number].iter().all(is_weak) {
            return (less, less_prices);
        }
        number /= 2;
    }
}

/// The candidate that an item is, and by what its gain is judged.
fn priced(state: &State, prices: &[Price], item: Item) -> (usize, Price) {
    match item {
        Item::Term(place) => (state.terms[place].candidate, prices[place]),
        Item::Change(place) => {
            let change = &state.changes[place];
            (change.candidate, Price::among(change.freedom, change.ln_places))
        }
    }
}

/// As many shapes in time without a recorded cause in one source ask whether they are not noise.
const SEVERAL: usize = 3;
/// Where they are worth no more than this beyond noise, what is held out decides, nats.
const UNDECIDED: f64 = 12.0;
/// Nats that a description may be less likely than one that has more parameters, in fewer changes, and stand for it.
const AS_LIKELY: f64 = 1.0;

/// The description with several items of a source that have no recorded cause put as changes of its noise alone, where that is the
/// better description for the places and parameters that it is sought in: flicker that was taken for a Markov part and a step, a random
/// walk for a drift and three steps. A walk has its steps, and as many of them as one likes describe it: where the two are nearly worth
/// the same, the one stays that foretells better what it was not fitted to.
///
/// A change of several parameters that begins with what another does with one, a Markov part shorter than a step with the white level, may have
/// been taken first: the white level is tried first as well, where no sources meet.
fn merged<'c>(
    case: &'c Case<'c>,
    mut found: Found<'c>,
    family: &Family,
    ln_level: f64,
    budget: &mut Budget,
) -> Found<'c> {
    let parameters = |state: &State| -> usize {
        let of_terms = state.terms.iter().map(|term| term.amplitudes() + term.nonlinear.len()).sum::<usize>();
        of_terms + state.changes.iter().map(|change| change.knobs.len()).sum::<usize>()
    };
    for source in 0..case.model.sources.len() {
        let blocks = blocks_with(case.model, source);
        let is_alone = blocks.iter().all(|&block| case.model.blocks[block].sources.len() == 1);
        for first in [None, Some(NoiseChange::White)] {
            let (state, ..) = &found;
            let terms = state.terms.iter().filter(|term| is_uncaused(case, term, source)).count();
            let changes = state.changes.iter().filter(|change| change.source == source).count();
            let is_other = |change: &Accepted| change.source == source && Some(change.change) != first;
            let may_gain = match first {
                None => terms > 0 && terms + changes > 1,
                Some(_) => is_alone && state.changes.iter().any(is_other),
            };
            if !may_gain || !budget.affords(of_round(case, state, &blocks)) {
                continue;
            }
            let noise = as_noise_alone(case, &found, source, (first, terms + changes), family, ln_level);
            let more = worth(case, &noise, family) - worth(case, &found, family);
            let foretells_more = || {
                let Fit { held_out, .. } = hold_out(case, &noise.0, &found.0);
                held_out.before.nll_per_sample < held_out.after.nll_per_sample
            };
            // As likely with fewer parameters: the part of another kind shows nothing of its kind.
            let (own, others) = (parameters(&noise.0), parameters(&found.0));
            let likelier = noise.0.log_likelihood - found.0.log_likelihood;
            let is_simpler =
                first.is_some() && (likelier > -AS_LIKELY && own < others || likelier > 0.0 && own == others);
            if more > 0.0 || is_simpler || (terms >= SEVERAL && more > -UNDECIDED && foretells_more()) {
                found = noise;
            }
        }
    }
    found
}

/// A description in which items of a source without a recorded cause are changes of its noise alone, at `most` so many: `first` if that is
/// significant, then what shows most.
fn as_noise_alone<'c>(
    case: &'c Case<'c>,
    (state, _, prices): &Found<'c>,
    source: usize,
    (first, most): (Option<NoiseChange>, usize),
    family: &Family,
    ln_level: f64,
) -> Found<'c> {
    let blocks = blocks_with(case.model, source);
    let (mut noise, mut prices) = (state.clone(), prices.clone());
    noise.changes.retain(|change| change.source != source);
    noise.noises[source] = case.model.sources[source].nominal.clone();
    let mut kept = state.terms.iter().map(|term| !is_uncaused(case, term, source));
    prices.retain(|_| kept.next().unwrap_or(true));
    noise.terms.retain(|term| !is_uncaused(case, term, source));
    let (mut noise, mut bench) = refitted(case, &noise, None);
    for change in first.map(Some).into_iter().chain(std::iter::repeat_n(None, most)) {
        let is_it = |candidate: usize| {
            change.is_none_or(
                |change| matches!(case.candidates[candidate].search, Search::Noise(of) if of == change),
            )
        };
        let score = |fit: &ChangeFit| fit.price().evidence(fit.gain);
        let fits = bench.noise_changes(&noise, &blocks, &is_it);
        let best = (fits.into_iter().filter(|(_, fit)| fit.source == source))
            .max_by(|a, b| score(&a.1).total_cmp(&score(&b.1)));
        match best {
            Some((candidate, fit)) if family.ln_p(&case.candidates[candidate], score(&fit)) <= ln_level => {
                add_change(&mut noise, candidate, fit);
                (noise, bench) = refitted(case, &noise, None);
            }
            _ if change.is_some() => {}
            _ => break,
        }
    }
    pruned(case, noise, prices, family, ln_level)
}

/// Whether a term is a shape in time of a source that nothing recorded causes.
fn is_uncaused(case: &Case<'_>, term: &Term, source: usize) -> bool {
    is_at(case, term.candidate, source) && has_no_cause(&case.candidates[term.candidate])
}

/// Whether a candidate is about the output, or the input, that a source is.
pub fn is_at(case: &Case<'_>, candidate: usize, source: usize) -> bool {
    let (origin, candidate) = (&case.model.sources[source], &case.candidates[candidate]);
    candidate.target == Target::Sensor(origin.sensor) && candidate.port == origin.port
}

/// Whether a candidate is a shape in time that nothing recorded causes, as slow noise may take any.
fn has_no_cause(candidate: &Candidate) -> bool {
    candidate.effect.id == WARMUP
        || matches!(
            candidate.search,
            Search::Onset(_) | Search::Frequency | Search::Readings(ReadingFault::IntermittentJump)
        )
}

/// What an item gains a description over the one without it.
pub fn gain_of_item(item: Item, with: &State, less: &State) -> f64 {
    let gain = with.log_likelihood - less.log_likelihood;
    match item {
        Item::Term(_) => gain,
        Item::Change(place) => with.changes[place].change.counted(gain, with.told_beside - less.told_beside),
    }
}

/// The evidence of an item of a description that shows so much by its gain.
pub fn evidence_of(bench: &Bench<'_>, item: Item, by_gain: f64) -> f64 {
    let of_jumps = |place: usize| shown_beside(bench, bench.terms.get(place)?);
    match item {
        Item::Term(place) => of_jumps(place).map_or(by_gain, |evidence| evidence.min(by_gain)),
        Item::Change(_) => by_gain,
    }
}

/// What each item shows beside all others; of one that is significant beyond doubt, nearly.
pub fn shown(case: &Case<'_>, state: &State, prices: &[Price], family: &Family) -> Vec<(Item, Shown)> {
    shown_up_to(case, state, prices, family, BEYOND_DOUBT)
}

/// The same, exact for what gains less than `doubtful` nats above the price of its search.
fn shown_up_to(
    case: &Case<'_>,
    state: &State,
    prices: &[Price],
    family: &Family,
    doubtful: f64,
) -> Vec<(Item, Shown)> {
    let terms = (0..state.terms.len()).map(Item::Term);
    let items = terms.chain((0..state.changes.len()).map(Item::Change));
    let bench = Bench::new(case, &state.terms, &state.noises);
    items
        .map(|item| {
            let (candidate, price) = priced(state, prices, item);
            let least = state.log_likelihood - price.ln_places - doubtful;
            let (less, _) = refitted_above(case, &taken_out(case, state, item), None, least);
            let gain = gain_of_item(item, state, &less);
            let evidence = evidence_of(&bench, item, price.evidence(gain));
            (item, Shown { gain, evidence, ln_p: family.ln_p(&case.candidates[candidate], evidence) })
        })
        .collect()
}
