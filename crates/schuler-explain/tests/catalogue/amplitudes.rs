//! Units and plausible magnitudes of amplitudes.
use std::f64::consts::PI;

use schuler_explain::catalogue::Candidate;
use schuler_explain::inputs::Inputs;
use schuler_recording::case::{Attitude, Grade, MotionKind, Quantity, SensorKind};
use schuler_recording::unit::Unit;

use crate::formulas::Variant;
use crate::scene::{Scene, at, line, turning};

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
fn plausible_magnitudes_are_in_the_unit_of_the_amplitude_and_wider_for_lesser_grades() {
    // Of gyros at rest 1 °/h, 100 °/h, and ±20 °/s by data sheets of micromechanical ones.
    for (kind, grade, unit, expected) in [
        (SensorKind::Dtg, Grade::Navigation, Unit::DegreePerHour, [0.01, 1.0]),
        (SensorKind::Dtg, Grade::Navigation, Unit::DegreePerSecond, [0.01 / 3600.0, 1.0 / 3600.0]),
        (SensorKind::Fog, Grade::Tactical, Unit::DegreePerHour, [0.01, 100.0]),
        (SensorKind::MemsGyro, Grade::Mems, Unit::DegreePerHour, [0.01, 1e5]),
        (SensorKind::Accelerometer, Grade::Navigation, Unit::MilliG, [0.01, 0.1]),
        (SensorKind::Accelerometer, Grade::Tactical, Unit::MilliG, [0.01, 1.0]),
        (SensorKind::Accelerometer, Grade::Mems, Unit::MilliG, [0.01, 100.0]),
    ] {
        let mut scene =
            Scene::new(MotionKind::Static, 500, 1.0).sensor("s", kind, unit, [0.0, 0.0, 1.0]).site(50.0);
        scene.0.case.motion.attitude_deg = Some(Attitude::default());
        scene.0.sensors[0].sensor.grade = Some(grade);
        let inputs = Inputs::new(&scene.0);
        let plausible = at(&inputs, "bias_constant", 0, &[])[0].amplitudes[0].plausible.unwrap();
        for (found, expected) in plausible.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{kind} in {unit}: {plausible:?}");
        }
    }
}
