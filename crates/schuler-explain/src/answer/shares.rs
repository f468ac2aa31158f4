//! Which share of the mismatch each finding explains.
//!
//! The mismatch is what whitened residuals have more of than noise has: Σ e² − n over all sensors, whitened by the noise that the case
//! states, or by what was found where it states none. With e₀ before and e₁ = e₀ − Σ p after, Σ e₀² − Σ e₁² = Σ p (e₀ + e₁): a sum of
//! the findings. What they leave is that of the noise, where that is a finding.
use rayon::prelude::*;

use super::arrays::findings_of;
use crate::catalogue::{Effect, named};
use crate::exact::{OverRows, added};
use crate::explanation::Finding;
use crate::numeric::least_squares::dot;

/// Standard deviations of noise from which on there is a mismatch to be shared.
const MISMATCH: f64 = 4.0;

/// What of a mismatch is whose.
struct Parts {
    /// Squares beyond those of noise.
    mismatch: f64,
    /// Number of values.
    count: f64,
    /// Parts of the findings that add to the mean.
    means: Vec<(usize, f64)>,
    /// The part of the noise, with the finding that has it.
    noise: Option<(usize, f64)>,
}

/// The share of each finding, and of all together; absent where there is hardly a mismatch.
pub fn shares(after: &OverRows<'_>, findings: &[Finding]) -> (Vec<Option<f64>>, Option<f64>) {
    let problem = after.bench.problem;
    let terms = after.description.placed.iter().map(|placed| &placed.term);
    let places = findings_of(problem.model, &problem.candidates, terms, findings);
    let all: Vec<Parts> = (0..problem.model.blocks.len())
        .into_par_iter()
        .filter_map(|block| parts(after, block, &places, findings))
        .collect();
    let (mismatch, count) = all.iter().fold((0.0, 0.0), |(m, n), it| (m + it.mismatch, n + it.count));
    if mismatch <= MISMATCH * f64::sqrt(2.0 * count) {
        return (vec![None; findings.len()], None);
    }
    let mut shares: Vec<Option<f64>> = vec![None; findings.len()];
    for (finding, part) in all.iter().flat_map(|it| it.means.iter().chain(&it.noise)) {
        *shares[*finding].get_or_insert(0.0) += part / mismatch;
    }
    let explained = shares.iter().flatten().sum::<f64>().clamp(0.0, 1.0);
    shares.iter_mut().flatten().for_each(|share| *share = share.clamp(0.0, 1.0));
    (shares, Some(explained))
}

fn parts(
    after: &OverRows<'_>,
    index: usize,
    places: &[Option<usize>],
    findings: &[Finding],
) -> Option<Parts> {
    let model = after.bench.problem.model;
    let block = &model.blocks[index];
    let found = after.description.noises.iter();
    let noises: Vec<_> = (model.sources.iter().zip(found))
        .map(|(source, found)| if source.unknown { found.clone() } else { source.nominal.clone() })
        .collect();
    let filter = block.filter(&noises)?;
    let residual = &after.blocks[index].as_ref()?.residual;
    let added: Vec<(usize, Vec<f64>)> = (after.description.placed.iter().zip(&after.amplitudes).zip(places))
        .filter_map(|((placed, own), finding)| Some(((*finding)?, added(model, block, placed, own)?)))
        .collect();
    let mut columns: Vec<&[f64]> = vec![residual];
    columns.extend(added.iter().map(|(_, values)| values.as_slice()));
    let whitened = filter.whiten(&columns);
    let (before, parts) = whitened.split_first()?;
    let mut left = before.clone();
    for part in parts {
        left.iter_mut().zip(part).for_each(|(left, part)| *left -= part);
    }
    let count = (block.count() * block.channels) as f64;
    let both: Vec<f64> = before.iter().zip(&left).map(|(before, left)| before + left).collect();
    let means = added.iter().zip(parts).map(|((finding, _), part)| (*finding, dot(part, &both)));
    let is_noise_here = |finding: &Finding| {
        let sources = block.sources.iter().filter_map(|&source| model.sources.get(source));
        named(&finding.effect).is_some_and(Effect::is_noise)
            && sources.into_iter().any(|source| source.name == finding.sensor)
    };
    let noise = findings.iter().position(is_noise_here).map(|finding| (finding, dot(&left, &left) - count));
    Some(Parts { mismatch: dot(before, before) - count, count, means: means.collect(), noise })
}
