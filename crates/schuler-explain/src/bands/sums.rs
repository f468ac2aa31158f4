//! A block whitened by one filter, and the products of its channels and series by band.
//!
//! Every channel and every series goes through the same filter of one channel: innovations of the rows that are present, one
//! after the other, without anything in place of those that are missing. What enters channel c by the sensor at place i is
//! v_i φ, v the columns of the parity matrix, so that all products are those of series times those of vectors.
use std::collections::HashMap;
use std::sync::{Arc, PoisonError, RwLock};

use nalgebra::{DMatrix, DVector};

use super::layout::Layout;
use super::onsets::Onsets;
use crate::catalogue::{OnsetShape, Port};
use crate::config::Config;
use crate::noise::Noise;
use crate::nominal::Block;
use crate::whitening::filter::{Filter, Space};

/// Energy of the coefficients that are left away at the end of a series, of all, at most.
const LEFT_AWAY: f64 = 1e-9;
/// The same of a series that is as large as the data, in variances of a whitened coefficient.
const LEFT_OF_DATA: f64 = 1e-3;

/// A series of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SeriesId(u32);

/// A series whitened and transformed.
struct Entry {
    /// Coefficients of the series of unit energy, as far as they matter.
    coefficients: Vec<f32>,
    /// Root of its energy.
    norm: f64,
    /// Products with the channels by band, channel after channel.
    with_channels: Vec<Vec<f64>>,
    /// Energy by band.
    energy: Arc<[f64]>,
}

#[derive(Default)]
struct Store {
    by_content: HashMap<(u64, usize), SeriesId>,
    entries: Vec<Arc<Entry>>,
    products: HashMap<(SeriesId, SeriesId), Arc<[f64]>>,
    onsets: HashMap<(Port, OnsetShape), Option<Arc<Onsets>>>,
}

/// The sums of a block.
pub struct Sums {
    /// The bands.
    pub layout: Layout,
    /// The filter of each channel.
    pub filter: Filter,
    /// How the sensor at each place enters the channels; one of (1) where there is one channel.
    pub vectors: Vec<DVector<f64>>,
    /// Power by which each source of a block of one channel enters it, by band; 1 in redundant blocks, which have their vectors.
    pub through: Vec<Vec<f64>>,
    /// Spectrum by which the record was whitened, by band.
    pub base: Vec<f64>,
    /// Transforms of the channels.
    pub channels: Vec<Vec<f64>>,
    /// Products of the channels by band.
    pub between_channels: Vec<DMatrix<f64>>,
    /// Half the logarithm of the determinant that whitening took away, of all channels.
    pub half_log_determinant: f64,
    present: Vec<usize>,
    /// Energy of the coefficients that are left away at the end of a series, of all.
    left_away: f64,
    store: RwLock<Store>,
}

impl Sums {
    /// The sums of a block under the noises of all sources, with narrow bands about the frequencies `resolved`, rad a row; none where the
    /// noises are singular.
    pub fn new(block: &Block, noises: &[Noise], resolved: &[f64], config: &Config) -> Option<Self> {
        let present: Vec<usize> = (0..block.rows()).filter(|&row| block.present[row]).collect();
        let layout = Layout::new(present.len(), config.single_coefficients, config.band_ratio, resolved);
        let vectors: Vec<DVector<f64>> = if block.is_redundant() {
            let real = |place| block.transfer(place, 0.0).into_iter().map(|value| value.re).collect();
            (0..block.sensors.len()).map(|place| DVector::from_vec(real(place))).collect()
        } else {
            vec![DVector::from_element(1, 1.0)]
        };
        let through: Vec<Vec<f64>> = (0..block.sources.len())
            .map(|place| layout.omega.iter().map(|&omega| power_through(block, place, omega)).collect())
            .collect();
        let (filter, base) = if block.is_redundant() {
            let noise = noise_in_the_middle(block, noises);
            let base = layout.omega.iter().map(|&omega| noise.spectrum(omega, block.step_s())).collect();
            (Filter::new(&space(&noise, block.step_s()), &block.present)?, base)
        } else {
            let base = total_spectrum(block, noises, &layout.omega, &through);
            (block.filter(noises)?, base)
        };
        let half_log_determinant = 0.5 * filter.log_variances * block.channels as f64;
        let mut sums = Self {
            layout,
            filter,
            vectors,
            through,
            base,
            channels: Vec::new(),
            between_channels: Vec::new(),
            half_log_determinant,
            present,
            left_away: LEFT_AWAY,
            store: RwLock::default(),
        };
        let rows = block.rows();
        let columns: Vec<&[f64]> = block.data.chunks(rows).collect();
        sums.channels = sums.transformed(&columns);
        sums.between_channels = sums.between(&sums.channels);
        let energy = |channel: &Vec<f64>| channel.iter().map(|value| value * value).sum::<f64>();
        let most = sums.channels.iter().map(energy).fold(1.0, f64::max);
        sums.left_away = LEFT_AWAY.min(LEFT_OF_DATA / most);
        Some(sums)
    }

    /// Number of channels.
    pub fn width(&self) -> usize {
        self.channels.len()
    }

    /// Number of rows that are present.
    pub fn rows(&self) -> usize {
        self.present.len()
    }

    /// Whitens and transforms columns of all rows, of one channel each.
    pub fn transformed(&self, columns: &[&[f64]]) -> Vec<Vec<f64>> {
        let whitened = self.filter.whiten(columns);
        let transformed = whitened.into_iter().map(|all| {
            let mut values: Vec<f64> = self.present.iter().map(|&row| all[row]).collect();
            self.layout.transform(&mut values);
            values
        });
        transformed.collect()
    }

    /// Energy by band of the values of all rows, whitened; none where it is not a number.
    pub fn energy_of(&self, values: &[f64]) -> Option<Vec<f64>> {
        let whitened = self.transformed(&[values]).pop()?;
        let in_band = |edge: &[usize]| whitened[edge[0]..edge[1]].iter().map(|value| value * value).sum();
        let energy: Vec<f64> = self.layout.edges.windows(2).map(in_band).collect();
        energy.iter().all(|value: &f64| value.is_finite()).then_some(energy)
    }

    /// Information of a shape that begins at a row, at a port of a sensor of the block, computed once: under the filter of one channel that of
    /// each sensor is the same.
    pub fn onsets(
        &self,
        block: &Block,
        sensor: usize,
        port: Port,
        shape: OnsetShape,
        config: &Config,
    ) -> Option<Arc<Onsets>> {
        let key = (port, shape);
        let known = self.store.read().unwrap_or_else(PoisonError::into_inner).onsets.get(&key).cloned();
        known.unwrap_or_else(|| {
            let computed = Onsets::new(self, block, sensor, port, shape, config).map(Arc::new);
            let mut store = self.store.write().unwrap_or_else(PoisonError::into_inner);
            store.onsets.insert(key, computed.clone());
            computed
        })
    }

    /// Products of transformed channels by band.
    pub fn between(&self, channels: &[Vec<f64>]) -> Vec<DMatrix<f64>> {
        let width = channels.len();
        let in_band = |edge: &[usize]| {
            DMatrix::from_fn(width, width, |c, d| {
                let (a, b) = (&channels[c][edge[0]..edge[1]], &channels[d][edge[0]..edge[1]]);
                a.iter().zip(b).map(|(a, b)| a * b).sum()
            })
        };
        self.layout.edges.windows(2).map(in_band).collect()
    }

    /// The scores of unit impulses in every row of every channel: the transpose of whitening and transform.
    pub fn impulses(&self, coefficients: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let of_channel = |coefficients: &Vec<f64>| {
            let mut values = coefficients.clone();
            self.layout.inverse(&mut values);
            let mut whitened = vec![0.0; self.filter.rows()];
            for (&row, value) in self.present.iter().zip(values) {
                whitened[row] = value;
            }
            self.filter.adjoint(&whitened)
        };
        coefficients.iter().map(of_channel).collect()
    }

    /// The series of given values in all rows, each once; none of those that are zero.
    pub fn insert(&self, values: &[&[f64]]) -> Vec<Option<SeriesId>> {
        let keys: Vec<(u64, usize)> =
            values.iter().map(|values| (fingerprint(values), values.len())).collect();
        let known = |store: &Store| keys.iter().map(|key| store.by_content.get(key).copied()).collect();
        let mut ids: Vec<Option<SeriesId>> =
            known(&self.store.read().unwrap_or_else(PoisonError::into_inner));
        let new: Vec<usize> = (0..values.len()).filter(|&index| ids[index].is_none()).collect();
        let columns: Vec<&[f64]> = new.iter().map(|&index| values[index]).collect();
        let entries: Vec<Option<Entry>> =
            self.transformed(&columns).into_iter().map(|series| self.entry(&series)).collect();
        let mut store = self.store.write().unwrap_or_else(PoisonError::into_inner);
        for (index, entry) in new.into_iter().zip(entries) {
            ids[index] = store.by_content.get(&keys[index]).copied();
            if let (None, Some(entry)) = (ids[index], entry) {
                let id = SeriesId(store.entries.len() as u32);
                store.entries.push(Arc::new(entry));
                store.by_content.insert(keys[index], id);
                ids[index] = Some(id);
            }
        }
        ids
    }

    fn entry(&self, series: &[f64]) -> Option<Entry> {
        let energy: f64 = series.iter().map(|value| value * value).sum();
        if !(energy > f64::MIN_POSITIVE && energy.is_finite()) {
            return None;
        }
        let norm = energy.sqrt();
        let mut left = 0.0;
        let beyond = |value: &&f64| {
            left += *value * *value;
            left <= self.left_away * energy
        };
        let kept = series.len() - series.iter().rev().take_while(beyond).count();
        let coefficients: Vec<f32> = series[..kept].iter().map(|value| (value / norm) as f32).collect();
        let with = |channel: &Vec<f64>| -> Vec<f64> {
            let in_band = |edge: &[usize]| {
                let (from, to) = (edge[0].min(kept), edge[1].min(kept));
                let pairs = coefficients[from..to].iter().zip(&channel[from..to]);
                norm * pairs.map(|(a, b)| f64::from(*a) * b).sum::<f64>()
            };
            self.layout.edges.windows(2).map(in_band).collect()
        };
        let with_channels = self.channels.iter().map(with).collect();
        let products = self.layout.products(&coefficients, &coefficients);
        let energy = products.into_iter().map(|product| product * energy).collect();
        Some(Entry { coefficients, norm, with_channels, energy })
    }

    fn entry_of(&self, id: SeriesId) -> Arc<Entry> {
        Arc::clone(&self.store.read().unwrap_or_else(PoisonError::into_inner).entries[id.0 as usize])
    }

    /// Products of a series with the channels by band, channel after channel, seen by `visit`.
    pub fn with_channels<T>(&self, id: SeriesId, visit: impl FnOnce(&[Vec<f64>]) -> T) -> T {
        visit(&self.entry_of(id).with_channels)
    }

    /// Products of two series by band.
    pub fn products(&self, a: SeriesId, b: SeriesId) -> Arc<[f64]> {
        if a == b {
            return Arc::clone(&self.entry_of(a).energy);
        }
        let key = (a.min(b), a.max(b));
        if let Some(known) = self.store.read().unwrap_or_else(PoisonError::into_inner).products.get(&key) {
            return Arc::clone(known);
        }
        let (first, second) = (self.entry_of(a), self.entry_of(b));
        let scale = first.norm * second.norm;
        let products = self.layout.products(&first.coefficients, &second.coefficients);
        let products: Arc<[f64]> = products.into_iter().map(|product| product * scale).collect();
        let mut store = self.store.write().unwrap_or_else(PoisonError::into_inner);
        store.products.insert(key, Arc::clone(&products));
        products
    }

    /// Adds `amplitude` times a series to coefficients.
    pub fn add(&self, id: SeriesId, amplitude: f64, coefficients: &mut [f64]) {
        let entry = self.entry_of(id);
        let scale = amplitude * entry.norm;
        for (sum, value) in coefficients.iter_mut().zip(&entry.coefficients) {
            *sum += scale * f64::from(*value);
        }
    }
}

/// Power by which a source enters a block of one channel at `omega` rad a row.
fn power_through(block: &Block, place: usize, omega: f64) -> f64 {
    if block.is_redundant() {
        return 1.0;
    }
    block.noise_transfer(place, omega).iter().map(nalgebra::Complex::norm_sqr).sum()
}

/// Spectrum of all sources of a block of one channel at frequencies in rad a row, of which `through` is the power by which each enters.
fn total_spectrum(block: &Block, noises: &[Noise], omega: &[f64], through: &[Vec<f64>]) -> Vec<f64> {
    let of_band = |(band, &omega): (usize, &f64)| {
        let of = |(&source, through): (&usize, &Vec<f64>)| {
            through[band] * noises[source].spectrum(omega, block.step_s())
        };
        block.sources.iter().zip(through).map(of).sum()
    };
    omega.iter().enumerate().map(of_band).collect()
}

/// Of the noises of a redundant block that whose white level is in the middle.
fn noise_in_the_middle(block: &Block, noises: &[Noise]) -> Noise {
    let mut sources = block.sources.clone();
    sources.sort_by(|&a, &b| noises[a].white_variance().total_cmp(&noises[b].white_variance()));
    sources.get(sources.len() / 2).map(|&source| noises[source].clone()).unwrap_or_default()
}

/// One channel of one noise.
fn space(noise: &Noise, step_s: f64) -> Space {
    let groups = noise.states(step_s).groups;
    let states: usize = groups.iter().map(|group| group.size).sum();
    let mut space = Space {
        states,
        channels: 1,
        transition: vec![0.0; states * states],
        driven: vec![0.0; states * states],
        start: vec![0.0; states * states],
        seen: Vec::new(),
        white: vec![noise.white_variance()],
        other_white: None,
    };
    let mut at = 0;
    for group in &groups {
        for i in 0..group.size {
            for j in 0..group.size {
                space.transition[(at + i) * states + at + j] = group.transition[i][j];
            }
            space.driven[(at + i) * states + at + i] = group.driven[i];
            space.start[(at + i) * states + at + i] = group.start[i];
        }
        space.seen.extend(&group.seen[..group.size]);
        at += group.size;
    }
    space
}

/// A number by which equal series are known.
fn fingerprint(values: &[f64]) -> u64 {
    values.iter().fold(0xcbf2_9ce4_8422_2325, |hash: u64, value| {
        (hash ^ value.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
    })
}
