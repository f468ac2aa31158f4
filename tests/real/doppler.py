"""Underwater vehicle: the Doppler log against the inertial system's velocity, turned into body axes.

y(t) = (1 + k) v(t - d) + v x e + w(t - d) x r + b + noise, for the log as one instrument: scale factor k, mounting e,
lever arm r, delay d (on a grid: the cubic spline through the reference is read at t - d), constants b. The noise of each
component is an autoregression of its own.

The rate w is the derivative of a rotation spline through the attitude. The mean rate between the neighbours of a row, over
2 s, lacks the peaks of turns that last some seconds: with it the likelihood is 150 to 400 nats less and the arm 3 to 8 %
longer.
"""

import numpy as np
import pandas as pd
from common import DATA, Fit, Report, cross_with_axes
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

ORDER = 4
EDGE = 6
NAMES = ["scale", "mounting x", "mounting y", "mounting z", "arm x", "arm y", "arm z", "bias x", "bias y", "bias z"]


def channels(leg, delay, lever=True, turned=True):
    velocity, rate = leg["velocity"](leg["t"] - delay), leg["rate"](leg["t"] - delay)
    rows = slice(EDGE, -EDGE)
    columns = [velocity[:, :, None]]
    columns += [cross_with_axes(velocity)] if turned else []
    columns += [cross_with_axes(rate)] if lever else []
    columns += [np.broadcast_to(np.eye(3), (len(rate), 3, 3))]
    X, y = np.concatenate(columns, axis=2), leg["log"] - velocity
    return [(y[rows, axis], X[rows, axis]) for axis in range(3)]


def best(leg, **options):
    """Likelihood on a grid of delays, then a parabola through its top: delay, its sigma, fit."""
    coarse = np.arange(-3.0, 1.01, 0.1)
    top = coarse[np.argmax([Fit(channels(leg, d, **options), ORDER).log_likelihood for d in coarse])]
    fine = top + np.arange(-0.1, 0.101, 0.02)
    likelihoods = [Fit(channels(leg, d, **options), ORDER).log_likelihood for d in fine]
    middle = int(np.clip(np.argmax(likelihoods), 2, len(fine) - 3))
    near = slice(middle - 2, middle + 3)
    a, b, _ = np.polyfit(fine[near] - fine[middle], likelihoods[near], 2)
    delay = fine[middle] - b / (2 * a)
    return delay, 1 / np.sqrt(-2 * a), Fit(channels(leg, delay, **options), ORDER)


def main():
    report = Report("auv_doppler_ins")
    for number in range(1, 7):
        table = pd.read_csv(DATA / f"auv_doppler_ins/leg{number:02}.csv")
        t = table.t_s.to_numpy()
        attitude = Rotation.from_euler("ZYX", table[["yaw_rad", "pitch_rad", "roll_rad"]].to_numpy())
        turning = RotationSpline(t, attitude)
        leg = {
            "t": t,
            "velocity": CubicSpline(t, attitude.inv().apply(table[["vn_mps", "ve_mps", "vd_mps"]].to_numpy())),
            "rate": lambda when: turning(np.clip(when, t[0], t[-1]), 1),
            "log": table[["dvl_x_mps", "dvl_y_mps", "dvl_z_mps"]].to_numpy(),
        }
        case = f"auv_doppler_ins/leg{number:02}"
        delay, delay_sigma, fit = best(leg)
        at_zero = Fit(channels(leg, 0.0), ORDER)
        no_lever = best(leg, lever=False)[2]
        report.estimate(case, "dvl", "time_delay", "delay_s", delay, delay_sigma, "s",
                        gain=fit.log_likelihood - at_zero.log_likelihood)
        units = dict(zip(NAMES, zip(fit.coefficients, fit.sigmas)))
        for axis in "xyz":
            value, sigma = units[f"arm {axis}"]
            report.estimate(case, "dvl", "lever_arm", f"arm_{axis}_m", value, sigma, "m",
                            gain=fit.log_likelihood - no_lever.log_likelihood)
        value, sigma = units["scale"]
        report.estimate(case, "dvl", "scale_factor", "coefficient", 1e6 * value, 1e6 * sigma, "ppm")
        for axis in "xyz":
            value, sigma = units[f"mounting {axis}"]
            report.estimate(case, "dvl", "misalignment", f"angle_{axis}", value, sigma, "rad")
            value, sigma = units[f"bias {axis}"]
            report.estimate(case, f"dvl_{axis}", "bias_constant", "coefficient", value, sigma, "m/s")
        spread = [float(np.std(residual)) for residual in fit.residuals]
        raw = [float(np.std(y)) for y, _ in channels(leg, 0.0)]
        report.remark(case, f"standard deviation of the difference {np.round(raw, 4).tolist()} m/s, of what is left "
                      f"{np.round(spread, 4).tolist()} m/s; autoregressions {[np.round(n[0], 2).tolist() for n in fit.noise]}")
        # What is right of the log as an instrument, and of its axes.
        report.require(case, "dvl", "time_delay")
        report.require(case, "dvl", "lever_arm")
        for axis in "xyz":
            report.allow(case, f"dvl_{axis}", "noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_exp_cos",
                         "noise_variance_step", "noise_outliers", "noise_angle_quantisation")
        for row in report.case(case)["estimates"]:
            if row["gain_nats"] > 6 and row["effect"] in ("scale_factor", "misalignment", "bias_constant"):
                report.allow(case, row["sensor"], row["effect"])
    report.print()


if __name__ == "__main__":
    main()
