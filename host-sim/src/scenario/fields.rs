//! Short ways of asking a scenario's tables for optional values. A mistake is reported where it stands and replaced by the
//! default, so that reading goes on and finds the rest.
use schuler_recording::document::{Field, Node};

use crate::physics::environment::Profile;

/// A table of the scenario.
#[derive(Clone, Copy)]
pub(super) struct Fields<'n, 'd>(pub(super) &'n Node<'d>);

impl<'d> Fields<'_, 'd> {
    fn get<T>(self, key: &'static str, default: T, read: impl FnOnce(&Field<'d>) -> Option<T>) -> T {
        self.0.optional(key).and_then(|field| read(&field)).unwrap_or(default)
    }

    pub(super) fn number(self, key: &'static str, default: f64) -> f64 {
        self.get(key, default, Field::number)
    }

    pub(super) fn positive(self, key: &'static str, default: f64) -> f64 {
        self.get(key, default, |f| f.number_where("a number greater than zero", |n| n > 0.0))
    }

    pub(super) fn not_negative(self, key: &'static str, default: f64) -> f64 {
        self.get(key, default, |f| f.number_where("a number not less than zero", |n| n >= 0.0))
    }

    pub(super) fn share(self, key: &'static str, default: f64) -> f64 {
        self.get(key, default, |f| f.number_where("a number from 0 to 1", |n| (0.0..=1.0).contains(&n)))
    }

    pub(super) fn whole(self, key: &'static str, default: u32) -> u32 {
        let expected = "a whole number not less than zero";
        let valid = |n: f64| n >= 0.0 && n.fract() == 0.0 && n <= f64::from(u32::MAX);
        self.get(key, f64::from(default), |f| f.number_where(expected, valid)) as u32
    }

    pub(super) fn flag(self, key: &'static str) -> bool {
        self.flag_or(key, false)
    }

    pub(super) fn flag_or(self, key: &'static str, default: bool) -> bool {
        self.get(key, default, Field::boolean)
    }

    pub(super) fn text(self, key: &'static str) -> Option<String> {
        self.0.optional(key).and_then(|field| field.text())
    }

    pub(super) fn pair(self, key: &'static str) -> [f64; 2] {
        self.get(key, [0.0; 2], Field::numbers)
    }

    pub(super) fn vector(self, key: &'static str, default: [f64; 3]) -> nalgebra::Vector3<f64> {
        self.get(key, default, Field::numbers).into()
    }

    /// A direction; of length one whatever its length in the file.
    pub(super) fn direction(self, key: &'static str, default: [f64; 3]) -> nalgebra::Vector3<f64> {
        let read = |f: &Field<'d>| {
            let v = f.numbers::<3>()?;
            if v.iter().any(|x| *x != 0.0) { Some(v) } else { f.wrong("a vector that is not zero") }
        };
        nalgebra::Vector3::from(self.get(key, default, read)).normalize()
    }

    pub(super) fn table<T>(self, key: &'static str, read: impl FnOnce(&Node<'_>) -> Option<T>) -> Option<T> {
        self.0.optional(key).and_then(|field| field.table(read))
    }

    /// A table in which every key is optional, if it is there.
    pub(super) fn section<T>(self, key: &'static str, read: impl FnOnce(Fields<'_, '_>) -> T) -> Option<T> {
        self.table(key, |node| Some(read(Fields(node))))
    }

    /// `key = { time_s = [...], value = [...], amplitude = 0, period_s = 1 }`, every key of it optional.
    pub(super) fn profile(self, key: &'static str, default: f64) -> Profile {
        self.section(key, |fields| {
            let node = fields.0;
            let times = node.optional("time_s").and_then(|f| {
                let times = f.number_list()?;
                if times.windows(2).all(|w| w[1] > w[0]) {
                    Some(times)
                } else {
                    f.wrong("times that increase")
                }
            });
            let times = times.unwrap_or_else(|| vec![0.0]);
            let values = node.optional("value").and_then(|f| {
                let values = f.number_list()?;
                if values.len() == times.len() {
                    Some(values)
                } else {
                    f.wrong(&format!("as many numbers as time_s has ({})", times.len()))
                }
            });
            let values = values.unwrap_or_else(|| vec![default; times.len()]);
            Profile {
                points: times.into_iter().zip(values).collect(),
                amplitude: fields.number("amplitude", 0.0),
                period_s: fields.positive("period_s", 86_400.0),
            }
        })
        .unwrap_or_else(|| Profile::constant(default))
    }
}
