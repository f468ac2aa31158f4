//! Scores of many cases against the bars, by family, with confidence intervals.
//!
//! Shares have Clopper and Pearson's exact interval; the gain at which half of the effects are found comes from a logistic fit of
//! what was found over the logarithm of the oracle's gain (iteratively reweighted least squares, Firth's penalty, so that a
//! campaign that finds everything has a fit too), its interval from the likelihood ratio's curvature.
use serde::{Deserialize, Serialize};
use statrs::distribution::{Beta, ContinuousCDF, Normal};

use super::effect::Family;
use super::plan::Bars;
use super::score::{CaseScore, EffectScore};

/// Reported deviations within which a parameter must lie.
const DEVIATIONS: f64 = 3.0;
/// Rows times sensors for which the bar of time stands: 24 h at 1 Hz, six sensors.
const TIMED: f64 = 86_400.0 * 6.0;
/// Gains are taken as at least this in the logistic fit, nats.
const LEAST_GAIN: f64 = 0.1;
/// Iterations of the logistic fit.
const ITERATIONS: usize = 200;

/// A share of cases with its interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Cases in which it is so.
    pub hits: usize,
    /// Cases in all.
    pub of: usize,
    /// Share; not a number without cases.
    pub share: f64,
    /// Interval.
    pub interval: [f64; 2],
}

/// Whether a bar is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// The figure is on the right side of the bar.
    Reached,
    /// The figure is on the wrong side; its interval holds the bar.
    Open,
    /// The interval lies on the wrong side.
    Missed,
    /// There are no cases that tell.
    Unknown,
}

/// A figure with its bar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// What it is.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its interval.
    pub interval: [f64; 2],
    /// Cases, effects or parameters behind it.
    pub count: usize,
    /// Bar.
    pub bar: f64,
    /// Whether it must be above the bar.
    pub at_least: bool,
    /// Whether it is.
    pub standing: Standing,
}

/// Figures of one family, or of all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FamilySummary {
    /// Family; none for all.
    pub family: Option<Family>,
    /// Cases.
    pub cases: usize,
    /// Figures.
    pub figures: Vec<Figure>,
}

/// Results by identifier: how often it was right, of how many.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EffectSummary {
    /// Identifier.
    pub effect: String,
    /// Right, where the oracle's gain is above the bar.
    pub right: Share,
    /// Found anywhere, whatever the gain.
    pub found: Share,
}

/// Summary of a campaign.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Of all cases whose effects are in the catalogue or absent, and by family.
    pub families: Vec<FamilySummary>,
    /// By identifier.
    pub effects: Vec<EffectSummary>,
    /// Effects in no catalogue: cases in which the sensor was found, cases in which a known effect was claimed to explain everything.
    pub outside: [Share; 2],
    /// Explanations that failed.
    pub failures: Share,
}

impl Share {
    /// A share with Clopper and Pearson's interval.
    pub fn new(hits: usize, of: usize, confidence: f64) -> Self {
        if of == 0 {
            return Self { hits, of, share: f64::NAN, interval: [0.0, 1.0] };
        }
        let tail = 0.5 * (1.0 - confidence);
        let (k, n) = (hits as f64, of as f64);
        let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).map_or(f64::NAN, |beta| beta.inverse_cdf(p));
        let low = if hits == 0 { 0.0 } else { quantile(k, n - k + 1.0, tail) };
        let high = if hits == of { 1.0 } else { quantile(k + 1.0, n - k, 1.0 - tail) };
        Self { hits, of, share: k / n, interval: [low, high] }
    }
}

fn figure(name: &str, value: f64, interval: [f64; 2], count: usize, bar: f64, at_least: bool) -> Figure {
    let standing = if count == 0 || !value.is_finite() {
        Standing::Unknown
    } else if (at_least && value >= bar) || (!at_least && value <= bar) {
        Standing::Reached
    } else if (at_least && interval[1] < bar) || (!at_least && interval[0] > bar) {
        Standing::Missed
    } else {
        Standing::Open
    };
    Figure { name: name.to_owned(), value, interval, count, bar, at_least, standing }
}

fn share_figure(name: &str, share: Share, bar: f64, at_least: bool) -> Figure {
    figure(name, share.share, share.interval, share.of, bar, at_least)
}

/// Sums up.
pub fn summary(scores: &[CaseScore], bars: &Bars) -> Summary {
    let known: Vec<&CaseScore> = scores.iter().filter(|s| s.family != Family::Outside).collect();
    let mut families = vec![of_family(None, &known, bars)];
    let mut names: Vec<Family> = known.iter().map(|s| s.family).collect();
    names.sort_unstable();
    names.dedup();
    for family in names {
        let own: Vec<&CaseScore> = known.iter().copied().filter(|s| s.family == family).collect();
        families.push(of_family(Some(family), &own, bars));
    }
    let outside: Vec<&CaseScore> = scores.iter().filter(|s| s.family == Family::Outside).collect();
    let strong: Vec<&&CaseScore> =
        outside.iter().filter(|s| s.effects.iter().any(|e| e.gain_nats >= bars.gain_nats)).collect();
    let located = strong
        .iter()
        .filter(|s| s.located().is_some_and(|sensor| s.effects.iter().any(|e| e.sensor == sensor)));
    let claimed = strong.iter().filter(|s| s.verdict == Some(super::explanation::Verdict::Explained));
    let share = |hits: usize, of: usize| Share::new(hits, of, bars.confidence);
    Summary {
        families,
        effects: by_effect(scores, bars),
        outside: [share(located.count(), strong.len()), share(claimed.count(), strong.len())],
        failures: share(scores.iter().filter(|s| s.failure.is_some()).count(), scores.len()),
    }
}

fn by_effect(scores: &[CaseScore], bars: &Bars) -> Vec<EffectSummary> {
    let all: Vec<&EffectScore> = scores.iter().flat_map(|s| &s.effects).collect();
    let mut names: Vec<&str> = all.iter().map(|e| e.effect.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    names
        .into_iter()
        .map(|name| {
            let own: Vec<&&EffectScore> = all.iter().filter(|e| e.effect == name).collect();
            let strong: Vec<&&&EffectScore> = own.iter().filter(|e| e.gain_nats >= bars.gain_nats).collect();
            let right = strong.iter().filter(|e| e.right).count();
            let found = own.iter().filter(|e| e.found).count();
            EffectSummary {
                effect: name.to_owned(),
                right: Share::new(right, strong.len(), bars.confidence),
                found: Share::new(found, own.len(), bars.confidence),
            }
        })
        .collect()
}

fn of_family(family: Option<Family>, scores: &[&CaseScore], bars: &Bars) -> FamilySummary {
    let share = |hits: usize, of: usize| Share::new(hits, of, bars.confidence);
    let effects: Vec<&EffectScore> = scores.iter().flat_map(|s| &s.effects).collect();
    let mut figures = Vec::new();

    let strong: Vec<&&EffectScore> = effects.iter().filter(|e| e.gain_nats >= bars.gain_nats).collect();
    let right = strong.iter().filter(|e| e.right).count();
    figures.push(share_figure("right sensor and effect", share(right, strong.len()), bars.right, true));

    let null: Vec<&&CaseScore> = scores.iter().filter(|s| s.effects.is_empty()).collect();
    let alarms = null.iter().filter(|s| !s.false_findings.is_empty()).count();
    figures.push(share_figure(
        "false effect where nothing is concealed",
        share(alarms, null.len()),
        bars.false_alarm,
        false,
    ));

    let found: Vec<&&CaseScore> = scores.iter().filter(|s| s.effects.iter().any(|e| e.found)).collect();
    let second = found.iter().filter(|s| !s.false_findings.is_empty()).count();
    figures.push(share_figure(
        "false effect beside a true one",
        share(second, found.len()),
        bars.false_second,
        false,
    ));

    let deviations: Vec<f64> = effects
        .iter()
        .flat_map(|e| &e.parameters)
        .filter_map(super::score::ParameterScore::deviations)
        .collect();
    let within = deviations.iter().filter(|d| **d <= DEVIATIONS).count();
    figures.push(share_figure(
        "parameter within 3 sigma",
        share(within, deviations.len()),
        bars.parameter,
        true,
    ));

    let ratios: Vec<f64> =
        scores.iter().filter_map(|s| s.held_out_nats).map(|[found, oracle]| found / oracle).collect();
    let (median, interval) = median(&ratios, bars.confidence);
    figures.push(figure(
        "held-out gain of the oracle's (median)",
        median,
        interval,
        ratios.len(),
        bars.held_out,
        true,
    ));

    let pairs: Vec<(f64, bool)> =
        effects.iter().map(|e| (e.gain_nats.max(LEAST_GAIN).ln(), e.found)).collect();
    let (half, interval) = half_point(&pairs, bars.confidence);
    figures.push(figure(
        "gain at which half are found, nats",
        half,
        interval,
        pairs.len(),
        bars.half_nats,
        false,
    ));

    // A weak effect's onset is not in the data: what can be reached is what the oracle reaches.
    let onsets: Vec<([f64; 2], f64)> =
        effects.iter().filter_map(|e| e.onset_s.zip(e.oracle_onset_s)).collect();
    let near = onsets.iter().filter(|([off, allowed], _)| off <= allowed).count();
    let by_oracle = onsets.iter().filter(|([_, allowed], off)| off <= allowed).count();
    let bar = bars.onset * by_oracle as f64 / onsets.len().max(1) as f64;
    figures.push(share_figure("onset of what is local in time", share(near, onsets.len()), bar, true));

    let times: Vec<f64> =
        scores.iter().map(|s| s.time_s / ((s.rows * s.sensors) as f64 / TIMED).max(1.0)).collect();
    let slowest = times.iter().copied().fold(f64::NAN, f64::max);
    figures.push(figure("time of the slowest, s", slowest, [slowest; 2], times.len(), bars.time_s, false));
    FamilySummary { family, cases: scores.len(), figures }
}

/// Median with the interval of its order statistics.
fn median(values: &[f64], confidence: f64) -> (f64, [f64; 2]) {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    if n == 0 {
        return (f64::NAN, [f64::NEG_INFINITY, f64::INFINITY]);
    }
    let half_width = quantile(confidence) * 0.5 * (n as f64).sqrt();
    let at = |place: f64| match place {
        p if p < 0.0 => f64::NEG_INFINITY,
        p if p > (n - 1) as f64 => f64::INFINITY,
        p => sorted[p.round() as usize],
    };
    let middle = 0.5 * (n - 1) as f64;
    (0.5 * (sorted[n / 2] + sorted[(n - 1) / 2]), [at(middle - half_width), at(middle + half_width)])
}

/// Two-sided normal quantile.
fn quantile(confidence: f64) -> f64 {
    Normal::new(0.0, 1.0).map_or(f64::NAN, |normal| normal.inverse_cdf(0.5 * (1.0 + confidence)))
}

/// Intercept, slope and covariance of a logistic fit with Firth's penalty; none where the points have no spread.
pub fn logistic(points: &[(f64, bool)]) -> Option<([f64; 2], [[f64; 2]; 2])> {
    let first = points.first()?.0;
    if points.iter().all(|(x, _)| (x - first).abs() < 1e-9) {
        return None;
    }
    let mut beta = nalgebra::Vector2::zeros();
    let mut covariance = nalgebra::Matrix2::zeros();
    for _ in 0..ITERATIONS {
        let mut information = nalgebra::Matrix2::zeros();
        for (x, _) in points {
            let row = nalgebra::Vector2::new(1.0, *x);
            let p = 1.0 / (1.0 + (-row.dot(&beta)).exp());
            information += row * row.transpose() * (p * (1.0 - p)).max(1e-12);
        }
        covariance = information.try_inverse()?;
        let mut slope = nalgebra::Vector2::zeros();
        for (x, y) in points {
            let row = nalgebra::Vector2::new(1.0, *x);
            let p = 1.0 / (1.0 + (-row.dot(&beta)).exp());
            let leverage = (p * (1.0 - p)).max(1e-12) * row.dot(&(covariance * row));
            slope += row * (f64::from(u8::from(*y)) - p + leverage * (0.5 - p));
        }
        let mut step: nalgebra::Vector2<f64> = covariance * slope;
        // Steps are held short; the penalised likelihood is concave enough for that to be all it takes.
        let length = step.amax();
        if length > 1.0 {
            step /= length;
        }
        beta += step;
        if length < 1e-9 {
            break;
        }
    }
    let c = |i: usize, j: usize| covariance[(i, j)];
    Some(([beta[0], beta[1]], [[c(0, 0), c(0, 1)], [c(1, 0), c(1, 1)]]))
}

/// The gain at which half are found, nats, with its interval; pairs are logarithm of the gain and whether it was found.
fn half_point(pairs: &[(f64, bool)], confidence: f64) -> (f64, [f64; 2]) {
    let gains = pairs.iter().map(|(x, _)| x.exp());
    if pairs.is_empty() {
        return (f64::NAN, [0.0, f64::INFINITY]);
    }
    if pairs.iter().all(|(_, found)| *found) {
        // Somewhere below all of them.
        let least = gains.fold(f64::INFINITY, f64::min);
        return (least, [0.0, least]);
    }
    if pairs.iter().all(|(_, found)| !found) {
        let most = gains.fold(0.0, f64::max);
        return (most, [most, f64::INFINITY]);
    }
    let unknown = (f64::NAN, [0.0, f64::INFINITY]);
    let Some(([a, b], covariance)) = logistic(pairs) else { return unknown };
    if b <= 0.0 {
        return unknown;
    }
    let at = -a / b;
    // Delta method: d(−a/b) = −da/b + a db/b².
    let gradient = [-1.0 / b, a / (b * b)];
    let variance: f64 = (0..2)
        .flat_map(|i| (0..2).map(move |j| (i, j)))
        .map(|(i, j)| gradient[i] * covariance[i][j] * gradient[j])
        .sum();
    let half_width = quantile(confidence) * variance.max(0.0).sqrt();
    (at.exp(), [(at - half_width).exp(), (at + half_width).exp()])
}

impl Summary {
    /// Whether a figure over all cases misses its bar for sure.
    pub fn misses(&self) -> Vec<&Figure> {
        let all = self.families.iter().filter(|f| f.family.is_none()).flat_map(|f| &f.figures);
        all.filter(|figure| figure.standing == Standing::Missed).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::random::Stream;

    #[test]
    fn clopper_and_pearson_agree_with_published_values() {
        // Newcombe (1998), table I, method 5: 81 of 263 and 15 of 148, 0 of 20, 1 of 29.
        for (hits, of, low, high) in [
            (81, 263, 0.2527, 0.3676),
            (15, 148, 0.0578, 0.1617),
            (0, 20, 0.0, 0.1684),
            (1, 29, 0.0009, 0.1776),
        ] {
            let share = Share::new(hits, of, 0.95);
            assert!(
                (share.interval[0] - low).abs() < 6e-5 && (share.interval[1] - high).abs() < 6e-5,
                "{share:?}"
            );
        }
        assert!(Share::new(0, 0, 0.95).share.is_nan());
    }

    #[test]
    fn half_point_is_found_and_its_interval_covers_it() {
        let mut covered = 0;
        for run in 0..200 {
            let mut stream = Stream::new(run, "logistic");
            let pairs: Vec<(f64, bool)> = (0..150)
                .map(|_| {
                    let x = (4f64).ln() + stream.uniform() * (250f64).ln();
                    (x, stream.uniform() < 1.0 / (1.0 + (-3.0 * (x - 8f64.ln())).exp()))
                })
                .collect();
            let (half, [low, high]) = half_point(&pairs, 0.95);
            assert!((4.0..14.0).contains(&half), "{half}");
            covered += usize::from(low <= 8.0 && 8.0 <= high);
        }
        assert!((180..=200).contains(&covered), "{covered}");
    }

    #[test]
    fn a_campaign_that_finds_everything_or_nothing_has_a_half_point() {
        let pairs = |found: bool| (0..60).map(|k| (1.4 + 0.08 * f64::from(k), found)).collect::<Vec<_>>();
        let (all, _) = half_point(&pairs(true), 0.95);
        assert!(all < 4.1, "{all}");
        let (none, _) = half_point(&pairs(false), 0.95);
        assert!(none > 100.0, "{none}");
    }

    #[test]
    fn standings() {
        let stand =
            |hits, of, bar, at_least| share_figure("", Share::new(hits, of, 0.95), bar, at_least).standing;
        assert_eq!(stand(96, 100, 0.95, true), Standing::Reached);
        assert_eq!(stand(94, 100, 0.95, true), Standing::Open);
        assert_eq!(stand(80, 100, 0.95, true), Standing::Missed);
        assert_eq!(stand(1, 100, 0.02, false), Standing::Reached);
        assert_eq!(stand(15, 100, 0.02, false), Standing::Missed);
        assert_eq!(stand(0, 0, 0.02, false), Standing::Unknown);
    }
}
