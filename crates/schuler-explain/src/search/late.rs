//! What comes as late as the readings that it is in.
//!
//! A late instrument reads at t what was at t − d: not its nominal reading alone, but all that the motion adds to it, a lever arm's
//! ω × r as well as a mounting or a scale factor.
use super::beside::Beside;
use crate::catalogue::{Candidate, Column};
use crate::description::{Delays, Term, columns};
use crate::evidence::late::delays_of;
use crate::inputs::series::Series;

/// The columns of a candidate at given values of its parameters, as late as what is described makes them; those of a delay with what
/// it moves of the effects that are described.
pub fn columns_beside(beside: &Beside<'_>, candidate: &Candidate, point: &[f64]) -> Vec<Column> {
    let problem = beside.bench.problem;
    let own = columns(candidate, point, problem.time_s());
    let described = &beside.description.placed;
    if candidate.effect.is_a_delay() {
        let moved = Term::new(usize::MAX, candidate, point, problem.time_s());
        return with_what_it_moves(beside, &own, &moved);
    }
    let delays = delays_of(described.iter());
    if delays.is_empty() || !candidate.effect.is_of_the_motion() {
        return own;
    }
    own.iter().map(|column| delays.late(problem.model, true, column).into_owned()).collect()
}

/// The column of a delay, with what it changes in the effects of the motion that are described.
fn with_what_it_moves(beside: &Beside<'_>, own: &[Column], delay: &Term) -> Vec<Column> {
    let (bench, description) = (beside.bench, beside.description);
    let before = delays_of(description.placed.iter());
    let after = Delays::new(description.placed.iter().map(|placed| &placed.term).chain([delay]));
    let mut parts: Vec<(usize, Vec<f64>)> = (own.iter().flat_map(|column| &column.parts))
        .map(|(sensor, values)| (*sensor, values.to_vec()))
        .collect();
    let amplitudes = description.amplitudes_of_effects_at(bench, &beside.solved.amplitudes);
    for (placed, amplitudes) in description.placed.iter().zip(amplitudes) {
        if !after.move_term(&placed.term) {
            continue;
        }
        for (column, amplitude) in placed.term.columns.iter().zip(amplitudes) {
            let [now, then] = [&after, &before].map(|it| it.late(bench.problem.model, true, column));
            add_difference(&mut parts, amplitude, &now, &then);
        }
    }
    vec![Column::of(parts.into_iter().map(|(sensor, values)| (sensor, Series::from(values))))]
}

/// Adds to the values of each sensor what one column has more than another, times an amplitude.
fn add_difference(parts: &mut [(usize, Vec<f64>)], amplitude: f64, now: &Column, then: &Column) {
    for ((sensor, now), (_, then)) in now.parts.iter().zip(&then.parts) {
        if let Some((_, sum)) = parts.iter_mut().find(|(known, _)| known == sensor) {
            let differences = now.iter().zip(then.iter()).map(|(now, then)| amplitude * (now - then));
            sum.iter_mut().zip(differences).for_each(|(sum, difference)| *sum += difference);
        }
    }
}
