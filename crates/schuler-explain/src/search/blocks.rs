//! What descriptions have in some blocks: blocks that no item links are searched by themselves, and what is better in each is taken together.
use super::moves::{Item, Structure, items, reached_by, structure_of, touched_by};
use crate::evidence::fit::{Bench, Description, Placed};
use crate::noise::Knob;

/// The blocks that have sums.
pub fn all_blocks(bench: &Bench<'_>) -> Vec<usize> {
    (0..bench.sums.len()).filter(|&block| bench.sums[block].is_some()).collect()
}

/// A description with what is better in others, that of the best of them in each block, where those are several.
pub fn together(bench: &Bench<'_>, description: &Description, others: &[Description]) -> Option<Description> {
    let is_better = |other: &&Description| other.ln_evidence > description.ln_evidence;
    let mut better: Vec<&Description> = others.iter().filter(is_better).collect();
    better.sort_by(|a, b| b.ln_evidence.total_cmp(&a.ln_evidence));
    let (mut whole, mut touched, mut parts) = (description.clone(), Vec::new(), 0);
    for other in better {
        let differs = differing(bench, description, other);
        if differs.is_empty() || differs.iter().any(|block| touched.contains(block)) {
            continue;
        }
        take_over(bench, &mut whole, other, &differs);
        touched.extend(differs);
        parts += 1;
    }
    if parts < 2 { None } else { bench.fitted(&whole, &touched) }
}

/// The blocks in which two descriptions differ, with all that an item of either links to them.
fn differing(bench: &Bench<'_>, one: &Description, other: &Description) -> Vec<usize> {
    let parts = |description: &Description, block: usize| -> Vec<(usize, Vec<u64>, Vec<Knob>)> {
        let here = items(description).into_iter();
        let of = |item: Item| match item {
            Item::Placed(index) => {
                let term = &description.placed[index].term;
                (term.candidate, term.nonlinear.iter().map(|value| value.to_bits()).collect(), Vec::new())
            }
            Item::Change(index) => {
                let change = &description.changes[index];
                (change.candidate, Vec::new(), change.knobs.clone())
            }
        };
        here.filter(|&item| reached_by(bench, description, item).contains(&block)).map(of).collect()
    };
    let mut differs = all_blocks(bench);
    differs.retain(|&block| parts(one, block) != parts(other, block));
    let reaches: Vec<Vec<usize>> = [one, other]
        .iter()
        .flat_map(|it| items(it).into_iter().map(|item| reached_by(bench, it, item)))
        .collect();
    loop {
        let linked = reaches.iter().filter(|reach| reach.iter().any(|block| differs.contains(block)));
        let more: Vec<usize> = linked.flatten().copied().filter(|block| !differs.contains(block)).collect();
        if more.is_empty() {
            return differs;
        }
        differs.extend(more);
        differs.sort_unstable();
        differs.dedup();
    }
}

/// Gives a description what another has in some blocks, which no item links to others.
fn take_over(bench: &Bench<'_>, description: &mut Description, other: &Description, blocks: &[usize]) {
    let model = bench.problem.model;
    let is_there = |source: usize| model.block_of_source(source).is_some_and(|block| blocks.contains(&block));
    description.placed.retain(|placed| !touches(placed, blocks));
    description.placed.extend(other.placed.iter().filter(|placed| touches(placed, blocks)).cloned());
    description.changes.retain(|change| !is_there(change.source));
    description.changes.extend(other.changes.iter().filter(|change| is_there(change.source)).cloned());
    description.nuisances.retain(|(source, _)| !is_there(*source));
    description.nuisances.extend(other.nuisances.iter().filter(|(source, _)| is_there(*source)));
    for source in (0..model.sources.len()).filter(|&source| is_there(source)) {
        description.noises[source].clone_from(&other.noises[source]);
    }
    for &block in blocks {
        description.blocks[block].clone_from(&other.blocks[block]);
        description.weights[block].clone_from(&other.weights[block]);
    }
}

/// Whether an effect reaches one of some blocks.
fn touches(placed: &Placed, blocks: &[usize]) -> bool {
    touched_by(placed).iter().any(|block| blocks.contains(block))
}

/// What makes descriptions the same in some blocks.
pub fn structure_in(bench: &Bench<'_>, description: &Description, among: &[usize]) -> Structure {
    let model = bench.problem.model;
    let is_there = |source: usize| model.block_of_source(source).is_some_and(|it| among.contains(&it));
    structure_of(
        description.placed.iter().filter(|placed| touches(placed, among)),
        description.changes.iter().filter(|change| is_there(change.source)),
    )
}
