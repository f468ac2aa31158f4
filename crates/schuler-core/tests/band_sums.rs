//! Band sums against sums over all data, through gaps, and what evidence they are worth.
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};
use schuler_core::filter::{ErrorFilter, FilterConfig};
use schuler_core::module::ModuleConfig;
use schuler_core::sums::{
    BandSums, FilterPass, FlightSums, Heard, Port, Regressor, SERIES, Series, SumsConfig, SumsInput,
    Transition,
};

/// Where the product of series `i` and `j ≥ i` of `n` stands.
fn place(n: usize, i: usize, j: usize) -> usize {
    i * n - i * (i + 1) / 2 + j
}

/// Differences of pairs of averages, straight from the definition: octave by octave over the whole record, in f64.
fn directly<const N: usize>(record: &[[f32; N]], octave: usize) -> Vec<[f64; N]> {
    let length = 1 << octave;
    let sum = |from: usize, k: usize| {
        record[from..from + length].iter().map(|vector| f64::from(vector[k])).sum::<f64>()
    };
    (0..record.len() / (2 * length))
        .map(|pair| {
            let from = 2 * length * pair;
            std::array::from_fn(|k| (sum(from, k) - sum(from + length, k)) / (2.0 * length as f64).sqrt())
        })
        .collect()
}

fn products<const N: usize>(coefficients: &[[f64; N]]) -> Vec<f64> {
    let mut sums = vec![0.0; N * (N + 1) / 2];
    for vector in coefficients {
        for i in 0..N {
            for j in i..N {
                sums[place(N, i, j)] += vector[i] * vector[j];
            }
        }
    }
    sums
}

fn close(one: &[f32], other: &[f64], scale: f64) -> bool {
    one.len() == other.len() && one.iter().zip(other).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-5 * scale)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Whatever is absent: the sums are those of what is present, octave by octave, and nothing is lost.
    #[test]
    fn the_sums_are_those_over_all_data(seed: u64, length in 0_usize..900, percent_absent in 0_u32..60) {
        let mut random = Pcg32::seed_from_u64(seed);
        let (mut sums, mut record) = (BandSums::<3, 6, 7>::EMPTY, Vec::new());
        for k in 0..length {
            let mut normal = || -> f32 { StandardNormal.sample(&mut random) };
            let vector = [normal(), 3.0 + 0.01 * k as f32, 10.0 * normal()];
            let present = random.next_u32() % 100 >= percent_absent;
            let wild = present && k % 37 == 5;
            sums.push(&if wild { [f32::NAN, 1.0, 1.0] } else { vector }, present);
            if present && !wild {
                record.push(vector);
            }
        }
        prop_assert_eq!(sums.pushed() as usize, record.len());
        let squares = record.iter().flatten().map(|x| f64::from(*x).powi(2)).sum::<f64>() + 1.0;
        // Before the end a pair may still wait for the turn of its octave; after it, nothing does.
        let before: Vec<u32> = sums.bands().map(|band| band.count).collect();
        sums.settle();
        let mut total = [0.0; 6];
        for (octave, band) in sums.bands().enumerate() {
            if octave < 6 {
                let expected = directly(&record, octave);
                prop_assert_eq!(band.count as usize, expected.len());
                prop_assert!(before[octave] <= band.count && band.count <= before[octave] + 1);
                prop_assert!(close(band.products, &products(&expected), squares), "octave {}", octave);
            }
            total.iter_mut().zip(band.products).for_each(|(sum, product)| *sum += f64::from(*product));
        }
        let raw: Vec<[f64; 3]> = record.iter().map(|vector| vector.map(f64::from)).collect();
        let raw = products(&raw);
        prop_assert!(total.iter().zip(&raw).all(|(a, b)| (a - b).abs() < 1e-5 * squares));
    }
}

/// Force through every port, so that the filter can be fed what exactly one of them makes.
fn by_force() -> SumsConfig {
    let entry = |series, port| Regressor { series, port };
    SumsConfig {
        velocity: [
            entry(Series::Force, Port::Gyro),
            entry(Series::Force, Port::Accelerometer),
            entry(Series::Force, Port::Velocity),
            entry(Series::ForceSquared, Port::Gyro),
            entry(Series::Constant, Port::Gyro),
            entry(Series::Time, Port::Gyro),
            entry(Series::Temperature, Port::Gyro),
            entry(Series::TemperatureRate, Port::Velocity),
        ],
        ..SumsConfig::default()
    }
}

/// A Schuler loop [FIL-3], by Runge and Kutta.
#[derive(Clone, Copy, Default)]
struct Loop {
    velocity: f64,
    vertical: f64,
}

impl Loop {
    /// Over a second with errors (accelerometer, gyro) that go from `one` to `other`.
    fn pass(&mut self, filter: &FilterConfig<f32>, one: [f64; 2], other: [f64; 2]) {
        let (radius, gravity) = (f64::from(filter.radius_m), f64::from(filter.gravity));
        let slope = |t: f64, v: f64, d: f64| {
            let [a, w] = std::array::from_fn(|k| one[k] + t * (other[k] - one[k]));
            (-gravity * d + a, v / radius + w)
        };
        let (v, d) = (self.velocity, self.vertical);
        let (k1, l1) = slope(0.0, v, d);
        let (k2, l2) = slope(0.5, v + 0.5 * k1, d + 0.5 * l1);
        let (k3, l3) = slope(0.5, v + 0.5 * k2, d + 0.5 * l2);
        let (k4, l4) = slope(1.0, v + k3, d + l3);
        self.velocity += (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
        self.vertical += (l1 + 2.0 * l2 + 2.0 * l3 + l4) / 6.0;
    }
}

/// Without noise, the innovation is the series that made it, in every octave: through gaps and steps without measurement.
#[test]
fn fil_6_a_series_goes_through_loop_and_filter_as_the_error_does() {
    let config = ModuleConfig::default().filter;
    let coefficient = [0.8, 1.5, 0.5];
    let units = [config.gyro.sigma, config.accelerometer.sigma, config.velocity_noise];
    for (port, unit) in units.iter().enumerate() {
        let mut filter = ErrorFilter::try_build(&config).unwrap();
        let mut sums = Box::new(FlightSums::IDLE);
        sums.start(Some(&by_force()), &config);
        let force = |k: u32| (f64::from(k) / 180.0).sin() + 0.3 * (f64::from(k) / 37.0).cos();
        let error = |k: u32| coefficient[port] * f64::from(*unit) * (force(k) - force(0));
        let mut truth = Loop::default();
        let mut last = None;
        for k in 0..5000_u32 {
            let driven = |k: u32| [[0.0, error(k)], [error(k), 0.0], [0.0; 2]][port];
            truth.pass(&config, driven(k.saturating_sub(1)), driven(k));
            // Some steps do not happen, for no longer than the series is straight.
            if k % 400 >= 396 {
                continue;
            }
            let missing = last.map_or(0, |last: u32| k - last - 1);
            last = Some(k);
            let mut bridged = Transition::IDENTITY;
            if missing > 0 {
                let model = config.model(&config.accelerometer, &config.gyro, missing as f32);
                filter.coast(&model);
                bridged = Transition::from(&model);
            }
            // A reading in seven is missing.
            let direct = if port == 2 { error(k) } else { 0.0 };
            let measured = (k % 7 != 3).then_some((truth.velocity + direct) as f32);
            let step = filter.step(measured);
            assert!(!step.gated, "{k}");
            let duration_s = (missing + 1) as f32;
            let pass = FilterPass::of(&filter, &step, &bridged, duration_s, measured.is_some(), false);
            let heard = Heard { force: Some(force(k) as f32), ..Heard::default() };
            sums.step(&SumsInput { elapsed: missing + 1, heard, pass, parity: None });
        }
        assert_eq!(sums.parity().pushed(), 0);
        let n = 1 + SERIES;
        for (octave, band) in sums.velocity().bands().enumerate().take(9) {
            let product = |i, j| f64::from(band.products[place(n, i, j)]);
            let (yy, y, own) = (product(0, 0), product(0, 1 + port), product(1 + port, 1 + port));
            assert!(own > 0.0 && band.count > 0);
            let ratio = y / own / coefficient[port];
            let left = (yy - y * y / own) / yy;
            assert!((ratio - 1.0).abs() < 0.01, "port {port}, octave {octave}: {ratio}");
            assert!(left < 1e-3, "port {port}, octave {octave}: {left}");
        }
    }
}

/// One run of the filter's own noise with a gyro that depends on temperature: the coefficient in σ of the gyro's drift per K, its
/// standard deviation, from the sums alone, with a constant drift beside it.
fn fitted(seed: u64, hidden: f64) -> (f64, f64) {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let filter_config = ModuleConfig::default().filter;
    let mut filter = ErrorFilter::try_build(&filter_config).unwrap();
    let sums_config = SumsConfig::default();
    let mut sums = Box::new(FlightSums::IDLE);
    sums.start(Some(&sums_config), &filter_config);
    let [rise, wave, period] = [10.0 + 3.0 * normal(), 3.0 + normal(), 2500.0 + 500.0 * normal()];
    let temperature =
        |t: f64| rise * (1.0 - (-t / 1800.0).exp()) + wave * (t / period * std::f64::consts::TAU).sin();

    let noises = [filter_config.accelerometer, filter_config.gyro]
        .map(|noise| (f64::from(noise.sigma), (-1.0 / f64::from(noise.tau_s)).exp()));
    let mut errors = noises.map(|(sigma, _)| sigma * normal());
    let mut truth = Loop {
        velocity: f64::from(filter_config.initial_velocity_sigma) * normal(),
        vertical: f64::from(filter_config.initial_vertical_sigma) * normal(),
    };
    for k in 0..6000 {
        let driven = |errors: [f64; 2], t: f64| {
            [errors[0], errors[1] + hidden * f64::from(filter_config.gyro.sigma) * temperature(t)]
        };
        let before = driven(errors, f64::from(k - 1).max(0.0));
        for (error, (sigma, kept)) in errors.iter_mut().zip(noises) {
            *error = *error * kept + sigma * (1.0 - kept * kept).sqrt() * normal();
        }
        truth.pass(&filter_config, before, driven(errors, f64::from(k)));
        let measured = truth.velocity + f64::from(filter_config.velocity_noise) * normal();
        let step = filter.step(Some(measured as f32));
        let heard = Heard { temperature: Some(temperature(f64::from(k)) as f32), ..Heard::default() };
        let pass = FilterPass::of(&filter, &step, &Transition::IDENTITY, 1.0, true, false);
        sums.step(&SumsInput { elapsed: 1, heard, pass, parity: None });
    }
    let mut sums = *sums.velocity();
    sums.settle();
    let at = |gyro_series| 1 + sums_config.velocity.iter().position(|it| it.series == gyro_series).unwrap();
    let (one, other) = (at(Series::Constant), at(Series::Temperature));
    let total =
        |i, j| sums.bands().map(|band| f64::from(band.products[place(1 + SERIES, i, j)])).sum::<f64>();
    let share = total(one, other) / total(one, one);
    let information = total(other, other) - share * total(one, other);
    let said = total(0, other) - share * total(0, one);
    (said / information, information.sqrt().recip())
}

const RUNS: u64 = 400;

/// Without a dependence the gain (ĉ/σ)² is chi-square distributed with one degree of freedom: evidence counts once.
#[test]
fn without_a_dependence_the_gain_is_chi_square() {
    let mut gains: Vec<f64> = (0..RUNS)
        .map(|seed| {
            let (coefficient, sigma) = fitted(seed, 0.0);
            (coefficient / sigma).powi(2)
        })
        .collect();
    gains.sort_by(f64::total_cmp);
    let mean = gains.iter().sum::<f64>() / RUNS as f64;
    // Its standard deviation over the runs is √(2/400) = 0.07.
    assert!((mean - 1.0).abs() < 0.25, "{mean}");
    // Kolmogorov's distance; 1.63/√n is exceeded by one true hypothesis in a hundred.
    let distance = gains
        .iter()
        .enumerate()
        .map(|(k, gain)| {
            let expected = libm::erf((gain / 2.0).sqrt());
            let (below, above) = (k as f64 / RUNS as f64, (k + 1) as f64 / RUNS as f64);
            (expected - below).abs().max((expected - above).abs())
        })
        .fold(0.0, f64::max);
    println!("gain without a dependence: mean {mean:.3}, distance {distance:.3}");
    assert!(distance < 1.63 / (RUNS as f64).sqrt(), "{distance}");
}

/// A concealed coefficient is found within three standard deviations in 99 % of runs, and the deviation is that of the runs.
#[test]
fn a_concealed_dependence_is_found_within_its_deviation() {
    let hidden = 1.0;
    let runs: Vec<(f64, f64)> = (0..RUNS).map(|seed| fitted(10_000 + seed, hidden)).collect();
    let within = runs.iter().filter(|(found, sigma)| (found - hidden).abs() < 3.0 * sigma).count();
    let square = runs.iter().map(|(found, sigma)| ((found - hidden) / sigma).powi(2)).sum::<f64>();
    let told = runs.iter().filter(|(found, sigma)| found / sigma > 4.0).count();
    println!("within 3 σ: {within} of {RUNS}; mean square {:.3}; told {told}", square / RUNS as f64);
    assert!(within as u64 * 100 >= RUNS * 99, "{within}");
    assert!((square / RUNS as f64 - 1.0).abs() < 0.25);
    assert!(told as u64 * 100 >= RUNS * 95, "or there was nothing to find: {told}");
}

#[test]
fn what_cannot_be_flown_is_refused() {
    let fine = SumsConfig::default();
    let wrong = [
        (SumsConfig { thermometer: 4, ..fine }, "sums.thermometer"),
        (SumsConfig { accelerometer: 3, ..fine }, "sums.accelerometer"),
        (SumsConfig { lags_s: [300.0, 0.0], ..fine }, "sums.lags_s"),
        (SumsConfig { lags_s: [f32::NAN, 1.0], ..fine }, "sums.lags_s"),
    ];
    assert_eq!(fine.validate(), Ok(()));
    for (sums, field) in wrong {
        assert_eq!(sums.validate().unwrap_err().field, field);
    }
}
