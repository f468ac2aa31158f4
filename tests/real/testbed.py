"""Pump testbed: in each channel the row at which the level changes most, against the marks of those who staged the fault.

The noise is a first-order autoregression of each channel about its level, by the median of neighbouring stretches. At every row the
likelihood of a level before and another after is compared with that of one level (exact, from sums of the whitened series).
"""

import numpy as np
import pandas as pd
from common import DATA, SKAB, Report

NOISE = ["noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_angle_quantisation", "noise_variance_step",
         "noise_exp_cos", "noise_outliers", "quantisation"]
# Least rows on a side of a change, and nats from which one is said to be there.
LEAST_ROWS, LEAST_NATS = 20, 20.0
# Channels that creep all the time: no level to change.
CREEPING = ["motor_temperature", "fluid_temperature"]


def whitened(values):
    """First-order autoregression whose coefficient is that of the differences from a running median: levels do not count."""
    left = values - pd.Series(values).rolling(61, center=True, min_periods=1).median().to_numpy()
    rho = float(np.clip(left[1:] @ left[:-1] / max(left @ left, 1e-300), 0.0, 0.98))
    innovations = left[1:] - rho * left[:-1]
    return rho, max(1.4826 * np.median(np.abs(innovations)), innovations.std() / 3, 1e-12)


def gains(values):
    """Nats of another level from each row on."""
    rho, sigma = whitened(values)
    y = np.concatenate([[values[0] * (1 - rho)], values[1:] - rho * values[:-1]]) / sigma
    ones = np.full(len(y), (1 - rho) / sigma)
    # A level from row k on: 1 at k, 1 - rho after.
    tail_y, tail_1 = np.cumsum(y[::-1])[::-1], np.arange(len(y), 0, -1) - 1.0
    q = (1 - rho) / sigma
    step_y = y / sigma + q * (tail_y - y)
    step_step = 1 / sigma**2 + tail_1 * q**2
    step_one = q / sigma + tail_1 * q**2
    whole = ones @ ones
    cross = step_y - step_one * (ones @ y) / whole
    square = step_step - step_one**2 / whole
    gain = 0.5 * cross**2 / np.maximum(square, 1e-12)
    gain[:LEAST_ROWS], gain[len(y) - LEAST_ROWS :] = 0.0, 0.0
    return gain


def main():
    report = Report("skab_testbed")
    for path in sorted((DATA / "skab_testbed").glob("*.csv.gz")):
        name = path.name.split(".")[0]
        case, table = f"skab_testbed/{name}", pd.read_csv(path, sep=";")
        stamps = pd.to_datetime(table.datetime)
        seconds = (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy()
        marks = seconds[table.changepoint.to_numpy() > 0] if "changepoint" in table else np.array([])
        for sensor, (column, _) in SKAB.items():
            gain = gains(table[column].to_numpy(float))
            row = int(np.argmax(gain))
            report.allow(case, sensor, *NOISE)
            if sensor in CREEPING:
                report.allow(case, sensor, "bias_step", "bias_drift_linear", "bias_warmup", "bias_on_aux", "bias_temperature")
                continue
            if gain[row] < LEAST_NATS:
                continue
            # Rows within two nats of the best say how well the onset is known.
            near = np.flatnonzero(gain > gain[row] - 2)
            spread = max(float(np.ptp(seconds[near])) / 2, 1.0)
            report.estimate(case, sensor, "bias_step", "onset_s", seconds[row], spread, "s", gain=gain[row])
            # A level that comes and goes, or creeps, is described as well by these.
            report.allow(case, sensor, "bias_step", "bias_drift_linear", "bias_warmup", "intermittent_jump", "bias_on_aux")
            if len(marks):
                apart = marks[np.argmin(np.abs(marks - seconds[row]))] - seconds[row]
                report.remark(case, f"{sensor}: level changes at {seconds[row]:.0f} s ({gain[row]:.0f} nats), the nearest mark is {apart:+.0f} s from it")
            else:
                report.remark(case, f"{sensor}: level changes at {seconds[row]:.0f} s ({gain[row]:.0f} nats); no mark in this file")
        report.case(case)["marks_s"] = marks.tolist()
    report.print()


if __name__ == "__main__":
    main()
