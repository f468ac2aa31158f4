//! Which effects there are, and where each is offered.
use schuler_explain::catalogue::{CATALOGUE, OnsetShape, Search};
use schuler_explain::inputs::Inputs;
use schuler_recording::case::{MotionKind, Quantity, SensorKind};
use schuler_recording::unit::Unit;

use crate::scene::{Scene, at, bare, candidates, column, turning};

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
