//! States that are saved, brought back, and refused.
extern crate std;
use std::vec::Vec;

use super::*;
use crate::filter::{ErrorFilter, FilterConfig, MarkovNoise};
use crate::health::{HealthConfig, HealthMonitor, MemoryModel};
use crate::identification::{LikelihoodIdentifier, PublishedLoop};
use crate::module::{FlightModule, ModuleConfig, RadioUse, STATE_VERSION};
use crate::reading::Reading;
use crate::thermal::{TemperatureRate, TemperatureRateConfig};

fn bytes(value: &mut impl Saved) -> Vec<u8> {
    let mut visitor = Visitor::measure();
    value.visit(&mut visitor);
    let mut bytes = std::vec![0; visitor.here() as usize];
    let mut visitor = Visitor::save(0, &mut bytes);
    value.visit(&mut visitor);
    assert_eq!(visitor.served() as usize, bytes.len());
    bytes
}

/// Saved after `before` steps and brought back into a fresh one, it goes on in the same way.
fn goes_on<V: Saved + Clone, O: PartialEq + core::fmt::Debug>(
    fresh: &V,
    mut step: impl FnMut(&mut V, u32) -> O,
) {
    for before in [0, 1, 13, crate::repeats(400)] {
        let mut one = fresh.clone();
        for k in 0..before {
            step(&mut one, k);
        }
        let saved = bytes(&mut one);
        let mut two = fresh.clone();
        let mut visitor = Visitor::restore(0, &saved, Checksum::EMPTY);
        two.visit(&mut visitor);
        assert_eq!((visitor.served() as usize, visitor.is_flawed()), (saved.len(), false));
        for k in before..before + crate::repeats(200) {
            assert_eq!(step(&mut one, k), step(&mut two, k));
        }
        assert_eq!(bytes(&mut one), bytes(&mut two));
    }
}

macro_rules! parts_in {
    ($name:ident, $scalar:ty) => {
        /// The parts that are generic over their scalar, which the module flies in one precision each.
        #[test]
        fn $name() {
            let noise = |k: u32| ((k * 7919 % 1013) as $scalar) / 1013.0 - 0.5;
            let config = FilterConfig::<$scalar> {
                radius_m: 6_371_000.0,
                gravity: 9.8,
                step_s: 1.0,
                accelerometer: MarkovNoise { sigma: 1e-3, tau_s: 60.0 },
                gyro: MarkovNoise { sigma: 5e-7, tau_s: 1800.0 },
                velocity_noise: 0.1,
                initial_velocity_sigma: 0.1,
                initial_vertical_sigma: 1e-4,
                gate_sigma: 3.0,
            };
            let fresh = ErrorFilter::try_build(&config).unwrap();
            goes_on(&fresh, |filter, k| {
                let step = filter.step((k % 5 != 0).then(|| noise(k)));
                filter.output(&step)
            });
            let fresh =
                TemperatureRate::try_build(&TemperatureRateConfig::<$scalar>::of_quantum(0.0625)).unwrap();
            goes_on(&fresh, |rate, k| {
                let reading = Reading::good((20.0 + 0.01 * k as $scalar).round());
                let wrong = Reading { value: <$scalar>::NAN, ..reading };
                rate.step(u64::from(k) * 1000, if k % 7 == 0 { &wrong } else { &reading })
            });
            let fresh =
                HealthMonitor::try_build(&HealthConfig::<$scalar, 2>::doppler_against_inertial()).unwrap();
            goes_on(&fresh, |monitor, k| {
                let jump = if k % 300 > 100 { 3.0 } else { 0.0 };
                monitor.step(&Reading::good(noise(k) + jump), &Reading::good(0.0), 1 + u32::from(k % 11 == 0))
            });
        }
    };
}
parts_in!(parts_in_single_precision_come_back, f32);
parts_in!(parts_in_double_precision_come_back, f64);

#[test]
fn nan_is_always_the_same() {
    let mut numbers = (f32::from_bits(0xffc1_2345), f64::from_bits(0xfff0_0000_0000_0001));
    let saved = bytes(&mut numbers);
    assert_eq!(saved[..4], 0x7fc0_0000u32.to_le_bytes());
    assert_eq!(saved[4..], 0x7ff8_0000_0000_0000u64.to_le_bytes());
    assert_eq!(numbers.0.to_bits(), 0xffc1_2345, "saving changes nothing");
}

#[test]
fn a_checksum_can_be_put_aside() {
    let whole = CRC.checksum(b"123456789");
    assert_eq!(whole, 0xcbf4_3926);
    for cut in 0..9 {
        let (head, tail) = b"123456789".split_at(cut);
        assert_eq!(Checksum::EMPTY.with(head).with(tail).value(), whole);
    }
}

#[test]
fn every_impossible_tag_and_index_is_found() {
    let mut identifier = std::boxed::Box::new(LikelihoodIdentifier::new());
    let mut other = identifier.clone();
    let saved = bytes(&mut *identifier);
    let mut found = 0;
    // The tags stand behind the banks and windows; a byte of a number can be anything.
    for at in 0..saved.len() {
        let mut wrong = saved.clone();
        wrong[at] = 0xee;
        let mut visitor = Visitor::restore(0, &wrong, Checksum::EMPTY);
        if at % 8 == 0 || at > saved.len() - 2000 {
            other.visit(&mut visitor);
            found += u32::from(visitor.is_flawed());
        }
    }
    // Behind the read-out: phase and its count, the stretch, two channels, three that may not be there.
    assert!(found >= 8, "{found}");
}

/// Names and places of all that is saved. Where this differs, a saved state of before is not one of now: raise
/// [`STATE_VERSION`] and write the new fingerprint here.
#[test]
fn the_layout_is_that_of_its_version() {
    let memory = Some(MemoryModel { repeat: 0.05, fail: 1.0 / 1800.0, recover: 1.0 / 120.0 });
    let config = ModuleConfig {
        thermometers: [Some(TemperatureRateConfig::of_quantum(0.0625)); 4],
        health: Some(HealthConfig { memory, ..HealthConfig::doppler_against_inertial() }),
        radio_use: Some(RadioUse::DEFAULT),
        ..ModuleConfig::default()
    };
    let mut module = std::boxed::Box::new(FlightModule::new());
    module.configure(&config).unwrap();
    let mut visitor = Visitor::measure();
    module.visit(&mut visitor);
    PublishedLoop::new().visit(&mut visitor);
    assert_eq!((STATE_VERSION, visitor.layout.value()), (6, 3945593153));
}
