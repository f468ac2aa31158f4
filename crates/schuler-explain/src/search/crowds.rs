//! Lines that crowd in one band, and the search on bands that resolve it.
//!
//! What vibrates at a frequency that wanders is a noise of a narrow band: in bands that are wide for it no noise shows it, and line after
//! line stands in its place. Where several lines are found in one band the bands about them are made narrow, so that both are
//! judged by the same sums.
use crate::catalogue::Search;
use crate::evidence::fit::{Bench, Description, Placed};

use super::library::whitened_again;
use super::moves::touched_by;

/// Lines of one band from which on it is resolved.
const CROWD: usize = 2;
/// Coefficients of a band that is not resolved any further.
const NARROW: f64 = 4.0;

/// Whether some lines of a description crowd.
pub fn is_crowded(bench: &Bench<'_>, description: &Description) -> bool {
    !crowds(bench, description).is_empty()
}

/// The sums with narrow bands about a description's crowds, and the description without their lines, fitted to them. None where no lines
/// crowd.
pub fn resolved<'b>(bench: &Bench<'b>, description: &Description) -> Option<(Bench<'b>, Description)> {
    let crowds = crowds(bench, description);
    let mut resolved = bench.resolved.clone();
    for crowd in &crowds {
        let middle = crowd.lines.iter().map(|(_, omega)| omega).sum::<f64>() / crowd.lines.len() as f64;
        resolved.get_mut(crowd.block)?.push(middle);
    }
    let lines = crowds.iter().flat_map(|crowd| crowd.lines.iter().map(|(index, _)| *index));
    let lines: Vec<usize> = lines.collect();
    if lines.is_empty() {
        return None;
    }
    let narrow = Bench::new(bench.problem, &description.noises, resolved);
    let mut rest = description.clone();
    let mut index = 0;
    rest.placed.retain(|_| {
        index += 1;
        !lines.contains(&(index - 1))
    });
    let rest = narrow.fitted_whole(&whitened_again(&narrow, &rest))?;
    Some((narrow, rest))
}

/// Lines of a block in one band.
struct Crowd {
    block: usize,
    /// Indices among the effects of the description, and frequencies, rad a row.
    lines: Vec<(usize, f64)>,
}

fn crowds(bench: &Bench<'_>, description: &Description) -> Vec<Crowd> {
    let mut lines: Vec<(usize, usize, usize, f64)> = Vec::new();
    for (index, placed) in description.placed.iter().enumerate() {
        let (Some(omega), &[block]) = (omega_of(bench, placed), &*touched_by(placed)) else { continue };
        let Some(layout) = bench.sums[block].as_ref().map(|sums| &sums.layout) else { continue };
        let band = layout.band_of(omega);
        if layout.count[band] > NARROW {
            lines.push((block, band, index, omega));
        }
    }
    lines.sort_by_key(|(block, band, ..)| (*block, *band));
    let of_band = lines.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|crowd| crowd.len() >= CROWD);
    let of = |crowd: &[(usize, usize, usize, f64)]| {
        let &(block, ..) = crowd.first()?;
        Some(Crowd { block, lines: crowd.iter().map(|&(_, _, index, omega)| (index, omega)).collect() })
    };
    of_band.filter_map(of).collect()
}

/// The frequency of a line, rad a row.
fn omega_of(bench: &Bench<'_>, placed: &Placed) -> Option<f64> {
    let problem = bench.problem;
    let is_line = matches!(problem.candidates[placed.term.candidate].search, Search::Frequency);
    let frequency = placed.term.nonlinear.first().filter(|_| is_line)?;
    Some(std::f64::consts::TAU * frequency * problem.model.step_s)
}
