//! Support for the tests of the temperature-rate estimator.
//!
//! | part | is |
//! | --- | --- |
//! | [`heat`] | the two-mass heat model that makes true temperatures and rates, and the quantised thermometer |
//! | [`competitors`] | the methods that one would use instead |
//! | [`incremental`] | form A of the regression: measurements added and removed one by one |
//! | [`logs`] | thermometer logs of real sensors |
pub mod competitors;
pub mod heat;
pub mod incremental;
pub mod logs;
