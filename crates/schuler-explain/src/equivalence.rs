//! What the data cannot tell from a finding.
//!
//! With x = (1 − ρ²) · gain the log-likelihoods of a wrong and of the true candidate differ by a normal variable with
//! mean −x and variance 2x, so that a wrong one leads by more than c with a probability of at most Φ(−√(2c)), whatever
//! x is: 0.7 % for c = 3. Identifiers on the same sensor within that distance of the best are the finding's class;
//! others are its rivals, and so are the two of a pair that is as good as it together: a rate of the temperature with the temperature for
//! a hysteresis. Beside them stands what a dependence on a quantity without a stated reference holds as a part, where the data
//! show that part: with an effect of its own beside it the dependence has any reference, and is the same function.
use std::collections::HashSet;
use std::sync::Arc;

use schuler_recording::unit::Dimension;

use crate::budget::{Budget, of_item};
use crate::catalogue::{AT_MEAN, Candidate, Column, Port, Search, Target};
use crate::description::{Term, blocks_of, sensors_of};
use crate::explanation::Rival;
use crate::instead::PairInstead;
use crate::jump::RATES;
use crate::noise_change::ChangeFit;
use crate::nominal::Model;
use crate::price::Price;
use crate::search::{Family, deterministic, library};
use crate::second::answer::parameters::THREE_SIGMA_NATS;
use crate::select::{Item, add_change, blocks_with, gain_of_item, touches, without};
use crate::state::{Bench, Case, State, refitted};

/// Nats behind the best within which an identifier belongs to the class.
pub const CLASS_NATS: f64 = 3.0;

/// Nats behind within which it still belongs to the class where only the price of its search sets it back, not the data:
/// the price is a prior, and a user may know better.
const PRICED_NATS: f64 = 2.0 * CLASS_NATS;

/// Nats of difference in gain that mean nothing.
const INDIFFERENT_NATS: f64 = 0.5;
/// The effect of axes that are not where they are said to be.
const MISALIGNMENT: &str = "misalignment";
/// The effect that on a sensor that turns about its axis looks like the next.
const ANGULAR_ACCELERATION: &str = "angular_acceleration";
/// The effect of readings that come late.
const TIME_DELAY: &str = "time_delay";

/// What a radio sensor does rather than an inertial velocity.
const OF_RADIO: [&str; 9] = [
    TIME_DELAY,
    "bandwidth_lag",
    MISALIGNMENT,
    "lever_arm",
    "scale_factor",
    "bias_constant",
    "bias_step",
    "intermittent_jump",
    "noise_variance_step",
];

/// Part of the gain of an effect on one of two instruments that the same on the other gains, at least: the motion is estimated from
/// both, and is worth more to the one that is less noisy.
const SAME_MOTION: f64 = 0.7;

/// Evidence from which on a change of noise is judged with the other free parameters fitted beside it.
const WORTH_REFITTING: f64 = 3.0;

/// One way to describe what a finding describes.
#[derive(Clone, Debug)]
pub struct Alternative {
    /// Its place among the candidates.
    pub candidate: usize,
    /// The term, if it is one.
    pub term: Option<Term>,
    /// The change of noise, if it is one.
    pub fit: Option<ChangeFit>,
    /// −ln p.
    pub evidence: f64,
    /// Gain in log-likelihood, nats.
    pub gain: f64,
    /// How it is judged.
    pub price: Price,
    /// It leads though another shows more, because it is the simpler of the two and the data do not tell.
    pub simpler: bool,
}

impl Alternative {
    /// Nats by which it is behind another: what its evidence may be at most keeps it from leading, and not from looking the same.
    fn behind(&self, best: &Self) -> f64 {
        let evidence = if self.price.most.is_finite() {
            Price { most: f64::INFINITY, ..self.price }.evidence(self.gain)
        } else {
            self.evidence
        };
        best.evidence - evidence
    }
}

/// Name of what a candidate acts on.
pub fn target_name(model: &Model, candidate: &Candidate) -> String {
    match &candidate.target {
        Target::Group { name, .. } => name.clone(),
        Target::Sensor(sensor) => model
            .source_of(*sensor, candidate.port)
            .and_then(|source| model.sources.get(source))
            .map_or_else(String::new, |source| source.name.clone()),
    }
}

/// All ways to describe what `item` describes that are within the class's distance of the best or the same function, what
/// leads first; `ln_level` is that of the family-wise probability of a finding. Where the `budget` has no room for it, terms are
/// compared under the noises as they are, and changes of noise are not compared.
pub fn alternatives(
    case: &Case<'_>,
    state: &State,
    item: Item,
    family: &Family,
    ln_level: f64,
    budget: &mut Budget,
) -> (Vec<Alternative>, State) {
    let model = case.model;
    let blocks = match item {
        Item::Term(place) => blocks_of(model, std::slice::from_ref(&state.terms[place])),
        Item::Change(place) => blocks_with(model, state.changes[place].source),
    };
    let (less, bench) = without(case, state, item);
    let affordable = budget.affords(of_item(case, state, &blocks));
    let touched = |candidate: usize| touches(case, candidate, &blocks);
    let mut found: Vec<Alternative> = Vec::new();
    // Under the noises fitted with the item, which are those that the terms are to be compared under.
    let mut kept = less.clone();
    if matches!(item, Item::Term(_)) {
        kept.noises.clone_from(&state.noises);
    }
    let kept_bench = Bench::new(case, &kept.terms, &kept.noises);
    let told_beside = |&block: &usize| model.common_motion_of(block).is_some();
    let is_free = |&block: &usize| !kept.free_in(model, block).is_empty();
    let free = affordable && blocks.iter().any(|block| is_free(block) || told_beside(block));
    for proposal in deterministic(&kept_bench, &library(&kept_bench, &touched), family, &touched) {
        let (mut gain, mut evidence_here) = (proposal.gain, proposal.evidence);
        if free {
            let mut with = kept.clone();
            with.terms.push(proposal.term.clone());
            let (with, _) = refitted(case, &with, Some(&blocks));
            gain = with.log_likelihood - less.log_likelihood;
            evidence_here = proposal.price.evidence(gain);
        }
        found.push(Alternative {
            candidate: proposal.term.candidate,
            price: proposal.price,
            term: Some(proposal.term),
            fit: None,
            evidence: evidence_here,
            gain,
            simpler: false,
        });
    }
    for (candidate, fit) in bench.noise_changes(&less, &blocks, &|_| affordable) {
        if blocks.iter().any(|&block| model.blocks[block].sources.contains(&fit.source)) {
            let price = fit.price();
            let (mut gain, mut evidence_here) = (fit.gain, -fit.ln_p);
            // Other free parameters of the noise were fitted without it.
            if free && evidence_here > WORTH_REFITTING {
                let mut with = less.clone();
                add_change(&mut with, candidate, fit.clone());
                let added = Item::Change(with.changes.len() - 1);
                let (with, _) = refitted(case, &with, Some(&blocks));
                gain = gain_of_item(added, &with, &less);
                evidence_here = price.evidence(gain);
            }
            let evidence = evidence_here;
            found.push(Alternative {
                candidate,
                term: None,
                fit: Some(fit),
                evidence,
                gain,
                price,
                simpler: false,
            });
        }
    }
    found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    prefer_radio(case, &mut found);
    let Some(best) = found.first().cloned() else { return (found, less) };
    found.retain(|other| {
        let behind = other.behind(&best);
        behind < CLASS_NATS || (behind < PRICED_NATS && other.gain > best.gain - CLASS_NATS)
    });
    prefer_simpler(case, &mut found);
    prefer_part(case, family, ln_level, &mut found);
    prefer_instrument(case, &mut found);
    prefer_output(case, &mut found);
    (found, less)
}

/// Of effects of one cause that explain the same equally well the first of the catalogue leads: it goes from the plain to
/// the particular, from a temperature to its rate. Not one with more parameters, and not a shape that was sought at every
/// time or frequency.
fn prefer_simpler(case: &Case<'_>, found: &mut [Alternative]) {
    let Some(best) = found.first().cloned() else { return };
    let is_scan = |other: &Alternative| {
        matches!(case.candidates[other.candidate].search, Search::Onset(_) | Search::Frequency)
    };
    let parameters = |other: &Alternative| {
        let candidate = &case.candidates[other.candidate];
        let amplitudes = candidate.amplitudes.iter().filter(|amplitude| amplitude.name != AT_MEAN).count();
        let rates = if matches!(candidate.search, Search::Readings(_)) { RATES } else { 0 };
        amplitudes + rates + other.term.as_ref().map_or(0, |term| term.nonlinear.len())
    };
    let cause = |other: &Alternative| {
        case.candidates[other.candidate]
            .variant
            .iter()
            .find(|(name, _)| *name == "column")
            .map(|(_, column)| column)
    };
    let simpler = (found.iter().enumerate().skip(1))
        .filter(|(_, other)| {
            other.candidate < best.candidate
                && other.gain > best.gain - INDIFFERENT_NATS
                && best.term.is_some()
                && other.term.is_some()
                && case.candidates[other.candidate].effect.id != case.candidates[best.candidate].effect.id
                && cause(other) == cause(&best)
                && !is_scan(other)
                && other.price.most == f64::INFINITY
                && parameters(other) <= parameters(&best)
        })
        .min_by_key(|(_, other)| other.candidate);
    if let Some((place, _)) = simpler {
        lead_as_simpler(found, place);
    }
}

/// What multiplies a quantity whose reference is free holds another effect as a part: a dependence on temperature a constant,
/// one of the scale factor on temperature the scale factor. The part leads unless what the whole adds to it would itself be
/// significant: it would not be found beside the part.
fn prefer_part(case: &Case<'_>, family: &Family, ln_level: f64, found: &mut [Alternative]) {
    let Some((best, others)) = found.split_first() else { return };
    let Some((_, part)) = best.term.as_ref().and_then(|whole| part_at_mean(case, whole)) else { return };
    let is_part = |other: &Alternative| {
        let columns = other.term.as_ref().filter(|term| term.nonlinear.is_empty() && !term.unit_amplitude);
        columns.is_some_and(|term| term.columns.as_slice() == std::slice::from_ref(part))
    };
    let Some(place) = others.iter().position(is_part) else { return };
    let adds = best.gain - others[place].gain;
    let freedom = best.price.freedom.saturating_sub(others[place].price.freedom).max(1);
    let candidate = &case.candidates[best.candidate];
    if family.ln_p(candidate, Price { freedom, ..best.price }.evidence(adds)) > ln_level {
        lead_as_simpler(found, place + 1);
    }
}

/// A line of one frequency inside a loop is one of what the loop puts out, but for how it begins. Where that does not tell, it is where it
/// is seen.
fn prefer_output(case: &Case<'_>, found: &mut [Alternative]) {
    let port = |other: &Alternative| {
        let candidate = &case.candidates[other.candidate];
        matches!(candidate.search, Search::Frequency).then_some(candidate.port)
    };
    let inside = [Some(Port::Accelerometer), Some(Port::Gyro)];
    if found.first().is_some_and(|best| inside.contains(&port(best)))
        && let Some(place) = found.iter().position(|other| port(other) == Some(Port::Output))
    {
        lead_as_simpler(found, place);
    }
}

/// Puts one first that shows no more than what led.
fn lead_as_simpler(found: &mut [Alternative], place: usize) {
    found[place].simpler = true;
    found[..=place].rotate_right(1);
}

/// The column of a term that another reference adds to it, and its place.
fn part_at_mean<'t>(case: &Case<'_>, whole: &'t Term) -> Option<(usize, &'t Column)> {
    let amplitudes = &case.candidates[whole.candidate].amplitudes;
    let place = amplitudes.iter().position(|amplitude| amplitude.name == AT_MEAN)?;
    Some((place, whole.columns.get(place)?))
}

/// What one sensor shows and its whole instrument explains as well is of the instrument: a clock, the mounting of a log, whose beams
/// are one casting. The axes of gyros and accelerometers are set one by one, and one that is turned is likelier than a unit of
/// which no other sensor shows it: there the sensor leads.
fn prefer_instrument(case: &Case<'_>, found: &mut [Alternative]) {
    let Some(best) = found.first() else { return };
    let first = &case.candidates[best.candidate];
    let of_one = |candidate: &Candidate, sensor: usize| {
        let source = case.model.source_of(sensor, candidate.port).map(|source| &case.model.sources[source]);
        candidate.effect.id == MISALIGNMENT
            && source.is_some_and(|source| source.unit.dimension() != Dimension::Velocity)
    };
    // An error with the angular acceleration of the one gyro that turns is as well a delay of its instrument.
    let is_late = |other: &Alternative| {
        let candidate = &case.candidates[other.candidate];
        let (Target::Sensor(sensor), Target::Group { sensors, .. }) = (&first.target, &candidate.target)
        else {
            return false;
        };
        (first.effect.id, candidate.effect.id) == (ANGULAR_ACCELERATION, TIME_DELAY)
            && sensors.contains(sensor)
            && other.gain > best.gain - INDIFFERENT_NATS
    };
    let of_one_effect = |other: &Alternative| {
        let candidate = &case.candidates[other.candidate];
        candidate.effect.id == first.effect.id
            && match (&first.target, &candidate.target) {
                (Target::Sensor(sensor), Target::Group { sensors, .. }) => {
                    sensors.contains(sensor) && !of_one(first, *sensor)
                }
                (Target::Group { sensors, .. }, Target::Sensor(sensor)) => {
                    sensors.contains(sensor)
                        && of_one(candidate, *sensor)
                        && other.gain > best.gain - INDIFFERENT_NATS
                }
                _ => false,
            }
    };
    if let Some(place) = found.iter().position(of_one_effect) {
        // What leads instead of one that shows more goes on to do so.
        found[place].simpler |= found[0].simpler;
        found[..=place].rotate_right(1);
    } else if let Some(place) = found.iter().position(is_late) {
        lead_as_simpler(found, place);
    }
}

/// Of a radio sensor and an inertial velocity that are only compared with each other, what one does is what the other does with the
/// opposite sign. The radio sensor leads in what an integral does not do: come late, jump, be out of scale with the speed or turned from
/// it. That their gains differ comes from the motion, which is estimated from both.
fn prefer_radio(case: &Case<'_>, found: &mut [Alternative]) {
    let Some(best) = found.first() else { return };
    let first = &case.candidates[best.candidate];
    let integrates = |candidate: &Candidate| -> Option<bool> {
        let of = |&sensor: &usize| {
            let source = &case.model.sources[case.model.source_of(sensor, Port::Output)?];
            Some(source.integrates)
        };
        let kinds: Option<Vec<bool>> = sensors_of(candidate).iter().map(of).collect();
        kinds.filter(|kinds| kinds.windows(2).all(|pair| pair[0] == pair[1]))?.first().copied()
    };
    let compared = sensors_of(first).first().is_some_and(|&sensor| {
        let block = case.model.block_of(sensor).map(|block| &case.model.blocks[block]);
        block.is_some_and(|block| {
            let place = block.sensors.iter().position(|&other| other == sensor);
            place.is_some_and(|place| block.alike(place).len() > 1)
        })
    });
    let Some(inertial_first) = integrates(first) else { return };
    if !compared || !OF_RADIO.contains(&first.effect.id) {
        return;
    }
    if !inertial_first {
        // It leads as well where it shows no more than what was selected.
        found[0].simpler = true;
        return;
    }
    let is_group = |candidate: &Candidate| matches!(candidate.target, Target::Group { .. });
    let leads = |other: &Alternative| {
        let candidate = &case.candidates[other.candidate];
        candidate.effect.id == first.effect.id
            && is_group(candidate) == is_group(first)
            && candidate.amplitudes.len() == first.amplitudes.len()
            && integrates(candidate) == Some(!inertial_first)
            && match other.fit {
                // Whose noise it is the readings tell beside their difference, if anything does.
                Some(_) => other.gain > best.gain - CLASS_NATS,
                None => other.gain > SAME_MOTION * best.gain,
            }
    };
    if let Some(place) = found.iter().position(leads) {
        lead_as_simpler(found, place);
    }
}

/// The class of the first of `alternatives` and its rivals; `pairs` are of terms that describe together what it does.
pub fn class(
    case: &Case<'_>,
    bench: &Bench<'_>,
    alternatives: &[Alternative],
    pairs: &[&PairInstead],
) -> (Vec<String>, Vec<Rival>) {
    let Some(first) = alternatives.first() else { return (Vec::new(), Vec::new()) };
    let own = &case.candidates[first.candidate];
    let name = target_name(case.model, own);
    let mut class = vec![own.effect.id.to_owned()];
    let mut rivals = Vec::new();
    let mut seen = HashSet::from([(name.clone(), own.effect.id)]);
    let alone = alternatives
        .iter()
        .skip(1)
        .map(|other| (other.candidate, other.term.as_ref(), other.behind(first).max(0.0), None));
    let near = pairs.iter().filter(|pair| pair.behind_nats < CLASS_NATS);
    let together = near.flat_map(|PairInstead { terms: [a, b], behind_nats, .. }| {
        [(a, b), (b, a)].map(|(one, beside)| {
            let together_with = case.candidates[beside.candidate].effect.id.to_owned();
            (one.candidate, Some(one), *behind_nats, Some(together_with))
        })
    });
    for (candidate, term, behind_nats, together_with) in alone.chain(together) {
        let candidate = &case.candidates[candidate];
        let sensor = target_name(case.model, candidate);
        if !seen.insert((sensor.clone(), candidate.effect.id)) {
            continue;
        }
        let angle = match (&first.term, term) {
            (Some(a), Some(b)) => bench.angle_deg(a, b),
            _ => 90.0,
        };
        if sensor == name {
            class.push(candidate.effect.id.to_owned());
        }
        rivals.push(Rival {
            sensor,
            effect: candidate.effect.id.to_owned(),
            principal_angle_deg: angle,
            behind_nats,
            separated_by: separated_by(own, candidate),
            together_with,
        });
    }
    if let Some(part) = part_of_its_own(case, bench, first)
        && seen.insert((name.clone(), part))
    {
        class.push(part.to_owned());
        rivals.push(Rival {
            sensor: name,
            effect: part.to_owned(),
            principal_angle_deg: 0.0,
            behind_nats: 0.0,
            separated_by: REFERENCE.to_owned(),
            together_with: None,
        });
    }
    (class, rivals)
}

/// What the part of a description that another reference adds to it would be by itself, where the data show that part: with it beside it the
/// description has any reference and is as good.
fn part_of_its_own(case: &Case<'_>, bench: &Bench<'_>, found: &Alternative) -> Option<&'static str> {
    let whole = found.term.as_ref()?;
    let (place, part) = part_at_mean(case, whole)?;
    let mut columns = (*whole.columns).clone();
    columns.remove(place);
    let less = Term { columns: Arc::new(columns), ..whole.clone() };
    if bench.gain_of(whole).0 - bench.gain_of(&less).0 < THREE_SIGMA_NATS {
        return None;
    }
    let own = &case.candidates[whole.candidate];
    let is_part = |other: &&Candidate| {
        (&other.target, other.port) == (&own.target, own.port)
            && matches!(&other.search, Search::Linear(signature) if signature.columns == std::slice::from_ref(part))
    };
    Some(case.candidates.iter().find(is_part)?.effect.id)
}

/// What tells an error of the loop's accelerometer from one of its gyro: the loop turns the platform until its velocity no longer
/// grows, so that an accelerometer's error a is the same as a tilt at the start and a gyro's drift ȧ/g.
const ACROSS_THE_LOOP: &str = "measure the platform's tilt from outside: an accelerometer's error a tilts it by a/g, a gyro's drift \
    ȧ/g that gives the same velocity does not; no profile of the temperature tells the two apart";

/// What tells a dependence whose reference is not known from one with a constant beside it.
const REFERENCE: &str = "state the reference at which it is nominal: what there is at the mean may be an error of its own beside the \
    dependence, in part or in all";

fn separated_by(own: &Candidate, other: &Candidate) -> String {
    let inertial = |port: Port| matches!(port, Port::Accelerometer | Port::Gyro);
    if inertial(own.port) && inertial(other.port) && own.port != other.port {
        return ACROSS_THE_LOOP.to_owned();
    }
    if matches!(other.search, Search::Noise(_)) && !matches!(own.search, Search::Noise(_)) {
        return own.effect.separated_by.to_owned();
    }
    other.effect.separated_by.to_owned()
}
