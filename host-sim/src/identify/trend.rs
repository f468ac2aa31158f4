//! Mean and linear trend by ordinary least squares.
use serde::Serialize;

use super::series::mean;

/// Mean and straight line through a series, in the SI unit of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Trend {
    /// Arithmetic mean of the values that are there.
    pub mean: f64,
    /// Standard deviation about the mean, with n − 1.
    pub deviation: f64,
    /// Slope of the least-squares line, per second.
    pub slope_per_s: f64,
    /// The line's value at the first row.
    pub intercept: f64,
    /// Standard deviation about the line, with n − 2.
    pub deviation_about_line: f64,
}

/// The trend of `values` over `elapsed_s`; `None` with fewer than three values.
pub fn trend(elapsed_s: &[f64], values: &[f64]) -> Option<Trend> {
    let present = || elapsed_s.iter().zip(values).filter(|(_, value)| value.is_finite());
    let count = present().count();
    if count < 3 {
        return None;
    }
    let mean_value = mean(values);
    let mean_time = present().map(|(time, _)| time).sum::<f64>() / count as f64;
    let (mut times, mut products, mut squares) = (0.0, 0.0, 0.0);
    for (time, value) in present() {
        let (time, value) = (time - mean_time, value - mean_value);
        times += time * time;
        products += time * value;
        squares += value * value;
    }
    let slope_per_s = products / times;
    let about_line: f64 = present()
        .map(|(time, value)| value - mean_value - slope_per_s * (time - mean_time))
        .map(|residual| residual * residual)
        .sum();
    Some(Trend {
        mean: mean_value,
        deviation: (squares / (count - 1) as f64).sqrt(),
        slope_per_s,
        intercept: mean_value - slope_per_s * mean_time,
        deviation_about_line: (about_line / (count - 2) as f64).sqrt(),
    })
}
