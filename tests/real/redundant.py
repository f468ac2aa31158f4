"""Four units on one quadrotor: each unit's rates against the first's, in two halves of the flight.

y_k(t) = b + M w(t - d) by least squares over delays in steps of half a sample (the delay of least residual; a parabola through it and
its neighbours). Mounting is the antisymmetric part of M - 1, scale its diagonal. Units and delays are the same in both halves: half
their difference is the sigma, which has in it what M does not describe (the frame bends, the rotors shake each arm by itself).
"""

import numpy as np
import pandas as pd
from common import DATA, Report

STEP_S = 1 / 120
NOISE = ["noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_angle_quantisation", "noise_variance_step",
         "noise_exp_cos", "noise_outliers", "periodic_line", "quantisation"]
HALVES = 2


def shifted(values, time, delay):
    return np.column_stack([np.interp(time - delay, time, column) for column in values.T])


def fit(time, reference, rates, delay):
    """Coefficients (constant, then the three rates) by axis, and the sum of squares left."""
    inner = slice(12, -12)
    X = np.column_stack([np.ones(len(time)), shifted(reference, time, delay)])[inner]
    coefficients, *_ = np.linalg.lstsq(X, rates[inner], rcond=None)
    return coefficients, float(np.sum((rates[inner] - X @ coefficients) ** 2))


def best(time, reference, rates):
    delays = np.arange(-10, 10.5, 0.5) * STEP_S
    squares = np.array([fit(time, reference, rates, delay)[1] for delay in delays])
    k = int(np.clip(np.argmin(squares), 1, len(delays) - 2))
    a, b, c = squares[k - 1 : k + 2]
    delay = delays[k] + 0.5 * (a - c) / (a - 2 * b + c) * 0.5 * STEP_S
    coefficients, left = fit(time, reference, rates, delay)
    return delay, coefficients, left


def main():
    report, case = Report("ansfl_quadrotor_four_imus"), "ansfl_quadrotor_four_imus/path_1"
    tables = [pd.read_csv(DATA / f"ansfl_quadrotor_four_imus/Horizontal_path_1_IMU_{k}.csv.gz") for k in range(1, 5)]
    time = tables[0].time.to_numpy()
    rates = [table[["Gyr_X", "Gyr_Y", "Gyr_Z"]].to_numpy() for table in tables]
    for unit in range(1, 5):
        for letter in "xyz":
            # Four units that are nominally parallel and are not: everything of a mounting, and the arms shake.
            report.allow(case, f"gyro{unit}_{letter}", "bias_constant", "bias_step", "scale_factor", "misalignment", "time_delay",
                         "bandwidth_lag", "angular_acceleration", *NOISE)
        report.allow(case, f"unit_{unit}", "misalignment", "scale_factor", "time_delay", "bandwidth_lag")
    for unit in (2, 3, 4):
        parts = []
        for half in np.array_split(np.arange(len(time)), HALVES):
            delay, coefficients, left = best(time[half], rates[0][half], rates[unit - 1][half])
            matrix = coefficients[1:].T
            angles = 0.5 * np.array([matrix[1, 2] - matrix[2, 1], matrix[2, 0] - matrix[0, 2], matrix[0, 1] - matrix[1, 0]])
            explained = 1 - left / np.sum((rates[unit - 1][half] - rates[unit - 1][half].mean(axis=0)) ** 2)
            parts.append(np.concatenate([[delay], angles, np.diag(matrix) - 1, [explained]]))
        middle, sigma = np.mean(parts, axis=0), np.abs(np.diff(parts, axis=0)[0]) / 2
        report.estimate(case, f"unit_{unit}", "time_delay", "delay_s", middle[0], max(sigma[0], 1e-4), "s", relative_to="unit_1")
        for k, letter in enumerate("xyz"):
            report.estimate(case, f"unit_{unit}", "misalignment", f"angle_{letter}", middle[1 + k], max(sigma[1 + k], 1e-4), "rad",
                            relative_to="unit_1")
        report.remark(case, f"unit {unit} against unit 1: late by {1e3 * middle[0]:.1f} ± {1e3 * sigma[0]:.1f} ms, turned by "
                      f"{np.round(1e3 * middle[1:4], 0).tolist()} ± {np.round(1e3 * sigma[1:4], 0).tolist()} mrad, diagonal "
                      f"{np.round(middle[4:7], 3).tolist()} ± {np.round(sigma[4:7], 3).tolist()}; explains {middle[7]:.4f} of the variance")
    report.print()


if __name__ == "__main__":
    main()
