"""Compares an identification with statsmodels, allantools and scipy.

    check_identify.py IDENTIFICATION.json TABLE.csv[.gz]

IDENTIFICATION.json is the answer of `schuler identify --json` for the table. Everything that these packages compute as
well must agree to 1e-9: least squares, autocorrelation, overlapping Allan deviation, kind of noise, equivalent degrees of
freedom, bounds of the intervals. In short recordings the log-likelihoods are compared with those of the covariance
matrices. Prints the largest deviation of each, and ends with status 1 if one is too large.
"""

import gzip
import json
import sys
import warnings

import allantools
import numpy as np
import pandas as pd
import scipy.linalg
import scipy.stats
from statsmodels.tsa.stattools import acf, acovf

TOLERANCE = 1e-9
# An autocorrelation near zero is a difference of large numbers on both sides: those below this part of R_0 are compared
# as if they had this size.
SMALLEST_CORRELATION = 1e-3
GAP_STEPS = 1.5
LEAST_PRESENT, LEAST_VALUES = 0.25, 2
ONE_SIGMA = 0.682689492137085897
LONGEST_MATRIX = 2500

worst = {}


def compare(what, found, expected, scale=None):
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    if found.shape != expected.shape:
        sys.exit(f"{what}: {found.shape} values, expected {expected.shape}")
    if not np.array_equal(np.isnan(found), np.isnan(expected)):
        sys.exit(f"{what}: missing at other places than expected")
    size = np.abs(expected) if scale is None else np.maximum(np.abs(expected), scale)
    difference = np.abs(found - expected)
    relative = np.divide(difference, size, out=np.zeros_like(difference), where=difference > 0)
    largest = float(np.nanmax(relative, initial=0.0))
    count, before = worst.get(what, (0, 0.0))
    worst[what] = (count + found.size, max(before, largest))


def on_the_grid(time, values, step):
    """The documented rule for gaps: rows are put in between neighbours more than 1.5 steps apart."""
    filled_time, filled = [time[0]], [values[0]]
    for before, after, value in zip(time, time[1:], values[1:]):
        if after - before > GAP_STEPS * step:
            missing = max(int(np.floor((after - before) / step + 0.5)) - 1, 1)
            filled_time += [before + (after - before) / (missing + 1) * (k + 1) for k in range(missing)]
            filled += [np.nan] * missing
        filled_time.append(after)
        filled.append(value)
    return np.array(filled_time), np.array(filled)


def overlapping_allan_over_gaps(values, factor):
    """The definition, for means over `factor` steps of which a quarter is there; what lost values add is taken off each square."""
    windows = np.lib.stride_tricks.sliding_window_view(values, factor)
    present = np.isfinite(windows).sum(axis=1)
    with warnings.catch_warnings(), np.errstate(invalid="ignore", divide="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        means = np.nanmean(windows, axis=1)
        excess = np.nanvar(windows, axis=1, ddof=1) * (1 / present - 1 / factor)
    excess[present == factor] = 0.0
    usable = present >= (1 if factor == 1 else max(LEAST_VALUES, LEAST_PRESENT * factor))
    early, late = slice(None, -factor), slice(factor, None)
    both = usable[early] & usable[late]
    squares = ((means[late] - means[early]) ** 2 - excess[early] - excess[late])[both]
    weights = (present[early] * present[late] / (present[early] + present[late]))[both]
    return np.sqrt(0.5 * np.average(squares, weights=weights)), np.count_nonzero(both)


def degrees_of_freedom(count, factor, exponent):
    if exponent == -1 and factor == 1:
        # Howe, Allan and Barnes (1981); SP 1065 and allantools lack the square.
        return max(2 * (count - 2) ** 2 / (2.3 * count - 4.9), 1.0)
    with np.errstate(invalid="ignore"):
        return max(float(np.nan_to_num(allantools.ci.edf_simple(count, factor, exponent), nan=1.0)), 1.0)


def check_allan(sensor, values, step):
    points = sensor["allan"]
    factors = np.array([point["factor"] for point in points])
    complete = bool(np.isfinite(values).all())
    if complete:
        taus, deviations, _, terms = allantools.oadev(
            values, rate=1.0 / step, data_type="freq", taus=factors * step
        )
        compare("averaging time", [point["tau_s"] for point in points], taus)
        name = "overlapping Allan deviation (allantools.oadev)"
    else:
        centred = values - np.nanmean(values)
        deviations, terms = np.array([overlapping_allan_over_gaps(centred, m) for m in factors]).T
        name = "overlapping Allan deviation over gaps (definition)"
    compare(name, [point["deviation"] for point in points], deviations)
    compare("terms of the Allan deviation", [point["terms"] for point in points], terms)
    previous = 0
    for point, deviation, count in zip(points, deviations, terms):
        factor = point["factor"]
        if complete:
            if len(values) // factor >= 30:
                previous = int(np.clip(allantools.ci.autocorr_noise_id(values, factor, "freq")[0], -2, 2))
            compare("kind of noise (allantools.autocorr_noise_id)", point["exponent"], previous)
        degrees = degrees_of_freedom(int(count) + 2 * factor, factor, point["exponent"])
        degrees = max(degrees * float(np.isfinite(values).mean()), 1.0)
        compare("degrees of freedom (allantools.edf_simple)", point["degrees_of_freedom"], degrees)
        for bound, probability in (("lower", 0.5 + ONE_SIGMA / 2), ("upper", 0.5 - ONE_SIGMA / 2)):
            expected = deviation * np.sqrt(degrees / scipy.stats.chi2.ppf(probability, degrees))
            compare("bounds (scipy.stats.chi2)", point[bound], expected)


def check_autocorrelation(sensor, values):
    report = sensor["autocorrelation"]
    # About the first value, which is exact for neighbours in size: statsmodels loses the digits of a spread that is a
    # millionth of the mean.
    values = values - values[np.isfinite(values)][0]
    lags = len(report["covariance"]) - 1
    options = {"adjusted": True, "nlags": lags, "fft": False, "missing": "conservative"}
    correlation = acf(values, **options)
    options["nlag"] = options.pop("nlags")
    covariance = acovf(values, **options)
    scale = SMALLEST_CORRELATION * covariance[0]
    compare("autocovariance (statsmodels.acovf)", report["covariance"], covariance, scale)
    compare("autocorrelation (statsmodels.acf)", report["correlation"], correlation, SMALLEST_CORRELATION)


def check_trend(sensor, time, values):
    present = np.isfinite(values)
    time, values = time[present] - time[0], values[present]
    line = scipy.stats.linregress(time, values)
    trend = sensor["trend"]
    deviation = np.std(values, ddof=1)
    compare("mean (numpy)", trend["mean"], np.mean(values), deviation)
    compare("deviation (numpy)", trend["deviation"], deviation)
    # The slope is known to its standard error; where it is far below that, so is what is left of its digits.
    compare("slope (scipy.stats.linregress)", trend["slope_per_s"], line.slope, line.stderr)
    compare("intercept (scipy.stats.linregress)", trend["intercept"], line.intercept, line.intercept_stderr)
    residual = values - line.intercept - line.slope * time
    compare("deviation about the line", trend["deviation_about_line"], np.sqrt(residual @ residual / (len(time) - 2)))


def restricted_log_likelihood(model, values, step, line):
    """Of the data's contrasts, from the covariance matrix at the reported parameters; the scale is theirs as well."""
    rows = np.flatnonzero(np.isfinite(values))
    lag = np.abs(rows[:, None] - rows[None, :]) * step
    covariance = model["white"]["value"] ** 2 * np.eye(len(rows))
    for part in model["markov"]:
        covariance += part["sigma"]["value"] ** 2 * np.exp(-lag / part["tau_s"]["value"])
    if part := model["exp_cos"]:
        damped = np.exp(-part["alpha"]["value"] * lag) * np.cos(part["beta"]["value"] * lag)
        covariance += part["sigma"]["value"] ** 2 * damped
    if walk := model["random_walk"]:
        covariance += walk["value"] ** 2 * np.minimum(rows[:, None], rows[None, :]) * step
    regressors = np.ones((len(rows), 1 + line))
    if line:
        regressors[:, 1] = rows - 0.5 * (len(values) - 1)
    factor = scipy.linalg.cholesky(covariance, lower=True)
    white = scipy.linalg.solve_triangular(factor, values[rows] - np.nanmean(values), lower=True)
    whitened = scipy.linalg.solve_triangular(factor, regressors, lower=True)
    coefficients, *_ = np.linalg.lstsq(whitened, white, rcond=None)
    residual = white - whitened @ coefficients
    _, log_normal = np.linalg.slogdet(whitened.T @ whitened)
    contrasts = len(rows) - regressors.shape[1]
    log_determinant = 2 * np.log(np.diag(factor)).sum()
    return -0.5 * (contrasts * np.log(2 * np.pi) + log_determinant + log_normal + residual @ residual)


def check_likelihoods(sensor, values, step):
    structure = sensor["structure"]
    if len(values) > LONGEST_MATRIX or structure["averaged_steps"] != 1:
        return
    line = structure["removed"] == "line"
    models = structure["models"]
    likelihoods = [restricted_log_likelihood(model, values, step, line) for model in models]
    white = likelihoods[[model["name"] for model in models].index("white")]
    gains = [likelihood - white for likelihood in likelihoods]
    # A log-likelihood is a sum over all values: its rounding is relative to them, not to the gain.
    compare("gain in log-likelihood (covariance matrix)", [m["gain_nats"] for m in models], gains, len(values))


def main():
    identification_path, table_path = sys.argv[1:]
    with open(identification_path, encoding="utf-8") as file:
        identification = json.load(file)
    opener = gzip.open if table_path.endswith(".gz") else open
    with opener(table_path, "rt", encoding="utf-8") as file:
        table = pd.read_csv(file, float_precision="round_trip")
    step = identification["step_s"]
    recorded_time = table[identification["time_column"]].to_numpy(float)
    checked = 0
    for sensor in identification["sensors"]:
        subtracted = sensor["subtracted"]
        if subtracted["what"] == "motion":
            print(f"{sensor['id']}: SKIPPED, its motion is subtracted")
            continue
        readings = table[sensor["column"]].to_numpy(float) * sensor["written_unit_in_si"]
        time, values = on_the_grid(recorded_time, readings, step)
        values = values - subtracted.get("value", 0.0)
        if len(values) != identification["rows"]:
            sys.exit(f"{identification['rows']} rows, expected {len(values)}")
        check_trend(sensor, time, values)
        check_autocorrelation(sensor, values)
        check_allan(sensor, values, step)
        check_likelihoods(sensor, values, step)
        checked += 1
    failed = False
    for what, (count, largest) in worst.items():
        failed |= not largest <= TOLERANCE
        print(f"{'ok  ' if largest <= TOLERANCE else 'FAIL'} {what}: {count} values, largest deviation {largest:.1e}")
    print(f"{checked} sensors checked")
    sys.exit(1 if failed or checked == 0 else 0)


if __name__ == "__main__":
    warnings.filterwarnings("ignore", message="overflow encountered")
    main()
