//! Identification by likelihood, with the published read-out: level B.
//!
//! Beside the 1 Hz filter, in fixed memory and in fixed quanta of work per step:
//!
//! 1. keep ten-step means of the measurement ([`MeasurementWindow`]);
//! 2. run a wide bank of 225 filters over them ([`FilterBank`]), which gives the estimate while nothing better is
//!    known, and the starts of the search;
//! 3. from time to time, climb to the maximum of the likelihood of the window plus a wide prior about the data
//!    sheet ([`Simplex`]);
//! 4. replay the window there and read the parameters out by the published formulas ([`ReadOut`]), accepted
//!    channel by channel where the likelihood does not drop by more than one;
//! 5. look for an exponential-cosine in either channel: climb to the maximum of the likelihood with two more
//!    states, and keep them where the gain is beyond chance;
//! 6. probe how sharp the maximum is, and say so;
//! 7. start a narrow bank of 81 filters around the result on the window, retune the main filter from its central
//!    member, and let its mixture carry what uncertainty of the parameters is left.
//!
//! The published loop alone ([`super::PublishedLoop`]) does not converge; why stands there.
use super::bank::{ChannelNoise, FilterBank, Grid, Mixture, PARTS};
use super::replay::{ColouredChannels, DIFFUSE, Hypothesis, Replay, Stretch};
use super::simplex::Simplex;
use super::structure::ExponentialCosine;
use super::window::{DECIMATION, MeasurementWindow};
use super::{AveragedEstimate, ChannelStatus, EstimateSource, IdentificationConfig, steps_in};
use crate::filter::{ColouredGaussian, ColouredNoise, FilterConfig, Gaussian, MarkovNoise};
use crate::saved::saved;

use carry::{aged, carried, difference, middle_to_end};
use limits::{Limits, prior};
use phase::Phase;
use search::REPLAY_SAMPLES;
use workspace::{NARROW, Workspace};

mod carry;
mod coloured;
mod limits;
mod phase;
mod published;
mod retune;
mod search;
mod workspace;

/// Samples replayed per step while lagged products are collected.
const READ_OUT_SAMPLES: u32 = 192;
/// Samples replayed per step with six states.
const COLOURED_SAMPLES: u32 = 80;
/// Members worked on in vain in a step that starts members: with them it takes as long as one without.
const BEGINNING_IN_VAIN: usize = 10;
/// Parts of the narrow bank's work done per step while it catches up, nine a sample: as many as take no longer than a replay.
const CATCH_UP_PARTS: usize = 25;
/// The wide bank: five diffusions and three rates per channel.
type WideBank = FilterBank<5, WIDE>;
const WIDE: usize = 225;

/// New parameters for the main filter, with its state under them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retuned {
    /// The parameters of first order.
    pub noise: ChannelNoise,
    /// The state under them at present.
    pub state: Gaussian<f32>,
    /// The parameters and the state with six states, where an exponential-cosine was accepted.
    pub coloured: Option<(ColouredChannels, ColouredGaussian<f32>)>,
}

/// The likelihood identifier's whole state. About 37 kB: keep it where it is built.
#[derive(Clone, Copy, Debug)]
pub struct LikelihoodIdentifier {
    window: MeasurementWindow,
    wide: WideBank,
    /// Members of the wide bank that have been started.
    begun: usize,
    /// This step has built the wide bank.
    laid: bool,
    /// Means and standard deviations of ΔV, m/s, and δ, rad, that its members start from.
    first: [[f32; 2]; 2],
    /// They are those of a start in the midst of a flight.
    restarted: bool,
    places: [Workspace; 2],
    /// Index of the workspace of the narrow bank in use, once there is one.
    active: Option<u8>,
    simplex: Simplex<4, 5>,
    coloured_simplex: Simplex<5, 6>,
    replay: Replay<ChannelNoise>,
    coloured_replay: Replay<ColouredChannels>,
    phase: Phase,
    stretch: Stretch,
    steps: u64,
    /// Step at which the next identification is due.
    due: u64,
    /// What the filter flies with.
    in_use: ChannelNoise,
    status: [ChannelStatus; 2],
    retunes: u16,
    /// Mean of the main filter when the last sample was completed …
    at_sample: [f32; 4],
    /// … and how far the narrow bank's mixture was from it.
    correction: [f32; 4],
    /// Found so far in this identification, and the log-likelihood (with prior) there.
    found: ChannelNoise,
    found_value: f32,
    /// Read-out of the channel that is being checked.
    candidate: ChannelNoise,
    filter_variance: [f32; 2],
    probes: [f32; 4],
    /// Exponential-cosine that the read-out of the channel shows.
    cosine: [Option<ExponentialCosine<f32>>; 2],
    /// Exponential-cosine accepted in this identification, and the candidate being evaluated.
    coloured: Option<ColouredChannels>,
    coloured_value: f32,
    coloured_candidate: ColouredChannels,
    coloured_best: (ColouredChannels, f32),
}

impl LikelihoodIdentifier {
    /// An identifier that has not been started: all zeros, so that a static one costs no flash.
    pub const fn new() -> Self {
        let noise = MarkovNoise { sigma: 0.0, tau_s: 0.0 };
        let noise = ChannelNoise { accelerometer: noise, gyro: noise };
        let coloured = ColouredNoise { sigma: 0.0, alpha: 0.0, beta: 0.0 };
        let coloured_channels = ColouredChannels { accelerometer: coloured, gyro: coloured };
        Self {
            window: MeasurementWindow::new(),
            wide: WideBank::new(),
            begun: 0,
            laid: false,
            first: [[0.0; 2]; 2],
            restarted: false,
            places: [Workspace::EMPTY; 2],
            active: None,
            simplex: Simplex::idle(),
            coloured_simplex: Simplex::idle(),
            replay: Replay::idle(),
            coloured_replay: Replay::idle(),
            phase: Phase::Waiting,
            stretch: Stretch { begin: 0, end: 0, from_start: false },
            steps: 0,
            due: 0,
            in_use: noise,
            status: [ChannelStatus::DataSheet; 2],
            retunes: 0,
            at_sample: [0.0; 4],
            correction: [0.0; 4],
            found: noise,
            found_value: 0.0,
            candidate: noise,
            filter_variance: [0.0; 2],
            probes: [0.0; 4],
            cosine: [None; 2],
            coloured: None,
            coloured_value: 0.0,
            coloured_candidate: coloured_channels,
            coloured_best: (coloured_channels, 0.0),
        }
    }

    /// Starts anew from the data-sheet values. Both configurations must have been validated.
    pub fn start(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        self.window.clear();
        self.active = None;
        self.phase = Phase::Waiting;
        self.steps = 0;
        self.due = steps_in(config.first_s, filter.step_s);
        self.in_use = ChannelNoise { accelerometer: filter.accelerometer, gyro: filter.gyro };
        self.status = [ChannelStatus::DataSheet; 2];
        self.retunes = 0;

        let limits = Limits::new(filter, config);
        let grid = |channel: usize, noise: &MarkovNoise<f32>| -> Grid<5> {
            let diffusions = [0.1, 0.316_227_77, 1.0, 3.162_277_7, 10.0];
            [0.1, 1.0, 10.0].map(|rate: f32| {
                diffusions.map(|diffusion: f32| {
                    let tau_s = noise.tau_s / rate;
                    limits.clip(
                        channel,
                        MarkovNoise { sigma: noise.sigma * diffusion / libm::sqrtf(rate), tau_s },
                    )
                })
            })
        };
        self.wide.lay(filter, grid(0, &filter.accelerometer), grid(1, &filter.gyro));
        self.wide.start_at(0);
        self.begun = 0;
        self.laid = false;
        self.first = [[0.0; 2], [filter.initial_velocity_sigma, filter.initial_vertical_sigma]];
        self.restarted = false;
        let in_use = self.in_use;
        self.stretch = self.whole_window();
        self.evaluate(filter, &in_use);
    }

    /// The same in the midst of a flight, from a velocity error, m/s, and with next to nothing known
    /// of the vertical, which may be worse by then than at the start. The step in which it happens
    /// works no longer than another.
    pub fn restart(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, velocity: f32) {
        self.start(filter, config);
        self.laid = true;
        self.first = [[velocity, 0.0], DIFFUSE];
        self.restarted = true;
    }

    /// Where `condition` holds, the main filter starts from the measurement of the step that comes
    /// next: the velocity error may have jumped. The banks have nothing to say until they have come
    /// to what is measured after it.
    pub fn break_off_if(&mut self, condition: bool) {
        self.window.break_off_if(condition);
    }

    /// One step: takes the velocity error (m/s) or a gap and the main filter's state after it, does one quantum
    /// of work, and says when the main filter is to be retuned.
    pub fn step(
        &mut self,
        filter: &FilterConfig<f32>,
        config: &IdentificationConfig,
        velocity_error: Option<f32>,
        present: &Gaussian<f32>,
    ) -> Option<Retuned> {
        self.steps = self.steps.saturating_add(1);
        if self.window.push(velocity_error) {
            self.at_sample = present.mean;
        }
        let variance_of_one = filter.velocity_noise * filter.velocity_noise;
        if self.begun < WIDE {
            self.begin_members(filter, config);
        } else {
            self.wide.advance(&self.window, variance_of_one);
        }
        if let Some(narrow) =
            self.active.and_then(|active| self.places.get_mut(usize::from(active))?.bank_mut())
            && narrow.advance(&self.window, variance_of_one)
            && narrow.cursor() == self.window.completed()
        {
            let mixture = carried(filter, narrow.mixture().mean, middle_to_end(filter));
            self.correction = difference(mixture, self.at_sample);
        }
        if self.active.is_none() {
            // There will be a narrow bank.
            self.wide.work_in_vain(NARROW / PARTS, variance_of_one);
        }
        self.work(filter, config)
    }

    /// Starts the next members of the wide bank: as many as it would otherwise work on, so that all stand before the first
    /// sample is there.
    fn begin_members(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
        let [mean, sigma] = self.first;
        for index in self.begun..self.begun + WIDE / PARTS {
            let noise = self.wide.noise(index);
            self.wide.start_member(index, &noise.stationary(mean, sigma), prior(filter, config, &noise));
        }
        self.begun += WIDE / PARTS;
        // To start a member is less work than to work on a sample with one.
        self.wide.work_in_vain(BEGINNING_IN_VAIN, filter.velocity_noise * filter.velocity_noise);
    }

    /// Takes a gap of whole steps, as when the module was not called; at most `LONGEST_SKIP`
    /// of them. The work is that of the longest gap, also where there is none.
    pub fn skip(&mut self, steps: u32) {
        self.window.skip(steps);
    }

    /// The estimate averaged over what is not known of the parameters; none while no bank has anything to say: until the first
    /// sample is complete, after the filter has started from a measurement, and where not one member is sound.
    ///
    /// The banks work on ten-step means and hold for the middle of the last one. While only the wide bank is
    /// there, its mixture is carried to the present by the loop's equations; after that, the mixture says how far
    /// the main filter (`present`) was off at the last sample, and the main filter has the newest measurements.
    #[inline(never)]
    pub fn averaged(&self, filter: &FilterConfig<f32>, present: &Gaussian<f32>) -> Option<AveragedEstimate> {
        let narrow = self.active.and_then(|active| self.places.get(usize::from(active))?.bank());
        let (estimate, variance, source) = if let Some(narrow) = narrow {
            let mixture = self.heard(narrow.mixture(), narrow.cursor())?;
            let mut estimate = present.mean;
            for (x, correction) in estimate.iter_mut().zip(self.correction) {
                *x += correction;
            }
            (estimate, mixture.variance, EstimateSource::NarrowBank)
        } else {
            let mixture = self.heard(self.wide.mixture(), self.wide.cursor())?;
            let samples_behind = self.window.completed().saturating_sub(self.wide.cursor());
            let steps_behind = samples_behind.wrapping_mul(DECIMATION).wrapping_add(self.window.steps());
            let age_s = steps_behind as f32 * filter.step_s + middle_to_end(filter);
            let variance = aged(filter, mixture.variance, age_s);
            (carried(filter, mixture.mean, age_s), variance, EstimateSource::WideBank)
        };
        Some(AveragedEstimate { estimate, sigma: variance.map(libm::sqrtf), source })
    }

    /// The mixture of a bank that works on the sample with this index, if it has anything to say.
    fn heard<'a>(&self, mixture: &'a Mixture, cursor: u32) -> Option<&'a Mixture> {
        (mixture.sound & !self.window.jumps_after(cursor)).then_some(mixture)
    }

    /// The parameters in use.
    pub fn in_use(&self) -> &ChannelNoise {
        &self.in_use
    }

    /// How well each channel's parameters are known.
    pub fn status(&self) -> [ChannelStatus; 2] {
        self.status
    }

    /// How often the filter has been retuned.
    pub fn retunes(&self) -> u16 {
        self.retunes
    }

    /// Index of the workspace that is not in use.
    fn spare(&self) -> usize {
        usize::from(self.active == Some(0))
    }

    fn work(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) -> Option<Retuned> {
        match self.phase {
            Phase::Waiting => self.wait(filter, config),
            Phase::ReadOut { pass } => {
                let spare = self.spare();
                let read_out = self.places.get_mut(spare).and_then(Workspace::read_out)?;
                if self.replay.advance(&self.window, READ_OUT_SAMPLES, Some(read_out)) {
                    self.next_pass(filter, pass + 1);
                }
            }
            Phase::Fit { channel } => self.fit(filter, config, channel),
            Phase::Search { .. } | Phase::Check { .. } | Phase::Probe { .. } | Phase::Populate { .. } => {
                if self.replay.advance(&self.window, REPLAY_SAMPLES, None) {
                    self.evaluated(filter, config);
                }
            }
            Phase::Coloured { channel, scan } => {
                if self.coloured_replay.advance(&self.window, COLOURED_SAMPLES, None) {
                    self.coloured_evaluated(filter, config, channel, scan);
                }
            }
            Phase::CatchUp => {
                self.coloured_replay.extend_to(self.window.completed());
                let there = self.coloured_replay.advance(&self.window, COLOURED_SAMPLES, None);
                let there = there || self.coloured.is_none();
                let spare = self.spare();
                let variance_of_one = filter.velocity_noise * filter.velocity_noise;
                if let Some(bank) = self.places.get_mut(spare).and_then(Workspace::bank_mut) {
                    for _ in 0..CATCH_UP_PARTS {
                        bank.advance(&self.window, variance_of_one);
                    }
                    if there && bank.cursor() == self.window.completed() && self.window.steps() == 0 {
                        return self.activate(filter, spare as u8);
                    }
                }
            }
        }
        None
    }
}

impl Default for LikelihoodIdentifier {
    fn default() -> Self {
        Self::new()
    }
}

saved!([] LikelihoodIdentifier {
    window,
    wide,
    begun < WIDE + 1,
    laid,
    first,
    restarted,
    places,
    active < 2,
    simplex,
    coloured_simplex,
    replay,
    coloured_replay,
    phase,
    stretch,
    steps,
    due,
    in_use,
    status,
    retunes,
    at_sample,
    correction,
    found,
    found_value,
    candidate,
    filter_variance,
    probes,
    cosine,
    coloured,
    coloured_value,
    coloured_candidate,
    coloured_best,
} always);
