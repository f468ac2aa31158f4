//! What lies between an instrument's physical output and the number in the recording: electronics, noise, converter.
use super::heat::quantise;
use super::random::{Drift, Process, Stream};

/// What surrounds an instrument at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Temperature of the body where the instrument sits, °C.
    pub temperature: f64,
    /// Temperature gradient there along the body, K/m.
    pub gradient: f64,
    /// Temperature of the electronics, °C.
    pub electronics: f64,
    /// Supply voltage, V.
    pub voltage: f64,
    /// Magnetic flux density in body axes, T.
    pub magnetic_field: nalgebra::Vector3<f64>,
    /// A linear vibration of the body in body axes: amplitude of the specific force, m/s².
    pub vibration: nalgebra::Vector3<f64>,
    /// Its frequency, Hz.
    pub vibration_hz: f64,
    /// What else finds its way into the output, in the output's unit; see [`super::parasite`].
    pub parasitic: f64,
    /// Pick-off angles at which a tuned gyro's loop is told to hold its rotor, x and y, rad.
    pub pickoff_command: [f64; 2],
}

/// Temperature at which every parameter holds, °C.
pub const REFERENCE_TEMPERATURE: f64 = 20.0;
/// Supply voltage at which every parameter holds, V.
pub const REFERENCE_VOLTAGE: f64 = 27.0;

impl Default for Surroundings {
    fn default() -> Self {
        Self {
            temperature: REFERENCE_TEMPERATURE,
            gradient: 0.0,
            electronics: REFERENCE_TEMPERATURE,
            voltage: REFERENCE_VOLTAGE,
            magnetic_field: nalgebra::Vector3::zeros(),
            vibration: nalgebra::Vector3::zeros(),
            vibration_hz: 0.0,
            parasitic: 0.0,
            pickoff_command: [0.0; 2],
        }
    }
}

/// How the output becomes a number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Conversion {
    /// As it is.
    #[default]
    Exact,
    /// Rounded to this step.
    Rounding(f64),
    /// Counted in pulses of this much of the output's integral; what is left stays for the next reading.
    Pulses(f64),
}

/// Electronics and noise of one output. Units: the output's (rad/s, m/s²).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadoutDesign {
    /// Offset of the electronics.
    pub offset: f64,
    /// Its dependence on the electronics' temperature, per K.
    pub offset_temperature: f64,
    /// Its dependence on the supply voltage, per V.
    pub offset_voltage: f64,
    /// Magnitude below which nothing passes.
    pub threshold: f64,
    /// White noise, output unit per √Hz.
    pub white: f64,
    /// Random drift of the instrument's output, of which a reading holds the mean over its step.
    pub drift: Vec<Process>,
    /// Random drift of the electronics, of which a reading holds the value at its instant: sampled so, R(τ) of the readings is that
    /// of the process.
    pub electronics_drift: Vec<Process>,
    /// Converter.
    pub conversion: Conversion,
    /// Largest magnitude that can be told; infinite for no limit.
    pub range: f64,
}

/// One output at work.
#[derive(Clone, Debug)]
pub struct Readout {
    design: ReadoutDesign,
    drift: Drift,
    electronics_drift: Drift,
    white: Stream,
    /// Pulses' remainder: integral of the output not yet counted.
    remainder: f64,
}

impl Readout {
    /// The output called `name` of the run with this seed.
    pub fn new(design: ReadoutDesign, seed: u64, name: &str) -> Self {
        let stream = |what: &str| Stream::new(seed, &format!("{name}/{what}"));
        let drift = Drift::new(&design.drift, stream("drift"));
        let electronics_drift = Drift::new(&design.electronics_drift, stream("electronics_drift"));
        Self { design, drift, electronics_drift, white: stream("white"), remainder: 0.0 }
    }

    /// Mean of the instrument's random drift over the next step; moves it on.
    pub fn drift(&mut self, step_s: f64) -> f64 {
        let before = self.drift.value();
        0.5 * (before + self.drift.advance(step_s))
    }

    /// Turns the instrument's mean output over a step into a reading.
    pub fn read(&mut self, output: f64, around: &Surroundings, step_s: f64) -> f64 {
        let d = &self.design;
        let offset = d.offset
            + d.offset_temperature * (around.electronics - REFERENCE_TEMPERATURE)
            + d.offset_voltage * (around.voltage - REFERENCE_VOLTAGE)
            + around.parasitic
            + self.electronics_drift.advance(step_s);
        // A threshold lets nothing through that is smaller, as static friction does.
        let passed = if output.abs() < d.threshold { 0.0 } else { output };
        let noisy = passed + offset + d.white / step_s.sqrt() * self.white.normal();
        let clipped = noisy.clamp(-d.range, d.range);
        match d.conversion {
            Conversion::Exact => clipped,
            Conversion::Rounding(step) => quantise(clipped, step),
            Conversion::Pulses(quantum) => {
                let integral = self.remainder + clipped * step_s;
                let counted = (integral / quantum).floor() * quantum;
                self.remainder = integral - counted;
                counted / step_s
            }
        }
    }

    /// Whether a reading is at the end of the range.
    pub fn saturated(&self, reading: f64) -> bool {
        reading.abs() >= self.design.range * (1.0 - 1e-9)
    }
}

/// A part whose gain depends a little on the sign and size of what passes: output = input (1 ± asymmetry + odd_quadratic · abs(input)
/// + cubic · input²) + quadratic · input².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nonlinearity {
    /// Gain minus one.
    pub gain: f64,
    /// Half the difference of the gains for positive and negative input.
    pub asymmetry: f64,
    /// Quadratic coefficient, per unit of input.
    pub quadratic: f64,
    /// Change of the gain with the input's magnitude, as of a magnet that its coil's field weakens, per unit of input.
    pub odd_quadratic: f64,
    /// Cubic coefficient, per unit of input squared.
    pub cubic: f64,
}

impl Nonlinearity {
    /// What passes through.
    pub fn apply(&self, input: f64) -> f64 {
        let gain =
            self.asymmetry * input.signum() + self.odd_quadratic * input.abs() + self.cubic * input * input;
        input * (1.0 + self.gain + gain) + self.quadratic * input * input
    }

    /// The input that gives this output: Newton from the linear answer; the coefficients are small.
    pub fn invert(&self, output: f64) -> f64 {
        let mut input = output / (1.0 + self.gain);
        for _ in 0..6 {
            let slope = 1.0
                + self.gain
                + self.asymmetry * input.signum()
                + 2.0 * self.odd_quadratic * input.abs()
                + 3.0 * self.cubic * input * input
                + 2.0 * self.quadratic * input;
            input -= (self.apply(input) - output) / slope;
        }
        input
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_lose_nothing() {
        let design =
            ReadoutDesign { conversion: Conversion::Pulses(0.01), range: 1.0, ..ReadoutDesign::default() };
        let mut readout = Readout::new(design, 1, "x");
        let sum: f64 = (0..1000).map(|_| readout.read(0.123_456, &Surroundings::default(), 0.1) * 0.1).sum();
        assert!((sum - 12.345_6).abs() < 0.0101, "{sum}");
    }

    #[test]
    fn noise_of_a_reading_falls_with_the_square_root_of_the_step() {
        let design = ReadoutDesign { white: 0.2, range: f64::INFINITY, ..ReadoutDesign::default() };
        for step in [0.25, 4.0] {
            let mut readout = Readout::new(design.clone(), 1, "x");
            let n = 20_000;
            let variance =
                (0..n).map(|_| readout.read(0.0, &Surroundings::default(), step).powi(2)).sum::<f64>()
                    / f64::from(n);
            let expected = 0.04 / step;
            assert!((variance / expected - 1.0).abs() < 4.0 * (2.0 / f64::from(n)).sqrt());
        }
    }

    #[test]
    fn nonlinearity_inverts() {
        let part =
            Nonlinearity { gain: 1e-3, asymmetry: 2e-4, quadratic: 1e-4, odd_quadratic: 2e-5, cubic: -3e-5 };
        for x in [-3.0, -1e-6, 0.0, 0.2, 2.5] {
            assert!((part.invert(part.apply(x)) - x).abs() < 1e-14, "{x}");
        }
    }
}
