//! What bytes that are kept are sealed with, so that others are told from them:
//!
//! ```text
//! magic, four letters │ version u16 LE │ length u16 LE │ content, postcard │ CRC-32 LE
//! ```
use core::fmt;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::frame::CRC;

const HEADER: usize = 8;
const CHECKSUM: usize = 4;
/// What is not content, bytes.
pub(crate) const OVERHEAD: usize = HEADER + CHECKSUM;

/// Why bytes are not a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BlockError {
    /// Not a block of this kind, or cut short, or with something behind it.
    Form,
    /// The checksum does not fit.
    Checksum,
    /// Of another version than this program's.
    Version(u16),
    /// Sound bytes whose content is not a block.
    Content,
}

impl fmt::Display for BlockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Form => f.write_str("is not a block of this kind, or not a whole one"),
            Self::Checksum => f.write_str("does not fit its checksum"),
            Self::Version(version) => {
                write!(f, "is of version {version}; this program was built for another")
            }
            Self::Content => f.write_str("fits its checksum, but its content is not a block"),
        }
    }
}

impl core::error::Error for BlockError {}

/// Seals the content; nothing where it does not fit into `N` bytes.
pub(crate) fn close<T: Serialize, const N: usize>(magic: [u8; 4], version: u16, content: &T) -> Vec<u8, N> {
    let mut bytes = Vec::new();
    if write(magic, version, content, &mut bytes).is_err() {
        bytes.clear();
    }
    bytes
}

fn write<T: Serialize, const N: usize>(
    magic: [u8; 4],
    version: u16,
    content: &T,
    bytes: &mut Vec<u8, N>,
) -> Result<(), ()> {
    let mut buffer = [0; N];
    let content = postcard::to_slice(content, &mut buffer).map_err(|_| ())?;
    let length = u16::try_from(content.len()).map_err(|_| ())?;
    bytes.extend_from_slice(&magic).map_err(|_| ())?;
    bytes.extend_from_slice(&version.to_le_bytes()).map_err(|_| ())?;
    bytes.extend_from_slice(&length.to_le_bytes()).map_err(|_| ())?;
    bytes.extend_from_slice(content).map_err(|_| ())?;
    let checksum = CRC.checksum(bytes);
    bytes.extend_from_slice(&checksum.to_le_bytes()).map_err(|_| ())
}

/// The content of sealed bytes, and their checksum.
pub(crate) fn open(magic: [u8; 4], version: u16, bytes: &[u8]) -> Result<(&[u8], u32), BlockError> {
    let (body, &checksum) = bytes.split_last_chunk::<CHECKSUM>().ok_or(BlockError::Form)?;
    let (&[m0, m1, m2, m3, v0, v1, l0, l1], content) =
        body.split_first_chunk::<HEADER>().ok_or(BlockError::Form)?;
    if [m0, m1, m2, m3] != magic || usize::from(u16::from_le_bytes([l0, l1])) != content.len() {
        return Err(BlockError::Form);
    }
    let checksum = u32::from_le_bytes(checksum);
    if CRC.checksum(body) != checksum {
        return Err(BlockError::Checksum);
    }
    let found = u16::from_le_bytes([v0, v1]);
    if found == version { Ok((content, checksum)) } else { Err(BlockError::Version(found)) }
}
