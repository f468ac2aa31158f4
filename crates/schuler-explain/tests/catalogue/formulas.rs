//! Signatures against their formulas in closed form.
use std::f64::consts::TAU;

use schuler_explain::catalogue::Search;
use schuler_explain::inputs::Inputs;
use schuler_recording::case::{Attitude, MotionKind, Quantity, SensorKind, Site};
use schuler_recording::unit::Unit;

use crate::scene::{
    Scene, at, column, difference, fx, fy, fz, line, mean, signature, temperature, turning, vibration, wx,
    wx_dot, wy, wy_dot, wz, wz_dot,
};

/// Names and values of a variant.
pub type Variant<'v> = &'v [(&'v str, &'v str)];

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
