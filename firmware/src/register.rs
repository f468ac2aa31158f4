//! Access to the registers of a peripheral.
#![allow(unsafe_code)]

/// Bytes from a peripheral's base that its registers may take.
const SPAN: usize = 0x1000;

/// The registers of one peripheral, 32 bits each.
#[derive(Clone, Copy)]
pub(crate) struct Peripheral {
    base: usize,
}

impl Peripheral {
    /// The peripheral at this address.
    ///
    /// # Safety
    /// From `base` on lie the registers of a peripheral, which may be read and written at any time from any context
    /// without touching memory, and to which no other code holds a reference.
    pub(crate) const unsafe fn at(base: usize) -> Self {
        assert!(base.is_multiple_of(4));
        Self { base }
    }

    /// Reads the register at this offset.
    pub(crate) fn read(self, offset: usize) -> u32 {
        // SAFETY: whoever called `at` has promised that there is a register; `address` keeps to the peripheral.
        unsafe { self.address(offset).read_volatile() }
    }

    /// Writes the register at this offset.
    pub(crate) fn write(self, offset: usize, value: u32) {
        // SAFETY: as for `read`.
        unsafe { self.address(offset).write_volatile(value) }
    }

    const fn address(self, offset: usize) -> *mut u32 {
        assert!(offset < SPAN && offset.is_multiple_of(4));
        (self.base + offset) as *mut u32
    }
}
