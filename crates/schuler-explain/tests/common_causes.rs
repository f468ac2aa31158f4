//! What several sensors have in common is one finding that names them all, and a vibration whose frequency wanders is one noise.
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding};
use schuler_recording::Recording;

const ROWS: usize = 4000;
const SENSORS: [&str; 3] = ["ax", "ay", "az"];
/// Records of each kind.
const SEEDS: u64 = 3;

/// What three accelerometers at rest read, white noise of one included, explained.
fn explained(name: &str, seed: u64, beside: impl Fn(usize, usize) -> f64) -> Explanation {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut table = format!("t,{}\n", SENSORS.join(","));
    for row in 0..ROWS {
        let _ = write!(table, "{row}");
        for sensor in 0..SENSORS.len() {
            let noise: f64 = StandardNormal.sample(&mut random);
            let _ = write!(table, ",{}", noise + beside(sensor, row));
        }
        table.push('\n');
    }
    let mut case = format!(
        "format = \"schuler-case/1\"\ntitle = \"at rest\"\n[recording]\npath = \"{name}.csv\"\ntime = \"t\"\nstep_s = 1.0\n\
         [motion]\nkind = \"static\"\nattitude_deg = {{ roll = 0.0, pitch = 0.0, heading = 0.0 }}\n"
    );
    for (place, id) in SENSORS.iter().enumerate() {
        let axis: Vec<String> = (0..3).map(|k| if k == place { "1.0" } else { "0.0" }.to_owned()).collect();
        let _ = write!(
            case,
            "[[sensor]]\nid = \"{id}\"\nkind = \"accelerometer\"\ncolumn = \"{id}\"\nunit = \"mg\"\naxis = [{}]\n\
             relative = true\n[sensor.nominal]\nwhite = 1.0\n",
            axis.join(", ")
        );
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    fs::write(folder.join(format!("{name}.csv")), table).expect("the folder is writable");
    let path = folder.join(format!("{name}.toml"));
    fs::write(&path, case).expect("the folder is writable");
    let recording = Recording::read(&path).expect("the case can be read");
    explain(&recording, &Config::default()).expect("it can be explained")
}

/// The one finding.
fn only(explanation: &Explanation) -> &Finding {
    let [finding] = &explanation.findings[..] else {
        let said: Vec<&str> = explanation.findings.iter().map(|it| it.sentence.as_str()).collect();
        panic!("{said:#?}")
    };
    finding
}

fn is_told(finding: &Finding, name: &str, truth: f64) {
    let parameter = finding.parameters.iter().find(|parameter| parameter.name == name);
    let parameter = parameter.unwrap_or_else(|| panic!("{name} of {finding:?}"));
    let (value, sigma) = parameter.value.zip(parameter.sigma).expect("a number");
    assert!((value - truth).abs() < 4.0 * sigma, "{name}: {value} ± {sigma}, {truth} was put in");
}

#[test]
fn a_step_of_three_sensors_is_one_finding() {
    const STEPS: [f64; 3] = [0.9, -0.6, 0.5];
    for seed in 1..=SEEDS {
        let step = |sensor: usize, row: usize| if row >= 1500 { STEPS[sensor] } else { 0.0 };
        let explanation = explained("step_of_three", seed, step);
        let finding = only(&explanation);
        assert_eq!(
            (finding.effect.as_str(), &finding.sensors[..]),
            ("bias_step", &SENSORS.map(str::to_owned)[..])
        );
        assert!(finding.sentence.contains("what ax, ay and az have in common jumps"), "{}", finding.sentence);
        for (sensor, step) in SENSORS.iter().zip(STEPS) {
            is_told(finding, &format!("coefficient_{sensor}"), step);
        }
        is_told(finding, "onset_s", 1500.0);
    }
}

#[test]
fn a_step_of_one_sensor_is_of_that_one() {
    for seed in 1..=SEEDS {
        let step = |sensor: usize, row: usize| if sensor == 1 && row >= 1500 { 0.9 } else { 0.0 };
        let explanation = explained("step_of_one", seed, step);
        let finding = only(&explanation);
        assert_eq!((finding.effect.as_str(), finding.sensor.as_str()), ("bias_step", "ay"));
        assert!(finding.sensors.is_empty(), "{:?}", finding.sensors);
    }
}

#[test]
fn steps_at_other_times_are_not_in_common() {
    let step = |sensor: usize, row: usize| if row >= 1000 + 900 * sensor { 0.9 } else { 0.0 };
    let explanation = explained("steps_apart", 4, step);
    let of: Vec<(&str, &str)> =
        explanation.findings.iter().map(|it| (it.effect.as_str(), it.sensor.as_str())).collect();
    assert_eq!(of.len(), 3, "{of:?}");
    assert!(SENSORS.iter().all(|sensor| of.contains(&("bias_step", sensor))), "{of:?}");
}

#[test]
fn a_line_of_two_sensors_is_one_finding() {
    const FREQUENCY_HZ: f64 = 0.0731;
    for seed in 1..=SEEDS {
        let wave = |phase: f64, row: usize| (TAU * FREQUENCY_HZ * row as f64 + phase).cos();
        let line = |sensor: usize, row: usize| match sensor {
            0 => 0.25 * wave(0.3, row),
            2 => 0.2 * wave(1.9, row),
            _ => 0.0,
        };
        let explanation = explained("line_of_two", seed, line);
        let finding = only(&explanation);
        assert_eq!((finding.effect.as_str(), finding.sensor.as_str()), ("periodic_line", "ax, az"));
        is_told(finding, "a_ax", 0.25 * 0.3_f64.cos());
        is_told(finding, "b_az", -0.2 * 1.9_f64.sin());
        is_told(finding, "frequency_hz", FREQUENCY_HZ);
    }
}

/// A resonance that is driven by noise rings at one frequency for some hundred periods: no line, and narrower than any band of the sums.
#[test]
fn a_vibration_whose_frequency_wanders_is_one_noise() {
    const SIGMA: f64 = 0.8;
    const ALPHA: f64 = 0.004;
    const BETA: f64 = 2.1;
    for seed in 1..=SEEDS {
        let mut random = Pcg64::seed_from_u64(100 + seed);
        let driven = SIGMA * (1.0 - (-2.0 * ALPHA).exp()).sqrt();
        let (mut cos, mut sin) = (SIGMA, 0.0);
        let rings: Vec<f64> = (0..ROWS)
            .map(|_| {
                let mut noise =
                    || -> f64 { driven * Distribution::<f64>::sample(&StandardNormal, &mut random) };
                let kept = (-ALPHA).exp();
                let turned = [cos * BETA.cos() - sin * BETA.sin(), sin * BETA.cos() + cos * BETA.sin()];
                [cos, sin] = turned.map(|value| kept * value + noise());
                cos
            })
            .collect();
        let explanation =
            explained("wandering", seed, |sensor, row| if sensor == 0 { rings[row] } else { 0.0 });
        let finding = only(&explanation);
        assert_eq!((finding.effect.as_str(), finding.sensor.as_str()), ("noise_exp_cos", "ax"));
        is_told(finding, "beta", BETA);
        is_told(finding, "alpha", ALPHA);
        is_told(finding, "sigma", SIGMA);
    }
}

/// Lines of one band are lines still where the bands about them are made narrow.
#[test]
fn two_lines_in_one_band_stay_two_lines() {
    const FREQUENCIES_HZ: [f64; 2] = [0.2503, 0.2561];
    for seed in 1..=SEEDS {
        let line = |hz: f64, row: usize| 0.3 * (TAU * hz * row as f64).cos();
        let both = |row: usize| FREQUENCIES_HZ.map(|hz| line(hz, row)).iter().sum::<f64>();
        let explanation =
            explained("two_lines", seed, |sensor, row| if sensor == 1 { both(row) } else { 0.0 });
        let told: Vec<(&str, &str)> =
            explanation.findings.iter().map(|it| (it.effect.as_str(), it.sensor.as_str())).collect();
        assert_eq!(told, [("periodic_line", "ay"); 2]);
        for hz in FREQUENCIES_HZ {
            let distance = |finding: &&Finding| {
                let frequency = finding.parameters.iter().find(|it| it.name == "frequency_hz");
                (frequency.and_then(|it| it.value).unwrap_or(f64::NAN) - hz).abs()
            };
            let nearest =
                explanation.findings.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("two");
            is_told(nearest, "frequency_hz", hz);
            is_told(nearest, "a", 0.3);
        }
    }
}
