//! Synthetic records, and a catalogue of the simplest effects.
use crate::common;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::catalogue::{
    Amplitude, Candidate, Column, Effect, Form, InFlight, NoiseChange, Nonlinear, OnsetShape, Port,
    ReadingFault, Search, Signature, Target,
};
use schuler_explain::config::Config;
use schuler_explain::explain::{Error, explain_with};
use schuler_explain::explanation::Explanation;
use schuler_explain::inputs::Inputs;
use schuler_recording::Recording;
use schuler_recording::case::{Auxiliary, Markov, MotionKind, Nominal, Quantity, SensorKind};
use schuler_recording::recording::{AuxiliarySeries, Quality};
use schuler_recording::unit::Unit;

macro_rules! effect {
    ($name:ident, $id:literal) => {
        pub static $name: Effect = Effect {
            id: $id,
            formula: "",
            sentence: "{sensor} is wrong",
            needs: "",
            separated_by: "another record",
            source: "",
            in_flight: InFlight::Never("it is not"),
            form: Form::Values,
            acts_on: |_| true,
            candidates: |_, _| Vec::new(),
        };
    };
}

effect!(TREND, "trend");
effect!(CONSTANT, "constant");
effect!(WARM, "warm");
effect!(WAVE, "wave");
effect!(WAVE_RATE, "wave_rate");
effect!(LAGGED, "lagged");
effect!(DELAY, "delay");
effect!(STEP, "step");
effect!(RAMP, "ramp");
effect!(LINE, "line");
effect!(WHITE, "white");
effect!(MARKOV, "markov");
effect!(COSINE, "cosine");
effect!(WALK, "walk");
effect!(VARIANCE, "variance");
effect!(FLICKER, "flicker");
effect!(ANGLE, "angle");
effect!(JUMPS, "jumps");

pub const WHITE_SIGMA: f64 = 0.5;
pub const MARKOV_SIGMA: f64 = 1.0;
pub const TAU_S: f64 = 40.0;

/// A slow wave that never repeats within a record.
pub fn wave(time: f64, length: f64) -> f64 {
    (7.0 * time / length).sin() + 0.5 * (17.0 * time / length + 1.0).cos()
}

pub fn wave_rate(time: f64, length: f64) -> f64 {
    7.0 * (7.0 * time / length).cos() - 8.5 * (17.0 * time / length + 1.0).sin()
}

pub fn low_pass(values: &[f64], tau: f64) -> Vec<f64> {
    let mut state = values.first().copied().unwrap_or_default();
    values
        .iter()
        .map(|value| {
            state += (value - state) / tau.max(1.0);
            state
        })
        .collect()
}

pub fn amplitude() -> Amplitude {
    Amplitude { name: "coefficient".to_owned(), unit: "m/s".to_owned(), in_unit: 1.0, plausible: None }
}

pub fn candidate(effect: &'static Effect, sensor: usize, search: Search) -> Candidate {
    let amplitudes = match search {
        Search::Frequency => vec![amplitude(), amplitude()],
        Search::Readings(ReadingFault::IntermittentJump) => vec![amplitude()],
        Search::Noise(_) | Search::Readings(_) => Vec::new(),
        _ => vec![amplitude()],
    };
    Candidate {
        effect,
        target: Target::Sensor(sensor),
        port: Port::Output,
        variant: Vec::new(),
        search,
        amplitudes,
        noise_factor: 1.0,
    }
}

pub fn signature(sensor: usize, values: Vec<f64>) -> Signature {
    Signature { columns: vec![Column::on(sensor, values)] }
}

/// Every kind of candidate on every sensor.
pub fn candidates(rows: usize, sensors: usize) -> Vec<Candidate> {
    let times: Vec<f64> = (0..rows).map(|row| row as f64).collect();
    let length = rows as f64;
    let waved: Vec<f64> = times.iter().map(|&time| wave(time, length)).collect();
    (0..sensors)
        .flat_map(|sensor| {
            let linear =
                |effect, values| candidate(effect, sensor, Search::Linear(signature(sensor, values)));
            let noise = |effect, change| candidate(effect, sensor, Search::Noise(change));
            let fault = |effect, fault| candidate(effect, sensor, Search::Readings(fault));
            let lagged = waved.clone();
            let lag = Search::Grid {
                parameters: vec![Nonlinear {
                    name: "tau_s",
                    unit: "s",
                    grid: vec![20.0, 50.0, 120.0, 300.0, 800.0],
                }],
                signature: Box::new(move |point| signature(sensor, low_pass(&lagged, point[0]))),
                unit_amplitude: false,
            };
            vec![
                linear(&TREND, times.iter().map(|time| time / length).collect()),
                linear(&WAVE, waved.clone()),
                linear(&WAVE_RATE, times.iter().map(|&time| wave_rate(time, length)).collect()),
                candidate(&LAGGED, sensor, lag),
                candidate(&STEP, sensor, Search::Onset(OnsetShape::Step)),
                candidate(&RAMP, sensor, Search::Onset(OnsetShape::Ramp)),
                candidate(&LINE, sensor, Search::Frequency),
                noise(&WHITE, NoiseChange::White),
                noise(&MARKOV, NoiseChange::Markov),
                noise(&COSINE, NoiseChange::ExponentialCosine),
                noise(&WALK, NoiseChange::RandomWalk),
                noise(&VARIANCE, NoiseChange::VarianceStep),
                fault(&JUMPS, ReadingFault::IntermittentJump),
            ]
        })
        .collect()
}

pub fn markov(random: &mut Pcg64, rows: usize, sigma: f64, tau: f64) -> Vec<f64> {
    let phi = (-1.0 / tau).exp();
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let mut state = sigma * normal();
    (0..rows)
        .map(|_| {
            let now = state;
            state = phi * state + sigma * (1.0 - phi * phi).sqrt() * normal();
            now
        })
        .collect()
}

/// Coloured noise as the nominal model says.
pub fn noise(seed: u64, rows: usize) -> Vec<f64> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut values = markov(&mut random, rows, MARKOV_SIGMA, TAU_S);
    for value in &mut values {
        let white: f64 = StandardNormal.sample(&mut random);
        *value += WHITE_SIGMA * white;
    }
    values
}

pub fn recording(series: Vec<Vec<f64>>) -> Recording {
    let nominal = Nominal {
        white: WHITE_SIGMA,
        markov: Some(Markov { sigma: MARKOV_SIGMA, tau_s: TAU_S }),
        ..Nominal::default()
    };
    let (kind, unit) = (SensorKind::Doppler, Unit::MetrePerSecond);
    let sensors = series.into_iter().enumerate().map(|(index, values)| {
        common::series(&format!("sensor_{index}"), kind, unit, [1.0, 0.0, 0.0], nominal.clone(), values)
    });
    common::recording(MotionKind::Static, sensors.collect())
}

/// Five sensors on a cone in an unknown motion.
pub fn block_of_five(series: Vec<Vec<f64>>) -> Recording {
    let mut block = recording(series);
    block.case.motion.kind = MotionKind::Unknown;
    for (place, series) in block.sensors.iter_mut().enumerate() {
        let (sin, cos) = (1.2 * place as f64).sin_cos();
        series.sensor.axis = Some([0.6 * cos, 0.6 * sin, 0.8]);
    }
    block
}

pub fn answer(series: Vec<Vec<f64>>, hold_out: bool) -> Result<Explanation, Error> {
    let recording = recording(series);
    let inputs = Inputs::new(&recording);
    let candidates = candidates(recording.len(), recording.sensors.len());
    explain_with(&inputs, candidates, &Config { hold_out, ..Config::default() })
}

/// Records a quantity beside the sensors.
pub fn record(recording: &mut Recording, column: &str, quantity: Quantity, unit: &str, values: Vec<f64>) {
    let auxiliary = Auxiliary {
        column: column.to_owned(),
        quantity,
        unit: unit.to_owned(),
        scale: None,
        offset: None,
        near: None,
        position_m: None,
    };
    recording.auxiliaries.push(AuxiliarySeries { auxiliary, values, quality: Quality::default() });
}

pub fn with(mut values: Vec<f64>, add: impl Fn(f64) -> f64) -> Vec<f64> {
    values.iter_mut().enumerate().for_each(|(row, value)| *value += add(row as f64));
    values
}

/// Most successes that `trials` with the probability `p` show but once in a thousand.
pub fn most(trials: usize, p: f64) -> usize {
    let mean = trials as f64 * p;
    (mean + 3.1 * (mean * (1.0 - p)).sqrt() + 1.0) as usize
}

pub const ROWS: usize = 2000;
