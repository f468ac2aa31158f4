//! A mean that jumps on and off: a two-state Markov process s in the output, y = A s + coloured noise.
//!
//! Its autocorrelation is that of a Markov part, R(τ) = A² π(1 − π) exp(−|τ|/τ_c) with π the part of the time that it is
//! on and 1/τ_c the sum of its rates: a further Markov part on the band sums says whether to look, and where to
//! start. What tells the two apart is that the jumps have two levels. The noise is coloured, so that the likelihood of a
//! history of switchings depends on all of it: the filter runs once for each of the likeliest histories (a beam), and
//! those whose states have come together are summed, which without coloured noise is the forward algorithm (Rabiner,
//! Proc. IEEE 77, 1989). The sum over the histories kept is a bound of the marginal likelihood from below; by it the
//! jumps are judged. Amplitude and rates are fitted in turn with the likeliest history.
use rayon::prelude::*;
use schuler_recording::case::Markov;

use crate::whitening::filter::Filter;

/// Parts of the time on that are tried.
const PARTS_ON: [f64; 2] = [0.1, 0.3];
/// Histories kept.
const BEAM: usize = 16;
/// Nats behind the likeliest from which on a history is not followed: from there a new one costs less.
const FORGOTTEN: f64 = 25.0;
/// Difference of two histories' whitened innovations, in standard deviations, below which they are one.
const SAME: f64 = 0.1;
/// Starts that are followed, and how often amplitude and rates are fitted.
const FOLLOWED: usize = 2;
const ITERATIONS: usize = 3;
/// Rates of switching on and off.
pub const RATES: usize = 2;
/// Rows that it stays on, on average, and off: what changes from row to row is a lattice or noise, and a mean that is left for a
/// reading or two has glitches.
const SHORTEST_STAY_ROWS: usize = 4;
/// Stays that long, on as well as off; with fewer it is a step, or glitches.
const FEWEST_STAYS: usize = 2;

/// Amplitude and probabilities, a row, of switching on and off, and the part of the rows that it is on.
#[derive(Clone, Copy, Debug)]
struct Telegraph {
    amplitude: f64,
    on: f64,
    off: f64,
    mean: f64,
}

impl Telegraph {
    fn part_on(&self) -> f64 {
        self.on / (self.on + self.off)
    }
}

/// What the decoder made of a telegraph.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// Whether it is on, by row.
    pub on: Vec<bool>,
    /// ln of the marginal likelihood over that without jumps.
    pub gain: f64,
}

/// Whether a history is one of jumps, and not a step or glitches.
fn comes_and_goes(on: &[bool]) -> bool {
    [false, true].into_iter().all(|state| {
        let (number, rows) = stays(on, state).fold((0, 0), |(n, rows), stay| (n + 1, rows + stay));
        let long = stays(on, state).filter(|&stay| stay >= SHORTEST_STAY_ROWS).count();
        long >= FEWEST_STAYS && rows >= SHORTEST_STAY_ROWS * number
    })
}

/// Rows of each stay, on or off.
pub fn stays(on: &[bool], state: bool) -> impl Iterator<Item = usize> + '_ {
    on.chunk_by(|a, b| a == b).filter(move |stay| stay.first() == Some(&state)).map(<[bool]>::len)
}

/// Telegraphs with the autocorrelation of a Markov part, up or down.
fn starts(part: Markov, step_s: f64) -> Vec<Telegraph> {
    let rate = step_s / part.tau_s.max(2.0 * step_s);
    let of = |on: f64| {
        let amplitude = part.sigma / (on * (1.0 - on)).sqrt();
        [1.0, -1.0].map(|sign| Telegraph {
            amplitude: sign * amplitude,
            on: rate * on,
            off: rate * (1.0 - on),
            mean: on,
        })
    };
    PARTS_ON.into_iter().flat_map(of).collect()
}

/// Rates of switching on and off of a history; half a switching more than seen, as none seen does not mean never.
fn rates(on: &[bool]) -> [f64; 2] {
    let count = |from: bool| on.iter().filter(|&&on| on == from).count() as f64;
    let switched =
        |from: bool| on.windows(2).filter(|pair| pair[0] == from && pair[1] != from).count() as f64;
    [false, true].map(|from| ((switched(from) + 0.5) / (count(from) + 1.0)).clamp(1e-6, 0.5))
}

/// Follows histories of switchings.
pub struct Decoder<'d> {
    /// The filter of the block.
    pub filter: &'d Filter,
    /// Whitened residual without jumps.
    pub remainder: &'d [f64],
    /// What a unit shift adds to the channels.
    pub shape: Vec<f64>,
    /// Whether the regressors have taken the mean away.
    pub centred: bool,
    /// Weight of each state in the whitened innovations.
    pub weights: Vec<f64>,
    /// Number of channels.
    pub channels: usize,
}

/// A history of switchings up to a row.
#[derive(Clone, Copy, Debug)]
struct History {
    on: bool,
    /// ln of its weight.
    weight: f64,
    /// Its place among those of the row before.
    parent: u8,
    /// ln of the weight of the likeliest of those that it stands for.
    likeliest: f64,
}

/// A filter's states for a unit shift that went on and off as the histories of a row did, one after the other.
struct States {
    size: usize,
    values: Vec<f64>,
}

impl States {
    fn of(&self, place: usize) -> &[f64] {
        &self.values[place * self.size..][..self.size]
    }

    fn of_mut(&mut self, place: usize) -> &mut [f64] {
        &mut self.values[place * self.size..][..self.size]
    }
}

impl Decoder<'_> {
    /// The likeliest history, unless it is none of jumps, from the autocorrelation of a Markov `part` on; `amplitude_of` is that of
    /// a history at its best.
    pub fn likeliest(
        &self,
        part: Markov,
        step_s: f64,
        amplitude_of: &(dyn Fn(&Decoded) -> Option<f64> + Sync),
    ) -> Option<Decoded> {
        let starts = starts(part, step_s).into_par_iter();
        let mut found: Vec<Decoded> = starts.filter_map(|start| self.decode(start)).collect();
        found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        found.truncate(FOLLOWED);
        found.par_iter_mut().for_each(|decoded| {
            for _ in 0..ITERATIONS {
                let Some(amplitude) = amplitude_of(decoded) else { break };
                let [on, off] = rates(&decoded.on);
                // That of the rows, which few switchings tell from that of the rates.
                let is_on = decoded.on.iter().filter(|&&on| on).count();
                let mean = is_on as f64 / decoded.on.len() as f64;
                let Some(next) = self.decode(Telegraph { amplitude, on, off, mean }) else { break };
                if next.gain <= decoded.gain {
                    break;
                }
                *decoded = next;
            }
        });
        let best = found.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        comes_and_goes(&best.on).then_some(best)
    }

    /// The likeliest history under a telegraph and the sum over all that were kept.
    fn decode(&self, telegraph: Telegraph) -> Option<Decoded> {
        let Telegraph { amplitude, on, off, mean } = telegraph;
        if !(amplitude.is_finite() && amplitude != 0.0 && on > 0.0 && off > 0.0) {
            return None;
        }
        let (rows, m) = (self.filter.rows(), self.channels);
        let weights: Vec<f64> = self.weights.iter().map(|weight| weight * amplitude.abs()).collect();
        let base = if self.centred { mean } else { 0.0 };
        // ln P(off now), ln P(on now), where it was off before and on.
        let turned = [[(-on).ln_1p(), on.ln()], [off.ln(), (-off).ln_1p()]];
        let start = |on: bool, part: f64| History { on, weight: part.ln(), parent: 0, likeliest: part.ln() };
        let mut beam = vec![start(false, 1.0 - telegraph.part_on()), start(true, telegraph.part_on())];
        // One more than are kept: the one that is compared with them.
        let size = self.weights.len();
        let empty = || States { size, values: vec![0.0; (BEAM + 1) * size] };
        let (mut states, mut next_states) = (empty(), empty());
        let mut predicted = vec![0.0; BEAM * m];
        let (mut innovation, mut measured) = (vec![0.0; m], vec![0.0; size]);
        let mut next: Vec<History> = Vec::with_capacity(2 * BEAM);
        let mut back: Vec<[(u8, bool); BEAM]> = Vec::with_capacity(rows);
        for row in 0..rows {
            let gains = self.filter.gain_and_whitening(row);
            let shape = |c: usize| self.shape[c * rows + row];
            let level = |on: bool| f64::from(u8::from(on)) - base;
            next.clear();
            for (parent, history) in beam.iter().enumerate() {
                let predicted = &mut predicted[parent * m..][..m];
                self.filter.predict(states.of(parent), predicted);
                for now in [false, true] {
                    if row == 0 && now != history.on {
                        continue;
                    }
                    let prior =
                        if row == 0 { 0.0 } else { turned[usize::from(history.on)][usize::from(now)] };
                    let mut gain = 0.0;
                    if let Some((_, whitening)) = gains {
                        for (c, weights) in whitening.chunks_exact(m).enumerate() {
                            let innovation = |d: usize| level(now) * shape(d) - predicted[d];
                            let whitened: f64 = (0..=c).map(|d| weights[d] * innovation(d)).sum();
                            let shift = amplitude * whitened;
                            gain += shift * (self.remainder[c * rows + row] - 0.5 * shift);
                        }
                    }
                    next.push(History {
                        on: now,
                        weight: history.weight + prior + gain,
                        parent: parent as u8,
                        likeliest: history.likeliest + prior + gain,
                    });
                }
            }
            next.sort_by(|a, b| b.weight.total_cmp(&a.weight));
            let least = next.first().map_or(f64::NEG_INFINITY, |best| best.weight - FORGOTTEN);
            beam.clear();
            for history in next.iter().take_while(|history| history.weight >= least) {
                let parent = usize::from(history.parent);
                measured.copy_from_slice(states.of(parent));
                if let Some((gain, _)) = gains {
                    for (d, innovation) in innovation.iter_mut().enumerate() {
                        *innovation = level(history.on) * shape(d) - predicted[parent * m + d];
                    }
                    for (state, gain) in measured.iter_mut().zip(gain.chunks_exact(m)) {
                        *state += gain.iter().zip(&innovation).map(|(gain, value)| gain * value).sum::<f64>();
                    }
                }
                self.filter.propagate(&measured, next_states.of_mut(beam.len()));
                let own = next_states.of(beam.len());
                let alike = |(place, kept): &(usize, &mut History)| {
                    kept.on == history.on && {
                        // Most are far apart by the first of their states.
                        let mut apart = 0.0;
                        let mut differences = next_states.of(*place).iter().zip(own).zip(&weights);
                        differences.all(|((a, b), w)| {
                            apart += ((a - b) * w).abs();
                            apart < SAME
                        })
                    }
                };
                if let Some((_, kept)) = beam.iter_mut().enumerate().find(alike) {
                    kept.weight += (history.weight - kept.weight).exp().ln_1p();
                    if history.likeliest > kept.likeliest {
                        (kept.likeliest, kept.parent) = (history.likeliest, history.parent);
                    }
                } else if beam.len() < BEAM {
                    beam.push(*history);
                }
            }
            std::mem::swap(&mut states, &mut next_states);
            let mut kept = [(0, false); BEAM];
            kept.iter_mut().zip(&beam).for_each(|(kept, history)| *kept = (history.parent, history.on));
            back.push(kept);
        }
        let heaviest = beam.iter().map(|history| history.weight).fold(f64::NEG_INFINITY, f64::max);
        let gain = heaviest + beam.iter().map(|history| (history.weight - heaviest).exp()).sum::<f64>().ln();
        let last = beam.iter().enumerate().max_by(|a, b| a.1.likeliest.total_cmp(&b.1.likeliest))?.0;
        let mut on = vec![false; rows];
        let mut place = last;
        for (on, row) in on.iter_mut().zip(&back).rev() {
            let &(parent, was) = row.get(place)?;
            (*on, place) = (was, usize::from(parent));
        }
        gain.is_finite().then_some(Decoded { on, gain })
    }
}
