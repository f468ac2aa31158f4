//! Where the read-out and the narrow banks lie, one after the other.
use crate::identification::bank::FilterBank;
use crate::identification::read_out::ReadOut;
use crate::saved::{Saved, Walk};

/// The narrow bank: three standard deviations and three correlation times per channel.
pub(super) type NarrowBank = FilterBank<3, 81>;
pub(super) const NARROW: usize = 81;
/// Bytes of a place in a saved state.
const SAVED_PLACE: usize = size_of::<NarrowBank>();
const _: () = assert!(SAVED_PLACE >= size_of::<ReadOut>());
/// The narrow bank's member without any offset.
pub(super) const CENTRE: usize = NARROW / 2;

/// What is needed one after the other: the read-out, then the narrow bank that is laid around what it has found. There are
/// two places, so that one narrow bank is in use while the next identification works in the other.
///
/// The tag stands by itself, so that an identifier that waits is all zeros; a whole word, so that nothing lies between it and the
/// zeros of an empty place, which would then be made on the stack first.
#[derive(Clone, Copy, Debug)]
#[repr(u32)]
#[expect(clippy::large_enum_variant, reason = "no heap to box it in")]
pub(super) enum Place {
    Bank(NarrowBank),
    ReadOut(ReadOut),
}

impl Place {
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

/// Filled up to one length, so that what comes behind has its place whichever it is.
impl Saved for Place {
    fn walk(&mut self, walk: &mut Walk<'_>) {
        let mut tag = u8::from(self.bank().is_none());
        if walk.tag(&mut tag, 2) && (tag == 1) == self.bank().is_some() {
            self.empty(tag == 1);
        }
        let end = walk.here() + SAVED_PLACE as u32;
        match self {
            Self::Bank(bank) => bank.walk(walk),
            Self::ReadOut(read_out) => read_out.walk(walk),
        }
        while walk.here() < end {
            0u8.walk(walk);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::Gaussian;
    use crate::identification::read_out::PASSES;
    use crate::saved::Checksum;

    fn bytes(place: &mut Place) -> [u8; 1 + SAVED_PLACE] {
        let mut bytes = [0; 1 + SAVED_PLACE];
        let mut walk = Walk::save(0, &mut bytes);
        place.walk(&mut walk);
        assert_eq!((walk.served(), walk.here()), (1 + SAVED_PLACE as u32, 1 + SAVED_PLACE as u32));
        bytes
    }

    #[test]
    fn a_place_is_brought_back_over_whatever_was_there() {
        let state = Gaussian::independent([0.1, 0.2, 0.3, 0.4], [1.0; 4]);
        let mut bank = NarrowBank::new();
        bank.start_member(CENTRE, &state, -3.0);
        bank.start_at(77);
        let mut read_out = ReadOut::new();
        read_out.begin_pass(PASSES - 1, 5);
        read_out.take(9, &state, true);
        let (bank, read_out) = (Place::Bank(bank), Place::ReadOut(read_out));
        for from in [&bank, &read_out] {
            for over in [&bank, &read_out, &Place::EMPTY] {
                let (mut from, mut over) = (*from, *over);
                let saved = bytes(&mut from);
                let mut walk = Walk::restore(0, &saved, Checksum::EMPTY);
                over.walk(&mut walk);
                assert_eq!(walk.served() as usize, saved.len());
                assert_eq!(bytes(&mut over), saved);
            }
        }
    }
}
