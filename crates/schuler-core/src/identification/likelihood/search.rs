//! The search for the maximum of the likelihood of the window.
use super::LikelihoodIdentifier;
use super::limits::{Limits, prior};
use super::phase::Phase;
use super::workspace::Workspace;
use crate::filter::FilterConfig;
use crate::identification::bank::ChannelNoise;
use crate::identification::read_out::LAGS;
use crate::identification::replay::Stretch;
use crate::identification::simplex::Simplex;
use crate::identification::window::WINDOW;
use crate::identification::{IdentificationConfig, steps_in};
use crate::number::select;

/// Samples replayed per step.
pub(super) const REPLAY_SAMPLES: u32 = 256;
/// Samples not replayed in a step that has built the wide bank: that, and what else a jump of the clock restarts, takes as long.
const LAYING_SAMPLES: u32 = 91;
/// Edge of the first simplex, in the logarithms of the parameters.
const SEARCH_STEP: f32 = 0.7;
/// A search ends when the values of its simplex differ by less than this, nats.
pub(super) const SEARCH_TOLERANCE: f32 = 0.02;
/// Evaluations per search, the first time and later.
const FIRST_EVALUATIONS: u16 = 200;
const LATER_EVALUATIONS: u16 = 120;
/// What the log-likelihood may drop by when the read-out replaces a channel's parameters.
const READ_OUT_DROP: f32 = 1.0;
/// Correlation times of the accelerometer error that must fit into the time before the first identification.
const FIRST_TAUS: f32 = 20.0;
/// Samples without which an identification is not begun: four times the lags of the read-out.
const LEAST_SAMPLES: u32 = 4 * LAGS as u32;
/// Samples of the longest gap that the module bridges.
const LONGEST_GAP: u32 = 60;
/// The bank's grid knows a correlation time only to a factor of ten, so the wait for them has a limit, as a multiple of
/// the configured time.
const FIRST_PATIENCE: f32 = 1.25;

impl LikelihoodIdentifier {
    /// Begins an identification when it is due.
    pub(super) fn wait(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        let completed = self.window.completed();
        let posterior = self.wide.mixture().log_mean;
        let enough_s = FIRST_TAUS * libm::expf(posterior[1]);
        let first = self.retunes == 0;
        let early =
            first && (self.steps as f32) * filter.step_s < enough_s.min(FIRST_PATIENCE * config.first_s);
        if self.steps < self.due || early || completed < LEAST_SAMPLES {
            // The step's work is done all the same, and counts for nothing: the worst case is the only case.
            let samples = select(self.laid, REPLAY_SAMPLES - LAYING_SAMPLES, REPLAY_SAMPLES);
            self.laid = false;
            if self.replay.advance(&self.window, samples, None) {
                self.stretch = self.whole_window();
                let in_use = self.in_use;
                self.evaluate(filter, &in_use);
            }
            return;
        }
        self.stretch = self.whole_window();
        self.found_value = f32::NEG_INFINITY;
        self.cosine = [None; 2];
        self.due = self.steps.saturating_add(steps_in(config.interval_s, filter.step_s));
        self.begin_search(filter, config, 0);
    }

    /// The newest [`WINDOW`] samples; one that does not begin at power-on begins with a measurement, from which
    /// the velocity starts.
    pub(super) fn whole_window(&self) -> Stretch {
        let end = self.window.completed();
        let mut begin = end.saturating_sub(WINDOW);
        let from_start = (begin == 0) & !self.restarted;
        for _ in 0..LONGEST_GAP {
            let gap = !from_start && !self.window.sample(begin).is_present();
            begin += u32::from(gap && begin < end);
        }
        Stretch { begin, end, from_start }
    }

    pub(super) fn begin_search(
        &mut self,
        filter: &FilterConfig<f32>,
        config: &IdentificationConfig,
        start: u8,
    ) {
        let from = match start {
            0 => self.wide.mixture().log_mean,
            1 => self.wide.mixture().best,
            _ => self.in_use.logarithms(),
        };
        self.simplex = Simplex::new(from, SEARCH_STEP);
        self.phase = Phase::Search { start };
        self.evaluate_simplex_point(filter, config);
    }

    fn evaluate_simplex_point(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        let noise = ChannelNoise::from_logarithms(self.simplex.wanted());
        self.evaluate(filter, &Limits::new(filter, config).clip_both(&noise));
    }

    pub(super) fn evaluate(&mut self, filter: &FilterConfig<f32>, noise: &ChannelNoise) {
        self.candidate = *noise;
        self.replay.begin(filter, &self.window, self.stretch, noise);
    }

    /// A replay for its likelihood is complete.
    pub(super) fn evaluated(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        let value = self.replay.log_likelihood() + prior(filter, config, &self.candidate);
        match self.phase {
            Phase::Search { start } => self.searched(filter, config, start, value),
            Phase::Check { channel } => {
                if value >= self.found_value - READ_OUT_DROP {
                    self.found = self.candidate;
                }
                self.after_check(filter, config, channel);
            }
            Phase::Probe { probe } => {
                if let Some(slot) = self.probes.get_mut(usize::from(probe)) {
                    *slot = value;
                }
                self.begin_probe(filter, config, probe + 1);
            }
            Phase::Populate { member } => {
                let spare = self.spare();
                let bank = self.places.get_mut(spare).and_then(Workspace::bank_mut);
                if let (Some(bank), Some(state)) = (bank, self.replay.state()) {
                    bank.start_member(usize::from(member), state, value - self.found_value);
                }
                self.populate(filter, member + 1);
            }
            Phase::Waiting
            | Phase::ReadOut { .. }
            | Phase::Fit { .. }
            | Phase::Coloured { .. }
            | Phase::CatchUp => {}
        }
    }

    fn searched(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, start: u8, value: f32) {
        self.simplex.report(value);
        let first = self.retunes == 0;
        let most = if first { FIRST_EVALUATIONS } else { LATER_EVALUATIONS };
        if self.simplex.spread() > SEARCH_TOLERANCE && self.simplex.evaluations() < most {
            self.evaluate_simplex_point(filter, config);
            return;
        }
        let (point, best) = self.simplex.best();
        if best > self.found_value {
            self.found_value = best;
            self.found = Limits::new(filter, config).clip_both(&ChannelNoise::from_logarithms(point));
        }
        let starts = if first { 2 } else { 3 };
        if start + 1 < starts {
            self.begin_search(filter, config, start + 1);
        } else if self.found_value.is_finite() {
            self.next_pass(filter, 0);
        } else {
            // Not one filter held: nothing has been learned, the parameters stay.
            self.phase = Phase::Waiting;
        }
    }
}
