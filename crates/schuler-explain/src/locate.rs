//! Where record and simulation differ, before anything is named, and what is left when everything is.
use crate::explanation::{Located, Remainder};
use crate::inputs::Inputs;
use crate::state::{Case, State};

/// Tests of the record under a state.
pub fn locate(_case: &Case<'_>, _null: &State, _inputs: &Inputs<'_>) -> Vec<Located> {
    Vec::new()
}

/// Whether the record still differs, and in what.
pub fn left(_case: &Case<'_>, _state: &State, _inputs: &Inputs<'_>) -> (bool, Option<Remainder>) {
    (false, None)
}
