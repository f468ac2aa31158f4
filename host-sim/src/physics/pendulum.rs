//! A pendulous accelerometer: a pendulum on a hinge, held by a servo.
//!
//! Instrument axes: i the input axis, p from the hinge to the pendulum's mass, o = i × p the hinge. θ turns the mass
//! towards −i:
//!
//! J θ̈ + D θ̇ + Kh θ = P (fi cos θ + fp sin θ) + J ωi ωp − J ω̇o + hinge torque − T
//!
//! with the servo T from the pick-off p = θ − θ₀ through stiffness, a leaky integrator and the torquer's lag. The current
//! that makes T is the output. Because the servo gives way a little, θ follows fi, and fp leaks in through sin θ (cross
//! coupling, rectified vibration). SI units. The fast path solves the servo's equilibrium exactly, at the ends of each
//! part of a step, and subtracts the servo's lag; the full-rate integration is there to check it.
use nalgebra::{Complex, Matrix3, Matrix4, UnitQuaternion, Vector3, Vector4};

use super::heat::Lag;
use super::linear::growth;
use super::readout::{Nonlinearity, REFERENCE_TEMPERATURE, Readout, ReadoutDesign, Surroundings};
use super::rotor::Unstable;

/// Pendulum and servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pendulum {
    /// Pendulosity P, kg m.
    pub pendulosity: f64,
    /// Inertia about the hinge J, kg m².
    pub inertia: f64,
    /// Damping D, N m s/rad.
    pub damping: f64,
    /// Stiffness of the hinge Kh, N m/rad.
    pub hinge: f64,
    /// Stiffness of the servo without integrator, N m/rad.
    pub servo: f64,
    /// By how much the integrator multiplies it at rest, beyond one.
    pub integrator: f64,
    /// Rate of the integrator's leak, rad/s.
    pub integrator_rate: f64,
    /// Bandwidth of the torquer, rad/s.
    pub torquer: f64,
}

impl Pendulum {
    /// Stiffness of the servo at rest, N m/rad.
    fn static_servo(&self) -> f64 {
        self.servo * (1.0 + self.integrator)
    }

    /// Equilibrium of θ for a specific force, an added torque and a pick-off null.
    fn equilibrium(&self, fi: f64, fp: f64, added: f64, null: f64) -> f64 {
        let servo = self.static_servo();
        let mut angle = null;
        for _ in 0..6 {
            let (s, c) = angle.sin_cos();
            let balance =
                self.pendulosity * (fi * c + fp * s) + added - self.hinge * angle - servo * (angle - null);
            let slope = self.pendulosity * (fp * c - fi * s) - self.hinge - servo;
            angle -= balance / slope;
        }
        angle
    }

    /// First derivative of the servo's stiffness with respect to the Laplace variable, at rest, N m s/rad.
    fn servo_slope(&self) -> f64 {
        -self.servo * self.integrator / self.integrator_rate - self.static_servo() / self.torquer
    }

    /// Time by which the servo's torque lags the input, s.
    fn lag_s(&self) -> f64 {
        let servo = self.static_servo();
        (self.damping - self.hinge * self.servo_slope() / servo) / (servo + self.hinge)
    }

    /// By how much θ leads its equilibrium per rate of change of the torque, rad/(N m/s): the integrator has yet to follow.
    fn lead(&self) -> f64 {
        -(self.damping + self.servo_slope()) / (self.static_servo() + self.hinge).powi(2)
    }

    /// θ per torque and servo torque per torque at an angular frequency.
    fn transfer(&self, w: f64) -> (Complex<f64>, Complex<f64>) {
        let s = Complex::new(0.0, w);
        let servo = (Complex::from(1.0)
            + Complex::from(self.integrator) / (Complex::from(1.0) + s / self.integrator_rate))
            * self.servo
            / (Complex::from(1.0) + s / self.torquer);
        let passive = s * s * self.inertia + s * self.damping + self.hinge;
        let angle = Complex::from(1.0) / (passive + servo);
        (angle, angle * servo)
    }

    fn matrix(&self) -> Matrix4<f64> {
        // θ, θ̇, integrator, torque.
        Matrix4::new(
            0.0,
            1.0,
            0.0,
            0.0,
            -self.hinge / self.inertia,
            -self.damping / self.inertia,
            0.0,
            -1.0 / self.inertia,
            self.integrator_rate * self.integrator,
            0.0,
            -self.integrator_rate,
            0.0,
            self.torquer * self.servo,
            0.0,
            self.torquer * self.servo,
            -self.torquer,
        )
    }
}

/// Everything about one accelerometer.
#[derive(Clone, Debug, PartialEq)]
pub struct AccelerometerDesign {
    /// Pendulum and servo.
    pub pendulum: Pendulum,
    /// Torque at the hinge, N m.
    pub hinge_torque: f64,
    /// Its change with the housing's temperature, N m/K.
    pub hinge_torque_temperature: f64,
    /// Its change with the temperature gradient, N m/(K/m).
    pub hinge_torque_gradient: f64,
    /// Null of the pick-off, rad.
    pub pickoff_offset: f64,
    /// Its change with the housing's temperature, rad/K.
    pub pickoff_offset_temperature: f64,
    /// Torquer: from current (in m/s² of the design's gain) to torque over pendulosity.
    pub torquer: Nonlinearity,
    /// Relative change of the torquer's gain with the magnet's temperature, 1/K.
    pub torquer_temperature: f64,
    /// Power in the torquer per square of the specific force, W/(m/s²)².
    pub torquer_power: f64,
    /// Heating of the magnet, K/W.
    pub magnet_resistance: f64,
    /// Time constant of that, s.
    pub magnet_lag_s: f64,
    /// Output, in m/s².
    pub readout: ReadoutDesign,
    /// Input axis in the body.
    pub input_axis: Vector3<f64>,
    /// Pendulum's direction in the body, at right angles to it.
    pub pendulum_axis: Vector3<f64>,
    /// Rotation of the housing beside the nominal axes, rotation vector in instrument axes, rad.
    pub misalignment: Vector3<f64>,
    /// Place in the body, from the point whose motion is given, m.
    pub arm: Vector3<f64>,
    /// Integrate at full rate instead of using the equilibrium.
    pub full_rate: bool,
}

impl AccelerometerDesign {
    /// An accelerometer without any error but the servo's finite stiffness.
    pub fn ideal() -> Self {
        Self {
            pendulum: Pendulum {
                pendulosity: 8e-6,
                inertia: 6.4e-8,
                damping: 1.6e-4,
                hinge: 1e-3,
                servo: 0.1,
                integrator: 200.0,
                integrator_rate: 2.0,
                torquer: 2.0e4,
            },
            hinge_torque: 0.0,
            hinge_torque_temperature: 0.0,
            hinge_torque_gradient: 0.0,
            pickoff_offset: 0.0,
            pickoff_offset_temperature: 0.0,
            torquer: Nonlinearity::default(),
            torquer_temperature: 0.0,
            torquer_power: 0.0,
            magnet_resistance: 0.0,
            magnet_lag_s: 0.0,
            readout: ReadoutDesign { range: f64::INFINITY, ..ReadoutDesign::default() },
            input_axis: Vector3::x(),
            pendulum_axis: Vector3::y(),
            misalignment: Vector3::zeros(),
            arm: Vector3::zeros(),
            full_rate: false,
        }
    }
}

/// What an accelerometer says of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccelerometerReading {
    /// Indicated specific force, m/s².
    pub specific_force: f64,
    /// Mean true specific force along the nominal input axis at the point whose motion is given, m/s².
    pub true_force: f64,
    /// Whether it is at the end of its range.
    pub saturated: bool,
}

/// An accelerometer at work.
#[derive(Clone, Debug)]
pub struct Accelerometer {
    design: AccelerometerDesign,
    /// Rows: i, p, o in body axes.
    to_instrument: Matrix3<f64>,
    readout: Readout,
    magnet_rise: Lag,
    power_before: f64,
    /// State of the full-rate integration and its time.
    state: Option<Vector4<f64>>,
    time_s: f64,
}

/// What drives the pendulum at one instant.
#[derive(Clone, Copy, Debug, Default)]
struct Drive {
    fi: f64,
    fp: f64,
    added: f64,
}

/// One part of a step, in which the drive goes linearly from start to end.
struct Part {
    start: Drive,
    end: Drive,
    /// Pick-off angle that the loop holds at zero, rad.
    null: f64,
    /// Time at its start, s.
    time_s: f64,
    duration_s: f64,
}

impl Accelerometer {
    /// The accelerometer called `name` of the run with this seed.
    ///
    /// # Errors
    /// A servo that is not stable.
    pub fn new(design: AccelerometerDesign, seed: u64, name: &str) -> Result<Self, Unstable> {
        let growth = growth(&design.pendulum.matrix());
        // Not a number is not stable either.
        if growth.is_nan() || growth >= 0.0 {
            return Err(Unstable { growth });
        }
        let i = design.input_axis.normalize();
        let p = design.pendulum_axis.normalize();
        let nominal = Matrix3::from_rows(&[i.transpose(), p.transpose(), i.cross(&p).transpose()]);
        let turned = UnitQuaternion::from_scaled_axis(-design.misalignment).to_rotation_matrix();
        Ok(Self {
            to_instrument: turned.matrix() * nominal,
            readout: Readout::new(design.readout.clone(), seed, name),
            magnet_rise: Lag::new(0.0),
            power_before: 0.0,
            state: None,
            time_s: 0.0,
            design,
        })
    }

    /// One reading: the mean over a step cut into equal parts, with rate and specific force in body axes at the parts' ends
    /// (`parts + 1` entries).
    pub fn step(
        &mut self,
        rate: &[Vector3<f64>],
        specific_force: &[Vector3<f64>],
        around: &Surroundings,
        step_s: f64,
    ) -> AccelerometerReading {
        let parts = rate.len().min(specific_force.len()).saturating_sub(1).max(1);
        let part_s = step_s / parts as f64;
        let d = &self.design;
        let p = &d.pendulum;
        let warm = around.temperature - REFERENCE_TEMPERATURE;
        let null = d.pickoff_offset + d.pickoff_offset_temperature * warm;
        let hinge_torque =
            d.hinge_torque + d.hinge_torque_temperature * warm + d.hinge_torque_gradient * around.gradient;
        let drift = self.readout.drift(step_s);
        let vibration = self.to_instrument * around.vibration;

        let drive = |w: &Vector3<f64>, f: &Vector3<f64>, w_dot: &Vector3<f64>| {
            let here = f + w_dot.cross(&d.arm) + w.cross(&w.cross(&d.arm));
            let f = self.to_instrument * here;
            let (w, w_dot) = (self.to_instrument * w, self.to_instrument * w_dot);
            Drive { fi: f.x, fp: f.y, added: hinge_torque + p.inertia * (w.x * w.y - w_dot.z) }
        };
        let mut torque = 0.0;
        let mut last_state = self.state;
        let mut time_s = self.time_s;
        for (w, f) in rate.windows(2).zip(specific_force.windows(2)) {
            let ([w0, w1], [f0, f1]) = (w, f) else { continue };
            let w_dot = (w1 - w0) / part_s;
            let (start, end) = (drive(w0, f0, &w_dot), drive(w1, f1, &w_dot));
            let mean = if d.full_rate {
                let state = last_state.unwrap_or_else(|| self.settled(&start, null));
                let part = Part { start, end, null, time_s, duration_s: part_s };
                let (state, mean) = self.integrate(state, &part, &vibration, around.vibration_hz);
                last_state = Some(state);
                mean
            } else {
                let held = |e: &Drive| p.static_servo() * (p.equilibrium(e.fi, e.fp, e.added, null) - null);
                let (t0, t1) = (held(&start), held(&end));
                let slope = (t1 - t0) / part_s;
                let leaked = p.pendulosity * 0.5 * (start.fp + end.fp) * p.lead() * slope;
                0.5 * (t0 + t1) - p.lag_s() * slope + leaked
            };
            torque += mean / parts as f64;
            time_s += part_s;
        }
        self.state = last_state;
        self.time_s = time_s;

        let d = &self.design;
        let p = &d.pendulum;
        let mut held = torque / p.pendulosity;
        let mut rectified = 0.0;
        if !d.full_rate && around.vibration_hz > 0.0 {
            // Second order in the vibration: θ̂ f̂p over a cycle, and the torquer's quadratic part.
            let (angle, servo) = p.transfer(std::f64::consts::TAU * around.vibration_hz);
            let angle = angle * (p.pendulosity * vibration.x);
            held += 0.5 * angle.re * vibration.y;
            let alternating = (servo * vibration.x).norm_sqr();
            rectified = -0.5 * d.torquer.quadratic * alternating;
        }
        let gain = d.torquer.gain + d.torquer_temperature * (warm + self.magnet_rise.value());
        let current = Nonlinearity { gain, ..d.torquer }.invert(held) + rectified;
        let rise = d.magnet_resistance * d.torquer_power * current * current;
        self.magnet_rise.advance(step_s, d.magnet_lag_s, self.power_before, rise);
        self.power_before = rise;

        let reading = self.readout.read(current + drift, around, step_s);
        let i = self.design.input_axis.normalize();
        let true_force =
            specific_force.windows(2).map(|f| (f[0] + f[1]).dot(&i) / (2.0 * parts as f64)).sum();
        AccelerometerReading {
            specific_force: reading,
            true_force,
            saturated: self.readout.saturated(reading),
        }
    }

    fn settled(&self, drive: &Drive, null: f64) -> Vector4<f64> {
        let p = &self.design.pendulum;
        let angle = p.equilibrium(drive.fi, drive.fp, drive.added, null);
        Vector4::new(angle, 0.0, p.integrator * (angle - null), p.static_servo() * (angle - null))
    }

    /// Full-rate integration over one part; returns the state and the mean servo torque.
    fn integrate(
        &self,
        mut state: Vector4<f64>,
        part: &Part,
        vibration: &Vector3<f64>,
        vibration_hz: f64,
    ) -> (Vector4<f64>, f64) {
        let Part { start, end, null, time_s, duration_s: part_s } = *part;
        let p = &self.design.pendulum;
        let fastest = p.torquer.max(p.damping / p.inertia).max((p.servo / p.inertia).sqrt());
        let steps = (part_s * fastest * 3.0).ceil().max(1.0) as usize;
        let h = part_s / steps as f64;
        let w = std::f64::consts::TAU * vibration_hz;
        let slope = |x: &Vector4<f64>, t: f64| {
            let share = t / part_s;
            let mix = |a: f64, b: f64| a + (b - a) * share;
            let shake = if vibration_hz > 0.0 { (w * (time_s + t)).sin() } else { 0.0 };
            let fi = mix(start.fi, end.fi) + vibration.x * shake;
            let fp = mix(start.fp, end.fp) + vibration.y * shake;
            let (s, c) = x[0].sin_cos();
            let external = p.pendulosity * (fi * c + fp * s) + mix(start.added, end.added);
            let pickoff = x[0] - null;
            Vector4::new(
                x[1],
                (external - p.damping * x[1] - p.hinge * x[0] - x[3]) / p.inertia,
                p.integrator_rate * (p.integrator * pickoff - x[2]),
                p.torquer * (p.servo * (pickoff + x[2]) - x[3]),
            )
        };
        let mut sum = 0.0;
        for k in 0..steps {
            let t = k as f64 * h;
            let k1 = slope(&state, t);
            let k2 = slope(&(state + k1 * (0.5 * h)), t + 0.5 * h);
            let k3 = slope(&(state + k2 * (0.5 * h)), t + 0.5 * h);
            let k4 = slope(&(state + k3 * h), t + h);
            let next = state + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
            // Trapezoid with its end correction.
            sum += 0.5 * (state[3] + next[3]) * h + (k1[3] - slope(&next, t + h)[3]) * h * h / 12.0;
            state = next;
        }
        (state, sum / part_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::earth::STANDARD_GRAVITY as G;

    fn tell(design: &AccelerometerDesign, f: Vector3<f64>, around: &Surroundings) -> f64 {
        let mut it = Accelerometer::new(design.clone(), 1, "a").unwrap();
        it.step(&[Vector3::zeros(); 2], &[f; 2], around, 1.0).specific_force
    }

    #[test]
    fn six_position_tumble_recovers_bias_scale_and_cross_coupling() {
        let mut design = AccelerometerDesign::ideal();
        design.hinge_torque = design.pendulum.pendulosity * 5e-4;
        design.torquer.gain = -2e-4;
        design.torquer.quadratic = 2e-6;
        let still = Surroundings::default();
        let p = design.pendulum;
        let (i, q) = (Vector3::x() * G, Vector3::y() * G);
        let (up, down) = (tell(&design, i, &still), tell(&design, -i, &still));
        // The hinge takes its share of the torque: 1/(1 + Kh/Ks).
        let servo = p.servo * (1.0 + p.integrator);
        let share = servo / (servo + p.hinge);
        let bias = 0.5 * (up + down);
        let scale = (up - down) / (2.0 * G);
        assert!((scale - share * (1.0 + 2e-4)).abs() < 1e-7, "{scale}");
        // The quadratic part of the torquer is told with its sign reversed.
        let expected = 5e-4 * share * 1.0002 - 2e-6 * G * G;
        assert!((bias - expected).abs() < 1e-6 * G * G * 1e-2, "{bias} {expected}");
        // Both axes loaded: θ = P fi/(Ks + Kh) lets in P fp θ.
        let mut clean = AccelerometerDesign::ideal();
        clean.pendulum = p;
        let both = tell(&clean, (i + q) * std::f64::consts::FRAC_1_SQRT_2, &still);
        let alone = tell(&clean, i * std::f64::consts::FRAC_1_SQRT_2, &still);
        let coupling = (both - alone) / (0.5 * G * G);
        let expected = p.pendulosity / (servo + p.hinge);
        assert!((coupling / expected - 1.0).abs() < 2e-3, "{coupling} {expected}");
    }

    #[test]
    fn pickoff_null_against_the_hinge_is_a_bias_that_moves_with_temperature() {
        let mut design = AccelerometerDesign::ideal();
        design.pickoff_offset = 1e-5;
        design.pickoff_offset_temperature = 2e-7;
        let warm = Surroundings { temperature: 40.0, ..Surroundings::default() };
        let told = tell(&design, Vector3::zeros(), &warm);
        let expected = -design.pendulum.hinge * 1.4e-5 / design.pendulum.pendulosity;
        assert!((told / expected - 1.0).abs() < 1e-4, "{told} {expected}");
    }

    #[test]
    fn equilibrium_agrees_with_the_full_rate_integration() {
        let mut design = AccelerometerDesign::ideal();
        design.pickoff_offset = 2e-5;
        design.hinge_torque = 1e-9;
        design.misalignment = Vector3::new(1e-3, -2e-3, 5e-4);
        design.arm = Vector3::new(0.1, -0.2, 0.3);
        let mut fast = Accelerometer::new(design.clone(), 1, "a").unwrap();
        let mut full = Accelerometer::new(AccelerometerDesign { full_rate: true, ..design }, 1, "a").unwrap();
        for k in 0..3 {
            let at = |j: usize| {
                let t = f64::from(k) + j as f64 / 10.0;
                (Vector3::new(0.1 * t, 0.2, -0.05 * t * t), Vector3::new(5.0 * (0.4 * t).sin(), 3.0 - t, -G))
            };
            let (w, f): (Vec<_>, Vec<_>) = (0..=10).map(at).unzip();
            let around = Surroundings::default();
            let (a, b) = (fast.step(&w, &f, &around, 1.0), full.step(&w, &f, &around, 1.0));
            // Neglected: the second moment of the servo's response, 4e-6 s², times the change of the slope; the integration
            // also starts from rest, not from a ramp.
            let bar = if k == 0 { 1e-5 } else { 4e-6 };
            assert!((a.specific_force - b.specific_force).abs() < bar, "{k}: {a:?} {b:?}");
        }
    }

    #[test]
    fn rectified_vibration_agrees_with_the_full_rate_integration() {
        let mut design = AccelerometerDesign::ideal();
        design.torquer.quadratic = 3e-6;
        let around = Surroundings {
            vibration: Vector3::new(20.0, 20.0, 0.0),
            vibration_hz: 40.0,
            ..Surroundings::default()
        };
        let mut fast = Accelerometer::new(design.clone(), 1, "a").unwrap();
        // The integration's torquer is inverted after the mean, so its quadratic part is tested on its own below.
        design.torquer.quadratic = 0.0;
        let mut full =
            Accelerometer::new(AccelerometerDesign { full_rate: true, ..design.clone() }, 1, "a").unwrap();
        let mut pendulous = Accelerometer::new(design.clone(), 1, "a").unwrap();
        let (w, f) = ([Vector3::zeros(); 2], [Vector3::new(0.5, 0.2, -G); 2]);
        let mut told = [0.0; 3];
        for _ in 0..6 {
            told =
                [&mut fast, &mut full, &mut pendulous].map(|it| it.step(&w, &f, &around, 1.0).specific_force);
        }
        let still = tell(&design, f[0], &Surroundings::default());
        let (rectified, reference) = (told[2] - still, told[1] - still);
        assert!(reference.abs() > 1e-3);
        assert!((rectified / reference - 1.0).abs() < 0.01, "{rectified} {reference}");
        let (_, servo) = design.pendulum.transfer(std::f64::consts::TAU * 40.0);
        let quadratic = -0.5 * 3e-6 * (servo * 20.0).norm_sqr() - 3e-6 * 0.25;
        assert!((told[0] - told[2] - quadratic).abs() < 2e-3 * quadratic.abs());
    }
}
