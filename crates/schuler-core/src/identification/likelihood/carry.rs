//! A mixture carried from the middle of a sample to the present by the loop's equations.
use crate::filter::FilterConfig;
use crate::identification::window::DECIMATION;

/// From the middle of a sample's interval, for which its mean holds, to its last step, s.
pub(super) fn middle_to_end(filter: &FilterConfig<f32>) -> f32 {
    0.5 * filter.step_s * (DECIMATION - 1) as f32
}

/// A mean carried `age_s` seconds on by the loop's equations; a few tens of seconds at the most.
pub(super) fn carried(filter: &FilterConfig<f32>, mean: [f32; 4], age_s: f32) -> [f32; 4] {
    let [velocity, vertical, acceleration, drift] = mean;
    [
        velocity + age_s * (acceleration - filter.gravity * vertical),
        vertical + age_s * (velocity / filter.radius_m + drift),
        acceleration,
        drift,
    ]
}

/// Variances of a mean that has been carried so: what is not known of tilt and errors has grown into velocity and tilt, as if
/// they were independent, which is the most that it can have.
pub(super) fn aged(filter: &FilterConfig<f32>, variance: [f32; 4], age_s: f32) -> [f32; 4] {
    let [velocity, vertical, acceleration, drift] = variance;
    let square = age_s * age_s;
    let (g, r) = (filter.gravity, filter.radius_m);
    [
        velocity + square * (acceleration + g * g * vertical),
        vertical + square * (velocity / (r * r) + drift),
        acceleration,
        drift,
    ]
}

pub(super) fn difference(x: [f32; 4], y: [f32; 4]) -> [f32; 4] {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2], x[3] - y[3]]
}
