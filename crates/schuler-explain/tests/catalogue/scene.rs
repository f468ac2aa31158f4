//! Recordings whose rates, forces and temperatures are known in closed form, and the candidates that the catalogue offers for them.
use std::f64::consts::TAU;

use schuler_explain::catalogue::{CATALOGUE, Candidate, Search, Signature, Target};
use schuler_explain::inputs::Inputs;
use schuler_recording::case::{
    Attitude, Auxiliary, Case, Motion, MotionKind, Nominal, Quantity, Sensor, SensorKind, Site, Source,
    TemperatureBias,
};
use schuler_recording::recording::{AuxiliarySeries, MotionSeries, Quality, SensorSeries};
use schuler_recording::unit::Unit;
use schuler_recording::{Recording, unit};

pub struct Scene(pub Recording);

impl Scene {
    pub fn new(kind: MotionKind, rows: usize, step_s: f64) -> Self {
        let case = Case {
            title: String::new(),
            recording: Source {
                path: "r.csv".into(),
                time: Some("t".into()),
                step_s: Some(step_s),
                ..Source::default()
            },
            site: None,
            simulation: None,
            motion: Motion { kind, ..Motion::default() },
            schuler_loop: None,
            sensors: Vec::new(),
            calibration: None,
            auxiliaries: Vec::new(),
            effects: Vec::new(),
        };
        Self(Recording {
            case,
            step_s,
            time_s: (0..rows).map(|row| row as f64 * step_s).collect(),
            inserted: vec![false; rows],
            gaps: Vec::new(),
            sensors: Vec::new(),
            auxiliaries: Vec::new(),
            motion: MotionSeries::default(),
            table_angle: None,
            in_formulas: Vec::new(),
            warnings: Vec::new(),
        })
    }

    pub fn sample(&self, value: impl Fn(f64) -> f64) -> Vec<f64> {
        self.0.elapsed_s().map(value).collect()
    }

    pub fn sensor(mut self, id: &str, kind: SensorKind, unit: Unit, axis: [f64; 3]) -> Self {
        let nominal = Nominal { white: 1.0, ..Nominal::default() };
        let sensor = Sensor {
            axis: Some(axis),
            spin_axis: (kind == SensorKind::Dtg).then_some([0.0, 0.0, 1.0]),
            ..Sensor::new(id, kind, unit.si(), nominal)
        };
        self.0.case.sensors.push(sensor.clone());
        let values = vec![0.0; self.0.len()];
        self.0.sensors.push(SensorSeries {
            sensor,
            written_unit: unit,
            values,
            predicted: None,
            quality: Quality::default(),
        });
        self
    }

    pub fn last(mut self, change: impl FnOnce(&mut Sensor)) -> Self {
        change(&mut self.0.sensors.last_mut().unwrap().sensor);
        self
    }

    pub fn aux(
        mut self,
        column: &str,
        quantity: Quantity,
        unit: &str,
        near: Option<&str>,
        value: impl Fn(f64) -> f64,
    ) -> Self {
        let auxiliary = Auxiliary {
            column: column.to_owned(),
            quantity,
            unit: unit.to_owned(),
            scale: None,
            offset: None,
            near: near.map(str::to_owned),
            position_m: None,
        };
        let values = self.sample(value);
        self.0.auxiliaries.push(AuxiliarySeries { auxiliary, values, quality: Quality::default() });
        self
    }

    pub fn columns(&self, values: [fn(f64) -> f64; 3]) -> [Vec<f64>; 3] {
        values.map(|value| self.sample(value))
    }

    pub fn site(mut self, latitude_deg: f64) -> Self {
        self.0.case.site = Some(Site { latitude_deg, longitude_deg: None, altitude_m: 0.0 });
        self
    }
}

pub fn wx(t: f64) -> f64 {
    0.3 * (0.5 * t).sin()
}

pub fn wy(t: f64) -> f64 {
    0.2 * (0.7 * t).cos()
}

pub fn wz(t: f64) -> f64 {
    0.1 + 0.05 * (0.3 * t).sin()
}

pub fn wx_dot(t: f64) -> f64 {
    0.15 * (0.5 * t).cos()
}

pub fn wy_dot(t: f64) -> f64 {
    -0.14 * (0.7 * t).sin()
}

pub fn wz_dot(t: f64) -> f64 {
    0.015 * (0.3 * t).cos()
}

pub fn fx(t: f64) -> f64 {
    3.0 * (0.2 * t).sin()
}

pub fn fy(t: f64) -> f64 {
    2.0 * (0.3 * t).cos()
}

pub fn fz(t: f64) -> f64 {
    -9.8 + (0.25 * t).sin()
}

pub fn temperature(t: f64) -> f64 {
    25.0 + 8.0 * (TAU * t / 400.0).sin()
}

pub fn vibration(t: f64) -> f64 {
    2.0 + (0.01 * t).sin()
}

pub fn line(t: f64) -> f64 {
    (TAU * t / 150.0).sin()
}

const TURNING_S: f64 = 600.0;

/// Body that turns and shakes, 600 s at 10 Hz: DTG x, accelerometer x, Doppler x; temperature with known reference.
pub fn turning() -> Scene {
    let mut scene = Scene::new(MotionKind::Recorded, 6001, 0.1)
        .sensor("g", SensorKind::Dtg, Unit::DegreePerHour, [1.0, 0.0, 0.0])
        .last(|sensor| {
            sensor.nominal.temperature_bias = Some(TemperatureBias {
                column: "T".to_owned(),
                reference_deg_c: 20.0,
                coefficients: vec![0.0],
            });
        })
        .sensor("a", SensorKind::Accelerometer, Unit::MicroG, [1.0, 0.0, 0.0])
        .sensor("d", SensorKind::Doppler, Unit::MetrePerSecond, [1.0, 0.0, 0.0])
        .aux("T", Quantity::Temperature, "degC", Some("g"), temperature)
        .aux("T2", Quantity::Temperature, "degC", None, |t| temperature(t) + 3.0 + line(t))
        .aux("T_board", Quantity::Temperature, "degC", None, |t| 40.0 + 4.0 * line(t))
        .aux("V", Quantity::Voltage, "V", None, |t| 5.0 + 0.1 * line(t))
        .aux("p", Quantity::Pressure, "Pa", None, |t| 1e5 + 300.0 * line(t))
        .aux("B", Quantity::MagneticFieldY, "T", None, |t| 2e-5 * line(t))
        .aux("vib", Quantity::VibrationRms, "m/s^2", None, vibration)
        .aux("pickoff", Quantity::Other, "rad", Some("g"), |t| 1e-3 * line(t))
        .aux("I", Quantity::Current, "A", None, |t| 0.2 + 0.05 * line(t));
    scene.0.motion.rate = Some(scene.columns([wx, wy, wz]));
    scene.0.motion.specific_force = Some(scene.columns([fx, fy, fz]));
    let still: fn(f64) -> f64 = |_| 0.0;
    scene.0.motion.attitude_rad = Some(scene.columns([still, still, still]));
    scene.0.motion.velocity_ned =
        Some(scene.columns([|t| 5.0 + (0.4 * t).sin(), |t| (0.3 * t).cos(), still]));
    scene
}

/// Nothing but one relative gyro at rest, for a minute.
pub fn bare(kind: SensorKind) -> Scene {
    let unit = match kind.dimension() {
        unit::Dimension::AngularRate => Unit::DegreePerHour,
        unit::Dimension::Acceleration => Unit::MicroG,
        unit::Dimension::Velocity => Unit::MetrePerSecond,
        unit::Dimension::Other => Unit::free("N m"),
    };
    let mut scene = Scene::new(MotionKind::Static, 50, 1.0)
        .sensor("s", kind, unit, [0.0, 0.0, 1.0])
        .last(|sensor| sensor.relative = true)
        .aux("T", Quantity::Temperature, "degC", Some("s"), |_| 25.0)
        .aux("T2", Quantity::Temperature, "degC", None, |_| 26.0)
        .aux("V", Quantity::Voltage, "V", None, |_| 5.0)
        .aux("B", Quantity::MagneticFieldX, "T", None, |_| 2e-5)
        .aux("vib", Quantity::VibrationRms, "m/s^2", None, |_| 1.0)
        .aux("x", Quantity::Other, "rad", None, |_| 1.0)
        .site(50.0);
    scene.0.case.motion.attitude_deg = Some(Attitude { roll: 3.0, pitch: 20.0, heading: 40.0 });
    scene
}

pub fn candidates(inputs: &Inputs<'_>, id: &str) -> Vec<Candidate> {
    let effect = CATALOGUE.iter().find(|effect| effect.id == id).unwrap_or_else(|| panic!("{id}"));
    (effect.candidates)(effect, inputs)
}

/// The candidates of an effect at one sensor with the given variants.
pub fn at(inputs: &Inputs<'_>, id: &str, sensor: usize, variant: &[(&str, &str)]) -> Vec<Candidate> {
    candidates(inputs, id)
        .into_iter()
        .filter(|candidate| candidate.target == Target::Sensor(sensor))
        .filter(|candidate| {
            variant.iter().all(|wanted| {
                candidate.variant.iter().any(|(name, value)| (*name, value.as_str()) == *wanted)
            })
        })
        .collect()
}

pub fn signature(candidate: &Candidate, parameters: &[f64]) -> Signature {
    match &candidate.search {
        Search::Linear(signature) => signature.clone(),
        Search::Grid { signature, parameters: names, .. } => {
            assert_eq!(names.len(), parameters.len());
            for parameter in names {
                assert!(parameter.grid.windows(2).all(|pair| pair[0] < pair[1]), "{}", candidate.effect.id);
            }
            signature(parameters)
        }
        _ => panic!("{} has no signature", candidate.effect.id),
    }
}

/// A column of a signature, with the shape that every signature must have.
pub fn column(candidate: &Candidate, parameters: &[f64], index: usize, rows: usize) -> Vec<f64> {
    let signature = signature(candidate, parameters);
    assert_eq!(signature.columns.len(), candidate.amplitudes.len(), "{}", candidate.effect.id);
    for column in &signature.columns {
        for (_, values) in &column.parts {
            assert_eq!(values.len(), rows, "{}", candidate.effect.id);
            assert!(values.iter().all(|value| value.is_finite()), "{}", candidate.effect.id);
        }
    }
    signature.columns[index].parts[0].1.to_vec()
}

pub fn mean(f: impl Fn(f64) -> f64, scene: &Scene) -> f64 {
    let values = scene.sample(f);
    values.iter().sum::<f64>() / values.len() as f64
}

/// Largest difference from a closed form, as a part of its largest magnitude, after the first `skip` seconds.
pub fn difference(scene: &Scene, found: &[f64], expected: impl Fn(f64) -> f64, skip: f64) -> f64 {
    let last = TURNING_S.max(scene.0.elapsed_s().last().unwrap_or_default()) - 0.5;
    let size = scene.sample(&expected).iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    (scene.0.elapsed_s().zip(found))
        .filter(|&(t, _)| t >= skip && t <= last)
        .map(|(t, found)| (found - expected(t)).abs() / size)
        .fold(0.0, f64::max)
}
