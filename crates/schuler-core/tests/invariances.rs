//! What must not change when the description changes: axes turned, sensors renumbered, units scaled, clocks shifted.
//!
//! A scale that is a power of two, a shift of the clock and a change of sign change no rounding: there the results must be the
//! same to the last bit. Turned axes and renumbered sensors round otherwise: there a tolerance is stated.
use nalgebra::{Rotation3, SVector, Vector3};
use proptest::prelude::*;
use schuler_core::filter::{ErrorFilter, FilterConfig, MarkovNoise};
use schuler_core::health::{HealthConfig, HealthMonitor};
use schuler_core::identification::{
    EXPONENTIAL_FLOOR, IdentificationConfig, Method, Structure, choose_structure, fit_exponential,
};
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::ParitySpace;
use schuler_core::isolation::projector::OrthogonalProjector;
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use schuler_core::isolation::{FaultIsolation, IsolationConfig, Verdict};
use schuler_core::module::{FlightModule, ModuleConfig, StepInput, StepOutput, THERMOMETERS};
use schuler_core::reading::{Quality, Reading};
use schuler_core::thermal::{TemperatureRate, TemperatureRateConfig};

fn cases() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(48) }
}

/// A linear congruential generator: the same series whatever proptest draws.
struct Random(u64);

impl Random {
    /// Between −1 and 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

fn turn() -> impl Strategy<Value = Rotation3<f64>> {
    prop::array::uniform3(-3.0..3.0f64).prop_map(|angles| Rotation3::new(Vector3::from(angles)))
}

fn permutation() -> impl Strategy<Value = [usize; 5]> {
    Just([0, 1, 2, 3, 4]).prop_shuffle()
}

/// Five numbers of a geometry, each gyro's noise, and a reading of each.
fn block() -> impl Strategy<Value = ([[f64; 3]; 5], [f64; 5], [f64; 5])> {
    let axis = (-1.0..1.0f64, 0.0..std::f64::consts::TAU).prop_map(|(z, azimuth)| {
        let radius = (1.0 - z * z).sqrt();
        [radius * azimuth.cos(), radius * azimuth.sin(), z]
    });
    (prop::array::uniform5(axis), prop::array::uniform5(0.5..2.0f64), prop::array::uniform5(-5.0..5.0f64))
        // Far enough from the singular geometries that rounding stays what it is.
        .prop_filter("badly conditioned", |(axes, sigma, _)| {
            ParitySpace::try_build(axes, sigma).is_ok_and(|space| {
                space.geometry().volume() > 0.05 && space.sensitivity().iter().all(|&s| s > 0.1)
            })
        })
}

/// What every method of isolation says of a block, per gyro.
struct Verdicts {
    parity_square: f64,
    likelihood: [f64; 5],
    determinants: [f64; 5],
    unexplained: [f64; 5],
    sequential: [f64; 5],
}

fn verdicts(axes: &[[f64; 3]; 5], sigma: &[f64; 5], readings: &[f64; 5]) -> Verdicts {
    let space = ParitySpace::try_build(axes, sigma).unwrap();
    let whitened = SVector::from(*readings).component_div(&SVector::from(*sigma));
    let parity = space.parity(&whitened);
    let projection = OrthogonalProjector::new(space.geometry()).project(&whitened);
    let sequential = SequentialFilter::new(space.geometry(), Recursion::Kalman);
    Verdicts {
        parity_square: parity.norm_squared(),
        likelihood: space.likelihood(&parity, 1.0),
        determinants: FiveDeterminants::normalised(&space).of(&whitened).map(f64::abs).into(),
        unexplained: projection.unexplained.into(),
        sequential: std::array::from_fn(|gyro| sequential.statistics(gyro, &whitened).last),
    }
}

fn near(a: f64, b: f64, size: f64) -> bool {
    (a - b).abs() <= 1e-8 * (1.0 + size)
}

/// The same up to rounding, when gyro k of the second is gyro `from[k]` of the first.
fn agree(one: &Verdicts, other: &Verdicts, from: [usize; 5]) -> Result<(), TestCaseError> {
    let size = one.parity_square;
    prop_assert!(near(one.parity_square, other.parity_square, size));
    for (k, j) in from.into_iter().enumerate() {
        prop_assert!(near(one.likelihood[j], other.likelihood[k], size));
        prop_assert!(near(one.determinants[j], other.determinants[k], size));
        prop_assert!(near(one.unexplained[j], other.unexplained[k], size));
        prop_assert!(
            near(one.sequential[j], other.sequential[k], size),
            "{} {}",
            one.sequential[j],
            other.sequential[k]
        );
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases())]

    /// Determinants, parity, projection and sequential filter do not see in which axes the body is described, nor (parity)
    /// how the body turns.
    #[test]
    fn isolation_does_not_depend_on_the_body_axes(
        (axes, sigma, readings) in block(), turn in turn(), rate in prop::array::uniform3(-9.0..9.0f64),
    ) {
        let turned = axes.map(|axis| (turn * Vector3::from(axis)).into());
        let moving = std::array::from_fn(|k| readings[k] + Vector3::from(axes[k]).dot(&Vector3::from(rate)));
        let still = verdicts(&axes, &sigma, &readings);
        agree(&still, &verdicts(&turned, &sigma, &readings), [0, 1, 2, 3, 4])?;
        agree(&still, &verdicts(&axes, &sigma, &moving), [0, 1, 2, 3, 4])?;
        // A gyro that is built in the other way round reads the other way round.
        let mut other = (axes, readings);
        other.0[2] = other.0[2].map(|x| -x);
        other.1[2] *= -1.0;
        agree(&still, &verdicts(&other.0, &sigma, &other.1), [0, 1, 2, 3, 4])?;
    }

    /// Nor in which order the gyros are numbered.
    #[test]
    fn isolation_does_not_depend_on_the_order_of_the_gyros((axes, sigma, readings) in block(), from in permutation()) {
        let reordered = verdicts(&from.map(|j| axes[j]), &from.map(|j| sigma[j]), &from.map(|j| readings[j]));
        agree(&verdicts(&axes, &sigma, &readings), &reordered, from)?;
    }

    /// Nor in which unit they read; how well the geometry is conditioned does not either.
    #[test]
    fn isolation_does_not_depend_on_the_unit((axes, sigma, readings) in block(), exponent in -30..30i32) {
        let unit = 2f64.powi(exponent);
        let scaled = verdicts(&axes, &sigma.map(|x| x * unit), &readings.map(|x| x * unit));
        let plain = verdicts(&axes, &sigma, &readings);
        prop_assert_eq!(plain.parity_square, scaled.parity_square);
        prop_assert_eq!(plain.determinants, scaled.determinants);
        prop_assert_eq!(plain.sequential, scaled.sequential);
        let volume = |sigma: &[f64; 5]| ParitySpace::try_build(&axes, sigma).unwrap().geometry().volume();
        prop_assert_eq!(volume(&sigma), volume(&sigma.map(|x| x * unit)));
    }

    /// A whole flight of the block with a failing gyro, turned and renumbered: the same verdict at the same sample, the rate turned.
    #[test]
    fn a_failure_is_isolated_alike_in_all_axes_and_orders(
        turn in turn(), from in permutation(), failing in 0..5usize, size in 4.0..30.0f64, seed: u64,
    ) {
        let cone = IsolationConfig::CONE;
        let other = IsolationConfig {
            axes: from.map(|j| (turn * Vector3::from(cone.axes[j])).into()),
            sigma: from.map(|j| cone.sigma[j]),
            ..cone
        };
        let (mut one, mut two) =
            (FaultIsolation::try_build(&cone).unwrap(), FaultIsolation::try_build(&other).unwrap());
        let mut random = Random(seed);
        for sample in 0..300 {
            let rate = Vector3::new(7e-5, -3e-5, 5e-5);
            let mut readings: [f64; 5] = cone.axes.map(|axis| Vector3::from(axis).dot(&rate) + 1e-7 * random.next());
            readings[failing] += if sample > 100 { size * 1e-7 } else { 0.0 };
            let a = one.step(&readings.map(Reading::good), None);
            let b = two.step(&from.map(|j| Reading::good(readings[j])), None);
            let renumbered = match b.verdict {
                Verdict::Fault(gyro) => Verdict::Fault(from[usize::from(gyro)] as u8),
                same => same,
            };
            prop_assert_eq!(a.verdict, renumbered, "sample {}", sample);
            let turned = turn * Vector3::from(a.rate);
            prop_assert!((turned - Vector3::from(b.rate)).norm() < 1e-15, "{turned} {:?}", b.rate);
            // The sums are in single precision: docs/numerics.md.
            prop_assert!((a.alarm_level - b.alarm_level).abs() < 1e-4 * (1.0 + a.alarm_level));
        }
        prop_assert_eq!(one.excluded(), 1 << failing);
    }
}

/// The filter's configuration in units `unit` times smaller for every state: the loop is linear.
fn scaled(config: &FilterConfig<f32>, unit: f32) -> FilterConfig<f32> {
    let noise = |it: &MarkovNoise<f32>| MarkovNoise { sigma: it.sigma * unit, ..*it };
    FilterConfig {
        accelerometer: noise(&config.accelerometer),
        gyro: noise(&config.gyro),
        velocity_noise: config.velocity_noise * unit,
        initial_velocity_sigma: config.initial_velocity_sigma * unit,
        initial_vertical_sigma: config.initial_vertical_sigma * unit,
        ..*config
    }
}

proptest! {
    #![proptest_config(cases())]

    /// The error filter is linear: all states in another unit, and with the other sign, give the same to the last bit.
    #[test]
    fn filter_does_not_depend_on_the_unit(exponent in -12..12i32, seed: u64) {
        let unit = 2f32.powi(exponent);
        let config = ModuleConfig::default().filter;
        let mut one = ErrorFilter::try_build(&config).unwrap();
        let mut two = ErrorFilter::try_build(&scaled(&config, unit)).unwrap();
        let mut three = one;
        let mut random = Random(seed);
        for step in 0..500 {
            let velocity = (step % 5 != 4).then(|| (if step % 97 == 0 { 9.0 } else { 0.2 } * random.next()) as f32);
            let (a, b) = (one.step(velocity), two.step(velocity.map(|v| v * unit)));
            let c = three.step(velocity.map(|v| -v));
            prop_assert_eq!((a.gated, a.reacquired, a.reset), (b.gated, b.reacquired, b.reset));
            let (a, b, c) = (one.output(&a), two.output(&b), three.output(&c));
            prop_assert_eq!(a.estimate.map(|x| x * unit), b.estimate);
            prop_assert_eq!(a.sigma.map(|x| x * unit), b.sigma);
            prop_assert_eq!(a.nis, b.nis);
            prop_assert_eq!(a.estimate.map(|x| 0.0 - x), c.estimate.map(|x| 0.0 + x));
            prop_assert_eq!(a.sigma, c.sigma);
        }
    }

    /// A correlation in another unit has the same correlation time, structure and choice; in another unit of time, the
    /// reciprocal one.
    #[test]
    fn structure_does_not_depend_on_the_units(
        alpha in 1e-3..0.3f64, beta in 0.0..0.5f64, exponent in -20..20i32, time_exponent in -8..8i32, seed: u64,
    ) {
        let mut random = Random(seed);
        let unit = 2f64.powi(exponent);
        let time_unit = 2f64.powi(time_exponent);
        let correlation: [f64; 40] = std::array::from_fn(|lag| {
            let lag = lag as f64;
            3.0 * (-alpha * lag).exp() * (beta * lag).cos() + 0.003 * random.next()
        });
        let other = correlation.map(|r| r * unit);
        let (one, two) =
            (fit_exponential(&correlation, 1.0, EXPONENTIAL_FLOOR), fit_exponential(&other, time_unit, EXPONENTIAL_FLOOR));
        prop_assert_eq!(one.map(|it| (it.variance * unit, it.alpha / time_unit, it.lags)), two.map(|it| (it.variance, it.alpha, it.lags)));
        let name = |structure: &Structure<f64>| match structure {
            Structure::None => ("none", 0.0, 0.0),
            Structure::Exponential(it) => ("exponential", it.alpha, 0.0),
            Structure::ExponentialCosine(it, ..) => ("cosine", it.alpha, it.beta),
        };
        let one = choose_structure(&correlation, 1.0, 20_000.0);
        let two = choose_structure(&other, time_unit, 20_000.0 * time_unit);
        let (one, two) = (name(&one), name(&two));
        prop_assert_eq!(one.0, two.0);
        prop_assert!((one.1 / time_unit - two.1).abs() <= 1e-12 * two.1 && (one.2 / time_unit - two.2).abs() <= 1e-12 * two.2);
    }

    /// Temperature: by as many quanta warmer, and upside down. Not in another unit: the prior of the rate is one in degC/s.
    #[test]
    fn temperature_does_not_depend_on_zero_and_sign(warmer in -4..4i32, seed: u64) {
        let quantum = 0.0625f32;
        let build = |quantum: f32| TemperatureRate::try_build(&TemperatureRateConfig::of_quantum(quantum)).unwrap();
        let (mut one, mut warm, mut mirrored) = (build(quantum), build(quantum), build(quantum));
        // A power of two above all readings keeps the shift from changing a rounding.
        let shift = 0.25 * warmer as f32;
        let mut random = Random(seed);
        let mut level = 16.0f32;
        for step in 0..1500u64 {
            level = (level + if random.next() > 0.97 { quantum } else { 0.0 }).min(19.0);
            let time_ms = 1000 * step;
            let a = one.step(time_ms, &Reading::good(level));
            let b = warm.step(time_ms, &Reading::good(level + shift));
            let d = mirrored.step(time_ms, &Reading::good(-level));
            prop_assert!((a.temperature + shift - b.temperature).abs() < 4e-6 && a.rate == b.rate, "{a:?} {b:?}");
            prop_assert_eq!((a.temperature, a.rate, a.status), (0.0 - d.temperature, 0.0 - d.rate, d.status));
        }
    }

    /// Health: a common velocity, another unit, and the other direction.
    #[test]
    fn health_does_not_depend_on_common_velocity_unit_and_sign(common in -512..512i32, exponent in -4..4i32, seed: u64) {
        let unit = 2f32.powi(exponent);
        let config = HealthConfig::<f32, 2>::doppler_against_inertial();
        let mut scaled = config;
        for sigma in scaled.radio.sigma.iter_mut().chain([
            &mut scaled.jump.sigma,
            &mut scaled.inertial.random_walk,
            &mut scaled.inertial.initial_sigma,
            &mut scaled.inertial.drift_sigma,
            &mut scaled.inertial.drift_random_walk,
            &mut scaled.inertial.bound,
            &mut scaled.residual_sigma,
        ]) {
            *sigma *= unit;
        }
        let mut one = HealthMonitor::try_build(&config).unwrap();
        let (mut two, mut three) = (one, one);
        let mut four = HealthMonitor::try_build(&scaled).unwrap();
        let mut random = Random(seed);
        for step in 0..600 {
            // On a grid on which a common velocity is added without rounding.
            let mut on_grid = |size: f64| ((size * random.next()) * 1024.0).round() as f32 / 1024.0;
            let (radio, inertial) = (on_grid(0.5) + if step > 300 { 4.0 } else { 0.0 }, on_grid(0.1));
            let both = |f: &dyn Fn(f32) -> f32| [radio, inertial].map(|velocity| Reading::good(f(velocity)));
            let [r, i] = both(&|velocity| velocity);
            let a = one.step(&r, &i, 1);
            let [r, i] = both(&|velocity| velocity + common as f32);
            let b = two.step(&r, &i, 1);
            let [r, i] = both(&|velocity| -velocity);
            let c = three.step(&r, &i, 1);
            let [r, i] = both(&|velocity| velocity * unit);
            let d = four.step(&r, &i, 1);
            prop_assert_eq!((a.residual, a.mode_probability, a.jump, a.verdict), (b.residual, b.mode_probability, b.jump, b.verdict));
            prop_assert_eq!((a.mode_probability, a.verdict, a.jump.value), (c.mode_probability, c.verdict, 0.0 - c.jump.value));
            // The likelihood is a density: its logarithm rounds otherwise in another unit.
            prop_assert!((a.p_fault - d.p_fault).abs() < 1e-3, "{} {}", a.p_fault, d.p_fault);
            prop_assert!((a.jump.value * unit - d.jump.value).abs() < 1e-2 * unit);
        }
    }

    /// The whole module does not know when it was switched on: another origin of time gives the same bits.
    #[test]
    fn the_step_does_not_depend_on_the_origin_of_time(origin_ms in 0..1u64 << 60, seed: u64, likelihood: bool) {
        let method = if likelihood { Method::Likelihood } else { Method::Published };
        let config = ModuleConfig {
            identification: IdentificationConfig { method, first_s: 300.0, interval_s: 100.0, ..IdentificationConfig::default() },
            thermometers: [Some(TemperatureRateConfig::of_quantum(0.0625)); THERMOMETERS],
            health: Some(HealthConfig::doppler_against_inertial()),
            ..ModuleConfig::default()
        };
        let mut one = Box::new(FlightModule::new());
        one.configure(&config).unwrap();
        let mut two = one.clone();
        let mut random = Random(seed);
        let mut time_ms = 0;
        for step in 0..1200u64 {
            time_ms += match step % 211 { 100 => 7000, 150 => 0, 200 => 5_000_000, _ => 1000 };
            let quality = if step % 13 == 5 { Quality::Missing } else { Quality::Good };
            let input = StepInput {
                velocity_error: Reading { value: 0.3 * random.next() as f32, age_ms: 0, quality },
                gyros: [1.0, 0.2, -0.5, 0.4, 0.1].map(|k| Reading::good(1e-5 * k + 1e-7 * random.next())),
                accelerometers: [0.1, -0.2, -9.8].map(Reading::good),
                thermometers: [20.0, 21.0, 22.0, 23.0].map(|t| Reading::good(t + (step / 50) as f32 * 0.0625)),
                radio_velocity: Reading::good(100.0 + 0.3 * random.next() as f32),
                inertial_velocity: Reading::good(100.0),
                ..StepInput::without_readings(time_ms)
            };
            let a = one.step(&input);
            let b = two.step(&StepInput { time_ms: time_ms + origin_ms, ..input });
            prop_assert_eq!(a, StepOutput { time_ms, ..b });
        }
    }
}
