//! How much of a file that departs from its format is read all the same.

/// What becomes of what cannot be understood.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Leniency {
    /// It is an error.
    #[default]
    Strict,
    /// It is left out, counted, and told in the warnings: unknown keys of a document, rows of a text table that are not rows
    /// of it, cells that are not numbers.
    Lenient,
}

impl Leniency {
    /// Whether what cannot be understood is left out.
    pub fn is_lenient(self) -> bool {
        self == Self::Lenient
    }
}
