//! Real recordings through the reader and through the prediction of an ideal sensor's output.
//!
//! They look for the recordings in `SCHULER_DATA`, else in `../shared/data` beside the project.
use std::path::{Path, PathBuf};

use schuler_recording::motion::{Prediction, Use, inertial_rate, predict};
use schuler_recording::{Recording, table};

fn data(name: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let path = std::env::var_os("SCHULER_DATA").map_or_else(beside, PathBuf::from).join(name);
    if !path.exists() {
        eprintln!("SKIPPED: no real recording at {} (set SCHULER_DATA)", path.display());
        return None;
    }
    Some(path)
}

fn read(path: &Path) -> Recording {
    Recording::read(path).unwrap_or_else(|error| panic!("{error:#}"))
}

/// Mean and standard deviation of the values that are there.
fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let present: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let mean = present.iter().sum::<f64>() / present.len() as f64;
    let square = present.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / present.len() as f64;
    (mean, square.sqrt())
}

#[test]
fn every_case_is_read_as_its_readme_describes_it() {
    let cases = [
        ("auv_doppler_ins/leg01.toml", 400, 0, 3),
        ("auv_doppler_ins/leg06.toml", 400, 0, 3),
        ("mems_static/run1.toml", 10_000, 0, 6),
        ("mems_static/run3.toml", 10_000, 0, 6),
        ("quartz_gravimeter/segment_22h.toml", 1184, 0, 1),
        // 105 s between two stamps of the 62 h: one step is missing. 91 and 95 s are late stamps.
        ("quartz_gravimeter/segment_62h.toml", 3402, 1, 1),
    ];
    for (case, rows, in_gaps, sensors) in cases {
        let Some(path) = data(case) else { continue };
        let recording = read(&path);
        assert_eq!((recording.len(), recording.sensors.len()), (rows, sensors), "{case}");
        assert_eq!(recording.inserted.iter().filter(|&&inserted| inserted).count(), in_gaps, "{case}");
        assert!(recording.warnings.is_empty(), "{case}: {:?}", recording.warnings);
        for sensor in &recording.sensors {
            assert_eq!(sensor.quality.present, rows - in_gaps, "{case}: {}", sensor.sensor.id);
        }
    }
}

/// The log's velocity is the inertial system's, turned into body axes by the recorded attitude. What is left is the log's
/// own errors (its lever arm and delay among them, as the vehicle turns); a wrong sign or order of rotations would leave
/// errors of the size of the speed, about 2 m/s.
#[test]
fn the_doppler_log_of_an_underwater_vehicle_is_predicted_to_a_seventh_of_its_speed() {
    for leg in 1..=6 {
        let Some(path) = data(&format!("auv_doppler_ins/leg{leg:02}.toml")) else { continue };
        let recording = read(&path);
        for sensor in &recording.sensors {
            let Ok(Prediction::Series(predicted)) = predict(&recording, &sensor.sensor) else {
                panic!("leg {leg}: {} is not predicted", sensor.sensor.id)
            };
            let errors: Vec<f64> = sensor.values.iter().zip(&predicted).map(|(a, b)| a - b).collect();
            let (mean, deviation) = mean_and_deviation(&errors);
            println!("leg {leg}, {}: mean {mean:.4} m/s, deviation {deviation:.4} m/s", sensor.sensor.id);
            assert!(mean.abs() < 0.1 && deviation < 0.3, "leg {leg}: {}", sensor.sensor.id);
        }
    }
}

/// A car's gyros against the rate derived from the attitude of a fibre-optic inertial system on the same body: body axes
/// right, forward, up and yaw counter-clockwise from north there, forward, right, down and clockwise here.
#[test]
fn the_rate_derived_from_attitude_is_what_a_cars_gyros_read() {
    let (Some(reference), Some(gyros)) =
        (data("vehicle_fog_mems/fog_ins_10Hz.csv.gz"), data("vehicle_fog_mems/mems_100Hz_increments.csv.gz"))
    else {
        return;
    };
    let columns = |path: &Path, names: &[&str]| {
        let table = table::open(path).expect("a table");
        let wanted: Vec<usize> =
            names.iter().map(|name| table::column_index(table.names(), name).expect("a column")).collect();
        table.read(&wanted).expect("numbers").values
    };
    let attitude = columns(&reference, &["t_s", "pitch_rad", "roll_rad", "yaw_rad", "lat_rad"]);
    let [time_s, pitch, roll, yaw, latitude] = attitude.as_slice() else { panic!("five columns") };
    let clockwise: Vec<f64> = yaw.iter().map(|yaw| -yaw).collect();
    let attitude = [roll.clone(), pitch.clone(), clockwise];
    let rate = inertial_rate(time_s, &attitude, None, latitude[0], 0.0, Use::Prediction);

    let increments = columns(&gyros, &["t_s", "dthx_rad", "dthy_rad", "dthz_rad"]);
    let [gyro_time_s, right, forward, up] = increments.as_slice() else { panic!("four columns") };
    // Forward, right, down.
    for (axis, (derived, (read, sign))) in
        ["forward", "right", "down"].iter().zip(rate.iter().zip([(forward, 1.0), (right, 1.0), (up, -1.0)]))
    {
        // Means of the gyro over the step of the reference about each of its rows.
        let pairs: Vec<(f64, f64)> = (time_s.iter().zip(derived))
            .filter_map(|(&time, &derived)| {
                let from = gyro_time_s.partition_point(|&gyro| gyro < time - 0.05);
                let angles = read.get(from..from + 10)?;
                Some((derived, sign * angles.iter().sum::<f64>() / 0.1))
            })
            .filter(|(derived, _)| derived.is_finite())
            .collect();
        let (derived, read): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
        let ((mean_a, deviation_a), (mean_b, deviation_b)) =
            (mean_and_deviation(&derived), mean_and_deviation(&read));
        let product: f64 = derived.iter().zip(&read).map(|(a, b)| (a - mean_a) * (b - mean_b)).sum();
        let correlation = product / derived.len() as f64 / (deviation_a * deviation_b);
        println!(
            "{axis}: correlation {correlation:.4}, deviations {deviation_a:.5} and {deviation_b:.5} rad/s"
        );
        assert!(correlation > 0.9, "{axis}: {correlation}");
        assert!((deviation_a / deviation_b - 1.0).abs() < 0.15, "{axis}: {deviation_a} {deviation_b}");
    }
}
