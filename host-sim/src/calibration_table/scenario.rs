//! The scenario file `schuler-calibration-run/1`: a calibration run on a one-axis table in a thermal chamber.
//!
//! Keys that are left out have the values of the dissertation's set-up; error coefficients that are not given are drawn
//! from a normal distribution with these standard deviations. Every mistake is reported with line, field and expectation.
//!
//! | table | keys |
//! | --- | --- |
//! | | `format`, `title`, `seed` |
//! | `[site]` | `latitude_deg`, `gravity` |
//! | `[table]` | `azimuth_deg`, `tilt_deg`, `rate_deg_s`, `rotation_s`, `dwell_s`, `cycle_s`, `samples_per_second`, `mounting_arcsec`; with an angle sensor also `angle_arcsec`, `wobble_arcsec`: then gyros alone are recorded |
//! | `[chamber]` | `kind` = up_and_down (`low_degC`, `high_degC`, `period_s`, `load_K`), steady (`at_degC`), ramp (`from_degC`, `rate_degC_per_h`), exponential (`from_degC`, `to_degC`, `tau_s`) |
//! | `[thermometer]` | `step_K`, `white_K`; `gradient` = true for four more, on the axes |
//! | `[noise]` | `angle_random_walk_deg_per_rt_h`, `specific_force` (m/s², 1 σ of the mean of a second) |
//! | `[errors]` | standard deviations at 35 degC, for 30 K, for 20 K/h, for 5 K/m: `gyro_bias_deg_h`, `gyro_matrix_ppm`, `accelerometer_bias_mm_s2`, `accelerometer_matrix_ppm` |
use std::path::Path;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_recording::document::{Field, Node, Parsed, parse_with};
use schuler_recording::{Error, Leniency};

use super::{CalibrationTable, ErrorCoefficients, Programme, TriadErrors};

/// What the key `format` must say.
pub const FORMAT: &str = "schuler-calibration-run/1";

/// Arc second, rad.
const ARC_SECOND: f64 = std::f64::consts::PI / 180.0 / 3600.0;
/// Degree per hour, rad/s.
const DEGREE_PER_HOUR: f64 = ARC_SECOND;
/// What one unit of the standard deviations is for: 1, degC, degC/s, degC/m.
const FOR: [f64; 4] = [1.0, 30.0, 20.0 / 3600.0, 5.0];

/// A calibration run to be simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationScenario {
    /// What it is, for people.
    pub title: String,
    /// Seed of every random stream.
    pub seed: u64,
    /// Latitude is in it; the errors are drawn by [`CalibrationScenario::drawn`].
    pub table: CalibrationTable,
    /// Quantum of the thermometers, K.
    pub step_k: f64,
    /// Noise of the thermometers, K.
    pub white_k: f64,
    /// Whether there are thermometers for a gradient.
    pub gradient: bool,
    /// Standard deviations of the errors.
    pub(super) errors: Sigmas,
}

/// Standard deviations of the error coefficients' parts, SI units for the units of [`FOR`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sigmas {
    pub(super) gyro_bias: [f64; 4],
    pub(super) gyro_matrix: [f64; 4],
    pub(super) accelerometer_bias: [f64; 4],
    pub(super) accelerometer_matrix: [f64; 4],
}

impl CalibrationScenario {
    /// Whether a text claims to be one.
    pub fn is_one(text: &str) -> bool {
        text.lines().any(|line| line.starts_with("format") && line.contains("schuler-calibration-run"))
    }

    /// Reads a scenario from `text`, the content of the file `path`.
    ///
    /// # Errors
    /// Everything that is wrong with the text, by line and field.
    pub fn parse(path: &Path, text: &str) -> Result<(Self, Vec<String>), Error> {
        Self::parse_with(path, text, Leniency::Strict)
    }

    /// Reads a scenario from `text` as strictly or leniently as asked.
    ///
    /// # Errors
    /// As [`parse`](Self::parse).
    pub fn parse_with(path: &Path, text: &str, leniency: Leniency) -> Result<(Self, Vec<String>), Error> {
        let Parsed { value, warnings, .. } = parse_with(path, text, leniency, read)?;
        Ok((value, warnings))
    }

    /// The table with the errors of this seed.
    pub fn drawn(&self) -> CalibrationTable {
        let mut random = Pcg64::seed_from_u64(self.seed ^ 0x5eed_0000_0000);
        let mut draw = |sigmas: &[f64; 4]| {
            let mut part = |k: usize| {
                let unit: f64 = StandardNormal.sample(&mut random);
                sigmas[k] * unit / FOR[k]
            };
            ErrorCoefficients {
                constant: part(0),
                per_degree: part(1),
                per_rate: part(2),
                per_gradient: [part(3), part(3), part(3)],
            }
        };
        let mut table = self.table;
        for i in 0..3 {
            table.gyro.bias[i] = draw(&self.errors.gyro_bias);
            table.accelerometer.bias[i] = draw(&self.errors.accelerometer_bias);
            for j in 0..3 {
                table.gyro.matrix[i][j] = draw(&self.errors.gyro_matrix);
                // The accelerometers define the body frame.
                let element = draw(&self.errors.accelerometer_matrix);
                table.accelerometer.matrix[i][j] =
                    if j <= i { element } else { ErrorCoefficients::default() };
            }
        }
        table
    }
}

fn read(node: &Node<'_>) -> Option<CalibrationScenario> {
    let format = node.required("format", &format!("\"{FORMAT}\"")).and_then(|field| {
        let text = field.text()?;
        if text == FORMAT { Some(()) } else { field.wrong(&format!("\"{FORMAT}\"")) }
    });
    let title = node.optional("title").and_then(|field| field.any_text()).unwrap_or_default();
    let seed = number(node, "seed", 1.0, "a whole number", |n| n >= 0.0 && n.fract() == 0.0) as u64;
    let mut table = set_up();
    section(node, "site", |site| {
        table.latitude =
            number(site, "latitude_deg", 55.7, "degrees, -89 to 89", |n| n.abs() <= 89.0).to_radians();
        table.gravity = positive(site, "gravity", table.gravity);
    });
    let mut with_angle = false;
    section(node, "table", |node| {
        table.azimuth = any(node, "azimuth_deg", 20.0).to_radians();
        table.tilt = any(node, "tilt_deg", 0.0).to_radians();
        table.rate = positive(node, "rate_deg_s", 12.0).to_radians();
        table.rotation_s = positive(node, "rotation_s", table.rotation_s);
        table.dwell_s = positive(node, "dwell_s", table.dwell_s);
        let whole = |n: f64| n.fract() == 0.0 && (60.0..=86_400.0).contains(&n);
        table.cycle_s = number(node, "cycle_s", 3600.0, "whole seconds, 60 to 86400", whole) as usize;
        let rate = |n: f64| n.fract() == 0.0 && (10.0..=1000.0).contains(&n);
        table.samples_per_second =
            number(node, "samples_per_second", 20.0, "a whole number from 10 to 1000", rate) as usize;
        table.mounting = positive(node, "mounting_arcsec", 1800.0) * ARC_SECOND;
        let not_negative = |key| number(node, key, 0.0, "a number not less than zero", |n| n >= 0.0);
        table.angle_noise = not_negative("angle_arcsec") * ARC_SECOND;
        table.wobble = not_negative("wobble_arcsec") * ARC_SECOND;
        with_angle = table.angle_noise > 0.0;
    });
    if with_angle && table.wobble == 0.0 {
        return node.problem_at(
            "table.wobble_arcsec",
            "missing beside angle_arcsec; expected the table's wobble in arc seconds",
        );
    }
    let mut programme = None;
    section(node, "chamber", |node| programme = chamber(node));
    if node.optional("chamber").is_some() {
        table.programme = programme?;
    }
    let (mut step_k, mut white_k, mut gradient) = (0.0625, 0.0, false);
    section(node, "thermometer", |node| {
        step_k = positive(node, "step_K", step_k);
        white_k = number(node, "white_K", 0.0, "a number not less than zero", |n| n >= 0.0);
        gradient = node.optional("gradient").and_then(|field| field.boolean()).unwrap_or(false);
    });
    section(node, "noise", |node| {
        let walk = positive(node, "angle_random_walk_deg_per_rt_h", if with_angle { 0.02 } else { 0.05 });
        table.angle_random_walk = (walk / 60.0).to_radians();
        table.force_noise = positive(node, "specific_force", table.force_noise);
    });
    let per_hour = DEGREE_PER_HOUR;
    let mut errors = Sigmas {
        gyro_bias: [20.0, 10.0, 6.0, 0.0].map(|s| s * per_hour),
        gyro_matrix: [2e-3, 1e-3, 6e-4, 0.0],
        accelerometer_bias: [0.05, 0.025, 0.015, 0.0],
        accelerometer_matrix: [2e-3, 1e-3, 6e-4, 0.0],
    };
    section(node, "errors", |node| {
        let sigmas = |key, unit: f64, of: &mut [f64; 4]| {
            if let Some(given) = node.optional(key).and_then(|field| four(&field)) {
                *of = given.map(|s| s * unit);
            }
        };
        sigmas("gyro_bias_deg_h", per_hour, &mut errors.gyro_bias);
        sigmas("gyro_matrix_ppm", 1e-6, &mut errors.gyro_matrix);
        sigmas("accelerometer_bias_mm_s2", 1e-3, &mut errors.accelerometer_bias);
        sigmas("accelerometer_matrix_ppm", 1e-6, &mut errors.accelerometer_matrix);
    });
    format?;
    Some(CalibrationScenario { title, seed, table, step_k, white_k, gradient, errors })
}

/// A complete unit on a table that knows nothing, without errors.
fn set_up() -> CalibrationTable {
    CalibrationTable {
        latitude: 55.7_f64.to_radians(),
        gravity: 9.8156,
        azimuth: 20.0_f64.to_radians(),
        tilt: 0.0,
        rate: 12.0_f64.to_radians(),
        rotation_s: 68.0,
        dwell_s: 16.0,
        cycle_s: 3600,
        samples_per_second: 20,
        mounting: 1800.0 * ARC_SECOND,
        wobble: 0.0,
        angle_noise: 0.0,
        angle_random_walk: (0.05_f64 / 60.0).to_radians(),
        force_noise: 0.01,
        gyro: TriadErrors::default(),
        accelerometer: TriadErrors::default(),
        programme: Programme::UpAndDown { low: 10.0, high: 70.0, period_s: 3600.0, load: 6.0 },
    }
}

fn chamber(node: &Node<'_>) -> Option<Programme> {
    #[derive(Clone, Copy)]
    enum Kind {
        UpAndDown,
        Steady,
        Ramp,
        Exponential,
    }
    let kind = node.required("kind", "up_and_down, steady, ramp or exponential").and_then(|field| {
        field.one_of(&[
            ("up_and_down", Kind::UpAndDown),
            ("steady", Kind::Steady),
            ("ramp", Kind::Ramp),
            ("exponential", Kind::Exponential),
        ])
    })?;
    Some(match kind {
        Kind::UpAndDown => Programme::UpAndDown {
            low: any(node, "low_degC", 10.0),
            high: any(node, "high_degC", 70.0),
            period_s: positive(node, "period_s", 3600.0),
            load: any(node, "load_K", 6.0),
        },
        Kind::Steady => Programme::Steady(any(node, "at_degC", 35.0)),
        Kind::Ramp => {
            Programme::Ramp(any(node, "from_degC", 10.0), any(node, "rate_degC_per_h", 20.0) / 3600.0)
        }
        Kind::Exponential => Programme::Exponential(
            any(node, "from_degC", 20.0),
            any(node, "to_degC", 60.0),
            positive(node, "tau_s", 1500.0),
        ),
    })
}

fn section(node: &Node<'_>, key: &'static str, mut read: impl FnMut(&Node<'_>)) {
    if let Some(field) = node.optional(key) {
        field.table(|node| {
            read(node);
            Some(())
        });
    }
}

fn number(
    node: &Node<'_>,
    key: &'static str,
    default: f64,
    expected: &str,
    valid: impl Fn(f64) -> bool,
) -> f64 {
    node.optional(key).and_then(|field| field.number_where(expected, valid)).unwrap_or(default)
}

fn any(node: &Node<'_>, key: &'static str, default: f64) -> f64 {
    number(node, key, default, "a number", |_| true)
}

fn positive(node: &Node<'_>, key: &'static str, default: f64) -> f64 {
    number(node, key, default, "a number greater than zero", |n| n > 0.0)
}

/// Three or four standard deviations; the fourth is zero if it is not there.
fn four(field: &Field<'_>) -> Option<[f64; 4]> {
    let list = field.number_list()?;
    let four = match *list.as_slice() {
        [a, b, c] => [a, b, c, 0.0],
        [a, b, c, d] => [a, b, c, d],
        _ => return field.wrong("three or four standard deviations"),
    };
    if four.iter().all(|s| *s >= 0.0) { Some(four) } else { field.wrong("standard deviations") }
}
