//! Changes that begin and end smoothly.
/// A value with two derivatives.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Smooth {
    pub(super) value: f64,
    pub(super) rate: f64,
    pub(super) acceleration: f64,
}

/// A change from 0 to 1 over [0, 1] whose slope and curvature vanish at both ends: x − sin(2πx)/2π.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ease {
    pub(super) value: f64,
    pub(super) slope: f64,
    pub(super) curvature: f64,
}

impl Ease {
    pub(super) fn at(x: f64) -> Self {
        use std::f64::consts::TAU;
        let x = x.clamp(0.0, 1.0);
        let (s, c) = (TAU * x).sin_cos();
        Self { value: x - s / TAU, slope: 1.0 - c, curvature: TAU * s }
    }

    /// ∫₀ˣ value.
    pub(super) fn integral(x: f64) -> f64 {
        use std::f64::consts::TAU;
        0.5 * x * x + ((TAU * x).cos() - 1.0) / (TAU * TAU)
    }
}
