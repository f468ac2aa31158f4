//! Real logs of thermometers, where they are at hand.
use std::fs::File;
use std::path::PathBuf;

use flate2::read::GzDecoder;

/// Temperatures, degC, of a log in the folder of real recordings (`SCHULER_DATA`, else `../shared/data` beside the
/// project); `None`, and a loud line, where it is absent.
///
/// # Panics
/// On a log that is there but cannot be read.
pub fn temperatures(name: &str) -> Option<Vec<f64>> {
    let root = std::env::var_os("SCHULER_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let path = root.join(name);
    let Ok(file) = File::open(&path) else {
        eprintln!("SKIPPED: no real recording at {} (set SCHULER_DATA)", path.display());
        return None;
    };
    let mut reader = csv::Reader::from_reader(GzDecoder::new(file));
    let column =
        reader.headers().expect("a header").iter().position(|h| h == "T_degC").expect("a column T_degC");
    let values = reader.records().map(|r| r.expect("a row")[column].parse().expect("a temperature"));
    Some(values.collect())
}

/// Rate, degC/s, by a parabola fitted to the samples within `half` of each, a sample a second: a reference that
/// looks ahead and sees every unquantised sample. `NaN` within `half` of the ends.
pub fn smooth_rate(samples: &[f64], half: usize) -> Vec<f64> {
    let k2: f64 = (1..=half).map(|k| 2.0 * (k * k) as f64).sum();
    let at = |t: usize| -> f64 {
        if t < half || t + half >= samples.len() {
            return f64::NAN;
        }
        (1..=half).map(|k| k as f64 * (samples[t + k] - samples[t - k])).sum::<f64>() / k2
    };
    (0..samples.len()).map(at).collect()
}
