"""A simulator's prediction beside a real thing: what is left, by least squares on what the authors say is missing.

The cases are read as more_cases.py writes them, so that the prediction is the same:

    pairs.py FOLDER
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from common import Report
from redundant import shifted
from scipy.spatial.transform import Rotation

NOISE = ["noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_angle_quantisation", "noise_variance_step",
         "noise_exp_cos", "noise_outliers", "quantisation"]


def least_squares(X, y, blocks=10):
    """Coefficients and sigmas: the scatter over blocks of the record, each with the same regressors, over the root of their number."""
    coefficients = np.linalg.lstsq(X, y, rcond=None)[0]
    each = [np.linalg.lstsq(X[rows], y[rows], rcond=None)[0] for rows in np.array_split(np.arange(len(y)), blocks)]
    return coefficients, np.std(each, axis=0, ddof=1) / np.sqrt(blocks)


def silverbox(report, folder):
    case, table = "silverbox/arrow", pd.read_csv(folder / "silverbox/arrow.csv")
    y, left = table.output.to_numpy(), (table.drive - table.model).to_numpy()
    lags = np.column_stack([np.roll(y, k) for k in range(-3, 4)])
    X = np.column_stack([np.ones(len(y)), y**3, y**2, lags])[3:-3]
    coefficients, sigmas = least_squares(X, left[3:-3])
    report.estimate(case, "drive", "bias_on_aux", "coefficient", coefficients[1], sigmas[1], "V/V^3", column="output", power=3)
    report.allow(case, "drive", "bias_on_aux", "bias_constant", "scale_factor_cubic", "scale_factor_quadratic", *NOISE)
    report.remark(case, f"cubic {coefficients[1]:.3f} ± {sigmas[1]:.3f} V/V^3, quadratic {coefficients[2]:.4f} ± {sigmas[2]:.4f} V/V^2; "
                  f"standard deviation left of the linear model {left.std():.2e} V, after all {np.std(left[3:-3] - X @ coefficients):.2e} V, "
                  f"with the linear part alone {np.std(left[3:-3] - X[:, [0, *range(3, 10)]] @ np.linalg.lstsq(X[:, [0, *range(3, 10)]], left[3:-3], rcond=None)[0]):.2e} V")


def pendulum(report, folder):
    case, table = "dfki_pendulum/held", pd.read_csv(folder / "dfki_pendulum/held.csv")
    left = (table.torque - table.model).to_numpy()
    velocity = table.velocity.to_numpy()
    X = np.column_stack([np.ones(len(left)), np.sin(table.position), np.where(np.abs(velocity) > 0.05, np.sign(velocity), 0.0), velocity])
    coefficients, sigmas = least_squares(X, left)
    report.estimate(case, "torque", "bias_constant", "coefficient", coefficients[0], sigmas[0], "N m")
    report.allow(case, "torque", "bias_constant", "bias_on_aux", "scale_factor", "time_delay", *NOISE)
    report.remark(case, f"torque is commanded by the same model: offset {coefficients[0]:.4f} ± {sigmas[0]:.4f} N m, gravity "
                  f"{coefficients[1]:+.4f} ± {sigmas[1]:.4f} of 3.3133 N m, sign of the velocity {coefficients[2]:.4f} ± {sigmas[2]:.4f}, "
                  f"velocity {coefficients[3]:.4f} ± {sigmas[3]:.4f} N m s; left {left.std():.4f} N m")
    case, table = "dfki_pendulum/swing", pd.read_csv(folder / "dfki_pendulum/swing.csv")
    # The torque's integral: I w + m g l int sin + b angle + c int sign + offset t; no derivative is taken.
    time, step = table.t_s.to_numpy(), np.gradient(table.t_s.to_numpy())
    velocity, position = table.velocity.to_numpy(), table.position.to_numpy()
    integral = lambda values: np.cumsum(values * step)
    X = np.column_stack([velocity - velocity[0], integral(np.sin(position)), position - position[0], integral(np.sign(velocity)), time - time[0],
                         np.ones(len(time))])
    coefficients, *_ = np.linalg.lstsq(X, integral(table.torque.to_numpy()), rcond=None)
    left = integral(table.torque.to_numpy()) - X @ coefficients
    report.allow(case, "torque", "bias_constant", "bias_on_aux", "scale_factor", "time_delay", "bandwidth_lag", *NOISE)
    report.remark(case, f"from the torque's integral: inertia {coefficients[0]:.4f} kg m^2, gravity {coefficients[1]:.3f} N m, viscous "
                  f"{coefficients[2]:.4f} N m s, Coulomb {coefficients[3]:.3f} N m, offset {coefficients[4]:.3f} N m; left {left.std():.4f} of "
                  f"{integral(table.torque.to_numpy()).std():.4f} N m s. The torque has peaks of {table.torque.abs().max():.0f} N m that the motion does not show")


def delay_of(time, reference, values):
    """The delay of least residual, in steps of 5 ms and a parabola through the best and its neighbours."""
    delays, squares = np.arange(-0.06, 0.0605, 0.005), []
    for delay in delays:
        X = np.column_stack([np.ones(len(time)), shifted(reference, time, delay)])[10:-10]
        squares.append(np.linalg.lstsq(X, values[10:-10], rcond=None)[1][0])
    j = int(np.clip(np.argmin(squares), 1, len(delays) - 2))
    a, b, c = squares[j - 1 : j + 2]
    return delays[j] + 0.5 * (a - c) / (a - 2 * b + c) * 0.005


def pelican(report, folder):
    case, table = "qrsim_pelican/rotation", pd.read_csv(folder / "qrsim_pelican/rotation.csv")
    time = table.t_s.to_numpy()
    attitude = Rotation.from_euler("ZYX", table[["yaw", "pitch", "roll"]].to_numpy())
    # Rate between neighbours but one, in body axes, at the middle one.
    rate = (attitude[:-2].inv() * attitude[2:]).as_rotvec() / (time[2:] - time[:-2])[:, None]
    gyros, middle = table[["gx", "gy", "gz"]].to_numpy()[1:-1], time[1:-1]
    for k, name in enumerate(["gx", "gy", "gz"]):
        halves = [delay_of(middle[rows], rate[rows], gyros[rows, k]) for rows in np.array_split(np.arange(len(middle)), 2)]
        delay, spread = np.mean(halves), max(abs(halves[1] - halves[0]) / 2, 5e-4)
        X = np.column_stack([np.ones(len(middle)), shifted(rate, middle, delay)])[10:-10]
        coefficients, sigmas = least_squares(X, gyros[10:-10, k])
        left = np.std(gyros[10:-10, k] - X @ coefficients)
        report.estimate(case, name, "time_delay", "delay_s", delay, spread, "s")
        report.estimate(case, name, "scale_factor", "coefficient", 1e6 * (coefficients[1 + k] - 1), 1e6 * sigmas[1 + k], "ppm")
        report.allow(case, name, "time_delay", "bandwidth_lag", "scale_factor", "misalignment", "bias_constant", "angular_acceleration",
                     "scale_factor_cubic", "scale_factor_odd_quadratic", *NOISE)
        report.remark(case, f"{name}: late by {1e3 * delay:.1f} ± {1e3 * spread:.1f} ms against the attitude's rate, slope {coefficients[1 + k]:.4f} ± "
                      f"{sigmas[1 + k]:.4f}, left {left:.3f} of {gyros[:, k].std():.3f} rad/s")
    report.allow(case, "imu", "time_delay", "bandwidth_lag", "scale_factor", "misalignment")


def altimeters(report, folder):
    case, table = "rocketpy_flights/juno3", pd.read_csv(folder / "rocketpy_flights/juno3.csv")
    left = (table.altimeter - table.gnss).to_numpy()
    robust = 1.4826 * np.median(np.abs(left - np.median(left)))
    spikes = np.abs(np.diff(left, prepend=left[0])) > 300
    good = ~(spikes | np.roll(spikes, -1))
    slope = np.polyfit(table.gnss[good], table.altimeter[good], 1)
    report.allow(case, "altimeter", "scale_factor", "bias_constant", "time_delay", "bandwidth_lag", "noise_outliers", "bias_on_aux",
                 "bias_temperature", "bias_step", "intermittent_jump", *NOISE)
    report.remark(case, f"slope on the receiver's height {slope[0]:.3f}, {spikes.sum()} rows with jumps beyond 300 m, robust deviation {robust:.0f} m")
    case, table = "strapdown_rs_phone/drive", pd.read_csv(folder / "strapdown_rs_phone/drive.csv")
    left = (table.barometer - table.gnss).to_numpy()
    left = left[np.isfinite(left)]
    report.allow(case, "barometer", "bias_constant", "bias_drift_linear", "bias_on_aux", "scale_factor", "bias_step", *NOISE)
    report.remark(case, f"difference has a standard deviation of {left.std():.1f} m and a lag-one correlation of "
                  f"{np.corrcoef(left[1:], left[:-1])[0, 1]:.3f}: the receiver's own error is coloured; slope over the record "
                  f"{3600 * np.polyfit(np.arange(len(left)), left, 1)[0]:.1f} m/h")


def main():
    report, folder = Report("pairs"), Path(sys.argv[1])
    for examine in [silverbox, pendulum, pelican, altimeters]:
        examine(report, folder)
    report.print()


if __name__ == "__main__":
    main()
