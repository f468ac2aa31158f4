//! What else finds its way into an output: machines nearby, loose contacts, joints that slip, material that creeps, and
//! whatever reaches the electronics from a quantity that is or is not recorded.
//!
//! Each is a small system of its own, driven by the surroundings and moved on step by step; what it gives is added where the
//! electronics' offset is. Units: the output's (rad/s, m/s², m/s).
use nalgebra::Vector3;

use super::heat::Lag;
use super::random::Stream;

/// What disturbs.
#[derive(Clone, Debug, PartialEq)]
pub enum Disturbance {
    /// A rotating machine whose speed goes linearly from one value to another over a time.
    Machine {
        /// Amplitude.
        amplitude: f64,
        /// Speed at the start, Hz.
        start_hz: f64,
        /// Speed at the end, Hz.
        end_hz: f64,
        /// Time from start to end, s.
        over_s: f64,
        /// Angle at the start, rad.
        phase: f64,
    },
    /// A contact or a reflection that comes and goes: the mean shifts by an amount, for random times.
    Telegraph {
        /// Shift.
        shift: f64,
        /// Mean time shifted, s.
        on_s: f64,
        /// Mean time not shifted, s.
        off_s: f64,
    },
    /// Charges let go at random times, each leaking away.
    Bursts {
        /// Standard deviation of their size.
        size: f64,
        /// Mean time between them, s.
        every_s: f64,
        /// Time constant of the leak, s; zero: gone with the next reading.
        decay_s: f64,
    },
    /// A quantity of the surroundings, through a first-order lag.
    Coupled {
        /// Its column.
        column: String,
        /// Output per unit.
        coefficient: f64,
        /// Value at which nothing comes through.
        reference: f64,
        /// Time constant of the lag, s.
        lag_s: f64,
    },
    /// Two quantities of the surroundings in a mixer.
    Mixed {
        /// Their columns.
        columns: [String; 2],
        /// Output per product of the deviations.
        coefficient: f64,
        /// Values at which nothing comes through.
        references: [f64; 2],
    },
    /// A joint between two materials that holds by friction: it is strained by temperature until it slips.
    Joint {
        /// Output per strain in K.
        coefficient: f64,
        /// Strain at which it slips, K.
        slip: f64,
    },
    /// Material that creeps under load: a spring and a dashpot.
    Creep {
        /// Output per specific force once crept.
        coefficient: f64,
        /// Time constant, s.
        tau_s: f64,
        /// Direction of the load in the body.
        direction: Vector3<f64>,
    },
    /// A bridge of resistors whose curve is not straight: output for deviations, their squares and cubes.
    Bridge {
        /// Per K.
        first: f64,
        /// Per K².
        second: f64,
        /// Per K³.
        third: f64,
        /// Temperature at which it is balanced, °C.
        balanced: f64,
    },
    /// A supply that is switched: a constant from each time on until the next.
    Switched(Vec<(f64, f64)>),
}

/// What a disturbance feels in a step.
#[derive(Clone, Copy, Debug)]
pub struct Felt<'a> {
    /// End of the step, s.
    pub time_s: f64,
    /// Its length, s.
    pub step_s: f64,
    /// Temperature at the instrument, °C.
    pub temperature: f64,
    /// Mean specific force in body axes, m/s².
    pub force: Vector3<f64>,
    /// Other quantities by their columns.
    pub quantities: &'a [(String, f64)],
}

/// A disturbance at work.
#[derive(Clone, Debug)]
pub struct Parasite {
    design: Disturbance,
    stream: Stream,
    /// Whether a contact is shifted, the charge left, the strain, the temperature before.
    on: bool,
    charge: f64,
    before: Option<f64>,
    lag: Option<Lag>,
}

impl Parasite {
    /// The disturbance called `name` of the run with this seed.
    pub fn new(design: Disturbance, seed: u64, name: &str) -> Self {
        let stream = Stream::new(seed, name);
        Self { design, stream, on: false, charge: 0.0, before: None, lag: None }
    }

    /// What it adds to a reading, as a mean over the step.
    pub fn step(&mut self, felt: &Felt<'_>) -> f64 {
        let of = |column: &str| {
            felt.quantities.iter().find(|(name, _)| name == column).map_or(0.0, |(_, value)| *value)
        };
        match &self.design {
            Disturbance::Machine { amplitude, start_hz, end_hz, over_s, phase } => {
                let slope = (end_hz - start_hz) / over_s;
                let angle = |t: f64| phase + std::f64::consts::TAU * (start_hz * t + 0.5 * slope * t * t);
                // Mean of the sine over the step, by Simpson's rule.
                let (a, b) = (felt.time_s - felt.step_s, felt.time_s);
                amplitude * (angle(a).sin() + 4.0 * angle(0.5 * (a + b)).sin() + angle(b).sin()) / 6.0
            }
            Disturbance::Telegraph { shift, on_s, off_s } => {
                let stay = if self.on { *on_s } else { *off_s };
                if self.stream.uniform() < 1.0 - (-felt.step_s / stay).exp() {
                    self.on = !self.on;
                }
                if self.on { *shift } else { 0.0 }
            }
            Disturbance::Bursts { size, every_s, decay_s } => {
                let leak = if *decay_s > 0.0 { (-felt.step_s / decay_s).exp() } else { 0.0 };
                self.charge *= leak;
                let (uniform, normal) = (self.stream.uniform(), self.stream.normal());
                if uniform < 1.0 - (-felt.step_s / every_s).exp() {
                    self.charge += size * normal;
                }
                self.charge
            }
            Disturbance::Coupled { column, coefficient, reference, lag_s } => {
                let now = of(column);
                let before = self.before.unwrap_or(now);
                let lag = self.lag.get_or_insert(Lag::new(now));
                let value = lag.advance(felt.step_s, *lag_s, before, now);
                self.before = Some(now);
                coefficient * (value - reference)
            }
            Disturbance::Mixed { columns, coefficient, references } => {
                coefficient * (of(&columns[0]) - references[0]) * (of(&columns[1]) - references[1])
            }
            Disturbance::Joint { coefficient, slip } => {
                let moved = felt.temperature - self.before.unwrap_or(felt.temperature);
                self.before = Some(felt.temperature);
                self.charge = (self.charge + moved).clamp(-slip, *slip);
                coefficient * self.charge
            }
            Disturbance::Creep { coefficient, tau_s, direction } => {
                let now = felt.force.dot(direction);
                let before = self.before.unwrap_or(now);
                let lag = self.lag.get_or_insert(Lag::new(now));
                self.before = Some(now);
                coefficient * lag.advance(felt.step_s, *tau_s, before, now)
            }
            Disturbance::Bridge { first, second, third, balanced } => {
                let d = felt.temperature - balanced;
                ((third * d + second) * d + first) * d
            }
            Disturbance::Switched(times) => {
                times.iter().rev().find(|(from, _)| felt.time_s >= *from).map_or(0.0, |(_, value)| *value)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(design: Disturbance, n: usize, temperature: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut parasite = Parasite::new(design, 1, "p");
        (1..=n)
            .map(|k| {
                let t = k as f64;
                let quantities = [("p".to_owned(), t), ("q".to_owned(), 2.0)];
                parasite.step(&Felt {
                    time_s: t,
                    step_s: 1.0,
                    temperature: temperature(t),
                    force: Vector3::new(t, 0.0, 0.0),
                    quantities: &quantities,
                })
            })
            .collect()
    }

    #[test]
    fn a_contact_is_shifted_for_its_share_of_the_time() {
        let out = run(Disturbance::Telegraph { shift: 2.0, on_s: 20.0, off_s: 60.0 }, 400_000, |_| 20.0);
        let share = out.iter().sum::<f64>() / 2.0 / out.len() as f64;
        assert!((share - 0.25).abs() < 0.02, "{share}");
    }

    #[test]
    fn a_joint_has_two_branches() {
        let out = run(Disturbance::Joint { coefficient: 0.5, slip: 2.0 }, 200, |t| {
            if t <= 100.0 { 20.0 + 0.1 * t } else { 30.0 - 0.1 * (t - 100.0) }
        });
        assert!((out[99] - 1.0).abs() < 1e-9 && (out[199] + 1.0).abs() < 1e-9);
        assert!((out[120] - (1.0 - 0.5 * 2.1)).abs() < 1e-9, "{}", out[120]);
    }

    #[test]
    fn creep_lags_the_load_and_a_mixer_multiplies() {
        let creep = Disturbance::Creep { coefficient: 2.0, tau_s: 10.0, direction: Vector3::x() };
        assert!((run(creep, 200, |_| 20.0)[199] - 2.0 * 190.0).abs() < 1e-5);
        let mixed = Disturbance::Mixed {
            columns: ["p".into(), "q".into()],
            coefficient: 3.0,
            references: [1.0, 0.0],
        };
        assert!((run(mixed, 5, |_| 20.0)[4] - 24.0).abs() < 1e-12);
    }

    #[test]
    fn a_machine_runs_up() {
        let out = run(
            Disturbance::Machine { amplitude: 1.0, start_hz: 0.01, end_hz: 0.02, over_s: 1000.0, phase: 0.0 },
            1000,
            |_| 20.0,
        );
        let crossings = out.windows(2).filter(|w| w[0] < 0.0 && w[1] >= 0.0).count();
        assert!((14..=15).contains(&crossings), "{crossings}");
    }
}
