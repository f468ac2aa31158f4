//! Structure of the noise.
use super::super::draw::Draw;
use super::super::likelihood::Noise;
use super::super::setting::Kind;
use super::super::setting::Setting;
use super::Concealed;
use super::Family::Noise as Structure;
use super::Make;
use super::Rule;
use super::additive::onset;
use super::additive::pair;
use super::any;
use super::choose;
use super::fault;
use super::named;
use super::parasite;
use super::readout_of;
use super::unit_of;
use crate::physics::fault::Fault;
use crate::physics::parasite::Disturbance;
use crate::physics::random::Process;
use crate::physics::readout::Conversion;

pub(super) fn noise_white(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let output = id.clone();
    let it = Concealed::new("noise_white", Structure, &id, 0.05, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.white *= 1.0 + size.abs();
        }
    });
    Some(it.noise(false, |noise, size| Noise { white: noise.white * (1.0 + size.abs()), ..noise.clone() }))
}

/// A drift more.
pub(super) fn drifting(
    setting: &Setting,
    draw: &mut Draw,
    effect: &'static str,
    process: impl Fn(f64) -> Process + Send + Sync + Clone + 'static,
) -> Option<Concealed> {
    // Where the noise of the nominal model is white, nothing can swallow the drift.
    let (id, _) =
        choose(setting, draw, |id, make| make != Make::Velocity && setting.noise_of(id).drift.len() <= 1)?;
    let output = id.clone();
    let start = 0.3 * setting.noise_of(&id).white;
    let more = process.clone();
    let it = Concealed::new(effect, Structure, &id, start, move |s, size| {
        if let Some(it) = readout_of(s, &output) {
            it.electronics_drift.push(more(size.abs()));
        }
    });
    Some(it.noise(true, move |noise, size| {
        let mut noise = noise.clone();
        noise.drift.push(process(size.abs()));
        noise
    }))
}

pub(super) fn noise_markov(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let tau_s = draw.log_between(5.0 * step, duration / 20.0);
    let it = drifting(setting, draw, "noise_markov", move |sigma| Process::Markov { sigma, tau_s })?;
    let per = 1.0 / setting.unit(&it.sensor).in_si();
    let unit = unit_of(setting, &it.sensor);
    Some(it.parameter("tau_s", "s", Rule::Fixed(tau_s)).parameter("sigma", unit, Rule::Sized(per)))
}

pub(super) fn noise_exp_cos(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let beta = std::f64::consts::TAU / draw.log_between(15.0 * step, duration / 25.0);
    let alpha = beta / draw.log_between(3.0, 15.0);
    let it = drifting(setting, draw, "noise_exp_cos", move |sigma| Process::ExponentialCosine {
        sigma,
        alpha,
        beta,
    })?;
    let per = 1.0 / setting.unit(&it.sensor).in_si();
    let unit = unit_of(setting, &it.sensor);
    Some(
        it.parameter("alpha", "1/s", Rule::Fixed(alpha))
            .parameter("beta", "rad/s", Rule::Fixed(beta))
            .parameter("sigma", unit, Rule::Sized(per)),
    )
}

pub(super) fn noise_random_walk(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let duration = setting.scenario.duration_s;
    drifting(setting, draw, "noise_random_walk", move |size| Process::RandomWalk {
        rate: size / (0.1 * duration).sqrt(),
    })
}

pub(super) fn noise_flicker(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (shortest_s, longest_s) = (4.0 * setting.scenario.step_s, setting.scenario.duration_s);
    drifting(setting, draw, "noise_flicker", move |instability| Process::Flicker {
        instability,
        shortest_s,
        longest_s,
    })
}

pub(super) fn noise_angle_quantisation(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let rounded = |id: &str| {
        let s = &setting.scenario;
        s.gyros.iter().any(|g| g.ids.0 == id && g.design.readout[0].conversion != Conversion::Exact)
            || s.fogs.iter().any(|g| g.id == id && g.design.readout.conversion != Conversion::Exact)
    };
    let (id, _) = choose(setting, draw, |id, make| make != Make::Velocity && !rounded(id))?;
    let step = setting.scenario.step_s;
    let output = id.clone();
    let it = Concealed::new(
        "noise_angle_quantisation",
        Structure,
        &id,
        setting.noise_of(&id).white * step,
        move |s, size| {
            if let Some(it) = readout_of(s, &output) {
                it.conversion = Conversion::Pulses(size.abs());
            }
        },
    );
    Some(it.noise(false, move |noise, size| Noise {
        left_over: size.abs() / step / 12f64.sqrt(),
        ..noise.clone()
    }))
}

pub(super) fn noise_variance_step(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (from, end) = onset(setting, draw);
    let output = id.clone();
    let it = Concealed::new(
        "noise_variance_step",
        Structure,
        &id,
        0.4 * setting.noise_of(&id).white,
        move |s, size| {
            fault(s, &output, Fault::Noise(size.abs()), from, f64::INFINITY);
        },
    );
    let it = it.during(from, end).parameter("onset_s", "s", Rule::Instant(from));
    Some(it.noise(false, move |noise, size| Noise { more_white: Some((from, size.abs())), ..noise.clone() }))
}

pub(super) fn noise_outliers(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, make) =
        choose(setting, draw, |_, make| make != Make::Velocity || setting.kind == Kind::Channel)?;
    if setting.kind == Kind::Channel && make != Make::Velocity {
        return None;
    }
    let every_s = setting.scenario.duration_s / draw.log_between(4.0, 40.0);
    let output = id.clone();
    let name = named(setting, &id, make);
    let size = setting.noise_of(&id).white * draw.between(5.0, 12.0);
    let it = Concealed::new("noise_outliers", Structure, &name, size, move |s, size| {
        parasite(s, &output, Disturbance::Bursts { size, every_s, decay_s: 0.0 });
    });
    let probability = 1.0 - (-setting.scenario.step_s / every_s).exp();
    let it = it
        .read_at(&id)
        .noise(false, move |noise, size| Noise { spikes: Some((probability, size.abs())), ..noise.clone() });
    Some(pair(setting, it))
}
