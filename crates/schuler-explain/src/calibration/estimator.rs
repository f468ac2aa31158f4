//! The passes over a run: state, measurements, feedback [TMP-12], [TMP-14].
use std::cell::Cell;

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};

use super::experiment::{CalibrationError, Cycle, Experiment, invalid};
use super::filter::SquareRootFilter;
use super::kinematics::{EarthStep, Second, TriadValues, of_coefficients, propagate, vee};
use super::layout::Layout;
use super::result::ACCELEROMETER_MATRIX;

/// Shortest stretch of uninterrupted gyro data that is used, s.
const SHORTEST: usize = 60;
/// Seconds of data between reports to whoever watches.
const WATCHED: usize = 20;

/// A stretch of a cycle with uninterrupted gyros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    pub(super) cycle: usize,
    pub(super) first: usize,
    pub(super) seconds: usize,
}

/// What a pass found in one segment, for the next to start from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub(super) end_attitude: Matrix3<f64>,
    pub(super) mounting: Vector3<f64>,
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
    pub(super) experiment: &'a Experiment,
    pub(super) layout: Layout,
    pub(super) prior: Vec<f64>,
    pub(super) earth: EarthStep,
    /// Scaled features, cycle by cycle, second by second.
    pub(super) features: &'a [Vec<Vec<f64>>],
    pub(super) segments: Vec<Segment>,
    /// Told the seconds of data done and to be done; false ends the work.
    pub(super) watch: &'a dyn Fn(usize, usize) -> bool,
    pub(super) done: Cell<usize>,
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
pub(super) struct Pass {
    pub(super) filter: SquareRootFilter,
    /// Parameters about which the pass is linear; in the first pass they move.
    pub(super) about: DVector<f64>,
    pub(super) agreement: Vec<Agreement>,
    /// Whether estimates are fed back at once: the first pass.
    pub(super) extended: bool,
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
