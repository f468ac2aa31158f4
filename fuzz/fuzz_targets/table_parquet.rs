//! See `schuler_fuzz::table::parquet`.
#![no_main]
use std::alloc::System;

use cap::Cap;
use libfuzzer_sys::fuzz_target;

#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, schuler_fuzz::MEMORY);

fuzz_target!(init: {
        schuler_fuzz::table::expect_panics_of_the_decoder();
        schuler_fuzz::sow("table_parquet");
    }, |data: &[u8]| schuler_fuzz::table::parquet(data));
