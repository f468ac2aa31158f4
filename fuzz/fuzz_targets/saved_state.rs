//! See `schuler_fuzz::state::state`.
#![no_main]
use std::alloc::System;

use cap::Cap;
use libfuzzer_sys::fuzz_target;

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, schuler_fuzz::MEMORY);

fuzz_target!(init: schuler_fuzz::sow("saved_state"), |data: &[u8]| schuler_fuzz::state::state(data));
