//! What a bad line does to the link, counted: a seeded grid of faults and rates against the real firmware under QEMU.
//!
//! The line loses, repeats, reorders, cuts, joins and changes frames, and the host restarts in the midst of one. What must
//! come of it is known without asking the decoder: between two zeros a sent frame has arrived untouched, or has not. An
//! endpoint in this process hears the untouched ones alone. The module, which hears everything, must say what that one says,
//! byte for byte: one more answer is a damaged frame accepted, one less an intact frame lost. Its answers then go through
//! the same faults on their way back.
//!
//! Frames of before a reset are replayed after it, to endpoints in this process: a million of them in the ordinary tests.
//!
//! The long run writes `docs/link-faults.md`:
//!
//! ```text
//! cargo test -p schuler-tests link_fault_grid:: -- --ignored --nocapture
//! ```
use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use host_sim::emulator::{Emulator, HostModule, Target, Transport};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use schuler_core::identification::Method;
use schuler_core::module::{FlightModule, ModuleConfig, StateLoader, StepOutput};
use schuler_link::block::encode;
use schuler_link::endpoint::{Endpoint, Reaction};
use schuler_link::frame::{Decoder, Wire};
use schuler_link::message::{
    Board, HostMessage, Identity, ModuleMessage, Pace, STATE_PART, Start, Transport as Line,
};

use crate::common::flight::{Flight, everything, full_block};

use crate::common;

const PATIENCE: Duration = Duration::from_mins(1);

/// What the line does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Lost,
    Repeated,
    Reordered,
    CutAtTheEnd,
    CutAtTheStart,
    BitFlipped,
    BytesChanged,
    NoiseInserted,
    BordersLost,
    HostRestarted,
}

const FAULTS: [(Fault, &str); 10] = [
    (Fault::Lost, "frame lost"),
    (Fault::Repeated, "frame repeated"),
    (Fault::Reordered, "frame after the next one"),
    (Fault::CutAtTheEnd, "frame cut at its end"),
    (Fault::CutAtTheStart, "frame cut at its start"),
    (Fault::BitFlipped, "one bit flipped"),
    (Fault::BytesChanged, "up to 16 bytes changed"),
    (Fault::NoiseInserted, "up to 40 bytes inserted"),
    (Fault::BordersLost, "borders lost: two frames run into one"),
    (Fault::HostRestarted, "host restarted in mid-frame"),
];
const RATES: [f64; 3] = [0.02, 0.2, 0.7];

/// Frames as they leave: each may be damaged.
struct BadLine {
    fault: Fault,
    rate: f64,
    random: Pcg64,
    held_back: Option<Vec<u8>>,
}

impl BadLine {
    fn pass(&mut self, mut frame: Vec<u8>) -> Vec<u8> {
        let held_back = self.held_back.take().unwrap_or_default();
        let at = self.random.random_range(0..frame.len());
        if !self.random.random_bool(self.rate) {
            frame.extend(held_back);
            return frame;
        }
        match self.fault {
            Fault::Lost => frame.clear(),
            Fault::Repeated => frame.extend_from_within(..),
            Fault::Reordered => {
                self.held_back = Some(frame);
                return held_back;
            }
            Fault::CutAtTheEnd | Fault::HostRestarted => frame.truncate(at),
            Fault::CutAtTheStart => {
                frame.drain(..at);
            }
            Fault::BitFlipped => frame[at] ^= 1 << self.random.random_range(0..8),
            Fault::BytesChanged => {
                for _ in 0..self.random.random_range(1..=16) {
                    let at = self.random.random_range(0..frame.len());
                    frame[at] = self.random.random();
                }
            }
            Fault::NoiseInserted => {
                let noise: Vec<u8> =
                    (0..self.random.random_range(1..=40)).map(|_| self.random.random()).collect();
                frame.splice(at..at, noise);
            }
            Fault::BordersLost => frame.retain(|byte| *byte != 0),
        }
        frame.extend(held_back);
        frame
    }
}

/// What stands between zeros: never empty. The last piece is what no zero has ended yet.
fn pieces(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    bytes.split(|byte| *byte == 0).filter(|piece| !piece.is_empty())
}

/// What came of one cell of the grid.
#[derive(Clone, Copy, Default)]
struct Count {
    /// Frames that the host meant to send.
    sent: u64,
    /// Pieces between borders that are not a frame that was sent, or are no frame at all; both directions.
    damaged: u64,
    /// Frames that arrived untouched, both directions.
    intact: u64,
    /// Damaged pieces taken for a frame.
    accepted: u64,
    /// Intact frames not taken.
    lost: u64,
    steps: u64,
}

impl Count {
    fn add(&mut self, other: &Self) {
        self.sent += other.sent;
        self.damaged += other.damaged;
        self.intact += other.intact;
        self.accepted += other.accepted;
        self.lost += other.lost;
        self.steps += other.steps;
    }

    /// The largest share of damaged frames accepted that none in so many leaves possible, at 95 %: 1 − 0.05^(1/n).
    fn limit(&self) -> f64 {
        -(0.05f64.ln() / self.damaged as f64).exp_m1()
    }
}

/// The module under QEMU, and its double in this process, which hears intact frames only.
struct Pair {
    emulator: Emulator,
    endpoint: Box<Endpoint>,
    module: Box<FlightModule>,
    sequence: u32,
    /// In which both sides are.
    session: u64,
    /// Bytes in one go.
    batch: usize,
    /// What starts the flight, part by part.
    state: Vec<HostMessage>,
    /// First part of the state of a module with another configuration.
    foreign: HostMessage,
    /// Frames that the double has heard.
    accepted: u32,
}

/// The state of a module that has been configured and corrected, in the parts in which it is taken.
fn parts(config: &ModuleConfig) -> Vec<HostMessage> {
    let mut ground = HostModule::new();
    ground.configure(config).unwrap();
    ground.load_compensation(&encode(&full_block())).unwrap();
    let state = ground.save().unwrap();
    let (mut loader, mut module) = (StateLoader::new(), Box::new(FlightModule::new()));
    let (mut parts, mut begin) = (Vec::new(), 0);
    while begin < state.len() {
        let part = &state[begin..state.len().min(begin + STATE_PART)];
        parts.push(HostMessage::LoadState { begin: begin as u32, bytes: part.iter().copied().collect() });
        begin = loader.take(&mut module, begin as u32, part).unwrap() as usize;
    }
    parts
}

impl Pair {
    fn start(transport: Transport) -> Self {
        let mut emulator = common::start(transport);
        // What is on its way on the serial line must fit into the module's queue of 2048 bytes, repeated frames and all.
        let (line, batch) = match transport {
            Transport::Uart => (Line::Uart, 800),
            Transport::Fifo => (Line::Semihosting, 30_000),
        };
        let config = everything();
        let mut other = config;
        other.identification.method = Method::Off;
        let identity = Identity { board: Board::Mps2An386, transport: line, start: Start::PowerOn, boots: 1 };
        let mut endpoint = Box::new(Endpoint::new(identity));
        let mut module = Box::new(FlightModule::new());
        // The double's clock stands at zero: it is offered what makes its session that of the module.
        let session = emulator.session();
        let mut wire = Wire::new();
        wire.seal_with(session ^ 1 << 32);
        wire.encode(u32::MAX, &HostMessage::Hello).unwrap();
        for byte in wire.as_bytes() {
            endpoint.receive(*byte, &mut module, || 0);
        }
        // What the module has heard since its start, the double has not.
        let accepted = emulator.counters().unwrap().frames;
        Self {
            emulator,
            endpoint,
            module,
            sequence: 0,
            session,
            batch,
            state: parts(&config),
            foreign: parts(&other).swap_remove(0),
            accepted,
        }
    }

    /// Starts the flight anew, over a line that damages nothing.
    fn begin_flight(&mut self) {
        let mut wire = Wire::new();
        wire.seal_with(self.session);
        for message in [HostMessage::Forget].iter().chain(&self.state.clone()) {
            self.sequence = self.sequence.wrapping_add(1);
            wire.encode(self.sequence, message).unwrap();
            let sent = pieces(wire.as_bytes()).map(<[u8]>::to_vec).collect();
            let (answered, expected) = self.exchange(wire.as_bytes(), &sent, &mut Count::default());
            assert!(answered == expected, "over a good line");
        }
        assert!(self.module.state_length().is_ok());
    }

    /// What the double answers to one intact frame.
    fn answer(&mut self, body: &[u8], answers: &mut Vec<u8>) {
        for byte in [0].iter().chain(body).chain(&[0]) {
            match self.endpoint.receive(*byte, &mut self.module, || 0) {
                Reaction::Send(frame) => answers.extend_from_slice(frame),
                Reaction::None => (),
                Reaction::Reset => unreachable!("no reset is sent"),
            }
        }
        self.accepted += 1;
    }

    /// Sends the bytes as they are; what the module answered, and what its double did to the intact frames in them.
    fn exchange(&mut self, bytes: &[u8], sent: &HashSet<Vec<u8>>, count: &mut Count) -> (Vec<u8>, Vec<u8>) {
        let mut expected = Vec::new();
        for piece in pieces(bytes) {
            if sent.contains(piece) {
                count.intact += 1;
                self.answer(piece, &mut expected);
            } else {
                count.damaged += 1;
            }
        }
        self.emulator.send_bytes(bytes).unwrap();
        let mut answered = Vec::new();
        let deadline = Instant::now() + PATIENCE;
        while answered.len() < expected.len() {
            match self.emulator.next_bytes(deadline.saturating_duration_since(Instant::now())).unwrap() {
                Some(bytes) => answered.extend(bytes),
                None => break,
            }
        }
        (answered, expected)
    }

    /// One cell of the grid.
    fn run(&mut self, fault: Fault, rate: f64, frames: usize, seed: u64) -> Count {
        let mut count = Count::default();
        let mut random = Pcg64::seed_from_u64(seed);
        let mut line = BadLine { fault, rate, random: Pcg64::seed_from_u64(seed + 1), held_back: None };
        let mut back = BadLine { fault, rate, random: Pcg64::seed_from_u64(seed + 2), held_back: None };
        let mut flight = Flight::new(seed);
        let mut wire = Wire::new();
        wire.seal_with(self.session);
        let mut decoder = Decoder::new();
        let mut made = 0;
        while made < frames {
            let mut bytes = Vec::new();
            let mut sent = HashSet::new();
            while bytes.len() < self.batch && made < frames {
                self.sequence = self.sequence.wrapping_add(1);
                let message = match random.random_range(0..20) {
                    0..3 => HostMessage::Hello,
                    // These two are refused, and the flight goes on: a part out of its turn, a foreign state.
                    3 => self.state[random.random_range(1..self.state.len())].clone(),
                    4 => self.foreign.clone(),
                    5 => HostMessage::ReadState { begin: 0 },
                    6..16 => HostMessage::SetPace(Pace::Clock {
                        period_ms: random.random_range(60_001..=u32::MAX),
                    }),
                    _ => HostMessage::Step(flight.next().unwrap()),
                };
                wire.encode(self.sequence, &message).unwrap();
                sent.extend(pieces(wire.as_bytes()).map(<[u8]>::to_vec));
                let passed = line.pass(wire.as_bytes().to_vec());
                let cut = fault == Fault::HostRestarted && passed.len() < wire.as_bytes().len();
                bytes.extend(passed);
                made += 1;
                if cut {
                    // The new one knows nothing: it asks, and goes on from any number.
                    wire.encode(u32::MAX, &HostMessage::Hello).unwrap();
                    sent.extend(pieces(wire.as_bytes()).map(<[u8]>::to_vec));
                    bytes.extend_from_slice(wire.as_bytes());
                    self.sequence = self.sequence.wrapping_sub(random.random_range(0..4));
                    made += 1;
                }
            }
            // And a border, so that nothing waits for the next batch: what is looked for there is what was sent there.
            bytes.extend(line.held_back.take().unwrap_or_default());
            bytes.push(0);
            let (answered, expected) = self.exchange(&bytes, &sent, &mut count);
            if answered != expected {
                let (mut told, mut due) = (pieces(&answered), pieces(&expected).collect::<HashSet<_>>());
                count.accepted += told.by_ref().filter(|piece| !due.remove(piece)).count() as u64;
                count.lost += due.len() as u64;
            }

            // The way back: through the same faults, into the host's decoder.
            let mut bytes = Vec::new();
            for body in pieces(&answered) {
                bytes.extend(back.pass([&[0], body, &[0]].concat()));
            }
            bytes.extend(back.held_back.take().unwrap_or_default());
            bytes.push(0);
            let due: HashSet<&[u8]> = pieces(&answered).collect();
            let (mut intact, mut taken) = (0, 0);
            for piece in pieces(&bytes) {
                let known = due.contains(piece);
                intact += u64::from(known);
                count.damaged += u64::from(!known);
                for byte in piece.iter().chain(&[0]) {
                    let Some(Ok(frame)) = decoder.push::<ModuleMessage>(*byte) else { continue };
                    taken += u64::from(known);
                    count.accepted += u64::from(!known);
                    if let ModuleMessage::Output(output) = &frame.message {
                        count.steps += 1;
                        assert_in_range(output);
                    }
                }
            }
            count.intact += intact;
            count.lost += intact - taken;
        }
        count.sent = made as u64;
        count
    }

    /// The module's own count: every intact frame, and no other.
    fn assert_counted(&mut self) {
        // An endpoint counts the question, too.
        let frames = self.emulator.counters().unwrap().frames;
        assert_eq!(frames, self.accepted + 1, "frames that the module took");
        self.accepted += 1;
    }
}

/// No number of an output is one that no flight can have.
fn assert_in_range(output: &StepOutput) {
    let filter = &output.filter;
    let averaged = &output.identification.averaged;
    assert!(filter.estimate.iter().chain(&averaged.estimate).all(|x| x.is_finite()), "{output:?}");
    assert!(filter.sigma.iter().chain(&averaged.sigma).all(|x| x.is_finite() && *x > 0.0), "{output:?}");
    assert!(filter.nis.is_finite() && filter.nis >= 0.0, "{output:?}");
    let isolation = &output.isolation;
    assert!(isolation.excluded < 32 && isolation.gyros_used < 32, "{output:?}");
    assert!(isolation.rate.iter().all(|x| x.is_finite()), "{output:?}");
    for thermometer in &output.thermometers {
        assert!((-300.0..1000.0).contains(&thermometer.temperature), "{output:?}");
        assert!(thermometer.rate.is_finite(), "{output:?}");
    }
    let health = &output.health;
    let probabilities = [health.p_jump, health.p_noise, health.p_fault];
    assert!(probabilities.iter().all(|p| (0.0..=1.0).contains(p)), "{output:?}");
}

/// The whole grid with so many frames a cell; a line of the table for each fault, and the sum.
fn grid(transport: Transport, frames: usize, seed: u64) -> (String, Count) {
    let begin = Instant::now();
    let mut pair = Pair::start(transport);
    let (mut table, mut sum) = (String::new(), Count::default());
    for (k, (fault, name)) in FAULTS.into_iter().enumerate() {
        let mut row = Count::default();
        pair.begin_flight();
        for (j, rate) in RATES.into_iter().enumerate() {
            row.add(&pair.run(fault, rate, frames, seed + 100 * k as u64 + 10 * j as u64));
        }
        let Count { sent, damaged, intact, accepted, lost, .. } = row;
        writeln!(table, "| {name} | {sent} | {intact} | {damaged} | {accepted} | {lost} |").unwrap();
        sum.add(&row);
    }
    pair.assert_counted();
    let Count { sent, damaged, intact, accepted, lost, steps } = sum;
    writeln!(table, "| all | {sent} | {intact} | {damaged} | {accepted} | {lost} |").unwrap();
    say!(
        "{transport:?}: {damaged} damaged frames, {accepted} accepted (below {:.1e} at 95 %), {lost} intact ones lost, {steps} steps in range, {:.0} s",
        sum.limit(),
        begin.elapsed().as_secs_f64()
    );
    assert_eq!(accepted, 0, "a damaged frame was accepted\n{table}");
    assert_eq!(lost, 0, "an intact frame was lost\n{table}");
    assert!(damaged > 0 && steps > 0);
    (table, sum)
}

/// A board between two resets, without a line.
struct Started {
    endpoint: Box<Endpoint>,
    module: Box<FlightModule>,
    session: u64,
}

impl Started {
    fn new(boots: u32) -> Self {
        let identity = Identity { board: Board::Host, transport: Line::Memory, start: Start::PowerOn, boots };
        let endpoint = Box::new(Endpoint::new(identity));
        Self { endpoint, module: Box::new(FlightModule::new()), session: 0 }
    }

    /// Whether it was answered, and not refused.
    fn accepts(&mut self, frame: &[u8], now_us: u64) -> bool {
        let mut decoder = Decoder::new();
        let mut accepted = false;
        for byte in frame {
            match self.endpoint.receive(*byte, &mut self.module, || now_us) {
                Reaction::None => (),
                Reaction::Reset => accepted = true,
                Reaction::Send(bytes) => {
                    let answer = bytes.iter().find_map(|byte| decoder.push::<ModuleMessage>(*byte));
                    let answer = answer.unwrap().unwrap();
                    self.session = answer.session;
                    accepted |= !matches!(answer.message, ModuleMessage::Refused(_));
                }
            }
        }
        accepted
    }
}

fn sealed(session: u64, sequence: u32, message: &HostMessage) -> Vec<u8> {
    let mut wire = Wire::new();
    wire.seal_with(session);
    wire.encode(sequence, message).unwrap();
    wire.as_bytes().to_vec()
}

/// Commands of all kinds from before a reset, with numbers ahead of those after it, before and after the host's greeting. Every
/// fourth start has lost its count, with the power.
#[test]
fn no_command_of_before_a_reset_is_carried_out_after_it() {
    const STARTS: u32 = 400;
    const REPLAYS: usize = 1_000_000;
    let per_start = REPLAYS / STARTS as usize;
    let mut random = Pcg64::seed_from_u64(5);
    let mut flight = Flight::new(5);
    let state = parts(&everything());
    let (mut old, mut boots) = (Vec::new(), 0);
    let (mut replayed, mut accepted, mut carried_out) = (0, 0, 0);
    for start in 0..STARTS {
        boots = if start % 4 == 3 { 1 } else { boots + 1 };
        let mut board = Started::new(boots);
        let now_us = random.random_range(0..10_000_000);
        let mut replay = |board: &mut Started, random: &mut Pcg64, count: usize| {
            for _ in 0..if old.is_empty() { 0 } else { count } {
                let frame: &Vec<u8> = &old[random.random_range(0..old.len())];
                accepted += u32::from(board.accepts(frame, now_us));
                replayed += 1;
            }
        };
        replay(&mut board, &mut random, per_start / 2);
        assert!(board.accepts(&sealed(random.random(), 0, &HostMessage::Hello), now_us));
        replay(&mut board, &mut random, per_start / 2 + 8);
        let counters = board.endpoint.counters();
        assert_eq!((counters.steps, counters.states, counters.repeated, counters.conflicts), (0, 0, 0, 0));

        // And this session's own are carried out; some of each session are kept for later.
        let session = board.session;
        let first = random.random_range(0..1_000_000);
        let mut commands: Vec<HostMessage> = state.iter().take(2).cloned().collect();
        commands.push(HostMessage::Forget);
        commands.extend(flight.by_ref().take(4).map(HostMessage::Step));
        commands.push(HostMessage::SetPace(Pace::Host));
        commands.push(HostMessage::Reset);
        for (k, command) in commands.iter().enumerate() {
            let frame = sealed(session, first + k as u32, command);
            carried_out += u32::from(board.accepts(&frame, now_us));
            old.push(frame);
        }
    }
    say!(
        "{replayed} frames of before a reset, {accepted} accepted; {carried_out} of the own sessions carried out"
    );
    assert!(replayed >= REPLAYS && carried_out >= 4 * STARTS);
    assert_eq!(accepted, 0);
}

#[test]
fn no_damaged_frame_is_accepted_and_no_intact_one_lost() {
    if common::skipped("no_damaged_frame_is_accepted_and_no_intact_one_lost") {
        return;
    }
    let (_, sum) = grid(Transport::Fifo, 400, 1);
    assert!(sum.damaged > 2000, "{}", sum.damaged);
}

#[test]
fn the_same_on_the_serial_line() {
    if common::skipped("the_same_on_the_serial_line") {
        return;
    }
    grid(Transport::Uart, 40, 2);
}

/// What the page says of sessions.
const SESSIONS: &str = "## Sessions, for who writes a host

A frame that is stored on its way may arrive after the board has been reset, with a number ahead of all that came since. So every frame
bears the number of a session, and the module carries out the commands of its own session only.

1. Ask `Hello` after your own start, and again after each answer `Refusal::Session`. Seal the question with a number that you have not used
   before (a clock will do): after a reset it makes the session, together with the board's count of starts and its clock.
2. Seal every frame from then on with the session that the frame of the answer bears (`Frame::session`, `Wire::seal_with`).
3. Go on from the number `Banner::last_sequence`. Send the same frame again until its answer comes.
4. After a reset of the board send configuration and state again: steps are refused until then.

Of a million commands of before a reset that came after it none was carried out; `cargo test -p schuler-tests no_command_of_before_a_reset`
repeats that.

";

#[test]
#[ignore = "an hour; run by: cargo test -p schuler-tests link_fault_grid:: -- --ignored --nocapture"]
fn a_million_frames_and_the_table() {
    let scale = std::env::var("SCHULER_FRAMES").ok().and_then(|text| text.parse().ok()).unwrap_or(1_000_000);
    let cells = FAULTS.len() * RATES.len();
    let (fifo, of_fifo) = grid(Transport::Fifo, scale / cells, 1000);
    let (uart, of_uart) = grid(Transport::Uart, scale / cells / 40, 2000);
    let head = "| fault | frames sent | arrived intact | arrived damaged | damaged accepted | intact lost |\n\
                | --- | --: | --: | --: | --: | --: |\n";
    let mut all = of_fifo;
    all.add(&of_uart);
    let text = format!(
        "# Faults on the link\n\n\
         The firmware under QEMU at the end of a line that damages frames, one time in fifty, five and 1.4, in both directions.\n\
         A piece between two borders is intact when it is, byte for byte, a frame that was sent; everything else is damaged.\n\
         What was accepted is what the module answered, and what the host's decoder took on the way back. An intact frame\n\
         is lost when it was not: none means that the link is back with the first intact frame after any damage.\n\n\
         Made by `cargo test -p schuler-tests link_fault_grid:: -- --ignored`; a short version is in the ordinary tests.\n\n\
         | | damaged frames | accepted | share accepted, at most (95 %) | intact frames lost | steps, all outputs in range |\n\
         | --- | --: | --: | --: | --: | --: |\n\
         | both lines | {} | {} | {:.1e} | {} | {} |\n\n\
         The checksum alone lets one damaged frame in 4.3 × 10⁹ pass.\n\n\
         {SESSIONS}\
         ## Through semihosting\n\n{head}{fifo}\n## Over the serial line\n\n{head}{uart}",
        all.damaged,
        all.accepted,
        all.limit(),
        all.lost,
        all.steps
    );
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/link-faults.md");
    std::fs::write(path, text).unwrap();
}
