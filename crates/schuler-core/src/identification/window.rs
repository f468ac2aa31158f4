//! The measurements of the last hours, averaged over ten steps each.
//!
//! Input: one velocity error a step (m/s), or a gap. Output: means over [`DECIMATION`] steps with the number of
//! values in them, kept by absolute index while the newest [`CAPACITY`] last.

use crate::number::real;

/// Steps averaged into one sample, D.
pub const DECIMATION: u32 = 10;

/// Samples that one identification looks at, N: 5.7 h of 10 s means.
pub const WINDOW: u32 = 2048;

/// Samples kept: the window, and what arrives while an identification of it is under way.
pub const CAPACITY: usize = 2816;

/// The mean of up to [`DECIMATION`] values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Mean, m/s; zero in a gap.
    pub mean: f32,
    /// Values in it; zero in a gap.
    pub count: u8,
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

/// Averages and keeps.
#[derive(Clone, Copy, Debug)]
pub struct MeasurementWindow {
    means: [f32; CAPACITY],
    counts: [u8; CAPACITY],
    /// Samples completed since the start.
    completed: u32,
    sum: f32,
    present: u8,
    steps: u32,
}

impl MeasurementWindow {
    /// An empty window.
    pub const fn new() -> Self {
        Self { means: [0.0; CAPACITY], counts: [0; CAPACITY], completed: 0, sum: 0.0, present: 0, steps: 0 }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.completed = 0;
        self.sum = 0.0;
        self.present = 0;
        self.steps = 0;
    }

    /// Takes one step's value; true when it completed a sample.
    pub fn push(&mut self, value: Option<f32>) -> bool {
        self.sum += value.unwrap_or(0.0);
        self.present += u8::from(value.is_some());
        self.steps += 1;
        let complete = self.steps == DECIMATION;
        if complete {
            // Fewer than half of the values are a gap: their mean would stand for the wrong instant.
            let enough = u32::from(self.present) * 2 >= DECIMATION;
            let count = if enough { self.present } else { 0 };
            let mean = if enough { self.sum / f32::from(self.present.max(1)) } else { 0.0 };
            let index = self.completed as usize % CAPACITY;
            if let (Some(slot), Some(slot_count)) = (self.means.get_mut(index), self.counts.get_mut(index)) {
                *slot = mean;
                *slot_count = count;
            }
            self.completed = self.completed.wrapping_add(1);
            self.sum = 0.0;
            self.present = 0;
            self.steps = 0;
        }
        complete
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
        let mean = self.means.get(slot).copied().unwrap_or(0.0);
        let count = self.counts.get(slot).copied().unwrap_or(0);
        if there { Sample { mean, count } } else { Sample::default() }
    }
}

impl Default for MeasurementWindow {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_the_mean_of_what_is_there() {
        let mut window = MeasurementWindow::new();
        for step in 0..10 {
            let complete = window.push((step % 2 == 0).then_some(step as f32));
            assert_eq!(complete, step == 9);
        }
        assert_eq!(window.sample(0), Sample { mean: 4.0, count: 5 });
        assert_eq!(window.sample(1), Sample::default());
    }

    #[test]
    fn fewer_than_half_is_a_gap() {
        let mut window = MeasurementWindow::new();
        for step in 0..10 {
            window.push((step < 4).then_some(1.0));
        }
        assert!(!window.sample(0).is_present());
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
