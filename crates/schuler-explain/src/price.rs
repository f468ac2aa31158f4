//! What a gain is worth: how improbable it is where nothing is hidden, over all the places where it was sought.
use statrs::consts::EULER_MASCHERONI;
use statrs::function::gamma::digamma;

use crate::catalogue::{Candidate, Search};
use crate::statistics::ln_chi_squared_tail;

/// By what a gain is judged.
#[derive(Clone, Copy, Debug)]
pub struct Price {
    /// Degrees of freedom.
    pub freedom: usize,
    /// ln of the number of independent places that gains of records without the effect show to have been searched.
    pub ln_places: f64,
    /// Parameters sought in a continuum, of which larger gains know more places.
    pub continuous: usize,
    /// Most evidence that a gain may be, which is that of what is the effect's own in it.
    pub most: f64,
}

impl Price {
    /// Of a candidate that was sought in so many places.
    pub fn of(candidate: &Candidate, freedom: usize, ln_places: f64) -> Self {
        Self { freedom, ln_places, continuous: continuous(candidate), most: f64::INFINITY }
    }

    /// Of what was sought in so many places, and in no continuum.
    pub fn among(freedom: usize, ln_places: f64) -> Self {
        Self { freedom, ln_places, continuous: 0, most: f64::INFINITY }
    }

    /// −ln p of a gain.
    pub fn evidence(&self, gain: f64) -> f64 {
        let alone = -ln_chi_squared_tail(2.0 * gain, self.freedom);
        (alone - ln_places_at(alone, self.ln_places, self.continuous)).clamp(0.0, self.most)
    }
}

/// Number of parameters of a candidate that are sought in a continuum.
pub fn continuous(candidate: &Candidate) -> usize {
    match &candidate.search {
        Search::Grid { parameters, .. } => parameters.len(),
        _ => 0,
    }
}

/// ln of the number of places among which the best shows x = −ln p, of K that records without an effect show.
///
/// A gain along a continuous parameter that is crossed upwards at a rate V√x/π of the probability of one place grows so (Davies,
/// Biometrika 74, 1987, 33, eq. 3.4): 1 + (K − 1)(x/x̄)^½ for each parameter, x̄ = ψ(K + 1) + γ being what the best of K shows on average.
pub fn ln_places_at(alone: f64, ln_places: f64, continuous: usize) -> f64 {
    if continuous == 0 || ln_places <= 0.0 {
        return ln_places;
    }
    let places = ln_places.exp();
    let usual = digamma(places + 1.0) + EULER_MASCHERONI;
    let growth = (alone / usual).max(1.0).powf(0.5 * continuous as f64);
    ((places - 1.0) * growth).ln_1p()
}

/// ln K for which ψ(K + 1) + γ = `mean`.
pub fn ln_number_of_mean(mean: f64) -> f64 {
    let target = mean - EULER_MASCHERONI;
    let (mut low, mut high) = (0.0_f64, 20.0_f64);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if digamma(middle.exp() + 1.0) < target {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::ln_chi_squared_tail;

    /// The largest of the squares of cos θ·a + sin θ·b over an arc of angles, a and b standard normal, has a known law: that of a² + b²
    /// where its direction lies in the arc, and of the nearer end beside it.
    #[test]
    fn places_along_an_arc_grow_as_they_do() {
        let arc = 1.2_f64;
        // ∫ over directions of the probability that r² cos²(distance to the arc) exceeds u.
        let exact = |u: f64| {
            let inside = arc / std::f64::consts::PI * (-0.5 * u).exp();
            let steps = 4000;
            let half = 0.5 * (std::f64::consts::PI - arc);
            let beside: f64 = (0..steps)
                .map(|step| {
                    let away = half * (step as f64 + 0.5) / steps as f64;
                    (-0.5 * u / away.cos().powi(2)).exp() * half / steps as f64
                })
                .sum();
            inside + 2.0 * beside / std::f64::consts::PI
        };
        let ln_places_of = |gain: f64| exact(2.0 * gain).ln() - ln_chi_squared_tail(2.0 * gain, 1);
        let alone = |gain: f64| -ln_chi_squared_tail(2.0 * gain, 1);
        // From a usual gain to those of what is beyond doubt.
        let from = ln_places_of(1.0);
        for gain in [10.0, 30.0, 100.0, 250.0] {
            let grown = ln_places_at(alone(gain), from, 1);
            assert!((grown - ln_places_of(gain)).abs() < 0.35, "{gain}: {grown} {}", ln_places_of(gain));
            assert!((from - ln_places_of(gain)).abs() > 0.35, "{gain}: nothing to grow");
        }
        assert!(ln_places_at(1e3, from, 0) == from && ln_places_at(1e3, 0.0, 1) == 0.0);
    }

    #[test]
    fn number_of_places_is_that_of_its_mean() {
        for places in [1.0_f64, 3.0, 40.0] {
            let mean = digamma(places + 1.0) + EULER_MASCHERONI;
            assert!((ln_number_of_mean(mean) - places.ln()).abs() < 1e-6);
        }
    }
}
