//! How the state of the module becomes bytes and comes back: one pass over every value, those that change from step to step
//! and those that the configuration has determined. So a module is brought back without being configured, and what only
//! configuring needs has not to be in flight.
//!
//! A [`Saved`] type hands its parts to the [`Visitor`], always the same ones in the same order, whatever their values: so every
//! value has its place in the bytes, and the visitor can serve any stretch of them without a copy of the rest.
//!
//! Numbers are little-endian, `usize` has four bytes, a truth value, the tag of an `enum` and that of an `Option` one byte, and
//! what is not there its full size in zeros. NaN is always the same one.
use crc::{CRC_32_ISO_HDLC, Crc};
use nalgebra::SMatrix;

/// What the checksum is looked up in: a kilobyte on a host, nothing on the target, where flash is short. It takes 32 instructions a
/// byte there, 1.5 million for the whole of a state, in the part that has its end.
#[cfg(not(target_os = "none"))]
type Table = crc::Table<1>;
#[cfg(target_os = "none")]
type Table = crc::NoTable;

/// CRC-32/ISO-HDLC, that of Ethernet and zlib.
const CRC: Crc<u32, Table> = Crc::<u32, Table>::new(&CRC_32_ISO_HDLC);

/// Something whose values can be saved and brought back.
pub trait Saved {
    /// Hands all values to the visitor, in a fixed order.
    fn visit(&mut self, visitor: &mut Visitor<'_>);
}

/// What can stand in for something that is not there.
pub trait Blank: Saved + Sized {
    /// Any value; all zeros in the bytes where the type has such a value.
    fn blank() -> Self;
}

/// What a visitor is for.
#[derive(Debug)]
enum Purpose<'a> {
    /// Counts the bytes.
    Measure,
    /// Forms the checksum.
    Sum,
    /// Writes the bytes.
    Save(&'a mut [u8]),
    /// Brings the bytes back.
    Restore(&'a [u8]),
}

/// One pass over all values. It serves those from `begin` on for which there is room, or which are there; a value is served
/// as a whole or not at all.
#[derive(Debug)]
pub struct Visitor<'a> {
    purpose: Purpose<'a>,
    /// Where the visitor stands, in bytes from the start.
    here: u32,
    begin: u32,
    /// Where the next value to be served begins.
    next: u32,
    /// Of what has been looked at.
    checksum: Checksum,
    /// A value that cannot be.
    flawed: bool,
    #[cfg(test)]
    pub(crate) layout: Checksum,
}

/// A CRC-32 that can be put aside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Checksum(u32);

impl Checksum {
    /// Of nothing.
    pub const EMPTY: Self = Self(0);

    /// The checksum with more bytes behind.
    #[must_use]
    pub fn with(self, bytes: &[u8]) -> Self {
        let mut digest = CRC.digest_with_initial((!self.0).reverse_bits());
        digest.update(bytes);
        Self(digest.finalize())
    }

    /// The checksum of all the bytes.
    pub fn value(self) -> u32 {
        self.0
    }
}

impl<'a> Visitor<'a> {
    /// Only counts the bytes.
    pub fn measure() -> Self {
        Self::new(Purpose::Measure, 0, Checksum::default())
    }

    /// Forms the checksum of all bytes.
    pub fn sum() -> Self {
        Self::new(Purpose::Sum, 0, Checksum::default())
    }

    /// Writes the values from the one that begins at `begin` on.
    pub fn save(begin: u32, bytes: &'a mut [u8]) -> Self {
        Self::new(Purpose::Save(bytes), begin, Checksum::default())
    }

    /// Brings back the values from the one that begins at `begin` on. `checksum` is that of what came before.
    pub fn restore(begin: u32, bytes: &'a [u8], checksum: Checksum) -> Self {
        Self::new(Purpose::Restore(bytes), begin, checksum)
    }

    fn new(purpose: Purpose<'a>, begin: u32, checksum: Checksum) -> Self {
        Self {
            purpose,
            here: 0,
            begin,
            next: begin,
            checksum,
            flawed: false,
            #[cfg(test)]
            layout: Checksum::default(),
        }
    }

    /// Where the visitor stands, in bytes from the start.
    pub fn here(&self) -> u32 {
        self.here
    }

    /// Bytes served.
    pub fn served(&self) -> u32 {
        self.next - self.begin
    }

    /// Checksum of what has been looked at or brought back, and of what came before.
    pub fn checksum(&self) -> Checksum {
        self.checksum
    }

    /// A value was met that cannot be.
    pub fn is_flawed(&self) -> bool {
        self.flawed
    }

    /// The next value will be written, if there is room.
    pub fn is_written_next(&self) -> bool {
        matches!(self.purpose, Purpose::Save(_)) && self.here == self.next
    }

    /// Writes the value, or looks whether the bytes have it.
    ///
    /// # Errors
    /// What they have instead.
    pub fn constant(&mut self, value: u32) -> Result<(), u32> {
        let mut bytes = value.to_le_bytes();
        let found = self.bytes(&mut bytes);
        match u32::from_le_bytes(bytes) {
            other if found && other != value => Err(other),
            _ => Ok(()),
        }
    }

    /// One of `count` things by its number; true when it was brought back.
    #[inline(never)]
    pub fn tag(&mut self, tag: &mut u8, count: u8) -> bool {
        let mut bytes = [*tag];
        let found = self.bytes(&mut bytes);
        let [value] = bytes;
        self.take(tag, value, found, value < count)
    }

    /// The bits of flags, none but those of `all`; true when they were brought back.
    #[inline(never)]
    pub fn flags(&mut self, bits: &mut u32, all: u32) -> bool {
        let mut bytes = bits.to_le_bytes();
        let found = self.bytes(&mut bytes);
        let value = u32::from_le_bytes(bytes);
        self.take(bits, value, found, value & !all == 0)
    }

    /// An index or a count below `bound`.
    #[inline(never)]
    pub fn below(&mut self, index: &mut u32, bound: u32) -> bool {
        let mut bytes = index.to_le_bytes();
        let found = self.bytes(&mut bytes);
        let value = u32::from_le_bytes(bytes);
        self.take(index, value, found, value < bound)
    }

    fn take<T>(&mut self, slot: &mut T, value: T, found: bool, possible: bool) -> bool {
        self.flawed |= found && !possible;
        let restored = found && possible;
        if restored {
            *slot = value;
        }
        restored
    }

    /// Serves one value; true when the bytes have one, which then stands in `value`.
    #[inline(never)]
    fn bytes(&mut self, value: &mut [u8]) -> bool {
        let here = self.here;
        self.here = here.wrapping_add(value.len() as u32);
        let from = here.wrapping_sub(self.begin) as usize;
        let place = from..from.wrapping_add(value.len());
        let found = match &mut self.purpose {
            Purpose::Measure => return false,
            Purpose::Sum => {
                self.checksum = self.checksum.with(value);
                return false;
            }
            Purpose::Save(bytes) => {
                if let Some(slot) = bytes.get_mut(place).filter(|_| here == self.next) {
                    copy(value, slot);
                    self.next = self.here;
                }
                return false;
            }
            Purpose::Restore(bytes) => bytes.get(place).filter(|_| here == self.next),
        };
        let Some(found) = found else { return false };
        self.checksum = self.checksum.with(found);
        copy(found, value);
        self.next = self.here;
        true
    }
}

/// Of the same length, which the compiler cannot see.
fn copy(from: &[u8], to: &mut [u8]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

macro_rules! number {
    ($($number:ident $(as $canonical:expr)?),*) => {$(
        impl Saved for $number {
            #[inline(never)]
            fn visit(&mut self, visitor: &mut Visitor<'_>) {
                let value = *self;
                $(let value = $canonical(value);)?
                let mut bytes = value.to_le_bytes();
                let found = visitor.bytes(&mut bytes);
                visitor.take(self, $number::from_le_bytes(bytes), found, true);
            }
        }

        impl Blank for $number {
            fn blank() -> Self {
                Self::default()
            }
        }
    )*};
}

number!(
    u8,
    u16,
    u32,
    u64,
    f32 as |value: f32| if value.is_nan() { f32::from_bits(0x7fc0_0000) } else { value },
    f64 as |value: f64| if value.is_nan() { f64::from_bits(0x7ff8_0000_0000_0000) } else { value }
);

impl Saved for bool {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        let mut tag = u8::from(*self);
        visitor.tag(&mut tag, 2);
        *self = tag == 1;
    }
}

impl Blank for bool {
    fn blank() -> Self {
        false
    }
}

impl<T: Saved, const N: usize> Saved for [T; N] {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        for value in self {
            value.visit(visitor);
        }
    }
}

impl<T: Blank, const N: usize> Blank for [T; N] {
    fn blank() -> Self {
        core::array::from_fn(|_| T::blank())
    }
}

impl<A: Saved, B: Saved> Saved for (A, B) {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        self.0.visit(visitor);
        self.1.visit(visitor);
    }
}

impl<A: Blank, B: Blank> Blank for (A, B) {
    fn blank() -> Self {
        (A::blank(), B::blank())
    }
}

impl<T: Saved, const R: usize, const C: usize> Saved for SMatrix<T, R, C> {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        self.data.0.visit(visitor);
    }
}

impl<T: Blank, const R: usize, const C: usize> Blank for SMatrix<T, R, C> {
    fn blank() -> Self {
        Self::from_data(nalgebra::ArrayStorage(Blank::blank()))
    }
}

impl<T: Blank> Saved for Option<T> {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        let mut there = self.is_some();
        there.visit(visitor);
        if there {
            self.get_or_insert_with(T::blank).visit(visitor);
        } else {
            *self = None;
            T::blank().visit(visitor);
        }
    }
}

impl<T: Blank> Blank for Option<T> {
    fn blank() -> Self {
        None
    }
}

/// A number that stays below a bound.
pub trait Bounded {
    /// Hands it to the visitor.
    fn visit_below(&mut self, visitor: &mut Visitor<'_>, bound: u32);
}

impl Bounded for usize {
    fn visit_below(&mut self, visitor: &mut Visitor<'_>, bound: u32) {
        let mut index = *self as u32;
        if visitor.below(&mut index, bound) {
            *self = index as usize;
        }
    }
}

impl Bounded for u32 {
    fn visit_below(&mut self, visitor: &mut Visitor<'_>, bound: u32) {
        visitor.below(self, bound);
    }
}

impl Bounded for u8 {
    fn visit_below(&mut self, visitor: &mut Visitor<'_>, bound: u32) {
        visitor.tag(self, bound as u8);
    }
}

impl Bounded for Option<u8> {
    fn visit_below(&mut self, visitor: &mut Visitor<'_>, bound: u32) {
        let mut tag = self.map_or(0, |number| number.saturating_add(1));
        if visitor.tag(&mut tag, bound as u8 + 1) {
            *self = tag.checked_sub(1);
        }
    }
}

/// Makes a structure [`Saved`] and [`Blank`]: `saved!([generics] Type { fields })`. All fields are named, or this does not compile,
/// with a bound where one must hold (`head < N`). What is `always` there needs no stand-in and is not [`Blank`].
macro_rules! saved {
    ([$($generics:tt)*] $type:ty $(where [$($clauses:tt)*])? { $($field:ident $(< $bound:expr)?),* $(,)? }) => {
        $crate::saved::saved!([$($generics)*] $type $(where [$($clauses)*])? { $($field $(< $bound)?),* } always);

        impl<$($generics)*> $crate::saved::Blank for $type $(where $($clauses)*)? {
            fn blank() -> Self {
                Self { $($field: $crate::saved::saved!(@blank $($bound)?)),* }
            }
        }
    };
    ([$($generics:tt)*] $type:ty $(where [$($clauses:tt)*])? { $($field:ident $(< $bound:expr)?),* $(,)? } always) => {
        impl<$($generics)*> $crate::saved::Saved for $type $(where $($clauses)*)? {
            fn visit(&mut self, visitor: &mut $crate::saved::Visitor<'_>) {
                let Self { $($field),* } = self;
                $(
                    #[cfg(test)]
                    visitor.name(stringify!($field));
                    $crate::saved::saved!(@visit $field, visitor $(, $bound)?);
                )*
            }
        }
    };
    (@visit $field:ident, $visitor:ident) => { $crate::saved::Saved::visit($field, $visitor) };
    (@visit $field:ident, $visitor:ident, $bound:expr) => {
        $crate::saved::Bounded::visit_below($field, $visitor, ($bound) as u32)
    };
    (@blank) => { $crate::saved::Blank::blank() };
    (@blank $bound:expr) => { Default::default() };
}
pub(crate) use saved;

/// Makes an `enum` without fields [`Saved`] by the number of its variant.
macro_rules! saved_choice {
    ($type:ty { $($variant:ident),* $(,)? }) => {
        impl $crate::saved::Saved for $type {
            fn visit(&mut self, visitor: &mut $crate::saved::Visitor<'_>) {
                const ALL: &[$type] = &[$(<$type>::$variant),*];
                let mut tag = match self { $(Self::$variant => Self::$variant as u8),* };
                if visitor.tag(&mut tag, ALL.len() as u8) && let Some(variant) = ALL.get(usize::from(tag)) {
                    *self = *variant;
                }
            }
        }

        impl $crate::saved::Blank for $type {
            fn blank() -> Self {
                Self::default()
            }
        }
    };
}
pub(crate) use saved_choice;

/// Makes flags [`Saved`] by their bits, in four bytes.
macro_rules! saved_flags {
    ($type:ty) => {
        impl $crate::saved::Saved for $type {
            fn visit(&mut self, visitor: &mut $crate::saved::Visitor<'_>) {
                let mut bits = u32::from(self.bits());
                if visitor.flags(&mut bits, u32::from(Self::all().bits())) {
                    *self = Self::from_bits_truncate(bits as _);
                }
            }
        }

        impl $crate::saved::Blank for $type {
            fn blank() -> Self {
                Self::empty()
            }
        }
    };
}
pub(crate) use saved_flags;

#[cfg(test)]
impl Visitor<'_> {
    /// Takes the name of the next value into the fingerprint of the layout.
    pub(crate) fn name(&mut self, name: &str) {
        self.layout = self.layout.with(name.as_bytes()).with(&self.here.to_le_bytes());
    }
}

#[cfg(test)]
mod tests;
