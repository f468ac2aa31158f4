//! A module that was brought back from a saved state goes on as if it had never stopped, and what is not its state is refused.
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::SeedableRng;
use schuler_core::compensation::{Block, Factor, Quantity, Target, Term};
use schuler_core::filter::MarkovNoise;
use schuler_core::health::HealthConfig;
use schuler_core::identification::Method;
use schuler_core::isolation::Verdict;
use schuler_core::module::{
    Command, FlightModule, ModuleConfig, STATE_VERSION, StateError, StateLoader, Status, StepInput,
    StepOutput,
};
use schuler_core::reading::{Quality, Reading};
use schuler_core::thermal::TemperatureRateConfig;

/// Everything on, and an identification as early as there can be one.
fn config(method: Method) -> ModuleConfig {
    let mut config = ModuleConfig {
        thermometers: [Some(TemperatureRateConfig::of_quantum(0.0625)); 4],
        health: Some(HealthConfig::doppler_against_inertial()),
        ..ModuleConfig::default()
    };
    config.identification.method = method;
    config.identification.first_s = 5000.0;
    config.identification.interval_s = 3000.0;
    config.filter.accelerometer = MarkovNoise { sigma: 3e-3, tau_s: 120.0 };
    config
}

fn block() -> Block {
    let term = |target, coefficient, quantity| Term {
        target,
        coefficient,
        factors: [Factor { quantity, reference: 20.0, power: 1 }, Factor::default()],
    };
    Block {
        terms: [
            term(Target::Gyro(1), 1e-8, Quantity::Temperature(0)),
            term(Target::LoopAccelerometer, 1e-5, Quantity::Temperature(1)),
        ]
        .into_iter()
        .collect(),
        ..Block::default()
    }
}

/// A flight in which something is always wrong: gaps, missing and wild readings, a gyro that fails for a while, a clock that
/// jumps, radio jumps. It can be taken up at any step.
#[derive(Clone)]
struct Flight {
    random: Pcg32,
    step: u64,
    time_ms: u64,
    velocity: f64,
    vertical: f64,
    accelerometer: [f64; 2],
}

impl Flight {
    fn new(seed: u64) -> Self {
        Self {
            random: Pcg32::seed_from_u64(seed),
            step: 0,
            time_ms: 0,
            velocity: 0.2,
            vertical: 1e-5,
            accelerometer: [0.0; 2],
        }
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    fn next(&mut self) -> StepInput {
        self.step += 1;
        let k = self.step;
        self.time_ms += match k % 1500 {
            700 => 37_000,
            1100 => 0,
            1101 => 500,
            _ if k == 5_000 => 5_000_000,
            _ => 1000,
        };
        // The accelerometer's error swings, so that six states are tried and sometimes taken.
        let [s, c] = self.accelerometer;
        let (decay, turn) = ((-1.0f64 / 800.0).exp(), std::f64::consts::TAU / 900.0);
        let drive = 2e-3 * (2.0f64 / 800.0).sqrt();
        self.accelerometer = [
            decay * (s * turn.cos() - c * turn.sin()) + drive * self.normal(),
            decay * (s * turn.sin() + c * turn.cos()) + drive * self.normal(),
        ];
        self.velocity += -9.8 * self.vertical + self.accelerometer[0];
        self.vertical += self.velocity / 6.371e6 + 1e-9 * self.normal();
        let mut velocity = Reading::good((self.velocity + 0.1 * self.normal()) as f32);
        match k % 977 {
            100..140 => velocity = Reading::missing(),
            200..203 => velocity.value = f32::NAN,
            300..312 => velocity.value += 40.0,
            400..410 => velocity.quality = Quality::Saturated,
            _ => (),
        }
        let axes = ModuleConfig::default().isolation.axes;
        let rate = [1e-5, -2e-5, 7e-5];
        let mut gyros = axes.map(|axis| {
            let along: f64 = axis.iter().zip(rate).map(|(a, w)| a * w).sum();
            Reading::good(along + 1e-7 * self.normal())
        });
        match k % 4000 {
            2000..2600 => gyros[2].value += 2e-6,
            3000..3010 => gyros[4].value = f64::NAN,
            3500..3520 => gyros[1].quality = Quality::Missing,
            _ => (),
        }
        let temperature = 20.0 + 10.0 * (k as f64 / 3000.0).sin();
        let mut thermometers: [_; 4] = std::array::from_fn(|place| {
            Reading::good((((temperature + place as f64) * 16.0).round() / 16.0) as f32)
        });
        if k % 1200 > 1000 {
            thermometers[3] = Reading::missing();
        }
        let jump = if k % 2500 > 2300 { 3.0 } else { 0.0 };
        let radio = self.velocity + jump + 0.2 * self.normal();
        StepInput {
            time_ms: self.time_ms,
            velocity_error: velocity,
            gyros,
            accelerometers: [0.1, -0.2, -9.8].map(Reading::good),
            thermometers,
            radio_velocity: Reading::good(radio as f32),
            inertial_velocity: Reading::good(self.velocity as f32),
            command: if k % 4000 == 2900 { Command::ReadmitGyro(2) } else { Command::None },
        }
    }
}

fn module(config: &ModuleConfig) -> Box<FlightModule> {
    let mut module = Box::new(FlightModule::new());
    module.configure(config).unwrap();
    module
}

fn save(module: &mut FlightModule) -> Vec<u8> {
    let mut bytes = vec![0; module.state_length().unwrap() as usize];
    assert_eq!(module.save(&mut bytes), Ok(bytes.len()));
    bytes
}

/// Flies on with the original and with one that was brought back, configured before or not: the same outputs, and the same state at the end.
fn assert_goes_on(original: &FlightModule, flight: &Flight, config: &ModuleConfig, steps: usize) {
    let mut original = Box::new(*original);
    let mut flight = flight.clone();
    let bytes = save(&mut original);
    let mut other =
        if flight.step.is_multiple_of(2) { module(config) } else { Box::new(FlightModule::new()) };
    other.restore(&bytes).unwrap();
    assert_eq!(save(&mut other), bytes, "what comes back is what was saved");
    assert_eq!((other.steps(), other.last_time_ms()), (original.steps(), original.last_time_ms()));
    for _ in 0..steps {
        let input = flight.next();
        assert_eq!(other.step(&input), original.step(&input), "step {}", flight.step);
    }
    assert!(save(&mut other) == save(&mut original), "the states have drifted apart");
}

/// What a flight has led through, of what a state can be in the midst of.
#[derive(Default, Debug)]
struct Seen {
    status: Status,
    retunes: u16,
    faults: bool,
    undecided: bool,
}

impl Seen {
    fn add(&mut self, output: &StepOutput) {
        self.status |= output.status;
        self.retunes = output.identification.retunes;
        self.faults |= matches!(output.isolation.verdict, Verdict::Fault(_));
        self.undecided |= output.isolation.verdict == Verdict::DetectedNotIsolated;
    }
}

/// Saved and brought back at some three hundred moments of a flight: at random ones, and every few steps where the
/// identification is at work. Every moment is mid-window for one part or another.
fn at_any_moment(method: Method, steps: u64) -> Seen {
    let config = config(method);
    let mut original = module(&config);
    let mut flight = Flight::new(5);
    let mut seen = Seen::default();
    for k in 0..steps {
        let output = original.step(&flight.next());
        seen.add(&output);
        if k == 3000 {
            original.load_compensation(&block()).unwrap();
            original.name_compensation(77);
        }
        if k % 211 == 17 || seen.status.contains(Status::RETUNED) && k % 499 < 3 {
            assert_goes_on(&original, &flight, &config, 30);
        }
    }
    assert_goes_on(&original, &flight, &config, 3000);
    assert_eq!(original.compensation_name(), Some(77));
    seen
}

#[test]
fn a_module_brought_back_goes_on_at_any_moment() {
    let seen = at_any_moment(Method::Likelihood, 36_000);
    let expected = Status::STEPS_MISSING
        | Status::CLOCK_BACKWARDS
        | Status::CLOCK_JUMPED
        | Status::INNOVATION_GATED
        | Status::VELOCITY_REACQUIRED
        | Status::RETUNED
        | Status::COMPENSATION_LOADED;
    assert!(seen.status.contains(expected), "{seen:?}");
    assert!(seen.faults && seen.undecided, "{seen:?}");
}

#[test]
fn a_module_brought_back_goes_on_with_the_published_loop_and_without_any() {
    assert!(at_any_moment(Method::Published, 12_000).retunes > 0);
    at_any_moment(Method::Off, 4_000);
}

/// An outage is a gap: what the time of the next input shows, and nothing else, tells the two modules apart.
#[test]
fn an_outage_is_bridged_like_any_other_gap() {
    let config = config(Method::Likelihood);
    for (outage_ms, expected) in
        [(1000, Status::empty()), (8000, Status::STEPS_MISSING), (3_000_000, Status::CLOCK_JUMPED)]
    {
        let mut original = module(&config);
        let mut flight = Flight::new(1);
        for _ in 0..650 {
            original.step(&flight.next());
        }
        let bytes = save(&mut original);
        let mut other = module(&config);
        other.restore(&bytes).unwrap();
        let input = StepInput { time_ms: flight.time_ms + outage_ms, ..flight.next() };
        let (one, two) = (other.step(&input), original.step(&input));
        assert_eq!(one, two);
        let clock = Status::STEPS_MISSING | Status::CLOCK_JUMPED | Status::CLOCK_BACKWARDS;
        assert_eq!(one.status & clock, expected);
        assert_eq!(one.step, 651);
    }
}

#[test]
fn what_is_not_the_state_of_this_module_is_refused_and_changes_nothing() {
    let config = config(Method::Likelihood);
    let mut saved = module(&config);
    let mut flight = Flight::new(2);
    for _ in 0..500 {
        saved.step(&flight.next());
    }
    let bytes = save(&mut saved);
    println!("{} bytes", bytes.len());

    assert_eq!(FlightModule::new().save(&mut [0; 8]), Err(StateError::NotConfigured));
    assert_eq!(saved.save(&mut vec![0; bytes.len() - 1]), Err(StateError::Room));

    let mut target = module(&config);
    target.step(&flight.next());
    let before = save(&mut target);
    let mut refuses = |bytes: &[u8], why: StateError| {
        assert_eq!(target.restore(bytes), Err(why));
        assert!(save(&mut target) == before, "changed by a state that was refused");
    };
    for at in (0..bytes.len()).step_by(97).chain(0..16) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x20;
        let form = at < 4 || (8..12).contains(&at);
        refuses(&damaged, if form { StateError::Form } else { StateError::Checksum });
        refuses(&bytes[..at], StateError::Form);
    }
    refuses(&[&bytes[..], &[0]].concat(), StateError::Form);

    let sealed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = bytes[..bytes.len() - 4].to_vec();
        change(&mut bytes);
        let checksum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes);
        bytes.extend(checksum.to_le_bytes());
        bytes
    };
    assert!(sealed(&|_| ()) == bytes, "the checksum is zlib's");
    let version = (STATE_VERSION + 1).to_le_bytes();
    refuses(&sealed(&|bytes| bytes[4..8].copy_from_slice(&version)), StateError::Version(STATE_VERSION + 1));
    refuses(&sealed(&|bytes| bytes[12] ^= 1), StateError::Configuration);
    let mut other = config;
    other.filter.velocity_noise *= 1.5;
    refuses(&save(&mut module(&other)), StateError::Configuration);
    // Another length, too.
    other.identification.method = Method::Off;
    refuses(&save(&mut module(&other)), StateError::Configuration);

    // A truth value that is neither: somebody's work, found when the module has forgotten what it was.
    let last = bytes.len() - 5;
    let impossible = |at: usize| sealed(&|bytes| bytes[at] = 0xee);
    let tag = (0..last).rev().find(|at| module(&config).restore(&impossible(*at)).is_err()).unwrap();
    // Cut anywhere, also where another value would begin.
    let cuts = (0..100).map(|cut| sealed(&|bytes| bytes.truncate(last - cut)));
    for mut wrong in cuts.chain([impossible(tag), sealed(&|bytes| bytes.push(0))]) {
        let length = (wrong.len() as u32).to_le_bytes();
        wrong[8..12].copy_from_slice(&length);
        let body = wrong.len() - 4;
        let checksum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&wrong[..body]);
        wrong[body..].copy_from_slice(&checksum.to_le_bytes());
        assert!(target.restore(&wrong).is_err());
        assert_eq!(target.step(&flight.next()).status, Status::NOT_CONFIGURED);
        assert_eq!(target.state_length(), Err(StateError::NotConfigured));
        assert_eq!(target.restore(&bytes), Ok(()));
        assert!(save(&mut target) == bytes);
    }

    // Told to forget its configuration, a module takes one of another.
    target.forget();
    assert_eq!(target.step(&flight.next()).status, Status::NOT_CONFIGURED);
    let another = save(&mut module(&other));
    assert_eq!(target.restore(&another), Ok(()));
    assert!(save(&mut target) == another);
}

/// In parts of any size, as over the link: the same bytes, and the same module.
#[test]
fn parts_of_any_size_make_the_whole() {
    let config = config(Method::Likelihood);
    let mut original = module(&config);
    let mut flight = Flight::new(3);
    for _ in 0..777 {
        original.step(&flight.next());
    }
    let bytes = save(&mut original);
    for size in [16, 17, 29, 512, 100_000] {
        let mut whole = Vec::new();
        let mut part = vec![0; size];
        loop {
            match original.save_part(whole.len() as u32, &mut part).unwrap() {
                0 => break,
                written => whole.extend_from_slice(&part[..written]),
            }
        }
        assert!(whole == bytes, "in parts of {size}");

        let mut target = Box::new(FlightModule::new());
        let mut loader = StateLoader::new();
        let mut begin = 0;
        while begin < bytes.len() {
            let part = &bytes[begin..bytes.len().min(begin + size)];
            begin = loader.take(&mut target, begin as u32, part).unwrap() as usize;
            assert_eq!(target.state_length().is_ok(), begin == bytes.len(), "no step while it is not whole");
        }
        assert!(save(&mut target) == bytes);
        let input = flight.clone().next();
        assert_eq!(target.step(&input), original.clone().step(&input));
        assert_eq!(original.save_part(1, &mut part), Err(StateError::Place { next: 0 }));
    }
}

/// A first part that is not the begin of a state of this configuration, and a part out of its turn, change nothing; a state that
/// turns out wrong in a later part leaves a module that waits.
#[test]
fn a_state_in_parts_is_taken_in_its_order() {
    let config = config(Method::Off);
    let mut original = module(&config);
    let mut flight = Flight::new(4);
    for _ in 0..99 {
        original.step(&flight.next());
    }
    let bytes = save(&mut original);
    let mut target = module(&config);
    let before = save(&mut target);
    let mut loader = StateLoader::new();
    let damaged = |at: usize| {
        let mut damaged = bytes.clone();
        damaged[at] ^= 4;
        damaged
    };
    assert_eq!(loader.take(&mut target, 0, &bytes[..15]), Err(StateError::Form));
    assert_eq!(loader.take(&mut target, 0, &damaged(3)), Err(StateError::Form));
    assert_eq!(loader.take(&mut target, 0, &damaged(4)), Err(StateError::Version(STATE_VERSION ^ 4)));
    assert_eq!(loader.take(&mut target, 0, &damaged(12)), Err(StateError::Configuration));
    assert_eq!(loader.take(&mut target, 300, &bytes[300..]), Err(StateError::Place { next: 0 }));
    assert!(save(&mut target) == before);

    let next = loader.take(&mut target, 0, &bytes[..100]).unwrap();
    assert!((93..=100).contains(&next), "a value that is cut waits for the next part");
    assert_eq!(loader.take(&mut target, 300, &bytes[300..]), Err(StateError::Place { next }));
    assert_eq!(target.step(&flight.next()).status, Status::NOT_CONFIGURED);
    assert_eq!((target.steps(), target.last_time_ms()), (0, None));
    let length = bytes.len() as u32;
    assert_eq!(loader.take(&mut target, next, &bytes[next as usize..]), Ok(length));
    assert!(save(&mut target) == bytes);

    let longer = [&bytes[..], &[0]].concat();
    for (wrong, errors) in [
        (damaged(1000), [StateError::Checksum, StateError::Content]),
        (damaged(bytes.len() - 1), [StateError::Checksum; 2]),
        (damaged(8), [StateError::Checksum; 2]),
        (longer, [StateError::Form; 2]),
    ] {
        assert!(errors.contains(&loader.take(&mut target, 0, &wrong).unwrap_err()));
        assert_eq!(target.step(&flight.next()).status, Status::NOT_CONFIGURED);
        assert_eq!(target.save(&mut vec![0; 100_000]), Err(StateError::NotConfigured));
        assert_eq!(loader.take(&mut target, 0, &bytes), Ok(length));
        assert!(save(&mut target) == bytes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is fed to it, a module takes nothing but its own state, and goes on.
    #[test]
    fn garbage_is_refused(garbage in prop::collection::vec(any::<u8>(), 0..300), header in any::<bool>()) {
        let config = config(Method::Off);
        let mut target = module(&config);
        let mut bytes = save(&mut target);
        let begin = if header { 16 } else { 0 };
        for (slot, byte) in bytes[begin..].iter_mut().zip(&garbage) {
            *slot = *byte;
        }
        let same = bytes == save(&mut target);
        prop_assert_eq!(target.restore(&bytes).is_ok(), same);
        prop_assert!(target.step(&StepInput::without_readings(1000)).status.contains(Status::VELOCITY_MISSING));
    }
}
