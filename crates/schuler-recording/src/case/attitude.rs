//! Columns of the body's attitude in the forms that recordings have.
use serde::Serialize;

use super::calibration::AngleUnit;
use super::read::optional;
use crate::document::{Field, Node};

/// The columns of an attitude, and what they mean.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AttitudeColumns {
    /// Three angles or the four parts of a quaternion, in this order.
    pub columns: Vec<String>,
    /// What they are.
    pub order: Order,
    /// Unit of angles; without it radians. A quaternion has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<AngleUnit>,
    /// From and to which axes they turn.
    pub frames: Frames,
}

/// What the columns are: the parts of a quaternion, or the axes about which the angles turn, one after another, each
/// the axis as the turns before have left it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order(pub(crate) &'static str);

impl Order {
    /// Every order under its name in the case file. Yaw, pitch and roll are `zyx`.
    pub const NAMES: [(&'static str, Order); 14] = [
        ("wxyz", Order("wxyz")),
        ("xyzw", Order("xyzw")),
        ("zyx", Order("zyx")),
        ("xyz", Order("xyz")),
        ("xzy", Order("xzy")),
        ("yxz", Order("yxz")),
        ("yzx", Order("yzx")),
        ("zxy", Order("zxy")),
        ("xyx", Order("xyx")),
        ("xzx", Order("xzx")),
        ("yxy", Order("yxy")),
        ("yzy", Order("yzy")),
        ("zxz", Order("zxz")),
        ("zyz", Order("zyz")),
    ];

    /// Whether it is of a quaternion.
    pub const fn is_quaternion(self) -> bool {
        self.0.len() == 4
    }
}

/// Axes of the body and of the ground between which an attitude turns: the components of a vector in body axes into those on
/// the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frames {
    /// North, east, down; forward, right, down.
    #[default]
    NedFrd,
    /// East, north, up; forward, left, up, as in ROS. The columns of sensors and of other motion stay in x forward, y right, z
    /// down.
    EnuFlu,
}

impl Frames {
    /// Every pair under its name in the case file.
    pub const NAMES: [(&'static str, Frames); 2] = [("ned_frd", Frames::NedFrd), ("enu_flu", Frames::EnuFlu)];
}

/// Reads `[motion] attitude`.
pub(super) fn attitude(node: &Node<'_>) -> Option<AttitudeColumns> {
    let columns = node.required("columns", "an array of strings").and_then(|field| field.text_list());
    let order = node
        .required("order", "the order of the columns, e.g. \"wxyz\" or \"zyx\"")
        .and_then(|field| field.one_of(&Order::NAMES));
    let unit = optional(node, "unit", |field: &Field<'_>| field.one_of(&AngleUnit::NAMES));
    let frames = optional(node, "frames", |field: &Field<'_>| field.one_of(&Frames::NAMES));
    let (columns, order, unit) = (columns?, order?, unit?);
    let expected = order.0.len();
    if columns.len() != expected {
        let found = format!("found {} columns; expected {expected}, as order is \"{order}\"", columns.len());
        return node.problem_at("columns", &found);
    }
    if order.is_quaternion() && unit.is_some() {
        return node
            .problem_at("unit", "found beside a quaternion, which has none; expected angles, or no unit");
    }
    Some(AttitudeColumns { columns, order, unit, frames: frames?.unwrap_or_default() })
}
