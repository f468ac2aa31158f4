//! Maximum of a function of several variables by the simplex of Nelder and Mead, one evaluation at a time.
//!
//! The function is far too costly for one step of the flight module, so the search hands out the point that it
//! wants to know and takes the value when it is there. Between the two calls its work is small and bounded.
use crate::saved::{saved, saved_choice};

/// What the value that comes next is for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Stage {
    /// Values of the first simplex.
    #[default]
    Start,
    /// The worst vertex mirrored at the others' centre.
    Reflect,
    /// Twice as far, after a reflection that was the best yet.
    Expand,
    /// Half-way out, after a reflection that was only better than the worst.
    ContractOutside,
    /// Half-way in.
    ContractInside,
    /// All vertices drawn towards the best.
    Shrink,
}

/// The search's state, for `D` variables and `V` = `D` + 1 vertices.
#[derive(Clone, Copy, Debug)]
pub struct Simplex<const D: usize, const V: usize> {
    vertices: [[f32; D]; V],
    values: [f32; V],
    stage: Stage,
    /// The vertex whose turn it is in [`Stage::Start`] and [`Stage::Shrink`].
    vertex: usize,
    /// The last reflection and its value.
    reflected: [f32; D],
    at_reflected: f32,
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
            stage: Stage::Start,
            vertex: 0,
            reflected: [0.0; D],
            at_reflected: 0.0,
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
            stage: Stage::Start,
            vertex: 0,
            reflected: start,
            at_reflected: f32::NEG_INFINITY,
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
            Stage::Start => f32::INFINITY,
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
            stage @ (Stage::Start | Stage::Shrink) => {
                self.place(self.vertex, tried, value);
                self.vertex += 1;
                if self.vertex < V { stage } else { Stage::Reflect }
            }
            Stage::Reflect => {
                self.reflected = tried;
                self.at_reflected = value;
                if value > self.values[0] {
                    Stage::Expand
                } else if value > self.values[worst - 1] {
                    self.accept(tried, value)
                } else if value > self.values[worst] {
                    Stage::ContractOutside
                } else {
                    Stage::ContractInside
                }
            }
            Stage::Expand if value > self.at_reflected => self.accept(tried, value),
            Stage::Expand => self.accept(self.reflected, self.at_reflected),
            Stage::ContractOutside if value >= self.at_reflected => self.accept(tried, value),
            Stage::ContractInside if value > self.values[worst] => self.accept(tried, value),
            Stage::ContractOutside | Stage::ContractInside => {
                self.vertex = 1;
                Stage::Shrink
            }
        };
        if next == Stage::Reflect {
            self.vertex = 0;
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

    fn accept(&mut self, vertex: [f32; D], value: f32) -> Stage {
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

    fn point(&self, stage: Stage) -> [f32; D] {
        let vertex = self.vertices.get(self.vertex).copied().unwrap_or(self.vertices[0]);
        match stage {
            Stage::Start => vertex,
            Stage::Reflect => self.along(1.0),
            Stage::Expand => self.along(2.0),
            Stage::ContractOutside => self.along(0.5),
            Stage::ContractInside => self.along(-0.5),
            Stage::Shrink => {
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

saved_choice!(Stage { Start, Reflect, Expand, ContractOutside, ContractInside, Shrink });
saved!([const D: usize, const V: usize] Simplex<D, V> {
    vertices,
    values,
    stage,
    vertex < V,
    reflected,
    at_reflected,
    wanted,
    evaluations,
});

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
