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

/// Ring of the last updates. Times and values stand apart. The regression goes through the places in their order and not in that of
/// age, so that a host works on several at once; the same entries elsewhere in the ring give sums with other last digits.
#[derive(Clone, Copy, Debug)]
pub struct Window<F> {
    times_ms: [u32; RING],
    values: [F; RING],
    head: usize,
    len: usize,
    fictitious: usize,
}

impl<F: Scalar> Window<F> {
    /// The start [TMP-6]: six fictitious entries of `value`, a minute apart, the newest a minute before
    /// `now_ms`. `now_ms` must be at least 360 000.
    pub fn start(now_ms: u64, value: F) -> Self {
        let mut window = Self { times_ms: [0; RING], values: [value; RING], head: 0, len: 0, fictitious: 0 };
        window.restart_if(true, now_ms, value);
        window
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
        let place = (self.head + age) & (RING - 1);
        Entry { time_ms: self.times_ms[place], value: self.values[place] }
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
        for (place, minutes) in (1..=KEEP as u64).rev().enumerate() {
            let fictitious = Entry::new(now_ms.saturating_sub(60_000 * minutes), value);
            self.put_if(condition, place, fictitious);
        }
    }

    /// Appends an entry where `condition` holds; a full ring loses its oldest.
    pub fn push_if(&mut self, condition: bool, entry: Entry<F>) {
        self.drop_oldest(usize::from(condition & (self.len >= RING)));
        self.put_if(condition, self.head + self.len, entry);
        self.len += usize::from(condition);
    }

    /// Moves the newest entry to another instant where `condition` holds.
    pub fn move_newest_if(&mut self, condition: bool, time_ms: u64) {
        let newest = &mut self.times_ms[(self.head + self.len.wrapping_sub(1)) & (RING - 1)];
        *newest = select(condition, time_ms as u32, *newest);
    }

    /// Removes what no longer serves [TMP-5]: an entry leaves when it is older than the window **and** its
    /// follower is a window away from the newest entry, or when it is four windows old; six always remain.
    /// As times ascend, what goes is the oldest so many entries, and their number is found by halving.
    /// Nothing goes unless `condition` holds.
    pub fn expire_if(&mut self, condition: bool, now_ms: u64, window_ms: u32) {
        let newest = self.newest();
        let goes = |age: usize| {
            let old_ms = self.entry(age).age_ms(now_ms);
            let follower_old_ms = self.entry(age + 1).age_ms(u64::from(newest.time_ms));
            let unneeded = (old_ms > window_ms) & (follower_old_ms >= window_ms);
            (unneeded | (old_ms > window_ms.saturating_mul(4))) & (age + KEEP < self.len)
        };
        let mut gone = 0;
        let mut step = RING / 2;
        for _ in 0..RING.ilog2() {
            gone += select(goes(gone + step - 1), step, 0);
            step /= 2;
        }
        self.drop_oldest(select(condition, gone, 0));
    }

    /// Which from the oldest the entry at a place is.
    fn age_of(&self, place: usize) -> u32 {
        (place as u32).wrapping_sub(self.head as u32) & (RING as u32 - 1)
    }

    /// At a place, counted round the ring.
    fn put_if(&mut self, condition: bool, place: usize, entry: Entry<F>) {
        let place = place & (RING - 1);
        self.times_ms[place] = select(condition, entry.time_ms, self.times_ms[place]);
        self.values[place] = select(condition, entry.value, self.values[place]);
    }

    fn drop_oldest(&mut self, count: usize) {
        let count = count.min(self.len);
        self.head = (self.head + count) & (RING - 1);
        self.len -= count;
        self.fictitious = self.fictitious.saturating_sub(count);
    }

    /// Of the entry at a place the regression is given: one if it is in use and zero if it is stale, seconds from the newest entry to it
    /// (≤ 0; exact in `f32` below 4.6 h), and how far its value lies above the newest one's, degC.
    #[inline(always)]
    pub(super) fn beside(&self, newest: &Entry<F>, place: usize) -> (F, F, F) {
        let is_used = self.age_of(place) < self.len as u32;
        let used = select(is_used, F::one(), F::zero());
        let before_ms = select(is_used, between_ms(self.times_ms[place], newest.time_ms).max(0), 0);
        let seconds = F::from_i32(before_ms).unwrap_or_else(F::zero) * real(-1e-3);
        (used, seconds, used * (self.values[place] - newest.value))
    }
}

saved!([F: Blank] Entry<F> { time_ms, value });
saved!([F: Blank] Window<F> { times_ms, values, head < RING, len < RING + 1, fictitious < RING + 1 });
