//! How sharp the maximum is, and the narrow bank around it from which the main filter goes on.
use super::carry::{carried, difference, middle_to_end};
use super::limits::Limits;
use super::phase::Phase;
use super::workspace::{CENTRE, NARROW, Workspace};
use super::{LikelihoodIdentifier, Retuned};
use crate::filter::{FilterConfig, Kernel, MarkovNoise};
use crate::identification::bank::Grid;
use crate::identification::replay::Hypothesis;
use crate::identification::{ChannelStatus, IdentificationConfig};

/// Factor on τ, at constant diffusion, when the sharpness of the maximum is probed …
const PROBE_FACTOR: f32 = 3.0;
/// … and the drop below which the parameter counts as weakly determined.
const WEAK_DROP: f32 = 2.0;
/// A channel whose estimate keeps less than this share of the error's variance is not observed.
const OBSERVED_SHARE: f32 = 0.03;

impl LikelihoodIdentifier {
    /// Asks for the likelihood with one correlation time off, at constant diffusion.
    pub(super) fn begin_probe(
        &mut self,
        filter: &FilterConfig<f32>,
        config: &IdentificationConfig,
        probe: u8,
    ) {
        let factor = if probe.is_multiple_of(2) { PROBE_FACTOR } else { 1.0 / PROBE_FACTOR };
        let off = |noise: &MarkovNoise<f32>| MarkovNoise {
            sigma: noise.sigma * libm::sqrtf(factor),
            tau_s: noise.tau_s * factor,
        };
        let mut noise = self.found;
        match probe {
            0 | 1 => noise.accelerometer = off(&noise.accelerometer),
            2 | 3 => noise.gyro = off(&noise.gyro),
            _ => return self.judge(filter, config),
        }
        self.phase = Phase::Probe { probe };
        self.evaluate(filter, &noise);
    }

    /// Says how well the parameters are known, and lays the narrow bank around them.
    fn judge(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        let [up_a, down_a, up_w, down_w] = self.probes.map(|value| self.found_value - value);
        let sigma = [self.found.accelerometer.sigma, self.found.gyro.sigma];
        for (i, (up, down)) in [(up_a, down_a), (up_w, down_w)].into_iter().enumerate() {
            let observed = 1.0 - self.filter_variance[i] / (sigma[i] * sigma[i]);
            self.status[i] = if observed < OBSERVED_SHARE {
                ChannelStatus::Unobserved
            } else if up < WEAK_DROP && down < WEAK_DROP {
                ChannelStatus::Indeterminate
            } else if up < WEAK_DROP || down < WEAK_DROP {
                ChannelStatus::Weak
            } else {
                ChannelStatus::Determined
            };
        }
        // What is not observed is not retuned.
        if self.status[0] == ChannelStatus::Unobserved {
            self.found.accelerometer = self.in_use.accelerometer;
        }
        if self.status[1] == ChannelStatus::Unobserved {
            self.found.gyro = self.in_use.gyro;
        }
        let limits = Limits::new(filter, config);
        let grid = |noise: &MarkovNoise<f32>, status: ChannelStatus| -> Grid<3> {
            let (sigma_step, tau_step) =
                if status == ChannelStatus::Determined { (0.5, 1.0) } else { (0.8, 1.6) };
            [-1.0_f32, 0.0, 1.0].map(|tau| {
                [-1.0_f32, 0.0, 1.0].map(|sigma| {
                    let tau_s = noise.tau_s * libm::expf(tau * tau_step);
                    limits
                        .clip_tau(MarkovNoise { sigma: noise.sigma * libm::expf(sigma * sigma_step), tau_s })
                })
            })
        };
        let (found, status) = (self.found, self.status);
        let spare = self.spare();
        if let Some(workspace) = self.places.get_mut(spare) {
            workspace.empty(false);
        }
        if let Some(bank) = self.places.get_mut(spare).and_then(Workspace::bank_mut) {
            bank.lay(filter, grid(&found.accelerometer, status[0]), grid(&found.gyro, status[1]));
        }
        self.populate(filter, 0);
    }

    /// Replays the window for one member of the narrow bank after the other.
    pub(super) fn populate(&mut self, filter: &FilterConfig<f32>, member: u8) {
        let spare = self.spare();
        if usize::from(member) < NARROW {
            let bank = self.places.get(spare).and_then(Workspace::bank);
            let noise = bank.map_or(self.found, |bank| bank.noise(usize::from(member)));
            self.phase = Phase::Populate { member };
            self.evaluate(filter, &noise);
        } else {
            if let Some(bank) = self.places.get_mut(spare).and_then(Workspace::bank_mut) {
                bank.start_at(self.stretch.end);
            }
            if let Some(coloured) = self.coloured {
                self.coloured_replay.begin(filter, &self.window, self.stretch, &coloured);
            }
            self.phase = Phase::CatchUp;
        }
    }

    /// Puts the narrow bank to use; the main filter goes on from its central member.
    pub(super) fn activate(&mut self, filter: &FilterConfig<f32>, bank: u8) -> Option<Retuned> {
        let narrow = self.places.get(usize::from(bank))?.bank()?;
        let age_s = middle_to_end(filter);
        let mut state = *narrow.member_state(CENTRE)?;
        state.predict(&self.found.model(filter, age_s));
        self.correction = difference(carried(filter, narrow.mixture().mean, age_s), state.mean);
        self.active = Some(bank);
        self.in_use = self.found;
        self.retunes = self.retunes.saturating_add(1);
        self.phase = Phase::Waiting;
        let coloured = self.coloured.zip(self.coloured_replay.state()).map(|(noise, state)| {
            let mut state = *state;
            state.predict(&noise.model(filter, age_s));
            (noise, state)
        });
        Some(Retuned { noise: self.found, state, coloured })
    }
}
