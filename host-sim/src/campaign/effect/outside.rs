//! What is in no catalogue.
use super::super::draw::Draw;
use super::super::setting::Setting;
use super::Concealed;
use super::Family::Outside;
use super::any;
use super::parasite;
use super::scale_of;
use crate::physics::parasite::Disturbance;
use crate::scenario::QuantityEntry;

pub(super) fn outside_bilinear(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let quantities = &setting.scenario.recorded.quantities;
    let [a, b] = [quantities.first()?, quantities.get(1)?];
    let middle =
        |q: &QuantityEntry| q.profile.points.iter().map(|p| p.1).sum::<f64>() / q.profile.points.len() as f64;
    let spread =
        |q: &QuantityEntry| q.profile.points.iter().map(|p| (p.1 - middle(q)).abs()).fold(1e-9, f64::max);
    let (columns, references) = ([a.column.clone(), b.column.clone()], [middle(a), middle(b)]);
    let (id, _) = any(setting, draw)?;
    let start = scale_of(setting, &id) / spread(a) / spread(b) * draw.sign();
    let output = id.clone();
    Some(Concealed::new("outside_bilinear", Outside, &id, start, move |s, size| {
        parasite(s, &output, Disturbance::Mixed { columns: columns.clone(), coefficient: size, references });
    }))
}

pub(super) fn outside_chirp(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let (duration, step) = (setting.scenario.duration_s, setting.scenario.step_s);
    let f = draw.log_between(20.0 / duration, 0.2 / step);
    let phase = draw.between(0.0, std::f64::consts::TAU);
    let output = id.clone();
    Some(Concealed::new("outside_chirp", Outside, &id, 0.2 * scale_of(setting, &id), move |s, size| {
        let machine =
            Disturbance::Machine { amplitude: size, start_hz: 0.3 * f, end_hz: f, over_s: duration, phase };
        parasite(s, &output, machine);
    }))
}

pub(super) fn outside_popcorn(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let duration = setting.scenario.duration_s;
    let (every_s, decay_s) = (duration / draw.between(10.0, 40.0), duration / draw.between(150.0, 600.0));
    let output = id.clone();
    Some(Concealed::new("outside_popcorn", Outside, &id, scale_of(setting, &id), move |s, size| {
        parasite(s, &output, Disturbance::Bursts { size, every_s, decay_s });
    }))
}

pub(super) fn outside_telegraph(setting: &Setting, draw: &mut Draw) -> Option<Concealed> {
    let (id, _) = any(setting, draw)?;
    let duration = setting.scenario.duration_s;
    let output = id.clone();
    Some(Concealed::new(
        "outside_telegraph",
        Outside,
        &id,
        scale_of(setting, &id) * draw.sign(),
        move |s, size| {
            parasite(
                s,
                &output,
                Disturbance::Telegraph { shift: size, on_s: duration / 12.0, off_s: duration / 12.0 },
            );
        },
    ))
}
