"""Inertial units against a reference of attitude and velocity: a vehicle, a hand before cameras, a car.

    motion.py FOLDER      # with the tables of make_cases.py

For each sensor with the axis a: reading = a.u + k a.u + m.u + b - d a.du/dt (+ a.(w' x r + w x (w x r)) for an
accelerometer at r from the reference), u the reference's rate or specific force. Then the same for the three gyros and the
three accelerometers together, with one delay, one lever arm and one turned mounting. Of each sensor b, k and the two elements of m across
its axis are fitted in every combination: gravity on an axis that stays upright is a constant, its scale factor and, on one across
it, a mounting. A name is right that stands out in a combination which the data do not tell from the best one.

Derivatives are those of a cubic spline, or differences over two steps where these come nearer to the readings: the difference is
smaller than the derivative of what sways within a few steps (at 2.5 Hz and steps of 0.1 s by 0.6), the spline louder where the
reference is noise. So it is for each sensor by itself: of the vehicle's accelerometers the one along the vertical sways
(0.127 m/s^2 from the spline, 0.144 from the difference) and the others do not (0.145 and 0.125, 0.142 and 0.111); the cameras'
rates are 0.08 and 0.15 rad/s from the readings. With differences alone the vehicle's arm along comes out at -0.39 m instead of -0.07.
"""

import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from common import ALIKE_NATS, LEAST_NATS, Fit, Report, cross_with_axes, held_out_gain
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

ORDER = 8
FEWEST_OF_SPLINE = 4
CASES = {
    "vehicle_fog_mems/vehicle": (34.432, 172.3, "mems", {"x": [0, 1, 0], "y": [1, 0, 0], "z": [0, 0, -1]}),
    "optical_reference/trial_01": (52.5, 50.0, "imu", {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}),
    "car_imu_rtk/drive": (40.099, 1592.0, "imu", {"x": [-1, 0, 0], "y": [0, 1, 0], "z": [0, 0, -1]}),
}
# The course of an antenna ahead of the rear axle leads the yaw by l w'/v: no more tells a delay from a lag.
COURSE = ["car_imu_rtk/drive"]


def stretches(known):
    """Rows of each stretch that is known and long enough for a spline."""
    rows = np.flatnonzero(known)
    return [part for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(part) >= FEWEST_OF_SPLINE]


def over_two_steps(difference, t, known):
    """`difference` of the rows after and before each, by its time; NaN where one is not known."""
    out = np.full((len(t), 3), np.nan)
    inner = known[2:] & known[:-2]
    out[1:-1] = np.where(inner[:, None], difference / (t[2:] - t[:-2])[:, None], np.nan)
    return out


def rate_of_turn(t, attitude, known, by_difference):
    """In body axes."""
    if by_difference:
        return over_two_steps((attitude[:-2].inv() * attitude[2:]).as_rotvec(), t, known)
    rate = np.full((len(t), 3), np.nan)
    for part in stretches(known):
        rate[part] = RotationSpline(t[part], attitude[part])(t[part], 1)
    return rate


def reference(table, latitude_deg, altitude, by_difference):
    """Time, rate and specific force in body axes; NaN where the attitude is not known."""
    t = table.t_s.to_numpy()
    angles = table[["yaw", "pitch", "roll"]].to_numpy()
    velocity = table[["vn", "ve", "vd"]].to_numpy()
    known = np.isfinite(angles).all(axis=1)
    attitude = Rotation.from_euler("ZYX", np.where(known[:, None], angles, 0.0))
    turn = rate_of_turn(t, attitude, known, by_difference)
    acceleration = derivative(velocity, t, by_difference)
    latitude = np.radians(latitude_deg)
    sine = np.sin(latitude) ** 2
    gravity = 9.7803267715 * (1 + 0.0052790414 * sine + 0.0000232718 * sine**2) - 3.086e-6 * altitude
    earth = 7.292115e-5 * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    north, east = velocity[:, 0] / 6.36e6, velocity[:, 1] / 6.38e6
    transport = np.column_stack([east, -north, -east * np.tan(latitude)])
    rate = turn + attitude.inv().apply(earth + transport)
    force = attitude.inv().apply(acceleration + np.cross(2 * earth + transport, velocity) - [0.0, 0.0, gravity])
    force[~known] = np.nan
    return t, rate, force


def derivative(u, t, by_difference):
    """Of a cubic spline through each stretch of rows that are known, or over two steps."""
    known = np.isfinite(u).all(axis=1)
    if by_difference:
        return over_two_steps(u[2:] - u[:-2], t, known)
    out = np.full_like(u, np.nan)
    for part in stretches(known):
        out[part] = CubicSpline(t[part], u[part])(t[part], 1)
    return out


class Motion:
    """What gyros and accelerometers should read, how it changes, and what an accelerometer reads off the reference's place."""

    def __init__(self, table, latitude_deg, altitude, by_difference):
        self.t, rate, force = reference(table, latitude_deg, altitude, by_difference)
        angular = derivative(rate, self.t, by_difference)
        self.input = {"gyro": rate, "accelerometer": force}
        self.change = {"gyro": angular, "accelerometer": derivative(force, self.t, by_difference)}
        self.lever = np.stack([np.cross(angular, e) + np.cross(rate, np.cross(rate, e)) for e in np.eye(3)], axis=2)


def nearest(motions, kind, axis, readings):
    """The motion whose readings deviate least, over the rows that all know."""
    left = [readings - motion.input[kind] @ axis for motion in motions]
    known = np.isfinite(left).all(axis=0)
    return motions[int(np.argmin([np.std(residual[known]) for residual in left]))]


def descriptions(y, always, optional):
    """(names, fit) of the combinations of the optional columns that the data do not tell from the best one, best first."""
    fits = []
    for number in range(len(optional) + 1):
        for chosen in combinations(optional, number):
            columns = list(always.values()) + [optional[name] for name in chosen]
            fits.append(([*always, *chosen], Fit([(y, np.column_stack(columns))], ORDER)))
    fits.sort(key=lambda row: -row[1].score)
    return [row for row in fits if row[1].score > fits[0][1].score - ALIKE_NATS]


def report_sensor(report, case, sensor, group, names, fit):
    """Estimates of a sensor (name, kind, axis) by one description, and the names that stand out in it."""
    name, kind, axis = sensor
    course = case in COURSE
    of_output = "rad/s" if kind == "gyro" else "m/s^2"
    units = {"bias_constant": of_output, "scale_factor": "ppm", "misalignment": "rad", "time_delay": "s", "lever_arm": "m"}
    for (effect, letter), value, sigma in zip(names, fit.coefficients, fit.sigmas):
        factor = 1e6 if effect == "scale_factor" else 1.0
        delay = "delay_and_lag_s" if course else "delay_s"
        parameter = {"time_delay": delay, "lever_arm": f"arm_{letter}_m"}.get(effect, "coefficient")
        more = {}
        if effect == "misalignment":
            # Of a unit that is turned by the angles e the sensor along a feels (u x e).a, which is added up.
            whole, across = {"sensor": group, "effect": effect}, "xyz".index(letter)
            turned = [(f"angle_{k}", float(np.cross(e, axis)[across])) for k, e in zip("xyz", np.eye(3))]
            more = {"axis": letter, "also": [whole | {"parameter": angle, "factor": part} for angle, part in turned if part]}
        report.estimate(case, name, effect, parameter, factor * value, factor * sigma, units[effect], **more)
        if 0.5 * (value / sigma) ** 2 > LEAST_NATS:
            report.allow(case, name, effect)
            if course and effect == "time_delay":
                report.allow(case, name, "bandwidth_lag")


def main():
    folder, report = Path(sys.argv[1]), Report("motion")
    for case, (latitude, altitude, group, axes) in CASES.items():
        table = pd.read_csv(folder / f"{case}.csv")
        course = case in COURSE
        motions = [Motion(table, latitude, altitude, by_difference) for by_difference in (False, True)]
        channels = {"gyro": [], "accelerometer": []}
        for name in [n for n in ["gx", "gy", "gz", "gyro_z", "ax", "ay", "az"] if n in table]:
            axis = np.array(axes[name[-1]], float)
            kind = "gyro" if name[0] == "g" else "accelerometer"
            motion = nearest(motions, kind, axis, table[name].to_numpy())
            u = motion.input[kind]
            unit = "rad/s" if kind == "gyro" else "m/s^2"
            y = table[name].to_numpy() - u @ axis
            own = int(np.argmax(np.abs(axis)))
            always = {("time_delay", ""): -(motion.change[kind] @ axis)}
            always |= {("lever_arm", a): motion.lever[:, :, k] @ axis for k, a in enumerate("xyz") if kind == "accelerometer"}
            optional = {("bias_constant", ""): np.ones(len(u)), ("scale_factor", ""): u @ axis}
            optional |= {("misalignment", "xyz"[j]): u[:, j] for j in range(3) if j != own}
            fits = descriptions(y, always, optional)
            for chosen, fit in fits:
                report_sensor(report, case, (name, kind, axis), group, chosen, fit)
            best, X = fits[0][1], np.column_stack([*always.values(), *optional.values()])
            report.allow(case, name, "noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_exp_cos",
                         "noise_variance_step", "noise_angle_quantisation", "noise_outliers")
            report.remark(case, f"{name}: deviation {np.nanstd(y):.3g} {unit}, left {np.nanstd(best.residuals[0]):.3g}; "
                          f"held-out gain {held_out_gain([(y, X)], ORDER, [len(always)]):.3f} nats per sample")
            channels[kind].append((axis, y, motion))
        # The instrument as a whole, gyros and accelerometers apart: delay, mounting (u x e), lever arm; bias and scale own.
        for kind, members in channels.items():
            if len(members) < 3:
                continue
            stacked = []
            for k, (axis, y, motion) in enumerate(members):
                u = motion.input[kind]
                own = np.zeros((len(u), 2 * len(members)))
                own[:, 2 * k], own[:, 2 * k + 1] = 1.0, u @ axis
                X = [-(motion.change[kind] @ axis)[:, None], cross_with_axes(u).transpose(0, 2, 1) @ axis]
                X += [motion.lever.transpose(0, 2, 1) @ axis] if kind == "accelerometer" else []
                stacked.append((y, np.column_stack([*X, own])))
            fit = Fit(stacked, ORDER)
            what = [("time_delay", "delay_s", "s")] + [("misalignment", f"angle_{a}", "rad") for a in "xyz"]
            what += [("lever_arm", f"arm_{a}_m", "m") for a in "xyz"] if kind == "accelerometer" else []
            for (effect, parameter, unit), value, sigma in zip(what, fit.coefficients, fit.sigmas):
                if course and effect == "time_delay":
                    parameter = "delay_and_lag_s"
                    report.allow(case, group, "bandwidth_lag")
                report.estimate(case, group, effect, parameter, value, sigma, unit, of=kind)
                if 0.5 * (value / sigma) ** 2 > LEAST_NATS:
                    report.allow(case, group, effect)
                if 0.5 * (value / sigma) ** 2 > 500 and [group, effect] not in report.case(case)["required"]:
                    report.require(case, group, effect)
    report.print()


if __name__ == "__main__":
    main()
