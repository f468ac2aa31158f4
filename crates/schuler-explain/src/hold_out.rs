//! How well the description predicts what it was not fitted to.
//!
//! Every third of ten blocks of time is held out, with a gap of the longest correlation time on each side; short records
//! hold out their last part. The description's terms and its free noise parameters are fitted to the rest; the filter
//! then runs through the whole record and its one-step predictions are judged on the blocks held out. Before the findings
//! the noise is what the user believes: noise that is fitted swallows what was left out, and would hide the gain.
use rayon::prelude::*;

use crate::description::remainder;
use crate::explanation::{BeforeAfter, Fit, Goodness};
use crate::noise::Noise;
use crate::nominal::Model;
use crate::search::refine_terms;
use crate::second::answer::held_out::{Judged, Part, Sums, parts_of, stretches};
use crate::state::{Case, State, refitted};

/// Goodness of fit of `after` against `before`, both refitted to a part of the record.
pub fn hold_out(case: &Case<'_>, before: &State, after: &State) -> Fit {
    let model = case.model;
    let parts = parts_of(model, &after.noises);
    let train = model.without_rows(|_, row| parts[row] != Part::Train);
    let train_case = Case::new(&train, case.candidates, case.time_s, case.watch);
    let nominal = model.nominal_noises();
    let judged: Vec<[(Goodness, usize); 2]> = [before, after]
        .into_par_iter()
        .map(|state| {
            let (fitted, amplitudes) = fitted(&train_case, state);
            judge(model, &fitted, &amplitudes, &nominal, &parts)
        })
        .collect();
    let part = |place: usize, part: Part| {
        let of = |state: usize| judged.get(state).map(|both| both[place]).unwrap_or_default();
        let ((before, _), (after, samples)) = (of(0), of(1));
        BeforeAfter { before, after, intervals_s: stretches(model, &parts, part), samples }
    };
    Fit { train: part(0, Part::Train), held_out: part(1, Part::HeldOut) }
}

/// Terms and the free noise parameters fitted; with the amplitudes.
fn fitted(case: &Case<'_>, state: &State) -> (State, nalgebra::DVector<f64>) {
    let mut state = state.clone();
    refine_terms(case, &mut state, &|_| true);
    let (state, bench) = refitted(case, &state, None);
    (state, bench.solution.amplitudes)
}

/// Goodness on the rows trained on and on those held out, and the number of their samples.
fn judge(
    model: &Model,
    state: &State,
    amplitudes: &nalgebra::DVector<f64>,
    nominal: &[Noise],
    parts: &[Part],
) -> [(Goodness, usize); 2] {
    let mut sums = [Sums::default(), Sums::default()];
    for (index, block) in model.blocks.iter().enumerate() {
        let Some(filter) = block.filter(&state.noises) else { continue };
        let reference = block.filter(nominal);
        let left = remainder(model, index, &state.terms, amplitudes);
        let whitened = filter.whiten(&[&left]).swap_remove(0);
        let judged = Judged { block, filter: &filter, reference: reference.as_ref() };
        judged.add_to(&mut sums, &whitened, parts);
    }
    sums.map(Sums::goodness_and_count)
}
