//! How good a filter's probabilities and estimates are against the truth. [HLT-8] [HLT-11]
use super::generator::Sample;
use super::model::{Filter, Model, Posterior};

/// Sums over steps; the methods give the means.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    steps: f64,
    jump: f64,
    noise: f64,
    fault: f64,
    wrong: f64,
    eps: f64,
    xi: f64,
    nees: f64,
}

/// Probabilities of the faults in a posterior.
#[derive(Clone, Copy, Debug)]
pub struct FaultProbabilities {
    /// Jump present.
    pub jump: f64,
    /// Level of noise degraded.
    pub noise: f64,
    /// Either.
    pub fault: f64,
}

impl FaultProbabilities {
    /// Sums over modes.
    pub fn of(model: &Model, modes: &[f64]) -> Self {
        let sum =
            |which: &dyn Fn(usize) -> bool| (0..modes.len()).filter(|&r| which(r)).map(|r| modes[r]).sum();
        Self {
            jump: sum(&|r| model.mode(r).jump),
            noise: sum(&|r| model.mode(r).level >= model.normal_levels),
            fault: sum(&|r| model.is_fault(r)),
        }
    }
}

impl Score {
    /// Adds a step.
    pub fn add(&mut self, model: &Model, truth: &Sample, posterior: &Posterior) {
        let p = FaultProbabilities::of(model, &posterior.modes);
        let jump = indicator(truth.mode.jump);
        let noise = indicator(truth.mode.level >= model.normal_levels);
        let square = |x: f64| x * x;
        let eps = square(posterior.state.mean.x - truth.eps);
        self.steps += 1.0;
        self.jump += square(p.jump - jump);
        self.noise += square(p.noise - noise);
        self.fault += square(p.fault - jump.max(noise));
        self.wrong += indicator((p.jump > 0.5) != truth.mode.jump);
        self.eps += eps;
        self.xi += square(posterior.state.mean.y - truth.xi);
        self.nees += eps / posterior.state.covariance.m11;
    }

    /// Runs a filter over a recording.
    pub fn of(model: &Model, filter: &mut dyn Filter, samples: &[Sample]) -> Self {
        let mut score = Self::default();
        for sample in samples {
            let posterior = filter.step(Some(sample.d));
            score.add(model, sample, &posterior);
        }
        score
    }

    /// Both together.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            steps: self.steps + other.steps,
            jump: self.jump + other.jump,
            noise: self.noise + other.noise,
            fault: self.fault + other.fault,
            wrong: self.wrong + other.wrong,
            eps: self.eps + other.eps,
            xi: self.xi + other.xi,
            nees: self.nees + other.nees,
        }
    }

    /// Brier score of the jump's probability.
    pub fn brier_jump(&self) -> f64 {
        self.jump / self.steps
    }

    /// Brier score of grown noise's probability.
    pub fn brier_noise(&self) -> f64 {
        self.noise / self.steps
    }

    /// Brier score of any fault's probability.
    pub fn brier_fault(&self) -> f64 {
        self.fault / self.steps
    }

    /// Share of steps where P(jump) is on the wrong side of a half.
    pub fn error_rate(&self) -> f64 {
        self.wrong / self.steps
    }

    /// Root mean square error of ε, m/s.
    pub fn rmse_eps(&self) -> f64 {
        (self.eps / self.steps).sqrt()
    }

    /// Root mean square error of ξ, m/s.
    pub fn rmse_xi(&self) -> f64 {
        (self.xi / self.steps).sqrt()
    }

    /// Mean of ε's error squared over its variance.
    pub fn nees(&self) -> f64 {
        self.nees / self.steps
    }
}

/// Ratio of sums over runs, and its standard deviation from the scatter between runs.
pub fn ratio_of_sums(pairs: &[(f64, f64)]) -> (f64, f64) {
    let numerator: f64 = pairs.iter().map(|(a, _)| a).sum();
    let denominator: f64 = pairs.iter().map(|(_, b)| b).sum();
    let ratio = numerator / denominator;
    let scatter: f64 = pairs.iter().map(|(a, b)| (a - ratio * b).powi(2)).sum();
    (ratio, scatter.sqrt() / denominator)
}

/// Reliability diagram: predicted probability against observed frequency, in bins. Steps of one run depend on
/// one another, so intervals come from the scatter between runs.
#[derive(Clone, Debug)]
pub struct Reliability {
    edges: Vec<f64>,
    /// For each finished run and bin: steps, sum of predictions, sum of outcomes.
    runs: Vec<Vec<[f64; 3]>>,
}

/// One bin of the diagram.
#[derive(Clone, Copy, Debug)]
pub struct ReliabilityBin {
    /// Number of steps.
    pub steps: f64,
    /// Mean predicted probability.
    pub predicted: f64,
    /// Frequency of the event.
    pub observed: f64,
    /// Standard deviation of observed − predicted.
    pub sigma: f64,
}

impl Reliability {
    /// Bins between the edges, ascending.
    pub fn new(edges: &[f64]) -> Self {
        Self { edges: edges.to_vec(), runs: Vec::new() }
    }

    /// Adds one run of predictions and outcomes.
    pub fn add_run(&mut self, steps: impl IntoIterator<Item = (f64, bool)>) {
        let mut run = vec![[0.0; 3]; self.edges.len() - 1];
        for (p, happened) in steps {
            let bin = self.edges[1..].iter().position(|&edge| p < edge).unwrap_or(self.edges.len() - 2);
            run[bin][0] += 1.0;
            run[bin][1] += p;
            run[bin][2] += indicator(happened);
        }
        self.runs.push(run);
    }

    /// The diagram.
    pub fn bins(&self) -> Vec<ReliabilityBin> {
        (0..self.edges.len() - 1)
            .map(|bin| {
                let of = |part: usize| self.runs.iter().map(|run| run[bin][part]).sum::<f64>();
                let steps = of(0);
                let (predicted, observed) = (of(1) / steps, of(2) / steps);
                let bias = observed - predicted;
                let scatter: f64 = self
                    .runs
                    .iter()
                    .map(|run| (run[bin][2] - run[bin][1] - bias * run[bin][0]).powi(2))
                    .sum();
                ReliabilityBin { steps, predicted, observed, sigma: scatter.sqrt() / steps }
            })
            .collect()
    }
}

fn indicator(condition: bool) -> f64 {
    f64::from(u8::from(condition))
}
