//! Arithmetic in double precision, which the processor does not have: `double.s` takes the place of the compiler's own, whose
//! number of instructions depends on the operands.
#![allow(unsafe_code, reason = "assembly; each function is called by the compiler, by the rules of the ABI")]

core::arch::global_asm!(include_str!("double.s"), options(raw));
