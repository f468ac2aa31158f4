//! How far an explanation has come, and a way to stop it.
use std::fmt;

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Inputs and candidates are made, and faults of readings sought.
    Prepare,
    /// Effects are sought, one after the other.
    Search,
    /// What was found is compared with what looks like it, and its parameters are fitted.
    Refine,
    /// What is left is tested, and the description judged on blocks held out.
    Judge,
}

impl fmt::Display for Phase {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Prepare => "preparing",
            Self::Search => "searching",
            Self::Refine => "refining",
            Self::Judge => "judging",
        })
    }
}

/// Who watches an explanation; called from any thread, many times a second.
pub trait Watch: Sync {
    /// Whether the explanation is to end as soon as it can.
    fn is_cancelled(&self) -> bool {
        false
    }

    /// The phase, and the part of the phase that is done, 0 to 1. How often there is something to find is not known
    /// before: within the search the part is that of the present round.
    fn progress(&self, _phase: Phase, _part: f64) {}
}

/// Nobody watches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Watch for Unwatched {}

/// A flag that somebody sets.
impl Watch for std::sync::atomic::AtomicBool {
    fn is_cancelled(&self) -> bool {
        self.load(std::sync::atomic::Ordering::Relaxed)
    }
}
