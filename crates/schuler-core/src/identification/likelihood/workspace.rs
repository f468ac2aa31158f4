//! Where the read-out and the narrow banks lie, one after the other.
use crate::identification::bank::FilterBank;
use crate::identification::read_out::ReadOut;
use crate::saved::{Saved, Visitor};

/// The narrow bank: three standard deviations and three correlation times per channel.
pub(super) type NarrowBank = FilterBank<3, 81>;
pub(super) const NARROW: usize = 81;
/// Bytes of a workspace in a saved state.
const SAVED_SIZE: usize = size_of::<NarrowBank>();
const _: () = assert!(SAVED_SIZE >= size_of::<ReadOut>());
/// The narrow bank's member without any offset.
pub(super) const CENTRE: usize = NARROW / 2;

/// What is needed one after the other: the read-out, then the narrow bank that is laid around what it has found. There are
/// two places, so that one narrow bank is in use while the next identification works in the other.
///
/// The tag stands by itself, so that an identifier that waits is all zeros; a whole word, so that nothing lies between it and the
/// zeros of an empty workspace, which would then be made on the stack first.
#[derive(Clone, Copy, Debug)]
#[repr(u32)]
#[expect(clippy::large_enum_variant, reason = "no heap to box it in")]
pub(super) enum Workspace {
    Bank(NarrowBank),
    ReadOut(ReadOut),
}

impl Workspace {
    pub(super) const EMPTY: Self = Self::Bank(NarrowBank::new());

    /// Nothing collected, or a bank that is not laid. Zeros, written in place.
    #[inline(never)]
    pub(super) fn empty(&mut self, read_out: bool) {
        if read_out {
            *self = Self::ReadOut(ReadOut::new());
        } else {
            *self = Self::EMPTY;
        }
    }

    pub(super) fn bank(&self) -> Option<&NarrowBank> {
        match self {
            Self::Bank(bank) => Some(bank),
            Self::ReadOut(_) => None,
        }
    }

    pub(super) fn bank_mut(&mut self) -> Option<&mut NarrowBank> {
        match self {
            Self::Bank(bank) => Some(bank),
            Self::ReadOut(_) => None,
        }
    }

    pub(super) fn read_out(&mut self) -> Option<&mut ReadOut> {
        match self {
            Self::ReadOut(read_out) => Some(read_out),
            Self::Bank(_) => None,
        }
    }
}

/// Filled up to one length, so that what follows begins at the same byte whichever it holds.
impl Saved for Workspace {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        let mut tag = u8::from(self.bank().is_none());
        if visitor.tag(&mut tag, 2) && (tag == 1) == self.bank().is_some() {
            self.empty(tag == 1);
        }
        let end = visitor.here() + SAVED_SIZE as u32;
        match self {
            Self::Bank(bank) => bank.visit(visitor),
            Self::ReadOut(read_out) => read_out.visit(visitor),
        }
        while visitor.here() < end {
            0u8.visit(visitor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::Gaussian;
    use crate::identification::read_out::PASSES;
    use crate::saved::Checksum;

    fn bytes(workspace: &mut Workspace) -> [u8; 1 + SAVED_SIZE] {
        let mut bytes = [0; 1 + SAVED_SIZE];
        let mut visitor = Visitor::save(0, &mut bytes);
        workspace.visit(&mut visitor);
        assert_eq!((visitor.served(), visitor.here()), (1 + SAVED_SIZE as u32, 1 + SAVED_SIZE as u32));
        bytes
    }

    #[test]
    fn a_workspace_is_brought_back_over_whatever_was_there() {
        let state = Gaussian::independent([0.1, 0.2, 0.3, 0.4], [1.0; 4]);
        let mut bank = NarrowBank::new();
        bank.start_member(CENTRE, &state, -3.0);
        bank.start_at(77);
        let mut read_out = ReadOut::new();
        read_out.begin_pass(PASSES - 1, 5);
        read_out.take(9, &state, true);
        let (bank, read_out) = (Workspace::Bank(bank), Workspace::ReadOut(read_out));
        for from in [&bank, &read_out] {
            for over in [&bank, &read_out, &Workspace::EMPTY] {
                let (mut from, mut over) = (*from, *over);
                let saved = bytes(&mut from);
                let mut visitor = Visitor::restore(0, &saved, Checksum::EMPTY);
                over.visit(&mut visitor);
                assert_eq!(visitor.served() as usize, saved.len());
                assert_eq!(bytes(&mut over), saved);
            }
        }
    }
}
