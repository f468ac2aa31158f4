//! Answers of an engine as data, so that another engine can be compared with it case by case.
//!
//! | module | holds |
//! | --- | --- |
//! | [`record`] | the file: a header, then a line of JSON a case |
//! | [`set`] | where cases come from: a plan with a seed, or folders |
//! | [`truth`] | what others say is concealed in their cases |
//! | [`run`] | an engine over a set, one case after the other, with its processor time |
//! | [`compare`] | two records: where they differ, and how often each is right |
//! | [`table`] | the comparison as text |
//!
//! A record goes on where it was stopped. Cases of a plan come in an order that does not follow its
//! groups, so that the beginning of a long one is a fair sample of all of it.
pub mod compare;
pub mod record;
pub mod run;
pub mod set;
pub mod table;
pub mod truth;
