//! Heat conduction in a one-dimensional body with heaters, convection at both ends and thermometers.
//!
//! ρ c ∂T/∂t = ∂/∂x(k ∂T/∂x) + q, by finite volumes, integrated with a two-stage, second-order, L-stable implicit
//! Runge–Kutta method (Alexander 1977), one tridiagonal solution a stage. Positions are metres from the left end,
//! temperatures °C, power W, time s.
use super::random::Stream;

/// 1 − 1/√2: the coefficient of the L-stable method.
const GAMMA: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;

/// The body: a bar of constant cross-section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bar {
    /// Length, m.
    pub length_m: f64,
    /// Cross-section, m².
    pub section_m2: f64,
    /// Conductivity, W/(m K).
    pub conductivity: f64,
    /// Heat capacity per volume ρc, J/(m³ K).
    pub capacity: f64,
    /// Film coefficient to the surroundings at the left end, W/(m² K); infinity fixes the temperature there.
    pub film_left: f64,
    /// The same at the right end; zero insulates it.
    pub film_right: f64,
    /// Film coefficient times perimeter of the side, W/(m K): heat lost along the bar.
    pub side: f64,
    /// Number of finite volumes.
    pub cells: usize,
}

/// The temperature field of a bar.
#[derive(Clone, Debug)]
pub struct Conduction {
    bar: Bar,
    temperature: Vec<f64>,
    /// Power into each cell, W.
    power: Vec<f64>,
}

impl Conduction {
    /// The bar at a uniform temperature.
    pub fn new(bar: Bar, initial_deg_c: f64) -> Self {
        Self { bar, temperature: vec![initial_deg_c; bar.cells], power: vec![0.0; bar.cells] }
    }

    /// The bar with a given field.
    #[cfg(test)]
    fn with_field(bar: Bar, field: impl Fn(f64) -> f64) -> Self {
        let mut it = Self::new(bar, 0.0);
        let width = it.cell_width();
        it.temperature.iter_mut().enumerate().for_each(|(i, t)| *t = field((i as f64 + 0.5) * width));
        it
    }

    fn cell_width(&self) -> f64 {
        self.bar.length_m / self.bar.cells as f64
    }

    /// Cell-centred temperatures, °C.
    pub fn field(&self) -> &[f64] {
        &self.temperature
    }

    /// Temperature at a position, interpolated between cell centres; beyond the outer centres, theirs.
    pub fn at(&self, position_m: f64) -> f64 {
        let last = self.bar.cells - 1;
        let x = (position_m / self.cell_width() - 0.5).clamp(0.0, last as f64);
        let left = (x.floor() as usize).min(last.saturating_sub(1));
        let right = (left + 1).min(last);
        let share = x - left as f64;
        self.temperature[left] * (1.0 - share) + self.temperature[right] * share
    }

    /// Temperature gradient at a position over a length centred there, K/m.
    pub fn gradient(&self, position_m: f64, over_m: f64) -> f64 {
        (self.at(position_m + over_m / 2.0) - self.at(position_m - over_m / 2.0)) / over_m
    }

    /// Sets the power put in at positions: pairs of (position m, power W), each into its cell.
    pub fn set_heaters(&mut self, heaters: impl IntoIterator<Item = (f64, f64)>) {
        self.power.fill(0.0);
        let width = self.cell_width();
        for (position, power) in heaters {
            let cell = ((position / width).floor().max(0.0) as usize).min(self.bar.cells - 1);
            self.power[cell] += power;
        }
    }

    /// Moves on by a step, the surroundings going linearly from one temperature to the other.
    pub fn advance(&mut self, step_s: f64, ambient_start: f64, ambient_end: f64) {
        let ambient_mid = ambient_start + GAMMA * (ambient_end - ambient_start);
        let first = self.stage(&self.temperature, step_s, ambient_mid);
        let base: Vec<f64> =
            self.temperature.iter().zip(&first).map(|(t, k)| t + (1.0 - GAMMA) * step_s * k).collect();
        let second = self.stage(&base, step_s, ambient_end);
        self.temperature
            .iter_mut()
            .zip(first.iter().zip(&second))
            .for_each(|(t, (k1, k2))| *t += step_s * ((1.0 - GAMMA) * k1 + GAMMA * k2));
    }

    /// The slope k of one stage, which solves k = f(base + γ Δ k), that is (I − γ Δ J) k = f(base).
    fn stage(&self, base: &[f64], step_s: f64, ambient: f64) -> Vec<f64> {
        let n = self.bar.cells;
        let width = self.cell_width();
        let heat_capacity = self.bar.capacity * self.bar.section_m2 * width;
        let between = self.bar.conductivity * self.bar.section_m2 / width;
        // Film and half a cell of the bar in series.
        let end = |film: f64| {
            if film == 0.0 {
                0.0
            } else {
                self.bar.section_m2 / (1.0 / film + 0.5 * width / self.bar.conductivity)
            }
        };
        let side = self.bar.side * width;
        let (left, right) = (end(self.bar.film_left), end(self.bar.film_right));
        let scale = GAMMA * step_s / heat_capacity;

        let mut diagonal = vec![0.0; n];
        let mut slope = vec![0.0; n];
        for i in 0..n {
            let to_left = if i == 0 { 0.0 } else { between };
            let to_right = if i + 1 == n { 0.0 } else { between };
            let outside = side + if i == 0 { left } else { 0.0 } + if i + 1 == n { right } else { 0.0 };
            diagonal[i] = 1.0 + scale * (to_left + to_right + outside);
            let mut flow = self.power[i] + outside * (ambient - base[i]);
            if i > 0 {
                flow += to_left * (base[i - 1] - base[i]);
            }
            if i + 1 < n {
                flow += to_right * (base[i + 1] - base[i]);
            }
            slope[i] = flow / heat_capacity;
        }
        // Thomas; the matrix is diagonally dominant.
        let off = -scale * between;
        for i in 1..n {
            let factor = off / diagonal[i - 1];
            diagonal[i] -= factor * off;
            slope[i] -= factor * slope[i - 1];
        }
        slope[n - 1] /= diagonal[n - 1];
        for i in (0..n - 1).rev() {
            slope[i] = (slope[i] - off * slope[i + 1]) / diagonal[i];
        }
        slope
    }
}

/// A temperature that follows another through one thermal resistance and capacity: τ dT/dt = source − T.
#[derive(Clone, Copy, Debug)]
pub struct Lag {
    value: f64,
}

impl Lag {
    /// In equilibrium with `value`.
    pub const fn new(value: f64) -> Self {
        Self { value }
    }

    /// The lagged value now.
    pub const fn value(&self) -> f64 {
        self.value
    }

    /// Moves on by a step with the source going linearly from `start` to `end` (exact for that).
    pub fn advance(&mut self, step_s: f64, tau_s: f64, start: f64, end: f64) -> f64 {
        if tau_s <= 0.0 {
            self.value = end;
            return end;
        }
        let memory = (-step_s / tau_s).exp();
        let slope = (end - start) / step_s;
        // Particular solution: source(t) − slope τ.
        self.value = end - slope * tau_s + memory * (self.value - start + slope * tau_s);
        self.value
    }
}

/// A thermometer: its own lag, noise, then rounding.
#[derive(Clone, Debug)]
pub struct Thermometer {
    tau_s: f64,
    white: f64,
    quantisation: f64,
    lag: Lag,
    before: f64,
    stream: Stream,
}

impl Thermometer {
    /// A thermometer in equilibrium. `tau_s`: its time constant, s; `white`: noise per reading, K; `quantisation`:
    /// its step, K, zero for none.
    pub fn new(tau_s: f64, white: f64, quantisation: f64, initial_deg_c: f64, stream: Stream) -> Self {
        Self { tau_s, white, quantisation, lag: Lag::new(initial_deg_c), before: initial_deg_c, stream }
    }

    /// Reads the place's temperature after a step, °C.
    pub fn read(&mut self, step_s: f64, place_deg_c: f64) -> f64 {
        let felt = self.lag.advance(step_s, self.tau_s, self.before, place_deg_c);
        self.before = place_deg_c;
        quantise(felt + self.white * self.stream.normal(), self.quantisation)
    }
}

/// Rounds to a step; zero or less leaves the value as it is.
pub fn quantise(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const ALUMINIUM: Bar = Bar {
        length_m: 0.2,
        section_m2: 4e-3,
        conductivity: 160.0,
        capacity: 2.43e6,
        film_left: f64::INFINITY,
        film_right: f64::INFINITY,
        side: 0.0,
        cells: 40,
    };

    #[test]
    fn cooling_between_fixed_ends_agrees_with_the_fourier_series() {
        let mut body = Conduction::new(ALUMINIUM, 50.0);
        let diffusivity = ALUMINIUM.conductivity / ALUMINIUM.capacity;
        let l = ALUMINIUM.length_m;
        for k in 1..=200 {
            body.advance(1.0, 0.0, 0.0);
            if k % 20 == 0 {
                for x in [0.02, 0.05, 0.1] {
                    let series: f64 = (0..200)
                        .map(|j| {
                            let m = f64::from(2 * j + 1) * PI / l;
                            4.0 * 50.0 / (f64::from(2 * j + 1) * PI)
                                * (m * x).sin()
                                * (-diffusivity * m * m * f64::from(k)).exp()
                        })
                        .sum();
                    assert!(
                        (body.at(x) - series).abs() < 0.05,
                        "t {k} x {x}: {} against {series}",
                        body.at(x)
                    );
                }
            }
        }
    }

    #[test]
    fn the_scheme_is_of_second_order_in_time() {
        let eigenmode = |x: f64| 30.0 * (PI * x / ALUMINIUM.length_m).sin();
        let error = |step: f64| {
            let mut body = Conduction::with_field(ALUMINIUM, eigenmode);
            let mut fine = body.clone();
            (0..(80.0 / step) as usize).for_each(|_| body.advance(step, 0.0, 0.0));
            (0..1600).for_each(|_| fine.advance(0.05, 0.0, 0.0));
            (body.at(0.1) - fine.at(0.1)).abs()
        };
        let ratio = error(8.0) / error(4.0);
        assert!((3.2..5.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn heat_is_conserved_in_an_insulated_bar() {
        let bar = Bar { film_left: 0.0, film_right: 0.0, ..ALUMINIUM };
        let mut body = Conduction::new(bar, 20.0);
        body.set_heaters([(0.03, 5.0)]);
        (0..1000).for_each(|_| body.advance(1.0, -40.0, 60.0));
        let mean = body.field().iter().sum::<f64>() / bar.cells as f64;
        let expected = 20.0 + 5.0 * 1000.0 / (bar.capacity * bar.section_m2 * bar.length_m);
        assert!((mean - expected).abs() < 1e-9, "{mean} against {expected}");
    }

    #[test]
    fn steady_profile_through_a_film_agrees_with_the_series_resistance() {
        let bar = Bar { film_left: 12.0, film_right: 0.0, ..ALUMINIUM };
        let mut body = Conduction::new(bar, 25.0);
        body.set_heaters([(0.1999, 2.0)]);
        (0..100).for_each(|_| body.advance(1e5, 25.0, 25.0));
        // Heat enters the last cell, whose centre is 0.0025 m from the end.
        let resistance = |x: f64| 1.0 / (12.0 * bar.section_m2) + x / (bar.conductivity * bar.section_m2);
        for x in [0.0125, 0.1025, 0.1975] {
            let expected = 25.0 + 2.0 * resistance(x);
            assert!((body.at(x) - expected).abs() < 1e-6, "{} against {expected}", body.at(x));
        }
        assert!((body.gradient(0.1, 0.02) - 2.0 / (bar.conductivity * bar.section_m2)).abs() < 1e-6);
    }

    #[test]
    fn lag_is_exact_for_a_ramp() {
        let mut lag = Lag::new(0.0);
        for k in 0..10 {
            lag.advance(7.0, 30.0, f64::from(k) * 7.0, f64::from(k + 1) * 7.0);
        }
        let t = 70.0;
        let exact = t - 30.0 * (1.0 - (-t / 30.0f64).exp());
        assert!((lag.value() - exact).abs() < 1e-12);
    }

    #[test]
    fn thermometer_rounds_to_its_step() {
        let mut thermometer = Thermometer::new(0.0, 0.02, 0.0625, 20.0, Stream::new(1, "thermometer"));
        for k in 0..100 {
            let reading = thermometer.read(1.0, 20.0 + 0.01 * f64::from(k));
            assert!((reading / 0.0625).fract() == 0.0);
        }
    }
}
