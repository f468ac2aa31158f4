//! The published read-out at the maximum, channel by channel.
use super::LikelihoodIdentifier;
use super::limits::Limits;
use super::phase::Phase;
use super::workspace::Workspace;
use crate::filter::{FilterConfig, MarkovNoise};
use crate::identification::IdentificationConfig;
use crate::identification::read_out::PASSES;
use crate::identification::replay::Stretch;
use crate::identification::window::DECIMATION;

impl LikelihoodIdentifier {
    pub(super) fn next_pass(&mut self, filter: &FilterConfig<f32>, pass: u8) {
        if usize::from(pass) < PASSES {
            let Stretch { begin, end, .. } = self.stretch;
            let found = self.found;
            let spare = self.spare();
            if let Some(workspace) = self.places.get_mut(spare) {
                if workspace.bank().is_some() {
                    workspace.empty(true);
                }
                if let Some(read_out) = workspace.read_out() {
                    if pass == 0 {
                        read_out.clear();
                    }
                    let start = end.wrapping_sub(begin) / 8;
                    read_out.begin_pass(usize::from(pass), begin.wrapping_add(start));
                }
            }
            self.evaluate(filter, &found);
            self.phase = Phase::ReadOut { pass };
        } else {
            self.phase = Phase::Fit { channel: 0 };
        }
    }

    /// Fits the read-out of one channel and has it checked against the likelihood.
    pub(super) fn fit(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, channel: u8) {
        let spacing_s = filter.step_s * DECIMATION as f32;
        let spare = self.spare();
        let Some(read_out) = self.places.get_mut(spare).and_then(Workspace::read_out) else { return };
        let read = read_out.fit(usize::from(channel), spacing_s);
        if let Some(slot) = self.filter_variance.get_mut(usize::from(channel)) {
            *slot = read.filter_variance;
        }
        if let Some(slot) = self.cosine.get_mut(usize::from(channel)) {
            *slot = read.cosine;
        }
        let Some(fit) = read.exponential else {
            return self.after_check(filter, config, channel);
        };
        let noise =
            MarkovNoise { sigma: libm::sqrtf(fit.variance + read.filter_variance), tau_s: 1.0 / fit.alpha };
        let mut candidate = self.found;
        if channel == 0 {
            candidate.accelerometer = noise;
        } else {
            candidate.gyro = noise;
        }
        self.phase = Phase::Check { channel };
        self.evaluate(filter, &Limits::new(filter, config).clip_both(&candidate));
    }

    pub(super) fn after_check(
        &mut self,
        filter: &FilterConfig<f32>,
        config: &IdentificationConfig,
        channel: u8,
    ) {
        if channel == 0 {
            self.phase = Phase::Fit { channel: 1 };
        } else {
            self.coloured = None;
            self.coloured_value = f32::NEG_INFINITY;
            self.begin_coloured(filter, config, 0);
        }
    }
}
