"""Quartz gravimeter: drift, what is left of the tide, temperature and tilt, by generalised least squares.

The readings are put on the nominal grid (a stamp may be 1 to 3 s late: nothing to the tide). Two descriptions of the
noise are tried: an autoregression, and white noise on a random walk (statsmodels' Kalman filter); an effect counts that
stands in both. Vertical axis down: the reading's sign is that of gravity; the instrument had added the tide correction.
"""

import warnings

import numpy as np
import pandas as pd
from common import DATA, Fit, Report, held_out_gain
from spectrum import allow_line
from statsmodels.tsa.statespace.structural import UnobservedComponents

ORDER = 12
UNITS = {
    "drift": ("bias_drift_linear", "m/s^2/h", 1e-9),
    "tide": ("bias_on_aux", "m/s^2/(m/s^2)", 1.0),
    "temperature": ("bias_temperature", "m/s^2/K", 1e-6),
    "tilt x": ("bias_on_aux", "m/s^2/rad", 1e-3),
    "tilt y": ("bias_on_aux", "m/s^2/rad", 1e-3),
}
COLUMNS = {"tide": "tide_corr_mps2", "tilt x": "tilt_x_rad", "tilt y": "tilt_y_rad"}


def main():
    warnings.simplefilter("ignore")
    report = Report("quartz_gravimeter")
    for segment in ["segment_22h", "segment_62h"]:
        table = pd.read_csv(DATA / f"quartz_gravimeter/{segment}.csv")
        centred = table - table.mean()
        hours = (table.t_s - table.t_s.iloc[0]) / 3600
        y = 1e9 * centred.g_rel_mps2.to_numpy()
        # In units of 1e-9 m/s^2, hours, 1e-9 m/s^2, mK and urad.
        X = np.column_stack([
            np.ones(len(y)), hours - hours.mean(), 1e9 * centred.tide_corr_mps2, 1e3 * centred.dT_sensor_K,
            1e6 * centred.tilt_x_rad, 1e6 * centred.tilt_y_rad,
        ])
        fit = Fit([(y, X)], ORDER)
        walk = UnobservedComponents(y, "llevel", exog=X[:, 1:]).fit(disp=False, maxiter=500)
        case = f"quartz_gravimeter/{segment}"
        report.allow(case, "spring", "noise_white", "noise_markov", "noise_random_walk", "noise_flicker",
                     "noise_exp_cos", "noise_variance_step", "noise_outliers")
        for k, (name, (effect, unit, factor)) in enumerate(UNITS.items(), 1):
            gain = []
            without = np.delete(X, k, axis=1)
            gain.append(fit.log_likelihood - Fit([(y, without)], ORDER).log_likelihood)
            reduced = UnobservedComponents(y, "llevel", exog=without[:, 1:]).fit(disp=False, maxiter=500)
            gain.append(walk.llf - reduced.llf)
            more = {"column": COLUMNS[name]} if name in COLUMNS else {}
            value, sigma = factor * fit.coefficients[k], factor * fit.sigmas[k]
            other = factor * walk.params[-5:][k - 1], factor * walk.bse[-5:][k - 1]
            report.estimate(case, "spring", effect, "coefficient", value, max(sigma, other[1]), unit, gain=min(gain),
                            gain_autoregression=gain[0], gain_random_walk=gain[1], with_random_walk=list(other), **more)
            if max(gain) > 6:
                report.allow(case, "spring", effect)
                if name == "tide":
                    report.allow(case, "spring", "earth_tide", "periodic_line", "gravity_anomaly")
                if name == "drift":
                    report.allow(case, "spring", "bias_warmup")
        # Of the differences: the drift and its walk would hide what is slow.
        allow_line(report, case, "spring", np.diff(y), 66.0, 2e-4)
        report.case(case)["held_out_gain"] = {
            "drift": held_out_gain([(y, X[:, :2])], ORDER, [0]), "all": held_out_gain([(y, X)], ORDER, [0])
        }
        report.remark(case, f"white {np.sqrt(walk.params[0]):.2f}e-9 m/s^2, random walk {np.sqrt(walk.params[1]) / 66**0.5:.3f}e-9 "
                      f"m/s^2/sqrt(s); tilt moved by {1e6 * np.ptp(table.tilt_x_rad):.1f} and {1e6 * np.ptp(table.tilt_y_rad):.1f} urad, "
                      f"temperature by {1e3 * np.ptp(table.dT_sensor_K):.2f} mK; correlation of tilt x with time "
                      f"{np.corrcoef(table.tilt_x_rad, table.t_s)[0, 1]:.2f}")
        if segment == "segment_22h":
            # The instrument was levelled and settled in the first minutes.
            report.allow(case, "spring", "bias_warmup", "bias_step")
    report.print()


if __name__ == "__main__":
    main()
