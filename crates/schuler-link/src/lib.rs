//! The link between a host (navigation computer, simulator, ground) and the flight module.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`frame`] | how a message becomes bytes on a wire and comes back: direction, version, number, postcard, CRC-32, COBS |
//! | [`block`] | a compensation block as bytes: version, length, postcard, CRC-32 |
//! | [`configuration`] | a configuration as bytes, for who keeps it himself; the link carries states of configured modules |
//! | [`message`] | what the two sides can say |
//! | [`endpoint`] | the module's side of the conversation: each command carried out exactly once, pace, deadline, counters |
//! | [`ring`] | a byte queue between an interrupt and the main loop |
//!
//! No heap, no panic, no unsafe. Memory is fixed: a decoder holds one frame, an endpoint one decoder and two
//! frames.
//!
//! ```
//! use schuler_core::module::FlightModule;
//! use schuler_link::endpoint::{Endpoint, Reaction};
//! use schuler_link::frame::{Decoder, Wire};
//! use schuler_link::message::{Board, HostMessage, Identity, ModuleMessage, Start, Transport};
//!
//! // The module's side.
//! let identity = Identity { board: Board::Host, transport: Transport::Memory, start: Start::PowerOn, boots: 0 };
//! let (mut endpoint, mut module) = (Box::new(Endpoint::new(identity)), Box::new(FlightModule::new()));
//! // The host's side: a question, and the answer to it.
//! let (mut wire, mut decoder) = (Wire::new(), Decoder::new());
//! wire.encode(1, &HostMessage::Hello).expect("a question is short");
//! let mut answers = Vec::new();
//! for byte in wire.as_bytes() {
//!     if let Reaction::Send(bytes) = endpoint.receive(*byte, &mut module, || 0) {
//!         answers.extend(bytes.iter().filter_map(|byte| decoder.push::<ModuleMessage>(*byte)));
//!     }
//! }
//! assert!(matches!(&answers[..], [Ok(frame)] if matches!(frame.message, ModuleMessage::Banner(_))));
//! ```
#![no_std]

pub mod block;
pub mod configuration;
pub mod endpoint;
pub mod frame;
pub mod message;
pub mod ring;
mod seal;

/// Version of the protocol: frame layout and messages. A frame of another version is refused.
pub const PROTOCOL: u8 = 5;

/// Hash of the sources that determine what an image computes (`build.rs` lists them). A host built from other
/// sources than the image it talks to sees it here, before it trusts a comparison bit by bit.
pub const SOURCE_HASH: u64 = match u64::from_str_radix(env!("SCHULER_SOURCE_HASH"), 16) {
    Ok(hash) => hash,
    Err(_) => panic!("build.rs gives sixteen hexadecimal digits"),
};

/// Version of the module and this crate.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
