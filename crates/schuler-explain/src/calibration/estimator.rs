//! The passes over a run: state, measurements, feedback [TMP-12], [TMP-14].
use std::cell::Cell;

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};

use super::experiment::{Arrangement, CalibrationError, Cycle, Experiment, invalid};
use super::filter::SquareRootFilter;
use super::kinematics::{
    EarthStep, Second, TriadValues, body_rotation, of_coefficients, orthonormal, propagate, vee,
};
use super::result::ACCELEROMETER_MATRIX;

/// Shortest stretch of uninterrupted gyro data that is used, s.
const SHORTEST: usize = 60;
/// Seconds of data between reports to whoever watches.
const WATCHED: usize = 20;
/// Seconds of the coarse levelling.
const LEVELLING: usize = 10;

/// Where the parameters lie in the state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    /// Features of each coefficient.
    pub(super) features: usize,
    /// First gyro parameter; three of the table's base before it if there are any.
    pub(super) gyro: usize,
    /// First accelerometer parameter.
    pub(super) accelerometer: Option<usize>,
    /// First of three mounting errors, the last parameters.
    mounting: Option<usize>,
    /// All parameters.
    pub(super) count: usize,
}

impl Layout {
    pub(super) fn of(experiment: &Experiment) -> Self {
        let np = experiment.features.count();
        match experiment.arrangement {
            Arrangement::CompleteUnit => {
                Self { features: np, gyro: 0, accelerometer: Some(12 * np), mounting: None, count: 21 * np }
            }
            Arrangement::GyroBlock { .. } => Self {
                features: np,
                gyro: 3,
                accelerometer: None,
                mounting: Some(3 + 12 * np),
                count: 6 + 12 * np,
            },
        }
    }

    /// Prior sigma of every parameter.
    pub(super) fn prior(&self, experiment: &Experiment) -> Vec<f64> {
        let priors = &experiment.priors;
        let repeat = |prior: super::experiment::PriorSigma, times: usize| {
            (0..times * self.features).map(move |k| prior.at(k % self.features))
        };
        let gyro = repeat(priors.gyro_bias, 3).chain(repeat(priors.gyro_matrix, 9));
        match experiment.arrangement {
            Arrangement::CompleteUnit => {
                let accelerometer =
                    repeat(priors.accelerometer_bias, 3).chain(repeat(priors.accelerometer_matrix, 6));
                gyro.chain(accelerometer).collect()
            }
            Arrangement::GyroBlock { mounting, base, .. } => {
                [base; 3].into_iter().chain(gyro).chain([mounting; 3]).collect()
            }
        }
    }

    /// Value of the coefficient whose parts begin at `first`.
    fn value(&self, p: &DVector<f64>, first: usize, phi: &[f64]) -> f64 {
        phi.iter().zip(p.rows(first, self.features).iter()).map(|(f, p)| f * p).sum()
    }

    fn gyro_values(&self, p: &DVector<f64>, phi: &[f64]) -> TriadValues {
        let at = |slot: usize| self.value(p, self.gyro + slot * self.features, phi);
        TriadValues {
            bias: Vector3::from_fn(|i, _| at(i)),
            matrix: Matrix3::identity() + Matrix3::from_fn(|i, j| at(3 + 3 * i + j)),
        }
    }

    fn accelerometer_values(&self, first: usize, p: &DVector<f64>, phi: &[f64]) -> TriadValues {
        let at = |slot: usize| self.value(p, first + slot * self.features, phi);
        let mut matrix = Matrix3::identity();
        for (k, (i, j)) in ACCELEROMETER_MATRIX.into_iter().enumerate() {
            matrix[(i, j)] += at(3 + k);
        }
        TriadValues { bias: Vector3::from_fn(|i, _| at(i)), matrix }
    }
}

/// A stretch of a cycle with uninterrupted gyros.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Segment {
    cycle: usize,
    first: usize,
    seconds: usize,
}

/// What a pass found in one segment, for the next to start from.
#[derive(Clone, Copy, Debug)]
struct Found {
    end_attitude: Matrix3<f64>,
    mounting: Vector3<f64>,
}

/// How a cycle's measurements agreed with their predictions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Agreement {
    /// Sum of squared normalised innovations.
    pub(super) sum: f64,
    /// Scalar measurements.
    pub(super) count: usize,
    /// Seconds that gave any.
    pub(super) seconds: usize,
}

/// The outcome of all passes.
#[derive(Clone, Debug)]
pub(super) struct Outcome {
    /// Parameters.
    pub(super) parameters: DVector<f64>,
    /// Their covariance.
    pub(super) covariance: DMatrix<f64>,
    /// Cycle by cycle.
    pub(super) agreement: Vec<Agreement>,
    /// Largest move of a gyro or accelerometer parameter in the last pass, sigmas.
    pub(super) last_shift: f64,
}

/// A run with everything that does not change between passes.
pub(super) struct Estimator<'a> {
    experiment: &'a Experiment,
    layout: Layout,
    prior: Vec<f64>,
    earth: EarthStep,
    /// Scaled features, cycle by cycle, second by second.
    features: &'a [Vec<Vec<f64>>],
    segments: Vec<Segment>,
    /// Told the seconds of data done and to be done; false ends the work.
    watch: &'a dyn Fn(usize, usize) -> bool,
    done: Cell<usize>,
}

/// The mean specific force of a second.
struct Force {
    /// m/s².
    mean: Vector3<f64>,
    /// Of each component.
    variance: f64,
    /// Accelerometer coefficients.
    values: TriadValues,
    /// First accelerometer parameter.
    first: usize,
}

/// What one pass carries along.
struct Pass {
    filter: SquareRootFilter,
    /// Parameters about which the pass is linear; in the first pass they move.
    about: DVector<f64>,
    agreement: Vec<Agreement>,
    /// Whether estimates are fed back at once: the first pass.
    extended: bool,
}

impl<'a> Estimator<'a> {
    /// # Errors
    /// A cycle without a usable stretch.
    pub(super) fn new(
        experiment: &'a Experiment,
        features: &'a [Vec<Vec<f64>>],
        watch: &'a dyn Fn(usize, usize) -> bool,
    ) -> Result<Self, CalibrationError> {
        let layout = Layout::of(experiment);
        let samples = experiment.samples_per_second();
        let mut segments = Vec::new();
        for (k, cycle) in experiment.cycles.iter().enumerate() {
            let before = segments.len();
            segments.extend(stretches(k, cycle, samples));
            if segments.len() == before {
                return invalid(
                    &format!("cycles[{k}].rate"),
                    "has no stretch of 60 s in which every sample is a finite number",
                );
            }
        }
        Ok(Self {
            experiment,
            layout,
            prior: layout.prior(experiment),
            earth: EarthStep::new(experiment.site.latitude, experiment.site.gravity, experiment.sample_s),
            features,
            segments,
            watch,
            done: Cell::new(0),
        })
    }

    /// All passes: the first extended, the others linear about the one before.
    ///
    /// # Errors
    /// Data that contradict their description, or a covariance that lost its meaning.
    pub(super) fn run(&self) -> Result<Outcome, CalibrationError> {
        let mut found = None;
        let mut pass = self.pass(&mut found, DVector::zeros(self.layout.count))?;
        let mut last_shift = f64::INFINITY;
        for _ in 1..self.experiment.passes {
            let before = pass.about.clone();
            pass = self.pass(&mut found, before.clone())?;
            let covariance = pass.filter.covariance();
            let end = self.layout.mounting.unwrap_or(self.layout.count);
            last_shift = (self.layout.gyro..end)
                .map(|k| (pass.about[k] - before[k]).abs() / covariance[(k, k)].sqrt())
                .fold(0.0, f64::max);
        }
        Ok(Outcome {
            covariance: pass.filter.covariance(),
            parameters: pass.about,
            agreement: pass.agreement,
            last_shift,
        })
    }

    /// One pass about `about`; extended if nothing was `found` before.
    fn pass(&self, found: &mut Option<Vec<Found>>, about: DVector<f64>) -> Result<Pass, CalibrationError> {
        let m = self.layout.count;
        let extended = found.is_none();
        let all: usize = self.segments.iter().map(|segment| segment.seconds).sum();
        let all = all * usize::from(self.experiment.passes);
        let mut pass = Pass {
            filter: SquareRootFilter::new(&self.prior),
            about,
            agreement: vec![Agreement::default(); self.experiment.cycles.len()],
            extended,
        };
        if !extended {
            pass.filter.x.rows_mut(0, m).copy_from(&-&pass.about);
        }
        let mut now = Vec::with_capacity(self.segments.len());
        for (k, segment) in self.segments.iter().enumerate() {
            let before = found.as_ref().map(|f| f[k]);
            let remounted = k == 0 || self.segments[k - 1].cycle != segment.cycle;
            let mut attitude = self.start(&mut pass, segment, before, remounted)?;
            for second in segment.first..segment.first + segment.seconds {
                self.done.set(self.done.get() + 1);
                if self.done.get().is_multiple_of(WATCHED) && !(self.watch)(self.done.get(), all) {
                    return Err(CalibrationError::Stopped);
                }
                self.second(&mut pass, segment.cycle, second, &mut attitude)?;
                if extended {
                    feed_back(&mut pass, &mut attitude);
                }
            }
            if !pass.filter.is_finite() {
                return Err(CalibrationError::Numerical {
                    cycle: segment.cycle + 1,
                    second: segment.first + segment.seconds,
                    problem: "the covariance holds a number that is not finite".to_owned(),
                });
            }
            let error = pass.filter.x.fixed_rows::<3>(m).into_owned();
            let mounting = self.layout.mounting.map_or(Vector3::zeros(), |at| {
                pass.about.fixed_rows::<3>(at) + pass.filter.x.fixed_rows::<3>(at)
            });
            now.push(Found { end_attitude: turned(&error, &attitude), mounting });
        }
        // The parameters' estimate; a linear pass keeps them in the filter until here.
        pass.about += pass.filter.x.rows(0, m);
        *found = Some(now);
        Ok(pass)
    }

    /// Attitude and its statistics at the start of a segment.
    fn start(
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

    /// One second: prediction, measurement, step.
    fn second(
        &self,
        pass: &mut Pass,
        cycle_index: usize,
        second: usize,
        attitude: &mut Matrix3<f64>,
    ) -> Result<(), CalibrationError> {
        let failed = |problem: &str| CalibrationError::Numerical {
            cycle: cycle_index + 1,
            second,
            problem: problem.to_owned(),
        };
        let cycle = &self.experiment.cycles[cycle_index];
        let samples = self.experiment.samples_per_second();
        let span = second * samples..(second + 1) * samples;
        let phi = &self.features[cycle_index][second];
        let values = self.layout.gyro_values(&pass.about, phi);
        let inverse = values.matrix.try_inverse().ok_or_else(|| failed("the gyro matrix became singular"))?;
        let mut moved = propagate(attitude, &cycle.rate[span.clone()], &values, &inverse, &self.earth);
        moved.sensitivity = of_coefficients(&moved.sensitivity, &inverse);
        moved.force_sensitivity = of_coefficients(&moved.force_sensitivity, &inverse);
        let noise = &self.experiment.noise;
        let agreement = &mut pass.agreement[cycle_index];

        if let Some(first) = self.layout.accelerometer {
            let forces = &cycle.specific_force[span];
            let mean =
                forces.iter().fold(Vector3::zeros(), |sum, f| sum + Vector3::from(*f)) / samples as f64;
            if mean.iter().all(|f| f.is_finite()) {
                // The attitude's walk within the second adds a third of its variance.
                let walk = self.experiment.site.gravity * noise.angle_random_walk;
                let force = Force {
                    mean,
                    variance: noise.specific_force.powi(2) + walk * walk / 3.0,
                    values: self.layout.accelerometer_values(first, &pass.about, phi),
                    first,
                };
                self.measure_force(&mut pass.filter, agreement, phi, &moved, &force);
            }
        }
        pass.filter.step(
            &moved.transition,
            &moved.sensitivity,
            self.layout.gyro,
            phi,
            noise.angle_random_walk,
        );
        if let Some(at) = self.layout.mounting {
            let sigma = self.table_sigma(cycle);
            // Before the mounting is known its square disturbs the first pass.
            let excess = if pass.extended { self.prior[at].powi(4) } else { 0.0 };
            let angle = cycle.table_angle[second + 1];
            if angle.is_finite() {
                let (table, lever) = self.table(cycle, angle, &pass.about);
                let residual = -vee(&(*attitude * table.transpose()));
                let m = self.layout.count;
                let mut h = vec![0.0; m + 3];
                for i in 0..3 {
                    h.fill(0.0);
                    for k in 0..3 {
                        h[k] = lever[(i, k)];
                    }
                    h[at + i] = 1.0;
                    h[m + i] = 1.0;
                    let innovation = pass.filter.measure(&h, residual[i], sigma[i] * sigma[i] + excess);
                    agreement.sum += innovation.value * innovation.value / innovation.variance;
                    agreement.count += 1;
                }
                agreement.seconds += 1;
            }
        }
        if !agreement.sum.is_finite() {
            return Err(failed("an innovation is not a finite number"));
        }
        Ok(())
    }

    /// Three measurements of the mean specific force of a second, on the state at its start.
    fn measure_force(
        &self,
        filter: &mut SquareRootFilter,
        agreement: &mut Agreement,
        phi: &[f64],
        moved: &Second,
        force: &Force,
    ) {
        let Force { mean, variance, values, first } = force;
        let (np, m) = (self.layout.features, self.layout.count);
        let residual = mean - values.matrix * moved.force - values.bias;
        let attitude = -(values.matrix * moved.force_transition);
        let gyro = -(values.matrix * moved.force_sensitivity);
        let mut h = vec![0.0; m + 3];
        for i in 0..3 {
            h.fill(0.0);
            let mut set = |start: usize, slot: usize, sensitivity: f64| {
                for (h, phi) in h[start + slot * np..].iter_mut().zip(phi) {
                    *h = sensitivity * phi;
                }
            };
            for slot in 0..12 {
                set(self.layout.gyro, slot, gyro[(i, slot)]);
            }
            set(*first, i, 1.0);
            for (k, (row, column)) in ACCELEROMETER_MATRIX.into_iter().enumerate() {
                if row == i {
                    set(*first, 3 + k, moved.force[column]);
                }
            }
            for k in 0..3 {
                h[m + k] = attitude[(i, k)];
            }
            let innovation = filter.measure(&h, residual[i], *variance);
            agreement.sum += innovation.value * innovation.value / innovation.variance;
            agreement.count += 1;
        }
        agreement.seconds += 1;
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
    fn table_sigma(&self, cycle: &Cycle) -> Vector3<f64> {
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
    fn table(&self, cycle: &Cycle, angle: f64, about: &DVector<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
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

/// Takes the estimate into attitude and parameters.
fn feed_back(pass: &mut Pass, attitude: &mut Matrix3<f64>) {
    let m = pass.about.len();
    let error = pass.filter.x.fixed_rows::<3>(m).into_owned();
    *attitude = turned(&error, attitude);
    pass.about += pass.filter.x.rows(0, m);
    pass.filter.x.fill(0.0);
}

/// `Ĉ = (I − [β]×) C` solved for `C`.
fn turned(error: &Vector3<f64>, attitude: &Matrix3<f64>) -> Matrix3<f64> {
    Rotation3::new(*error).into_inner() * attitude
}

/// Stretches of whole seconds in which every gyro sample is finite.
fn stretches(cycle_index: usize, cycle: &Cycle, samples: usize) -> Vec<Segment> {
    let mut found = Vec::new();
    let mut first = 0;
    let seconds = cycle.rate.len() / samples;
    for (second, chunk) in cycle.rate.chunks_exact(samples).enumerate() {
        let finite = chunk.iter().flatten().all(|w| w.is_finite());
        let end = if finite { second + 1 } else { second };
        if (!finite || end == seconds) && end >= first + SHORTEST {
            found.push(Segment { cycle: cycle_index, first, seconds: end - first });
        }
        if !finite {
            first = second + 1;
        }
    }
    found
}
