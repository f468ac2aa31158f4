//! What could still be there without having been found.
use serde::Serialize;

/// The largest effect of a kind that could still hide in the readings of a sensor.
///
/// An effect of this size would be found with the probability [`Config::found_at`](crate::config::Config::found_at), beside all that is
/// described and whatever its other amplitudes are, in [`Config::certified_part`](crate::config::Config::certified_part) of the places,
/// times or frequencies that it may have.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Bound {
    /// Sensor or group.
    pub sensor: String,
    /// Identifier of the effect.
    pub effect: String,
    /// Which of several it is, where it has variants: name and value of each word.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub variant: Vec<(String, String)>,
    /// The parameter that is bounded.
    pub parameter: String,
    /// Its bound, in `unit`; absent where the recording cannot tell.
    pub bound: Option<f64>,
    /// Unit of the bound.
    pub unit: String,
    /// Values of the other parameters for which it holds: that of a time constant, an onset, a frequency.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub at: Vec<At>,
    /// What an effect of that size adds to the readings: root of the mean square over the recording, in `adds_unit`.
    pub adds_rms: Option<f64>,
    /// The unit in which the sensor's readings are written.
    pub adds_unit: String,
    /// The largest plausible magnitude, in `unit`, where the catalogue knows one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_plausible: Option<f64>,
    /// Why the recording cannot tell; absent where it can.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub because: Option<String>,
}

/// The value of a parameter in which an effect is not linear.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct At {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
}
