//! The instants at which the temperature was known, oldest first, in a ring of fixed size [TMP-5].
use super::{Scalar, real};
use crate::number::select;
use crate::saved::{Blank, saved};

/// Capacity of the ring.
pub const RING: usize = 64;
/// Entries that always remain: twice the number of model parameters.
pub const KEEP: usize = 6;

/// One stored update: the temperature was `value` at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry<F> {
    /// Instant, milliseconds on the estimator's internal clock, modulo 2³²: half the memory. Entries are at most four windows
    /// old, three days, and differences below 24 days are right.
    pub time_ms: u32,
    /// Temperature, degC.
    pub value: F,
}

impl<F> Entry<F> {
    /// The temperature `value` at `time_ms` on the estimator's internal clock.
    pub fn new(time_ms: u64, value: F) -> Self {
        Self { time_ms: time_ms as u32, value }
    }

    /// Time from the entry to an instant, ms; zero where that is before it.
    pub fn age_ms(&self, now_ms: u64) -> u32 {
        between_ms(self.time_ms, now_ms as u32).max(0).cast_unsigned()
    }

    /// Seconds from the entry to an instant; exact in `f32` below 4.6 h.
    pub(super) fn seconds_until(&self, time_ms: u64) -> F
    where
        F: Scalar,
    {
        F::from_i32(between_ms(self.time_ms, time_ms as u32)).unwrap_or_else(F::zero) * real(1e-3)
    }
}

/// From one instant to another, ms, both modulo 2³².
fn between_ms(from: u32, to: u32) -> i32 {
    to.wrapping_sub(from).cast_signed()
}

/// Ring of the last updates.
#[derive(Clone, Copy, Debug)]
pub struct Window<F> {
    entries: [Entry<F>; RING],
    head: usize,
    len: usize,
    fictitious: usize,
}

impl<F: Scalar> Window<F> {
    /// The start [TMP-6]: six fictitious entries of `value`, a minute apart, the newest a minute before
    /// `now_ms`. `now_ms` must be at least 360 000.
    pub fn start(now_ms: u64, value: F) -> Self {
        let mut entries = [Entry::new(0, value); RING];
        for (entry, minutes) in entries.iter_mut().zip((1..=KEEP as u64).rev()) {
            *entry = Entry::new(now_ms.saturating_sub(60_000 * minutes), value);
        }
        Self { entries, head: 0, len: KEEP, fictitious: KEEP }
    }

    /// Number of entries, 6 to 64.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Never: six entries always remain.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The `age`-th entry from the oldest; what lies beyond [`Window::len`] is stale and must be masked.
    pub fn entry(&self, age: usize) -> Entry<F> {
        self.entries[(self.head + age) & (RING - 1)]
    }

    /// The newest entry.
    pub fn newest(&self) -> Entry<F> {
        self.entry(self.len.wrapping_sub(1))
    }

    /// Whether an entry of the start is still in the ring.
    pub fn settling(&self) -> bool {
        self.fictitious > 0
    }

    /// Starts anew where `condition` holds, as [`Window::start`]; with the same work where it does not.
    pub fn restart_if(&mut self, condition: bool, now_ms: u64, value: F) {
        self.head = select(condition, 0, self.head);
        self.len = select(condition, KEEP, self.len);
        self.fictitious = select(condition, KEEP, self.fictitious);
        for (entry, minutes) in self.entries.iter_mut().zip((1..=KEEP as u64).rev()) {
            let fictitious = Entry::new(now_ms.saturating_sub(60_000 * minutes), value);
            *entry = select(condition, fictitious, *entry);
        }
    }

    /// Appends an entry where `condition` holds; a full ring loses its oldest.
    pub fn push_if(&mut self, condition: bool, entry: Entry<F>) {
        self.drop_oldest(usize::from(condition & (self.len >= RING)));
        let place = &mut self.entries[(self.head + self.len) & (RING - 1)];
        *place = select(condition, entry, *place);
        self.len += usize::from(condition);
    }

    /// Moves the newest entry to another instant where `condition` holds.
    pub fn move_newest_if(&mut self, condition: bool, time_ms: u64) {
        let newest = &mut self.entries[(self.head + self.len.wrapping_sub(1)) & (RING - 1)];
        newest.time_ms = select(condition, time_ms as u32, newest.time_ms);
    }

    /// Removes what no longer serves [TMP-5]: an entry leaves when it is older than the window **and** its
    /// follower is a window away from the newest entry, or when it is four windows old; six always remain.
    /// All conditions hold for a prefix of the ring, so one pass counts what goes. Nothing goes unless `condition` holds.
    pub fn expire_if(&mut self, condition: bool, now_ms: u64, window_ms: u32) {
        let newest_ms = self.newest().time_ms;
        let mut gone = 0;
        for age in 0..RING {
            let old = self.entry(age).age_ms(now_ms);
            let follower_old = between_ms(self.entry(age + 1).time_ms, newest_ms).max(0).cast_unsigned();
            let stale =
                ((old > window_ms) & (follower_old >= window_ms)) | (old > window_ms.saturating_mul(4));
            gone += usize::from(stale & (age + KEEP < self.len));
        }
        self.drop_oldest(select(condition, gone, 0));
    }

    fn drop_oldest(&mut self, count: usize) {
        let count = count.min(self.len);
        self.head = (self.head + count) & (RING - 1);
        self.len -= count;
        self.fictitious = self.fictitious.saturating_sub(count);
    }

    /// Seconds from the newest entry to the `age`-th one (≤ 0), for the regression; exact in `f32` below 4.6 h.
    pub(super) fn seconds_from_newest(&self, age: usize) -> F {
        let before_ms = between_ms(self.entry(age).time_ms, self.newest().time_ms).max(0);
        F::from_i32(before_ms).unwrap_or_else(F::zero) * real(-1e-3)
    }

    /// One for an entry in use, zero for a stale place.
    pub(super) fn mask(&self, age: usize) -> F {
        F::from_u8(u8::from(age < self.len)).unwrap_or_else(F::zero)
    }
}

saved!([F: Blank] Entry<F> { time_ms, value });
saved!([F: Blank] Window<F> { entries, head < RING, len < RING + 1, fictitious < RING + 1 });
