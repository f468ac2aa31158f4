//! The whole step of the module, and what the main loop adds to it.
use core::hint::black_box;

use schuler_core::compensation::{Block, Calibration, Factor, Quantity, Target, Term};
use schuler_core::health::{HealthConfig, MemoryModel};
use schuler_core::identification::Method;
use schuler_core::module::{Command, FlightModule, ModuleConfig, RadioUse, StepInput, StepOutput};
use schuler_core::reading::{Quality, Reading};
use schuler_core::thermal::TemperatureRateConfig;
use schuler_link::endpoint::{Endpoint, Reaction};
use schuler_link::frame::{Decoder, Wire};
use schuler_link::message::{HostMessage, ModuleMessage};

use crate::channel::Velocity;
use crate::gyros::Gyros;
use crate::meter::{Meter, Random};
use crate::sensors::{Pair, Thermometer};

/// Steps of a flight, and of one in which the noise is identified twice over.
const STEPS: usize = 3000;
const LONG: usize = 9000;
/// The first identification is early, so that the flight need not be long.
const FIRST_S: f32 = 3000.0;
const INTERVAL_S: f32 = 3000.0;

/// Inputs of a flight with all that can go wrong in it.
struct Flight {
    time_ms: u64,
    velocity: Velocity,
    gyros: Gyros,
    thermometers: [Thermometer; 4],
    pair: Pair<f32>,
    /// Clocks run backwards, and jump.
    clocks: bool,
}

impl Flight {
    fn new(clocks: bool) -> Self {
        Self {
            time_ms: 0,
            velocity: Velocity::new(),
            gyros: Gyros::new(),
            thermometers: [20.0, 25.0, -30.0, 60.0].map(Thermometer::at),
            pair: Pair::new(),
            clocks,
        }
    }

    fn next(&mut self, random: &mut Random) -> StepInput {
        self.time_ms += 1000;
        let time_ms = match self.time_ms / 1000 % 2500 {
            _ if !self.clocks => self.time_ms,
            600 => self.time_ms - 3000,
            1300 => {
                self.time_ms += 20_000;
                self.time_ms
            }
            2400 => {
                self.time_ms += 700_000;
                self.time_ms
            }
            _ => self.time_ms,
        };
        let velocity_error = match self.velocity.next::<f32>(random) {
            Some(value) if random.once_in(100) => Reading { age_ms: 5000, ..Reading::good(value) },
            Some(value) => Reading::good(value),
            None => Reading::missing(),
        };
        let (gyros, command) = self.gyros.next(random);
        let command = command.map_or(Command::None, Command::ReadmitGyro);
        let accelerometers = [0.0, 0.0, 9.8].map(|gravity| {
            let reading = Reading::good(gravity + 0.1 * random.normal());
            if random.once_in(50) {
                Reading::missing()
            } else if random.once_in(100) {
                Reading { quality: Quality::Saturated, ..reading }
            } else if random.once_in(80) {
                Reading::good(f64::NAN)
            } else {
                reading
            }
        });
        self.pair.next(random);
        StepInput {
            time_ms,
            velocity_error,
            gyros,
            accelerometers,
            thermometers: self.thermometers.each_mut().map(|thermometer| thermometer.next(random).1),
            radio_velocity: self.pair.radio,
            inertial_velocity: self.pair.inertial,
            command,
        }
    }
}

struct Flying {
    module: &'static mut FlightModule,
    flight: Flight,
    input: StepInput,
    output: StepOutput,
}

/// The module with each method of identification; then through the link.
#[inline(never)]
pub fn count(
    meter: &mut Meter,
    module: &'static mut FlightModule,
    endpoint: &'static mut Endpoint,
    wire: &'static mut Wire,
) {
    let mut config = ModuleConfig::default();
    config.identification.first_s = FIRST_S;
    config.identification.interval_s = INTERVAL_S;
    config.thermometers = [Some(TemperatureRateConfig::of_quantum(1.0 / 16.0)); 4];
    let memory = Some(MemoryModel { repeat: 0.05, fail: 1.0 / 1800.0, recover: 1.0 / 120.0 });
    config.health = Some(HealthConfig { memory, ..HealthConfig::doppler_against_inertial() });
    config.radio_use = Some(RadioUse::DEFAULT);
    let mut flying = Flying {
        module,
        flight: Flight::new(true),
        input: StepInput::default(),
        output: StepOutput::default(),
    };

    let configure = |flying: &mut (&mut Flying, ModuleConfig)| {
        let _ = black_box(flying.0.module.configure(&flying.1));
    };
    meter.part("configuration", 4, (&mut flying, config), |_, _| (), configure);
    for (name, method, clocks, steps) in [
        ("module step, no identification", Method::Off, true, STEPS),
        ("module step, published loop", Method::Published, false, LONG),
        ("module step", Method::Likelihood, false, LONG),
        ("module step, clocks that jump", Method::Likelihood, true, STEPS),
    ] {
        config.identification.method = method;
        flying.flight = Flight::new(clocks);
        if flying.module.configure(&config).is_err() || !load(flying.module) {
            return;
        }
        meter.part(
            name,
            steps,
            &mut flying,
            |flying, random| flying.input = flying.flight.next(random),
            |flying| flying.output = flying.module.step(&flying.input),
        );
    }

    flying.flight = Flight::new(true);
    if flying.module.configure(&config).is_err() {
        return;
    }
    endpoint.take_up(flying.module);
    let mut host = Host { flying, endpoint, wire, sequence: 0 };
    host.greet();
    meter.part("main loop: a frame with a step, its answer", STEPS, host, Host::prepare, Host::run);
}

/// Loads a calibration and two dozen terms, on every target; whether they are accepted.
#[inline(never)]
fn load(module: &mut FlightModule) -> bool {
    let mut block = Block { calibration: Some(Calibration::default()), ..Block::default() };
    let mut term = |target, coefficient, quantities: [Quantity; 2]| {
        let factors =
            quantities.map(|quantity| Factor { reference: 0.1, power: 2, ..Factor::from(quantity) });
        block.terms.push(Term { target, coefficient, factors }).is_ok()
    };
    let mut all = true;
    for gyro in 0..5 {
        all &= term(Target::Gyro(gyro), 1e-9, [Quantity::Temperature(gyro % 4), Quantity::One]);
        all &= term(Target::Gyro(gyro), 1e-4, [Quantity::Rate((gyro + 1) % 5), Quantity::TemperatureRate(0)]);
        all &= term(Target::Gyro(gyro), 1e-8, [Quantity::SpecificForce(gyro % 3), Quantity::InputMagnitude]);
    }
    for one in 0..3 {
        all &= term(Target::Accelerometer(one), 1e-6, [Quantity::TemperatureDifference(0, 1), Quantity::One]);
        all &= term(Target::Accelerometer(one), 1e-6, [Quantity::Input, Quantity::One]);
    }
    all &= term(Target::Velocity, 1e-5, [Quantity::Temperature(2), Quantity::One]);
    all &= term(Target::LoopAccelerometer, 1e-8, [Quantity::Temperature(3), Quantity::One]);
    all &= term(Target::LoopGyro, 1e-12, [Quantity::Temperature(0), Quantity::TemperatureRate(0)]);
    all && module.load_compensation(&block).is_ok()
}

/// The other end of the line.
struct Host {
    flying: Flying,
    endpoint: &'static mut Endpoint,
    wire: &'static mut Wire,
    sequence: u32,
}

impl Host {
    /// Begins the session in which the frames are to be sent.
    fn greet(&mut self) {
        let _ = self.wire.encode(self.sequence, &HostMessage::Hello);
        let mut session = 0;
        for byte in self.wire.as_bytes() {
            if let Reaction::Send(frame) = self.endpoint.receive(*byte, self.flying.module, || 0) {
                let mut decoder = Decoder::new();
                let banner = frame.iter().find_map(|byte| decoder.push::<ModuleMessage>(*byte)?.ok());
                session = banner.map_or(0, |banner| banner.session);
            }
        }
        self.wire.seal_with(session);
    }

    /// The next frame.
    fn prepare(&mut self, random: &mut Random) {
        let message = HostMessage::Step(self.flying.flight.next(random));
        let _ = self.wire.encode(self.sequence, &message);
        self.sequence += 1;
    }

    fn run(&mut self) {
        for byte in self.wire.as_bytes() {
            if let Reaction::Send(frame) = self.endpoint.receive(*byte, self.flying.module, || 0) {
                black_box(frame);
            }
        }
    }
}
