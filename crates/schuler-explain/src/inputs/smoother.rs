//! A quantity and its rate of change from noisy measurements of it: Kalman filter and Rauch–Tung–Striebel smoother.
//!
//! Model: the rate is a random walk, `d²x = √w dβ` (integrated random walk), whose posterior mean is the cubic smoothing
//! spline; `w` by maximum likelihood. `[Rauch, Tung, Striebel, AIAA Journal 3 (1965) 1445; Wecker & Ansley, JASA 78
//! (1983) 81]`
//!
//! A posterior mean is what a regression wants of a measured cause: the error of `E[x | all measurements]` is not
//! correlated with it (Berkson's kind of error), so a coefficient on it is not attenuated, while one on a noisy
//! difference is.
//!
//! Input: times s, measurements in any unit. Output: x, its rate per second, and the variances of both.

/// Standard deviation of the rate before the first measurement, in units of x per second times the scale of x.
const PRIOR_RATE: f64 = 0.1;
/// Decades of `w` that are searched, relative to the unit of x²/s³.
const DECADES: [i32; 2] = [-18, 4];
/// Golden-section steps within two decades: the last bracket is 2 · 0.618¹⁰ = 0.02 of a decade.
const GOLDEN_STEPS: usize = 10;

/// A measurement of x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Row at or before whose time it was.
    pub row: usize,
    /// How long before the time of the row, s; less than the step to the row before. The noise of the rate over that
    /// time is left out.
    pub before_s: f64,
    /// Value.
    pub value: f64,
    /// Variance of its error.
    pub variance: f64,
}

/// A quantity and its rate in every row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Smoothed {
    /// Posterior mean of x.
    pub value: Vec<f64>,
    /// Posterior mean of dx/dt, per second.
    pub rate: Vec<f64>,
    /// Variance of the first.
    pub value_variance: Vec<f64>,
    /// Variance of the second.
    pub rate_variance: Vec<f64>,
}

/// Mean and covariance of (x, dx/dt).
#[derive(Clone, Copy, Debug)]
struct State {
    x: [f64; 2],
    /// Variance of x, covariance, variance of the rate.
    p: [f64; 3],
}

impl State {
    fn prior(value: f64, scale: f64) -> Self {
        Self { x: [value, 0.0], p: [scale * scale, 0.0, (PRIOR_RATE * scale).powi(2)] }
    }

    /// The state `step_s` later.
    fn predicted(&self, step_s: f64, process: f64) -> Self {
        let [x, rate] = self.x;
        let [p00, p01, p11] = self.p;
        let (t, t2) = (step_s, step_s * step_s);
        Self {
            x: [x + t * rate, rate],
            p: [
                p00 + 2.0 * t * p01 + t2 * p11 + process * t2 * t / 3.0,
                p01 + t * p11 + process * t2 / 2.0,
                p11 + process * t,
            ],
        }
    }

    /// The state given a measurement, the square of its normalised innovation, and the innovation's variance.
    fn updated(&self, measurement: &Measurement) -> (Self, f64, f64) {
        // x was measured `before_s` ago: h = [1, −before].
        let b = measurement.before_s;
        let [p00, p01, p11] = self.p;
        let (c0, c1) = (p00 - b * p01, p01 - b * p11);
        let variance = c0 - b * c1 + measurement.variance;
        let innovation = measurement.value - (self.x[0] - b * self.x[1]);
        let (k0, k1) = (c0 / variance, c1 / variance);
        let state = Self {
            x: [self.x[0] + k0 * innovation, self.x[1] + k1 * innovation],
            p: [(p00 - k0 * c0).max(0.0), p01 - k0 * c1, (p11 - k1 * c1).max(0.0)],
        };
        (state, innovation * innovation / variance, variance)
    }
}

/// How well measurements in the order of their times agree with a process noise; the first two, which only start the filter, do not count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Agreement {
    /// Sum of the squares of normalised innovations.
    squares: f64,
    /// Sum of the logarithms of their variances.
    ln_variances: f64,
    /// Number of innovations.
    number: usize,
}

impl Agreement {
    fn of(time_s: &[f64], measurements: &[Measurement], process: f64, scale: f64) -> Self {
        let mut agreement = Self::default();
        let Some(first) = measurements.first() else { return agreement };
        let mut state = State::prior(first.value, scale);
        let mut now_s = time_s[first.row];
        for (count, measurement) in measurements.iter().enumerate() {
            let step_s = time_s[measurement.row] - now_s;
            if step_s > 0.0 {
                state = state.predicted(step_s, process);
                now_s = time_s[measurement.row];
            }
            let (square, variance);
            (state, square, variance) = state.updated(measurement);
            if count >= 2 {
                agreement.squares += square;
                agreement.ln_variances += variance.ln();
                agreement.number += 1;
            }
        }
        agreement
    }

    /// By what all variances, that of the process among them, have the largest likelihood, not less than `least`.
    fn factor(&self, least: f64) -> f64 {
        if self.number == 0 { 1.0_f64.max(least) } else { (self.squares / self.number as f64).max(least) }
    }

    /// Negative log-likelihood less the constant, all variances multiplied by `factor`.
    fn negative_log_likelihood(&self, factor: f64) -> f64 {
        0.5 * (self.squares / factor + self.ln_variances + self.number as f64 * factor.ln())
    }
}

/// The process noise `w`, unit of x²/s³, with the largest likelihood, and its negative log-likelihood.
pub fn process_noise(time_s: &[f64], measurements: &[Measurement], scale: f64) -> (f64, f64) {
    let cost =
        |process: f64| Agreement::of(time_s, measurements, process, scale).negative_log_likelihood(1.0);
    most_likely(scale, cost)
}

/// The process noise of measurements whose variances are known but for a common factor, not less than `least`, and that factor: concentrated
/// likelihood. The process noise belongs to the variances multiplied by it.
pub fn process_and_factor(
    time_s: &[f64],
    measurements: &[Measurement],
    scale: f64,
    least: f64,
) -> (f64, f64) {
    let agreement = |process: f64| Agreement::of(time_s, measurements, process, scale);
    let cost = |process: f64| {
        let agreement = agreement(process);
        agreement.negative_log_likelihood(agreement.factor(least))
    };
    let (process, _) = most_likely(scale, cost);
    let factor = agreement(process).factor(least);
    (process * factor, factor)
}

/// The process noise of the least cost, and that.
fn most_likely(scale: f64, cost: impl Fn(f64) -> f64) -> (f64, f64) {
    let unit = scale * scale;
    let cost = |decade: f64| cost(unit * 10_f64.powf(decade));
    let (best, _) = (DECADES[0]..=DECADES[1])
        .map(|decade| (decade as f64, cost(decade as f64)))
        .fold((0.0, f64::INFINITY), |best: (f64, f64), tried| if tried.1 < best.1 { tried } else { best });
    let golden = 0.5 * (5_f64.sqrt() - 1.0);
    let (mut low, mut high) = (best - 1.0, best + 1.0);
    let mut inner = [high - golden * (high - low), low + golden * (high - low)];
    let mut costs = inner.map(cost);
    for _ in 0..GOLDEN_STEPS {
        if costs[0] < costs[1] {
            high = inner[1];
            inner = [high - golden * (high - low), inner[0]];
            costs = [cost(inner[0]), costs[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + golden * (high - low)];
            costs = [costs[1], cost(inner[1])];
        }
    }
    let at = usize::from(costs[0] >= costs[1]);
    (unit * 10_f64.powf(inner[at]), costs[at])
}

/// x and its rate in every row, given all measurements (in the order of their times) and the process noise `w`.
pub fn smooth(time_s: &[f64], measurements: &[Measurement], process: f64, scale: f64) -> Smoothed {
    let Some(first) = measurements.first() else { return Smoothed::default() };
    let rows = time_s.len();
    let mut filtered = Vec::with_capacity(rows);
    let mut state = State::prior(first.value, scale);
    let mut pending = measurements.iter().peekable();
    for row in 0..rows {
        if row > 0 {
            state = state.predicted(time_s[row] - time_s[row - 1], process);
        }
        while let Some(measurement) = pending.next_if(|measurement| measurement.row <= row) {
            state = state.updated(measurement).0;
        }
        filtered.push(state);
    }
    let mut smoothed = Smoothed {
        value: vec![0.0; rows],
        rate: vec![0.0; rows],
        value_variance: vec![0.0; rows],
        rate_variance: vec![0.0; rows],
    };
    let mut after = state;
    for row in (0..rows).rev() {
        let here = filtered[row];
        if row + 1 < rows {
            after = backwards(&here, &after, time_s[row + 1] - time_s[row], process);
        }
        smoothed.value[row] = after.x[0];
        smoothed.rate[row] = after.x[1];
        smoothed.value_variance[row] = after.p[0].max(0.0);
        smoothed.rate_variance[row] = after.p[2].max(0.0);
    }
    smoothed
}

/// One step of the Rauch–Tung–Striebel recursion: the smoothed state from the filtered one and the smoothed next.
fn backwards(filtered: &State, next: &State, step_s: f64, process: f64) -> State {
    let predicted = filtered.predicted(step_s, process);
    let [p00, p01, p11] = filtered.p;
    let [q00, q01, q11] = predicted.p;
    let determinant = q00 * q11 - q01 * q01;
    if determinant <= 0.0 {
        return *filtered;
    }
    // C = P Φᵀ: rows (p00 + t p01, p01), (p01 + t p11, p11); gain G = C Q⁻¹.
    let c = [[p00 + step_s * p01, p01], [p01 + step_s * p11, p11]];
    let gain = c.map(|[a, b]| [(a * q11 - b * q01) / determinant, (b * q00 - a * q01) / determinant]);
    let dx = [next.x[0] - predicted.x[0], next.x[1] - predicted.x[1]];
    let dp = [next.p[0] - q00, next.p[1] - q01, next.p[2] - q11];
    let form = |u: [f64; 2], v: [f64; 2]| {
        u[0] * (dp[0] * v[0] + dp[1] * v[1]) + u[1] * (dp[1] * v[0] + dp[2] * v[1])
    };
    State {
        x: [0, 1].map(|i| filtered.x[i] + gain[i][0] * dx[0] + gain[i][1] * dx[1]),
        p: [p00 + form(gain[0], gain[0]), p01 + form(gain[0], gain[1]), p11 + form(gain[1], gain[1])],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// The smoother's mean and variance are those of the Gaussian conditioned at once: covariance of the integrated
    /// random walk in closed form, no recursion.
    #[test]
    fn agrees_with_conditioning_the_whole_gaussian() {
        let time_s: Vec<f64> = [0.0, 1.0, 2.5, 3.0, 4.0, 6.0, 7.0].to_vec();
        let (process, scale) = (0.3, 5.0);
        let measurements: Vec<Measurement> = [(0, 0.0, 1.0), (2, 0.0, 1.7), (3, 0.0, 2.2), (6, 0.0, -1.0)]
            .map(|(row, before_s, value)| Measurement { row, before_s, value, variance: 0.04 })
            .to_vec();
        let smoothed = smooth(&time_s, &measurements, process, scale);

        let prior = (scale * scale, (PRIOR_RATE * scale).powi(2));
        // Covariances of x(s) with x(t), and of rate(s) with x(t), for W = ∫∫ white noise from time 0.
        let xx = |s: f64, t: f64| {
            let (a, b) = (s.min(t), s.max(t));
            prior.0 + prior.1 * s * t + process * (a * a * b / 2.0 - a * a * a / 6.0)
        };
        let vx =
            |s: f64, t: f64| prior.1 * t + process * if s <= t { s * t - s * s / 2.0 } else { t * t / 2.0 };
        let at: Vec<f64> = measurements.iter().map(|m| time_s[m.row] - m.before_s).collect();
        let n = at.len();
        let covariance = DMatrix::from_fn(n, n, |i, j| xx(at[i], at[j]) + if i == j { 0.04 } else { 0.0 });
        let inverse = covariance.try_inverse().unwrap();
        let centred = DVector::from_fn(n, |i, _| measurements[i].value - measurements[0].value);
        for (row, &time) in time_s.iter().enumerate() {
            let to_value = DVector::from_fn(n, |i, _| xx(time, at[i]));
            let to_rate = DVector::from_fn(n, |i, _| vx(time, at[i]));
            let value = measurements[0].value + (to_value.transpose() * &inverse * &centred)[0];
            let rate = (to_rate.transpose() * &inverse * &centred)[0];
            let value_variance = xx(time, time) - (to_value.transpose() * &inverse * &to_value)[0];
            let rate_variance = prior.1 + process * time - (to_rate.transpose() * &inverse * &to_rate)[0];
            assert!((smoothed.value[row] - value).abs() < 1e-9, "row {row}");
            assert!((smoothed.rate[row] - rate).abs() < 1e-9, "row {row}");
            assert!((smoothed.value_variance[row] - value_variance).abs() < 1e-9, "row {row}");
            assert!((smoothed.rate_variance[row] - rate_variance).abs() < 1e-9, "row {row}");
        }
    }
}
