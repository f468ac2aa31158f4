//! The parts by which the noise of a source may differ from the stated one, where a fit begins, and how far each may go.
use schuler_recording::case::{ExponentialCosine, Markov};

use crate::catalogue::NoiseChange;
use crate::noise::{Flicker, Knob, Noise};

/// Shortest correlation times of flicker, in steps, that are tried: what it is made of ends somewhere.
const SHORTEST_FLICKER_STEPS: [f64; 2] = [2.0, 6.0];

/// Damping of an oscillation in a narrow band with which a fit begins, in inverse durations of the record.
const NARROW: [f64; 3] = [3.0, 15.0, 75.0];

/// Part of its level with which a Markov process counts as absent where a fit begins.
const ABSENT: f64 = 1e-3;

/// A noise with other or more parameters.
#[derive(Clone, Debug)]
pub struct Start {
    /// The noise.
    pub noise: Noise,
    /// The parameters that are free.
    pub knobs: Vec<Knob>,
}

/// A source whose noise is fitted.
#[derive(Clone, Copy, Debug)]
pub struct Fitting<'f> {
    /// Root mean square of what its noise makes of the output.
    pub spread: f64,
    /// Step, s.
    pub step_s: f64,
    /// Duration of the record, s.
    pub duration_s: f64,
    /// Frequencies at which the record shows that its power is in a narrow band, rad a row.
    pub resolved: &'f [f64],
}

/// Where fits of a change of the noise of a source begin.
pub fn starts(noise: &Noise, change: NoiseChange, fitting: Fitting<'_>) -> Vec<Start> {
    let Fitting { spread, step_s, duration_s, resolved } = fitting;
    let with = |knobs: &[Knob], set: &dyn Fn(&mut Noise)| {
        let mut noise = noise.clone();
        set(&mut noise);
        Start { noise, knobs: knobs.to_vec() }
    };
    let times = |count: usize| {
        let (low, high) = (3.0 * step_s, 0.5 * duration_s);
        (0..count).map(move |k| low * (high / low).powf((k as f64 + 0.5) / count as f64))
    };
    match change {
        NoiseChange::White => {
            let white = if noise.white > 0.0 { noise.white } else { 0.3 * spread };
            vec![with(&[Knob::White], &|noise| noise.white = white)]
        }
        NoiseChange::Markov => {
            let part = noise.markov.len();
            let added = times(5).map(|tau_s| {
                with(&[Knob::MarkovSigma(part), Knob::MarkovTau(part)], &|noise| {
                    noise.markov.push(Markov { sigma: 0.3 * spread, tau_s });
                })
            });
            let moved = (0..part).map(|at| with(&[Knob::MarkovSigma(at), Knob::MarkovTau(at)], &|_| ()));
            moved.chain(added).collect()
        }
        NoiseChange::ExponentialCosine => {
            let part = noise.exp_cos.len();
            let knobs = [Knob::CosineSigma(part), Knob::CosineAlpha(part), Knob::CosineBeta(part)];
            let added = times(8).map(|period_s| {
                let beta = std::f64::consts::TAU / period_s;
                with(&knobs, &|noise| {
                    noise.exp_cos.push(ExponentialCosine { sigma: 0.3 * spread, alpha: 0.2 * beta, beta });
                })
            });
            let narrow =
                resolved.iter().flat_map(|omega| NARROW.map(|turns| (omega / step_s, turns / duration_s)));
            let narrow = narrow.map(|(beta, alpha)| {
                with(&knobs, &|noise| {
                    noise.exp_cos.push(ExponentialCosine { sigma: 0.3 * spread, alpha, beta });
                })
            });
            let moved = (0..part).map(|at| {
                with(&[Knob::CosineSigma(at), Knob::CosineAlpha(at), Knob::CosineBeta(at)], &|_| ())
            });
            // In the place of a Markov process, of which nothing is left.
            let instead = (0..noise.markov.len()).flat_map(|at| {
                let knobs = [Knob::MarkovSigma(at)].into_iter().chain(knobs).collect::<Vec<Knob>>();
                times(8).map(move |period_s| (at, knobs.clone(), std::f64::consts::TAU / period_s))
            });
            let instead = instead.map(|(at, knobs, beta)| {
                with(&knobs, &|noise| {
                    let sigma = noise.markov[at].sigma;
                    noise.markov[at].sigma = ABSENT * sigma;
                    noise.exp_cos.push(ExponentialCosine { sigma, alpha: 0.2 * beta, beta });
                })
            });
            moved.chain(added).chain(narrow).chain(instead).collect()
        }
        NoiseChange::RandomWalk => {
            let coefficient =
                if noise.random_walk > 0.0 { noise.random_walk } else { 0.3 * spread / duration_s.sqrt() };
            vec![with(&[Knob::RandomWalk], &|noise| noise.random_walk = coefficient)]
        }
        NoiseChange::Flicker => {
            if noise.flicker.sigma > 0.0 {
                return vec![with(&[Knob::Flicker], &|_| ())];
            }
            let of = |steps: f64| {
                let flicker = Flicker { sigma: 0.1 * spread, tau_s: [steps * step_s, duration_s] };
                with(&[Knob::Flicker], &|noise| noise.flicker = flicker)
            };
            SHORTEST_FLICKER_STEPS.into_iter().map(of).collect()
        }
        NoiseChange::AngleQuantisation => {
            let sigma = if noise.angle > 0.0 { noise.angle } else { 0.3 * spread };
            vec![with(&[Knob::Angle], &|noise| noise.angle = sigma)]
        }
        NoiseChange::VarianceStep | NoiseChange::LevelAbove(_) => Vec::new(),
    }
}

/// Natural logarithm of the range over which a parameter is expected, before the record is seen.
pub fn ln_range(knob: Knob, step_s: f64, duration_s: f64, of_level: f64) -> f64 {
    match knob {
        Knob::MarkovTau(_) | Knob::CosineAlpha(_) | Knob::CosineBeta(_) => {
            (duration_s / step_s).max(std::f64::consts::E).ln()
        }
        _ => of_level,
    }
}

/// Smallest and largest value of a parameter that a record can show.
pub fn bounds(knob: Knob, spread: f64, step_s: f64, duration_s: f64) -> [f64; 2] {
    match knob {
        Knob::MarkovTau(_) => [0.5 * step_s, 10.0 * duration_s],
        Knob::CosineAlpha(_) => [0.1 / duration_s, 1.0 / step_s],
        Knob::CosineBeta(_) => [std::f64::consts::TAU / duration_s, std::f64::consts::PI / step_s],
        // What is inside a loop is some orders less than what it makes of the output.
        Knob::RandomWalk => [1e-12 * spread / duration_s.sqrt(), 1e3 * spread / step_s.sqrt()],
        _ => [1e-12 * spread, 1e3 * spread],
    }
}
