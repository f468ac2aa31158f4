//! The undisturbed Schuler loop over a step.
use nalgebra::DMatrix;

use crate::catalogue::Port;
use crate::noise::Group;
use crate::numeric::within_step::over_step;
use crate::whitening::filter::Space;

/// Standard deviations of the loop's velocity error, m/s, and vertical error, rad, at the start.
const LOOP_START: [f64; 2] = [0.1, 1e-4];
/// A first velocity error of this many of its standard deviations means that the loop starts from there.
const START_SIGMAS: f64 = 3.0;

/// The undisturbed loop over a step, and what a constant accelerometer error and gyro drift add.
#[derive(Clone, Copy, Debug)]
pub(super) struct SchulerStep {
    /// What the rates of change of its states are of them: of the velocity error by the error of the vertical, and the other way round.
    generator: [[f64; 2]; 2],
    pub(super) transition: [[f64; 2]; 2],
    accelerometer: [f64; 2],
    gyro: [f64; 2],
    pub(super) start: [f64; 2],
}

impl SchulerStep {
    pub(super) fn new(gravity: f64, radius: f64, step_s: f64, first: f64) -> Self {
        let omega = (gravity / radius).sqrt();
        let speed = (gravity * radius).sqrt();
        let (sin, cos) = (omega * step_s).sin_cos();
        let start = if first.abs() > START_SIGMAS * LOOP_START[0] { first.abs() } else { LOOP_START[0] };
        Self {
            generator: [[0.0, -gravity], [radius.recip(), 0.0]],
            transition: [[cos, -speed * sin], [sin / speed, cos]],
            accelerometer: [sin / omega, (1.0 - cos) / (omega * speed)],
            gyro: [-speed * (1.0 - cos) / omega, sin / omega],
            start: [start, LOOP_START[1]],
        }
    }

    /// Lets parts of the noises inside the loop, each of the source at a place with its first state, drive it between the rows. The rounding of an
    /// angle, which is there at the rows alone, is none of them.
    pub(super) fn drive(&self, space: &mut Space, inside: &[(usize, usize, &Group)], step_s: f64) {
        let continuous = inside
            .iter()
            .filter_map(|&(place, at, group)| Some((place, at, group, group.rates?, group.density(step_s)?)));
        let parts: Vec<_> = continuous.collect();
        // The loop's two states, and those of the parts, by their places in the whole.
        let own = parts.iter().flat_map(|&(_, at, group, ..)| at..at + group.size);
        let states: Vec<usize> = [0, 1].into_iter().chain(own).collect();
        let size = states.len();
        let (mut generator, mut density) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
        let [[_, tilt], [speed, _]] = self.generator;
        (generator[(0, 1)], generator[(1, 0)]) = (tilt, speed);
        let mut fastest = (-tilt * speed).sqrt();
        let mut at = 2;
        for &(place, _, group, [decay, frequency], of_noise) in &parts {
            for i in 0..group.size {
                generator[(at + i, at + i)] = -decay;
                generator[(place - 1, at + i)] = group.seen[i];
                density[(at + i, at + i)] = of_noise;
            }
            if group.size == 2 {
                (generator[(at, at + 1)], generator[(at + 1, at)]) = (-frequency, frequency);
            }
            fastest = fastest.max(decay.hypot(frequency));
            at += group.size;
        }
        let [transition, driven] = over_step(&generator, &density, fastest, step_s);
        for (i, &row) in states.iter().enumerate() {
            for (j, &column) in states.iter().enumerate() {
                space.transition[row * space.states + column] = transition[(i, j)];
                space.driven[row * space.states + column] = driven[(i, j)];
            }
        }
    }

    pub(super) fn of_port(&self, port: Port) -> Option<[f64; 2]> {
        match port {
            Port::Output => None,
            Port::Accelerometer => Some(self.accelerometer),
            Port::Gyro => Some(self.gyro),
        }
    }

    /// Velocity error that an input over the record causes from rest; between rows the input is taken as its mean.
    pub(super) fn response(&self, values: &[f64], enters: [f64; 2]) -> Vec<f64> {
        let mut state = [0.0; 2];
        let next = values.iter().skip(1).chain(values.last());
        (values.iter().zip(next))
            .map(|(now, next)| {
                let before = state;
                let mean = 0.5 * (now + next);
                for i in 0..2 {
                    state[i] = self.transition[i][0] * before[0]
                        + self.transition[i][1] * before[1]
                        + enters[i] * mean;
                }
                before[0]
            })
            .collect()
    }

    /// The transpose of [`response`](Self::response).
    pub(super) fn transposed_response(&self, scores: &[f64], enters: [f64; 2]) -> Vec<f64> {
        let mut result = vec![0.0; scores.len()];
        let mut costate = [0.0; 2];
        for (row, score) in scores.iter().enumerate().rev() {
            let through = 0.5 * (enters[0] * costate[0] + enters[1] * costate[1]);
            result[row] += through;
            if let Some(next) = result.get_mut(row + 1) {
                *next += through;
            } else {
                result[row] += through;
            }
            let before = costate;
            for i in 0..2 {
                costate[i] = self.transition[0][i] * before[0] + self.transition[1][i] * before[1];
            }
            costate[0] += score;
        }
        result
    }
}
