//! The noise of every sensor: stated, found, and how far its spectrum holds.
use crate::exact::OverRows;
use crate::explanation::{NoiseNumbers, NoiseOfSensor};
use crate::noise::Noise;
use crate::nominal::Source;
use crate::problem::prepared::Prepared;

/// A row a source of noise, in the order of the case; a sensor whose noise nobody states has nothing stated.
pub fn noise_table(rows: &OverRows<'_>, prepared: &Prepared) -> Vec<NoiseOfSensor> {
    let model = rows.bench.problem.model;
    let stated = |index: usize| prepared.unstated.iter().all(|(source, _)| *source != index);
    let of = |(index, (source, found)): (usize, (&Source, &Noise))| {
        let fit = model.block_of_source(index).and_then(|block| rows.description.blocks[block].as_ref());
        let nu = fit.map(|fit| fit.nu).filter(|nu| nu.is_finite());
        let in_unit = source.unit.in_si();
        NoiseOfSensor {
            sensor: source.name.clone(),
            unit: source.unit.name().to_owned(),
            stated: (!source.unknown && stated(index)).then(|| numbers(&source.nominal, in_unit)),
            found: numbers(found, in_unit),
            nu,
            // Of the root of a level whose inverse is χ²(ν)/ν.
            holds_within: nu.map_or(0.0, |nu| (2.0 * nu).sqrt().recip()),
        }
    };
    model.sources.iter().zip(&rows.description.noises).enumerate().map(of).collect()
}

fn numbers(noise: &Noise, in_unit: f64) -> NoiseNumbers {
    NoiseNumbers {
        white: noise.white / in_unit,
        markov: noise.markov.iter().map(|it| [it.sigma / in_unit, it.tau_s]).collect(),
        exp_cos: noise.exp_cos.iter().map(|it| [it.sigma / in_unit, it.alpha, it.beta]).collect(),
        random_walk: noise.random_walk / in_unit,
        flicker: noise.flicker.sigma / in_unit,
        angle: noise.angle / in_unit,
    }
}
