"""Static MEMS: noise structure by Whittle likelihood, lines in the spectrum, against the nominal white level.

Nothing is known here but noise: no temperature was recorded. So the only right names are those of noise structure, a line
where one stands out, jumps where the level changes more than Gaussian noise does, and a slow drift where a random walk or long
Markov process does as well.
"""

import numpy as np
import pandas as pd
from common import DATA, STANDARD_GRAVITY, Report
from spectrum import allan, allow_level_changes, strongest_line, structures, without_changes

# What other parts of the noise are named: the white level that is left is another beside each of them.
EFFECTS = {"markov": "noise_markov", "walk": "noise_random_walk", "flicker": "noise_flicker", "exp_cos": "noise_exp_cos"}
LEVELS = ["intermittent_jump", "bias_step"]
COUNTS = [8.726646e-4] * 3 + [0.0326561] * 3


def recordings():
    for run in range(1, 4):
        table = pd.read_csv(DATA / f"mems_static/run{run}_1Hz.csv.gz")
        yield f"mems_static/run{run}", 1.0, table.to_numpy()[:, 1:], [7e-4] * 3 + [6e-3] * 3
    counts = pd.read_csv(DATA / "mems_static/run1_raw_100Hz_first_3000s.csv.gz").to_numpy(float) * COUNTS
    means = counts.reshape(-1, 10, 6).mean(axis=1)
    yield "mems_static/run1_10Hz", 0.1, means, [0.9 * np.pi / 180 / 10**0.5] * 3 + [9e-3 * STANDARD_GRAVITY / 10**0.5] * 3


def main():
    report = Report("mems_static")
    for case, step, values, nominal in recordings():
        for name, column, white in zip(["gx", "gy", "gz", "ax", "ay", "az"], values.T, nominal):
            unit = "rad/s" if name[0] == "g" else "m/s^2"
            frequency, ratio, false_alarm = strongest_line(column, step, 0.1)
            extra = []
            if false_alarm < 0.001:
                # A line that wanders is a narrow exponential-cosine.
                extra = [("exp_cos", [0.3 * np.std(column), 0.003, 2 * np.pi * frequency])]
                report.allow(case, name, "periodic_line", "noise_exp_cos")
                report.require(case, name, "periodic_line|noise_exp_cos")
            # Five to twenty seconds are above the line's period and below all slow parts.
            changes = allow_level_changes(report, case, name, column, [round(s / step) for s in (5, 10, 20)])
            best = structures(column, step, extra)
            score, structure, parts, likelihood, parameters, deviations = best[0]
            gain = likelihood - [row for row in best if row[1] == "white"][0][3]
            report.case(case)["optional"] = [*EFFECTS.values(), *LEVELS]
            # Beside changes of the level as well, in which the names of these do not matter.
            left = structures(without_changes(column, changes), step, extra) if changes else []
            for fits, beside in [(best, []), (left, LEVELS[:1]), (left, LEVELS[1:]), (left, LEVELS)]:
                for _, _, others, _, fitted, spreads in fits:
                    sigma = fitted[0] * spreads[0]
                    effects = {EFFECTS[part if isinstance(part, str) else part[0]] for part in others}
                    report.estimate(case, name, "noise_white", "sigma", fitted[0], sigma, unit,
                                    gain=0.5 * ((fitted[0] - white) / sigma) ** 2, beside=sorted(effects | set(beside)))
            k = 1
            for part in parts:
                p, d = parameters[k:], deviations[k:]
                if part == "markov":
                    report.estimate(case, name, "noise_markov", "sigma", p[0], p[0] * d[0], unit, gain=gain)
                    report.estimate(case, name, "noise_markov", "tau_s", p[1], p[1] * d[1], "s", gain=gain)
                    k += 2
                elif part == "walk":
                    report.estimate(case, name, "noise_random_walk", "coefficient", p[0], p[0] * d[0], f"{unit}/sqrt(s)", gain=gain)
                    k += 1
                elif part[0] == "flicker":
                    # Its level is said in as many ways as there are programs.
                    k += 1
                else:
                    line = {"peak_over_median": float(ratio)}
                    report.estimate(case, name, "noise_exp_cos", "sigma", p[0], p[0] * d[0], unit, gain=ratio, **line)
                    report.estimate(case, name, "noise_exp_cos", "alpha", p[1], p[1] * d[1], "1/s", gain=ratio, **line)
                    width = max(p[1] / (2 * np.pi), 1 / (len(column) * step))
                    report.estimate(case, name, "periodic_line", "frequency_hz", frequency, width, "Hz", gain=ratio, **line)
                    k += 3
            report.allow(case, name, "noise_white", "noise_markov", "noise_random_walk", "noise_flicker",
                         "noise_angle_quantisation", "noise_variance_step", "noise_exp_cos", "noise_outliers")
            # A slow part is as well a drift over the record; a wandering one has steps.
            if structure != "white":
                report.allow(case, name, "bias_drift_linear", "bias_warmup", "bias_step")
            report.remark(case, f"{name}: {structure}{' + line' if extra else ''}, level changes: {len(changes)}, "
                          f"Allan deviation {[float(f'{allan(column, m):.2g}') for m in (1, 10, 100, 1000)]} {unit}")
    report.print()


if __name__ == "__main__":
    main()
