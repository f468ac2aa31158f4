"""Thermal logs: the accelerometer's cold soak and heating, and a MEMS unit in the cold and in the heat.

In each, every course that could explain the readings is tried beside a constant and the levels that change within a tenth of a
second, with autoregressive noise: the temperature and its powers, its rate, its low-pass, a step, a line, an exponential. The
temperature rises once, so most of these are alike; what the log supports is the set within a few nats of the best, an onset or
time constant that was searched for paid by half the logarithm of the rows and the logarithm of the number of values tried
(extended BIC). A coefficient is the mean over the onsets or time constants, weighted by likelihood, and its standard deviation
counts how it changes with them. It is that of one course alone: of two that are alike the coefficients are others.
"""

import numpy as np
import pandas as pd
from common import DATA, Fit, Report
from spectrum import allow_level_changes, allow_line

ORDER = 6
# Descriptions whose likelihoods differ by less are not told apart.
ALIKE_NATS = 6.0
# Below this nothing is said to be there: what a search over so many onsets and time constants gains in noise.
LEAST_NATS = 12.0
# Parts of the log's length.
TAUS = np.geomspace(0.003, 3.0, 11)


def low_pass(values, time, tau):
    out, step = np.empty_like(values), np.diff(time, prepend=time[0])
    state = values[0]
    for k, (value, dt) in enumerate(zip(values, step)):
        state += (value - state) * -np.expm1(-dt / tau)
        out[k] = state
    return out


def smooth_rate(temperature, time, window):
    """Slope of the local line over 2 window + 1 rows."""
    offsets = np.arange(-window, window + 1)
    padded = np.pad(temperature, window, mode="edge")
    return np.convolve(padded, offsets[::-1] / np.sum(offsets**2), mode="valid") / np.median(np.diff(time))


def courses(time, temperature, window):
    """(effect, what varies, column or columns)."""
    T = temperature - temperature.mean()
    duration = time[-1] - time[0]
    # The thermometer's own noise is not the sensor's temperature.
    smooth = low_pass(low_pass(T, time, window * np.median(np.diff(time)) / 4)[::-1], time, window * np.median(np.diff(time)) / 4)[::-1]
    yield "bias_temperature", None, smooth
    if np.ptp(smooth) > 3:
        yield "bias_temperature_sq", None, smooth**2
    yield "bias_temperature_rate", None, smooth_rate(smooth, time, window)
    for tau in duration * TAUS:
        yield "bias_thermal_lag", tau, low_pass(smooth, time, tau)
    yield "bias_drift_linear", 0.0, time - time.mean()
    for onset in np.quantile(time, np.arange(0.02, 0.99, 0.02)):
        yield "bias_step", onset, (time >= onset).astype(float)
        yield "bias_drift_linear", onset, np.clip(time - onset, 0, None)
    for tau in duration * TAUS:
        yield "bias_warmup", tau, np.exp(-(time - time[0]) / tau)


def penalty(effect, shape, rows):
    tried = {"bias_thermal_lag": len(TAUS), "bias_warmup": len(TAUS), "bias_step": 49, "bias_drift_linear": 50}.get(effect)
    return 0.5 * np.log(rows) + np.log(tried) if tried and shape != 0.0 else 0.0


def examine(report, case, time, temperature, readings, units, window, onsets):
    """`onsets`: rows at which the level of a reading changes, by its name."""
    report.case(case)["optional"] = sorted({effect for effect, *_ in courses(time, temperature, window)})
    for name, y in readings.items():
        steps = [(np.arange(len(y)) >= row).astype(float) for row in onsets.get(name, [])]
        beside = np.column_stack([np.ones(len(y)), *steps])
        null = Fit([(y, beside)], ORDER)
        tried = {}
        for effect, shape, column in courses(time, temperature, window):
            fit = Fit([(y, np.column_stack([column, beside]))], ORDER, rounds=4)
            gain = fit.log_likelihood - null.log_likelihood - penalty(effect, shape, len(y))
            tried.setdefault(effect, []).append((gain, fit.coefficients[0], fit.sigmas[0]))
        best = {effect: max(gain for gain, *_ in rows) for effect, rows in tried.items()}
        top = max(best.values())
        alike = [effect for effect, gain in best.items() if top > LEAST_NATS and gain > top - ALIKE_NATS]
        for effect, rows in tried.items():
            gains, values, sigmas = np.array(rows).T
            weights = np.exp(gains - best[effect])
            value = np.average(values, weights=weights)
            sigma = np.sqrt(np.average(sigmas**2 + (values - value) ** 2, weights=weights))
            unit = units[name] + {"bias_temperature": "/K", "bias_thermal_lag": "/K", "bias_temperature_sq": "/K^2",
                                  "bias_temperature_rate": "/(K/s)", "bias_drift_linear": "/s"}.get(effect, "")
            report.estimate(case, name, effect, "coefficient", value, sigma, unit, best[effect],
                            beside=sorted({effect} | ({"bias_step"} if steps else set())))
        if alike:
            report.allow(case, name, *alike)
            if {"bias_temperature", "bias_thermal_lag"} & set(alike):
                report.allow(case, name, "bias_temperature", "bias_thermal_lag", "bias_temperature_sq", "bias_temperature_cubic")
        report.allow(case, name, "noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_exp_cos",
                     "noise_variance_step", "noise_angle_quantisation", "quantisation", "noise_outliers")
        report.remark(case, f"{name}: {'alike: ' + ', '.join(alike) if alike else 'nothing'} (best {top:.1f} nats); autoregression "
                      f"{np.round(null.noise[0][0], 2).tolist()}")


def main():
    report = Report("thermal")
    raw = pd.read_csv(DATA / "accelerometer_thermal_ramp/icm42652_raw.csv.gz").to_numpy()
    # 50 samples are called one second.
    means = raw[:, 1:].reshape(-1, 50, 4).mean(axis=1)
    readings = dict(zip(["ax", "ay", "az"], means.T))
    examine(report, "accelerometer_thermal_ramp/ramp", np.arange(len(means)) * 1.0, means[:, 3], readings,
            dict.fromkeys(readings, "m/s^2"), 40, {})
    for log in ["cold", "hot"]:
        table = pd.read_csv(DATA / f"mems_hot_cold/{log}.csv.gz")
        # Means of 5 samples of 0.02 s: a tenth of a second is nothing to the temperature.
        rows = len(table) // 5 * 5
        values = table.to_numpy()[:rows].reshape(-1, 5, 8).mean(axis=1)
        readings = {f"g{a}": np.rad2deg(values[:, 5 + k]) for k, a in enumerate("xyz")}
        readings |= {f"a{a}": 4000 * values[:, 2 + k] for k, a in enumerate("xyz")}
        units = {name: "deg/s" if name[0] == "g" else "mg" for name in readings}
        # A level that changes within a tenth of a second is no temperature's doing.
        onsets = {}
        for name, y in readings.items():
            for k, size in allow_level_changes(report, f"mems_hot_cold/{log}", name, y, [1])[:1]:
                onsets[name] = [k]
                before, after = y[max(k - 10, 0) : k], y[k : k + 10]
                sigma = np.hypot(np.std(before), np.std(after)) / min(len(before), len(after)) ** 0.5
                report.estimate(f"mems_hot_cold/{log}", name, "bias_step", "coefficient", after.mean() - before.mean(),
                                sigma, units[name], onset_s=k / 10)
                report.remark(f"mems_hot_cold/{log}", f"{name}: level changes by {size:.4g} {units[name]} at {k / 10} s")
        # Lines are looked for at the full rate, about 50 Hz.
        full = table.to_numpy()
        for k, name in enumerate(["ax", "ay", "az", "gx", "gy", "gz"]):
            allow_line(report, f"mems_hot_cold/{log}", name, full[:, 2 + k], 0.02, 0.1)
        examine(report, f"mems_hot_cold/{log}", values[:, 0] / 50, values[:, 1], readings, units, 50, onsets)
    report.print()


if __name__ == "__main__":
    main()
