//! Faults of a sensor's output, injected between its read-out and the recording.
use super::random::Stream;

/// What goes wrong. Units: the output's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// A jump of this size.
    Step(f64),
    /// A drift that grows at this rate per second.
    Ramp(f64),
    /// The output stays at its last value.
    Stuck,
    /// White noise of this standard deviation per reading is added.
    Noise(f64),
    /// No reading; with this probability each step.
    Dropout(f64),
    /// The gain changes by this much.
    Gain(f64),
}

/// A fault and when it acts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedFault {
    /// What goes wrong.
    pub fault: Fault,
    /// From this time on, s.
    pub onset_s: f64,
    /// Until this time; infinite for good.
    pub end_s: f64,
}

/// The faults of one output at work.
#[derive(Clone, Debug)]
pub struct Faults {
    timed: Vec<TimedFault>,
    held: f64,
    stream: Stream,
}

impl Faults {
    /// The faults of the output called `name` of the run with this seed.
    pub fn new(faults: Vec<TimedFault>, seed: u64, name: &str) -> Self {
        Self { timed: faults, held: 0.0, stream: Stream::new(seed, &format!("{name}/fault")) }
    }

    /// What is left of a reading; none when it is lost.
    pub fn apply(&mut self, time_s: f64, reading: f64) -> Option<f64> {
        let mut told = Some(reading);
        let mut stuck = false;
        for timed in &self.timed {
            // Every fault draws every step, so that its timing changes nothing else.
            let (normal, uniform) = (self.stream.normal(), self.stream.uniform());
            if time_s < timed.onset_s || time_s >= timed.end_s {
                continue;
            }
            match timed.fault {
                Fault::Step(size) => told = told.map(|v| v + size),
                Fault::Ramp(rate) => told = told.map(|v| v + rate * (time_s - timed.onset_s)),
                Fault::Noise(sigma) => told = told.map(|v| v + sigma * normal),
                Fault::Gain(change) => told = told.map(|v| v * (1.0 + change)),
                Fault::Stuck => stuck = true,
                Fault::Dropout(probability) => told = told.filter(|_| uniform >= probability),
            }
        }
        if stuck {
            return Some(self.held);
        }
        if let Some(value) = told {
            self.held = value;
        }
        told
    }

    /// Whether any fault acts.
    pub fn active(&self, time_s: f64) -> bool {
        self.timed.iter().any(|f| time_s >= f.onset_s && time_s < f.end_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(fault: Fault) -> Vec<Option<f64>> {
        let timed = TimedFault { fault, onset_s: 5.0, end_s: 8.0 };
        let mut faults = Faults::new(vec![timed], 1, "x");
        (0..10).map(|k| faults.apply(f64::from(k), f64::from(k))).collect()
    }

    #[test]
    fn faults_act_in_their_time_and_only_then() {
        let clean: Vec<_> = (0..10).map(|k| Some(f64::from(k))).collect();
        for fault in [
            Fault::Step(2.0),
            Fault::Ramp(0.5),
            Fault::Stuck,
            Fault::Noise(1.0),
            Fault::Dropout(1.0),
            Fault::Gain(0.1),
        ] {
            let told = told(fault);
            assert_eq!(told[..5], clean[..5], "{fault:?}");
            assert_eq!(told[8..], clean[8..], "{fault:?}");
            assert_ne!(told[5..8], clean[5..8], "{fault:?}");
        }
        assert_eq!(told(Fault::Step(2.0))[6], Some(8.0));
        assert_eq!(told(Fault::Ramp(0.5))[7], Some(8.0));
        assert_eq!(told(Fault::Stuck)[5..8], [Some(4.0); 3]);
        assert_eq!(told(Fault::Dropout(1.0))[5..8], [None; 3]);
    }
}
