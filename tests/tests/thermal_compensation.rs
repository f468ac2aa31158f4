//! Run-time correction of thermal errors (TMP-11), and what the thermal part does with garbage.
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use schuler_core::config::Problem;
use schuler_core::reading::{Quality, Reading};
use schuler_core::thermal::{
    AxisCoefficients, CompensationBlock, CompensationStatus, Compensator, FeatureMap, TemperatureRate,
    TemperatureRateConfig, ThermalState, ThermalStatus,
};

/// A block with coefficients of the specification's prior size everywhere: 20 deg/h, 2000 ppm, 50 mm/s² and parts of them.
fn block() -> CompensationBlock {
    let mut block = CompensationBlock::default();
    let feature = [1.0, 0.5, 0.3, 0.2, -0.2, 0.1];
    for i in 0..3 {
        let sign = if i == 1 { -1.0 } else { 1.0 };
        block.gyro.bias[i] = feature.map(|f| sign * f * 9.7e-5);
        block.accelerometer.bias[i] = feature.map(|f| -sign * f * 0.05);
        for j in 0..3 {
            let size = 2e-3 * (1.0 + 0.3 * (3 * i + j) as f32);
            block.gyro.matrix[i][j] = feature.map(|f| sign * f * size);
            if j <= i {
                block.accelerometer.matrix[i][j] = feature.map(|f| f * size);
            }
        }
    }
    block
}

/// The sensors' errors straight from the definition, in double precision.
fn measure(
    bias: &[[f32; 6]; 3],
    matrix: &[[[f32; 6]; 3]; 3],
    phi: &[f64; 6],
    input: Vector3<f64>,
) -> [f64; 3] {
    let at = |c: &[f32; 6]| c.iter().zip(phi).map(|(c, p)| f64::from(*c) * p).sum::<f64>();
    let m = Matrix3::from_fn(|i, j| at(&matrix[i][j]));
    let b = Vector3::from_fn(|i, _| at(&bias[i]));
    (input + b + m * input).into()
}

#[test]
fn tmp_11_correction_undoes_the_error_model() {
    let block = block();
    let compensator = Compensator::try_build(&block).expect("valid");
    let (temperature, rate, gradient) = (48.5f32, -14.0f32 / 3600.0, [3.0f32, -8.0, 1.0]);
    let state = ThermalState { temperature: Some(temperature), rate: Some(rate), gradient: Some(gradient) };
    let phi = [
        1.0,
        (f64::from(temperature) - 35.0) / 30.0,
        f64::from(rate) * 3600.0 / 20.0,
        f64::from(gradient[0]) / 5.0,
        f64::from(gradient[1]) / 5.0,
        f64::from(gradient[2]) / 5.0,
    ];
    let correction = compensator.correction(&state);
    assert_eq!(correction.status, CompensationStatus::empty());
    for rate in [Vector3::new(0.2, -0.1, 0.05), Vector3::new(-1.0, 1.0, 1.0), Vector3::zeros()] {
        let back = correction.rate(measure(&block.gyro.bias, &block.gyro.matrix, &phi, rate));
        // 2e-9 rad/s is 0.0004 deg/h: single precision of a correction of 2 %.
        assert!((Vector3::from(back) - rate).amax() < 2e-9, "{back:?}");
    }
    let force = Vector3::new(0.3, -9.7, 1.2);
    let back = correction.specific_force(measure(
        &block.accelerometer.bias,
        &block.accelerometer.matrix,
        &phi,
        force,
    ));
    assert!((Vector3::from(back) - force).amax() < 5e-8, "{back:?}");
}

#[test]
fn tmp_11_block_that_corrects_nothing_gives_the_same_bits() {
    let correction = Compensator::try_build(&CompensationBlock::default())
        .expect("valid")
        .correction(&ThermalState::default());
    let signal = [0.123456789e-4, -1.0 / 3.0, 9.80665];
    assert_eq!(correction.rate(signal), signal);
    assert_eq!(correction.specific_force(signal), signal);
}

#[test]
fn tmp_11_missing_and_extreme_states_are_flagged() {
    let compensator = Compensator::try_build(&block()).expect("valid");
    let unknown = compensator.correction(&ThermalState::default()).status;
    assert_eq!(
        unknown,
        CompensationStatus::NO_TEMPERATURE | CompensationStatus::NO_RATE | CompensationStatus::NO_GRADIENT
    );
    let state = ThermalState { temperature: Some(20.0), rate: Some(0.0), gradient: Some([0.0; 3]) };
    assert!(compensator.correction(&state).status.is_empty());
    let cases = [
        (ThermalState { temperature: Some(86.0), ..state }, CompensationStatus::OUT_OF_RANGE),
        (ThermalState { rate: Some(-0.02), ..state }, CompensationStatus::OUT_OF_RANGE),
        (ThermalState { gradient: Some([0.0, 21.0, 0.0]), ..state }, CompensationStatus::OUT_OF_RANGE),
        (ThermalState { temperature: Some(f32::NAN), ..state }, CompensationStatus::NO_TEMPERATURE),
        (ThermalState { rate: Some(f32::INFINITY), ..state }, CompensationStatus::NO_RATE),
    ];
    for (state, expected) in cases {
        let correction = compensator.correction(&state);
        assert_eq!(correction.status, expected);
        assert!(correction.rate([0.1; 3]).iter().all(|v| v.is_finite()));
    }
    // The laws go on for a quarter of the range of temperature, and no further.
    let at = |temperature| {
        compensator.correction(&ThermalState { temperature: Some(temperature), ..state }).rate([0.1; 3])
    };
    let slope = |low: f32, high: f32| (at(high)[0] - at(low)[0]) / f64::from(high - low);
    assert!((slope(85.0, 115.0) / slope(20.0, 50.0) - 1.0).abs() < 0.02);
    assert_eq!(at(121.25), at(1e30));
}

#[test]
fn tmp_11_block_errors_name_the_field() {
    let good = block();
    let mut version = good;
    version.version = 2;
    let mut bias = good;
    bias.gyro.bias[1][2] = f32::NAN;
    let mut matrix = good;
    matrix.gyro.matrix[0][1][1] = 0.2;
    let mut infinite = good;
    infinite.accelerometer.matrix[2][0][0] = f32::INFINITY;
    let mut upper = good;
    upper.accelerometer.matrix[0][2][0] = 1e-6;
    let mut scale = good;
    scale.features.rate_scale = 0.0;
    let mut range = good;
    range.features.temperature_range = [50.0, 20.0];
    let upper_problem =
        Problem::Geometry("must be lower triangular: the accelerometers define the body frame");
    for (block, field, problem) in [
        (version, "thermal.compensation.version", Problem::OutOfRange),
        (bias, "thermal.compensation.gyro.bias", Problem::NotFinite),
        (matrix, "thermal.compensation.gyro.matrix", Problem::OutOfRange),
        (infinite, "thermal.compensation.accelerometer.matrix", Problem::NotFinite),
        (upper, "thermal.compensation.accelerometer.matrix", upper_problem),
        (scale, "thermal.features.rate_scale", Problem::NotPositive),
        (range, "thermal.features.temperature_range", Problem::OutOfRange),
    ] {
        let error = Compensator::try_build(&block).expect_err(field);
        assert_eq!((error.field, error.problem), (field, problem));
    }
}

#[test]
fn tmp_11_single_axis_correction_undoes_its_error_model() {
    let axis = AxisCoefficients {
        bias: [1e-5, 2e-5, -1e-5, 0.0, 0.0, 0.0],
        scale: [1e-3, -4e-4, 2e-4, 0.0, 0.0, 0.0],
    };
    let map = FeatureMap::default();
    axis.check(&map).expect("valid");
    let (phi, _) = map.features(&ThermalState { temperature: Some(50.0), rate: Some(0.003), gradient: None });
    let double = |c: &[f32; 6]| c.iter().zip(&phi).map(|(c, p)| f64::from(*c) * f64::from(*p)).sum::<f64>();
    let measured = 0.7 * (1.0 + double(&axis.scale)) + double(&axis.bias);
    assert!((axis.apply(measured, &phi) - 0.7).abs() < 1e-10);
    let wide = AxisCoefficients { scale: [0.21, 0.0, 0.0, 0.0, 0.0, 0.0], ..axis };
    assert_eq!(wide.check(&map).expect_err("too wide").field, "thermal.compensation.axis.scale");
}

fn any_reading() -> impl Strategy<Value = Reading<f32>> {
    let value = prop_oneof![
        8 => (-400..400i16).prop_map(|v| f32::from(v) * 0.25),
        1 => any::<f32>(),
        1 => Just(f32::NAN),
    ];
    let quality =
        prop_oneof![6 => Just(Quality::Good), 1 => Just(Quality::Saturated), 1 => Just(Quality::Missing)];
    (value, any::<u8>(), quality).prop_map(|(value, age, quality)| Reading {
        value,
        age_ms: u32::from(age) * 16,
        quality,
    })
}

fn any_stride() -> impl Strategy<Value = i64> {
    prop_oneof![12 => Just(1000i64), 2 => 0..5000i64, 1 => -2_000_000..2_000_000i64, 1 => any::<i32>().prop_map(i64::from)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever comes in, the outputs are finite, the sigmas positive once started, and a correction follows.
    #[test]
    fn tmp_7_garbage_leaves_the_outputs_finite(
        steps in proptest::collection::vec((any_reading(), any_stride()), 1..1500),
        start in any::<u64>(),
    ) {
        let mut estimator = TemperatureRate::try_build(&TemperatureRateConfig::of_quantum(0.25f32)).expect("valid");
        let compensator = Compensator::try_build(&block()).expect("valid");
        let mut time = start;
        for (reading, stride) in steps {
            time = time.wrapping_add_signed(stride);
            let out = estimator.step(time, &reading);
            let numbers = [out.temperature, out.rate, out.temperature_sigma, out.rate_sigma];
            prop_assert!(numbers.iter().all(|v| v.is_finite()), "{out:?}");
            let started = !out.status.contains(ThermalStatus::NO_READING);
            prop_assert!(!started || (out.temperature_sigma > 0.0 && out.rate_sigma > 0.0), "{out:?}");
            let corrected = compensator.correction(&ThermalState::from(&out)).rate([0.1, -0.2, 0.3]);
            prop_assert!(corrected.iter().all(|v| (v.abs() - 0.2).abs() < 0.15));
        }
    }
}
