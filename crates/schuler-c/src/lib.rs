//! The flight module behind a C interface, for flight software that exists already. C sees `include/schuler.h`, which is made
//! from the sources here.
//!
//! | file | holds |
//! | --- | --- |
//! | `boundary` | the functions that C calls; the only place with `unsafe` |
//! | `module` | the memory of a module, and what is done with it once the pointers are checked |
//! | `input` | what comes in each step |
//! | `output` | what comes out each step |
//! | `numbers` | flags and choices as C sees them |
//! | `result` | what a call can answer |
//!
//! **No heap, no panic, no globals.** The caller gives the memory. Numbers have fixed widths on every machine and the structures no
//! padding, so that the bytes of an output can be compared, stored and sent as they are.
//!
//! **The configuration comes as bytes**, the block of [`schuler_link::configuration`] that the ground has made and checked: one
//! reader for all of its fifty fields, a version and a checksum against what flash and links do to bytes, and nothing in C that must
//! be kept in step with the fields. The compensation block comes the same way.
//!
//! ```
//! use schuler_c::{SchulerInput, SchulerModule, SchulerOutput, SchulerResult};
//! use schuler_c::{SCHULER_INTERFACE_VERSION, SCHULER_MODULE_SIZE};
//! use schuler_core::module::ModuleConfig;
//!
//! let block = schuler_link::configuration::encode(&ModuleConfig::default())?;
//! let mut module = Box::new(SchulerModule::zeroed());
//! let mut output = SchulerOutput::default();
//! let input = SchulerInput { time_ms: 1000, ..SchulerInput::default() };
//! // SAFETY: all pointers come from what is borrowed here, and nobody else uses it.
//! unsafe {
//!     let size = SCHULER_MODULE_SIZE;
//!     let result = schuler_c::schuler_init(&mut *module, size, SCHULER_INTERFACE_VERSION);
//!     assert_eq!(result, SchulerResult::Ok);
//!     let result = schuler_c::schuler_configure(&mut *module, block.as_ptr(), block.len());
//!     assert_eq!(result, SchulerResult::Ok);
//!     assert_eq!(schuler_c::schuler_step(&mut *module, &input, &mut output), SchulerResult::Ok);
//! }
//! assert_eq!(output.step, 1);
//! # Ok::<(), schuler_core::config::ConfigError>(())
//! ```
#![cfg_attr(target_os = "none", no_std)]

mod boundary;
mod input;
mod module;
mod numbers;
mod output;
mod result;

pub use boundary::*;
pub use input::*;
pub use module::{SCHULER_MODULE_SIZE, SchulerModule};
pub use numbers::*;
pub use output::*;
pub use result::SchulerResult;

/// A library needs one to be linked into a program without the standard library. No call leads here.
#[cfg(target_os = "none")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
