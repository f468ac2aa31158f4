//! Every target on what it is fuzzed from: its seeds, what broke it before, and random changes of both. Seconds, not hours:
//! `tests/fuzz` is the real thing.
use std::alloc::System;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use cap::Cap;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use schuler_fuzz::{TARGETS, Target};

/// An allocation beyond this fails and ends the process.
#[global_allocator]
static MEMORY: Cap<System> = Cap::new(System, schuler_fuzz::MEMORY);

/// Changed inputs of each target.
const INPUTS: usize = 3000;
/// What a slow target may take instead.
const MOST: Duration = Duration::from_secs(3);
/// What one input may take; thousands of times what one does.
const LONGEST: Duration = Duration::from_secs(10);

fn regressions(target: &Target) -> Vec<Vec<u8>> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("regressions").join(target.name);
    let Ok(files) = fs::read_dir(directory) else { return Vec::new() };
    files.map(|file| fs::read(file.unwrap().path()).unwrap()).collect()
}

/// A few bytes changed, cut, put in or copied.
fn changed(random: &mut Pcg64, mut input: Vec<u8>) -> Vec<u8> {
    for _ in 0..random.random_range(1..6) {
        let at = random.random_range(0..=input.len());
        match random.random_range(0..6) {
            0 if at < input.len() => input[at] ^= 1 << random.random_range(0..8),
            1 if at < input.len() => input[at] = random.random(),
            2 if random.random_bool(0.2) => input.truncate(at),
            3 => input.insert(at, *b"\0\xff0.,\n"[..].get(random.random_range(0..6)).unwrap()),
            4 => {
                let end = random.random_range(at..=input.len()).min(at + 32);
                let part = input[at..end].to_vec();
                let to = random.random_range(0..=input.len());
                input.splice(to..to, part);
            }
            _ => {
                let end = (at + random.random_range(1..9)).min(input.len());
                random.fill_bytes(&mut input[at..end]);
            }
        }
    }
    input
}

fn smoke(name: &str) {
    let target = TARGETS.iter().find(|target| target.name == name).unwrap();
    let run = |input: &[u8]| {
        let start = Instant::now();
        (target.run)(input);
        assert!(start.elapsed() < LONGEST, "{name}: {} bytes took {:?}", input.len(), start.elapsed());
    };
    let mut sources = (target.seeds)();
    sources.extend(regressions(target));
    sources.push(Vec::new());
    for input in &sources {
        run(input);
    }
    let mut random = Pcg64::seed_from_u64(20);
    let start = Instant::now();
    let mut inputs = 0;
    while inputs < INPUTS && start.elapsed() < MOST {
        let from = sources[random.random_range(0..sources.len())].clone();
        run(&changed(&mut random, from));
        inputs += 1;
    }
    println!("{name}: {} inputs and {inputs} changed ones, {:?}", sources.len(), start.elapsed());
}

macro_rules! targets {
    ($($name:ident),*) => {
        $(#[test]
        fn $name() {
            smoke(stringify!($name));
        })*

        #[test]
        fn none_is_left_out() {
            let here = [$(stringify!($name)),*];
            let all: Vec<_> = TARGETS.iter().map(|target| target.name).collect();
            assert_eq!(here[..], all[..]);
        }
    };
}

targets!(
    link_decoder,
    link_message,
    link_endpoint,
    compensation_block,
    case,
    table_text,
    table_parquet,
    table_ulog,
    table_mcap,
    recording,
    flight,
    flight_step,
    saved_state,
    flight_configuration,
    error_filter
);
