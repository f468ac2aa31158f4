//! A compensation block as bytes: what a file holds, and what is loaded over the link.
//!
//! ```text
//! "SCHC" │ version u16 LE │ length u16 LE │ content, postcard │ CRC-32 LE
//! ```
//! The checksum is that of the frames and covers everything before it; the length is that of the content. The checksum names
//! the block: the module reports that of the block in force.
use heapless::Vec;
use schuler_core::compensation::{BLOCK_VERSION, Block, MAX_TERMS};
use schuler_core::thermal::CompensationBlock;

pub use crate::seal::BlockError;
use crate::seal::{self, OVERHEAD};

/// Longest block, bytes. One of another version may be as long.
pub const MAX_BLOCK: usize = 2464;

const MAGIC: [u8; 4] = *b"SCHC";
/// Target (tag, index), coefficient, and two factors of quantity (tag, two indices), reference and power, bytes.
const LONGEST_TERM: usize = 2 + 4 + 2 * (3 + 4 + 1);
/// The rest but the calibration: validity, limits, and what postcard puts in between, bytes.
const LONGEST_REST: usize = 64;

// A block of the most terms fits.
const _: () =
    assert!(OVERHEAD + size_of::<CompensationBlock>() + LONGEST_REST + MAX_TERMS * LONGEST_TERM <= MAX_BLOCK);

/// A block as bytes.
pub type BlockBytes = Vec<u8, MAX_BLOCK>;

/// The bytes of a block. Never panics: the longest block fits.
pub fn encode(block: &Block) -> BlockBytes {
    seal::close(MAGIC, BLOCK_VERSION, block)
}

/// The block in these bytes and its checksum. The values are yet to be checked by who flies them.
///
/// # Errors
/// Why the bytes are not a block.
pub fn decode(bytes: &[u8]) -> Result<(Block, u32), BlockError> {
    let (content, checksum) = seal::open(MAGIC, BLOCK_VERSION, bytes)?;
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
    use crate::frame::CRC;

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

    fn refusal(bytes: &[u8]) -> BlockError {
        decode(bytes).map(|_| ()).unwrap_err()
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
            assert_eq!(refusal(&damaged), expected, "byte {at}");
            assert_eq!(refusal(&bytes[..at]), BlockError::Form, "cut at {at}");
        }
        assert_eq!(refusal(&[&bytes[..], &[0]].concat()), BlockError::Form);
        let body = &bytes[..bytes.len() - 4];
        let mut other = body.to_vec();
        other[4] = 77;
        assert_eq!(refusal(&sealed(other)), BlockError::Version(77));
        let mut nonsense = body.to_vec();
        nonsense[8] = 9;
        assert_eq!(refusal(&sealed(nonsense)), BlockError::Content);
    }

    /// Sound bytes with a term too few, one too many, and part of one.
    #[test]
    fn terms_are_counted() {
        let bytes = encode(&longest());
        let rebuilt = |content: &[u8]| {
            let length = (content.len() as u16).to_le_bytes();
            sealed([&bytes[..6], &length, content].concat())
        };
        let content = &bytes[8..bytes.len() - 4];
        assert!(decode(&rebuilt(content)).is_ok());
        for wrong in [&content[..content.len() - 1], &[content, &[0]].concat(), &content[..content.len() / 2]]
        {
            assert_eq!(refusal(&rebuilt(wrong)), BlockError::Content);
        }
    }
}
