"""An IMU in six poses: bias, scale factor and misalignment of the accelerometers, bias and g-sensitivity of the gyros.

The mean of each pose against plus or minus one g along its axis (and none across); the turns between are not used. How well
a pose is kept is not known: the scatter of what does not fit is the sigma, as of six readings with four unknowns.
"""

import numpy as np
import pandas as pd
from common import DATA, Report


def main():
    report, case = Report("six_positions_three_turns"), "six_positions_three_turns/poses"
    table = pd.read_csv(DATA / "six_positions_three_turns/annotated_session.csv")
    poses = [f"{letter}_{sense}" for letter in "xyz" for sense in "pa"]
    up = np.array([sign * axis for axis in np.eye(3) for sign in (1, -1)])
    means = table.groupby("part").mean(numeric_only=True).loc[poses]
    X = np.column_stack([np.ones(6), up])
    inverse = np.linalg.inv(X.T @ X)
    for prefix, scale, unit in [("a", 1000 / 2048, "mg"), ("g", 1 / 16.384, "deg/s")]:
        readings = scale * means[[f"{'acc' if prefix == 'a' else 'gyr'}_{letter}" for letter in "xyz"]].to_numpy()
        expected = 1000 * up if prefix == "a" else np.zeros((6, 3))
        coefficients = inverse @ X.T @ (readings - expected)
        left = readings - expected - X @ coefficients
        sigmas = np.sqrt(np.outer(np.diag(inverse), (left**2).sum(axis=0) / 2))
        for k, letter in enumerate("xyz"):
            name = f"{prefix}{letter}"
            report.estimate(case, name, "bias_constant", "coefficient", coefficients[0, k], sigmas[0, k], unit)
            for j in range(3):
                value, sigma = coefficients[1 + j, k], sigmas[1 + j, k]
                if prefix == "g":
                    report.estimate(case, name, "g_sensitivity", "coefficient", value, sigma, "deg/s/g", axis="xyz"[j])
                elif j == k:
                    # What the whole unit has too, counts.
                    whole = [{"sensor": "imu", "effect": "scale_factor", "parameter": "coefficient", "factor": 1.0}]
                    report.estimate(case, name, "scale_factor", "coefficient", 1e3 * value, 1e3 * sigma, "ppm", also=whole)
                else:
                    # Of a unit that is turned by the angles e the sensor along k feels (f x e)_k.
                    third = 3 - j - k
                    turned = {"sensor": "imu", "effect": "misalignment", "parameter": f"angle_{'xyz'[third]}",
                              "factor": float(np.linalg.det(np.eye(3)[[j, third, k]]))}
                    report.estimate(case, name, "misalignment", "coefficient", 1e-3 * value, 1e-3 * sigma, "rad",
                                    axis="xyz"[j], also=[turned])
            report.allow(case, name, "bias_constant", "noise_white", "noise_markov", "noise_random_walk", "noise_flicker",
                         "noise_variance_step", "noise_exp_cos", "noise_outliers", "noise_angle_quantisation")
            if prefix == "a":
                # A pose a degree off is 17 mrad across and shows as misalignment; asymmetry is what two poses cannot tell
                # from a bias.
                report.allow(case, name, "scale_factor", "misalignment", "scale_factor_quadratic", "scale_factor_asymmetry")
                report.allow(case, "imu", "misalignment", "scale_factor")
            else:
                report.require(case, name, "bias_constant")
                # A few hundredths of deg/s between poses, as large as the drift of the bias over a minute.
                report.allow(case, name, "g_mass_unbalance", "g_quadrature", "g_spin", "bias_step", "bias_drift_linear")
        if prefix == "a":
            report.require(case, "az", "scale_factor")
        report.remark(case, f"{prefix}: left {np.round(left.std(axis=0), 3).tolist()} {unit}")
    # One turn of 360 deg about each axis, of which the start and end are marked by hand.
    bias = table[table.part.isin(poses)][["gyr_x", "gyr_y", "gyr_z"]].mean().to_numpy()
    for k, letter in enumerate("xyz"):
        turn = table[table.part == f"{letter}_rot"][f"gyr_{letter}"].to_numpy()
        angle = np.sum(turn - bias[k]) / 16.384 / 204.8
        report.remark(case, f"the turn about {letter} integrates to {angle:.1f} deg")
    report.print()


if __name__ == "__main__":
    main()
