//! The state of the module as bytes: a power cycle loses nothing but the outage.
//!
//! ```text
//! "SCHS" │ version u32 │ length u32 │ fingerprint of the configuration u32 │ everything that changes │ CRC-32
//! ```
//! All numbers are little-endian; the length is that of the whole block, and the checksum, that of the frames, covers everything
//! before it. A module is configured first, as before the outage, and then brought back; what the configuration determines is
//! not in the block. Its length is a matter of the configuration alone, and every value has its place.
//!
//! A module that was brought back goes on as if it had never stopped: the same inputs give the same bits. The outage shows in
//! the time of the next input, and is bridged or not like any other gap.
//!
//! Who has no memory for the whole block saves it in parts ([`FlightModule::save_part`]) and brings it back in parts
//! ([`StateLoader`]), in two passes: the first looks at everything and changes nothing.
use core::fmt;

use serde::{Deserialize, Serialize};

use super::FlightModule;
use crate::saved::{Checksum, Walk};

/// Version of the block: what is saved, and in which order.
pub const STATE_VERSION: u32 = 3;

const MAGIC: [u8; 4] = *b"SCHS";
/// Magic, version, length, fingerprint.
const HEADER: u32 = 16;
const CHECKSUM: u32 = 4;

/// Why a state was not saved or not brought back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StateError {
    /// There is no configuration yet, or a state that is being brought back is not whole yet.
    NotConfigured,
    /// Not a saved state, or not a whole one, or with something behind it.
    Form,
    /// Of another version.
    Version(u32),
    /// Of a module with another configuration.
    Configuration,
    /// The checksum does not fit.
    Checksum,
    /// Sound bytes with a value that cannot be.
    Content,
    /// No value begins there, or it is not that part's turn; `next` is where the next part begins.
    Place {
        /// In bytes from the start of the block.
        next: u32,
    },
    /// These bytes have not been looked at from beginning to end.
    NotChecked,
    /// Less room than the block needs.
    Room,
}

impl fmt::Display for StateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConfigured => f.write_str("needs a configured module"),
            Self::Form => f.write_str("is not a saved state, or not a whole one"),
            Self::Version(version) => {
                write!(f, "is of version {version}; expected version {STATE_VERSION}")
            }
            Self::Configuration => f.write_str("is that of a module with another configuration"),
            Self::Checksum => f.write_str("does not fit its checksum"),
            Self::Content => f.write_str("fits its checksum, but has a value that cannot be"),
            Self::Place { next } => write!(f, "is to go on at byte {next}"),
            Self::NotChecked => f.write_str("has not been checked before it is brought back"),
            Self::Room => f.write_str("does not fit into the room that there is for it"),
        }
    }
}

impl core::error::Error for StateError {}

impl FlightModule {
    /// Length of the saved state, bytes: a matter of the configuration alone. `&mut` because one walk serves saving and bringing
    /// back; nothing is changed.
    ///
    /// # Errors
    /// [`StateError::NotConfigured`].
    pub fn state_length(&mut self) -> Result<u32, StateError> {
        if self.is_incomplete() || self.fingerprint().is_none() {
            return Err(StateError::NotConfigured);
        }
        Ok(self.block_length())
    }

    /// Saves the whole state; the bytes written. Nothing is changed.
    ///
    /// # Errors
    /// [`StateError::NotConfigured`] or [`StateError::Room`].
    pub fn save(&mut self, bytes: &mut [u8]) -> Result<usize, StateError> {
        let length = self.state_length()? as usize;
        let bytes = bytes.get_mut(..length).ok_or(StateError::Room)?;
        self.save_part(0, bytes)
    }

    /// Saves the part of the state that begins at `begin`, as much of it as fits into `bytes`; the bytes written: where they end
    /// the next part begins, and after the last one nothing is written. Eight bytes are enough for any value. Nothing is changed.
    /// Parts saved before and after a step do not make a state: their checksum does not fit.
    ///
    /// # Errors
    /// [`StateError::NotConfigured`], or [`StateError::Place`] when no value begins there.
    pub fn save_part(&mut self, begin: u32, bytes: &mut [u8]) -> Result<usize, StateError> {
        let length = self.state_length()?;
        let room = bytes.len();
        let mut walk = Walk::save(begin, bytes);
        self.walk_block(&mut walk)?;
        let written = walk.served();
        if written == 0 && begin != length && room > 0 {
            return Err(StateError::Place { next: 0 });
        }
        Ok(written as usize)
    }

    /// Goes on from a saved state. The module must have been configured as the one that was saved; what it was doing is
    /// forgotten. On an error it goes on as it was.
    ///
    /// # Errors
    /// Why the bytes are not a state of this module.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), StateError> {
        self.fingerprint().ok_or(StateError::NotConfigured)?;
        examine(bytes)?;
        self.walk_block(&mut Walk::check(0, bytes, Checksum::default()))?;
        self.walk_block(&mut Walk::restore(0, bytes, Checksum::default()))?;
        self.set_incomplete(false);
        Ok(())
    }

    fn block_length(&mut self) -> u32 {
        let mut walk = Walk::measure();
        self.walk(&mut walk);
        HEADER + walk.here() + CHECKSUM
    }

    /// Walks over the block from its first byte to its last.
    #[inline(never)]
    fn walk_block(&mut self, walk: &mut Walk<'_>) -> Result<(), StateError> {
        self.walk_body(walk)?;
        let checksum = if walk.is_written_next() {
            let mut sum = Walk::sum();
            self.walk_body(&mut sum)?;
            sum.checksum()
        } else {
            walk.checksum()
        };
        walk.constant(checksum.value()).map_err(|_| StateError::Checksum)
    }

    /// Everything but the checksum.
    fn walk_body(&mut self, walk: &mut Walk<'_>) -> Result<(), StateError> {
        let fingerprint = self.fingerprint().ok_or(StateError::NotConfigured)?;
        let length = self.block_length();
        walk.constant(u32::from_le_bytes(MAGIC)).map_err(|_| StateError::Form)?;
        walk.constant(STATE_VERSION).map_err(StateError::Version)?;
        walk.constant(length).map_err(|_| StateError::Form)?;
        walk.constant(fingerprint).map_err(|_| StateError::Configuration)?;
        self.walk(walk);
        if walk.is_flawed() { Err(StateError::Content) } else { Ok(()) }
    }
}

/// Whether the bytes are a whole saved state, of whatever version, configuration and content.
///
/// # Errors
/// [`StateError::Form`] or [`StateError::Checksum`].
fn examine(bytes: &[u8]) -> Result<(), StateError> {
    let (body, checksum) = bytes.split_last_chunk::<4>().ok_or(StateError::Form)?;
    let (header, _) = body.split_first_chunk::<{ HEADER as usize }>().ok_or(StateError::Form)?;
    let [m0, m1, m2, m3, _, _, _, _, l0, l1, l2, l3, ..] = *header;
    if [m0, m1, m2, m3] != MAGIC || u32::from_le_bytes([l0, l1, l2, l3]) as usize != bytes.len() {
        return Err(StateError::Form);
    }
    if Checksum::default().with(body).value() != u32::from_le_bytes(*checksum) {
        return Err(StateError::Checksum);
    }
    Ok(())
}

/// Which time the bytes of a saved state go by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum StatePass {
    /// The first: they are looked at, and nothing is changed.
    #[default]
    Check,
    /// The second: they are brought back. From its first part to its last the module makes no step.
    Restore,
}

/// Brings a state back in parts, in a few bytes of memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct StateLoader {
    pass: StatePass,
    /// Where the next part begins.
    next: u32,
    /// Of the parts of this pass so far.
    checksum: Checksum,
    /// Checksum of the state that was looked at from beginning to end and found good.
    good: Option<u32>,
}

impl StateLoader {
    /// A loader that has heard nothing yet.
    pub const fn new() -> Self {
        Self { pass: StatePass::Check, next: 0, checksum: Checksum::EMPTY, good: None }
    }

    /// Takes a part of the state that begins at `begin`; where the next one begins. That may be before the end of this part:
    /// a value that is not whole is not taken. At the length of the block the pass is complete, and after the second one the
    /// module goes on from the state. A part that begins at zero begins a pass.
    ///
    /// # Errors
    /// Why this is not a state of this module. In the first pass the module goes on as it was. In the second, which the first
    /// has made sure of, an error means that other bytes came than the first time: the module makes no step until a state has
    /// come whole, or a configuration.
    pub fn take(
        &mut self,
        module: &mut FlightModule,
        pass: StatePass,
        begin: u32,
        bytes: &[u8],
    ) -> Result<u32, StateError> {
        let result = self.take_part(module, pass, begin, bytes);
        if result.is_err_and(|error| !matches!(error, StateError::Place { .. })) {
            *self = Self::default();
        }
        result
    }

    fn take_part(
        &mut self,
        module: &mut FlightModule,
        pass: StatePass,
        begin: u32,
        bytes: &[u8],
    ) -> Result<u32, StateError> {
        module.fingerprint().ok_or(StateError::NotConfigured)?;
        if begin == 0 {
            let good = self.good.filter(|_| pass == StatePass::Restore);
            *self = Self { pass, good, ..Self::default() };
        }
        if pass != self.pass || begin != self.next {
            return Err(StateError::Place { next: if pass == self.pass { self.next } else { 0 } });
        }
        let mut walk = match pass {
            StatePass::Check => Walk::check(begin, bytes, self.checksum),
            StatePass::Restore => {
                self.good.ok_or(StateError::NotChecked)?;
                module.set_incomplete(true);
                Walk::restore(begin, bytes, self.checksum)
            }
        };
        module.walk_block(&mut walk)?;
        let (served, checksum) = (walk.served(), walk.checksum());
        self.next = begin + served;
        self.checksum = checksum;
        let complete = self.next == module.block_length();
        if complete && served as usize != bytes.len() {
            return Err(StateError::Form);
        }
        if complete && pass == StatePass::Check {
            self.good = Some(checksum.value());
        } else if complete {
            if self.good != Some(checksum.value()) {
                return Err(StateError::Checksum);
            }
            self.good = None;
            module.set_incomplete(false);
        }
        Ok(self.next)
    }
}
