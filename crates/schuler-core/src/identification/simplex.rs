//! Maximum of a function of several variables by the simplex of Nelder and Mead, one evaluation at a time.
//!
//! The function is far too costly for one step of the flight module, so the search hands out the point that it
//! wants to know and takes the value when it is there. Between the two calls its work is small and bounded.

/// What the value that comes next is for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage<const D: usize> {
    /// Values of the first simplex.
    Start(usize),
    /// The worst vertex mirrored at the others' centre.
    Reflect,
    /// Twice as far, after a reflection that was the best yet.
    Expand { reflected: [f32; D], value: f32 },
    /// Half-way out, after a reflection that was only better than the worst.
    ContractOutside { value: f32 },
    /// Half-way in.
    ContractInside,
    /// All vertices drawn towards the best.
    Shrink(usize),
}

/// The search's state, for `D` variables and `V` = `D` + 1 vertices.
#[derive(Clone, Copy, Debug)]
pub struct Simplex<const D: usize, const V: usize> {
    vertices: [[f32; D]; V],
    values: [f32; V],
    stage: Stage<D>,
    /// The point whose value is wanted.
    wanted: [f32; D],
    evaluations: u16,
}

impl<const D: usize, const V: usize> Simplex<D, V> {
    const WHOLE: () = assert!(V == D + 1, "one vertex more than variables");

    /// A search that has not been started.
    pub const fn idle() -> Self {
        let () = Self::WHOLE;
        Self {
            vertices: [[0.0; D]; V],
            values: [0.0; V],
            stage: Stage::Start(0),
            wanted: [0.0; D],
            evaluations: 0,
        }
    }

    /// A search from `start`, with a first simplex of edge `step` along each variable.
    pub fn new(start: [f32; D], step: f32) -> Self {
        let mut vertices = [start; V];
        for (axis, vertex) in vertices.iter_mut().skip(1).enumerate() {
            for (i, x) in vertex.iter_mut().enumerate() {
                *x += if i == axis { step } else { 0.0 };
            }
        }
        Self {
            vertices,
            values: [f32::NEG_INFINITY; V],
            stage: Stage::Start(0),
            wanted: start,
            evaluations: 0,
        }
    }

    /// The point whose value the search wants next.
    pub fn wanted(&self) -> [f32; D] {
        self.wanted
    }

    /// Values taken so far.
    pub fn evaluations(&self) -> u16 {
        self.evaluations
    }

    /// Difference of the best and the worst value of the simplex; infinite before it is complete.
    pub fn spread(&self) -> f32 {
        match self.stage {
            Stage::Start(_) => f32::INFINITY,
            _ => self.values[0] - self.values[V - 1],
        }
    }

    /// The best point yet and its value.
    pub fn best(&self) -> ([f32; D], f32) {
        self.vertices.iter().zip(self.values).fold(
            (self.vertices[0], f32::NEG_INFINITY),
            |best, (&vertex, value)| if value > best.1 { (vertex, value) } else { best },
        )
    }

    /// Takes the value at the wanted point. A value that is not a number counts as the worst there is.
    pub fn report(&mut self, value: f32) {
        let value = if value.is_nan() { f32::NEG_INFINITY } else { value };
        self.evaluations = self.evaluations.saturating_add(1);
        let worst = V - 1;
        let tried = self.wanted;
        let next = match self.stage {
            Stage::Start(i) => {
                self.place(i, tried, value);
                if i + 1 < V { Stage::Start(i + 1) } else { Stage::Reflect }
            }
            Stage::Reflect if value > self.values[0] => Stage::Expand { reflected: tried, value },
            Stage::Reflect if value > self.values[worst - 1] => self.accept(tried, value),
            Stage::Reflect if value > self.values[worst] => Stage::ContractOutside { value },
            Stage::Reflect => Stage::ContractInside,
            Stage::Expand { reflected, value: at_reflected } => {
                if value > at_reflected {
                    self.accept(tried, value)
                } else {
                    self.accept(reflected, at_reflected)
                }
            }
            Stage::ContractOutside { value: at_reflected } if value >= at_reflected => {
                self.accept(tried, value)
            }
            Stage::ContractInside if value > self.values[worst] => self.accept(tried, value),
            Stage::ContractOutside { .. } | Stage::ContractInside => Stage::Shrink(1),
            Stage::Shrink(i) => {
                self.place(i, tried, value);
                if i + 1 < V { Stage::Shrink(i + 1) } else { Stage::Reflect }
            }
        };
        if next == Stage::Reflect {
            self.sort();
        }
        self.stage = next;
        self.wanted = self.point(next);
    }

    fn place(&mut self, index: usize, vertex: [f32; D], value: f32) {
        if let (Some(v), Some(f)) = (self.vertices.get_mut(index), self.values.get_mut(index)) {
            *v = vertex;
            *f = value;
        }
    }

    fn accept(&mut self, vertex: [f32; D], value: f32) -> Stage<D> {
        self.place(V - 1, vertex, value);
        Stage::Reflect
    }

    /// Best first: an exchange sort of fixed length.
    fn sort(&mut self) {
        for _ in 1..V {
            for i in 1..V {
                if self.values[i] > self.values[i - 1] {
                    self.values.swap(i, i - 1);
                    self.vertices.swap(i, i - 1);
                }
            }
        }
    }

    fn point(&self, stage: Stage<D>) -> [f32; D] {
        match stage {
            Stage::Start(i) => self.vertices.get(i).copied().unwrap_or(self.vertices[0]),
            Stage::Reflect => self.along(1.0),
            Stage::Expand { .. } => self.along(2.0),
            Stage::ContractOutside { .. } => self.along(0.5),
            Stage::ContractInside => self.along(-0.5),
            Stage::Shrink(i) => {
                let vertex = self.vertices.get(i).copied().unwrap_or(self.vertices[0]);
                let mut point = self.vertices[0];
                for (x, y) in point.iter_mut().zip(vertex) {
                    *x = 0.5 * (*x + y);
                }
                point
            }
        }
    }

    /// centre + t (centre − worst), the centre being that of all vertices but the worst.
    fn along(&self, t: f32) -> [f32; D] {
        let mut centre = [0.0; D];
        for vertex in self.vertices.iter().take(D) {
            for (c, x) in centre.iter_mut().zip(vertex) {
                *c += x * (1.0 / D as f32);
            }
        }
        for (c, x) in centre.iter_mut().zip(self.vertices[V - 1]) {
            *c += t * (*c - x);
        }
        centre
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maximise(start: [f32; 4], step: f32, f: impl Fn(&[f32; 4]) -> f32) -> Simplex<4, 5> {
        let mut simplex = Simplex::new(start, step);
        while simplex.spread() > 1e-6 && simplex.evaluations() < 1000 {
            simplex.report(f(&simplex.wanted()));
        }
        simplex
    }

    #[test]
    fn finds_the_top_of_a_tilted_quadratic() {
        let top = [1.0, -2.0, 0.5, 3.0];
        let simplex = maximise([0.0; 4], 0.7, |x| {
            let d = [x[0] - top[0], x[1] - top[1], x[2] - top[2], x[3] - top[3]];
            -(d[0] * d[0] + 5.0 * d[1] * d[1] + d[2] * d[2] + 0.3 * d[3] * d[3] + 0.8 * d[0] * d[1])
        });
        for (found, top) in simplex.best().0.iter().zip(top) {
            assert!((found - top).abs() < 0.02, "{:?}", simplex.best());
        }
        assert!(simplex.evaluations() < 300);
    }

    #[test]
    fn survives_values_that_are_not_numbers() {
        let simplex = maximise([0.3; 4], 0.5, |x| if x[0] > 0.5 { f32::NAN } else { -x[0] * x[0] });
        assert!(simplex.best().0[0].abs() < 0.05);
    }
}
