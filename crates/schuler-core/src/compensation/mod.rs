//! Correction of the inputs by what is known of the sensors' errors: a block of coefficients, loaded before the flight.
//!
//! | file | holds |
//! | --- | --- |
//! | `block` | [`Block`]: what is loaded; its terms, and the check of it |
//! | `evaluation` | [`Compensator`]: the corrections of one step |
//! | `loop_response` | [`LoopResponse`]: what known sensor errors make of a Schuler loop's velocity and vertical |
//!
//! A block has two parts. The *calibration* is the thermal model of a complete inertial unit
//! ([`thermal::compensation`](crate::thermal::compensation)) and is taken off gyros 0 to 2 and the accelerometers first. The
//! *terms* are single effects that were found afterwards; each is
//!
//! ```text
//! error of the target = coefficient · (quantity₁ − reference₁)^power₁ · (quantity₂ − reference₂)^power₂
//! ```
//!
//! which is a bias, a temperature coefficient and its square, a coefficient of the temperature's rate or of the difference of
//! two thermometers, a scale factor and its dependence on temperature, a mass unbalance, a quadrature term … of any gyro, any
//! accelerometer, or the velocity measured against a reference. A term may also act as accelerometer error or gyro drift
//! *inside* the Schuler loop: the error filter then estimates what is left beside it.
//!
//! Units: rad/s, m/s², m/s, degC, degC/s. Coefficients are single precision, signals double: the rounding of single
//! precision falls on the correction, not on the signal.
mod block;
mod evaluation;
mod loop_response;

pub use block::{
    BLOCK_VERSION, Block, BlockHead, Calibration, Factor, Limits, MAX_TERMS, Quantity, Target, Term, Validity,
};
pub use evaluation::{Compensation, Compensator, Known, TermStatus};
pub use loop_response::LoopResponse;
