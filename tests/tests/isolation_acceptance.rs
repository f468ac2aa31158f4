//! Statistical acceptance of the five-gyro isolation: seeded, so that every run gives the same numbers; the
//! tolerances are the acceptance bars, and the number of trials keeps one standard error well inside them.
use crate::isolation_common;

use crate::isolation_common::{
    Rates, TABULATED, argmax, cone, fault, generator, good, noise, noise_of_the_paper, skewed,
};
use nalgebra::{SVector, Vector3};
use rand::RngExt;
use rayon::prelude::*;
use schuler_core::isolation::detector::{Alarm, DetectorConfig, FiveGyroDetector};
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::ParitySpace;
use schuler_core::isolation::remaining::FourGyroDetector;
use schuler_core::isolation::{FaultIsolation, IsolationConfig, IsolationFlags, Verdict};
use statrs::distribution::{ContinuousCDF, Normal};

/// Probability that the GLT names the right gyro of the cone from one sample, by Simpson's rule over the angle
/// between the parity vector and the line of the faulty gyro.
fn isolation_probability(size: f64) -> f64 {
    use std::f64::consts::TAU;
    let normal = Normal::standard();
    let mu = size * 0.4_f64.sqrt();
    let density = |theta: f64| {
        let along = mu * theta.cos();
        let across = mu * theta.sin();
        (-mu * mu / 2.0).exp() / TAU + along * normal.cdf(along) * (-across * across / 2.0).exp() / TAU.sqrt()
    };
    let half = 18_f64.to_radians();
    let panels = 200;
    let step = 2.0 * half / f64::from(panels);
    [0.0, std::f64::consts::PI]
        .into_iter()
        .flat_map(|centre| (0..=panels).map(move |i| (centre, i)))
        .map(|(centre, i)| {
            let weight = if i == 0 || i == panels { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
            weight * density(centre - half + f64::from(i) * step) * step / 3.0
        })
        .sum()
}

/// Share of trials for which `trial` holds.
fn share(trials: u64, trial: impl Fn(u64) -> bool + Sync) -> f64 {
    (0..trials).into_par_iter().filter(|t| trial(*t)).count() as f64 / trials as f64
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn fdi_4_probability_of_isolation_reaches_the_optimum() {
    let space = cone();
    let determinants = FiveDeterminants::normalised(&space);
    let published = [
        (2.0, 0.3291),
        (3.0, 0.4480),
        (4.0, 0.5666),
        (6.0, 0.7591),
        (8.0, 0.8821),
        (10.0, 0.9493),
        (12.0, 0.9810),
    ];
    for (size, optimum) in published {
        assert!((isolation_probability(size) - optimum).abs() < 6e-5);
        // 1e6 trials: one standard error of the ratio is 0.0015 at most.
        let found = share(1_000_000, |trial| {
            let mut rng = generator(4, trial);
            let faulty = (trial % 5) as usize;
            let mut measured: Rates = noise(&mut rng);
            measured[faulty] += size;
            argmax(determinants.of(&measured).iter().map(|d| -d.abs())) == faulty
        });
        println!("f = {size} σ: P(correct) {found:.4}, optimum {optimum:.4}, ratio {:.4}", found / optimum);
        assert!((found / optimum - 1.0).abs() <= 0.006, "{size}: {found} {optimum}");
    }
}

#[test]
fn fdi_3_determinants_and_glt_decide_alike() {
    let blocks = [cone(), skewed()];
    let determinants = blocks.map(|space| FiveDeterminants::normalised(&space));
    let differing = share(100_000, |trial| {
        let mut rng = generator(3, trial);
        let block = (trial % 2) as usize;
        let space = &blocks[block];
        let mut measured: Rates = noise(&mut rng);
        measured[(trial / 2 % 5) as usize] += rng.random_range(-10.0..10.0);
        measured += space.geometry().matrix() * Vector3::from(noise::<3>(&mut rng) * 100.0);
        argmax(space.likelihood(&space.parity(&measured), 1.0))
            != argmax(determinants[block].of(&measured).iter().map(|d| -d.abs()))
    });
    assert!(differing <= 1e-5, "{differing}");
}

#[test]
fn fdi_3_single_precision_decides_as_double() {
    let axes = IsolationConfig::CONE.axes;
    let double = cone();
    let single = ParitySpace::<f32>::try_build(&axes.map(|a| a.map(|x| x as f32)), &[1.0; 5]).expect("flies");
    let single_determinants = FiveDeterminants::normalised(&single);
    let trials = 200_000;
    for magnitude in [1.0, 1e3] {
        let differing = share(trials, |trial| {
            let mut rng = generator(33, trial);
            let mut measured: Rates = noise(&mut rng);
            measured[(trial % 5) as usize] += 6.0;
            measured += double.geometry().matrix() * noise::<3>(&mut rng).normalize() * magnitude;
            let narrow: SVector<f32, 5> = measured.map(|x| x as f32);
            argmax(double.likelihood(&double.parity(&measured), 1.0))
                != argmax(single_determinants.of(&narrow).iter().map(|d| -d.abs()))
        });
        println!("rate {magnitude} σ: f32 decides otherwise in {differing:e}");
        assert!(differing <= 1e-4, "{magnitude}: {differing}");
    }
}

#[test]
fn fdi_4_false_alarms_and_detections_of_one_sample() {
    let space = cone();
    let statistic = |trial: u64, seed: u64, size: f64| {
        let mut rng = generator(seed, trial);
        let mut measured: Rates = noise(&mut rng);
        measured[(trial % 5) as usize] += size;
        measured += space.geometry().matrix() * Vector3::new(10.0, -20.0, 30.0);
        space.parity(&measured).norm_squared()
    };
    // 2e6 trials at 1e-3: one standard error is 2.2 % of the rate.
    let false_alarms = share(2_000_000, |trial| statistic(trial, 40, 0.0) > 13.816) / 1e-3;
    println!("false alarms over nominal at 1e-3: {false_alarms:.3}");
    assert!((0.9..=1.1).contains(&false_alarms), "{false_alarms}");

    for (threshold, table) in [
        (13.816, [0.153, 0.584, 0.928, 0.997, 1.0]),
        (23.026, [0.017, 0.188, 0.642, 0.947, 0.998]),
        (32.236, [0.001, 0.038, 0.300, 0.768, 0.977]),
    ] {
        for (size, expected) in [4.0, 6.0, 8.0, 10.0, 12.0].into_iter().zip(table) {
            // 1e5 trials: one standard error is 0.0016 at most; the table is rounded to 0.0005.
            let found = share(100_000, |trial| statistic(trial, 41, size) > threshold);
            assert!((found - expected).abs() < 0.0055, "c {threshold} f {size}: {found} {expected}");
        }
    }
}

/// Mean run length to a false alarm over the configured one.
fn run_length_ratio(runs: u64, configured: f64, one_run: impl Fn(u64) -> u64 + Sync) -> f64 {
    let lengths: Vec<f64> = (0..runs).into_par_iter().map(|run| one_run(run) as f64).collect();
    mean(&lengths) / configured
}

#[test]
fn fdi_6_time_between_false_alarms_of_five_gyros() {
    for (name, space, persistence, interval, runs) in [
        ("cone", cone(), 1, 1e5, 600),
        ("cone", cone(), 3, 1e5, 600),
        ("cone", cone(), 1, 1e4, 3000),
        ("asymmetric", skewed(), 1, 1e5, 600),
    ] {
        let config = DetectorConfig { false_alarm_interval: interval, persistence, ..TABULATED };
        // Run lengths are close to exponential: one standard error is 1/√runs, 4 % for 600.
        let ratio = run_length_ratio(runs, interval, |run| {
            let mut rng = generator(60 + u64::from(persistence), run);
            let mut detector = FiveGyroDetector::new(&config);
            (1..u64::MAX).find(|_| detector.step(&space, &noise(&mut rng), true, true).raised).expect("ends")
        });
        println!("{name}, persistence {persistence}, {interval:e} samples: ratio {ratio:.3}");
        assert!((0.85..=1.15).contains(&ratio), "{name} {persistence} {interval}: {ratio}");
    }
}

#[test]
fn fdi_9_time_between_false_alarms_of_four_gyros() {
    for (persistence, interval, runs) in [(1, 1e5, 1000), (3, 1e5, 1000), (1, 1e4, 3000)] {
        let config = DetectorConfig { false_alarm_interval: interval, persistence, ..TABULATED };
        let ratio = run_length_ratio(runs, interval, |run| {
            let mut rng = generator(90 + u64::from(persistence), run);
            let mut detector = FourGyroDetector::new(&config);
            (1..u64::MAX).find(|_| detector.step(noise::<1>(&mut rng)[0], true, true).raised).expect("ends")
        });
        println!("four gyros, persistence {persistence}, {interval:e} samples: ratio {ratio:.3}");
        assert!((0.85..=1.15).contains(&ratio), "{persistence} {interval}: {ratio}");
    }
}

#[test]
fn fdi_6_time_between_false_alarms_of_the_whole_step() {
    let mut config = IsolationConfig::CONE;
    config.sigma = [1e-7, 1.5e-7, 0.8e-7, 1.2e-7, 1e-7];
    let ratio = run_length_ratio(600, config.false_alarm_interval, |run| {
        let mut rng = generator(65, run);
        let mut block = FaultIsolation::try_build(&config).expect("can be flown");
        let rate = axes() * Vector3::new(2e-5, -1e-5, 3e-5);
        (1..u64::MAX)
            .find(|_| {
                let measured = rate + noise::<5>(&mut rng).component_mul(&Rates::from(config.sigma));
                block.step(&good(&measured), None).flags.contains(IsolationFlags::ALARM_RAISED)
            })
            .expect("ends")
    });
    println!("whole step, unequal gyros: ratio {ratio:.3}");
    assert!((0.85..=1.15).contains(&ratio), "{ratio}");
}

fn axes() -> nalgebra::Matrix5x3<f64> {
    isolation_common::axes_of_the_paper()
}

/// How a fault grows: f = step + ramp · samples, in σ.
struct Growth {
    name: &'static str,
    step: f64,
    ramp: f64,
    /// Mean samples from onset to alarm, and to isolation with the margin 9.2.
    detection: f64,
    isolation: f64,
}

const GROWTHS: [Growth; 9] = [
    Growth { name: "step 0.5", step: 0.5, ramp: 0.0, detection: 216.0, isolation: 359.0 },
    Growth { name: "step 1", step: 1.0, ramp: 0.0, detection: 67.0, isolation: 95.0 },
    Growth { name: "step 2", step: 2.0, ramp: 0.0, detection: 16.7, isolation: 25.0 },
    Growth { name: "step 4", step: 4.0, ramp: 0.0, detection: 6.6, isolation: 8.1 },
    Growth { name: "step 8", step: 8.0, ramp: 0.0, detection: 1.7, isolation: 2.6 },
    Growth { name: "ramp 0.0005", step: 0.0, ramp: 0.0005, detection: 783.0, isolation: 1023.0 },
    Growth { name: "ramp 0.002", step: 0.0, ramp: 0.002, detection: 334.0, isolation: 414.0 },
    Growth { name: "ramp 0.01", step: 0.0, ramp: 0.01, detection: 125.0, isolation: 143.0 },
    Growth { name: "ramp 0.05", step: 0.0, ramp: 0.05, detection: 42.0, isolation: 50.0 },
];

/// A detector that has been watching a healthy block for a while, without an alarm standing.
fn settled(
    space: &ParitySpace<f64>,
    config: &DetectorConfig<f64>,
    rng: &mut rand_pcg::Pcg64,
) -> FiveGyroDetector<f64> {
    loop {
        let mut detector = FiveGyroDetector::new(config);
        if (0..1000).all(|_| detector.step(space, &noise(rng), true, true).alarm == Alarm::Quiet) {
            return detector;
        }
    }
}

#[test]
fn fdi_6_delays_of_detection_and_isolation() {
    let space = cone();
    for persistence in [1, 3] {
        let config = DetectorConfig { persistence, ..TABULATED };
        for growth in &GROWTHS {
            // 4000 runs: one standard error of a mean delay is about 1.5 %, of the probability 0.003.
            let runs: Vec<(f64, f64, bool)> = (0..4000)
                .into_par_iter()
                .map(|run| {
                    let mut rng = generator(66, run);
                    let mut detector = settled(&space, &config, &mut rng);
                    let faulty = (run % 5) as usize;
                    let mut detected = None;
                    for sample in 1..20_000 {
                        let size = growth.step + growth.ramp * f64::from(sample);
                        let parity = noise::<2>(&mut rng) + fault(&space, faulty, size);
                        let detection = detector.step(&space, &parity, true, true);
                        if detection.raised && detected.is_none() {
                            detected = Some(sample);
                        }
                        if let Some(found) = detection.isolated {
                            return (
                                detected.map_or(f64::NAN, f64::from),
                                f64::from(sample),
                                found == faulty,
                            );
                        }
                    }
                    panic!("never isolated");
                })
                .collect();
            let detection = mean(&runs.iter().map(|r| r.0).collect::<Vec<_>>());
            let isolation = mean(&runs.iter().map(|r| r.1).collect::<Vec<_>>());
            let correct = runs.iter().filter(|r| r.2).count() as f64 / runs.len() as f64;
            println!(
                "persistence {persistence}, {:12} detection {detection:7.2} ({:.3}) isolation {isolation:7.2} ({:.3}) correct {correct:.4}",
                growth.name,
                detection / growth.detection,
                isolation / growth.isolation
            );
            assert!(correct >= 0.955, "{}: {correct}", growth.name);
            // A fault of many σ waits for the persistence and no longer: the table has persistence one.
            if persistence == 1 || growth.step < 8.0 {
                assert!((detection / growth.detection - 1.0).abs() <= 0.1, "{}: {detection}", growth.name);
                assert!((isolation / growth.isolation - 1.0).abs() <= 0.1, "{}: {isolation}", growth.name);
            } else {
                assert!(detection <= 3.5 && isolation <= 4.0);
            }
        }
    }
}

#[test]
fn fdi_6_cost_of_false_alarms_and_of_wrong_names() {
    // A healthy block: how long an alarm that should not be keeps the verdict from being "no fault".
    let samples = 500_000;
    let unavailable: f64 = (0..40)
        .into_par_iter()
        .map(|run| {
            let mut rng = generator(67, run);
            let mut block = FaultIsolation::try_build(&IsolationConfig::CONE).expect("can be flown");
            let doubted = (0..samples)
                .filter(|_| block.step(&good(&(noise(&mut rng) * 1e-7)), None).verdict != Verdict::NoFault)
                .count();
            doubted as f64 / f64::from(samples) / 40.0
        })
        .sum();
    println!("healthy block: verdict other than no fault in {:.3} % of the samples", unavailable * 100.0);
    assert!(unavailable < 0.01, "{unavailable}");

    // A faulty one: the first name may be wrong once in thirty times, the last one must not.
    for size in [0.5, 1.0, 4.0] {
        let right = share(1000, |run| {
            let mut rng = generator(68, run);
            let mut block = FaultIsolation::try_build(&IsolationConfig::CONE).expect("can be flown");
            let faulty = (run % 5) as usize;
            for _ in 0..2500 {
                let mut measured: Rates = noise(&mut rng) * 1e-7;
                measured[faulty] += size * 1e-7;
                block.step(&good(&measured), None);
            }
            block.excluded() == 1 << faulty
        });
        println!("fault of {size} σ: the right gyro is excluded in the end in {:.2} %", right * 100.0);
        assert!(right >= 0.995, "{size}: {right}");
    }
}

#[test]
fn fdi_5_margin_trades_delay_for_certainty() {
    // One sample, c = 23.026, f = 8 σ: correct and wrong by margin.
    let space = cone();
    for (margin, correct, wrong) in [(0.0, 0.580, 0.061), (4.6, 0.438, 0.013), (9.2, 0.161, 0.001)] {
        let outcome = |want_correct: bool| {
            share(100_000, |trial| {
                let faulty = (trial % 5) as usize;
                let parity = noise::<2>(&mut generator(55, trial)) + fault(&space, faulty, 8.0);
                let mut q = space.likelihood(&parity, 1.0);
                let found = argmax(q);
                q.sort_by(f64::total_cmp);
                parity.norm_squared() > 23.026 && q[4] - q[3] >= margin && (found == faulty) == want_correct
            })
        };
        assert!((outcome(true) - correct).abs() < 0.006);
        assert!((outcome(false) - wrong).abs() < 0.003);
    }
}

#[test]
fn fdi_5_size_of_the_fault_lies_within_its_standard_deviation() {
    let sigma = 1e-7;
    let trials = 2000;
    let standardised: Vec<f64> = (0..trials)
        .into_par_iter()
        .map(|trial| {
            let mut rng = generator(56, trial);
            let mut block = FaultIsolation::try_build(&IsolationConfig::CONE).expect("can be flown");
            let mut output = block.step(&good(&(noise::<5>(&mut rng) * sigma)), None);
            for _ in 0..300 {
                let mut measured = noise::<5>(&mut rng) * sigma;
                measured[2] -= 5.0 * sigma;
                output = block.step(&good(&measured), None);
            }
            assert_eq!(block.excluded(), 1 << 2);
            (output.fault_size + 5.0 * sigma) / output.fault_sigma
        })
        .collect();
    let bias = mean(&standardised);
    let variance = mean(&standardised.iter().map(|x| x * x).collect::<Vec<_>>());
    println!("fault size: standardised bias {bias:.3}, mean square {variance:.3}");
    // The sample of the alarm was picked for being large, which leaves a trace in 300 samples: no more than a fifth
    // of a standard deviation. Mean square: chi-square, one standard error 0.032.
    assert!(bias.abs() < 0.2 && (0.87..1.15).contains(&variance), "{bias} {variance}");
}

#[test]
fn fdi_9_error_of_the_rate_has_the_stated_covariance() {
    let mut config = IsolationConfig::CONE;
    config.sigma = [1e-7, 2e-7, 1.5e-7, 1e-7, 3e-7];
    let truth = Vector3::new(1e-5, -2e-5, 3e-5);
    for missing in [None, Some(1)] {
        let errors: Vec<f64> = (0..20_000)
            .into_par_iter()
            .map(|trial| {
                let mut rng = generator(91, trial);
                let mut block = FaultIsolation::try_build(&config).expect("can be flown");
                let measured =
                    axes() * truth + noise::<5>(&mut rng).component_mul(&Rates::from(config.sigma));
                let mut readings = good(&measured);
                if let Some(gyro) = missing {
                    readings[gyro] = schuler_core::reading::Reading::missing();
                }
                let output = block.step(&readings, None);
                let error = Vector3::from(output.rate) - truth;
                let information = block.rate_covariance().try_inverse().expect("regular");
                (error.transpose() * information * error)[0]
            })
            .collect();
        // Chi-square with 3 degrees of freedom: one standard error of the mean is 0.017.
        let normalised = mean(&errors);
        println!("normalised squared error of the rate without {missing:?}: {normalised:.3}");
        assert!((normalised - 3.0).abs() < 0.07, "{normalised}");
    }
}

#[test]
fn fdi_11_example_as_a_flight() {
    // The block of the example with a fault of ten σ in each gyro in turn, as the paper has it.
    for faulty in 0..5 {
        let mut config = IsolationConfig::CONE;
        config.sigma = [0.1; 5];
        config.range = 10.0;
        config.relative_error = 0.0;
        config.rate_limit = 10.0;
        config.persistence = 1;
        config.margin = 0.0;
        let mut block = FaultIsolation::try_build(&config).expect("can be flown");
        let mut measured = noise_of_the_paper();
        measured[faulty] += 1.0;
        let output = block.step(&good(&measured), None);
        let estimate = [1.2002, 1.1063, 0.9719, 1.1518, 1.2176][faulty];
        assert_eq!(output.verdict, Verdict::Fault(faulty as u8));
        assert!((output.fault_size - estimate).abs() < 1e-4);
        assert!((output.fault_sigma - 0.1581).abs() < 1e-4);
    }
}
