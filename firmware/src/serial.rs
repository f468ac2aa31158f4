//! The main loop on the serial line.
use cortex_m::asm::wfi;
use schuler_core::module::FlightModule;
use schuler_link::endpoint::{Endpoint, Reaction};
use schuler_link::message::{Counters, Identity, Start, Transport};

use crate::{board, log, start, time};

/// Who speaks here.
pub const IDENTITY: Identity =
    Identity { board: board::BOARD, transport: Transport::Uart, start: Start::PowerOn, boots: 0 };

/// Bytes taken in one turn: a line that babbles does not keep the clock's step from its tick.
const BYTES_PER_TURN: usize = 1024;

/// The log repeats what is wrong no more often than this.
const COMPLAINT_PERIOD_US: u64 = 1_000_000;

/// Serves the host for good.
pub fn run(endpoint: &mut Endpoint, module: &mut FlightModule) -> ! {
    let mut complaints = Complaints::default();
    send(endpoint.banner());
    loop {
        board::feed_watchdog();
        for byte in (0..BYTES_PER_TURN).map_while(|_| board::RECEIVED.pop()) {
            match endpoint.receive(byte, module, time::now_us) {
                Reaction::None => (),
                Reaction::Send(frame) => send(frame),
                Reaction::Reset => {
                    defmt::info!("reset by command");
                    start::restart(Start::Command);
                }
            }
        }
        if let Some(frame) = endpoint.tick(module, time::now_us) {
            send(frame);
        }
        endpoint.count_lost_bytes(board::take_lost());
        complaints.log(endpoint.counters());
        log::drain();
        rest();
    }
}

/// Sends a frame. The line takes it at its own speed; the log uses the time.
fn send(frame: &[u8]) {
    for byte in frame {
        while !board::link_send(*byte) {
            log::drain();
        }
    }
}

/// Sleeps until something happens. With interrupts masked a byte that comes between the look and the sleep still
/// ends it; without, it would be slept over.
fn rest() {
    cortex_m::interrupt::free(|_| {
        if board::RECEIVED.is_empty() && log::is_empty() {
            wfi();
        }
    });
}

/// What has been logged.
#[derive(Default)]
struct Complaints {
    logged: Counters,
    dropped: u32,
    next_us: u64,
}

impl Complaints {
    /// Logs what has changed.
    fn log(&mut self, now: Counters) {
        if now.states != self.logged.states {
            defmt::info!("state loaded");
            self.logged.states = now.states;
        }
        if let Some(checksum) = now.compensation.filter(|_| now.compensation != self.logged.compensation) {
            defmt::info!("compensation block {=u32:08x} in force", checksum);
        }
        self.logged.compensation = now.compensation;
        let wrong = |counters: &Counters| {
            let Counters { refused, lost_bytes, stale, conflicts, overruns, skipped_ticks, .. } = *counters;
            (refused, lost_bytes, stale, conflicts, overruns, skipped_ticks)
        };
        let dropped = log::dropped();
        let news = wrong(&now) != wrong(&self.logged) || dropped != self.dropped;
        if !news || time::now_us() < self.next_us {
            return;
        }
        self.next_us = time::now_us() + COMPLAINT_PERIOD_US;
        let refused = now.refused.total();
        if refused != self.logged.refused.total() {
            defmt::warn!("{=u32} frames refused so far", refused);
        }
        if now.lost_bytes != self.logged.lost_bytes {
            defmt::warn!("{=u32} bytes lost so far", now.lost_bytes);
        }
        if (now.stale, now.conflicts) != (self.logged.stale, self.logged.conflicts) {
            defmt::warn!("{=u32} commands late, {=u32} in conflict so far", now.stale, now.conflicts);
        }
        if (now.overruns, now.skipped_ticks) != (self.logged.overruns, self.logged.skipped_ticks) {
            let (overruns, skipped, longest) = (now.overruns, now.skipped_ticks, now.longest_step_us);
            defmt::warn!(
                "{=u32} steps overran, {=u32} ticks skipped, longest step {=u32} us",
                overruns,
                skipped,
                longest
            );
        }
        if dropped != self.dropped {
            defmt::warn!("{=u32} log frames dropped so far", dropped);
        }
        self.logged = now;
        self.dropped = dropped;
    }
}
