//! The records that are used of a file.
//!
//! Read here, as the `mcap` crate (0.26) reserves what a record says of the length of its strings before it looks at how
//! long the record is: 4 GB for a damaged byte.
use std::collections::BTreeMap;

use mcap::records::op;

/// A record.
pub(super) enum Record<'r> {
    Header { profile: &'r str, library: &'r str },
    Schema { id: u16, name: &'r str, encoding: &'r str, data: &'r [u8] },
    Channel { id: u16, schema: u16, topic: &'r str, encoding: &'r str },
    Message { channel: u16, sequence: u32, log_time: u64, publish_time: u64, data: &'r [u8] },
    Metadata { name: &'r str, pairs: BTreeMap<&'r str, &'r str> },
    Statistics { messages: u64 },
    Other,
}

impl<'r> Record<'r> {
    /// None if it does not hold what it must.
    pub(super) fn parse(opcode: u8, content: &'r [u8]) -> Option<Self> {
        let mut left = Left(content);
        Some(match opcode {
            op::HEADER => Self::Header { profile: left.text()?, library: left.text()? },
            op::SCHEMA => Self::Schema {
                id: left.u16()?,
                name: left.text()?,
                encoding: left.text()?,
                data: left.bytes()?,
            },
            op::CHANNEL => Self::Channel {
                id: left.u16()?,
                schema: left.u16()?,
                topic: left.text()?,
                encoding: left.text()?,
            },
            op::MESSAGE => Self::Message {
                channel: left.u16()?,
                sequence: left.u32()?,
                log_time: left.u64()?,
                publish_time: left.u64()?,
                data: left.0,
            },
            op::METADATA => {
                let name = left.text()?;
                let mut inside = Left(left.bytes()?);
                let mut pairs = BTreeMap::new();
                while !inside.0.is_empty() {
                    pairs.insert(inside.text()?, inside.text()?);
                }
                Self::Metadata { name, pairs }
            }
            op::STATISTICS => Self::Statistics { messages: left.u64()? },
            _ => Self::Other,
        })
    }
}

/// What is left of a record.
struct Left<'r>(&'r [u8]);

impl<'r> Left<'r> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (&taken, left) = self.0.split_first_chunk()?;
        self.0 = left;
        Some(taken)
    }

    fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn bytes(&mut self) -> Option<&'r [u8]> {
        let length = self.u32()? as usize;
        let (taken, left) = self.0.split_at_checked(length)?;
        self.0 = left;
        Some(taken)
    }

    fn text(&mut self) -> Option<&'r str> {
        std::str::from_utf8(self.bytes()?).ok()
    }
}
