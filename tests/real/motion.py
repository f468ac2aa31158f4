"""Inertial units against a reference of attitude and velocity: a vehicle, a hand before cameras, a car.

    motion.py FOLDER      # with the tables of make_cases.py

For each sensor with the axis a: reading = a.u + k a.u + m.u + b - d a.du/dt (+ a.(w' x r + w x (w x r)) for an
accelerometer at r from the reference), u the reference's rate or specific force. Then the same for the three gyros and the
three accelerometers together, with one delay, one lever arm and one turned mounting.

Derivatives are those of a cubic spline. A difference over two steps is smaller than the derivative of what sways within a few steps
(at 2.5 Hz and steps of 0.1 s by 0.6), and a delay fitted with it larger: the vehicle's gyros 6.15 ms instead of 5.42, with 39 nats
less; before the cameras 5.2 ms instead of 4.4, with 1460 nats less. The car's course from a satellite receiver is so noisy that
the difference predicts better (0.083 nats per sample held out, the spline 0.031).
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from common import Fit, Report, cross_with_axes, held_out_gain
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

ORDER = 8
FEWEST_OF_SPLINE = 4
CASES = {
    "vehicle_fog_mems/vehicle": (34.432, 172.3, "mems", {"x": [0, 1, 0], "y": [1, 0, 0], "z": [0, 0, -1]}),
    "optical_reference/trial_01": (52.5, 50.0, "imu", {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1]}),
    "car_imu_rtk/drive": (40.099, 1592.0, "imu", {"x": [-1, 0, 0], "y": [0, 1, 0], "z": [0, 0, -1]}),
}
# The course of an antenna ahead of the rear axle leads the yaw by l w'/v: no more tells a delay from a lag.
COURSE = ["car_imu_rtk/drive"]


def reference(table, latitude_deg, altitude):
    """Rate and specific force in body axes, centred over the neighbours; NaN where the attitude is not known."""
    t = table.t_s.to_numpy()
    angles = table[["yaw", "pitch", "roll"]].to_numpy()
    known = np.isfinite(angles).all(axis=1)
    attitude = Rotation.from_euler("ZYX", np.where(known[:, None], angles, 0.0))
    span = (t[2:] - t[:-2])[:, None]
    inner = np.where((known[2:] & known[:-2])[:, None], (attitude[:-2].inv() * attitude[2:]).as_rotvec() / span, np.nan)
    end = np.full((1, 3), np.nan)
    velocity = table[["vn", "ve", "vd"]].to_numpy()
    acceleration = np.vstack([end, (velocity[2:] - velocity[:-2]) / span, end])
    latitude = np.radians(latitude_deg)
    sine = np.sin(latitude) ** 2
    gravity = 9.7803267715 * (1 + 0.0052790414 * sine + 0.0000232718 * sine**2) - 3.086e-6 * altitude
    earth = 7.292115e-5 * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    north, east = velocity[:, 0] / 6.36e6, velocity[:, 1] / 6.38e6
    transport = np.column_stack([east, -north, -east * np.tan(latitude)])
    rate = np.vstack([end, inner, end]) + attitude.inv().apply(earth + transport)
    force = attitude.inv().apply(acceleration + np.cross(2 * earth + transport, velocity) - [0.0, 0.0, gravity])
    force[~known] = np.nan
    return t, rate, force


def derivative(u, t, noisy):
    """Of a cubic spline through each stretch of rows that are known; over two steps where they are noisy."""
    if noisy:
        return np.gradient(u, t, axis=0)
    out = np.full_like(u, np.nan)
    known = np.flatnonzero(np.isfinite(u).all(axis=1))
    for stretch in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        if len(stretch) >= FEWEST_OF_SPLINE:
            out[stretch] = CubicSpline(t[stretch], u[stretch])(t[stretch], 1)
    return out


def sensor_columns(axis, u, changes):
    return np.column_stack([np.ones(len(u)), u, -changes @ np.asarray(axis, float)])


def main():
    folder, report = Path(sys.argv[1]), Report("motion")
    for case, (latitude, altitude, group, axes) in CASES.items():
        table = pd.read_csv(folder / f"{case}.csv")
        t, rate, force = reference(table, latitude, altitude)
        noisy = case in COURSE
        angular = derivative(rate, t, noisy)
        changes = {"gyro": angular, "accelerometer": derivative(force, t, noisy)}
        lever = np.stack([np.cross(angular, e) + np.cross(rate, np.cross(rate, e)) for e in np.eye(3)], axis=2)
        channels = {"gyro": [], "accelerometer": []}
        for name in [n for n in ["gx", "gy", "gz", "gyro_z", "ax", "ay", "az"] if n in table]:
            axis = np.array(axes[name[-1]], float)
            kind, u = ("gyro", rate) if name[0] == "g" else ("accelerometer", force)
            unit = "rad/s" if kind == "gyro" else "m/s^2"
            y = table[name].to_numpy() - u @ axis
            X = sensor_columns(axis, u, changes[kind])
            if kind == "accelerometer":
                X = np.column_stack([X, lever.transpose(0, 2, 1) @ axis])
            fit = Fit([(y, X)], ORDER)
            own = int(np.argmax(np.abs(axis)))
            rows = [("bias_constant", "coefficient", 1.0, unit, {}, 0)]
            rows += [("scale_factor", "coefficient", 1e6 * axis[own], "ppm", {}, 1 + own)]
            rows += [("misalignment", "coefficient", 1.0, "rad", {"axis": "xyz"[j]}, 1 + j) for j in range(3) if j != own]
            rows += [("time_delay", "delay_s", 1.0, "s", {}, 4)]
            rows += [("lever_arm", f"arm_{a}_m", 1.0, "m", {}, 5 + k) for k, a in enumerate("xyz") if kind == "accelerometer"]
            for effect, parameter, factor, of, more, k in rows:
                value, sigma = fit.coefficients[k], fit.sigmas[k]
                if case in COURSE and effect == "time_delay":
                    parameter = "delay_and_lag_s"
                report.estimate(case, name, effect, parameter, factor * value, abs(factor) * sigma, of, **more)
                if 0.5 * (value / sigma) ** 2 > 6:
                    report.allow(case, name, effect)
                    if case in COURSE and effect == "time_delay":
                        report.allow(case, name, "bandwidth_lag")
            report.allow(case, name, "noise_white", "noise_markov", "noise_random_walk", "noise_flicker", "noise_exp_cos",
                         "noise_variance_step", "noise_angle_quantisation", "noise_outliers")
            report.remark(case, f"{name}: deviation {np.nanstd(y):.3g} {unit}, left {np.nanstd(fit.residuals[0]):.3g}; "
                          f"held-out gain {held_out_gain([(y, X)], ORDER, [0]):.3f} nats per sample")
            channels[kind].append((name, axis, y, u))
        # The instrument as a whole, gyros and accelerometers apart: delay, mounting (u x e), lever arm; bias and scale own.
        for kind, members in channels.items():
            if len(members) < 3:
                continue
            stacked = []
            for k, (_, axis, y, u) in enumerate(members):
                own = np.zeros((len(t), 2 * len(members)))
                own[:, 2 * k], own[:, 2 * k + 1] = 1.0, u @ axis
                X = [-(changes[kind] @ axis)[:, None], cross_with_axes(u).transpose(0, 2, 1) @ axis]
                X += [lever.transpose(0, 2, 1) @ axis] if kind == "accelerometer" else []
                stacked.append((y, np.column_stack([*X, own])))
            fit = Fit(stacked, ORDER)
            what = [("time_delay", "delay_s", "s")] + [("misalignment", f"angle_{a}", "rad") for a in "xyz"]
            what += [("lever_arm", f"arm_{a}_m", "m") for a in "xyz"] if kind == "accelerometer" else []
            for (effect, parameter, unit), value, sigma in zip(what, fit.coefficients, fit.sigmas):
                if case in COURSE and effect == "time_delay":
                    parameter = "delay_and_lag_s"
                    report.allow(case, group, "bandwidth_lag")
                report.estimate(case, group, effect, parameter, value, sigma, unit, of=kind)
                if 0.5 * (value / sigma) ** 2 > 6:
                    report.allow(case, group, effect)
                if 0.5 * (value / sigma) ** 2 > 500 and [group, effect] not in report.case(case)["required"]:
                    report.require(case, group, effect)
    report.print()


if __name__ == "__main__":
    main()
