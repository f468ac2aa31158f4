//! Where an identification stands.
use super::workspace::NARROW;
use crate::saved::{Saved, Visitor};

/// Where the current identification stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Phase {
    /// Until the next one is due.
    Waiting,
    /// Evaluating the simplex point.
    Search { start: u8 },
    /// Collecting lagged products.
    ReadOut { pass: u8 },
    /// Fitting one channel.
    Fit { channel: u8 },
    /// Evaluating the read-out of one channel.
    Check { channel: u8 },
    /// Evaluating one channel's exponential-cosine, first at the places of the scan.
    Coloured { channel: u8, scan: u8 },
    /// Evaluating off the maximum: τ_a up, τ_a down, τ_w up, τ_w down.
    Probe { probe: u8 },
    /// Replaying for one member of the narrow bank.
    Populate { member: u8 },
    /// The narrow bank takes in what arrived meanwhile.
    CatchUp,
}

impl Saved for Phase {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        let (mut tag, mut first, mut second) = match *self {
            Self::Waiting => (0, 0, 0),
            Self::Search { start } => (1, start, 0),
            Self::ReadOut { pass } => (2, pass, 0),
            Self::Fit { channel } => (3, channel, 0),
            Self::Check { channel } => (4, channel, 0),
            Self::Coloured { channel, scan } => (5, channel, scan),
            Self::Probe { probe } => (6, probe, 0),
            Self::Populate { member } => (7, member, 0),
            Self::CatchUp => (8, 0, 0),
        };
        visitor.tag(&mut tag, 9);
        // The longest series that a phase counts through.
        visitor.tag(&mut first, NARROW as u8);
        second.visit(visitor);
        *self = match tag {
            0 => Self::Waiting,
            1 => Self::Search { start: first },
            2 => Self::ReadOut { pass: first },
            3 => Self::Fit { channel: first },
            4 => Self::Check { channel: first },
            5 => Self::Coloured { channel: first, scan: second },
            6 => Self::Probe { probe: first },
            7 => Self::Populate { member: first },
            _ => Self::CatchUp,
        };
    }
}
