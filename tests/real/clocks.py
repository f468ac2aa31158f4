"""Clocks: the deviations of Stable32, which others computed and the set has beside its data, described by three parts of noise.

Overlapping Allan variance: white phase 3 x^2 / tau^2, white frequency a^2 / tau, flicker frequency f^2; least squares of logarithms
over the factors of the table, and the same for our own overlapping Allan deviation of the phase, so that the reading of the table
and of the phase are compared as well.
"""

import numpy as np
import pandas as pd
from common import DATA, Report
from scipy import optimize

NOISE = ["noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_angle_quantisation", "noise_variance_step",
         "noise_exp_cos", "noise_outliers"]
# What is one count of the case, of the fractional frequency.
COUNT = 1e-12


def stable32(name):
    rows = [line.split() for line in (DATA / f"allantools_clocks/{name}").read_text().splitlines() if line[:1] != "#" and line.strip()]
    table = np.array([[float(row[0]), float(row[1]), float(row[5])] for row in rows])
    return table[:, 0].astype(int), table[:, 2]


def overlapping(phase, factor):
    second = phase[2 * factor :] - 2 * phase[factor:-factor] + phase[: -2 * factor]
    return np.sqrt(0.5 * np.mean(second**2)) / factor


def parts(taus, deviations):
    """White phase (s), white frequency and flicker floor, with standard deviations."""
    def model(p):
        x, a, f = np.exp(p)
        return 0.5 * np.log(3 * x**2 / taus**2 + a**2 / taus + f**2)
    # What the parts miss is more than chance: all factors weigh alike, and their scatter is the uncertainty.
    start = np.log([deviations[0] / 3**0.5, deviations[-1] * taus[-1] ** 0.5, deviations[-1] / 3])
    found = optimize.least_squares(lambda p: model(p) - np.log(deviations), start)
    # Neighbouring factors share their data: what they say is worth one in an octave.
    worth = len(taus) / np.log2(taus[-1] / taus[0])
    share = np.sqrt(worth * 2 * found.cost / len(taus) * np.diag(np.linalg.pinv(found.jac.T @ found.jac)))
    return np.exp(found.x), np.exp(found.x) * share, np.exp(model(found.x)) / deviations


def main():
    report = Report("allantools_clocks")
    for clock, table in [("cs5071a", "reference_Cs5071A_oadev_all.txt"), ("gps_1pps", None)]:
        case = f"allantools_clocks/{clock}"
        phase = pd.read_csv(DATA / f"{case}_phase.txt.gz", comment="#", header=None).iloc[:, 0].to_numpy(float)
        factors = np.unique(np.geomspace(1, len(phase) // 6, 40).astype(int))
        own = np.array([overlapping(phase, m) for m in factors])
        if table:
            theirs = dict(zip(*stable32(table)))
            both = [(m, d) for m, d in zip(factors, own) if m in theirs]
            apart = max(abs(d / theirs[m] - 1) for m, d in both)
            report.remark(case, f"our overlapping Allan deviation is within {100 * apart:.2g} % of Stable32's at {len(both)} factors")
            nearest = [min(theirs, key=lambda m: abs(np.log(m / wanted))) for wanted in factors]
            factors, own = np.unique(nearest), np.array([theirs[m] for m in np.unique(nearest)])
        (x, a, f), sigmas, ratio = parts(factors.astype(float), own)
        report.allow(case, "frequency", *NOISE)
        report.require(case, "frequency", "noise_angle_quantisation|noise_white")
        for effect, name, value, sigma, unit in [
            ("noise_angle_quantisation", "sigma", x, sigmas[0], "1e-12 s"),
            ("noise_white", "sigma", a, sigmas[1], "1e-12"),
            ("noise_flicker", "floor", f, sigmas[2], "1e-12"),
        ]:
            # A part that is below every deviation is not seen.
            if value > 0.1 * own.min():
                report.estimate(case, "frequency", effect, name, value / COUNT, sigma / COUNT, unit)
        # A straight line in frequency is the clock's ageing.
        seconds = np.arange(1, len(phase)) - len(phase) / 2
        ageing = np.polyfit(seconds, np.diff(phase), 1)[0]
        # Of white phase the line's own scatter; of white frequency more.
        spread = a * np.sqrt(12.0 / len(phase) ** 3)
        report.estimate(case, "frequency", "bias_drift_linear", "coefficient", 3600 * ageing / COUNT, 3600 * spread / COUNT, "1e-12/h")
        if abs(ageing) > 5 * spread:
            report.allow(case, "frequency", "bias_drift_linear")
        report.remark(case, f"white phase {x:.3g} s, white frequency {a:.3g}, flicker floor {f:.3g}; these three are {ratio.min():.2f} to "
                      f"{ratio.max():.2f} of the deviations; ageing {ageing * 86400:.2g} ± {spread * 86400:.1g} a day")
    report.print()


if __name__ == "__main__":
    main()
