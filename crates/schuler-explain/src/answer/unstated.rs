//! The noise of sensors of which the case states none. It is no finding, as nothing says what else it should be, and it is told.
use super::parameters::of_knob;
use crate::evidence::fit::Description;
use crate::noise::Noise;
use crate::nominal::Model;
use crate::sentence::with_sigma;

/// A line for each sensor of which the case states no noise, with the noise that was fitted to it.
pub fn notes(model: &Model, description: &Description) -> Vec<String> {
    let unstated = model.sources.iter().zip(&description.noises).enumerate();
    let unstated = unstated.filter(|(_, (source, _))| source.unknown);
    let note = |(index, (source, noise)): (usize, (&_, &Noise))| {
        let block = model.block_of_source(index).and_then(|block| description.blocks[block].as_ref());
        let sigmas = block.map(|fit| fit.sigmas.as_slice()).unwrap_or_default();
        let part = |knob| {
            let relative = sigmas.iter().find(|(of, _)| *of == (index, knob)).map(|(_, sigma)| *sigma);
            let fitted = of_knob(source, &Noise::default(), knob, noise.get(knob), relative);
            let value = fitted.value.unwrap_or_default();
            let unit = fitted.unit.unwrap_or_default();
            let name = knob.name().1.trim_end_matches("_s").replace(['.', '_'], " ");
            format!("{name} {}", with_sigma(value, fitted.sigma, &unit))
        };
        let parts: Vec<String> = noise.knobs().into_iter().map(part).collect();
        format!("{}: the case gives no noise; estimated from the record: {}", source.name, parts.join(", "))
    };
    unstated.map(note).collect()
}
