//! Dependences on recorded quantities.
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding, Verdict};
use schuler_recording::case::{Quantity, TemperatureBias};

use crate::limits::beside_rate;
use crate::synthetic::{ROWS, markov, noise, record, recording, with};

/// A product of two recorded quantities, and a broad resonance on one, are in no catalogue and go as slow noise does: the answer says what they depend
/// on. Slow noise beside the same quantities stays noise.
#[test]
fn what_depends_on_quantities_in_its_own_way_is_no_noise() {
    const TRIALS: u64 = 12;
    let answered = |seed: u64, more: &dyn Fn(&[f64; 2], f64) -> f64| {
        let mut random = Pcg64::seed_from_u64(150_000 + seed);
        let slow = markov(&mut random, ROWS, 0.8, 40.0);
        let phases: [f64; 6] = std::array::from_fn(|_| StandardUniform.sample(&mut random));
        let quantities: Vec<[f64; 2]> = (0..ROWS)
            .map(|row| {
                let turns = row as f64 / ROWS as f64;
                let of = |place: usize, number: f64| {
                    (std::f64::consts::TAU * (number * turns + phases[place])).sin() / number.sqrt()
                };
                [of(0, 1.3) + of(1, 3.7) + of(2, 8.1), of(3, 0.9) + of(4, 4.6) + of(5, 10.3)]
            })
            .collect();
        let values = noise(151_000 + seed, ROWS).into_iter().zip(&quantities).zip(slow);
        let mut recording =
            recording(vec![values.map(|((value, of), slow)| value + more(of, slow)).collect()]);
        for (place, column) in ["load", "humidity"].into_iter().enumerate() {
            let values = quantities.iter().map(|of| 50.0 + 10.0 * of[place]).collect();
            record(&mut recording, column, Quantity::Other, "%", values);
        }
        explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap()
    };
    let is_unexplained = |answer: Explanation, on: &str| {
        let said = answer.remainder.and_then(|remainder| remainder.on);
        let right = answer.verdict != Verdict::Explained && said.as_deref() == Some(on);
        if !right {
            println!("{on}: {said:?} {:?}", answer.findings.iter().map(|it| &it.effect).collect::<Vec<_>>());
        }
        right
    };
    let product = |&seed: &u64| is_unexplained(answered(seed, &|[a, b], _| 3.0 * a * b), "load and humidity");
    let resonance = |&seed: &u64| {
        let resonance = |[a, _]: &[f64; 2], _| 10.0 / (1.0 + ((a - 0.3) / 0.5).powi(2));
        is_unexplained(answered(100 + seed, &resonance), "load")
    };
    let noise = |&seed: &u64| answered(200 + seed, &|_, slow| slow).verdict == Verdict::Explained;
    let count = |told: &(dyn Fn(&u64) -> bool + Sync)| (0..TRIALS).into_par_iter().filter(told).count();
    let told = [count(&product), count(&resonance), count(&noise)];
    println!("told of {TRIALS} products, resonances and noises: {told:?}");
    assert!(told.iter().all(|told| told + 1 >= TRIALS as usize));
}

/// What a meter's noise adds to a quantity is no part of what acts: neither the coefficient nor the gain is less for it. Where the quantity itself
/// flickers, that acts as well.
#[test]
fn the_noise_of_a_meter_attenuates_no_coefficient() {
    const TRIALS: u64 = 24;
    const COEFFICIENT: f64 = 6.0;
    // Volts per row of a supply that wanders, and of what its meter or itself adds.
    let deviation = |flickers: bool, seed: u64| -> Option<f64> {
        let mut random = Pcg64::seed_from_u64(160_000 + seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let phases: [f64; 4] = std::array::from_fn(|_| normal());
        let (mut read, mut acts) = (Vec::new(), Vec::new());
        for row in 0..ROWS {
            let turns = std::f64::consts::TAU * row as f64 / ROWS as f64;
            let parts = [1.7, 3.9, 6.1, 11.3].iter().zip(phases);
            let wander: f64 =
                parts.map(|(number, phase)| (number * turns + phase).sin() / number.sqrt()).sum();
            let noise = 0.1 * normal();
            read.push((1e3 * (27.0 + wander + noise)).round() / 1e3);
            acts.push(if flickers { wander + noise } else { wander });
        }
        let values = noise(161_000 + seed, ROWS).into_iter().zip(acts);
        let mut recording = recording(vec![values.map(|(value, acts)| value + COEFFICIENT * acts).collect()]);
        record(&mut recording, "supply", Quantity::Voltage, "V", read);
        let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
        let is_it = |finding: &&Finding| finding.effect == "bias_supply_voltage";
        let found = answer.findings.iter().find(is_it)?;
        let coefficient = found.parameters.iter().find(|parameter| parameter.name == "coefficient")?;
        Some((coefficient.value? - COEFFICIENT) / coefficient.sigma?)
    };
    for flickers in [false, true] {
        let deviations: Vec<Option<f64>> =
            (0..TRIALS).into_par_iter().map(|seed| deviation(flickers, seed)).collect();
        let found: Vec<f64> = deviations.into_iter().flatten().collect();
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        println!(
            "flickers {flickers}: found {} of {TRIALS}, mean deviation {mean:.2} σ: {found:.1?}",
            found.len()
        );
        assert!(found.len() == TRIALS as usize && found.iter().all(|deviation| deviation.abs() < 4.0));
        assert!(mean.abs() < 3.0 / (TRIALS as f64).sqrt());
    }
}

/// A dependence counted from a stated reference, beside which the mean is nominal all the same: neither the dependence shows alone nor a
/// constant, and slow noise holds both.
#[test]
fn a_dependence_whose_mean_is_nominal_is_no_slow_noise() {
    let length = ROWS as f64;
    let of =
        |turns: f64, time: f64| (turns * std::f64::consts::TAU * time / length + turns).sin() / turns.sqrt();
    let wander = |time: f64| [7.0, 11.3, 18.1, 29.9].map(|turns| of(turns, time)).iter().sum::<f64>();
    let mean = (0..ROWS).map(|row| wander(row as f64)).sum::<f64>() / length;
    let error = |time: f64| 4.0 * (wander(time) - mean);
    let mut recording = recording(vec![with(noise(8970, ROWS), error)]);
    recording.sensors[0].sensor.nominal.temperature_bias =
        Some(TemperatureBias { column: "t".to_owned(), reference_deg_c: 20.0, coefficients: vec![0.0] });
    let values = (0..ROWS).map(|row| 28.0 + wander(row as f64)).collect();
    record(&mut recording, "t", Quantity::Temperature, "degC", values);
    let answer = explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap();
    let mut found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
    found.sort_unstable();
    // Hysteresis of next to nothing is the same function with an effect less.
    let is_right = found == ["bias_constant", "bias_temperature"] || found == ["bias_thermal_hysteresis"];
    assert!(is_right, "{:?}", answer.findings);
}

/// What is found in a gyro that is turned nearly steadily and has a constant and a warm-up.
fn turned_steadily(seed: u64, constant: f64, warm_up: f64) -> Explanation {
    let white = 3e-6;
    let rates: Vec<f64> = (0..ROWS).map(|row| 0.01 + 1e-4 * (0.05 * row as f64).sin()).collect();
    let mut random = Pcg64::seed_from_u64(seed);
    let mut reading = |(row, rate): (usize, &f64)| {
        let noise: f64 = StandardNormal.sample(&mut random);
        rate + white * noise + constant + warm_up * (-(row as f64) / 150.0).exp()
    };
    let values = rates.iter().enumerate().map(&mut reading).collect();
    let recording = beside_rate(rates.clone(), white, values);
    explain(&recording, &Config { hold_out: false, ..Config::default() }).unwrap()
}

/// A constant and a warm-up of a gyro that is turned nearly steadily: the heat of a steady turn from a start that nobody knows is a constant and
/// a decay as well, and says nothing of the turn.
#[test]
fn a_constant_and_a_warm_up_may_be_the_heat_of_a_steady_turn() {
    for trial in 0..4_u64 {
        let answer = turned_steadily(8990 + trial, 6e-7, -3e-6);
        let mut found: Vec<&str> = answer.findings.iter().map(|finding| finding.effect.as_str()).collect();
        found.sort_unstable();
        let is_right = found == ["bias_constant", "bias_warmup"] || found == ["torquer_self_heating"];
        assert!(is_right, "{trial}: {:?}", answer.findings);
    }
}

/// That needs evidence of its own to lead. Where it looks the same it is said to.
#[test]
fn a_constant_of_a_steady_turn_may_be_its_heat() {
    for trial in 0..4_u64 {
        let answer = turned_steadily(8995 + trial, 6e-7, 0.0);
        let [constant] = &answer.findings[..] else { panic!("{trial}: {:?}", answer.findings) };
        let may_be = constant.may_be("torquer_self_heating");
        assert!(constant.effect == "bias_constant" && may_be, "{trial}: {constant:?}");
    }
}
