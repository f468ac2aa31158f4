//! A compensation block as bytes: what a file holds, and what is loaded over the link.
//!
//! ```text
//! "SCHC" │ version u16 LE │ length u16 LE │ content, postcard │ CRC-32 LE
//! ```
//! The checksum is that of the frames and covers everything before it; the length is that of the content. The checksum names
//! the block: the module reports that of the block in force.
use core::fmt;

use heapless::Vec;
use schuler_core::compensation::{BLOCK_VERSION, Block, MAX_TERMS};
use schuler_core::thermal::CompensationBlock;
use serde::{Deserialize, Serialize};

use crate::frame::CRC;

/// Longest block, bytes. One of another version may be as long.
pub const MAX_BLOCK: usize = 2464;

const MAGIC: [u8; 4] = *b"SCHC";
const HEADER: usize = MAGIC.len() + 4;
const CHECKSUM: usize = 4;
/// Target (tag, index), coefficient, and two factors of quantity (tag, two indices), reference and power, bytes.
const LONGEST_TERM: usize = 2 + 4 + 2 * (3 + 4 + 1);
/// The rest but the calibration: validity, limits, and what postcard puts in between, bytes.
const LONGEST_REST: usize = 64;

// A block of the most terms fits.
const _: () = assert!(
    HEADER + size_of::<CompensationBlock>() + LONGEST_REST + MAX_TERMS * LONGEST_TERM + CHECKSUM <= MAX_BLOCK
);

/// A block as bytes.
pub type BlockBytes = Vec<u8, MAX_BLOCK>;

/// Why bytes are not a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BlockError {
    /// Not a compensation block, or cut short, or with something behind it.
    Form,
    /// The checksum does not fit.
    Checksum,
    /// Of another version.
    Version(u16),
    /// Sound bytes whose content is not a block.
    Content,
}

impl fmt::Display for BlockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Form => f.write_str("is not a compensation block, or not a whole one"),
            Self::Checksum => f.write_str("does not fit its checksum"),
            Self::Version(version) => {
                write!(f, "is of version {version}; expected version {BLOCK_VERSION}")
            }
            Self::Content => f.write_str("fits its checksum, but its content is not a block"),
        }
    }
}

impl core::error::Error for BlockError {}

/// The bytes of a block. Never panics: the longest block fits.
pub fn encode(block: &Block) -> BlockBytes {
    let mut bytes = BlockBytes::new();
    // It fits, by the assertion above.
    let _ = write(block, &mut bytes);
    bytes
}

fn write(block: &Block, bytes: &mut BlockBytes) -> Result<(), ()> {
    let mut content = [0; MAX_BLOCK];
    let content = postcard::to_slice(block, &mut content).map_err(|_| ())?;
    let length = u16::try_from(content.len()).map_err(|_| ())?;
    bytes.extend_from_slice(&MAGIC).map_err(|_| ())?;
    bytes.extend_from_slice(&BLOCK_VERSION.to_le_bytes()).map_err(|_| ())?;
    bytes.extend_from_slice(&length.to_le_bytes()).map_err(|_| ())?;
    bytes.extend_from_slice(content).map_err(|_| ())?;
    let checksum = CRC.checksum(bytes);
    bytes.extend_from_slice(&checksum.to_le_bytes()).map_err(|_| ())
}

/// The block in these bytes and its checksum. The values are yet to be checked by who flies them.
///
/// # Errors
/// Why the bytes are not a block.
#[inline(never)] // What it needs of the stack is free again when the block is put to use.
pub fn decode(bytes: &[u8]) -> Result<(Block, u32), BlockError> {
    let (body, &checksum) = bytes.split_last_chunk::<CHECKSUM>().ok_or(BlockError::Form)?;
    let (&[m0, m1, m2, m3, v0, v1, l0, l1], content) =
        body.split_first_chunk::<HEADER>().ok_or(BlockError::Form)?;
    if [m0, m1, m2, m3] != MAGIC || usize::from(u16::from_le_bytes([l0, l1])) != content.len() {
        return Err(BlockError::Form);
    }
    let checksum = u32::from_le_bytes(checksum);
    if CRC.checksum(body) != checksum {
        return Err(BlockError::Checksum);
    }
    let version = u16::from_le_bytes([v0, v1]);
    if version != BLOCK_VERSION {
        return Err(BlockError::Version(version));
    }
    match postcard::take_from_bytes(content) {
        Ok((block, [])) => Ok((block, checksum)),
        _ => Err(BlockError::Content),
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use schuler_core::compensation::{Calibration, Factor, Quantity, Target, Term};

    use super::*;

    fn longest() -> Block {
        let factor = Factor {
            quantity: Quantity::TemperatureDifference(u8::MAX, u8::MAX),
            reference: 1e30,
            power: 255,
        };
        let term = Term { target: Target::Gyro(u8::MAX), coefficient: -1e-30, factors: [factor; 2] };
        Block {
            calibration: Some(Calibration {
                thermometer: u8::MAX,
                coefficients: CompensationBlock { version: u16::MAX, ..CompensationBlock::default() },
            }),
            terms: (0..MAX_TERMS).map(|_| term).collect(),
            ..Block::default()
        }
    }

    #[test]
    fn blocks_come_back_and_the_longest_fits() {
        for block in [Block::default(), longest()] {
            let bytes = encode(&block);
            std::println!("{} of {MAX_BLOCK} bytes", bytes.len());
            let (back, checksum) = decode(&bytes).unwrap();
            assert_eq!(back, block);
            assert_eq!(checksum.to_le_bytes(), bytes[bytes.len() - 4..]);
        }
    }

    /// The first bytes, by hand, and the checksum by zlib's definition: anybody can make a block.
    #[test]
    fn the_form_is_as_described() {
        let bytes = encode(&Block::default());
        assert_eq!(&bytes[..6], b"SCHC\x02\x00");
        assert_eq!(usize::from(bytes[6]) + 256 * usize::from(bytes[7]), bytes.len() - 12);
        assert_eq!(bytes[8..10], [0, 0], "no calibration; then the validity, -60 as a little-endian float");
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes[..bytes.len() - 4]);
        assert_eq!(crc.to_le_bytes(), bytes[bytes.len() - 4..]);
    }

    fn sealed(mut body: Vec<u8>) -> Vec<u8> {
        let checksum = CRC.checksum(&body);
        body.extend(checksum.to_le_bytes());
        body
    }

    #[test]
    fn each_damage_has_its_reason() {
        let bytes = encode(&longest());
        for at in 0..bytes.len() {
            let mut damaged = bytes.to_vec();
            damaged[at] ^= 0x10;
            let expected =
                if at < 4 || (6..8).contains(&at) { BlockError::Form } else { BlockError::Checksum };
            assert_eq!(decode(&damaged).unwrap_err(), expected, "byte {at}");
            assert_eq!(decode(&bytes[..at]).unwrap_err(), BlockError::Form, "cut at {at}");
        }
        assert_eq!(decode(&[&bytes[..], &[0]].concat()).unwrap_err(), BlockError::Form);
        let body = &bytes[..bytes.len() - 4];
        let mut other = body.to_vec();
        other[4] = 77;
        assert_eq!(decode(&sealed(other)).unwrap_err(), BlockError::Version(77));
        let mut nonsense = body.to_vec();
        nonsense[8] = 9;
        assert_eq!(decode(&sealed(nonsense)).unwrap_err(), BlockError::Content);
    }
}
