//! See `schuler_fuzz::link::conversation`.
#![no_main]
use std::alloc::System;

use cap::Cap;
use libfuzzer_sys::fuzz_target;

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, schuler_fuzz::MEMORY);

fuzz_target!(init: schuler_fuzz::sow("link_endpoint"), |data: &[u8]| schuler_fuzz::link::conversation(data));
