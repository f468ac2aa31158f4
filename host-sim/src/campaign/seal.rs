//! Sealing: the fingerprint of an answer is written down before anybody looks for it, so that nobody can change it afterwards.
//!
//! The fingerprint is SHA-256 over a salt of 32 random bytes and the answer's text. The salt keeps the answer from being guessed: there
//! are few identifiers, and a fingerprint without one could be tried.
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Bytes of a salt.
const SALT: usize = 32;

/// A sealed text.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// SHA-256, hexadecimal.
    pub fingerprint: String,
    /// Salt, hexadecimal; known once the seal is broken.
    pub salt: String,
}

impl Seal {
    /// Seals a text with a fresh salt of the operating system's randomness.
    ///
    /// # Errors
    /// The operating system has no randomness to give.
    pub fn new(text: &str) -> anyhow::Result<Self> {
        let mut salt = [0u8; SALT];
        getrandom::fill(&mut salt).map_err(|error| anyhow::anyhow!("no random salt: {error}"))?;
        let salt = hexadecimal(&salt);
        Ok(Self { fingerprint: fingerprint(&salt, text), salt })
    }

    /// Whether this is the seal of a text.
    pub fn fits(&self, text: &str) -> bool {
        self.fingerprint == fingerprint(&self.salt, text)
    }
}

fn fingerprint(salt: &str, text: &str) -> String {
    hexadecimal(&Sha256::new().chain_update(salt.as_bytes()).chain_update(text.as_bytes()).finalize())
}

pub(super) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing into a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seal_fits_its_text_and_no_other() {
        let seal = Seal::new("bias_step on gyro_x").unwrap();
        assert!(seal.fits("bias_step on gyro_x"));
        assert!(!seal.fits("bias_step on gyro_y"));
        let another = Seal::new("bias_step on gyro_x").unwrap();
        assert_ne!(seal, another);
        assert!(!Seal { salt: another.salt, ..seal }.fits("bias_step on gyro_x"));
    }

    #[test]
    fn the_fingerprint_is_sha_256() {
        // FIPS 180-4, "abc".
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(fingerprint("a", "bc"), expected);
    }
}
