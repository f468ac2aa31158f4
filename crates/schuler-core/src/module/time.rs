//! What the time stamps say, and a clock that only runs forward.
use crate::saved::saved;

/// Longest gap that is bridged, in steps. After a longer one the time that has passed is not trusted.
const LONGEST_GAP: u64 = 600;
/// What the monotonic clock moves at a jump: longer than any part bridges.
const JUMP_MS: u64 = 600_000;

/// What the time stamps say has happened since the last step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Passage {
    OneStep,
    /// So many steps are missing in between.
    Missing(u32),
    /// The time ran backwards or repeated.
    Backwards,
    /// More than can be bridged.
    Jump,
}

impl Passage {
    /// Nominal steps since the last one, for a part that bridges gaps by itself and starts anew when they are too
    /// long; none for a step that repeats.
    pub(super) fn elapsed(self) -> u32 {
        match self {
            Self::OneStep => 1,
            Self::Missing(steps) => steps.saturating_add(1),
            Self::Backwards => 0,
            Self::Jump => u32::MAX,
        }
    }

    /// Steps that the Schuler loop has moved, as far as is known.
    pub(super) fn moved(self) -> u32 {
        match self {
            Self::OneStep | Self::Backwards | Self::Jump => 1,
            Self::Missing(steps) => steps.saturating_add(1),
        }
    }
}

/// The time stamps so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Clock {
    last_ms: Option<u64>,
    /// Runs forward whatever the time stamps do: a step that ran backwards is a nominal step, a jump longer than any part
    /// bridges.
    steady_ms: u64,
}

impl Clock {
    /// Takes the time of a step.
    pub(super) fn pass(&mut self, now_ms: u64, step_s: f32) -> Passage {
        let passage = passage(self.last_ms, now_ms, step_s);
        let since_ms = self.last_ms.map(|last_ms| now_ms.saturating_sub(last_ms));
        // Never zero: time passes.
        let nominal_ms = (libm::roundf(1000.0 * step_s) as u64).max(1);
        let moved_ms = match (passage, since_ms) {
            (Passage::OneStep | Passage::Missing(_), Some(since_ms)) => since_ms,
            (Passage::OneStep | Passage::Missing(_), None) | (Passage::Backwards, _) => nominal_ms,
            (Passage::Jump, _) => JUMP_MS.max(nominal_ms),
        };
        self.last_ms = Some(now_ms);
        self.steady_ms = self.steady_ms.saturating_add(moved_ms);
        passage
    }

    /// Time of the last step, milliseconds.
    pub(super) fn last_ms(&self) -> Option<u64> {
        self.last_ms
    }

    /// Time that has passed, milliseconds, for parts that need more than steps.
    pub(super) fn monotonic_ms(&self) -> u64 {
        self.steady_ms
    }
}

fn passage(last_ms: Option<u64>, now_ms: u64, step_s: f32) -> Passage {
    let Some(last_ms) = last_ms else { return Passage::OneStep };
    if now_ms <= last_ms {
        return Passage::Backwards;
    }
    let steps = libm::roundf((now_ms - last_ms) as f32 / (1000.0 * step_s));
    if steps <= 1.0 {
        Passage::OneStep
    } else if steps <= LONGEST_GAP as f32 {
        Passage::Missing(steps as u32 - 1)
    } else {
        Passage::Jump
    }
}

saved!([] Clock { last_ms, steady_ms });
