//! The descriptions that are kept, and which of them are expanded.
use std::collections::HashSet;

use rayon::prelude::*;

use super::library::Shelf;
use super::moves::{items, structure, with_one_more, without};
use crate::second::evidence::fit::{Bench, Description};

/// The descriptions of a search, the best first, one of each structure.
pub struct Beam {
    /// The descriptions.
    pub descriptions: Vec<Description>,
    /// Number of descriptions whose neighbours were sought.
    pub expanded: usize,
}

type Structure = Vec<(usize, Vec<String>)>;

/// Searches from a description on: of the best that are not expanded yet the neighbours are fitted, those with an item more, less, or
/// another in its place, until none of the best is left.
pub fn search(bench: &Bench<'_>, library: &[Shelf], start: Description) -> Beam {
    let config = bench.problem.config;
    let mut known: Vec<(Structure, Description)> = vec![(structure(&start), start)];
    let mut expanded: HashSet<Structure> = HashSet::new();
    let mut extended: HashSet<Structure> = HashSet::new();
    loop {
        known.sort_by(|a, b| b.1.ln_evidence.total_cmp(&a.1.ln_evidence).then(a.0.cmp(&b.0)));
        let best = known[0].1.ln_evidence;
        let next = (known.iter().take(config.expanded))
            .find(|(of, description)| {
                !expanded.contains(of) && description.ln_evidence > best - config.expanded_within
            })
            .cloned();
        let Some((of, description)) = next else { break };
        expanded.insert(of.clone());
        let less: Vec<Description> =
            items(&description).par_iter().filter_map(|&item| without(bench, &description, item)).collect();
        let mut bases = less.clone();
        if description.items() < config.most_items {
            bases.push(description);
        }
        let mut found = less;
        for base in bases {
            if extended.insert(structure(&base)) {
                found.extend(with_one_more(bench, library, &base));
            }
        }
        for description in found {
            let of = structure(&description);
            match known.iter_mut().find(|(known, _)| *known == of) {
                Some((_, other)) if other.ln_evidence < description.ln_evidence => *other = description,
                Some(_) => {}
                None => known.push((of, description)),
            }
        }
    }
    let expanded = expanded.len();
    Beam { descriptions: known.into_iter().map(|(_, description)| description).collect(), expanded }
}
