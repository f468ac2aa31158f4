//! defmt frames to the second serial line.
//!
//! A frame is composed with interrupts masked and put into a queue as a whole, or dropped as a whole; the main loop
//! sends the queue when it has nothing better to do. So the log never holds up the link, and never cuts a frame.
#![allow(unsafe_code)]
use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicU32, Ordering};

use critical_section::RestoreState;
use heapless::Vec;
use schuler_link::ring::Ring;

use crate::board;

/// Longest frame, bytes.
const FRAME: usize = 256;

static QUEUE: Ring<512> = Ring::new();
static DROPPED: AtomicU32 = AtomicU32::new(0);

/// Sends what the line takes now.
pub fn drain() {
    while let Some(byte) = QUEUE.peek() {
        if !board::log_send(byte) {
            return;
        }
        QUEUE.pop();
    }
}

/// Sends everything, however long it takes; only before a reset.
pub fn flush() {
    while !is_empty() {
        drain();
    }
}

/// Nothing waits to be sent.
pub fn is_empty() -> bool {
    QUEUE.is_empty()
}

/// Frames dropped so far, for want of room.
pub fn dropped() -> u32 {
    DROPPED.load(Ordering::Relaxed)
}

#[defmt::global_logger]
struct Logger;

/// The frame in the making.
struct Composer {
    encoder: defmt::Encoder,
    frame: Vec<u8, FRAME>,
    whole: bool,
    restore: RestoreState,
}

struct Shared(UnsafeCell<Composer>);

// SAFETY: only the logger touches it, between `acquire` and `release`, with interrupts masked on the only core.
unsafe impl Sync for Shared {}

static COMPOSER: Shared = Shared(UnsafeCell::new(Composer {
    encoder: defmt::Encoder::new(),
    frame: Vec::new(),
    whole: true,
    restore: RestoreState::invalid(),
}));

impl Composer {
    /// The only reference there is.
    ///
    /// # Safety
    /// Only between `acquire` and `release`, and not while another one lives.
    unsafe fn get() -> &'static mut Self {
        // SAFETY: the caller keeps it the only one.
        unsafe { &mut *COMPOSER.0.get() }
    }

    fn push(frame: &mut Vec<u8, FRAME>, whole: &mut bool, bytes: &[u8]) {
        *whole &= frame.extend_from_slice(bytes).is_ok();
    }
}

// SAFETY: `acquire` masks interrupts until `release`, so that no other context gets in between, and defmt promises to
// call `write` and `flush` only in between.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: `release` gives it back, with the state that is kept here.
        let restore = unsafe { critical_section::acquire() };
        // SAFETY: interrupts are masked now.
        let Composer { encoder, frame, whole, restore: kept } = unsafe { Composer::get() };
        *kept = restore;
        *whole = true;
        frame.clear();
        encoder.start_frame(|bytes| Composer::push(frame, whole, bytes));
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: defmt calls it after `acquire`.
        let Composer { encoder, frame, whole, restore } = unsafe { Composer::get() };
        encoder.end_frame(|bytes| Composer::push(frame, whole, bytes));
        if *whole && frame.len() <= QUEUE.free() {
            frame.iter().for_each(|byte| {
                QUEUE.push(*byte);
            });
        } else {
            DROPPED.fetch_add(1, Ordering::Relaxed);
        }
        // SAFETY: it is the state of the matching `acquire`.
        unsafe { critical_section::release(*restore) };
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: defmt calls it between `acquire` and `release`.
        let Composer { encoder, frame, whole, .. } = unsafe { Composer::get() };
        encoder.write(bytes, |bytes| Composer::push(frame, whole, bytes));
    }
}
