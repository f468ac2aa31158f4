//! Noise of an output: the true one, and what its user knows of it.
use schuler_recording::case::{ExponentialCosine, Markov, Nominal};

use crate::campaign::draw::Draw;
use crate::campaign::likelihood::Noise;
use crate::physics::random::Process;
use crate::physics::readout::ReadoutDesign;

/// Noise of an output whose unit has this SI value: white of this order per reading and often something correlated.
pub(super) fn noise(white: f64, si: f64, duration_s: f64, step_s: f64, draw: &mut Draw) -> (Noise, Nominal) {
    let white = round(white * draw.log_between(0.5, 2.0));
    let mut noise = Noise { white: white * si, ..Noise::default() };
    let mut nominal = Nominal { white, ..Nominal::default() };
    let sigma = round(white * draw.log_between(0.2, 2.0));
    let tau_s = round((duration_s / draw.log_between(30.0, 300.0)).max(8.0 * step_s));
    let which = draw.between(0.0, 1.0);
    if which < 0.5 {
        noise.drift.push(Process::Markov { sigma: sigma * si, tau_s });
        nominal.markov = Some(Markov { sigma, tau_s });
    } else if which < 0.65 {
        let alpha = round(1.0 / tau_s);
        let beta = round(alpha * draw.between(2.0, 6.0));
        noise.drift.push(Process::ExponentialCosine { sigma: sigma * si, alpha, beta });
        nominal.exp_cos = Some(ExponentialCosine { sigma, alpha, beta });
    } else if which < 0.75 {
        let rate = round(white * draw.log_between(0.1, 1.0) / duration_s.sqrt());
        noise.drift.push(Process::RandomWalk { rate: rate * si });
        nominal.random_walk = rate;
    }
    (noise, nominal)
}

/// To three digits, as people write numbers into a case.
pub(super) fn round(value: f64) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    let scale = 10f64.powf(2.0 - value.abs().log10().floor());
    (value * scale).round() / scale
}

/// The output of an instrument whose readings have this noise, as a case states it: the drift is that of the readings themselves.
pub(super) fn readout(noise: &Noise, step_s: f64) -> ReadoutDesign {
    ReadoutDesign {
        white: noise.white * step_s.sqrt(),
        electronics_drift: noise.drift.clone(),
        range: f64::INFINITY,
        ..ReadoutDesign::default()
    }
}

pub(super) fn velocity_noise(white: f64, duration_s: f64, step_s: f64, draw: &mut Draw) -> (Noise, Nominal) {
    noise(white, 1.0, duration_s, step_s, draw)
}
