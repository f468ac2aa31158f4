//! What the findings add to the readings, as a model for a simulation.
use super::arrays::findings_of;
use crate::catalogue::{Port, named, target_name};
use crate::evidence::fit::Placed;
use crate::evidence::late::late_columns;
use crate::exact::OverRows;
use crate::explanation::{Finding, Fit};
use crate::export::model::given::Given;
use crate::export::model::resolve::Resolver;
use crate::export::model::signal::{Factor, Memory, NARROW, Outside, Signal, WIDE};
use crate::export::model::{Described, FORMAT, LeftOut, Model, Output, TIME, Term};
use crate::inputs::Inputs;

/// Part of the largest value by which a signal may differ from what was fitted.
const SAME: f64 = 1e-9;

/// The model of a description with its findings.
pub fn model(after: &OverRows<'_>, findings: &[Finding], fit: &Fit) -> Model {
    let problem = after.bench.problem;
    let mut given = Given::default();
    given.put(TIME, "s", "time from the first row", &problem.inputs.time_s);
    let terms = after.description.placed.iter().map(|placed| &placed.term);
    let places = findings_of(problem.model, &problem.candidates, terms, findings);
    let mut model =
        Model { format: FORMAT, title: problem.inputs.recording.case.title.clone(), ..Model::default() };
    for ((placed, amplitudes), place) in after.description.placed.iter().zip(&after.amplitudes).zip(&places) {
        let candidate = &problem.candidates[placed.term.candidate];
        match place.and_then(|place| Some((place, findings.get(place)?))) {
            Some((place, finding)) => {
                let terms = terms_of(after, placed, amplitudes, &Told { index: place, finding }, &mut given);
                model.terms.extend(terms);
            }
            None => model.left_out.push(LeftOut {
                sensor: target_name(problem.model, candidate),
                effect: candidate.effect.id.to_owned(),
                because: "it is in the description, but not sure enough to be told".to_owned(),
            }),
        }
    }
    let is_in = |(place, _): &(usize, &Finding)| places.contains(&Some(*place));
    for (_, finding) in findings.iter().enumerate().filter(|it| !is_in(it)) {
        let (sensor, effect) = (finding.sensor.clone(), finding.effect.clone());
        if named(&effect).is_some_and(|effect| effect.is_noise() && !effect.is_outliers()) {
            let (sentence, parameters) = (finding.sentence.clone(), finding.parameters.clone());
            model.noise.push(Described { sensor, effect, sentence, parameters });
        } else {
            let because = "readings show it of themselves, and nothing is added to them".to_owned();
            model.left_out.push(LeftOut { sensor, effect, because });
        }
    }
    let is_used =
        |name: &str| name == TIME || model.terms.iter().any(|term| term.signal.inputs().any(|it| it == name));
    model.inputs = given.inputs;
    model.inputs.retain(|input| is_used(&input.name));
    model.outputs = outputs(after, &model.terms);
    model.fit = fit.clone();
    model
}

/// A finding with its index among all.
struct Told<'t> {
    index: usize,
    finding: &'t Finding,
}

/// The terms of an effect: one for each amplitude and each sensor.
fn terms_of(
    after: &OverRows<'_>,
    placed: &Placed,
    amplitudes: &[f64],
    told: &Told<'_>,
    given: &mut Given,
) -> Vec<Term> {
    let (inputs, model) = (after.bench.problem.inputs, after.bench.problem.model);
    let (term, candidate) = (&placed.term, &after.bench.problem.candidates[placed.term.candidate]);
    let late = late_columns(model, &placed.delays, term);
    let mut terms = Vec::new();
    for (index, (column, &amplitude)) in late.iter().zip(amplitudes).enumerate() {
        for (sensor, values) in column.parts.iter().filter(|_| amplitude != 0.0) {
            let Some(source) = model.source_of(*sensor, term.port) else { continue };
            let output = &model.sources[source].name;
            let delay_s = if placed.delays.move_term(term) { placed.delays.of(*sensor) } else { 0.0 };
            let mut resolver = Resolver { inputs, candidate, nonlinear: &term.nonlinear, given };
            let now = term.columns.get(index).and_then(|it| it.parts.iter().find(|(own, _)| own == sensor));
            let now = now.map_or(&values[..], |(_, values)| values);
            let formed =
                resolver.signal(index, *sensor, now).and_then(|signal| late_by(signal, delay_s, inputs));
            let formed = formed.filter(|signal| is_same(signal, inputs, resolver.given, values));
            let is_table = formed.is_none();
            let signal = formed.unwrap_or_else(|| {
                let id = candidate.effect.id;
                let is =
                    format!("what {id} adds to {output} for an amplitude of 1, row by row of this recording");
                Signal::product(vec![Factor::of(given.put(&format!("{id}_{output}"), "SI", &is, values))])
            });
            terms.push(Term {
                finding: told.index,
                effect: told.finding.effect.clone(),
                sentence: told.finding.sentence.clone(),
                output: output.clone(),
                parameter: candidate.amplitudes.get(index).map_or_else(String::new, |it| it.name.clone()),
                amplitude,
                signal,
                is_table,
            });
        }
    }
    terms
}

/// A signal that comes late; none where it has a memory already.
fn late_by(signal: Signal, delay_s: f64, inputs: &Inputs<'_>) -> Option<Signal> {
    if delay_s == 0.0 {
        return Some(signal);
    }
    let step_s = inputs.recording.step_s;
    let even = inputs.time_s.windows(2).all(|pair| (pair[1] - pair[0] - step_s).abs() < 1e-6 * step_s);
    let reach = if even { WIDE } else { NARROW };
    let memory = Memory::Delay { delay_s, reach, outside: Outside::Now, less_now: false };
    signal.memory.is_none().then(|| signal.through(memory))
}

/// Whether a signal is what was fitted.
fn is_same(signal: &Signal, inputs: &Inputs<'_>, given: &Given, fitted: &[f64]) -> bool {
    let Some(values) = signal.values(&inputs.time_s, &|name| given.values(name)) else { return false };
    let largest = fitted.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    values.len() == fitted.len()
        && values.iter().zip(fitted).all(|(value, fitted)| (value - fitted).abs() <= SAME * largest)
}

/// The outputs of terms, each once.
fn outputs(after: &OverRows<'_>, terms: &[Term]) -> Vec<Output> {
    let sources = after.bench.problem.model.sources.iter();
    sources
        .filter(|source| terms.iter().any(|term| term.output == source.name))
        .map(|source| Output {
            sensor: source.name.clone(),
            unit: source.unit.si().name(),
            written_unit: source.unit.name().to_owned(),
            written_unit_in_si: source.unit.in_si(),
            enters: match source.port {
                Port::Output => "added to its reading",
                Port::Accelerometer => "error of the accelerometer that drives the Schuler loop",
                Port::Gyro => "error of the gyro that drives the Schuler loop",
            },
        })
        .collect()
}
