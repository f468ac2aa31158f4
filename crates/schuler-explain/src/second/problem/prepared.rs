//! The nominal model of a recording as it is explained: without the readings that faults spoil, with the lattices on which readings lie,
//! and with a white level where the case states no noise.
use crate::explain::{
    Error, account_for_lattices, estimate_unknown, is_of_angle, model_without, no_singular_noise,
};
use crate::inputs::Inputs;
use crate::nominal::Model;
use crate::readings::{Fault, Faults, faults};
use crate::second::config::Config;
use crate::second::noise::fit::SourceKnob;

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
    let unstated = estimate_unknown(&mut model);
    no_singular_noise(&model, &model.nominal_noises())?;
    Ok(Prepared { model, unmasked, faults, unstated })
}
