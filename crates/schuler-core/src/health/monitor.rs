//! The monitor: guards in front of the recursion, read-outs and alarms behind it [HLT-5], [HLT-6].
use nalgebra::{RealField, convert};

use super::conditional::Conditional;
use super::config::{AlarmThresholds, HealthConfig};
use super::memory::Memory;
use super::output::{Estimate, HealthOutput, HealthStatus};
use super::recursion::{Evidence, Recursion};
use super::span::{MAX_SPAN_STEPS, SpanLadder};
use super::verdict::{Findings, HealthAlarms};
use crate::config::ConfigError;
use crate::number::select;
use crate::reading::{Quality, Reading};
use crate::saved::{Blank, saved};

/// One residual out of the model is an outlier, this many in a row are a fault.
const OUT_OF_MODEL_STEPS: u32 = 3;
/// The inertial error counts as beyond its bound when it is by this many standard deviations.
const INERTIAL_CONFIDENCE: f64 = 3.0;
/// Largest normalised innovation squared that is reported.
const MAX_NIS: f64 = 1e12;

/// Monitors one radio sensor against one inertial sensor of the same quantity.
#[derive(Clone, Copy, Debug)]
pub struct HealthMonitor<T, const LEVELS: usize> {
    priors: Recursion<T, LEVELS>,
    ladder: SpanLadder<T, LEVELS>,
    thresholds: AlarmThresholds<T>,
    normal_levels: usize,
    inertial_bound: T,
    /// A jump of more steps than this may as well be the inertial sensor's.
    attribution_steps: u32,
    /// After this many steps of silence there is no verdict.
    unobserved_steps: u32,
    /// The longest silence that is bridged, steps.
    bridged_steps: u32,
    max_age_ms: u32,
    memory: Memory<T>,
    state: State<T, LEVELS>,
}

/// What changes from step to step.
#[derive(Clone, Copy, Debug)]
struct State<T, const LEVELS: usize> {
    /// As of the last residual that was used. Silence is bridged from there in one span and not second by
    /// second, because every merging without a residual to weigh the paths loses what the next one could tell
    /// apart.
    recursion: Recursion<T, LEVELS>,
    /// A residual has been used since the last start.
    started: bool,
    /// Steps since the last residual that was used.
    silence: u32,
    /// Residuals out of the model in a row.
    rejected: u32,
    /// Steps since the jump alarm was set.
    jump_steps: u32,
    alarms: HealthAlarms,
}

impl<T: RealField + Copy, const LEVELS: usize> HealthMonitor<T, LEVELS> {
    /// Checks the configuration and builds the monitor.
    ///
    /// # Errors
    /// The first field that cannot be flown.
    pub fn try_build(config: &HealthConfig<T, LEVELS>) -> Result<Self, ConfigError> {
        config.validate()?;
        let priors = Recursion::new(config);
        Ok(Self {
            priors,
            ladder: SpanLadder::new(config),
            thresholds: config.alarm,
            normal_levels: usize::from(config.radio.normal_levels),
            inertial_bound: config.inertial.bound,
            attribution_steps: config.steps(config.jump.attribution_limit_s),
            unobserved_steps: config.steps(config.unobserved_after_s),
            bridged_steps: config.steps(config.restart_after_s).min(MAX_SPAN_STEPS),
            max_age_ms: config.max_age_ms,
            memory: Memory::new(config.memory.as_ref()),
            state: State::new(priors),
        })
    }

    /// Forgets everything but the configuration.
    pub fn restart(&mut self) {
        self.memory.restart();
        self.state = State::new(self.priors);
    }

    /// One step with the readings of both sensors, m/s. `elapsed`: nominal steps since the last call, 1 in
    /// ordinary running; any number of them is the same work. Never panics; whatever the readings, the state
    /// stays usable.
    #[inline(never)]
    pub fn step(
        &mut self,
        radio: &Reading<T>,
        inertial: &Reading<T>,
        elapsed: u32,
    ) -> HealthOutput<T, LEVELS> {
        let radio_usable = self.is_usable(radio);
        let inertial_usable = self.is_usable(inertial);
        let residual = radio.value - inertial.value;
        let state = &mut self.state;
        let repeated = state.started && elapsed == 0;
        let p_memory = self.memory.step(radio.value, radio_usable & (elapsed > 0));
        // What a radio holds says nothing of its error.
        let holds = p_memory >= self.thresholds.clear;
        let present = radio_usable && inertial_usable && residual.is_finite() && !repeated && !holds;

        state.silence = state.silence.saturating_add(elapsed);
        let restarted = state.started && state.silence > self.bridged_steps;
        let before = *select(restarted, &self.priors, &state.recursion);
        state.started &= !restarted;
        let span = self.ladder.span(select(state.started, state.silence, 0));
        let (after, evidence) = before.after(&span, residual, present);
        let sound = evidence.sound;
        // What came of numbers that are not sound says nothing.
        let evidence = *select(sound, &evidence, &Evidence::none());
        let now = *select(sound, &after, &self.priors);
        let used = present & sound & !evidence.out_of_model;
        state.recursion = *select(used | !sound, &now, &before);
        state.started = used | (state.started & sound);
        state.silence = select(used, 0, state.silence);
        state.rejected = select(used, 0, state.rejected);
        state.rejected = state.rejected.saturating_add(u32::from(evidence.out_of_model));

        let mut status = HealthStatus::empty();
        status.set(HealthStatus::RADIO_UNUSABLE, !radio_usable);
        status.set(HealthStatus::INERTIAL_UNUSABLE, !inertial_usable);
        status.set(HealthStatus::OUT_OF_MODEL, evidence.out_of_model);
        status.set(HealthStatus::GAP, elapsed > 1);
        status.set(HealthStatus::REPEATED, repeated);
        status.set(HealthStatus::RESTARTED, restarted);
        status.set(HealthStatus::NUMERICAL_RESET, !sound);

        let square = evidence.innovation * evidence.innovation;
        let nis = if evidence.variance > T::zero() { square / evidence.variance } else { T::zero() };
        let mut output = HealthOutput {
            status,
            residual: if present { residual } else { T::zero() },
            innovation: evidence.innovation,
            innovation_variance: evidence.variance,
            nis: nis.min(convert(MAX_NIS)),
            log_likelihood: evidence.log_likelihood,
            p_memory,
            ..HealthOutput::default()
        };
        read_probabilities(&mut output, &now.weights, self.normal_levels);
        let radio = radio_usable.then_some(radio.value);
        let inertial = inertial_usable.then_some(inertial.value);
        read_estimates(&mut output, &now.over_modes(), radio, inertial, present);
        self.judge(&mut output, elapsed);
        output
    }

    fn is_usable(&self, reading: &Reading<T>) -> bool {
        (reading.quality == Quality::Good) && (reading.age_ms <= self.max_age_ms) && reading.value.is_finite()
    }

    fn judge(&mut self, output: &mut HealthOutput<T, LEVELS>, elapsed: u32) {
        let state = &mut self.state;
        let alarms = &mut state.alarms;
        alarms.follow(HealthAlarms::JUMP, output.p_jump, &self.thresholds);
        alarms.follow(HealthAlarms::NOISE, output.p_noise, &self.thresholds);
        alarms.follow(HealthAlarms::FAULT, output.p_fault, &self.thresholds);
        alarms.follow(HealthAlarms::MEMORY, output.p_memory, &self.thresholds);
        let xi = output.inertial_error;
        let beyond = xi.value.abs() - convert::<f64, T>(INERTIAL_CONFIDENCE) * xi.sigma > self.inertial_bound;
        alarms.switch(HealthAlarms::INERTIAL, beyond, xi.value.abs() < self.inertial_bound);

        let jump = alarms.contains(HealthAlarms::JUMP);
        state.jump_steps = if jump { state.jump_steps.saturating_add(elapsed) } else { 0 };
        let findings = Findings {
            alarms: state.alarms,
            observed: state.started && state.silence <= self.unobserved_steps,
            out_of_model: state.rejected >= OUT_OF_MODEL_STEPS,
            persistent_jump: state.jump_steps > self.attribution_steps,
        };
        output.alarms = state.alarms;
        (output.verdict, output.suspect) = findings.verdict();
    }
}

impl<T: RealField + Copy, const LEVELS: usize> State<T, LEVELS> {
    fn new(priors: Recursion<T, LEVELS>) -> Self {
        Self {
            recursion: priors,
            started: false,
            silence: 0,
            rejected: 0,
            jump_steps: 0,
            alarms: HealthAlarms::empty(),
        }
    }
}

fn read_probabilities<T: RealField + Copy, const LEVELS: usize>(
    output: &mut HealthOutput<T, LEVELS>,
    weights: &[[T; LEVELS]; 2],
    normal_levels: usize,
) {
    output.mode_probability = *weights;
    let [absent, present] = weights;
    let sum_from =
        |row: &[T; LEVELS], first: usize| row.iter().skip(first).fold(T::zero(), |sum, &w| sum + w);
    // Summed, not one less the rest: a small probability keeps its digits in single precision. Rounding may take a sum beyond one.
    let probability = |sum: T| sum.min(T::one());
    output.p_jump = probability(sum_from(present, 0));
    output.p_noise = probability(sum_from(absent, normal_levels) + sum_from(present, normal_levels));
    let p_fault = probability(output.p_jump + sum_from(absent, normal_levels));
    output.p_fault = p_fault + output.p_memory * (T::one() - p_fault);
}

fn read_estimates<T: RealField + Copy, const LEVELS: usize>(
    output: &mut HealthOutput<T, LEVELS>,
    now: &Conditional<T>,
    radio: Option<T>,
    inertial: Option<T>,
    present: bool,
) {
    let [eps, xi, m, mu] = now.mean;
    let [p00, _, p02, _, p11, _, _, p22, _, p33] = now.covariance;
    let estimate = |value: T, variance: T| Estimate { value, sigma: variance.max(T::zero()).sqrt() };
    output.correlated_error = estimate(eps, p00);
    output.inertial_error = estimate(xi, p11);
    output.jump = estimate(m, p22);
    output.inertial_drift = estimate(mu, p33);
    output.radio_error =
        if present { estimate(output.residual + xi, p11) } else { estimate(eps + m, p00 + p02 + p02 + p22) };
    output.corrected = match (radio, inertial) {
        (_, Some(inertial)) => Some(Estimate { value: inertial - xi, sigma: output.inertial_error.sigma }),
        (Some(radio), None) => {
            Some(Estimate { value: radio - output.radio_error.value, sigma: output.radio_error.sigma })
        }
        (None, None) => None,
    };
}

saved!([T: Blank, const LEVELS: usize] HealthMonitor<T, LEVELS> {
    state,
    priors,
    ladder,
    thresholds,
    normal_levels < LEVELS + 1,
    inertial_bound,
    attribution_steps,
    unobserved_steps,
    bridged_steps < MAX_SPAN_STEPS + 1,
    max_age_ms,
    memory,
});
saved!([T: Blank, const LEVELS: usize] State<T, LEVELS> { recursion, started, silence, rejected, jump_steps, alarms });

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights of a flight in single precision, of which the three with a fault sum up to 1.0000001.
    #[test]
    fn rounding_takes_no_probability_beyond_one() {
        let weights = [[1.296_987_2e-9_f32, 0.226_948_57], [0.531_888_9, 0.241_162_57]];
        assert!(weights[1][0] + weights[1][1] + weights[0][1] > 1.0);
        let mut output = HealthOutput::default();
        read_probabilities(&mut output, &weights, 1);
        assert_eq!(output.p_fault.to_bits(), 1.0_f32.to_bits());
    }
}
