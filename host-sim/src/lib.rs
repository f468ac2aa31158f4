//! Sensor and environment physics from first principles, and what the `schuler` command is made of.
//!
//! | module | holds |
//! | --- | --- |
//! | [`physics`] | instruments, motion, heat, the Schuler loop |
//! | [`scenario`] | the scenario file: what to simulate |
//! | [`simulation`] | scenario in, recording, case and truth out |
//! | [`exported`] | what was found, as a model in files |
//! | [`fitted`] | terms that were fitted to a recording, in a simulation |
//! | [`flight`] | case in, module flown, outputs summed up |
//! | [`identify`] | noise structure, Allan deviation and autocorrelation of each sensor of a recording |
//! | [`plot`] | figures as SVG and PNG |
//! | [`proposal`] | cases that are proposed from tables |
//! | [`report`] | an explanation as text, figures and an HTML page |
//! | [`statistics`] | tests of innovations |
//! | [`command`] | the command's arguments, texts and progress |
//! | [`emulator`] | the flight module behind one interface: in this process, or on the emulated target |
//! | [`output`] | files that are whole or not there |
//! | [`campaign`] | cases with concealed effects, sealed answers, and how well they are found
//! | [`compare_isolation`] | every way of isolating a gyro against the optimum |
//! | [`calibration_table`] | a calibration experiment on a one-axis table at changing temperature |

pub mod calibration_table;
pub mod campaign;
pub mod command;
pub mod compare_isolation;
pub mod emulator;
pub mod exported;
pub mod fitted;
pub mod flight;
pub mod identify;
pub mod output;
pub mod physics;
pub mod plot;
pub mod proposal;
pub mod report;
pub mod scenario;
pub mod simulation;
pub mod statistics;
