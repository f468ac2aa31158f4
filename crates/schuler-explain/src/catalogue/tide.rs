//! The pull of Moon and Sun on a rigid Earth, by Longman's formulas.
//!
//! `[Longman, Formulas for computing the tidal accelerations due to the moon and the sun, J. Geophysical Research 64
//! (1959) 2351]`; the numbers in brackets are its equations. What a gravimeter feels is about 1.16 times as much, as
//! the Earth gives way.
//!
//! Input: Unix time s, geodetic latitude and longitude (east) rad, height m. Output: upward acceleration, m/s².
use std::f64::consts::PI;

/// Newton's constant, cm³/(g s²), and the masses of Moon and Sun, g.
const NEWTON: f64 = 6.673e-8;
const MOON: f64 = 7.3537e25;
const SUN: f64 = 1.993e33;
/// Eccentricity of the Moon's orbit, and ratio of the mean motions of Sun and Moon.
const ECCENTRICITY: f64 = 0.05490;
const MEAN_MOTIONS: f64 = 0.074804;
/// Mean distances of Moon and Sun, and equatorial radius of the Earth, cm.
const MOON_DISTANCE: f64 = 3.84402e10;
const SUN_DISTANCE: f64 = 1.495e13;
const EARTH_RADIUS: f64 = 6.378270e8;
/// Inclinations of the equator and of the Moon's orbit to the ecliptic, degrees.
const OBLIQUITY_DEG: f64 = 23.452;
const MOON_INCLINATION_DEG: f64 = 5.145;
/// Julian day of Unix time 0, and of noon on 31 December 1899.
const UNIX_JULIAN_DAY: f64 = 2_440_587.5;
const EPOCH_JULIAN_DAY: f64 = 2_415_020.0;

/// Upward acceleration by Moon and Sun together, m/s².
pub(super) fn upward_pull(unix_time_s: f64, latitude: f64, longitude: f64, altitude_m: f64) -> f64 {
    let days = unix_time_s / 86_400.0;
    let t = (UNIX_JULIAN_DAY + days - EPOCH_JULIAN_DAY) / 36_525.0;
    let (t2, t3) = (t * t, t * t * t);
    // Mean longitude of the Moon (10'), of its perigee (11'), of the Sun (12'), of the Moon's node (19').
    let s = 4.720_008_893_870 + 8_399.709_274_533_2 * t + 3.455_751_92e-5 * t2 + 3.490_658_50e-8 * t3;
    let p = 5.835_151_628_14 + 71.018_041_208_9 * t - 1.801_082_83e-4 * t2 - 1.745_329_25e-7 * t3;
    let h = 4.881_627_982_59 + 628.331_950_894 * t + 5.235_987_76e-6 * t2;
    let n = 4.523_601_611_81 - 33.757_146_295 * t + 3.626_406_33e-5 * t2 + 3.393_695_77e-8 * t3;
    let (omega, i) = (OBLIQUITY_DEG.to_radians(), MOON_INCLINATION_DEG.to_radians());
    // Inclination of the Moon's orbit to the equator (20), longitude of their intersection on the equator (21).
    let inclination = (omega.cos() * i.cos() - omega.sin() * i.sin() * n.cos()).acos();
    let nu = (i.sin() * n.sin() / inclination.sin()).asin();
    // Hour angle of the mean Sun (24), right ascension of the meridian from that intersection (23).
    let hour_angle = 2.0 * PI * (days - days.floor() - 0.5) + longitude;
    let chi = hour_angle + h - nu;
    // Longitude of the intersection in the Moon's orbit (14, 15), of the Moon from it (13, 9).
    let cos_alpha = n.cos() * nu.cos() + n.sin() * nu.sin() * omega.cos();
    let sin_alpha = omega.sin() * n.sin() / inclination.sin();
    let alpha = 2.0 * (sin_alpha / (1.0 + cos_alpha)).atan();
    let sigma = s - (n - alpha);
    let (e, m) = (ECCENTRICITY, MEAN_MOTIONS);
    let moon = sigma
        + 2.0 * e * (s - p).sin()
        + 1.25 * e * e * (2.0 * (s - p)).sin()
        + 3.75 * m * e * (s - 2.0 * h + p).sin()
        + 1.375 * m * m * (2.0 * (s - h)).sin();
    // Perigee (26') and eccentricity (27) of the Sun's orbit, right ascension (28), longitude of the Sun (25).
    let p1 = 4.908_229_441_8 + 3.000_526_42e-2 * t + 7.902_463e-6 * t2 + 5.817_764e-8 * t3;
    let e1 = 0.016_751_04 - 4.180e-5 * t - 1.26e-7 * t2;
    let chi1 = hour_angle + h;
    let sun = h + 2.0 * e1 * (h - p1).sin();
    // Zenith angles of Moon (7) and Sun (8).
    let zenith = |inclination: f64, longitude: f64, chi: f64| {
        latitude.sin() * inclination.sin() * longitude.sin()
            + latitude.cos()
                * ((inclination / 2.0).cos().powi(2) * (longitude - chi).cos()
                    + (inclination / 2.0).sin().powi(2) * (longitude + chi).cos())
    };
    let (cos_moon, cos_sun) = (zenith(inclination, moon, chi), zenith(omega, sun, chi1));
    // Distance from the Earth's centre, and of Moon (29) and Sun (30).
    let r = EARTH_RADIUS / (1.0 + 0.006_738 * latitude.sin().powi(2)).sqrt() + 100.0 * altitude_m;
    let a = 1.0 / (MOON_DISTANCE * (1.0 - e * e));
    let per_moon = 1.0 / MOON_DISTANCE
        + a * e * (s - p).cos()
        + a * e * e * (2.0 * (s - p)).cos()
        + 1.875 * a * m * e * (s - 2.0 * h + p).cos()
        + a * m * m * (2.0 * (s - h)).cos();
    let a1 = 1.0 / (SUN_DISTANCE * (1.0 - e1 * e1));
    let per_sun = 1.0 / SUN_DISTANCE + a1 * e1 * (h - p1).cos();
    // Vertical accelerations of Moon (1) and Sun (3), cm/s².
    let by_moon = NEWTON * MOON * r * per_moon.powi(3) * (3.0 * cos_moon * cos_moon - 1.0)
        + 1.5 * NEWTON * MOON * r * r * per_moon.powi(4) * (5.0 * cos_moon.powi(3) - 3.0 * cos_moon);
    let by_sun = NEWTON * SUN * r * per_sun.powi(3) * (3.0 * cos_sun * cos_sun - 1.0);
    (by_moon + by_sun) / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against vectors to Moon and Sun from other theories (ERFA 2.0: `moon98`, `epv00`, rotation `c2t06a`), the exact
    /// difference of attractions, and masses of the IAU: upward along the ellipsoid's normal, µGal. Longman's own
    /// formulas, programmed by others with masses 0.2 % apart (tidegravity 0.5.0, which multiplies by 1.16), give 3.05, −45.54, 82.01, −83.94.
    #[test]
    fn agrees_with_ephemerides_and_with_another_program() {
        let published = [
            (40.7914, -77.8586, 370.0, 1_429_747_200.0, 2.924, 3.0472),
            (55.57, 37.6, 150.0, 1_577_858_400.0, -45.282, -45.5387),
            (-33.9, 151.2, 20.0, 932_045_400.0, 82.291, 82.0140),
            (0.0, 0.0, 0.0, 1_292_954_400.0, -84.215, -83.9434),
        ];
        for (latitude, longitude, altitude_m, utc_s, ephemerides, program) in published {
            let (latitude, longitude) = (f64::to_radians(latitude), f64::to_radians(longitude));
            let pull = 1e8 * upward_pull(utc_s, latitude, longitude, altitude_m);
            assert!((pull - ephemerides).abs() < 0.6, "{pull} µGal, not {ephemerides}");
            assert!((pull - program).abs() < 0.25, "{pull} µGal, not {program}");
        }
    }
}
