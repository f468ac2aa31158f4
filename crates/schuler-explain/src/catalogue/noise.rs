//! The random part is another than the nominal model says.
use super::draft::{Draft, any, at_each_place, inertial};
use super::form::Form;
use super::in_flight::{IS_A_FAILURE, IS_NOISE};
use super::{Candidate, Effect, NoiseChange, ReadingFault, Search};
use crate::inputs::{Inputs, Place};
use crate::sentence::QUANTITY;

const IEEE_952: &str = "IEEE Std 952, annex C (stochastic model and Allan variance)";

/// A row of the catalogue on the structure of the noise.
macro_rules! noise {
    ($name:ident, $id:literal, $formula:literal, $sentence:literal, $separated_by:literal, $acts_on:expr, $change:expr) => {
        pub(super) const $name: Effect = Effect {
            id: $id,
            formula: $formula,
            sentence: $sentence,
            needs: "a record much longer than the correlation time",
            separated_by: $separated_by,
            source: IEEE_952,
            in_flight: IS_NOISE,
            form: Form::Values,
            acts_on: $acts_on,
            candidates: |effect, inputs| changed(effect, inputs, $change),
        };
    };
}

noise!(
    NOISE_WHITE,
    "noise_white",
    "white level other than nominal",
    "has another white noise than nominal",
    "record at a higher rate: white noise grows with its square root",
    any,
    NoiseChange::White
);
noise!(
    NOISE_MARKOV,
    "noise_markov",
    "R(τ) = σ² exp(−|τ|/τ_c)",
    "has another first-order Markov noise than nominal",
    "a record of a hundred correlation times at constant temperature",
    any,
    NoiseChange::Markov
);
noise!(
    NOISE_EXP_COS,
    "noise_exp_cos",
    "R(τ) = σ² exp(−α|τ|) cos βτ",
    "has an oscillating random error",
    "a record of a hundred periods: a line stays narrow, an oscillating noise has a band",
    any,
    NoiseChange::ExponentialCosine
);
noise!(
    NOISE_RANDOM_WALK,
    "noise_random_walk",
    "integrated white noise",
    "wanders as a random walk",
    "a longer record: a Markov process returns, a random walk does not",
    any,
    NoiseChange::RandomWalk
);
noise!(
    NOISE_FLICKER,
    "noise_flicker",
    "bias instability, as a sum of Markov terms",
    "has flicker noise",
    "Allan deviation over three decades of averaging time: flat for flicker, a hump for one Markov term",
    any,
    NoiseChange::Flicker
);
noise!(
    NOISE_ANGLE_QUANTISATION,
    "noise_angle_quantisation",
    "differenced quantisation, Allan slope −1",
    "reads the differences of a coarsely counted angle",
    "record at a lower rate: differenced quantisation falls with the averaging time, white noise with its square root",
    inertial,
    NoiseChange::AngleQuantisation
);
pub(super) const NOISE_VARIANCE_STEP: Effect = Effect {
    id: "noise_variance_step",
    formula: "white level changes at t₀, or where a quantity is large",
    sentence: "changes its noise level",
    needs: "nothing",
    separated_by: "repeat the run",
    source: IEEE_952,
    in_flight: IS_NOISE,
    form: Form::Values,
    acts_on: any,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            let mut drafts = vec![Draft::new(Search::Noise(NoiseChange::VarianceStep), Vec::new())];
            if place.port == super::Port::Output {
                drafts.extend(inputs.loudness().iter().enumerate().map(|(quantity, loudness)| {
                    Draft::new(Search::Noise(NoiseChange::LevelAbove(quantity)), Vec::new())
                        .with(QUANTITY, loudness.name)
                }));
            }
            drafts
        })
    },
};

pub(super) const NOISE_OUTLIERS: Effect = Effect {
    id: "noise_outliers",
    formula: "isolated spikes",
    sentence: "has isolated spikes",
    needs: "nothing",
    separated_by: "log the raw words of the link: spikes of the link are not in the sensor",
    source: IEEE_952,
    in_flight: IS_A_FAILURE,
    form: Form::Values,
    acts_on: any,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            if place.port != super::Port::Output {
                return Vec::new();
            }
            vec![Draft::new(Search::Readings(ReadingFault::Outliers), Vec::new())]
        })
    },
};

/// The parameters of a change are found by the search itself, so a candidate has no amplitudes of its own.
fn changed(effect: &'static Effect, inputs: &Inputs<'_>, change: NoiseChange) -> Vec<Candidate> {
    at_each_place(effect, inputs, |_: &Place| vec![Draft::new(Search::Noise(change), Vec::new())])
}
