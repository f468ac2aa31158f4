//! The image on the emulated boards, over the emulated serial line.
use std::time::{Duration, Instant};

use host_sim::emulator::{Emulator, HostModule, Image, Target, TargetError, Transport};
use schuler_core::module::ModuleConfig;
use schuler_link::block::{BlockError, encode};
use schuler_link::frame::{Frame, Wire};
use schuler_link::message::{
    Board, HostMessage, ModuleMessage, Pace, Refusal, RefusedFrames, Start, Tick, Transport as Line,
};
use schuler_link::{PROTOCOL, SOURCE_HASH, VERSION};

use crate::common::flight::{Flight, everything, full_block};

use crate::common;

const PATIENCE: Duration = Duration::from_secs(30);

/// The two images with a serial line answer as the module in this process does.
fn answers_as_the_host_does(mut emulator: Emulator, board: Board) {
    let banner = emulator.banner();
    assert_eq!((banner.protocol, banner.version.as_str()), (PROTOCOL, VERSION));
    assert_eq!((banner.source_hash, banner.board, banner.transport), (SOURCE_HASH, board, Line::Uart));
    assert_eq!((banner.start, banner.configured), (Start::PowerOn, false));

    let mut flight = Flight::new(7);
    let first = flight.next().unwrap();
    match emulator.step(&first) {
        Err(TargetError::Refused(refusal)) => assert_eq!(*refusal, Refusal::NotConfigured),
        other => panic!("a step before any configuration: {other:?}"),
    }

    let config = everything();
    let mut host = HostModule::new();
    host.configure(&config).unwrap();
    emulator.configure(&config).unwrap();
    for input in flight.by_ref().take(50) {
        assert_eq!(emulator.step(&input).unwrap(), host.step(&input).unwrap());
    }
    // A block is refused or taken, and says so; what was in force stays or goes.
    let block = encode(&full_block());
    let mut damaged = block.clone();
    damaged[100] ^= 1;
    match emulator.load_compensation(&damaged) {
        Err(TargetError::Block(error)) => assert_eq!(error, BlockError::Checksum),
        other => panic!("{other:?}"),
    }
    let mut nan = full_block();
    nan.terms[7].coefficient = f32::NAN;
    match emulator.load_compensation(&encode(&nan)) {
        Err(TargetError::Configuration { field, .. }) => assert_eq!(field, "compensation.terms.coefficient"),
        other => panic!("{other:?}"),
    }
    assert_eq!(emulator.counters().unwrap().compensation, None);
    emulator.load_compensation(&block).unwrap();
    host.load_compensation(&block).unwrap();
    let checksum = u32::from_le_bytes(*block.last_chunk().unwrap());
    assert_eq!(emulator.counters().unwrap().compensation, Some(checksum));
    for input in flight.take(50) {
        assert_eq!(emulator.step(&input).unwrap(), host.step(&input).unwrap());
    }

    let mut wrong = config;
    wrong.filter.step_s = -1.0;
    match emulator.configure(&wrong) {
        Err(TargetError::Configuration { field, .. }) => assert_eq!(field, "filter.step_s"),
        other => panic!("{other:?}"),
    }
    let counters = emulator.counters().unwrap();
    assert_eq!((counters.steps, counters.states, counters.lost_bytes), (100, 2, 0));
    assert_eq!(counters.refused, RefusedFrames::NONE);
}

#[test]
fn the_emulated_board_answers() {
    if common::skipped("the_emulated_board_answers") {
        return;
    }
    answers_as_the_host_does(common::start(Transport::Uart), Board::Mps2An386);
}

/// The very image that is flashed, as far as an emulator has its board.
#[test]
fn the_flashed_image_answers() {
    if common::skipped("the_flashed_image_answers") {
        return;
    }
    answers_as_the_host_does(common::start_image(Image::Flashed), Board::Stm32f405);
}

fn wire(session: u64, sequence: u32, message: &HostMessage) -> Vec<u8> {
    let mut wire = Wire::new();
    wire.seal_with(session);
    wire.encode(sequence, message).unwrap();
    wire.as_bytes().to_vec()
}

/// The answer to `sequence`.
fn answer(emulator: &mut Emulator, sequence: u32) -> ModuleMessage {
    loop {
        match emulator.receive(PATIENCE).unwrap() {
            Some(frame) if frame.sequence == sequence => return frame.message,
            Some(_) => (),
            None => panic!("no answer to {sequence}"),
        }
    }
}

#[test]
fn a_damaged_frame_is_refused_and_the_link_goes_on() {
    if common::skipped("a_damaged_frame_is_refused_and_the_link_goes_on") {
        return;
    }
    let mut emulator = common::start(Transport::Uart);
    emulator.configure(&ModuleConfig::default()).unwrap();
    let inputs: Vec<_> = Flight::new(1).take(8).collect();
    let session = emulator.session();
    let step = |k: u32| wire(session, k, &HostMessage::Step(inputs[k as usize % 8]));

    let mut changed = step(100);
    let middle = changed.len() / 2;
    changed[middle] ^= 0x10;
    let cut = &step(101)[..20];
    let endless = vec![0x55; 5000];
    for (damaged, next) in [(&changed[..], 102), (cut, 103), (&endless, 104)] {
        emulator.send_bytes(damaged).unwrap();
        emulator.send_bytes(&step(next)).unwrap();
        match answer(&mut emulator, next) {
            ModuleMessage::Output(output) => {
                assert_eq!(output.step, u64::from(next - 101), "only whole frames are steps");
            }
            other => panic!("{other:?}"),
        }
    }
    // The same frame again: the same answer, and no step.
    emulator.send_bytes(&step(104)).unwrap();
    assert!(matches!(answer(&mut emulator, 104), ModuleMessage::Output(output) if output.step == 3));
    // An old one: refused.
    emulator.send_bytes(&step(102)).unwrap();
    let stale = ModuleMessage::Refused(Refusal::Stale { last_sequence: 104 });
    assert_eq!(answer(&mut emulator, 102), stale);

    let counters = emulator.counters().unwrap();
    assert_eq!((counters.steps, counters.repeated, counters.stale), (3, 1, 1));
    assert_eq!(counters.refused.too_long, 1);
    assert_eq!(counters.refused.total(), 3, "{:?}", counters.refused);
}

#[test]
fn a_reset_by_command_is_told_from_power() {
    if common::skipped("a_reset_by_command_is_told_from_power") {
        return;
    }
    let mut emulator = common::start(Transport::Uart);
    emulator.configure(&ModuleConfig::default()).unwrap();
    emulator.send_bytes(&wire(emulator.session(), 1000, &HostMessage::Reset)).unwrap();
    match answer(&mut emulator, 0) {
        ModuleMessage::Banner(banner) => {
            assert_eq!((banner.start, banner.configured), (Start::Command, false));
        }
        other => panic!("{other:?}"),
    }
    common::wait_for_log(&emulator, |log| log.iter().any(|line| line.ends_with("started by command")));
}

fn next_tick(emulator: &mut Emulator) -> Tick {
    loop {
        match emulator.receive(PATIENCE).unwrap() {
            Some(Frame { message: ModuleMessage::Tick(tick), .. }) => return tick,
            Some(_) => (),
            None => panic!("the clock has stopped"),
        }
    }
}

/// At the clock's pace the steps come by themselves, in time; a missing input is a step with missing readings.
#[test]
fn the_clock_keeps_its_pace_and_reports_missing_inputs() {
    const PERIOD_MS: u32 = 100;
    const TICKS: u64 = 50;
    if common::skipped("the_clock_keeps_its_pace_and_reports_missing_inputs") {
        return;
    }
    let mut emulator = common::start(Transport::Uart);
    match emulator.set_pace(Pace::Clock { period_ms: PERIOD_MS }) {
        Err(TargetError::Refused(refusal)) => assert_eq!(*refusal, Refusal::NotConfigured),
        other => panic!("{other:?}"),
    }
    emulator.configure(&ModuleConfig::default()).unwrap();
    emulator.set_pace(Pace::Clock { period_ms: PERIOD_MS }).unwrap();

    let begin = Instant::now();
    let first = next_tick(&mut emulator);
    let mut last = first;
    let mut ticks = vec![first];
    let mut inputs = Flight::new(3);
    for k in 0..TICKS {
        // An input for every second tick.
        let sent = k % 2 == 0;
        if sent {
            emulator.post(&inputs.next().unwrap()).unwrap();
        }
        let tick = next_tick(&mut emulator);
        let periods = 1 + u64::from(tick.skipped);
        assert_eq!(
            tick.due_us - last.due_us,
            periods * u64::from(PERIOD_MS) * 1000,
            "no tick is lost in silence"
        );
        assert_eq!(tick.output.step, last.output.step + 1);
        if !tick.fresh {
            assert_eq!(tick.output.time_ms, last.output.time_ms + periods * u64::from(PERIOD_MS));
        }
        ticks.push(tick);
        last = tick;
    }
    let elapsed = begin.elapsed();

    let fresh = ticks.iter().filter(|tick| tick.fresh).count() as u64;
    // A machine that stands still between a tick and our answer to it makes an input late, never lost.
    assert!((TICKS / 4..=TICKS / 2).contains(&fresh), "{fresh} of {} inputs", TICKS / 2);
    let counters = emulator.counters().unwrap();
    assert!(counters.missing_inputs > 0);
    assert!(counters.steps >= ticks.len() as u32);
    // The emulated clock is the machine's own: it is neither ahead of it nor far behind.
    let virtual_us = last.due_us - first.due_us;
    let ratio = elapsed.as_micros() as f64 / virtual_us as f64;
    say!(
        "{} ticks: {:.3} s of the module's clock, {:.3} s here",
        ticks.len(),
        virtual_us as f64 / 1e6,
        elapsed.as_secs_f64()
    );
    assert!((0.9..3.0).contains(&ratio), "time runs {ratio} times as fast here");
    say!(
        "latest start {} us, longest step {} us",
        ticks.iter().map(|t| t.late_us).max().unwrap(),
        counters.longest_step_us
    );

    emulator.set_pace(Pace::Host).unwrap();
    assert!(emulator.step(&inputs.next().unwrap()).is_ok());
}

/// A processor that is too slow for its period says so, and does the steps that it can. An instruction takes a microsecond here:
/// step and answer do not fit into a millisecond, whatever machine emulates it.
#[test]
fn a_step_that_overruns_is_flagged_and_counted() {
    const TICKS: usize = 20;
    if common::skipped("a_step_that_overruns_is_flagged_and_counted") {
        return;
    }
    let slow = ["-icount", "shift=10"];
    let mut emulator = common::launch(Image::Serial, &slow).wait_for_banner().unwrap();
    emulator.configure(&ModuleConfig::default()).unwrap();
    emulator.set_pace(Pace::Clock { period_ms: 1 }).unwrap();
    let ticks: Vec<_> = (0..TICKS).map(|_| next_tick(&mut emulator)).collect();
    emulator.set_pace(Pace::Host).unwrap();

    assert!(ticks.iter().all(|tick| tick.overrun == (tick.late_us + tick.step_us >= 1000)), "{ticks:?}");
    assert!(ticks[1..].iter().all(|tick| tick.skipped > 0), "{ticks:?}");
    for pair in ticks.windows(2) {
        let periods = 1 + u64::from(pair[1].skipped);
        assert_eq!(pair[1].due_us - pair[0].due_us, periods * 1000, "no tick is lost in silence");
    }
    let counters = emulator.counters().unwrap();
    assert!(counters.skipped_ticks as usize >= TICKS, "{counters:?}");
    assert!(counters.overruns as usize >= ticks.iter().filter(|tick| tick.overrun).count(), "{counters:?}");
    common::wait_for_log(&emulator, |log| log.iter().any(|line| line.contains("ticks skipped")));
}
