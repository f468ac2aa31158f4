//! The same bits for thirty days: 2.6 million steps on this machine and on the emulated Cortex-M4F, with faults, gaps, jumps of
//! the clock and retunings, and every few hours a power cycle: the emulator is killed, a new one started and configured, and
//! the state that was saved before brought back. The saved states are compared byte for byte, too.
//!
//! The long runs are not for every day (`docs/same-bits.md` has what they gave):
//!
//! ```text
//! cargo test -p schuler-tests thirty_days:: -- --ignored --nocapture
//! ```
use std::time::Instant;

use host_sim::emulator::{Emulator, HostModule, Image, Target, Transport};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use schuler_core::module::{Status, StepOutput};
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

/// What a flight has led through.
#[derive(Default)]
struct Flown {
    steps: usize,
    power_cycles: usize,
    retunes: usize,
    faults: usize,
    status: Status,
    /// Over the outputs of all steps, for a comparison with other machines.
    digest: u64,
}

/// Flies on both, with a power cycle after about every `leg` steps; whatever differs ends the test.
fn fly_both(transport: Transport, steps: usize, leg: usize) -> Flown {
    let kind = match transport {
        Transport::Uart => Image::Serial,
        Transport::Fifo => Image::Semihosting,
    };
    let config = everything();
    let block = encode(&full_block());
    let begin = Instant::now();
    let mut random = Pcg64::seed_from_u64(30);
    let mut flight = Flight::new(30);
    let mut host = HostModule::new();
    let mut emulator = common::start(transport);
    // One of its own: neither a build nor the test beside it is to change it.
    let name = format!("schuler-thirty-days-{}-{transport:?}.elf", std::process::id());
    let image = std::env::temp_dir().join(name);
    std::fs::copy(emulator.image(), &image).unwrap();
    for target in [&mut host as &mut dyn Target, &mut emulator] {
        target.configure(&config).unwrap();
        target.load_compensation(&block).unwrap();
    }

    let mut flown = Flown { digest: 0xcbf2_9ce4_8422_2325, ..Flown::default() };
    let (mut here, mut there) = ([0; MAX_MESSAGE], [0; MAX_MESSAGE]);
    loop {
        let until = (flown.steps + random.random_range(leg / 2..leg * 3 / 2)).min(steps);
        while flown.steps < until {
            let inputs: Vec<_> = flight.by_ref().take(BATCH.min(until - flown.steps)).collect();
            let mut outputs = emulator.run(inputs.iter().copied());
            for input in &inputs {
                let expected = host.step(input).unwrap();
                let output = outputs.next().unwrap().unwrap();
                let expected_bits = bits(&expected, &mut here);
                assert!(
                    bits(&output, &mut there) == expected_bits,
                    "step {} differs\ninput  {input:?}\nhost   {expected:?}\ntarget {output:?}",
                    expected.step
                );
                flown.digest = digest(flown.digest, expected_bits);
                flown.steps += 1;
                flown.status |= expected.status;
                flown.retunes += usize::from(expected.status.contains(Status::RETUNED));
                flown.faults += usize::from(expected.isolation.excluded != 0);
            }
        }
        let state = emulator.save().unwrap();
        assert!(state == host.save().unwrap(), "the states differ after {} steps", flown.steps);
        if flown.steps == steps {
            break;
        }
        say!(
            "{:>8} steps in {:>6.0} s, {:.0} steps/s, {} retunings; power cycle with {} bytes of state",
            flown.steps,
            begin.elapsed().as_secs_f64(),
            flown.steps as f64 / begin.elapsed().as_secs_f64(),
            flown.retunes,
            state.len()
        );
        // Power off, here and there; what comes meanwhile is lost.
        drop(emulator);
        let outage = match flown.power_cycles % 3 {
            0 => 0,
            1 => random.random_range(1..300),
            _ => random.random_range(1000..5000),
        };
        flight.by_ref().take(outage).for_each(drop);
        host = HostModule::new();
        emulator = Emulator::start_image(kind, &image).unwrap();
        for target in [&mut host as &mut dyn Target, &mut emulator] {
            target.configure(&config).unwrap();
            target.restore(&state).unwrap();
        }
        flown.power_cycles += 1;
    }
    std::fs::remove_file(&image).unwrap();
    say!(
        "{} steps in {:.0} s: {} power cycles, {} retunings, {} steps without a gyro, all the same; digest of the outputs {:016x}",
        flown.steps,
        begin.elapsed().as_secs_f64(),
        flown.power_cycles,
        flown.retunes,
        flown.faults,
        flown.digest
    );
    assert_eq!(flown.steps, steps, "every step was compared");
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
    let flown = fly_both(Transport::Fifo, 6 * HOUR, 2 * HOUR);
    assert!(flown.power_cycles >= 2);
}

#[test]
fn a_quarter_of_an_hour_with_power_cycles_gives_the_same_bits_over_the_serial_line() {
    if common::skipped("a_quarter_of_an_hour_with_power_cycles_gives_the_same_bits_over_the_serial_line") {
        return;
    }
    let flown = fly_both(Transport::Uart, HOUR / 4, HOUR / 8);
    assert!(flown.power_cycles >= 1);
}

#[test]
#[ignore = "hours; run by: cargo test -p schuler-tests thirty_days::thirty -- --ignored --nocapture"]
fn thirty_days_give_the_same_bits() {
    let flown = fly_both(Transport::Fifo, 30 * DAY, DAY / 2);
    assert!(flown.power_cycles >= 40 && flown.retunes >= 20, "{} retunings", flown.retunes);
    assert_eventful(&flown);
}

#[test]
#[ignore = "many minutes; run by: cargo test -p schuler-tests thirty_days::a_day -- --ignored --nocapture"]
fn a_day_gives_the_same_bits_over_the_serial_line() {
    let flown = fly_both(Transport::Uart, DAY, DAY / 6);
    assert!(flown.power_cycles >= 4 && flown.retunes >= 1, "{} retunings", flown.retunes);
    assert_eventful(&flown);
}
