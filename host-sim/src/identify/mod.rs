//! `schuler identify`: the noise of each sensor of a recording.
//!
//! | module | computes |
//! | --- | --- |
//! | [`series`] | the error series: readings less the ideal sensor's output |
//! | [`spikes`] | single readings far from those around them, which are set aside first |
//! | [`trend`] | mean and straight line |
//! | [`mod@autocorrelation`] | unbiased autocorrelation over gaps |
//! | [`allan`] | overlapping Allan deviation with χ² intervals |
//! | [`power_law`] | quantisation, random walk, bias instability, rate random walk, ramp |
//! | [`published`] | the published read-out of the autocorrelation, on block means |
//! | [`likelihood`] | restricted maximum likelihood of white, Markov, exponential-cosine and random-walk noise |
//! | [`structure`] | which of these the sensor has |
//! | [`model_curves`] | what the fits say of autocorrelation and Allan variance, for plots |
//! | [`field_units`] | the units in which the field quotes coefficients |
//! | [`report`] | all of it as data |
//! | [`figures`] | all of it as figures |
//! | [`summary`] | all of it as text |
pub mod allan;
pub mod autocorrelation;
pub mod field_units;
pub mod figures;
pub mod likelihood;
pub mod model_curves;
pub mod power_law;
pub mod published;
pub mod report;
pub mod series;
pub mod spikes;
pub mod structure;
pub mod summary;
pub mod trend;

use std::convert::Infallible;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use schuler_recording::Recording;
use schuler_recording::recording::SensorSeries;

use allan::{AllanPoint, overlapping_allan};
use autocorrelation::{Centre, autocorrelation};
use field_units::coefficient_names;
use likelihood::{Fit, Removed};
use model_curves::{allan_variance_of, autocorrelation_of};
use power_law::{PowerLaws, fit_power_laws};
use report::{AllanReport, AutocorrelationReport, Identification, SensorIdentification};
use series::error_series;
use structure::{NoiseStructure, noise_structure};

/// What is asked of the identification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Longest lag of the reported autocorrelation, in steps; never more than half of the recording.
    pub longest_lag: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { longest_lag: 1000 }
    }
}

/// The noise of every sensor of `recording`, sensors in parallel.
pub fn identify(recording: &Recording, options: Options) -> Identification {
    let Ok(found) = identify_watched(recording, options, |_| Ok::<_, Infallible>(()));
    found
}

/// As [`identify`]; `watch` is told now and then how many sensors are finished, and may stop it.
///
/// # Errors
/// What `watch` returns.
pub fn identify_watched<E: Send>(
    recording: &Recording,
    options: Options,
    watch: impl Fn(usize) -> Result<(), E> + Sync,
) -> Result<Identification, E> {
    let finished = AtomicUsize::new(0);
    let sensors = recording
        .sensors
        .par_iter()
        .map(|sensor| {
            let stopped = || watch(finished.load(Ordering::Relaxed)).is_err();
            let found = identify_sensor(recording, sensor, options, &stopped);
            watch(finished.fetch_add(1, Ordering::Relaxed) + 1)?;
            Ok(found)
        })
        .collect::<Result<_, E>>()?;
    Ok(Identification {
        format: report::FORMAT,
        title: recording.case.title.clone(),
        time_column: recording.case.recording.time_name().to_owned(),
        step_s: recording.step_s,
        rows: recording.len(),
        rows_in_gaps: recording.gaps.iter().map(|gap| gap.missing).sum(),
        sensors,
        warnings: recording.warnings.clone(),
    })
}

/// The noise of a sensor; of no use once `stopped` says so.
fn identify_sensor(
    recording: &Recording,
    sensor: &SensorSeries,
    options: Options,
    stopped: &dyn Fn() -> bool,
) -> SensorIdentification {
    let mut series = error_series(recording, sensor);
    let spikes = spikes::set_spikes_aside(&mut series.values);
    let (values, step_s) = (series.values.as_slice(), series.step_s);
    let present = values.iter().filter(|value| value.is_finite()).count();
    let elapsed_s: Vec<f64> = recording.elapsed_s().collect();
    let allan = overlapping_allan(values, step_s);
    let laws = fit_power_laws(&allan, values, step_s);
    let structure = noise_structure(values, step_s, stopped);
    SensorIdentification {
        id: sensor.sensor.id.clone(),
        column: sensor.sensor.column.clone(),
        kind: sensor.sensor.kind.to_string(),
        unit: sensor.sensor.unit,
        written_unit: sensor.written_unit,
        written_unit_in_si: sensor.written_unit.in_si(),
        present,
        missing: values.len() - present - spikes,
        spikes,
        trend: trend::trend(&elapsed_s, values),
        autocorrelation: autocorrelation_report(values, step_s, options, &structure),
        floor: report::floor(&allan),
        allan: allan_report(&allan, laws.as_ref(), &structure),
        coefficients: laws.as_ref().map_or_else(Vec::new, |laws| {
            report::coefficients(laws, &coefficient_names(sensor.sensor.kind.dimension()))
        }),
        power_laws_p: laws.as_ref().map(|laws| laws.p_value),
        structure: report::structure_report(&structure, step_s, sensor.written_unit),
        subtracted: series.subtracted,
    }
}

fn autocorrelation_report(
    values: &[f64],
    step_s: f64,
    options: Options,
    structure: &NoiseStructure,
) -> AutocorrelationReport {
    let lags = options.longest_lag.min(values.len() / 2);
    let found = autocorrelation(values, lags, Centre::Mean);
    let variance = found.values.first().copied().unwrap_or(f64::NAN);
    let stationary = |fit: &&Fit| structure.factor == 1 && !fit.parts.walk && fit.removed == Removed::Mean;
    let model = structure.chosen().filter(stationary).map_or_else(Vec::new, |fit| {
        // The mean takes the variance of the mean from every lag: the square of the level's standard deviation.
        let taken = fit.level.1 * fit.level.1;
        (0..found.values.len()).map(|lag| autocorrelation_of(&fit.parameters, lag) - taken).collect()
    });
    AutocorrelationReport {
        step_s,
        correlation: found.values.iter().map(|value| value / variance).collect(),
        covariance: found.values,
        pairs: found.pairs,
        model,
    }
}

fn allan_report(
    points: &[AllanPoint],
    laws: Option<&PowerLaws>,
    structure: &NoiseStructure,
) -> Vec<AllanReport> {
    let of_structure = |point: &AllanPoint| {
        let fit = structure.chosen()?;
        // Fitted values are means over `factor` steps; shorter averaging times are not theirs to say.
        let factor =
            point.factor.is_multiple_of(structure.factor).then(|| point.factor / structure.factor)?;
        Some(allan_variance_of(fit, factor).max(0.0).sqrt())
    };
    points
        .iter()
        .map(|point| AllanReport {
            point: *point,
            power_laws: laws.map(|laws| power_law::variance(&laws.squares, point.tau_s).sqrt()),
            structure: of_structure(point),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;
    use std::fs;

    use tempfile::TempDir;

    use super::*;

    fn recording(rows: impl Iterator<Item = (f64, String)>) -> Recording {
        read(rows).unwrap()
    }

    fn read(rows: impl Iterator<Item = (f64, String)>) -> Result<Recording, schuler_recording::Error> {
        let folder = TempDir::new().unwrap();
        let mut table = "t,x\n".to_owned();
        for (time, value) in rows {
            writeln!(table, "{time},{value}").unwrap();
        }
        fs::write(folder.path().join("r.csv"), table).unwrap();
        let case = "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\n\
                    [[sensor]]\nid = \"x\"\nkind = \"fog\"\ncolumn = \"x\"\nunit = \"deg/h\"\naxis = [1, 0, 0]\n";
        fs::write(folder.path().join("c.toml"), case).unwrap();
        Recording::read(&folder.path().join("c.toml"))
    }

    #[test]
    fn hopeless_recordings_are_answered_all_the_same() {
        let constant = recording((0..100).map(|row| (f64::from(row), "1.5".to_owned())));
        let short = recording((0..2).map(|row| (f64::from(row), row.to_string())));
        let two_levels = recording((0..500).map(|row| (f64::from(row), (row % 2).to_string())));
        let step = recording((0..500).map(|row| (f64::from(row), (row / 250).to_string())));
        let mostly_gaps = recording((0..60).map(|row| (f64::from(row * row), (row % 7).to_string())));
        for recording in [constant, short, two_levels, step, mostly_gaps] {
            let found = identify(&recording, Options::default());
            assert_eq!(found.sensors.len(), 1);
            assert!(serde_json::to_string(&found).is_ok());
            assert!(!found.to_string().is_empty());
        }
    }

    /// Rows without a reading are not there.
    #[test]
    fn a_recording_without_two_readings_is_refused() {
        let missing = read((0..100).map(|row| (f64::from(row), "nan".to_owned())));
        let one_value = read((0..50).map(|row| (f64::from(row), if row == 7 { "1" } else { "" }.to_owned())));
        for refused in [missing, one_value] {
            let error = refused.expect_err("there is nothing to read").to_string();
            assert!(error.contains("expected at least two"), "{error}");
        }
    }
}
