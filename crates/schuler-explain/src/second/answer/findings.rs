//! Findings with their parameters, from the exact likelihood of all rows.
use super::posterior::Posterior;
use crate::catalogue::{Candidate, Search, Target};
use crate::equivalence::target_name;
use crate::explain::interval;
use crate::explanation::{Evidence, Finding, Parameter, Remainder, Rival};
use crate::inputs::Inputs;
use crate::readings::{Fault, OFF_LATTICE};
use crate::refit::parameters;
use crate::search::refine_terms;
use crate::second::config::Config;
use crate::second::evidence::fit::Description;
use crate::second::search::moves::Item;
use crate::select;
use crate::sentence::sentence;
use crate::state::{Accepted, Case, State, refitted};

/// Logarithm of the odds against a fault in readings before they are seen.
const LN_ODDS_OF_FAULTS: f64 = -7.0;

/// A description fitted to all rows.
pub fn exact(case: &Case<'_>, description: &Description) -> State {
    let changes = description.changes.iter().map(|change| Accepted {
        candidate: change.candidate,
        source: change.source,
        change: change.change,
        knobs: change.knobs.clone(),
        freedom: change.knobs.len(),
        ln_places: 0.0,
    });
    let mut state = State {
        terms: description.placed.iter().map(|placed| placed.term.clone()).collect(),
        noises: description.noises.clone(),
        changes: changes.collect(),
        nuisances: description.nuisances.clone(),
        log_likelihood: f64::NEG_INFINITY,
        told_beside: 0.0,
    };
    state = refitted(case, &state, None).0;
    if refine_terms(case, &mut state, &|_| true) {
        state = refitted(case, &state, None).0;
    }
    state
}

/// The items that are sure enough to be told.
pub fn findings(
    case: &Case<'_>,
    state: &State,
    description: &Description,
    posterior: &[Posterior],
    config: &Config,
) -> Vec<Finding> {
    let is_told = |posterior: &&Posterior| {
        let is_nuisance = match posterior.item {
            Item::Change(place) => super::is_unstated(case.model, description.changes[place].source),
            Item::Placed(_) => false,
        };
        let is_unnamed = matches!(posterior.item, Item::Placed(_)) && is_unnamed(case, posterior);
        posterior.probability >= config.told_at && !is_nuisance && !is_unnamed
    };
    let finding = |posterior: &Posterior| finding(case, state, posterior);
    posterior.iter().filter(is_told).map(finding).collect()
}

/// Whether it is most probably in no catalogue.
fn is_unnamed(case: &Case<'_>, posterior: &Posterior) -> bool {
    let first = posterior.class.first().and_then(|(member, _)| case.candidates.get(*member));
    first.is_some_and(|candidate| candidate.effect.is_unnamed())
}

/// The dependences that are most probably in no catalogue, the surest of them; with all of them in words.
pub fn unnamed(case: &Case<'_>, posterior: &[Posterior], config: &Config) -> Option<Remainder> {
    let told: Vec<(&Posterior, &Candidate)> = (posterior.iter())
        .filter(|it| it.probability >= config.told_at && is_unnamed(case, it))
        .filter_map(|it| Some((it, case.candidates.get(it.class.first()?.0)?)))
        .collect();
    let on = |candidate: &Candidate| {
        candidate.variant.first().map_or_else(String::new, |(_, column)| column.clone())
    };
    let (first, strongest) =
        told.iter().max_by(|a, b| a.0.probability.total_cmp(&b.0.probability)).copied()?;
    let what = told.iter().map(|(_, candidate)| {
        let name = target_name(case.model, candidate);
        format!("the mean of {name} depends on {}, as no effect of the catalogue does", on(candidate))
    });
    Some(Remainder {
        sensor: target_name(case.model, strongest),
        what: what.collect::<Vec<_>>().join("; "),
        on: Some(on(strongest)),
        gain_nats: -(1.0 - first.probability).max(1e-300).ln(),
    })
}

fn finding(case: &Case<'_>, state: &State, posterior: &Posterior) -> Finding {
    let (item, own) = match posterior.item {
        Item::Placed(place) => (select::Item::Term(place), state.terms[place].candidate),
        Item::Change(place) => (select::Item::Change(place), state.changes[place].candidate),
    };
    let candidate = &case.candidates[own];
    let sensor = target_name(case.model, candidate);
    let parameters = parameters(case, state, item);
    let interval_s = interval(case, state, item);
    let mut class = vec![candidate.effect.id.to_owned()];
    let mut rivals = Vec::new();
    for &(member, probability) in posterior.class.iter().filter(|(member, _)| *member != own) {
        let other = &case.candidates[member];
        let (name, id) = (target_name(case.model, other), other.effect.id.to_owned());
        if name == sensor && !class.contains(&id) {
            class.push(id.clone());
        }
        rivals.push(Rival {
            sensor: name,
            effect: id,
            principal_angle_deg: f64::NAN,
            behind_nats: -probability.ln(),
            separated_by: other.effect.separated_by.to_owned(),
            together_with: None,
        });
    }
    let absent = 1.0 - posterior.probability;
    Finding {
        sentence: sentence(candidate, &sensor, &parameters, interval_s, case.time_s),
        sensor,
        effect: candidate.effect.id.to_owned(),
        class,
        interval_s,
        parameters,
        evidence: Evidence { gain_nats: -absent.max(1e-300).ln(), p_value: absent },
        noise_shift: Vec::new(),
        rivals,
    }
}

/// What readings show of themselves.
pub fn of_faults(inputs: &Inputs<'_>, case: &Case<'_>, faults: &[Fault]) -> Vec<Finding> {
    let candidates = crate::catalogue::CATALOGUE;
    let at = |row: usize| case.time_s.get(row).copied().unwrap_or_default();
    let of = |fault: &Fault| {
        if fault.evidence + LN_ODDS_OF_FAULTS < 3.0 {
            return None;
        }
        let is_it = |search: &Search| matches!(search, Search::Readings(found) if *found == fault.fault);
        let candidate = candidates
            .iter()
            .flat_map(|effect| (effect.candidates)(effect, inputs))
            .find(|it| is_it(&it.search) && it.target == Target::Sensor(fault.sensor))?;
        let series = inputs.recording.sensors.get(fault.sensor)?;
        let named = target_name(case.model, &candidate);
        let sensor = if named.is_empty() { series.sensor.id.clone() } else { named };
        let unit = series.written_unit;
        let parameter = |&(name, value, in_unit): &(&str, f64, bool)| {
            let (value, sigma, unit) = match name {
                "onset_s" => (at(value as usize), Some(case.model.step_s / 3.0_f64.sqrt()), "s"),
                "step" => (value / unit.in_si(), Some(OFF_LATTICE * value / unit.in_si()), unit.name()),
                _ if in_unit => (value / unit.in_si(), None, unit.name()),
                _ => (value, None, "1"),
            };
            let (value, unit) = (Some(value), Some(unit.to_owned()));
            Parameter { name: name.to_owned(), value, sigma, unit, ..Parameter::default() }
        };
        let parameters: Vec<Parameter> = fault.parameters.iter().map(parameter).collect();
        let interval_s = [at(fault.rows.0), at(fault.rows.1.saturating_sub(1)) + case.model.step_s];
        Some(Finding {
            sentence: sentence(&candidate, &sensor, &parameters, interval_s, case.time_s),
            sensor,
            effect: candidate.effect.id.to_owned(),
            class: vec![candidate.effect.id.to_owned()],
            interval_s,
            parameters,
            evidence: Evidence { gain_nats: fault.evidence, p_value: (-fault.evidence).exp() },
            noise_shift: Vec::new(),
            rivals: Vec::new(),
        })
    };
    faults.iter().filter_map(of).collect()
}

/// Physics before what is none, of each the surest first.
pub fn in_order(findings: &mut [Finding]) {
    findings.sort_by(|a, b| {
        let by_evidence = b.evidence.gain_nats.total_cmp(&a.evidence.gain_nats);
        a.is_no_physics().cmp(&b.is_no_physics()).then(by_evidence)
    });
}
