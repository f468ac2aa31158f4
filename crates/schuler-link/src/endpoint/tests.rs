//! The conversation with lost, repeated, reordered and damaged frames, sessions, states and the clock.
extern crate std;
use core::cell::Cell;
use std::vec::Vec;

use proptest::prelude::*;
use schuler_core::compensation::{Block, Factor, Target, Term};
use schuler_core::module::{ModuleConfig, StateError};

use super::*;
use crate::block;
use crate::frame::FrameError;
use crate::frame::Wire;
use crate::message::{HostMessage, RefusedFrames};

const IDENTITY: Identity =
    Identity { board: Board::Host, transport: Transport::Memory, start: Start::PowerOn, boots: 0 };

/// An endpoint with its module and a clock that is moved by hand.
struct Rig {
    endpoint: Endpoint,
    module: FlightModule,
    now_us: Cell<u64>,
    /// What reading the clock costs: the duration of a step.
    tick_us: u64,
}

impl Rig {
    fn new() -> Self {
        Self {
            endpoint: Endpoint::new(IDENTITY),
            module: FlightModule::new(),
            now_us: Cell::new(0),
            tick_us: 0,
        }
    }

    fn configured() -> Self {
        let mut rig = Self::new();
        let state = state_of(&ModuleConfig::default(), None);
        // Up to number 0, with which the tests go on.
        let mut sequence = 0u32.wrapping_sub(state.len().div_ceil(STATE_PART - 8) as u32 + 1);
        let whole = Some(ModuleMessage::StateTaken { next: state.len() as u32 });
        assert_eq!(load_state(&mut rig, &mut sequence, &state), whole);
        assert!(sequence == 0 || sequence > u32::MAX / 2);
        rig
    }

    fn feed(&mut self, bytes: &[u8]) -> Vec<Frame<ModuleMessage>> {
        let mut decoder = Decoder::new();
        let mut answers = Vec::new();
        for byte in bytes {
            let now_us = || self.now_us.replace(self.now_us.get() + self.tick_us);
            match self.endpoint.receive(*byte, &mut self.module, now_us) {
                Reaction::Send(wire) => {
                    answers.extend(wire.iter().filter_map(|byte| decoder.push(*byte)).map(Result::unwrap));
                }
                Reaction::None => (),
                Reaction::Reset => *self = Self::new(),
            }
        }
        answers
    }

    fn say(&mut self, sequence: u32, message: &HostMessage) -> Option<ModuleMessage> {
        let mut answers = self.feed(wire(sequence, message).as_bytes());
        assert!(answers.len() <= 1);
        answers.pop().map(|frame| frame.message)
    }

    fn tick_at(&mut self, now_us: u64) -> Option<Tick> {
        self.now_us.set(now_us);
        let now_us = || self.now_us.replace(self.now_us.get() + self.tick_us);
        let wire = self.endpoint.tick(&mut self.module, now_us)?;
        let mut decoder = Decoder::new();
        match wire.iter().find_map(|byte| decoder.push::<ModuleMessage>(*byte)).unwrap().unwrap().message {
            ModuleMessage::Tick(tick) => Some(tick),
            other => panic!("{other:?}"),
        }
    }
}

fn wire(sequence: u32, message: &HostMessage) -> Wire {
    let mut wire = Wire::new();
    wire.encode(sequence, message).unwrap();
    wire
}

fn step(time_ms: u64) -> HostMessage {
    HostMessage::Step(StepInput::without_readings(time_ms))
}

fn steps(answer: Option<ModuleMessage>) -> u64 {
    match answer {
        Some(ModuleMessage::Output(output)) => output.step,
        other => panic!("{other:?}"),
    }
}

fn read_state(rig: &mut Rig) -> Vec<u8> {
    let mut state = Vec::new();
    loop {
        let begin = state.len() as u32;
        match rig.say(0, &HostMessage::ReadState { begin }) {
            Some(ModuleMessage::State { begin: answered, length, bytes, .. }) => {
                assert_eq!(answered, begin);
                state.extend_from_slice(&bytes);
                if bytes.is_empty() {
                    assert_eq!(state.len(), length as usize);
                    return state;
                }
            }
            other => panic!("{other:?}"),
        }
    }
}

/// What a computer on the ground makes: a module that has been configured, and corrected by a block.
fn state_of(config: &ModuleConfig, block: Option<(&Block, u32)>) -> Vec<u8> {
    let mut ground = std::boxed::Box::new(FlightModule::new());
    ground.configure(config).unwrap();
    if let Some((block, name)) = block {
        ground.load_compensation(block).unwrap();
        ground.name_compensation(name);
    }
    let mut state = std::vec![0; ground.state_length().unwrap() as usize];
    ground.save(&mut state).unwrap();
    state
}

fn part(state: &[u8], begin: usize) -> HostMessage {
    let bytes = state[begin..].iter().copied().take(STATE_PART).collect();
    HostMessage::LoadState { begin: begin as u32, bytes }
}

fn load_state(rig: &mut Rig, sequence: &mut u32, state: &[u8]) -> Option<ModuleMessage> {
    let mut begin = 0;
    loop {
        *sequence = sequence.wrapping_add(1);
        match rig.say(*sequence, &part(state, begin as usize)) {
            Some(ModuleMessage::StateTaken { next }) if (next as usize) < state.len() => begin = next,
            answer => return answer,
        }
    }
}

/// Reading is a question and changes nothing; what was read is brought back in a module that has just started, with the
/// block in force and the time.
#[test]
fn a_state_is_read_and_loaded() {
    let (mut rig, mut sequence) = (Rig::new(), 0);
    load_state(&mut rig, &mut sequence, &state_of(&ModuleConfig::default(), Some((&Block::default(), 77))));
    for k in 1..50 {
        rig.say(sequence + k, &step(u64::from(k) * 1000));
    }
    let state = read_state(&mut rig);
    assert_eq!(steps(rig.say(sequence + 49, &step(49_000))), 49, "the last command is still the last one");

    let mut other = Rig::new();
    let mut others = 0;
    let whole = Some(ModuleMessage::StateTaken { next: state.len() as u32 });
    assert_eq!(load_state(&mut other, &mut others, &state), whole);
    let counters = other.endpoint.counters();
    assert_eq!((counters.states, counters.compensation), (1, Some(77)));
    assert_eq!(other.endpoint.conversation.time_ms, 49_000);
    assert_eq!(other.say(others + 1, &step(60_000)), rig.say(sequence + 50, &step(60_000)));
}

#[test]
fn no_step_is_made_while_a_state_is_not_whole() {
    let mut rig = Rig::configured();
    let refused = |error| Some(ModuleMessage::Refused(Refusal::State(error)));
    let not_configured = Some(ModuleMessage::Refused(Refusal::NotConfigured));
    assert_eq!(Rig::new().say(1, &HostMessage::ReadState { begin: 0 }), refused(StateError::NotConfigured));
    let state = read_state(&mut rig);
    assert_eq!(rig.say(1, &part(&state, 8)), refused(StateError::Place { next: 0 }));
    assert_eq!(steps(rig.say(2, &step(1000))), 1, "and it flies on");
    rig.say(3, &HostMessage::SetPace(Pace::Clock { period_ms: 1000 }));
    assert!(matches!(rig.say(4, &part(&state, 0)), Some(ModuleMessage::StateTaken { .. })));
    assert_eq!(rig.endpoint.pace(), Pace::Host, "the clock waits");
    assert_eq!(rig.say(5, &step(2000)), not_configured);
    assert_eq!(rig.say(6, &HostMessage::ReadState { begin: 0 }), refused(StateError::NotConfigured));
    // From the start again.
    let mut sequence = 6;
    load_state(&mut rig, &mut sequence, &state);
    assert_eq!(steps(rig.say(sequence + 1, &step(2000))), 1);
}

/// A flying module keeps its configuration until it is told to forget it.
#[test]
fn a_state_of_another_configuration_does_not_wipe_the_flight() {
    let mut rig = Rig::configured();
    assert_eq!(steps(rig.say(1, &step(1000))), 1);
    let other = ModuleConfig { max_age_ms: 700, ..ModuleConfig::default() };
    let state = state_of(&other, None);
    let refusal = ModuleMessage::Refused(Refusal::State(StateError::Configuration));
    assert_eq!(rig.say(2, &part(&state, 0)), Some(refusal));
    assert_eq!(steps(rig.say(3, &step(2000))), 2, "flies on");
    assert_eq!(rig.say(4, &HostMessage::Forget), Some(ModuleMessage::Forgotten));
    assert_eq!(rig.say(5, &step(3000)), Some(ModuleMessage::Refused(Refusal::NotConfigured)));
    let mut sequence = 5;
    load_state(&mut rig, &mut sequence, &state);
    assert_eq!(steps(rig.say(sequence + 1, &step(3000))), 1);
}

#[test]
fn a_repeated_step_gets_the_stored_answer() {
    let mut rig = Rig::configured();
    let first = rig.say(1, &step(1000));
    assert_eq!(steps(first.clone()), 1);
    for _ in 0..3 {
        assert_eq!(rig.say(1, &step(1000)), first, "not run again");
    }
    // Questions in between do not disturb the stored answer.
    rig.say(77, &HostMessage::Hello);
    rig.say(78, &HostMessage::Counters);
    assert_eq!(rig.say(1, &step(1000)), first);
    assert_eq!(steps(rig.say(2, &step(2000))), 2);
    let counters = rig.endpoint.counters();
    assert_eq!((counters.steps, counters.repeated), (2, 4));
}

fn frame_in(session: u64, sequence: u32, message: &HostMessage) -> Vec<u8> {
    let mut wire = Wire::new();
    wire.seal_with(session);
    wire.encode(sequence, message).unwrap();
    wire.as_bytes().to_vec()
}

/// A board that has started so many times, and when its host said hello.
fn board(boots: u32, now_us: u64, offered: u64) -> (Rig, u64) {
    let mut rig = Rig::new();
    rig.endpoint.identify(Identity { boots, ..IDENTITY });
    rig.now_us.set(now_us);
    let answers = rig.feed(&frame_in(offered, 0, &HostMessage::Hello));
    assert!(matches!(answers[0].message, ModuleMessage::Banner(_)));
    (rig, answers[0].session)
}

#[test]
fn a_command_of_another_session_is_refused() {
    let refused = ModuleMessage::Refused(Refusal::Session);
    // Before there is a session, whatever the frame bears.
    let mut rig = Rig::new();
    rig.endpoint.identify(Identity { boots: 1, ..IDENTITY });
    for session in [0, 1 << 32, u64::MAX] {
        assert_eq!(rig.feed(&frame_in(session, 500, &HostMessage::Forget))[0].message, refused);
    }
    let (mut before, old) = board(1, 77, 5);
    assert_eq!(old, (1 << 32 | 0x4d) ^ 5);
    assert_eq!(before.feed(&frame_in(old, 900, &HostMessage::Forget))[0].message, ModuleMessage::Forgotten);
    // After a reset at the same time with the same offer; after a loss of power with another offer.
    for (boots, offered) in [(2, 5), (1, 6)] {
        let (mut rig, new) = board(boots, 77, offered);
        assert_ne!(new, old);
        for sequence in [0, 1, 500, 901, u32::MAX] {
            let answers = rig.feed(&frame_in(old, sequence, &HostMessage::Forget));
            assert_eq!((answers[0].session, &answers[0].message), (new, &refused));
        }
        // A second question begins no second session.
        assert_eq!(rig.feed(&frame_in(9, 0, &HostMessage::Hello))[0].session, new);
        let answers = rig.feed(&frame_in(new, 1, &HostMessage::Forget));
        assert_eq!(answers[0].message, ModuleMessage::Forgotten);
        assert_eq!(rig.endpoint.counters().stale, 5);
    }
}

#[test]
fn a_late_copy_is_refused_and_a_gap_is_not() {
    let mut rig = Rig::configured();
    assert_eq!(steps(rig.say(1, &step(1000))), 1);
    assert_eq!(steps(rig.say(5, &step(5000))), 2, "frames 2 to 4 were lost");
    assert_eq!(rig.say(4, &step(4000)), Some(ModuleMessage::Refused(Refusal::Stale { last_sequence: 5 })));
    let late = rig.say(0, &HostMessage::Forget);
    assert_eq!(
        late,
        Some(ModuleMessage::Refused(Refusal::Stale { last_sequence: 5 })),
        "does not wipe the flight"
    );
    assert_eq!(rig.say(5, &step(5001)), Some(ModuleMessage::Refused(Refusal::Conflict)));
    assert_eq!(steps(rig.say(6, &step(6000))), 3);
    let counters = rig.endpoint.counters();
    assert_eq!((counters.steps, counters.stale, counters.conflicts), (3, 2, 1));
}

#[test]
fn numbers_wrap() {
    let mut rig = Rig::configured();
    rig.say(0x7fff_0000, &step(1));
    rig.say(0xf000_0000, &step(2));
    rig.say(u32::MAX, &step(3));
    assert_eq!(steps(rig.say(0, &step(4))), 4);
}

#[test]
fn without_a_state_nothing_is_flown() {
    let mut rig = Rig::new();
    let not_configured = Some(ModuleMessage::Refused(Refusal::NotConfigured));
    assert_eq!(rig.say(1, &step(1000)), not_configured);
    assert_eq!(rig.say(2, &HostMessage::SetPace(Pace::Host)), not_configured);
}

/// What the ground has put into the state corrects the inputs, and the module says what it is called.
#[test]
fn a_compensation_block_comes_with_the_state() {
    let term =
        Term { target: Target::Velocity, coefficient: 0.25, factors: [Factor::default(), Factor::default()] };
    let block = Block { terms: [term].into_iter().collect(), ..Block::default() };
    let bytes = block::encode(&block);
    let (_, name) = block::decode(&bytes).unwrap();
    let (mut rig, mut sequence) = (Rig::configured(), 0);
    load_state(&mut rig, &mut sequence, &state_of(&ModuleConfig::default(), Some((&block, name))));
    assert_eq!(rig.endpoint.counters().compensation, Some(name));
    let input = StepInput {
        velocity_error: schuler_core::reading::Reading::good(0.25),
        ..StepInput::without_readings(1000)
    };
    match rig.say(sequence + 1, &HostMessage::Step(input)) {
        Some(ModuleMessage::Output(output)) => {
            assert_eq!((output.compensation.velocity, output.filter.innovation), (0.25, 0.0));
        }
        other => panic!("{other:?}"),
    }
    rig.say(sequence + 2, &HostMessage::Forget);
    assert_eq!(rig.endpoint.counters().compensation, None);
}

#[test]
fn a_host_that_comes_back_learns_where_to_go_on() {
    let mut rig = Rig::configured();
    rig.say(41, &step(1000));
    let Some(ModuleMessage::Banner(banner)) = rig.say(0, &HostMessage::Hello) else { panic!() };
    assert_eq!((banner.last_sequence, banner.configured), (Some(41), true));
    rig.say(42, &HostMessage::Reset);
    let Some(ModuleMessage::Banner(banner)) = rig.say(0, &HostMessage::Hello) else { panic!() };
    assert_eq!((banner.last_sequence, banner.configured), (None, false));
}

/// A frame of another version is answered with the banner, which bears the version of this side.
#[test]
fn another_version_learns_whom_it_speaks_to() {
    let mut rig = Rig::new();
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut body = [0; 15];
    body[..2].copy_from_slice(&[b'>', crate::PROTOCOL + 1]);
    let mut line = [0; 32];
    cobs::encode(&[&body[..], &crc.checksum(&body).to_le_bytes()].concat(), &mut line);
    let answers = rig.feed(&line);
    assert!(
        matches!(&answers[0].message, ModuleMessage::Banner(banner) if banner.protocol == crate::PROTOCOL)
    );
    assert_eq!(rig.endpoint.counters().refused, RefusedFrames { version: 1, ..RefusedFrames::NONE });
    let mut decoder = Decoder::new();
    let refused: Vec<_> = line.iter().filter_map(|byte| decoder.push::<HostMessage>(*byte)).collect();
    assert_eq!(refused, [Err(FrameError::Version(crate::PROTOCOL + 1))]);
}

#[test]
fn the_clock_runs_a_step_a_period() {
    let mut rig = Rig::configured();
    rig.tick_us = 300;
    rig.say(1, &step(5000));
    rig.now_us.set(0);
    assert_eq!(
        rig.say(2, &HostMessage::SetPace(Pace::Clock { period_ms: 0 })),
        Some(ModuleMessage::Refused(Refusal::Pace))
    );
    rig.now_us.set(0);
    let pace = Pace::Clock { period_ms: 1000 };
    assert_eq!(rig.say(3, &HostMessage::SetPace(pace)), Some(ModuleMessage::PaceSet(pace)));
    assert_eq!(rig.endpoint.pace(), pace);
    assert_eq!(rig.tick_at(999_999), None);

    // Nothing has come: a step with missing readings, one period after the last step.
    let tick = rig.tick_at(1_000_000).unwrap();
    assert_eq!((tick.fresh, tick.skipped, tick.overrun), (false, 0, false));
    assert_eq!((tick.due_us, tick.late_us, tick.step_us), (1_000_000, 0, 300));
    assert_eq!((tick.output.step, tick.output.time_ms), (2, 6000));
    assert_eq!(rig.tick_at(1_000_001), None, "once a period");

    // Two inputs: the newest counts. An input is not answered by itself.
    assert_eq!(rig.say(4, &step(6999)), None);
    assert_eq!(rig.say(5, &step(7003)), None);
    assert_eq!(rig.say(5, &step(7003)), None, "a repetition is the same input");
    let tick = rig.tick_at(2_000_400).unwrap();
    assert_eq!((tick.fresh, tick.late_us, tick.output.time_ms), (true, 400, 7003));

    // A step that takes too long, and the ticks that it eats.
    rig.tick_us = 1_200_000;
    assert!(rig.tick_at(3_000_000).unwrap().overrun);
    rig.tick_us = 300;
    let tick = rig.tick_at(6_500_000).unwrap();
    assert_eq!((tick.skipped, tick.due_us, tick.late_us, tick.overrun), (2, 6_000_000, 500_000, false));
    assert_eq!(tick.output.time_ms, 8003 + 3000, "the time of the skipped steps has passed");
    assert_eq!(rig.tick_at(6_999_999), None);
    assert!(rig.tick_at(7_000_000).is_some());

    let counters = rig.endpoint.counters();
    assert_eq!((counters.missing_inputs, counters.superseded_inputs), (4, 1));
    assert_eq!((counters.overruns, counters.skipped_ticks, counters.longest_step_us), (1, 2, 1_200_000));

    assert_eq!(rig.say(6, &HostMessage::SetPace(Pace::Host)), Some(ModuleMessage::PaceSet(Pace::Host)));
    assert_eq!(rig.tick_at(90_000_000), None);
    assert!(matches!(rig.say(7, &step(10_000)), Some(ModuleMessage::Output(_))));
}

/// The next tick would be due beyond the end of the clock.
#[test]
fn the_clock_may_end() {
    let mut rig = Rig::configured();
    rig.tick_us = 0;
    rig.now_us.set(u64::MAX - 1_000_000);
    let pace = Pace::Clock { period_ms: 1000 };
    assert_eq!(rig.say(1, &HostMessage::SetPace(pace)), Some(ModuleMessage::PaceSet(pace)));
    assert!(rig.tick_at(u64::MAX).is_some());
}

#[test]
fn semihosting_has_no_clock_pace() {
    let mut rig = Rig::configured();
    rig.endpoint.identify(Identity { transport: Transport::Semihosting, ..IDENTITY });
    assert_eq!(
        rig.say(1, &HostMessage::SetPace(Pace::Clock { period_ms: 1000 })),
        Some(ModuleMessage::Refused(Refusal::Pace))
    );
}

#[derive(Clone, Copy, Debug)]
enum Fate {
    Arrives,
    IsLost,
    IsDamaged(u16),
    ComesTwice,
    AnswerIsLost,
    ComesAgainLater,
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        4 => Just(Fate::Arrives),
        1 => Just(Fate::IsLost),
        1 => any::<u16>().prop_map(Fate::IsDamaged),
        1 => Just(Fate::ComesTwice),
        1 => Just(Fate::AnswerIsLost),
        1 => Just(Fate::ComesAgainLater),
    ]
}

proptest! {
    /// A host that repeats a frame until it hears the answer: each step is run exactly once, in order, whatever the
    /// line does to the attempts.
    #[test]
    fn every_step_is_run_exactly_once(fates in prop::collection::vec(fate(), 1..200)) {
        let mut rig = Rig::configured();
        let mut fates = fates.into_iter();
        let mut delayed: Vec<Vec<u8>> = Vec::new();
        let mut sequence = 0;
        'steps: loop {
            sequence += 1;
            let frame = wire(sequence, &step(u64::from(sequence) * 1000));
            loop {
                let Some(fate) = fates.next() else { break 'steps };
                let bytes = frame.as_bytes();
                let mut line = Vec::new();
                match fate {
                    Fate::Arrives | Fate::AnswerIsLost => line.extend(bytes),
                    Fate::IsLost => (),
                    Fate::IsDamaged(at) => {
                        line.extend(bytes);
                        let at = usize::from(at) % line.len();
                        line[at] ^= 0x41;
                    }
                    Fate::ComesTwice => line.extend([bytes, bytes].concat()),
                    Fate::ComesAgainLater => {
                        line.extend(bytes);
                        delayed.push(bytes.to_vec());
                    }
                }
                if !matches!(fate, Fate::ComesAgainLater) && let Some(old) = delayed.pop() {
                    line.extend(old);
                }
                let answers = rig.feed(&line);
                let mine = answers.into_iter().filter(|answer| answer.sequence == sequence);
                let outputs: Vec<_> = mine.map(|answer| steps(Some(answer.message))).collect();
                prop_assert!(outputs.iter().all(|step| *step == u64::from(sequence)));
                if !outputs.is_empty() && !matches!(fate, Fate::AnswerIsLost) {
                    break;
                }
            }
        }
        prop_assert!(rig.endpoint.counters().steps <= sequence);
    }

    /// Arbitrary bytes, damaged or valid, never stop the endpoint.
    #[test]
    fn it_answers_after_anything(garbage in prop::collection::vec(any::<u8>(), 0..4000)) {
        let mut rig = Rig::new();
        rig.feed(&garbage);
        prop_assert!(matches!(rig.say(1, &HostMessage::Hello), Some(ModuleMessage::Banner(_))));
    }
}
