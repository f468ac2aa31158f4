"""Maximum likelihood of a noise model in the frequency domain (Whittle), and lines that stand out of the spectrum."""

import numpy as np
from scipy import optimize, signal, stats
from scipy.ndimage import median_filter


def periodogram(values, step):
    """One-sided spectral density of the linearly detrended values, without frequency zero."""
    frequency, power = signal.periodogram(signal.detrend(values), 1 / step)
    return frequency[1:-1], power[1:-1]


def markov(frequency, step, sigma, tau):
    """Density of a sampled first-order Markov process."""
    a = np.exp(-step / tau)
    return 2 * step * sigma**2 * (1 - a * a) / (1 - 2 * a * np.cos(2 * np.pi * frequency * step) + a * a)


def walk(frequency, step, q):
    """Density of a sampled random walk of q per root second."""
    return 2 * step * q**2 * step / (4 * np.sin(np.pi * frequency * step) ** 2)


def flicker(frequency, level, step, ends_steps):
    """Density level^2/f: falls slowly enough for its aliases to count little. Falls with 1/f^2 above the frequency to which the
    shortest correlation time belongs, if there is one: the white level beside it is another by up to 12 %."""
    ends = 1 / (2 * np.pi * ends_steps * step) if ends_steps else np.inf
    return level**2 / frequency / (1 + (frequency / ends) ** 2) ** 0.5


def exponential_cosine(frequency, step, sigma, alpha, beta):
    """Density of R = s^2 exp(-alpha tau) cos(beta tau), sampled: two shifted Markov lines."""
    a = np.exp(-alpha * step)
    def line(angle):
        return (1 - a * a) / (1 - 2 * a * np.cos(angle) + a * a)
    angle = 2 * np.pi * frequency * step
    return step * sigma**2 * (line(angle - beta * step) + line(angle + beta * step))


# Shortest correlation times of flicker, steps; none: it does not end.
FLICKER_ENDS = [None, 2, 6]
MODELS = [
    ("white", []),
    ("white + markov", ["markov"]),
    ("white + random walk", ["walk"]),
    ("white + markov + random walk", ["markov", "walk"]),
    ("white + two markov", ["markov", "markov"]),
]
MODELS += [
    (f"white + flicker{more}", [("flicker", ends_steps), *parts])
    for more, parts in [("", []), (" + markov", ["markov"]), (" + random walk", ["walk"])]
    for ends_steps in FLICKER_ENDS
]


def density(parameters, parts, frequency, step):
    p = np.exp(parameters)
    total, k = np.full_like(frequency, 2 * step * p[0] ** 2), 1
    for part in parts:
        if part == "markov":
            total += markov(frequency, step, p[k], p[k + 1])
            k += 2
        elif part == "walk":
            total += walk(frequency, step, p[k])
            k += 1
        elif part[0] == "flicker":
            total += flicker(frequency, p[k], step, part[1])
            k += 1
        else:
            total += exponential_cosine(frequency, step, p[k], p[k + 1], p[k + 2])
            k += 3
    return total


def fit(frequency, power, step, parts, start):
    """Log-likelihood, parameters and their relative standard deviations; `start` are the parameters to start from."""
    def cost(parameters):
        model = density(parameters, parts, frequency, step)
        return np.sum(np.log(model) + power / model)
    found = optimize.minimize(cost, np.log(start), method="Nelder-Mead",
                              options={"maxiter": 4000, "maxfev": 4000, "xatol": 1e-5, "fatol": 1e-4})
    # The information of a Gaussian process: sum over frequencies of the squared derivatives of the log-density.
    steps = 1e-4 * np.eye(len(found.x))
    derivative = [
        np.log(density(found.x + h, parts, frequency, step) / density(found.x - h, parts, frequency, step)) / 2e-4
        for h in steps
    ]
    information = np.array([[np.sum(a * b) for a in derivative] for b in derivative])
    return -found.fun, np.exp(found.x), np.sqrt(np.abs(np.diag(np.linalg.pinv(information, hermitian=True))))


def structures(values, step, extra=()):
    """All models of MODELS, with `extra` parts (name, start) added to each, as (BIC-like score, name, fit), best first."""
    frequency, power = periodogram(values, step)
    spread, white = np.std(values), np.sqrt(np.mean(power[len(power) * 3 // 4 :]) / (2 * step))
    duration, fits = len(values) * step, []
    for name, parts in MODELS:
        start, taus = [white], iter([duration / 20, duration / 200])
        for part in parts:
            if part == "markov":
                start += [0.7 * spread, next(taus)]
            else:
                start.append(0.3 * spread / np.sqrt(duration / 10) if part == "walk" else 0.3 * spread)
        extras = [part for part, _ in extra]
        start += [number for _, numbers in extra for number in numbers]
        likelihood, values_, deviations = fit(frequency, power, step, parts + extras, start)
        score = -likelihood + 0.5 * len(start) * np.log(len(frequency))
        fits.append((score, name, parts + extras, likelihood, values_, deviations))
    return sorted(fits, key=lambda row: row[0])


def strongest_line(values, step, lowest_hz):
    """Frequency, power over the local median's mean, and false-alarm probability of the highest peak."""
    frequency, power = periodogram(values, step)
    ratio = power / (median_filter(power, 401) / np.log(2))
    ratio[frequency < lowest_hz] = 0.0
    top = int(np.argmax(ratio))
    false_alarm = -np.expm1(len(ratio) * np.log1p(-np.exp(-ratio[top]))) if ratio[top] < 700 else 0.0
    return frequency[top], ratio[top], false_alarm


def allow_line(report, case, name, values, step, lowest_hz):
    """Names a line right where one stands out of the spectrum, whatever its cause."""
    frequency, ratio, false_alarm = strongest_line(values, step, lowest_hz)
    if false_alarm < 0.01:
        report.allow(case, name, "periodic_line", "noise_exp_cos")
        report.estimate(case, name, "periodic_line", "frequency_hz", frequency, 1 / (len(values) * step), "Hz", gain=ratio)
        report.remark(case, f"{name}: line at {frequency:.6g} Hz, {ratio:.0f} times the median, false alarm {false_alarm:.1g}")


def allan(values, factor):
    means = values[: len(values) // factor * factor].reshape(-1, factor).mean(axis=1)
    return np.sqrt(0.5 * np.mean(np.diff(means) ** 2))


def slope(values, step):
    return stats.linregress(np.arange(len(values)) * step, values)


def level_changes(values, lengths):
    """Places and sizes of changes of level that Gaussian noise of any spectrum would hardly show, largest first.

    At every row the mean of the `length` values from there on is compared with that of as many before, for each of `lengths`;
    a change counts beyond the quantile of 0.1 % for all rows and lengths, in standard deviations by the median. Means of fixed
    stretches, compared with their neighbours, see a change in the middle of a stretch by half.
    """
    sums, found = np.concatenate([[0.0], np.cumsum(values)]), []
    for length in lengths:
        rows = np.arange(length, len(values) - length + 1)
        change = (sums[rows + length] - 2 * sums[rows] + sums[rows - length]) / length
        sigma = np.median(np.abs(change - np.median(change))) / stats.norm.ppf(0.75)
        # Readings of few steps may have no spread at all.
        sigma = max(sigma, np.std(change) / 10)
        ratio = np.abs(change) / sigma
        beyond = stats.norm.isf(0.5e-3 / (len(rows) * len(lengths)))
        found += [(ratio[k], int(rows[k]), float(change[k]), length) for k in np.flatnonzero(ratio > beyond)]
    changes = []
    for _, row, size, length in sorted(found, reverse=True):
        # What is nearer than a window is the same change.
        if all(abs(row - other) > max(length, reach) for other, _, reach in changes):
            changes.append((row, size, length))
    return [(row, size) for row, size, _ in changes]


def without_changes(values, changes):
    """What is left of the values when their level has not changed."""
    left = values.copy()
    for row, size in changes:
        left[row:] -= size
    return left


def allow_level_changes(report, case, name, values, lengths):
    """Names for levels that change, of which a jump that comes and goes takes two; the changes, largest first."""
    changes = level_changes(values, lengths)
    if changes:
        report.allow(case, name, "bias_step")
    if len(changes) > 1:
        report.allow(case, name, "intermittent_jump")
    return changes
