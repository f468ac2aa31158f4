//! What the catalogue knows of an effect, and what an effect becomes in a case: a candidate with its signatures.
//!
//! An [`Effect`] is data: identifier, formula, units, what must vary for it to be seen, plausible magnitude, source. In
//! a case it [gives](Effect::candidates) one [`Candidate`] for each sensor or group on which it can act with what was
//! recorded. A candidate's [`Signature`] is what the effect adds to the outputs of the sensors, in SI units, for
//! amplitudes of one. Of its physics the rest of the pipeline asks little: whether it is of the motion, which comes as late
//! as the readings, whether it is that delay, and whether it depends on temperature, which a thermometer tells inexactly.
use schuler_recording::case::SensorKind;

use super::form::Form;
use super::in_flight::InFlight;
use crate::inputs::Inputs;
use crate::inputs::series::Series;

/// A row of the catalogue.
#[derive(Clone, Copy, Debug)]
pub struct Effect {
    /// Identifier, by which answers are scored.
    pub id: &'static str,
    /// The formula, as in the catalogue.
    pub formula: &'static str,
    /// What was left out, to stand in a sentence: "gyro_x drifts with the rate of its temperature".
    pub sentence: &'static str,
    /// What must vary in the recording for the effect to be seen.
    pub needs: &'static str,
    /// The experiment that tells it from what looks like it.
    pub separated_by: &'static str,
    /// Where the formula and the magnitudes come from.
    pub source: &'static str,
    /// Whether it is compensated in flight.
    pub in_flight: InFlight,
    /// How what it adds is computed from recorded quantities.
    pub form: Form,
    /// Which kinds of sensor it acts on.
    pub acts_on: fn(SensorKind) -> bool,
    /// The candidates that it gives in a case: none where what it needs was not recorded or does not vary.
    pub candidates: fn(&'static Effect, &Inputs<'_>) -> Vec<Candidate>,
}

/// Where an effect acts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// One sensor, by its place in the recording.
    Sensor(usize),
    /// All sensors of an instrument together.
    Group {
        /// Name of the group.
        name: String,
        /// Its sensors, by their places in the recording.
        sensors: Vec<usize>,
    },
}

/// Where in a Schuler loop a signal enters; sensors outside of a loop have only their output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Port {
    /// The sensor's output, in the SI unit of the sensor.
    Output,
    /// The accelerometer's error in the Schuler loop, m/s².
    Accelerometer,
    /// The gyro's error in the Schuler loop, rad/s.
    Gyro,
}

/// An effect at one place in a case.
pub struct Candidate {
    /// Its row in the catalogue.
    pub effect: &'static Effect,
    /// Where it acts.
    pub target: Target,
    /// Where it enters.
    pub port: Port,
    /// Which of several it is: name and value of each parameter that is not a number, e.g. `column`, `axis`.
    pub variant: Vec<(&'static str, String)>,
    /// How its parameters are found.
    pub search: Search,
    /// One for each column of the signature.
    pub amplitudes: Vec<Amplitude>,
    /// Factor between the stated noise of its sensors and the one that they may have with this effect: readings in a mistaken unit may
    /// have their noise stated in the right one. 1 of effects that say nothing of the noise.
    pub noise_factor: f64,
}

impl Candidate {
    /// Whether it is a shape sought at every time or frequency that several sensors have in common, with an amplitude of each.
    pub fn is_in_common(&self) -> bool {
        self.search.is_scanned() && matches!(self.target, Target::Group { .. })
    }

    /// Whether it is a mean that jumps on and off.
    pub fn is_jump(&self) -> bool {
        matches!(self.search, Search::Readings(ReadingFault::IntermittentJump))
    }
}

/// What stands between the names of sensors that have something in common.
pub(crate) const IN_COMMON: &str = ", ";
/// Name of the amplitude of what decays from a start that nobody knows.
pub const AT_START: &str = "at_start";
/// What an effect whose reference is not known adds at the mean.
pub const AT_MEAN: &str = "at_mean";

/// The number that multiplies a column of the signature.
#[derive(Clone, Debug, PartialEq)]
pub struct Amplitude {
    /// Name in the answer: `coefficient`, `arm_x_m` ….
    pub name: String,
    /// Unit in the answer.
    pub unit: String,
    /// Value in the answer for an amplitude of 1.
    pub in_unit: f64,
    /// Plausible magnitude in the unit of the answer, smallest and largest.
    pub plausible: Option<[f64; 2]>,
}

/// Signature for given values of the parameters in which it is not linear.
pub type SignatureOf = Box<dyn Fn(&[f64]) -> Signature + Send + Sync>;

/// How the parameters of a candidate are found.
pub enum Search {
    /// The signature is linear in its amplitudes: one least-squares solution.
    Linear(Signature),
    /// Some parameters are not linear: a grid, then refinement; at each point the amplitudes are least squares.
    Grid {
        /// The parameters.
        parameters: Vec<Nonlinear>,
        /// The signature for given values of them.
        signature: SignatureOf,
        /// Whether the amplitudes are exactly 1 (a time delay is all parameter and no amplitude).
        unit_amplitude: bool,
    },
    /// A shape that begins at some time: searched at every time at once.
    Onset(OnsetShape),
    /// A sinusoid of unknown frequency: searched at every frequency at once.
    Frequency,
    /// The structure or the level of the noise is another: judged by the likelihood of the whitened record.
    Noise(NoiseChange),
    /// The output itself shows it (stuck, clipped, coarse, spikes): judged from the readings.
    Readings(ReadingFault),
}

impl Search {
    /// Whether it is a shape that is sought at every time or every frequency.
    pub fn is_scanned(&self) -> bool {
        matches!(self, Self::Onset(_) | Self::Frequency)
    }
}

/// A parameter in which the signature is not linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Nonlinear {
    /// Name in the answer: `tau_s`, `delay_s` ….
    pub name: &'static str,
    /// Unit in the answer.
    pub unit: &'static str,
    /// Points of the grid, increasing; the refinement stays between the neighbours, and within the first and last.
    pub grid: Vec<f64>,
}

/// Shapes that begin at some time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OnsetShape {
    /// 0 before, 1 after.
    Step,
    /// 0 before, the time since the onset after.
    Ramp,
}

/// How noise can differ from the nominal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoiseChange {
    /// White level.
    White,
    /// First-order Markov.
    Markov,
    /// Exponential-cosine.
    ExponentialCosine,
    /// Random walk.
    RandomWalk,
    /// Flicker, as a sum of Markov terms.
    Flicker,
    /// Differenced quantisation.
    AngleQuantisation,
    /// White level changes at a time.
    VarianceStep,
    /// White level is another where a quantity is large, by its place among those of [`Inputs::loudness`](crate::inputs::Inputs::loudness).
    LevelAbove(usize),
}

impl NoiseChange {
    /// What of a gain in log-likelihood counts, so much of which the readings of redundant sensors tell beside their residuals: of a change in
    /// time they tell nothing but what speaks against the sensor's having so much noise in the mean.
    pub fn counted(self, gain: f64, redundant_gain: f64) -> f64 {
        match self {
            Self::VarianceStep | Self::LevelAbove(_) => gain - redundant_gain.max(0.0),
            _ => gain,
        }
    }
}

/// What readings show without a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadingFault {
    /// Constant from some time on.
    Stuck,
    /// Clipped at a limit.
    Saturated,
    /// Rounded to a step coarser than nominal.
    Quantised,
    /// Isolated spikes.
    Outliers,
    /// A mean that jumps on and off.
    IntermittentJump,
}

/// Lets the linear signatures of an effect's candidates share the series that are equal: what goes with a temperature or the time is
/// the same on every sensor, and of a long record a series is much memory.
pub fn share_equal_series(candidates: &mut [Candidate]) {
    let mut distinct: Vec<Series> = Vec::new();
    let signatures = candidates.iter_mut().filter_map(|candidate| match &mut candidate.search {
        Search::Linear(signature) => Some(signature),
        _ => None,
    });
    for (_, values) in signatures.flat_map(|it| &mut it.columns).flat_map(|column| &mut column.parts) {
        match distinct.iter().find(|known| ***known == **values) {
            Some(known) => *values = known.clone(),
            None => distinct.push(values.clone()),
        }
    }
}

/// What an effect adds to the readings of the sensors it acts on, one column for each amplitude.
#[derive(Clone, Debug, Default)]
pub struct Signature {
    /// The columns.
    pub columns: Vec<Column>,
}

/// One column of a signature: for each sensor a value a row, in the SI unit of the port; 0 where it is not known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column {
    /// Sensor, by its place in the recording, and values.
    pub parts: Vec<(usize, Series)>,
}

impl Column {
    /// One that acts on one sensor.
    pub fn on(sensor: usize, values: impl Into<Series>) -> Self {
        Self { parts: vec![(sensor, values.into())] }
    }

    /// One that acts on several.
    pub fn of<V: Into<Series>>(parts: impl IntoIterator<Item = (usize, V)>) -> Self {
        Self { parts: parts.into_iter().map(|(sensor, values)| (sensor, values.into())).collect() }
    }
}
