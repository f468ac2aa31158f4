//! Failures.
use super::super::draw::Draw;
use super::super::likelihood::Noise;
use super::super::setting::Setting;
use super::Concealed;
use super::Family::Failure;
use super::Make;
use super::Rule;
use super::additive::onset;
use super::additive::pair;
use super::any;
use super::choose;
use super::fault;
use super::parasite;
use super::readout_of;
use super::scale_of;
use crate::physics::fault::Fault;
use crate::physics::parasite::Disturbance;
use crate::physics::readout::Conversion;

pub(super) fn output_stuck(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (from, end) = onset(setting, draw);
    let output = id.clone();
    let mut it = Concealed::new("output_stuck", Failure, &id, 1.0, move |s, _| {
        fault(s, &output, Fault::Stuck, from, f64::INFINITY);
    });
    it.with_noise = true;
    it.linear = false;
    Some(it.during(from, end).parameter("onset_s", "s", Rule::Instant(from)))
}

pub(super) fn output_saturated(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, make) = choose(setting, draw, |_, make| matches!(make, Make::Fibre | Make::Accelerometer))?;
    let most = if make == Make::Fibre { 1.0 } else { 11.0 };
    let output = id.clone();
    let mut it = Concealed::new("output_saturated", Failure, &id, 0.1, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.range = most * (-size.abs()).exp();
        }
    });
    it.with_noise = true;
    Some(it.curved())
}

pub(super) fn dead_zone(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = choose(setting, draw, |_, make| matches!(make, Make::Fibre | Make::Doppler))?;
    let output = id.clone();
    let it = Concealed::new("dead_zone", Failure, &id, scale_of(setting, &id), move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.threshold = size.abs();
        }
    });
    Some(it.curved())
}

pub(super) fn quantisation(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let output = id.clone();
    let step = setting.noise_of(&id).white * draw.log_between(1.0, 4.0);
    let it = Concealed::new("quantisation", Failure, &id, step, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.conversion = Conversion::Rounding(size.abs());
        }
    });
    Some(
        it.noise(false, |noise, size| Noise {
            white: noise.white.hypot(size / 12f64.sqrt()),
            ..noise.clone()
        }),
    )
}

pub(super) fn intermittent_jump(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let duration = setting.scenario.duration_s;
    let (on_s, off_s) = (duration / draw.log_between(60.0, 300.0), duration / draw.between(8.0, 20.0));
    let output = id.clone();
    let shift = scale_of(setting, &id) * draw.sign();
    let it = Concealed::new("intermittent_jump", Failure, &id, shift, move |s, size| {
        parasite(s, &output, Disturbance::Telegraph { shift: size, on_s, off_s });
    });
    Some(pair(setting, it))
}
