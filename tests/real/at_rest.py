"""Units at rest: constants by the mean, noise by its spectrum, changes of level, lines.

Nothing moves and nothing warms up that is known of, so the right names are constants and parts of the noise, a line or a change of
level where one stands out. Of ansfl_xsens_static that is known by construction.
"""

import numpy as np
import pandas as pd
from common import DATA, STANDARD_GRAVITY, Report, long_run_covariance
from spectrum import allan, allow_level_changes, allow_line, slope, structures
from still import standstills

NOISE = ["noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_angle_quantisation", "noise_variance_step",
         "noise_exp_cos", "noise_outliers", "quantisation"]
# A straight line counts as a drift where it is this many standard deviations off, those of correlated residuals.
DRIFT = 5.0


def examine(report, case, name, values, step, unit, white=None):
    """`values` without gaps; `white`: the nominal level, where one is stated."""
    values = values[np.isfinite(values)]
    mean = values.mean()
    sigma = np.sqrt(long_run_covariance((values - mean)[:, None])[0, 0]) / len(values)
    report.estimate(case, name, "bias_constant", "coefficient", mean, sigma, unit)
    report.allow(case, name, "bias_constant", *NOISE)
    best = structures(values, step)[0]
    _, structure, _, _, parameters, deviations = best
    # Where a fast part of the noise takes the place of white noise, that one's level is nothing that is seen.
    if parameters[0] > 0.5 * allan(values, 1):
        report.estimate(case, name, "noise_white", "sigma", parameters[0], parameters[0] * deviations[0], unit)
    changes = allow_level_changes(report, case, name, values, [round(s / step) for s in (1, 5)])
    allow_line(report, case, name, values, step, 20 / (len(values) * step))
    line = slope(values, step)
    time = (np.arange(len(values)) - len(values) / 2) * step
    left = values - mean - line.slope * time
    spread = np.sqrt(long_run_covariance((left * time)[:, None])[0, 0]) / np.sum(time**2)
    if abs(line.slope) > DRIFT * spread:
        report.allow(case, name, "bias_drift_linear", "bias_warmup")
    report.remark(case, f"{name}: mean {mean:.4g} ± {sigma:.1g} {unit}; {structure}; white {parameters[0]:.3g} a row"
                  f"{f' of {white:.3g} stated' if white else ''}; slope {line.slope:.2g} ± {spread:.1g} {unit}/s; changes of level "
                  f"{len(changes)}; Allan deviation {[float(f'{allan(values, m):.2g}') for m in (1, 10, 100, 1000) if len(values) > 4 * m]}")


def xsens(report):
    for unit in (1, 2):
        table = pd.read_csv(DATA / f"ansfl_xsens_static/x_stat_{unit}.csv.gz", usecols=range(10)).iloc[1:]
        table = table.apply(pd.to_numeric, errors="coerce").replace([np.inf, -np.inf], np.nan).interpolate()
        # Level: the z axis, which is up, reads gravity at Haifa, 9.7965 m/s^2.
        expected = {"f_z": 9.7965}
        for column, name in zip(["w_x", "w_y", "w_z", "f_x", "f_y", "f_z"], ["gx", "gy", "gz", "ax", "ay", "az"]):
            quantity, white = ("deg/s", 0.007 * 60**0.5) if name[0] == "g" else ("m/s^2", 120e-6 * STANDARD_GRAVITY * 60**0.5)
            values = table[column].to_numpy() - expected.get(column, 0.0)
            examine(report, f"ansfl_xsens_static/unit_{unit}", name, values, 1 / 120, quantity, white)
            if name[0] == "g":
                report.require(f"ansfl_xsens_static/unit_{unit}", name, "bias_constant")
        report.allow(f"ansfl_xsens_static/unit_{unit}", "az", "scale_factor", "gravity_anomaly")
        report.allow(f"ansfl_xsens_static/unit_{unit}", "ax", "misalignment")
        report.allow(f"ansfl_xsens_static/unit_{unit}", "ay", "misalignment")


def gait(report):
    raw = pd.read_csv(DATA / "ximu_gait/straightLine.csv.gz")
    rates = raw[[f"Gyroscope {k} (deg/s)" for k in "XYZ"]].to_numpy(float)
    means = np.array([rates[a:b].mean(axis=0) for a, b in standstills(rates, 40, 1.5)])
    case = "ximu_gait/stances"
    for k, name in enumerate(["gx", "gy", "gz"]):
        # A stance is one reading: within it the foot may creep.
        report.estimate(case, name, "bias_constant", "coefficient", means[:, k].mean(), means[:, k].std(ddof=1) / len(means) ** 0.5, "deg/s")
        report.allow(case, name, "bias_constant", "bias_step", "intermittent_jump", *NOISE)
    report.remark(case, f"{len(means)} stances; means apart by {np.round(np.ptp(means, axis=0), 2).tolist()} deg/s")


def gyrolib(report):
    raw = pd.read_csv(DATA / "rahrs_gyrolib/angles.csv.gz")
    rates = raw[["Wx", "Wy", "Wz"]].to_numpy(float) / 3000
    stretches = standstills(rates, 100, 0.02)
    means = np.array([rates[a:b].mean(axis=0) for a, b in stretches])
    counts = np.array([raw.temperature[a:b].mean() for a, b in stretches])
    X = np.column_stack([np.ones(len(counts)), counts - counts.mean()])
    inverse = np.linalg.inv(X.T @ X)
    case = "rahrs_gyrolib/angles_at_rest"
    for k, name in enumerate(["gx", "gy", "gz"]):
        coefficients = inverse @ X.T @ means[:, k]
        left = means[:, k] - X @ coefficients
        sigmas = np.sqrt(np.diag(inverse) * np.sum(left**2) / (len(counts) - 2))
        report.estimate(case, name, "bias_temperature", "coefficient", coefficients[1], sigmas[1], "rad/s/K")
        report.allow(case, name, *NOISE)
        # The thermometer drifts one way: what goes with it goes with time as well.
        if abs(coefficients[1]) > 3 * sigmas[1]:
            report.allow(case, name, "bias_temperature", "bias_drift_linear", "bias_thermal_lag", "bias_warmup", "bias_step")
        report.remark(case, f"{name}: {len(counts)} standstills, {np.ptp(counts):.0f} counts; {coefficients[1]:.2g} ± {sigmas[1]:.1g} "
                      f"rad/s a count; left {left.std():.2g} rad/s")


def main():
    report = Report("at_rest")
    xsens(report)
    gait(report)
    gyrolib(report)
    report.print()


if __name__ == "__main__":
    main()
