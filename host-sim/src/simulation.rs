//! Runs a scenario: from physics to a recording, its case, and the truth beside them.
//!
//! Row k of the recording, at time kΔ, holds the instruments' means over the step that ends there, and so do the
//! reference rate and specific force. The truth is a table of its own, in SI units, which no case points to.
use std::path::{Path, PathBuf};

use nalgebra::{UnitQuaternion, Vector3};
use schuler_recording::Error;
use schuler_recording::case::{
    Attitude as NominalAttitude, Auxiliary, Case, Motion as NominalMotion, MotionKind, Nominal, Quantity,
    Sensor, SensorKind, Site as NominalSite, Source,
};
use schuler_recording::unit::Unit;

use crate::fitted::{self, Fitted};
use crate::output::{self, Interrupted};
use crate::physics::doppler::Doppler;
use crate::physics::environment::Environment;
use crate::physics::fault::{Faults, TimedFault};
use crate::physics::fog::Fog;
use crate::physics::gyro::Gyro;
use crate::physics::heat::{Lag, Thermometer};
use crate::physics::motion::{Kinematics, Motion, Trajectory, euler};
use crate::physics::parasite::{Felt, Parasite};
use crate::physics::pendulum::Accelerometer;
use crate::physics::random::{Drift, Stream};
use crate::physics::readout::Conversion;
use crate::physics::schuler::{Delay, SchulerLoop};
use crate::scenario::{Channel, ErrorSource, LoopEntry, Scenario, Told};

/// Name of the case that is written.
pub const CASE: &str = "case.toml";
/// Name of the recording that is written.
pub const RECORDING: &str = "recording.csv.gz";
/// Name of the truth that is written beside them.
pub const TRUTH: &str = "truth.csv.gz";

/// Named columns of equal length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns(Vec<(String, Vec<f64>)>);

impl Columns {
    /// A column by its name.
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.0.iter().find(|(column, _)| column == name).map(|(_, values)| values.as_slice())
    }

    /// The columns for which `keep` says true at each row.
    fn rows(&self, keep: &[bool]) -> Self {
        let kept = |values: &Vec<f64>| {
            values.iter().zip(keep).filter(|(_, keep)| **keep).map(|(value, _)| *value).collect()
        };
        Self(self.0.iter().map(|(name, values)| (name.clone(), kept(values))).collect())
    }

    fn write(&self, path: &Path) -> Result<(), Error> {
        let columns: Vec<(&str, &[f64])> =
            self.0.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
        output::write_table(path, &columns)
    }
}

/// A row in the making: values are put under their names in the same order every row.
struct Rows {
    columns: Columns,
    capacity: usize,
    next: usize,
}

impl Rows {
    fn new(capacity: usize) -> Self {
        Self { columns: Columns::default(), capacity, next: 0 }
    }

    fn start(&mut self) {
        self.next = 0;
    }

    fn put(&mut self, name: impl FnOnce() -> String, value: f64) {
        if self.next == self.columns.0.len() {
            self.columns.0.push((name(), Vec::with_capacity(self.capacity)));
        }
        if let Some((_, values)) = self.columns.0.get_mut(self.next) {
            values.push(value);
        }
        self.next += 1;
    }

    fn put3(&mut self, names: [&str; 3], v: &Vector3<f64>) {
        for (name, value) in names.iter().zip(v.iter()) {
            self.put(|| (*name).to_owned(), *value);
        }
    }
}

/// What a scenario gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulated {
    /// The case, without nested directories.
    pub case: Case,
    /// The recording, in the units of the case.
    pub recording: Columns,
    /// The truth, in SI units.
    pub truth: Columns,
}

/// The files that were written.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Written {
    /// The case.
    pub case: PathBuf,
    /// The recording.
    pub recording: PathBuf,
    /// The truth.
    pub truth: PathBuf,
}

impl Simulated {
    /// Writes case, recording and truth into a directory, each file whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, directory: &Path) -> Result<Written, Error> {
        let written = Written {
            case: directory.join(CASE),
            recording: directory.join(RECORDING),
            truth: directory.join(TRUTH),
        };
        self.write_public(directory)?;
        self.truth.write(&written.truth)?;
        Ok(written)
    }

    /// Writes case and recording without the truth, each file whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_public(&self, directory: &Path) -> Result<(), Error> {
        std::fs::create_dir_all(directory)
            .map_err(|error| Error::io(directory, "make the directory", &error))?;
        self.recording.write(&directory.join(RECORDING))?;
        output::write_case(&directory.join(CASE), &self.case)
    }
}

/// The mean motion over a step and its ends.
struct StepMotion {
    rate: Vec<Vector3<f64>>,
    force: Vec<Vector3<f64>>,
    end: Kinematics,
}

impl StepMotion {
    fn mean(values: &[Vector3<f64>]) -> Vector3<f64> {
        let n = values.len().saturating_sub(1).max(1) as f64;
        values.windows(2).fold(Vector3::zeros(), |sum, w| sum + (w[0] + w[1]) / (2.0 * n))
    }

    /// The same with the steady rate that would make the same turn of the body.
    fn as_rotation_vector(&self, step_s: f64) -> Self {
        let part_s = step_s / self.rate.len().saturating_sub(1).max(1) as f64;
        let turn = self.rate.windows(2).fold(UnitQuaternion::identity(), |turn, w| {
            turn * UnitQuaternion::from_scaled_axis((w[0] + w[1]) * (0.5 * part_s))
        });
        let rate = turn.scaled_axis() / step_s;
        Self { rate: vec![rate; self.rate.len()], force: self.force.clone(), end: self.end }
    }
}

/// Runs a scenario; `progress` hears the number of steps done and may stop the run.
///
/// # Errors
/// The run was stopped.
pub fn run(
    scenario: &Scenario,
    mut progress: impl FnMut(usize) -> Result<(), Interrupted>,
) -> Result<Simulated, Interrupted> {
    let steps = steps(scenario);
    let step_s = scenario.step_s;
    let mut plant = Plant::new(scenario);
    let mut recording = Rows::new(steps);
    let mut truth = Rows::new(steps);
    let mut keep = Vec::with_capacity(steps);
    for k in 1..=steps {
        progress(k)?;
        recording.start();
        truth.start();
        let time_s = k as f64 * step_s;
        plant.step(time_s, &mut recording, &mut truth);
        keep.push(!scenario.gaps.iter().any(|(start, length)| time_s >= *start && time_s < start + length));
    }
    Ok(Simulated { case: case(scenario), recording: recording.columns.rows(&keep), truth: truth.columns })
}

/// Number of steps of a scenario.
pub fn steps(scenario: &Scenario) -> usize {
    (scenario.duration_s / scenario.step_s).round().max(1.0) as usize
}

/// Everything that moves.
struct Plant<'s> {
    scenario: &'s Scenario,
    trajectory: Trajectory,
    /// The motion as its user believes it to be, where that is another.
    believed: Option<Clock>,
    environment: Environment,
    gyros: Vec<(Gyro, Faults, Faults)>,
    fogs: Vec<(Fog, Faults)>,
    accelerometers: Vec<(Accelerometer, Faults)>,
    dopplers: Vec<(Doppler, Faults)>,
    thermometers: Vec<Thermometer>,
    channel: Option<LoopPlant>,
    parasites: Vec<Parasite>,
    fitted: Vec<Fitted>,
    /// Temperatures of the thermometers a step ago, for fitted terms.
    warm_before: Vec<f64>,
    clocks: Vec<Clock>,
    before: Kinematics,
}

/// The motion as late instruments feel it, or as another history has it.
struct Clock {
    trajectory: Trajectory,
    before: Kinematics,
    /// Rate and specific force after the lag.
    lagged: Option<[Lag; 6]>,
    delay_s: f64,
    lag_s: f64,
}

impl Clock {
    fn new(mut trajectory: Trajectory, delay_s: f64, lag_s: f64) -> Self {
        let before = trajectory.at(-delay_s);
        Self { trajectory, before, lagged: None, delay_s, lag_s }
    }

    /// The motion over the step that ends at `time_s`, cut into parts.
    fn step(&mut self, time_s: f64, step_s: f64, parts: usize) -> StepMotion {
        let mut motion = StepMotion { rate: vec![], force: vec![], end: self.before };
        for part in 0..=parts {
            if part > 0 {
                let t = time_s - step_s + step_s * part as f64 / parts as f64;
                let before = motion.end;
                motion.end = self.trajectory.at(t - self.delay_s);
                self.follow(&before, &motion.end, step_s / parts as f64);
            }
            let [wx, wy, wz, fx, fy, fz] = self.felt(&motion.end);
            motion.rate.push(Vector3::new(wx, wy, wz));
            motion.force.push(Vector3::new(fx, fy, fz));
        }
        self.before = motion.end;
        motion
    }

    fn felt(&self, now: &Kinematics) -> [f64; 6] {
        let exact = six(now);
        self.lagged.map_or(exact, |lagged| lagged.map(|lag| lag.value()))
    }

    fn follow(&mut self, before: &Kinematics, now: &Kinematics, step_s: f64) {
        if self.lag_s <= 0.0 {
            return;
        }
        let lagged = self.lagged.get_or_insert(six(before).map(Lag::new));
        for ((lag, a), b) in lagged.iter_mut().zip(six(before)).zip(six(now)) {
            lag.advance(step_s, self.lag_s, a, b);
        }
    }
}

fn six(it: &Kinematics) -> [f64; 6] {
    let (w, f) = (&it.rate, &it.specific_force);
    [w.x, w.y, w.z, f.x, f.y, f.z]
}

/// The Schuler loop with its reference and the sources of its sensors' errors.
struct LoopPlant {
    truth: SchulerLoop,
    reference: Delay,
    accelerometer: SourcePlant,
    gyro: SourcePlant,
    noise: Stream,
    faults: Faults,
}

enum SourcePlant {
    /// Id of the output, its nominal bias in SI, the last error.
    Instrument(String, f64, f64),
    Process(Drift, f64, Stream),
}

impl SourcePlant {
    /// Mean error over a step. What else finds its way in, an instrument's reading already holds.
    fn mean(&mut self, step_s: f64, outputs: &[Output], parasitic: f64) -> f64 {
        match self {
            Self::Instrument(id, bias, last) => {
                if let Some(output) = outputs.iter().find(|output| output.id == *id)
                    && let Some(told) = output.told
                {
                    *last = told - output.input - *bias;
                }
                *last
            }
            Self::Process(drift, white, stream) => {
                let before = drift.value();
                let drift = 0.5 * (before + drift.advance(step_s));
                drift + *white / step_s.sqrt() * stream.normal() + parasitic
            }
        }
    }
}

/// What an instrument's output said in a step, SI units.
struct Output {
    id: String,
    input: f64,
    told: Option<f64>,
}

impl<'s> Plant<'s> {
    fn new(scenario: &'s Scenario) -> Self {
        let seed = scenario.seed;
        let faults = |id: &str| {
            let own: Vec<TimedFault> =
                scenario.faults.iter().filter(|f| f.sensor == id).map(|f| f.fault).collect();
            Faults::new(own, seed, id)
        };
        let mut trajectory = Trajectory::new(scenario.motion.clone(), scenario.site);
        let before = trajectory.at(0.0);
        let believed = (scenario.believed.as_ref())
            .map(|it| Clock::new(Trajectory::new(it.motion.clone(), it.site), 0.0, 0.0));
        let environment = Environment::new(scenario.environment.clone());
        // Every design was tried when the scenario was read; one that fails all the same is left out.
        let gyros = scenario
            .gyros
            .iter()
            .filter_map(|entry| {
                let gyro = Gyro::new(entry.design.clone(), seed, &entry.ids.0).ok()?;
                let second = entry.ids.1.as_deref().unwrap_or_default();
                Some((gyro, faults(&entry.ids.0), faults(second)))
            })
            .collect();
        let fogs = scenario
            .fogs
            .iter()
            .map(|entry| (Fog::new(entry.design.clone(), seed, &entry.id), faults(&entry.id)))
            .collect();
        let accelerometers = scenario
            .accelerometers
            .iter()
            .filter_map(|entry| {
                Some((Accelerometer::new(entry.design.clone(), seed, &entry.id).ok()?, faults(&entry.id)))
            })
            .collect();
        let dopplers = scenario
            .dopplers
            .iter()
            .map(|entry| {
                let mut doppler = Doppler::new(entry.design.clone(), seed, &entry.id);
                doppler.pass(0.0, &before);
                (doppler, faults(&entry.id))
            })
            .collect();
        let thermometers = scenario
            .recorded
            .thermometers
            .iter()
            .map(|t| {
                let initial = environment.temperature(t.position_m);
                let stream = Stream::new(seed, &format!("{}/thermometer", t.column));
                Thermometer::new(t.tau_s, t.white, t.quantisation, initial, stream)
            })
            .collect();
        let channel = scenario.schuler_loop.as_ref().map(|entry| LoopPlant {
            truth: SchulerLoop {
                radius_m: entry.radius_m,
                gravity: entry.gravity,
                velocity_error: entry.velocity_error,
                tilt: entry.tilt,
            },
            reference: Delay::new(entry.delay_s),
            accelerometer: source(scenario, entry, &entry.accelerometer, "accelerometer"),
            gyro: source(scenario, entry, &entry.gyro, "gyro"),
            noise: Stream::new(seed, &format!("{}/white", entry.id)),
            faults: faults(&entry.id),
        });
        let parasites = scenario
            .parasites
            .iter()
            .enumerate()
            .map(|(k, entry)| {
                Parasite::new(entry.disturbance.clone(), seed, &format!("{}/parasite_{k}", entry.sensor))
            })
            .collect();
        let clocks = scenario
            .clocks
            .iter()
            .map(|entry| {
                let trajectory = Trajectory::new(scenario.motion.clone(), scenario.site);
                Clock::new(trajectory, entry.delay_s, entry.lag_s)
            })
            .collect();
        Self {
            scenario,
            trajectory,
            believed,
            environment,
            gyros,
            fogs,
            accelerometers,
            dopplers,
            thermometers,
            channel,
            parasites,
            fitted: scenario.fitted.iter().map(|entry| Fitted::new(entry.design.clone())).collect(),
            warm_before: Vec::new(),
            clocks,
            before,
        }
    }

    fn step(&mut self, time_s: f64, recording: &mut Rows, truth: &mut Rows) {
        let step_s = self.scenario.step_s;
        let motion = self.move_body(time_s, step_s);
        self.environment.advance(step_s);
        let late: Vec<StepMotion> =
            self.clocks.iter_mut().map(|clock| clock.step(time_s, step_s, self.scenario.parts)).collect();
        let turned = (!self.scenario.rotation_vectors.is_empty()).then(|| motion.as_rotation_vector(step_s));
        let seen = Seen { motion: &motion, late: &late, turned: turned.as_ref(), scenario: self.scenario };
        let quantities: Vec<(String, f64)> = (self.scenario.recorded.quantities.iter())
            .map(|entry| (entry.column.clone(), entry.profile.at(time_s)))
            .collect();
        let mut parasitic = self.disturb(time_s, &motion, &quantities);
        let fitted = self.fitted(time_s, &motion, &quantities);
        // The sources of a loop's errors have no output of their own.
        parasitic.extend(fitted.iter().filter(|(id, _)| self.scenario.drives_loop(id)).cloned());
        recording.put(|| "t".to_owned(), time_s);
        truth.put(|| "t".to_owned(), time_s);
        truth.put3(["wx", "wy", "wz"], &StepMotion::mean(&motion.rate));
        truth.put3(["fx", "fy", "fz"], &StepMotion::mean(&motion.force));
        let attitude = euler(&motion.end.attitude);
        let angles = Vector3::new(attitude.roll, attitude.pitch, attitude.heading);
        truth.put3(["roll", "pitch", "heading"], &angles);
        truth.put3(["vn", "ve", "vd"], &motion.end.velocity);
        let place = Vector3::new(motion.end.latitude, motion.end.longitude, motion.end.height);
        truth.put3(["latitude", "longitude", "height"], &place);

        let mut outputs = Vec::new();
        self.read_gyros(time_s, &seen, [&parasitic, &fitted], &mut outputs, recording, truth);
        self.read_fogs(time_s, &seen, [&parasitic, &fitted], &mut outputs, recording, truth);
        self.read_accelerometers(time_s, &seen, [&parasitic, &fitted], &mut outputs, recording, truth);
        self.read_dopplers(time_s, &motion, [&parasitic, &fitted], recording, truth);
        self.read_loop(time_s, &motion, [&parasitic, &fitted], &outputs, recording, truth);
        self.read_surroundings(&motion, &quantities, recording, truth);
        let told = self.believed.as_mut().map(|it| it.step(time_s, step_s, self.scenario.parts));
        let told = told.as_ref().unwrap_or(&motion);
        let (rate, force) = (StepMotion::mean(&told.rate), StepMotion::mean(&told.force));
        let attitude = euler(&told.end.attitude);
        let angles = Vector3::new(attitude.roll, attitude.pitch, attitude.heading);
        match self.scenario.told {
            Told::Recorded => {
                recording.put3(["ref_wx", "ref_wy", "ref_wz"], &rate);
                recording.put3(["ref_fx", "ref_fy", "ref_fz"], &force);
                if self.scenario.recorded.attitude {
                    recording.put3(["roll", "pitch", "yaw"], &angles);
                }
            }
            Told::Navigation => {
                recording.put3(["vn", "ve", "vd"], &told.end.velocity);
                recording.put3(["roll", "pitch", "yaw"], &angles);
            }
            Told::VelocityError if self.scenario.recorded.specific_force => {
                recording.put3(["fx", "fy", "fz"], &force);
            }
            _ => {}
        }
        self.before = motion.end;
    }

    fn move_body(&mut self, time_s: f64, step_s: f64) -> StepMotion {
        let parts = self.scenario.parts;
        let mut rate = vec![self.before.rate];
        let mut force = vec![self.before.specific_force];
        let mut end = self.before;
        for part in 1..=parts {
            end = self.trajectory.at(time_s - step_s + step_s * part as f64 / parts as f64);
            rate.push(end.rate);
            force.push(end.specific_force);
            if part < parts {
                for (doppler, _) in &mut self.dopplers {
                    doppler.pass(time_s - step_s + step_s * part as f64 / parts as f64, &end);
                }
            }
        }
        StepMotion { rate, force, end }
    }

    fn read_gyros(
        &mut self,
        time_s: f64,
        seen: &Seen<'_>,
        [parasitic, fitted]: [&[(String, f64)]; 2],
        outputs: &mut Vec<Output>,
        recording: &mut Rows,
        truth: &mut Rows,
    ) {
        let step_s = self.scenario.step_s;
        for ((gyro, first, second), entry) in self.gyros.iter_mut().zip(&self.scenario.gyros) {
            let motion = seen.by(&entry.ids.0);
            let mut around = self.environment.around(entry.position_m, &motion.end.attitude);
            around.parasitic = of(parasitic, &entry.ids.0);
            around.pickoff_command = entry.pickoff_command.each_ref().map(|it| it.at(time_s));
            let reading = gyro.step(&motion.rate, &motion.force, &around, step_s);
            let si = entry.unit.in_si();
            let ids = [Some(&entry.ids.0), entry.ids.1.as_ref()];
            for (axis, (id, faults)) in ids.into_iter().zip([first, second]).enumerate() {
                let Some(id) = id else { continue };
                let (said, input) = (reading.rate[axis] + of(fitted, id), reading.true_rate[axis]);
                let told = faults.apply(time_s, said);
                if entry.recorded {
                    recording.put(|| id.clone(), told.unwrap_or(f64::NAN) / si);
                }
                truth.put(|| format!("{id}.input"), input);
                truth.put(|| format!("{id}.error"), said - input);
                truth.put(|| format!("{id}.fault"), f64::from(u8::from(faults.active(time_s))));
                outputs.push(Output { id: id.clone(), input, told });
            }
            let id = &entry.ids.0;
            truth.put(|| format!("{id}.temperature"), around.temperature);
            truth.put(|| format!("{id}.gradient"), around.gradient);
            if self.scenario.recorded.pickoff.as_ref() == Some(id) {
                recording.put(|| format!("{id}.pickoff_x"), reading.pickoff[0]);
                recording.put(|| format!("{id}.pickoff_y"), reading.pickoff[1]);
            }
        }
    }

    fn read_fogs(
        &mut self,
        time_s: f64,
        seen: &Seen<'_>,
        [parasitic, fitted]: [&[(String, f64)]; 2],
        outputs: &mut Vec<Output>,
        recording: &mut Rows,
        truth: &mut Rows,
    ) {
        let step_s = self.scenario.step_s;
        for ((fog, faults), entry) in self.fogs.iter_mut().zip(&self.scenario.fogs) {
            let motion = seen.by(&entry.id);
            let mut around = self.environment.around(entry.position_m, &motion.end.attitude);
            around.parasitic = of(parasitic, &entry.id);
            let reading = fog.step(&motion.rate, &around, step_s);
            let (id, input) = (&entry.id, reading.true_rate);
            let said = reading.rate + of(fitted, id);
            let told = faults.apply(time_s, said);
            recording.put(|| id.clone(), told.unwrap_or(f64::NAN) / entry.unit.in_si());
            truth.put(|| format!("{id}.input"), input);
            truth.put(|| format!("{id}.error"), said - input);
            truth.put(|| format!("{id}.fault"), f64::from(u8::from(faults.active(time_s))));
            truth.put(|| format!("{id}.temperature"), around.temperature);
            truth.put(|| format!("{id}.gradient"), around.gradient);
            outputs.push(Output { id: id.clone(), input, told });
        }
    }

    fn read_accelerometers(
        &mut self,
        time_s: f64,
        seen: &Seen<'_>,
        [parasitic, fitted]: [&[(String, f64)]; 2],
        outputs: &mut Vec<Output>,
        recording: &mut Rows,
        truth: &mut Rows,
    ) {
        let step_s = self.scenario.step_s;
        for ((instrument, faults), entry) in self.accelerometers.iter_mut().zip(&self.scenario.accelerometers)
        {
            let motion = seen.by(&entry.id);
            let mut around = self.environment.around(entry.position_m, &motion.end.attitude);
            around.parasitic = of(parasitic, &entry.id);
            let reading = instrument.step(&motion.rate, &motion.force, &around, step_s);
            let (id, input) = (&entry.id, reading.true_force);
            let said = reading.specific_force + of(fitted, id);
            let told = faults.apply(time_s, said);
            if entry.recorded {
                recording.put(|| id.clone(), told.unwrap_or(f64::NAN) / entry.unit.in_si());
            }
            truth.put(|| format!("{id}.input"), input);
            truth.put(|| format!("{id}.error"), said - input);
            truth.put(|| format!("{id}.fault"), f64::from(u8::from(faults.active(time_s))));
            truth.put(|| format!("{id}.temperature"), around.temperature);
            truth.put(|| format!("{id}.gradient"), around.gradient);
            outputs.push(Output { id: id.clone(), input, told });
        }
    }

    fn read_dopplers(
        &mut self,
        time_s: f64,
        motion: &StepMotion,
        [parasitic, fitted]: [&[(String, f64)]; 2],
        recording: &mut Rows,
        truth: &mut Rows,
    ) {
        let mut around = self.environment.around(0.0, &motion.end.attitude);
        for ((doppler, faults), entry) in self.dopplers.iter_mut().zip(&self.scenario.dopplers) {
            around.parasitic = of(parasitic, &entry.id);
            let reading = doppler.read(time_s, &motion.end, &around, self.scenario.step_s);
            let (id, input) = (&entry.id, reading.true_velocity);
            let said = reading.velocity + of(fitted, id);
            let told = faults.apply(time_s, said);
            recording.put(|| id.clone(), told.unwrap_or(f64::NAN));
            truth.put(|| format!("{id}.input"), input);
            truth.put(|| format!("{id}.error"), said - input);
            truth.put(|| format!("{id}.fault"), f64::from(u8::from(faults.active(time_s))));
        }
    }

    fn read_loop(
        &mut self,
        time_s: f64,
        motion: &StepMotion,
        [parasitic, fitted]: [&[(String, f64)]; 2],
        outputs: &[Output],
        recording: &mut Rows,
        truth: &mut Rows,
    ) {
        let (Some(channel), Some(entry)) = (&mut self.channel, &self.scenario.schuler_loop) else { return };
        let step_s = self.scenario.step_s;
        let component = usize::from(entry.channel == Channel::East);
        let acceleration = (motion.end.velocity[component] - self.before.velocity[component]) / step_s;
        let accelerometer = channel.accelerometer.mean(step_s, outputs, of(parasitic, "accelerometer"));
        let drift = channel.gyro.mean(step_s, outputs, of(parasitic, "gyro"));
        channel.truth.advance(step_s, accelerometer, drift, acceleration);
        let velocity = motion.end.velocity[component];
        let delayed = channel.reference.pass(time_s, velocity);
        let noise = entry.velocity_white * channel.noise.normal();
        let compared = if entry.absolute { velocity } else { velocity - delayed };
        let said = channel.truth.velocity_error
            + compared
            + noise
            + of(parasitic, &entry.id)
            + of(fitted, &entry.id);
        let told = channel.faults.apply(time_s, said);
        let out = entry.outages.iter().any(|(start, length)| time_s >= *start && time_s < start + length);
        let id = &entry.id;
        recording.put(|| id.clone(), told.filter(|_| !out).unwrap_or(f64::NAN));
        for (name, value) in [
            ("velocity_error", channel.truth.velocity_error),
            ("tilt", channel.truth.tilt),
            ("accelerometer_error", accelerometer),
            ("gyro_drift", drift),
            ("fault", f64::from(u8::from(channel.faults.active(time_s)))),
        ] {
            truth.put(|| format!("{id}.{name}"), value);
        }
    }

    /// What each disturbed output gets, by its id.
    fn disturb(
        &mut self,
        time_s: f64,
        motion: &StepMotion,
        quantities: &[(String, f64)],
    ) -> Vec<(String, f64)> {
        let scenario = self.scenario;
        let environment = &self.environment;
        let force = StepMotion::mean(&motion.force);
        (self.parasites.iter_mut().zip(&scenario.parasites))
            .map(|(parasite, entry)| {
                let temperature = environment.temperature(position(scenario, &entry.sensor));
                let felt = Felt { time_s, step_s: scenario.step_s, temperature, force, quantities };
                (entry.sensor.clone(), parasite.step(&felt))
            })
            .collect()
    }

    /// What fitted terms add to each output, by its id.
    fn fitted(
        &mut self,
        time_s: f64,
        motion: &StepMotion,
        quantities: &[(String, f64)],
    ) -> Vec<(String, f64)> {
        if self.fitted.is_empty() {
            return Vec::new();
        }
        let step_s = self.scenario.step_s;
        let step = fitted::Step {
            time_s,
            step_s,
            mean: [StepMotion::mean(&motion.rate), StepMotion::mean(&motion.force)],
            ends: [&self.before, &motion.end],
            environment: &self.environment,
            quantities,
        };
        let inputs = fitted::inputs(self.scenario, &step, &mut self.warm_before);
        (self.fitted.iter_mut().zip(&self.scenario.fitted))
            .map(|(term, entry)| (entry.sensor.clone(), term.step(step_s, &inputs)))
            .collect()
    }

    fn read_surroundings(
        &mut self,
        motion: &StepMotion,
        quantities: &[(String, f64)],
        recording: &mut Rows,
        truth: &mut Rows,
    ) {
        let recorded = &self.scenario.recorded;
        for (thermometer, entry) in self.thermometers.iter_mut().zip(&recorded.thermometers) {
            let place = self.environment.temperature(entry.position_m);
            recording.put(|| entry.column.clone(), thermometer.read(self.scenario.step_s, place));
            truth.put(|| format!("{}.temperature", entry.column), place);
        }
        for ((column, value), entry) in quantities.iter().zip(&recorded.quantities) {
            if entry.recorded {
                recording.put(|| column.clone(), *value);
            }
        }
        if recorded.voltage {
            recording.put(|| "supply_V".to_owned(), self.environment.voltage());
        }
        if recorded.magnetic_field {
            let field = self.environment.magnetic_field(&motion.end.attitude);
            recording.put3(["field_x", "field_y", "field_z"], &field);
        }
        if recorded.vibration {
            recording.put(|| "vibration_rms".to_owned(), self.environment.vibration_rms());
        }
    }
}

/// The motion as each output's instrument feels it.
struct Seen<'a> {
    motion: &'a StepMotion,
    late: &'a [StepMotion],
    /// Computed only where some instrument's output is a rotation vector.
    turned: Option<&'a StepMotion>,
    scenario: &'a Scenario,
}

impl Seen<'_> {
    fn by(&self, id: &str) -> &StepMotion {
        if let Some(turned) = self.turned
            && self.scenario.rotation_vectors.iter().any(|sensor| sensor == id)
        {
            return turned;
        }
        (self.scenario.clocks.iter().zip(self.late))
            .find(|(clock, _)| clock.sensors.iter().any(|sensor| sensor == id))
            .map_or(self.motion, |(_, late)| late)
    }
}

/// Sum of the values under a name.
fn of(values: &[(String, f64)], id: &str) -> f64 {
    values.iter().filter(|(name, _)| name == id).map(|(_, value)| value).sum()
}

/// Where an output's instrument sits along the bar, m.
fn position(scenario: &Scenario, id: &str) -> f64 {
    let gyro = scenario.gyros.iter().find(|it| it.ids.0 == id).map(|it| it.position_m);
    let fog = scenario.fogs.iter().find(|it| it.id == id).map(|it| it.position_m);
    let accelerometer = scenario.accelerometers.iter().find(|it| it.id == id).map(|it| it.position_m);
    gyro.or(fog).or(accelerometer).unwrap_or_default()
}

fn source(scenario: &Scenario, entry: &LoopEntry, source: &ErrorSource, name: &str) -> SourcePlant {
    match source {
        ErrorSource::Instrument(id) => {
            let gyro = scenario
                .gyros
                .iter()
                .find(|g| g.ids.0 == *id || g.ids.1.as_ref() == Some(id))
                .map(|g| g.nominal.bias * g.unit.in_si());
            let accelerometer =
                scenario.accelerometers.iter().find(|a| a.id == *id).map(|a| a.nominal.bias * a.unit.in_si());
            SourcePlant::Instrument(id.clone(), gyro.or(accelerometer).unwrap_or_default(), 0.0)
        }
        ErrorSource::Process { drift, white } => {
            let stream = |part: &str| Stream::new(scenario.seed, &format!("{}/{name}/{part}", entry.id));
            SourcePlant::Process(Drift::new(drift, stream("drift")), *white, stream("white"))
        }
    }
}

/// The case that goes with the recording of a scenario.
pub fn case(scenario: &Scenario) -> Case {
    let (site, course) = match &scenario.believed {
        Some(it) => (it.site, &it.motion),
        None => (scenario.site, &scenario.motion),
    };
    let three = |names: [&str; 3]| Some(names.map(str::to_owned));
    let mut motion = NominalMotion::default();
    match scenario.told {
        Told::Static => {
            motion.kind = MotionKind::Static;
            if let Motion::Static(attitude) = course {
                motion.attitude_deg = Some(NominalAttitude {
                    roll: attitude.roll.to_degrees(),
                    pitch: attitude.pitch.to_degrees(),
                    heading: attitude.heading.to_degrees(),
                });
            }
        }
        Told::Recorded => {
            motion.kind = MotionKind::Recorded;
            motion.rate = three(["ref_wx", "ref_wy", "ref_wz"]);
            motion.specific_force = three(["ref_fx", "ref_fy", "ref_fz"]);
            if scenario.recorded.attitude {
                motion.attitude_rad = three(["roll", "pitch", "yaw"]);
            }
        }
        Told::Navigation => {
            motion.kind = MotionKind::Recorded;
            motion.velocity_ned = three(["vn", "ve", "vd"]);
            motion.attitude_rad = three(["roll", "pitch", "yaw"]);
        }
        Told::Unknown => motion.kind = MotionKind::Unknown,
        Told::VelocityError => {
            motion.kind = MotionKind::VelocityError;
            if scenario.recorded.specific_force {
                motion.specific_force = three(["fx", "fy", "fz"]);
            }
        }
    }
    Case {
        title: scenario.title.clone(),
        recording: Source {
            path: RECORDING.into(),
            time: Some("t".to_owned()),
            step_s: Some(scenario.step_s),
            ..Source::default()
        },
        site: Some(NominalSite {
            latitude_deg: site.latitude.to_degrees(),
            longitude_deg: None,
            altitude_m: site.height,
        }),
        simulation: None,
        motion,
        schuler_loop: scenario.schuler_loop.as_ref().map(|entry| entry.nominal),
        sensors: sensors(scenario),
        calibration: None,
        auxiliaries: auxiliaries(scenario),
        effects: Vec::new(),
    }
}

fn sensors(scenario: &Scenario) -> Vec<Sensor> {
    let rounding = |conversion: &Conversion, si: f64| match conversion {
        Conversion::Rounding(step) => step / si,
        Conversion::Exact | Conversion::Pulses(_) => 0.0,
    };
    let mut all = Vec::new();
    for entry in scenario.gyros.iter().filter(|entry| entry.recorded) {
        let d = &entry.design;
        let (x, z) = (d.input_axis, d.spin_axis);
        let axes = [x, z.cross(&x)];
        let ids = [Some(&entry.ids.0), entry.ids.1.as_ref()];
        for ((id, axis), readout) in ids.into_iter().zip(axes).zip(&d.readout) {
            let Some(id) = id else { continue };
            all.push(Sensor {
                axis: Some(axis.into()),
                group: entry.group.clone(),
                spin_axis: Some(z.into()),
                quantisation: rounding(&readout.conversion, entry.unit.in_si()),
                relative: entry.relative,
                ..Sensor::new(id, SensorKind::Dtg, entry.unit, entry.nominal.clone())
            });
        }
    }
    for entry in &scenario.fogs {
        all.push(Sensor {
            axis: Some(entry.design.input_axis.into()),
            group: entry.group.clone(),
            quantisation: rounding(&entry.design.readout.conversion, entry.unit.in_si()),
            relative: entry.relative,
            ..Sensor::new(&entry.id, SensorKind::Fog, entry.unit, entry.nominal.clone())
        });
    }
    for entry in scenario.accelerometers.iter().filter(|entry| entry.recorded) {
        all.push(Sensor {
            axis: Some(entry.design.input_axis.into()),
            group: entry.group.clone(),
            quantisation: rounding(&entry.design.readout.conversion, entry.unit.in_si()),
            relative: entry.relative,
            ..Sensor::new(&entry.id, SensorKind::Accelerometer, entry.unit, entry.nominal.clone())
        });
    }
    for entry in &scenario.dopplers {
        all.push(Sensor {
            axis: Some(entry.design.axis.into()),
            group: entry.group.clone(),
            quantisation: rounding(&entry.design.readout.conversion, 1.0),
            ..Sensor::new(&entry.id, SensorKind::Doppler, Unit::MetrePerSecond, entry.nominal.clone())
        });
    }
    if let Some(entry) = &scenario.schuler_loop {
        let nominal = Nominal { white: entry.nominal.velocity_white, ..Nominal::default() };
        all.push(Sensor::new(&entry.id, SensorKind::InsVelocity, Unit::MetrePerSecond, nominal));
    }
    all
}

fn auxiliaries(scenario: &Scenario) -> Vec<Auxiliary> {
    let recorded = &scenario.recorded;
    let plain = |column: &str, quantity: Quantity, unit: &str| Auxiliary {
        column: column.to_owned(),
        quantity,
        unit: unit.to_owned(),
        scale: None,
        offset: None,
        near: None,
        position_m: None,
    };
    let mut all: Vec<Auxiliary> = recorded
        .thermometers
        .iter()
        .map(|t| Auxiliary {
            near: t.near.clone(),
            position_m: Some([t.position_m, 0.0, 0.0]),
            ..plain(&t.column, Quantity::Temperature, "degC")
        })
        .collect();
    for entry in recorded.quantities.iter().filter(|entry| entry.recorded) {
        all.push(Auxiliary { near: entry.near.clone(), ..plain(&entry.column, entry.quantity, &entry.unit) });
    }
    if recorded.voltage {
        all.push(plain("supply_V", Quantity::Voltage, "V"));
    }
    if recorded.magnetic_field {
        all.push(plain("field_x", Quantity::MagneticFieldX, "T"));
        all.push(plain("field_y", Quantity::MagneticFieldY, "T"));
        all.push(plain("field_z", Quantity::MagneticFieldZ, "T"));
    }
    if recorded.vibration {
        all.push(plain("vibration_rms", Quantity::VibrationRms, "m/s^2"));
    }
    if let Some(id) = &recorded.pickoff {
        for axis in ["x", "y"] {
            let column = format!("{id}.pickoff_{axis}");
            all.push(Auxiliary { near: Some(id.clone()), ..plain(&column, Quantity::Other, "rad") });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Believed, ScenarioFile};
    use schuler_recording::Recording;

    fn simulated(text: &str) -> Simulated {
        let file = ScenarioFile::parse(Path::new("s.toml"), text).unwrap();
        assert!(file.warnings.is_empty(), "{:?}", file.warnings);
        run(&file.scenario, |_| Ok(())).unwrap()
    }

    const BENCH: &str = r#"
format = "schuler-scenario/1"
seed = 3
[time]
duration_s = 600.0
[site]
latitude_deg = 55.57
altitude_m = 150.0
[motion]
kind = "static"
attitude_deg = { roll = 10.0, pitch = -5.0, heading = 30.0 }
[thermal]
ambient_degC = { time_s = [0, 600], value = [20.0, 25.0] }
bar = {}
[[thermometer]]
column = "temp"
near = "gx"
quantisation = 0.0625
[[gyro]]
id = "gx"
second_id = "gy"
unit = "deg/h"
  [gyro.noise]
  white = 0.02
[[accelerometer]]
id = "ax"
unit = "ug"
  [accelerometer.noise]
  white = 5.0
[[gap]]
start_s = 100
duration_s = 5
"#;

    #[test]
    fn what_is_written_reads_back_as_a_case_with_the_predicted_outputs() {
        let directory = tempfile::tempdir().unwrap();
        let written = simulated(BENCH).write(directory.path()).unwrap();
        let recording = Recording::read(&written.case).unwrap();
        assert!(recording.warnings.is_empty(), "{:?}", recording.warnings);
        assert_eq!((recording.len(), recording.gaps.len()), (600, 1));
        // The case's own prediction, made by other code, agrees with the ideal instruments' outputs.
        for (id, tolerance) in [("gx", 4e-9), ("gy", 4e-9), ("ax", 1e-3)] {
            let series = recording.sensor(id).unwrap();
            let predicted = match schuler_recording::motion::predict(&recording, &series.sensor).unwrap() {
                schuler_recording::motion::Prediction::Constant(value) => value,
                series @ schuler_recording::motion::Prediction::Series(_) => panic!("{series:?}"),
            };
            let present: Vec<f64> = series.values.iter().copied().filter(|v| v.is_finite()).collect();
            let mean = present.iter().sum::<f64>() / present.len() as f64;
            assert!((mean - predicted).abs() < tolerance, "{id}: {mean:e} against {predicted:e}");
        }
    }

    #[test]
    fn what_is_believed_is_told_and_what_is_true_is_felt() {
        let text = BENCH
            .replace("kind = \"static\"", "kind = \"table\"")
            .replace("[thermal]", "[case]\nattitude = true\n[thermal]");
        let told = ScenarioFile::parse(Path::new("s.toml"), &text).unwrap().scenario;
        let mut other = told.clone();
        other.believed = Some(Believed { site: told.site, motion: told.motion.clone() });
        other.site.gravity_anomaly = 1e-4;
        if let Motion::Table { start, .. } = &mut other.motion {
            start.heading += 0.01;
        }
        let (a, b) = (run(&told, |_| Ok(())).unwrap(), run(&other, |_| Ok(())).unwrap());
        assert_eq!(a.case, b.case);
        for column in ["ref_wx", "ref_wy", "ref_fz", "roll", "pitch", "yaw"] {
            assert_eq!(a.recording.get(column).unwrap()[7], b.recording.get(column).unwrap()[7], "{column}");
        }
        let gain = |column: &str| b.recording.get(column).unwrap()[7] - a.recording.get(column).unwrap()[7];
        // −δψ Ω cos φ along the level starboard axis of a body at heading 30°, in degrees per hour; −δg along x, in µg.
        let (roll, pitch, heading) = (10f64.to_radians(), -5f64.to_radians(), 30f64.to_radians());
        let east = nalgebra::Rotation3::from_euler_angles(roll, pitch, heading).inverse() * Vector3::y();
        let earth = 15.041_067 * 55.57f64.to_radians().cos();
        assert!((gain("gx") / (-0.01 * earth * east.x) - 1.0).abs() < 0.01, "{}", gain("gx"));
        assert!((gain("ax") / (1e-4 * pitch.sin() / 9.80665e-6) - 1.0).abs() < 1e-3, "{}", gain("ax"));
    }

    #[test]
    fn another_sensor_changes_nothing_for_the_others() {
        let more = format!("{BENCH}[[gyro]]\nid = \"extra\"\n[gyro.noise]\nwhite = 1.0\n");
        let (a, b) = (simulated(BENCH), simulated(&more));
        for column in ["gx", "gy", "ax", "temp"] {
            assert_eq!(a.recording.get(column), b.recording.get(column), "{column}");
        }
        let reseeded = simulated(&BENCH.replace("seed = 3", "seed = 4"));
        assert_ne!(a.recording.get("gx"), reseeded.recording.get("gx"));
    }

    #[test]
    fn the_loop_is_driven_by_its_instruments() {
        let text = r#"
format = "schuler-scenario/1"
[time]
duration_s = 3000.0
[motion]
kind = "vehicle"
level_platform = true
[[gyro]]
id = "ge"
input_axis = [0.0, 1.0, 0.0]
unit = "deg/h"
  [gyro.torque]
  reaction_Nm = [0.0, 2e-9]
[loop]
gyro = "ge"
velocity_white = 0.0
"#;
        let it = simulated(text);
        let drift = it.truth.get("velocity_error.gyro_drift").unwrap();
        let error = it.truth.get("ge.error").unwrap();
        assert_eq!(drift, error);
        assert!(drift[0].abs() > 1e-8);
        // ΔV = −R ω (1 − cos ω_S t).
        let t = 3000.0;
        let w = (9.80665f64 / 6_371_000.0).sqrt();
        let expected = -6_371_000.0 * drift[0] * (1.0 - (w * t).cos());
        let found = it.recording.get("velocity_error").unwrap()[2999];
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    }

    #[test]
    fn a_run_can_be_stopped() {
        let file = ScenarioFile::parse(Path::new("s.toml"), BENCH).unwrap();
        let stopped = run(&file.scenario, |k| if k > 10 { Err(Interrupted) } else { Ok(()) });
        assert_eq!(stopped, Err(Interrupted));
    }
}
