//! The calibration experiment of a recording whose case has a part `[calibration]`.
//!
//! In: the recording, in SI units on its grid. A row holds the sensors' means over the step that ends there, and the
//! table's angle and the temperature at its time. Out: [`Experiment`], with the thermometer read once a second over the
//! whole recording.
use nalgebra::{DMatrix, Vector3};
use schuler_recording::case::calibration::{ARC_SECOND, CalibrationRun, Features, Table};
use schuler_recording::case::{Quantity, SensorKind};
use schuler_recording::motion::earth;
use schuler_recording::recording::{AuxiliarySeries, SensorSeries};
use schuler_recording::unit::Dimension;
use schuler_recording::{Problem, Recording};

use super::experiment::{
    Arrangement, AttitudePrior, Cycle, Experiment, FeatureSet, Noise, PriorSigma, Priors, Site,
};
use super::thermometer::Thermometry;

/// Passes that suffice for a complete unit, and for gyros on a table that does not repeat their mounting.
const PASSES: [u8; 2] = [2, 3];
/// How far the axis of a sensor may be from a body axis: the rest is what the calibration finds.
const AXIS_TOLERANCE: f64 = 1e-6;
/// Thermometers that a gradient needs: three components and the mean.
const GRADIENT_THERMOMETERS: usize = 4;
/// Least singular value of the thermometers' places about their mean, over the largest.
const SPREAD: f64 = 0.05;
/// Degree per hour, rad/s.
const DEGREE_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;

impl Experiment {
    /// The experiment that a recording holds.
    ///
    /// # Errors
    /// A recording that is no calibration run, by field of its case.
    pub fn of_recording(recording: &Recording) -> Result<Self, Problem> {
        let Some(run) = &recording.case.calibration else {
            return wrong(
                "calibration",
                "missing; expected a table [calibration] with the cycles of the run".to_owned(),
            );
        };
        let Some(site) = recording.case.site else {
            return wrong(
                "site",
                "missing; expected a table [site], as gravity and Earth rate are the reference".to_owned(),
            );
        };
        let samples = (1.0 / recording.step_s).round();
        if !(10.0..=1000.0).contains(&samples) || (recording.step_s * samples - 1.0).abs() > 1e-6 {
            let found = format!("found {}", recording.step_s);
            return wrong(
                "recording.step_s",
                format!("{found}; expected a step of at most 0.1 s of which a whole number makes a second"),
            );
        }
        let samples = samples as usize;
        let gyros = triad(recording, Dimension::AngularRate, "gyros")?;
        let accelerometers = match run.table {
            None => Some(triad(recording, Dimension::Acceleration, "accelerometers")?),
            Some(_) => None,
        };
        let thermometer = thermometer(recording, run)?;
        let gradients = match run.features {
            Features::TemperatureRateGradient => Some(gradient_thermometers(recording)?),
            _ => None,
        };
        let cycles = (0..run.cycles.len())
            .map(|k| {
                let parts = Parts {
                    recording,
                    run,
                    samples,
                    gyros: &gyros,
                    accelerometers: accelerometers.as_ref(),
                    thermometer,
                    gradients: gradients.as_ref(),
                };
                parts.cycle(k)
            })
            .collect::<Result<_, _>>()?;
        let latitude = site.latitude_deg.to_radians();
        let attitude = AttitudePrior::default();
        let sigma = |given: Option<f64>, otherwise: f64| given.map_or(otherwise, f64::to_radians);
        Ok(Self {
            site: Site {
                latitude,
                gravity: run.gravity.unwrap_or_else(|| earth::gravity(latitude, site.altitude_m)),
            },
            arrangement: run.table.as_ref().map_or(Arrangement::CompleteUnit, arrangement),
            features: match run.features {
                Features::Temperature => FeatureSet::Temperature,
                Features::TemperatureRate => FeatureSet::TemperatureRate,
                Features::TemperatureRateGradient => FeatureSet::TemperatureRateGradient,
            },
            noise: Noise {
                angle_random_walk: density(recording, &gyros)?,
                specific_force: match &accelerometers {
                    Some(triad) => density(recording, triad)?,
                    None => 1.0,
                },
            },
            priors: priors(run),
            attitude: AttitudePrior {
                level: sigma(run.level_sigma_deg, attitude.level),
                azimuth: sigma(run.azimuth_sigma_deg, attitude.azimuth),
            },
            sample_s: 1.0 / samples as f64,
            passes: run.passes.unwrap_or(PASSES[usize::from(run.table.is_some())]),
            cycles,
        })
    }
}

/// What a cycle is cut from.
struct Parts<'r> {
    recording: &'r Recording,
    run: &'r CalibrationRun,
    samples: usize,
    gyros: &'r [&'r SensorSeries; 3],
    accelerometers: Option<&'r [&'r SensorSeries; 3]>,
    thermometer: &'r AuxiliarySeries,
    gradients: Option<&'r Gradients<'r>>,
}

impl Parts<'_> {
    fn cycle(&self, k: usize) -> Result<Cycle, Problem> {
        let cycle = &self.run.cycles[k];
        let time = &self.recording.time_s;
        let half = 0.5 * self.recording.step_s;
        // The row whose time is the start: its instant is the cycle's zero, and the samples are the rows after it.
        let zero = time.partition_point(|t| *t < cycle.start_s - half);
        let seconds = ((cycle.end_s - cycle.start_s) + 1e-9).floor() as usize;
        let last = zero + seconds * self.samples;
        if last >= time.len() || (time[zero] - cycle.start_s).abs() > half {
            let (first_s, last_s) = (time.first().copied(), time.last().copied());
            return wrong(
                &format!("calibration.cycle[{k}].end_s"),
                format!(
                    "found {} to {} s; expected times within the recording, {} to {} s",
                    cycle.start_s,
                    cycle.end_s,
                    first_s.unwrap_or_default(),
                    last_s.unwrap_or_default()
                ),
            );
        }
        let rows = zero + 1..=last;
        let of = |triad: &[&SensorSeries; 3]| -> Vec<[f64; 3]> {
            rows.clone().map(|row| [0, 1, 2].map(|axis| triad[axis].along(axis, row))).collect()
        };
        let each_second = (zero..=last).step_by(self.samples);
        let whole = zero % self.samples;
        let first_s = -i64::try_from(zero / self.samples).unwrap_or(i64::MAX);
        let temperature = Thermometry::Quantised {
            quantum: self.quantum(self.thermometer)?,
            readings: self.thermometer.values.iter().skip(whole).step_by(self.samples).copied().collect(),
            first_s,
            gradient: self
                .gradients
                .map_or(Ok(Vec::new()), |it| self.gradient(it, whole, first_s, seconds))?,
        };
        Ok(Cycle {
            axis: cycle.axis.0,
            azimuth: cycle.azimuth_deg.to_radians(),
            rate: of(self.gyros),
            specific_force: self.accelerometers.map(of).unwrap_or_default(),
            table_angle: self.recording.table_angle.as_ref().map_or_else(Vec::new, |angle| {
                each_second.map(|row| angle.get(row).copied().unwrap_or(f64::NAN)).collect()
            }),
            thermometry: temperature,
        })
    }

    /// The case's quantum, or the least step between readings.
    fn quantum(&self, series: &AuxiliarySeries) -> Result<f64, Problem> {
        if let (Some(step), true) =
            (self.run.thermometer_step_k, series.auxiliary.column == self.thermometer.auxiliary.column)
        {
            return Ok(step);
        }
        let mut finite: Vec<f64> = series.values.iter().copied().filter(|v| v.is_finite()).collect();
        finite.sort_by(f64::total_cmp);
        let steps = finite.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 1e-9);
        let step = steps.fold(f64::INFINITY, f64::min);
        if step.is_finite() {
            return Ok(step);
        }
        wrong(
            "calibration.thermometer",
            format!(
                "found \"{}\", which does not change; expected a run at changing temperature",
                series.auxiliary.column
            ),
        )
    }

    /// Gradient at each whole second of the cycle, degC/m: the plane through the thermometers' smoothed temperatures.
    fn gradient(
        &self,
        gradients: &Gradients<'_>,
        whole: usize,
        first_s: i64,
        seconds: usize,
    ) -> Result<Vec<[f64; 3]>, Problem> {
        let mut sum = vec![[0.0; 3]; seconds + 1];
        for (series, weight) in gradients.thermometers.iter().zip(&gradients.weights) {
            let smooth = Thermometry::Quantised {
                quantum: self.quantum(series)?,
                readings: series.values.iter().skip(whole).step_by(self.samples).copied().collect(),
                first_s,
                gradient: Vec::new(),
            };
            // Points are at the middle of each second.
            let points = smooth.points(seconds);
            for (second, sum) in sum.iter_mut().enumerate() {
                let (a, b) = (second.saturating_sub(1), second.min(seconds.saturating_sub(1)));
                let mean = match (points.get(a), points.get(b)) {
                    (Some(a), Some(b)) => 0.5 * (a.temperature + b.temperature),
                    _ => f64::NAN,
                };
                for (sum, weight) in sum.iter_mut().zip(weight.iter()) {
                    *sum += weight * mean;
                }
            }
        }
        Ok(sum)
    }
}

/// A sensor's reading along the positive body axis.
trait Along {
    fn along(&self, axis: usize, row: usize) -> f64;
}

impl Along for SensorSeries {
    fn along(&self, axis: usize, row: usize) -> f64 {
        let sign = self.sensor.axis.map_or(1.0, |a| a[axis].signum());
        sign * self.values.get(row).copied().unwrap_or(f64::NAN)
    }
}

/// The three sensors along the body axes.
fn triad<'r>(
    recording: &'r Recording,
    dimension: Dimension,
    name: &str,
) -> Result<[&'r SensorSeries; 3], Problem> {
    let of_kind: Vec<&SensorSeries> = recording
        .sensors
        .iter()
        .filter(|s| s.sensor.kind.dimension() == dimension && s.sensor.kind != SensorKind::Doppler)
        .collect();
    let along = |axis: usize| {
        of_kind
            .iter()
            .find(|s| s.sensor.axis.is_some_and(|a| (a[axis].abs() - 1.0).abs() < AXIS_TOLERANCE))
            .copied()
    };
    match ([along(0), along(1), along(2)], of_kind.len()) {
        ([Some(x), Some(y), Some(z)], 3) => Ok([x, y, z]),
        (_, count) => wrong(
            "sensor",
            format!(
                "found {count} {name}; expected three of them, nominally along the body axes: what is not is found by \
                 the calibration"
            ),
        ),
    }
}

/// The largest white noise of a triad as the standard deviation of a mean over one second.
fn density(recording: &Recording, triad: &[&SensorSeries; 3]) -> Result<f64, Problem> {
    for series in triad {
        if series.sensor.nominal.white <= 0.0 {
            return wrong(
                "sensor.nominal.white",
                format!("found none for \"{}\"; expected its noise, 1 σ per sample", series.sensor.id),
            );
        }
    }
    let white = triad.iter().map(|s| s.sensor.nominal.white.hypot(s.sensor.quantisation / 12.0_f64.sqrt()));
    Ok(white.fold(0.0, f64::max) * recording.step_s.sqrt())
}

fn temperatures(recording: &Recording) -> impl Iterator<Item = &AuxiliarySeries> {
    recording.auxiliaries.iter().filter(|series| series.auxiliary.quantity == Quantity::Temperature)
}

fn thermometer<'r>(recording: &'r Recording, run: &CalibrationRun) -> Result<&'r AuxiliarySeries, Problem> {
    let all: Vec<_> = temperatures(recording).collect();
    let named = |column: &str| all.iter().find(|series| series.auxiliary.column == column).copied();
    let names: Vec<&str> = all.iter().map(|series| series.auxiliary.column.as_str()).collect();
    match (&run.thermometer, all.as_slice()) {
        (Some(column), _) => named(column).map_or_else(
            || {
                wrong(
                    "calibration.thermometer",
                    format!(
                        "found \"{column}\"; expected the column of an [[aux]] temperature: {}",
                        names.join(", ")
                    ),
                )
            },
            Ok,
        ),
        (None, [only]) => Ok(only),
        (None, _) => wrong(
            "calibration.thermometer",
            format!(
                "missing with {} temperatures; expected the column of one of them: {}",
                all.len(),
                names.join(", ")
            ),
        ),
    }
}

/// Thermometers with places, and what each adds to the gradient, 1/m.
struct Gradients<'r> {
    thermometers: Vec<&'r AuxiliarySeries>,
    weights: Vec<Vector3<f64>>,
}

fn gradient_thermometers(recording: &Recording) -> Result<Gradients<'_>, Problem> {
    let placed: Vec<(&AuxiliarySeries, Vector3<f64>)> = temperatures(recording)
        .filter_map(|series| Some((series, Vector3::from(series.auxiliary.position_m?))))
        .collect();
    let count = placed.len();
    let mean = placed.iter().map(|(_, place)| place).sum::<Vector3<f64>>() / count.max(1) as f64;
    let places = DMatrix::from_fn(count, 3, |k, axis| placed[k].1[axis] - mean[axis]);
    let singular = places.singular_values();
    let (least, most) = (singular.iter().copied().fold(f64::INFINITY, f64::min), singular.max());
    let inverse = if count >= GRADIENT_THERMOMETERS && least > SPREAD * most {
        places.pseudo_inverse(0.0).ok()
    } else {
        None
    };
    let Some(inverse) = inverse else {
        return wrong(
            "aux",
            format!(
                "found {count} temperatures with position_m; expected at least {GRADIENT_THERMOMETERS} that are not in \
                 one plane, for the gradient"
            ),
        );
    };
    let weights = (0..count).map(|k| inverse.fixed_view::<3, 1>(0, k).into_owned()).collect();
    Ok(Gradients { thermometers: placed.into_iter().map(|(series, _)| series).collect(), weights })
}

fn arrangement(table: &Table) -> Arrangement {
    Arrangement::GyroBlock {
        angle: table.angle_arcsec * ARC_SECOND,
        wobble: table.wobble_arcsec * ARC_SECOND,
        mounting: table.mounting_arcsec * ARC_SECOND,
        base: table.base_arcsec * ARC_SECOND,
    }
}

fn priors(run: &CalibrationRun) -> Priors {
    let default = Priors::default();
    let given = run.prior.unwrap_or_default();
    let sigma = |given: Option<[f64; 4]>, unit: f64, otherwise: PriorSigma| {
        given.map_or(otherwise, |sigmas| {
            let [constant, temperature, rate, gradient] = sigmas.map(|s| s * unit);
            PriorSigma { constant, temperature, rate, gradient }
        })
    };
    Priors {
        gyro_bias: sigma(given.gyro_bias_deg_h, DEGREE_PER_HOUR, default.gyro_bias),
        gyro_matrix: sigma(given.gyro_matrix_ppm, 1e-6, default.gyro_matrix),
        accelerometer_bias: sigma(given.accelerometer_bias_mm_s2, 1e-3, default.accelerometer_bias),
        accelerometer_matrix: sigma(given.accelerometer_matrix_ppm, 1e-6, default.accelerometer_matrix),
    }
}

fn wrong<T>(field: &str, message: String) -> Result<T, Problem> {
    Err(Problem::new(None, field, message))
}
