//! The instants at which the temperature was known, oldest first, in a ring of fixed size [TMP-5].
use super::{Scalar, real};
use crate::number::select;
use crate::saved::{Blank, saved};

/// Capacity of the ring.
pub const RING: usize = 64;
/// Entries that always remain: twice the number of model parameters.
pub const KEEP: usize = 6;

/// One stored update: the temperature was `value` at `time_ms`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry<F> {
    /// Instant, milliseconds on the estimator's internal clock.
    pub time_ms: u64,
    /// Temperature, degC.
    pub value: F,
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
        let mut entries = [Entry { time_ms: 0, value }; RING];
        for (entry, minutes) in entries.iter_mut().zip((1..=KEEP as u64).rev()) {
            entry.time_ms = now_ms.saturating_sub(60_000 * minutes);
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
            let time_ms = now_ms.saturating_sub(60_000 * minutes);
            *entry = select(condition, Entry { time_ms, value }, *entry);
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
        newest.time_ms = select(condition, time_ms, newest.time_ms);
    }

    /// Removes what no longer serves [TMP-5]: an entry leaves when it is older than the window **and** its
    /// follower is a window away from the newest entry, or when it is four windows old; six always remain.
    /// All conditions hold for a prefix of the ring, so one pass counts what goes. Nothing goes unless `condition` holds.
    pub fn expire_if(&mut self, condition: bool, now_ms: u64, window_ms: u64) {
        let newest_ms = self.newest().time_ms;
        let mut gone = 0;
        for age in 0..RING {
            let old = now_ms.saturating_sub(self.entry(age).time_ms);
            let follower_old = newest_ms.saturating_sub(self.entry(age + 1).time_ms);
            let stale = (old > window_ms && follower_old >= window_ms) || old > window_ms.saturating_mul(4);
            gone += usize::from(stale && age + KEEP < self.len);
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
        let before_ms = self.newest().time_ms.saturating_sub(self.entry(age).time_ms);
        F::from_u32(u32::try_from(before_ms).unwrap_or(u32::MAX)).unwrap_or_else(F::zero) * real(-1e-3)
    }

    /// One for an entry in use, zero for a stale place.
    pub(super) fn mask(&self, age: usize) -> F {
        F::from_u8(u8::from(age < self.len)).unwrap_or_else(F::zero)
    }
}

saved!([F: Blank] Entry<F> { time_ms, value });
saved!([F: Blank] Window<F> { entries, head < RING, len < RING + 1, fictitious < RING + 1 });
