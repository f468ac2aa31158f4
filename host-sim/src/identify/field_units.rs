//! The units in which the field quotes noise coefficients.
use schuler_recording::unit::{Dimension, Unit};

/// A unit and the factor that turns an SI value into it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldUnit {
    /// Name.
    pub name: &'static str,
    /// Value in this unit = factor · value in SI.
    pub factor: f64,
}

/// What one of the five power laws of the Allan variance is called and quoted in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoefficientNames {
    /// Letter in IEEE Std 952.
    pub symbol: &'static str,
    /// Name.
    pub name: &'static str,
    /// SI unit.
    pub si: &'static str,
    /// Unit of the field.
    pub field: FieldUnit,
}

/// √s in √h.
const ROOT_HOUR: f64 = 60.0;
const HOUR: f64 = 3600.0;

/// The names of Q, N, B, K, R for a sensor of `dimension`.
pub fn coefficient_names(dimension: Dimension) -> [CoefficientNames; 5] {
    let names = |symbol, name, si, field, factor| CoefficientNames {
        symbol,
        name,
        si,
        field: FieldUnit { name: field, factor },
    };
    let deg_h = 1.0 / Unit::DegreePerHour.in_si();
    let deg = deg_h / HOUR;
    let micro_g = 1.0 / Unit::MicroG.in_si();
    match dimension {
        Dimension::AngularRate => [
            names("Q", "quantisation", "rad", "arcsec", deg * 3600.0),
            names("N", "angle random walk", "rad/sqrt(s)", "deg/sqrt(h)", deg * ROOT_HOUR),
            names("B", "bias instability", "rad/s", "deg/h", deg_h),
            names("K", "rate random walk", "rad/s/sqrt(s)", "deg/h/sqrt(h)", deg_h * ROOT_HOUR),
            names("R", "rate ramp", "rad/s^2", "deg/h/h", deg_h * HOUR),
        ],
        Dimension::Acceleration => [
            names("Q", "quantisation", "m/s", "m/s", 1.0),
            names("N", "velocity random walk", "m/s/sqrt(s)", "m/s/sqrt(h)", ROOT_HOUR),
            names("B", "bias instability", "m/s^2", "ug", micro_g),
            names("K", "acceleration random walk", "m/s^2/sqrt(s)", "ug/sqrt(h)", micro_g * ROOT_HOUR),
            names("R", "acceleration ramp", "m/s^3", "ug/h", micro_g * HOUR),
        ],
        Dimension::Velocity => [
            names("Q", "quantisation", "m", "m", 1.0),
            names("N", "position random walk", "m/sqrt(s)", "m/sqrt(h)", ROOT_HOUR),
            names("B", "bias instability", "m/s", "m/s", 1.0),
            names("K", "velocity random walk", "m/s/sqrt(s)", "m/s/sqrt(h)", ROOT_HOUR),
            names("R", "velocity ramp", "m/s^2", "m/s/h", HOUR),
        ],
        // Of the sensor's own unit, which is free text.
        Dimension::Other => [
            names("Q", "quantisation", "unit*s", "unit*s", 1.0),
            names("N", "random walk of the integral", "unit*sqrt(s)", "unit*sqrt(s)", 1.0),
            names("B", "bias instability", "unit", "unit", 1.0),
            names("K", "random walk", "unit/sqrt(s)", "unit/sqrt(s)", 1.0),
            names("R", "ramp", "unit/s", "unit/s", 1.0),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn field_units_agree_with_the_usual_conversions() {
        let [q, n, b, k, r] = coefficient_names(Dimension::AngularRate);
        let near =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
        // 1 rad/√s = 3437.7 °/√h (IEEE Std 952: 1 °/√h = 60 °/h/√Hz).
        near(n.field.factor, 180.0 / std::f64::consts::PI * 60.0);
        near(b.field.factor, 206_264.806_247_096_36);
        near(k.field.factor, 206_264.806_247_096_36 * 60.0);
        near(r.field.factor, 206_264.806_247_096_36 * 3600.0);
        near(q.field.factor, 206_264.806_247_096_36);
    }
}
