//! What a change of the noise gains over the nominal one.
use super::bench::{Bench, sum};
use crate::campaign::effect::Concealed;
use crate::campaign::likelihood::{Model, Noise, Whitened};
use crate::campaign::oracle::{self, Signals};
use crate::identify::likelihood::{Correlated, Parameters, Parts, Removed, fit};
use crate::identify::series::Blocks;
use crate::output::Interrupted;
use crate::physics::random::Process;

impl Bench<'_> {
    /// Gain of the true noise against the nominal one, over a simulated record.
    pub(super) fn noise_gain(
        &self,
        concealed: &Concealed,
        size: f64,
    ) -> Result<(f64, Vec<f64>), Interrupted> {
        let scenario = self.with(concealed, size);
        let simulated = self.run(&scenario)?;
        let noise = oracle::difference_or_missing(&self.outputs(&simulated), &self.base);
        Ok(self.noise_gain_of(concealed, size, &noise))
    }

    /// The same for a given noise series of every output; nats in all and row by row.
    pub(super) fn noise_gain_of(&self, concealed: &Concealed, size: f64, noise: &Signals) -> (f64, Vec<f64>) {
        let Some(change) = &concealed.noise else { return (0.0, vec![0.0; self.rows]) };
        let nominal = |id: &str| self.setting.noise_of(id);
        let changed = |id: &str| {
            let own = nominal(id);
            if id == concealed.output { (change.with)(&own, size) } else { own }
        };
        let mut gain = vec![0.0; self.rows];
        let before = oracle::views(&self.setting, nominal);
        let after = oracle::views(&self.setting, changed);
        for (before, after) in before.iter().zip(&after).filter(|(view, _)| view.has(&concealed.output)) {
            let mut series = before.of(noise, self.rows);
            centre(&mut series, before.relative);
            let fitted = before.noise.as_ref().filter(|_| change.refit);
            let null = fitted.map_or_else(
                || before.model.clone(),
                |it| refitted(it, &series, self.setting.scenario.step_s).model(self.setting.scenario.step_s),
            );
            let (a, b) =
                (null.whiten(&self.time_s, &[&series]), after.model.whiten(&self.time_s, &[&series]));
            for k in 0..self.rows {
                let of =
                    |model: &Model, w: &Whitened| model.log_density(w.innovations[0][k], w.log_variance[k]);
                gain[k] += of(&after.model, &b) - of(&null, &a);
            }
        }
        (gain.iter().filter(|g| g.is_finite()).sum(), gain)
    }
}

/// Takes the mean away where the output is read against an unknown constant.
pub(super) fn centre(series: &mut [f64], relative: bool) {
    if relative {
        let n = series.iter().filter(|v| v.is_finite()).count().max(1) as f64;
        let mean = sum(series.iter().copied()) / n;
        for v in series.iter_mut() {
            *v -= mean;
        }
    }
}

/// Noise of the same structure, fitted to a series by maximum likelihood: what the null model would make of it.
fn refitted(nominal: &Noise, series: &[f64], step_s: f64) -> Noise {
    let mut parts = Parts::default();
    for process in &nominal.drift {
        match process {
            Process::Markov { .. } | Process::Flicker { .. } => parts.markov = 1,
            Process::ExponentialCosine { .. } => parts.cosine = true,
            Process::RandomWalk { .. } => parts.walk = true,
        }
    }
    let n = series.iter().filter(|v| v.is_finite()).count().max(1) as f64;
    let spread = (sum(series.iter().map(|v| v * v)) / n).sqrt();
    let mut start = Parameters { white: nominal.white, ..Parameters::default() };
    for process in &nominal.drift {
        match *process {
            Process::Markov { sigma, tau_s } => {
                start.markov[0] = Correlated { sigma, alpha: step_s / tau_s };
            }
            Process::ExponentialCosine { sigma, alpha, beta } => {
                start.cosine = Correlated { sigma, alpha: alpha * step_s };
                start.beta = beta * step_s;
            }
            Process::RandomWalk { rate } => start.walk = rate * step_s.sqrt(),
            Process::Flicker { .. } => {}
        }
    }
    let mut starts = vec![start];
    for slower in [0.1, 0.3, 3.0] {
        let mut other = start;
        other.markov[0] = Correlated { sigma: spread, alpha: start.markov[0].alpha * slower };
        other.cosine.sigma = spread;
        starts.push(other);
    }
    let rows = Blocks::new(series, 1);
    let Some(fitted) = fit(&rows, parts, Removed::Mean, &starts) else { return nominal.clone() };
    let p = fitted.parameters;
    let mut drift = Vec::new();
    if parts.markov > 0 && p.markov[0].alpha > 0.0 {
        drift.push(Process::Markov { sigma: p.markov[0].sigma, tau_s: step_s / p.markov[0].alpha });
    }
    if parts.cosine {
        let (alpha, beta) = (p.cosine.alpha / step_s, p.beta / step_s);
        drift.push(Process::ExponentialCosine { sigma: p.cosine.sigma, alpha, beta });
    }
    if parts.walk {
        drift.push(Process::RandomWalk { rate: p.walk / step_s.sqrt() });
    }
    Noise { white: p.white, drift, ..Noise::default() }
}
