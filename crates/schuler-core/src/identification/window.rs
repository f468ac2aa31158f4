//! The measurements of the last hours, averaged over ten steps each.
//!
//! Input: one velocity error a step (m/s), or a gap. Output: means over [`DECIMATION`] steps with the number of
//! values in them, kept by absolute index while the newest [`CAPACITY`] last.

use crate::number::{real, select};
use crate::saved::{Saved, Visitor, saved};

/// Steps averaged into one sample, D.
pub const DECIMATION: u32 = 10;

/// Samples that one identification looks at, N: 5.7 h of 10 s means.
pub const WINDOW: u32 = 2048;

/// Samples kept: the window, and what arrives while an identification of it is under way.
pub const CAPACITY: usize = 2816;

/// Most steps that can be skipped at a time.
pub const LONGEST_SKIP: u32 = 600;

/// The mean of up to [`DECIMATION`] values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Mean, m/s; zero in a gap.
    pub mean: f32,
    /// Values in it; zero in a gap.
    pub count: u8,
    /// The velocity error may have jumped since the last sample that is no gap.
    pub jumped: bool,
}

impl Sample {
    /// Whether there is a measurement.
    pub fn is_present(self) -> bool {
        self.count > 0
    }

    /// Variance of the mean, given that of one value.
    pub fn variance(self, variance_of_one: f32) -> f32 {
        variance_of_one / real::<f32>(f64::from(self.count.max(1)))
    }
}

/// A sample in four bytes: the number of values stands in the last four bits of the mean, which are worth two millionths
/// of it. It is zero, or five to ten. Six more stand for a sample before which the velocity error
/// may have jumped, which counts nine values at most, as the one that shows the jump is left out.
#[derive(Clone, Copy, Debug)]
struct Packed(u32);

const COUNT_BITS: u32 = 0xF;
const JUMPED: u32 = 6;
const _: () = assert!(DECIMATION / 2 + JUMPED > DECIMATION && DECIMATION - 1 + JUMPED <= COUNT_BITS);

impl Packed {
    const GAP: Self = Self(0);

    fn new(sample: Sample) -> Self {
        let rounded = sample.mean.to_bits().saturating_add(COUNT_BITS.div_ceil(2));
        let count = u32::from(sample.count);
        let told = select(sample.jumped, count.min(DECIMATION - 1) + JUMPED, count);
        Self(rounded & !COUNT_BITS | told & COUNT_BITS)
    }

    fn sample(self) -> Sample {
        let told = self.0 & COUNT_BITS;
        let jumped = told > DECIMATION;
        let count = select(jumped, told.wrapping_sub(JUMPED), told) as u8;
        Sample { mean: f32::from_bits(self.0 & !COUNT_BITS), count, jumped }
    }
}

/// Averages and keeps.
#[derive(Clone, Copy, Debug)]
pub struct MeasurementWindow {
    samples: [Packed; CAPACITY],
    /// Samples completed since the start.
    completed: u32,
    sum: f32,
    present: u8,
    steps: u32,
    /// The velocity error may have jumped since the last sample that is no gap.
    jumped: bool,
    /// Index after the newest sample that says so.
    after_jump: u32,
}

impl MeasurementWindow {
    /// An empty window.
    pub const fn new() -> Self {
        Self {
            samples: [Packed::GAP; CAPACITY],
            completed: 0,
            sum: 0.0,
            present: 0,
            steps: 0,
            jumped: false,
            after_jump: 0,
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.completed = 0;
        self.sum = 0.0;
        self.present = 0;
        self.steps = 0;
        self.jumped = false;
        self.after_jump = 0;
    }

    /// Where `condition` holds, the velocity error may have jumped before the next value.
    pub fn break_off_if(&mut self, condition: bool) {
        self.jumped |= condition;
    }

    /// Whether it may have jumped behind the samples before this index.
    pub fn jumps_after(&self, index: u32) -> bool {
        self.jumped | (index < self.after_jump)
    }

    /// Takes one step's value; true when it completed a sample.
    pub fn push(&mut self, value: Option<f32>) -> bool {
        self.sum += value.unwrap_or(0.0);
        self.present += u8::from(value.is_some());
        self.steps += 1;
        self.complete_if(self.steps == DECIMATION)
    }

    /// Takes up to [`LONGEST_SKIP`] steps without value; with the same work whatever their number.
    pub fn skip(&mut self, steps: u32) {
        let mut left = steps;
        for _ in 0..=LONGEST_SKIP / DECIMATION {
            let now = left.min(DECIMATION - self.steps);
            self.steps += now;
            left -= now;
            self.complete_if(self.steps == DECIMATION);
        }
    }

    /// Completes a sample where `condition` holds, which is given back.
    #[inline(always)]
    fn complete_if(&mut self, condition: bool) -> bool {
        // Fewer than half of the values are a gap: their mean would stand for the wrong instant.
        let enough = u32::from(self.present) * 2 >= DECIMATION;
        let count = select(enough, self.present, 0);
        let mean = select(enough, self.sum / f32::from(self.present.max(1)), 0.0);
        let jumped = self.jumped & enough;
        let index = self.completed as usize % CAPACITY;
        if let Some(slot) = self.samples.get_mut(index) {
            *slot = select(condition, Packed::new(Sample { mean, count, jumped }), *slot);
        }
        self.completed = self.completed.wrapping_add(u32::from(condition));
        self.after_jump = select(condition & jumped, self.completed, self.after_jump);
        self.jumped &= !(condition & enough);
        self.sum = select(condition, 0.0, self.sum);
        self.present = select(condition, 0, self.present);
        self.steps = select(condition, 0, self.steps);
        condition
    }

    /// Samples completed since the start: the index of the next one.
    pub fn completed(&self) -> u32 {
        self.completed
    }

    /// Steps taken of the sample that is being collected.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// The sample with the given index; a gap when it is not there (yet, or any more).
    pub fn sample(&self, index: u32) -> Sample {
        let there = index < self.completed && self.completed - index <= CAPACITY as u32;
        let slot = index as usize % CAPACITY;
        let kept = self.samples.get(slot).copied().unwrap_or(Packed::GAP);
        select(there, kept, Packed::GAP).sample()
    }
}

impl Default for MeasurementWindow {
    fn default() -> Self {
        Self::new()
    }
}

saved!([] MeasurementWindow {
    samples,
    completed,
    sum,
    present < DECIMATION,
    steps < DECIMATION,
    jumped,
    after_jump,
} always);

impl Saved for Packed {
    fn visit(&mut self, visitor: &mut Visitor<'_>) {
        self.0.visit(visitor);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use super::*;

    #[test]
    fn a_sample_is_the_mean_of_what_is_there() {
        let mut window = MeasurementWindow::new();
        for step in 0..10 {
            let complete = window.push((step % 2 == 0).then_some(step as f32));
            assert_eq!(complete, step == 9);
        }
        assert_eq!(window.sample(0), Sample { mean: 4.0, count: 5, jumped: false });
        assert_eq!(window.sample(1), Sample::default());
    }

    #[test]
    fn a_packed_sample_keeps_its_count_and_two_millionths_of_its_mean() {
        for mean in [0.0, 1e-30, -0.1, 0.333_333_34, -999.999_9, 1000.0] {
            for (count, jumped) in
                (0..=10).map(|count| (count, false)).chain((5..10).map(|count| (count, true)))
            {
                let back = Packed::new(Sample { mean, count, jumped }).sample();
                assert_eq!((back.count, back.jumped), (count, jumped));
                assert!((back.mean - mean).abs() <= 1e-6 * mean.abs());
            }
        }
    }

    #[test]
    fn a_skip_is_as_many_steps_without_value() {
        for skipped in [0, 1, 4, 9, 10, 11, 255, 599, 600] {
            for before in [0, 3, 7] {
                let (mut one, mut other) = (MeasurementWindow::new(), MeasurementWindow::new());
                for step in 0..before + 40 {
                    if step == before {
                        one.skip(skipped);
                        for _ in 0..skipped {
                            other.push(None);
                        }
                    }
                    assert_eq!(one.push(Some(step as f32)), other.push(Some(step as f32)));
                }
                assert_eq!((one.completed(), one.steps()), (other.completed(), other.steps()));
                for index in 0..one.completed() {
                    assert_eq!(one.sample(index), other.sample(index));
                }
            }
        }
    }

    #[test]
    fn fewer_than_half_is_a_gap() {
        let mut window = MeasurementWindow::new();
        for step in 0..10 {
            window.push((step < 4).then_some(1.0));
        }
        assert!(!window.sample(0).is_present());
    }

    /// The sample after a jump says so, over gaps; a bank has heard of it once it is behind that sample.
    #[test]
    fn a_jump_is_told_with_the_first_sample_behind_it() {
        for gaps in [0, 2] {
            let mut window = MeasurementWindow::new();
            (0..13).for_each(|_| assert!(!window.push(Some(1.0)) || window.completed() == 1));
            window.break_off_if(false);
            assert!(!window.jumps_after(0));
            window.break_off_if(true);
            assert!(window.jumps_after(1));
            window.skip(7 + 10 * gaps);
            assert!(window.jumps_after(window.completed()));
            (0..20).for_each(|_| {
                window.push(Some(2.0));
            });
            let told: Vec<bool> = (0..window.completed()).map(|index| window.sample(index).jumped).collect();
            let first = 2 + gaps as usize;
            assert!(told.iter().enumerate().all(|(index, &jumped)| jumped == (index == first)), "{told:?}");
            assert!(window.jumps_after(first as u32) && !window.jumps_after(first as u32 + 1));
            assert_eq!(window.sample(first as u32).count, 9);
        }
    }

    #[test]
    fn the_newest_samples_last() {
        let mut window = MeasurementWindow::new();
        for sample in 0..3000u32 {
            for _ in 0..10 {
                window.push(Some(sample as f32));
            }
        }
        assert_eq!(window.sample(2999).mean, 2999.0);
        assert_eq!(window.sample(184).mean, 184.0);
        assert!(!window.sample(183).is_present());
    }
}
