//! A mean that jumps on and off: a two-state Markov process s in the output, y = A s + coloured noise.
//!
//! Its autocorrelation is that of a Markov part, R(τ) = A² π(1 − π) exp(−|τ|/τ_c) with π the part of the time that it is
//! on and 1/τ_c the sum of its rates: a further Markov part on Whittle's likelihood says whether to look, and where to
//! start. What tells the two apart is that the jumps have two levels. The noise is coloured, so that the likelihood of a
//! history of switchings depends on all of it: the filter runs once for each of the likeliest histories (a beam), and
//! those whose states have come together are summed, which without coloured noise is the forward algorithm (Rabiner,
//! Proc. IEEE 77, 1989). The sum over the histories kept is a bound of the marginal likelihood from below; by it the
//! jumps are judged. Amplitude and rates are fitted in turn with the likeliest history.
use schuler_recording::case::Markov;

use crate::catalogue::{Candidate, Column, Port, ReadingFault, Search, Target};
use crate::description::Term;
use crate::search::{Proposal, evidence};
use crate::state::Bench;
use crate::statistics::ln_chi_squared_tail;
use crate::whiten::Filter;

/// Gain of a further Markov part from which on jumps are sought.
const WORTH_TRYING: f64 = 6.0;
/// Parts of the time on that are tried.
const PARTS_ON: [f64; 2] = [0.1, 0.3];
/// Histories kept.
const BEAM: usize = 16;
/// Difference of two histories' whitened innovations, in standard deviations, below which they are one.
const SAME: f64 = 0.1;
/// Starts that are followed, and how often amplitude and rates are fitted.
const FOLLOWED: usize = 2;
const ITERATIONS: usize = 3;
/// Degrees of freedom: the amplitude and two rates; and ln of the places where they were sought.
const FREEDOM: usize = 3;
const LN_PLACES: f64 = 2.0;
/// Rows that it stays on, on average: what changes from row to row is a lattice or noise.
const SHORTEST_STAY_ROWS: usize = 4;
/// Switchings, at least; with fewer it is a step.
const FEWEST_SWITCHINGS: usize = 3;

/// Amplitude and probabilities, a row, of switching on and off.
#[derive(Clone, Copy, Debug)]
struct Telegraph {
    amplitude: f64,
    on: f64,
    off: f64,
}

impl Telegraph {
    fn part_on(&self) -> f64 {
        self.on / (self.on + self.off)
    }
}

/// What the decoder made of a telegraph.
struct Decoded {
    /// Whether it is on, by row.
    on: Vec<bool>,
    /// ln of the marginal likelihood over that without jumps.
    gain: f64,
}

/// A mean that jumps on and off, for each candidate of that kind.
pub fn jumps(bench: &Bench<'_>, wanted: &(dyn Fn(usize) -> bool + Sync)) -> Vec<Proposal> {
    let mut proposals = Vec::new();
    for (index, candidate) in bench.case.candidates.iter().enumerate() {
        if !matches!(candidate.search, Search::Readings(ReadingFault::IntermittentJump)) || !wanted(index) {
            continue;
        }
        let known = bench.terms.iter().any(|term| term.candidate == index);
        if !known && let Some(proposal) = jump(bench, index, candidate) {
            proposals.push(proposal);
        }
    }
    proposals
}

fn jump(bench: &Bench<'_>, index: usize, candidate: &Candidate) -> Option<Proposal> {
    let Target::Sensor(sensor) = candidate.target else { return None };
    let model = bench.case.model;
    let place = model.block_of(sensor)?;
    let source = model.source_of(sensor, Port::Output)?;
    let (block, filter) = (model.blocks.get(place)?, bench.filters.of_block.get(place)?.as_ref()?);
    let whitened = bench.blocks.get(place)?.as_ref()?;
    let spectrum = bench.spectrum(place)?;
    let (part, gain) = bench.view(place, &spectrum)?.further_markov(source, &model.sources[source])?;
    if gain < WORTH_TRYING {
        return None;
    }
    let rows = block.rows();
    let decoder = Decoder {
        filter,
        remainder: &whitened.remainder,
        shape: block.project(&Column { parts: vec![(sensor, vec![1.0; rows])] }, Port::Output)?,
        centred: !whitened.projected.places.is_empty(),
        weights: filter.weight_of_states(),
        channels: block.channels,
    };
    let term_of = |on: &[bool]| Term {
        candidate: index,
        nonlinear: Vec::new(),
        columns: vec![Column {
            parts: vec![(sensor, on.iter().map(|&on| f64::from(u8::from(on))).collect())],
        }],
        port: Port::Output,
        unit_amplitude: false,
        of_the_motion: false,
        delay_s: None,
    };
    let mut found: Vec<Decoded> =
        starts(part, block.step_s()).into_iter().filter_map(|start| decoder.decode(start)).collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    found.truncate(FOLLOWED);
    for decoded in &mut found {
        for _ in 0..ITERATIONS {
            let (_, solution) = bench.with_term(&term_of(&decoded.on));
            let Some(&amplitude) = solution.amplitudes.as_slice().last() else { break };
            let [on, off] = rates(&decoded.on);
            let Some(next) = decoder.decode(Telegraph { amplitude, on, off }) else { break };
            if next.gain <= decoded.gain {
                break;
            }
            *decoded = next;
        }
    }
    let best = found.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain))?;
    let switchings = best.on.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let rows_on = best.on.iter().filter(|&&on| on).count();
    if switchings < FEWEST_SWITCHINGS || rows_on < SHORTEST_STAY_ROWS * switchings.div_ceil(2) {
        return None;
    }
    let term = term_of(&best.on);
    let (gain, freedom) = bench.gain_of(&term);
    // A history that is given gains more than the marginal likelihood; its price is the difference.
    let marginal = (-ln_chi_squared_tail(2.0 * best.gain.max(0.0), FREEDOM) - LN_PLACES).max(0.0);
    let ln_places = (-ln_chi_squared_tail(2.0 * gain, freedom) - marginal).max(0.0);
    Some(Proposal { term, gain, freedom, ln_places, evidence: evidence(gain, freedom, ln_places) })
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

struct Decoder<'d> {
    filter: &'d Filter,
    /// Whitened residual without jumps.
    remainder: &'d [f64],
    /// What a unit shift adds to the channels.
    shape: Vec<f64>,
    /// Whether the regressors have taken the mean away.
    centred: bool,
    /// Weight of each state in the whitened innovations.
    weights: Vec<f64>,
    channels: usize,
}

/// A history of switchings up to a row.
#[derive(Clone, Debug)]
struct History {
    /// State of the filter for a unit shift that went on and off so.
    state: Vec<f64>,
    on: bool,
    /// ln of its weight.
    weight: f64,
    /// Its place among those of the row before.
    parent: usize,
    /// ln of the weight of the likeliest of those that it stands for.
    likeliest: f64,
}

impl Decoder<'_> {
    /// The likeliest history under a telegraph and the sum over all that were kept.
    fn decode(&self, telegraph: Telegraph) -> Option<Decoded> {
        let Telegraph { amplitude, on, off } = telegraph;
        if !(amplitude.is_finite() && amplitude != 0.0 && on > 0.0 && off > 0.0) {
            return None;
        }
        let rows = self.filter.rows();
        let base = if self.centred { telegraph.part_on() } else { 0.0 };
        // ln P(on now | before), ln P(off now | before).
        let turned = |before: bool, now: bool| -> f64 {
            match (before, now) {
                (false, true) => on.ln(),
                (false, false) => (-on).ln_1p(),
                (true, false) => off.ln(),
                (true, true) => (-off).ln_1p(),
            }
        };
        let empty = vec![0.0; self.weights.len()];
        let start = |on: bool, part: f64| History {
            state: empty.clone(),
            on,
            weight: part.ln(),
            parent: 0,
            likeliest: part.ln(),
        };
        let mut beam = vec![start(false, 1.0 - telegraph.part_on()), start(true, telegraph.part_on())];
        let mut scratch = self.filter.scratch();
        let mut back: Vec<Vec<(u8, bool)>> = Vec::with_capacity(rows);
        // States of histories that ended, to be used again.
        let mut ended: Vec<Vec<f64>> = Vec::new();
        let mut next: Vec<History> = Vec::with_capacity(2 * BEAM);
        for row in 0..rows {
            for (parent, history) in beam.iter().enumerate() {
                for now in [false, true] {
                    let prior = if row == 0 {
                        if now == history.on { 0.0 } else { continue }
                    } else {
                        turned(history.on, now)
                    };
                    let level = f64::from(u8::from(now)) - base;
                    let mut state = ended.pop().unwrap_or_default();
                    state.clone_from(&history.state);
                    let response = self
                        .filter
                        .step(row, &mut state, &mut scratch, |c| level * self.shape[c * rows + row]);
                    let gain: f64 = (0..self.channels)
                        .map(|c| {
                            let shift = amplitude * response[c];
                            shift * (self.remainder[c * rows + row] - 0.5 * shift)
                        })
                        .sum();
                    next.push(History {
                        state,
                        on: now,
                        weight: history.weight + prior + gain,
                        parent,
                        likeliest: history.likeliest + prior + gain,
                    });
                }
            }
            next.sort_by(|a, b| b.weight.total_cmp(&a.weight));
            ended.extend(beam.drain(..).map(|history| history.state));
            for history in next.drain(..) {
                let alike = |kept: &&mut History| {
                    let differences = kept.state.iter().zip(&history.state).zip(&self.weights);
                    kept.on == history.on
                        && differences.map(|((a, b), w)| ((a - b) * w).abs()).sum::<f64>() * amplitude.abs()
                            < SAME
                };
                if let Some(kept) = beam.iter_mut().find(alike) {
                    kept.weight += (history.weight - kept.weight).exp().ln_1p();
                    if history.likeliest > kept.likeliest {
                        (kept.likeliest, kept.parent) = (history.likeliest, history.parent);
                    }
                    ended.push(history.state);
                } else if beam.len() < BEAM {
                    beam.push(history);
                } else {
                    ended.push(history.state);
                }
            }
            back.push(beam.iter().map(|history| (history.parent as u8, history.on)).collect());
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
