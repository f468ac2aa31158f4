//! The descriptions that are kept, and which of them are expanded.
use std::collections::HashSet;

use rayon::prelude::*;

use super::blocks::{all_blocks, structure_in, together};
use super::common::with_common;
use super::known::Known;
use super::library::Shelf;
use super::moves::{
    Base, Item, Structure, candidate_of, items, reached_by, structure, with_one_more, without,
    without_several,
};
use super::telegraph::with_telegraph;
use crate::catalogue::Search;
use crate::evidence::fit::{Bench, Description};

/// Whether a description ends a search.
pub type Ends<'e> = dyn Fn(&Bench<'_>, &Description) -> bool + 'e;

/// The descriptions of a search, the best first, one of each structure.
#[derive(Default)]
pub struct Beam {
    known: Vec<(Structure, Description)>,
    /// Structure and evidence of descriptions of the record whitened otherwise.
    pub others: Vec<(Structure, f64)>,
    /// Those whose neighbours were sought.
    expanded: HashSet<Structure>,
    /// Those to which an item more was sought, and in which blocks.
    extended: HashSet<(Structure, Vec<usize>)>,
    /// What is in some blocks of those to which an item more was sought there, whatever is elsewhere.
    seen: HashSet<(Structure, Vec<usize>)>,
    /// Those of which every neighbour was sought beside all that they have.
    settled: HashSet<Structure>,
    /// What was computed of their parts.
    parts: Known,
}

impl Beam {
    /// A description from which a search starts.
    pub fn new(start: Description) -> Self {
        Self { known: vec![(structure(&start), start)], ..Self::default() }
    }

    /// The best description.
    pub fn best(&self) -> &Description {
        &self.known[0].1
    }

    /// Structure and evidence of all that are known.
    pub fn scored(&self) -> Vec<(Structure, f64)> {
        let known = self.known.iter().map(|(of, description)| (of.clone(), description.ln_evidence));
        known.chain(self.others.iter().cloned()).collect()
    }

    /// Searches on: of the best that are not expanded yet the neighbours are fitted, those with an item more, less, or another in its
    /// place, until none of the best is left, or the best is one that `ends` it.
    pub fn search(&mut self, bench: &Bench<'_>, library: &[Shelf], ends: &Ends<'_>) {
        self.expand(bench, library, ends);
        for reach in [Self::share, Self::jump, Self::share] {
            if !ends(bench, self.best()) && reach(self, bench) {
                self.expand(bench, library, ends);
            }
        }
    }

    /// Expands the best until none of them is left. What was sought in a block is not sought again where something is another
    /// elsewhere, but beside the best of all: only there are its neighbours compared.
    fn expand(&mut self, bench: &Bench<'_>, library: &[Shelf], ends: &Ends<'_>) {
        let config = bench.problem.config;
        loop {
            self.ascend(bench, library, ends);
            if ends(bench, self.best()) {
                return;
            }
            let best = self.best().ln_evidence;
            let next = (self.known.iter().take(config.expanded)).find(|(of, description)| {
                !self.expanded.contains(of) && description.ln_evidence > best - config.expanded_within
            });
            let is_settled = all_blocks(bench).len() < 2 || self.settled.contains(&self.known[0].0);
            let is_last = next.is_none();
            let next = next.or_else(|| self.known.first().filter(|_| !is_settled)).cloned();
            let Some((of, description)) = next.filter(|_| !bench.problem.watch.is_cancelled()) else {
                return;
            };
            if is_last {
                self.settled.insert(of);
            } else {
                self.expanded.insert(of);
            }
            // What is added elsewhere than where something is left out is two moves, each of which has its turn.
            let mut bases = neighbours_below(bench, &description);
            let mut found: Vec<Description> =
                bases.iter().map(|(base, _)| base.description.clone()).collect();
            bases.push((Base { description: description.clone(), lacks: Vec::new() }, all_blocks(bench)));
            for (among, bases) in self.unextended(bench, bases, is_last) {
                found.extend(with_one_more(bench, library, &self.parts, &bases, &among, best));
            }
            found.extend(together(bench, &description, &found));
            self.take(bench, found);
        }
    }

    /// Adds to the best what makes it better until nothing does, or it is one that `ends` it. What takes
    /// the place of an item is sought from there on alone: below it what is missing would decide.
    pub fn ascend(&mut self, bench: &Bench<'_>, library: &[Shelf], ends: &Ends<'_>) {
        loop {
            let (of, best) = self.known[0].clone();
            let among = with_room(bench, &best, all_blocks(bench));
            let is_new = !among.is_empty() && self.extended.insert((of, among.clone()));
            if !is_new || bench.problem.watch.is_cancelled() || ends(bench, &best) {
                return;
            }
            self.seen.extend(among.iter().map(|&block| (structure_in(bench, &best, &[block]), vec![block])));
            let base = Base { description: best, lacks: Vec::new() };
            let (best, bases) = (&base.description, std::slice::from_ref(&base));
            let mut found = with_one_more(bench, library, &self.parts, bases, &among, best.ln_evidence);
            found.extend(together(bench, best, &found));
            self.take(bench, found);
        }
    }

    /// Those of some descriptions to which nothing was added yet, those together that have room in the same blocks; without those to
    /// whose like in these blocks something was added, unless `also_alike`.
    fn unextended(
        &mut self,
        bench: &Bench<'_>,
        bases: Vec<(Base, Vec<usize>)>,
        also_alike: bool,
    ) -> Vec<(Vec<usize>, Vec<Base>)> {
        let mut together: Vec<(Vec<usize>, Vec<Base>)> = Vec::new();
        for (base, among) in bases {
            let among = with_room(bench, &base.description, among);
            let here = (structure_in(bench, &base.description, &among), among.clone());
            let whole = (structure(&base.description), among.clone());
            let is_alike = !also_alike && self.seen.contains(&here);
            if among.is_empty() || is_alike || !self.extended.insert(whole) {
                continue;
            }
            self.seen.insert(here);
            match together.iter_mut().find(|(known, _)| *known == among) {
                Some((_, bases)) => bases.push(base),
                None => together.push((among, vec![base])),
            }
        }
        together
    }

    /// Tells once what sensors have in common. Whether the best description is better by it.
    fn share(&mut self, bench: &Bench<'_>) -> bool {
        let found = with_common(bench, self.best());
        let is_better = found.is_some();
        self.take(bench, found.into_iter().collect());
        is_better
    }

    /// Seeks a telegraph beside the best description, in the place of each of its items, and in that of all steps, of all effects
    /// and of all that is in a block: what jumps often was told as many steps. Whether there is a better one by it.
    fn jump(&mut self, bench: &Bench<'_>) -> bool {
        let best = self.best().clone();
        // Where nothing was left out a telegraph promises what it promises beside the best.
        let mut bases = neighbours_below(bench, &best);
        bases.extend(neighbours_far_below(bench, &best));
        bases.push((Base { description: best.clone(), lacks: Vec::new() }, all_blocks(bench)));
        let with = |(base, among): &(Base, Vec<usize>)| with_telegraph(bench, &base.description, among);
        let found: Vec<Description> = bases.par_iter().flat_map_iter(with).collect();
        let is_better = found.iter().any(|it| it.ln_evidence > best.ln_evidence);
        self.take(bench, found);
        is_better
    }

    /// Takes descriptions in that have not too many items, of each structure the best; the best come first.
    fn take(&mut self, bench: &Bench<'_>, found: Vec<Description>) {
        let most = bench.problem.config.most_items;
        for description in found {
            if all_blocks(bench).into_iter().any(|block| items_in(bench, &description, block) > most) {
                continue;
            }
            let of = structure(&description);
            match self.known.iter_mut().find(|(known, _)| *known == of) {
                Some((_, other)) if other.ln_evidence < description.ln_evidence => *other = description,
                Some(_) => {}
                None => self.known.push((of, description)),
            }
        }
        self.known.sort_by(|a, b| b.1.ln_evidence.total_cmp(&a.1.ln_evidence).then(a.0.cmp(&b.0)));
    }
}

/// Number of items that reach a block.
fn items_in(bench: &Bench<'_>, description: &Description, block: usize) -> usize {
    items(description)
        .into_iter()
        .filter(|&item| reached_by(bench, description, item).contains(&block))
        .count()
}

/// Those of some blocks in which a description may have another item.
fn with_room(bench: &Bench<'_>, description: &Description, mut among: Vec<usize>) -> Vec<usize> {
    among.retain(|&block| items_in(bench, description, block) < bench.problem.config.most_items);
    among
}

/// The descriptions that lack one item of another, with the blocks that it reached.
fn neighbours_below(bench: &Bench<'_>, description: &Description) -> Vec<(Base, Vec<usize>)> {
    let without = |&item: &Item| {
        let lacks = match item {
            Item::Placed(place) => vec![description.placed[place].term.clone()],
            Item::Change(_) => Vec::new(),
        };
        let base = Base { description: without(bench, description, item)?, lacks };
        Some((base, reached_by(bench, description, item)))
    };
    items(description).par_iter().filter_map(without).collect()
}

/// The descriptions that lack all steps and ramps of a block, all its effects, or all its items, where those are several, with that block.
fn neighbours_far_below(bench: &Bench<'_>, description: &Description) -> Vec<(Base, Vec<usize>)> {
    let is_effect = |item: &Item| matches!(item, Item::Placed(_));
    let is_onset = |item: &Item| {
        let candidate = candidate_of(description, *item);
        matches!(bench.problem.candidates[candidate].search, Search::Onset(_))
    };
    let sets = (0..bench.sums.len()).flat_map(|block| {
        let all = items(description).into_iter();
        let all: Vec<Item> = all.filter(|&item| reached_by(bench, description, item) == [block]).collect();
        let of = |belongs: &dyn Fn(&Item) -> bool| all.iter().copied().filter(belongs).collect::<Vec<_>>();
        let mut sets = vec![of(&is_onset), of(&is_effect), all];
        sets.dedup();
        sets.into_iter().map(move |set| (set, vec![block]))
    });
    let several: Vec<(Vec<Item>, Vec<usize>)> = sets.filter(|(set, _)| set.len() > 1).collect();
    let without = |(set, among): &(Vec<Item>, Vec<usize>)| {
        let description = without_several(bench, description, set)?;
        Some((Base { description, lacks: Vec::new() }, among.clone()))
    };
    several.par_iter().filter_map(without).collect()
}
