//! What becomes of an alarm: a gyro is named, or the alarm is withdrawn, or isolation is given up.
//! Equation ids FDI-1, FDI-5, FDI-6.
use nalgebra::{RealField, Vector2};

use super::geometry::constant;
use super::parity::ParitySpace;
use super::sums::Evidence;
use crate::number::select;
use crate::saved::{Blank, saved, saved_choice};

/// Parity that the suspect leaves unexplained, squared: chi-square with one degree of freedom, 0.1 %. Above it more
/// than one gyro has failed.
const MAX_UNEXPLAINED: f64 = 10.83;

/// Where an alarm stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Alarm {
    /// There is none.
    #[default]
    Quiet,
    /// It stands, and evidence is being gathered.
    Standing,
    /// This sample withdrew it: the samples since speak against the fault that raised it.
    Withdrawn,
    /// Isolation was given up; the alarm stands until the next reset.
    GivenUp,
    /// A gyro is named; evidence is still gathered, and may yet name another.
    Isolated,
    /// The gyro that was named last is final until the next reset.
    Settled,
}

/// The gyro that explains evidence best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suspicion<T> {
    /// The gyro, from zero.
    pub gyro: usize,
    /// By how much its likelihood statistic q leads the next.
    pub margin: T,
    /// Squared parity that it leaves unexplained.
    pub unexplained: T,
}

impl<T: RealField + Copy> Suspicion<T> {
    /// `[FDI-1]` `[FDI-5]`
    pub(super) fn of(space: &ParitySpace<T>, evidence: &Evidence<T>) -> Self {
        let samples = evidence.count();
        let mut first = (0, -T::one());
        let mut second = -T::one();
        for (gyro, q) in space.likelihood(&evidence.sum, samples).into_iter().enumerate() {
            let leads = q > first.1;
            let least = select(leads, first.1, q);
            second = select(second > least, second, least);
            first = (select(leads, gyro, first.0), select(leads, q, first.1));
        }
        let total = evidence.sum.norm_squared() / samples;
        Self { gyro: first.0, margin: first.1 - second, unexplained: total - first.1 }
    }

    /// Whether the gyro can be named: it leads all others, and nothing else has failed beside it.
    fn suffices(&self, margin: T) -> bool {
        self.margin >= margin && self.unexplained <= constant(MAX_UNEXPLAINED)
    }
}

/// An alarm and the evidence for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Investigation<T> {
    margin: T,
    give_up_samples: u32,
    pub(super) alarm: Alarm,
    evidence: Evidence<T>,
    /// Mean parity of the evidence that raised the alarm.
    shift: Vector2<T>,
    /// Log-likelihood ratio of that shift against none, over the samples since.
    support: T,
    /// Samples since the alarm was raised.
    age: u32,
}

impl<T: RealField + Copy> Investigation<T> {
    pub(super) fn new(margin: T, give_up_samples: u32) -> Self {
        Self {
            margin,
            give_up_samples,
            alarm: Alarm::Quiet,
            evidence: Evidence::none(),
            shift: Vector2::zeros(),
            support: T::zero(),
            age: 0,
        }
    }

    pub(super) fn reset(&mut self) {
        *self = Self::new(self.margin, self.give_up_samples);
    }

    /// One sample. `alarm`: evidence of the detector that is beyond its threshold; `usable`: the sample counts at
    /// all; `add_up`: it joins the evidence. Gives whether this sample raised the alarm, the suspicion, and the
    /// gyro when the evidence suffices to name it. `[FDI-5]` `[FDI-6]`
    pub(super) fn step(
        &mut self,
        space: &ParitySpace<T>,
        parity: &Vector2<T>,
        alarm: Option<Evidence<T>>,
        usable: bool,
        add_up: bool,
    ) -> (bool, Suspicion<T>, Option<usize>) {
        let before = self.alarm;
        let quiet = matches!(before, Alarm::Quiet | Alarm::Withdrawn);
        let raised = alarm.filter(|_| quiet && usable);
        let open = usable && matches!(before, Alarm::Standing | Alarm::Isolated);
        let joins = open && add_up;

        let half = constant::<T>(0.5);
        // The shift was picked because it was large: samples that had no part in that must bear it out.
        let support = self.support + self.shift.dot(parity) - self.shift.norm_squared() * half;
        let support = select(joins, support, self.support);
        let evidence = Evidence::select(joins, &self.evidence.with(parity), &self.evidence);
        let age = self.age.saturating_add(u32::from(open));
        let first = raised.unwrap_or(evidence);
        let shift = first.sum / first.count();
        let raises = raised.is_some();
        self.evidence = Evidence::select(raises, &first, &evidence);
        self.shift.x = select(raises, shift.x, self.shift.x);
        self.shift.y = select(raises, shift.y, self.shift.y);
        self.support = select(raises, T::zero(), support);
        self.age = select(raises, 0, age);

        let refuted = self.support < -self.margin * half;
        let expired = self.age >= self.give_up_samples;
        let suspicion = Suspicion::of(space, &self.evidence);
        let suffices = suspicion.suffices(self.margin);
        self.alarm = match before {
            Alarm::Quiet | Alarm::Withdrawn if raised.is_some() && suffices => Alarm::Isolated,
            Alarm::Quiet | Alarm::Withdrawn if raised.is_some() => Alarm::Standing,
            Alarm::Quiet | Alarm::Withdrawn => Alarm::Quiet,
            Alarm::Standing if refuted => Alarm::Withdrawn,
            Alarm::Standing if suffices => Alarm::Isolated,
            Alarm::Standing if expired => Alarm::GivenUp,
            Alarm::Isolated if expired => Alarm::Settled,
            same => same,
        };
        let named = self.alarm == Alarm::Isolated && suffices;
        (raised.is_some(), suspicion, named.then_some(suspicion.gyro))
    }
}

saved_choice!(Alarm { Quiet, Standing, Withdrawn, GivenUp, Isolated, Settled });
saved!([T: Blank] Investigation<T> {
    alarm,
    evidence,
    shift,
    support,
    age,
    margin,
    give_up_samples,
});
