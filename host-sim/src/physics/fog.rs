//! A fibre-optic gyro, closed loop: a coil whose two waves part by the Sagnac phase, and the loop that nulls it.
//!
//! The loop reads the rate along the coil's axis through its own gain. Beside it the coil feels the temperature's rate, because
//! the fibre's middle is not where the coil's is (Shupe), and the magnetic field along its axis, because the fibre is
//! twisted (Faraday). The coil follows the housing's temperature with a lag; the bracket that holds it bends with temperature. SI
//! units.
use nalgebra::{UnitQuaternion, Vector3};

use super::heat::Lag;
use super::readout::{Nonlinearity, REFERENCE_TEMPERATURE, Readout, ReadoutDesign, Surroundings};

/// Everything about one gyro.
#[derive(Clone, Debug, PartialEq)]
pub struct FogDesign {
    /// Axis of the coil in the body.
    pub input_axis: Vector3<f64>,
    /// Rotation of the coil in the body beside that, rotation vector in body axes, rad.
    pub misalignment: Vector3<f64>,
    /// Its change with the housing's temperature, rad/K.
    pub misalignment_temperature: Vector3<f64>,
    /// From rate to output.
    pub scale: Nonlinearity,
    /// Relative change of the gain with the coil's temperature, 1/K.
    pub scale_temperature: f64,
    /// Output per rate of the coil's temperature, rad/s per K/s.
    pub midpoint: f64,
    /// Output per magnetic flux density along the axis, rad/s per T.
    pub faraday: f64,
    /// Lag of the coil's temperature behind the housing's, s.
    pub coil_lag_s: f64,
    /// Output.
    pub readout: ReadoutDesign,
}

impl FogDesign {
    /// A gyro without any error.
    pub fn ideal(input_axis: Vector3<f64>) -> Self {
        Self {
            input_axis: input_axis.normalize(),
            misalignment: Vector3::zeros(),
            misalignment_temperature: Vector3::zeros(),
            scale: Nonlinearity::default(),
            scale_temperature: 0.0,
            midpoint: 0.0,
            faraday: 0.0,
            coil_lag_s: 0.0,
            readout: ReadoutDesign { range: f64::INFINITY, ..ReadoutDesign::default() },
        }
    }
}

/// A gyro at work.
#[derive(Clone, Debug)]
pub struct Fog {
    design: FogDesign,
    coil: Option<(Lag, f64)>,
    readout: Readout,
}

/// What it says of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FogReading {
    /// Indicated rate, rad/s.
    pub rate: f64,
    /// Mean true rate about the nominal axis, rad/s.
    pub true_rate: f64,
}

impl Fog {
    /// The gyro called `name` of the run with this seed.
    pub fn new(design: FogDesign, seed: u64, name: &str) -> Self {
        let readout = Readout::new(design.readout.clone(), seed, name);
        Self { design, coil: None, readout }
    }

    /// One reading: the mean over a step cut into equal parts, with the rate in body axes at the parts' ends (`parts + 1`
    /// entries).
    pub fn step(&mut self, rate: &[Vector3<f64>], around: &Surroundings, step_s: f64) -> FogReading {
        let d = &self.design;
        let housing = around.temperature;
        let (coil, before) = self.coil.get_or_insert((Lag::new(housing), housing));
        let coil_before = coil.value();
        let coil_now = coil.advance(step_s, d.coil_lag_s, *before, housing);
        *before = housing;
        let turn = d.misalignment + d.misalignment_temperature * (housing - REFERENCE_TEMPERATURE);
        let axis = UnitQuaternion::from_scaled_axis(turn) * d.input_axis;
        let parts = rate.len().saturating_sub(1).max(1) as f64;
        let gain = 1.0 + d.scale_temperature * (0.5 * (coil_before + coil_now) - REFERENCE_TEMPERATURE);
        let sagnac: f64 =
            rate.windows(2).map(|w| d.scale.apply(0.5 * (w[0] + w[1]).dot(&axis) * gain) / parts).sum();
        let true_rate = rate.windows(2).map(|w| 0.5 * (w[0] + w[1]).dot(&d.input_axis) / parts).sum();
        let shupe = d.midpoint * (coil_now - coil_before) / step_s;
        let faraday = d.faraday * around.magnetic_field.dot(&axis);
        let drift = self.readout.drift(step_s);
        let rate = self.readout.read(sagnac + shupe + faraday + drift, around, step_s);
        FogReading { rate, true_rate }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ideal_gyro_reads_the_mean_rate_along_its_axis() {
        let mut fog = Fog::new(FogDesign::ideal(Vector3::new(0.0, 1.0, 1.0)), 1, "f");
        let rate = [Vector3::zeros(), Vector3::new(3.0, 0.2, 0.0), Vector3::new(0.0, 0.4, 0.0)];
        let said = fog.step(&rate, &Surroundings::default(), 0.1);
        assert!((said.rate - 0.2 / 2f64.sqrt()).abs() < 1e-15 && said.rate == said.true_rate);
    }

    #[test]
    fn the_coil_feels_the_rate_of_temperature_after_its_lag_and_the_field_along_it() {
        let design =
            FogDesign { midpoint: 2.0, faraday: 3.0, coil_lag_s: 20.0, ..FogDesign::ideal(Vector3::x()) };
        let mut fog = Fog::new(design, 1, "f");
        let mut said = 0.0;
        for k in 0..400 {
            let around = Surroundings {
                temperature: 20.0 + 0.01 * f64::from(k),
                magnetic_field: Vector3::new(5e-5, 1.0, 0.0),
                ..Surroundings::default()
            };
            said = fog.step(&[Vector3::zeros(); 2], &around, 1.0).rate;
        }
        assert!((said - 0.02 - 1.5e-4).abs() < 1e-9, "{said}");
    }
}
