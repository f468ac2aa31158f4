//! Integers at their ends. Tests are built with overflow checks: a sum that overflows panics.
use schuler_core::identification::{IdentificationConfig, Method};
use schuler_core::module::{FlightModule, ModuleConfig, StepInput};
use schuler_core::reading::Reading;

/// The time to the next identification, in steps, may be as long as a configuration says: beyond the last step there is.
#[test]
fn an_identification_may_be_due_never() {
    for method in [Method::Published, Method::Likelihood] {
        let identification = IdentificationConfig {
            method,
            first_s: 1.0,
            interval_s: f32::MAX,
            ..IdentificationConfig::default()
        };
        let mut module = Box::new(FlightModule::new());
        module.configure(&ModuleConfig { identification, ..ModuleConfig::default() }).unwrap();
        // Long enough for the likelihood's least samples.
        for step in 1..=20_000 {
            module.step(&StepInput {
                velocity_error: Reading::good((step % 7) as f32 * 0.05),
                ..StepInput::without_readings(1000 * step)
            });
        }
    }
}

/// Times at the end of the clock, backwards and forwards.
#[test]
fn times_may_be_at_the_end_of_their_type() {
    let mut module = Box::new(FlightModule::new());
    module.configure(&ModuleConfig::default()).unwrap();
    for time_ms in [u64::MAX, 0, u64::MAX - 1, u64::MAX, u64::MAX, 1, u64::MAX / 2] {
        let mut input =
            StepInput { velocity_error: Reading::good(0.1), ..StepInput::without_readings(time_ms) };
        input.thermometers = [Reading { value: 20.0, age_ms: u32::MAX, ..Reading::good(20.0) }; 4];
        assert_eq!(module.step(&input).time_ms, time_ms);
    }
}
