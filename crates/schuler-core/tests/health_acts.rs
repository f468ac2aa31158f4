//! What the health monitor's verdict does for the filter: the same flights with 500 faults of the radio, with the verdict used by
//! nothing and with the measurement weighted and withheld by it.
//!
//! `SCHULER_RECORD=DIRECTORY cargo test -p schuler-core --test health_acts` writes what came of it there, with date, commit and
//! machine.
use std::fmt::Write as _;
use std::process::Command;

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;
use schuler_core::health::{HealthConfig, MemoryModel, Verdict};
use schuler_core::identification::Method;
use schuler_core::module::{FlightModule, ModuleConfig, RadioUse, Status, StepInput};
use schuler_core::reading::Reading;

const SEED: u64 = 49_001;
const FLIGHTS: u64 = 500;
/// Steps of 1 s before the fault, in it, and after it.
const BEFORE: usize = 600;
const FAULT: usize = 120;
const AFTER: usize = 180;

/// True errors of the radio: white and correlated, m/s, and its resolution.
const WHITE: f64 = 0.1;
const CORRELATED: f64 = 0.05;
const CORRELATION_S: f64 = 10.0;
const RESOLUTION: f64 = 0.01;

/// What happens to the radio.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    /// Its mean shifts, by 0.3 to 3 m/s.
    Jump,
    /// Its noise grows tenfold.
    Noise,
    /// It holds its last value.
    Memory,
    /// Its mean shifts by 30 to 300 m/s, beyond what the monitor knows of.
    Wild,
}

const FAULTS: [(Fault, &str); 4] =
    [(Fault::Jump, "jump"), (Fault::Noise, "noise"), (Fault::Memory, "memory"), (Fault::Wild, "wild")];

fn config(radio_use: Option<RadioUse>) -> ModuleConfig {
    let mut health = HealthConfig::doppler_against_inertial();
    health.radio.tau_s = 10.0;
    health.radio.sigma = [0.06, 0.6];
    health.jump.sigma = 1.0;
    health.residual_sigma = 0.1;
    // The inertial error is the filter's ΔV: driven by the accelerometer's error of 10⁻³ m/s² in a minute.
    health.inertial.initial_sigma = 0.2;
    health.inertial.drift_sigma = 1.5e-3;
    health.inertial.drift_random_walk = 1.8e-4;
    health.inertial.bound = 50.0;
    health.memory = radio_use.map(|_| MemoryModel { repeat: 0.05, fail: 1.0 / 1800.0, recover: 1.0 / 120.0 });
    let mut config = ModuleConfig { health: Some(health), radio_use, ..ModuleConfig::default() };
    config.identification.method = Method::Off;
    config
}

/// A vehicle, its inertial system and its radio.
struct Plant {
    random: Pcg64,
    /// ΔV, δ, a, ω.
    errors: [f64; 4],
    /// True velocity about its mean, m/s.
    velocity: f64,
    /// Correlated error of the radio, m/s.
    radio: f64,
}

impl Plant {
    fn new(seed: u64) -> Self {
        let mut plant =
            Self { random: Pcg64::seed_from_u64(seed), errors: [0.0; 4], velocity: 0.0, radio: 0.0 };
        let filter = ModuleConfig::default().filter;
        let sigma = [
            filter.initial_velocity_sigma,
            filter.initial_vertical_sigma,
            filter.accelerometer.sigma,
            filter.gyro.sigma,
        ];
        plant.errors = sigma.map(|sigma| f64::from(sigma) * plant.normal());
        plant.radio = CORRELATED * plant.normal();
        plant
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let fraction = 0.5 * libm::erfc(-self.normal() / std::f64::consts::SQRT_2);
        low + (high - low) * fraction
    }

    fn markov(&mut self, x: f64, sigma: f64, tau_s: f64, dt: f64) -> f64 {
        let f = (-dt / tau_s).exp();
        f * x + sigma * (1.0 - f * f).sqrt() * self.normal()
    }

    /// One second on: inertial velocity and error of the radio, m/s.
    fn step(&mut self) -> (f64, f64) {
        let filter = ModuleConfig::default().filter;
        let (g, r) = (f64::from(filter.gravity), f64::from(filter.radius_m));
        for _ in 0..4 {
            let [v, d, a, w] = self.errors;
            let a = self.markov(
                a,
                f64::from(filter.accelerometer.sigma),
                f64::from(filter.accelerometer.tau_s),
                0.25,
            );
            let w = self.markov(w, f64::from(filter.gyro.sigma), f64::from(filter.gyro.tau_s), 0.25);
            let v = v + 0.25 * (a - g * d);
            self.errors = [v, d + 0.25 * (v / r + w), a, w];
        }
        self.velocity = self.markov(self.velocity, 5.0, 100.0, 1.0);
        self.radio = self.markov(self.radio, CORRELATED, CORRELATION_S, 1.0);
        let white = WHITE * self.normal();
        (100.0 + self.velocity + self.errors[0], self.radio + white)
    }
}

/// What came of flights with one kind of fault.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    flights: u32,
    /// Sum of the normalised squared errors of the tilt from the fault on, and their number.
    nees: f64,
    /// Sum of the squared errors of the tilt in the same steps, rad².
    square: f64,
    steps: u32,
    /// Flights in which the fault was told (by an alarm, or withholding), and the sum of the delays, steps.
    told: u32,
    delay: u32,
    /// Measurements withheld before the fault, of so many.
    false_withheld: u32,
    healthy: u32,
    /// Times that the filter started from a faulty radio.
    reacquired: u32,
}

impl Score {
    fn plus(&self, other: &Self) -> Self {
        Self {
            flights: self.flights + other.flights,
            nees: self.nees + other.nees,
            square: self.square + other.square,
            steps: self.steps + other.steps,
            told: self.told + other.told,
            delay: self.delay + other.delay,
            false_withheld: self.false_withheld + other.false_withheld,
            healthy: self.healthy + other.healthy,
            reacquired: self.reacquired + other.reacquired,
        }
    }

    fn mean_nees(&self) -> f64 {
        self.nees / f64::from(self.steps)
    }

    /// Of the tilt, seconds of arc.
    fn rms_arc_s(&self) -> f64 {
        (self.square / f64::from(self.steps)).sqrt() * 206_264.8
    }

    fn mean_delay_s(&self) -> f64 {
        f64::from(self.delay) / f64::from(self.told.max(1))
    }

    fn false_share(&self) -> f64 {
        f64::from(self.false_withheld) / f64::from(self.healthy)
    }
}

fn fly(fault: Fault, seed: u64, module: &mut FlightModule, acts: bool) -> Score {
    module.configure(&config(acts.then_some(RadioUse::DEFAULT))).unwrap();
    let mut plant = Plant::new(seed);
    let size = plant.uniform(0.3, 3.0);
    let sign = plant.normal().signum();
    let mut score = Score { flights: 1, ..Score::default() };
    let (mut held, mut told) = (0.0, false);
    for k in 0..BEFORE + FAULT + AFTER {
        let (inertial, mut error) = plant.step();
        let in_fault = (BEFORE..BEFORE + FAULT).contains(&k);
        match fault {
            Fault::Jump if in_fault => error += sign * size,
            Fault::Wild if in_fault => error += sign * 100.0 * size,
            Fault::Noise if in_fault => error *= 10.0,
            _ => (),
        }
        let read = ((100.0 + plant.velocity + error) / RESOLUTION).round() * RESOLUTION;
        held = if in_fault && fault == Fault::Memory { held } else { read };
        let output = module.step(&StepInput {
            velocity_error: Reading::good((inertial - held) as f32),
            radio_velocity: Reading::good(held as f32),
            inertial_velocity: Reading::good(inertial as f32),
            ..StepInput::without_readings(1000 * (k as u64 + 1))
        });
        let withheld = output.status.contains(Status::VELOCITY_WITHHELD);
        if k < BEFORE {
            score.healthy += 1;
            score.false_withheld += u32::from(withheld);
            continue;
        }
        let verdict = output.health.verdict;
        if in_fault && !told && (withheld || !matches!(verdict, Verdict::Nominal | Verdict::Unobserved)) {
            told = true;
            score.told += 1;
            score.delay += (k - BEFORE) as u32;
        }
        score.reacquired += u32::from(in_fault && output.status.contains(Status::VELOCITY_REACQUIRED));
        let away = f64::from(output.filter.estimate[1]) - plant.errors[1];
        score.nees += (away / f64::from(output.filter.sigma[1])).powi(2);
        score.square += away * away;
        score.steps += 1;
    }
    score
}

/// Scores of all kinds of fault, on two threads.
fn scores(acts: bool) -> [Score; 4] {
    let half = |first: u64| {
        let mut module = Box::new(FlightModule::new());
        let mut scores = [Score::default(); 4];
        for flight in (first..FLIGHTS).step_by(2) {
            let kind = (flight / 2 % 4) as usize;
            let score = fly(FAULTS[kind].0, SEED + flight, &mut module, acts);
            scores[kind] = scores[kind].plus(&score);
        }
        scores
    };
    std::thread::scope(|scope| {
        let other = scope.spawn(|| half(1));
        let mine = half(0);
        let other = other.join().unwrap();
        std::array::from_fn(|kind| mine[kind].plus(&other[kind]))
    })
}

fn all(scores: &[Score; 4]) -> Score {
    scores.iter().fold(Score::default(), |sum, score| sum.plus(score))
}

/// The record's tables.
fn record(before: &[Score; 4], after: &[Score; 4]) -> String {
    let mut text = String::new();
    for (when, scores) in [("off", before), ("on", after)] {
        for ((_, name), score) in FAULTS.iter().zip(scores).chain([(&(Fault::Jump, "all"), &all(scores))]) {
            let _ = write!(
                text,
                "\n[{when}.{name}]\nflights = {}\nnees_tilt = {:.2}\nrms_tilt_arc_s = {:.1}\ntold = {}\nmean_delay_s = {:.2}\n\
                 reacquired_from_faulty = {}\nwithheld_while_healthy = {}\nhealthy_steps = {}\n",
                score.flights,
                score.mean_nees(),
                score.rms_arc_s(),
                score.told,
                score.mean_delay_s(),
                score.reacquired,
                score.false_withheld,
                score.healthy
            );
        }
    }
    text
}

fn told_by(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output();
    output.map(|it| String::from_utf8_lossy(&it.stdout).trim().to_owned()).unwrap_or_default()
}

#[test]
fn a_faulty_radio_is_withheld_from_the_filter() {
    let (before, after) = (scores(false), scores(true));
    let text = record(&before, &after);
    println!("{text}");
    if let Some(directory) = std::env::var_os("SCHULER_RECORD") {
        let date = told_by("date", &["-u", "+%Y-%m-%d"]);
        let head = format!(
            "# What the health monitor's verdict does for the filter: test `health_acts` of schuler-core.\n\
             date = {date}\ncommit = \"{}\"\nseed = {SEED}\nmachine = \"{}\"\nflights = {FLIGHTS}\n",
            told_by("git", &["rev-parse", "--short=12", "HEAD"]),
            told_by("uname", &["-srm"]),
        );
        let path = std::path::Path::new(&directory).join(format!("{date}-health-acts.toml"));
        std::fs::write(path, head + &text).unwrap();
    }
    for ((_, name), (off, on)) in FAULTS.iter().zip(before.iter().zip(&after)) {
        assert_eq!(off.false_withheld, 0, "{name}: off withholds nothing");
        assert!(on.reacquired == 0, "{name}: started {} times from a faulty radio", on.reacquired);
        assert!(on.rms_arc_s() < off.rms_arc_s(), "{name}");
        assert!(on.told * 100 >= on.flights * 99, "{name}: {} of {} told", on.told, on.flights);
        assert!(on.mean_delay_s() < 2.0, "{name}: {:.1} s", on.mean_delay_s());
    }
    let (off, on) = (all(&before), all(&after));
    // As consistent as without a fault, and ten times as good as with one that is followed.
    assert!((0.8..1.3).contains(&on.mean_nees()), "{}", on.mean_nees());
    assert!(on.rms_arc_s() < 0.1 * off.rms_arc_s(), "{} against {}", on.rms_arc_s(), off.rms_arc_s());
    assert!(on.false_share() < 0.01, "{}", on.false_share());
}
