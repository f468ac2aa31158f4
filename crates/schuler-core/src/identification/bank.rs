//! Many filters at once, each with its own noise parameters, weighted by how well they predict.
//!
//! A member's log-weight grows by −½(ln S + ν²/S) with every sample, so that after normalisation the weights are
//! the posterior probabilities of the parameters on the grid (Bayes). Two banks fly: a wide one over the whole
//! range that the data sheet allows, to start the search from, and a narrow one around the identified
//! parameters, whose mixture carries their uncertainty into the estimate.

use super::window::{DECIMATION, MeasurementWindow, Sample};
use crate::filter::{DiscreteModel, FilterConfig, Gaussian, Kernel, MarkovNoise};
use crate::number::{each, select};
use crate::saved::saved;

/// Correlation times per channel on the grid.
const TAUS: usize = 3;

/// Parts into which one sample's work is cut: each step does one, and one step in ten rests, so that a bank that
/// has fallen behind catches up.
pub const PARTS: usize = 9;

const _: () = assert!(PARTS < DECIMATION as usize, "the bank must be faster than the samples");

/// Lowest log-weight relative to the best.
const FLOOR: f32 = -80.0;

/// Normalised innovation squared beyond which a member has not foreseen a velocity.
const MISLED: f32 = 25.0;
/// What its variances are then multiplied by, as those of the filter where it starts again.
const REACQUISITION: f32 = 100.0;

/// The noise of both channels at one point of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelNoise {
    /// Accelerometer error, m/s² and s.
    pub accelerometer: MarkovNoise<f32>,
    /// Gyro drift, rad/s and s.
    pub gyro: MarkovNoise<f32>,
}

/// One channel's grid: `L` levels for each of [`TAUS`] correlation times.
pub type Grid<const L: usize> = [[MarkovNoise<f32>; L]; TAUS];

/// What a channel adds to the model of one sample, for unit spectral level.
#[derive(Clone, Copy, Debug)]
struct Part {
    to_velocity: f32,
    to_vertical: f32,
    decay: f32,
    /// Noise: vv, vδ, v·own, δδ, δ·own, own.
    noise: [f32; 6],
}

/// A filter, and how well it has done.
#[derive(Clone, Copy, Debug)]
struct Member {
    state: Gaussian<f32>,
    log_weight: f32,
}

/// What there is to do for a member.
struct Work {
    /// Mean of the sample's velocities, m/s, and its variance, (m/s)²; whether there are any.
    velocity: f32,
    variance: f32,
    present: bool,
    /// The velocity error may have jumped before them.
    jumped: bool,
    /// Whether it counts; it is done all the same.
    counts: bool,
}

impl Member {
    /// Takes a sample, and adds to the moments of the bank. `before` holds the bank's mean and greatest log-weight before the
    /// sample. One function for banks of any size.
    ///
    /// Mean and variance are carried from member to member as moments of the mixture so far (West's recursion): every term of
    /// the variance is positive and nothing is subtracted, so that it neither cancels nor, with weights of 10⁻³⁵, underflows.
    #[inline(never)]
    fn work(
        &mut self,
        work: &Work,
        model: &DiscreteModel<f32>,
        noise: &ChannelNoise,
        before: (&[f32; 4], f32),
        sums: &mut Sums,
    ) {
        let (reference, greatest) = before;
        let Work { velocity, variance, present, jumped, counts } = *work;
        let mut in_vain = *self;
        let member = select(counts, self, &mut in_vain);
        member.state.predict(model);
        let innovation = member.state.innovation(velocity, variance);
        // One that has not foreseen what the filter started from has been misled as well: all that
        // it knows is as uncertain as there, unless it is already.
        let [_, _, _, drift] = member.state.variances();
        let misled = jumped & (innovation.nis() > MISLED) & (drift < noise.gyro.sigma * noise.gyro.sigma);
        let factor = select(misled, REACQUISITION, 1.0);
        member.state.covariance = member.state.covariance.map(|p| p * factor);
        let innovation = member.state.innovation(velocity, variance);
        let innovation = member.state.after_jump_if(jumped, innovation);
        member.state.correct(&innovation, present);
        let gained = select(present, innovation.log_likelihood(), 0.0);
        // A member that has lost its footing weighs nothing from then on.
        let relative = member.log_weight - greatest + gained;
        let sound = member.state.is_sound();
        member.log_weight = select(sound, relative.max(FLOOR), FLOOR);

        // What is not sound, or does not count, weighs nothing; it is multiplied by that and not passed over, which would take
        // less work.
        let sound = sound & counts;
        let weight = f32::from(u8::from(sound)) * libm::expf(member.log_weight);
        let parameters = noise.logarithms();
        sums.weight += weight;
        // Its share of the mixture so far, and that of the members before it.
        let share = weight / sums.weight.max(f32::MIN_POSITIVE);
        let rest = 1.0 - share;
        let state = select(sound, &member.state, &Gaussian { mean: [0.0; 4], covariance: [0.0; 10] });
        let (mean, variances) = (state.mean, state.variances());
        let (first, second, logarithms) = (sums.first, sums.second, sums.log_parameters);
        let apart = each!(|i| mean[i] - reference[i] - first[i]; 0 1 2 3);
        sums.first = each!(|i| first[i] + share * apart[i]; 0 1 2 3);
        sums.second =
            each!(|i| rest * second[i] + share * (variances[i] + rest * apart[i] * apart[i]); 0 1 2 3);
        sums.log_parameters = each!(|i| rest * logarithms[i] + share * parameters[i]; 0 1 2 3);
        let better = counts & (member.log_weight > sums.greatest);
        sums.greatest = select(better, member.log_weight, sums.greatest);
        sums.best = select(better, parameters, sums.best);
    }
}

/// Mean and covariance of the whole bank, and where its posterior lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Mean of [ΔV, δ, a, ω]: m/s, rad, m/s², rad/s.
    pub mean: [f32; 4],
    /// Variances, the spread between the members included.
    pub variance: [f32; 4],
    /// Posterior mean of ln σ_a, ln τ_a, ln σ_w, ln τ_w.
    pub log_mean: [f32; 4],
    /// The best member's ln σ_a, ln τ_a, ln σ_w, ln τ_w.
    pub best: [f32; 4],
    /// Sound members stand behind it. Without any, the rest is what it was before.
    pub sound: bool,
}

/// A bank of `M` = (3 `L`)² filters over samples of ten steps.
#[derive(Clone, Copy, Debug)]
pub struct FilterBank<const L: usize, const M: usize> {
    accelerometer: Grid<L>,
    gyro: Grid<L>,
    /// ΔV, δ from ΔV, δ.
    coupling: [[f32; 2]; 2],
    parts_a: [Part; TAUS],
    parts_w: [Part; TAUS],
    members: [Member; M],
    /// Parts of the work done since sample zero.
    done: u32,
    /// Greatest log-weight after the previous sample, taken off all of them.
    greatest: f32,
    sums: Sums,
    mixture: Mixture,
}

/// Moments of the members so far, while one sample is worked on.
#[derive(Clone, Copy, Debug)]
struct Sums {
    weight: f32,
    /// Mean, less the previous mixture's.
    first: [f32; 4],
    /// Variance about the mean.
    second: [f32; 4],
    log_parameters: [f32; 4],
    greatest: f32,
    best: [f32; 4],
}

impl Sums {
    const ZERO: Self = Self { greatest: 0.0, ..Self::EMPTY };
    const EMPTY: Self = Self {
        weight: 0.0,
        first: [0.0; 4],
        second: [0.0; 4],
        log_parameters: [0.0; 4],
        greatest: f32::NEG_INFINITY,
        best: [0.0; 4],
    };
}

impl Mixture {
    const EMPTY: Self =
        Self { mean: [0.0; 4], variance: [0.0; 4], log_mean: [0.0; 4], best: [0.0; 4], sound: false };
}

impl<const L: usize, const M: usize> FilterBank<L, M> {
    const WHOLE: () = assert!(M == TAUS * L * TAUS * L && M.is_multiple_of(PARTS), "M = (3 L)²");

    /// A bank that has not been started.
    pub const fn new() -> Self {
        let () = Self::WHOLE;
        let noise = MarkovNoise { sigma: 0.0, tau_s: 0.0 };
        let part = Part { to_velocity: 0.0, to_vertical: 0.0, decay: 0.0, noise: [0.0; 6] };
        let state = Gaussian { mean: [0.0; 4], covariance: [0.0; 10] };
        Self {
            accelerometer: [[noise; L]; TAUS],
            gyro: [[noise; L]; TAUS],
            coupling: [[0.0; 2]; 2],
            parts_a: [part; TAUS],
            parts_w: [part; TAUS],
            members: [Member { state, log_weight: 0.0 }; M],
            done: 0,
            greatest: 0.0,
            sums: Sums::ZERO,
            mixture: Mixture::EMPTY,
        }
    }

    /// Lays the grid. The members must then be started one by one with [`Self::start_member`].
    pub fn lay(&mut self, config: &FilterConfig<f32>, accelerometer: Grid<L>, gyro: Grid<L>) {
        let sample_s = config.step_s * DECIMATION as f32;
        self.accelerometer = accelerometer;
        self.gyro = gyro;
        for ((part_a, part_w), (levels_a, levels_w)) in
            self.parts_a.iter_mut().zip(&mut self.parts_w).zip(accelerometer.iter().zip(&gyro))
        {
            let tau = |levels: &[MarkovNoise<f32>; L]| levels.first().map_or(1.0, |noise| noise.tau_s);
            let (tau_a, tau_w) = (tau(levels_a), tau(levels_w));
            let model = |level_a: f32, level_w: f32| {
                let unit =
                    |tau_s: f32, level: f32| MarkovNoise { sigma: libm::sqrtf(0.5 * level * tau_s), tau_s };
                config.model(&unit(tau_a, level_a), &unit(tau_w, level_w), sample_s)
            };
            *part_a = Part::accelerometer(&model(1.0, 0.0));
            let with_gyro = model(0.0, 1.0);
            *part_w = Part::gyro(&with_gyro);
            self.coupling = [
                [with_gyro.velocity[0], with_gyro.velocity[1]],
                [with_gyro.vertical[0], with_gyro.vertical[1]],
            ];
        }
        self.greatest = 0.0;
        self.sums = Sums::EMPTY;
        self.mixture = Mixture::EMPTY;
    }

    /// Noise of member `index`.
    pub fn noise(&self, index: usize) -> ChannelNoise {
        let (a, w) = (index / (TAUS * L), index % (TAUS * L));
        ChannelNoise { accelerometer: pick(&self.accelerometer, a), gyro: pick(&self.gyro, w) }
    }

    /// Puts member `index` where it is to begin.
    pub fn start_member(&mut self, index: usize, state: &Gaussian<f32>, log_weight: f32) {
        if let Some(member) = self.members.get_mut(index) {
            *member = Member { state: *state, log_weight };
        }
        self.mixture.mean = state.mean;
        self.greatest = if index == 0 { log_weight } else { self.greatest.max(log_weight) };
    }

    /// Says which sample comes next, once all members stand before it.
    pub fn start_at(&mut self, cursor: u32) {
        self.done = cursor.wrapping_mul(PARTS as u32);
        self.sums = Sums::EMPTY;
    }

    /// State of member `index`, holding for the middle of the last sample's interval.
    pub fn member_state(&self, index: usize) -> Option<&Gaussian<f32>> {
        self.members.get(index).map(|member| &member.state)
    }

    /// Index of the sample that the bank works on.
    pub fn cursor(&self) -> u32 {
        self.done / PARTS as u32
    }

    /// Does one of nine parts of the work on the current sample; true when that completed it. Where the sample is not there
    /// yet the work is done all the same, and counts for nothing.
    pub fn advance(&mut self, window: &MeasurementWindow, variance_of_one: f32) -> bool {
        let cursor = self.cursor();
        let counts = cursor < window.completed();
        let sample = window.sample(cursor);
        let per_part = M / PARTS;
        let first = self.done as usize % PARTS * per_part;
        for index in first..first + per_part {
            self.work_member(index, sample, variance_of_one, counts);
        }
        self.done = self.done.wrapping_add(u32::from(counts));
        let complete = counts & self.done.is_multiple_of(PARTS as u32);
        if complete {
            self.complete();
        }
        complete
    }

    /// The mixture after the last completed sample; it holds for the middle of that sample's interval.
    pub fn mixture(&self) -> &Mixture {
        &self.mixture
    }

    /// Does the work of so many members, which counts for nothing.
    pub fn work_in_vain(&mut self, members: usize, variance_of_one: f32) {
        for index in 0..members {
            self.work_member(index, Sample::default(), variance_of_one, false);
        }
    }

    #[inline]
    fn work_member(&mut self, index: usize, sample: Sample, variance_of_one: f32, counts: bool) {
        let noise = self.noise(index);
        let model = self.model(index, &noise);
        let variance = sample.variance(variance_of_one);
        let Some(member) = self.members.get_mut(index) else { return };
        let relative_to = (&self.mixture.mean, self.greatest);
        let (present, jumped) = (sample.is_present(), sample.jumped);
        let work = Work { velocity: sample.mean, variance, present, jumped, counts };
        member.work(&work, &model, &noise, relative_to, &mut self.sums);
    }

    fn complete(&mut self) {
        let (sums, mixture) = (&self.sums, &mut self.mixture);
        mixture.sound = sums.weight > 0.0;
        // Without a sound member the old mixture stands.
        if mixture.sound {
            for (mean, away) in mixture.mean.iter_mut().zip(sums.first) {
                *mean += away;
            }
            mixture.variance = sums.second;
            mixture.log_mean = sums.log_parameters;
            mixture.best = sums.best;
        }
        self.greatest = sums.greatest;
        self.sums = Sums::EMPTY;
    }

    fn model(&self, index: usize, noise: &ChannelNoise) -> DiscreteModel<f32> {
        let (a, w) = (index / (TAUS * L) / L, index % (TAUS * L) / L);
        let (a, w) = (part(&self.parts_a, a), part(&self.parts_w, w));
        let (qa, qw) = (noise.accelerometer.spectral_level(), noise.gyro.spectral_level());
        let [[vv, vd], [dv, dd]] = self.coupling;
        DiscreteModel {
            velocity: [vv, vd, a.to_velocity, w.to_velocity],
            vertical: [dv, dd, a.to_vertical, w.to_vertical],
            decay: [a.decay, w.decay],
            noise: [
                qa * a.noise[0] + qw * w.noise[0],
                qa * a.noise[1] + qw * w.noise[1],
                qa * a.noise[2],
                qw * w.noise[2],
                qa * a.noise[3] + qw * w.noise[3],
                qa * a.noise[4],
                qw * w.noise[4],
                qa * a.noise[5],
                0.0,
                qw * w.noise[5],
            ],
        }
    }
}

impl<const L: usize, const M: usize> Default for FilterBank<L, M> {
    fn default() -> Self {
        Self::new()
    }
}

impl ChannelNoise {
    /// ln σ_a, ln τ_a, ln σ_w, ln τ_w.
    pub fn logarithms(&self) -> [f32; 4] {
        [self.accelerometer.sigma, self.accelerometer.tau_s, self.gyro.sigma, self.gyro.tau_s].map(libm::logf)
    }

    /// From ln σ_a, ln τ_a, ln σ_w, ln τ_w.
    pub fn from_logarithms(logarithms: [f32; 4]) -> Self {
        let [sigma_a, tau_a, sigma_w, tau_w] = logarithms.map(libm::expf);
        Self {
            accelerometer: MarkovNoise { sigma: sigma_a, tau_s: tau_a },
            gyro: MarkovNoise { sigma: sigma_w, tau_s: tau_w },
        }
    }
}

impl Part {
    fn accelerometer(model: &DiscreteModel<f32>) -> Self {
        let q = &model.noise;
        Self {
            to_velocity: model.velocity[2],
            to_vertical: model.vertical[2],
            decay: model.decay[0],
            noise: [q[0], q[1], q[2], q[4], q[5], q[7]],
        }
    }

    fn gyro(model: &DiscreteModel<f32>) -> Self {
        let q = &model.noise;
        Self {
            to_velocity: model.velocity[3],
            to_vertical: model.vertical[3],
            decay: model.decay[1],
            noise: [q[0], q[1], q[3], q[4], q[6], q[9]],
        }
    }
}

fn pick<const L: usize>(grid: &Grid<L>, index: usize) -> MarkovNoise<f32> {
    let fallback = MarkovNoise { sigma: 1.0, tau_s: 1.0 };
    grid.get(index / L).and_then(|levels| levels.get(index % L)).copied().unwrap_or(fallback)
}

fn part(parts: &[Part; TAUS], index: usize) -> Part {
    parts.get(index).copied().unwrap_or(parts[0])
}

saved!([] ChannelNoise { accelerometer, gyro });
saved!([] Part { to_velocity, to_vertical, decay, noise });
saved!([] Member { state, log_weight });
saved!([] Mixture { mean, variance, log_mean, best, sound });
saved!([] Sums { weight, first, second, log_parameters, greatest, best });
saved!([const L: usize, const M: usize] FilterBank<L, M> {
    accelerometer,
    gyro,
    coupling,
    parts_a,
    parts_w,
    members,
    done,
    greatest,
    sums,
    mixture,
});
