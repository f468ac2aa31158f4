//! Physics from first principles: the Earth, heat, sensors, motion and the Schuler loop.
//!
//! Nothing here knows of the catalogue that explains a mismatch: an effect appears because a part is heavy, warm,
//! elastic or late, not because its formula was added to an output.
pub mod doppler;
pub mod earth;
pub mod environment;
pub mod fault;
pub mod fog;
pub mod gyro;
pub mod heat;
pub mod linear;
pub mod motion;
pub mod parasite;
pub mod pendulum;
pub mod random;
pub mod readout;
pub mod rotor;
pub mod schuler;
