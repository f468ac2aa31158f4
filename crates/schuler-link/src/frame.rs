//! How a message becomes bytes on a wire, and comes back.
//!
//! ```text
//! 00 │ COBS( direction u8 │ protocol u8 │ session u64 LE │ sequence u32 LE │ postcard message │ CRC-32 LE ) │ 00
//! ```
//! The session ([`crate::endpoint`]) tells a frame from one of before a reset, whose number may be ahead.
//! The CRC (CRC-32/ISO-HDLC, that of Ethernet and zlib) covers everything before it. COBS keeps the zero byte out
//! of a frame, so that a zero is always a border. A frame carries one on either side: noise, or the torso of
//! a cut frame, ends at the leading zero and costs no frame but the damaged one. The direction byte keeps an echo
//! of one's own frames from being taken for an answer.
use cobs::{CobsEncoder, DecodeResult, DecoderState};
use crc::{CRC_32_ISO_HDLC, Crc, Digest};
use heapless::Vec;
use postcard::ser_flavors::Flavor;
use serde::{Deserialize, Serialize};

use crate::PROTOCOL;

/// Longest serialised message, bytes.
pub const MAX_MESSAGE: usize = 1024;

/// Longest frame on the wire, borders included, bytes.
pub const MAX_WIRE: usize = on_the_wire(MAX_MESSAGE);

/// Direction, protocol, session and sequence number.
const HEADER: usize = 14;
const CHECKSUM: usize = 4;
const MAX_FRAME: usize = HEADER + MAX_MESSAGE + CHECKSUM;

/// Longest frame for a message of so many bytes, borders included, bytes.
pub(crate) const fn on_the_wire(message: usize) -> usize {
    let frame = HEADER + message + CHECKSUM;
    frame + frame.div_ceil(254) + 2
}

/// What the checksum is looked up in: a kilobyte on a host, nothing on the target, where flash is short and frames are few.
#[cfg(not(target_os = "none"))]
type Table = crc::Table<1>;
#[cfg(target_os = "none")]
type Table = crc::NoTable;

pub(crate) const CRC: Crc<u32, Table> = Crc::<u32, Table>::new(&CRC_32_ISO_HDLC);

/// A message of one direction of the link.
pub trait Message: Serialize {
    /// Byte that marks the direction.
    const DIRECTION: u8;
}

/// A frame that arrived whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame<M> {
    /// The session in which it was sent; zero where there is none.
    pub session: u64,
    /// Host to module: running number of the frame. Module to host: number of the frame that is answered.
    pub sequence: u32,
    /// CRC-32 of the frame: tells a repetition from another frame of the same number.
    pub checksum: u32,
    /// What it says.
    pub message: M,
}

/// Why bytes between two borders were refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// More bytes than the longest frame; the rest, up to the next border, is skipped.
    TooLong,
    /// Not COBS: cut short, or a border in its midst.
    Encoding,
    /// Shorter than header and checksum.
    TooShort,
    /// The checksum does not fit.
    Checksum,
    /// Not from the other side of this link: an echo, or another device.
    Direction(u8),
    /// Another version of the protocol.
    Version(u8),
    /// A sound frame whose content is not a message of this protocol.
    Content,
}

/// The message is longer than [`MAX_MESSAGE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong;

/// One frame as it goes over the wire, or nothing.
pub type Wire = ShortWire<MAX_WIRE>;

/// The same with room for fewer bytes than the longest frame has.
#[derive(Debug)]
pub struct ShortWire<const BYTES: usize> {
    session: u64,
    bytes: [u8; BYTES],
    length: usize,
}

impl<const BYTES: usize> Default for ShortWire<BYTES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const BYTES: usize> ShortWire<BYTES> {
    /// Nothing.
    pub const fn new() -> Self {
        Self { session: 0, bytes: [0; BYTES], length: 0 }
    }

    /// The session in which the frames from now on are sent; zero for none, as in the beginning.
    pub fn seal_with(&mut self, session: u64) {
        self.session = session;
    }

    /// The frame for a message. Never panics.
    ///
    /// # Errors
    /// The message is too long; the wire then holds nothing.
    pub fn encode<M: Message>(&mut self, sequence: u32, message: &M) -> Result<(), TooLong> {
        self.length = 0;
        let (border, body) = self.bytes.split_first_mut().ok_or(TooLong)?;
        *border = 0;
        let mut flavor = WireFlavor { cobs: CobsEncoder::new(body), digest: CRC.digest() };
        flavor.try_extend(&[M::DIRECTION, PROTOCOL]).map_err(|_| TooLong)?;
        flavor.try_extend(&self.session.to_le_bytes()).map_err(|_| TooLong)?;
        flavor.try_extend(&sequence.to_le_bytes()).map_err(|_| TooLong)?;
        let length = postcard::serialize_with_flavor(message, flavor).map_err(|_| TooLong)?;
        *body.get_mut(length).ok_or(TooLong)? = 0;
        self.length = length + 2;
        Ok(())
    }

    /// Nothing again.
    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// The bytes to be sent.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }
}

/// Feeds what postcard writes to the checksum and to COBS in one pass.
struct WireFlavor<'a> {
    cobs: CobsEncoder<'a>,
    digest: Digest<'static, u32, Table>,
}

impl Flavor for WireFlavor<'_> {
    type Output = usize;

    fn try_extend(&mut self, data: &[u8]) -> postcard::Result<()> {
        self.digest.update(data);
        self.cobs.push(data).map_err(|_| postcard::Error::SerializeBufferFull)
    }

    fn try_push(&mut self, data: u8) -> postcard::Result<()> {
        self.try_extend(&[data])
    }

    fn finalize(mut self) -> postcard::Result<usize> {
        let checksum = self.digest.finalize().to_le_bytes();
        self.cobs.push(&checksum).map_err(|_| postcard::Error::SerializeBufferFull)?;
        Ok(self.cobs.finalize())
    }
}

/// Finds frames in a stream of bytes, one byte at a time, in fixed memory. Never panics.
#[derive(Debug)]
pub struct Decoder {
    cobs: DecoderState,
    frame: Vec<u8, MAX_FRAME>,
    /// The frame has ended, or was refused: the next byte begins another.
    ended: bool,
    /// Within a frame that is too long: nothing counts until the next border.
    skipping: bool,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder that has heard nothing yet.
    pub const fn new() -> Self {
        Self { cobs: DecoderState::Idle, frame: Vec::new(), ended: false, skipping: false }
    }

    /// Takes the next byte. `Some` when it ends a frame, or makes it hopeless. Of a message that borrows, the bytes stay in
    /// the decoder.
    pub fn push<'a, M: Message + Deserialize<'a>>(
        &'a mut self,
        byte: u8,
    ) -> Option<Result<Frame<M>, FrameError>> {
        if self.skipping {
            self.skipping = byte != 0;
            return None;
        }
        if self.ended {
            self.cobs = DecoderState::Idle;
            self.frame.clear();
            self.ended = false;
        }
        let complete = match self.cobs.feed(byte) {
            Ok(DecodeResult::NoData) => return None,
            Ok(DecodeResult::DataContinue(data)) if self.frame.push(data).is_ok() => return None,
            Ok(DecodeResult::DataContinue(_)) => {
                self.skipping = true;
                Err(FrameError::TooLong)
            }
            Ok(DecodeResult::DataComplete) => Ok(()),
            Err(_) => Err(FrameError::Encoding),
        };
        self.ended = true;
        Some(complete.and_then(|()| open(&self.frame)))
    }
}

/// Checks a frame from the outside in and reads its message.
#[inline(never)]
fn open<'a, M: Message + Deserialize<'a>>(frame: &'a [u8]) -> Result<Frame<M>, FrameError> {
    let (body, &checksum) = frame.split_last_chunk::<CHECKSUM>().ok_or(FrameError::TooShort)?;
    let (&[direction, protocol, n0, n1, n2, n3, n4, n5, n6, n7, s0, s1, s2, s3], content) =
        body.split_first_chunk::<HEADER>().ok_or(FrameError::TooShort)?;
    let checksum = u32::from_le_bytes(checksum);
    if CRC.checksum(body) != checksum {
        return Err(FrameError::Checksum);
    }
    if direction != M::DIRECTION {
        return Err(FrameError::Direction(direction));
    }
    if protocol != PROTOCOL {
        return Err(FrameError::Version(protocol));
    }
    match postcard::take_from_bytes(content) {
        Ok((message, [])) => Ok(Frame {
            session: u64::from_le_bytes([n0, n1, n2, n3, n4, n5, n6, n7]),
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            checksum,
            message,
        }),
        _ => Err(FrameError::Content),
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use heapless::Vec as Bytes;
    use proptest::prelude::*;
    use schuler_core::module::{FlightModule, StateError, StepInput};
    use schuler_core::reading::Reading;
    use serde::de::DeserializeOwned;

    use super::*;
    use crate::message::{
        Banner, Board, Counters, HostMessage, Identity, ModuleMessage, Pace, Refusal, RefusedFrames,
        STATE_PART, Start, Tick, Transport,
    };

    fn input(time_ms: u64) -> StepInput {
        StepInput { velocity_error: Reading::good(0.125), ..StepInput::without_readings(time_ms) }
    }

    fn wire(sequence: u32, message: &impl Message) -> Vec<u8> {
        let mut wire = Wire::new();
        wire.encode(sequence, message).unwrap();
        wire.as_bytes().to_vec()
    }

    /// A line with three frames: what is done to the second must not touch the others.
    fn three() -> [Vec<u8>; 3] {
        [1, 2, 3].map(|k| wire(k, &HostMessage::Step(input(u64::from(k) * 1000))))
    }

    /// Feeds the bytes; the frames that arrived, and the number of refusals.
    fn listen<M: Message + DeserializeOwned>(
        decoder: &mut Decoder,
        bytes: &[u8],
    ) -> (Vec<Frame<M>>, RefusedFrames) {
        let (mut frames, mut refused) = (Vec::new(), RefusedFrames::NONE);
        for result in bytes.iter().filter_map(|byte| decoder.push::<M>(*byte)) {
            match result {
                Ok(frame) => frames.push(frame),
                Err(error) => refused.count(error),
            }
        }
        (frames, refused)
    }

    /// The damaged second frame is refused, or its damage did not touch its content; its neighbours arrive.
    fn assert_only_the_second_suffers(line: &[u8], what: &str) {
        let (frames, _) = listen::<HostMessage>(&mut Decoder::new(), line);
        let whole = three().map(|wire| listen::<HostMessage>(&mut Decoder::new(), &wire).0.swap_remove(0));
        let [first, _, third] = &whole;
        assert!(
            frames == whole || (frames.len() == 2 && frames[0] == *first && frames[1] == *third),
            "{what}: {:?}",
            frames.iter().map(|f| f.sequence).collect::<Vec<_>>()
        );
    }

    #[derive(Clone, Debug, PartialEq, serde::Serialize, Deserialize)]
    struct Blob(Bytes<u8, MAX_FRAME>);

    impl Message for Blob {
        const DIRECTION: u8 = b'#';
    }

    /// Every length, so every position of the COBS blocks: with zeros, without, and alternating.
    #[test]
    fn every_length_comes_back() {
        for length in 0..=MAX_MESSAGE - 2 {
            for pattern in [0u8, 0xff, 0x55] {
                let content = (0..length).map(|k| if pattern == 0x55 { (k % 3) as u8 } else { pattern });
                let blob = Blob(content.collect());
                let (frames, errors) = listen::<Blob>(&mut Decoder::new(), &wire(7, &blob));
                assert_eq!((frames[0].sequence, &frames[0].message, errors.total()), (7, &blob, 0));
            }
        }
        let blob = Blob((0..MAX_MESSAGE - 1).map(|_| 1).collect());
        assert_eq!(Wire::new().encode(7, &blob), Err(TooLong), "one byte more does not go out");
    }

    /// The checksum is that of zlib, so that anybody can make a frame.
    #[test]
    fn the_checksum_is_that_of_zlib() {
        assert_eq!(CRC.checksum(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn every_message_comes_back() {
        let step = HostMessage::Step(input(u64::MAX));
        for message in std::vec![
            HostMessage::Hello,
            HostMessage::Counters,
            HostMessage::Forget,
            step,
            HostMessage::SetPace(Pace::Clock { period_ms: 1000 }),
            HostMessage::Reset,
            HostMessage::ReadState { begin: 12_345 },
            HostMessage::LoadState { begin: 512, bytes: (0..STATE_PART).map(|k| k as u8).collect() },
        ] {
            let (frames, _) = listen::<HostMessage>(&mut Decoder::new(), &wire(u32::MAX, &message));
            assert_eq!((frames[0].sequence, &frames[0].message), (u32::MAX, &message));
        }
        let identity =
            Identity { board: Board::Host, transport: Transport::Memory, start: Start::PowerOn, boots: 0 };
        let output = FlightModule::new().step(&input(1));
        for message in [
            ModuleMessage::Banner(Banner::new(identity)),
            ModuleMessage::Counters(Counters::NONE),
            ModuleMessage::Forgotten,
            ModuleMessage::Output(output),
            ModuleMessage::PaceSet(Pace::Host),
            ModuleMessage::Tick(Tick { output, fresh: true, ..Tick::default() }),
            ModuleMessage::Refused(Refusal::NotConfigured),
            ModuleMessage::Refused(Refusal::Stale { last_sequence: 3 }),
            ModuleMessage::Refused(Refusal::State(StateError::Place { next: 7 })),
            ModuleMessage::State {
                begin: 512,
                length: 50_000,
                step: 3,
                bytes: (0..STATE_PART).map(|_| 0).collect(),
            },
            ModuleMessage::StateTaken { next: 1024 },
        ] {
            let (frames, _) = listen::<ModuleMessage>(&mut Decoder::new(), &wire(0, &message));
            assert_eq!(frames[0].message, message);
        }
    }

    #[test]
    fn every_changed_byte_costs_one_frame_at_most() {
        let [first, second, third] = three();
        for position in 0..second.len() {
            for change in 1..=255 {
                let mut damaged = second.clone();
                damaged[position] ^= change;
                let line = [&first[..], &damaged, &third].concat();
                assert_only_the_second_suffers(&line, "changed");
            }
        }
    }

    #[test]
    fn every_inserted_byte_costs_one_frame_at_most() {
        let [first, second, third] = three();
        for position in 0..=second.len() {
            for byte in 0..=255 {
                let mut damaged = second.clone();
                damaged.insert(position, byte);
                let line = [&first[..], &damaged, &third].concat();
                assert_only_the_second_suffers(&line, "inserted");
            }
        }
    }

    #[test]
    fn every_cut_costs_one_frame_at_most() {
        let [first, second, third] = three();
        for begin in 0..second.len() {
            for end in begin + 1..=second.len() {
                let damaged = [&second[..begin], &second[end..]].concat();
                let line = [&first[..], &damaged, &third].concat();
                assert_only_the_second_suffers(&line, "cut");
            }
        }
    }

    #[test]
    fn every_swap_of_two_bytes_costs_one_frame_at_most() {
        let [first, second, third] = three();
        for a in 0..second.len() {
            for b in a + 1..second.len() {
                let mut damaged = second.clone();
                damaged.swap(a, b);
                let line = [&first[..], &damaged, &third].concat();
                assert_only_the_second_suffers(&line, "swapped");
            }
        }
    }

    #[test]
    fn a_frame_that_is_too_long_is_refused_once_and_skipped() {
        let mut decoder = Decoder::new();
        let line = [std::vec![1u8; 10 * MAX_WIRE], three()[0].clone()].concat();
        let (frames, errors) = listen::<HostMessage>(&mut decoder, &line);
        assert_eq!((frames.len(), errors.total(), errors.too_long), (1, 1, 1));
    }

    /// Each reason has its counter.
    #[test]
    fn reasons_are_told_apart() {
        let hello = wire(1, &HostMessage::Hello);
        let sealed = |body: &[u8]| {
            let mut cobs = std::vec![0; MAX_WIRE];
            let whole = [body, &CRC.checksum(body).to_le_bytes()].concat();
            let length = cobs::encode(&whole, &mut cobs);
            cobs[length] = 0;
            cobs.truncate(length + 1);
            cobs
        };
        assert_eq!(
            sealed(&[b'>', PROTOCOL, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0]),
            hello[1..],
            "made by hand"
        );

        let mut decoder = Decoder::new();
        let cases: [(Vec<u8>, FrameError); 7] = [
            (std::vec![9, 1, 0], FrameError::Encoding),
            (std::vec![2, 1, 0], FrameError::TooShort),
            (
                sealed(&[b'>', PROTOCOL, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0])
                    .iter()
                    .map(|b| if *b == b'>' { b'?' } else { *b })
                    .collect(),
                FrameError::Checksum,
            ),
            (wire(1, &ModuleMessage::Forgotten), FrameError::Direction(b'<')),
            (
                sealed(&[b'>', PROTOCOL + 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0]),
                FrameError::Version(PROTOCOL + 1),
            ),
            (sealed(&[b'>', PROTOCOL, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 99]), FrameError::Content),
            (sealed(&[b'>', PROTOCOL, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0]), FrameError::Content),
        ];
        let mut refused = RefusedFrames::NONE;
        for (bytes, error) in &cases {
            let results: Vec<_> =
                bytes.iter().filter_map(|byte| decoder.push::<HostMessage>(*byte)).collect();
            assert_eq!(results, [Err(*error)]);
            refused.count(*error);
        }
        let expected = RefusedFrames {
            encoding: 1,
            too_short: 1,
            checksum: 1,
            direction: 1,
            version: 1,
            content: 2,
            ..RefusedFrames::NONE
        };
        assert_eq!(refused, expected);
    }

    proptest! {
        /// Whatever came before, the next frame arrives: noise without a border costs nothing but itself.
        #[test]
        fn after_any_garbage_the_next_frame_arrives(garbage in prop::collection::vec(any::<u8>(), 0..6000)) {
            let mut decoder = Decoder::new();
            let (frames, _) = listen::<HostMessage>(&mut decoder, &garbage);
            prop_assert!(frames.is_empty());
            let (frames, _) = listen::<HostMessage>(&mut decoder, &wire(5, &HostMessage::Reset));
            prop_assert_eq!(frames.len(), 1);
            prop_assert_eq!(&frames[0].message, &HostMessage::Reset);
        }

        /// A long line on which some frames are damaged in some ways: all others arrive, in order.
        #[test]
        fn untouched_frames_arrive_in_order(
            damages in prop::collection::vec(prop::option::weighted(0.4, (0u8..5, any::<prop::sample::Index>(), any::<u8>())), 1..60),
        ) {
            let mut line = Vec::new();
            let mut untouched = Vec::new();
            for (k, damage) in damages.iter().enumerate() {
                let sequence = k as u32;
                let mut bytes = wire(sequence, &HostMessage::Step(input(k as u64)));
                if let Some((kind, index, byte)) = damage {
                    let at = index.index(bytes.len());
                    match kind {
                        0 => bytes[at] = bytes[at].wrapping_add((*byte).max(1)),
                        1 => bytes.insert(at, *byte),
                        2 => { bytes.remove(at); }
                        3 => bytes.truncate(at),
                        _ => { bytes.drain(..at); }
                    }
                } else {
                    untouched.push(sequence);
                }
                line.extend(bytes);
            }
            let (frames, _) = listen::<HostMessage>(&mut Decoder::new(), &line);
            let arrived: Vec<u32> = frames.iter().map(|frame| frame.sequence).collect();
            prop_assert!(arrived.is_sorted());
            prop_assert!(untouched.iter().all(|sequence| arrived.contains(sequence)));
            for frame in frames {
                prop_assert_eq!(frame.message, HostMessage::Step(input(u64::from(frame.sequence))));
            }
        }
    }
}
