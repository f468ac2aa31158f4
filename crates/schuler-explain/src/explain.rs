//! Why a recording does not look like its simulation: the whole way from a recording to an [`Explanation`].
use rayon::prelude::*;
use schuler_recording::Recording;
use thiserror::Error;

use crate::arrays::arrays;
use crate::catalogue::{CATALOGUE, Candidate, Port, ReadingFault, Search, Target};
use crate::description::{Term, sensors_of};
use crate::equivalence::{alternatives, class, target_name};
use crate::evidence::CaseArrays;
use crate::explanation::{Evidence, Explanation, FORMAT, Finding, Fit, NoiseShift, Parameter, Verdict};
use crate::hold_out::hold_out;
use crate::inputs::Inputs;
use crate::locate;
use crate::noise::{Knob, Noise};
use crate::noise_fit::SourceKnob;
use crate::nominal::{FEWEST_ROWS, Model};
use crate::readings::{Fault, faults};
use crate::refit::parameters;
use crate::search::Family;
use crate::select::{Item, Selection, select};
use crate::sentence::sentence;
use crate::state::{Bench, Case, State, refitted};

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
    /// An option is out of range.
    #[error("level: found {0}; expected a probability between 0 and 1")]
    Level(String),
}

/// Explains a recording by the catalogue.
///
/// # Errors
/// What in the recording or the case leaves nothing to explain.
pub fn explain(recording: &Recording, options: &Options) -> Result<Explanation, Error> {
    if recording.len() < FEWEST_ROWS {
        return Err(Error::TooShort { rows: recording.len(), least: FEWEST_ROWS });
    }
    let inputs = Inputs::new(recording);
    let candidates: Vec<Candidate> =
        CATALOGUE.par_iter().flat_map_iter(|effect| (effect.candidates)(effect, &inputs)).collect();
    explain_with(&inputs, candidates, options)
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
    explained(inputs, candidates, options, |_, _, _| ()).map(|(explanation, ())| explanation)
}

/// As [`explain`], with the arrays that show it.
///
/// # Errors
/// As [`explain`].
pub fn explain_shown(recording: &Recording, options: &Options) -> Result<(Explanation, CaseArrays), Error> {
    if recording.len() < FEWEST_ROWS {
        return Err(Error::TooShort { rows: recording.len(), least: FEWEST_ROWS });
    }
    let inputs = Inputs::new(recording);
    let candidates: Vec<Candidate> =
        CATALOGUE.par_iter().flat_map_iter(|effect| (effect.candidates)(effect, &inputs)).collect();
    explained(&inputs, candidates, options, |case, selection, findings| {
        arrays(case, &selection.null, &selection.state, findings)
    })
}

/// The explanation, and what `show` makes of the selection behind it.
fn explained<S>(
    inputs: &Inputs<'_>,
    mut candidates: Vec<Candidate>,
    options: &Options,
    show: impl FnOnce(&Case<'_>, &Selection<'_>, &[Finding]) -> S,
) -> Result<(Explanation, S), Error> {
    let recording = inputs.recording;
    if recording.len() < FEWEST_ROWS {
        return Err(Error::TooShort { rows: recording.len(), least: FEWEST_ROWS });
    }
    if !(options.level > 0.0 && options.level < 1.0) {
        return Err(Error::Level(options.level.to_string()));
    }
    let unmasked = Model::new(recording, &[]).map_err(Error::NothingToCompare)?;
    let (faults, masked) = faults(recording, &unmasked);
    let mut model = if faults.is_empty() {
        unmasked
    } else {
        Model::new(recording, &masked).map_err(Error::NothingToCompare)?
    };
    account_for_lattices(&mut model, &faults);
    candidates.retain(|candidate| acts(&model, candidate) && !is_spoilt(candidate, &faults));
    let nuisances = estimate_unknown(&mut model);
    let noises = model.nominal_noises();
    for block in &model.blocks {
        if block.filter(&noises).is_none() {
            let names: Vec<&str> =
                block.sources.iter().map(|&source| model.sources[source].name.as_str()).collect();
            return Err(Error::Singular {
                sensor: names.join(", "),
                what: "its variance must be positive and its parts not too many".to_owned(),
            });
        }
    }
    let case = Case { model: &model, candidates: &candidates, time_s: &inputs.time_s };
    let start = State {
        terms: Vec::new(),
        noises,
        changes: Vec::new(),
        nuisances,
        log_likelihood: f64::NEG_INFINITY,
    };
    let mut selection = select(&case, &start, options.level);
    let mut findings = findings(&case, &mut selection);
    findings.extend(of_readings(recording, &case, &selection.family, &faults, options.level));
    findings.sort_by(|a, b| b.evidence.gain_nats.total_cmp(&a.evidence.gain_nats));
    let located = locate::locate(&case, &selection.null, inputs);
    let (left, remainder) = locate::left(&case, &selection.state, inputs);
    let verdict = match (findings.is_empty(), left) {
        (true, false) => Verdict::NoMismatch,
        (true, true) => Verdict::Unexplained,
        (false, false) => Verdict::Explained,
        (false, true) => Verdict::PartlyExplained,
    };
    let fit =
        if options.hold_out { hold_out(&case, &selection.null, &selection.state) } else { Fit::default() };
    let mut notes = recording.warnings.clone();
    notes.extend(model.notes.iter().cloned());
    let shown = show(&case, &selection, &findings);
    Ok((Explanation { format: FORMAT, verdict, findings, fit, located, remainder, notes }, shown))
}

/// Whether a candidate is about the noise of an output that is clipped or coarse: what is left of it then is not what
/// the sensor's noise was.
fn is_spoilt(candidate: &Candidate, faults: &[Fault]) -> bool {
    let spoils = |fault: &Fault| {
        matches!(fault.fault, ReadingFault::Saturated | ReadingFault::Quantised)
            && sensors_of(candidate).contains(&fault.sensor)
    };
    matches!(candidate.search, Search::Noise(_)) && faults.iter().any(spoils)
}

/// What is rounded to a lattice has the variance of the rounding.
fn account_for_lattices(model: &mut Model, faults: &[Fault]) {
    for fault in faults.iter().filter(|fault| fault.fault == ReadingFault::Quantised) {
        let step = fault.parameters.first().map_or(0.0, |parameter| parameter.1);
        for source in model.sources.iter_mut().filter(|s| s.sensor == fault.sensor && s.port == Port::Output)
        {
            source.nominal.rounding = step;
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
                let (value, unit) = match name {
                    "onset_s" => (at(value as usize), "s"),
                    _ if in_unit => (value / unit.in_si(), unit.name()),
                    _ => (value, "1"),
                };
                let (value, unit) = (Some(value), Some(unit.to_owned()));
                Parameter { name: name.to_owned(), value, sigma: None, unit, text: None, plausible: None }
            })
            .collect();
        let interval_s = [at(fault.rows.0), at(fault.rows.1.saturating_sub(1))];
        let id = candidate.effect.id.to_owned();
        findings.push(Finding {
            sentence: sentence(candidate, &sensor, &parameters, interval_s, case.time_s),
            sensor,
            class: vec![id.clone()],
            effect: id,
            interval_s,
            parameters,
            evidence: Evidence { gain_nats: fault.evidence, p_value: ln_p.exp() },
            noise_shift: Vec::new(),
            rivals: Vec::new(),
        });
    }
    findings
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
fn estimate_unknown(model: &mut Model) -> Vec<SourceKnob> {
    let mut nuisances = Vec::new();
    for index in 0..model.sources.len() {
        if !model.sources[index].unknown {
            continue;
        }
        let Some(block) = model.blocks.iter().find(|block| block.sources.contains(&index)) else { continue };
        let rows = block.rows();
        let mut differences: Vec<f64> = (block.data[..rows].windows(2))
            .map(|pair| (pair[1] - pair[0]).abs())
            .filter(|difference| difference.is_finite())
            .collect();
        let middle = differences.len() / 2;
        let median = if differences.is_empty() {
            0.0
        } else {
            *differences.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let largest =
            block.data.iter().filter(|value| value.is_finite()).fold(0.0_f64, |a, b| a.max(b.abs()));
        // Median of |difference| of normal values: 0.6745 √2 σ.
        let white = (median / 0.954).max(1e-6 * largest).max(f64::MIN_POSITIVE.sqrt());
        model.sources[index].nominal.white = white;
        nuisances.push((index, Knob::White));
        model.notes.push(format!(
            "{}: the case gives no noise; its white level is estimated from the record",
            model.sources[index].name
        ));
    }
    nuisances
}

/// Builds the findings: the best of each class is taken, then the parameters of all are fitted together.
fn findings<'c>(case: &'c Case<'c>, selection: &mut Selection<'c>) -> Vec<Finding> {
    let mut found = Vec::new();
    let shown = selection.shown.clone();
    for (item, shown) in shown {
        let (ways, less) = alternatives(case, &selection.state, item, &selection.family);
        if let (Item::Term(place), Some(first)) = (item, ways.first())
            && let Some(term) = &first.term
            && (first.evidence > shown.evidence
                || whole_instrument(case, term, &selection.state.terms[place]))
        {
            selection.state.terms[place] = term.clone();
        }
        found.push((item, shown, ways, less));
    }
    let (state, bench) = refitted(case, &selection.state, None);
    selection.state = state;
    selection.bench = bench;
    polish_nonlinear(case, &mut selection.state);
    let state = &selection.state;
    let mut findings: Vec<Finding> = found
        .into_iter()
        .map(|(item, shown, mut ways, less)| {
            let candidate = &case.candidates[candidate_of(state, item)];
            // What was selected leads unless something of the same kind of item was better.
            if let Some(place) = ways.iter().position(|way| way.candidate == candidate_of(state, item)) {
                let own = ways.remove(place);
                ways.insert(0, own);
            }
            let kept: Vec<Term> = less.terms.clone();
            let bench = Bench::new(case, &kept, &state.noises);
            let (mut class, rivals) = class(case, &bench, &ways);
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
                noise_shift: noise_shift(case, &less, state),
                rivals,
            }
        })
        .collect();
    findings.sort_by(|a, b| b.evidence.gain_nats.total_cmp(&a.evidence.gain_nats));
    findings
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

/// Refines the non-linear parameters of each term beside the others.
fn polish_nonlinear(case: &Case<'_>, state: &mut State) {
    for place in 0..state.terms.len() {
        if state.terms[place].nonlinear.is_empty() || state.terms.len() < 2 {
            continue;
        }
        let others: Vec<Term> = (state.terms.iter().enumerate())
            .filter(|(index, _)| *index != place)
            .map(|(_, term)| term.clone())
            .collect();
        let bench = Bench::new(case, &others, &state.noises);
        state.terms[place] = bench.refined(&state.terms[place]).0;
    }
}

/// When it acts: from its onset on, or over the whole record.
fn interval(case: &Case<'_>, state: &State, item: Item) -> [f64; 2] {
    let end = case.time_s.last().copied().unwrap_or_default();
    let start = match item {
        Item::Term(place) => {
            let term = &state.terms[place];
            match case.candidates[term.candidate].search {
                Search::Onset(_) => term.nonlinear.first().copied().unwrap_or_default(),
                _ => onset_parameter(&case.candidates[term.candidate], term).unwrap_or_default(),
            }
        }
        Item::Change(place) => {
            let change = &state.changes[place];
            let step = state.noises[change.source].step.filter(|_| change.knobs.contains(&Knob::StepRatio));
            step.and_then(|step| case.time_s.get(step.row).copied()).unwrap_or_default()
        }
    };
    [start, end]
}

fn onset_parameter(candidate: &Candidate, term: &Term) -> Option<f64> {
    let names = crate::description::nonlinear_names(candidate);
    let place = names.iter().position(|(name, _)| *name == "onset_s")?;
    term.nonlinear.get(place).copied()
}

/// Every noise parameter that moved by more than a per cent.
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
