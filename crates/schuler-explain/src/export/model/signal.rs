//! Signals: how what an effect adds, for an amplitude of 1, is computed from named inputs.
//!
//! A signal is a sum of products of a few functions of the inputs, and at most one memory behind it: a lag, a delay or a play. That is all
//! that the catalogue needs, and little enough to be written out in any language.
use serde::{Deserialize, Serialize};

use crate::catalogue::straight_on;
use crate::inputs::series::{delayed, delayed_closely, lagged, lagged_smooth, map, play_branch, product};

/// A signal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Signal {
    /// What is added up.
    pub sum: Vec<Product>,
    /// What the sum goes through.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory: Option<Memory>,
}

/// A coefficient times factors; of none it is the coefficient itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Product {
    /// The coefficient.
    pub coefficient: f64,
    /// The factors.
    pub factors: Vec<Factor>,
}

/// A function of x = Σ weight · input − reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Factor {
    /// The inputs.
    pub of: Vec<Weighted>,
    /// What is taken off.
    pub reference: f64,
    /// The function.
    pub function: Function,
}

/// An input times a weight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weighted {
    /// Name of the input.
    pub input: String,
    /// Its weight.
    pub weight: f64,
}

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Function {
    /// xⁿ.
    Power {
        /// n.
        exponent: u8,
    },
    /// |x|.
    Magnitude,
    /// −1, 0 or 1.
    Sign,
    /// 0 below 0, 1 from 0 on.
    Step,
    /// 0 below 0, x from 0 on.
    Ramp,
    /// exp(−x/τ).
    Decay {
        /// τ, s.
        tau_s: f64,
    },
    /// cos 2πfx.
    Cosine {
        /// f, Hz.
        frequency_hz: f64,
    },
    /// sin 2πfx.
    Sine {
        /// f, Hz.
        frequency_hz: f64,
    },
    /// −x where |x| is below a threshold, else 0.
    DeadZone {
        /// The threshold.
        threshold: f64,
    },
    /// What a limit on |x| takes away.
    Clipped {
        /// The limit.
        limit: f64,
    },
}

/// What a signal goes through.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Memory {
    /// A first-order lag that starts at rest on the first value; exact for a straight line from row to row.
    Lag {
        /// Time constant, s.
        tau_s: f64,
    },
    /// The same for a cubic from row to row, less the signal itself: what a bandwidth takes away.
    Bandwidth {
        /// Time constant, s.
        tau_s: f64,
    },
    /// The signal as it was some time ago, by interpolation through as many rows on either side as there are up to `reach`.
    Delay {
        /// Delay, s.
        delay_s: f64,
        /// Rows on either side.
        reach: usize,
        /// What there is where that time lies outside of the record.
        outside: Outside,
        /// Whether the signal of now is taken off.
        less_now: bool,
    },
    /// The branch, −1 to 1, on which a play is; it starts in the middle.
    Branch {
        /// Half-width of the play.
        half_width: f64,
    },
}

/// What a delayed signal is where the record has no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outside {
    /// As it is now.
    Now,
    /// As it was first.
    First,
    /// Straight on from the end, by two steps at most.
    StraightOn,
}

/// Rows on either side through which most signals are delayed, and those that sway within a few steps.
pub const NARROW: usize = 2;
/// See [`NARROW`].
pub const WIDE: usize = 16;
/// A lag of so many steps takes the input for a straight line from row to row.
pub const LONG_LAG_STEPS: f64 = 20.0;

impl Signal {
    /// A product alone.
    pub fn product(factors: Vec<Factor>) -> Self {
        Self { sum: vec![Product { coefficient: 1.0, factors }], memory: None }
    }

    /// The same through a memory.
    #[must_use]
    pub fn through(self, memory: Memory) -> Self {
        Self { memory: Some(memory), ..self }
    }

    /// Names of its inputs.
    pub fn inputs(&self) -> impl Iterator<Item = &str> {
        let factors = self.sum.iter().flat_map(|product| &product.factors);
        factors.flat_map(|factor| &factor.of).map(|weighted| weighted.input.as_str())
    }

    /// The sum in one row without its memory; none where an input is not there.
    pub fn sum_at(&self, input: &dyn Fn(&str) -> Option<f64>) -> Option<f64> {
        let product = |it: &Product| {
            let factors: Option<f64> = it.factors.iter().map(|factor| factor.at(input)).product();
            Some(it.coefficient * factors?)
        };
        self.sum.iter().map(product).sum()
    }

    /// Its values over the rows at `time_s`, by the values of its inputs; none where an input is not there.
    pub fn values<'v>(&self, time_s: &[f64], input: &dyn Fn(&str) -> Option<&'v [f64]>) -> Option<Vec<f64>> {
        let mut sum = vec![0.0; time_s.len()];
        for Product { coefficient, factors } in &self.sum {
            let mut values = vec![*coefficient; time_s.len()];
            for factor in factors {
                values = product(&values, &factor.values(time_s.len(), input)?);
            }
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
        Some(self.memory.map_or_else(|| sum.clone(), |memory| memory.of(time_s, &sum)))
    }
}

impl Factor {
    /// A function of inputs.
    pub fn new(of: Vec<Weighted>, reference: f64, function: Function) -> Self {
        Self { of, reference, function }
    }

    /// An input as it is.
    pub fn of(input: String) -> Self {
        Self::new(vec![Weighted { input, weight: 1.0 }], 0.0, Function::Power { exponent: 1 })
    }

    fn values<'v>(&self, rows: usize, input: &dyn Fn(&str) -> Option<&'v [f64]>) -> Option<Vec<f64>> {
        let mut argument = vec![-self.reference; rows];
        for Weighted { input: name, weight } in &self.of {
            argument.iter_mut().zip(input(name)?).for_each(|(sum, value)| *sum += weight * value);
        }
        Some(map(&argument, |x| self.function.of(x)))
    }

    fn at(&self, input: &dyn Fn(&str) -> Option<f64>) -> Option<f64> {
        let weighted = self.of.iter().map(|it| Some(it.weight * input(&it.input)?));
        Some(self.function.of(weighted.sum::<Option<f64>>()? - self.reference))
    }
}

impl Function {
    /// Its value.
    pub fn of(self, x: f64) -> f64 {
        let turn = |frequency_hz: f64| std::f64::consts::TAU * frequency_hz * x;
        match self {
            Self::Power { exponent } => x.powi(i32::from(exponent)),
            Self::Magnitude => x.abs(),
            Self::Sign if x == 0.0 => 0.0,
            Self::Sign => x.signum(),
            Self::Step => f64::from(u8::from(x >= 0.0)),
            Self::Ramp => x.max(0.0),
            Self::Decay { tau_s } => (-x / tau_s).exp(),
            Self::Cosine { frequency_hz } => turn(frequency_hz).cos(),
            Self::Sine { frequency_hz } => turn(frequency_hz).sin(),
            Self::DeadZone { threshold } if x.abs() < threshold => -x,
            Self::DeadZone { .. } => 0.0,
            Self::Clipped { limit } => x.max(-limit).min(limit) - x,
        }
    }
}

impl Memory {
    fn of(self, time_s: &[f64], values: &[f64]) -> Vec<f64> {
        match self {
            Self::Lag { tau_s } => lagged(time_s, values, tau_s),
            Self::Bandwidth { tau_s } => {
                let late = lagged_smooth(time_s, values, tau_s);
                late.iter().zip(values).map(|(late, now)| late - now).collect()
            }
            Self::Delay { delay_s, reach, outside, less_now } => {
                let of = if reach > NARROW { delayed_closely } else { delayed };
                let first = values.first().copied().unwrap_or_default();
                let beyond = straight_on(time_s, values, delay_s);
                let late = of(time_s, values, delay_s).into_iter().zip(time_s).zip(values);
                late.map(|((late, &time), &now)| {
                    let late = late.unwrap_or_else(|| match outside {
                        Outside::Now => now,
                        Outside::First => first,
                        Outside::StraightOn => beyond(time),
                    });
                    if less_now { late - now } else { late }
                })
                .collect()
            }
            Self::Branch { half_width } => play_branch(values, half_width),
        }
    }
}
