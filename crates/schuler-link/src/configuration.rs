//! The configuration of a module as bytes: what a computer on the ground makes and checks, and what flight software keeps in
//! its flash and hands to the module (`schuler-c`).
//!
//! ```text
//! "SCHM" │ version u16 LE │ length u16 LE │ content, postcard │ CRC-32 LE
//! ```
//! The form is that of a compensation block ([`crate::block`]).
use heapless::Vec;
use schuler_core::config::ConfigError;
use schuler_core::module::ModuleConfig;

use crate::seal::{self, BlockError, OVERHEAD};

/// Version of the content: the fields of [`ModuleConfig`] and their order.
pub const CONFIGURATION_VERSION: u16 = 2;

/// Longest configuration, bytes: as in a frame, a field takes no more than one and a half times its size in memory.
pub const MAX_CONFIGURATION: usize = OVERHEAD + size_of::<ModuleConfig>() * 3 / 2;

const MAGIC: [u8; 4] = *b"SCHM";

/// A configuration as bytes.
pub type ConfigurationBytes = Vec<u8, MAX_CONFIGURATION>;

/// The bytes of a configuration that can be flown.
///
/// # Errors
/// The first field that cannot be flown.
pub fn encode(config: &ModuleConfig) -> Result<ConfigurationBytes, ConfigError> {
    config.validate()?;
    Ok(seal::close(MAGIC, CONFIGURATION_VERSION, config))
}

/// The configuration in these bytes. The values are yet to be checked by who flies them.
///
/// # Errors
/// Why the bytes are not a configuration.
#[inline(never)]
pub fn decode(bytes: &[u8]) -> Result<ModuleConfig, BlockError> {
    let (content, _) = seal::open(MAGIC, CONFIGURATION_VERSION, bytes)?;
    match postcard::take_from_bytes(content) {
        Ok((config, [])) => Ok(config),
        _ => Err(BlockError::Content),
    }
}

#[cfg(test)]
mod tests {
    use schuler_core::config::Problem;
    use schuler_core::health::{HealthConfig, MemoryModel};
    use schuler_core::module::RadioUse;
    use schuler_core::thermal::TemperatureRateConfig;

    use super::*;

    fn everything() -> ModuleConfig {
        let memory = Some(MemoryModel { repeat: 0.05, fail: 1.0 / 1800.0, recover: 1.0 / 120.0 });
        ModuleConfig {
            thermometers: [Some(TemperatureRateConfig::of_quantum(0.0625)); 4],
            health: Some(HealthConfig { memory, ..HealthConfig::doppler_against_inertial() }),
            radio_use: Some(RadioUse::DEFAULT),
            max_age_ms: u32::MAX,
            ..ModuleConfig::default()
        }
    }

    #[test]
    fn configurations_come_back() {
        for config in [ModuleConfig::default(), everything()] {
            let bytes = encode(&config).unwrap();
            assert_eq!(bytes[..6], *b"SCHM\x02\x00");
            assert_eq!(decode(&bytes), Ok(config));
        }
    }

    /// Length and checksum of one configuration. Where this differs, the bytes of before mean something else now, or a default has
    /// changed: in the first case raise [`CONFIGURATION_VERSION`]; in both write what is new here.
    #[test]
    fn the_layout_is_that_of_its_version() {
        let bytes = encode(&everything()).unwrap();
        let checksum = u32::from_le_bytes(bytes[bytes.len() - 4..].try_into().unwrap());
        assert_eq!((CONFIGURATION_VERSION, bytes.len(), checksum), (2, 532, 2466023240));
    }

    #[test]
    fn what_cannot_be_flown_is_not_written() {
        let config = ModuleConfig { velocity_range: f32::NAN, ..ModuleConfig::default() };
        assert_eq!(encode(&config), Err(ConfigError::new("velocity_range", Problem::NotFinite)));
    }

    #[test]
    fn a_compensation_block_is_not_a_configuration() {
        let block = crate::block::encode(&schuler_core::compensation::Block::default());
        assert_eq!(decode(&block), Err(BlockError::Form));
    }
}
