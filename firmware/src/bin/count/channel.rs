//! The error filter of the channel, with four states and with six.
use nalgebra::RealField;
use schuler_core::filter::{
    ColouredGaussian, ColouredModel, ColouredNoise, DiscreteModel, ErrorFilter, FilterConfig, FilterOutput,
    FilterStep, Gaussian, Innovation, Kernel, MarkovNoise,
};

use crate::arithmetic::heading;
use crate::meter::{Meter, Random};

const SAMPLES: usize = 2000;

/// The channel of the flight configuration.
pub fn config<T: RealField + Copy>() -> FilterConfig<T> {
    let real = nalgebra::convert::<f64, T>;
    FilterConfig {
        radius_m: real(6_371_000.0),
        gravity: real(9.80665),
        step_s: T::one(),
        accelerometer: MarkovNoise { sigma: real(9.80665e-4), tau_s: real(60.0) },
        gyro: MarkovNoise { sigma: real(4.84814e-7), tau_s: real(1800.0) },
        velocity_noise: real(0.1),
        initial_velocity_sigma: real(0.1),
        initial_vertical_sigma: real(1e-4),
        gate_sigma: real(6.0),
    }
}

/// Velocity errors, m/s: noise with outliers, gaps, a stretch that is all wrong, and what is no number.
pub struct Velocity {
    step: u32,
    lead: f64,
}

impl Velocity {
    pub fn new() -> Self {
        Self { step: 0, lead: 0.0 }
    }

    pub fn next<T: RealField + Copy>(&mut self, random: &mut Random) -> Option<T> {
        self.step += 1;
        self.lead += 0.003 * random.normal();
        let value = self.lead + 0.1 * random.normal();
        let value = match self.step % 500 {
            200..220 => value + 50.0,
            300 => f64::NAN,
            310 => f64::INFINITY,
            320 => 3e38,
            _ if random.once_in(40) => value + 5.0 * random.symmetric(),
            _ => value,
        };
        (!random.once_in(20)).then(|| nalgebra::convert(value))
    }
}

struct Running<K: Kernel<T>, T: RealField + Copy> {
    filter: ErrorFilter<T, K>,
    velocity: Velocity,
    next: Option<T>,
    step: Option<FilterStep<T>>,
    output: Option<FilterOutput<T>>,
}

impl<T: RealField + Copy, K: Kernel<T>> Running<K, T> {
    fn new(model: K::Model, prior: K) -> Self {
        let filter = ErrorFilter::with_model(&config(), model, prior);
        Self { filter, velocity: Velocity::new(), next: None, step: None, output: None }
    }

    fn prepare(&mut self, random: &mut Random) {
        self.next = self.velocity.next(random);
    }
}

/// A kernel alone: prediction, innovation, gate and correction, without the guards of the filter around it.
struct Bare<T: RealField + Copy> {
    model: DiscreteModel<T>,
    state: Gaussian<T>,
    variance: T,
    gate_squared: T,
    velocity: Velocity,
    next: Option<T>,
    innovation: Option<Innovation<T>>,
}

impl<T: RealField + Copy> Bare<T> {
    fn prepare(&mut self, random: &mut Random) {
        let next: Option<T> = self.velocity.next(random);
        self.next = next.filter(nalgebra::ComplexField::is_finite);
    }

    fn run(&mut self) {
        self.state.predict(&self.model);
        let velocity = self.next.unwrap_or(self.state.mean[0]);
        let innovation = self.state.innovation(velocity, self.variance);
        let inside = innovation.value * innovation.value <= self.gate_squared * innovation.variance;
        self.state.correct(&innovation, self.next.is_some() && inside);
        self.innovation = Some(innovation);
    }
}

/// The filter's step.
#[inline(never)]
pub fn count<T: RealField + Copy>(meter: &mut Meter, precision: &str) {
    let config = config::<T>();
    let model = config.model(&config.accelerometer, &config.gyro, config.step_s);
    let bare = Bare {
        model,
        state: config.prior(),
        variance: config.velocity_noise * config.velocity_noise,
        gate_squared: config.gate_sigma * config.gate_sigma,
        velocity: Velocity::new(),
        next: None,
        innovation: None,
    };
    meter.part(&heading("filter kernel", precision), SAMPLES, bare, Bare::prepare, Bare::run);
    let filter = Running::new(model, config.prior());
    meter.part(&heading("filter step", precision), SAMPLES, filter, Running::prepare, |running| {
        running.step = Some(running.filter.step(running.next));
    });
    let mut filter = Running::new(model, config.prior());
    filter.step = Some(filter.filter.step(None));
    meter.part(
        &heading("filter output", precision),
        SAMPLES,
        filter,
        |running, random| {
            running.prepare(random);
            running.step = Some(running.filter.step(running.next));
        },
        |running| running.output = running.step.as_ref().map(|step| running.filter.output(step)),
    );

    let accelerometer = ColouredNoise {
        sigma: config.accelerometer.sigma,
        alpha: nalgebra::convert(1.0 / 600.0),
        beta: nalgebra::convert(core::f64::consts::TAU / 1800.0),
    };
    let gyro = ColouredNoise::from(&config.gyro);
    let coloured = ColouredModel::exact(&config, &accelerometer, &gyro, config.step_s);
    let sigma = [config.initial_velocity_sigma, config.initial_vertical_sigma];
    let prior = ColouredGaussian::stationary([T::zero(); 2], sigma, &accelerometer, &gyro);
    let filter = Running::new(coloured, prior);
    meter.part(&heading("coloured filter step", precision), SAMPLES, filter, Running::prepare, |running| {
        running.step = Some(running.filter.step(running.next));
    });
}
