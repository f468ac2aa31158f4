//! The likelihood of a record by the gain at which its filter settles.
//!
//! The gain of an exact filter changes from row to row where a record begins, beside missing rows and where the white level
//! changes. But there only the covariance P of the predicted state is another than the settled one, P̄: it is as if the state that the
//! settled filter predicts were off by ξ ~ N(0, Δ), Δ = P − P̄. What the rows from some row on say of a state that is off by δ,
//! −2 ln p = c + 2 λᵀδ + δᵀΛδ, follows from the last row to the first, e being the whitened innovations of the settled filter
//! and Ψ = Φ(1 − KH):
//!
//! | over | Λ | λ | c |
//! | --- | --- | --- | --- |
//! | a row | HᵀS⁻¹H + ΨᵀΛΨ | Ψᵀλ − HᵀWᵀe | c + eᵀe + ln det S |
//! | a missing row | ΦᵀΛΦ | Φᵀλ | c |
//! | all ξ | Λ − ΛMΛ | λ − ΛMλ | c − λᵀMλ + ln det(1 + ΔΛ) |
//!
//! with M = (1 + ΔΛ)⁻¹Δ. Nothing is left out, Δ need not be positive, and it does not matter how long the exact filter would take to
//! settle: a covariance over many equal rows goes by powers of two, so that a likelihood costs a run of one gain over the data
//! forwards and one backwards.
use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::course::{halves, settled};
use crate::description::Sums;
use crate::laid_out::{Gains, LaidOut, RUN_ROWS, lay_out, whiten_rows};
use crate::whiten::{Filter, Space};

/// Rows of a stretch, on average, below which a gain for each row costs less.
const SHORTEST_STRETCH: usize = 8;
/// Change of the log-likelihood, nats, that a covariance which has not quite settled may make.
const UNSETTLED_NATS: f64 = 1e-4;
/// States up to which a filter of one channel is of fixed size.
const FEW_STATES: usize = 8;
/// Elements of Ψ over some rows, states in units of their spread, below which nothing is left of a state.
const FORGOTTEN: f64 = 1e-12;

/// A filter with its settled gain, and where it has not settled.
pub struct Steady {
    filter: Filter,
    /// The same where channels or states are many, of the gain of each level.
    many: Option<Box<dyn LaidOut>>,
    stretches: Vec<Stretch>,
}

/// Rows without one missing and with one white level.
struct Stretch {
    rows: Range<usize>,
    level: usize,
    /// Rows before the next stretch after which nothing is left of a state.
    memory: usize,
    /// M, and 1 − ΛM, of its first row.
    moved: DMatrix<f64>,
    turned: DMatrix<f64>,
}

/// What a filter settles at.
struct Settled {
    /// P̄.
    covariance: DMatrix<f64>,
    /// K and W, by rows.
    gain: (Vec<f64>, Vec<f64>),
    /// ln det S.
    log_variance: f64,
    /// Λ over rows that are present.
    present: Powers,
    /// Δ over rows that are missing.
    missing: Powers,
    memory: usize,
}

/// X ← C + A X Aᵀ, once, twice, four times …: A and C of each.
struct Powers(Vec<(DMatrix<f64>, DMatrix<f64>)>);

impl Powers {
    fn new(map: DMatrix<f64>, added: DMatrix<f64>, most: usize) -> Self {
        let doubled =
            |(map, added): &(DMatrix<f64>, DMatrix<f64>)| (map * map, added + map * added * map.transpose());
        let number = most.checked_ilog2().map_or(0, |power| power as usize + 1);
        Self(std::iter::successors(Some((map, added)), |last| Some(doubled(last))).take(number).collect())
    }

    fn apply(&self, matrix: &mut DMatrix<f64>, times: usize) {
        for (power, (map, added)) in self.0.iter().enumerate() {
            if times >> power & 1 == 1 {
                *matrix = added + map * &*matrix * map.transpose();
            }
        }
    }
}

impl Settled {
    /// Of a model with states in units of their spread, for stretches and gaps of at most so many rows.
    fn new(space: &Space, white: &[f64], present: &[bool], longest: [usize; 2]) -> Option<Self> {
        let (n, m) = (space.states, space.channels);
        let covariance = settled(space, white)?;
        let start = covariance.as_slice().to_vec();
        let at_rest = Space { start, white: white.to_vec(), other_white: None, ..space.clone() };
        let [one, two] = [1, 2].map(|rows| Filter::new(&at_rest, &vec![true; rows]));
        let (one, two) = (one?, two?);
        let rows = present.len() as f64;
        let log_variance = one.log_variances;
        if (two.log_variances - 2.0 * log_variance).abs() * rows > UNSETTLED_NATS {
            return None;
        }
        let (gain, whitening) = one.settled();
        let (k, w) = (DMatrix::from_row_slice(n, m, &gain), DMatrix::from_row_slice(m, m, &whitening));
        let seen = DMatrix::from_row_slice(m, n, &space.seen);
        let transition = DMatrix::from_row_slice(n, n, &space.transition);
        let known = &k * &seen;
        let missed = halves(&(&transition * &known * &covariance * transition.transpose()));
        let closed = &transition * (DMatrix::identity(n, n) - known);
        let whitened = w * seen;
        let present = Powers::new(closed.transpose(), whitened.transpose() * whitened, longest[0]);
        let forgotten = present.0.iter().position(|(map, _)| map.amax() < FORGOTTEN);
        Some(Self {
            covariance,
            gain: (gain, whitening),
            log_variance,
            memory: forgotten.map_or(usize::MAX, |power| 1 << power),
            present,
            missing: Powers::new(transition, missed, longest[1]),
        })
    }
}

impl Steady {
    /// The filter of `space` over rows that are `present` or not; `None` where it does not settle, or a gain for each row
    /// costs less.
    pub fn new(space: &Space, present: &[bool]) -> Option<Self> {
        let n = space.states;
        let mut of_rows: Vec<Range<usize>> = Vec::new();
        for (row, _) in present.iter().enumerate().filter(|(_, present)| **present) {
            match of_rows.last_mut() {
                Some(last) if last.end == row && space.is_other(row) == space.is_other(last.start) => {
                    last.end += 1;
                }
                _ => of_rows.push(row..row + 1),
            }
        }
        let first = of_rows.first()?.start;
        if n == 0 || of_rows.len() * SHORTEST_STRETCH > present.len() {
            return None;
        }
        let gap_before = |place: usize| match place.checked_sub(1) {
            Some(before) => of_rows[place].start - of_rows[before].end,
            None => first,
        };
        let longest = of_rows.iter().map(ExactSizeIterator::len).max()?;
        let longest_gap = (0..of_rows.len()).map(gap_before).max()?;
        let space = space.in_units(&space.units(&space.start));
        let white = std::iter::once(&space.white).chain(space.other_white.as_ref().map(|(_, white)| white));
        let levels: Vec<Settled> = white
            .map(|white| Settled::new(&space, white, present, [longest, longest_gap]))
            .collect::<Option<_>>()?;
        let level_at = |row: usize| usize::from(space.is_other(row));
        // Δ where each stretch begins.
        let off = |(place, rows): (usize, &Range<usize>)| {
            let own = &levels[level_at(rows.start)];
            let Some(before) = place.checked_sub(1) else {
                let mut start = DMatrix::from_row_slice(n, n, &space.start);
                let driven = DMatrix::from_row_slice(n, n, &space.driven);
                let transition = DMatrix::from_row_slice(n, n, &space.transition);
                Powers::new(transition, driven, first).apply(&mut start, first);
                return start - &own.covariance;
            };
            let before = &levels[level_at(of_rows[before].start)];
            let mut off = DMatrix::zeros(n, n);
            before.missing.apply(&mut off, gap_before(place));
            off + &before.covariance - &own.covariance
        };
        let off: Vec<DMatrix<f64>> = of_rows.iter().enumerate().map(off).collect();
        let unseen = Powers::new(
            DMatrix::from_column_slice(n, n, &space.transition),
            DMatrix::zeros(n, n),
            longest_gap,
        );
        let mut log_variances = 0.0;
        let mut information = DMatrix::zeros(n, n);
        let mut stretches = Vec::with_capacity(of_rows.len());
        for (place, (rows, off)) in of_rows.iter().zip(&off).enumerate().rev() {
            let number = level_at(rows.start);
            let level = &levels[number];
            level.present.apply(&mut information, rows.len());
            let whole = (DMatrix::identity(n, n) + off * &information).lu();
            let determinant = whole.determinant();
            if determinant.is_nan() || determinant <= 0.0 {
                return None;
            }
            log_variances += determinant.ln() + rows.len() as f64 * level.log_variance;
            let moved = halves(&whole.solve(off)?);
            let turned = DMatrix::identity(n, n) - &information * &moved;
            information = halves(&(&turned * information));
            unseen.apply(&mut information, gap_before(place));
            let (rows, memory) = (rows.clone(), level.memory);
            stretches.push(Stretch { rows, level: number, memory, moved, turned });
        }
        stretches.reverse();
        let index: Vec<Option<u8>> =
            (present.iter().enumerate()).map(|(row, present)| present.then(|| level_at(row) as u8)).collect();
        let gains: Vec<(Vec<f64>, Vec<f64>)> = levels.into_iter().map(|level| level.gain).collect();
        let filter = Filter::of_gains(&space, &gains, &index, log_variances);
        let many = (space.channels > 1 || n > FEW_STATES).then(|| {
            let views: Vec<(&[f64], &[f64])> =
                gains.iter().map(|(gain, whitening)| (gain.as_slice(), whitening.as_slice())).collect();
            lay_out(&filter, &views)
        });
        Some(Self { filter, many, stretches })
    }

    /// Sums of data (first) and regressors.
    pub fn sums(&self, columns: &[&[f64]]) -> Sums {
        let whitened = match &self.many {
            Some(many) => self.whiten(many.as_ref(), columns),
            None => self.filter.whiten(columns),
        };
        let mut sums = Sums::of_whitened(&self.filter, &whitened);
        let costates: Vec<Vec<DVector<f64>>> =
            whitened.iter().map(|whitened| self.costates(whitened)).collect();
        for (place, stretch) in self.stretches.iter().enumerate() {
            for (i, costates_i) in costates.iter().enumerate() {
                let moved = &stretch.moved * &costates_i[place];
                for (j, costates_j) in costates.iter().enumerate().take(i + 1) {
                    let taken = moved.dot(&costates_j[place]);
                    match (i, j) {
                        (0, _) => sums.log_likelihood += 0.5 * taken,
                        (_, 0) => sums.scores[i - 1] -= taken,
                        _ => {
                            sums.normal[(i - 1, j - 1)] -= taken;
                            if i != j {
                                sums.normal[(j - 1, i - 1)] -= taken;
                            }
                        }
                    }
                }
            }
        }
        sums
    }

    fn whiten(&self, many: &dyn LaidOut, columns: &[&[f64]]) -> Vec<Vec<f64>> {
        let mut whitened: Vec<Vec<f64>> = columns.iter().map(|column| vec![0.0; column.len()]).collect();
        let mut states = vec![vec![0.0; self.filter.states()]; columns.len()];
        let mut run = vec![vec![0.0; self.filter.channels() * RUN_ROWS]; columns.len()];
        let mut end = 0;
        for Stretch { rows: of_stretch, level, .. } in &self.stretches {
            for state in &mut states {
                self.filter.coast(of_stretch.start - end, state);
            }
            end = of_stretch.end;
            for first in of_stretch.clone().step_by(RUN_ROWS) {
                let rows = (Gains::One(*level), first..(first + RUN_ROWS).min(end));
                whiten_rows(many, rows, columns, &mut states, &mut run, &mut whitened);
            }
        }
        whitened
    }

    /// λ where each stretch begins.
    fn costates(&self, whitened: &[f64]) -> Vec<DVector<f64>> {
        let mut costate = DVector::zeros(self.filter.states());
        let mut end = self.stretches.last().map_or(0, |stretch| stretch.rows.end);
        let mut found = Vec::with_capacity(self.stretches.len());
        for Stretch { rows, level, memory, turned, .. } in self.stretches.iter().rev() {
            if rows.len() > *memory {
                end = rows.start + memory;
                costate.fill(0.0);
            }
            match &self.many {
                Some(many) => {
                    self.filter.coast_back(end.saturating_sub(rows.end), costate.as_mut_slice());
                    let over = rows.start..end.min(rows.end);
                    many.backwards(*level, whitened, over, costate.as_mut_slice());
                }
                None => {
                    self.filter.backwards(whitened, rows.start..end, costate.as_mut_slice(), |_, _| ());
                }
            }
            end = rows.start;
            let next = turned * &costate;
            found.push(std::mem::replace(&mut costate, next));
        }
        found.reverse();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::course::tests::{noises, space_of};

    /// Sums by the exact filter of every row.
    fn exact(space: &Space, present: &[bool], columns: &[&[f64]]) -> Sums {
        let filter = Filter::of_every_row(space, present).unwrap();
        Sums::of_whitened(&filter, &filter.whiten(columns))
    }

    fn columns(rows: usize, channels: usize) -> [Vec<f64>; 3] {
        let wave = |rate: f64| {
            (0..rows * channels).map(|flat| 1e-7 * (flat as f64 * rate).sin() + 1e-8).collect::<Vec<_>>()
        };
        [wave(0.37), wave(0.0011), vec![1e-7; rows * channels]]
    }

    fn assert_same(space: &Space, present: &[bool]) {
        let columns = columns(present.len(), space.channels);
        let views: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let found = Steady::new(space, present).unwrap().sums(&views);
        let expected = exact(space, present, &views);
        let apart = (found.log_likelihood - expected.log_likelihood).abs();
        assert!(apart < 1e-6 + 1e-10 * expected.log_likelihood.abs(), "{space:?}: {apart}");
        assert!((&found.normal - &expected.normal).amax() < 1e-8 * expected.normal.amax(), "{space:?}");
        let size = expected.scores.amax().max(expected.normal.amax());
        assert!((&found.scores - &expected.scores).amax() < 1e-8 * size, "{space:?}");
    }

    /// Noises that settle at once, slowly and never, through gaps of all lengths and a change of the white level.
    #[test]
    fn sums_are_those_of_the_filter_of_every_row() {
        let rows = 6000;
        let whole = vec![true; rows];
        let gaps: Vec<bool> = (0..rows)
            .map(|row| row > 7 && row < 5990 && row % 97 != 0 && !(1000..2500).contains(&row))
            .collect();
        for noise in noises() {
            let space = space_of(&noise);
            for present in [&whole, &gaps] {
                assert_same(&space, present);
                for changes_at in [3, 900, 1500, 2500, 4000, 5995] {
                    let since = (0..rows).map(|row| row >= changes_at).collect();
                    let other_white = Some((since, vec![space.white[0] * 4.0]));
                    assert_same(&Space { other_white, ..space.clone() }, present);
                }
            }
        }
    }

    /// Three instruments seen through two channels, in which what all have in common is never seen, and grows without bound.
    #[test]
    fn what_no_channel_sees_may_grow() {
        let (c, s) = (0.9 * 0.3_f64.cos(), 0.9 * 0.3_f64.sin());
        let mut space = Space {
            states: 5,
            channels: 2,
            transition: vec![0.0; 25],
            driven: vec![0.0; 25],
            start: vec![0.0; 25],
            seen: vec![1.0, -1.0, 0.0, 1.0, 0.0, 0.5, 0.5, -1.0, 0.5, 0.0],
            white: vec![0.3, 0.1, 0.1, 0.2],
            other_white: None,
        };
        for i in 0..3 {
            space.transition[6 * i] = 1.0;
            space.driven[6 * i] = 1e-4;
        }
        for (at, value) in [(18, c), (19, -s), (23, s), (24, c)] {
            space.transition[at] = value;
        }
        for at in [18, 24] {
            space.driven[at] = 0.019;
            space.start[at] = 0.1;
        }
        let present: Vec<bool> = (0..3000).map(|row| row % 211 != 0 && !(700..1300).contains(&row)).collect();
        assert_same(&space, &present);
        let in_turns = (0..3000).map(|row| row % 500 > 380).collect();
        assert_same(&Space { other_white: Some((in_turns, vec![0.9, 0.1, 0.1, 0.2])), ..space }, &present);
    }
}
