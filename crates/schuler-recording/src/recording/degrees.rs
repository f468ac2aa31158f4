//! Attitudes that are stated in radians and can only be in degrees.
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;

use super::Recording;
use crate::document::Lines;
use crate::error::{Error, Problem};

/// Angles, rad, are taken for degrees only beyond this part more than they can be.
const SLACK: f64 = 1.01;
/// From one row to the next a heading in degrees goes back by nearly a whole turn at north; no body turns as far as so many radians.
const LEAST_WRAP: f64 = 300.0;
const WHOLE_TURN: f64 = 360.5;

impl Recording {
    /// Refuses an attitude in degrees where the case says that it is in radians.
    ///
    /// # Errors
    /// Which column shows it and how.
    pub(super) fn refuse_degrees(&self, case: &Path, lines: &Lines) -> Result<(), Error> {
        let (Some([roll, pitch, yaw]), Some(recorded)) =
            (&self.case.motion.attitude_rad, &self.motion.attitude_rad)
        else {
            return Ok(());
        };
        let Some((axis, found)) = in_degrees(recorded) else { return Ok(()) };
        let message = format!(
            "found {found}; expected radians: in place of it state attitude = {{ columns = [\"{yaw}\", \"{pitch}\", \"{roll}\"], \
             order = \"zyx\", unit = \"deg\" }}, or unit = \"rad\" if it is so"
        );
        let path = "motion.attitude_rad";
        Err(Error::one(case, Problem::new(lines.get(path), format!("{path}[{axis}]"), message)))
    }
}

/// The axis on which roll, pitch and yaw show that they are in degrees, and what shows it.
fn in_degrees([roll, pitch, yaw]: &[Vec<f64>; 3]) -> Option<(usize, String)> {
    for (axis, angles) in [(0, roll), (2, yaw)] {
        let wrap = |pair: &&[f64]| (LEAST_WRAP..=WHOLE_TURN).contains(&(pair[1] - pair[0]).abs());
        if largest(angles) <= WHOLE_TURN
            && let Some(pair) = angles.windows(2).find(wrap)
        {
            return Some((axis, format!("{} after {} in the next row", pair[1], pair[0])));
        }
    }
    // A pitch turns back at a quarter of a turn, unless it is not brought into one; then neither is another angle.
    let highest = largest(pitch);
    let others = largest(roll).max(largest(yaw));
    let are_degrees = highest > SLACK * FRAC_PI_2
        && highest <= 90.0 * SLACK
        && (SLACK * TAU..=WHOLE_TURN).contains(&others);
    are_degrees.then(|| (1, format!("a pitch of up to {highest}")))
}

fn largest(angles: &[f64]) -> f64 {
    angles.iter().filter(|angle| angle.is_finite()).fold(0.0, |most, angle| angle.abs().max(most))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn angles(of: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..200).map(|row| of(f64::from(row))).collect()
    }

    #[test]
    fn degrees_are_seen_where_radians_cannot_be() {
        let still = || angles(|_| 0.0);
        // A heading through north, and a climb while turning.
        let heading = angles(|row| (300.0 + row).rem_euclid(360.0));
        assert_eq!(in_degrees(&[still(), still(), heading]).unwrap().0, 2);
        let signed = angles(|row| (300.0 + row).rem_euclid(360.0) - 180.0);
        assert_eq!(in_degrees(&[still(), still(), signed]).unwrap().0, 2);
        assert_eq!(in_degrees(&[still(), angles(|row| 0.1 * row), angles(|row| row)]).unwrap().0, 1);
        // Radians: wrapped, not wrapped, a table that turns over in pitch, a gap.
        let wrapped = angles(|row| (0.3 * row).sin().atan2((0.3 * row).cos()));
        assert_eq!(in_degrees(&[wrapped.clone(), still(), wrapped]), None);
        assert_eq!(in_degrees(&[still(), still(), angles(|row| 2.0 * row)]), None);
        assert_eq!(in_degrees(&[still(), angles(|row| 0.05 * row), still()]), None);
        assert_eq!(in_degrees(&[still(), still(), vec![f64::NAN; 5]]), None);
    }
}
