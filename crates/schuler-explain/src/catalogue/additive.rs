//! Errors that time alone makes: constants, steps, drifts, warm-up, lines.
use schuler_recording::case::SensorKind;
use schuler_recording::motion::earth;

use super::draft::{
    Draft, HOUR, ITSELF, Plausible, amplitude, any, at_each_instrument_place, at_each_place, coefficient,
    in_common, time_constant,
};
use super::form::Form;
use super::in_flight::{InFlight, OF_THIS_RECORD, OF_UNKNOWN_PHASE, Part};
use super::{Effect, OnsetShape, Search};
use crate::inputs::series::map;
use crate::inputs::{Inputs, Place, Series};

/// A drift needs this many rows to be told from a step.
const LEAST_ROWS: usize = 100;
/// Least length of a record that shows a warm-up, s.
const WARMUP_S: f64 = 60.0;
/// Part of a Schuler period that a record must have to show the oscillation.
const SCHULER_PERIODS: f64 = 0.5;
/// Part of a day that it must have to show the daily one.
const DAYS: f64 = 0.5;

const IEEE_528: &str = "IEEE Std 528 (terminology of inertial sensors)";

pub(super) const BIAS_CONSTANT: Effect = Effect {
    id: "bias_constant",
    formula: "k",
    sentence: "has a constant error",
    needs: "known input; not a relative sensor",
    separated_by: "turn the sensor's axis by 180° between two runs: a bias keeps its sign, an input error changes it",
    source: IEEE_528,
    in_flight: InFlight::Term([Part::One, Part::One]),
    form: Form::Term,
    acts_on: any,
    candidates: |effect, inputs| {
        at_each_place(effect, inputs, |place| {
            if place.relative || !has_known_zero(inputs, place) {
                return Vec::new();
            }
            let plausible = Plausible::inertial([0.01, 1.0], [10.0, 100.0]);
            vec![Draft::linear(place, vec![1.0; inputs.rows()], coefficient(place, ITSELF, plausible))]
        })
    },
};

pub(super) const BIAS_STEP: Effect = Effect {
    id: "bias_step",
    formula: "k·1(t ≥ t₀)",
    sentence: "jumps by a constant",
    needs: "nothing but time on either side of the step",
    separated_by: "repeat the run: a step of the sensor's own does not come again at the same time",
    source: IEEE_528,
    in_flight: OF_THIS_RECORD,
    form: Form::Step,
    acts_on: any,
    candidates: |effect, inputs| {
        let plausible = Plausible::inertial([0.01, 1.0], [5.0, 100.0]);
        let amplitudes = |place: &Place| vec![coefficient(place, ITSELF, plausible)];
        let search = || Search::Onset(OnsetShape::Step);
        let mut all = at_each_place(effect, inputs, |place| vec![Draft::new(search(), amplitudes(place))]);
        all.extend(in_common(effect, inputs, search, amplitudes));
        all
    },
};

pub(super) const BIAS_DRIFT_LINEAR: Effect = Effect {
    id: "bias_drift_linear",
    formula: "k·(t − t₀)₊",
    sentence: "drifts steadily",
    needs: "hours",
    separated_by: "hold the temperature constant for as long again: ageing goes on, a thermal drift ends",
    source: IEEE_528,
    in_flight: OF_THIS_RECORD,
    form: Form::Drift,
    acts_on: any,
    candidates: |effect, inputs| {
        at_each_instrument_place(effect, inputs, |place| {
            if inputs.rows() < LEAST_ROWS {
                return Vec::new();
            }
            let plausible = Plausible { gyro: Some([0.001, 0.1]), ..Plausible::UNKNOWN };
            let amplitude = || vec![coefficient(place, HOUR, plausible)];
            vec![
                Draft::linear(place, inputs.time_s.to_vec(), coefficient(place, HOUR, plausible)),
                Draft::new(Search::Onset(OnsetShape::Ramp), amplitude()),
            ]
        })
    },
};

pub(super) const BIAS_WARMUP: Effect = Effect {
    id: "bias_warmup",
    formula: "k·exp(−t/τ), t from the first row or from the last switch-on",
    sentence: "settles after switch-on",
    needs: "record from switch-on",
    separated_by: "switch on at another ambient temperature: warm-up comes again, dependence on T changes",
    source: "IEEE Std 813 (DTG test procedure), warm-up; IEEE Std 1293 for accelerometers",
    in_flight: OF_THIS_RECORD,
    form: Form::WarmUp,
    acts_on: any,
    candidates: |effect, inputs| {
        if inputs.duration_s() < WARMUP_S {
            return Vec::new();
        }
        let Some(tau) = time_constant(inputs, 60.0, 6.0 * 3600.0) else { return Vec::new() };
        // Where readings are missing for long it may have been switched off, or have gone on unrecorded.
        let mut ways: Vec<(&str, Series)> = vec![("before the record", inputs.time_s.clone())];
        if inputs.run_starts.len() > 1 {
            ways.push(("again after each long gap", inputs.since_switch_on_s().into()));
        }
        at_each_instrument_place(effect, inputs, |place| {
            let plausible = Plausible::inertial([0.05, 5.0], [10.0, 300.0]);
            let counted = |(name, since): &(&str, Series)| {
                let since = since.clone();
                let amplitude = coefficient(place, ITSELF, plausible);
                let values = move |tau: f64| map(&since, |t| (-t / tau).exp());
                let draft = Draft::grid(place, tau.clone(), amplitude, values);
                if ways.len() > 1 { draft.with("switched_on", *name) } else { draft }
            };
            ways.iter().map(counted).collect()
        })
    },
};

pub(super) const BIAS_RESTART: Effect = Effect {
    id: "bias_restart",
    formula: "a constant per run",
    sentence: "has another constant error after each switch-on",
    needs: "several switch-ons, or gaps that may hide them, in one record",
    separated_by: "more switch-ons at one temperature",
    source: "IEEE Std 528, repeatability from turn-on to turn-on",
    in_flight: OF_THIS_RECORD,
    form: Form::Runs,
    acts_on: any,
    candidates: |effect, inputs| {
        if inputs.possible_run_starts.len() < 2 {
            return Vec::new();
        }
        at_each_instrument_place(effect, inputs, |place| {
            let plausible = Plausible::inertial([0.005, 0.1], [10.0, 100.0]);
            let ends = inputs.possible_run_starts.iter().skip(1).copied().chain([inputs.rows()]);
            let runs: Vec<_> = inputs.possible_run_starts.iter().copied().zip(ends).enumerate().collect();
            let draft = |from: usize| {
                let columns = runs.iter().skip(from).map(|&(run, (start, end))| {
                    let values = (0..inputs.rows()).map(|row| f64::from(u8::from(row >= start && row < end)));
                    let name = format!("coefficient_run_{}", run + 1);
                    (values.collect(), amplitude(place, &name, ITSELF, plausible))
                });
                Draft::columns(place, columns.collect())
            };
            // The first run may be the one that the bias was calibrated in, from which the others differ, or as new as they are.
            if place.relative { vec![draft(1)] } else { vec![draft(1), draft(0)] }
        })
    },
};

pub(super) const PERIODIC_LINE: Effect = Effect {
    id: "periodic_line",
    formula: "a cos 2πft + b sin 2πft",
    sentence: "carries a line of one frequency",
    needs: "a few periods",
    separated_by: "another sampling rate moves an alias; another spin rate or engine speed moves its own line",
    source: "IEEE Std 813, spin-frequency and 2N noise; IEEE Std 647 for dither",
    in_flight: OF_UNKNOWN_PHASE,
    form: Form::Waves,
    acts_on: any,
    candidates: |effect, inputs| {
        let plausible = Plausible { gyro: Some([0.001, 0.1]), ..Plausible::UNKNOWN };
        let amplitudes =
            |place: &Place| ["a", "b"].map(|name| amplitude(place, name, ITSELF, plausible)).to_vec();
        let mut all =
            at_each_place(effect, inputs, |place| vec![Draft::new(Search::Frequency, amplitudes(place))]);
        all.extend(in_common(effect, inputs, || Search::Frequency, amplitudes));
        all
    },
};

pub(super) const SCHULER_OSCILLATION: Effect = Effect {
    id: "schuler_oscillation",
    formula: "a cos ω_S t + b sin ω_S t, ω_S = √(g/R), and the same at the Earth's rate",
    sentence: "oscillates with the Schuler period",
    needs: "hours; a velocity of an inertial system",
    separated_by: "run longer than one period of 84.4 min, or damp the loop with an outside velocity",
    source: "Schuler, Physikalische Zeitschrift 24 (1923) 344",
    in_flight: OF_UNKNOWN_PHASE,
    form: Form::Waves,
    acts_on: |kind| matches!(kind, SensorKind::InsVelocity),
    candidates: |effect, inputs| {
        let schuler = schuler_rate(inputs);
        let turns = |rate: f64| inputs.duration_s() * rate / std::f64::consts::TAU;
        if turns(schuler) < SCHULER_PERIODS {
            return Vec::new();
        }
        at_each_place(effect, inputs, |place| {
            let plausible = Plausible { velocity: Some([0.01, 10.0]), ..Plausible::UNKNOWN };
            let wave = |name: &str, rate: f64, phase: fn(f64) -> f64| {
                let values = map(&inputs.time_s, |t| phase(rate * t));
                (values, amplitude(place, name, ITSELF, plausible))
            };
            let mut columns = vec![wave("a", schuler, f64::cos), wave("b", schuler, f64::sin)];
            if turns(earth::ROTATION_RATE) >= DAYS {
                columns.push(wave("a_day", earth::ROTATION_RATE, f64::cos));
                columns.push(wave("b_day", earth::ROTATION_RATE, f64::sin));
            }
            vec![Draft::columns(place, columns)]
        })
    },
};

/// ω_S = √(g/R), rad/s.
pub(crate) fn schuler_rate(inputs: &Inputs<'_>) -> f64 {
    match inputs.recording.case.schuler_loop {
        Some(nominal) => (nominal.gravity / nominal.radius_m).sqrt(),
        None => (crate::inputs::motion::gravity(inputs.recording) / earth::SEMI_MAJOR_AXIS).sqrt(),
    }
}

/// Whether a constant error can be seen: against a known input, against other sensors, or in the loop.
fn has_known_zero(inputs: &Inputs<'_>, place: &Place) -> bool {
    let others = || (inputs.places.iter()).filter(|other| other.dimension() == place.dimension()).count() > 1;
    // One of any kind that is not relative has a level that the case states.
    inputs.is_loop()
        || place.kind == SensorKind::Other
        || (place.input.is_some() && (!place.is_estimated || others()))
}
