//! Random numbers and the random drifts of sensors.
//!
//! Every consumer of randomness has a stream of its own, named by a path such as `gyro_1/drift`: adding or removing
//! a sensor changes nothing for the others. The processes are sampled exactly at any step (s); units are the
//! caller's.
use rand::SeedableRng;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Dxsm;

/// One independent stream of normal numbers.
#[derive(Clone, Debug)]
pub struct Stream {
    generator: Pcg64Dxsm,
}

impl Stream {
    /// The stream called `name` of the run with this seed.
    pub fn new(seed: u64, name: &str) -> Self {
        // FNV-1a over the name, then the generator's own seed expansion; the name also selects the increment.
        let mut hash: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
        for byte in seed.to_le_bytes().into_iter().chain(name.bytes()) {
            hash ^= u128::from(byte);
            hash = hash.wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b);
        }
        let mut state = [0u8; 32];
        state[..16].copy_from_slice(&hash.to_le_bytes());
        state[16..].copy_from_slice(&hash.rotate_left(61).to_be_bytes());
        Self { generator: Pcg64Dxsm::from_seed(state) }
    }

    /// A standard normal number.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.generator)
    }

    /// A number uniform over [0, 1).
    pub fn uniform(&mut self) -> f64 {
        rand::RngExt::random(&mut self.generator)
    }
}

/// What a random drift is made of. σ in the process's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Process {
    /// First-order Markov: R(t) = σ² exp(−|t|/τ).
    Markov {
        /// Standard deviation.
        sigma: f64,
        /// Correlation time, s.
        tau_s: f64,
    },
    /// R(t) = σ² exp(−α|t|) cos βt.
    ExponentialCosine {
        /// Standard deviation.
        sigma: f64,
        /// Rate of decay, 1/s.
        alpha: f64,
        /// Angular frequency, rad/s.
        beta: f64,
    },
    /// Integrated white noise, from zero.
    RandomWalk {
        /// 1-σ growth in the unit per √s.
        rate: f64,
    },
    /// Flicker noise S(f) = B²/(2πf) between two corner times: a sum of Markov processes spaced by a factor of two.
    Flicker {
        /// Bias instability B; the Allan deviation's floor is 0.664 B.
        instability: f64,
        /// Shortest correlation time, s.
        shortest_s: f64,
        /// Longest correlation time, s.
        longest_s: f64,
    },
}

/// Spacing of the correlation times that make up flicker noise.
const FLICKER_RATIO: f64 = 2.0;

/// A random drift at work.
#[derive(Clone, Debug)]
pub struct Drift {
    terms: Vec<Term>,
    stream: Stream,
}

#[derive(Clone, Debug)]
enum Term {
    Markov { sigma: f64, tau_s: f64, value: f64 },
    ExponentialCosine { sigma: f64, alpha: f64, beta: f64, value: [f64; 2] },
    RandomWalk { rate: f64, value: f64 },
}

impl Drift {
    /// A drift that is the sum of `processes`; the stationary ones start in their stationary distribution.
    pub fn new(processes: &[Process], mut stream: Stream) -> Self {
        let mut terms = Vec::new();
        for process in processes {
            match *process {
                Process::Markov { sigma, tau_s } => {
                    terms.push(Term::Markov { sigma, tau_s, value: sigma * stream.normal() });
                }
                Process::ExponentialCosine { sigma, alpha, beta } => {
                    let value = [sigma * stream.normal(), sigma * stream.normal()];
                    terms.push(Term::ExponentialCosine { sigma, alpha, beta, value });
                }
                Process::RandomWalk { rate } => terms.push(Term::RandomWalk { rate, value: 0.0 }),
                Process::Flicker { instability, shortest_s, longest_s } => {
                    // Σ over log-spaced τ of one-sided spectra 4σ²τ/(1 + (2πfτ)²) → σ²/(f ln r), to equal B²/(2πf) × 2
                    // (one-sided). Hence σ² = B² ln r/π.
                    let sigma = instability * (FLICKER_RATIO.ln() / std::f64::consts::PI).sqrt();
                    let mut tau_s = shortest_s;
                    while tau_s <= longest_s * (1.0 + 1e-9) {
                        terms.push(Term::Markov { sigma, tau_s, value: sigma * stream.normal() });
                        tau_s *= FLICKER_RATIO;
                    }
                }
            }
        }
        Self { terms, stream }
    }

    /// The drift now.
    pub fn value(&self) -> f64 {
        self.terms
            .iter()
            .map(|term| match term {
                Term::Markov { value, .. } | Term::RandomWalk { value, .. } => *value,
                Term::ExponentialCosine { value, .. } => value[0],
            })
            .sum()
    }

    /// Moves on by `step_s` seconds and returns the drift there.
    pub fn advance(&mut self, step_s: f64) -> f64 {
        let stream = &mut self.stream;
        for term in &mut self.terms {
            match term {
                Term::Markov { sigma, tau_s, value } => {
                    let memory = (-step_s / *tau_s).exp();
                    *value = memory * *value + *sigma * (1.0 - memory * memory).sqrt() * stream.normal();
                }
                Term::ExponentialCosine { sigma, alpha, beta, value } => {
                    let memory = (-*alpha * step_s).exp();
                    let (s, c) = (*beta * step_s).sin_cos();
                    let fresh = *sigma * (1.0 - memory * memory).sqrt();
                    *value = [
                        memory * (c * value[0] - s * value[1]) + fresh * stream.normal(),
                        memory * (s * value[0] + c * value[1]) + fresh * stream.normal(),
                    ];
                }
                Term::RandomWalk { rate, value } => *value += *rate * step_s.sqrt() * stream.normal(),
            }
        }
        self.value()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Autocovariance of `n` samples at the given lags.
    fn autocovariance(drift: &mut Drift, step_s: f64, n: usize, lags: &[usize]) -> Vec<f64> {
        let x: Vec<f64> = (0..n).map(|_| drift.advance(step_s)).collect();
        lags.iter()
            .map(|&j| x.iter().zip(&x[j..]).map(|(a, b)| a * b).sum::<f64>() / (n - j) as f64)
            .collect()
    }

    #[test]
    fn streams_are_repeatable_and_independent() {
        let draw = |seed, name| {
            let mut stream = Stream::new(seed, name);
            (0..20_000).map(|_| stream.normal()).collect::<Vec<_>>()
        };
        assert_eq!(draw(1, "gyro_1"), draw(1, "gyro_1"));
        let (a, b, c) = (draw(1, "gyro_1"), draw(1, "gyro_2"), draw(2, "gyro_1"));
        let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(x, y)| x * y).sum::<f64>() / 20_000.0;
        assert!((product(&a, &a) - 1.0).abs() < 0.05);
        assert!(product(&a, &b).abs() < 0.03 && product(&a, &c).abs() < 0.03);
    }

    #[test]
    fn markov_autocovariance_agrees_with_theory() {
        let mut drift = Drift::new(&[Process::Markov { sigma: 2.0, tau_s: 50.0 }], Stream::new(7, "markov"));
        let n = 1_000_000;
        let lags = [0, 10, 50, 100];
        // Standard deviation of an autocovariance of a Markov process: about σ² √(2τ/T).
        let tolerance = 4.0 * 4.0 * (2.0 * 50.0 / n as f64).sqrt();
        for (lag, r) in lags.iter().zip(autocovariance(&mut drift, 1.0, n, &lags)) {
            let theory = 4.0 * (-(*lag as f64) / 50.0).exp();
            assert!((r - theory).abs() < tolerance, "lag {lag}: {r} against {theory}");
        }
    }

    #[test]
    fn exponential_cosine_autocovariance_agrees_with_theory() {
        let (sigma, alpha, beta) = (1.5, 1.0 / 60.0, 0.05);
        let mut drift =
            Drift::new(&[Process::ExponentialCosine { sigma, alpha, beta }], Stream::new(7, "cosine"));
        let n = 1_000_000;
        let lags = [0, 15, 30, 60, 90];
        let tolerance = 4.0 * sigma * sigma * (2.0 / alpha / n as f64).sqrt();
        for (lag, r) in lags.iter().zip(autocovariance(&mut drift, 1.0, n, &lags)) {
            let t = *lag as f64;
            let theory = sigma * sigma * (-alpha * t).exp() * (beta * t).cos();
            assert!((r - theory).abs() < tolerance, "lag {lag}: {r} against {theory}");
        }
    }

    #[test]
    fn flicker_allan_deviation_is_flat_at_its_theoretical_level() {
        let flicker = Process::Flicker { instability: 1.0, shortest_s: 1.0, longest_s: 65536.0 };
        let mut drift = Drift::new(&[flicker], Stream::new(11, "flicker"));
        let x: Vec<f64> = (0..1_000_000).map(|_| drift.advance(1.0)).collect();
        for m in [64, 256, 1024] {
            let means: Vec<f64> = x.chunks_exact(m).map(|c| c.iter().sum::<f64>() / m as f64).collect();
            let variance = means.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f64>()
                / (2.0 * (means.len() - 1) as f64);
            // √(2 ln 2/π) = 0.664.
            assert!((variance.sqrt() / 0.664 - 1.0).abs() < 0.08, "m {m}: {}", variance.sqrt());
        }
    }

    #[test]
    fn random_walk_grows_with_the_square_root_of_time() {
        let mut sum = 0.0;
        for run in 0..4000 {
            let mut drift = Drift::new(&[Process::RandomWalk { rate: 0.3 }], Stream::new(run, "walk"));
            for _ in 0..25 {
                drift.advance(4.0);
            }
            sum += drift.value().powi(2);
        }
        let variance = sum / 4000.0;
        assert!((variance / 9.0 - 1.0).abs() < 4.0 * (2.0f64 / 4000.0).sqrt(), "{variance}");
    }
}
