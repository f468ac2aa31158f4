"""Underwater vehicle: the Doppler log against the inertial system's velocity, turned into body axes.

y(t) = (1 + k) v(t - d) + v x e + w(t - d) x r + b + noise, for the log as one instrument: scale factor k, mounting e,
lever arm r, delay d (on a grid: the cubic spline through the reference is read at t - d), constants b. The noise of each
component is an autoregression of its own, whose innovations have a deviation of their own in each eighth of the angular
acceleration: the log is louder in turns.

The rate w is the derivative of a rotation spline through the attitude. The mean rate between the neighbours of a row, over
2 s, lacks the peaks of turns that last some seconds: with it the likelihood is 150 to 400 nats less, the arm along 3 to 8 %
longer and the arm down two to four times as long.

Mounting, scale factor and constants are fitted in every combination: at a speed that hardly changes a mounting about z and a
constant of y are nearly the same, so that the value of one is another beside the other. A name is right that stands out in a
combination which the log does not tell from the best one. Standard deviations count the delay's. All that with and without a scale factor
of the component down, and of the component across, beside the mounting -1.4 to -3.3 % in five of the six legs, 2 to 4 sigma in each: beside it the arm along
is 1 to 2 % longer.
"""

from itertools import product

import numpy as np
import pandas as pd
from common import ALIKE_NATS, DATA, LEAST_NATS, Fit, Report, cross_with_axes
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

ORDER = 4
EDGE = 6
# Half the distance over which the derivative by the delay is taken, s.
DELAY_STEP = 0.02
OPTIONAL = {
    "scale_factor": ["coefficient"],
    "misalignment": ["angle_x", "angle_y", "angle_z"],
    "bias_constant": ["coefficient_x", "coefficient_y", "coefficient_z"],
}
UNITS = {"lever_arm": "m", "misalignment": "rad", "scale_factor": "ppm", "bias_constant": "m/s"}
ARM = ["arm_x_m", "arm_y_m", "arm_z_m"]


def channels(leg, delay, beside=tuple(OPTIONAL), lever=True, across=False, down=False):
    velocity, rate = leg["velocity"](leg["t"] - delay), leg["rate"](leg["t"] - delay)
    rows = slice(EDGE, -EDGE)
    columns = [cross_with_axes(rate)] if lever else []
    columns += [velocity[:, :, None]] if "scale_factor" in beside else []
    columns += [cross_with_axes(velocity)] if "misalignment" in beside else []
    columns += [np.broadcast_to(np.eye(3), (len(rate), 3, 3))] if "bias_constant" in beside else []
    columns += [(velocity * [0, 1, 0])[:, :, None]] if across else []
    columns += [(velocity * [0, 0, 1])[:, :, None]] if down else []
    X, y = np.concatenate(columns, axis=2), leg["log"] - velocity
    return [(y[rows, axis], X[rows, axis]) for axis in range(3)]


def shaken(leg, delay):
    return np.linalg.norm(leg["turn"](leg["t"] - delay), axis=1)[EDGE:-EDGE]


def fitted(leg, delay, **options):
    return Fit(channels(leg, delay, **options), ORDER, shaken=shaken(leg, delay))


def best(leg, around=None, **options):
    """Likelihood on a grid of delays, then a parabola through its top: delay, fit."""
    if around is None:
        coarse = np.arange(-3.0, 1.01, 0.1)
        around = coarse[np.argmax([fitted(leg, d, **options).log_likelihood for d in coarse])]
    fine = around + np.arange(-0.1, 0.101, 0.02)
    likelihoods = [fitted(leg, d, **options).log_likelihood for d in fine]
    middle = int(np.clip(np.argmax(likelihoods), 2, len(fine) - 3))
    near = slice(middle - 2, middle + 3)
    a, b, _ = np.polyfit(fine[near] - fine[middle], likelihoods[near], 2)
    delay = fine[middle] - b / (2 * a)
    return delay, fitted(leg, delay, **options)


def with_delay(leg, delay, fit, **options):
    """The fit with one more column: what the delay changes."""
    def left(at):
        return [y - X @ fit.coefficients for y, X in channels(leg, at, **options)]
    slopes = [(late - early) / (2 * DELAY_STEP) for early, late in zip(left(delay - DELAY_STEP), left(delay + DELAY_STEP))]
    return Fit([(y, np.column_stack([X, -slope])) for (y, X), slope in zip(channels(leg, delay, **options), slopes)],
               ORDER, shaken=shaken(leg, delay))


def main():
    report = Report("auv_doppler_ins")
    for number in range(1, 7):
        table = pd.read_csv(DATA / f"auv_doppler_ins/leg{number:02}.csv")
        t = table.t_s.to_numpy()
        attitude = Rotation.from_euler("ZYX", table[["yaw_rad", "pitch_rad", "roll_rad"]].to_numpy())
        turning = RotationSpline(t, attitude)
        leg = {
            "t": t,
            "velocity": CubicSpline(t, attitude.inv().apply(table[["vn_mps", "ve_mps", "vd_mps"]].to_numpy())),
            "rate": lambda when: turning(np.clip(when, t[0], t[-1]), 1),
            "turn": lambda when: turning(np.clip(when, t[0], t[-1]), 2),
            "log": table[["dvl_x_mps", "dvl_y_mps", "dvl_z_mps"]].to_numpy(),
        }
        case = f"auv_doppler_ins/leg{number:02}"
        delay, fit = best(leg)
        gain = {"time_delay": fit.log_likelihood - fitted(leg, 0.0).log_likelihood,
                "lever_arm": fit.log_likelihood - best(leg, lever=False)[1].log_likelihood}
        report.case(case)["optional"] = list(OPTIONAL)
        scores = {}
        for *chosen, across, down in product([False, True], repeat=len(OPTIONAL) + 2):
            beside = [effect for effect, there in zip(OPTIONAL, chosen) if there]
            options = {"beside": beside, "across": across, "down": down}
            at, alone = best(leg, around=delay, **options)
            joint = with_delay(leg, at, alone, **options)
            scores[tuple(beside), across, down] = joint.score
            names = [("lever_arm", name) for name in ARM]
            names += [(effect, name) for effect in beside for name in OPTIONAL[effect]]
            names += [("scale_factor", "coefficient_y")] if across else []
            names += [("scale_factor", "coefficient_z")] if down else []
            for (effect, name), value, sigma in zip(names, joint.coefficients, joint.sigmas):
                sensor, scale, unit = "dvl", 1.0, UNITS[effect]
                if "_" in name and effect in ("bias_constant", "scale_factor"):
                    name, letter = name.split("_")
                    sensor = f"dvl_{letter}"
                if effect == "scale_factor":
                    scale = 1e6
                report.estimate(case, sensor, effect, name, scale * value, scale * sigma, unit, gain.get(effect), **options)
            report.estimate(case, "dvl", "time_delay", "delay_s", at, joint.sigmas[-1], "s", gain["time_delay"], **options)
        spread = [float(np.std(residual)) for residual in fit.residuals]
        raw = [float(np.std(y)) for y, _ in channels(leg, 0.0)]
        report.remark(case, f"standard deviation of the difference {np.round(raw, 4).tolist()} m/s, of what is left "
                      f"{np.round(spread, 4).tolist()} m/s; autoregressions {[np.round(n[0], 2).tolist() for n in fit.noise]}")
        # What is right of the log as an instrument, and of its axes.
        report.require(case, "dvl", "time_delay")
        report.require(case, "dvl", "lever_arm")
        for axis in "xyz":
            report.allow(case, f"dvl_{axis}", "noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_exp_cos",
                         "noise_variance_step", "noise_outliers", "noise_angle_quantisation")
        for row in report.case(case)["estimates"]:
            alike = scores[tuple(row["beside"]), row["across"], row["down"]] > max(scores.values()) - ALIKE_NATS
            if alike and row["gain_nats"] > LEAST_NATS and row["effect"] in OPTIONAL:
                report.allow(case, row["sensor"], row["effect"])
        alike = [structure for structure, score in scores.items() if score > max(scores.values()) - ALIKE_NATS]
        report.remark(case, "as good: " + "; ".join(
            ", ".join(beside) + " and y's scale" * across + " and z's scale" * down for beside, across, down in alike))
    report.print()


if __name__ == "__main__":
    main()
