//! What readings show of a failure without a model of the sensor, and a limit that a known input shows.
use super::draft::{Draft, ITSELF, Plausible, any, at_each_place, coefficient};
use super::form::Form;
use super::in_flight::IS_A_FAILURE;
use super::input::clipped_inputs;
use super::{Candidate, Effect, Port, ReadingFault, Search};
use crate::inputs::Inputs;

const SOURCE: &str =
    "IEEE Std 528; failure modes as in Titterton & Weston, Strapdown Inertial Navigation Technology";

/// A row of the catalogue that is judged from the readings.
macro_rules! failure {
    ($name:ident, $id:literal, $formula:literal, $sentence:literal, $needs:literal, $separated_by:literal, $fault:expr) => {
        pub(super) const $name: Effect = Effect {
            id: $id,
            formula: $formula,
            sentence: $sentence,
            needs: $needs,
            separated_by: $separated_by,
            source: SOURCE,
            in_flight: IS_A_FAILURE,
            form: Form::Values,
            acts_on: any,
            candidates: |effect, inputs| readings(effect, inputs, $fault),
        };
    };
}

failure!(
    OUTPUT_STUCK,
    "output_stuck",
    "output constant from t₀",
    "is stuck",
    "nothing",
    "turn the sensor: a stuck output does not answer",
    ReadingFault::Stuck
);
pub(super) const OUTPUT_SATURATED: Effect = Effect {
    id: "output_saturated",
    formula: "clipped at ±limit",
    sentence: "is clipped at a limit",
    needs: "inputs beyond the limit",
    separated_by: "the same motion with less amplitude",
    source: SOURCE,
    in_flight: IS_A_FAILURE,
    form: Form::Clipped,
    acts_on: any,
    // A converter's limit shows in the readings that equal it. What is clipped before the noise comes to it, as by a torquer that
    // can no more, shows beside a known input only.
    candidates: |effect, inputs| {
        let mut candidates = readings(effect, inputs, ReadingFault::Saturated);
        candidates.extend(clipped_inputs(effect, inputs));
        candidates
    },
};
failure!(
    QUANTISATION,
    "quantisation",
    "rounding to a step",
    "is read in coarser steps than nominal",
    "nothing",
    "log the raw words",
    ReadingFault::Quantised
);
failure!(
    INTERMITTENT_JUMP,
    "intermittent_jump",
    "a Markov on/off shift of the mean",
    "jumps on and off",
    "nothing",
    "repeat with another antenna or another bottom: a radio or acoustic fault changes, a sensor's does not",
    ReadingFault::IntermittentJump
);

fn readings(effect: &'static Effect, inputs: &Inputs<'_>, fault: ReadingFault) -> Vec<Candidate> {
    at_each_place(effect, inputs, |place| {
        if place.port != Port::Output {
            return Vec::new();
        }
        let amplitudes = match fault {
            ReadingFault::IntermittentJump => vec![coefficient(place, ITSELF, Plausible::UNKNOWN)],
            _ => Vec::new(),
        };
        vec![Draft::new(Search::Readings(fault), amplitudes)]
    })
}
