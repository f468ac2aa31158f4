//! A byte queue between an interrupt and the main loop.
use core::array;
use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// A queue of up to `N` bytes (`N` a power of two) for one writer and one reader, which may interrupt each other.
/// Never panics and never blocks; more than one writer, or more than one reader, at a time can lose bytes but
/// not memory safety.
#[derive(Debug)]
pub struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    /// Bytes ever written; only the writer moves it.
    written: AtomicUsize,
    /// Bytes ever read; only the reader moves it.
    read: AtomicUsize,
}

impl<const N: usize> Default for Ring<N> {
    fn default() -> Self {
        Self {
            bytes: array::from_fn(|_| AtomicU8::new(0)),
            written: AtomicUsize::new(0),
            read: AtomicUsize::new(0),
        }
    }
}

impl<const N: usize> Ring<N> {
    /// An empty queue; a constant, so that it can live in a static.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two()) };
        Self {
            bytes: [const { AtomicU8::new(0) }; N],
            written: AtomicUsize::new(0),
            read: AtomicUsize::new(0),
        }
    }

    /// Puts a byte in; false when the queue is full, and the byte is lost.
    pub fn push(&self, byte: u8) -> bool {
        let written = self.written.load(Ordering::Relaxed);
        let full = written.wrapping_sub(self.read.load(Ordering::Acquire)) >= N;
        if !full && let Some(cell) = self.bytes.get(written & (N - 1)) {
            cell.store(byte, Ordering::Relaxed);
            self.written.store(written.wrapping_add(1), Ordering::Release);
        }
        !full
    }

    /// The oldest byte, which stays; for the reader.
    pub fn peek(&self) -> Option<u8> {
        let read = self.read.load(Ordering::Relaxed);
        if read == self.written.load(Ordering::Acquire) {
            return None;
        }
        Some(self.bytes.get(read & (N - 1))?.load(Ordering::Relaxed))
    }

    /// Takes the oldest byte out.
    pub fn pop(&self) -> Option<u8> {
        let byte = self.peek()?;
        self.read.store(self.read.load(Ordering::Relaxed).wrapping_add(1), Ordering::Release);
        Some(byte)
    }

    /// Room for this many more bytes.
    pub fn free(&self) -> usize {
        N.saturating_sub(self.written.load(Ordering::Relaxed).wrapping_sub(self.read.load(Ordering::Acquire)))
    }

    /// Nothing to take out.
    pub fn is_empty(&self) -> bool {
        self.free() == N
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::collections::VecDeque;
    use std::thread;

    use proptest::prelude::*;

    use super::Ring;

    proptest! {
        /// Behaves as a bounded queue, across the wrap of the indices.
        #[test]
        fn is_a_bounded_queue(operations in prop::collection::vec(prop::option::weighted(0.6, any::<u8>()), 0..500)) {
            let ring = Ring::<16>::new();
            let mut model = VecDeque::new();
            for operation in operations {
                if let Some(byte) = operation {
                    prop_assert_eq!(ring.push(byte), model.len() < 16);
                    if model.len() < 16 {
                        model.push_back(byte);
                    }
                } else {
                    prop_assert_eq!(ring.peek(), model.front().copied());
                    prop_assert_eq!(ring.pop(), model.pop_front());
                }
                prop_assert_eq!(ring.free(), 16 - model.len());
                prop_assert_eq!(ring.is_empty(), model.is_empty());
            }
        }
    }

    /// A writer and a reader at the same time: every byte comes through once and in order.
    #[test]
    fn carries_bytes_between_threads() {
        static RING: Ring<64> = Ring::new();
        let writer = thread::spawn(|| {
            for k in 0..200_000u32 {
                while !RING.push(k as u8) {
                    thread::yield_now();
                }
            }
        });
        for k in 0..200_000u32 {
            let byte = loop {
                match RING.pop() {
                    Some(byte) => break byte,
                    None => thread::yield_now(),
                }
            };
            assert_eq!(byte, k as u8);
        }
        writer.join().unwrap();
    }
}
