//! How much single precision costs in accuracy, and double precision, against references of more digits.
//!
//! `SCHULER_REWRITE_GOLDEN=1 cargo test -p schuler-core --test numerics` writes the table in `docs/numerics.md` anew. The
//! numbers are exact, because elementary functions and arithmetic give the same bits everywhere.
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use nalgebra::{Cholesky, Matrix4, SVector, Vector2, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_core::filter::{ErrorFilter, FilterConfig, Gaussian, MarkovNoise};
use schuler_core::health::{HealthConfig, HealthMonitor};
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::detector::{DetectorConfig, FiveGyroDetector};
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::ParitySpace;
use schuler_core::reading::Reading;
use schuler_core::thermal::{TemperatureRate, TemperatureRateConfig};
use twofloat::TwoFloat;

const DAY: u32 = 86_400;

/// A line of the table.
struct Line {
    part: &'static str,
    quantity: &'static str,
    single: f64,
    double: Option<f64>,
    /// What single precision may reach; none where it does not fly.
    bar: Option<f64>,
    flies: &'static str,
}

#[test]
fn single_precision_flies_where_it_is_enough() {
    let mut lines = filter_lines();
    lines.extend(gyro_lines());
    lines.extend(temperature_lines());
    lines.extend(health_lines());
    let table = table(&lines);
    println!("{table}");
    for line in &lines {
        if let Some(bar) = line.bar {
            assert!(
                line.single <= bar,
                "{}, {}: {:.2e}, more than {bar:e}",
                line.part,
                line.quantity,
                line.single
            );
        }
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/numerics.md");
    if std::env::var("SCHULER_REWRITE_GOLDEN").is_ok_and(|value| value == "1") {
        fs::write(&path, &table).unwrap();
    }
    let written = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        written == table,
        "{} is not this table; SCHULER_REWRITE_GOLDEN=1 writes it anew",
        path.display()
    );
}

fn table(lines: &[Line]) -> String {
    let mut text = String::from(
        "# Precision\n\nLargest errors of the step's parts in single and in double precision. Written by\n\
         `SCHULER_REWRITE_GOLDEN=1 cargo test -p schuler-core --test numerics`.\n\n\
         | part | largest error | single | double | bar | flies |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    let number =
        |value: Option<f64>| value.map_or_else(|| "reference".into(), |value| format!("{value:.1e}"));
    for Line { part, quantity, single, double, bar, flies } in lines {
        let bar = bar.map_or_else(|| "–".into(), |bar| format!("{bar:.1e}"));
        let _ =
            writeln!(text, "| {part} | {quantity} | {single:.1e} | {} | {bar} | {flies} |", number(*double));
    }
    text.push_str(
        "\nFilter and determinants: against double-double arithmetic (32 digits), with another formula: the model as the\n\
         exponential of a matrix, the covariance by full matrices, the determinants by expansion. That reference is itself\n\
         compared with mpmath at fifty digits and with rational numbers (`tests/oracle/make_precision.py`): over ten hours it\n\
         stays within 1e-27 standard deviations. The rest: single against double precision. What a part costs in either stands\n\
         in `tests/golden/instruction_counts.txt`, and what the image has room for in `docs/flight-budget.md`.\n\n\
         Bars on the states: ten hours, the specification; thirty days, which it does not name, a hundredth of a standard\n\
         deviation. The errors are the largest met.\n\n\
         - **Filter, identification, temperature, health: single.** The errors are far below what the sensors' noise leaves\n  \
         unknown, and double precision would cost 25 to 75 times the instructions.\n\
         - **Readings of the gyros, parity, determinants, rate: double.** A parity is what is left of readings up to ten\n  \
         million times as large; single precision loses it at any rate that matters.\n\
         - **Sums of parities: single.** The parity itself is small.\n",
    );
    text
}

// --- The error filter -------------------------------------------------------------------------------------------

/// The channel of the flight configuration.
const CHANNEL: FilterConfig<f32> = FilterConfig {
    radius_m: 6_371_000.0,
    gravity: 9.80665,
    step_s: 1.0,
    accelerometer: MarkovNoise { sigma: 9.80665e-4, tau_s: 60.0 },
    gyro: MarkovNoise { sigma: 4.84814e-7, tau_s: 1800.0 },
    velocity_noise: 0.1,
    initial_velocity_sigma: 0.1,
    initial_vertical_sigma: 1e-4,
    gate_sigma: 6.0,
};

/// The same numbers in double precision: what is compared is the arithmetic.
fn doubled(config: &FilterConfig<f32>) -> FilterConfig<f64> {
    let noise =
        |noise: &MarkovNoise<f32>| MarkovNoise { sigma: noise.sigma.into(), tau_s: noise.tau_s.into() };
    FilterConfig {
        radius_m: config.radius_m.into(),
        gravity: config.gravity.into(),
        step_s: config.step_s.into(),
        accelerometer: noise(&config.accelerometer),
        gyro: noise(&config.gyro),
        velocity_noise: config.velocity_noise.into(),
        initial_velocity_sigma: config.initial_velocity_sigma.into(),
        initial_vertical_sigma: config.initial_vertical_sigma.into(),
        gate_sigma: config.gate_sigma.into(),
    }
}

type Full = [[TwoFloat; 4]; 4];

/// The filter by the textbook, in double-double arithmetic.
struct Reference {
    transition: Full,
    noise: Full,
    mean: [TwoFloat; 4],
    covariance: Full,
    measurement_variance: TwoFloat,
}

fn of(value: f64) -> TwoFloat {
    TwoFloat::from(value)
}

/// a/b to all digits: `TwoFloat`'s own division (0.8.4) takes 1 − b·(1/b) without a fused product and has those of a double,
/// which a step of Newton doubles.
fn quotient(a: TwoFloat, b: TwoFloat) -> TwoFloat {
    let first = a / b;
    first + (a - first * b) / b
}

impl Reference {
    /// Φ and Q from the exponential of [−F G q Gᵀ; 0 Fᵀ] Δ (Van Loan).
    fn new(config: &FilterConfig<f64>) -> Self {
        let (zero, one) = (of(0.0), of(1.0));
        let (rate_a, rate_w) =
            (quotient(one, of(config.accelerometer.tau_s)), quotient(one, of(config.gyro.tau_s)));
        let level =
            |noise: &MarkovNoise<f64>| quotient(of(2.0) * of(noise.sigma) * of(noise.sigma), of(noise.tau_s));
        let mut f = [[zero; 4]; 4];
        f[0] = [zero, -of(config.gravity), one, zero];
        f[1] = [quotient(one, of(config.radius_m)), zero, zero, one];
        f[2][2] = -rate_a;
        f[3][3] = -rate_w;
        let mut block = [[zero; 8]; 8];
        for i in 0..4 {
            for j in 0..4 {
                block[i][j] = -f[i][j];
                block[4 + i][4 + j] = f[j][i];
            }
        }
        block[2][6] = level(&config.accelerometer);
        block[3][7] = level(&config.gyro);

        // A sixteenth of the step, so that the series loses no digits; then doubled four times.
        let scale = of(config.step_s / 16.0);
        let mut sum = identity::<8>();
        let mut term = sum;
        for k in 1..40 {
            term = product(&term, &block).map(|row| row.map(|x| quotient(x * scale, of(f64::from(k)))));
            sum = added(&sum, &term);
        }
        for _ in 0..4 {
            sum = product(&sum, &sum);
        }
        let transition: Full = std::array::from_fn(|i| std::array::from_fn(|j| sum[4 + j][4 + i]));
        let upper: Full = std::array::from_fn(|i| std::array::from_fn(|j| sum[i][4 + j]));
        let mut covariance = [[zero; 4]; 4];
        let sigma = [
            config.initial_velocity_sigma,
            config.initial_vertical_sigma,
            config.accelerometer.sigma,
            config.gyro.sigma,
        ];
        for (i, sigma) in sigma.into_iter().enumerate() {
            covariance[i][i] = of(sigma) * of(sigma);
        }
        Self {
            noise: product(&transition, &upper),
            transition,
            mean: [zero; 4],
            covariance,
            measurement_variance: of(config.velocity_noise) * of(config.velocity_noise),
        }
    }

    fn step(&mut self, velocity: Option<f64>) {
        let f = &self.transition;
        self.mean = std::array::from_fn(|i| {
            let mean = &self.mean;
            f[i][0] * mean[0] + f[i][1] * mean[1] + f[i][2] * mean[2] + f[i][3] * mean[3]
        });
        let transposed: Full = std::array::from_fn(|i| std::array::from_fn(|j| f[j][i]));
        self.covariance = added(&product(&product(f, &self.covariance), &transposed), &self.noise);
        if let Some(velocity) = velocity {
            let p = self.covariance;
            let variance = p[0][0] + self.measurement_variance;
            let innovation = of(velocity) - self.mean[0];
            for i in 0..4 {
                self.mean[i] += quotient(p[i][0] * innovation, variance);
                for j in 0..4 {
                    self.covariance[i][j] = p[i][j] - quotient(p[i][0] * p[0][j], variance);
                }
            }
        }
    }
}

fn identity<const N: usize>() -> [[TwoFloat; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| of(f64::from(u8::from(i == j)))))
}

fn product<const N: usize>(a: &[[TwoFloat; N]; N], b: &[[TwoFloat; N]; N]) -> [[TwoFloat; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..N).fold(of(0.0), |sum, k| sum + a[i][k] * b[k][j])))
}

fn added<const N: usize>(a: &[[TwoFloat; N]; N], b: &[[TwoFloat; N]; N]) -> [[TwoFloat; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j]))
}

/// Largest errors so far.
#[derive(Default)]
struct Errors {
    /// Of the states, in their standard deviations.
    mean: f64,
    /// Of the covariance, in standard deviations of both.
    covariance: f64,
    /// Largest of −(least pivot of the correlations' Cholesky factor): negative while all is well.
    indefinite: f64,
}

impl Errors {
    fn take(&mut self, reference: &Reference, mean: [f64; 4], upper: [f64; 10], probe: bool) {
        let sigma: [f64; 4] = std::array::from_fn(|i| f64::from(reference.covariance[i][i]).sqrt());
        let mut entries = upper.into_iter();
        let mut full = Matrix4::zeros();
        for i in 0..4 {
            self.mean = self.mean.max(f64::from(reference.mean[i] - of(mean[i])).abs() / sigma[i]);
            for j in i..4 {
                let p = entries.next().unwrap();
                let error = f64::from(reference.covariance[i][j] - of(p)).abs() / (sigma[i] * sigma[j]);
                self.covariance = self.covariance.max(error);
                full[(i, j)] = p / (sigma[i] * sigma[j]);
                full[(j, i)] = full[(i, j)];
            }
        }
        if probe {
            let pivot = Cholesky::new(full).map_or(-1.0, |factor| factor.l().diagonal().min());
            self.indefinite = self.indefinite.max(-pivot);
        }
    }
}

impl Errors {
    fn lines(part: &'static str, single: &Self, double: &Self, bar: f64) -> Vec<Line> {
        let line = |quantity, single, double, bar| Line {
            part,
            quantity,
            single,
            double: Some(double),
            bar: Some(bar),
            flies: "single",
        };
        vec![
            line("states, in their standard deviations", single.mean, double.mean, bar),
            line("covariance, relative to the variances", single.covariance, double.covariance, 2e-4),
            line(
                "negative of the least pivot of the correlations",
                single.indefinite,
                double.indefinite,
                0.0,
            ),
        ]
    }
}

/// Minutes without a measurement, when a drift up to a thousand times as large had been believed before: the next measurement
/// takes nearly all of the variances, and rounding errors are as large as what it leaves.
#[test]
fn measurements_after_a_gap_leave_the_covariance_positive_definite() {
    for (drift, vertical) in [(1.0, 1.0), (30.0, 10.0), (1000.0, 100.0), (1000.0, 1.0)] {
        let gyro = MarkovNoise { sigma: CHANNEL.gyro.sigma * drift, ..CHANNEL.gyro };
        let initial_vertical_sigma = CHANNEL.initial_vertical_sigma * vertical;
        let config = FilterConfig { gyro, initial_vertical_sigma, ..CHANNEL };
        for gap_s in 1..=600u16 {
            let mut filter = ErrorFilter::try_build(&config).unwrap();
            let model = |step_s| CHANNEL.model(&CHANNEL.accelerometer, &CHANNEL.gyro, step_s);
            filter.retune(model(CHANNEL.step_s), CHANNEL.prior());
            filter.coast(&model(f32::from(gap_s)));
            for second in 1..=20 {
                filter.step(Some(0.0));
                let [vv, vd, va, vw, dd, da, dw, aa, aw, ww] = filter.state().covariance.map(f64::from);
                let full = Matrix4::new(vv, vd, va, vw, vd, dd, da, dw, va, da, aa, aw, vw, dw, aw, ww);
                let scale = Matrix4::from_diagonal(&full.diagonal().map(|variance| 1.0 / variance.sqrt()));
                assert!(
                    Cholesky::new(scale * full * scale).is_some(),
                    "drift times {drift}, vertical times {vertical}, {gap_s} s, {second} s after it: {full}"
                );
            }
        }
    }
}

/// Thirty days of the filter, with single gaps and outages of ten minutes.
fn filter_lines() -> Vec<Line> {
    let config = doubled(&CHANNEL);
    let mut single = ErrorFilter::try_build(&CHANNEL).unwrap();
    let mut double = ErrorFilter::try_build(&config).unwrap();
    let mut reference = Reference::new(&config);
    let model = config.model(&config.accelerometer, &config.gyro, config.step_s);
    let drive = [model.noise[7].sqrt(), model.noise[9].sqrt()];
    let mut truth = [0.0_f64; 4];
    let mut random = Pcg64::new(1, 2);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let (mut of_single, mut of_double) = (
        Errors { indefinite: f64::MIN, ..Errors::default() },
        Errors { indefinite: f64::MIN, ..Errors::default() },
    );
    let mut lines = Vec::new();
    for step in 0..30 * DAY {
        let dot = |row: &[f64; 4]| row.iter().zip(&truth).map(|(f, x)| f * x).sum::<f64>();
        truth = [
            dot(&model.velocity),
            dot(&model.vertical),
            model.decay[0] * truth[2] + drive[0] * normal(),
            model.decay[1] * truth[3] + drive[1] * normal(),
        ];
        let velocity = (truth[0] + 0.1 * normal()) as f32;
        let gap = normal() > 1.645 || step % 21_600 > 21_000;
        let velocity = (!gap).then_some(velocity);
        let steps = (single.step(velocity).gated, double.step(velocity.map(f64::from)).gated);
        reference.step(velocity.map(f64::from).filter(|_| !steps.1));
        assert_eq!(steps.0, steps.1, "one precision gates step {step}, the other does not");
        let probe = step % 60 == 0;
        let Gaussian { mean, covariance } = single.state();
        of_single.take(&reference, mean.map(f64::from), covariance.map(f64::from), probe);
        let Gaussian { mean, covariance } = double.state();
        of_double.take(&reference, *mean, *covariance, probe);
        // The specification's bar on the states is for ten hours. Over a month there is none: a hundredth of a standard
        // deviation.
        for (part, end, bar) in [("filter, 10 hours", 36_000, 1.4e-3), ("filter, 30 days", 30 * DAY, 1e-2)] {
            if step + 1 == end {
                lines.extend(Errors::lines(part, &of_single, &of_double, bar));
            }
        }
    }
    lines
}

// --- The reference's own digits ---------------------------------------------------------------------------------

/// What `tests/oracle/make_precision.py` writes: filter steps to fifty digits, determinants as rational numbers.
const FIFTY_DIGITS: &str = include_str!("fifty_digits.txt");

/// A number as two doubles whose sum it is.
fn pairs(numbers: &[f64]) -> Vec<TwoFloat> {
    numbers.chunks_exact(2).map(|pair| of(pair[0]) + of(pair[1])).collect()
}

/// What that script measures at a step.
fn oracle_velocity(step: u64) -> Option<f64> {
    let missing = step % 7 == 3 || (601..=700).contains(&(step % 3600));
    (!missing).then(|| ((step * 2_654_435_761) % (1 << 20)) as f64 / f64::from(1 << 21) - 0.25)
}

#[test]
fn the_reference_has_the_digits_of_fifty() {
    let axes = IsolationConfig::CONE.axes;
    let mut reference = Reference::new(&doubled(&CHANNEL));
    let mut here = 0;
    let (mut of_filter, mut of_determinants) = (0.0_f64, 0.0_f64);
    for line in FIFTY_DIGITS.lines() {
        let (what, rest) = line.split_once(' ').unwrap();
        let numbers: Vec<f64> = rest.split(' ').map(|number| number.parse().unwrap()).collect();
        if what == "filter" {
            let step = numbers[0] as u64;
            while here < step {
                here += 1;
                reference.step(oracle_velocity(here));
            }
            let exact = pairs(&numbers[1..]);
            let (mean, upper) = exact.split_at(4);
            let mut upper = upper.iter();
            let sigma: [f64; 4] = std::array::from_fn(|i| f64::from(reference.covariance[i][i]).sqrt());
            for i in 0..4 {
                of_filter = of_filter.max(f64::from(reference.mean[i] - mean[i]).abs() / sigma[i]);
                for j in i..4 {
                    let error = f64::from(reference.covariance[i][j] - *upper.next().unwrap()).abs();
                    of_filter = of_filter.max(error / (sigma[i] * sigma[j]));
                }
            }
        } else {
            let readings: [f64; 5] = numbers[..5].try_into().unwrap();
            for (removed, exact) in pairs(&numbers[5..]).into_iter().enumerate() {
                let error = f64::from(determinant(&axes, &readings, removed) - exact).abs();
                let largest = readings.iter().fold(0.0_f64, |most, y| most.max(y.abs()));
                of_determinants = of_determinants.max(error / largest);
            }
        }
    }
    println!("filter {of_filter:e} standard deviations, determinants {of_determinants:e} of the readings");
    assert_eq!(here, 36_000);
    assert!(of_filter < 1e-27, "{of_filter:e}");
    assert!(of_determinants < 1e-30, "{of_determinants:e}");
}

// --- The gyro block ---------------------------------------------------------------------------------------------

/// Errors of the determinants in standard deviations of their noise, at rest and at rates; and of the sums of parities.
fn gyro_lines() -> Vec<Line> {
    let config = IsolationConfig::CONE;
    let space = ParitySpace::try_build(&config.axes, &config.sigma).unwrap();
    let axes = config.axes.map(Vector3::from);
    let (single, double) =
        (FiveDeterminants::new(&axes.map(|axis| axis.map(|x| x as f32))), FiveDeterminants::new(&axes));
    let mut random = Pcg64::new(3, 4);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let mut lines = Vec::new();
    for (rate, quantity) in [
        (0.0, "without rate, in standard deviations"),
        (7.3e-5, "at the Earth's rate, in standard deviations"),
        (0.5, "at 0.5 rad/s, in standard deviations"),
    ] {
        let (mut of_single, mut of_double) = (0.0_f64, 0.0_f64);
        for _ in 0..10_000 {
            let body = Vector3::new(normal(), normal(), normal()).normalize() * rate;
            let readings: [f64; 5] = std::array::from_fn(|k| axes[k].dot(&body) + config.sigma[k] * normal());
            let single = single.of(&SVector::from(readings.map(|y| y as f32)));
            let double = double.of(&SVector::from(readings));
            for removed in 0..5 {
                let exact = determinant(&config.axes, &readings, removed);
                let unit = space.geometry().volume() * space.sensitivity_of(removed) * config.sigma[removed];
                of_single = of_single.max(f64::from(exact - of(single[removed].into())).abs() / unit);
                of_double = of_double.max(f64::from(exact - of(double[removed])).abs() / unit);
            }
        }
        lines.push(Line {
            part: "five determinants",
            quantity,
            single: of_single,
            double: Some(of_double),
            bar: None,
            flies: "double",
        });
    }

    let detector = DetectorConfig {
        false_alarm_interval: config.false_alarm_interval,
        margin: config.margin,
        persistence: config.persistence,
        give_up_samples: config.give_up_samples,
    };
    let narrow = DetectorConfig {
        false_alarm_interval: config.false_alarm_interval as f32,
        margin: config.margin as f32,
        persistence: config.persistence,
        give_up_samples: config.give_up_samples,
    };
    let (mut single, mut double) = (FiveGyroDetector::new(&narrow), FiveGyroDetector::new(&detector));
    let lines_single = space.single();
    let (mut level, mut decisions) = (0.0_f64, 0_u32);
    for step in 0..10 * DAY {
        // A slow fault of one gyro in every other hour.
        let shift = space.matrix().column(2) * if step % 7200 > 3600 { 0.3 } else { 0.0 };
        let parity = Vector2::new(normal(), normal()) + shift;
        let one = single.step(&lines_single, &parity.map(|x| x as f32), true, true);
        let other = double.step(&space, &parity, true, true);
        let same = one.raised == other.raised && one.alarm == other.alarm && one.isolated == other.isolated;
        decisions += u32::from(!same);
        level = level.max((f64::from(one.level) - other.level).abs());
        if step % 3600 == 0 {
            single.reset();
            double.reset();
        }
    }
    let line = |quantity, single, bar| Line {
        part: "sums of parities, 10 days",
        quantity,
        single,
        double: None,
        bar: Some(bar),
        flies: "single",
    };
    lines.push(line("statistic over its threshold", level, 1e-4));
    lines.push(line(
        "share of steps with another decision",
        f64::from(decisions) / f64::from(10 * DAY),
        1e-5,
    ));
    lines
}

/// Determinant of [A y] without a row, by expansion.
fn determinant(axes: &[[f64; 3]; 5], readings: &[f64; 5], removed: usize) -> TwoFloat {
    let rows: Vec<[TwoFloat; 4]> = (0..5)
        .filter(|row| *row != removed)
        .map(|row| [of(axes[row][0]), of(axes[row][1]), of(axes[row][2]), of(readings[row])])
        .collect();
    let mut sum = of(0.0);
    for (p, row) in rows.iter().enumerate() {
        let others: Vec<&[TwoFloat; 4]> =
            rows.iter().enumerate().filter(|(k, _)| *k != p).map(|(_, row)| row).collect();
        let [a, b, c] = [others[0], others[1], others[2]];
        let minor = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]);
        sum += if p % 2 == 0 { -row[3] * minor } else { row[3] * minor };
    }
    sum
}

// --- Thermometer and health -------------------------------------------------------------------------------------

/// Ten days of a thermometer of a sixteenth of a degree.
fn temperature_lines() -> Vec<Line> {
    let mut single = TemperatureRate::try_build(&TemperatureRateConfig::of_quantum(0.0625_f32)).unwrap();
    let mut double = TemperatureRate::try_build(&TemperatureRateConfig::of_quantum(0.0625_f64)).unwrap();
    let mut random = Pcg64::new(5, 6);
    let (mut temperature, mut rate) = (0.0_f64, 0.0_f64);
    for step in 0..10 * DAY {
        let phase = f64::from(step) / f64::from(DAY) * core::f64::consts::TAU;
        let noise: f64 = StandardNormal.sample(&mut random);
        let celsius = 20.0 + 15.0 * phase.sin() + 5.0 * (7.0 * phase).sin() + 0.01 * noise;
        let level = (celsius * 16.0).round() / 16.0;
        let time_ms = u64::from(step) * 1000;
        let (s, d) =
            (single.step(time_ms, &Reading::good(level as f32)), double.step(time_ms, &Reading::good(level)));
        temperature = temperature.max((f64::from(s.temperature) - d.temperature).abs() / d.temperature_sigma);
        rate = rate.max((f64::from(s.rate) - d.rate).abs() / d.rate_sigma);
    }
    let line = |quantity, single, bar| Line {
        part: "temperature rate, 10 days",
        quantity,
        single,
        double: None,
        bar: Some(bar),
        flies: "single",
    };
    vec![
        line("temperature, in its standard deviation", temperature, 1e-2),
        line("rate, in its standard deviation", rate, 1e-2),
    ]
}

/// Ten days of a radio speed against an inertial one, with jumps and grown noise.
fn health_lines() -> Vec<Line> {
    let mut single = HealthMonitor::try_build(&HealthConfig::<f32, 2>::doppler_against_inertial()).unwrap();
    let mut double = HealthMonitor::try_build(&HealthConfig::<f64, 2>::doppler_against_inertial()).unwrap();
    let mut random = Pcg64::new(7, 8);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let (mut probability, mut verdicts, mut correlated) = (0.0_f64, 0_u32, 0.0_f64);
    for step in 0..10 * DAY {
        let sigma = if step % 20_000 > 19_000 { 0.9 } else { 0.3 };
        correlated = 0.905 * correlated + 0.425 * sigma * normal();
        let shift = if step % 9000 > 8700 { 1.5 } else { 0.0 };
        let radio = (correlated + shift + 0.01 * normal()) as f32;
        let s = single.step(&Reading::good(radio), &Reading::good(0.0), 1);
        let d = double.step(&Reading::good(radio.into()), &Reading::good(0.0), 1);
        probability = probability.max((f64::from(s.p_fault) - d.p_fault).abs());
        verdicts += u32::from(s.verdict != d.verdict);
    }
    let line = |quantity, single, bar| Line {
        part: "health, 10 days",
        quantity,
        single,
        double: None,
        bar: Some(bar),
        flies: "single",
    };
    vec![
        line("probability of a fault", probability, 1e-2),
        line("share of steps with another verdict", f64::from(verdicts) / f64::from(10 * DAY), 1e-4),
    ]
}
