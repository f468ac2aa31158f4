//! Minimisation without derivatives.
use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;

/// What cannot be computed costs this.
pub const IMPOSSIBLE: f64 = 1e30;

struct Cost<F>(F);

impl<F: Fn(&[f64]) -> f64> CostFunction for Cost<F> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, at: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        let cost = (self.0)(at);
        Ok(if cost.is_finite() { cost } else { IMPOSSIBLE })
    }
}

/// The least cost found by a simplex from `start` with the given sides, and where; `spread` is that of the simplex's
/// costs at which the search ends.
pub fn simplex(
    start: &[f64],
    sides: &[f64],
    spread: f64,
    iterations: u64,
    cost: impl Fn(&[f64]) -> f64,
) -> (Vec<f64>, f64) {
    let mut corners = vec![start.to_vec(); start.len() + 1];
    for (axis, (corner, side)) in corners.iter_mut().skip(1).zip(sides).enumerate() {
        corner[axis] += side;
    }
    let here = (start.to_vec(), cost(start));
    let Ok(solver) = NelderMead::new(corners).with_sd_tolerance(spread) else { return here };
    let Ok(result) = Executor::new(Cost(&cost), solver).configure(|state| state.max_iters(iterations)).run()
    else {
        return here;
    };
    match result.state.best_param {
        Some(best) if result.state.best_cost < here.1 => (best, result.state.best_cost),
        _ => here,
    }
}

/// The least cost between `low` and `high` by golden section, from a point inside; returns where and how much.
pub fn golden(low: f64, high: f64, tolerance: f64, cost: impl Fn(f64) -> f64) -> (f64, f64) {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut low, mut high) = (low, high);
    let mut a = high - RATIO * (high - low);
    let mut b = low + RATIO * (high - low);
    let (mut cost_a, mut cost_b) = (cost(a), cost(b));
    while high - low > tolerance {
        if cost_a < cost_b {
            high = b;
            (b, cost_b) = (a, cost_a);
            a = high - RATIO * (high - low);
            cost_a = cost(a);
        } else {
            low = a;
            (a, cost_a) = (b, cost_b);
            b = low + RATIO * (high - low);
            cost_b = cost(b);
        }
        if !(high - low).is_finite() {
            break;
        }
    }
    if cost_a < cost_b { (a, cost_a) } else { (b, cost_b) }
}
