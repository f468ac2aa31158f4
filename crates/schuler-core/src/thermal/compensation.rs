//! Correction of a triad of gyros, a triad of accelerometers and of single-axis sensors for their thermal errors
//! [TMP-11]: `ω = (I + M_g)⁻¹(ω′ − b_g)`, `f = (I + M_a)⁻¹(f′ − b_a)`, with every element of `b` and `M` linear in
//! the thermal features.
//!
//! Coefficients are single precision, signals (rad/s, m/s²) double: the inverse is written `I − N`, `N = M(I + M)⁻¹`,
//! so that the rounding of single precision falls on the correction, not on the signal.
//!
//! A coefficient block is checked once: whatever the thermal state, `I + M` is then far from singular, because the state
//! is kept within a margin around the calibrated range, with a flag. So the inverse needs no guard at run time.
use serde::{Deserialize, Serialize};

use super::features::{Coefficient, CompensationStatus, FEATURES, FeatureMap, ThermalState, at};
use crate::config::{ConfigError, Problem};
use crate::number::each;
use crate::saved::saved;

/// Version of the coefficient block that this code understands.
pub const BLOCK_VERSION: u16 = 1;
/// Largest row sum of |M| over the range of the calibration: 20 %, which keeps the determinant of I + M above one half.
const MATRIX_LIMIT: f32 = 0.2;

/// Three sensors along the body axes: bias and matrix of scale-factor errors (diagonal) and misalignments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TriadCoefficients {
    /// Bias b, in the sensors' unit (rad/s or m/s²).
    pub bias: [Coefficient; 3],
    /// M: the part of input `j` that sensor `i` adds to its output is `matrix[i][j]`.
    pub matrix: [[Coefficient; 3]; 3],
}

/// One sensor alone: `u′ = (1 + scale)·u + bias`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AxisCoefficients {
    /// Bias, in the sensor's unit.
    pub bias: Coefficient,
    /// Scale-factor error.
    pub scale: Coefficient,
}

/// Everything a calibration found, as it is sent to the navigation computer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompensationBlock {
    /// Version of this block's meaning; [`BLOCK_VERSION`].
    pub version: u16,
    /// Features in which the coefficients are linear.
    pub features: FeatureMap,
    /// Gyros, rad/s.
    pub gyro: TriadCoefficients,
    /// Accelerometers, m/s². The matrix is lower triangular: the body frame is that of the accelerometers.
    pub accelerometer: TriadCoefficients,
}

impl Default for CompensationBlock {
    /// A block that corrects nothing.
    fn default() -> Self {
        Self {
            version: BLOCK_VERSION,
            features: FeatureMap::default(),
            gyro: TriadCoefficients::default(),
            accelerometer: TriadCoefficients::default(),
        }
    }
}

/// A checked coefficient block.
#[derive(Clone, Copy, Debug)]
pub struct Compensator {
    block: CompensationBlock,
}

/// The correction at one thermal state.
#[derive(Clone, Copy, Debug)]
pub struct Correction {
    gyro: Triad,
    accelerometer: Triad,
    /// What limited it.
    pub status: CompensationStatus,
}

/// `b` and `N` of one triad at one thermal state.
#[derive(Clone, Copy, Debug)]
struct Triad {
    bias: [f32; 3],
    shrink: [[f32; 3]; 3],
}

impl Default for Compensator {
    /// Corrects nothing.
    fn default() -> Self {
        Self { block: CompensationBlock::default() }
    }
}

impl Compensator {
    /// Checks the block.
    ///
    /// # Errors
    /// The first field that cannot be flown: another version, a number that is not finite, an accelerometer
    /// matrix that is not lower triangular, a matrix that could come near a singular one.
    pub fn try_build(block: &CompensationBlock) -> Result<Self, ConfigError> {
        if block.version != BLOCK_VERSION {
            return Err(ConfigError::new("thermal.compensation.version", Problem::OutOfRange));
        }
        block.features.check()?;
        let limits = block.features.limits();
        block.gyro.check(&limits, ["thermal.compensation.gyro.bias", "thermal.compensation.gyro.matrix"])?;
        block.accelerometer.check(
            &limits,
            ["thermal.compensation.accelerometer.bias", "thermal.compensation.accelerometer.matrix"],
        )?;
        let [[_, xy, xz], [_, _, yz], _] = block.accelerometer.matrix;
        if [xy, xz, yz].iter().flatten().any(|c| *c != 0.0) {
            let problem =
                Problem::Geometry("must be lower triangular: the accelerometers define the body frame");
            return Err(ConfigError::new("thermal.compensation.accelerometer.matrix", problem));
        }
        Ok(Self { block: *block })
    }

    /// The correction at a thermal state. Never panics.
    pub fn correction(&self, state: &ThermalState) -> Correction {
        let (phi, status) = self.block.features.features(state);
        Correction {
            gyro: self.block.gyro.at(&phi),
            accelerometer: self.block.accelerometer.at(&phi),
            status,
        }
    }
}

impl Correction {
    /// Body rate, rad/s, from the gyros' outputs, rad/s.
    pub fn rate(&self, measured: [f64; 3]) -> [f64; 3] {
        self.gyro.apply(measured)
    }

    /// Specific force, m/s², from the accelerometers' outputs, m/s².
    pub fn specific_force(&self, measured: [f64; 3]) -> [f64; 3] {
        self.accelerometer.apply_triangular(measured)
    }
}

impl TriadCoefficients {
    fn check(&self, limits: &Coefficient, [bias, matrix]: [&'static str; 2]) -> Result<(), ConfigError> {
        if self.bias.iter().flatten().any(|c| !c.is_finite()) {
            return Err(ConfigError::new(bias, Problem::NotFinite));
        }
        for row in &self.matrix {
            let sum = row.iter().fold(0.0, |sum, c| sum + largest(c, limits));
            if !sum.is_finite() {
                return Err(ConfigError::new(matrix, Problem::NotFinite));
            }
            if sum > MATRIX_LIMIT {
                return Err(ConfigError::new(matrix, Problem::OutOfRange));
            }
        }
        Ok(())
    }

    fn at(&self, phi: &Coefficient) -> Triad {
        let m = &self.matrix;
        let m = each!(|i| each!(|j| at(&m[i][j], phi); 0 1 2); 0 1 2);
        let [[a, b, c], [d, e, f], [g, h, i]] = m;
        let (a, e, i) = (1.0 + a, 1.0 + e, 1.0 + i);
        // Adjugate and determinant of I + M; the determinant is above one half by the check of the block.
        let adjugate = [
            [e * i - f * h, c * h - b * i, b * f - c * e],
            [f * g - d * i, a * i - c * g, c * d - a * f],
            [d * h - e * g, b * g - a * h, a * e - b * d],
        ];
        let determinant = a * adjugate[0][0] + b * adjugate[1][0] + c * adjugate[2][0];
        let shrink = each!(|i| each!(|j| {
            (m[i][0] * adjugate[0][j] + m[i][1] * adjugate[1][j] + m[i][2] * adjugate[2][j]) / determinant
        }; 0 1 2); 0 1 2);
        Triad { bias: each!(|i| at(&self.bias[i], phi); 0 1 2), shrink }
    }
}

impl Triad {
    fn apply(&self, measured: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = measured;
        let [bx, by, bz] = self.bias.map(f64::from);
        let [x, y, z] = [x - bx, y - by, z - bz];
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = self.shrink.map(|row| row.map(f64::from));
        [x - (xx * x + xy * y + xz * z), y - (yx * x + yy * y + yz * z), z - (zx * x + zy * y + zz * z)]
    }

    /// The same where `N` is lower triangular, as it is with `M`.
    fn apply_triangular(&self, measured: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = measured;
        let [bx, by, bz] = self.bias.map(f64::from);
        let [x, y, z] = [x - bx, y - by, z - bz];
        let [[xx, ..], [yx, yy, _], [zx, zy, zz]] = self.shrink;
        let [xx, yx, yy, zx, zy, zz] = [xx, yx, yy, zx, zy, zz].map(f64::from);
        [x - xx * x, y - (yx * x + yy * y), z - (zx * x + zy * y + zz * z)]
    }
}

impl AxisCoefficients {
    /// # Errors
    /// A number that is not finite, or a scale-factor error beyond 20 % within the range of the calibration.
    pub fn check(&self, features: &FeatureMap) -> Result<(), ConfigError> {
        features.check()?;
        if self.bias.iter().any(|c| !c.is_finite()) {
            return Err(ConfigError::new("thermal.compensation.axis.bias", Problem::NotFinite));
        }
        let scale = largest(&self.scale, &features.limits());
        if !scale.is_finite() {
            return Err(ConfigError::new("thermal.compensation.axis.scale", Problem::NotFinite));
        }
        if scale > MATRIX_LIMIT {
            return Err(ConfigError::new("thermal.compensation.axis.scale", Problem::OutOfRange));
        }
        Ok(())
    }

    /// The sensor's input from its output at `phi`, as [`FeatureMap::features`] gives it. Checked coefficients keep
    /// the divisor above 0.8.
    pub fn apply(&self, measured: f64, phi: &Coefficient) -> f64 {
        let scale = at(&self.scale, phi);
        let free = measured - f64::from(at(&self.bias, phi));
        free - f64::from(scale / (1.0 + scale)) * free
    }
}

/// Largest magnitude of a coefficient within the range of the calibration; NaN if it is not a number.
fn largest(coefficient: &[f32; FEATURES], limits: &Coefficient) -> f32 {
    coefficient.iter().zip(limits).fold(0.0, |sum, (c, l)| sum + (c * l).max(-c * l))
}

saved!([] TriadCoefficients { bias, matrix });
saved!([] CompensationBlock { version, features, gyro, accelerometer });
saved!([] Compensator { block });
