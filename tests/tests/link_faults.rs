//! The link between this process and the emulated module while the line loses, repeats, delays and changes bytes: every
//! step is run exactly once, and its answer is the one that an undisturbed module gives.
use std::time::Duration;

use host_sim::emulator::{Disturbance, HostModule, Target, Transport};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use schuler_core::module::ModuleConfig;

use crate::common::flight::Flight;

use crate::common;

const STEPS: usize = 60;

/// What the line does to a frame, one time in five.
#[derive(Clone, Copy, Debug)]
enum Fault {
    Loses,
    Repeats,
    Delays,
    ChangesAByte,
    Cuts,
    InsertsNoise,
}

fn disturbance(fault: Fault, seed: u64) -> Disturbance {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut frame: Vec<u8> = Vec::new();
    let mut held_back: Vec<u8> = Vec::new();
    Box::new(move |bytes| {
        let mut sent = Vec::new();
        for byte in bytes {
            frame.push(*byte);
            // A zero ends a frame; the one before it begins it.
            if *byte == 0 && frame.len() > 1 {
                sent.append(&mut disturbed(std::mem::take(&mut frame), fault, &mut random, &mut held_back));
            }
        }
        sent
    })
}

fn disturbed(mut frame: Vec<u8>, fault: Fault, random: &mut Pcg64, held_back: &mut Vec<u8>) -> Vec<u8> {
    let at = random.random_range(0..frame.len());
    if random.random_bool(0.2) {
        match fault {
            Fault::Loses => frame.clear(),
            Fault::Repeats => frame.extend_from_within(..),
            Fault::Delays => {
                // Comes after the next one, or the one after that.
                held_back.append(&mut frame);
                return Vec::new();
            }
            Fault::ChangesAByte => frame[at] ^= random.random_range(1..=255),
            Fault::Cuts => frame.truncate(at),
            Fault::InsertsNoise => {
                let noise: Vec<u8> = (0..random.random_range(1..20)).map(|_| random.random()).collect();
                frame.splice(at..at, noise);
            }
        }
    }
    if random.random_bool(0.5) {
        frame.append(held_back);
    }
    frame
}

#[test]
fn every_step_is_run_exactly_once_whatever_the_line_does() {
    if common::skipped("every_step_is_run_exactly_once_whatever_the_line_does") {
        return;
    }
    let mut emulator = common::start(Transport::Uart);
    // A command that is sent again too early does no harm: that is the point.
    emulator.set_patience(Duration::from_millis(100));
    let faults =
        [Fault::Loses, Fault::Repeats, Fault::Delays, Fault::ChangesAByte, Fault::Cuts, Fault::InsertsNoise];
    for (seed, fault) in faults.into_iter().enumerate() {
        let seed = seed as u64;
        let mut host = HostModule::new();
        host.configure(&ModuleConfig::default()).unwrap();
        emulator.configure(&ModuleConfig::default()).unwrap();
        let before = emulator.counters().unwrap();

        emulator.disturb(disturbance(fault, seed), disturbance(fault, seed + 100));
        for input in Flight::new(seed).take(STEPS) {
            assert_eq!(emulator.step(&input).unwrap(), host.step(&input).unwrap(), "{fault:?}");
        }
        emulator.leave_alone();

        let after = emulator.counters().unwrap();
        assert_eq!((after.steps - before.steps) as usize, STEPS, "{fault:?}");
        assert_eq!(after.lost_bytes, 0);
        say!(
            "{fault:?}: {} frames refused, {} answered again, {} came late",
            after.refused.total() - before.refused.total(),
            after.repeated - before.repeated,
            after.stale - before.stale
        );
    }
    let counters = emulator.counters().unwrap();
    let happened = [counters.refused.total(), counters.repeated, counters.stale];
    assert!(happened.iter().all(|count| *count > 0), "the line was disturbed: {counters:?}");
}
