//! Many sensors, and somebody who watches.
use std::sync::atomic::AtomicBool;
use std::sync::atomic::{AtomicUsize, Ordering};

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::common_motion::CommonMotion;
use schuler_explain::explain::{Error, Options, explain_watched};
use schuler_explain::noise::{Knob, Noise};
use schuler_explain::noise_fit::{SourceKnob, curvature, logs_of, with_logs};
use schuler_explain::nominal::Model;
use schuler_explain::spectrum::{Derivatives, Spectrum};
use schuler_explain::watch::{Phase, Watch};
use schuler_recording::Recording;
use schuler_recording::case::{Markov, MotionKind, Nominal, SensorKind};
use schuler_recording::recording::SensorSeries;
use schuler_recording::unit::Unit;

mod common;

const WHITE: f64 = 1e-6;
/// Step of differences, in logarithms.
const STEP: f64 = 0.01;

/// Gyros whose axes are spread over the sphere, in a motion that nobody knows; one has an error that grows with time.
fn gyros(number: usize, rows: usize, drift: f64) -> Recording {
    let mut random = Pcg64::seed_from_u64(3);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let sensors: Vec<SensorSeries> = (0..number)
        .map(|index| {
            let height = 1.0 - (2 * index + 1) as f64 / number as f64;
            let (sin, cos) = (2.4 * index as f64).sin_cos();
            let along = (1.0 - height * height).sqrt();
            let axis = [along * cos, along * sin, height];
            let mut colour = 0.0;
            let values = (0..rows)
                .map(|row| {
                    let t = row as f64;
                    let rate = [0.01 * (0.02 * t).sin(), 0.02 * (0.01 * t).cos(), 0.01 * (0.03 * t).sin()];
                    let motion: f64 = axis.iter().zip(rate).map(|(axis, rate)| axis * rate).sum();
                    colour = 0.98 * colour + 0.2 * normal();
                    let own = if index == 4 { drift * t / rows as f64 } else { 0.0 };
                    motion + own + WHITE * (normal() + 0.5 * colour)
                })
                .collect();
            let nominal = Nominal {
                white: WHITE,
                markov: Some(Markov { sigma: 0.5 * WHITE, tau_s: 50.0 }),
                ..Nominal::default()
            };
            let kind = (SensorKind::Fog, Unit::RadianPerSecond);
            common::series(&format!("gyro_{index}"), kind, axis, nominal, values)
        })
        .collect();
    common::recording(MotionKind::Unknown, sensors)
}

/// Derivatives in closed form are those by differences.
fn assert_bends(
    closed: &Derivatives,
    noises: &[Noise],
    knobs: &[SourceKnob],
    likelihood: impl Fn(&[Noise]) -> f64,
) {
    let (logs, likelihood) =
        (logs_of(noises, knobs), |logs: &[f64]| likelihood(&with_logs(noises, knobs, logs)));
    let differences = curvature(&logs, STEP, |logs| -likelihood(logs));
    assert!((&closed.curvature - &differences).amax() < 1e-3 * differences.amax(), "{differences}");
    for (axis, slope) in closed.slopes.iter().enumerate() {
        let moved = |by: f64| {
            let mut moved = logs.clone();
            moved[axis] += by;
            likelihood(&moved)
        };
        let difference = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
        assert!((slope - difference).abs() < 1e-3 * closed.slopes.amax(), "{axis}: {slope} {difference}");
    }
}

/// All parameters of the noises of two sensors.
fn knobs_of_two() -> Vec<SourceKnob> {
    let own = [Knob::White, Knob::MarkovSigma(0), Knob::MarkovTau(0)];
    [0, 3].into_iter().flat_map(|source| own.map(|knob| (source, knob))).collect()
}

#[test]
fn whittles_likelihood_bends_as_differences_say() {
    let model = Model::new(&gyros(8, 3000, 0.0), &[]).unwrap();
    let (block, noises) = (&model.blocks[0], model.nominal_noises());
    let filter = block.filter(&noises).unwrap();
    let whitened = filter.whiten(&[&block.data]).swap_remove(0);
    let spectrum = Spectrum::new(block, &filter, &noises, &whitened);
    let knobs = knobs_of_two();
    let closed = spectrum.derivatives(block, &noises, &knobs, STEP).unwrap();
    assert_bends(&closed, &noises, &knobs, |noises| spectrum.log_likelihood(block, noises));
}

/// Of sensors that span the space, and of two that are alike.
#[test]
fn what_readings_tell_beside_residuals_bends_as_differences_say() {
    for number in [6, 2] {
        let mut recording = gyros(6, 3000, 0.0);
        recording.sensors.truncate(number);
        if number == 2 {
            recording.sensors[1].sensor.axis = recording.sensors[0].sensor.axis;
        }
        let model = Model::new(&recording, &[]).unwrap();
        let [common] = &CommonMotion::of_model(&model, &recording, &[])[..] else {
            panic!("{number}: one block")
        };
        let mut noises = model.nominal_noises();
        noises[0].white *= 1.5;
        let knobs: Vec<SourceKnob> =
            knobs_of_two().into_iter().map(|(source, knob)| (source % number, knob)).collect();
        let closed = common.derivatives(&noises, &knobs, STEP).unwrap();
        assert_bends(&closed, &noises, &knobs, |noises| common.beside_residual(noises));
    }
}

/// Counts what it is told, and ends the explanation in a phase.
struct Counter {
    told: AtomicUsize,
    until: Option<Phase>,
    ended: AtomicBool,
}

impl Watch for Counter {
    fn is_cancelled(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    fn progress(&self, phase: Phase, part: f64) {
        assert!((0.0..=1.0).contains(&part), "{phase}: {part}");
        self.told.fetch_add(1, Ordering::Relaxed);
        if self.until == Some(phase) {
            self.ended.store(true, Ordering::Relaxed);
        }
    }
}

fn counter(until: Option<Phase>) -> Counter {
    Counter { told: AtomicUsize::new(0), until, ended: AtomicBool::new(false) }
}

#[test]
fn fourteen_gyros_are_checked_together_and_the_one_that_drifts_is_named() {
    let recording = gyros(14, 1200, 8.0 * WHITE);
    let watch = counter(None);
    let (explanation, _) = explain_watched(&recording, &Options::default(), &watch).unwrap();
    let first = explanation.findings.first().expect("a strong drift");
    assert_eq!(first.sensor, "gyro_4", "{}", first.sentence);
    assert!(first.class.iter().any(|effect| effect == "bias_drift_linear"), "{:?}", first.class);
    assert_eq!(explanation.findings.len(), 1);
    assert!(watch.told.load(Ordering::Relaxed) >= 5);
}

#[test]
fn who_watches_can_end_it_in_every_phase() {
    let recording = gyros(5, 600, 8.0 * WHITE);
    let before = AtomicBool::new(true);
    let cancelled = |watch: &dyn Watch| explain_watched(&recording, &Options::default(), watch).map(|_| ());
    assert_eq!(cancelled(&before), Err(Error::Cancelled));
    for phase in [Phase::Prepare, Phase::Search, Phase::Refine, Phase::Judge] {
        let watch = counter(Some(phase));
        assert_eq!(cancelled(&watch), Err(Error::Cancelled), "{phase}");
    }
    let after = AtomicBool::new(false);
    assert_eq!(cancelled(&after), Ok(()));
}
