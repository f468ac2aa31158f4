//! Programme of a rate table.
use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::ease::Ease;

/// One piece of a rate table's programme.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TableStep {
    /// Stand still.
    Dwell {
        /// For so long, s.
        duration_s: f64,
    },
    /// Turn by an angle about a body axis, smoothly (the rate and its derivative start and end at zero).
    Turn {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Angle, rad.
        angle: f64,
        /// Time it takes, s.
        duration_s: f64,
    },
    /// Turn about a body axis at a constant rate, reached and left over a ramp.
    Spin {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Rate, rad/s.
        rate: f64,
        /// Time in all, s.
        duration_s: f64,
        /// Time of either ramp, s.
        ramp_s: f64,
    },
    /// Swing about a body axis: angle = amplitude · sin(2πft), faded in and out over one cycle.
    Swing {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Amplitude, rad.
        amplitude: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Time in all, s.
        duration_s: f64,
    },
    /// Move a body axis round a cone: swings about the two axes across it, a quarter of a cycle apart.
    Cone {
        /// Body axis.
        axis: Unit<Vector3<f64>>,
        /// Half-angle of the cone, rad.
        amplitude: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Time in all, s.
        duration_s: f64,
    },
}

impl TableStep {
    /// How long the piece lasts, s.
    pub fn duration_s(&self) -> f64 {
        match *self {
            TableStep::Dwell { duration_s }
            | TableStep::Turn { duration_s, .. }
            | TableStep::Spin { duration_s, .. }
            | TableStep::Swing { duration_s, .. }
            | TableStep::Cone { duration_s, .. } => duration_s,
        }
    }

    fn axis(&self) -> Unit<Vector3<f64>> {
        match *self {
            TableStep::Dwell { .. } => Vector3::x_axis(),
            TableStep::Turn { axis, .. }
            | TableStep::Spin { axis, .. }
            | TableStep::Swing { axis, .. }
            | TableStep::Cone { axis, .. } => axis,
        }
    }

    /// Turn since the piece's start and the body's rate at a time within the piece.
    pub(super) fn turn(&self, t: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let TableStep::Cone { axis, amplitude, frequency_hz, duration_s } = *self else {
            let (angle, rate) = self.angle_and_rate(t);
            return (UnitQuaternion::from_axis_angle(&self.axis(), angle), self.axis().into_inner() * rate);
        };
        let least = axis.iamin();
        let first = Unit::new_normalize(axis.cross(&Vector3::ith(least, 1.0)));
        let second = Unit::new_unchecked(axis.cross(&first));
        let (outer, outer_rate) = swing(amplitude, frequency_hz, duration_s, t, 0.0);
        let (inner, inner_rate) = swing(amplitude, frequency_hz, duration_s, t, 0.25);
        let inner = UnitQuaternion::from_axis_angle(&second, inner);
        let rate = inner.inverse() * (first.into_inner() * outer_rate) + second.into_inner() * inner_rate;
        (UnitQuaternion::from_axis_angle(&first, outer) * inner, rate)
    }

    /// Angle about the piece's axis and its rate at a time within the piece.
    pub(super) fn angle_and_rate(&self, t: f64) -> (f64, f64) {
        match *self {
            TableStep::Dwell { .. } | TableStep::Cone { .. } => (0.0, 0.0),
            TableStep::Turn { angle, duration_s, .. } => {
                let ease = Ease::at(t / duration_s);
                (angle * ease.value, angle * ease.slope / duration_s)
            }
            TableStep::Spin { rate, duration_s, ramp_s, .. } => {
                // Smooth ramps: rate · ease up, hold, ease down; the angle is the integral.
                let hold_end = duration_s - ramp_s;
                let ramp_angle = 0.5 * rate * ramp_s;
                if t < ramp_s {
                    let x = t / ramp_s;
                    (rate * ramp_s * Ease::integral(x), rate * Ease::at(x).value)
                } else if t < hold_end {
                    (ramp_angle + rate * (t - ramp_s), rate)
                } else {
                    let x = (duration_s - t) / ramp_s.max(f64::MIN_POSITIVE);
                    let total = 2.0 * ramp_angle + rate * (hold_end - ramp_s);
                    (total - rate * ramp_s * Ease::integral(x), rate * Ease::at(x).value)
                }
            }
            TableStep::Swing { amplitude, frequency_hz, duration_s, .. } => {
                swing(amplitude, frequency_hz, duration_s, t, 0.0)
            }
        }
    }
}

/// Angle and rate of a swing that is faded in and out over one cycle; `phase` in cycles.
fn swing(amplitude: f64, frequency_hz: f64, duration_s: f64, t: f64, phase: f64) -> (f64, f64) {
    let w = std::f64::consts::TAU * frequency_hz;
    let cycle = 1.0 / frequency_hz;
    let (envelope, slope) = if t < cycle {
        let e = Ease::at(t / cycle);
        (e.value, e.slope / cycle)
    } else if t > duration_s - cycle {
        let e = Ease::at((duration_s - t) / cycle);
        (e.value, -e.slope / cycle)
    } else {
        (1.0, 0.0)
    };
    let (s, c) = (w * t + std::f64::consts::TAU * phase).sin_cos();
    (amplitude * envelope * s, amplitude * (slope * s + envelope * w * c))
}
