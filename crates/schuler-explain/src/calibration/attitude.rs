//! The attitude at the start of a segment: from levelling, or from the angle of the table [TMP-14].
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};

use super::estimator::{Estimator, Found, Pass, Segment};
use super::experiment::{Arrangement, CalibrationError, Cycle, invalid};
use super::kinematics::{body_rotation, orthonormal, vee};

/// Seconds of the coarse levelling.
const LEVELLING: usize = 10;

impl Estimator<'_> {
    /// Attitude and its statistics at the start of a segment.
    pub(super) fn start(
        &self,
        pass: &mut Pass,
        segment: &Segment,
        before: Option<Found>,
        remounted: bool,
    ) -> Result<Matrix3<f64>, CalibrationError> {
        let cycle = &self.experiment.cycles[segment.cycle];
        match self.experiment.arrangement {
            Arrangement::CompleteUnit => {
                let levelled = self.level(segment, cycle)?;
                let attitude = match before {
                    None => levelled,
                    Some(found) => self.rewind(pass, segment, &found.end_attitude)?,
                };
                // What levelling says of the error of the attitude that the pass starts from.
                let mean = vee(&(levelled * attitude.transpose()));
                let up = levelled.column(2);
                let prior = &self.experiment.attitude;
                let vertical = up * up.transpose();
                let covariance =
                    vertical * prior.azimuth.powi(2) + (Matrix3::identity() - vertical) * prior.level.powi(2);
                let factor = covariance.cholesky().map_or_else(Matrix3::zeros, |c| c.l());
                let m = self.layout.count;
                let mut rows = DMatrix::zeros(3, m + 3);
                rows.fixed_view_mut::<3, 3>(0, m).copy_from(&factor);
                pass.filter.set_tail(&rows, &DVector::from_column_slice(mean.as_slice()));
                Ok(attitude)
            }
            Arrangement::GyroBlock { mounting, .. } => {
                self.start_on_table(pass, segment, before, remounted.then_some(mounting))
            }
        }
    }

    /// The same with the table's angle: the attitude error is fully correlated with those of mounting and base, up to
    /// the noise of the angle.
    fn start_on_table(
        &self,
        pass: &mut Pass,
        segment: &Segment,
        before: Option<Found>,
        remount: Option<f64>,
    ) -> Result<Matrix3<f64>, CalibrationError> {
        let cycle = &self.experiment.cycles[segment.cycle];
        let Some(at) = self.layout.mounting else { return invalid("arrangement", "has no mounting") };
        let m = self.layout.count;
        let columns = m + 3;
        // Mounting anew: its own errors, uncorrelated.
        let mounting_rows = match remount {
            None => pass.filter.rows(at, 3),
            Some(sigma) => {
                let nominal = before.map_or(Vector3::zeros(), |f| f.mounting);
                pass.about.fixed_rows_mut::<3>(at).copy_from(&nominal);
                pass.filter.x.fixed_rows_mut::<3>(at).copy_from(&-nominal);
                let mut rows = DMatrix::zeros(3, columns);
                rows.fixed_view_mut::<3, 3>(0, at).fill_diagonal(sigma);
                rows
            }
        };
        let angle = cycle.table_angle[segment.first];
        if !angle.is_finite() {
            return invalid(
                &format!("cycles[{}].table_angle[{}]", segment.cycle, segment.first),
                "is not a finite number, and the attitude starts from it",
            );
        }
        let (table, lever) = self.table(cycle, angle, &pass.about);
        let attitude = match before {
            None => table,
            Some(found) => self.rewind(pass, segment, &found.end_attitude)?,
        };
        let residual = -vee(&(attitude * table.transpose()));
        let base_rows = pass.filter.rows(0, 3);
        let mut own = DMatrix::zeros(3, columns);
        let sigma = self.table_sigma(cycle);
        own.fixed_view_mut::<3, 3>(0, m).copy_from(&Matrix3::from_diagonal(&sigma));
        let lever_rows = DMatrix::from_fn(3, columns, |i, j| {
            (0..3).map(|k| lever[(i, k)] * base_rows[(k, j)]).sum::<f64>()
        });
        let attitude_rows = own - &mounting_rows - lever_rows;
        let x = &pass.filter.x;
        let mean = residual - x.fixed_rows::<3>(at) - lever * x.fixed_rows::<3>(0);
        let mut rows = DMatrix::zeros(6, columns);
        rows.rows_mut(0, 3).copy_from(&mounting_rows);
        rows.rows_mut(3, 3).copy_from(&attitude_rows);
        let mut means = DVector::zeros(6);
        means.fixed_rows_mut::<3>(0).copy_from(&x.fixed_rows::<3>(at));
        means.fixed_rows_mut::<3>(3).copy_from(&mean);
        pass.filter.set_tail(&rows, &means);
        Ok(attitude)
    }

    /// Attitude at the start of a segment from that at its end, with the pass's parameters.
    fn rewind(
        &self,
        pass: &Pass,
        segment: &Segment,
        end: &Matrix3<f64>,
    ) -> Result<Matrix3<f64>, CalibrationError> {
        let cycle = &self.experiment.cycles[segment.cycle];
        let samples = self.experiment.samples_per_second();
        let mut body = Matrix3::identity();
        for second in segment.first..segment.first + segment.seconds {
            let values = self.layout.gyro_values(&pass.about, &self.features[segment.cycle][second]);
            let outputs = &cycle.rate[second * samples..(second + 1) * samples];
            let turn = body_rotation(outputs, &values, self.experiment.sample_s).ok_or_else(|| {
                CalibrationError::Numerical {
                    cycle: segment.cycle + 1,
                    second,
                    problem: "the gyro matrix became singular".to_owned(),
                }
            })?;
            body = orthonormal(&(turn * body));
        }
        let earth = self.earth.rotation_over(segment.seconds * samples);
        Ok(orthonormal(&(body.transpose() * end * earth.transpose())))
    }

    /// Attitude at the start of a segment from the specific force of its first seconds and the stated azimuth.
    fn level(&self, segment: &Segment, cycle: &Cycle) -> Result<Matrix3<f64>, CalibrationError> {
        let samples = self.experiment.samples_per_second();
        let first = segment.first * samples;
        let mut body = Matrix3::identity();
        let mut up = Vector3::zeros();
        for k in first..first + LEVELLING * samples {
            let turn = Vector3::from(cycle.rate[k]) * self.experiment.sample_s;
            let force = Vector3::from(cycle.specific_force[k]);
            if force.iter().all(|f| f.is_finite()) {
                let middle = Rotation3::new(turn * -0.5) * body;
                up += middle.transpose() * force;
            }
            body = Rotation3::new(-turn) * body;
        }
        let field = format!("cycles[{}].specific_force", segment.cycle);
        if up.norm() < 1e-3 {
            return invalid(
                &field,
                "has no finite sample in the first 10 s, and the attitude starts from them",
            );
        }
        let up = up.normalize();
        let axis = Vector3::ith(cycle.axis, 1.0);
        let along = axis - up * up.dot(&axis);
        if along.norm() < 0.8 {
            let field = format!("cycles[{}].axis", segment.cycle);
            return invalid(
                &field,
                "is not the horizontal one: the accelerometers see it tilted by more than 37 degrees",
            );
        }
        let along = along.normalize();
        let (sin, cos) = cycle.azimuth.sin_cos();
        let local = Matrix3::from_columns(&[
            Vector3::z(),
            Vector3::new(sin, cos, 0.0),
            Vector3::z().cross(&Vector3::new(sin, cos, 0.0)),
        ]);
        Ok(Matrix3::from_columns(&[up, along, up.cross(&along)]) * local.transpose())
    }

    /// 1-σ of the attitude that the table tells, about the body's axes: the angle sensor speaks of one of them.
    pub(super) fn table_sigma(&self, cycle: &Cycle) -> Vector3<f64> {
        match self.experiment.arrangement {
            Arrangement::CompleteUnit => Vector3::zeros(),
            Arrangement::GyroBlock { angle, wobble, .. } => {
                let mut sigma = Vector3::repeat(wobble);
                sigma[cycle.axis] = wobble.hypot(angle);
                sigma
            }
        }
    }

    /// Attitude that the table tells at an angle with the errors of base and mounting in `about`, and the lever of the
    /// base's errors: `C_t = exp(−[κ]×) K0 R1(α) exp(−[n]×) N0`, `K0 R1(α)` [TMP-14].
    pub(super) fn table(
        &self,
        cycle: &Cycle,
        angle: f64,
        about: &DVector<f64>,
    ) -> (Matrix3<f64>, Matrix3<f64>) {
        let (sin, cos) = cycle.azimuth.sin_cos();
        let along = Vector3::new(sin, cos, 0.0);
        let base = Matrix3::from_columns(&[along, Vector3::z(), along.cross(&Vector3::z())]).transpose();
        let turn = Rotation3::new(Vector3::x() * -angle).into_inner();
        let mut fixture = Matrix3::zeros();
        for k in 0..3 {
            fixture[((cycle.axis + k) % 3, k)] = 1.0;
        }
        let lever = fixture * turn;
        let mounting =
            self.layout.mounting.map_or(Vector3::zeros(), |at| about.fixed_rows::<3>(at).into_owned());
        let base_error: Vector3<f64> = about.fixed_rows::<3>(0).into_owned();
        let attitude =
            Rotation3::new(-mounting).into_inner() * lever * Rotation3::new(-base_error).into_inner() * base;
        (attitude, lever)
    }
}
