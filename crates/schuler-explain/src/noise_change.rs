//! Noise of another structure or level as a candidate: the best fit of each change to one source.
//!
//! A change is found on Whittle's likelihood and judged by the exact one. Its evidence is the tail of χ² with as many
//! degrees of freedom as it has parameters, one more where a part is added (its correlation time means nothing without
//! it, so that the maximum over it is a scan), and the number of frequencies searched for an exponential-cosine: bounds
//! that are on the safe side.
use schuler_recording::case::{ExponentialCosine, Markov};

use crate::catalogue::{NoiseChange, Port};
use crate::noise::{Flicker, Knob, Noise, RowsOfLevel, VarianceStep};
use crate::noise_fit::{Observations, SourceKnob, exact, logs_of, polish, whittle};
use crate::nominal::Source;
use crate::price::Price;
use crate::statistics::{ln_chi_squared_tail, ln_rough_scan_tail};
use crate::whiten::Filter;

/// Most Markov parts.
const MOST_MARKOV: usize = 3;
/// Gain on Whittle's likelihood below which the exact one is not asked.
const WORTH_POLISHING: f64 = 3.0;
/// The same for its evidence: what shows less is neither taken nor tried beside a term.
const LEAST_EVIDENCE: f64 = 2.0;
/// Correlation times tried for a further part: from steps, to a part of the record, by a factor.
const SHORTEST_STEPS: f64 = 2.0;
const LONGEST_PART: f64 = 0.3;
const TAU_FACTOR: f64 = 3.0;
/// Shortest correlation times tried for flicker, steps; its longest is the record, as flicker does not end within it.
const FLICKER_STEPS: [f64; 2] = [2.0, 6.0];
/// Levels tried for a further part, relative to what one step tells.
const LEVELS: [f64; 7] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0];
/// Starts kept for the simplex.
const STARTS: usize = 2;
/// Nats, and logarithms of the parameters, within which two starts have led to the same place.
const SAME_NATS: f64 = 0.05;
const SAME_PLACE: f64 = 0.1;
/// Frequencies tried for an exponential-cosine.
const PEAKS: usize = 4;
/// Level of the Markov parts, as a part of what it was, from which an exponential-cosine is tried in their place.
const REPLACED: f64 = 0.03;
/// Logarithm of the number of places searched for a further Markov part, and for an exponential-cosine.
const LN_PLACES_MARKOV: f64 = 1.4;
const LN_PLACES_COSINE: f64 = 3.0;
/// What one innovation may say at most of the white level, in its deviations: an outlier is not a level.
const MOST_INNOVATION: f64 = 4.0;
/// Rows left on both sides of a change of the white level.
const MARGIN_ROWS: usize = 20;

/// A change fitted.
#[derive(Clone, Debug)]
pub struct ChangeFit {
    /// The source.
    pub source: usize,
    /// What changed.
    pub change: NoiseChange,
    /// All noises with it.
    pub noises: Vec<Noise>,
    /// The parameters that were fitted.
    pub knobs: Vec<Knob>,
    /// Gain in exact log-likelihood, with what the readings tell beside the residuals.
    pub gain: f64,
    /// Degrees of freedom by which it is judged.
    pub freedom: usize,
    /// ln of the number of places where it was sought.
    pub ln_places: f64,
    /// ln of the probability of such a gain without a change, over all places where it was sought.
    pub ln_p: f64,
}

impl ChangeFit {
    /// How it is judged.
    pub fn price(&self) -> Price {
        Price::among(self.freedom, self.ln_places)
    }
}

/// A block seen under its present noises.
pub struct View<'b> {
    /// What its noises are fitted to.
    pub observations: Observations<'b>,
    /// Present noises of all sources.
    pub noises: &'b [Noise],
    /// Their filter.
    pub filter: &'b Filter,
    /// Whitened residuals.
    pub whitened: &'b [f64],
    /// Exact log-likelihood of the residuals.
    pub log_likelihood: f64,
}

/// Where the exact likelihood of a change is to begin, and what it promises there.
#[derive(Clone, Debug)]
pub struct PromisedStart {
    start: Start,
    /// −ln p over all places where it was sought.
    pub evidence: f64,
}

/// Two levels of white noise: what they gain, nats, the rows of the first, and the variances of both by that of the innovations.
struct Levels {
    gain: f64,
    number: usize,
    within: f64,
    beyond: f64,
}

/// Noises to start from, the parameters to fit, degrees of freedom, and ln of the number of places searched.
#[derive(Clone, Debug)]
struct Start {
    noises: Vec<Noise>,
    knobs: Vec<Knob>,
    freedom: usize,
    ln_places: f64,
}

impl View<'_> {
    /// What a change of a source promises: by Whittle's likelihood, and for a change of the white level by the squares of
    /// the innovations.
    pub fn promised(&self, source: usize, origin: &Source, change: NoiseChange) -> Vec<PromisedStart> {
        match change {
            NoiseChange::VarianceStep => return self.promised_step(source).into_iter().collect(),
            NoiseChange::LevelAbove(quantity) => {
                return self.promised_level(source, origin, quantity).into_iter().collect();
            }
            _ => {}
        }
        let Some(one) = self.observations.spectrum.one_source(self.observations.block, self.noises, source)
        else {
            return Vec::new();
        };
        let base = one.log_likelihood(&self.noises[source]);
        let mut starts: Vec<(f64, Start)> = (self.starts(source, origin, change).into_iter())
            .map(|start| (one.log_likelihood(&start.noises[source]), start))
            .filter(|(likelihood, _)| likelihood.is_finite())
            .collect();
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        // One start each for what is of another kind.
        let mut kept: Vec<Start> = Vec::new();
        for (_, start) in starts {
            let flicker = |start: &Start| start.noises.get(source).map(|noise| noise.flicker.tau_s);
            let alike = |other: &&Start| other.knobs == start.knobs && flicker(other) == flicker(&start);
            let same = kept.iter().filter(alike).count();
            if same < STARTS {
                kept.push(start);
            }
        }
        // Where starts led: from the same place the exact likelihood leads to the same as well.
        let mut reached: Vec<(Vec<Knob>, f64, Vec<f64>)> = Vec::new();
        let mut promised = Vec::new();
        for start in kept {
            let knobs: Vec<SourceKnob> = start.knobs.iter().map(|&knob| (source, knob)).collect();
            let (noises, likelihood) = whittle(self.observations.block, &one, &start.noises, &knobs);
            let logs = logs_of(&noises, &knobs);
            let same = |(other, height, place): &(Vec<Knob>, f64, Vec<f64>)| {
                *other == start.knobs
                    && (height - likelihood).abs() < SAME_NATS
                    && place.iter().zip(&logs).all(|(a, b)| (a - b).abs() < SAME_PLACE)
            };
            if reached.iter().any(same) {
                continue;
            }
            reached.push((start.knobs.clone(), likelihood, logs));
            let gain = likelihood - base;
            let evidence = -ln_chi_squared_tail(2.0 * gain, start.freedom) - start.ln_places;
            if gain >= WORTH_POLISHING && evidence >= LEAST_EVIDENCE {
                promised.push(PromisedStart { start: Start { noises, ..start }, evidence });
            }
        }
        promised
    }

    /// The best fit of a change to a source by the exact likelihood, from where it promised most; `None` where it promised
    /// nothing.
    pub fn fit(&self, source: usize, change: NoiseChange, promised: &[PromisedStart]) -> Option<ChangeFit> {
        let fits = promised.iter().filter_map(|PromisedStart { start, .. }| match change {
            NoiseChange::VarianceStep => self.fit_step(source, start),
            _ => Some(self.fit_promised(source, change, start)),
        });
        let remembers = |fit: &ChangeFit| is_seen_from_row_to_row(fit, self.observations.block.step_s());
        fits.filter(remembers).min_by(|a, b| a.ln_p.total_cmp(&b.ln_p))
    }

    fn fit_promised(&self, source: usize, change: NoiseChange, start: &Start) -> ChangeFit {
        let knobs: Vec<SourceKnob> = start.knobs.iter().map(|&knob| (source, knob)).collect();
        let here = self.log_likelihood + self.observations.beside_residuals(self.noises);
        let fit = polish(self.observations, &start.noises, &knobs, here + WORTH_POLISHING, None);
        let gain = change.counted(fit.log_likelihood - here, self.told(&fit.noises));
        let ln_p = (ln_chi_squared_tail(2.0 * gain, start.freedom) + start.ln_places).min(0.0);
        ChangeFit {
            source,
            change,
            noises: fit.noises,
            knobs: start.knobs.clone(),
            gain,
            freedom: start.freedom,
            ln_places: start.ln_places,
            ln_p,
        }
    }

    /// What the readings tell of noises, in the place of the present ones, beside the residuals.
    fn told(&self, noises: &[Noise]) -> f64 {
        self.observations.beside_residuals(noises) - self.observations.beside_residuals(self.noises)
    }

    /// A further Markov part of a source, and what it would gain, both by Whittle's likelihood.
    pub fn further_markov(&self, source: usize, origin: &Source) -> Option<(Markov, f64)> {
        let part = self.noises[source].markov.len();
        let one = self.observations.spectrum.one_source(self.observations.block, self.noises, source)?;
        let base = one.log_likelihood(&self.noises[source]);
        let starts = self.starts(source, origin, NoiseChange::Markov).into_iter();
        let (_, start) = starts
            .filter(|start| start.knobs.contains(&Knob::MarkovSigma(part)))
            .map(|start| (one.log_likelihood(&start.noises[source]), start))
            .filter(|(likelihood, _)| likelihood.is_finite())
            .max_by(|a, b| a.0.total_cmp(&b.0))?;
        let knobs: Vec<SourceKnob> = start.knobs.iter().map(|&knob| (source, knob)).collect();
        let (noises, likelihood) = whittle(self.observations.block, &one, &start.noises, &knobs);
        Some((*noises[source].markov.get(part)?, likelihood - base))
    }

    /// What one step tells of a source: the unit in which levels are tried.
    fn unit(&self, source: usize, origin: &Source) -> f64 {
        if origin.port == Port::Output {
            let (_, whitening) = self.filter.settled();
            return whitening.first().map_or(1.0, |w| w.recip());
        }
        let own = &self.noises[source];
        let sigma = own.markov.iter().map(|part| part.sigma).chain(own.exp_cos.iter().map(|part| part.sigma));
        let fallback = if origin.port == Port::Accelerometer { 1e-3 } else { 5e-7 };
        sigma.fold(0.0, f64::max).max(1e-3 * fallback)
    }

    fn starts(&self, source: usize, origin: &Source, change: NoiseChange) -> Vec<Start> {
        let own = &self.noises[source];
        let unit = self.unit(source, origin);
        let step_s = self.observations.block.step_s();
        let length_s = step_s * self.observations.block.rows() as f64;
        let with = |alter: &dyn Fn(&mut Noise)| {
            let mut noises = self.noises.to_vec();
            alter(&mut noises[source]);
            noises
        };
        let single = |knob: Knob, freedom: usize| {
            let value = own.get(knob);
            let levels: Vec<f64> = if value > 0.0 { vec![value] } else { LEVELS.map(|l| l * unit).to_vec() };
            levels
                .into_iter()
                .map(|level| Start {
                    noises: with(&|noise| noise.set(knob, level)),
                    knobs: vec![knob],
                    freedom,
                    ln_places: 0.0,
                })
                .collect::<Vec<_>>()
        };
        match change {
            // A change of the white level has its own search; white noise and rounding are of an output alone.
            NoiseChange::VarianceStep | NoiseChange::LevelAbove(_) => Vec::new(),
            NoiseChange::White | NoiseChange::AngleQuantisation if origin.port != Port::Output => Vec::new(),
            NoiseChange::White => single(Knob::White, 1),
            NoiseChange::RandomWalk => {
                let mut starts = single(Knob::RandomWalk, 1);
                for start in &mut starts {
                    if own.random_walk == 0.0 {
                        start.noises[source].random_walk *= 0.1 / step_s.sqrt();
                    }
                }
                starts
            }
            NoiseChange::AngleQuantisation => single(Knob::Angle, 1),
            NoiseChange::Flicker if own.flicker.sigma > 0.0 => single(Knob::Flicker, 1),
            NoiseChange::Flicker => {
                let of = |steps: f64| {
                    let mut starts = single(Knob::Flicker, 1);
                    for start in &mut starts {
                        let flicker = &mut start.noises[source].flicker;
                        *flicker = Flicker { tau_s: [steps * step_s, length_s], ..*flicker };
                        start.ln_places = (FLICKER_STEPS.len() as f64).ln();
                    }
                    starts
                };
                FLICKER_STEPS.into_iter().flat_map(of).collect()
            }
            NoiseChange::Markov => {
                let mut starts: Vec<Start> = (0..own.markov.len())
                    .map(|part| Start {
                        noises: self.noises.to_vec(),
                        knobs: vec![Knob::MarkovSigma(part), Knob::MarkovTau(part)],
                        freedom: 2,
                        ln_places: 0.0,
                    })
                    .collect();
                let part = own.markov.len();
                let mut tau_s = SHORTEST_STEPS * step_s;
                while part < MOST_MARKOV && tau_s < LONGEST_PART * length_s {
                    for level in LEVELS {
                        let sigma = level * unit;
                        starts.push(Start {
                            noises: with(&|noise| noise.markov.push(Markov { sigma, tau_s })),
                            knobs: vec![Knob::MarkovSigma(part), Knob::MarkovTau(part)],
                            freedom: 2,
                            ln_places: LN_PLACES_MARKOV,
                        });
                    }
                    tau_s *= TAU_FACTOR;
                }
                starts
            }
            NoiseChange::ExponentialCosine => self.cosine_starts(source, unit),
        }
    }

    /// Parts that are there, set free, and further ones at the frequencies that stand out: beside the Markov parts as they
    /// are, and in their place, their levels being free. Beside a Markov part that is too strong no further one is any good.
    fn cosine_starts(&self, source: usize, unit: f64) -> Vec<Start> {
        let own = &self.noises[source];
        let step_s = self.observations.block.step_s();
        let with = |noise: ExponentialCosine| {
            let mut noises = self.noises.to_vec();
            noises[source].exp_cos.push(noise);
            noises
        };
        let knobs = |part| vec![Knob::CosineSigma(part), Knob::CosineAlpha(part), Knob::CosineBeta(part)];
        let mut starts: Vec<Start> = (0..own.exp_cos.len())
            .map(|part| Start {
                noises: self.noises.to_vec(),
                knobs: knobs(part),
                freedom: 3,
                ln_places: 0.0,
            })
            .collect();
        let part = own.exp_cos.len();
        let levels: Vec<Knob> = (0..own.markov.len()).map(Knob::MarkovSigma).collect();
        for omega in self.observations.spectrum.peaks(PEAKS) {
            let beta = omega / step_s;
            for damping in [0.03, 0.2, 1.0] {
                for level in LEVELS {
                    let noise = ExponentialCosine { sigma: level * unit, alpha: damping * beta, beta };
                    let beside = Start {
                        noises: with(noise),
                        knobs: knobs(part),
                        freedom: 3,
                        ln_places: LN_PLACES_COSINE,
                    };
                    if !levels.is_empty() {
                        let mut instead = beside.clone();
                        for &level in &levels {
                            let noise = &mut instead.noises[source];
                            noise.set(level, REPLACED * noise.get(level));
                        }
                        instead.knobs.extend(&levels);
                        instead.freedom += levels.len();
                        starts.push(instead);
                    }
                    starts.push(beside);
                }
            }
        }
        starts
    }

    /// A change of the white level, at the time found on the squares of the innovations, of which only those along the
    /// source change.
    fn promised_step(&self, source: usize) -> Option<PromisedStart> {
        let squares = self.squares(source)?;
        let backwards: Vec<usize> = (0..self.observations.block.rows()).rev().collect();
        let Levels { gain, number, within, .. } =
            self.best_levels(&backwards, &squares, false, |_, _| true)?;
        let row = self.observations.block.rows() - number;
        let rows = RowsOfLevel::From(row);
        let step = VarianceStep { rows, part: self.part(number), ratio: within.sqrt() };
        self.promise_of_level(source, gain, step, None)
    }

    /// Another white level where a quantity is large, both levels free.
    fn promised_level(&self, source: usize, origin: &Source, quantity: usize) -> Option<PromisedStart> {
        let squares = self.squares(source)?;
        let loudness = self.observations.block.loudness.get(quantity)?;
        let (order, values) = (&loudness.descending, &loudness.values);
        let divides = |row: usize, next: usize| values[row] > values[next];
        let Levels { gain, number, within, beyond } = self.best_levels(order, &squares, true, divides)?;
        let value = 0.5 * (values[order[number - 1]] + values[order[number]]);
        let rows = RowsOfLevel::Above { quantity, value };
        let step = VarianceStep { rows, part: self.part(number), ratio: (within / beyond).sqrt() };
        let is_known = self.noises[source].white == origin.nominal.white;
        self.promise_of_level(source, gain, step, Some((beyond.sqrt(), is_known)))
    }

    fn part(&self, number: usize) -> f64 {
        number as f64 / self.observations.block.rows() as f64
    }

    fn promise_of_level(
        &self,
        source: usize,
        gain: f64,
        step: VarianceStep,
        beyond: Option<(f64, bool)>,
    ) -> Option<PromisedStart> {
        if gain < WORTH_POLISHING {
            return None;
        }
        let (mut ln_p, ln_places) = self.step_tail(gain);
        let mut noises = self.noises.to_vec();
        let (mut knobs, mut freedom) = (vec![Knob::StepRatio], 1);
        noises[source].step = Some(step);
        if let Some((scale, is_known)) = beyond {
            noises[source].white *= scale;
            knobs.insert(0, Knob::White);
            freedom += usize::from(is_known);
            ln_p = ln_chi_squared_tail(2.0 * gain, freedom) + ln_places;
        }
        let start = Start { noises, knobs, freedom, ln_places };
        (-ln_p >= LEAST_EVIDENCE).then_some(PromisedStart { start, evidence: -ln_p })
    }

    /// Squares of the innovations along a source whose white level may change.
    fn squares(&self, source: usize) -> Option<Vec<f64>> {
        let noise = &self.noises[source];
        if noise.white <= 0.0 || noise.step.is_some() {
            return None;
        }
        let (rows, channels) = (self.observations.block.rows(), self.observations.block.channels);
        let along = self.along(source)?;
        let square = |row: usize| {
            let innovation: f64 = (0..channels).map(|c| along[c] * self.whitened[c * rows + row]).sum();
            innovation.powi(2).min(MOST_INNOVATION.powi(2))
        };
        Some((0..rows).map(square).collect())
    }

    /// How many of the first of `order` gain most by a level of their own, the others keeping theirs or with one of their own as well. Between
    /// a row and the next it must be possible to divide.
    fn best_levels(
        &self,
        order: &[usize],
        squares: &[f64],
        both: bool,
        divides: impl Fn(usize, usize) -> bool,
    ) -> Option<Levels> {
        let present = |row: &&usize| self.observations.block.present[**row];
        let (all, count) =
            order.iter().filter(present).fold((0.0, 0.0), |(sum, n), &row| (sum + squares[row], n + 1.0));
        let gain_of = |sum: f64, number: f64| {
            let ratio = sum / number;
            0.5 * number * (ratio - 1.0 - ratio.max(1e-12).ln())
        };
        let (mut sum, mut number) = (0.0, 0.0);
        let mut best: Option<Levels> = None;
        for (at, pair) in order.windows(2).enumerate() {
            let (row, next) = (pair[0], pair[1]);
            if self.observations.block.present[row] {
                sum += squares[row];
                number += 1.0;
            }
            if number < MARGIN_ROWS as f64 || !divides(row, next) {
                continue;
            }
            let others = count - number;
            if others < MARGIN_ROWS as f64 {
                break;
            }
            let gain = gain_of(sum, number) + if both { gain_of(all - sum, others) } else { 0.0 };
            if best.as_ref().is_none_or(|best| gain > best.gain) {
                best =
                    Some(Levels { gain, number: at + 1, within: sum / number, beyond: (all - sum) / others });
            }
        }
        best
    }

    /// Direction of a source's own noise among the whitened innovations of the settled filter, of unit length.
    fn along(&self, source: usize) -> Option<Vec<f64>> {
        let channels = self.observations.block.channels;
        let place = self.observations.block.sources.iter().position(|&other| other == source)?;
        let seen = self.observations.block.noise_transfer(place, 0.0);
        let (_, whitening) = self.filter.settled();
        let whitened = |row: &[f64]| row.iter().zip(&seen).map(|(w, seen)| w * seen.re).sum::<f64>();
        let along: Vec<f64> = whitening.chunks_exact(channels).map(whitened).collect();
        let length = along.iter().map(|value| value * value).sum::<f64>().sqrt();
        (length > 0.0).then(|| along.iter().map(|value| value / length).collect())
    }

    /// ln of the probability that a change of the white level gains so much somewhere, and of the number of places that
    /// this counts.
    fn step_tail(&self, gain: f64) -> (f64, f64) {
        let correlations =
            (MARGIN_ROWS..self.observations.block.rows()).map(|n| (1.0 - 1.0 / n as f64).sqrt());
        let ln_p = ln_rough_scan_tail((2.0 * gain.max(0.0)).sqrt(), correlations);
        (ln_p, (ln_p - ln_chi_squared_tail(2.0 * gain, 1)).max(0.0))
    }

    /// The ratio of the white levels with the largest exact likelihood, the row being given.
    fn fit_step(&self, source: usize, start: &Start) -> Option<ChangeFit> {
        let promised = start.noises[source].step?;
        let noises_at = |log: f64| {
            let mut noises = start.noises.clone();
            noises[source].step = Some(VarianceStep { ratio: log.exp(), ..promised });
            noises
        };
        // The innovations hold more than white noise, whose ratio is further from 1 than theirs.
        let middle = promised.ratio.ln();
        let change = NoiseChange::VarianceStep;
        let Observations { block, projected, .. } = self.observations;
        let gain_at = |log: f64| {
            let noises = noises_at(log);
            let told = self.told(&noises);
            change.counted(exact(block, &noises, projected) - self.log_likelihood + told, told)
        };
        let (log, cost) = crate::minimise::golden(middle - 0.7, middle + 1.5, 0.003, |log| -gain_at(log));
        let gain = -cost;
        let (ln_p, ln_places) = self.step_tail(gain);
        let (noises, knobs) = (noises_at(log), start.knobs.clone());
        Some(ChangeFit { source, change, noises, knobs, gain, freedom: start.freedom, ln_places, ln_p })
    }
}

/// Whether the oscillation that a fit is of lasts from one row to the next: one that has decayed by then is white noise by another name, and
/// takes with it whatever else of the noise is free beside it.
fn is_seen_from_row_to_row(fit: &ChangeFit, step_s: f64) -> bool {
    let lasts = |knob: &Knob| match knob {
        Knob::CosineAlpha(_) => fit.noises[fit.source].get(*knob) * step_s < 1.0,
        _ => true,
    };
    fit.knobs.iter().all(lasts)
}
