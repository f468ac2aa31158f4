//! What a case is before anything is concealed: motion, surroundings, instruments, and what their user rightly believes.
//!
//! | setting | motion told | instruments |
//! | --- | --- | --- |
//! | bench | static | tuned and fibre-optic gyros, accelerometers in changing temperature |
//! | table | recorded rate and force | three fibre-optic gyros and accelerometers on a rate table |
//! | tuned_table | recorded rate and force | three tuned gyros for large rates on a rate table, slowly moved |
//! | tumble | recorded rate and force, nothing while it turns | three tuned gyros and accelerometers in many attitudes |
//! | drive | recorded rate and force | strapdown unit in a vehicle |
//! | log | recorded velocity and attitude | Doppler log |
//! | block | unknown | five gyros on a cone |
//! | radio | unknown | Doppler log beside the velocity of an inertial system |
//! | channel | velocity error | Schuler loop with its gyro and accelerometer |
use schuler_recording::unit::Unit;
use serde::{Deserialize, Serialize};

use super::draw::Draw;
use super::likelihood::{Loop, Noise};
use crate::physics::environment::EnvironmentDesign;
use crate::physics::motion::{Attitude, Motion, Site};
use crate::scenario::{Recorded, Scenario, Told};

mod bench;
mod block;
mod channel;
mod drive;
mod instruments;
mod log;
mod noise;
mod radio;
mod surroundings;
mod table;
#[cfg(test)]
mod tests;
mod tumble;
mod tuned_table;
mod vehicle;

/// Kinds of setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, PartialOrd, Ord)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// At rest.
    Bench,
    /// On a rate table.
    Table,
    /// Tuned gyros on a rate table.
    TunedTable,
    /// In many attitudes.
    Tumble,
    /// In a vehicle.
    Drive,
    /// Doppler log.
    Log,
    /// Five gyros.
    Block,
    /// Doppler log beside an inertial system.
    Radio,
    /// Schuler loop.
    Channel,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 9] = [
        Self::Bench,
        Self::Table,
        Self::TunedTable,
        Self::Tumble,
        Self::Drive,
        Self::Log,
        Self::Block,
        Self::Radio,
        Self::Channel,
    ];
}

/// A setting.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Its kind.
    pub kind: Kind,
    /// What is simulated, with nothing concealed.
    pub scenario: Scenario,
    /// The true noise of each output, in SI units.
    pub noise: Vec<(String, Noise)>,
    /// The true noise of the Schuler loop.
    pub channel: Option<Loop>,
}

/// Group of a strapdown unit's sensors.
pub const UNIT: &str = "unit";
/// Group of a Doppler log's beams.
pub const LOG: &str = "log";
/// Column of the first thermometer.
pub const THERMOMETER: &str = "temperature";
/// Column of the thermometer beyond it.
pub const FAR_THERMOMETER: &str = "temperature_far";
/// Column of the electronics' thermometer.
pub const ELECTRONICS: &str = "temperature_electronics";

impl Setting {
    /// Draws a setting with at most so many rows.
    pub fn draw(kind: Kind, most_rows: usize, seed: u64, draw: &mut Draw) -> Self {
        match kind {
            Kind::Bench => bench::bench(most_rows, seed, draw),
            Kind::Table => table::table(most_rows, seed, draw),
            Kind::TunedTable => tuned_table::tuned_table(most_rows, seed, draw),
            Kind::Tumble => tumble::tumble(most_rows, seed, draw),
            Kind::Drive => drive::drive(most_rows, seed, draw),
            Kind::Log => log::log(most_rows, seed, draw),
            Kind::Block => block::block(most_rows, seed, draw),
            Kind::Radio => radio::radio(most_rows, seed, draw),
            Kind::Channel => channel::channel(most_rows, seed, draw),
        }
    }

    /// The true noise of an output.
    pub fn noise_of(&self, id: &str) -> Noise {
        self.noise.iter().find(|(name, _)| name == id).map(|(_, noise)| noise.clone()).unwrap_or_default()
    }

    /// Whether an output is read against an unknown constant.
    pub fn relative(&self, id: &str) -> bool {
        let s = &self.scenario;
        s.gyros.iter().any(|g| g.ids.0 == id && g.relative)
            || s.fogs.iter().any(|g| g.id == id && g.relative)
            || s.accelerometers.iter().any(|g| g.id == id && g.relative)
    }

    /// The unit of an output's column.
    pub fn unit(&self, id: &str) -> Unit {
        let s = &self.scenario;
        let gyro = s.gyros.iter().find(|g| g.ids.0 == id).map(|g| g.unit);
        let fog = s.fogs.iter().find(|g| g.id == id).map(|g| g.unit);
        let accelerometer = s.accelerometers.iter().find(|g| g.id == id).map(|g| g.unit);
        gyro.or(fog).or(accelerometer).unwrap_or(Unit::MetrePerSecond)
    }
}

/// A scenario in which nothing happens.
fn empty(title: &str, seed: u64, duration_s: f64, step_s: f64, draw: &mut Draw) -> Scenario {
    let latitude = draw.between(25.0, 68.0).to_radians() * draw.sign();
    Scenario {
        title: title.to_owned(),
        seed,
        duration_s,
        step_s,
        parts: 1,
        site: Site { latitude, height: draw.between(0.0, 600.0), gravity_anomaly: 0.0 },
        motion: Motion::Static(Attitude::default()),
        believed: None,
        told: Told::Static,
        environment: EnvironmentDesign::default(),
        recorded: Recorded::default(),
        gyros: vec![],
        fogs: vec![],
        accelerometers: vec![],
        dopplers: vec![],
        schuler_loop: None,
        faults: vec![],
        parasites: vec![],
        fitted: vec![],
        clocks: vec![],
        rotation_vectors: vec![],
        gaps: vec![],
    }
}

/// A number of rows up to a limit.
fn rows(least: usize, most: usize, draw: &mut Draw) -> usize {
    draw.log_between(least.min(most) as f64, most as f64).round() as usize
}
