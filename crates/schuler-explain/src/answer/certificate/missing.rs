//! Effects of the catalogue that a recording cannot show, because it lacks what they need.
use crate::catalogue::{CATALOGUE, Effect, OF_READINGS, Port, named};
use crate::description::sensors_of;
use crate::explanation::Bound;
use crate::problem::Problem;

/// One for each sensor and each effect that acts on such a sensor and was not sought in it.
pub fn bounds(problem: &Problem<'_>) -> Vec<Bound> {
    // Where the caller gives candidates of other effects, the catalogue was not asked.
    if problem.candidates.iter().all(|candidate| named(candidate.effect.id).is_none()) {
        return Vec::new();
    }
    let is_of_the_mean =
        |effect: &&Effect| !effect.is_noise() && OF_READINGS.iter().all(|other| other.id != effect.id);
    let mut bounds = Vec::new();
    for source in problem.model.sources.iter().filter(|source| source.port == Port::Output) {
        let Some(series) = problem.inputs.recording.sensors.get(source.sensor) else { continue };
        let is_sought = |effect: &Effect| {
            let mut of_it = problem.candidates.iter().filter(|it| it.effect.id == effect.id);
            of_it.any(|it| sensors_of(it).contains(&source.sensor))
        };
        let missing = CATALOGUE.iter().filter(is_of_the_mean);
        for effect in missing.filter(|it| (it.acts_on)(series.sensor.kind) && !is_sought(it)) {
            bounds.push(Bound {
                sensor: source.name.clone(),
                effect: effect.id.to_owned(),
                adds_unit: source.unit.name().to_owned(),
                because: Some(format!("the recording lacks what it needs: {}", effect.needs)),
                ..Bound::default()
            });
        }
    }
    bounds
}
