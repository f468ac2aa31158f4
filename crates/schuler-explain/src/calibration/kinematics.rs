//! One second of attitude with its sensitivities [TMP-12].
//!
//! `Ċ = −[ω − C u]× C` for the body-from-local (east, north, up) matrix `C`, in sub-steps of one sample `h`:
//! `C ← A C E`, `Φ ← A Φ`, `Ψ ← A Ψ + h A_h [I, ω_x·, ω_y·, ω_z·]`, with `A = exp(−[ω h]×)`, `A_h = exp(−[ω h/2]×)` and
//! `E = exp(+[u h]×)`. The half-step rotation is what keeps false observability out.
//!
//! `Ψ` has one column for each of twelve gyro coefficients (biases x, y, z, then the matrix row by row), still without the
//! `(I + M)⁻¹` that [`of_coefficients`] adds; a coefficient's
//! parts at the features follow by multiplication with the features, which do not change within a second.
use std::ops::AddAssign;

use nalgebra::{Matrix3, Rotation3, SMatrix, Vector3};

/// Earth's rotation, rad/s.
pub(super) const EARTH_RATE: f64 = 7.292115e-5;

/// Sensitivity of an attitude or of a force to the twelve gyro coefficients.
pub(super) type GyroSensitivity = SMatrix<f64, 3, 12>;

/// What the Earth does at the site during one sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct EarthStep {
    sample_s: f64,
    gravity: f64,
    /// Rotation of the local frame over one sample, as a vector, rad, and as a matrix.
    turn: Vector3<f64>,
    rotation: Matrix3<f64>,
    /// Up at the start, in the middle and at the end of a sample, seen from the local frame of its start.
    up: [Vector3<f64>; 3],
}

/// Values of the gyros' coefficients at one instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct TriadValues {
    /// Bias.
    pub(super) bias: Vector3<f64>,
    /// I + M.
    pub(super) matrix: Matrix3<f64>,
}

/// What happened in one second.
#[derive(Clone, Copy, Debug)]
pub(super) struct Second {
    /// Attitude error at the end from that at the start.
    pub(super) transition: Matrix3<f64>,
    /// Attitude error at the end from errors `ν` of the corrected rate: constant, and times each component of the rate.
    pub(super) sensitivity: GyroSensitivity,
    /// Mean specific force, m/s².
    pub(super) force: Vector3<f64>,
    /// Mean of `[f]×` times the attitude error, from the error at the start.
    pub(super) force_transition: Matrix3<f64>,
    /// The same from errors of the corrected rate.
    pub(super) force_sensitivity: GyroSensitivity,
}

/// From sensitivity to errors of the corrected rate to sensitivity to errors of the coefficients, which reach the rate
/// through `(I + M)⁻¹`. Where a mounting is not repeatable the matrix is known only up to a rotation; leaving the inverse out
/// turns that rotation into errors of other coefficients, in proportion to M.
pub(super) fn of_coefficients(sensitivity: &GyroSensitivity, inverse: &Matrix3<f64>) -> GyroSensitivity {
    let mut mixed = GyroSensitivity::zeros();
    for i in 0..3 {
        for k in 0..3 {
            let weight = inverse[(k, i)];
            let bias = sensitivity.column(k) * weight;
            mixed.column_mut(i).add_assign(&bias);
            for j in 0..3 {
                let element = sensitivity.column(3 + 3 * k + j) * weight;
                mixed.column_mut(3 + 3 * i + j).add_assign(&element);
            }
        }
    }
    mixed
}

impl EarthStep {
    pub(super) fn new(latitude: f64, gravity: f64, sample_s: f64) -> Self {
        let earth = Vector3::new(0.0, latitude.cos(), latitude.sin()) * EARTH_RATE;
        let turned = |s: f64| Rotation3::new(earth * s).into_inner();
        let up = [0.0, 0.5, 1.0].map(|part| turned(part * sample_s) * Vector3::z());
        Self { sample_s, gravity, turn: earth * sample_s, rotation: turned(sample_s), up }
    }

    /// Rotation of the local frame over `samples`.
    pub(super) fn rotation_over(&self, samples: usize) -> Matrix3<f64> {
        // A rotation about a fixed axis: its powers are exponentials.
        Rotation3::new(self.turn * samples as f64).into_inner()
    }
}

/// Body rates from gyro outputs.
fn body_rate(output: &[f64; 3], values: &TriadValues, inverse: &Matrix3<f64>) -> Vector3<f64> {
    inverse * (Vector3::from(*output) - values.bias)
}

/// Carries `attitude` over one second of gyro `outputs`; `inverse` is that of I + M.
pub(super) fn propagate(
    attitude: &mut Matrix3<f64>,
    outputs: &[[f64; 3]],
    values: &TriadValues,
    inverse: &Matrix3<f64>,
    earth: &EarthStep,
) -> Second {
    let h = earth.sample_s;
    let mut second = Second {
        transition: Matrix3::identity(),
        sensitivity: GyroSensitivity::zeros(),
        force: Vector3::zeros(),
        force_transition: Matrix3::zeros(),
        force_sensitivity: GyroSensitivity::zeros(),
    };
    for output in outputs {
        let rate = body_rate(output, values, inverse);
        let half = Rotation3::new(rate * (-0.5 * h)).into_inner();
        let whole = half * half;

        // Mean specific force of the sample by Simpson's rule.
        let [start, middle, end] = earth.up.map(|up| *attitude * up);
        let force = (start + half * middle * 4.0 + whole * end) * (earth.gravity / 6.0);

        let transition = whole * second.transition;
        let mut sensitivity = whole * second.sensitivity;
        for i in 0..3 {
            let push = half.column(i) * h;
            sensitivity.column_mut(i).add_assign(&push);
            for j in 0..3 {
                sensitivity.column_mut(3 + 3 * i + j).add_assign(&(push * rate[j]));
            }
        }
        let cross = force.cross_matrix() * 0.5;
        second.force += force;
        second.force_transition += cross * (second.transition + transition);
        second.force_sensitivity += cross * (second.sensitivity + sensitivity);
        second.transition = transition;
        second.sensitivity = sensitivity;
        *attitude = whole * *attitude * earth.rotation;
    }
    let count = outputs.len() as f64;
    second.force /= count;
    second.force_transition /= count;
    second.force_sensitivity /= count;
    *attitude = orthonormal(attitude);
    second
}

/// Rotation of the body over gyro `outputs`: `C ← (this) C E…E`. `None` if I + M is singular.
pub(super) fn body_rotation(
    outputs: &[[f64; 3]],
    values: &TriadValues,
    sample_s: f64,
) -> Option<Matrix3<f64>> {
    let inverse = values.matrix.try_inverse()?;
    let turn =
        |output: &[f64; 3]| Rotation3::new(body_rate(output, values, &inverse) * -sample_s).into_inner();
    Some(orthonormal(&outputs.iter().fold(Matrix3::identity(), |product, output| turn(output) * product)))
}

/// The nearest rotation, one Newton step from a matrix that is one to rounding.
pub(super) fn orthonormal(c: &Matrix3<f64>) -> Matrix3<f64> {
    c * (Matrix3::identity() * 3.0 - c.transpose() * c) * 0.5
}

/// Vector of the skew part.
pub(super) fn vee(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of the golden case at φ = (1, 0.5, −0.2).
    fn golden_values() -> TriadValues {
        let mut matrix = Matrix3::identity();
        matrix[(0, 0)] += 1e-3;
        matrix[(1, 0)] += 2e-3 + 0.5 * 1e-3;
        TriadValues { bias: Vector3::new(1e-4 + 0.5 * 2e-5, 0.0, -0.2 * 1e-5), matrix }
    }

    #[test]
    fn tmp_15_golden_sub_step() {
        let values = golden_values();
        let output = [0.2, -0.1, 0.05];
        let inverse = values.matrix.try_inverse().expect("regular");
        let rate = body_rate(&output, &values, &inverse);
        assert!((rate - Vector3::new(0.1996903097, -0.1004992258, 0.050002)).amax() < 1e-10, "{rate}");

        let earth = EarthStep::new(55.7f64.to_radians(), 9.81, 0.05);
        let mut attitude = Matrix3::identity();
        let second = propagate(&mut attitude, &[output], &values, &inverse, &earth);
        let row = Vector3::new(0.9999842469, 0.0024719478, 0.0050393871);
        assert!((attitude.row(0).transpose() - row).amax() < 1e-10, "{attitude}");
        let bias = Vector3::new(0.0499998031, -6.28157e-5, -1.254673e-4);
        assert!((second.sensitivity.column(0) - bias).amax() < 1e-10, "{}", second.sensitivity.column(0));
        let matrix = Vector3::new(1.2418e-5, 0.0099843833, -4.98607e-5);
        assert!((second.sensitivity.column(6) - matrix).amax() < 1e-9, "{}", second.sensitivity.column(6));
    }

    /// Five seconds of varying rotation: `Ψ`, and the mean of `[f]×β`, against differences of the propagation itself.
    #[test]
    fn tmp_15_sensitivities_match_finite_differences() {
        let earth = EarthStep::new(55.7f64.to_radians(), 9.81, 0.05);
        let outputs: Vec<[f64; 3]> = (0..100)
            .map(|k| {
                let t = 0.05 * f64::from(k);
                [0.2 + 0.05 * t.sin(), -0.1 + 0.02 * t, 0.05 * (2.0 * t).cos()]
            })
            .collect();
        let start = Rotation3::new(Vector3::new(0.3, -0.2, 1.0)).into_inner();
        let values = golden_values();
        let run = |values: &TriadValues, extra: &dyn Fn(Vector3<f64>) -> Vector3<f64>, turn: Vector3<f64>| {
            // `extra` is an error of the corrected rate, as a function of that rate.
            let inverse = values.matrix.try_inverse().expect("regular");
            let disturbed: Vec<[f64; 3]> = outputs
                .iter()
                .map(|o| (Vector3::from(*o) + values.matrix * extra(body_rate(o, values, &inverse))).into())
                .collect();
            // Ĉ = (I − [β]×) C: an error β at the start.
            let mut attitude = Rotation3::new(-turn).into_inner() * start;
            let second = propagate(&mut attitude, &disturbed, values, &inverse, &earth);
            (attitude, second)
        };
        let none = |_: Vector3<f64>| Vector3::zeros();
        let (nominal, second) = run(&values, &none, Vector3::zeros());
        let inverse = values.matrix.try_inverse().expect("regular");
        let coefficients =
            [second.sensitivity, second.force_sensitivity].map(|s| of_coefficients(&s, &inverse));
        let size = 1e-6;
        let check =
            |(matrix, changed): (Matrix3<f64>, Second), attitude: Vector3<f64>, force: Vector3<f64>| {
                let got = -vee(&(matrix * nominal.transpose())) / size;
                assert!((got - attitude).norm() < 1e-4 * attitude.norm(), "attitude {got} {attitude}");
                // f̂ = (I − [β]×) f = f + [f]× β; the mean over a sample is taken of a product that bends within it.
                let got = (changed.force - second.force) / size;
                assert!((got - force).norm() < 1e-3 * force.norm(), "force {got} {force}");
            };
        for i in 0..3 {
            let unit = Vector3::ith(i, size);
            check(
                run(&values, &none, unit),
                second.transition.column(i).into_owned(),
                second.force_transition.column(i).into_owned(),
            );
            for column in [i, 3 + 3 * i, 4 + 3 * i, 5 + 3 * i] {
                let error =
                    |rate: Vector3<f64>| if column < 3 { unit } else { unit * rate[column - 3 - 3 * i] };
                check(
                    run(&values, &error, Vector3::zeros()),
                    second.sensitivity.column(column).into_owned(),
                    second.force_sensitivity.column(column).into_owned(),
                );
                // The truth exceeds what is assumed.
                let mut assumed = values;
                if column < 3 {
                    assumed.bias[i] -= size;
                } else {
                    assumed.matrix[(i, column - 3 - 3 * i)] -= size;
                }
                let [attitude, force] = coefficients.map(|s| s.column(column).into_owned());
                check(run(&assumed, &none, Vector3::zeros()), attitude, force);
            }
        }
    }
}
