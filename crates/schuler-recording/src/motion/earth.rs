//! The Earth of WGS 84: rotation, radii of curvature, normal gravity.
//!
//! Latitudes are geodetic, in radians; heights are above the ellipsoid, in metres.
use nalgebra::Vector3;

/// Semi-major axis a, m.
pub const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
/// Flattening f.
pub const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Rate of rotation `ω_ie`, rad/s.
pub const ROTATION_RATE: f64 = 7.292_115e-5;
/// Normal gravity at the equator `γ_e`, m/s².
const EQUATORIAL_GRAVITY: f64 = 9.780_325_335_9;
/// Somigliana's constant k.
const SOMIGLIANA: f64 = 0.001_931_852_652_41;
/// ω² a² b / GM.
const CENTRIFUGAL_RATIO: f64 = 0.003_449_786_506_84;

/// Square of the eccentricity, e² = f (2 − f).
const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);

/// The Earth's rotation in north-east-down, rad/s.
pub fn rotation_ned(latitude: f64) -> Vector3<f64> {
    ROTATION_RATE * Vector3::new(latitude.cos(), 0.0, -latitude.sin())
}

/// Normal gravity, m/s²: Somigliana's closed form on the ellipsoid, second order in the height.
/// `[Department of Defense, WGS 84, NGA.STND.0036, eq. 4-1 and 4-3]`
pub fn gravity(latitude: f64, altitude_m: f64) -> f64 {
    let sin2 = latitude.sin() * latitude.sin();
    let on_ellipsoid =
        EQUATORIAL_GRAVITY * (1.0 + SOMIGLIANA * sin2) / (1.0 - ECCENTRICITY_SQUARED * sin2).sqrt();
    let height = altitude_m / SEMI_MAJOR_AXIS;
    let first = 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * sin2);
    on_ellipsoid * (1.0 - first * height + 3.0 * height * height)
}

/// Radius of curvature along the meridian, m.
pub fn meridian_radius(latitude: f64) -> f64 {
    let sin2 = latitude.sin() * latitude.sin();
    SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (1.0 - ECCENTRICITY_SQUARED * sin2).powf(1.5)
}

/// Radius of curvature across the meridian, m.
pub fn transverse_radius(latitude: f64) -> f64 {
    SEMI_MAJOR_AXIS / (1.0 - ECCENTRICITY_SQUARED * latitude.sin() * latitude.sin()).sqrt()
}

/// Turn of the north-east-down frame as it moves over the Earth, rad/s, for a velocity in m/s. At the poles, where
/// north is not defined, the turn about the vertical is left out.
pub fn transport_rate(latitude: f64, altitude_m: f64, velocity_ned: &Vector3<f64>) -> Vector3<f64> {
    let north = velocity_ned.x / (meridian_radius(latitude) + altitude_m);
    let east = velocity_ned.y / (transverse_radius(latitude) + altitude_m);
    let tangent = if latitude.cos() > 1e-6 { latitude.tan() } else { 0.0 };
    Vector3::new(east, -north, -east * tangent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_agrees_with_published_values() {
        // Equator and pole of WGS 84; at 45° the value of GRS 80, which differs in the seventh digit.
        assert!((gravity(0.0, 0.0) - 9.7803253359).abs() < 1e-10);
        assert!((gravity(90_f64.to_radians(), 0.0) - 9.8321849378).abs() < 1e-8);
        assert!((gravity(45_f64.to_radians(), 0.0) - 9.806199203).abs() < 2e-6);
        // Free-air gradient: 308.6 µGal/m.
        let latitude = 45_f64.to_radians();
        let gradient = (gravity(latitude, 100.0) - gravity(latitude, 0.0)) / 100.0;
        assert!((gradient + 3.086e-6).abs() < 3e-9, "{gradient}");
    }

    #[test]
    fn radii_agree_with_closed_forms() {
        let polar = SEMI_MAJOR_AXIS / (1.0 - FLATTENING);
        let pole = 90_f64.to_radians();
        assert!((meridian_radius(pole) - polar).abs() < 1e-6);
        assert!((transverse_radius(pole) - polar).abs() < 1e-6);
        assert!((transverse_radius(0.0) - SEMI_MAJOR_AXIS).abs() < 1e-9);
    }
}
