//! Messages of Protobuf, described by the file descriptors in the schema.
use prost_reflect::{DescriptorPool, DynamicMessage, MessageDescriptor, ReflectMessage, Value};

use super::Leaves;
use crate::table::log::LONGEST_ARRAY;
use crate::table::seconds::of_parts;

/// Messages that are one number of seconds.
const STAMPS: [&str; 2] = ["google.protobuf.Timestamp", "google.protobuf.Duration"];

/// A kind of message.
pub(super) struct Protobuf(MessageDescriptor);

impl Protobuf {
    /// The message called `name`; what is wrong completes "its messages are …".
    pub(super) fn new(name: &str, descriptors: &[u8]) -> Result<Self, String> {
        let pool = DescriptorPool::decode(descriptors)
            .map_err(|error| format!("described by what is no set of file descriptors: {error}"))?;
        let message = pool.get_message_by_name(name);
        message.map(Self).ok_or_else(|| format!("described by descriptors that lack {name:?}"))
    }

    pub(super) fn decode(&self, message: &[u8], leaves: &mut Leaves<'_>) -> Result<(), String> {
        let message = DynamicMessage::decode(self.0.clone(), message)
            .map_err(|error| format!("it is no {}: {error}", self.0.full_name()))?;
        walk_message(&message, leaves);
        Ok(())
    }
}

fn walk_message(message: &DynamicMessage, leaves: &mut Leaves<'_>) {
    let descriptor = message.descriptor();
    if STAMPS.contains(&descriptor.full_name()) {
        let part = |name| message.get_field_by_name(name);
        if let (Some(whole), Some(nanoseconds)) = (part("seconds"), part("nanos"))
            && let (Some(whole), Some(nanoseconds)) = (whole.as_i64(), nanoseconds.as_i32())
        {
            leaves.number(of_parts(whole, nanoseconds.into()));
        }
        return;
    }
    for field in descriptor.fields() {
        // A field that says whether it is there may be missing; another one that is not there is 0.
        if message.has_field(&field) || !field.supports_presence() {
            let value = message.get_field(&field);
            leaves.within(format_args!(".{}", field.name()), |leaves| walk(&value, leaves));
        }
    }
}

fn walk(value: &Value, leaves: &mut Leaves<'_>) {
    match value {
        Value::Bool(value) => leaves.number(f64::from(*value)),
        Value::I32(value) | Value::EnumNumber(value) => leaves.number(f64::from(*value)),
        Value::I64(value) => leaves.number(*value as f64),
        Value::U32(value) => leaves.number(f64::from(*value)),
        Value::U64(value) => leaves.number(*value as f64),
        Value::F32(value) => leaves.number(f64::from(*value)),
        Value::F64(value) => leaves.number(*value),
        Value::Message(message) => walk_message(message, leaves),
        Value::List(values) => {
            for (index, value) in values.iter().enumerate().filter(|_| values.len() <= LONGEST_ARRAY) {
                leaves.within(format_args!("[{index}]"), |leaves| walk(value, leaves));
            }
        }
        Value::String(_) | Value::Bytes(_) | Value::Map(_) => {}
    }
}
