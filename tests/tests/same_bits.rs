//! The same input gives the same bits on this machine and on the emulated Cortex-M4F.
use std::time::Instant;

use host_sim::emulator::{Emulator, HostModule, Target, Transport};
use schuler_core::module::{ModuleConfig, Status, StepOutput};

use common::flight::Flight;

mod common;

/// Steps over semihosting: more than a day.
const LONG: usize = 100_000;
/// Steps over the emulated serial port.
const SHORT: usize = 3000;

/// The configurations that are flown one after the other.
fn configurations() -> [ModuleConfig; 2] {
    let mut other = ModuleConfig::default();
    other.filter.accelerometer.tau_s = 200.0;
    other.filter.gyro.tau_s = 600.0;
    other.filter.velocity_noise = 0.05;
    other.max_age_ms = 500;
    [ModuleConfig::default(), other]
}

fn bits(output: &StepOutput) -> Vec<u8> {
    let mut buffer = [0; 2048];
    postcard::to_slice(output, &mut buffer).unwrap().to_vec()
}

/// Everything that the outputs reported, and how often the filter was retuned.
struct Reported {
    status: Status,
    retunes: u16,
}

fn fly_both(emulator: &mut Emulator, steps: usize) -> Reported {
    let mut compared = 0;
    let mut reported = Reported { status: Status::empty(), retunes: 0 };
    for (seed, config) in configurations().iter().enumerate() {
        let mut host = HostModule::new();
        host.configure(config).unwrap();
        emulator.configure(config).unwrap();

        let inputs: Vec<_> = Flight::new(seed as u64).take(steps / 2).collect();
        let begin = Instant::now();
        let expected: Vec<_> = inputs.iter().map(|input| host.step(input).unwrap()).collect();
        let host_s = begin.elapsed().as_secs_f64();
        for output in &expected {
            reported.status |= output.status;
            reported.retunes += u16::from(output.status.contains(Status::RETUNED));
        }

        let begin = Instant::now();
        for ((input, expected), output) in
            inputs.iter().zip(&expected).zip(emulator.run(inputs.iter().copied()))
        {
            let output = output.unwrap();
            assert!(
                bits(&output) == bits(expected),
                "step {} differs\ninput  {input:?}\nhost   {expected:?}\ntarget {output:?}",
                expected.step
            );
            compared += 1;
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
