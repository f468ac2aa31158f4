//! Three gyros of one instrument that turn, and the reference that says how.
use std::f64::consts::TAU;
use std::fmt::Write;

use rand::SeedableRng;
use rand_pcg::Pcg64;
use schuler_explain::explanation::Explanation;

use crate::{explained, normal};

/// Three gyros of one instrument that turn, beside their true rates.
pub struct Turning {
    /// What a gyro reads at a row, from the rates of all axes as functions of time.
    pub reads: fn(usize, f64) -> f64,
    /// The reference's rate of an axis at a row.
    pub reference: fn(usize, u32) -> f64,
    /// Standard deviation of a gyro's noise at a row.
    pub white: fn(u32) -> f64,
    /// The row of which a row shows the readings.
    pub shown: fn(u32) -> u32,
    /// The axes in the order in which the case lists their gyros.
    pub order: [usize; 3],
}

pub const STEP_S: f64 = 0.01;
pub const WHITE: f64 = 0.002;

/// Rate of an axis, rad/s.
pub fn rate(axis: usize, time_s: f64) -> f64 {
    let tones = [(0.31, 0.9), (0.83, 0.5), (1.7, 0.2)];
    let of_tone = |(frequency_hz, size): (f64, f64)| {
        let phase = axis as f64 * 1.3 + size;
        size * (TAU * frequency_hz * (1.0 + 0.1 * axis as f64) * time_s + phase).sin()
    };
    tones.into_iter().map(of_tone).sum()
}

pub fn true_rate(axis: usize, row: u32) -> f64 {
    rate(axis, STEP_S * f64::from(row))
}

impl Default for Turning {
    fn default() -> Self {
        Self { reads: rate, reference: true_rate, white: |_| WHITE, shown: |row| row, order: [0, 1, 2] }
    }
}

impl Turning {
    /// What is told of it where all gyros are late by as much.
    pub fn explained(&self, late_s: f64) -> Explanation {
        self.explained_late([late_s; 3])
    }

    /// The same where each is late by its own.
    pub fn explained_late(&self, late_s: [f64; 3]) -> Explanation {
        let mut random = Pcg64::seed_from_u64(7);
        let mut table = String::from("t,gx,gy,gz,wx,wy,wz\n");
        let mut of_row = |row: u32| {
            let at = |axis: usize| STEP_S * f64::from(row) - late_s[axis];
            [0, 1, 2].map(|axis| (self.reads)(axis, at(axis)) + (self.white)(row) * normal(&mut random))
        };
        let readings: Vec<[f64; 3]> = (0..6000).map(&mut of_row).collect();
        for row in 0..6000_u32 {
            write!(table, "{:.2}", STEP_S * f64::from(row)).expect("a string can be written to");
            for reading in readings[(self.shown)(row) as usize] {
                write!(table, ",{reading:.7}").expect("a string can be written to");
            }
            let [x, y, z] = [0, 1, 2].map(|axis| (self.reference)(axis, row));
            writeln!(table, ",{x:.9},{y:.9},{z:.9}").expect("a string can be written to");
        }
        let sensor = |id: &str, axis: &str| {
            format!(
                "[[sensor]]\nid = \"{id}\"\nkind = \"mems_gyro\"\ncolumn = \"{id}\"\nunit = \"rad/s\"\ngroup = \"imu\"\n\
                 axis = {axis}\n[sensor.nominal]\nwhite = {WHITE}\n"
            )
        };
        let sensors = [
            sensor("gx", "[1.0, 0.0, 0.0]"),
            sensor("gy", "[0.0, 1.0, 0.0]"),
            sensor("gz", "[0.0, 0.0, 1.0]"),
        ];
        let listed = self.order.map(|axis| &sensors[axis]);
        let case = format!(
            "format = \"schuler-case/1\"\ntitle = \"Turning\"\n\
             recording = {{ path = \"recording.csv\", time = \"t\", step_s = {STEP_S} }}\n\
             site = {{ latitude_deg = 47.0, altitude_m = 400.0 }}\n\
             motion = {{ kind = \"recorded\", rate = [\"wx\", \"wy\", \"wz\"] }}\n{}{}{}",
            listed[0], listed[1], listed[2]
        );
        explained(&table, &case)
    }
}
