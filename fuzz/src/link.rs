//! Bytes from a line.
use std::cell::Cell;

use arbitrary::{Result, Unstructured};
use schuler_core::module::{FlightModule, StateLoader};
use schuler_link::PROTOCOL;
use schuler_link::endpoint::{Endpoint, Reaction};
use schuler_link::frame::{Decoder, Frame, FrameError, Message, Wire};
use schuler_link::message::{
    Board, HostMessage, Identity, ModuleMessage, Pace, STATE_PART, Start, StateBytes, Transport,
};
use serde::de::DeserializeOwned;

use crate::flight::{check_output, on_a_module, started};
use crate::source;
use crate::state::{SHORT, save};

/// The checksum of a frame, by its definition: the frames here are not made by what is tested.
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Bytes of a line, into the decoders of both sides.
pub fn decoder(data: &[u8]) {
    listen::<HostMessage>(data);
    listen::<ModuleMessage>(data);
}

fn listen<M: Message + DeserializeOwned>(data: &[u8]) {
    let mut decoder = Decoder::new();
    let (mut whole, mut refused) = (0, 0);
    for &byte in data {
        match decoder.push::<M>(byte) {
            Some(Ok(frame)) => {
                whole += 1;
                goes_out_again(&frame);
            }
            Some(Err(_)) => refused += 1,
            None => {}
        }
    }
    assert!(whole + refused <= data.len());
}

/// A frame that came in can be sent, and what is sent comes in as the same bytes (NaN is not equal to itself).
fn goes_out_again<M: Message + DeserializeOwned>(frame: &Frame<M>) {
    let mut wire = Wire::new();
    wire.seal_with(frame.session);
    // A number may have come in a longer form than it goes out: what was read is never too long to send.
    assert_eq!(wire.encode(frame.sequence, &frame.message), Ok(()));
    let mut decoder = Decoder::new();
    let back = wire.as_bytes().iter().find_map(|&byte| match decoder.push::<M>(byte) {
        Some(Ok(frame)) => Some(frame),
        _ => None,
    });
    let back = back.expect("a frame that was sent arrives");
    let mut again = Wire::new();
    again.seal_with(back.session);
    assert_eq!(again.encode(back.sequence, &back.message), Ok(()));
    assert_eq!(wire.as_bytes(), again.as_bytes());
}

/// The content of a frame whose border, checksum, direction and version are right.
pub fn message(data: &[u8]) {
    sealed::<HostMessage>(data);
    sealed::<ModuleMessage>(data);
}

fn sealed<M: Message + DeserializeOwned>(content: &[u8]) {
    let mut decoder = Decoder::new();
    let bytes = framed::<M>(7, content);
    let answers: Vec<_> = bytes.iter().filter_map(|&byte| decoder.push::<M>(byte)).collect();
    match answers.as_slice() {
        [Err(FrameError::Content | FrameError::TooLong), ..] => {}
        [Ok(frame)] => goes_out_again(frame),
        _ => panic!("a sound frame is neither a message nor refused for its content"),
    }
}

fn framed<M: Message>(sequence: u32, content: &[u8]) -> Vec<u8> {
    let mut frame = vec![M::DIRECTION, PROTOCOL];
    frame.extend(0u64.to_le_bytes());
    frame.extend(sequence.to_le_bytes());
    frame.extend(content);
    frame.extend(CRC.checksum(&frame).to_le_bytes());
    let mut bytes = cobs::encode_vec(&frame);
    bytes.insert(0, 0);
    bytes.push(0);
    bytes
}

/// Most messages of a conversation: a bound on its time.
const MESSAGES: u32 = 16;

/// What is said next, where it is not drawn.
const NEXT_PART: u8 = u8::MAX;

/// What a conversation begins with.
struct Scene {
    module: Box<FlightModule>,
    /// What a host would have said to bring it to its state.
    loading: Vec<HostMessage>,
}

/// A module that waits, and those in flight without identification, the others' states being six times as long.
fn scenes() -> Vec<Scene> {
    let waits = Scene { module: Box::new(FlightModule::new()), loading: Vec::new() };
    let in_flight = started().into_iter().take(SHORT).map(|mut module| {
        let loading = loading(&save(&mut module));
        Scene { module, loading }
    });
    [waits].into_iter().chain(in_flight).collect()
}

/// What a host says to bring a module to a state.
fn loading(state: &[u8]) -> Vec<HostMessage> {
    let mut messages = vec![HostMessage::Forget];
    // A part that cuts a value would have to be followed by one that begins before its end: the loader says where.
    let (mut loader, mut module) = (StateLoader::new(), Box::new(FlightModule::new()));
    let mut begin = 0;
    while begin < state.len() {
        let part = &state[begin..state.len().min(begin + STATE_PART)];
        messages.push(HostMessage::LoadState { begin: begin as u32, bytes: part.iter().copied().collect() });
        begin = loader.take(&mut module, begin as u32, part).expect("the state is sound") as usize;
    }
    messages
}

thread_local! {
    static SCENES: Vec<Scene> = scenes();
}

/// What comes to the module's side: commands, repetitions, noise, and a clock that does what it likes.
pub fn conversation(data: &[u8]) {
    SCENES.with(|scenes| {
        // Bytes that end too early end the conversation.
        let _ = on_a_module(|module| converse(&mut Unstructured::new(data), scenes, module));
    });
}

fn converse(source: &mut Unstructured<'_>, scenes: &[Scene], module: &mut FlightModule) -> Result<()> {
    let identity =
        Identity { board: Board::Host, transport: Transport::Memory, start: Start::PowerOn, boots: 0 };
    let mut endpoint = Endpoint::new(identity);
    module.clone_from(&source.choose(scenes)?.module);
    let now_us = Cell::new(0u64);
    let (mut sequence, mut time_ms) = (0u32, 0u64);
    let mut last = Vec::new();
    // A state on its way, and whether its parts follow each other with nothing between.
    let (mut to_come, mut at_once) = ([].iter(), false);
    // A configuration that promises finite outputs is in force.
    let mut sane = true;
    let mut said = 0;
    // Past their end, the bytes are zeros.
    while said < MESSAGES && !source.is_empty() {
        at_once &= to_come.len() > 0;
        said += u32::from(!at_once);
        let what = if at_once { NEXT_PART } else { source.int_in_range(0..=NEXT_PART - 1)? };
        let message = match what {
            0..8 => None,
            8..24 => {
                now_us.set(
                    now_us.get().wrapping_add(source.arbitrary::<u64>()? >> (source.arbitrary::<u8>()? % 64)),
                );
                None
            }
            24..32 => Some(HostMessage::Hello),
            32..40 => Some(HostMessage::Counters),
            40..48 => Some(HostMessage::SetPace(if source.arbitrary()? {
                Pace::Clock { period_ms: source.arbitrary::<u32>()? >> (source.arbitrary::<u8>()? % 32) }
            } else {
                Pace::Host
            })),
            48..52 => Some(HostMessage::Reset),
            52..56 => Some(HostMessage::ReadState { begin: source.arbitrary::<u32>()? % 60_000 }),
            56..60 => {
                let begin = source.arbitrary::<u32>()? % 2000;
                let bytes: StateBytes = source.bytes(source.len().min(64))?.iter().copied().collect();
                Some(HostMessage::LoadState { begin, bytes })
            }
            60..64 => {
                to_come = source.choose(scenes)?.loading.iter();
                at_once = source.arbitrary()?;
                to_come.next().cloned()
            }
            64..180 | NEXT_PART if to_come.len() > 0 => to_come.next().cloned(),
            _ => {
                time_ms = source::next_time(source, time_ms)?;
                Some(HostMessage::Step(source::step_input(source, time_ms)?))
            }
        };
        let bytes = match &message {
            Some(message) => {
                sequence = match if at_once { NEXT_PART } else { source.arbitrary()? } {
                    0..8 => source.arbitrary()?,
                    8..16 => sequence,
                    _ => sequence.wrapping_add(1),
                };
                let mut wire = Wire::new();
                assert_eq!(wire.encode(sequence, message), Ok(()));
                wire.as_bytes().to_vec()
            }
            None if source.arbitrary()? => last.clone(),
            None => {
                sane = false;
                framed::<HostMessage>(sequence.wrapping_add(1), source.bytes(source.len().min(100))?)
            }
        };
        for &byte in &bytes {
            if let Reaction::Send(answer) = endpoint.receive(byte, module, || now_us.get()) {
                check_answer(answer, sane);
            }
        }
        if let Some(answer) = endpoint.tick(module, || now_us.get()) {
            check_answer(answer, sane);
        }
        last = bytes;
    }
    Ok(())
}

/// One whole frame for the host; finite outputs.
fn check_answer(answer: &[u8], sane: bool) {
    let mut decoder = Decoder::new();
    let mut frames = answer.iter().filter_map(|&byte| decoder.push::<ModuleMessage>(byte));
    let frame = frames.next().expect("a frame").expect("a sound frame");
    match frame.message {
        ModuleMessage::Output(output) if sane => check_output(&output),
        ModuleMessage::Tick(tick) if sane => check_output(&tick.output),
        _ => {}
    }
}
