//! The engine on synthetic records with signatures of the tests' own: false alarms, detection, naming, uncertainties.
//!
//! Seeds are fixed; no bound is set to what they give: bounds are those of the acceptance figures with their binomial
//! allowance.
#[path = "../common/mod.rs"]
mod common;

mod certificate;
mod detection;
mod input;
mod jumps;
mod limits;
mod motion;
mod noise;
mod quantities;
mod readings;
mod schuler_loop;
mod several;
mod synthetic;
mod uncertainty;
