//! Gains laid out for runs over a column, where channels or states are many.
//!
//! With D = ΦK, states x before a row and its values y lead to those before the next one by e = y − H x and x ← Φ x + D e, in which Φ x does
//! not wait for e, and to what is whitened by W e. Rows wait for each other, columns do not: a few run side by side. States stand in groups, whose numbers are computed side by side, the two of an oscillation in the same place of neighbours; channels
//! stand in blocks, whose sums stay in registers. Usual sizes are known to the compiler, which does not find the groups by itself: they are
//! vectors of `wide`.
use std::ops::Range;

use wide::f64x2;

use crate::whitening::filter::{FLUSH_ROWS, Filter, Rounded, flush};

/// States of a group.
const LANES: usize = 2;
type Group = f64x2;
/// Most channels of a block.
const MOST: usize = 4;
/// Most groups that the compiler knows of.
const MOST_GROUPS: usize = 12;
/// Rows that run at once.
pub const RUN_ROWS: usize = 256;
/// Columns that run side by side: each row of one waits for the row before, and meanwhile the others are computed.
const SIDE_BY_SIDE: usize = 2;

/// A filter's runs by gains that are laid out.
pub trait LaidOut: Send + Sync {
    /// Number of channels.
    fn channels(&self) -> usize;

    /// Whitened innovations of some rows of each column, channel after channel, under one gain, or each row under the next. Takes the
    /// predicted state of each from the first of them to behind the last.
    fn whiten(
        &self,
        gains: Gains,
        columns: &[&[f64]],
        over: Range<usize>,
        states: &mut [Vec<f64>],
        whitened: &mut [Vec<f64>],
    );
}

/// Runs some rows of columns, at most [`RUN_ROWS`], and puts what is whitened into its place in those of the columns; each of `run` has room
/// for what is of one.
pub fn whiten_rows<T: Rounded>(
    runs: &dyn LaidOut,
    (gains, over): (Gains, Range<usize>),
    columns: &[&[f64]],
    states: &mut [Vec<f64>],
    run: &mut [Vec<f64>],
    whitened: &mut [Vec<T>],
) {
    runs.whiten(gains, columns, over.clone(), states, run);
    for ((column, run), whitened) in columns.iter().zip(run).zip(whitened) {
        let rows = column.len() / runs.channels();
        for (c, run) in run.chunks_exact(over.len()).take(runs.channels()).enumerate() {
            let slots = &mut whitened[c * rows..][over.clone()];
            slots.iter_mut().zip(run).for_each(|(slot, value)| *slot = T::rounded(*value));
        }
    }
}

/// Which gains rows have.
#[derive(Clone, Copy, Debug)]
pub enum Gains {
    /// All the same one.
    One(usize),
    /// Each the next one, from the first.
    From(usize),
}

/// Runs of a filter by gains K and matrices W, by rows. One state at least.
pub fn lay_out(filter: &Filter, gains: &[(&[f64], &[f64])]) -> Box<dyn LaidOut> {
    // As few blocks as can be, and as little of the last one empty.
    let channels = filter.channels();
    let make = match channels.div_ceil(channels.div_ceil(MOST).max(1)) {
        0 | 1 => boxed::<1>,
        2 => boxed::<2>,
        3 => boxed::<3>,
        _ => boxed::<MOST>,
    };
    make(filter, gains)
}

/// Whether the compiler knows of a filter's size, so that gains take little more room than their numbers.
pub fn is_of_usual_size(filter: &Filter) -> bool {
    Places::new(filter).are_usual(filter.channels())
}

fn boxed<const B: usize>(filter: &Filter, gains: &[(&[f64], &[f64])]) -> Box<dyn LaidOut> {
    let places = Places::new(filter);
    let make = match (places.are_usual(filter.channels()), places.groups) {
        (true, 1) => Runs::<Fixed<1>, Fixed<1>, B>::boxed,
        (true, 2) => Runs::<Fixed<2>, Fixed<1>, B>::boxed,
        (true, 3) => Runs::<Fixed<3>, Fixed<1>, B>::boxed,
        (true, 4) => Runs::<Fixed<4>, Fixed<1>, B>::boxed,
        (true, 5) => Runs::<Fixed<5>, Fixed<1>, B>::boxed,
        (true, 6) => Runs::<Fixed<6>, Fixed<1>, B>::boxed,
        (true, 7) => Runs::<Fixed<7>, Fixed<1>, B>::boxed,
        (true, 8) => Runs::<Fixed<8>, Fixed<1>, B>::boxed,
        (true, 9) => Runs::<Fixed<9>, Fixed<1>, B>::boxed,
        (true, 10) => Runs::<Fixed<10>, Fixed<1>, B>::boxed,
        (true, 11) => Runs::<Fixed<11>, Fixed<1>, B>::boxed,
        (true, 12) => Runs::<Fixed<12>, Fixed<1>, B>::boxed,
        _ => Runs::<Any, Any, B>::boxed,
    };
    make(filter, &places, gains)
}

/// A number of things, which the compiler may know.
trait Size: 'static {
    /// Whether it does.
    const IS_FIXED: bool;
    /// So many of them.
    type Of<T: Clone + Send + Sync>: AsRef<[T]> + AsMut<[T]> + Clone + Send + Sync;
    /// The same from their places.
    fn of<T: Clone + Send + Sync>(number: usize, at: impl FnMut(usize) -> T) -> Self::Of<T>;
}

struct Fixed<const N: usize>;

impl<const N: usize> Size for Fixed<N> {
    const IS_FIXED: bool = true;
    type Of<T: Clone + Send + Sync> = [T; N];

    fn of<T: Clone + Send + Sync>(_: usize, at: impl FnMut(usize) -> T) -> [T; N] {
        std::array::from_fn(at)
    }
}

struct Any;

impl Size for Any {
    const IS_FIXED: bool = false;
    type Of<T: Clone + Send + Sync> = Vec<T>;

    fn of<T: Clone + Send + Sync>(number: usize, at: impl FnMut(usize) -> T) -> Vec<T> {
        (0..number).map(at).collect()
    }
}

/// Where states stand.
struct Places {
    groups: usize,
    /// The place of each state.
    of: Vec<usize>,
    /// Whether what moves another state is its neighbour.
    only_neighbours: bool,
}

impl Places {
    fn new(filter: &Filter) -> Self {
        let (states, (transition, _)) = (filter.states(), filter.transition_and_output());
        let moves = |i: usize, j: usize| i != j && (transition[(i, j)] != 0.0 || transition[(j, i)] != 0.0);
        let partners: Vec<Vec<usize>> =
            (0..states).map(|i| (0..states).filter(|&j| moves(i, j)).collect()).collect();
        let partner = |i: usize| match partners[i][..] {
            [j] if partners[j][..] == [i] => Some(j),
            _ => None,
        };
        let mut of = vec![0; states];
        let pairs: Vec<(usize, usize)> =
            (0..states).filter_map(|i| Some((i, partner(i)?))).filter(|(i, j)| i < j).collect();
        for (number, &(i, j)) in pairs.iter().enumerate() {
            of[i] = number / LANES * 2 * LANES + number % LANES;
            of[j] = of[i] + LANES;
        }
        let taken: Vec<usize> = pairs.iter().flat_map(|&(i, j)| [of[i], of[j]]).collect();
        let free = (0..).filter(|place| !taken.contains(place));
        for (i, place) in (0..states).filter(|&i| partner(i).is_none()).zip(free) {
            of[i] = place;
        }
        let groups = of.iter().map(|place| place / LANES + 1).max().unwrap_or(1);
        Self {
            groups,
            of,
            only_neighbours: (0..states).all(|i| partners[i].is_empty() || partner(i).is_some()),
        }
    }

    fn are_usual(&self, channels: usize) -> bool {
        channels <= MOST && self.only_neighbours && self.groups <= MOST_GROUPS
    }

    /// States in their places, and back.
    fn to(&self, states: &[f64], placed: &mut [Group]) {
        let places = self.of.iter().zip(states);
        places.for_each(|(&place, &state)| placed[place / LANES].as_mut_array()[place % LANES] = state);
    }

    fn back(&self, placed: &[Group], states: &mut [f64]) {
        let places = self.of.iter().zip(states);
        places.for_each(|(&place, state)| *state = placed[place / LANES].as_array()[place % LANES]);
    }
}

/// What ties a block of channels and the states together, group after group.
type Ties<G, const B: usize> = <G as Size>::Of<[Group; B]>;

/// A block of W.
type Square<const B: usize> = [[f64; B]; B];

/// A gain, by blocks of channels: D, and W.
struct Gain<G: Size, C: Size, const B: usize> {
    driven: C::Of<Ties<G, B>>,
    whitening: C::Of<C::Of<Square<B>>>,
}

impl<G: Size, C: Size, const B: usize> Gain<G, C, B> {
    /// W e.
    #[inline(always)]
    fn whitened(&self, innovations: &C::Of<[f64; B]>, whitened: &mut C::Of<[f64; B]>) {
        for (values, weights) in whitened.as_mut().iter_mut().zip(self.whitening.as_ref()) {
            *values = [0.0; B];
            for (weights, innovation) in weights.as_ref().iter().zip(innovations.as_ref()) {
                for c in 0..B {
                    for d in 0..B {
                        values[c] += weights[c][d] * innovation[d];
                    }
                }
            }
        }
    }
}

/// A step: e = v + S x and x ← Φ x + D e, from v and x.
#[inline(always)]
fn step<G: Size, C: Size, const B: usize>(
    transition: &Transition<G>,
    [seen, driven]: [&C::Of<Ties<G, B>>; 2],
    state: &mut G::Of<Group>,
    values: &mut C::Of<[f64; B]>,
    moved: &mut [f64],
) {
    for (value, seen) in values.as_mut().iter_mut().zip(seen.as_ref()) {
        // Of halves that do not wait for each other, v first, which has been there for long.
        let mut sums = [std::array::from_fn(|c| Group::new([value[c], 0.0])), [Group::ZERO; B]];
        for (at, (seen, state)) in seen.as_ref().iter().zip(state.as_ref()).enumerate() {
            for c in 0..B {
                sums[at % 2][c] += seen[c] * *state;
            }
        }
        for c in 0..B {
            let [a, b] = (sums[0][c] + sums[1][c]).to_array();
            value[c] = a + b;
        }
    }
    transition.apply(state, moved);
    for (value, driven) in values.as_ref().iter().zip(driven.as_ref()) {
        for (state, driven) in state.as_mut().iter_mut().zip(driven.as_ref()) {
            for c in 0..B {
                *state += driven[c] * Group::splat(value[c]);
            }
        }
    }
}

/// Φ: its diagonal, what neighbouring groups give each other, and what else stands beside: to, from, weight.
struct Transition<G: Size> {
    diagonal: G::Of<Group>,
    across: G::Of<Group>,
    is_crossed: bool,
    beside: Vec<(usize, usize, f64)>,
}

impl<G: Size> Transition<G> {
    fn new(places: &Places, at: impl Fn(usize, usize) -> f64) -> Self {
        let states = places.of.len();
        let [mut diagonal, mut across] = [0, 1].map(|_| G::of(places.groups, |_| Group::ZERO));
        let mut beside = Vec::new();
        for (i, j) in (0..states).flat_map(|i| (0..states).map(move |j| (i, j))) {
            let (to, from, weight) = (places.of[i], places.of[j], at(i, j));
            let are_neighbours = (to / LANES) ^ 1 == from / LANES && to % LANES == from % LANES;
            if to == from {
                diagonal.as_mut()[to / LANES].as_mut_array()[to % LANES] = weight;
            } else if are_neighbours {
                across.as_mut()[to / LANES].as_mut_array()[to % LANES] = weight;
            } else if weight != 0.0 {
                beside.push((to, from, weight));
            }
        }
        let is_crossed = !beside.is_empty() || across.as_ref().iter().any(|group| *group != Group::ZERO);
        Self { diagonal, across, is_crossed, beside }
    }

    #[inline(always)]
    fn apply(&self, state: &mut G::Of<Group>, moved: &mut [f64]) {
        if !G::IS_FIXED {
            let state = state.as_ref();
            for (moved, &(_, from, weight)) in moved.iter_mut().zip(&self.beside) {
                *moved = weight * state[from / LANES].as_array()[from % LANES];
            }
        }
        if !self.is_crossed {
            for (state, own) in state.as_mut().iter_mut().zip(self.diagonal.as_ref()) {
                *state *= *own;
            }
            return;
        }
        let own = self.diagonal.as_ref().chunks(2).zip(self.across.as_ref().chunks(2));
        for (state, (diagonal, across)) in state.as_mut().chunks_mut(2).zip(own) {
            match (state, diagonal, across) {
                ([first, second], [own_first, own_second], [to_first, to_second]) => {
                    let (a, b) = (*first, *second);
                    *first = *own_first * a + *to_first * b;
                    *second = *own_second * b + *to_second * a;
                }
                ([last], [own], _) => {
                    *last *= *own;
                }
                _ => {}
            }
        }
        if !G::IS_FIXED {
            let state = state.as_mut();
            for (moved, &(to, ..)) in moved.iter().zip(&self.beside) {
                state[to / LANES].as_mut_array()[to % LANES] += moved;
            }
        }
    }
}

/// The runs of a filter.
struct Runs<G: Size, C: Size, const B: usize> {
    places: Places,
    channels: usize,
    transition: Transition<G>,
    /// −H.
    minus_seen: C::Of<Ties<G, B>>,
    gains: Vec<Gain<G, C, B>>,
}

impl<G: Size, C: Size, const B: usize> Runs<G, C, B> {
    fn boxed(filter: &Filter, places: &Places, gains: &[(&[f64], &[f64])]) -> Box<dyn LaidOut> {
        let (n, m) = (filter.states(), filter.channels());
        let (transition, seen) = filter.transition_and_output();
        let from: Vec<Vec<(usize, f64)>> = (0..n)
            .map(|i| (0..n).map(|j| (j, transition[(i, j)])).filter(|(_, weight)| *weight != 0.0).collect())
            .collect();
        let blocks = m.div_ceil(B).max(1);
        let mut state_at = vec![None; places.groups * LANES];
        places.of.iter().enumerate().for_each(|(state, &place)| state_at[place] = Some(state));
        let ties = |at: &dyn Fn(usize, usize) -> f64| -> C::Of<Ties<G, B>> {
            let value = |c: usize, place: usize| match state_at[place] {
                Some(state) if c < m => at(c, state),
                _ => 0.0,
            };
            let group = |c: usize, group: usize| {
                Group::new(std::array::from_fn(|lane| value(c, group * LANES + lane)))
            };
            C::of(blocks, |block| {
                G::of(places.groups, |of| std::array::from_fn(|c| group(block * B + c, of)))
            })
        };
        let squares = |whitening: &[f64]| -> C::Of<C::Of<Square<B>>> {
            let value = |c: usize, d: usize| if c < m && d < m { whitening[c * m + d] } else { 0.0 };
            let square = |k: usize, j: usize| {
                std::array::from_fn(|c| std::array::from_fn(|d| value(k * B + c, j * B + d)))
            };
            C::of(blocks, |k| C::of(blocks, |j| square(k, j)))
        };
        let of_gain = |&(gain, whitening): &(&[f64], &[f64])| Gain {
            driven: ties(&|c, i| from[i].iter().map(|&(j, weight)| weight * gain[j * m + c]).sum()),
            whitening: squares(whitening),
        };
        Box::new(Self {
            channels: m,
            transition: Transition::new(places, |i, j| transition[(i, j)]),
            minus_seen: ties(&|c, i| -seen[(c, i)]),
            gains: gains.iter().map(of_gain).collect(),
            places: Places { of: places.of.clone(), ..*places },
        })
    }

    fn zero_values(&self) -> C::Of<[f64; B]> {
        C::of(self.channels.div_ceil(B).max(1), |_| [0.0; B])
    }

    fn placed(&self, state: &[f64]) -> G::Of<Group> {
        let mut placed = G::of(self.places.groups, |_| Group::ZERO);
        self.places.to(state, placed.as_mut());
        placed
    }

    /// `N` columns side by side.
    #[inline]
    fn run<const N: usize>(
        &self,
        gains: Gains,
        columns: &[&[f64]; N],
        over: Range<usize>,
        states: &mut [Vec<f64>; N],
        whitened: &mut [Vec<f64>; N],
    ) {
        let (rows, length) = (columns.map(|column| column.len() / self.channels), over.len());
        let (first, further) = match gains {
            Gains::One(gain) => (gain, 0),
            Gains::From(first) => (first, 1),
        };
        let mut placed = states.each_ref().map(|state| self.placed(state));
        let mut innovations: [C::Of<[f64; B]>; N] = std::array::from_fn(|_| self.zero_values());
        let mut white = self.zero_values();
        let mut moved = vec![0.0; self.transition.beside.len()];
        for (at, row) in over.enumerate() {
            let gain = &self.gains[first + at * further];
            let ties = [&self.minus_seen, &gain.driven];
            for n in 0..N {
                values(columns[n], rows[n], row, innovations[n].as_mut());
                step::<G, C, B>(&self.transition, ties, &mut placed[n], &mut innovations[n], &mut moved);
            }
            for n in 0..N {
                gain.whitened(&innovations[n], &mut white);
                for (c, value) in white.as_ref().as_flattened().iter().enumerate().take(self.channels) {
                    if let Some(slot) = whitened[n].get_mut(c * length + at) {
                        *slot = *value;
                    }
                }
            }
            if row % FLUSH_ROWS == 0 {
                for placed in &mut placed {
                    placed.as_mut().iter_mut().for_each(|group| flush(group.as_mut_array()));
                }
            }
        }
        for (placed, state) in placed.iter().zip(states) {
            self.places.back(placed.as_ref(), state);
        }
    }
}

/// Values of all channels in a row of a column that has so many; 0 of channels that there are not.
#[inline(always)]
fn values<const B: usize>(column: &[f64], rows: usize, row: usize, values: &mut [[f64; B]]) {
    for (block, values) in values.iter_mut().enumerate() {
        for (c, value) in values.iter_mut().enumerate() {
            *value = column.get((block * B + c) * rows + row).copied().unwrap_or_default();
        }
    }
}

impl<G: Size, C: Size, const B: usize> LaidOut for Runs<G, C, B> {
    fn channels(&self) -> usize {
        self.channels
    }

    fn whiten(
        &self,
        gains: Gains,
        columns: &[&[f64]],
        over: Range<usize>,
        states: &mut [Vec<f64>],
        whitened: &mut [Vec<f64>],
    ) {
        let together = columns.len() / SIDE_BY_SIDE * SIDE_BY_SIDE;
        let (columns, alone) = columns.split_at(together);
        let (states, of_alone) = states.split_at_mut(together);
        let (whitened, whitened_alone) = whitened.split_at_mut(together);
        let groups = states.as_chunks_mut().0.iter_mut().zip(whitened.as_chunks_mut().0);
        for (columns, (states, whitened)) in columns.as_chunks().0.iter().zip(groups) {
            self.run::<SIDE_BY_SIDE>(gains, columns, over.clone(), states, whitened);
        }
        let each = of_alone.as_chunks_mut().0.iter_mut().zip(whitened_alone.as_chunks_mut().0);
        for (columns, (states, whitened)) in alone.as_chunks().0.iter().zip(each) {
            self.run::<1>(gains, columns, over.clone(), states, whitened);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::{Gains, lay_out};
    use crate::whitening::filter::{Filter, Space};

    /// Any number of channels and states, in pairs or not, and two gains: as the filter of one gain after the other.
    #[test]
    fn runs_are_those_of_the_filter() {
        let mut random = Pcg64::seed_from_u64(11);
        let mut drawn = |count: usize, size: f64| -> Vec<f64> {
            (0..count).map(|_| size * (random.random::<f64>() - 0.5)).collect()
        };
        let rows = 200;
        let index: Vec<Option<u8>> = (0..rows).map(|row| Some(u8::from(row > 90))).collect();
        for (n, m) in [(1, 1), (9, 1), (5, 2), (8, 3), (10, 4), (7, 5), (3, 6), (11, 9), (17, 2), (15, 2)] {
            for pairs in [Some(0), Some(n / 2), Some(n / 3), None] {
                let mut transition = match pairs {
                    Some(_) => vec![0.0; n * n],
                    None => drawn(n * n, 0.3 / n as f64),
                };
                for i in 0..n {
                    transition[i * n + i] = 0.9;
                    let is_of_pair = pairs.is_some_and(|pairs| i >= n - 2 * pairs);
                    if is_of_pair {
                        let first = (n - i).is_multiple_of(2);
                        let other = if first { i + 1 } else { i - 1 };
                        transition[i * n + other] = if first { 0.3 } else { -0.2 };
                    }
                }
                let space =
                    Space { states: n, channels: m, transition, seen: drawn(m * n, 1.0), ..Space::default() };
                let mut gain = || {
                    let mut whitening = drawn(m * m, 1.0);
                    (0..m).for_each(|c| whitening[c * m + c + 1..(c + 1) * m].fill(0.0));
                    (drawn(n * m, 0.2), whitening)
                };
                let gains = [gain(), gain()];
                let filter = Filter::of_gains(&space, &gains, &index, 0.0);
                let views = gains.each_ref().map(|(gain, whitening)| (gain.as_slice(), whitening.as_slice()));
                let runs = lay_out(&filter, &views);
                let column = drawn(m * rows, 1.0);
                let expected = written_out(&space, &gains, &index, &column);
                let mut state = [vec![0.0; n]];
                for (gains, over) in
                    [(Gains::One(0), 0..90), (Gains::From(0), 90..92), (Gains::One(1), 92..rows)]
                {
                    let mut whitened = [vec![0.0; m * over.len()]];
                    runs.whiten(gains, &[&column], over.clone(), &mut state, &mut whitened);
                    for (c, whitened) in whitened[0].chunks(over.len()).enumerate() {
                        assert_same(whitened, &expected[c * rows..][over.clone()]);
                    }
                }
            }
        }
    }

    /// e = y − H x, x ← Φ (x + K e), row by row.
    fn written_out(
        space: &Space,
        gains: &[(Vec<f64>, Vec<f64>)],
        index: &[Option<u8>],
        column: &[f64],
    ) -> Vec<f64> {
        let (n, m, rows) = (space.states, space.channels, index.len());
        let transition = DMatrix::from_row_slice(n, n, &space.transition);
        let seen = DMatrix::from_row_slice(m, n, &space.seen);
        let (mut state, mut whitened) = (DVector::zeros(n), vec![0.0; m * rows]);
        for (row, index) in index.iter().enumerate() {
            if let Some(index) = index {
                let (gain, whitening) = &gains[usize::from(*index)];
                let innovation = DVector::from_fn(m, |c, _| column[c * rows + row]) - &seen * &state;
                let values = DMatrix::from_row_slice(m, m, whitening) * &innovation;
                (0..m).for_each(|c| whitened[c * rows + row] = values[c]);
                state += DMatrix::from_row_slice(n, m, gain) * innovation;
            }
            state = &transition * state;
        }
        whitened
    }

    /// One gain, each row another, gains that come back, and rows that are missing, of many columns, in parts that are laid out and not.
    #[test]
    fn columns_run_through_parts_as_row_by_row() {
        let mut random = Pcg64::seed_from_u64(12);
        let mut drawn = |count: usize, size: f64| -> Vec<f64> {
            (0..count).map(|_| size * (random.random::<f64>() - 0.5)).collect()
        };
        let stretches: [(Option<u8>, u8); 7] =
            [(None, 3), (Some(0), 1), (Some(1), 250), (None, 5), (Some(2), 4), (None, 40), (Some(0), 20)];
        for (n, m, loops) in [(4, 2, false), (5, 5, false), (9, 1, true), (3, 4, false)] {
            // Gains of a sweep differ from row to row.
            let mut index = Vec::new();
            for (first, length) in stretches {
                index.extend((0..length).map(|row| first.map(|first| first + row)));
                index.extend((0..length).map(|_| first));
            }
            let rows = index.len();
            let mut transition = vec![0.0; n * n];
            for i in 0..n {
                transition[i * n + i] = 0.9;
            }
            // Half of an oscillation that does not come back, or what several states give to one.
            transition[n - 1] = 0.2;
            if loops {
                transition[1] = 0.1;
            }
            let space =
                Space { states: n, channels: m, transition, seen: drawn(m * n, 1.0), ..Space::default() };
            let gains: Vec<(Vec<f64>, Vec<f64>)> = (0..256)
                .map(|_| {
                    let mut whitening = drawn(m * m, 1.0);
                    (0..m).for_each(|c| whitening[c * m + c + 1..(c + 1) * m].fill(0.0));
                    (drawn(n * m, 0.2), whitening)
                })
                .collect();
            let filter = Filter::of_gains(&space, &gains, &index, 0.0);
            let columns: Vec<Vec<f64>> = (0..11)
                .map(|_| {
                    let mut column = drawn(m * rows, 1.0);
                    let is_missing = |flat: usize| index[flat % rows].is_none();
                    (0..m * rows).filter(|&flat| is_missing(flat)).for_each(|flat| column[flat] = f64::NAN);
                    column
                })
                .collect();
            for number in [1, 2, 3, 5, 8, 11] {
                let views: Vec<&[f64]> = columns[..number].iter().map(Vec::as_slice).collect();
                let (double, single) = (filter.whiten(&views), filter.whiten_single(&views));
                for ((column, double), single) in views.iter().zip(&double).zip(&single) {
                    let expected = written_out(&space, &gains, &index, column);
                    assert_same(double, &expected);
                    let apart = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs() < 1e-6 * (1.0 + b.abs());
                    assert!(single.iter().zip(&expected).all(apart));
                }
            }
        }
    }

    fn assert_same(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12 * (1.0 + b.abs())));
    }
}
