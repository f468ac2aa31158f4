//! Why a recording does not look like its simulation: the whole way from a recording to an [`Explanation`].
use std::borrow::Cow;

use rayon::prelude::*;
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, SensorKind};
use schuler_recording::motion::predict;
use schuler_recording::recording::SensorSeries;
use thiserror::Error;

use crate::arrays::arrays;
use crate::budget::Budget;
use crate::catalogue::{
    CATALOGUE, Candidate, Effect, Port, ReadingFault, Search, Target, share_equal_series,
};
use crate::common_motion::CommonMotion;
use crate::description::{Delays, Term, project, sensors_of};
use crate::equivalence::{Alternative, alternatives, class, target_name};
use crate::evidence::CaseArrays;
use crate::explanation::{
    Evidence, Explanation, FORMAT, Finding, Fit, NoiseShift, Parameter, Rival, Verdict,
};
use crate::hold_out::hold_out;
use crate::inputs::Inputs;
use crate::inputs::held::without_held_reference;
use crate::instead::PairInstead;
use crate::locate;
use crate::minimise::golden;
use crate::noise::{Knob, Noise, RowsOfLevel};
use crate::noise_fit::{SourceKnob, exact};
use crate::nominal::{Block, FEWEST_ROWS, Model};
use crate::readings::{FEWEST_PILED, Fault, Faults, LEAST_STEP, OFF_LATTICE, faults, lattice};
use crate::refit::parameters;
use crate::search::{Family, by_all_readings, refine_terms};
use crate::select::{
    Item, MOST_FINDINGS, Selection, Shown, add_change, evidence_of, gain_of_item, judged_again, select,
    without,
};
use crate::sentence::sentence;
use crate::smooth::in_the_place_of_noise;
use crate::state::{Bench, Case, State, refitted};
use crate::watch::{Phase, Unwatched, Watch};

/// Part of the gain of a term below which what else is found on the same sensor may be what the term leaves over: a form
/// that is right within a tenth of its size (an interpolated reference, a smoothed input) leaves the square of that.
const FORM: f64 = 0.01;

/// The same among dependences on temperature: the thermometer tells what the sensor feels within some 30 % of its
/// changes, because it sits elsewhere and is late.
const THERMAL_FORM: f64 = 0.1;

/// Part of what differs from row to row from which on it goes with the reference.
const OF_THE_REFERENCE: f64 = 0.8;

/// What is said where the search ended at its budget of work.
const EXCEEDED: &str = "the search ended at its budget of work: there may be more to find, and what was found may look like more \
                        than is said";

/// A coarse output.
const QUANTISATION: &str = "quantisation";
/// Shift of a mean by rounding, in steps, up to which the noise carries the readings over the steps.
const UNCARRIED: f64 = 0.05;
/// The effect of an angle that is counted in steps.
const ANGLE_QUANTISATION: &str = "noise_angle_quantisation";

/// What may be chosen.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Family-wise probability of a false finding.
    pub level: f64,
    /// Whether the description is judged on blocks held out.
    pub hold_out: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { level: 0.01, hold_out: true }
    }
}

/// Why nothing can be explained.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum Error {
    /// The record is too short.
    #[error("the recording has {rows} rows; expected at least {least}")]
    TooShort {
        /// Rows found.
        rows: usize,
        /// Rows needed.
        least: usize,
    },
    /// No sensor can be compared with the simulation.
    #[error("{0}")]
    NothingToCompare(String),
    /// The nominal noise of a sensor is singular.
    #[error("{sensor}: the nominal noise makes the model singular: {what}")]
    Singular {
        /// The sensors.
        sensor: String,
        /// What is wrong.
        what: String,
    },
    /// Whoever watches has ended it.
    #[error("cancelled")]
    Cancelled,
    /// An option is out of range.
    #[error("level: found {0}; expected a probability between 0 and 1")]
    Level(String),
}

/// Explains a recording by the catalogue.
///
/// # Errors
/// What in the recording or the case leaves nothing to explain.
pub fn explain(recording: &Recording, options: &Options) -> Result<Explanation, Error> {
    long_enough(recording)?;
    let recording = as_explained(recording);
    let inputs = Inputs::new(&recording);
    explain_with(&inputs, candidates(&inputs), options)
}

/// Explains a recording by given candidates.
///
/// # Errors
/// What in the recording or the case leaves nothing to explain.
pub fn explain_with(
    inputs: &Inputs<'_>,
    candidates: Vec<Candidate>,
    options: &Options,
) -> Result<Explanation, Error> {
    explained(inputs, candidates, options, &Unwatched, |_, _, _| ()).map(|(explanation, ())| explanation)
}

/// The recording as it is explained.
pub(crate) fn as_explained(recording: &Recording) -> Cow<'_, Recording> {
    without_held_reference(against_constants(recording))
}

/// As [`explain`], with the arrays that show it, and watched: it tells how far it has come, and ends with
/// [`Error::Cancelled`] when it is told to.
///
/// # Errors
/// As [`explain`], and [`Error::Cancelled`].
pub fn explain_watched(
    recording: &Recording,
    options: &Options,
    watch: &dyn Watch,
) -> Result<(Explanation, CaseArrays), Error> {
    long_enough(recording)?;
    watch.progress(Phase::Prepare, 0.0);
    let recording = as_explained(recording);
    let inputs = Inputs::new(&recording);
    unless_cancelled(watch)?;
    watch.progress(Phase::Prepare, 0.3);
    let candidates = candidates(&inputs);
    unless_cancelled(watch)?;
    explained(&inputs, candidates, options, watch, |case, selection, findings| {
        arrays(case, &selection.null, &selection.state, findings)
    })
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

pub(crate) fn unless_cancelled(watch: &dyn Watch) -> Result<(), Error> {
    if watch.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
}

/// The inputs of a case need a recording of some length.
pub(crate) fn long_enough(recording: &Recording) -> Result<(), Error> {
    let (rows, least) = (recording.len(), FEWEST_ROWS);
    if rows < least { Err(Error::TooShort { rows, least }) } else { Ok(()) }
}

/// What the whole catalogue gives in a case.
fn candidates(inputs: &Inputs<'_>) -> Vec<Candidate> {
    let of_effect = |effect: &'static Effect| {
        let mut candidates = (effect.candidates)(effect, inputs);
        share_equal_series(&mut candidates);
        candidates
    };
    CATALOGUE.par_iter().flat_map_iter(of_effect).collect()
}

/// The explanation, and what `show` makes of the selection behind it.
fn explained<S>(
    inputs: &Inputs<'_>,
    mut candidates: Vec<Candidate>,
    options: &Options,
    watch: &dyn Watch,
    show: impl FnOnce(&Case<'_>, &Selection<'_>, &[Finding]) -> S,
) -> Result<(Explanation, S), Error> {
    let recording = inputs.recording;
    long_enough(recording)?;
    if !(options.level > 0.0 && options.level < 1.0) {
        return Err(Error::Level(options.level.to_string()));
    }
    let unmasked = model_without(&[], inputs)?;
    let mut faults = faults(recording, &unmasked);
    let angles: Vec<Fault> = faults.found.extract_if(.., |fault| is_of_angle(&unmasked, fault)).collect();
    let of_angle: Vec<usize> = angles.iter().map(|fault| fault.sensor).collect();
    let mut model = prepared(&unmasked, &faults, &of_angle, inputs)?;
    candidates.retain(|candidate| acts(&model, candidate) && !is_spoilt(candidate, &faults.found, &model));
    let nuisances = estimate_unknown(&mut model);
    let noises = model.nominal_noises();
    no_singular_noise(&model, &noises)?;
    unless_cancelled(watch)?;
    let case = Case::new(&model, &candidates, &inputs.time_s, watch);
    let start = State {
        terms: Vec::new(),
        noises,
        changes: Vec::new(),
        nuisances,
        log_likelihood: f64::NEG_INFINITY,
        told_beside: 0.0,
    };
    watch.progress(Phase::Search, 0.0);
    let mut selection = select(&case, &start, options.level);
    unless_cancelled(watch)?;
    // Readings that are louder where something shakes the sensor had been taken for spikes; and what was read beyond the record the search
    // took to go straight on.
    let louder = if faults.spikes_of_levels(&unmasked, &selection.state.noises) {
        let mut louder = prepared(&unmasked, &faults, &of_angle, inputs)?;
        louder.sources.clone_from(&model.sources);
        Some(louder)
    } else {
        None
    };
    let judged_in = within_record(louder.as_ref().unwrap_or(&model), &selection.state).or(louder);
    let case_again;
    let case = match &judged_in {
        Some(model) => {
            case_again = Case::new(model, &candidates, &inputs.time_s, watch);
            selection = judged_again(&case_again, selection, options.level);
            &case_again
        }
        None => &case,
    };
    let dependences = in_the_place_of_noise(case, &selection, inputs);
    let many = selection.state.terms.len() + selection.state.changes.len() >= MOST_FINDINGS;
    // Those that were taken for spikes are no longer among those of the case.
    let spiked = faults.found.iter().any(|fault| fault.fault == ReadingFault::Outliers);
    let with_all_readings = |selection: &mut Selection<'_>| {
        if spiked {
            let Selection { state, bench, .. } = selection;
            state.terms = by_all_readings(&unmasked, &candidates, &state.terms, &bench.solution.amplitudes);
            *bench = Bench::new(bench.case, &state.terms, &state.noises);
            state.log_likelihood = bench.log_likelihood;
        }
    };
    let mut findings = findings(case, &mut selection, options.level.ln(), &with_all_readings);
    let is_replaced = |finding: &Finding| {
        dependences.iter().any(|dependence| dependence.replaces(case, &selection.state, finding))
    };
    findings.retain(|finding| !is_replaced(finding));
    unless_cancelled(watch)?;
    watch.progress(Phase::Judge, 0.0);
    let Selection { state, bench, .. } = &selection;
    let described = (state.terms.as_slice(), state.noises.as_slice());
    faults.spikes_beside(&unmasked, &candidates, described, &bench.solution.amplitudes);
    join_readings(
        &mut findings,
        of_readings(recording, case, &selection.family, &faults.found, options.level),
    );
    in_order(&mut findings);
    let located = locate::locate(case, &selection.null, inputs);
    let (left, remainder) = locate::left(case, &selection.state, inputs, &dependences);
    unless_cancelled(watch)?;
    watch.progress(Phase::Judge, 0.4);
    let verdict = match (findings.is_empty(), left) {
        (true, false) => Verdict::NoMismatch,
        (true, true) => Verdict::Unexplained,
        (false, false) => Verdict::Explained,
        (false, true) => Verdict::PartlyExplained,
    };
    let fit =
        if options.hold_out { hold_out(case, &selection.null, &selection.state) } else { Fit::default() };
    let mut notes = recording.warnings.clone();
    notes.extend(model.notes.iter().cloned());
    let told = |main: &Finding, sensor: &str| told_of(case, &selection, main, sensor);
    notes.extend(set_remainders_aside(&mut findings, recording, &told));
    notes.extend(set_rounding_aside(&mut findings, &model, recording, &faults.found));
    notes.extend(set_angles_aside(&mut findings, recording, &of_angle));
    notes.extend(noise_of_references(&unmasked, recording, &findings));
    if many {
        notes.push(format!("the search ended at {MOST_FINDINGS} findings; there may be more"));
    }
    if selection.exceeded {
        notes.push(EXCEEDED.to_owned());
    }
    unless_cancelled(watch)?;
    watch.progress(Phase::Judge, 1.0);
    let shown = show(case, &selection, &findings);
    Ok((Explanation { format: FORMAT, verdict, findings, fit, located, remainder, notes }, shown))
}

/// The nominal model without the readings in `masked`, whose white levels may go with quantities.
pub(crate) fn model_without(masked: &[Vec<bool>], inputs: &Inputs<'_>) -> Result<Model, Error> {
    let mut model = Model::new(inputs.recording, masked).map_err(Error::NothingToCompare)?;
    model.goes_with(inputs.loudness());
    Ok(model)
}

/// The same without the readings that faults spoil, with what its sensors have in common and the lattices of their readings.
fn prepared(
    unmasked: &Model,
    faults: &Faults,
    of_angle: &[usize],
    inputs: &Inputs<'_>,
) -> Result<Model, Error> {
    let mut model =
        if faults.found.is_empty() { unmasked.clone() } else { model_without(&faults.masked, inputs)? };
    model.common_motions = CommonMotion::of_model(&model, inputs.recording, &faults.masked);
    account_for_lattices(&mut model, inputs.recording, of_angle);
    Ok(model)
}

/// An error where the noise of a block leaves nothing to divide by.
pub(crate) fn no_singular_noise(model: &Model, noises: &[Noise]) -> Result<(), Error> {
    let Some(block) = model.blocks.iter().find(|block| block.filter(noises).is_none()) else {
        return Ok(());
    };
    let names: Vec<&str> = block.sources.iter().map(|&source| model.sources[source].name.as_str()).collect();
    Err(Error::Singular { sensor: names.join(", "), what: "its variance must be positive".to_owned() })
}

/// The model without the rows in which an instrument that comes early or late reads what is not in the record, if there are such.
fn within_record(model: &Model, state: &State) -> Option<Model> {
    let delays = Delays::new(&state.terms);
    if delays.is_empty() {
        return None;
    }
    let beyond = |block: &Block, row: usize| {
        let time_s = model.time_s.get(row).copied().unwrap_or_default();
        block.sensors.iter().any(|&sensor| delays.reach_beyond(model, sensor, time_s))
    };
    let any = model.blocks.iter().any(|block| (0..block.rows()).any(|row| beyond(block, row)));
    any.then(|| model.without_rows(beyond))
}

/// What a finding tells of a sensor, nats: what it gains, or the energy of its term there, if that is less; of a redundant set the
/// energy is that in all its channels.
fn told_of(case: &Case<'_>, selection: &Selection<'_>, finding: &Finding, sensor: &str) -> f64 {
    let model = case.model;
    let source = model.sources.iter().find(|source| source.name == sensor);
    if let (QUANTISATION, Some(source)) = (finding.effect.as_str(), source) {
        // Of itself it leaves over the means that the noise does not carry over the steps.
        let (noise, rows) = (&source.nominal, model.rows as f64);
        let shift = shift_by_rounding(noise.rounding, noise.white);
        let most = 0.5 * rows * shift * shift / noise.white_variance();
        return finding.evidence.gain_nats.min(most / FORM);
    }
    let Some(block) = source.and_then(|source| model.block_of(source.sensor)) else {
        return finding.evidence.gain_nats;
    };
    let is_it = |term: &Term| {
        let candidate = &case.candidates[term.candidate];
        candidate.effect.id == finding.effect && target_name(model, candidate) == finding.sensor
    };
    let terms = &selection.state.terms;
    let energies = (0..terms.len())
        .filter(|&place| is_it(&terms[place]))
        .map(|place| selection.bench.energy_in(block, place));
    energies.reduce(f64::max).map_or(finding.evidence.gain_nats, |most| most.min(finding.evidence.gain_nats))
}

/// Adds what readings show of themselves. A limit that the readings equal and that the inputs show as well is one finding: the reading's own
/// limit is exact, the evidence that of the stronger.
fn join_readings(findings: &mut Vec<Finding>, of_readings: Vec<Finding>) {
    for exact in of_readings {
        let same = |known: &&mut Finding| known.sensor == exact.sensor && known.effect == exact.effect;
        let Some(known) = findings.iter_mut().find(same) else {
            findings.push(exact);
            continue;
        };
        let evidence = known.evidence;
        *known = Finding { noise_shift: std::mem::take(&mut known.noise_shift), ..exact };
        if evidence.gain_nats > known.evidence.gain_nats {
            known.evidence = evidence;
        }
    }
}

/// Takes away the findings that say of a sensor what a much stronger term on it, or on its instrument, may leave over
/// because its form is not exact, and says so. They stay in the description that is fitted. `told` is what a finding tells of a
/// sensor: a mounting leaves nothing over on gyros that do not turn.
fn set_remainders_aside(
    findings: &mut Vec<Finding>,
    recording: &Recording,
    told: &dyn Fn(&Finding, &str) -> f64,
) -> Vec<String> {
    let group = |name: &str| {
        let series = recording.sensors.iter().find(|series| series.sensor.id == name);
        series.and_then(|series| series.sensor.group.as_deref())
    };
    let meet = |a: &str, b: &str| a == b || group(a) == Some(b) || group(b) == Some(a);
    let thermal = |finding: &Finding| {
        finding.effect.starts_with("bias_temperature") || finding.effect.starts_with("bias_thermal")
    };
    // What readings show of themselves, and the level of the noise, no form leaves over.
    let of_itself = ["output_stuck", "output_saturated", QUANTISATION, "noise_outliers", "noise_white"];
    // What spoils some readings leaves nothing over in the others.
    let of_some_readings = ["output_stuck", "output_saturated"];
    let all = findings.clone();
    let stronger = |finding: &Finding| {
        let is_main = |main: &&Finding| {
            let part = if thermal(main) && thermal(finding) { THERMAL_FORM } else { FORM };
            !main.effect.starts_with("noise_")
                && !of_some_readings.contains(&main.effect.as_str())
                && meet(&main.sensor, &finding.sensor)
                && part * told(main, &finding.sensor) > finding.evidence.gain_nats
        };
        let main = all.iter().find(is_main);
        main.filter(|_| !of_itself.contains(&finding.effect.as_str()))
    };
    let mut notes = Vec::new();
    findings.retain(|finding| {
        let Some(main) = stronger(finding) else { return true };
        notes.push(format!(
            "{}: {} gains {:.0} nats beside {} with {:.0}: too little to tell it from what an inexact form of that \
             leaves over",
            finding.sensor,
            finding.effect,
            finding.evidence.gain_nats,
            main.effect,
            told(main, &finding.sensor)
        ));
        false
    });
    notes
}

/// Says where what differs, from row to row, goes with the reference of motion and not with the reading, of sensors of which something
/// was found: a noisy reference is larger than the reading as that of a late instrument is, and nothing in the data tells them apart.
fn noise_of_references(model: &Model, recording: &Recording, findings: &[Finding]) -> Vec<String> {
    if recording.case.motion.kind != MotionKind::Recorded {
        return Vec::new();
    }
    let curved = |values: &[f64]| -> Vec<f64> {
        values.windows(3).map(|three| three[2] - 2.0 * three[1] + three[0]).collect()
    };
    let note = |block: &Block| {
        let [source] = block.sources[..] else { return None };
        let series = recording.sensors.get(model.sources[source].sensor)?;
        let names = [Some(&series.sensor.id), series.sensor.group.as_ref()];
        let is_its = |finding: &Finding| names.contains(&Some(&finding.sensor));
        if !findings.iter().any(is_its) {
            return None;
        }
        let readings = curved(&series.values);
        let (mut together, mut alone) = (0.0, 0.0);
        let curved_both = readings.iter().zip(curved(&block.data));
        for (reading, differs) in curved_both.filter(|(a, b)| (**a + b).is_finite()) {
            together += differs * (reading - differs);
            alone += differs * differs;
        }
        // 0 of a sensor's own noise, 1 of the reference's.
        let part = -together / alone;
        (part > OF_THE_REFERENCE).then(|| {
            format!(
                "{}: {:.0} % of what differs from row to row goes with the reference and not with the reading, as noise of the \
                 reference does, or an instrument that follows late or not at all: what is found of the motion on this sensor may \
                 be the one or the other",
                series.sensor.id,
                100.0 * part.min(1.0)
            )
        })
    };
    model.blocks.iter().filter_map(note).collect()
}

/// Takes away the constants that are no larger than what rounding to the step that was found makes of readings whose noise does
/// not carry them over it, and says so. They stay in the description that is fitted.
fn set_rounding_aside(
    findings: &mut Vec<Finding>,
    model: &Model,
    recording: &Recording,
    faults: &[Fault],
) -> Vec<String> {
    let most = |finding: &Finding| {
        let sensor = recording.sensors.iter().position(|series| series.sensor.id == finding.sensor)?;
        let step = (faults.iter()).filter(|fault| fault.sensor == sensor).find_map(Fault::lattice_step)?;
        let series = &recording.sensors[sensor];
        let shift = shift_by_rounding(step, model.white_of(sensor));
        Some(shift / series.written_unit.in_si())
    };
    let mut notes = Vec::new();
    findings.retain(|finding| {
        let coefficient = finding.parameters.iter().find(|parameter| parameter.name == "coefficient");
        let (Some(most), Some(value), "bias_constant") =
            (most(finding), coefficient.and_then(|it| it.value), finding.effect.as_str())
        else {
            return true;
        };
        let sigma = coefficient.and_then(|it| it.sigma).unwrap_or_default();
        if value.abs() > most + 3.0 * sigma {
            return true;
        }
        notes.push(format!(
            "{}: a constant of {value:.3e} is no more than what rounding leaves of readings that seldom cross a step",
            finding.sensor
        ));
        false
    });
    notes
}

/// Takes away what is said of the noise beside a coarsely counted angle, as far as it is no larger than the counts, and says so: the errors
/// of counts are white only where the angle moves by many of them from one reading to the next. `of_angle` names the sensors whose
/// readings lie on the lattice of an angle.
fn set_angles_aside(findings: &mut Vec<Finding>, recording: &Recording, of_angle: &[usize]) -> Vec<String> {
    let sigma = |finding: &Finding| {
        let parameter = finding.parameters.iter().find(|parameter| parameter.name == "sigma")?;
        Some((parameter.value?, parameter.unit.clone()?))
    };
    let of_sensors: Vec<&str> = (of_angle.iter())
        .filter_map(|&sensor| Some(recording.sensors.get(sensor)?.sensor.id.as_str()))
        .collect();
    let counted: Vec<(String, (f64, String))> = (findings.iter())
        .filter(|finding| {
            finding.effect == ANGLE_QUANTISATION && of_sensors.contains(&finding.sensor.as_str())
        })
        .filter_map(|finding| Some((finding.sensor.clone(), sigma(finding)?)))
        .collect();
    let mut notes = Vec::new();
    findings.retain(|finding| {
        let counts = counted.iter().find(|(sensor, _)| *sensor == finding.sensor);
        let is_less = counts.is_some_and(|(_, (counts, unit))| {
            sigma(finding).is_some_and(|(sigma, of)| of == *unit && sigma < *counts)
        });
        if !is_less || !finding.effect.starts_with("noise_") || finding.effect == ANGLE_QUANTISATION {
            return true;
        }
        notes.push(format!(
            "{}: {} is no larger than the counts of the angle, whose errors come again as the angle does",
            finding.sensor, finding.effect
        ));
        false
    });
    notes
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
pub(crate) fn is_spoilt(candidate: &Candidate, faults: &[Fault], model: &Model) -> bool {
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

/// Whether readings lie on a lattice because the angle whose difference they are is rounded: neighbours' errors are then
/// opposite, while those of rounded readings are independent.
pub(crate) fn is_of_angle(model: &Model, fault: &Fault) -> bool {
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
            -exact(&model.blocks[block], &noises, &projected)
        };
        -golden(-1.5, 1.5, 0.03, cost).1
    };
    let rounded = likelihood(&|noise| noise.rounding = step);
    likelihood(&|noise| noise.angle = step / 12.0_f64.sqrt()) > rounded
}

/// What is rounded to a lattice has at least the variance of the rounding, step²/12, whether the case says so or not;
/// `of_angle` names the sensors whose lattice is that of an angle, which is another noise.
///
/// Readings of which many are equal would otherwise let fitted noise vanish, and the likelihood grow without bound: a
/// density at the value that is repeated has no limit, the probability of a step of the lattice has.
pub(crate) fn account_for_lattices(model: &mut Model, recording: &Recording, of_angle: &[usize]) {
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

/// The findings of faults in readings.
fn of_readings(
    recording: &Recording,
    case: &Case<'_>,
    family: &Family,
    faults: &[Fault],
    level: f64,
) -> Vec<Finding> {
    let mut findings = Vec::new();
    for fault in faults {
        let candidate = case.candidates.iter().find(|candidate| {
            matches!(candidate.search, Search::Readings(found) if found == fault.fault)
                && candidate.target == Target::Sensor(fault.sensor)
                && candidate.port == Port::Output
        });
        let Some(candidate) = candidate else { continue };
        let ln_p = family.ln_p(candidate, fault.evidence);
        if ln_p > level.ln() {
            continue;
        }
        let Some(series) = recording.sensors.get(fault.sensor) else { continue };
        let named = target_name(case.model, candidate);
        let sensor = if named.is_empty() { series.sensor.id.clone() } else { named };
        let unit = series.written_unit;
        let at = |row: usize| case.time_s.get(row).copied().unwrap_or_default();
        let parameters: Vec<Parameter> = (fault.parameters.iter())
            .map(|&(name, value, in_unit)| {
                let step_s = case.model.step_s;
                let (value, sigma, unit) = match name {
                    // In the step before or after the first of the equal readings, whether that is the last that was live or
                    // the first that was not: uniform over both.
                    "onset_s" => (at(value as usize), Some(step_s / 3.0_f64.sqrt()), "s"),
                    // A lattice is one of which no reading is farther off than so.
                    "step" => (value / unit.in_si(), Some(OFF_LATTICE * value / unit.in_si()), unit.name()),
                    _ if in_unit => (value / unit.in_si(), None, unit.name()),
                    _ => (value, None, "1"),
                };
                let (value, unit) = (Some(value), Some(unit.to_owned()));
                Parameter { name: name.to_owned(), value, sigma, unit, ..Parameter::default() }
            })
            .collect();
        let interval_s = [at(fault.rows.0), at(fault.rows.1.saturating_sub(1)) + case.model.step_s];
        let id = candidate.effect.id.to_owned();
        let mut class = vec![id.clone()];
        // Steps that are coarser than all that it reads leave one level as well.
        let mut present = series.values.iter().filter(|value| value.is_finite());
        let first = present.next();
        if fault.fault == ReadingFault::Stuck && present.all(|value| Some(value) == first) {
            class.push(QUANTISATION.to_owned());
        }
        let rivals = same_in_parity(case.model, fault, candidate);
        findings.push(Finding {
            sentence: sentence(candidate, &sensor, &parameters, interval_s, case.time_s),
            sensor,
            class,
            effect: id,
            interval_s,
            parameters,
            evidence: Evidence { gain_nats: fault.evidence, p_value: ln_p.exp() },
            noise_shift: Vec::new(),
            rivals,
        });
    }
    findings
}

/// The other sensors whose spikes look the same: of a pair that is only compared with each other, and of a single parity
/// relation, a spike may be any one's.
fn same_in_parity(model: &Model, fault: &Fault, candidate: &Candidate) -> Vec<Rival> {
    let block = model.block_of(fault.sensor).and_then(|block| model.blocks.get(block));
    let Some(block) = block.filter(|_| fault.fault == ReadingFault::Outliers) else { return Vec::new() };
    let Some(place) = block.sensors.iter().position(|&sensor| sensor == fault.sensor) else {
        return Vec::new();
    };
    let others = block.alike(place).into_iter().map(|place| block.sensors[place]);
    (others.filter(|&sensor| sensor != fault.sensor))
        .filter_map(|sensor| model.sources.get(model.source_of(sensor, Port::Output)?))
        .map(|source| Rival {
            sensor: source.name.clone(),
            effect: candidate.effect.id.to_owned(),
            principal_angle_deg: 0.0,
            behind_nats: 0.0,
            separated_by: candidate.effect.separated_by.to_owned(),
            together_with: None,
        })
        .collect()
}

/// Whether a candidate acts on anything that is compared.
fn acts(model: &Model, candidate: &Candidate) -> bool {
    let shaped = match &candidate.search {
        Search::Noise(_) | Search::Readings(_) => true,
        Search::Grid { parameters, .. } => parameters.iter().all(|parameter| !parameter.grid.is_empty()),
        _ => !candidate.amplitudes.is_empty(),
    };
    let reached =
        sensors_of(candidate).iter().any(|&sensor| model.source_of(sensor, candidate.port).is_some());
    let reached = reached || matches!(candidate.search, Search::Readings(_));
    let whole = match (&candidate.search, &candidate.target) {
        // What is searched at every time or frequency is of one sensor.
        (Search::Onset(_) | Search::Frequency | Search::Noise(_), Target::Group { .. }) => false,
        _ => true,
    };
    shaped && reached && whole
}

/// Gives sources of which the user says nothing white noise by the spread of differences, to be fitted as a nuisance.
pub(crate) fn estimate_unknown(model: &mut Model) -> Vec<SourceKnob> {
    let mut nuisances = Vec::new();
    for index in 0..model.sources.len() {
        if !model.sources[index].unknown {
            continue;
        }
        let Some(block) = model.blocks.iter().find(|block| block.sources.contains(&index)) else { continue };
        let white = block.white_by_differences();
        model.sources[index].nominal.white = white;
        nuisances.push((index, Knob::White));
        model.notes.push(format!(
            "{}: the case gives no noise; its white level is estimated from the record",
            model.sources[index].name
        ));
    }
    nuisances
}

/// Builds the findings: the best of each class is taken, then the parameters of all are fitted together, but for what is read off all
/// readings.
fn findings<'c>(
    case: &'c Case<'c>,
    selection: &mut Selection<'c>,
    ln_level: f64,
    with_all_readings: &dyn Fn(&mut Selection<'c>),
) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut budget = Budget::new(case.model);
    let shown = selection.shown.clone();
    let number = shown.len();
    for (place, (item, shown)) in shown.into_iter().enumerate() {
        case.watch.progress(Phase::Refine, place as f64 / number as f64);
        if case.watch.is_cancelled() {
            return Vec::new();
        }
        let (ways, less) =
            alternatives(case, &selection.state, item, &selection.family, ln_level, &mut budget);
        match (item, ways.first()) {
            (Item::Term(place), Some(Alternative { term: Some(term), evidence, simpler, .. }))
                if *evidence > shown.evidence
                    || *simpler
                    || whole_instrument(case, term, &selection.state.terms[place]) =>
            {
                selection.state.terms[place] = term.clone();
            }
            // Another structure of the same noise that was worse until the rest of it was fitted.
            (Item::Change(place), Some(Alternative { fit: Some(fit), candidate, evidence, .. }))
                if *evidence > shown.evidence
                    && *candidate != selection.state.changes[place].candidate
                    && less.changes.iter().all(|change| change.candidate != *candidate) =>
            {
                let mut other = less.clone();
                add_change(&mut other, *candidate, fit.clone());
                let moved = other.changes.pop();
                selection.state.noises = other.noises;
                selection.state.changes = other.changes;
                if let Some(moved) = moved {
                    selection.state.changes.insert(place, moved);
                }
            }
            _ => {}
        }
        found.push((item, shown, ways, less));
    }
    selection.exceeded |= budget.exceeded;
    let (state, bench) = refitted(case, &selection.state, None);
    selection.state = state;
    selection.bench = bench;
    if selection.state.terms.len() > 1 && refine_terms(case, &mut selection.state, &|_| true) {
        (selection.state, selection.bench) = refitted(case, &selection.state, None);
    }
    with_all_readings(selection);
    let alone = found.len() == 1;
    loop {
        let shown: Vec<(Shown, State)> =
            found.par_iter().map(|found| shown_now(case, selection, found, alone)).collect();
        // What entered early may show nothing beside what came later.
        let ln_p = |place: usize| shown[place].0.ln_p;
        let weakest = (0..shown.len()).max_by(|&a, &b| ln_p(a).total_cmp(&ln_p(b)));
        let Some(weakest) = weakest.filter(|&weakest| ln_p(weakest) > ln_level) else {
            let mut findings: Vec<Finding> = (found.par_iter().zip(shown))
                .map(|(found, (shown, less))| finding(case, selection, found, &less, shown))
                .collect();
            in_order(&mut findings);
            return findings;
        };
        take_back(case, selection, &mut found, weakest);
    }
}

/// Physics that was left out before what is none, of each the one with the most evidence first.
fn in_order(findings: &mut [Finding]) {
    findings.sort_by(|a, b| {
        let by_evidence = b.evidence.gain_nats.total_cmp(&a.evidence.gain_nats);
        a.is_no_physics().cmp(&b.is_no_physics()).then(by_evidence)
    });
}

/// An item, what it showed when it was selected, the ways to describe it, the best first, and the state without it.
type Found = (Item, Shown, Vec<Alternative>, State);

/// Takes an item out of the description.
fn take_back<'c>(case: &'c Case<'c>, selection: &mut Selection<'c>, found: &mut Vec<Found>, weakest: usize) {
    let (item, ..) = found.remove(weakest);
    (selection.state, selection.bench) = without(case, &selection.state, item);
    for (other, ..) in found {
        *other = match (*other, item) {
            (Item::Term(place), Item::Term(gone)) if place > gone => Item::Term(place - 1),
            (Item::Change(place), Item::Change(gone)) if place > gone => Item::Change(place - 1),
            (unmoved, _) => unmoved,
        };
    }
}

/// What an item shows beside all the others as they now are, and the state without it.
fn shown_now(
    case: &Case<'_>,
    selection: &Selection<'_>,
    (item, shown, ways, less): &Found,
    alone: bool,
) -> (Shown, State) {
    let state = &selection.state;
    let own = candidate_of(state, *item);
    // Without the only one nothing else may have changed.
    let less = if alone { less.clone() } else { without(case, state, *item).0 };
    let gain = gain_of_item(*item, state, &less);
    let evidence = match ways.iter().find(|way| way.candidate == own) {
        Some(way) => way.price.evidence(gain),
        None => (shown.evidence - (shown.gain - gain).max(0.0)).max(0.0),
    };
    let evidence = evidence_of(&selection.bench, *item, evidence);
    let ln_p = selection.family.ln_p(&case.candidates[own], evidence);
    (Shown { gain, evidence, ln_p }, less)
}

/// The finding that an item is.
fn finding(
    case: &Case<'_>,
    selection: &Selection<'_>,
    (item, _, ways, _): &Found,
    less: &State,
    shown: Shown,
) -> Finding {
    let (state, item, mut ways) = (&selection.state, *item, ways.clone());
    let candidate = &case.candidates[candidate_of(state, item)];
    // What was selected leads unless something of the same kind of item was better.
    if let Some(place) = ways.iter().position(|way| way.candidate == candidate_of(state, item)) {
        let own = ways.remove(place);
        ways.insert(0, own);
    }
    let kept: Vec<Term> = less.terms.clone();
    let bench = Bench::new(case, &kept, &state.noises);
    let pairs: Vec<&PairInstead> =
        selection.pairs.iter().filter(|pair| pair.of == candidate_of(state, item)).collect();
    let (mut class, rivals) = class(case, &bench, &ways, &pairs);
    if class.first().map(String::as_str) != Some(candidate.effect.id) {
        class.retain(|id| id != candidate.effect.id);
        class.insert(0, candidate.effect.id.to_owned());
    }
    let parameters = parameters(case, state, item);
    let interval_s = interval(case, state, item);
    let sensor = target_name(case.model, candidate);
    let sentence = sentence(candidate, &sensor, &parameters, interval_s, case.time_s);
    Finding {
        sensor,
        effect: candidate.effect.id.to_owned(),
        class,
        interval_s,
        parameters,
        evidence: Evidence { gain_nats: shown.gain, p_value: shown.ln_p.exp() },
        sentence,
        noise_shift: noise_shift(case, less, state),
        rivals,
    }
}

/// Whether `term` is the same effect as `selected` on the whole instrument.
fn whole_instrument(case: &Case<'_>, term: &Term, selected: &Term) -> bool {
    let (whole, one) = (&case.candidates[term.candidate], &case.candidates[selected.candidate]);
    whole.effect.id == one.effect.id
        && matches!((&whole.target, &one.target), (Target::Group { .. }, Target::Sensor(_)))
}

fn candidate_of(state: &State, item: Item) -> usize {
    match item {
        Item::Term(place) => state.terms[place].candidate,
        Item::Change(place) => state.changes[place].candidate,
    }
}

/// When it acts, to the end of the last step: from its onset or from where its signature begins.
pub(crate) fn interval(case: &Case<'_>, state: &State, item: Item) -> [f64; 2] {
    let end = case.time_s.last().copied().unwrap_or_default() + case.model.step_s;
    let start = match item {
        Item::Term(place) => {
            let term = &state.terms[place];
            match case.candidates[term.candidate].search {
                Search::Onset(_) => term.nonlinear.first().copied().unwrap_or_default(),
                _ => onset_parameter(&case.candidates[term.candidate], term)
                    .unwrap_or_else(|| first_acting_s(case, term)),
            }
        }
        Item::Change(place) => {
            let change = &state.changes[place];
            let step = state.noises[change.source].step.filter(|_| change.knobs.contains(&Knob::StepRatio));
            let since = step.and_then(|step| match step.rows {
                RowsOfLevel::From(row) => case.time_s.get(row).copied(),
                RowsOfLevel::Above { .. } => None,
            });
            since.unwrap_or_default()
        }
    };
    [start, end]
}

/// When the signature of a term first is not zero.
fn first_acting_s(case: &Case<'_>, term: &Term) -> f64 {
    let parts = term.columns.iter().flat_map(|column| &column.parts);
    let row = parts.filter_map(|(_, values)| values.iter().position(|value| *value != 0.0)).min();
    row.and_then(|row| case.time_s.get(row).copied()).unwrap_or_default()
}

fn onset_parameter(candidate: &Candidate, term: &Term) -> Option<f64> {
    let names = crate::description::nonlinear_names(candidate);
    let place = names.iter().position(|(name, _)| *name == "onset_s")?;
    term.nonlinear.get(place).copied()
}

/// Every noise parameter that moved by more than a per cent, of the parts that are there with the finding and without
/// it: the time constant of a part that was not there before has not moved from anywhere.
fn noise_shift(case: &Case<'_>, before: &State, after: &State) -> Vec<NoiseShift> {
    let mut shifts = Vec::new();
    for (index, source) in case.model.sources.iter().enumerate() {
        let (old, new): (&Noise, &Noise) = (&before.noises[index], &after.noises[index]);
        let mut knobs = old.knobs();
        knobs.extend(new.knobs());
        let mut seen: Vec<Knob> = Vec::new();
        for knob in knobs {
            if seen.contains(&knob) {
                continue;
            }
            seen.push(knob);
            let (from, to) = (old.get(knob), new.get(knob));
            if !(old.has_shape(knob) && new.has_shape(knob)) {
                continue;
            }
            if (from - to).abs() > 0.01 * from.abs().max(to.abs()) {
                let scale = if knob.in_sensor_unit() { source.unit.in_si().recip() } else { 1.0 };
                let unit = if knob.in_sensor_unit() {
                    format!("{}{}", source.unit.name(), knob.unit())
                } else {
                    knob.unit().to_owned()
                };
                shifts.push(NoiseShift {
                    sensor: source.name.clone(),
                    name: knob.name().1.to_owned(),
                    unit,
                    before: from * scale,
                    after: to * scale,
                });
            }
        }
    }
    shifts
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
