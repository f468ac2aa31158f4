//! The same bits for thirty days: 2.6 million steps on this machine and on the emulated Cortex-M4F, with faults, gaps, jumps of
//! the clock and retunings, and every few hours a power cycle: the emulator is killed, a new one started and configured, and
//! the state that was saved before brought back. The saved states are compared byte for byte, too.
//!
//! The module in this process flies ahead, alone, and keeps its state at each power cycle. The legs between two power cycles
//! are then flown by both, several at a time: each begins from the kept state and must end, here and there, in the next one.
//! So the legs are one flight, whatever the order in which they are flown.
//!
//! The long runs are not for every day (`docs/same-bits.md` has what they gave). They note each leg that gave the same bits,
//! and leave it out when they are started again with the same sources:
//!
//! ```text
//! cargo test -p schuler-tests thirty_days:: -- --ignored --nocapture
//! ```
use std::collections::HashSet;
use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use host_sim::emulator::{Emulator, HostModule, Image, Target, Transport};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_core::module::{Status, StepOutput};
use schuler_link::SOURCE_HASH;
use schuler_link::block::encode;
use schuler_link::frame::MAX_MESSAGE;

use crate::common::flight::{Flight, everything, full_block};

use crate::common;

const HOUR: usize = 3600;
const DAY: usize = 24 * HOUR;

/// Steps compared before the next ones are made: what waits is small.
const BATCH: usize = 2000;

fn bits<'a>(output: &StepOutput, buffer: &'a mut [u8; MAX_MESSAGE]) -> &'a [u8] {
    postcard::to_slice(output, buffer).unwrap()
}

/// FNV-1a with more bytes behind.
fn digest(before: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(before, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
}

/// From one power cycle to the next.
struct Leg {
    flight: Flight,
    steps: usize,
    /// The state that is brought back; none before the first leg, which begins with a configuration and a block.
    begin: Option<Vec<u8>>,
    /// The state that is saved at its end.
    end: Vec<u8>,
    /// Over the outputs of all steps up to its end, and that state.
    digest: u64,
}

impl Leg {
    /// Brings a module that has just got power to where the leg begins.
    fn prepare(begin: Option<&[u8]>, module: &mut dyn Target) {
        if let Some(state) = begin {
            module.restore(state).unwrap();
        } else {
            module.configure(&everything()).unwrap();
            module.load_compensation(&encode(&full_block())).unwrap();
        }
    }

    /// Flies it on both; whatever differs ends the test.
    fn fly(&self, image: Image, elf: &Path) {
        let mut flight = self.flight.clone();
        let mut host = HostModule::new();
        let mut emulator = Emulator::start_image(image, elf).unwrap();
        for module in [&mut host as &mut dyn Target, &mut emulator] {
            Self::prepare(self.begin.as_deref(), module);
        }
        let (mut here, mut there) = ([0; MAX_MESSAGE], [0; MAX_MESSAGE]);
        let mut flown = 0;
        while flown < self.steps {
            let inputs: Vec<_> = flight.by_ref().take(BATCH.min(self.steps - flown)).collect();
            let mut outputs = emulator.run(inputs.iter().copied());
            for input in &inputs {
                let expected = host.step(input).unwrap();
                let output = outputs.next().unwrap().unwrap();
                assert!(
                    bits(&output, &mut there) == bits(&expected, &mut here),
                    "step {} differs\ninput  {input:?}\nhost   {expected:?}\ntarget {output:?}",
                    expected.step
                );
                flown += 1;
            }
        }
        assert!(host.save().unwrap() == self.end, "the host does not come where it was");
        assert!(emulator.save().unwrap() == self.end, "the states differ after {flown} steps of the leg");
    }
}

/// What a flight has led through.
#[derive(Default)]
struct Flown {
    steps: usize,
    power_cycles: usize,
    retunes: usize,
    faults: usize,
    status: Status,
}

/// The flight on this machine alone, with a power cycle after about every `leg` steps.
fn fly_ahead(steps: usize, leg: usize) -> (Vec<Leg>, Flown) {
    let mut random = Pcg64::seed_from_u64(30);
    let mut flight = Flight::new(30);
    let mut legs: Vec<Leg> = Vec::new();
    let mut flown = Flown::default();
    let mut sum = 0xcbf2_9ce4_8422_2325;
    let mut buffer = [0; MAX_MESSAGE];
    while flown.steps < steps {
        let begin = legs.last().map(|before| before.end.clone());
        let mut host = HostModule::new();
        Leg::prepare(begin.as_deref(), &mut host);
        let from = flight.clone();
        let length = random.random_range(leg / 2..leg * 3 / 2).min(steps - flown.steps);
        for input in flight.by_ref().take(length) {
            let output = host.step(&input).unwrap();
            sum = digest(sum, bits(&output, &mut buffer));
            flown.status |= output.status;
            flown.retunes += usize::from(output.status.contains(Status::RETUNED));
            flown.faults += usize::from(output.isolation.excluded != 0);
        }
        flown.steps += length;
        let end = host.save().unwrap();
        sum = digest(sum, &end);
        // Power off; what comes meanwhile is lost.
        let outage = match legs.len() % 3 {
            0 => 0,
            1 => random.random_range(1..300),
            _ => random.random_range(1000..5000),
        };
        flight.by_ref().take(outage).for_each(drop);
        legs.push(Leg { flight: from, steps: length, begin, end, digest: sum });
    }
    flown.power_cycles = legs.len() - 1;
    (legs, flown)
}

/// The legs that have given the same bits, by their digests: a long run that was interrupted goes on from there.
struct Notes {
    done: HashSet<u64>,
    file: Mutex<File>,
}

impl Notes {
    /// Those of these sources and this transport.
    fn open(transport: Transport) -> Self {
        let name = format!("thirty-days-{SOURCE_HASH:016x}-{transport:?}.txt");
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let text = fs::read_to_string(&path).unwrap_or_default();
        let done = text.lines().filter_map(|line| u64::from_str_radix(line, 16).ok()).collect();
        let file = OpenOptions::new().create(true).append(true).open(&path).unwrap();
        Self { done, file: Mutex::new(file) }
    }

    fn add(&self, leg: &Leg) {
        writeln!(self.file.lock().unwrap(), "{:016x}", leg.digest).unwrap();
    }
}

/// Flies on both, as many legs at a time as there are cores. What `notes` has is left out.
fn fly_both(transport: Transport, steps: usize, leg: usize, notes: Option<&Notes>) -> Flown {
    let image = match transport {
        Transport::Uart => Image::Serial,
        Transport::Fifo => Image::Semihosting,
    };
    // One of its own: neither a build nor the test beside it is to change it. It is built, and from these sources.
    let elf = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join(format!("thirty-days-{}-{transport:?}.elf", std::process::id()));
    fs::copy(common::start(transport).image(), &elf).unwrap();

    let begin = Instant::now();
    let (legs, flown) = fly_ahead(steps, leg);
    let ahead = begin.elapsed().as_secs_f64();
    let (done, left): (Vec<_>, Vec<_>) =
        legs.iter().partition(|leg| notes.is_some_and(|notes| notes.done.contains(&leg.digest)));
    let begin = Instant::now();
    let compared = Mutex::new(0);
    left.par_iter().with_max_len(1).for_each(|leg| {
        leg.fly(image, &elf);
        if let Some(notes) = notes {
            notes.add(leg);
            let mut compared = compared.lock().unwrap();
            *compared += leg.steps;
            let seconds = begin.elapsed().as_secs_f64();
            say!(
                "{transport:?}: {compared:>8} steps in {seconds:>6.0} s, {:.0} steps/s",
                *compared as f64 / seconds
            );
        }
    });
    fs::remove_file(&elf).unwrap();
    say!(
        "{transport:?}: {} steps, {} of them earlier, ahead in {ahead:.0} s, on both in {:.0} s: {} power cycles, {} retunings, \
         {} steps without a gyro, all the same; digest {:016x}",
        flown.steps,
        done.iter().map(|leg| leg.steps).sum::<usize>(),
        begin.elapsed().as_secs_f64(),
        flown.power_cycles,
        flown.retunes,
        flown.faults,
        legs.last().unwrap().digest
    );
    flown
}

/// Every flag of the step but those of what cannot happen in a flight.
fn assert_eventful(flown: &Flown) {
    let unlikely = Status::COVARIANCE_RESET | Status::NOT_CONFIGURED;
    assert_eq!(flown.status | unlikely, Status::all(), "every flag must have been up");
    assert!(flown.faults > 0);
}

#[test]
fn six_hours_with_power_cycles_give_the_same_bits() {
    if common::skipped("six_hours_with_power_cycles_give_the_same_bits") {
        return;
    }
    let flown = fly_both(Transport::Fifo, 6 * HOUR, 2 * HOUR, None);
    assert!(flown.power_cycles >= 2);
}

#[test]
fn a_quarter_of_an_hour_with_power_cycles_gives_the_same_bits_over_the_serial_line() {
    if common::skipped("a_quarter_of_an_hour_with_power_cycles_gives_the_same_bits_over_the_serial_line") {
        return;
    }
    let flown = fly_both(Transport::Uart, HOUR / 4, HOUR / 8, None);
    assert!(flown.power_cycles >= 1);
}

#[test]
#[ignore = "hours; run by: cargo test -p schuler-tests thirty_days::thirty -- --ignored --nocapture"]
fn thirty_days_give_the_same_bits() {
    let flown = fly_both(Transport::Fifo, 30 * DAY, DAY / 2, Some(&Notes::open(Transport::Fifo)));
    assert!(flown.power_cycles >= 40 && flown.retunes >= 20, "{} retunings", flown.retunes);
    assert_eventful(&flown);
}

#[test]
#[ignore = "many minutes; run by: cargo test -p schuler-tests thirty_days::a_day -- --ignored --nocapture"]
fn a_day_gives_the_same_bits_over_the_serial_line() {
    let flown = fly_both(Transport::Uart, DAY, DAY / 6, Some(&Notes::open(Transport::Uart)));
    assert!(flown.power_cycles >= 4 && flown.retunes >= 1, "{} retunings", flown.retunes);
    assert_eventful(&flown);
}
