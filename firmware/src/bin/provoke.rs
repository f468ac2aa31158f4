//! Provokes what should never happen, to prove what is made against it. Not for flight.
//!
//! After its boot line it does what the first byte on the link asks for: `p` panics, `f` accesses memory that is not
//! there, `s` overflows the stack, `w` hangs, `i` raises an interrupt nobody has asked for.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {}

#[cfg(target_os = "none")]
mod image {
    #![allow(unsafe_code)]
    use core::hint::black_box;

    use cortex_m::interrupt::InterruptNumber;
    use cortex_m::peripheral::NVIC;
    use cortex_m_rt::entry;
    use schuler_firmware::{board, log, serial, start};

    #[derive(Clone, Copy)]
    struct Unused;

    // SAFETY: both boards have an interrupt 5; nothing uses it.
    unsafe impl InterruptNumber for Unused {
        fn number(self) -> u16 {
            5
        }
    }

    #[entry]
    fn main() -> ! {
        board::start();
        start::introduce(serial::IDENTITY);
        // The ready mark.
        while !board::link_send(b'R') {}
        loop {
            board::feed_watchdog();
            log::drain();
            match board::RECEIVED.pop() {
                Some(b'p') => panic!("provoked"),
                // SAFETY: none: there is nothing at this address. That is the point.
                Some(b'f') => unsafe {
                    (0x5000_0000 as *const u32).read_volatile();
                },
                Some(b's') => {
                    black_box(overflow(1));
                }
                Some(b'w') => loop {
                    log::drain();
                },
                Some(b'i') => {
                    // SAFETY: raising it is the point.
                    unsafe { NVIC::unmask(Unused) };
                    NVIC::pend(Unused);
                }
                _ => (),
            }
        }
    }

    /// Takes a kilobyte of stack a call, for good.
    #[inline(never)]
    #[allow(unconditional_recursion)]
    fn overflow(depth: u32) -> u32 {
        let block = black_box([depth; 256]);
        overflow(depth + 1) + block[depth as usize % 256]
    }
}
