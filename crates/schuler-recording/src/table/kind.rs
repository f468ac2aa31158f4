//! Formats that are read, told by their first bytes.
#[cfg(feature = "hdf5")]
use super::hdf5;
use super::{dataflash, matlab, mavlink, mcap, numpy, ulog};

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
    /// MAVLink telemetry log.
    Tlog,
    /// MATLAB 5.
    Matlab,
    /// HDF5, and MATLAB 7.3.
    #[cfg(feature = "hdf5")]
    Hdf5,
    /// SQLite, of rosbag2.
    #[cfg(feature = "rosbag2")]
    Sqlite,
    /// NumPy array.
    Array,
    /// ZIP archive of NumPy arrays.
    Archive,
    /// None of the others.
    Text,
}

/// What files of most kinds begin with.
const MAGIC: &[(&[u8], Kind)] = &[
    (PARQUET_MAGIC, Kind::Parquet),
    (::mcap::MAGIC, Kind::Mcap),
    (mcap::bag::MAGIC, Kind::Bag),
    (ulog::MAGIC, Kind::Ulog),
    (dataflash::MAGIC, Kind::DataFlash),
    (matlab::MAGIC, Kind::Matlab),
    #[cfg(feature = "hdf5")]
    (hdf5::MAGIC, Kind::Hdf5),
    #[cfg(feature = "hdf5")]
    (hdf5::MATLAB_MAGIC, Kind::Hdf5),
    #[cfg(feature = "rosbag2")]
    (mcap::rosbag2::MAGIC, Kind::Sqlite),
    (numpy::MAGIC, Kind::Array),
    (numpy::ZIP_MAGIC, Kind::Archive),
];

impl Kind {
    /// Of a file that begins so.
    pub(super) fn of(beginning: &[u8]) -> Self {
        let begins = |magic: &[u8]| beginning.starts_with(magic);
        match MAGIC.iter().find(|(magic, _)| begins(magic)) {
            Some(&(_, kind)) => kind,
            None if mavlink::is_log(beginning) => Self::Tlog,
            None => Self::Text,
        }
    }
}
