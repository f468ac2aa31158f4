//! The maker of cases: draws a setting and effects, finds sizes near the limit of detection, and simulates.
//!
//! A case depends on its seed, its place in the plan and what the plan asks for there, and on nothing else.
use super::answer::Answer;
use super::draw::Draw;
use super::effect::{Concealed, EFFECTS, Entry, Family};
use super::plan::Group;
use super::setting::{Kind, Setting};
use crate::output::Interrupted;
use crate::simulation::Simulated;

use bench::{Bench, Sized};

mod bench;
mod finish;
mod formula;
mod noise;
mod onset;
mod size;

/// A case with what the oracle knows of it.
#[derive(Clone, Debug)]
pub struct Made {
    /// Case, recording and truth.
    pub simulated: Simulated,
    /// What was concealed.
    pub answer: Answer,
    /// Gain of taking everything out, nats, row by row of the complete grid; NaN where nothing was recorded.
    pub gain: Vec<f64>,
}

/// Why a case could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Unmade {
    /// The user has stopped it.
    #[error(transparent)]
    Stopped(#[from] Interrupted),
    /// No effect that the plan allows could be put into any setting that it allows.
    #[error("group \"{0}\": none of its effects can be concealed in its settings")]
    Impossible(String),
}

/// Which case is made.
struct Order<'a> {
    /// What the plan asks for.
    group: &'a Group,
    /// Its place in the plan.
    index: usize,
    seed: u64,
}

/// Settings tried for an effect before another is drawn.
const TRIES: usize = 40;
/// Effects tried for a case; of those that a setting distorts, few are what they are called.
const MOST_EFFECTS_TRIED: usize = 250;

/// Makes a case of a group. `check` hears that work goes on and may stop it.
///
/// # Errors
/// The run was stopped, or the group asks for what cannot be.
pub fn make(
    group: &Group,
    index: usize,
    seed: u64,
    check: &dyn Fn() -> Result<(), Interrupted>,
) -> Result<Made, Unmade> {
    let mut draw = Draw::new(seed, "what");
    for attempt in 0..MOST_EFFECTS_TRIED {
        let entries = group.entries();
        let entry = (!entries.is_empty()).then(|| entries[draw.index(entries.len())]);
        let kinds = entry.map_or(Kind::ALL.as_slice(), |entry| entry.kinds);
        let kinds: Vec<Kind> = kinds.iter().copied().filter(|k| group.allows(*k)).collect();
        let Some(kind) = kinds.get(draw.index(kinds.len())).copied() else { continue };
        for _ in 0..TRIES {
            let mut setting_draw = Draw::new(seed, &format!("setting {attempt} {}", draw.between(0.0, 1.0)));
            let setting = Setting::draw(kind, group.most_rows, seed, &mut setting_draw);
            let first = match entry {
                Some(entry) => match (entry.draw)(&setting, &mut draw) {
                    Some(first) => Some(first),
                    None => continue,
                },
                None => None,
            };
            let order = Order { group, index, seed };
            if let Some(made) = conceal(&order, setting, first, &mut draw, check)? {
                return Ok(made);
            }
            break;
        }
    }
    Err(Unmade::Impossible(group.name.clone()))
}

/// Conceals effects in a setting, the first of which is chosen; none if they do not go into it.
fn conceal(
    order: &Order<'_>,
    setting: Setting,
    first: Option<Concealed>,
    draw: &mut Draw,
    check: &dyn Fn() -> Result<(), Interrupted>,
) -> Result<Option<Made>, Unmade> {
    let group = order.group;
    let bench = Bench::new(setting, check)?;
    let mut effects = Vec::new();
    if let Some(first) = first {
        let Some(sized) = bench.size(first, group.gain_nats, draw)? else { return Ok(None) };
        effects.push(sized);
        let wanted = if group.effects > 1 { 2 + draw.index(group.effects - 1) } else { 1 };
        for _ in 0..TRIES {
            if effects.len() >= wanted {
                break;
            }
            let entries: Vec<&Entry> = group.entries();
            let entry = entries[draw.index(entries.len())];
            if !entry.kinds.contains(&bench.setting.kind) {
                continue;
            }
            let Some(another) = (entry.draw)(&bench.setting, draw) else { continue };
            if !goes_with(&effects, &another) {
                continue;
            }
            let Some(sized) = bench.size(another, group.gain_nats, draw)? else { continue };
            effects.push(sized);
            if !bench.tells_apart(&effects) {
                effects.pop();
            }
        }
        if effects.len() < wanted {
            return Ok(None);
        }
    }
    bench.finish(order, &effects, draw).map(Some)
}

/// Whether an effect can stand beside others: one that changes the noise or fails takes its sensor for itself, and no effect comes
/// twice on one sensor.
fn goes_with(effects: &[Sized], another: &Concealed) -> bool {
    let alone = |it: &Concealed| it.noise.is_some() || it.with_noise || it.family == Family::Outside;
    effects.iter().all(|it| {
        let it = &it.concealed;
        let together = it.sensor == another.sensor || it.output == another.output;
        let same = it.effect == another.effect
            || it.same.iter().any(|(_, e)| *e == another.effect)
            || another.same.iter().any(|(_, e)| *e == it.effect);
        !(together && (same || alone(it) || alone(another))) && !(same && it.effect == another.effect)
    })
}

/// The entries of the catalogue of makers that a list of names or families asks for.
pub fn entries(names: &[String], families: &[Family]) -> Vec<&'static Entry> {
    EFFECTS
        .iter()
        .filter(|e| families.contains(&e.family) || names.iter().any(|name| name == e.effect))
        .collect()
}
