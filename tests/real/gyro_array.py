"""Eight gyro units on one board: each axis against the mean of all units.

Only differences between units are seen: what all have in common is not. An estimate against the mean of eight is therefore
uncertain by what the mean itself may be off, the spread over the units divided by sqrt(8): that is in its sigma.
An explanation says as much in another way: it gives nothing to some axis along each of the board's, and the others what they
have beside it. Constants are therefore those beside each axis that may be the one with nothing (`without`).
Poses (before the fast motion): y_i - mean_i = b + M w + G f + D dw/dt, w and f the means of the units, noise an
autoregression. Whole: the same would say nothing more; the counts are at their limits, which the counts themselves show.
"""

import numpy as np
import pandas as pd
from common import DATA, Fit, Report

ORDER = 6
TURNED = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
LIMIT = 32767


def main():
    report = Report("gyro_array")
    for experiment in ["exp1", "exp3"]:
        table = pd.read_csv(DATA / f"gyro_array/{experiment}.csv.gz")
        for units in (8, 3):
            examine(report, experiment, table, units)
    report.print()


def examine(report, experiment, table, units):
    counts = {
        kind: np.stack([table[[f"{kind}{k}_{a}_lsb" for a in "xyz"]].to_numpy(float) for k in range(1, units + 1)], 1)
        for kind in ["gyro", "acc"]
    }
    saturated = np.abs(counts["gyro"]) >= LIMIT
    board = {kind: values.copy() for kind, values in counts.items()}
    for values in board.values():
        values[:, 1::2] = values[:, 1::2] @ TURNED
    rows = table.t_s.to_numpy() < 480.0
    time = table.t_s.to_numpy()[rows]
    gyro, force = board["gyro"][rows] / 16.4, board["acc"][rows].mean(axis=1) / 2048
    rate = gyro.mean(axis=1)
    X = np.column_stack([np.ones(len(time)), rate, force, np.gradient(rate, time, axis=0)])
    fits = [[Fit([(gyro[:, unit, axis] - rate[:, axis], X)], ORDER) for axis in range(3)] for unit in range(units)]
    coefficients = np.array([[fit.coefficients for fit in unit] for unit in fits])
    sigmas = np.array([[fit.sigmas for fit in unit] for unit in fits])
    common = coefficients.std(axis=0, ddof=1) / np.sqrt(units)

    def own(unit, axis):
        """Of a unit, its axis that lies along the board's: its name, and its sign. A turned unit's x and y are exchanged."""
        turned = unit % 2 == 1
        return f"gyro{unit + 1}_{'xyz'[{0: 1, 1: 0, 2: 2}[axis] if turned else axis]}", -1.0 if turned else 1.0

    # Without what depends on the specific force, which is never nothing, a constant is another.
    X_of_rate = X[:, :4]
    constants, deviations = np.zeros((2, units, 3)), np.zeros((2, units, 3))
    for unit in range(units):
        for axis in range(3):
            of_rate = Fit([(gyro[:, unit, axis] - rate[:, axis], X_of_rate)], ORDER)
            for which, fit in enumerate([fits[unit][axis], of_rate]):
                constants[which, unit, axis], deviations[which, unit, axis] = fit.coefficients[0], fit.sigmas[0]

    poses, whole = (f"gyro_array/{experiment}_{part}_{units}_units" for part in ("poses", "whole"))
    report.remark(poses, f"largest dependence on specific force {np.abs(coefficients[:, :, 4:7]).max():.3f} deg/s/g, on angular "
                  f"acceleration {1e3 * np.abs(coefficients[:, :, 7:10]).max():.2f} ms; scale factors apart by "
                  f"{100 * np.ptp(coefficients[:, [0, 1, 2], [1, 2, 3]]):.2f} %")
    for unit in range(units):
        for axis in range(3):
            name, sign = own(unit, axis)
            value, sigma = coefficients[unit, axis], np.hypot(sigmas[unit, axis], common[axis])
            likely = 0.5 * (value / sigmas[unit, axis]) ** 2
            # The reading is along the turned axis: its bias has the other sign, its scale factor the same.
            for which in range(2):
                for other in set(range(units)) - {unit}:
                    report.estimate(
                        poses, name, "bias_constant", "coefficient",
                        sign * (constants[which, unit, axis] - constants[which, other, axis]),
                        np.hypot(deviations[which, unit, axis], deviations[which, other, axis]), "deg/s", likely[0],
                        without=[own(other, axis)[0]])
            for j in range(3):
                if j == axis:
                    report.estimate(poses, name, "scale_factor", "coefficient", 1e6 * value[1 + j], 1e6 * sigma[1 + j],
                                    "ppm", likely[1 + j])
                else:
                    report.estimate(poses, name, "misalignment", "coefficient", sign * value[1 + j], sigma[1 + j], "rad",
                                    likely[1 + j], axis="xyz"[j])
            for case in (poses, whole):
                report.allow(case, name, "bias_constant", "scale_factor", "misalignment", "noise_white", "noise_markov",
                             "noise_random_walk", "noise_flicker", "noise_variance_step", "noise_exp_cos", "noise_outliers",
                             "bias_step", "bias_drift_linear", "bias_warmup", "noise_angle_quantisation", "quantisation")
                report.allow(case, f"unit_{unit + 1}", "misalignment", "scale_factor")
            hits = saturated[:, unit, "xyz".index(name[-1])]
            if hits.any():
                first, last = table.t_s[hits].iloc[[0, -1]]
                report.estimate(whole, name, "output_saturated", "limit", LIMIT / 16.4, 0.1, "deg/s", gain=float(hits.sum()),
                                rows=int(hits.sum()), interval_s=[float(first), float(last)])
                report.require(whole, name, "output_saturated")
                # Fast motion shows what is proportional to rates squared, changes of rate, and timing.
                report.allow(whole, name, "time_delay", "bandwidth_lag", "angular_acceleration", "scale_factor_quadratic",
                             "scale_factor_cubic", "scale_factor_odd_quadratic", "scale_factor_asymmetry")
                report.allow(whole, f"unit_{unit + 1}", "time_delay", "bandwidth_lag")


if __name__ == "__main__":
    main()
