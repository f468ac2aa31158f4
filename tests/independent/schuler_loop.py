"""Velocity error of an inertial system: the Schuler loop integrated, with noise and hidden errors inside it.

    dV' = -g d + da        d' = dV / R + dw        (velocity error, error of the vertical, accelerometer, gyro)
"""

import numpy as np
from scipy import linalg, signal

from case_file import DEGREE, Auxiliary, Case, Instrument
from motion import gravity, voyage
from noise import Noise, ornstein_uhlenbeck
from settings import DEG_H, UP_TO_ROWS, MICRO_G, log_uniform, lose_rows, record, site, target
from surroundings import chamber, rod, smooth_wander, thermometer

RADIUS = 6_371_000.0  # m
# Errors of velocity, m/s, and of the vertical, rad, after an alignment: 1 sigma. An accelerometer's constant error is a tilt
# like these, and is not hidden.
START_VELOCITY = 0.1
START_TILT = 1e-4


def response(t, accelerometer, gyro, gravity_):
    """Velocity error from errors of the two sensors that are linear between samples, from rest."""
    loop = tuple(map(np.array, ([[0.0, -gravity_], [1 / RADIUS, 0.0]], np.eye(2), [[1.0, 0.0]], [[0.0, 0.0]])))
    discrete = signal.cont2discrete(loop, t[1] - t[0], method="foh")
    total = np.zeros_like(t)
    for column, drive in enumerate((accelerometer, gyro)):
        if drive is not None:
            numerator, denominator = signal.ss2tf(*discrete[:4], input=column)
            total += signal.lfilter(numerator[0], denominator, drive)
    return total


def loop_case(rng, title, with_force=False):
    step_s, t = record(rng, 3 * 3600.0, 30 * 3600.0, (1.0, 2.0, 5.0, 10.0), UP_TO_ROWS, fewest=5000)
    place = site(rng)
    case = Case("loop", title, step_s, t, "velocity_error", site=place)
    g = gravity(place["latitude_deg"] * DEGREE, place["altitude_m"])
    accelerometer = (log_uniform(rng, 3, 60) * MICRO_G, log_uniform(rng, 60.0, 3000.0))
    gyro = (log_uniform(rng, 0.003, 0.05) * DEG_H, log_uniform(rng, 600.0, 7200.0))
    white = log_uniform(rng, 0.003, 0.1)
    case.loop = {"radius_m": RADIUS, "gravity": g, "accelerometer": dict(zip(("sigma", "tau_s"), accelerometer)),
                 "gyro": dict(zip(("sigma", "tau_s"), gyro)), "velocity_white": white}
    if with_force:
        case.motion = voyage(rng, t[-1], place["latitude_deg"] * DEGREE, place["altitude_m"], 200.0, 120.0)
        case.recorded = "force"
    sensor = Instrument("dv", "ins_velocity", "m/s", Noise(white=white), axis=(1.0, 0.0, 0.0))
    sensor.says_nothing = True
    sensor.ideal, sensor.hidden = np.zeros_like(t), np.zeros_like(t)

    def inner_noise(rng, count):
        tilt = START_TILT * rng.standard_normal()
        swing = np.sqrt(g / RADIUS) * t
        return (response(t, ornstein_uhlenbeck(rng, count, step_s, *accelerometer),
                         ornstein_uhlenbeck(rng, count, step_s, *gyro), g)
                + START_VELOCITY * rng.standard_normal() * np.cos(swing) - np.sqrt(g * RADIUS) * tilt * np.sin(swing))
    sensor.extra_noise.append(inner_noise)
    case.instruments.append(sensor)
    # Model of the noise: velocity, vertical, accelerometer, gyro.
    rates = np.array([1 / accelerometer[1], 1 / gyro[1]])
    dynamics = np.array([[0, -g, 1, 0], [1 / RADIUS, 0, 0, 1], [0, 0, -rates[0], 0], [0, 0, 0, -rates[1]]])
    power = np.diag([0, 0, 2 * rates[0] * accelerometer[0] ** 2, 2 * rates[1] * gyro[0] ** 2])
    block = linalg.expm(np.block([[-dynamics, power], [np.zeros((4, 4)), dynamics.T]]) * step_s)
    transition = block[4:, 4:].T
    driving = transition @ block[:4, 4:]
    case.loop_model = (transition, (driving + driving.T) / 2, np.array([[1.0, 0, 0, 0]]), white**2,
                       np.diag([START_VELOCITY**2, START_TILT**2, accelerometer[0] ** 2, gyro[0] ** 2]))
    return case


def inside(where, effect):
    """An effect of the accelerometer or the gyro inside the loop, or of the velocity."""
    def make(rng):
        case = loop_case(rng, "Velocity error over a flight", with_force=effect in ("scale_factor", "scale_factor_quadratic"))
        t, more = case.t, {}
        onset = float(rng.uniform(0.15, 0.7) * t[-1])
        if effect == "bias_constant":
            error = np.ones_like(t)
        elif effect == "bias_step":
            error, more = (t >= onset).astype(float), {"onset_s": onset}
        elif effect == "bias_drift_linear":
            error = t.copy()
        elif effect in ("bias_temperature", "bias_temperature_rate"):
            body, = rod(t, chamber(rng, t, 8.0), t[-1] / 25, [0.6])
            case.auxiliaries.append(Auxiliary("T_ins", "temperature", "degC", thermometer(rng, body)))
            error = body - 20.0 if effect == "bias_temperature" else np.gradient(body, t)
        elif effect == "periodic_line":
            frequency = log_uniform(rng, 1 / 1500.0, 0.2 / case.step_s)
            error, more = np.cos(2 * np.pi * frequency * t), {"frequency_hz": frequency}
        elif effect.startswith("scale_factor"):
            force = case.motion.specific_force(t)[0]
            error = force if effect == "scale_factor" else force**2
        elif effect == "bias_supply_voltage":
            error = smooth_wander(rng, len(t), case.step_s, t[-1] / 25)
            case.auxiliaries.append(Auxiliary("U", "voltage", "V", 27.0 + error))
        g = case.loop["gravity"]
        seen = {"accelerometer": lambda: response(t, error, None, g), "gyro": lambda: response(t, None, error, g),
                "velocity": lambda: error}[where]()
        case.hide(where, effect, {"dv": seen}, target(rng), dict(more), rng, onset_s=more.get("onset_s"),
                  coefficient=None if effect == "periodic_line" else "coefficient", unsigned=where == "gyro")
        lose_rows(rng, case)
        if (where, effect) == ("gyro", "bias_temperature_rate"):
            # g times a drift that follows the rate is the derivative of an accelerometer's that follows the temperature.
            case.effects[-1]["also_at"] = [["accelerometer", "bias_temperature"]]
        return case
    return make


def velocity_noise(effect):
    def make(rng):
        case = loop_case(rng, "Velocity error over a flight")
        sensor, t = case.instruments[0], case.t
        white = sensor.nominal.white
        if effect == "noise_white":
            sensor.truth = Noise(white=white * rng.uniform(1.1, 2.0))
            ratio = (sensor.truth.white / white) ** 2
            case.note("velocity", effect, {"sigma": sensor.truth.white}, 0.25 * len(t) * (ratio - 1 - np.log(ratio)))
        elif effect == "noise_outliers":
            spikes = rng.choice(len(t), max(5, len(t) // 1000), replace=False)
            sensor.hidden[spikes] += rng.choice([-1, 1], len(spikes)) * white * rng.uniform(10, 30, len(spikes))
            case.note("velocity", effect, {}, 20.0 * len(spikes))
        return case
    return make


CATALOGUE = {
    **{f"loop_accelerometer_{e}": inside("accelerometer", e) for e in (
        "bias_step", "bias_temperature", "scale_factor", "scale_factor_quadratic", "bias_supply_voltage")},
    **{f"loop_gyro_{e}": inside("gyro", e) for e in (
        "bias_constant", "bias_step", "bias_drift_linear", "bias_temperature", "bias_temperature_rate")},
    **{f"loop_velocity_{e}": inside("velocity", e) for e in ("bias_step", "periodic_line")},
    **{f"loop_velocity_{e}": velocity_noise(e) for e in ("noise_white", "noise_outliers")},
}
