//! Everything in a case on which an effect may depend, on the recording's grid, without holes.
use schuler_recording::Recording;

/// The recorded and derived quantities of a case.
pub struct Inputs<'r> {
    /// The recording.
    pub recording: &'r Recording,
    /// Time from the first row, s, by the grid.
    pub time_s: Vec<f64>,
}
