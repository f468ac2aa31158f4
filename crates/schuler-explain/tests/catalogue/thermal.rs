//! Effects of temperature, of its history and of switching on.
use std::f64::consts::TAU;

use schuler_explain::catalogue::{Candidate, Search, Signature};
use schuler_explain::inputs::Inputs;
use schuler_recording::Recording;
use schuler_recording::case::{MotionKind, Quantity, SensorKind};
use schuler_recording::recording::Gap;
use schuler_recording::unit::Unit;

use crate::scene::{Scene, at, candidates, column, signature, wx, wy, wz};

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
