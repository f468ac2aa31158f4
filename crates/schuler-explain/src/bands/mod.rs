//! The whitened record in the frequency domain, as sums of products over bands.
//!
//! | module | gives |
//! | --- | --- |
//! | [`layout`] | the bands, and the cosine transform (DCT-II) of the rows that are present |
//! | [`sums`] | products of channels and series by band, each computed when it is asked for |
//! | [`onset_energy`] | the energy of a step and a ramp at every row, under the filter |
//! | [`onsets`] | that energy by band, as far as the search asks for it |
//! | [`scan`] | scores of a step and a ramp at every row, and of a line at every frequency |
pub mod layout;
pub mod onset_energy;
pub mod onsets;
pub mod scan;
pub mod sums;
