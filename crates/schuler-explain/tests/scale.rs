//! Many sensors, and somebody who watches.
use std::sync::atomic::AtomicBool;
use std::sync::atomic::{AtomicUsize, Ordering};

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::config::Config;
use schuler_explain::explain::{Error, explain_watched};
use schuler_explain::watch::{Phase, Watch};
use schuler_recording::Recording;
use schuler_recording::case::{Markov, MotionKind, Nominal, SensorKind};
use schuler_recording::recording::SensorSeries;
use schuler_recording::unit::Unit;

mod common;

const WHITE: f64 = 1e-6;

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
            let (kind, unit) = (SensorKind::Fog, Unit::RadianPerSecond);
            common::series(&format!("gyro_{index}"), kind, unit, axis, nominal, values)
        })
        .collect();
    common::recording(MotionKind::Unknown, sensors)
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
    let (explanation, _) = explain_watched(&recording, &Config::default(), &watch).unwrap();
    let first = explanation.findings.first().expect("a strong drift");
    assert_eq!(first.sensor, "gyro_4", "{}", first.sentence);
    assert!(first.may_be("bias_drift_linear"), "{:?}", first.class);
    assert_eq!(explanation.findings.len(), 1);
    assert!(watch.told.load(Ordering::Relaxed) >= 5);
}

#[test]
fn who_watches_can_end_it_in_every_phase() {
    let recording = gyros(5, 600, 8.0 * WHITE);
    let before = AtomicBool::new(true);
    let cancelled = |watch: &dyn Watch| explain_watched(&recording, &Config::default(), watch).map(|_| ());
    assert_eq!(cancelled(&before), Err(Error::Cancelled));
    for phase in [Phase::Prepare, Phase::Search, Phase::Refine, Phase::Judge] {
        let watch = counter(Some(phase));
        assert_eq!(cancelled(&watch), Err(Error::Cancelled), "{phase}");
    }
    let after = AtomicBool::new(false);
    assert_eq!(cancelled(&after), Ok(()));
}
