//! Campaigns: cases with concealed effects, sealed answers, and how well they are found.
//!
//! | module | holds |
//! | --- | --- |
//! | [`plan`] | the plan file: which cases, and what must be reached |
//! | [`setting`] | motion, surroundings and instruments of a case |
//! | [`effect`] | what can be concealed, as the physics that causes it |
//! | [`maker`] | a case from its seed |
//! | [`oracle`], [`likelihood`] | what an oracle that knows the effect would gain |
//! | [`files`] | where cases, answers and results lie
//! | [`answer`], [`seal`] | what was concealed, and its fingerprint |
//! | [`unit_text`] | units of parameters |
//! | [`explainer`], [`explanation`] | who looks, and what is answered |
//! | [`engine`], [`processor`] | which engine gave the answers of a record, and the time that it takes |
//! | [`run`] | every case made, sealed, explained, opened, scored |
//! | [`score`], [`summary`], [`report`] | what was found against what was concealed |
//! | [`freeze`] | answers of an engine as data, and two engines compared case by case |
//!
//! The physics comes from [`crate::physics`] and [`crate::simulation`]; nothing here knows the formulas of whoever looks for the
//! effects, only their identifiers.
pub mod answer;
pub mod draw;
pub mod effect;
pub mod engine;
pub mod explainer;
pub mod explanation;
pub mod files;
pub mod freeze;
pub mod likelihood;
pub mod maker;
pub mod oracle;
pub mod plan;
pub mod processor;
pub mod report;
pub mod run;
pub mod score;
pub mod seal;
pub mod setting;
pub mod summary;
pub mod unit_text;

/// The seed of a case of a campaign: SplitMix64 (Steele, Lea and Flood 2014) over the campaign's seed and the case's number.
pub fn seed_of(campaign: u64, index: usize) -> u64 {
    let mut z = campaign.wrapping_add((index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) >> 11
}
