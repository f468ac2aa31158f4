"""Five MPU-9150 units turned by hand, three of them here: scale factors, angles and biases from |f| = g at the standstills.

What the authors published of the same units is a picture that is not among the data: the comparison with it is open. The gyros'
biases are means over the standstills.
"""

import numpy as np
import pandas as pd
from common import DATA, STANDARD_GRAVITY, Report
from still import FREE, self_calibration, standstills

NOISE = ["noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_angle_quantisation", "noise_variance_step",
         "noise_exp_cos", "noise_outliers", "quantisation"]


def main():
    report = Report("mikoff_mpu9150_five")
    for unit in range(3):
        case = f"mikoff_mpu9150_five/imu{unit}"
        rows = pd.read_csv(DATA / f"{case}.csv.gz", sep=" ", header=None).to_numpy(float)
        stretches = standstills(rows[:, 3:], 100, 0.004)
        means = np.array([rows[a:b].mean(axis=0) for a, b in stretches])
        matrix, bias, deviations, sigmas, _, left = self_calibration(means[:, :3])
        for k, letter in enumerate("xyz"):
            name = f"a{letter}"
            report.estimate(case, name, "bias_constant", "coefficient", bias[k], sigmas[k], "m/s^2")
            report.allow(case, name, "bias_constant", "scale_factor", "misalignment", "bias_step", "intermittent_jump", *NOISE)
            if abs(bias[k]) > 5 * sigmas[k]:
                report.require(case, name, "bias_constant")
            rates = means[:, 3 + k]
            report.estimate(case, f"g{letter}", "bias_constant", "coefficient", rates.mean(), rates.std(ddof=1) / len(rates) ** 0.5, "rad/s")
            report.require(case, f"g{letter}", "bias_constant")
            # Means of standstills scatter by more than noise within one: the bias wanders, and may follow the attitude.
            report.allow(case, f"g{letter}", "bias_drift_linear", "bias_step", "g_mass_unbalance", "g_quadrature", "g_spin", *NOISE)
        for i, j in FREE:
            effect, unit_text, factor, more = ("scale_factor", "ppm", 1e6, {}) if i == j else ("misalignment", "rad", 1.0, {"axis": "xyz"[j]})
            report.estimate(case, f"a{'xyz'[i]}", effect, "coefficient", factor * matrix[i, j], factor * deviations[i, j], unit_text, **more)
        report.allow(case, "imu", "scale_factor", "misalignment")
        report.remark(case, f"{len(stretches)} standstills; matrix {np.round(1e3 * matrix, 2).tolist()} 1e-3, bias {np.round(bias, 4).tolist()} "
                      f"m/s^2; left of |f| - {STANDARD_GRAVITY} {1e3 * left.std():.1f} mm/s^2")
    report.print()


if __name__ == "__main__":
    main()
