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
use super::read_out::{LAGS, PASSES, ReadOut};
use super::replay::{ColouredChannels, DIFFUSE, Hypothesis, Replay, Stretch};
use super::simplex::Simplex;
use super::structure::ExponentialCosine;
use super::window::{DECIMATION, MeasurementWindow, WINDOW};
use super::{AveragedEstimate, ChannelStatus, EstimateSource, IdentificationConfig, steps_in};
use crate::filter::{ColouredGaussian, ColouredNoise, FilterConfig, Gaussian, Kernel, MarkovNoise};
use crate::number::select;
use crate::saved::{Saved, Walk, saved};

/// Samples replayed per step.
const REPLAY_SAMPLES: u32 = 256;
/// Samples not replayed in a step that has laid out the wide bank: that, and what else a jump of the clock restarts, takes as long.
const LAYING_SAMPLES: u32 = 91;
/// Samples replayed per step while lagged products are collected.
const READ_OUT_SAMPLES: u32 = 192;
/// Samples replayed per step with six states.
const COLOURED_SAMPLES: u32 = 80;
/// Members worked on in vain in a step that starts members: with them it takes as long as one without.
const BEGINNING_IN_VAIN: usize = 10;
/// Parts of the narrow bank's work done per step while it catches up, nine a sample: as many as take no longer than a replay.
const CATCH_UP_PARTS: usize = 25;

/// Edge of the first simplex, in the logarithms of the parameters.
const SEARCH_STEP: f32 = 0.7;
/// A search ends when the values of its simplex differ by less than this, nats.
const SEARCH_TOLERANCE: f32 = 0.02;
/// Evaluations per search, the first time and later.
const FIRST_EVALUATIONS: u16 = 200;
const LATER_EVALUATIONS: u16 = 120;
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
/// Longest correlation time that the search may reach, s.
const LONGEST_TAU_S: f32 = 2e5;
/// What the log-likelihood may drop by when the read-out replaces a channel's parameters.
const READ_OUT_DROP: f32 = 1.0;
/// Factor on τ, at constant diffusion, when the sharpness of the maximum is probed …
const PROBE_FACTOR: f32 = 3.0;
/// … and the drop below which the parameter counts as weakly determined.
const WEAK_DROP: f32 = 2.0;
/// A channel whose estimate keeps less than this share of the error's variance is not observed.
const OBSERVED_SHARE: f32 = 0.03;
/// Correlation times of the accelerometer error that must fit into the time before the first identification.
const FIRST_TAUS: f32 = 20.0;

/// Samples without which an identification is not begun: four times the lags of the read-out.
const LEAST_SAMPLES: u32 = 4 * LAGS as u32;

/// Samples of the longest gap that the module bridges.
const LONGEST_GAP: u32 = 60;

/// The bank's grid knows a correlation time only to a factor of ten, so the wait for them has a limit, as a multiple of
/// the configured time.
const FIRST_PATIENCE: f32 = 1.25;

/// The wide bank: five diffusions and three rates per channel.
type WideBank = FilterBank<5, WIDE>;
const WIDE: usize = 225;
/// The narrow bank: three standard deviations and three correlation times per channel.
type NarrowBank = FilterBank<3, 81>;
const NARROW: usize = 81;
/// Bytes of a place in a saved state.
const SAVED_PLACE: usize = size_of::<NarrowBank>();
const _: () = assert!(SAVED_PLACE >= size_of::<ReadOut>());
/// The narrow bank's member without any offset.
const CENTRE: usize = NARROW / 2;

/// Where the current identification stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Until the next one is due.
    Waiting,
    /// Evaluating the simplex point.
    Search { start: u8 },
    /// Collecting lagged products.
    ReadOut { pass: u8 },
    /// Fitting one channel.
    Fit { channel: u8 },
    /// Evaluating the read-out of one channel.
    Check { channel: u8 },
    /// Evaluating one channel's exponential-cosine, first at the places of the scan.
    Coloured { channel: u8, scan: u8 },
    /// Evaluating off the maximum: τ_a up, τ_a down, τ_w up, τ_w down.
    Probe { probe: u8 },
    /// Replaying for one member of the narrow bank.
    Populate { member: u8 },
    /// The narrow bank takes in what arrived meanwhile.
    CatchUp,
}

/// What is needed one after the other: the read-out, then the narrow bank that is laid around what it has found. There are
/// two places, so that one narrow bank is in use while the next identification works in the other.
///
/// The tag stands by itself, so that an identifier that waits is all zeros; a whole word, so that nothing lies between it and the
/// zeros of an empty place, which would then be made on the stack first.
#[derive(Clone, Copy, Debug)]
#[repr(u32)]
#[expect(clippy::large_enum_variant, reason = "no heap to box it in")]
enum Place {
    Bank(NarrowBank),
    ReadOut(ReadOut),
}

impl Place {
    const EMPTY: Self = Self::Bank(NarrowBank::new());

    /// Nothing collected, or a bank that is not laid. Zeros, written in place.
    #[inline(never)]
    fn empty(&mut self, read_out: bool) {
        if read_out {
            *self = Self::ReadOut(ReadOut::new());
        } else {
            *self = Self::EMPTY;
        }
    }

    fn bank(&self) -> Option<&NarrowBank> {
        match self {
            Self::Bank(bank) => Some(bank),
            Self::ReadOut(_) => None,
        }
    }

    fn bank_mut(&mut self) -> Option<&mut NarrowBank> {
        match self {
            Self::Bank(bank) => Some(bank),
            Self::ReadOut(_) => None,
        }
    }

    fn read_out(&mut self) -> Option<&mut ReadOut> {
        match self {
            Self::ReadOut(read_out) => Some(read_out),
            Self::Bank(_) => None,
        }
    }
}

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
    /// This step has laid out the wide bank.
    laid: bool,
    /// Means and standard deviations of ΔV, m/s, and δ, rad, that its members start from.
    first: [[f32; 2]; 2],
    /// They are those of a start in the midst of a flight.
    restarted: bool,
    places: [Place; 2],
    /// The place of the narrow bank in use, once there is one.
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
            places: [Place::EMPTY; 2],
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

    /// Index of the place that is not in use.
    fn spare(&self) -> usize {
        usize::from(self.active == Some(0))
    }

    fn work(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) -> Option<Retuned> {
        match self.phase {
            Phase::Waiting => self.wait(filter, config),
            Phase::ReadOut { pass } => {
                let spare = self.spare();
                let read_out = self.places.get_mut(spare).and_then(Place::read_out)?;
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
                if let Some(bank) = self.places.get_mut(spare).and_then(Place::bank_mut) {
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

    /// Begins an identification when it is due.
    fn wait(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
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
    fn whole_window(&self) -> Stretch {
        let end = self.window.completed();
        let mut begin = end.saturating_sub(WINDOW);
        let from_start = (begin == 0) & !self.restarted;
        for _ in 0..LONGEST_GAP {
            let gap = !from_start && !self.window.sample(begin).is_present();
            begin += u32::from(gap && begin < end);
        }
        Stretch { begin, end, from_start }
    }

    fn begin_search(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, start: u8) {
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

    fn evaluate(&mut self, filter: &FilterConfig<f32>, noise: &ChannelNoise) {
        self.candidate = *noise;
        self.replay.begin(filter, &self.window, self.stretch, noise);
    }

    /// A replay for its likelihood is complete.
    fn evaluated(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig) {
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
                let bank = self.places.get_mut(spare).and_then(Place::bank_mut);
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

    fn next_pass(&mut self, filter: &FilterConfig<f32>, pass: u8) {
        if usize::from(pass) < PASSES {
            let Stretch { begin, end, .. } = self.stretch;
            let found = self.found;
            let spare = self.spare();
            if let Some(place) = self.places.get_mut(spare) {
                if place.bank().is_some() {
                    place.empty(true);
                }
                if let Some(read_out) = place.read_out() {
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
    fn fit(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, channel: u8) {
        let spacing_s = filter.step_s * DECIMATION as f32;
        let spare = self.spare();
        let Some(read_out) = self.places.get_mut(spare).and_then(Place::read_out) else { return };
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

    fn after_check(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, channel: u8) {
        if channel == 0 {
            self.phase = Phase::Fit { channel: 1 };
        } else {
            self.coloured = None;
            self.coloured_value = f32::NEG_INFINITY;
            self.begin_coloured(filter, config, 0);
        }
    }

    /// Begins the search with six states for one channel; after both, takes the better of the two if it is worth
    /// it. What one sensor's swing does to the velocity another's can nearly do, so each is tried on its own.
    fn begin_coloured(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, channel: u8) {
        if channel <= 1 {
            self.coloured_best = (ColouredChannels::from(&self.found), f32::NEG_INFINITY);
            return self.begin_scan(filter, channel, 0);
        }
        self.begin_probe(filter, config, 0);
    }

    /// Evaluates place number `scan`: swings of several periods with the other channel as it was found, the same
    /// with the other channel as it is flown (for the first-order search may have bent it to follow the swing), and
    /// the swing that the read-out shows.
    fn begin_scan(&mut self, filter: &FilterConfig<f32>, channel: u8, scan: u8) {
        let own = |noise: &ChannelNoise| if channel == 0 { noise.accelerometer } else { noise.gyro };
        let other = |noise: &ChannelNoise| if channel == 0 { noise.gyro } else { noise.accelerometer };
        let (found, flown) = (self.found, self.in_use);
        let scan_index = usize::from(scan);
        let periods = SCANNED_PERIODS_S.len();
        let place = if let Some(period_s) = SCANNED_PERIODS_S.get(scan_index % periods)
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
        if let Some((noise, other)) = place {
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
    fn evaluate_coloured(&mut self, filter: &FilterConfig<f32>, channel: u8, place: [f32; 5]) {
        let [sigma, alpha, beta, other_sigma, other_alpha] = place;
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
    fn coloured_evaluated(
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
            let place = simplex.wanted().map(libm::expf);
            return self.evaluate_coloured(filter, channel, place);
        }
        let (best, value) = self.coloured_best;
        if value >= self.coloured_value.max(self.found_value + COLOURED_GAIN) {
            self.coloured = Some(best);
            self.coloured_value = value;
        }
        self.begin_coloured(filter, config, channel + 1);
    }

    /// Asks for the likelihood with one correlation time off, at constant diffusion.
    fn begin_probe(&mut self, filter: &FilterConfig<f32>, config: &IdentificationConfig, probe: u8) {
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
        if let Some(place) = self.places.get_mut(spare) {
            place.empty(false);
        }
        if let Some(bank) = self.places.get_mut(spare).and_then(Place::bank_mut) {
            bank.lay(filter, grid(&found.accelerometer, status[0]), grid(&found.gyro, status[1]));
        }
        self.populate(filter, 0);
    }

    /// Replays the window for one member of the narrow bank after the other.
    fn populate(&mut self, filter: &FilterConfig<f32>, member: u8) {
        let spare = self.spare();
        if usize::from(member) < NARROW {
            let bank = self.places.get(spare).and_then(Place::bank);
            let noise = bank.map_or(self.found, |bank| bank.noise(usize::from(member)));
            self.phase = Phase::Populate { member };
            self.evaluate(filter, &noise);
        } else {
            if let Some(bank) = self.places.get_mut(spare).and_then(Place::bank_mut) {
                bank.start_at(self.stretch.end);
            }
            if let Some(coloured) = self.coloured {
                self.coloured_replay.begin(filter, &self.window, self.stretch, &coloured);
            }
            self.phase = Phase::CatchUp;
        }
    }

    /// Puts the narrow bank to use; the main filter goes on from its central member.
    fn activate(&mut self, filter: &FilterConfig<f32>, bank: u8) -> Option<Retuned> {
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

impl Default for LikelihoodIdentifier {
    fn default() -> Self {
        Self::new()
    }
}

/// Where the parameters may lie.
struct Limits {
    centre: [MarkovNoise<f32>; 2],
    factor: f32,
    shortest_tau_s: f32,
}

impl Limits {
    fn new(filter: &FilterConfig<f32>, config: &IdentificationConfig) -> Self {
        Self {
            centre: [filter.accelerometer, filter.gyro],
            factor: config.limit_factor,
            shortest_tau_s: 0.5 * DECIMATION as f32 * filter.step_s,
        }
    }

    fn clip(&self, channel: usize, noise: MarkovNoise<f32>) -> MarkovNoise<f32> {
        let centre = &self.centre[channel & 1];
        let within = |value: f32, centre: f32| value.min(centre * self.factor).max(centre / self.factor);
        self.clip_tau(MarkovNoise {
            sigma: within(noise.sigma, centre.sigma),
            tau_s: within(noise.tau_s, centre.tau_s),
        })
    }

    fn clip_tau(&self, noise: MarkovNoise<f32>) -> MarkovNoise<f32> {
        MarkovNoise { tau_s: noise.tau_s.min(LONGEST_TAU_S).max(self.shortest_tau_s), ..noise }
    }

    fn clip_both(&self, noise: &ChannelNoise) -> ChannelNoise {
        ChannelNoise { accelerometer: self.clip(0, noise.accelerometer), gyro: self.clip(1, noise.gyro) }
    }
}

/// −½ Σ (ln θ_i/θ_i⁰)²/w² about the data sheet.
fn prior(filter: &FilterConfig<f32>, config: &IdentificationConfig, noise: &ChannelNoise) -> f32 {
    let data_sheet = ChannelNoise { accelerometer: filter.accelerometer, gyro: filter.gyro };
    let away = noise.logarithms().into_iter().zip(data_sheet.logarithms());
    let square = away.fold(0.0, |sum, (x, x0)| sum + (x - x0) * (x - x0));
    -0.5 * square / (config.prior_width * config.prior_width)
}

/// From the middle of a sample's interval, for which its mean holds, to its last step, s.
fn middle_to_end(filter: &FilterConfig<f32>) -> f32 {
    0.5 * filter.step_s * (DECIMATION - 1) as f32
}

/// A mean carried `age_s` seconds on by the loop's equations; a few tens of seconds at the most.
fn carried(filter: &FilterConfig<f32>, mean: [f32; 4], age_s: f32) -> [f32; 4] {
    let [velocity, vertical, acceleration, drift] = mean;
    [
        velocity + age_s * (acceleration - filter.gravity * vertical),
        vertical + age_s * (velocity / filter.radius_m + drift),
        acceleration,
        drift,
    ]
}

/// Variances of a mean that has been carried so: what is not known of tilt and errors has grown into velocity and tilt, as if
/// they were independent, which is the most that it can have.
fn aged(filter: &FilterConfig<f32>, variance: [f32; 4], age_s: f32) -> [f32; 4] {
    let [velocity, vertical, acceleration, drift] = variance;
    let square = age_s * age_s;
    let (g, r) = (filter.gravity, filter.radius_m);
    [
        velocity + square * (acceleration + g * g * vertical),
        vertical + square * (velocity / (r * r) + drift),
        acceleration,
        drift,
    ]
}

fn difference(x: [f32; 4], y: [f32; 4]) -> [f32; 4] {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2], x[3] - y[3]]
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

/// Filled up to one length, so that what comes behind has its place whichever it is.
impl Saved for Place {
    fn walk(&mut self, walk: &mut Walk<'_>) {
        let mut tag = u8::from(self.bank().is_none());
        if walk.tag(&mut tag, 2) && (tag == 1) == self.bank().is_some() {
            self.empty(tag == 1);
        }
        let end = walk.here() + SAVED_PLACE as u32;
        match self {
            Self::Bank(bank) => bank.walk(walk),
            Self::ReadOut(read_out) => read_out.walk(walk),
        }
        while walk.here() < end {
            0u8.walk(walk);
        }
    }
}

impl Saved for Phase {
    fn walk(&mut self, walk: &mut Walk<'_>) {
        let (mut tag, mut first, mut second) = match *self {
            Self::Waiting => (0, 0, 0),
            Self::Search { start } => (1, start, 0),
            Self::ReadOut { pass } => (2, pass, 0),
            Self::Fit { channel } => (3, channel, 0),
            Self::Check { channel } => (4, channel, 0),
            Self::Coloured { channel, scan } => (5, channel, scan),
            Self::Probe { probe } => (6, probe, 0),
            Self::Populate { member } => (7, member, 0),
            Self::CatchUp => (8, 0, 0),
        };
        walk.tag(&mut tag, 9);
        // The longest series that a phase counts through.
        walk.tag(&mut first, NARROW as u8);
        second.walk(walk);
        *self = match tag {
            0 => Self::Waiting,
            1 => Self::Search { start: first },
            2 => Self::ReadOut { pass: first },
            3 => Self::Fit { channel: first },
            4 => Self::Check { channel: first },
            5 => Self::Coloured { channel: first, scan: second },
            6 => Self::Probe { probe: first },
            7 => Self::Populate { member: first },
            _ => Self::CatchUp,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::saved::Checksum;

    fn bytes(place: &mut Place) -> [u8; 1 + SAVED_PLACE] {
        let mut bytes = [0; 1 + SAVED_PLACE];
        let mut walk = Walk::save(0, &mut bytes);
        place.walk(&mut walk);
        assert_eq!((walk.served(), walk.here()), (1 + SAVED_PLACE as u32, 1 + SAVED_PLACE as u32));
        bytes
    }

    #[test]
    fn a_place_is_brought_back_over_whatever_was_there() {
        let state = Gaussian::independent([0.1, 0.2, 0.3, 0.4], [1.0; 4]);
        let mut bank = NarrowBank::new();
        bank.start_member(CENTRE, &state, -3.0);
        bank.start_at(77);
        let mut read_out = ReadOut::new();
        read_out.begin_pass(PASSES - 1, 5);
        read_out.take(9, &state, true);
        let (bank, read_out) = (Place::Bank(bank), Place::ReadOut(read_out));
        for from in [&bank, &read_out] {
            for over in [&bank, &read_out, &Place::EMPTY] {
                let (mut from, mut over) = (*from, *over);
                let saved = bytes(&mut from);
                let mut walk = Walk::restore(0, &saved, Checksum::EMPTY);
                over.walk(&mut walk);
                assert_eq!(walk.served() as usize, saved.len());
                assert_eq!(bytes(&mut over), saved);
            }
        }
    }
}
