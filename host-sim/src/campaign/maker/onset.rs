//! Where an oracle places the beginning of an effect.
use super::bench::{Bench, Sized, sum};
use super::noise::centre;
use crate::campaign::oracle::{self, Signals, View};
use crate::output::Interrupted;

/// Onsets that the oracle tries over a record before it looks at every row …
const ONSETS: usize = 400;
/// … and so many at once.
const ONSETS_AT_ONCE: usize = 32;

/// Gains of an effect that begins in each of some rows.
type GainsFrom<'g> = Box<dyn Fn(&[usize]) -> Vec<f64> + 'g>;

impl Bench<'_> {
    /// Where the likelihood of an effect that begins at some time is largest, its shape and the noise known, its size free (of a
    /// change of noise the true one); none for one that acts all the time. `noise`: the outputs without any effect.
    pub(super) fn onset(
        &self,
        it: &Sized,
        views: &[View],
        noise: &Signals,
    ) -> Result<Option<f64>, Interrupted> {
        let Some([from_s, _]) = it.concealed.interval_s else { return Ok(None) };
        if it.concealed.effect == "output_stuck" {
            // A value that is repeated shows itself.
            return Ok(Some(from_s));
        }
        let step_s = self.setting.scenario.step_s;
        let first_s = from_s - (from_s / step_s).floor() * step_s;
        let gains = if it.concealed.noise.is_some() {
            self.gains_of_noise_from(it, views, noise, first_s)
        } else {
            self.gains_of_signal_from(it, views, noise, first_s)?
        };
        let best_of = |rows: Vec<usize>| -> Result<usize, Interrupted> {
            let mut best = (f64::NEG_INFINITY, 0);
            for some in rows.chunks(ONSETS_AT_ONCE) {
                (self.check)()?;
                let better = |best: (f64, usize), (row, gain)| if gain > best.0 { (gain, row) } else { best };
                best = some.iter().copied().zip(gains(some)).fold(best, better);
            }
            Ok(best.1)
        };
        let stride = (self.rows / ONSETS).max(1);
        let coarse = best_of((0..self.rows).step_by(stride).collect())?;
        let best = best_of((coarse.saturating_sub(stride)..(coarse + stride).min(self.rows)).collect())?;
        Ok(Some(first_s + best as f64 * step_s))
    }

    /// Log-likelihoods of a change of noise that begins so many rows after `first_s`.
    fn gains_of_noise_from<'g>(
        &'g self,
        it: &Sized,
        views: &'g [View],
        noise: &Signals,
        first_s: f64,
    ) -> GainsFrom<'g> {
        let seen: Vec<(&View, Vec<f64>)> = (views.iter().filter(|view| view.has(&it.concealed.output)))
            .map(|view| {
                let mut series = view.of(noise, self.rows);
                centre(&mut series, view.relative);
                (view, series)
            })
            .collect();
        let step_s = self.setting.scenario.step_s;
        let likelihood = move |row: &usize| {
            let onset_s = first_s + *row as f64 * step_s;
            seen.iter()
                .map(|(view, series)| view.model.later(onset_s).log_likelihood(&self.time_s, series))
                .sum()
        };
        Box::new(move |rows| rows.iter().map(&likelihood).collect())
    }

    /// Gains of an effect of any size that begins so many rows after `first_s`. Its response does not depend on when it begins, so
    /// the earliest, moved, is that to every later onset.
    fn gains_of_signal_from<'g>(
        &'g self,
        it: &Sized,
        views: &'g [View],
        noise: &Signals,
        first_s: f64,
    ) -> Result<GainsFrom<'g>, Interrupted> {
        let mut earliest = self.with(&it.concealed, it.size);
        let before = self.setting.scenario.faults.len();
        earliest.faults.iter_mut().skip(before).for_each(|entry| entry.fault.onset_s = first_s);
        let earliest = self.outputs(&self.run(&oracle::silent(&earliest))?);
        let earliest = oracle::difference(&earliest, &self.base);
        let seen: Vec<(&View, Vec<f64>, Vec<f64>)> = (views.iter())
            .map(|view| {
                let signal = view.of(&it.signals, self.rows);
                let mut told = view.of(noise, self.rows);
                told.iter_mut().zip(signal).for_each(|(sum, signal)| *sum += signal);
                (view, told, view.of(&earliest, self.rows))
            })
            .collect();
        Ok(Box::new(move |rows| {
            let mut sums = vec![[0.0; 2]; rows.len()];
            for (view, told, earliest) in &seen {
                let late = |row: &usize| std::iter::repeat_n(0.0, *row).chain(earliest.iter().copied());
                let moved: Vec<Vec<f64>> =
                    rows.iter().map(|row| late(row).take(self.rows).collect()).collect();
                let series: Vec<&[f64]> =
                    std::iter::once(told.as_slice()).chain(moved.iter().map(Vec::as_slice)).collect();
                let white = view.whiten(&self.time_s, &series);
                let Some((told, moved)) = white.split_first() else { continue };
                for ([cross, square], signal) in sums.iter_mut().zip(moved) {
                    *cross += sum(told.iter().zip(signal).map(|(e, s)| e * s));
                    *square += sum(signal.iter().map(|s| s * s));
                }
            }
            let gain =
                |[cross, square]: [f64; 2]| if square > 0.0 { 0.5 * cross * cross / square } else { 0.0 };
            sums.into_iter().map(gain).collect()
        }))
    }
}
