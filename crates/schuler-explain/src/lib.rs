//! Why a recording does not look like its simulation.
//!
//! | module | stage |
//! | --- | --- |
//! | [`inputs`] | what is recorded and what follows from it |
//! | `problem` | the recording against its nominal model, and what may have been left out: [`catalogue`] |
//! | [`faults`] | readings that are stuck, clipped, coarse or spiked |
//! | `whitening` | the state-space filter that whitens residuals and signatures |
//! | `bands` | the whitened record as sums of products over bands |
//! | [`noise`] | spectra of the noise, how far they are believed, their fit |
//! | `evidence` | the one number of a description |
//! | `search` | from description to description |
//! | `exact` | the few that stand, over all rows |
//! | `answer` | from the best of them to an [`explanation`] |
//! | [`export`] | what was found as a compensation |
//!
//! [`config::Config`] holds every number that decides.
//!
//! ```
//! use std::fmt::Write;
//!
//! use schuler_explain::config::Config;
//! use schuler_explain::explain::explain;
//! use schuler_recording::Recording;
//!
//! // Ten minutes of a gyro at rest, whose bias jumps in the middle by something that nobody has believed.
//! let mut table = String::from("t,gyro\n");
//! let mut random = 1_u32;
//! for k in 0..600 {
//!     random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
//!     let noise = f64::from(random >> 8) / f64::from(1 << 24) - 0.5;
//!     let jump = if k < 300 { 0.0 } else { 1.0 };
//!     writeln!(table, "{k},{}", 0.1 * noise + jump)?;
//! }
//! let folder = tempfile::tempdir()?;
//! std::fs::write(folder.path().join("recording.csv"), table)?;
//! std::fs::write(
//!     folder.path().join("case.toml"),
//!     r#"
//!         format = "schuler-case/1"
//!         title  = "Gyro on a bench"
//!         recording = { path = "recording.csv", time = "t", step_s = 1.0 }
//!         motion = { kind = "static", attitude_deg = { roll = 0.0, pitch = 0.0, heading = 90.0 } }
//!         site = { latitude_deg = 0.0, altitude_m = 0.0 }
//!         [[sensor]]
//!         id     = "gyro"
//!         kind   = "mems_gyro"
//!         column = "gyro"
//!         unit   = "deg/s"
//!         axis   = [0.0, 0.0, 1.0]
//!         nominal = { bias = 0.0, white = 0.03 }
//!     "#,
//! )?;
//! let recording = Recording::read(&folder.path().join("case.toml"))?;
//! let explanation = explain(&recording, &Config::default())?;
//! let [finding] = &explanation.findings[..] else { panic!("one thing was left out, and not {explanation:?}") };
//! println!("{}", finding.sentence);
//! assert_eq!((finding.sensor.as_str(), finding.interval_s[0].round()), ("gyro", 300.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod answer;
mod bands;
pub mod calibration;
pub mod catalogue;
mod common_motion;
pub mod config;
mod description;
pub mod diagnostics;
mod evidence;
mod exact;
pub mod explain;
pub mod explanation;
pub mod export;
pub mod faults;
pub mod inputs;
pub mod noise;
pub mod nominal;
pub mod numeric;
mod problem;
pub mod radio_identification;
mod search;
pub mod sentence;
pub mod watch;
mod whitening;
