//! A vehicle's run.
/// One piece of a vehicle's run: speed, heading and vertical speed change smoothly over its duration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleStep {
    /// Time, s.
    pub duration_s: f64,
    /// Change of speed, m/s.
    pub speed_change: f64,
    /// Change of heading, rad.
    pub heading_change: f64,
    /// Change of height, m.
    pub height_change: f64,
}

/// A periodic angular motion on top of the vehicle's: waves, engine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sway {
    /// Amplitude of roll, rad.
    pub roll: f64,
    /// Amplitude of pitch, rad.
    pub pitch: f64,
    /// Period of roll, s; that of pitch is 0.7 of it.
    pub period_s: f64,
}

/// A vehicle's run.
#[derive(Clone, Debug, PartialEq)]
pub struct Vehicle {
    /// Speed at the start, m/s.
    pub speed: f64,
    /// Heading at the start, rad.
    pub heading: f64,
    /// Share of the bank of a coordinated turn: 1 aircraft, 0 ship.
    pub bank_share: f64,
    /// Waves.
    pub sway: Sway,
    /// The sensors stand on a platform held level and north whatever the vehicle does.
    pub level_platform: bool,
    /// Its pieces; after the last it goes on straight.
    pub steps: Vec<VehicleStep>,
}
