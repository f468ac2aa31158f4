//! Findings in words and numbers.
use super::parameters::parameters;
use super::posterior::Posterior;
use crate::catalogue::{Candidate, Effect, OF_READINGS, ReadingFault, Search, Target, target_name};
use crate::description::{Term, nonlinear_names};
use crate::evidence::fit::{Bench, Change, Description};
use crate::exact::OverRows;
use crate::explanation::{Evidence, Finding, Member, Parameter, Remainder, subject};
use crate::faults::{Fault, OFF_LATTICE};
use crate::noise::RowsOfLevel;
use crate::nominal::Model;
use crate::problem::Problem;
use crate::problem::prepared::Prepared;
use crate::search::moves::{Item, candidate_of};
use crate::sentence::sentence;

/// The items that are sure enough to be told.
pub fn findings(rows: &OverRows<'_>, posterior: &[Posterior]) -> Vec<Finding> {
    let (bench, description) = (rows.bench, rows.description);
    let is_told = |posterior: &&Posterior| {
        let is_unstated = match posterior.item {
            Item::Change(place) => bench.problem.model.sources[description.changes[place].source].unknown,
            Item::Placed(_) => false,
        };
        posterior.probability() >= bench.problem.config.told_at
            && !is_unstated
            && unnamed_in(bench, description, posterior).is_none()
    };
    posterior.iter().filter(is_told).map(|posterior| finding(bench, description, posterior)).collect()
}

/// What is in no catalogue, where that describes it or is most probable.
fn unnamed_in<'b>(
    bench: &'b Bench<'_>,
    description: &Description,
    posterior: &Posterior,
) -> Option<&'b Candidate> {
    let first = posterior.class.first().map(|(member, _)| *member);
    (std::iter::once(candidate_of(description, posterior.item)).chain(first))
        .map(|candidate| &bench.problem.candidates[candidate])
        .find(|candidate| candidate.effect.is_unnamed())
}

/// The dependences that are most probably in no catalogue, the surest of them; with all of them in words.
pub fn unnamed(bench: &Bench<'_>, description: &Description, posterior: &[Posterior]) -> Option<Remainder> {
    let problem = bench.problem;
    let told: Vec<(&Posterior, &Candidate)> = (posterior.iter())
        .filter(|it| it.probability() >= problem.config.told_at)
        .filter_map(|it| Some((it, unnamed_in(bench, description, it)?)))
        .collect();
    let on = |candidate: &Candidate| {
        candidate.variant.first().map_or_else(String::new, |(_, column)| column.clone())
    };
    let (first, strongest) = told.iter().max_by(|a, b| a.0.ln_odds.total_cmp(&b.0.ln_odds)).copied()?;
    let what = told.iter().map(|(_, candidate)| {
        let name = target_name(problem.model, candidate);
        format!("the mean of {name} depends on {}, as no effect of the catalogue does", on(candidate))
    });
    Some(Remainder {
        sensor: target_name(problem.model, strongest),
        what: what.collect::<Vec<_>>().join("; "),
        on: Some(on(strongest)),
        gain_nats: first.ln_odds,
    })
}

fn finding(bench: &Bench<'_>, description: &Description, posterior: &Posterior) -> Finding {
    let problem = bench.problem;
    let own = candidate_of(description, posterior.item);
    let candidate = &problem.candidates[own];
    let sensor = target_name(problem.model, candidate);
    let sensors = in_common(problem, candidate);
    let parameters = parameters(bench, description, posterior.item);
    let interval_s = interval(bench, description, posterior.item);
    Finding {
        sentence: sentence(candidate, &subject(&sensor, &sensors), &parameters, interval_s, problem.time_s()),
        sensor,
        sensors,
        effect: candidate.effect.id.to_owned(),
        probability: posterior.probability(),
        class: class(problem, own, &posterior.class),
        interval_s,
        parameters,
        evidence: Evidence { gain_nats: posterior.ln_odds, p_value: (1.0 + posterior.ln_odds.exp()).recip() },
        share: None,
        impact: None,
    }
}

/// The names of the sensors on which a candidate acts together.
fn in_common(problem: &Problem<'_>, candidate: &Candidate) -> Vec<String> {
    let Target::Group { sensors, .. } = &candidate.target else { return Vec::new() };
    let of = |&sensor: &usize| problem.inputs.recording.sensors.get(sensor).map(|it| it.sensor.id.clone());
    sensors.iter().filter_map(of).collect()
}

/// Candidates with their probabilities as pairs of a sensor and an effect, that of the finding first; variants of an effect are one.
fn class(problem: &Problem<'_>, own: usize, candidates: &[(usize, f64)]) -> Vec<Member> {
    let mut class: Vec<Member> = Vec::new();
    let of_own = candidates.iter().filter(|(candidate, _)| *candidate == own);
    let others = candidates.iter().filter(|(candidate, _)| *candidate != own);
    for &(candidate, probability) in of_own.chain(others) {
        let candidate = &problem.candidates[candidate];
        let (sensor, effect) = (target_name(problem.model, candidate), candidate.effect.id);
        let known = class.iter_mut().find(|known| known.sensor == sensor && known.effect == effect);
        if let Some(known) = known {
            known.probability += probability;
            continue;
        }
        let separated_by = if class.is_empty() { "" } else { candidate.effect.separated_by };
        let (effect, separated_by) = (effect.to_owned(), separated_by.to_owned());
        class.push(Member { sensor, effect, probability, separated_by });
    }
    class
}

/// When an item acts, to the end of the last step: from its onset or from where its signature begins.
fn interval(bench: &Bench<'_>, description: &Description, item: Item) -> [f64; 2] {
    let problem = bench.problem;
    let end = problem.time_s().last().copied().unwrap_or_default() + problem.model.step_s;
    let start = match item {
        Item::Placed(place) => {
            let term = &description.placed[place].term;
            let names = nonlinear_names(&problem.candidates[term.candidate]);
            let onset = names.iter().position(|(name, _)| *name == "onset_s");
            let onset_s = onset.and_then(|place| term.nonlinear.get(place).copied());
            onset_s.unwrap_or_else(|| first_acting_s(problem.model, term))
        }
        Item::Change(place) => level_since_s(problem.model, description, &description.changes[place]),
    };
    [start, end]
}

/// When the signature of a term first is not zero.
fn first_acting_s(model: &Model, term: &Term) -> f64 {
    let parts = term.columns.iter().flat_map(|column| &column.parts);
    let row = parts.filter_map(|(_, values)| values.iter().position(|value| *value != 0.0)).min();
    row.and_then(|row| model.time_s.get(row).copied()).unwrap_or_default()
}

/// Since when another level is there; 0 of other changes.
fn level_since_s(model: &Model, description: &Description, change: &Change) -> f64 {
    let step = description.noises[change.source].step.filter(|_| change.is_level());
    let since = step.and_then(|step| match step.rows {
        RowsOfLevel::From(row) => model.time_s.get(row).copied(),
        RowsOfLevel::Above { .. } => None,
    });
    since.unwrap_or_default()
}

/// What readings show of themselves beside what a description tells of them.
pub fn of_readings(rows: &OverRows<'_>, prepared: &mut Prepared) -> Vec<Finding> {
    let problem = rows.bench.problem;
    let terms: Vec<Term> = rows.description.placed.iter().map(|placed| placed.term.clone()).collect();
    let described = (terms.as_slice(), rows.description.noises.as_slice());
    let amplitudes = rows.amplitudes_of_model();
    prepared.faults.spikes_beside(&prepared.unmasked, &problem.candidates, described, &amplitudes);
    prepared.faults.found.iter().filter_map(|fault| of_fault(rows, fault)).collect()
}

fn of_fault(rows: &OverRows<'_>, fault: &Fault) -> Option<Finding> {
    let (problem, model) = (rows.bench.problem, rows.bench.problem.model);
    let is_it = |search: &Search| matches!(search, Search::Readings(found) if *found == fault.fault);
    let candidate = (OF_READINGS.iter())
        .flat_map(|effect: &'static Effect| (effect.candidates)(effect, problem.inputs))
        .find(|it| is_it(&it.search) && it.target == Target::Sensor(fault.sensor))?;
    let series = problem.inputs.recording.sensors.get(fault.sensor)?;
    let named = target_name(model, &candidate);
    let sensor = if named.is_empty() { series.sensor.id.clone() } else { named };
    let unit = series.written_unit;
    let at = |row: usize| problem.time_s().get(row).copied().unwrap_or_default();
    let parameter = |&(name, value, in_unit): &(&str, f64, bool)| {
        let (value, sigma, unit) = match name {
            // In the step before or after the first of the equal readings, whether that is the last that was live or
            // the first that was not: uniform over both.
            "onset_s" => (at(value as usize), Some(model.step_s / 3.0_f64.sqrt()), "s"),
            // A lattice is one of which no reading is farther off than so.
            "step" => (value / unit.in_si(), Some(OFF_LATTICE * value / unit.in_si()), unit.name()),
            _ if in_unit => (value / unit.in_si(), None, unit.name()),
            _ => (value, None, "1"),
        };
        let (value, unit) = (Some(value), Some(unit.to_owned()));
        Parameter { name: name.to_owned(), value, sigma, unit, ..Parameter::default() }
    };
    let parameters: Vec<Parameter> = fault.parameters.iter().map(parameter).collect();
    let interval_s = [at(fault.rows.0), at(fault.rows.1.saturating_sub(1)) + model.step_s];
    let mut pairs = vec![(sensor.clone(), candidate.effect)];
    // Steps that are coarser than all that it reads leave one level as well.
    let mut present = series.values.iter().filter(|value| value.is_finite());
    let first = present.next();
    if fault.fault == ReadingFault::Stuck && present.all(|value| Some(value) == first) {
        let coarse = OF_READINGS.iter().find(|effect| effect.is_coarse_output());
        pairs.extend(coarse.map(|effect| (sensor.clone(), effect)));
    }
    pairs.extend(same_in_parity(model, fault, &candidate).map(|other| (other, candidate.effect)));
    let ln_odds = fault.evidence + problem.config.ln_odds_of_faults;
    Some(Finding {
        sentence: sentence(&candidate, &sensor, &parameters, interval_s, problem.time_s()),
        sensor,
        sensors: Vec::new(),
        effect: candidate.effect.id.to_owned(),
        probability: (1.0 + (-ln_odds).exp()).recip(),
        class: as_likely(pairs),
        interval_s,
        parameters,
        evidence: Evidence { gain_nats: fault.evidence, p_value: (1.0 + ln_odds.exp()).recip() },
        share: None,
        impact: None,
    })
}

/// Pairs of which nothing tells which it is.
fn as_likely(pairs: Vec<(String, &'static Effect)>) -> Vec<Member> {
    let probability = (pairs.len() as f64).recip();
    let member = |(place, (sensor, effect)): (usize, (String, &'static Effect))| Member {
        sensor,
        effect: effect.id.to_owned(),
        probability,
        separated_by: if place == 0 { String::new() } else { effect.separated_by.to_owned() },
    };
    pairs.into_iter().enumerate().map(member).collect()
}

/// The other sensors whose spikes look the same: of a pair that is only compared with each other, and of a single parity
/// relation, a spike may be any one's.
fn same_in_parity<'m>(
    model: &'m Model,
    fault: &'m Fault,
    candidate: &'m Candidate,
) -> impl Iterator<Item = String> + 'm {
    let block = model.block_of(fault.sensor).and_then(|block| model.blocks.get(block));
    let block = block.filter(|_| fault.fault == ReadingFault::Outliers);
    let place = block.and_then(|block| block.sensors.iter().position(|&sensor| sensor == fault.sensor));
    let alike = block.zip(place).map(|(block, place)| (block, block.alike(place)));
    let others = alike.into_iter().flat_map(|(block, alike)| alike.into_iter().map(|at| block.sensors[at]));
    (others.filter(|&sensor| sensor != fault.sensor))
        .filter_map(|sensor| model.sources.get(model.source_of(sensor, candidate.port)?))
        .map(|source| source.name.clone())
}

/// Physics before what is none, of each the surest first.
pub fn in_order(findings: &mut [Finding]) {
    findings.sort_by(|a, b| {
        let by_evidence = b.evidence.gain_nats.total_cmp(&a.evidence.gain_nats);
        a.is_no_physics().cmp(&b.is_no_physics()).then(by_evidence)
    });
}
