//! An explanation with its evidence, made from arrays: a day of six gyros of which one drifts with the rate of its
//! temperature and one steps. Noise is first-order Markov and white, whitened with the filter that fits it.
use std::f64::consts::TAU;

use host_sim::report::{Recorded, Report};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use schuler_explain::diagnostics::{CaseArrays, Cause, Part, SensorArrays, evidence};
use schuler_explain::explanation::{
    At, BeforeAfter, Bound, Evidence, Explanation, FORMAT, Finding, Fit, Goodness, Impact, Located, Member,
    NoiseNumbers, NoiseOfSensor, Parameter, Remainder, Verdict,
};
use schuler_recording::unit::Unit;

/// Rows of the day, one a second.
pub const ROWS: usize = 86_400;
/// When the second gyro steps, s.
const ONSET_S: f64 = 30_000.0;

/// First-order Markov noise of a standard deviation and a correlation time in steps, seen through white noise.
#[derive(Clone, Copy)]
struct Noise {
    sigma: f64,
    tau: f64,
    white: f64,
}

const TRUE: Noise = Noise { sigma: 1.0, tau: 300.0, white: 0.6 };
/// What the fit makes of it while an effect is unexplained.
const SWOLLEN: Noise = Noise { sigma: 1.39, tau: 221.0, white: 0.6 };

impl Noise {
    fn sample(self, rows: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
        let transition = f64::exp(-1.0 / self.tau);
        let mut state = self.sigma * draw();
        (0..rows)
            .map(|_| {
                state = transition * state + self.sigma * (1.0 - transition * transition).sqrt() * draw();
                state + self.white * draw()
            })
            .collect()
    }

    /// Standardised innovations of the Kalman filter for this noise.
    fn whiten(self, values: &[f64]) -> Vec<f64> {
        let transition = f64::exp(-1.0 / self.tau);
        let drive = self.sigma.powi(2) * (1.0 - transition * transition);
        let (mut state, mut variance) = (0.0, self.sigma.powi(2));
        values
            .iter()
            .map(|value| {
                let expected = variance + self.white.powi(2);
                let innovation = value - state;
                if value.is_finite() {
                    let gain = variance / expected;
                    state += gain * innovation;
                    variance *= 1.0 - gain;
                }
                state *= transition;
                variance = transition * transition * variance + drive;
                innovation / expected.sqrt()
            })
            .collect()
    }
}

fn parameter(name: &str, value: f64, sigma: f64, unit: &str, plausible: Option<bool>) -> Parameter {
    let (value, sigma, unit) = (Some(value), Some(sigma), Some(unit.to_owned()));
    Parameter { name: name.into(), value, sigma, unit, plausible, ..Parameter::default() }
}

/// The report of the day; the gyros' names begin with `prefix`, and so does its title.
pub fn report(prefix: &str) -> Report {
    let degree_per_hour = Unit::DegreePerHour.in_si();
    let time_s: Vec<f64> = (0..ROWS).map(|k| k as f64).collect();
    let hour = |t: f64| TAU * t / 86_400.0;
    let temperature_rate: Vec<f64> =
        time_s.iter().map(|t| 3.0 * hour(*t).cos() + 1.5 * (3.0 * hour(*t)).sin()).collect();
    let names: Vec<String> =
        ["gyro_x", "gyro_y", "gyro_z", "gyro_a", "gyro_b", "gyro_c"].map(|id| format!("{prefix}{id}")).into();

    let sensors = names.iter().enumerate().map(|(index, name)| {
        let mut values = TRUE.sample(ROWS, 7 + index as u64);
        let part: Option<(Vec<f64>, Option<Cause>)> = match index {
            0 => {
                let cause =
                    Cause { name: "Ṫ".into(), unit: "K/h".into(), values: temperature_rate.clone() };
                Some((temperature_rate.iter().map(|rate| 0.5 * rate).collect(), Some(cause)))
            }
            1 => {
                let step = time_s.iter().map(|t| if *t >= ONSET_S { 1.6 } else { 0.0 }).collect();
                let cause = Cause { name: "time".into(), unit: "s".into(), values: time_s.clone() };
                Some((step, Some(cause)))
            }
            _ => None,
        };
        let remainder = values.clone();
        if let Some((part, _)) = &part {
            for (value, effect) in values.iter_mut().zip(part) {
                *value += effect;
            }
        }
        // An hour was not recorded.
        let gap = |values: &mut [f64]| values[50_000..53_600].fill(f64::NAN);
        let mut whitened_remainder = remainder;
        gap(&mut values);
        gap(&mut whitened_remainder);
        let before = if part.is_some() { SWOLLEN } else { TRUE };
        let scaled = |values: &[f64]| -> Vec<f64> { values.iter().map(|v| v * degree_per_hour).collect() };
        SensorArrays {
            sensor: name.clone(),
            unit: Unit::DegreePerHour,
            residual: scaled(&values),
            innovation_before: before.whiten(&values),
            innovation_after: TRUE.whiten(&whitened_remainder),
            parts: part
                .map(|(part, cause)| Part { finding: index, values: scaled(&part), cause })
                .into_iter()
                .collect(),
        }
    });
    let arrays = CaseArrays {
        step_s: 1.0,
        held_out_s: vec![[17_000.0, 21_000.0], [70_000.0, 78_000.0]],
        sensors: sensors.collect(),
        time_s,
        ..CaseArrays::default()
    };
    Report {
        title: format!("{prefix}Six gyros on the bench over a day, run 17"),
        recorded: Recorded {
            case: "bench/run17.toml".into(),
            rows: ROWS,
            rows_in_gaps: 3600,
            step_s: 1.0,
            length_s: ROWS as f64,
            sensors: names.clone(),
        },
        explanation: explanation(prefix, &names),
        evidence: evidence(arrays),
    }
}

/// The report of a day on which there was nothing to find.
pub fn nothing_found() -> Report {
    let mut report = report("");
    report.explanation = Explanation {
        verdict: Verdict::NoMismatch,
        findings: Vec::new(),
        located: Vec::new(),
        remainder: None,
        explained_share: None,
        impact: None,
        noise: Vec::new(),
        certificate: Vec::new(),
        notes: Vec::new(),
        ..report.explanation
    };
    report.evidence.sensors.drain(..2);
    report
}

fn explanation(prefix: &str, names: &[String]) -> Explanation {
    let good = Goodness { nll_per_sample: 1.4213, rmse: 1.002, whiteness_p: 0.41, nis_mean: 1.01 };
    let fit = BeforeAfter {
        before: Goodness { nll_per_sample: 1.7641, rmse: 1.392, whiteness_p: 2e-9, nis_mean: 1.74 },
        after: good,
        ..BeforeAfter::default()
    };
    Explanation {
        format: FORMAT,
        verdict: Verdict::PartlyExplained,
        findings: vec![
            Finding {
                sensor: names[0].clone(),
                sensors: Vec::new(),
                effect: "bias_temperature_rate".into(),
                probability: 1.0,
                class: vec![
                    Member {
                        sensor: names[0].clone(),
                        effect: "bias_temperature_rate".into(),
                        probability: 0.67,
                        separated_by: String::new(),
                    },
                    Member {
                        sensor: names[0].clone(),
                        effect: "bias_thermal_lag".into(),
                        probability: 0.33,
                        separated_by: "A daily cycle, or two steps of temperature an hour apart".into(),
                    },
                ],
                interval_s: [0.0, ROWS as f64],
                parameters: vec![parameter("coefficient", 0.5012, 0.0123, "deg/h/(K/h)", Some(true))],
                evidence: Evidence { gain_nats: 812.4, p_value: 1e-12 },
                share: Some(0.61),
                impact: Some(impact(&names[0])),
                sentence: format!("{} drifts with the rate of its temperature", names[0]),
            },
            Finding {
                sensor: names[1].clone(),
                sensors: Vec::new(),
                effect: "bias_step".into(),
                probability: 0.99996,
                class: Vec::new(),
                interval_s: [ONSET_S, ROWS as f64],
                parameters: vec![
                    parameter("coefficient", 1.62, 0.09, "deg/h", Some(false)),
                    parameter("onset_s", 30_013.0, 40.0, "s", None),
                ],
                evidence: Evidence { gain_nats: 96.1, p_value: 4e-5 },
                share: Some(0.2),
                impact: None,
                sentence: format!("the bias of {} steps", names[1]),
            },
        ],
        fit: Fit { train: fit.clone(), held_out: fit },
        located: vec![
            Located {
                sensor: names[0].clone(),
                test: "conditional means".into(),
                what: format!("innovations depend on the rate of {prefix}temp_x"),
                p_value: 3e-14,
                interval_s: None,
                band_hz: Some([1e-5, 4e-5]),
            },
            Located {
                sensor: names[1].clone(),
                test: "change point".into(),
                what: "mean of the innovations changes by 0.21 σ".into(),
                p_value: 2e-6,
                interval_s: Some([ONSET_S, ROWS as f64]),
                band_hz: None,
            },
        ],
        remainder: Some(Remainder {
            sensor: names[2].clone(),
            what: "a slow bend between 0.01 and 0.1 mHz".into(),
            on: Some(format!("{prefix}supply")),
            gain_nats: 14.2,
        }),
        explained_share: Some(0.81),
        impact: Some(impact(&names[0])),
        noise: names.iter().map(|name| noise(name)).collect(),
        certificate: names.iter().flat_map(|name| certificate(name)).collect(),
        notes: vec![format!("{prefix}Column temp_x has steps of 0.0625 K.")],
    }
}

fn impact(sensor: &str) -> Impact {
    Impact { sensor: sensor.to_owned(), after_s: 3600.0, position_m: 1230.0, attitude_deg: 0.011 }
}

fn noise(sensor: &str) -> NoiseOfSensor {
    let stated = NoiseNumbers { white: 0.2, ..NoiseNumbers::default() };
    NoiseOfSensor {
        sensor: sensor.to_owned(),
        unit: "deg/h".to_owned(),
        found: NoiseNumbers { markov: vec![[0.05, 300.0]], ..stated.clone() },
        stated: Some(stated),
        nu: Some(64.0),
        holds_within: 0.088,
    }
}

/// One effect with a bound and one without.
fn certificate(sensor: &str) -> [Bound; 2] {
    let bound = Bound { sensor: sensor.to_owned(), adds_unit: "deg/h".to_owned(), ..Bound::default() };
    [
        Bound {
            effect: "bias_warmup".to_owned(),
            parameter: "coefficient".to_owned(),
            bound: Some(0.0221),
            unit: "deg/h".to_owned(),
            at: vec![At { name: "tau_s".to_owned(), value: 12_649.0, unit: "s".to_owned() }],
            adds_rms: Some(0.00598),
            ..bound.clone()
        },
        Bound {
            effect: "dead_zone".to_owned(),
            because: Some("the recording lacks what it needs: input below the threshold".to_owned()),
            ..bound
        },
    ]
}
