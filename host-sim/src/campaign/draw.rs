//! Draws that decide what a case is, all from one stream of the case's seed.
use crate::physics::environment::Profile;
use crate::physics::random::Stream;

/// The stream of decisions.
#[derive(Clone, Debug)]
pub struct Draw(Stream);

impl Draw {
    /// The decisions called `name` of the case with this seed.
    pub fn new(seed: u64, name: &str) -> Self {
        Self(Stream::new(seed, &format!("case/{name}")))
    }

    /// Uniform between two values.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.uniform()
    }

    /// Uniform in the logarithm between two positive values.
    pub fn log_between(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// True with a probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.uniform() < probability
    }

    /// Plus or minus one.
    pub fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    /// A standard normal number.
    pub fn normal(&mut self) -> f64 {
        self.0.normal()
    }

    /// An index below `n`; zero for none.
    pub fn index(&mut self, n: usize) -> usize {
        ((self.0.uniform() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// One of several.
    #[expect(clippy::needless_pass_by_value, reason = "lists stand where they are used")]
    pub fn pick<T: Clone, const N: usize>(&mut self, several: [T; N]) -> T {
        let index = self.index(N);
        several[index].clone()
    }

    /// A quantity that wanders about a value as a room does: corners every so often, of a correlated walk.
    pub fn wander(&mut self, about: f64, spread: f64, every_s: f64, duration_s: f64) -> Profile {
        let corners = ((duration_s / every_s).ceil() as usize).clamp(3, 4000);
        let memory: f64 = 0.8;
        let mut deviation = self.normal();
        let points = (0..=corners).map(|k| {
            deviation = memory * deviation + (1.0 - memory * memory).sqrt() * self.normal();
            (duration_s * k as f64 / corners as f64, about + spread * deviation)
        });
        Profile { points: points.collect(), amplitude: 0.0, period_s: 1.0 }
    }
}
