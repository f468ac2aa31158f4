//! Cases and recordings: what a sensor's output was, what its user believes about it, and what the body really did.
//!
//! | module | holds |
//! | --- | --- |
//! | [`case`] | the case file `schuler-case/1`, as written: types, reader, writer |
//! | [`mod@unit`] | the units of the case file and their conversion to SI |
//! | [`table`] | tables of numbers: text, Parquet, logs and arrays read; CSV and Parquet written |
//! | [`recording`] | case and table together: arrays in SI units on the nominal step grid, gaps marked |
//! | [`motion`] | Earth rate, gravity and attitude; the ideal sensor's output for the recorded or static motion |
//! | [`document`] | a TOML document read field by field, with every mistake named by file, line, field and expectation |
//! | [`formula`] | formulas of effects that a case defines |
//! | [`mod@file`] | opening a file for reading, and how much of one is read as a whole |
//! | [`leniency`] | whether what cannot be understood is an error or left out and counted |
//! | [`error`] | what is wrong with a file, and where |
//!
//! Everything past [`recording`] is in SI units and radians (temperature in °C by convention); nothing else
//! converts. No input makes anything here panic.
//!
//! ```
//! use schuler_recording::CaseFile;
//!
//! let text = r#"
//! format = "schuler-case/1"
//! title  = "Gyro on a bench"
//! [recording]
//! path   = "recording.csv"
//! time   = "t"
//! step_s = 1.0
//! [motion]
//! kind = "static"
//! [[sensor]]
//! id     = "gyro_x"
//! kind   = "dtg"
//! column = "gyro_x"
//! unit   = "deg/hour"
//! "#;
//! // A mistake is named with file, line, field, and what was expected.
//! let error = CaseFile::parse("case.toml".as_ref(), text).unwrap_err().to_string();
//! println!("{error}");
//! assert!(error.contains("case.toml:14") && error.contains("deg/hour") && error.contains("deg/h"));
//! ```

pub mod case;
pub mod document;
pub mod error;
pub mod file;
pub mod formula;
pub mod leniency;
pub mod motion;
pub mod recording;
pub mod table;
pub mod unit;

pub use case::{Case, CaseFile};
pub use error::{Error, Problem};
pub use leniency::Leniency;
pub use recording::Recording;
