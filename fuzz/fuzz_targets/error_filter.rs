//! See `schuler_fuzz::filter::filter`.
#![no_main]
use std::alloc::System;

use cap::Cap;
use libfuzzer_sys::fuzz_target;

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, schuler_fuzz::MEMORY);

fuzz_target!(init: schuler_fuzz::sow("error_filter"), |data: &[u8]| schuler_fuzz::filter::filter(data));
