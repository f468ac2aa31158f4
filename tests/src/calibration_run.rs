//! A simulated calibration run with errors drawn from the priors, handed to the calibration as its recording.
use host_sim::calibration_table::{
    CalibrationTable, ErrorCoefficients, Programme, SensorTemperature, TableRecord, TriadErrors,
};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::calibration::{
    Arrangement, AttitudePrior, Calibration, Cycle, Element, Experiment, Feature, FeatureSet, Noise,
    PriorSigma, Priors, Site, ThermalPoint, Thermometry,
};

/// Degrees per hour, rad/s.
pub const DEGREE_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;
/// Arc seconds, rad.
pub const ARC_SECOND: f64 = std::f64::consts::PI / 180.0 / 3600.0;

/// A thermal programme whose functions of temperature are independent in every cycle.
pub const UP_AND_DOWN: Programme =
    Programme::UpAndDown { low: 10.0, high: 70.0, period_s: 3600.0, load: 6.0 };

/// A complete unit on a table that knows nothing, with the noise of the specification [TMP-13]; errors zero.
pub fn complete_unit(programme: Programme) -> CalibrationTable {
    CalibrationTable {
        latitude: 55.7f64.to_radians(),
        gravity: 9.8156,
        azimuth: 0.35,
        tilt: 0.0,
        rate: 12.0f64.to_radians(),
        rotation_s: 68.0,
        dwell_s: 16.0,
        cycle_s: 3600,
        samples_per_second: 20,
        mounting: 0.5f64.to_radians(),
        wobble: 0.0,
        angle_noise: 0.0,
        angle_random_walk: (0.05f64 / 60.0).to_radians(),
        force_noise: 0.01,
        gyro: TriadErrors::default(),
        accelerometer: TriadErrors::default(),
        programme,
    }
}

/// Gyros alone on a table with an angle sensor [TMP-14].
pub fn gyro_block(programme: Programme, mounting: f64) -> CalibrationTable {
    CalibrationTable {
        mounting,
        wobble: 5.0 * ARC_SECOND,
        angle_noise: 5.0 * ARC_SECOND,
        angle_random_walk: (0.02f64 / 60.0).to_radians(),
        ..complete_unit(programme)
    }
}

/// Draws every error coefficient of the model with these features from its prior.
pub fn draw_errors(table: &mut CalibrationTable, priors: &Priors, features: FeatureSet, seed: u64) {
    let mut random = Pcg64::seed_from_u64(seed ^ 0x5eed_0000_0000);
    let mut draw = |prior: &PriorSigma| {
        let mut part = |f: usize| {
            let scaled: f64 = StandardNormal.sample(&mut random);
            if f < features.count() { prior.at(f) * scaled / Feature::ALL[f].scale() } else { 0.0 }
        };
        ErrorCoefficients {
            constant: part(0),
            per_degree: part(1),
            per_rate: part(2),
            per_gradient: [part(3), part(4), part(5)],
        }
    };
    for i in 0..3 {
        table.gyro.bias[i] = draw(&priors.gyro_bias);
        table.accelerometer.bias[i] = draw(&priors.accelerometer_bias);
        for j in 0..3 {
            table.gyro.matrix[i][j] = draw(&priors.gyro_matrix);
            let element = draw(&priors.accelerometer_matrix);
            if j <= i {
                table.accelerometer.matrix[i][j] = element;
            }
        }
    }
}

/// The true value of a coefficient at a scaled feature.
pub fn truth(table: &CalibrationTable, element: Element, feature: Feature) -> f64 {
    let errors = match element {
        Element::GyroBias(i) => table.gyro.bias[i],
        Element::GyroMatrix(i, j) => table.gyro.matrix[i][j],
        Element::AccelerometerBias(i) => table.accelerometer.bias[i],
        Element::AccelerometerMatrix(i, j) => table.accelerometer.matrix[i][j],
    };
    let value = match feature {
        Feature::Constant => errors.constant,
        Feature::Temperature => errors.per_degree,
        Feature::Rate => errors.per_rate,
        Feature::GradientX => errors.per_gradient[0],
        Feature::GradientY => errors.per_gradient[1],
        Feature::GradientZ => errors.per_gradient[2],
    };
    value * feature.scale()
}

/// What the calibration knows of the temperature.
#[derive(Clone, Copy, Debug)]
pub enum Known {
    /// The truth.
    Truth,
    /// A thermometer with this quantum, degC.
    Quantum(f64),
}

/// The recording with its description.
///
/// # Panics
/// On a run whose seconds do not fit 63 bits.
pub fn experiment(
    table: &CalibrationTable,
    record: &TableRecord,
    features: FeatureSet,
    known: Known,
) -> Experiment {
    let point = |t: &SensorTemperature| ThermalPoint {
        temperature: t.temperature,
        rate: t.rate,
        gradient: t.gradient,
    };
    let readings = match known {
        Known::Truth => Vec::new(),
        Known::Quantum(q) => record.thermometer(q, 0.0, 0),
    };
    let with_table = table.angle_noise > 0.0;
    let cycles = record
        .cycles
        .iter()
        .map(|cycle| Cycle {
            axis: cycle.axis,
            azimuth: table.azimuth,
            rate: cycle.rate.clone(),
            specific_force: if with_table { Vec::new() } else { cycle.specific_force.clone() },
            table_angle: if with_table { cycle.angle.clone() } else { Vec::new() },
            thermometry: match known {
                Known::Truth => Thermometry::Known(cycle.temperature.iter().map(point).collect()),
                Known::Quantum(quantum) => Thermometry::Quantised {
                    quantum,
                    readings: readings.clone(),
                    first_s: -i64::try_from(cycle.began_s).expect("a second of a run"),
                    gradient: cycle.temperature.iter().map(|t| t.gradient).collect(),
                },
            },
        })
        .collect();
    Experiment {
        site: Site { latitude: table.latitude, gravity: table.gravity },
        arrangement: if with_table {
            Arrangement::GyroBlock {
                angle: table.angle_noise,
                wobble: table.wobble,
                mounting: table.mounting,
                base: 60.0 * ARC_SECOND,
            }
        } else {
            Arrangement::CompleteUnit
        },
        features,
        noise: Noise { angle_random_walk: table.angle_random_walk, specific_force: table.force_noise },
        priors: Priors::default(),
        attitude: AttitudePrior::default(),
        sample_s: 1.0 / table.samples_per_second as f64,
        passes: 2,
        cycles,
    }
}

/// Errors of all coefficients in sigmas.
pub fn normalised_errors(table: &CalibrationTable, calibration: &Calibration) -> Vec<f64> {
    let coefficients = calibration.coefficients.iter();
    coefficients.map(|c| (c.value - truth(table, c.element, c.feature)) / c.sigma).collect()
}

/// Root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}
