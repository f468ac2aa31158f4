//! The compiled part of the Python package `schuler`: its functions and classes, on numpy arrays.
//!
//! | module | gives Python |
//! | --- | --- |
//! | `filter` | the error filter, step by step or over arrays |
//! | `adaptive` | the flight module's velocity channel, which finds out its noise and retunes |
//! | `noise` | autocorrelation, the published fits, Allan deviation, `identify` |
//! | `isolation` | five gyros: determinants, projector, sequential filter, the isolation that flies |
//! | `explain` | `explain` and what its answer can do |
//! | `propose` | cases guessed from tables |
//! | `command` | the command |
//! | `campaign` | single cases of a campaign, and the summary of many |
//!
//! Everything is in SI units and radians, and NaN is a missing value. What is wrong with an argument is a `ValueError`
//! with the line that the command would print. Arguments are copied before the interpreter is released, so that
//! nobody changes them meanwhile; it is released for all work that grows with the data.
//!
//! Doc comments are Python's docstrings, so they give units and shapes; types stand in `python/schuler/_schuler.pyi`.
//!
//! `unsafe` stays forbidden here as elsewhere: pyo3 keeps its own inside its macros.

mod adaptive;
mod answer;
mod arrays;
mod campaign;
mod case;
mod command;
mod explain;
mod filter;
mod input;
mod isolation;
mod noise;
mod propose;
mod watched;

use pyo3::prelude::*;

/// The compiled part of `schuler`; use it through that.
#[pymodule]
mod _schuler {
    #[pymodule_export]
    use crate::adaptive::{AdaptiveFilter, AdaptiveRun};
    #[pymodule_export]
    use crate::campaign::{campaign_case, campaign_cases, campaign_summary};
    #[pymodule_export]
    use crate::command::command;
    #[pymodule_export]
    use crate::explain::{Explained, explain};
    #[pymodule_export]
    use crate::filter::{ErrorFilter, FilterConfig, FilterRun, FilterStep, MarkovNoise};
    #[pymodule_export]
    use crate::isolation::{FaultIsolation, GyroBlock, IsolationRun, Projection, SequentialStatistics};
    #[pymodule_export]
    use crate::noise::{
        AllanDeviation, Autocorrelation, Exponential, ExponentialCosine, NoiseStructure, allan_deviation,
        autocorrelation, choose_structure, fit_exponential, fit_exponential_cosine, identify,
    };
    #[pymodule_export]
    use crate::propose::{propose, propose_pair};

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "what Python calls it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
