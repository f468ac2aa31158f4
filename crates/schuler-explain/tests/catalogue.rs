//! Every row of the catalogue: that it is there, that its signature is its formula's for simple inputs, and that it is
//! not offered where what it needs was not recorded or does not vary.
use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, Vector3};
use schuler_explain::catalogue::{CATALOGUE, Candidate, OnsetShape, Port, Search, Signature, Target};
use schuler_explain::inputs::Inputs;
use schuler_recording::case::{
    Attitude, Auxiliary, Case, Grade, Motion, MotionKind, Nominal, Quantity, SchulerLoop, Sensor, SensorKind,
    Site, Source, TemperatureBias,
};
use schuler_recording::motion::{body_to_ned, earth};
use schuler_recording::recording::{AuxiliarySeries, Gap, MotionSeries, Quality, SensorSeries};
use schuler_recording::unit::Unit;
use schuler_recording::{Recording, unit};

/// The identifiers that answers are scored by.
const IDENTIFIERS: [&str; 61] = [
    "bias_constant",
    "bias_step",
    "bias_drift_linear",
    "bias_warmup",
    "bias_temperature",
    "bias_temperature_sq",
    "bias_temperature_cubic",
    "bias_temperature_rate",
    "bias_thermal_lag",
    "bias_temperature_gradient",
    "bias_thermal_hysteresis",
    "bias_supply_voltage",
    "bias_magnetic_field",
    "bias_electronics_temperature",
    "bias_pickoff_offset",
    "bias_restart",
    "bias_pressure",
    "bias_on_aux",
    "periodic_line",
    "schuler_oscillation",
    "output_stuck",
    "output_saturated",
    "dead_zone",
    "quantisation",
    "intermittent_jump",
    "scale_factor",
    "scale_factor_asymmetry",
    "scale_factor_quadratic",
    "scale_factor_cubic",
    "scale_factor_temperature",
    "misalignment",
    "misalignment_temperature",
    "cross_coupling",
    "g_mass_unbalance",
    "g_quadrature",
    "g_spin",
    "g2_anisoelasticity",
    "g2_cross",
    "g_mass_unbalance_temperature",
    "torquer_self_heating",
    "post_g_transient",
    "scale_factor_odd_quadratic",
    "vibration_rectification",
    "anisoinertia",
    "angular_acceleration",
    "rate_cross_axis",
    "coning_sculling",
    "time_delay",
    "bandwidth_lag",
    "lever_arm",
    "earth_rate_attitude",
    "gravity_anomaly",
    "earth_tide",
    "noise_white",
    "noise_markov",
    "noise_exp_cos",
    "noise_random_walk",
    "noise_flicker",
    "noise_angle_quantisation",
    "noise_variance_step",
    "noise_outliers",
];

/// What needs nothing but readings.
const ALWAYS: [&str; 15] = [
    "bias_step",
    "periodic_line",
    "output_stuck",
    "output_saturated",
    "quantisation",
    "intermittent_jump",
    "noise_white",
    "noise_markov",
    "noise_exp_cos",
    "noise_random_walk",
    "noise_flicker",
    "noise_angle_quantisation",
    "noise_variance_step",
    "noise_outliers",
    "bias_constant",
];

#[test]
fn the_identifiers_are_the_catalogues() {
    let found: Vec<&str> = CATALOGUE.iter().map(|effect| effect.id).collect();
    assert_eq!(found, IDENTIFIERS);
    for effect in CATALOGUE {
        let texts = [effect.formula, effect.sentence, effect.needs, effect.separated_by, effect.source];
        assert!(texts.iter().all(|text| !text.trim().is_empty()), "{}", effect.id);
        assert!(SensorKind::NAMES.iter().any(|&(_, kind)| (effect.acts_on)(kind)), "{}", effect.id);
    }
}

// ── Recordings ──────────────────────────────────────────────────────────────────────────────────────────────────────

struct Scene(Recording);

impl Scene {
    fn new(kind: MotionKind, rows: usize, step_s: f64) -> Self {
        let case = Case {
            title: String::new(),
            recording: Source {
                path: "r.csv".into(),
                time: Some("t".into()),
                step_s: Some(step_s),
                ..Source::default()
            },
            site: None,
            simulation: None,
            motion: Motion { kind, ..Motion::default() },
            schuler_loop: None,
            sensors: Vec::new(),
            calibration: None,
            auxiliaries: Vec::new(),
            effects: Vec::new(),
        };
        Self(Recording {
            case,
            step_s,
            time_s: (0..rows).map(|row| row as f64 * step_s).collect(),
            inserted: vec![false; rows],
            gaps: Vec::new(),
            sensors: Vec::new(),
            auxiliaries: Vec::new(),
            motion: MotionSeries::default(),
            table_angle: None,
            in_formulas: Vec::new(),
            warnings: Vec::new(),
        })
    }

    fn sample(&self, value: impl Fn(f64) -> f64) -> Vec<f64> {
        self.0.elapsed_s().map(value).collect()
    }

    fn sensor(mut self, id: &str, kind: SensorKind, unit: Unit, axis: [f64; 3]) -> Self {
        let nominal = Nominal { white: 1.0, ..Nominal::default() };
        let sensor = Sensor {
            axis: Some(axis),
            spin_axis: (kind == SensorKind::Dtg).then_some([0.0, 0.0, 1.0]),
            ..Sensor::new(id, kind, unit.si(), nominal)
        };
        self.0.case.sensors.push(sensor.clone());
        let values = vec![0.0; self.0.len()];
        self.0.sensors.push(SensorSeries {
            sensor,
            written_unit: unit,
            values,
            predicted: None,
            quality: Quality::default(),
        });
        self
    }

    fn last(mut self, change: impl FnOnce(&mut Sensor)) -> Self {
        change(&mut self.0.sensors.last_mut().unwrap().sensor);
        self
    }

    fn aux(
        mut self,
        column: &str,
        quantity: Quantity,
        unit: &str,
        near: Option<&str>,
        value: impl Fn(f64) -> f64,
    ) -> Self {
        let auxiliary = Auxiliary {
            column: column.to_owned(),
            quantity,
            unit: unit.to_owned(),
            scale: None,
            offset: None,
            near: near.map(str::to_owned),
            position_m: None,
        };
        let values = self.sample(value);
        self.0.auxiliaries.push(AuxiliarySeries { auxiliary, values, quality: Quality::default() });
        self
    }

    fn columns(&self, values: [fn(f64) -> f64; 3]) -> [Vec<f64>; 3] {
        values.map(|value| self.sample(value))
    }

    fn site(mut self, latitude_deg: f64) -> Self {
        self.0.case.site = Some(Site { latitude_deg, longitude_deg: None, altitude_m: 0.0 });
        self
    }
}

// The turning recording: rates, their derivatives, forces, velocities, temperature, in closed form.
fn wx(t: f64) -> f64 {
    0.3 * (0.5 * t).sin()
}
fn wy(t: f64) -> f64 {
    0.2 * (0.7 * t).cos()
}
fn wz(t: f64) -> f64 {
    0.1 + 0.05 * (0.3 * t).sin()
}
fn wx_dot(t: f64) -> f64 {
    0.15 * (0.5 * t).cos()
}
fn wy_dot(t: f64) -> f64 {
    -0.14 * (0.7 * t).sin()
}
fn wz_dot(t: f64) -> f64 {
    0.015 * (0.3 * t).cos()
}
fn fx(t: f64) -> f64 {
    3.0 * (0.2 * t).sin()
}
fn fy(t: f64) -> f64 {
    2.0 * (0.3 * t).cos()
}
fn fz(t: f64) -> f64 {
    -9.8 + (0.25 * t).sin()
}
fn temperature(t: f64) -> f64 {
    25.0 + 8.0 * (TAU * t / 400.0).sin()
}
fn vibration(t: f64) -> f64 {
    2.0 + (0.01 * t).sin()
}
fn line(t: f64) -> f64 {
    (TAU * t / 150.0).sin()
}

const TURNING_S: f64 = 600.0;

/// Body that turns and shakes, 600 s at 10 Hz: DTG x, accelerometer x, Doppler x; temperature with known reference.
fn turning() -> Scene {
    let mut scene = Scene::new(MotionKind::Recorded, 6001, 0.1)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .last(|sensor| {
            sensor.nominal.temperature_bias = Some(TemperatureBias {
                column: "T".to_owned(),
                reference_deg_c: 20.0,
                coefficients: vec![0.0],
            });
        })
        .sensor("a", SensorKind::Accelerometer, Unit::MicroG, [1.0, 0.0, 0.0])
        .sensor("d", SensorKind::Doppler, Unit::MetrePerSecond, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", Some("g"), temperature)
        .aux("T2", Quantity::Temperature, "degC", None, |t| temperature(t) + 3.0 + line(t))
        .aux("T_board", Quantity::Temperature, "degC", None, |t| 40.0 + 4.0 * line(t))
        .aux("V", Quantity::Voltage, "V", None, |t| 5.0 + 0.1 * line(t))
        .aux("p", Quantity::Pressure, "Pa", None, |t| 1e5 + 300.0 * line(t))
        .aux("B", Quantity::MagneticFieldY, "T", None, |t| 2e-5 * line(t))
        .aux("vib", Quantity::VibrationRms, "m/s^2", None, vibration)
        .aux("pickoff", Quantity::Other, "rad", Some("g"), |t| 1e-3 * line(t))
        .aux("I", Quantity::Current, "A", None, |t| 0.2 + 0.05 * line(t));
    scene.0.motion.rate = Some(scene.columns([wx, wy, wz]));
    scene.0.motion.specific_force = Some(scene.columns([fx, fy, fz]));
    let still: fn(f64) -> f64 = |_| 0.0;
    scene.0.motion.attitude_rad = Some(scene.columns([still, still, still]));
    scene.0.motion.velocity_ned =
        Some(scene.columns([|t| 5.0 + (0.4 * t).sin(), |t| (0.3 * t).cos(), still]));
    scene
}

/// Nothing but one relative gyro at rest, for a minute.
fn bare(kind: SensorKind) -> Scene {
    let unit = match kind.dimension() {
        unit::Dimension::AngularRate => Unit::DegreePerHour,
        unit::Dimension::Acceleration => Unit::MicroG,
        unit::Dimension::Velocity => Unit::MetrePerSecond,
        unit::Dimension::Other => Unit::free("N m"),
    };
    let mut scene = Scene::new(MotionKind::Static, 50, 1.0)
        .sensor("s", kind, unit, [0.0, 0.0, 1.0])
        .last(|sensor| sensor.relative = true)
        .aux("T", Quantity::Temperature, "degC", Some("s"), |_| 25.0)
        .aux("T2", Quantity::Temperature, "degC", None, |_| 26.0)
        .aux("V", Quantity::Voltage, "V", None, |_| 5.0)
        .aux("B", Quantity::MagneticFieldX, "T", None, |_| 2e-5)
        .aux("vib", Quantity::VibrationRms, "m/s^2", None, |_| 1.0)
        .aux("x", Quantity::Other, "rad", None, |_| 1.0)
        .site(50.0);
    scene.0.case.motion.attitude_deg = Some(Attitude { roll: 3.0, pitch: 20.0, heading: 40.0 });
    scene
}

// ── Candidates ──────────────────────────────────────────────────────────────────────────────────────────────────────

fn candidates(inputs: &Inputs<'_>, id: &str) -> Vec<Candidate> {
    let effect = CATALOGUE.iter().find(|effect| effect.id == id).unwrap_or_else(|| panic!("{id}"));
    (effect.candidates)(effect, inputs)
}

/// The candidates of an effect at one sensor with the given variants.
fn at(inputs: &Inputs<'_>, id: &str, sensor: usize, variant: &[(&str, &str)]) -> Vec<Candidate> {
    candidates(inputs, id)
        .into_iter()
        .filter(|candidate| candidate.target == Target::Sensor(sensor))
        .filter(|candidate| {
            variant.iter().all(|wanted| {
                candidate.variant.iter().any(|(name, value)| (*name, value.as_str()) == *wanted)
            })
        })
        .collect()
}

fn signature(candidate: &Candidate, parameters: &[f64]) -> Signature {
    match &candidate.search {
        Search::Linear(signature) => signature.clone(),
        Search::Grid { signature, parameters: names, .. } => {
            assert_eq!(names.len(), parameters.len());
            for parameter in names {
                assert!(parameter.grid.windows(2).all(|pair| pair[0] < pair[1]), "{}", candidate.effect.id);
            }
            signature(parameters)
        }
        _ => panic!("{} has no signature", candidate.effect.id),
    }
}

/// A column of a signature, with the shape that every signature must have.
fn column(candidate: &Candidate, parameters: &[f64], index: usize, rows: usize) -> Vec<f64> {
    let signature = signature(candidate, parameters);
    assert_eq!(signature.columns.len(), candidate.amplitudes.len(), "{}", candidate.effect.id);
    for column in &signature.columns {
        for (_, values) in &column.parts {
            assert_eq!(values.len(), rows, "{}", candidate.effect.id);
            assert!(values.iter().all(|value| value.is_finite()), "{}", candidate.effect.id);
        }
    }
    signature.columns[index].parts[0].1.to_vec()
}

fn mean(f: impl Fn(f64) -> f64, scene: &Scene) -> f64 {
    let values = scene.sample(f);
    values.iter().sum::<f64>() / values.len() as f64
}

/// Largest difference from a closed form, as a part of its largest magnitude, after the first `skip` seconds.
fn difference(scene: &Scene, found: &[f64], expected: impl Fn(f64) -> f64, skip: f64) -> f64 {
    let last = TURNING_S.max(scene.0.elapsed_s().last().unwrap_or_default()) - 0.5;
    let size = scene.sample(&expected).iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    (scene.0.elapsed_s().zip(found))
        .filter(|&(t, _)| t >= skip && t <= last)
        .map(|(t, found)| (found - expected(t)).abs() / size)
        .fold(0.0, f64::max)
}

/// Names and values of a variant.
type Variant<'v> = &'v [(&'v str, &'v str)];
/// One line of the table: identifier, sensor, variant, parameters, formula, tolerance.
type Row = (
    &'static str,
    usize,
    &'static [(&'static str, &'static str)],
    &'static [f64],
    Box<dyn Fn(f64) -> f64>,
    f64,
);

/// Response of a lag τ, at rest on the first value, to a + b sin(ωt) + c cos(ωt).
fn lag_of_wave(t: f64, tau: f64, omega: f64, [a, b, c]: [f64; 3]) -> f64 {
    let x = omega * tau;
    let wave = |t: f64| {
        let (sin, cos) = (omega * t).sin_cos();
        (b * (sin - x * cos) + c * (cos + x * sin)) / (1.0 + x * x)
    };
    a + wave(t) + (c - wave(0.0)) * (-t / tau).exp()
}

#[test]
#[allow(clippy::too_many_lines)]
fn signatures_are_the_formulas_in_closed_form() {
    const G: usize = 0;
    const A: usize = 1;
    const D: usize = 2;
    let scene = turning();
    let inputs = Inputs::new(&scene.0);
    let omega_t = TAU / 400.0;
    let (t_mean, t2_mean) = (mean(temperature, &scene), mean(|t| temperature(t) + 3.0 + line(t), &scene));
    let line_mean = mean(line, &scene);
    let rows: Vec<Row> = vec![
        ("bias_constant", G, &[], &[], Box::new(|_| 1.0), 1e-12),
        ("bias_drift_linear", G, &[], &[], Box::new(|t| t), 1e-12),
        ("bias_warmup", G, &[], &[90.0], Box::new(|t| (-t / 90.0).exp()), 1e-12),
        ("bias_temperature", G, &[("column", "T")], &[], Box::new(|t| temperature(t) - 20.0), 1e-3),
        (
            "bias_temperature",
            A,
            &[("column", "T2")],
            &[],
            Box::new(move |t| temperature(t) + 3.0 + line(t) - t2_mean),
            1e-3,
        ),
        ("bias_temperature_sq", G, &[], &[], Box::new(|t| (temperature(t) - 20.0).powi(2)), 2e-3),
        (
            "bias_temperature_sq",
            A,
            &[],
            &[25.0],
            Box::new(|t| (temperature(t) + line(t) - 22.0).powi(2)),
            2e-3,
        ),
        ("bias_temperature_cubic", G, &[], &[], Box::new(|t| (temperature(t) - 20.0).powi(3)), 3e-3),
        ("bias_temperature_rate", G, &[], &[], Box::new(move |t| 8.0 * omega_t * (omega_t * t).cos()), 2e-2),
        (
            "bias_thermal_lag",
            G,
            &[],
            &[80.0],
            Box::new(move |t| lag_of_wave(t, 80.0, omega_t, [5.0, 8.0, 0.0])),
            1e-3,
        ),
        ("bias_temperature_gradient", G, &[("column", "T2 - T")], &[], Box::new(|t| 3.0 + line(t)), 5e-3),
        (
            "bias_electronics_temperature",
            G,
            &[("column", "T_board")],
            &[],
            Box::new(move |t| 4.0 * (line(t) - line_mean)),
            5e-3,
        ),
        ("bias_supply_voltage", G, &[], &[], Box::new(move |t| 0.1 * (line(t) - line_mean)), 1e-9),
        (
            "bias_magnetic_field",
            A,
            &[("axis", "y")],
            &[],
            Box::new(move |t| 2e-5 * (line(t) - line_mean)),
            1e-9,
        ),
        ("bias_pickoff_offset", G, &[], &[], Box::new(move |t| 1e-3 * (line(t) - line_mean)), 1e-9),
        ("bias_pressure", D, &[], &[], Box::new(move |t| 300.0 * (line(t) - line_mean)), 1e-9),
        ("bias_on_aux", G, &[("column", "I")], &[], Box::new(move |t| 0.05 * (line(t) - line_mean)), 1e-9),
        ("dead_zone", G, &[], &[0.1], Box::new(|t| if wx(t).abs() < 0.1 { -wx(t) } else { 0.0 }), 1e-12),
        ("output_saturated", G, &[], &[0.1], Box::new(|t| wx(t).clamp(-0.1, 0.1) - wx(t)), 1e-12),
        ("scale_factor", G, &[], &[], Box::new(wx), 1e-12),
        ("scale_factor", D, &[], &[], Box::new(|t| 5.0 + (0.4 * t).sin()), 1e-12),
        ("scale_factor_asymmetry", G, &[], &[], Box::new(|t| wx(t).abs()), 1e-12),
        ("scale_factor_quadratic", A, &[], &[], Box::new(|t| fx(t).powi(2)), 1e-12),
        ("scale_factor_cubic", A, &[], &[], Box::new(|t| fx(t).powi(3)), 1e-12),
        ("scale_factor_odd_quadratic", A, &[], &[], Box::new(|t| fx(t) * fx(t).abs()), 1e-12),
        ("scale_factor_temperature", G, &[], &[], Box::new(|t| wx(t) * (temperature(t) - 20.0)), 1e-3),
        ("misalignment", G, &[("axis", "y")], &[], Box::new(wy), 1e-12),
        ("misalignment", A, &[("axis", "z")], &[], Box::new(fz), 1e-12),
        (
            "misalignment_temperature",
            G,
            &[("axis", "z")],
            &[],
            Box::new(|t| wz(t) * (temperature(t) - 20.0)),
            1e-3,
        ),
        ("cross_coupling", A, &[("axis", "z")], &[], Box::new(|t| fx(t) * fz(t)), 1e-12),
        ("g_mass_unbalance", G, &[], &[], Box::new(fx), 1e-12),
        ("g_quadrature", G, &[], &[], Box::new(fy), 1e-12),
        ("g_spin", G, &[], &[], Box::new(fz), 1e-12),
        ("g2_anisoelasticity", G, &[], &[], Box::new(|t| fx(t) * fz(t)), 1e-12),
        ("g2_cross", G, &[("axis", "input-other")], &[], Box::new(|t| fx(t) * fy(t)), 1e-12),
        ("g2_cross", G, &[("axis", "other-spin")], &[], Box::new(|t| fy(t) * fz(t)), 1e-12),
        ("g_mass_unbalance_temperature", G, &[], &[], Box::new(|t| fx(t) * (temperature(t) - 20.0)), 1e-3),
        // ω_x² = 0.045 (1 − cos t).
        (
            "torquer_self_heating",
            G,
            &[("axis", "input")],
            &[20.0],
            Box::new(|t| lag_of_wave(t, 20.0, 1.0, [0.045, 0.0, -0.045])),
            1e-3,
        ),
        ("post_g_transient", A, &[], &[10.0], Box::new(|t| lag_of_wave(t, 10.0, 0.2, [0.0, 3.0, 0.0])), 1e-3),
        ("vibration_rectification", A, &[], &[], Box::new(|t| vibration(t).powi(2)), 1e-12),
        ("anisoinertia", G, &[], &[], Box::new(|t| wx(t) * wz(t)), 1e-12),
        ("angular_acceleration", G, &[("axis", "input")], &[], Box::new(wx_dot), 1e-4),
        ("angular_acceleration", G, &[("axis", "other")], &[], Box::new(wy_dot), 1e-4),
        ("rate_cross_axis", G, &[], &[], Box::new(wy), 1e-12),
        ("time_delay", G, &[], &[0.037], Box::new(|t| wx(t - 0.037) - wx(t)), 1e-3),
        (
            "bandwidth_lag",
            G,
            &[],
            &[0.4],
            Box::new(|t| lag_of_wave(t, 0.4, 0.5, [0.0, 0.3, 0.0]) - wx(t)),
            1e-3,
        ),
    ];
    for (id, sensor, variant, parameters, formula, tolerance) in rows {
        let found = at(&inputs, id, sensor, variant);
        let matching = found.iter().find(|candidate| match &candidate.search {
            Search::Grid { parameters: names, .. } => names.len() == parameters.len(),
            Search::Linear(_) => parameters.is_empty(),
            _ => false,
        });
        let candidate = matching.unwrap_or_else(|| panic!("{id} {variant:?}: not offered"));
        let values = column(candidate, parameters, 0, scene.0.len());
        let skip = if id == "time_delay" {
            1.0
        } else if id == "bias_temperature_rate" {
            20.0
        } else {
            0.3
        };
        let error = difference(&scene, &values, &formula, skip);
        assert!(error < tolerance, "{id} {variant:?} {parameters:?}: off by {error:.2e}");
    }
    assert!((t_mean - 25.0).abs() < 3.0);
}

#[test]
fn a_lever_arm_is_the_cross_products() {
    let scene = turning();
    let inputs = Inputs::new(&scene.0);
    let accelerometer = &at(&inputs, "lever_arm", 1, &[])[0];
    let names: Vec<&str> = accelerometer.amplitudes.iter().map(|amplitude| amplitude.name.as_str()).collect();
    assert_eq!(names, ["arm_x_m", "arm_y_m", "arm_z_m"]);
    // x of ω̇ × r + ω × (ω × r) for r along x, y, z.
    let formulas: [fn(f64) -> f64; 3] =
        [|t| -(wy(t).powi(2) + wz(t).powi(2)), |t| wx(t) * wy(t) - wz_dot(t), |t| wx(t) * wz(t) + wy_dot(t)];
    for (index, formula) in formulas.into_iter().enumerate() {
        let values = column(accelerometer, &[], index, scene.0.len());
        assert!(difference(&scene, &values, formula, 0.3) < 1e-4, "{}", names[index]);
    }
    // x of ω × r: nothing from r along x, which is left out.
    let doppler = &at(&inputs, "lever_arm", 2, &[])[0];
    let names: Vec<&str> = doppler.amplitudes.iter().map(|amplitude| amplitude.name.as_str()).collect();
    assert_eq!(names, ["arm_y_m", "arm_z_m"]);
    assert!(difference(&scene, &column(doppler, &[], 0, scene.0.len()), |t| -wz(t), 0.3) < 1e-9);
    assert!(difference(&scene, &column(doppler, &[], 1, scene.0.len()), wy, 0.3) < 1e-9);
}

#[test]
fn coning_is_what_a_rotation_vector_lacks() {
    const RATE: f64 = 0.05;
    const OMEGA: f64 = TAU * 2.0;
    let mut scene = Scene::new(MotionKind::Recorded, 6001, 0.005)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .sensor("a", SensorKind::Accelerometer, Unit::MicroG, [1.0, 0.0, 0.0]);
    scene.0.motion.rate =
        Some(scene.columns([|_| 0.3, |t| RATE * (OMEGA * t).cos(), |t| RATE * (OMEGA * t).sin()]));
    let inputs = Inputs::new(&scene.0);
    let found = at(&inputs, "coning_sculling", 0, &[]);
    for (frequency_hz, readings_s) in [(200.0, 0.005), (7.0, 29.0 * 0.005), (0.8, 1.25)] {
        let values = column(&found[0], &[frequency_hz], 0, scene.0.len());
        // ½ ∫ θ × ω dt/T with θ from the beginning of T, x = Ω T; the steady rate about the axis adds nothing.
        let x: f64 = OMEGA * readings_s;
        let expected = 0.5 * RATE * RATE / OMEGA * (1.0 - x.sin() / x);
        let settled = &values[300..];
        let error = settled.iter().map(|value| (value - expected).abs()).fold(0.0, f64::max) / expected;
        assert!(error < 2e-3, "{frequency_hz} Hz: off by {error:.2e}");
    }
    assert!(at(&inputs, "coning_sculling", 1, &[]).is_empty(), "no force was recorded");
}

/// A table that turns about one axis after the other, seconds apart, does not cone.
#[test]
fn turns_about_one_axis_are_no_coning() {
    let mut scene = Scene::new(MotionKind::Recorded, 6001, 0.05).sensor(
        "g",
        SensorKind::Fog,
        Unit::DegreePerHour,
        [0.0, 0.0, 1.0],
    );
    let turns: [fn(f64) -> f64; 3] = [
        |t| if (50.0..100.0).contains(&t) { 0.5 } else { 0.0 },
        |t| if (150.0..200.0).contains(&t) { -0.3 } else { 0.0 },
        |_| 7e-5,
    ];
    scene.0.motion.rate = Some(scene.columns(turns));
    let inputs = Inputs::new(&scene.0);
    let found = at(&inputs, "coning_sculling", 0, &[]);
    let values = column(&found[0], &[1.0], 0, scene.0.len());
    assert!(
        values.iter().all(|value| value.abs() < 1e-12),
        "{:e}",
        values.iter().fold(0.0_f64, |a, b| a.max(b.abs()))
    );
}

#[test]
fn heading_latitude_and_gravity_act_through_the_attitude() {
    let mut scene = Scene::new(MotionKind::Recorded, 7201, 1.0)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .sensor("a", SensorKind::Accelerometer, Unit::MicroG, [1.0, 0.0, 0.0])
        .site(50.0);
    let heading: fn(f64) -> f64 = |t| 0.002 * t;
    let pitch: fn(f64) -> f64 = |t| 0.3 * (0.001 * t).sin();
    scene.0.motion.attitude_rad = Some(scene.columns([|_| 0.0, pitch, heading]));
    let inputs = Inputs::new(&scene.0);
    let (sin, cos) = 50_f64.to_radians().sin_cos();
    let earth = 7.292_115e-5;
    let found = at(&inputs, "earth_rate_attitude", 0, &[("angle", "heading")]);
    let values = column(&found[0], &[], 0, scene.0.len());
    // x axis: u = Ω (cos φ cos ψ cos θ + sin φ sin θ).
    let formula = |t: f64| -earth * cos * heading(t).sin() * pitch(t).cos();
    assert!(difference(&scene, &values, formula, 0.0) < 1e-9);
    let found = at(&inputs, "earth_rate_attitude", 0, &[("angle", "latitude")]);
    let values = column(&found[0], &[], 0, scene.0.len());
    let formula = |t: f64| earth * (-sin * heading(t).cos() * pitch(t).cos() + cos * pitch(t).sin());
    assert!(difference(&scene, &values, formula, 0.0) < 1e-9);
    // A nose-up x axis feels gravity's reaction forwards: f = g sin θ.
    let found = at(&inputs, "gravity_anomaly", 1, &[]);
    let values = column(&found[0], &[], 0, scene.0.len());
    assert!(difference(&scene, &values, |t| pitch(t).sin(), 0.0) < 1e-9);
    // Without a recorded field, the Earth's dipole turns with the body.
    let found = at(&inputs, "bias_magnetic_field", 0, &[("axis", "y")]);
    let values = column(&found[0], &[], 0, scene.0.len());
    assert!(difference(&scene, &values, |t| -2.98e-5 * cos * heading(t).sin(), 0.0) < 1e-9);
}

#[test]
fn the_tide_is_longmans_with_utc_and_its_lines_without() {
    let mut scene = Scene::new(MotionKind::Static, 1441, 60.0)
        .sensor("a", SensorKind::Accelerometer, Unit::MicroG, [0.0, 0.0, 1.0])
        .site(-33.9);
    scene.0.case.motion.attitude_deg = Some(Attitude::default());
    {
        let inputs = Inputs::new(&scene.0);
        let found = at(&inputs, "earth_tide", 0, &[]);
        assert_eq!(found[0].amplitudes.len(), 4, "K1 and M2");
        let values = column(&found[0], &[], 2, scene.0.len());
        let rate = 28.984_104_f64.to_radians() / 3600.0;
        assert!(difference(&scene, &values, |t| (rate * t).cos(), 0.0) < 1e-9);
    }
    for time in &mut scene.0.time_s {
        *time += 932_045_400.0;
    }
    scene.0.case.site = Some(Site { latitude_deg: -33.9, longitude_deg: Some(151.2), altitude_m: 20.0 });
    let inputs = Inputs::new(&scene.0);
    let found = at(&inputs, "earth_tide", 0, &[]);
    assert_eq!(found[0].amplitudes.len(), 1);
    // From ephemerides (see the tide's own test): 82.29 µGal upward.
    let values = column(&found[0], &[], 0, scene.0.len());
    assert!((values[0] - 82.29e-8).abs() < 0.6e-8, "{}", values[0]);
    assert!(values.iter().fold(0.0_f64, |most, value| most.max(value.abs())) < 2e-6);
}

/// How warm a gyro is when a record of a turning body begins is not known; what rests before it turns is as warm as its surroundings. Any gyro
/// may be heated by its own rate, and by that about the other axis only one with two torquers.
#[test]
fn heat_from_before_a_record_is_not_known() {
    let turned: fn(f64) -> f64 = |t| if (100.0..300.0).contains(&t) { 0.5 } else { 0.0 };
    let names = |kind: SensorKind, rate: fn(f64) -> f64| -> Vec<(String, Vec<String>)> {
        let mut scene = Scene::new(MotionKind::Recorded, 6001, 0.1).sensor(
            "g",
            kind,
            Unit::DegreePerHour,
            [1.0, 0.0, 0.0],
        );
        scene.0.motion.rate = Some(scene.columns([rate, wy, wz]));
        let inputs = Inputs::new(&scene.0);
        let found = at(&inputs, "torquer_self_heating", 0, &[]);
        let of = |candidate: &Candidate| {
            let axis = candidate.variant.iter().map(|(_, value)| value.clone()).collect::<String>();
            (axis, candidate.amplitudes.iter().map(|amplitude| amplitude.name.clone()).collect())
        };
        if let [first, ..] = &found[..]
            && first.amplitudes.len() == 2
        {
            let start = column(first, &[50.0], 1, scene.0.len());
            assert!((start[1000] - (-2.0_f64).exp()).abs() < 1e-9, "{}", start[1000]);
        }
        found.iter().map(of).collect()
    };
    let unknown = || vec!["coefficient".to_owned(), "at_start".to_owned()];
    let known = || vec!["coefficient".to_owned()];
    assert_eq!(names(SensorKind::Fog, wx), [("input".to_owned(), unknown())]);
    assert_eq!(names(SensorKind::Fog, turned), [("input".to_owned(), known())]);
    assert_eq!(names(SensorKind::Dtg, wx), [("input".to_owned(), unknown()), ("both".to_owned(), unknown())]);
}

#[test]
fn hysteresis_knows_heating_from_cooling() {
    let cycles = |t: f64| 25.0 + 10.0 * (TAU * t / 20_000.0).sin();
    let scene = Scene::new(MotionKind::Static, 6000, 10.0)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", None, cycles);
    let inputs = Inputs::new(&scene.0);
    let found = at(&inputs, "bias_thermal_hysteresis", 0, &[]);
    let values = column(&found[0], &[0.5], 0, scene.0.len());
    // Where it has turned by more than twice the width: + while heating, − while cooling.
    for (row, value) in values.iter().enumerate() {
        let phase = (row as f64 * 10.0 / 20_000.0).fract();
        let expected = if (0.35..0.7).contains(&phase) { -1.0 } else { 1.0 };
        if (0.02..0.2).contains(&phase) || (0.35..0.7).contains(&phase) || phase > 0.85 {
            assert!((value - expected).abs() < 1e-6, "row {row}: {value}");
        }
    }
    // A warm-up that turns back by a tenth of the way shows narrow branches, and no wide ones.
    let warming = |t: f64| 20.0 + 10.0 * (1.0 - (-t / 6000.0).exp()) + 0.7 * (TAU * t / 12_000.0).sin();
    let scene = Scene::new(MotionKind::Static, 6000, 10.0)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", None, warming);
    let inputs = Inputs::new(&scene.0);
    let found = at(&inputs, "bias_thermal_hysteresis", 0, &[]);
    let Search::Grid { parameters, .. } = &found[0].search else { panic!("a width is sought") };
    assert!(parameters[0].grid.last().is_some_and(|&widest| (0.9..2.3).contains(&widest)), "{parameters:?}");
    // A single ramp has no turns.
    let scene = Scene::new(MotionKind::Static, 6000, 10.0)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", None, |t| 20.0 + 5e-4 * t);
    let inputs = Inputs::new(&scene.0);
    assert!(candidates(&inputs, "bias_thermal_hysteresis").is_empty());
    assert!(!candidates(&inputs, "bias_temperature").is_empty());
}

#[test]
fn runs_after_switch_on_have_their_own_constants_and_warm_up_again() {
    let mut scene = Scene::new(MotionKind::Static, 3000, 1.0).sensor(
        "g",
        SensorKind::Fog,
        Unit::DegreePerHour,
        [1.0, 0.0, 0.0],
    );
    let none = Inputs::new(&scene.0);
    assert!(candidates(&none, "bias_restart").is_empty());
    drop(none);
    scene.0.gaps.push(Gap { first: 1000, missing: 600, after_s: 999.0, before_s: 1600.0 });
    let inputs = Inputs::new(&scene.0);
    assert_eq!(inputs.run_starts, [0, 1600]);
    let found = at(&inputs, "bias_restart", 0, &[]);
    let values = column(&found[0], &[], 0, 3000);
    assert!(values.iter().enumerate().all(|(row, value)| *value == f64::from(u8::from(row >= 1600))));
    // Or the first run has one of its own as well.
    let values = column(&found[1], &[], 0, 3000);
    assert!(values.iter().enumerate().all(|(row, value)| *value == f64::from(u8::from(row < 1600))));
    // The instrument went on while nothing was recorded, or was switched on again.
    let found = at(&inputs, "bias_warmup", 0, &[]);
    let ways = [("before the record", (-17_f64).exp()), ("again after each long gap", (-1_f64).exp())];
    assert_eq!(found.len(), ways.len());
    for (candidate, (name, expected)) in found.iter().zip(ways) {
        assert_eq!(candidate.variant, [("switched_on", name.to_owned())]);
        let values = column(candidate, &[100.0], 0, 3000);
        assert!((values[1700] - expected).abs() < 1e-12, "{name}");
    }
    drop(inputs);
    // Off for a short while: another constant, perhaps, but as warm as before.
    scene.0.gaps[0] = Gap { first: 1000, missing: 10, after_s: 999.0, before_s: 1010.0 };
    let inputs = Inputs::new(&scene.0);
    assert_eq!(
        (inputs.run_starts.as_slice(), inputs.possible_run_starts.as_slice()),
        (&[0][..], &[0, 1010][..])
    );
    let values = column(&at(&inputs, "bias_restart", 0, &[])[0], &[], 0, 3000);
    assert!(values.iter().enumerate().all(|(row, value)| *value == f64::from(u8::from(row >= 1010))));
    drop(inputs);
    // A supply that was off tells it as well; one of a signal, or that flickers, does not.
    let off = |t: f64| (500.0..520.0).contains(&t) || (2000.0..2600.0).contains(&t);
    let scene = scene
        .aux("supply", Quantity::Voltage, "V", None, |t| if off(t) { 0.01 } else { 27.0 })
        .aux("signal", Quantity::Voltage, "V", None, |t| 5.0 * (t / 300.0).sin())
        .aux("flickers", Quantity::Voltage, "V", None, |t| if t % 100.0 < 1.0 { 0.0 } else { 5.0 });
    let inputs = Inputs::new(&scene.0);
    assert_eq!(inputs.run_starts, [0, 520, 2600]);
    assert_eq!(inputs.possible_run_starts, [0, 500, 1010, 2000]);
    let scene = Scene(Recording { auxiliaries: scene.0.auxiliaries[1..].to_vec(), ..scene.0.clone() });
    assert_eq!(Inputs::new(&scene.0).possible_run_starts, [0, 1010]);
}

#[test]
fn a_run_begins_where_it_is_stated_and_not_behind_a_dropout() {
    let scene = || {
        let of = Scene::new(MotionKind::Static, 3000, 0.005);
        of.sensor("g", SensorKind::MemsGyro, Unit::RadianPerSecond, [1.0, 0.0, 0.0])
    };
    let mut dropped = scene();
    // 12 to 65 ms, as a logger drops that waits for its card; and 6 s.
    for (first, missing) in [(100, 3), (400, 5), (900, 13)] {
        let after_s = (first - 1) as f64 * 0.005;
        let before_s = (first + missing) as f64 * 0.005;
        dropped.0.gaps.push(Gap { first, missing, after_s, before_s });
    }
    let none = Inputs::new(&dropped.0);
    assert_eq!((none.run_starts.as_slice(), none.possible_run_starts.as_slice()), (&[0][..], &[0][..]));
    assert!(candidates(&none, "bias_restart").is_empty());
    drop(none);
    dropped.0.gaps.push(Gap { first: 1200, missing: 1200, after_s: 5.995, before_s: 12.0 });
    assert_eq!(Inputs::new(&dropped.0).possible_run_starts, [0, 2400]);
    // What is stated takes the place of all guesses, and none is a statement.
    dropped.0.case.recording.switched_on_s = Some(vec![2.5, 7.501]);
    let stated = Inputs::new(&dropped.0);
    assert_eq!(stated.run_starts, [0, 500, 1501]);
    assert_eq!(stated.possible_run_starts, stated.run_starts);
    drop(stated);
    dropped.0.case.recording.switched_on_s = Some(Vec::new());
    assert_eq!(Inputs::new(&dropped.0).possible_run_starts, [0]);
}

#[test]
fn a_grade_is_stated_or_guessed_from_kind_and_noise_and_said() {
    // Standard deviations of a sample at 100 Hz, in °/s and mg.
    let gyro = |kind, white| {
        let mut scene = Scene::new(MotionKind::Unknown, 400, 0.01).sensor(
            "g",
            kind,
            Unit::DegreePerSecond,
            [1.0, 0.0, 0.0],
        );
        scene.0.sensors[0].sensor.nominal.white = f64::to_radians(white);
        scene
    };
    let graded = |scene: &Scene| Inputs::new(&scene.0).places[0].grade;
    for (kind, white, grade) in [
        (SensorKind::Rlg, 4e-4, Grade::Navigation),
        (SensorKind::Fog, 4e-4, Grade::Navigation),
        (SensorKind::Fog, 0.01, Grade::Tactical),
        (SensorKind::Fog, 1.0, Grade::Tactical),
        (SensorKind::MemsGyro, 1e-4, Grade::Tactical),
        (SensorKind::MemsGyro, 0.025, Grade::Tactical),
        (SensorKind::MemsGyro, 0.05, Grade::Mems),
    ] {
        assert_eq!(graded(&gyro(kind, white)), Some(grade), "{kind} of {white} °/s");
    }
    // Where no noise is stated, that of the readings: N of 0.005 °/√h in a ramp, whatever its slope.
    let mut unstated = gyro(SensorKind::Fog, 0.0);
    let scattered = |row: i32| f64::from(row * row * 31 % 997) / 997.0 - 0.5;
    let readings = (0..400).map(|row| f64::from(row) * 1e-3 + 5e-5 * scattered(row));
    unstated.0.sensors[0].values = readings.collect();
    assert_eq!(graded(&unstated), Some(Grade::Navigation));
    // An accelerometer is of the grade of the gyros it is built in with, whatever it reads; alone of that of its noise.
    let beside = gyro(SensorKind::MemsGyro, 0.05).sensor(
        "a",
        SensorKind::Accelerometer,
        Unit::MilliG,
        [1.0, 0.0, 0.0],
    );
    assert_eq!(Inputs::new(&beside.0).places[1].grade, Some(Grade::Mems));
    let said = schuler_explain::inputs::grade::said(&beside.0).unwrap();
    assert!(said.contains("guessed from kind and noise: mems (g, a);"), "{said}");
    for (white, grade) in [(0.1, Grade::Navigation), (1.0, Grade::Tactical), (10.0, Grade::Mems)] {
        let mut alone = Scene::new(MotionKind::Unknown, 400, 0.01).sensor(
            "a",
            SensorKind::Accelerometer,
            Unit::MilliG,
            [1.0, 0.0, 0.0],
        );
        alone.0.sensors[0].sensor.nominal.white = white * Unit::MilliG.in_si();
        assert_eq!(graded(&alone), Some(grade), "{white} mg");
    }
    // What is stated holds, and nothing is said of it.
    let mut stated = gyro(SensorKind::MemsGyro, 0.05);
    stated.0.sensors[0].sensor.grade = Some(Grade::Navigation);
    assert_eq!(graded(&stated), Some(Grade::Navigation));
    assert!(!Inputs::new(&stated.0).places[0].micromechanical);
    assert_eq!(schuler_explain::inputs::grade::said(&stated.0), None);
}

#[test]
fn a_schuler_oscillation_has_its_periods() {
    let scene = Scene::new(MotionKind::Static, 1441, 60.0)
        .sensor("v", SensorKind::InsVelocity, Unit::MetrePerSecond, [1.0, 0.0, 0.0])
        .site(45.0);
    let inputs = Inputs::new(&scene.0);
    let found = at(&inputs, "schuler_oscillation", 0, &[]);
    let values = column(&found[0], &[], 0, 1441);
    // √(R/g): 84.4 min.
    let period = 84.4 * 60.0;
    let turns = (TAU * 20_000.0 / period).cos();
    assert!((values[0] - 1.0).abs() < 1e-12);
    let row = 20_000 / 60;
    assert!((values[row] - (TAU * row as f64 * 60.0 / period).cos()).abs() < 0.02, "{} {turns}", values[row]);
    let day = column(&found[0], &[], 3, 1441);
    assert!((day[360] - 1.0).abs() < 1e-3, "a quarter of a day after the start the sine is 1: {}", day[360]);
}

#[test]
fn where_nothing_was_recorded_nothing_is_offered() {
    for (_, kind) in SensorKind::NAMES {
        let scene = bare(kind);
        let inputs = Inputs::new(&scene.0);
        for effect in CATALOGUE {
            let offered = (effect.candidates)(effect, &inputs);
            let expected =
                ALWAYS.contains(&effect.id) && effect.id != "bias_constant" && (effect.acts_on)(kind);
            assert_eq!(!offered.is_empty(), expected, "{} on {kind}", effect.id);
        }
        assert!(inputs.conditions().is_empty());
    }
}

#[test]
fn searches_without_signature_say_what_they_are() {
    let scene = turning();
    let inputs = Inputs::new(&scene.0);
    let step = &at(&inputs, "bias_step", 0, &[])[0];
    assert!(matches!(step.search, Search::Onset(OnsetShape::Step)));
    let ramps = at(&inputs, "bias_drift_linear", 0, &[]);
    let ramp =
        ramps.iter().find(|candidate| matches!(candidate.search, Search::Onset(OnsetShape::Ramp))).unwrap();
    assert_eq!(ramp.amplitudes[0].unit, "deg/h/h");
    let lines = at(&inputs, "periodic_line", 0, &[]);
    assert!(matches!(lines[0].search, Search::Frequency));
    assert_eq!(lines[0].amplitudes.len(), 2);
    for effect in CATALOGUE.iter().filter(|effect| effect.id.starts_with("noise_")) {
        let search = &(effect.candidates)(effect, &inputs)[0].search;
        assert!(matches!(search, Search::Noise(_)) || effect.id == "noise_outliers", "{}", effect.id);
    }
    for id in ["output_stuck", "output_saturated", "quantisation", "intermittent_jump", "noise_outliers"] {
        assert!(matches!(at(&inputs, id, 2, &[])[0].search, Search::Readings(_)), "{id}");
    }
}

#[test]
fn amplitudes_are_in_the_sensors_unit() {
    let scene = turning();
    let inputs = Inputs::new(&scene.0);
    let degree_per_hour = PI / 180.0 / 3600.0;
    let micro_g = 9.80665e-6;
    // Identifier, sensor, variant, one of the unit in SI, unit.
    let table: [(&str, usize, Variant<'_>, f64, &str); 14] = [
        ("bias_constant", 0, &[], degree_per_hour, "deg/h"),
        ("bias_constant", 1, &[], micro_g, "ug"),
        ("bias_temperature", 0, &[], degree_per_hour, "deg/h/K"),
        ("bias_temperature_rate", 0, &[], degree_per_hour * 3600.0, "deg/h/(K/h)"),
        ("bias_drift_linear", 0, &[], degree_per_hour / 3600.0, "deg/h/h"),
        ("bias_magnetic_field", 0, &[], degree_per_hour / 1e-4, "deg/h/G"),
        ("bias_pickoff_offset", 0, &[], degree_per_hour / 1e-3, "deg/h/mrad"),
        ("bias_on_aux", 0, &[("column", "I")], degree_per_hour, "deg/h/A"),
        ("scale_factor", 0, &[], 1e-6, "ppm"),
        ("scale_factor_quadratic", 1, &[], micro_g / 9.80665_f64.powi(2), "ug/g^2"),
        ("misalignment", 1, &[], PI / 648_000.0, "arcsec"),
        ("g_mass_unbalance", 0, &[], degree_per_hour / 9.80665, "deg/h/g"),
        ("g2_anisoelasticity", 0, &[], degree_per_hour / 9.80665_f64.powi(2), "deg/h/g^2"),
        ("anisoinertia", 0, &[], degree_per_hour, "deg/h/(rad/s)^2"),
    ];
    for (id, sensor, variant, in_si, unit) in table {
        let amplitude = &at(&inputs, id, sensor, variant)[0].amplitudes[0];
        assert_eq!(amplitude.unit, unit, "{id}");
        assert!((in_si * amplitude.in_unit - 1.0).abs() < 1e-12, "{id}: {}", amplitude.in_unit);
    }
}

/// Whatever the coefficient is per, and whether its unit has a slash of its own.
#[test]
fn an_amplitude_at_the_mean_is_in_the_unit_of_what_it_multiplies() {
    let mut scene = turning()
        .sensor("r", SensorKind::MemsGyro, Unit::RadianPerSecond, [1.0, 0.0, 0.0])
        .aux("n", Quantity::Other, "", None, line)
        .aux("v", Quantity::Other, "m/s", None, line);
    scene.0.sensors[0].sensor.nominal.temperature_bias = None;
    let inputs = Inputs::new(&scene.0);
    let degree_per_hour = PI / 180.0 / 3600.0;
    // Identifier, sensor, variant, one of the unit in SI, unit.
    let table: [(&str, usize, Variant<'_>, f64, &str); 13] = [
        ("bias_temperature", 0, &[("column", "T")], degree_per_hour, "deg/h"),
        ("bias_temperature", 3, &[], 1.0, "rad/s"),
        ("bias_temperature_gradient", 0, &[("reference", "*")], degree_per_hour, "deg/h"),
        ("bias_supply_voltage", 0, &[], degree_per_hour, "deg/h"),
        ("bias_pressure", 0, &[], degree_per_hour, "deg/h"),
        ("bias_magnetic_field", 0, &[], degree_per_hour, "deg/h"),
        ("bias_on_aux", 0, &[("column", "I")], degree_per_hour, "deg/h"),
        ("bias_on_aux", 0, &[("column", "v")], degree_per_hour, "deg/h"),
        ("bias_on_aux", 3, &[("column", "n")], 1.0, "rad/s"),
        ("bias_on_aux", 2, &[("column", "n")], 1.0, "m/s"),
        ("scale_factor_temperature", 0, &[], 1e-6, "ppm"),
        ("misalignment_temperature", 0, &[], PI / 648_000.0, "arcsec"),
        ("g_mass_unbalance_temperature", 0, &[], degree_per_hour / 9.80665, "deg/h/g"),
    ];
    for (id, sensor, variant, in_si, unit) in table {
        let named = |candidate: &Candidate, wanted: &(&str, &str)| {
            let mut variants = candidate.variant.iter();
            variants.any(|(name, value)| *name == wanted.0 && (wanted.1 == "*" || value == wanted.1))
        };
        let found = at(&inputs, id, sensor, &[]).into_iter();
        let mut found = found.filter(|candidate| variant.iter().all(|wanted| named(candidate, wanted)));
        let candidate = found.next().unwrap_or_else(|| panic!("{id} at {sensor}"));
        let at_mean = candidate.amplitudes.iter().find(|amplitude| amplitude.name == "at_mean");
        let at_mean = at_mean.unwrap_or_else(|| panic!("{id} at {sensor}: {:?}", candidate.variant));
        assert_eq!(at_mean.unit, unit, "{id} at {sensor}");
        assert!((in_si * at_mean.in_unit - 1.0).abs() < 1e-12, "{id} at {sensor}: {}", at_mean.in_unit);
    }
}

#[test]
fn plausible_magnitudes_are_in_the_unit_of_the_amplitude_and_wider_for_micromechanics() {
    for (kind, unit, expected) in [
        (SensorKind::Dtg, Unit::DegreePerHour, [0.01, 1.0]),
        (SensorKind::Dtg, Unit::DegreePerSecond, [0.01 / 3600.0, 1.0 / 3600.0]),
        (SensorKind::MemsGyro, Unit::DegreePerHour, [0.01, 1000.0]),
        (SensorKind::Accelerometer, Unit::MilliG, [0.01, 0.1]),
    ] {
        let mut scene =
            Scene::new(MotionKind::Static, 500, 1.0).sensor("s", kind, unit, [0.0, 0.0, 1.0]).site(50.0);
        scene.0.case.motion.attitude_deg = Some(Attitude::default());
        let inputs = Inputs::new(&scene.0);
        let plausible = at(&inputs, "bias_constant", 0, &[])[0].amplitudes[0].plausible.unwrap();
        for (found, expected) in plausible.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{kind} in {unit}: {plausible:?}");
        }
    }
}

#[test]
fn an_instrument_has_its_delay_arm_and_mounting_as_one() {
    let mut scene = turning();
    scene = scene.sensor("d2", SensorKind::Doppler, Unit::MetrePerSecond, [0.0, 1.0, 0.0]).sensor(
        "d3",
        SensorKind::Doppler,
        Unit::MetrePerSecond,
        [0.0, 0.0, 1.0],
    );
    for index in [2, 3, 4] {
        scene.0.sensors[index].sensor.group = Some("log".to_owned());
    }
    let inputs = Inputs::new(&scene.0);
    let group = |id: &str| -> Vec<Candidate> {
        (candidates(&inputs, id).into_iter())
            .filter(|candidate| matches!(&candidate.target, Target::Group { name, .. } if name == "log"))
            .collect()
    };
    let v = |t: f64| 5.0 + (0.4 * t).sin();
    let e = |t: f64| (0.3 * t).cos();
    let delay = &group("time_delay")[0];
    assert_eq!(delay.target, Target::Group { name: "log".to_owned(), sensors: vec![2, 3] }, "down is still");
    let parts = &signature(delay, &[0.5]).columns[0].parts;
    assert!(difference(&scene, &parts[0].1, |t| v(t - 0.5) - v(t), 1.0) < 1e-3);
    assert!(difference(&scene, &parts[1].1, |t| e(t - 0.5) - e(t), 1.0) < 1e-3);
    assert!(at(&inputs, "time_delay", 2, &[]).is_empty(), "a delay is the log's");
    // One gyro of a unit may be late alone.
    let mut unit = turning();
    unit.0.sensors.truncate(2);
    unit.0.sensors.iter_mut().for_each(|series| series.sensor.group = Some("unit".to_owned()));
    let late = candidates(&Inputs::new(&unit.0), "time_delay");
    assert!(late.iter().any(|candidate| candidate.target == Target::Sensor(0)));
    assert!(late.iter().any(|candidate| matches!(candidate.target, Target::Group { .. })));
    assert_eq!(group("lever_arm").len(), 1);
    assert_eq!(group("scale_factor").len(), 1);
    // ε × a for a = x: ε about z moves x towards y: reads ε v_y; about y towards −z.
    let mounting = &group("misalignment")[0];
    let about_z = mounting.amplitudes.iter().position(|amplitude| amplitude.name == "angle_z").unwrap();
    let parts = &signature(mounting, &[]).columns[about_z].parts;
    assert!(difference(&scene, &parts[0].1, e, 0.0) < 1e-12);
    assert!(difference(&scene, &parts[1].1, |t| -v(t), 0.0) < 1e-12);
    // About each axis alone as well: a mounting that is wrong about one is one number.
    for (name, about) in [("angle_x", 0), ("angle_y", 1), ("angle_z", 2)] {
        let alone: Vec<Candidate> = (group("misalignment").into_iter())
            .filter(|it| it.amplitudes.len() == 1 && it.amplitudes[0].name == name)
            .collect();
        let whole = signature(mounting, &[]);
        match (mounting.amplitudes.iter().position(|amplitude| amplitude.name == name), &alone[..]) {
            (Some(column), [alone]) => {
                let (of_one, of_all) = (&signature(alone, &[]).columns[0], &whole.columns[column]);
                assert_eq!(of_one.parts, of_all.parts, "{name}");
            }
            (None, []) => {}
            _ => panic!("{name} ({about}): {} alone", alone.len()),
        }
    }
}

#[test]
fn a_thermometer_at_another_sensor_still_makes_a_gradient() {
    let scene = Scene::new(MotionKind::Static, 4001, 1.0)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .sensor("h", SensorKind::Dtg, Unit::DegreePerHour, [0.0, 1.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", Some("g"), |t| 25.0 + 6.0 * (t / 600.0).sin())
        .aux("T_far", Quantity::Temperature, "degC", None, |t| 25.0 + 5.0 * (t / 600.0 - 0.4).sin())
        .aux("T_board", Quantity::Temperature, "degC", None, |t| 40.0 + 5.0 * (t / 700.0).sin());
    let inputs = Inputs::new(&scene.0);
    // The one at the other sensor does not tell this one's temperature, but the difference of both its gradient.
    assert_eq!(at(&inputs, "bias_temperature", 1, &[("column", "T_far")]).len(), 1);
    assert!(at(&inputs, "bias_temperature", 1, &[("column", "T")]).is_empty());
    for sensor in [0, 1] {
        let found = at(&inputs, "bias_temperature_gradient", sensor, &[]);
        // With the same sign for both.
        let told = at(&inputs, "bias_temperature_gradient", sensor, &[("column", "T_far - T")]);
        assert_eq!((found.len(), told.len()), (2, 2), "{sensor}");
        // The second about its mean, which is beside it.
        let [plain, about_mean] = [signature(&told[0], &[]), signature(&told[1], &[])];
        let values = |signature: &Signature, column: usize| signature.columns[column].parts[0].1.to_vec();
        let mean = values(&plain, 0).iter().sum::<f64>() / 4001.0;
        assert!((values(&about_mean, 0)[7] - (values(&plain, 0)[7] - mean)).abs() < 1e-9);
        assert_eq!((plain.columns.len(), values(&about_mean, 1)), (1, vec![1.0; 4001]));
    }
}

/// A body that is turned from pose to pose shows north and down by the rate and the specific force that are recorded of it.
#[test]
fn a_body_that_stands_now_and_then_shows_the_error_of_its_heading() {
    const LATITUDE_DEG: f64 = 50.0;
    let ned = earth::rotation_ned(LATITUDE_DEG.to_radians());
    let turn_rate = Vector3::new(0.02, -0.01, 0.03);
    let turns = |row: usize| (200..260).contains(&row) || (500..560).contains(&row);
    let mut attitude = body_to_ned(0.3, 0.2, 1.0);
    let mut scene = Scene::new(MotionKind::Recorded, 900, 1.0)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .site(LATITUDE_DEG);
    let (mut rate, mut force) = ([vec![], vec![], vec![]], [vec![], vec![], vec![]]);
    let mut expected = Vec::new();
    let gravity = earth::gravity(LATITUDE_DEG.to_radians(), 0.0);
    for row in 0..900 {
        let to_body = attitude.inverse();
        let turn = if turns(row) { turn_rate } else { Vector3::zeros() };
        let columns =
            [(&mut rate, to_body * ned + turn), (&mut force, to_body * Vector3::new(0.0, 0.0, -gravity))];
        for (columns, vector) in columns {
            columns.iter_mut().zip(vector.iter()).for_each(|(column, value)| column.push(*value));
        }
        expected.push(-(to_body * Vector3::new(0.0, ned.x, 0.0)).x);
        if turns(row) {
            attitude *= Rotation3::new(turn_rate);
        }
    }
    scene.0.motion.rate = Some(rate.clone());
    scene.0.motion.specific_force = Some(force.clone());
    let of_heading = |scene: &Scene| {
        let found = at(&Inputs::new(&scene.0), "earth_rate_attitude", 0, &[("angle", "heading")]);
        found.first().map(|found| column(found, &[], 0, 900))
    };
    let found = of_heading(&scene).unwrap();
    for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
        // The rate within a step is not known.
        let most = if turns(row) { 0.03 } else { 1e-9 };
        assert!((found - expected).abs() < most * ned.x, "{row}: {found:e} {expected:e}");
    }
    // One that never stands still does not.
    scene.0.motion.rate.as_mut().unwrap()[1].iter_mut().for_each(|rate| *rate += 1e-3);
    assert!(of_heading(&scene).is_none());
    scene.0.motion.rate = Some(rate);
    scene.0.motion.specific_force.as_mut().unwrap()[1].iter_mut().for_each(|force| *force += 5.0);
    assert!(of_heading(&scene).is_none());
}

#[test]
fn powers_reach_a_reference_far_from_the_record_and_a_steady_rate_is_not_passed_over() {
    let scene = Scene::new(MotionKind::Static, 4001, 1.0)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", Some("g"), |t| 40.0 + 6.0 * t / 4000.0);
    let inputs = Inputs::new(&scene.0);
    for id in ["bias_temperature_sq", "bias_temperature_cubic"] {
        let found = at(&inputs, id, 0, &[]);
        let Search::Grid { parameters, .. } = &found[0].search else {
            panic!("{id}: no reference is searched")
        };
        let grid = &parameters[0].grid;
        assert!(grid.first().unwrap() < &20.0 && grid.last().unwrap() > &60.0, "{id}: {grid:?}");
        signature(&found[0], &[20.0]);
    }
    assert_eq!(at(&inputs, "bias_temperature_rate", 0, &[]).len(), 1);

    // Over less than it takes to see one well they are offered all the same.
    let scene = Scene::new(MotionKind::Static, 4001, 1.0)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", Some("g"), |t| 20.0 + 3.0 * t / 4000.0);
    let inputs = Inputs::new(&scene.0);
    for id in ["bias_temperature_sq", "bias_temperature_cubic"] {
        assert!(!at(&inputs, id, 0, &[]).is_empty(), "{id}");
    }
}

#[test]
fn lags_from_far_below_a_step_to_beyond_what_is_plausible_are_searched() {
    let scene = turning();
    let inputs = Inputs::new(&scene.0);
    for id in ["bandwidth_lag", "time_delay"] {
        let found = at(&inputs, id, 0, &[]);
        let Search::Grid { parameters, .. } = &found[0].search else { panic!("{id}: no grid") };
        let least = parameters[0].grid.iter().map(|value| value.abs()).fold(f64::INFINITY, f64::min);
        assert!(least <= 1e-5, "{id}: {least}");
        assert!(parameters[0].grid.last().unwrap() > &1.5, "{id}");
    }
    // τ far below a step: −τ ω̇.
    let values = column(&at(&inputs, "bandwidth_lag", 0, &[])[0], &[1e-4], 0, inputs.rows());
    assert!(difference(&scene, &values, |t| -1e-4 * wx_dot(t), 5.0) < 2e-2);
}

/// A vessel that sways within three steps, read half a step early: four rows about the time have 63 % of the sway.
#[test]
fn a_late_velocity_keeps_what_sways_within_a_few_steps() {
    let sway: fn(f64) -> f64 = |t| 2.0 + 0.05 * (2.2 * t).sin();
    let still: fn(f64) -> f64 = |_| 0.0;
    let mut scene = Scene::new(MotionKind::Recorded, 401, 1.0).sensor(
        "d",
        SensorKind::Doppler,
        Unit::MetrePerSecond,
        [1.0, 0.0, 0.0],
    );
    scene.0.motion.attitude_rad = Some(scene.columns([still, still, still]));
    scene.0.motion.velocity_ned = Some(scene.columns([sway, still, still]));
    let inputs = Inputs::new(&scene.0);
    let values = column(&at(&inputs, "time_delay", 0, &[])[0], &[-0.5], 0, inputs.rows());
    let moved = |t: f64| 2.0 + 0.05 * (2.2 * (t + 0.5)).sin() - (2.0 + 0.05 * (2.2 * t).sin());
    let off = (20..380).map(|row| (values[row] - moved(row as f64)).abs()).fold(0.0, f64::max);
    assert!(off < 0.05 * 0.02, "{off}");
}

/// Of two instruments that are each other's reference the one comes early where the other comes late; beside a known motion an instrument
/// comes early where the reference is late.
#[test]
fn instruments_that_check_each_other_come_late_and_never_early() {
    let of = |scene: Scene| scene.sensor("d", SensorKind::Doppler, Unit::MetrePerSecond, [1.0, 0.0, 0.0]);
    let mut scene = of(Scene::new(MotionKind::Unknown, 401, 1.0));
    scene = scene.sensor("ins", SensorKind::InsVelocity, Unit::MetrePerSecond, [1.0, 0.0, 0.0]);
    for series in &mut scene.0.sensors {
        series.values = (0..401).map(|row| (0.05 * f64::from(row)).sin()).collect();
    }
    let still: fn(f64) -> f64 = |_| 0.0;
    let mut known = of(Scene::new(MotionKind::Recorded, 401, 1.0));
    known.0.motion.attitude_rad = Some(known.columns([still, still, still]));
    known.0.motion.velocity_ned = Some(known.columns([|t| (0.05 * t).sin(), still, still]));
    for (scene, sensors, comes_early) in [(scene, 2, false), (known, 1, true)] {
        let inputs = Inputs::new(&scene.0);
        for sensor in 0..sensors {
            let found = at(&inputs, "time_delay", sensor, &[]);
            let Search::Grid { parameters, .. } = &found[0].search else { panic!("no grid") };
            assert_eq!(parameters[0].grid.iter().any(|delay| *delay < 0.0), comes_early, "{sensor}");
        }
    }
}

#[test]
fn a_schuler_loop_has_accelerometer_gyro_and_velocity() {
    let mut scene = Scene::new(MotionKind::VelocityError, 7201, 1.0)
        .sensor("dv", SensorKind::InsVelocity, Unit::MetrePerSecond, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", None, |t| 25.0 + 5.0 * (t / 1500.0).sin())
        .aux("Tg", Quantity::Temperature, "degC", Some("gyro"), |t| 25.0 + 5.0 * (t / 1500.0).cos());
    scene.0.case.schuler_loop = Some(SchulerLoop::default());
    scene.0.motion.specific_force = Some(scene.columns([fx, fy, fz]));
    scene.0.motion.velocity_ned =
        Some(scene.columns([|t| 100.0 + 10.0 * (0.01 * t).sin(), |_| 0.0, |_| 0.0]));
    let inputs = Inputs::new(&scene.0);
    let names: Vec<&str> = inputs.places.iter().map(|place| place.name.as_str()).collect();
    assert_eq!(names, ["accelerometer", "gyro", "velocity"]);
    let ports = |id: &str| -> Vec<Port> { candidates(&inputs, id).iter().map(|found| found.port).collect() };
    assert_eq!(ports("bias_constant"), [Port::Accelerometer, Port::Gyro, Port::Output]);
    assert_eq!(ports("bias_temperature"), [Port::Accelerometer, Port::Gyro]);
    assert_eq!(ports("g_mass_unbalance"), [Port::Gyro]);
    assert_eq!(ports("scale_factor"), [Port::Accelerometer, Port::Output]);
    assert_eq!(ports("scale_factor_quadratic"), [Port::Accelerometer, Port::Output]);
    assert!(ports("time_delay").contains(&Port::Output));
    let mut grouped = Recording::clone(&scene.0);
    grouped.sensors[0].sensor.group = Some("channel".to_owned());
    let delays = candidates(&Inputs::new(&grouped), "time_delay");
    assert!(
        delays.iter().any(|found| found.port == Port::Output),
        "its group takes nothing from the loop's velocity"
    );
    assert_eq!(ports("noise_outliers"), [Port::Output]);
    let by_column: Vec<_> = (candidates(&inputs, "bias_temperature").iter())
        .map(|found| found.variant.iter().find(|(name, _)| *name == "column").unwrap().1.clone())
        .collect();
    assert_eq!(by_column, ["T", "Tg"], "a thermometer near the gyro is the gyro's");
    // A speed beside it is the velocity of which the channel has an error, if no velocity is there.
    let mut scene =
        Scene(scene.0.clone()).aux("speed", Quantity::Speed, "m/s", None, |t| 20.0 + 2.0 * (0.01 * t).cos());
    let of_velocity = |scene: &Scene| {
        let found = candidates(&Inputs::new(&scene.0), "scale_factor");
        let own = found.iter().find(|found| found.port == Port::Output);
        own.map(|own| column(own, &[], 0, 7201)[100])
    };
    assert!((of_velocity(&scene).unwrap() - (100.0 + 10.0 * 1.0_f64.sin())).abs() < 1e-9);
    scene.0.motion.velocity_ned = None;
    assert!((of_velocity(&scene).unwrap() - (20.0 + 2.0 * 1.0_f64.cos())).abs() < 1e-9);
    scene.0.auxiliaries.pop();
    assert!(of_velocity(&scene).is_none());
    assert_eq!(candidates(&inputs, "bias_temperature")[0].amplitudes[0].unit, "m/s^2/K");
}

#[test]
fn redundant_sensors_tell_the_motion_that_no_one_knows() {
    // A radio beside an inertial velocity: the better one leads.
    let mut scene = Scene::new(MotionKind::Unknown, 1000, 1.0)
        .sensor("ins", SensorKind::InsVelocity, Unit::MetrePerSecond, [1.0, 0.0, 0.0])
        .last(|sensor| sensor.nominal.white = 0.01)
        .sensor("radio", SensorKind::Doppler, Unit::MetrePerSecond, [1.0, 0.0, 0.0]);
    let truth = |t: f64| 50.0 + 5.0 * (0.05 * t).sin();
    let noise = |t: f64, of: f64| 12.0_f64.sqrt() * (((t * of).sin() * 43_758.545_3).fract().abs() - 0.5);
    scene.0.sensors[0].values = scene.sample(|t| truth(t) + 0.01 * noise(t, 12.9898));
    scene.0.sensors[1].values = scene.sample(|t| truth(t) + 3.0 + noise(t, 78.233));
    scene.0.sensors[1].values[500] = f64::NAN;
    let inputs = Inputs::new(&scene.0);
    let values = column(&at(&inputs, "scale_factor", 1, &[])[0], &[], 0, 1000);
    // Smoothed, within the noise of the better one: in the mean square, and three of it in any row.
    let expected = |t: f64| truth(t) + 3.0 / 10_001.0;
    let squares = scene.0.elapsed_s().zip(&values).map(|(t, found)| (found - expected(t)).powi(2));
    assert!((squares.sum::<f64>() / 1000.0).sqrt() < 0.01);
    assert!(difference(&scene, &values, expected, 0.0) < 0.03 / 55.0);

    // Five gyros on a cone: the estimate is the rate, though one of them is absent for a while.
    let mut scene = Scene::new(MotionKind::Unknown, 1000, 1.0);
    let axes: Vec<[f64; 3]> = (0..5)
        .map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 5.0).sin_cos();
            [0.8 * cos, 0.8 * sin, 0.6]
        })
        .collect();
    for (index, axis) in axes.iter().enumerate() {
        scene = scene.sensor(&format!("g{index}"), SensorKind::Dtg, Unit::DegreePerHour, *axis);
        let [x, y, z] = *axis;
        // Nothing to smooth.
        scene.0.sensors[index].sensor.nominal.white = 0.0;
        scene.0.sensors[index].values = scene.sample(|t| x * wx(t) + y * wy(t) + z * wz(t));
    }
    scene.0.sensors[2].values[100..300].fill(f64::NAN);
    let inputs = Inputs::new(&scene.0);
    let rate = inputs.motion.rate.as_ref().unwrap();
    assert!(difference(&scene, &rate[0], wx, 0.0) < 1e-9);
    assert!(difference(&scene, &rate[2], wz, 0.0) < 1e-9);
    assert_eq!(candidates(&inputs, "scale_factor").len(), 5);
    assert!(!inputs.conditions().is_empty());
}

#[test]
fn every_signature_is_finite_whatever_is_missing() {
    let mut scene = turning();
    for axis in scene.0.motion.rate.iter_mut().flatten() {
        axis[100..200].fill(f64::NAN);
    }
    for axis in scene.0.motion.attitude_rad.iter_mut().flatten() {
        axis[..50].fill(f64::NAN);
    }
    for series in &mut scene.0.auxiliaries {
        series.values[3000..3500].fill(f64::NAN);
        series.values[6000] = f64::INFINITY;
    }
    let inputs = Inputs::new(&scene.0);
    let mut seen = 0;
    for effect in CATALOGUE {
        for candidate in (effect.candidates)(effect, &inputs) {
            let grid: Vec<f64> = match &candidate.search {
                Search::Grid { parameters, .. } => {
                    parameters.iter().map(|parameter| *parameter.grid.last().unwrap()).collect()
                }
                Search::Linear(_) => Vec::new(),
                _ => continue,
            };
            for index in 0..candidate.amplitudes.len() {
                column(&candidate, &grid, index, scene.0.len());
                seen += 1;
            }
        }
    }
    assert!(seen > 80, "{seen}");
}

/// Cases in which something varies, but not what the effect needs.
#[test]
fn an_effect_is_not_offered_where_its_own_need_is_not_met() {
    let offered = |scene: &Scene, id: &str| {
        let inputs = Inputs::new(&scene.0);
        !candidates(&inputs, id).is_empty()
    };
    let mut scene = Scene::new(MotionKind::Recorded, 4001, 1.0)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .sensor("a", SensorKind::Accelerometer, Unit::MicroG, [0.0, 0.0, 1.0])
        .aux("T", Quantity::Temperature, "degC", None, |t| 25.0 + 0.5 * (t / 600.0).sin());
    scene.0.motion.rate = Some(scene.columns([|t| 0.5 + 0.1 * (0.02 * t).sin(), |_| 0.0, |_| 0.0]));
    scene.0.motion.specific_force =
        Some(scene.columns([|_| 0.0, |_| 0.0, |t| -9.8 + 0.1 * (0.01 * t).sin()]));
    for id in [
        "bias_temperature",
        "bias_temperature_rate",
        "dead_zone",
        "scale_factor",
        "scale_factor_temperature",
        "g_spin",
    ] {
        assert!(offered(&scene, id), "{id}: the temperature, one rate and one force vary");
    }
    for (id, why) in [
        ("bias_temperature_sq", "1 K is not enough"),
        ("bias_temperature_cubic", "1 K is not enough"),
        ("bias_temperature_gradient", "one thermometer"),
        ("bias_electronics_temperature", "no thermometer there"),
        ("scale_factor_asymmetry", "one sign"),
        ("scale_factor_odd_quadratic", "one sign"),
        ("misalignment_temperature", "nothing across"),
        ("cross_coupling", "one force"),
        ("g_mass_unbalance", "no force along the axis"),
        ("g_quadrature", "no force along the other axis"),
        ("g2_anisoelasticity", "one force"),
        ("g2_cross", "one force"),
        ("anisoinertia", "one rate"),
        ("rate_cross_axis", "one rate"),
        ("coning_sculling", "one rate"),
        ("earth_rate_attitude", "no attitude"),
        ("gravity_anomaly", "no attitude"),
        ("earth_tide", "an hour, no attitude"),
        ("schuler_oscillation", "no inertial velocity"),
        ("bias_restart", "one run"),
    ] {
        assert!(!offered(&scene, id), "{id}: {why}");
    }
    // Any gyro may feel the force.
    let optical = scene.sensor("f", SensorKind::Fog, Unit::DegreePerHour, [0.0, 0.0, 1.0]);
    let inputs = Inputs::new(&optical.0);
    assert_eq!(at(&inputs, "g_mass_unbalance", 2, &[]).len(), 1);
    let scene = optical;
    // A dead zone that nothing passes is one, and one between inputs is found between them.
    let inputs = Inputs::new(&scene.0);
    let zone = at(&inputs, "dead_zone", 0, &[]);
    let Search::Grid { parameters, .. } = &zone[0].search else { panic!("a threshold is searched") };
    let largest = *parameters[0].grid.last().unwrap();
    let all = column(&zone[0], &[largest], 0, scene.0.time_s.len());
    assert!(all.iter().all(|value| (-0.61..=-0.39).contains(value)), "nothing passes");
    // A coarse thermometer that dithers over one step says nothing of the temperature.
    let coarse = Scene::new(MotionKind::Static, 4000, 1.0)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", None, |t| 25.0 + 0.5 * ((t * 0.37).sin().round()));
    assert!(!offered(&coarse, "bias_temperature"));
    // A voltage that flickers between two counts neither.
    let flicker = Scene::new(MotionKind::Static, 4000, 1.0)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("V", Quantity::Voltage, "V", None, |t| {
            5.0 + 0.01 * (f64::from(u8::from((t * 0.37).sin() > 0.0)))
        });
    assert!(!offered(&flicker, "bias_supply_voltage"));
    // One that was switched does.
    let switched = Scene::new(MotionKind::Static, 4000, 1.0)
        .sensor("g", SensorKind::Fog, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .aux("V", Quantity::Voltage, "V", None, |t| if (1000.0..2500.0).contains(&t) { 5.5 } else { 5.0 });
    assert!(offered(&switched, "bias_supply_voltage"));
}
