//! Effects of the motion come as late as the readings that they are in.
use std::borrow::Cow;

use super::fit::Placed;
use crate::catalogue::Column;
use crate::description::{Delays, Term};
use crate::nominal::Model;

/// The delays among effects.
pub fn delays_of<'p>(placed: impl Iterator<Item = &'p Placed>) -> Delays {
    Delays::new(placed.map(|placed| &placed.term))
}

/// The columns of an effect as late as delays make them.
pub fn late_columns<'t>(model: &Model, delays: &Delays, term: &'t Term) -> Cow<'t, [Column]> {
    if !delays.move_term(term) {
        return Cow::Borrowed(&term.columns);
    }
    term.columns.iter().map(|column| delays.late(model, true, column).into_owned()).collect()
}
