//! What a call can answer.
use schuler_core::module::StateError;
use schuler_link::block::BlockError;

/// What a call answers. After anything but SCHULER_RESULT_OK the module is as it was before the call, unless said otherwise there.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SchulerResult {
    /// Done.
    Ok = 0,
    /// A pointer is null.
    NullPointer = 1,
    /// A pointer does not have the alignment of its type.
    Misaligned = 2,
    /// The memory for the module is smaller than this library needs: it was compiled with the header of another version.
    Size = 3,
    /// The caller was compiled with the header of another version.
    InterfaceVersion = 4,
    /// schuler_init has not been called on this memory, or something has written over it.
    NotInitialised = 5,
    /// The module has no configuration.
    NotConfigured = 6,
    /// The bytes are not a block or state of the expected kind, or are cut short, or have something behind them.
    Form = 7,
    /// The bytes do not fit their checksum.
    Checksum = 8,
    /// The bytes are of another version than this library.
    Version = 9,
    /// The bytes fit their checksum, but say something that cannot be.
    Content = 10,
    /// A value cannot be flown; schuler_refusal says which and why.
    Refused = 11,
    /// The state is that of a module with another configuration.
    OtherConfiguration = 12,
    /// There is less room than is needed.
    Room = 13,
}

impl From<BlockError> for SchulerResult {
    fn from(error: BlockError) -> Self {
        match error {
            BlockError::Form => Self::Form,
            BlockError::Checksum => Self::Checksum,
            BlockError::Version(_) => Self::Version,
            BlockError::Content => Self::Content,
        }
    }
}

impl From<StateError> for SchulerResult {
    fn from(error: StateError) -> Self {
        match error {
            StateError::NotConfigured => Self::NotConfigured,
            // Places are a matter of loading in parts, which is not offered here.
            StateError::Form | StateError::Place { .. } => Self::Form,
            StateError::Version(_) => Self::Version,
            StateError::Configuration => Self::OtherConfiguration,
            StateError::Checksum => Self::Checksum,
            StateError::Content => Self::Content,
            StateError::Room => Self::Room,
        }
    }
}
