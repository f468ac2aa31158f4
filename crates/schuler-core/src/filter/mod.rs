//! The error filter.
use serde::{Deserialize, Serialize};

/// A first-order Markov process: R(t) = σ² exp(−|t|/τ).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarkovNoise<T> {
    /// Standard deviation, in the state's unit (m/s² for the accelerometer, rad/s for the gyro).
    pub sigma: T,
    /// Correlation time, s.
    pub tau_s: T,
}

/// The single channel and what is believed of its noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilterConfig<T> {
    /// Radius of the Earth R, m.
    pub radius_m: T,
    /// Gravity g, m/s².
    pub gravity: T,
    /// Step Δ, s.
    pub step_s: T,
    /// Accelerometer error a, m/s².
    pub accelerometer: MarkovNoise<T>,
    /// Gyro drift ω, rad/s.
    pub gyro: MarkovNoise<T>,
    /// 1-σ white noise r of the velocity measurement, m/s.
    pub velocity_noise: T,
    /// 1-σ of the velocity error at the start, m/s.
    pub initial_velocity_sigma: T,
    /// 1-σ of the vertical error at the start, rad.
    pub initial_vertical_sigma: T,
    /// An innovation beyond this many of its standard deviations is not used.
    pub gate_sigma: T,
}

/// What the filter says each step. Order of the states: ΔV (m/s), δ (rad), a (m/s²), ω (rad/s).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FilterOutput<T> {
    /// Estimate x̂.
    pub estimate: [T; 4],
    /// Standard deviations √diag P.
    pub sigma: [T; 4],
    /// Innovation ν = z − H x̂⁻, m/s; zero when there was no measurement.
    pub innovation: T,
    /// Innovation variance S, (m/s)².
    pub innovation_variance: T,
    /// Normalised innovation squared ν²/S; zero when there was no measurement.
    pub nis: T,
}
