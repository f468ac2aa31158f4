//! The Earth: rate, gravity and radii on the WGS-84 ellipsoid.
//!
//! Source: NIMA TR8350.2, third edition. Angles in radians, lengths in metres, SI throughout.
use nalgebra::Vector3;

/// Rate of the Earth, rad/s.
pub const EARTH_RATE: f64 = 7.292_115e-5;
/// Standard gravity, m/s².
pub const STANDARD_GRAVITY: f64 = 9.806_65;
/// Mean radius used by the single-channel Schuler loop, m.
pub const MEAN_RADIUS: f64 = 6_371_000.0;

const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);
const GRAVITY_EQUATOR: f64 = 9.780_325_335_9;
const SOMIGLIANA: f64 = 0.001_931_852_652_41;
/// ω²a²b/GM.
const CENTRIFUGAL_RATIO: f64 = 0.003_449_786_506_84;

/// Normal gravity at a geodetic latitude (rad) and height (m), m/s²: Somigliana's formula with the second-order
/// height term.
pub fn gravity(latitude: f64, height: f64) -> f64 {
    let s2 = latitude.sin().powi(2);
    let surface = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * s2) / (1.0 - ECCENTRICITY_SQUARED * s2).sqrt();
    let a = SEMI_MAJOR_AXIS;
    surface
        * (1.0 - 2.0 / a * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * s2) * height
            + 3.0 / (a * a) * height * height)
}

/// Radii of curvature (meridian, prime vertical) at a geodetic latitude (rad), m.
pub fn radii(latitude: f64) -> (f64, f64) {
    let w2 = 1.0 - ECCENTRICITY_SQUARED * latitude.sin().powi(2);
    let w = w2.sqrt();
    (SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (w2 * w), SEMI_MAJOR_AXIS / w)
}

/// Rate of the Earth in north-east-down axes, rad/s.
pub fn earth_rate_ned(latitude: f64) -> Vector3<f64> {
    EARTH_RATE * Vector3::new(latitude.cos(), 0.0, -latitude.sin())
}

/// Rate of north-east-down axes over the Earth (transport rate), rad/s, for a velocity in those axes, m/s.
///
/// The vertical component is zero at the poles, where north is not defined.
pub fn transport_rate_ned(latitude: f64, height: f64, velocity: &Vector3<f64>) -> Vector3<f64> {
    let (meridian, prime_vertical) = radii(latitude);
    let east = velocity.y / (prime_vertical + height);
    let vertical = if latitude.cos().abs() > 1e-9 { -east * latitude.tan() } else { 0.0 };
    Vector3::new(east, -velocity.x / (meridian + height), vertical)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_agrees_with_published_values() {
        // TR8350.2: equator, pole; and 45 deg from Somigliana's closed form.
        assert!((gravity(0.0, 0.0) - 9.780_325_335_9).abs() < 1e-10);
        assert!((gravity(std::f64::consts::FRAC_PI_2, 0.0) - 9.832_184_937_9).abs() < 1e-8);
        assert!((gravity(std::f64::consts::FRAC_PI_4, 0.0) - 9.806_197_769).abs() < 1e-8);
        // Free-air gradient, 0.3086 mGal/m.
        let gradient = (gravity(0.8, 1.0) - gravity(0.8, 0.0)) * 1e5;
        assert!((gradient + 0.3086).abs() < 5e-4, "{gradient}");
    }

    #[test]
    fn radii_agree_with_the_ellipsoid() {
        let (m, n) = radii(0.0);
        assert!((n - 6_378_137.0).abs() < 1e-6 && (m - 6_335_439.327).abs() < 1e-2);
        let (m, n) = radii(std::f64::consts::FRAC_PI_2);
        assert!((m - 6_399_593.626).abs() < 1e-2 && (m - n).abs() < 1e-6);
    }
}
