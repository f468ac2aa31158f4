//! How well a step, a ramp or a line that is not described would be known, over all places where it may be.
use super::beside::Beside;
use super::scans::{Left, Source, of_sources};
use crate::catalogue::{OnsetShape, Search};

/// Places at most whose products with one of them are computed.
const MOST_PRODUCTS: usize = 4096;

/// A shape where it is judged.
#[derive(Clone, Debug)]
pub struct Reach {
    /// Its candidate.
    pub candidate: usize,
    /// Time at which it begins, s, or frequency, Hz.
    pub at: f64,
    /// Information of an amplitude there; 0 where it cannot be told from what is described.
    pub information: f64,
    /// Products with the shape at places spread over all, each with the information there; none of lines, which are alike only near by.
    pub products: Vec<[f64; 2]>,
    /// Number of places.
    pub places: usize,
}

/// Every step, ramp and line of one source of some blocks, at the one that `chosen` picks by the information at each.
pub fn reaches(
    beside: &Beside<'_>,
    among: &[usize],
    chosen: &(impl Fn(&[f64]) -> usize + Sync),
) -> Vec<Reach> {
    let of = |source: &Source<'_>, number: usize, search: &Search| match *search {
        Search::Onset(shape) => of_onset(source, number, shape, chosen),
        Search::Frequency => of_line(source, number, chosen),
        _ => None,
    };
    of_sources(beside, among, of).into_iter().flatten().collect()
}

fn of_onset(
    source: &Source<'_>,
    candidate: usize,
    shape: OnsetShape,
    chosen: impl Fn(&[f64]) -> usize,
) -> Option<Reach> {
    let problem = source.beside.bench.problem;
    let left: Left = source.left_of_onsets(shape)?;
    let index = chosen(&left.of_rows);
    let row = *left.onsets.rows.get(index)?;
    // A ramp of the scan rises by one a row, and one of the catalogue by one a second.
    let scale = if shape == OnsetShape::Ramp { problem.model.step_s.powi(2) } else { 1.0 };
    let stride = left.of_rows.len().div_ceil(MOST_PRODUCTS);
    let products = source.products_of_onset(shape, &left, row);
    let both = products.iter().zip(&left.of_rows).step_by(stride);
    Some(Reach {
        candidate,
        at: *problem.time_s().get(row)?,
        information: scale * left.of_rows.get(index)?,
        products: both.map(|(product, left)| [scale * product, scale * left]).collect(),
        places: left.of_rows.len(),
    })
}

fn of_line(source: &Source<'_>, candidate: usize, chosen: impl Fn(&[f64]) -> usize) -> Option<Reach> {
    let lines = source.left_of_lines()?;
    let informations: Vec<f64> = lines.iter().map(|(_, information)| *information).collect();
    let &(at, information) = lines.get(chosen(&informations))?;
    Some(Reach { candidate, at, information, products: Vec::new(), places: lines.len() })
}
