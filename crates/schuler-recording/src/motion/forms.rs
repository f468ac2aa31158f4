//! Roll, pitch and yaw of attitudes in other forms.
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::body_to_ned;
use crate::case::calibration::AngleUnit;
use crate::case::{AttitudeColumns, Frames};

/// Turns components in east, north, up into those in north, east, down, and back.
const NED_OF_ENU: Matrix3<f64> = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
/// Turns components in forward, right, down into those in forward, left, up, and back.
const FLU_OF_FRD: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);

/// Roll, pitch and yaw (body from north-east-down, 3-2-1), rad, of rows of columns in the form that `form` says. Missing where one of
/// the values is, or where a quaternion is zero.
pub(crate) fn roll_pitch_yaw(form: &AttitudeColumns, columns: &[Vec<f64>]) -> [Vec<f64>; 3] {
    let rows = columns.first().map_or(0, Vec::len);
    let mut angles = [(); 3].map(|()| Vec::with_capacity(rows));
    for row in 0..rows {
        let values: Vec<f64> =
            columns.iter().map(|values| values.get(row).copied().unwrap_or(f64::NAN)).collect();
        let turned = rotation(form, &values).map(|rotation| match form.frames {
            Frames::NedFrd => *rotation.matrix(),
            Frames::EnuFlu => NED_OF_ENU * rotation.matrix() * FLU_OF_FRD,
        });
        let found = turned.map(|it| Rotation3::from_matrix_unchecked(it).euler_angles());
        let (roll, pitch, yaw) = found.unwrap_or((f64::NAN, f64::NAN, f64::NAN));
        for (angles, angle) in angles.iter_mut().zip([roll, pitch, yaw]) {
            angles.push(angle);
        }
    }
    angles
}

/// The rotation from body axes to those on the ground.
fn rotation(form: &AttitudeColumns, values: &[f64]) -> Option<Rotation3<f64>> {
    if values.iter().any(|value| !value.is_finite()) {
        return None;
    }
    if form.order.is_quaternion() {
        let part = |name: char| form.order.0.find(name).and_then(|place| values.get(place)).copied();
        let quaternion = Quaternion::new(part('w')?, part('x')?, part('y')?, part('z')?);
        return UnitQuaternion::try_new(quaternion, f64::MIN_POSITIVE)
            .map(UnitQuaternion::to_rotation_matrix);
    }
    let unit = form.unit.unwrap_or(AngleUnit::Radians).in_si();
    let turn = |(axis, angle): (char, &f64)| {
        let axis = match axis {
            'x' => Vector3::x_axis(),
            'y' => Vector3::y_axis(),
            _ => Vector3::z_axis(),
        };
        Rotation3::from_axis_angle(&axis, angle * unit)
    };
    Some(form.order.0.chars().zip(values).map(turn).fold(body_to_ned(0.0, 0.0, 0.0), |all, turn| all * turn))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::Order;

    fn form(order: &str, frames: Frames, unit: AngleUnit) -> AttitudeColumns {
        let (_, order) = Order::NAMES.into_iter().find(|(name, _)| *name == order).unwrap();
        AttitudeColumns { columns: Vec::new(), order, unit: Some(unit), frames }
    }

    fn of_row(form: &AttitudeColumns, row: &[f64]) -> [f64; 3] {
        let columns: Vec<Vec<f64>> = row.iter().map(|value| vec![*value]).collect();
        roll_pitch_yaw(form, &columns).map(|angles| angles[0])
    }

    fn near(found: [f64; 3], expected: [f64; 3]) -> bool {
        found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn angles_and_quaternions_give_the_same_attitude() {
        let (roll, pitch, yaw) = (0.3_f64, -0.7_f64, 2.1_f64);
        let ned = |order| form(order, Frames::NedFrd, AngleUnit::Radians);
        assert!(near(of_row(&ned("zyx"), &[yaw, pitch, roll]), [roll, pitch, yaw]));
        let degrees = form("zyx", Frames::NedFrd, AngleUnit::Degrees);
        assert!(near(of_row(&degrees, &[yaw, pitch, roll].map(f64::to_degrees)), [roll, pitch, yaw]));
        // The half angles of the textbook.
        let [cr, cp, cy] = [roll, pitch, yaw].map(|angle| (angle / 2.0).cos());
        let [sr, sp, sy] = [roll, pitch, yaw].map(|angle| (angle / 2.0).sin());
        let w = cr * cp * cy + sr * sp * sy;
        let x = sr * cp * cy - cr * sp * sy;
        let y = cr * sp * cy + sr * cp * sy;
        let z = cr * cp * sy - sr * sp * cy;
        for scale in [1.0, -2.0] {
            let [w, x, y, z] = [w, x, y, z].map(|part| part * scale);
            assert!(near(of_row(&ned("wxyz"), &[w, x, y, z]), [roll, pitch, yaw]));
            assert!(near(of_row(&ned("xyzw"), &[x, y, z, w]), [roll, pitch, yaw]));
        }
        // One turn about one axis is that turn in every order.
        for (name, _) in Order::NAMES.iter().skip(2) {
            let first = name.find('x').map(|place| {
                let mut angles = [0.0; 3];
                angles[place] = 0.4;
                of_row(&ned(name), &angles)
            });
            assert!(first.is_none_or(|found| near(found, [0.4, 0.0, 0.0])), "{name}");
        }
        assert!(of_row(&ned("wxyz"), &[0.0; 4]).iter().all(|angle| angle.is_nan()));
        assert!(of_row(&ned("zyx"), &[0.0, f64::NAN, 0.0]).iter().all(|angle| angle.is_nan()));
    }

    #[test]
    fn frames_of_ros_are_turned() {
        let enu = form("zyx", Frames::EnuFlu, AngleUnit::Degrees);
        // Forward is east without a turn, and north after a quarter to the left.
        for (angles, expected) in [
            ([0.0, 0.0, 0.0], [0.0, 0.0, 90.0]),
            ([90.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
            ([60.0, 0.0, 0.0], [0.0, 0.0, 30.0]),
            // The nose goes down with a positive turn about the axis to the left.
            ([90.0, 10.0, 0.0], [0.0, -10.0, 0.0]),
            // To the right side with one about forward.
            ([90.0, 0.0, 20.0], [20.0, 0.0, 0.0]),
        ] {
            assert!(near(of_row(&enu, &angles), expected.map(f64::to_radians)), "{angles:?}");
        }
    }
}
