//! The gyro block.
use nalgebra::{RealField, SVector};
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::ParitySpace;
use schuler_core::isolation::{FaultIsolation, IsolationConfig, IsolationOutput};
use schuler_core::reading::{Quality, Reading};

use crate::arithmetic::heading;
use crate::meter::{Meter, Random};

const SAMPLES: usize = 3000;

/// Five gyros over a small rate, rad/s: noise, a fault that comes and goes, a slow one, silence, stuck and wild readings,
/// stretches of fast rotation.
pub struct Gyros {
    step: u32,
    last: [Reading<f64>; 5],
}

impl Gyros {
    pub fn new() -> Self {
        Self { step: 0, last: [Reading::good(0.0); 5] }
    }

    /// The next readings, and now and then a command to take a gyro back.
    pub fn next(&mut self, random: &mut Random) -> ([Reading<f64>; 5], Option<u8>) {
        self.step += 1;
        let phase = self.step % 1500;
        let scale = if (1200..1300).contains(&phase) { 1e-3 } else { 1e-5 };
        let rate = [random.symmetric() * scale, random.symmetric() * scale, random.symmetric() * scale];
        let mut readings = [Reading::good(0.0); 5];
        for (gyro, (reading, axis)) in readings.iter_mut().zip(IsolationConfig::CONE.axes).enumerate() {
            let clean = axis[0] * rate[0] + axis[1] * rate[1] + axis[2] * rate[2];
            reading.value = clean + 1e-7 * random.normal();
            match (phase, gyro) {
                (200..400, 1) => reading.value += 2e-6,
                (300..400, 3) => reading.value += 1e-6,
                (500..800, 2) => reading.value += 1e-7,
                (900..970, 4) => *reading = Reading::missing(),
                (1000..1030, 0) => *reading = self.last[0],
                (1040..1060, _) => *reading = self.last[gyro],
                (1100..1110, 3) => reading.value = f64::NAN,
                (1110..1120, 3) => reading.value = 1e300,
                (1120..1130, 3) => reading.quality = Quality::Saturated,
                _ if random.once_in(200) => *reading = Reading::missing(),
                _ if random.once_in(200) => reading.value += 3e-6 * random.symmetric(),
                _ => (),
            }
        }
        self.last = readings;
        let command = match phase {
            450 | 850 | 1000 | 1150 => Some((self.step % 5) as u8),
            0 => Some(9),
            460..465 => Some((phase - 460) as u8),
            _ => None,
        };
        (readings, command)
    }
}

/// The parity, the determinants and the whole isolation.
#[inline(never)]
pub fn count(meter: &mut Meter) {
    linear::<f32>(meter, "f32");
    linear::<f64>(meter, "f64");

    let Ok(isolation) = FaultIsolation::try_build(&IsolationConfig::CONE) else { return };
    let nothing = ([Reading::good(0.0); 5], None);
    meter.part(
        "isolation step, f64",
        SAMPLES,
        (isolation, Gyros::new(), nothing, IsolationOutput::default()),
        |(_, gyros, next, _), random| *next = gyros.next(random),
        |(isolation, _, (readings, command), output)| *output = isolation.step(readings, *command),
    );
}

fn linear<T: RealField + Copy>(meter: &mut Meter, precision: &str) {
    let config = IsolationConfig::CONE;
    let real = nalgebra::convert::<f64, T>;
    let axes = config.axes.map(|axis| axis.map(real));
    let Ok(space) = ParitySpace::try_build(&axes, &config.sigma.map(real)) else { return };
    let zero = T::zero();
    let draw = |readings: &mut SVector<T, 5>, random: &mut Random| {
        *readings = SVector::from_fn(|_, _| real(3.0 * random.normal()));
    };
    meter.part(
        &heading("parity", precision),
        SAMPLES,
        (space, SVector::from([zero; 5]), [zero; 2].into()),
        |(_, readings, _), random| draw(readings, random),
        |(space, readings, parity)| *parity = space.parity(readings),
    );
    meter.part(
        &heading("five determinants", precision),
        SAMPLES,
        (FiveDeterminants::normalised(&space), SVector::from([zero; 5]), SVector::from([zero; 5])),
        |(_, readings, _), random| draw(readings, random),
        |(determinants, readings, values)| *values = determinants.of(readings),
    );
}
