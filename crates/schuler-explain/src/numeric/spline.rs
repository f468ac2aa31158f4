//! Natural cubic spline.

/// A point of a spline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// Where it is.
    pub time: f64,
    /// The value there.
    pub value: f64,
}

/// Natural cubic spline.
#[derive(Clone, Debug)]
pub struct Spline {
    knots: Vec<Knot>,
    /// Second derivative at each knot.
    bend: Vec<f64>,
}

impl Spline {
    /// Through at least one knot, times increasing.
    pub fn through(knots: &[Knot]) -> Self {
        let n = knots.len();
        let mut bend = vec![0.0; n];
        // Tridiagonal system for the inner second derivatives: forward sweep, back substitution.
        let mut sweep = vec![(0.0, 0.0); n];
        for k in 1..n.saturating_sub(1) {
            let (before, after) = (knots[k].time - knots[k - 1].time, knots[k + 1].time - knots[k].time);
            let slope =
                |i: usize| (knots[i + 1].value - knots[i].value) / (knots[i + 1].time - knots[i].time);
            let pivot = 2.0 * (before + after) - before * sweep[k - 1].0;
            sweep[k] = (after / pivot, (6.0 * (slope(k) - slope(k - 1)) - before * sweep[k - 1].1) / pivot);
        }
        for k in (1..n.saturating_sub(1)).rev() {
            bend[k] = sweep[k].1 - sweep[k].0 * bend[k + 1];
        }
        Self { knots: knots.to_vec(), bend }
    }

    /// Value and slope; straight beyond the ends.
    pub fn at(&self, time: f64) -> (f64, f64) {
        let last = self.knots.len() - 1;
        if last == 0 {
            return (self.knots[0].value, 0.0);
        }
        let k = self.knots.partition_point(|u| u.time <= time).clamp(1, last) - 1;
        let (a, b) = (self.knots[k], self.knots[k + 1]);
        let h = b.time - a.time;
        let inside = time.clamp(self.knots[0].time, self.knots[last].time);
        let (u, v) = ((b.time - inside) / h, (inside - a.time) / h);
        let (ma, mb) = (self.bend[k], self.bend[k + 1]);
        let value = u * a.value + v * b.value + h * h / 6.0 * ((u * u * u - u) * ma + (v * v * v - v) * mb);
        let rate = (b.value - a.value) / h + h / 6.0 * ((3.0 * v * v - 1.0) * mb - (3.0 * u * u - 1.0) * ma);
        (value + rate * (time - inside), rate)
    }
}
