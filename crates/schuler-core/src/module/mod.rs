//! The one fixed step that strings everything together: one plain struct in, one plain struct out.
//!
//! ```
//! use schuler_core::module::{FlightModule, ModuleConfig, StepInput};
//! use schuler_core::reading::Reading;
//!
//! // The state is large: keep it in a static on the target, in a box on the host.
//! let mut module = Box::new(FlightModule::new());
//! module.configure(&ModuleConfig::default())?;
//! let output = module.step(&StepInput {
//!     time_ms: 1000,
//!     velocity_error: Reading::good(0.12),
//!     gyros: [Reading::missing(); 5],
//!     ..StepInput::default()
//! });
//! assert!(output.filter.nis < 9.0);
//! # Ok::<(), schuler_core::config::ConfigError>(())
//! ```
//!
//! | file | holds |
//! | --- | --- |
//! | `input` | [`StepInput`], [`Command`] |
//! | `output` | [`StepOutput`], [`Status`] |
//! | `config` | [`ModuleConfig`] |
//! | `time` | what the time stamps say, and a clock that only runs forward |
//! | `thermometer` | one thermometer and how long it has been silent |
//! | `trust` | [`RadioUse`]: what the health monitor's verdict does to the filter's measurement |
//! | `velocity` | error filter and noise identification: the velocity channel |
//! | `flight` | [`FlightModule`]: the step |
//! | `state` | the state of the module as bytes, to go on after a power cycle |
//!
//! In a step: time; temperatures and rates; corrections; health monitor; velocity channel; gyro block. A part without
//! configuration runs on missing readings: its output says that it has none, and the work of a step is the same.
mod config;
mod flight;
mod input;
mod output;
mod state;
mod thermometer;
mod time;
mod trust;
mod velocity;

pub use config::ModuleConfig;
pub use flight::FlightModule;
pub use input::{Command, StepInput};
pub use output::{Status, StepOutput};
pub use state::{STATE_VERSION, StateError, StateLoader};
pub use trust::RadioUse;

/// Number of gyros in the block.
pub const GYROS: usize = 5;
/// Number of accelerometers.
pub const ACCELEROMETERS: usize = 3;
/// Number of thermometers.
pub const THERMOMETERS: usize = 4;
/// Levels of noise that the health monitor tells apart: normal and degraded.
pub const HEALTH_LEVELS: usize = 2;
