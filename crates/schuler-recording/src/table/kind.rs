//! Formats that are read, told by their first bytes.
use super::{dataflash, mcap, numpy, ulog};

/// First bytes of a Parquet file.
pub(super) const PARQUET_MAGIC: &[u8] = b"PAR1";

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Parquet,
    Mcap,
    /// ROS 1 bag.
    Bag,
    /// PX4 ULog.
    Ulog,
    /// ArduPilot DataFlash.
    DataFlash,
    /// NumPy array.
    Array,
    /// ZIP archive of NumPy arrays.
    Archive,
    /// None of the others.
    Text,
}

/// What a file of each kind begins with.
const MAGIC: [(&[u8], Kind); 7] = [
    (PARQUET_MAGIC, Kind::Parquet),
    (::mcap::MAGIC, Kind::Mcap),
    (mcap::bag::MAGIC, Kind::Bag),
    (ulog::MAGIC, Kind::Ulog),
    (dataflash::MAGIC, Kind::DataFlash),
    (numpy::MAGIC, Kind::Array),
    (numpy::ZIP_MAGIC, Kind::Archive),
];

impl Kind {
    /// Of a file that begins so.
    pub(super) fn of(beginning: &[u8]) -> Self {
        let begins = |magic: &[u8]| beginning.starts_with(magic);
        MAGIC.iter().find(|(magic, _)| begins(magic)).map_or(Self::Text, |&(_, kind)| kind)
    }
}
