//! The search for an exponential-cosine in either channel.
use super::LikelihoodIdentifier;
use super::limits::{LONGEST_TAU_S, prior};
use super::phase::Phase;
use super::search::SEARCH_TOLERANCE;
use crate::filter::{ColouredNoise, FilterConfig, MarkovNoise};
use crate::identification::IdentificationConfig;
use crate::identification::bank::ChannelNoise;
use crate::identification::replay::ColouredChannels;
use crate::identification::simplex::Simplex;
use crate::identification::window::DECIMATION;

/// Periods at which a swing is looked for before the search with six states, s, with α as a share of β.
const SCANNED_PERIODS_S: [f32; 5] = [300.0, 600.0, 1200.0, 2400.0, 4800.0];
const SCANNED_DAMPING: f32 = 0.2;
/// The scan is over.
const SCANNED: u8 = u8::MAX;
/// Edge of the first simplex and evaluations of the search with six states.
const COLOURED_STEP: f32 = 0.4;
const COLOURED_EVALUATIONS: u16 = 60;
/// After so many evaluations without reaching the first-order likelihood the search with six states ends.
const COLOURED_PATIENCE: u16 = 20;
/// What two more states must gain in the log-likelihood.
///
/// The best of two searches over three more parameters gains more than 3 in one of twenty identifications of
/// first-order sensors, and 5.3 was the most in 145; a swing that is there gains 8 to 30 in four hours.
const COLOURED_GAIN: f32 = 7.0;

impl LikelihoodIdentifier {
    /// Begins the search with six states for one channel; after both, takes the better of the two if it is worth
    /// it. What one sensor's swing does to the velocity another's can nearly do, so each is tried on its own.
    pub(super) fn begin_coloured(
        &mut self,
        filter: &FilterConfig<f32>,
        config: &IdentificationConfig,
        channel: u8,
    ) {
        if channel <= 1 {
            self.coloured_best = (ColouredChannels::from(&self.found), f32::NEG_INFINITY);
            return self.begin_scan(filter, channel, 0);
        }
        self.begin_probe(filter, config, 0);
    }

    /// Evaluates point number `scan`: swings of several periods with the other channel as it was found, the same
    /// with the other channel as it is flown (for the first-order search may have bent it to follow the swing), and
    /// the swing that the read-out shows.
    fn begin_scan(&mut self, filter: &FilterConfig<f32>, channel: u8, scan: u8) {
        let own = |noise: &ChannelNoise| if channel == 0 { noise.accelerometer } else { noise.gyro };
        let other = |noise: &ChannelNoise| if channel == 0 { noise.gyro } else { noise.accelerometer };
        let (found, flown) = (self.found, self.in_use);
        let scan_index = usize::from(scan);
        let periods = SCANNED_PERIODS_S.len();
        let point = if let Some(period_s) = SCANNED_PERIODS_S.get(scan_index % periods)
            && scan_index < 2 * periods
        {
            let beta = core::f32::consts::TAU / period_s;
            let base = if scan_index < periods { &found } else { &flown };
            let noise = ColouredNoise { sigma: own(&found).sigma, alpha: SCANNED_DAMPING * beta, beta };
            Some((noise, other(base)))
        } else {
            self.cosine[usize::from(channel & 1)].filter(|_| scan_index == 2 * periods).map(|cosine| {
                let variance = cosine.variance + self.filter_variance[usize::from(channel & 1)];
                let noise =
                    ColouredNoise { sigma: libm::sqrtf(variance), alpha: cosine.alpha, beta: cosine.beta };
                (noise, other(&found))
            })
        };
        if let Some((noise, other)) = point {
            self.phase = Phase::Coloured { channel, scan };
            let other = ColouredNoise::from(&other);
            self.evaluate_coloured(
                filter,
                channel,
                [noise.sigma, noise.alpha, noise.beta, other.sigma, other.alpha],
            );
        } else {
            let ColouredChannels { accelerometer, gyro } = self.coloured_best.0;
            let (own, other) = if channel == 0 { (accelerometer, gyro) } else { (gyro, accelerometer) };
            let start = [own.sigma, own.alpha, own.beta, other.sigma, other.alpha].map(libm::logf);
            self.coloured_simplex = Simplex::new(start, COLOURED_STEP);
            self.phase = Phase::Coloured { channel, scan: SCANNED };
            self.evaluate_coloured(filter, channel, self.coloured_simplex.wanted().map(libm::expf));
        }
    }

    /// Begins a replay with one channel's σ, α, β and the other's σ, α as given.
    fn evaluate_coloured(&mut self, filter: &FilterConfig<f32>, channel: u8, point: [f32; 5]) {
        let [sigma, alpha, beta, other_sigma, other_alpha] = point;
        // Slower than the window or faster than the sampling can show, there is no swing.
        let sample_s = filter.step_s * DECIMATION as f32;
        let within = |alpha: f32| alpha.min(2.0 / sample_s).max(1.0 / LONGEST_TAU_S);
        let beta = beta.min(core::f32::consts::FRAC_PI_2 / sample_s);
        let own = ColouredNoise { sigma, alpha: within(alpha), beta };
        let other = ColouredNoise { sigma: other_sigma, alpha: within(other_alpha), beta: 0.0 };
        let (accelerometer, gyro) = if channel == 0 { (own, other) } else { (other, own) };
        self.coloured_candidate = ColouredChannels { accelerometer, gyro };
        let candidate = self.coloured_candidate;
        self.coloured_replay.begin(filter, &self.window, self.stretch, &candidate);
    }

    /// A replay with six states is complete.
    pub(super) fn coloured_evaluated(
        &mut self,
        filter: &FilterConfig<f32>,
        config: &IdentificationConfig,
        channel: u8,
        scan: u8,
    ) {
        let candidate = self.coloured_candidate;
        let markov =
            |noise: &ColouredNoise<f32>| MarkovNoise { sigma: noise.sigma, tau_s: 1.0 / noise.alpha };
        let of_first_order =
            ChannelNoise { accelerometer: markov(&candidate.accelerometer), gyro: markov(&candidate.gyro) };
        let value = self.coloured_replay.log_likelihood() + prior(filter, config, &of_first_order);
        if value > self.coloured_best.1 {
            self.coloured_best = (candidate, value);
        }
        if scan < SCANNED {
            return self.begin_scan(filter, channel, scan + 1);
        }
        let simplex = &mut self.coloured_simplex;
        simplex.report(value);
        let hopeless = simplex.evaluations() >= COLOURED_PATIENCE && self.coloured_best.1 < self.found_value;
        let going_on = simplex.spread() > SEARCH_TOLERANCE && simplex.evaluations() < COLOURED_EVALUATIONS;
        if going_on && !hopeless {
            let point = simplex.wanted().map(libm::expf);
            return self.evaluate_coloured(filter, channel, point);
        }
        let (best, value) = self.coloured_best;
        if value >= self.coloured_value.max(self.found_value + COLOURED_GAIN) {
            self.coloured = Some(best);
            self.coloured_value = value;
        }
        self.begin_coloured(filter, config, channel + 1);
    }
}
