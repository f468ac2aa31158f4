//! The memory of a module, and what is done with it once the pointers are checked.
use core::fmt::{self, Write};
use core::mem::MaybeUninit;

use schuler_core::config::{ConfigError, Problem};
use schuler_core::module::{FlightModule, Status};
use schuler_link::{block, configuration};

use crate::{SchulerInput, SchulerOutput, SchulerResult};

/// Size of a module, bytes: enough on machines of 32 and of 64 bits.
pub const SCHULER_MODULE_SIZE: usize = 47_872;

/// The memory of a module; give it a static. What is in it is the library's business alone. It must not be copied or moved in use;
/// schuler_save and schuler_restore carry a state over.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct SchulerModule {
    /// Of the library.
    pub private_words: [u64; 5984],
}

const _: () = assert!(size_of::<SchulerModule>() == SCHULER_MODULE_SIZE);
const _: () = assert!(size_of::<Module>() <= SCHULER_MODULE_SIZE, "raise SCHULER_MODULE_SIZE");
const _: () = assert!(size_of::<Module>() + 1024 > SCHULER_MODULE_SIZE, "lower SCHULER_MODULE_SIZE");
const _: () = assert!(align_of::<Module>() <= align_of::<SchulerModule>());

impl SchulerModule {
    /// Memory that is yet to be initialised.
    #[allow(clippy::large_stack_arrays)] // For statics.
    pub const fn zeroed() -> Self {
        Self { private_words: [0; 5984] }
    }
}

/// Says that there is a module. Chance does not leave it in memory.
const MARK: u64 = 0x5c4d_71e5_6d6f_6475;

/// What really is in the memory.
#[repr(C)]
pub(crate) struct Module {
    /// Of the first word of the memory.
    mark: u64,
    flight: FlightModule,
    refusal: Option<ConfigError>,
}

impl Module {
    /// Writes a module that waits for its configuration.
    #[inline(never)]
    pub(crate) fn place(memory: &mut MaybeUninit<Self>) {
        memory.write(Self { mark: MARK, flight: FlightModule::new(), refusal: None });
    }

    pub(crate) const fn is_marked(mark: u64) -> bool {
        mark == MARK
    }

    pub(crate) fn configure(&mut self, bytes: &[u8]) -> Result<(), SchulerResult> {
        // By reference: a configuration is too large to be moved.
        let result = match &configuration::decode(bytes) {
            Ok(config) => self.flight.configure(config),
            Err(error) => return Err((*error).into()),
        };
        self.refuse(result)
    }

    pub(crate) fn load_compensation(&mut self, bytes: &[u8]) -> Result<(), SchulerResult> {
        let (result, checksum) = match &block::decode(bytes) {
            Ok((block, checksum)) => (self.flight.load_compensation(block), *checksum),
            Err(error) => return Err((*error).into()),
        };
        self.refuse(result)?;
        self.flight.name_compensation(checksum);
        Ok(())
    }

    fn refuse(&mut self, result: Result<(), ConfigError>) -> Result<(), SchulerResult> {
        self.refusal = result.err();
        result.map_err(|error| match error.problem {
            Problem::BeforeConfiguration => SchulerResult::NotConfigured,
            _ => SchulerResult::Refused,
        })
    }

    pub(crate) fn step(&mut self, input: &SchulerInput) -> (SchulerOutput, SchulerResult) {
        let output = self.flight.step(&input.into());
        let configured = !output.status.contains(Status::NOT_CONFIGURED);
        let result = if configured { SchulerResult::Ok } else { SchulerResult::NotConfigured };
        (SchulerOutput::from(&output), result)
    }

    pub(crate) fn state_length(&mut self) -> Result<usize, SchulerResult> {
        Ok(self.flight.state_length()? as usize)
    }

    pub(crate) fn save(&mut self, bytes: &mut [u8]) -> Result<usize, SchulerResult> {
        Ok(self.flight.save(bytes)?)
    }

    pub(crate) fn restore(&mut self, bytes: &[u8]) -> Result<(), SchulerResult> {
        Ok(self.flight.restore(bytes)?)
    }

    /// Field and problem of the last refusal, and a zero; what does not fit is left out.
    pub(crate) fn refusal(&self, text: &mut [u8]) {
        let mut text = Text { left: text };
        if let Some(error) = &self.refusal {
            // An error says that the rest was left out.
            let _ = write!(text, "{error}");
        }
        if let [end, ..] = text.left {
            *end = 0;
        }
    }
}

/// Text in a buffer, with room left for the zero at its end.
struct Text<'a> {
    left: &'a mut [u8],
}

impl Write for Text<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            let left = core::mem::take(&mut self.left);
            let [here, rest @ ..] = left else { return Err(fmt::Error) };
            if rest.is_empty() {
                self.left = core::slice::from_mut(here);
                return Err(fmt::Error);
            }
            *here = byte;
            self.left = rest;
        }
        Ok(())
    }
}
