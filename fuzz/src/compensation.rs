//! Compensation blocks.
use schuler_core::compensation::{Block, Compensator, Known};
use schuler_core::thermal::ThermalState;
use schuler_link::block::{decode, encode};

const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// A block as it is, and the same bytes as the content of a block whose frame is sound.
pub fn block(data: &[u8]) {
    check(data);
    let mut sealed = b"SCHC".to_vec();
    sealed.extend(schuler_core::compensation::BLOCK_VERSION.to_le_bytes());
    sealed.extend((data.len() as u16).to_le_bytes());
    sealed.extend(data);
    sealed.extend(CRC.checksum(&sealed).to_le_bytes());
    check(&sealed);
}

fn check(bytes: &[u8]) {
    let Ok((block, _)) = decode(bytes) else { return };
    let again = encode(&block);
    let (back, _) = decode(&again).expect("a block that was read can be written");
    assert_eq!(encode(&back), again);
    if let Ok(compensator) = Compensator::try_build(&block) {
        corrections_are_sound(&block, &compensator);
    }
}

/// Whatever the readings, the corrections are finite and within their limits.
fn corrections_are_sound(block: &Block, compensator: &Compensator) {
    let of_gyros = [1e-4, -0.3, 0.0, f64::MAX, 5.0];
    let of_accelerometers = [9.8, -1e300, f64::NAN];
    for known in [
        Known::default(),
        known(20.0, Some(0.001), [1e-5; 5], [9.8, 0.1, -0.1], Some(0.2)),
        known(-1e30, Some(-1e30), of_gyros, of_accelerometers, Some(f32::MAX)),
        known(f32::NAN, Some(f32::INFINITY), [f64::NEG_INFINITY; 5], [0.0; 3], Some(f32::NAN)),
        known(84.9, None, [f64::MIN_POSITIVE; 5], [-9.8; 3], None),
    ] {
        let out = compensator.correct(&known);
        assert!(
            out.gyros.iter().chain(&out.accelerometers).all(|value| value.is_finite()),
            "{known:?} {out:?}"
        );
        assert!(out.velocity.abs() <= block.limits.velocity, "{out:?}");
        let [accelerometer, gyro] = out.loop_errors;
        assert!(
            accelerometer.abs() <= block.limits.accelerometer && gyro.abs() <= block.limits.gyro,
            "{out:?}"
        );
    }
}

fn known(
    temperature: f32,
    rate: Option<f32>,
    gyros: [f64; 5],
    accelerometers: [f64; 3],
    velocity: Option<f32>,
) -> Known {
    Known {
        thermometers: [ThermalState { temperature: Some(temperature), rate, ..ThermalState::default() }; 4],
        gyros: gyros.map(Some),
        accelerometers: accelerometers.map(Some),
        velocity,
    }
}
