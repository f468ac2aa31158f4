//! Bytes moved in place: `memory.s` takes the place of the compiler's own routine, which is fast where places overlap and takes
//! 1600 bytes of flash for it. Here places overlap wholly or not at all.
#![allow(unsafe_code, reason = "assembly; called by the compiler, by the rules of the ABI")]

core::arch::global_asm!(include_str!("memory.s"), options(raw));
