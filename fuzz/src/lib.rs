//! Bad input: what every reader and the flight step are held to, whatever comes in.
//!
//! Each target is a function of bytes that panics when a promise is broken. The same functions are run by libFuzzer
//! (`fuzz_targets/`, built and run by `tests/fuzz`) and, for a few thousand inputs, by the ordinary tests
//! (`tests/smoke.rs`).
//!
//! | target | bytes are | held to |
//! | --- | --- | --- |
//! | [`link::decoder`] | a line's bytes | refused or a whole frame, each refusal counted, in fixed memory |
//! | [`link::message`] | the content of a sound frame | a message that goes out again as it came, or refused |
//! | [`link::conversation`] | commands, repetitions, noise, jumps of the clock | every answer a frame; finite outputs |
//! | [`compensation::block`] | a block, or its content under a sound checksum | refused, or corrections finite and within limits |
//! | [`case::case`] | a case file | an error by line, or a case that is written and read back the same |
//! | [`table::text`] | CSV or gzipped CSV | an error, or columns of one length of finite numbers and NaN |
//! | [`table::parquet`] | a Parquet file | the same, chunk by chunk, up to so many rows |
//! | [`table::ulog`] | a ULog file | the same, and the rows of a topic by themselves as beside others |
//! | [`table::mcap`] | an MCAP file, or messages in a sound one | the same |
//! | [`recording::recording`] | a table under a fixed case | an error, or times that increase and series of one length |
//! | [`flight::flight`] | a flight: configuration, readings, commands, clock | finite outputs in range |
//! | [`flight::step`] | a few steps of it, from the start, a quiet flight or a bad one | the same |
//! | [`state::state`] | a saved state, changed, cut, of another module, in parts | refused and nothing changed, or it flies, and saves as the same |
//! | [`flight::configuration`] | a module's configuration | refused, or it flies without a panic |
//! | [`filter::filter`] | measurements, gaps, retunings | covariance symmetric positive definite in both precisions |
//!
//! Memory is bounded for all of them by [`MEMORY`]: beyond it an allocation fails and the process ends.

pub mod case;
pub mod compensation;
pub mod filter;
pub mod flight;
pub mod link;
pub mod recording;
pub mod seeds;
pub mod source;
pub mod state;
pub mod table;

/// Memory that a target may use, bytes.
pub const MEMORY: usize = 512 << 20;

/// One target.
#[derive(Clone, Copy)]
pub struct Target {
    /// Its name, that of the file in `fuzz_targets`.
    pub name: &'static str,
    /// What is run on each input.
    pub run: fn(&[u8]),
    /// Sound inputs to start from.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

/// All targets.
pub const TARGETS: [Target; 15] = [
    Target { name: "link_decoder", run: link::decoder, seeds: seeds::frames },
    Target { name: "link_message", run: link::message, seeds: seeds::messages },
    Target { name: "link_endpoint", run: link::conversation, seeds: seeds::noise },
    Target { name: "compensation_block", run: compensation::block, seeds: seeds::blocks },
    Target { name: "case", run: case::case, seeds: seeds::cases },
    Target { name: "table_text", run: table::text, seeds: seeds::text_tables },
    Target { name: "table_parquet", run: table::parquet, seeds: seeds::parquet_tables },
    Target { name: "table_ulog", run: table::ulog, seeds: seeds::ulog_tables },
    Target { name: "table_mcap", run: table::mcap, seeds: seeds::mcap_tables },
    Target { name: "recording", run: recording::recording, seeds: seeds::text_tables },
    Target { name: "flight", run: flight::flight, seeds: seeds::noise },
    Target { name: "flight_step", run: flight::step, seeds: seeds::noise },
    Target { name: "saved_state", run: state::state, seeds: seeds::noise },
    Target { name: "flight_configuration", run: flight::configuration, seeds: seeds::configurations },
    Target { name: "error_filter", run: filter::filter, seeds: seeds::noise },
];

/// Writes the seeds of a target to the directory that `SCHULER_FUZZ_SEEDS` names, if it does.
pub fn sow(name: &str) {
    let Some(directory) = std::env::var_os("SCHULER_FUZZ_SEEDS") else { return };
    let seeds = TARGETS.iter().filter(|target| target.name == name).flat_map(|target| (target.seeds)());
    for (index, seed) in seeds.enumerate() {
        let path = std::path::Path::new(&directory).join(format!("seed-{index}"));
        std::fs::write(path, seed).expect("the seeds can be written");
    }
}
