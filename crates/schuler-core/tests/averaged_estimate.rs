//! The averaged estimate is a number with an honest sigma, or the filter's: over flights whose inputs are spoilt in every
//! structured way that makes banks of filters fail.
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng;
use schuler_core::identification::EstimateSource;
use schuler_core::module::{FlightModule, ModuleConfig, Status, StepInput, StepOutput};
use schuler_core::reading::Reading;

/// Fractions of a second in which the truth is integrated.
const FINE: u32 = 20;

/// The single channel by itself: true [ΔV, δ, a, ω], and a measurement a second.
struct Plant {
    state: [f64; 4],
    random: Pcg64,
}

/// Of [ΔV, δ, a, ω] at the start: m/s, rad, m/s², rad/s.
fn prior_sigma() -> [f32; 4] {
    let config = ModuleConfig::default().filter;
    let initial = [config.initial_velocity_sigma, config.initial_vertical_sigma];
    [initial[0], initial[1], config.accelerometer.sigma, config.gyro.sigma]
}

impl Plant {
    fn new(seed: u64) -> Self {
        let mut plant = Self { state: [0.0; 4], random: Pcg64::seed_from_u64(seed) };
        plant.state = prior_sigma().map(|sigma| f64::from(sigma) * plant.normal());
        plant
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    /// One second on; the measured velocity error, m/s.
    fn step(&mut self) -> f64 {
        let config = ModuleConfig::default().filter;
        let (g, r) = (f64::from(config.gravity), f64::from(config.radius_m));
        let dt = 1.0 / f64::from(FINE);
        for _ in 0..FINE {
            let [v, d, a, w] = self.state;
            let mut driven = |x: f64, sigma: f32, tau_s: f32| {
                let f = (-dt / f64::from(tau_s)).exp();
                f * x + f64::from(sigma) * (1.0 - f * f).sqrt() * self.normal()
            };
            let next_a = driven(a, config.accelerometer.sigma, config.accelerometer.tau_s);
            let next_w = driven(w, config.gyro.sigma, config.gyro.tau_s);
            let v = v + dt * (a - g * d);
            self.state = [v, d + dt * (v / r + w), next_a, next_w];
        }
        self.state[0] + f64::from(config.velocity_noise) * self.normal()
    }
}

/// What is done to the inputs from some step on.
#[derive(Clone, Copy, Debug)]
enum Spoilt {
    /// So many readings off by so much, m/s, the sign as it comes or alternating.
    Off { steps: u32, by: f64, alternating: bool },
    /// So many readings that are no number.
    NaN { steps: u32 },
    /// So many readings missing.
    Missing { steps: u32 },
    /// The module is not called for so many seconds.
    Silence { seconds: u32 },
    /// The clock jumps forward while no time passes, milliseconds.
    Jump { ms: u64 },
    /// The clock runs backwards for so many steps.
    Backwards { steps: u32 },
}

fn spoilt() -> impl Strategy<Value = Spoilt> {
    let by = prop::sample::select(vec![100.0, -100.0, 3.0, 999.0, -0.8]);
    prop_oneof![
        (1..40u32, by, any::<bool>()).prop_map(|(steps, by, alternating)| Spoilt::Off {
            steps,
            by,
            alternating
        }),
        (1..200u32).prop_map(|steps| Spoilt::NaN { steps }),
        (1..200u32).prop_map(|steps| Spoilt::Missing { steps }),
        prop::sample::select(vec![1, 9, 10, 11, 599, 600]).prop_map(|seconds| Spoilt::Silence { seconds }),
        prop::sample::select(vec![601_000, 10_000_000, u64::MAX / 4]).prop_map(|ms| Spoilt::Jump { ms }),
        (1..30u32).prop_map(|steps| Spoilt::Backwards { steps }),
    ]
}

/// Flags of a step whose reading the filter did not take in.
const LEFT_OUT: Status = Status::VELOCITY_MISSING
    .union(Status::VELOCITY_SATURATED)
    .union(Status::INNOVATION_GATED)
    .union(Status::CLOCK_BACKWARDS);

/// Correlation times of the accelerometer error after which a tilt that a wrong reading has left
/// behind is gone: until then the filter cannot tell one from the other.
const SETTLING_TAUS: f32 = 5.0;

/// Place of the error of the gyro among the states.
const GYRO: usize = 3;

/// Steps in which an estimate is excused after the filter has taken in a wrong reading. There is no
/// other excuse: readings that are missing, gated or lost with the clock make an estimate less
/// certain, never wrong.
fn settling() -> u32 {
    let config = ModuleConfig::default().filter;
    (SETTLING_TAUS * config.accelerometer.tau_s / config.step_s) as u32
}

/// A flight with a clock, and what excuses its estimates.
struct Flown {
    module: Box<FlightModule>,
    plant: Plant,
    time_ms: u64,
    /// Steps for which the estimates are still excused.
    excused: u32,
    /// Whether the filter has ever taken in a wrong reading: what that has left in the error of the gyro is there for its correlation
    /// time, which is hours.
    was_misled: bool,
    sources: Vec<EstimateSource>,
}

impl Flown {
    fn new(seed: u64) -> Self {
        let mut module = Box::new(FlightModule::new());
        module.configure(&ModuleConfig::default()).unwrap();
        Self {
            module,
            plant: Plant::new(seed),
            time_ms: 0,
            excused: 0,
            was_misled: false,
            sources: Vec::new(),
        }
    }

    fn step(&mut self, forward_ms: i64, spoil: impl FnOnce(f64) -> Reading<f32>) {
        self.step_off(forward_ms, 0.0, spoil);
    }

    /// A step whose reading is `off` by so much.
    fn step_off(&mut self, forward_ms: i64, off: f64, spoil: impl FnOnce(f64) -> Reading<f32>) {
        let measured = self.plant.step() + off;
        self.time_ms = self.time_ms.saturating_add_signed(forward_ms);
        let input =
            StepInput { velocity_error: spoil(measured), ..StepInput::without_readings(self.time_ms) };
        let output = self.module.step(&input);
        let status = output.status;
        let started = status.contains(Status::VELOCITY_REACQUIRED);
        let misled = off != 0.0 && (started || !status.intersects(LEFT_OUT));
        // One that follows wrong readings leaves out the right ones, until it starts from one of them.
        let follows = self.excused > 0 && (started || status.contains(Status::INNOVATION_GATED));
        self.excused = if misled || follows { settling() } else { self.excused.saturating_sub(1) };
        self.was_misled |= misled;
        self.check(&output);
        self.sources.push(output.identification.averaged.source);
    }

    fn good(&mut self, steps: u32) {
        for _ in 0..steps {
            self.step(1000, |measured| Reading::good(measured as f32));
        }
    }

    fn suffer(&mut self, spoilt: Spoilt) {
        match spoilt {
            Spoilt::Off { steps, by, alternating } => {
                for k in 0..steps {
                    let by = if alternating && k % 2 == 1 { -by } else { by };
                    self.step_off(1000, by, |measured| Reading::good(measured as f32));
                }
            }
            Spoilt::NaN { steps } => (0..steps).for_each(|_| self.step(1000, |_| Reading::good(f32::NAN))),
            Spoilt::Missing { steps } => {
                (0..steps).for_each(|_| self.step(1000, |_| Reading::missing()));
            }
            Spoilt::Silence { seconds } => {
                for _ in 0..seconds {
                    self.plant.step();
                }
                self.step(1000 * (i64::from(seconds) + 1), |measured| Reading::good(measured as f32));
            }
            Spoilt::Jump { ms } => {
                self.time_ms = self.time_ms.saturating_add(ms);
                self.step(0, |measured| Reading::good(measured as f32));
            }
            Spoilt::Backwards { steps } => {
                for _ in 0..steps {
                    self.step(-1000, |measured| Reading::good(measured as f32));
                }
            }
        }
    }

    fn check(&self, output: &StepOutput) {
        let averaged = &output.identification.averaged;
        let filter = &output.filter;
        let prior = prior_sigma();
        for (name, estimate, sigma) in
            [("averaged", averaged.estimate, averaged.sigma), ("filter", filter.estimate, filter.sigma)]
        {
            for (i, (estimate, truth)) in estimate.iter().zip(self.plant.state).enumerate() {
                let step = output.step;
                let is_excused = self.excused > 0 || (i == GYRO && self.was_misled);
                assert!(
                    estimate.is_finite() && sigma[i].is_finite() && sigma[i] > 0.0,
                    "{name} {step}: {output:?}"
                );
                // The filter here knows the noise as it is. A bank has learnt it in minutes, to a
                // factor of two or three, and so its sigma is off by as much.
                let known = filter.sigma[i].min(prior[i]);
                assert!(sigma[i] > 0.1 * known || is_excused, "{name} {step}: {output:?}");
                let error = (f64::from(*estimate) - truth).abs() / f64::from(sigma[i].max(known));
                assert!(
                    error < 6.0 || is_excused,
                    "{name} is {error:.1} sigma off at step {step}: {averaged:?}, {filter:?}, truth {:?}, {:?}",
                    self.plant.state,
                    output.status
                );
            }
        }
        if averaged.source == EstimateSource::Filter {
            assert_eq!((averaged.estimate, averaged.sigma), (filter.estimate, filter.sigma));
        }
    }
}

#[test]
fn until_the_bank_speaks_the_filter_does() {
    let mut flown = Flown::new(1);
    flown.good(60);
    let first = flown.sources.iter().position(|&source| source == EstimateSource::WideBank).unwrap();
    assert!((10..30).contains(&first), "{first}");
    assert!(flown.sources[first..].iter().all(|&source| source == EstimateSource::WideBank));
    // The same after a jump of the clock, from the step of the jump on.
    flown.suffer(Spoilt::Jump { ms: 10_000_000 });
    flown.good(60);
    let after = &flown.sources[60..];
    assert_eq!(after.iter().position(|&source| source == EstimateSource::WideBank), Some(first));
    assert!(after[..first].iter().all(|&source| source == EstimateSource::Filter));
}

/// The reading is off by 100 m/s for so long that the filter starts from it, and then comes back.
#[test]
fn the_banks_start_again_where_the_filter_does() {
    for (steps, alternating) in [(9, false), (10, false), (25, false), (25, true), (300, true)] {
        for by in [100.0, -100.0, 900.0] {
            let mut flown = Flown::new(2);
            flown.good(305);
            flown.suffer(Spoilt::Off { steps, by, alternating });
            flown.good(1500);
            assert_eq!(flown.excused, 0, "{steps} {by}");
            assert_eq!(flown.sources.last(), Some(&EstimateSource::WideBank));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(40) })]

    #[test]
    fn no_estimate_has_a_sigma_of_zero_or_is_six_of_them_off(
        seed in any::<u64>(),
        events in prop::collection::vec((1..400u32, spoilt()), 1..6),
    ) {
        let mut flown = Flown::new(seed);
        for (before, event) in events {
            flown.good(before);
            flown.suffer(event);
        }
        flown.good(500);
    }
}
