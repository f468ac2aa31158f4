//! Instructions and stack of a piece of code.
#![allow(unsafe_code)]
use core::cell::UnsafeCell;
use core::fmt::Write;
use core::hint::black_box;
use core::ptr;

use cortex_m::register::msp;
use heapless::Vec;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;
use schuler_firmware::board;
use schuler_firmware::semihosting::Console;

/// Emulated time of an instruction, ns: `-icount shift=10`.
const INSTRUCTION_NS: u64 = 1 << 10;
/// Period of the board's counter, ns.
const TICK_NS: u64 = 1_000_000_000 / board::CLOCK_HZ as u64;
const _: () = assert!(INSTRUCTION_NS > 4 * TICK_NS, "an instruction cannot be told from the next");

/// What unused stack is filled with.
const PAINT: u32 = 0x5CA1_AB1E;
/// Left unpainted below the stack pointer, for the painting itself, bytes.
const CLEAR: usize = 64;

/// Most inputs of a part.
const MOST: usize = 4096;

/// The stack is painted for one input in so many.
const PAINTED: usize = 8;

/// Where the counts of one part are gathered.
pub type Counts = Vec<u32, MOST>;

/// Numbers that vary, the same in every run.
pub struct Random(Pcg32);

impl Random {
    /// Uniform over ±1.
    pub fn symmetric(&mut self) -> f64 {
        f64::from(self.0.next_u32().cast_signed()) / f64::from(1u32 << 31)
    }

    /// Close to normal with unit variance: the sum of twelve.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.symmetric()).sum::<f64>() * 0.5
    }

    /// Any bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A number below the limit, which is not zero.
    pub fn below(&mut self, limit: u32) -> u32 {
        self.0.next_u32() % limit
    }

    /// True once in so many times.
    pub fn once_in(&mut self, times: u32) -> bool {
        self.0.next_u32().is_multiple_of(times)
    }
}

/// A part to be counted: what makes its input, which does not count, and what runs.
pub trait Part {
    /// Makes the next input.
    fn prepare(&mut self, random: &mut Random);
    /// What counts.
    fn run(&mut self);
}

struct Of<S, P, R> {
    state: S,
    prepare: P,
    run: R,
}

impl<S, P: FnMut(&mut S, &mut Random), R: FnMut(&mut S)> Part for Of<S, P, R> {
    fn prepare(&mut self, random: &mut Random) {
        (self.prepare)(&mut self.state, random);
    }

    fn run(&mut self) {
        (self.run)(&mut self.state);
    }
}

/// Counts and prints.
pub struct Meter {
    console: Console,
    counts: &'static mut Counts,
    /// Instructions and stack of a part that does nothing.
    nothing: Gathered,
}

impl Meter {
    /// Prints to `console`.
    pub fn new(console: Console, counts: &'static mut Counts) -> Self {
        let mut meter = Self { console, counts, nothing: Gathered::default() };
        let mut nothing = Of { state: (), prepare: |(): &mut (), _: &mut Random| (), run: |(): &mut ()| () };
        meter.nothing = meter.gather(&mut nothing, 16);
        if meter.nothing.most != meter.nothing.least {
            let _ = writeln!(meter.console, "the emulator does not count");
        }
        meter
    }

    /// Counts a part over `samples` inputs: `prepare` makes the next from the state, `run` is what counts.
    pub fn part<S>(
        &mut self,
        name: &str,
        samples: usize,
        state: S,
        prepare: impl FnMut(&mut S, &mut Random),
        run: impl FnMut(&mut S),
    ) {
        let mut part = Of { state, prepare, run };
        let gathered = self.gather(&mut part, samples);
        self.print(name, &gathered);
    }

    /// The marker of a complete run.
    pub fn end(&mut self) {
        let _ = writeln!(self.console, "end");
    }

    fn gather(&mut self, part: &mut dyn Part, samples: usize) -> Gathered {
        let mut random = Random(Pcg32::new(0x5c4d, 1));
        self.counts.clear();
        let mut gathered = Gathered { least: u32::MAX, most: 0, stack: 0 };
        // A long run is painted once, so that no step of it is left out; what makes its input counts there.
        let (kept, painted) = if samples > MOST { (samples / MOST + 1, usize::MAX) } else { (1, PAINTED) };
        for sample in 0..samples {
            part.prepare(&mut random);
            if sample % painted == 0 {
                paint();
            }
            let ticks = ticks(part);
            if sample % painted == 0 || sample + 1 == samples {
                gathered.stack = gathered.stack.max(painted_over());
            }
            // Rounded: a reading of the counter may be up to a tick old.
            let instructions = (u64::from(ticks) * TICK_NS + INSTRUCTION_NS / 2) / INSTRUCTION_NS;
            let instructions = instructions as u32;
            gathered.least = gathered.least.min(instructions);
            gathered.most = gathered.most.max(instructions);
            if sample % kept == 0 {
                let _ = self.counts.push(instructions);
            }
        }
        gathered
    }

    fn print(&mut self, name: &str, gathered: &Gathered) {
        self.counts.sort_unstable();
        let net = |count: u32| count.saturating_sub(self.nothing.most);
        let median = net(self.counts.get(self.counts.len() / 2).copied().unwrap_or_default());
        let (least, most) = (net(gathered.least), net(gathered.most));
        let stack = gathered.stack.saturating_sub(self.nothing.stack);
        let _ = writeln!(self.console, "{name}|{least}|{median}|{most}|{stack}");
    }
}

/// What a run has taken, with what the meter itself takes.
#[derive(Clone, Copy, Default)]
struct Gathered {
    least: u32,
    most: u32,
    /// Bytes.
    stack: usize,
}

/// What the counter advances while the part runs.
#[inline(never)]
fn ticks(part: &mut dyn Part) -> u32 {
    let part = black_box(part);
    let start = board::clock();
    part.run();
    let end = board::clock();
    end.wrapping_sub(start)
}

/// The stack, as memory.
fn stack() -> (*mut u32, *mut u32) {
    unsafe extern "C" {
        static _stack_end: UnsafeCell<u32>;
        static _stack_start: UnsafeCell<u32>;
    }
    // Only the addresses are taken.
    ((&raw const _stack_end).cast_mut().cast(), (&raw const _stack_start).cast_mut().cast())
}

/// Fills the unused stack.
#[inline(never)]
fn paint() {
    let (mut word, _) = stack();
    let end = msp::read() as usize - CLEAR;
    while (word as usize) < end {
        // SAFETY: between the end of the stack and its pointer nothing lives; interrupts are off.
        unsafe {
            ptr::write_volatile(word, PAINT);
            word = word.add(1);
        }
    }
}

/// Bytes of stack from here to the deepest word that is not as it was painted.
#[inline(never)]
fn painted_over() -> usize {
    let (mut word, start) = stack();
    // SAFETY: within the stack.
    while word < start && unsafe { ptr::read_volatile(word) } == PAINT {
        // SAFETY: as above.
        word = unsafe { word.add(1) };
    }
    (msp::read() as usize).saturating_sub(word as usize)
}
