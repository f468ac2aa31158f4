//! Why a recording does not look like its simulation.
//!
//! ```
//! use std::fmt::Write;
//!
//! use schuler_explain::explain::{Options, explain};
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
//! let explanation = explain(&recording, &Options::default())?;
//! let [finding] = &explanation.findings[..] else { panic!("one thing was left out, and not {explanation:?}") };
//! println!("{}", finding.sentence);
//! assert_eq!((finding.sensor.as_str(), finding.interval_s[0].round()), ("gyro", 300.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod arrays;
pub mod budget;
pub mod calibration;
pub mod catalogue;
pub mod common_motion;
pub mod constancy;
mod course;
pub mod deploy;
pub mod description;
pub mod equivalence;
pub mod evidence;
pub mod explain;
pub mod explanation;
pub mod hold_out;
pub mod inputs;
pub mod instead;
pub mod jump;
mod laid_out;
pub mod least_squares;
pub mod library;
pub mod locate;
pub mod minimise;
pub mod noise;
pub mod noise_change;
pub mod noise_fit;
pub mod nominal;
mod onset_energy;
pub mod price;
pub mod radio_identification;
pub mod readings;
pub mod refit;
pub mod sandwich;
pub mod scan;
pub mod search;
pub mod second;
pub mod select;
pub mod sentence;
pub mod smooth;
pub mod spectrum;
mod spline;
pub mod state;
pub mod statistics;
pub mod steady;
pub mod watch;
pub mod whiten;
mod within_step;
