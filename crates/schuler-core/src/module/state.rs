//! The state of the module as bytes: a power cycle loses nothing but the outage, and what is configured on the ground flies
//! without a line of code that configures.
//!
//! ```text
//! "SCHS" │ version u32 │ length u32 │ fingerprint of the configuration u32 │ everything │ CRC-32
//! ```
//! All numbers are little-endian; the length is that of the whole block, and the checksum, that of the frames, covers everything
//! before it. What the configuration has determined is in the block with what changes from step to step, so a module needs
//! nothing else to be brought back; one that has been configured takes none of another configuration. The length is a matter of
//! the configuration alone, and every value has its place.
//!
//! A module that was brought back goes on as if it had never stopped: the same inputs give the same bits. The outage shows in
//! the time of the next input, and is bridged or not like any other gap. One that has been configured and has made no step is
//! a state like any other. A state is made by a module, which has checked its configuration; bringing it back checks that the bytes
//! are those that were saved, and that no tag or index is impossible, but not again whether each number can be flown.
//!
//! Who has no memory for the whole block saves it in parts ([`FlightModule::save_part`]) and brings it back in parts
//! ([`StateLoader`]).
use core::fmt;

use serde::{Deserialize, Serialize};

use super::FlightModule;
use crate::saved::{Checksum, Saved, Visitor};

/// Version of the block: what is saved, and in which order.
pub const STATE_VERSION: u32 = 6;

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
    /// Of a module with another configuration than this one has.
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
            Self::Room => f.write_str("does not fit into the room that there is for it"),
        }
    }
}

impl core::error::Error for StateError {}

impl FlightModule {
    /// Length of the saved state, bytes: a matter of the configuration alone. `&mut` because one pass serves saving and bringing
    /// back; nothing is changed.
    ///
    /// # Errors
    /// [`StateError::NotConfigured`].
    pub fn state_length(&mut self) -> Result<u32, StateError> {
        if self.is_whole() { Ok(self.block_length()) } else { Err(StateError::NotConfigured) }
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
        let mut visitor = Visitor::save(begin, bytes);
        self.visit_block(&mut visitor)?;
        let written = visitor.served();
        if written == 0 && begin != length && room > 0 {
            return Err(StateError::Place { next: 0 });
        }
        Ok(written as usize)
    }

    /// Goes on from a saved state; what the module was doing is forgotten. One that has been configured takes none of another
    /// configuration, unless it is told to [forget](Self::forget) its own; one that waits takes any.
    ///
    /// # Errors
    /// Why the bytes are not a state. The module goes on as it was; but after bytes that fit their checksum and say what cannot be
    /// it waits for a configuration or another state, as in the beginning.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), StateError> {
        examine(bytes)?;
        match StateLoader::new().take(self, 0, bytes) {
            Ok(_) if !self.is_loading() => Ok(()),
            // Of a length that no state has: somebody's work. It may end where another value would begin.
            Ok(_) => {
                self.forget();
                Err(StateError::Content)
            }
            Err(error) => Err(error),
        }
    }

    fn block_length(&mut self) -> u32 {
        let mut visitor = Visitor::measure();
        self.visit(&mut visitor);
        HEADER + visitor.here() + CHECKSUM
    }

    /// Walks over the block from its first byte to its last.
    #[inline(never)]
    fn visit_block(&mut self, visitor: &mut Visitor<'_>) -> Result<(), StateError> {
        self.visit_body(visitor)?;
        let checksum = if visitor.is_written_next() {
            let mut sum = Visitor::sum();
            self.visit_body(&mut sum)?;
            sum.checksum()
        } else {
            visitor.checksum()
        };
        visitor.constant(checksum.value()).map_err(|_| StateError::Checksum)
    }

    /// Everything but the checksum.
    fn visit_body(&mut self, visitor: &mut Visitor<'_>) -> Result<(), StateError> {
        // Those of the state that comes, if one does: it says more of itself when all of it is there.
        let (mut length, mut fingerprint) = (self.block_length(), self.fingerprint().unwrap_or_default());
        visitor.constant(u32::from_le_bytes(MAGIC)).map_err(|_| StateError::Form)?;
        visitor.constant(STATE_VERSION).map_err(StateError::Version)?;
        length.visit(visitor);
        fingerprint.visit(visitor);
        self.visit(visitor);
        if visitor.is_flawed() { Err(StateError::Content) } else { Ok(()) }
    }
}

/// Whether the bytes are a whole saved state of this version, of whatever content.
///
/// # Errors
/// [`StateError::Form`], [`StateError::Checksum`] or [`StateError::Version`].
fn examine(bytes: &[u8]) -> Result<(), StateError> {
    let (body, checksum) = bytes.split_last_chunk::<4>().ok_or(StateError::Form)?;
    let Header { version, length, .. } = Header::of(body)?;
    if length as usize != bytes.len() {
        return Err(StateError::Form);
    }
    if Checksum::default().with(body).value() != u32::from_le_bytes(*checksum) {
        return Err(StateError::Checksum);
    }
    if version == STATE_VERSION { Ok(()) } else { Err(StateError::Version(version)) }
}

/// What a block says of itself.
struct Header {
    version: u32,
    length: u32,
    fingerprint: u32,
}

impl Header {
    fn of(bytes: &[u8]) -> Result<Self, StateError> {
        let header = bytes.first_chunk::<{ HEADER as usize }>().ok_or(StateError::Form)?;
        let [m0, m1, m2, m3, v0, v1, v2, v3, l0, l1, l2, l3, f0, f1, f2, f3] = *header;
        if [m0, m1, m2, m3] != MAGIC {
            return Err(StateError::Form);
        }
        Ok(Self {
            version: u32::from_le_bytes([v0, v1, v2, v3]),
            length: u32::from_le_bytes([l0, l1, l2, l3]),
            fingerprint: u32::from_le_bytes([f0, f1, f2, f3]),
        })
    }
}

/// Brings a state back in parts, in a few bytes of memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct StateLoader {
    /// Length of the block, by its header.
    length: u32,
    /// Where the next part begins.
    next: u32,
    /// Of the parts so far.
    checksum: Checksum,
}

impl StateLoader {
    /// A loader that has heard nothing yet.
    pub const fn new() -> Self {
        Self { length: 0, next: 0, checksum: Checksum::EMPTY }
    }

    /// Takes a part of the state that begins at `begin`; where the next one begins. That may be before the end of this part:
    /// a value that is not whole is not taken. A part that begins at zero begins anew, and holds the header at least, sixteen
    /// bytes. From it to the last part the module makes no step; at the length of the block it goes on from the state.
    ///
    /// # Errors
    /// Why this is not a state. A part that is out of its turn, and a first one without the header of a state of this version
    /// and configuration, change nothing. After any other error the module waits for a configuration or a state, as in the beginning.
    pub fn take(&mut self, module: &mut FlightModule, begin: u32, bytes: &[u8]) -> Result<u32, StateError> {
        if begin == 0 {
            let Header { version, length, fingerprint } = Header::of(bytes)?;
            if version != STATE_VERSION {
                return Err(StateError::Version(version));
            }
            if module.fingerprint().is_some_and(|own| own != fingerprint) {
                return Err(StateError::Configuration);
            }
            *self = Self { length, ..Self::new() };
            module.begin_loading();
        } else if !module.is_loading() {
            return Err(StateError::Place { next: 0 });
        } else if begin != self.next {
            return Err(StateError::Place { next: self.next });
        }
        let result = self.take_part(module, begin, bytes);
        if result.is_err() {
            module.forget();
        }
        result
    }

    fn take_part(&mut self, module: &mut FlightModule, begin: u32, bytes: &[u8]) -> Result<u32, StateError> {
        let mut visitor = Visitor::restore(begin, bytes, self.checksum);
        module.visit_block(&mut visitor)?;
        self.next = begin + visitor.served();
        self.checksum = visitor.checksum();
        if self.next == module.block_length() {
            if self.next != self.length || visitor.served() as usize != bytes.len() {
                return Err(StateError::Form);
            }
            module.end_loading();
        }
        Ok(self.next)
    }
}
