//! A series of any length as a line or a band of bounded length.
//!
//! Neighbouring values are put together when there are too many, by two, then by four, and so on: of each lot the place, the
//! smallest and the largest are kept, so no spike is lost. A figure has fewer pixels than this has lots.

/// Lots that are kept.
const MOST: usize = 1 << 16;

/// Values that have been put together.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lot {
    x: f64,
    low: f64,
    high: f64,
}

impl Lot {
    /// This and the one behind it; what is NaN is not there.
    fn with(self, next: Self) -> Self {
        Self { x: self.x, low: self.low.min(next.low), high: self.high.max(next.high) }
    }
}

/// Values that come one after another.
#[derive(Clone, Debug, PartialEq)]
pub struct Envelope {
    lots: Vec<Lot>,
    /// Values in each lot but the last.
    size: usize,
    /// Values in the last.
    last: usize,
}

impl Envelope {
    /// Of nothing yet.
    pub fn new() -> Self {
        Self { lots: Vec::new(), size: 1, last: 1 }
    }

    /// Takes the next value.
    pub fn line(&mut self, x: f64, y: f64) {
        self.band(x, y, y);
    }

    /// Takes the next width of a band.
    pub fn band(&mut self, x: f64, low: f64, high: f64) {
        let lot = Lot { x, low, high };
        if let Some(last) = self.lots.last_mut().filter(|_| self.last < self.size) {
            *last = last.with(lot);
            self.last += 1;
            return;
        }
        if self.lots.len() == MOST {
            self.lots = self.lots.chunks(2).map(|two| two[0].with(two[1])).collect();
            self.size *= 2;
        }
        self.lots.push(lot);
        self.last = 1;
    }

    /// The series as a line: places and values.
    pub fn into_line(self) -> (Vec<f64>, Vec<f64>) {
        if self.size == 1 {
            return self.lots.into_iter().map(|lot| (lot.x, lot.low)).unzip();
        }
        self.lots.into_iter().flat_map(|lot| [(lot.x, lot.low), (lot.x, lot.high)]).unzip()
    }

    /// The series as a band: places, lower and upper edge.
    pub fn into_band(self) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let (x, edges): (Vec<f64>, Vec<(f64, f64)>) =
            self.lots.into_iter().map(|lot| (lot.x, (lot.low, lot.high))).unzip();
        let (low, high) = edges.into_iter().unzip();
        (x, low, high)
    }
}

impl Default for Envelope {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_series_stays_as_it_is() {
        let mut envelope = Envelope::new();
        let y = |k: usize| if k % 7 == 3 { f64::NAN } else { (k as f64 * 0.37).sin() };
        (0..MOST).for_each(|k| envelope.line(k as f64, y(k)));
        let (x, values) = envelope.into_line();
        assert_eq!(x, (0..MOST).map(|k| k as f64).collect::<Vec<_>>());
        assert!(values.iter().enumerate().all(|(k, value)| value.to_bits() == y(k).to_bits()));
    }

    #[test]
    fn a_long_one_keeps_spikes_gaps_and_both_ends() {
        let mut envelope = Envelope::new();
        let rows = 9 * MOST + 5;
        for k in 0..rows {
            let y = match k {
                300_001 => 40.0,
                400_002 => -40.0,
                200_000..=200_400 => f64::NAN,
                _ => (k as f64 * 0.01).sin(),
            };
            envelope.line(k as f64, y);
        }
        let (x, y) = envelope.clone().into_line();
        assert!(x.len() <= 2 * MOST && x.windows(2).all(|pair| pair[0] <= pair[1]));
        assert_eq!(x[0], 0.0);
        assert!(*x.last().unwrap() > (rows - 33) as f64);
        let at = |value: f64| x[y.iter().position(|y| *y == value).unwrap()];
        assert!((at(40.0) - 300_001.0).abs() <= 16.0 && (at(-40.0) - 400_002.0).abs() <= 16.0);
        let gap: Vec<f64> = x.iter().zip(&y).filter(|(_, y)| y.is_nan()).map(|(x, _)| *x).collect();
        assert!(gap.len() > 2 * 20 && gap.iter().all(|x| (199_990.0..200_400.0).contains(x)));
        let (_, low, high) = envelope.into_band();
        assert!(low.iter().zip(&high).all(|(low, high)| low.is_nan() && high.is_nan() || low <= high));
    }
}
