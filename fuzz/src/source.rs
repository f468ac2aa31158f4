//! Numbers and readings out of a fuzzer's bytes, often at the ends of what there is.
use arbitrary::{Result, Unstructured};
use schuler_core::module::{Command, StepInput};
use schuler_core::reading::{Quality, Reading};

const ENDS: [f64; 12] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    f32::MAX as f64,
    f32::MIN as f64,
    1e-45,
    5e-324,
    -0.0,
    1e19,
    -1e30,
];

/// Any number at all, one at an end, or one of everyday size: `usual` times something within ±4.
///
/// # Errors
/// Never: an input that has ended gives zeros.
pub fn number(source: &mut Unstructured<'_>, usual: f64) -> Result<f64> {
    Ok(match source.arbitrary::<u8>()? {
        0..16 => f64::from_bits(source.arbitrary()?),
        16..32 => f64::from(f32::from_bits(source.arbitrary()?)),
        32..56 => *source.choose(&ENDS)?,
        _ => usual * f64::from(source.arbitrary::<i16>()?) / 8192.0,
    })
}

/// A reading of any number, age and quality, mostly fresh and good.
///
/// # Errors
/// Never: an input that has ended gives zeros.
pub fn reading(source: &mut Unstructured<'_>, usual: f64) -> Result<Reading<f64>> {
    let value = number(source, usual)?;
    let (age_ms, quality) = match source.arbitrary::<u8>()? {
        0..16 => (0, Quality::Missing),
        16..32 => (0, Quality::Saturated),
        32..48 => (source.arbitrary()?, Quality::Good),
        _ => (0, Quality::Good),
    };
    Ok(Reading { value, age_ms, quality })
}

fn single(source: &mut Unstructured<'_>, usual: f64) -> Result<Reading<f32>> {
    let Reading { value, age_ms, quality } = reading(source, usual)?;
    Ok(Reading { value: value as f32, age_ms, quality })
}

/// The time of the step after `time_ms`: mostly a second later.
///
/// # Errors
/// Never: an input that has ended gives zeros.
pub fn next_time(source: &mut Unstructured<'_>, time_ms: u64) -> Result<u64> {
    Ok(match source.arbitrary::<u8>()? {
        0..8 => source.arbitrary()?,
        8..16 => time_ms.wrapping_add(u64::from(source.arbitrary::<u32>()?)),
        16..24 => time_ms.wrapping_sub(u64::from(source.arbitrary::<u32>()?)),
        24..32 => time_ms,
        32..48 => time_ms.wrapping_add(1000 * u64::from(source.arbitrary::<u8>()?)),
        _ => time_ms.wrapping_add(1000),
    })
}

/// The input of a step.
///
/// # Errors
/// Never: an input that has ended gives zeros.
pub fn step_input(source: &mut Unstructured<'_>, time_ms: u64) -> Result<StepInput> {
    let mut input = StepInput { time_ms, ..StepInput::default() };
    input.velocity_error = single(source, 0.5)?;
    for gyro in &mut input.gyros {
        *gyro = reading(source, 1e-4)?;
    }
    for accelerometer in &mut input.accelerometers {
        *accelerometer = reading(source, 9.8)?;
    }
    for thermometer in &mut input.thermometers {
        *thermometer = single(source, 25.0)?;
    }
    input.radio_velocity = single(source, 100.0)?;
    input.inertial_velocity = single(source, 100.0)?;
    if source.arbitrary::<u8>()? < 16 {
        input.command = Command::ReadmitGyro(source.arbitrary()?);
    }
    Ok(input)
}
