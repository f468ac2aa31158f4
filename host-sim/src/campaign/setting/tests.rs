//! What a setting states of its noise is the noise of its readings.
use super::noise::readout;
use super::*;
use crate::campaign::likelihood::Model;
use crate::campaign::oracle;
use crate::physics::random::Process;
use crate::physics::readout::{Readout, Surroundings};
use crate::simulation;

/// Twice what a free level of the white noise gains over the stated one, nearly: χ² with one degree of freedom.
fn of_free_white(time_s: &[f64], series: &[f64], model: impl Fn(f64) -> Model) -> f64 {
    let step: f64 = 0.01;
    let [less, stated, more] = [-step, 0.0, step].map(|by| model(by.exp()).log_likelihood(time_s, series));
    let slope = (more - less) / (2.0 * step);
    let curvature = (2.0 * stated - more - less) / (step * step);
    slope * slope / curvature
}

/// What a case states as noise is the noise of the readings, whatever the instrument: 1e-4 is χ² > 15.
#[test]
fn readings_have_the_noise_that_the_case_states() {
    for kind in Kind::ALL {
        for seed in 1..=3 {
            let setting = Setting::draw(kind, 6000, seed, &mut Draw::new(seed, "setting"));
            let rows = simulation::steps(&setting.scenario);
            let time: Vec<f64> = (1..=rows).map(|k| k as f64 * setting.scenario.step_s).collect();
            let run = |scenario: &Scenario| {
                oracle::outputs(&setting, &simulation::run(scenario, |_| Ok(())).unwrap(), rows)
            };
            let with = run(&oracle::exact(&setting.scenario));
            let noise = oracle::difference(&with, &run(&oracle::silent(&setting.scenario)));
            let views = |factor: f64| {
                oracle::views(&setting, |id| {
                    let it = setting.noise_of(id);
                    Noise { white: factor * it.white, ..it }
                })
            };
            for (k, view) in views(1.0).iter().enumerate() {
                let series = view.of(&noise, rows);
                let found = of_free_white(&time, &series, |factor| views(factor)[k].model.clone());
                assert!(found < 15.0, "{kind:?} {seed} {:?}: {found}", view.weights);
            }
        }
    }
}

/// The same where the white noise is small beside what the drift moves from reading to reading.
#[test]
fn a_fast_drift_leaves_the_white_noise_as_stated() {
    let step_s = 0.5;
    for process in [
        Process::Markov { sigma: 1.0, tau_s: 2.5 },
        Process::ExponentialCosine { sigma: 1.0, alpha: 0.1, beta: 0.8 },
        Process::RandomWalk { rate: 0.5 },
        Process::Flicker { instability: 2.0, shortest_s: 2.0, longest_s: 2000.0 },
    ] {
        let noise = Noise { white: 0.1, drift: vec![process], ..Noise::default() };
        let mut output = Readout::new(readout(&noise, step_s), 1, "x");
        let series: Vec<f64> =
            (0..20_000).map(|_| output.read(0.0, &Surroundings::default(), step_s)).collect();
        let time: Vec<f64> = (1..=series.len()).map(|k| k as f64 * step_s).collect();
        let of = |factor: f64| Noise { white: factor * noise.white, ..noise.clone() }.model(step_s);
        let found = of_free_white(&time, &series, of);
        assert!(found < 15.0, "{process:?}: {found}");
    }
}
