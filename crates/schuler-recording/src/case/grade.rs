//! How good a sensor is, in the classes of the trade.

/// The class of a sensor: what errors are plausible of it.
///
/// | grade | noise of a gyro, N | noise of an accelerometer | constant error of a gyro |
/// | --- | --- | --- | --- |
/// | navigation | 0.002 °/√h | 20 µg/√Hz | 0.01 °/h |
/// | tactical | 0.03 to 0.1 °/√h | 100 µg/√Hz | 1 to 100 °/h |
/// | mems | 1 °/√h | 1000 µg/√Hz | 100 °/h and more |
///
/// Magnitudes are those of Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd edition,
/// sections 4.1 and 4.4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Of an inertial navigation system that goes on for hours without aids.
    Navigation,
    /// Of one that goes on for minutes.
    Tactical,
    /// Of micromechanical sensors for telephones, drones and cars.
    Mems,
}

impl Grade {
    /// Every grade under its name in the case file, the best first.
    pub const NAMES: [(&'static str, Grade); 3] =
        [("navigation", Grade::Navigation), ("tactical", Grade::Tactical), ("mems", Grade::Mems)];
}
