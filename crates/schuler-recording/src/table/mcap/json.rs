//! Messages in JSON.
use serde_json::{Map, Value};

use super::Leaves;
use crate::table::log::LONGEST_ARRAY;
use crate::table::seconds::of_parts;

/// Names of the parts of a time stamp: those of Foxglove's schemas, of ROS 1 and of ROS 2.
const STAMPS: [[&str; 2]; 3] = [["sec", "nsec"], ["secs", "nsecs"], ["sec", "nanosec"]];

/// Finds the numbers of a message; true is 1, false 0, null a number that is missing.
pub(super) fn decode(message: &[u8], leaves: &mut Leaves<'_>) -> Result<(), String> {
    let value: Value = serde_json::from_slice(message).map_err(|error| format!("it is not JSON: {error}"))?;
    walk(&value, leaves);
    Ok(())
}

fn walk(value: &Value, leaves: &mut Leaves<'_>) {
    match value {
        Value::Null => leaves.number(f64::NAN),
        Value::Bool(value) => leaves.number(f64::from(*value)),
        Value::Number(value) => leaves.number(value.as_f64().unwrap_or(f64::NAN)),
        Value::String(_) => {}
        Value::Array(values) => {
            for (index, value) in values.iter().enumerate().filter(|_| values.len() <= LONGEST_ARRAY) {
                leaves.within(format_args!("[{index}]"), |leaves| walk(value, leaves));
            }
        }
        Value::Object(fields) => match stamp(fields) {
            Some(seconds) => leaves.number(seconds),
            None => {
                for (name, value) in fields {
                    leaves.within(format_args!(".{name}"), |leaves| walk(value, leaves));
                }
            }
        },
    }
}

/// The seconds of an object that is a time stamp.
fn stamp(fields: &Map<String, Value>) -> Option<f64> {
    if fields.len() != 2 {
        return None;
    }
    STAMPS.iter().find_map(|[whole, nanoseconds]| {
        Some(of_parts(fields.get(*whole)?.as_i64()?, fields.get(*nanoseconds)?.as_i64()?))
    })
}
