//! Form A of the regression [TMP-3], [TMP-8]: parameters of `[1, s, exp(−s)]`, measurements added and removed one by
//! one in a square-root filter. A reference for the form that flies; double precision only.
use nalgebra::{Matrix3, Vector3};

/// Parameters x (degC) with a square root S of their covariance.
#[derive(Clone, Copy, Debug)]
pub struct Incremental {
    /// x0, x1, x2, degC.
    pub x: Vector3<f64>,
    /// Square root of the covariance, degC.
    pub s: Matrix3<f64>,
    /// Origin t0, s.
    pub origin_s: f64,
    /// `T_p`, s.
    pub time_constant_s: f64,
}

impl Incremental {
    /// Zero with a prior of 1000 degC; more destroys the numerics.
    pub fn start(origin_s: f64, time_constant_s: f64) -> Self {
        Self { x: Vector3::zeros(), s: Matrix3::identity() * 1e3, origin_s, time_constant_s }
    }

    /// Row of the measurement matrix at `t`, s.
    pub fn row(&self, t: f64) -> Vector3<f64> {
        let s = (t - self.origin_s) / self.time_constant_s;
        Vector3::new(1.0, s, (-s).exp())
    }

    /// Adds `z = h·x` with variance `r`.
    pub fn add(&mut self, h: &Vector3<f64>, z: f64, r: f64) {
        let phi = self.s.transpose() * h;
        let a = phi.dot(&phi) + r;
        let v = self.s * phi;
        self.x += v * ((z - h.dot(&self.x)) / a);
        self.s -= v * phi.transpose() / (a + (r * a).sqrt());
    }

    /// Removes what [`Incremental::add`] added. `false`, and nothing done, when what remains would be near-singular.
    #[must_use]
    pub fn remove(&mut self, h: &Vector3<f64>, z: f64, r: f64) -> bool {
        let phi = self.s.transpose() * h;
        let b = r - phi.dot(&phi);
        if b <= 1e-3 * r {
            return false;
        }
        let v = self.s * phi;
        self.x -= v * ((z - h.dot(&self.x)) / b);
        self.s += v * phi.transpose() / (b + (r * b).sqrt());
        true
    }

    /// Moves the origin; the temperature stays the same function of time.
    pub fn shift(&mut self, origin_s: f64) {
        let d = (origin_s - self.origin_s) / self.time_constant_s;
        let c = Matrix3::new(1.0, d, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, (-d).exp());
        self.x = c * self.x;
        self.s = c * self.s;
        self.origin_s = origin_s;
    }

    /// Temperature, degC, and rate, degC/s.
    pub fn at(&self, t: f64) -> (f64, f64) {
        let h = self.row(t);
        (h.dot(&self.x), (self.x[1] - h[2] * self.x[2]) / self.time_constant_s)
    }
}
