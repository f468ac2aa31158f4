//! What one would use instead: each turns readings (degC, 1 Hz) into a rate (degC/s) in real time.

/// A method with its one tuning parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// `(y(t) − y(t − lag))/lag`; lag in s.
    Difference(usize),
    /// Slope at the newest point of a polynomial of the order, fitted to the last points; order, points.
    SavitzkyGolay(usize, usize),
    /// First difference smoothed with a time constant, s.
    ExponentialSmoothing(f64),
    /// Double exponential smoothing; time constants of level and trend, s.
    Holt(f64, f64),
    /// Kalman filter of temperature and a rate that walks at random, on every reading; rate noise, degC²/s³.
    ConstantRateKalman(f64),
}

impl Method {
    /// The settings among which each method is tuned, method by method.
    pub fn grids() -> [(&'static str, Vec<Self>); 5] {
        const SPANS: [usize; 12] = [60, 100, 150, 220, 320, 450, 640, 900, 1250, 1750, 2400, 3400];
        let spans = || SPANS.into_iter();
        let holt = spans().take(8).flat_map(|level| {
            spans().take(8).map(move |trend| Self::Holt(level as f64 * 0.5, trend as f64 * 0.5))
        });
        [
            ("simple difference", spans().map(Self::Difference).collect()),
            (
                "Savitzky-Golay",
                [1, 2].into_iter().flat_map(|o| spans().map(move |n| Self::SavitzkyGolay(o, n))).collect(),
            ),
            ("exponential smoothing", spans().map(|n| Self::ExponentialSmoothing(n as f64 * 0.5)).collect()),
            ("Holt", holt.collect()),
            (
                "constant-rate Kalman",
                (0..14).map(|k| Self::ConstantRateKalman(1e-12 * 10f64.powf(f64::from(k) / 3.0))).collect(),
            ),
        ]
    }

    /// Rates for readings of a thermometer with this quantum, degC.
    pub fn rates(self, readings: &[f64], quantum: f64) -> Vec<f64> {
        let first = readings.first().copied().unwrap_or(0.0);
        match self {
            Self::Difference(lag) => readings
                .iter()
                .enumerate()
                .map(|(t, y)| (y - readings[t.saturating_sub(lag)]) / lag as f64)
                .collect(),
            Self::SavitzkyGolay(order, points) => savitzky_golay(readings, order, points),
            Self::ExponentialSmoothing(tau) => {
                let gain = 1.0 - (-1.0 / tau).exp();
                let (mut previous, mut rate) = (first, 0.0);
                readings
                    .iter()
                    .map(|y| {
                        rate += gain * (y - previous - rate);
                        previous = *y;
                        rate
                    })
                    .collect()
            }
            Self::Holt(level_s, trend_s) => {
                let (alpha, beta) = (1.0 - (-1.0 / level_s).exp(), 1.0 - (-1.0 / trend_s).exp());
                let (mut level, mut trend) = (first, 0.0);
                readings
                    .iter()
                    .map(|y| {
                        let before = level;
                        level += trend + alpha * (y - level - trend);
                        trend += beta * (level - before - trend);
                        trend
                    })
                    .collect()
            }
            Self::ConstantRateKalman(noise) => {
                let r = quantum * quantum / 12.0;
                let (mut level, mut rate) = (first, 0.0);
                let (mut p00, mut p01, mut p11) = (r, 0.0, (30.0 / 3600.0f64).powi(2));
                readings
                    .iter()
                    .map(|y| {
                        level += rate;
                        p00 += 2.0 * p01 + p11 + noise / 3.0;
                        p01 += p11 + noise / 2.0;
                        p11 += noise;
                        let s = p00 + r;
                        let (k0, k1) = (p00 / s, p01 / s);
                        let innovation = y - level;
                        level += k0 * innovation;
                        rate += k1 * innovation;
                        p11 -= k1 * p01;
                        p01 *= 1.0 - k0;
                        p00 *= 1.0 - k0;
                        rate
                    })
                    .collect()
            }
        }
    }
}

/// Slope at the newest of the last `points` readings; the sums of moments are carried along. Before the start the
/// reading was the first one.
fn savitzky_golay(readings: &[f64], order: usize, points: usize) -> Vec<f64> {
    let n = points as f64;
    let first = readings.first().copied().unwrap_or(0.0);
    let at = |t: usize, back: usize| t.checked_sub(back).map_or(0.0, |k| readings[k] - first);
    // Moments about the newest point: Σy, Σk·y, Σk²·y with k = 0, −1, … −(n − 1).
    let (mut m0, mut m1, mut m2) = (0.0, 0.0, 0.0);
    // Σk², Σk⁴ about the middle.
    let k2 = n * (n * n - 1.0) / 12.0;
    let k4 = n * (n * n - 1.0) * (3.0 * n * n - 7.0) / 240.0;
    (0..readings.len())
        .map(|t| {
            // Every point moves back by one, the oldest leaves at k = −n, the newest enters at zero.
            m2 += m0 - 2.0 * m1;
            m1 -= m0;
            let leaving = at(t, points);
            m0 -= leaving;
            m1 += n * leaving;
            m2 -= n * n * leaving;
            m0 += at(t, 0);
            // About the middle, k' = k + h.
            let h = (n - 1.0) / 2.0;
            let c1 = m1 + h * m0;
            let c2 = m2 + 2.0 * h * m1 + h * h * m0;
            let slope = c1 / k2;
            let curvature = (c2 - k2 / n * m0) / (k4 - k2 * k2 / n);
            if order == 1 { slope } else { slope + 2.0 * curvature * h }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn savitzky_golay_differentiates_its_polynomials_exactly() {
        let parabola: Vec<f64> =
            (0..500).map(|t| 3.0 + 0.2 * f64::from(t) - 1e-3 * f64::from(t * t)).collect();
        let rates = savitzky_golay(&parabola, 2, 80);
        for t in [200, 300, 499] {
            assert!((rates[t] - (0.2 - 2e-3 * t as f64)).abs() < 1e-8, "{}", rates[t]);
        }
        let line: Vec<f64> = (0..500).map(|t| 3.0 + 0.2 * f64::from(t)).collect();
        assert!((savitzky_golay(&line, 1, 80)[300] - 0.2).abs() < 1e-9);
    }
}
