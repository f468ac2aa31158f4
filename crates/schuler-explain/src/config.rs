//! Every number that decides, with its meaning and what moving it does.
use crate::explain::Error;

/// What decides an explanation.
#[derive(Clone, Debug)]
pub struct Config {
    /// Effects that a record is expected to have, before it is seen. Twice as many add 0.7 nats to every finding.
    pub expected_effects: f64,
    /// Probability, before it is seen, that a sensor has a step or a line that another one of its dimension has. A higher value
    /// takes more of what coincides for one cause.
    pub in_common: f64,
    /// Posterior probability from which on a finding is told. Nearer to 1 fewer weak effects are told, and fewer false ones.
    pub told_at: f64,
    /// Cosine coefficients at low frequency that are bands of their own.
    pub single_coefficients: usize,
    /// Ratio of the edges of the bands above them. Wider bands resolve spectra less and cost less.
    pub band_ratio: f64,
    /// Degrees of freedom ν of the level of a band, over which the evidence is averaged: 4 trusts a spectrum within a
    /// factor of two, infinity trusts it wholly.
    pub trust: Vec<f64>,
    /// Size of an effect in squared standard deviations at which the Cauchy prior of its amplitude begins to fall.
    /// A larger value takes nats from small effects and gives them to large ones.
    pub unit_information: f64,
    /// Nats that an amplitude loses a decade outside of its plausible range, by ln(1 + (this · decades)²).
    pub implausible_per_decade: f64,
    /// Part of its information that a signature must have left beside what is described.
    pub least_information_left: f64,
    /// Nats that a move must promise before prior odds to be fitted in full. A lower value fits more moves, and tells hardly more.
    pub least_promised: f64,
    /// Nats behind the best description beyond which what a move promises is not fitted: it would not be expanded. Less is quicker,
    /// and misses what a promise falls short of.
    pub within_reach: f64,
    /// Levels of white noise in part of the rows, at most.
    pub most_levels: usize,
    /// Innovation, in standard deviations, beyond which one counts as that much where levels are sought.
    pub largest_innovation: f64,
    /// Candidates of each kind of move that are fitted in full.
    pub fitted_moves: usize,
    /// Descriptions that are kept.
    pub beam: usize,
    /// Descriptions of the beam that are expanded.
    pub expanded: usize,
    /// Nats behind the best at which a description is not expanded any more.
    pub expanded_within: f64,
    /// Items of a description that reach one block, at most.
    pub most_items: usize,
    /// Rows before and after an onset, at least.
    pub least_segment: usize,
    /// Onsets at which the weighted energy of a step is computed in full; between them it is interpolated.
    pub onset_knots: usize,
    /// Periods of a line that the record has to hold, at least.
    pub least_periods: f64,
    /// Standard deviation of ln σ of a noise part before the record is seen, of its level.
    pub noise_level_range: f64,
    /// Rounds in which amplitudes, trust and noise are fitted in turn.
    pub fit_rounds: usize,
    /// Change of the log-likelihood, nats, at which they have converged.
    pub fit_tolerance: f64,
    /// Ratio of a fitted to the whitening spectrum from which on the record is whitened anew.
    pub whiten_again_at: f64,
    /// Probability of a member of a class below which it is not told.
    pub least_class_probability: f64,
    /// Logarithm of the odds of a fault in the readings of a sensor before they are seen.
    pub ln_odds_of_faults: f64,
    /// Whether the description is judged on stretches that were held out.
    pub hold_out: bool,
    /// Whether it is computed what could still hide.
    pub certify: bool,
    /// Probability with which an effect of the size of a bound of the certificate is found. Nearer to 1 bounds are larger: 0.999 adds 0.8
    /// standard deviations to those of 0.99.
    pub found_at: f64,
    /// Part of the places, times or frequencies of an effect in which its bound holds. At 1 it is that of a step in the last rows,
    /// which may be of any size.
    pub certified_part: f64,
}

impl Config {
    /// Logarithm of the odds from which on a finding is told.
    pub fn least_ln_odds(&self) -> f64 {
        (self.told_at / (1.0 - self.told_at)).ln()
    }

    /// Whether it can be worked with.
    ///
    /// # Errors
    /// [`Error::Config`] names the field that is out of range.
    pub fn check(&self) -> Result<(), Error> {
        let probabilities = [("probability", self.told_at), ("found_at", self.found_at)];
        match probabilities.into_iter().find(|(_, value)| !(*value > 0.0 && *value < 1.0)) {
            None => Ok(()),
            Some((name, value)) => {
                let (found, expected) = (value.to_string(), "a probability between 0 and 1");
                Err(Error::Config { name, found, expected })
            }
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            expected_effects: 1.0,
            in_common: 0.1,
            told_at: 0.95,
            single_coefficients: 8,
            band_ratio: 1.2,
            trust: vec![4.0, 16.0, 64.0, f64::INFINITY],
            unit_information: 50.0,
            implausible_per_decade: 1.0,
            least_information_left: 1e-6,
            least_promised: -2.0,
            within_reach: 30.0,
            most_levels: 3,
            largest_innovation: 4.0,
            fitted_moves: 8,
            beam: 20,
            expanded: 3,
            expanded_within: 6.0,
            most_items: 12,
            least_segment: 8,
            onset_knots: 24,
            least_periods: 4.0,
            noise_level_range: 6.9,
            fit_rounds: 8,
            fit_tolerance: 0.02,
            whiten_again_at: 3.0,
            least_class_probability: 0.01,
            ln_odds_of_faults: -7.0,
            hold_out: true,
            certify: true,
            found_at: 0.99,
            certified_part: 0.9,
        }
    }
}
