//! Microseconds since start.
use core::cell::Cell;

use critical_section::Mutex;

use crate::board;

/// Last reading of the counter, and all its ticks since start.
static ELAPSED: Mutex<Cell<(u32, u64)>> = Mutex::new(Cell::new((0, 0)));

/// Microseconds since start. To be called at least once a turn of the board's counter: 171 s on mps2-an386, 71 min on
/// stm32f405.
pub fn now_us() -> u64 {
    let ticks = critical_section::with(|section| {
        let elapsed = ELAPSED.borrow(section);
        let (last, ticks) = elapsed.get();
        let now = board::clock();
        let ticks = ticks + u64::from(now.wrapping_sub(last));
        elapsed.set((now, ticks));
        ticks
    });
    ticks / u64::from(board::CLOCK_HZ / 1_000_000)
}

defmt::timestamp!("{=u64:us}", now_us());
