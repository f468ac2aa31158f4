//! The same input gives the same bits on this machine and on the emulated Cortex-M4F.
use std::time::Instant;

use host_sim::emulator::{Emulator, HostModule, Target, Transport};
use schuler_core::compensation::TermStatus;
use schuler_core::health::{HealthStatus, Verdict};
use schuler_core::module::{ModuleConfig, Status, StepOutput};
use schuler_core::thermal::{CompensationStatus, ThermalStatus};
use schuler_link::block::encode;
use schuler_link::frame::MAX_MESSAGE;

use crate::common::flight::{Flight, everything, full_block};

use crate::common;

/// Steps over semihosting: more than a day.
const LONG: usize = 100_000;
/// Steps over the emulated serial port.
const SHORT: usize = 3000;

/// The configurations that are flown one after the other, with every part on: the first is corrected by a full block from
/// its middle on, the second from its start.
fn configurations() -> [ModuleConfig; 2] {
    let mut other = everything();
    other.filter.accelerometer.tau_s = 200.0;
    other.filter.gyro.tau_s = 600.0;
    other.filter.velocity_noise = 0.05;
    other.max_age_ms = 500;
    // The one that the calibration of the block looks at.
    other.thermometers[2] = None;
    [everything(), other]
}

fn bits(output: &StepOutput) -> Vec<u8> {
    let mut buffer = [0; MAX_MESSAGE];
    postcard::to_slice(output, &mut buffer).unwrap().to_vec()
}

/// Everything that the outputs reported, and how often the filter was retuned.
#[derive(Default)]
struct Reported {
    status: Status,
    retunes: u16,
    thermal: ThermalStatus,
    terms: TermStatus,
    calibration: CompensationStatus,
    health: HealthStatus,
    verdicts: Vec<Verdict>,
}

impl Reported {
    fn add(&mut self, output: &StepOutput) {
        self.status |= output.status;
        self.retunes += u16::from(output.status.contains(Status::RETUNED));
        for thermometer in &output.thermometers {
            self.thermal |= thermometer.status;
        }
        self.terms |= output.compensation.terms;
        self.calibration |= output.compensation.calibration;
        self.health |= output.health.status;
        if !self.verdicts.contains(&output.health.verdict) {
            self.verdicts.push(output.health.verdict);
        }
    }
}

fn fly_both(emulator: &mut Emulator, steps: usize) -> Reported {
    let mut compared = 0;
    let mut reported = Reported::default();
    let block = encode(&full_block());
    for (seed, config) in configurations().iter().enumerate() {
        let mut host = HostModule::new();
        host.configure(config).unwrap();
        emulator.configure(config).unwrap();

        let inputs: Vec<_> = Flight::new(seed as u64).take(steps / 2).collect();
        let (before, after) = inputs.split_at(if seed == 0 { inputs.len() / 2 } else { 0 });
        let begin = Instant::now();
        let mut expected: Vec<_> = before.iter().map(|input| host.step(input).unwrap()).collect();
        host.load_compensation(&block).unwrap();
        expected.extend(after.iter().map(|input| host.step(input).unwrap()));
        let host_s = begin.elapsed().as_secs_f64();
        for output in &expected {
            reported.add(output);
        }

        let begin = Instant::now();
        for (part, expected) in [(before, &expected[..before.len()]), (after, &expected[before.len()..])] {
            if std::ptr::eq(part, after) {
                emulator.load_compensation(&block).unwrap();
            }
            for ((input, expected), output) in
                part.iter().zip(expected).zip(emulator.run(part.iter().copied()))
            {
                let output = output.unwrap();
                assert!(
                    bits(&output) == bits(expected),
                    "step {} differs\ninput  {input:?}\nhost   {expected:?}\ntarget {output:?}",
                    expected.step
                );
                compared += 1;
            }
        }
        let target_s = begin.elapsed().as_secs_f64();
        let steps = inputs.len() as f64;
        say!(
            "configuration {seed}: {:.0} steps/s here, {:.0} steps/s on the target",
            steps / host_s,
            steps / target_s
        );
    }
    assert_eq!(compared, steps, "every step was compared");
    assert_eq!(emulator.counters().unwrap().steps as usize, steps, "and run once");
    reported
}

#[test]
fn a_long_flight_gives_the_same_bits() {
    if common::skipped("a_long_flight_gives_the_same_bits") {
        return;
    }
    let mut emulator = common::start(Transport::Fifo);
    let reported = fly_both(&mut emulator, LONG);
    say!("{} retunings, status {:?}", reported.retunes, reported.status);
    assert!(reported.retunes >= 3, "the flight must be retuned");
    let unlikely = Status::COVARIANCE_RESET | Status::NOT_CONFIGURED;
    assert_eq!(reported.status | unlikely, Status::all(), "every flag must have been up");
    assert_eq!(reported.thermal | ThermalStatus::DITHER, ThermalStatus::all());
    assert_eq!(reported.terms | TermStatus::LIMITED, TermStatus::all());
    assert_eq!(reported.calibration, CompensationStatus::all());
    assert_eq!(reported.health | HealthStatus::NUMERICAL_RESET, HealthStatus::all());
    say!("verdicts of the health monitor: {:?}", reported.verdicts);
    assert!(reported.verdicts.len() >= 6, "{:?}", reported.verdicts);
    // The image says so itself when it comes to its end.
    let image = emulator.image().to_owned();
    let (well, log) = emulator.finish().unwrap();
    assert!(well);
    assert_eq!(
        common::decode(&log, &image).last().map(String::as_str),
        Some("info the host has closed the line")
    );
}

#[test]
fn a_short_flight_gives_the_same_bits_over_the_serial_line() {
    if common::skipped("a_short_flight_gives_the_same_bits_over_the_serial_line") {
        return;
    }
    fly_both(&mut common::start(Transport::Uart), SHORT);
}

/// The flight above leads through everything that it claims to.
#[test]
fn the_flight_has_every_disturbance() {
    let mut flight = Flight::new(0);
    flight.by_ref().take(LONG / 2).for_each(drop);
    assert!(flight.begun[1..].iter().all(|begun| *begun >= 3), "{:?}", flight.begun);
}
