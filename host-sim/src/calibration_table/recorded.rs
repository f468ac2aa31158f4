//! A calibration run as recording, case and truth.
//!
//! The truth is a table of its own that no case points to: one row a coefficient, in SI units for one degC, degC/s, degC/m.
use std::fmt::Write;
use std::path::{Path, PathBuf};

use schuler_recording::Error;
use schuler_recording::case::calibration::{
    AngleUnit, BodyAxis, CalibrationRun, Cycle, Features, Prior, Table,
};
use schuler_recording::case::{Auxiliary, Case, Motion, Nominal, Quantity, Sensor, SensorKind, Site, Source};
use schuler_recording::unit::Unit;

use super::scenario::CalibrationScenario;
use super::{CalibrationTable, CycleRecord, ErrorCoefficients, REMOUNTING_S, TableRecord, TriadErrors};
use crate::output::{self, Interrupted};
use crate::plot::{Colour, Figure, Panel};
use crate::simulation::{CASE, RECORDING, Written};

/// Name of the truth that is written beside the case.
pub const TRUTH: &str = "truth.csv";
/// Distance of the outer thermometers from the middle one, m.
const ARM: f64 = 0.05;
const ARC_SECOND: f64 = std::f64::consts::PI / 180.0 / 3600.0;
const AXES: [&str; 3] = ["x", "y", "z"];

/// A calibration run, ready to be written.
#[derive(Clone, Debug)]
pub struct SimulatedRun {
    case: Case,
    columns: Vec<(String, Vec<f64>)>,
    truth: String,
}

impl SimulatedRun {
    /// Writes case, recording and truth into a directory, each file whole or not at all; gives also the number of rows.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, directory: &Path) -> Result<(Written, usize), Error> {
        std::fs::create_dir_all(directory)
            .map_err(|error| Error::io(directory, "make the directory", &error))?;
        let written = Written {
            case: directory.join(CASE),
            recording: directory.join(RECORDING),
            truth: directory.join(TRUTH),
        };
        let named: Vec<(&str, &[f64])> =
            self.columns.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
        output::write_table(&written.recording, &named)?;
        output::write(&written.truth, self.truth.as_bytes())?;
        output::write_case(&written.case, &self.case)?;
        Ok((written, self.columns.first().map_or(0, |(_, time)| time.len())))
    }

    /// Outputs of the gyros, and the temperature.
    pub fn figure(&self) -> Figure {
        let hours: Vec<f64> =
            self.columns.first().map_or_else(Vec::new, |(_, time)| time.iter().map(|t| t / 3600.0).collect());
        let panel = |(name, values): &(String, Vec<f64>)| {
            Panel::new("time, h", name).line("", &hours, values.clone(), Colour::Blue)
        };
        Figure { title: self.case.title.clone(), panels: self.columns.iter().skip(1).map(panel).collect() }
    }
}

impl CalibrationScenario {
    /// Runs the scenario; `watch` is told the seconds done and may end the work.
    ///
    /// # Errors
    /// What `watch` says.
    pub fn simulated(
        &self,
        mut watch: impl FnMut(usize) -> Result<(), Interrupted>,
    ) -> Result<SimulatedRun, Interrupted> {
        let table = self.drawn();
        let record = table.run_watched(self.seed, &mut watch)?;
        let columns = self.columns(&table, &record);
        Ok(SimulatedRun { case: self.case(&table, &record), columns, truth: truth(&table) })
    }

    /// Rows at every sample of the whole run; between cycles only the thermometers are read.
    fn columns(&self, table: &CalibrationTable, record: &TableRecord) -> Vec<(String, Vec<f64>)> {
        let samples = table.samples_per_second;
        let rows = (record.temperature.len() - 1) * samples + 1;
        let empty = || vec![f64::NAN; rows];
        let step = 1.0 / samples as f64;
        let mut columns = vec![("t".to_owned(), (0..rows).map(|k| k as f64 * step).collect())];
        let mut triad = |name: &str, of: fn(&CycleRecord) -> &Vec<[f64; 3]>, unit: Unit| {
            for (k, axis) in AXES.iter().enumerate() {
                let mut values = empty();
                for cycle in &record.cycles {
                    let first = cycle.began_s * samples + 1;
                    for (value, sample) in values.iter_mut().skip(first).zip(of(cycle)) {
                        *value = sample[k] / unit.in_si();
                    }
                }
                columns.push((format!("{name}_{axis}"), values));
            }
        };
        triad("gyro", |cycle| &cycle.rate, Unit::DegreePerHour);
        if table.angle_noise > 0.0 {
            let mut angle = empty();
            for cycle in &record.cycles {
                let slots = angle.iter_mut().skip(cycle.began_s * samples).step_by(samples);
                slots.zip(&cycle.angle).for_each(|(slot, value)| *slot = value.to_degrees());
            }
            columns.push(("angle".to_owned(), angle));
        } else {
            triad("accelerometer", |cycle| &cycle.specific_force, Unit::MetrePerSecondSquared);
        }
        for (k, (name, place)) in self.thermometers().into_iter().enumerate() {
            let mut moved = record.clone();
            for t in &mut moved.temperature {
                t.temperature += t.gradient.iter().zip(place).map(|(g, x)| g * x).sum::<f64>();
            }
            let readings = moved.thermometer(self.step_k, self.white_k, self.seed ^ (0x7e << 32) ^ k as u64);
            let mut values = empty();
            values.iter_mut().step_by(samples).zip(readings).for_each(|(slot, value)| *slot = value);
            columns.push((name, values));
        }
        columns
    }

    /// Column and place of each thermometer.
    fn thermometers(&self) -> Vec<(String, [f64; 3])> {
        let mut all = vec![("temperature".to_owned(), [0.0; 3])];
        if self.gradient {
            for (k, axis) in AXES.iter().enumerate() {
                for (sign, arm) in [("p", ARM), ("m", -ARM)] {
                    let mut place = [0.0; 3];
                    place[k] = arm;
                    all.push((format!("temperature_{axis}{sign}"), place));
                }
            }
        }
        all
    }

    fn case(&self, table: &CalibrationTable, record: &TableRecord) -> Case {
        let per_sample = (table.samples_per_second as f64).sqrt();
        let sensor = |kind, name: &str, k: usize, unit: Unit, white: f64| {
            let mut axis = [0.0; 3];
            axis[k] = 1.0;
            let nominal = Nominal { white: white / unit.in_si(), ..Nominal::default() };
            Sensor {
                axis: Some(axis),
                group: Some("unit".to_owned()),
                ..Sensor::new(&format!("{name}_{}", AXES[k]), kind, unit, nominal)
            }
        };
        let gyro_white = table.angle_random_walk * per_sample;
        let force_white = table.force_noise * per_sample;
        let with_angle = table.angle_noise > 0.0;
        let gyros = (0..3).map(|k| sensor(SensorKind::Fog, "gyro", k, Unit::DegreePerHour, gyro_white));
        let accelerometers = (0..if with_angle { 0 } else { 3 }).map(|k| {
            let unit = Unit::MetrePerSecondSquared;
            sensor(SensorKind::Accelerometer, "accelerometer", k, unit, force_white)
        });
        Case {
            title: self.title.clone(),
            recording: Source {
                path: RECORDING.into(),
                time: Some("t".to_owned()),
                step_s: Some(1.0 / table.samples_per_second as f64),
                ..Source::default()
            },
            site: Some(Site {
                latitude_deg: table.latitude.to_degrees(),
                longitude_deg: None,
                altitude_m: 0.0,
            }),
            simulation: None,
            motion: Motion::default(),
            schuler_loop: None,
            sensors: gyros.chain(accelerometers).collect(),
            calibration: Some(self.run(table, record)),
            effects: Vec::new(),
            auxiliaries: self
                .thermometers()
                .into_iter()
                .map(|(column, place)| Auxiliary {
                    column,
                    quantity: Quantity::Temperature,
                    unit: "degC".to_owned(),
                    scale: None,
                    offset: None,
                    near: Some("unit".to_owned()),
                    position_m: self.gradient.then_some(place),
                })
                .collect(),
        }
    }

    fn run(&self, table: &CalibrationTable, record: &TableRecord) -> CalibrationRun {
        let sigmas = |sigmas: [f64; 4], unit: f64| {
            let sigmas = sigmas.map(|s| s / unit);
            sigmas.iter().take(3).all(|s| *s > 0.0).then_some([
                sigmas[0],
                sigmas[1],
                sigmas[2],
                if sigmas[3] > 0.0 { sigmas[3] } else { sigmas[2] },
            ])
        };
        CalibrationRun {
            features: if self.gradient {
                Features::TemperatureRateGradient
            } else {
                Features::TemperatureRate
            },
            gravity: Some(table.gravity),
            thermometer: Some("temperature".to_owned()),
            thermometer_step_k: Some(self.step_k),
            table: (table.angle_noise > 0.0).then(|| Table {
                column: "angle".to_owned(),
                unit: AngleUnit::Degrees,
                angle_arcsec: table.angle_noise / ARC_SECOND,
                wobble_arcsec: table.wobble / ARC_SECOND,
                mounting_arcsec: table.mounting / ARC_SECOND,
                base_arcsec: 60.0,
            }),
            prior: Some(Prior {
                gyro_bias_deg_h: sigmas(self.errors.gyro_bias, ARC_SECOND),
                gyro_matrix_ppm: sigmas(self.errors.gyro_matrix, 1e-6),
                accelerometer_bias_mm_s2: sigmas(self.errors.accelerometer_bias, 1e-3),
                accelerometer_matrix_ppm: sigmas(self.errors.accelerometer_matrix, 1e-6),
            }),
            cycles: record
                .cycles
                .iter()
                .map(|cycle| Cycle {
                    axis: BodyAxis(cycle.axis),
                    azimuth_deg: table.azimuth.to_degrees(),
                    start_s: cycle.began_s as f64,
                    end_s: (cycle.began_s + table.cycle_s) as f64,
                })
                .collect(),
            ..CalibrationRun::default()
        }
    }
}

/// The true coefficients.
fn truth(table: &CalibrationTable) -> String {
    let mut text =
        "element,constant,per_K,per_K_per_s,per_K_per_m_x,per_K_per_m_y,per_K_per_m_z\n".to_owned();
    let mut row = |name: String, c: &ErrorCoefficients| {
        let [x, y, z] = c.per_gradient;
        // Writing into a string cannot fail.
        let _ =
            writeln!(text, "{name},{:e},{:e},{:e},{x:e},{y:e},{z:e}", c.constant, c.per_degree, c.per_rate);
    };
    let mut triad = |name: &str, errors: &TriadErrors| {
        for i in 0..3 {
            row(format!("{name}_bias_{}", AXES[i]), &errors.bias[i]);
            for j in 0..3 {
                row(format!("{name}_matrix_{}{}", AXES[i], AXES[j]), &errors.matrix[i][j]);
            }
        }
    };
    triad("gyro", &table.gyro);
    triad("accelerometer", &table.accelerometer);
    text
}

/// Seconds of a run.
pub fn seconds(table: &CalibrationTable) -> usize {
    3 * (table.cycle_s + REMOUNTING_S)
}

/// An element by its name, and its true parts in SI units for one degC, degC/s and degC/m.
pub type TrueElement = (String, [f64; 6]);

/// The true coefficients beside a case, if there are any: element by its name, and its parts in SI units for one degC,
/// degC/s and degC/m.
///
/// # Errors
/// A truth that cannot be read.
pub fn truth_beside(case: &Path) -> Result<Option<Vec<TrueElement>>, Error> {
    let path: PathBuf = case.parent().unwrap_or(Path::new("")).join(TRUTH);
    if !path.exists() {
        return Ok(None);
    }
    let text = schuler_recording::file::text(&path, "read the truth")?;
    let rows = text.lines().skip(1).enumerate().map(|(row, line)| {
        let mut cells = line.split(',');
        let name = cells.next().unwrap_or_default().to_owned();
        let parts: Vec<f64> = cells.map_while(|cell| cell.parse().ok()).collect();
        parts.try_into().map(|parts: [f64; 6]| (name, parts)).map_err(|_| {
            let problem =
                schuler_recording::Problem::new(Some(row + 2), "", "expected an element and six numbers");
            Error::one(&path, problem)
        })
    });
    rows.collect::<Result<_, _>>().map(Some)
}
