//! The nominal model of a recording as it is explained: without the readings that faults spoil, with the lattices on which readings lie,
//! and with a white level where the case states no noise.
use std::borrow::Cow;

use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, SensorKind};
use schuler_recording::motion::predict;
use schuler_recording::recording::SensorSeries;

use crate::catalogue::{Candidate, Port, ReadingFault, Search};
use crate::config::Config;
use crate::description::{log_likelihood, project, sensors_of};
use crate::explain::Error;
use crate::faults::{FEWEST_PILED, Fault, Faults, LEAST_STEP, faults, lattice};
use crate::inputs::Inputs;
use crate::inputs::held::without_held_reference;
use crate::inputs::resets::without_resets;
use crate::noise::fit::SourceKnob;
use crate::noise::{Knob, Noise};
use crate::nominal::{FEWEST_ROWS, Model};
use crate::numeric::minimise::golden;

/// Shift of a mean by rounding, in steps, up to which the noise carries the readings over the steps.
const UNCARRIED: f64 = 0.05;

/// The model of a recording, and what was seen in its readings.
pub struct Prepared {
    /// Without the readings that faults spoil.
    pub model: Model,
    /// With all readings.
    pub unmasked: Model,
    /// What readings show of themselves.
    pub faults: Faults,
    /// White levels of which the case says nothing, which are fitted and no finding.
    pub unstated: Vec<SourceKnob>,
}

/// The recording as it is explained.
pub fn as_explained(recording: &Recording) -> Cow<'_, Recording> {
    without_resets(without_held_reference(against_constants(recording)))
}

/// The inputs of a case need a recording of some length.
///
/// # Errors
/// [`Error::TooShort`].
pub fn long_enough(recording: &Recording) -> Result<(), Error> {
    let (rows, least) = (recording.len(), FEWEST_ROWS);
    if rows < least { Err(Error::TooShort { rows, least }) } else { Ok(()) }
}

/// The model that is explained.
///
/// # Errors
/// Where no sensor can be compared, or the nominal noise of one is singular.
pub fn prepared(inputs: &Inputs<'_>, config: &Config) -> Result<Prepared, Error> {
    let recording = inputs.recording;
    let unmasked = model_without(&[], inputs)?;
    let mut faults = faults(recording, &unmasked);
    let angles: Vec<Fault> = faults.found.extract_if(.., |fault| is_of_angle(&unmasked, fault)).collect();
    let of_angle: Vec<usize> = angles.iter().map(|fault| fault.sensor).collect();
    let is_told = |fault: &Fault| fault.evidence + config.ln_odds_of_faults > config.least_ln_odds();
    faults.found.retain(is_told);
    let mut model = model_without(&faults.masked, inputs)?;
    account_for_lattices(&mut model, recording, &of_angle);
    let unstated = with_estimated_levels(&mut model);
    let noises = model.nominal_noises();
    let singular = model.blocks.iter().find(|block| block.filter(&noises).is_none());
    if let Some(block) = singular {
        let names = block.sources.iter().map(|&source| model.sources[source].name.as_str());
        let sensor = names.collect::<Vec<_>>().join(", ");
        return Err(Error::Singular { sensor, what: "its variance must be positive".to_owned() });
    }
    Ok(Prepared { model, unmasked, faults, unstated })
}

/// The recording, in which the sensors of a body at rest whose input the case does not tell, for want of its attitude, say, are read against an
/// unknown constant: whatever that input is, it is one. So are those of any kind of which nothing says at what level they are.
fn against_constants(recording: &Recording) -> Cow<'_, Recording> {
    // Of a body that moves a prediction is the work of the model, and not made twice.
    let at_rest = recording.case.motion.kind == MotionKind::Static;
    let is_untold = |series: &SensorSeries| {
        let sensor = &series.sensor;
        if sensor.kind == SensorKind::Other {
            // A bias that is stated is its level.
            return series.predicted.is_none() && sensor.nominal.bias == 0.0;
        }
        at_rest && predict(recording, sensor).is_err()
    };
    let untold: Vec<bool> = recording.sensors.iter().map(is_untold).collect();
    if !untold.contains(&true) {
        return Cow::Borrowed(recording);
    }
    let mut recording = recording.clone();
    for (series, untold) in recording.sensors.iter_mut().zip(untold) {
        series.sensor.relative |= untold;
    }
    Cow::Owned(recording)
}

/// The nominal model without the readings in `masked`, whose white levels may go with quantities.
fn model_without(masked: &[Vec<bool>], inputs: &Inputs<'_>) -> Result<Model, Error> {
    let mut model = Model::new(inputs.recording, masked).map_err(Error::NothingToCompare)?;
    model.goes_with(inputs.loudness());
    Ok(model)
}

/// Whether readings lie on a lattice because the angle whose difference they are is rounded: neighbours' errors are then
/// opposite, while those of rounded readings are independent.
fn is_of_angle(model: &Model, fault: &Fault) -> bool {
    let (Some(block), Some(source)) =
        (model.block_of(fault.sensor), model.source_of(fault.sensor, Port::Output))
    else {
        return false;
    };
    let Some(step) = fault.lattice_step() else { return false };
    let projected = project(model, block, &[]);
    // Where the noise is more than the case says, whatever has more of it would be the likelier: its level is free.
    let likelihood = |change: &dyn Fn(&mut Noise)| {
        let mut noises = model.nominal_noises();
        change(&mut noises[source]);
        let nominal = noises[source].white.max(0.1 * step);
        let cost = |log: f64| {
            let mut noises = noises.clone();
            noises[source].white = nominal * log.exp();
            -log_likelihood(&model.blocks[block], &noises, &projected)
        };
        -golden(-1.5, 1.5, 0.03, cost).1
    };
    let rounded = likelihood(&|noise| noise.rounding = step);
    likelihood(&|noise| noise.angle = step / 12.0_f64.sqrt()) > rounded
}

/// The steps of the lattices on which readings lie, but for those of an angle, are part of their noise.
fn account_for_lattices(model: &mut Model, recording: &Recording, of_angle: &[usize]) {
    for source in model.sources.iter_mut().filter(|source| source.port == Port::Output) {
        if of_angle.contains(&source.sensor) {
            continue;
        }
        let values = recording.sensors.get(source.sensor).map(|series| series.values.as_slice());
        if let Some(lattice) = values.and_then(lattice) {
            source.nominal.rounding = source.nominal.rounding.max(lattice.step);
        }
    }
}

/// Gives sources of which the user says nothing white noise by the spread of differences.
fn with_estimated_levels(model: &mut Model) -> Vec<SourceKnob> {
    let mut unstated = Vec::new();
    for index in 0..model.sources.len() {
        if !model.sources[index].unknown {
            continue;
        }
        let Some(block) = model.blocks.iter().find(|block| block.sources.contains(&index)) else { continue };
        let white = block.white_by_differences();
        model.sources[index].nominal.white = white;
        unstated.push((index, Knob::White));
    }
    unstated
}

/// Most by which rounding to `step` shifts the mean of a constant input with noise of standard deviation `white`, in the unit
/// of both: the sawtooth that rounding adds, Σ (−1)ᵏ (step/πk) sin 2πk x/step, whose every harmonic the noise averages by
/// exp(−2π²k² white²/step²) `[Widrow and Kollár, Quantization Noise, Cambridge 2008, ch. 4]`; without noise half a step.
fn shift_by_rounding(step: f64, white: f64) -> f64 {
    use std::f64::consts::PI;
    let harmonics =
        (1..=20).map(f64::from).map(|k: f64| (-2.0 * (PI * k * white / step).powi(2)).exp() / (PI * k));
    step * harmonics.sum::<f64>().min(0.5)
}

/// Whether a candidate is about the noise, or a mean that comes and goes, of an output that is clipped or coarse: what is left of it
/// then is not what the sensor's noise was, and readings of a few levels have a mean for each. Rounding that the noise carries over the
/// steps adds to it and leaves it as it was, and so does a limit that is reached once.
pub fn is_spoilt(candidate: &Candidate, faults: &[Fault], model: &Model) -> bool {
    let coarse = |fault: &Fault| {
        let white = model.white_of(fault.sensor);
        let step = fault.lattice_step().filter(|step| *step >= LEAST_STEP * white);
        match candidate.search {
            Search::Readings(ReadingFault::IntermittentJump) => step.is_some(),
            _ => step.is_some_and(|step| shift_by_rounding(step, white) > UNCARRIED * step),
        }
    };
    let spoils = |fault: &Fault| {
        let is_brief = fault.rows.1 - fault.rows.0 < FEWEST_PILED;
        sensors_of(candidate).contains(&fault.sensor)
            && (coarse(fault) || fault.fault == ReadingFault::Saturated && !is_brief)
    };
    let of_noise =
        matches!(candidate.search, Search::Noise(_) | Search::Readings(ReadingFault::IntermittentJump));
    of_noise && faults.iter().any(spoils)
}

#[cfg(test)]
mod tests {
    use super::shift_by_rounding;

    /// Against the mean of rounded normal values, at the worst input.
    #[test]
    fn rounding_shifts_a_mean_by_what_the_noise_does_not_carry_over_a_step() {
        assert!((shift_by_rounding(1.0, 0.0) - 0.5).abs() < 1e-12);
        // Mean of round(x + 0.3 z) less x, by summing over the normal distribution: 0.0538 at most, near x = 0.25.
        assert!((shift_by_rounding(1.0, 0.3) - 0.0538).abs() < 5e-4);
        assert!((shift_by_rounding(2e-6, 0.6e-6) - 2e-6 * 0.0538).abs() < 1e-9);
        assert!(shift_by_rounding(1.0, 1.0) < 1e-8);
    }
}
