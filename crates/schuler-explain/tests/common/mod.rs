//! Recordings at 1 Hz without a file.
use schuler_recording::Recording;
use schuler_recording::case::{Case, Motion, MotionKind, Nominal, Sensor, SensorKind, Source};
use schuler_recording::recording::{MotionSeries, Quality, SensorSeries};
use schuler_recording::unit::Unit;

/// Readings of a sensor, in SI units.
pub fn series(
    id: &str,
    kind: SensorKind,
    unit: Unit,
    axis: [f64; 3],
    nominal: Nominal,
    values: Vec<f64>,
) -> SensorSeries {
    SensorSeries {
        sensor: Sensor { axis: Some(axis), ..Sensor::new(id, kind, unit, nominal) },
        written_unit: unit,
        values,
        predicted: None,
        quality: Quality::default(),
    }
}

/// A recording of nothing but sensors in a kind of motion.
pub fn recording(motion: MotionKind, sensors: Vec<SensorSeries>) -> Recording {
    let rows = sensors.first().map_or(0, |series| series.values.len());
    Recording {
        case: Case {
            title: String::new(),
            recording: Source {
                path: "x.csv".into(),
                time: Some("t".to_owned()),
                step_s: Some(1.0),
                ..Source::default()
            },
            site: None,
            simulation: None,
            motion: Motion { kind: motion, ..Motion::default() },
            schuler_loop: None,
            sensors: sensors.iter().map(|series| series.sensor.clone()).collect(),
            auxiliaries: Vec::new(),
            effects: Vec::new(),
            calibration: None,
        },
        step_s: 1.0,
        time_s: (0..rows).map(|row| row as f64).collect(),
        inserted: vec![false; rows],
        gaps: Vec::new(),
        sensors,
        auxiliaries: Vec::new(),
        motion: MotionSeries::default(),
        table_angle: None,
        in_formulas: Vec::new(),
        warnings: Vec::new(),
    }
}
