//! Whether the radio holds its last value ("memory" mode): a chain of two states beside those of the jump and the noise.
//!
//! A radio that has lost its signal may go on giving the last reading. The residual then holds what the vehicle does, which no
//! mode of the radio's noise explains; but that a reading repeats to the last digit tells it within a few steps. What the radio
//! says in the meantime says nothing of its error, so the residual is left aside.
use nalgebra::RealField;

use super::config::MemoryModel;
use crate::number::select;
use crate::saved::{Blank, saved};

/// Probability that the radio holds its last value, by Bayes' rule from one reading to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Memory<T> {
    /// Probability per step to begin to hold: zero where it is not looked for.
    fail: T,
    /// Probability per step to go on holding.
    stays: T,
    /// Probability that a reading of a radio that works repeats the one before.
    repeat: T,
    /// The last reading, m/s; anything before there is one, when a repetition is as good as none.
    last: T,
    probability: T,
}

impl<T: RealField + Copy> Memory<T> {
    /// Of a validated model; without one the probability is always zero.
    pub(super) fn new(model: Option<&MemoryModel<T>>) -> Self {
        let (zero, half) = (T::zero(), nalgebra::convert(0.5));
        let (fail, stays, repeat) =
            model.map_or((zero, zero, half), |it| (it.fail, T::one() - it.recover, it.repeat));
        Self { fail, stays, repeat, last: zero, probability: zero }
    }

    /// Forgets what it has heard.
    pub(super) fn restart(&mut self) {
        (self.last, self.probability) = (T::zero(), T::zero());
    }

    /// Takes a reading, m/s, if there is one that `counts`; the probability after it.
    pub(super) fn step(&mut self, reading: T, counts: bool) -> T {
        let one = T::one();
        let before = self.probability * self.stays + (one - self.probability) * self.fail;
        let repeats = reading == self.last;
        let held = select(repeats, before, T::zero());
        let working = (one - before) * select(repeats, self.repeat, one - self.repeat);
        self.probability = select(counts, held / (held + working), before);
        self.last = select(counts, reading, self.last);
        self.probability
    }
}

saved!([T: Blank] Memory<T> { fail, stays, repeat, last, probability });

#[cfg(test)]
mod tests {
    use super::*;

    fn model(repeat: f64) -> MemoryModel<f64> {
        MemoryModel { repeat, fail: 1.0 / 1800.0, recover: 1.0 / 120.0 }
    }

    #[test]
    fn a_value_that_is_held_is_told_within_steps_and_forgotten_in_one() {
        let mut memory = Memory::new(Some(&model(0.05)));
        for k in 0..100 {
            assert!(memory.step(f64::from(k) + 0.25, true) < 1e-3);
        }
        let told = (1..20).find(|_| memory.step(99.25, true) > 0.9);
        assert!(told.is_some_and(|steps| steps <= 4), "{told:?}");
        // Nothing heard for a while: it fades towards what it is without readings.
        for _ in 0..2000 {
            memory.step(99.25, false);
        }
        assert!((memory.probability - 0.0625).abs() < 1e-3, "{}", memory.probability);
        assert_eq!(memory.step(99.5, true), 0.0);
    }

    /// Bayes' rule by hand: the prior odds over the probability of a repetition.
    #[test]
    fn the_odds_of_a_repetition_are_those_of_bayes() {
        let mut memory = Memory::new(Some(&model(0.1)));
        memory.step(3.0, true);
        let fail = 1.0 / 1800.0;
        let odds: f64 = fail / (1.0 - fail) / 0.1;
        assert!((memory.step(3.0, true) - odds / (1.0 + odds)).abs() < 1e-15);
    }

    #[test]
    fn what_is_not_looked_for_is_not_found() {
        let mut memory = Memory::<f32>::new(None);
        assert!((0..100).all(|_| memory.step(7.0, true).to_bits() == 0));
    }
}
