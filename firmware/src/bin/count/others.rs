//! The same filter by libraries of others.
use minikalman::prelude::*;
use minikalman::regular::{RegularKalmanBuilder, RegularObservationBuilder};
use nalgebra::{Matrix4, RealField, RowVector4, Vector4};
use schuler_core::filter::DiscreteModel;

use crate::arithmetic::heading;
use crate::channel::config;
use crate::meter::{Meter, Random};

const SAMPLES: usize = 500;

/// Both libraries on the four-state channel with a velocity in every step.
#[inline(never)]
pub fn count<T: RealField + Copy + MatrixDataType>(meter: &mut Meter, precision: &str) {
    let config = config::<T>();
    let model = config.model(&config.accelerometer, &config.gyro, config.step_s);
    let prior = Matrix4::from_diagonal(&Vector4::new(
        config.initial_velocity_sigma,
        config.initial_vertical_sigma,
        config.accelerometer.sigma,
        config.gyro.sigma,
    ));
    let dense = Dense {
        transition: transition(&model),
        noise: noise(&model),
        mean: Vector4::zeros(),
        covariance: prior * prior,
        variance: config.velocity_noise * config.velocity_noise,
        velocity: T::zero(),
    };
    meter.part(&heading("Joseph form by nalgebra", precision), SAMPLES, dense, Dense::prepare, Dense::run);
    minikalman(meter, precision, &dense);
}

/// The textbook's formulas in nalgebra's matrices.
#[derive(Clone, Copy)]
struct Dense<T> {
    transition: Matrix4<T>,
    noise: Matrix4<T>,
    mean: Vector4<T>,
    covariance: Matrix4<T>,
    variance: T,
    velocity: T,
}

impl<T: RealField + Copy> Dense<T> {
    fn prepare(&mut self, random: &mut Random) {
        self.velocity = nalgebra::convert(0.1 * random.normal());
    }

    fn run(&mut self) {
        self.mean = self.transition * self.mean;
        self.covariance = self.transition * self.covariance * self.transition.transpose() + self.noise;
        let observation = RowVector4::new(T::one(), T::zero(), T::zero(), T::zero());
        let innovation = self.velocity - (observation * self.mean).x;
        let variance = (observation * self.covariance * observation.transpose()).x + self.variance;
        let gain = self.covariance * observation.transpose() / variance;
        self.mean += gain * innovation;
        let rest = Matrix4::identity() - gain * observation;
        self.covariance = rest * self.covariance * rest.transpose() + gain * self.variance * gain.transpose();
    }
}

fn minikalman<T: RealField + Copy + MatrixDataType>(meter: &mut Meter, precision: &str, dense: &Dense<T>) {
    let zero = nalgebra::zero::<T>();
    impl_buffer_x!(mut x, 4, T, zero);
    impl_buffer_A!(mut a, 4, T, zero);
    impl_buffer_P!(mut p, 4, T, zero);
    impl_buffer_Q_direct!(mut q, 4, T, zero);
    impl_buffer_temp_x!(mut temp_x, 4, T, zero);
    impl_buffer_temp_P!(mut temp_p, 4, T, zero);
    impl_buffer_z!(mut z, 1, T, zero);
    impl_buffer_H!(mut h, 1, 4, T, zero);
    impl_buffer_R!(mut r, 1, T, zero);
    impl_buffer_y!(mut y, 1, T, zero);
    impl_buffer_S!(mut s, 1, T, zero);
    impl_buffer_K!(mut k, 4, 1, T, zero);
    impl_buffer_temp_S_inv!(mut temp_s_inv, 1, T, zero);
    impl_buffer_temp_HP!(mut temp_hp, 1, 4, T, zero);
    impl_buffer_temp_PHt!(mut temp_pht, 4, 1, T, zero);
    impl_buffer_temp_KHP!(mut temp_khp, 4, T, zero);
    let mut filter = RegularKalmanBuilder::new::<4, T>(a, x, p, q, temp_x, temp_p);
    let mut measurement =
        RegularObservationBuilder::new::<4, 1, T>(h, z, r, y, s, k, temp_s_inv, temp_hp, temp_pht, temp_khp);
    for i in 0..4 {
        for j in 0..4 {
            let (f, p, q) = (dense.transition[(i, j)], dense.covariance[(i, j)], dense.noise[(i, j)]);
            filter.state_transition_mut().as_matrix_mut().set_at(i, j, f);
            filter.estimate_covariance_mut().as_matrix_mut().set_at(i, j, p);
            filter.direct_process_noise_mut().as_matrix_mut().set_at(i, j, q);
        }
    }
    measurement.observation_matrix_mut().as_matrix_mut().set_at(0, 0, nalgebra::one());
    measurement.measurement_noise_covariance_mut().as_matrix_mut().set_at(0, 0, dense.variance);

    meter.part(
        &heading("minikalman", precision),
        SAMPLES,
        (filter, measurement),
        |(_, measurement), random| {
            let velocity = nalgebra::convert(0.1 * random.normal());
            measurement.measurement_vector_mut().as_matrix_mut().set_at(0, 0, velocity);
        },
        |(filter, measurement)| {
            filter.predict();
            filter.correct(measurement);
        },
    );
}

fn transition<T: RealField + Copy>(model: &DiscreteModel<T>) -> Matrix4<T> {
    let (v, d, [a, w], o) = (model.velocity, model.vertical, model.decay, T::zero());
    Matrix4::new(v[0], v[1], v[2], v[3], d[0], d[1], d[2], d[3], o, o, a, o, o, o, o, w)
}

fn noise<T: RealField + Copy>(model: &DiscreteModel<T>) -> Matrix4<T> {
    let [vv, vd, va, vw, dd, da, dw, aa, aw, ww] = model.noise;
    Matrix4::new(vv, vd, va, vw, vd, dd, da, dw, va, da, aa, aw, vw, dw, aw, ww)
}
