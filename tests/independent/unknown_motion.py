"""Cases in which the motion is not known: redundant gyros, and a Doppler log beside an inertial system."""

import numpy as np

from case_file import DEGREE, Auxiliary, Case
from motion import swing, voyage
from settings import AXES, UP_TO_ROWS, any_sensor, instrument, log_uniform, lose_rows, noise_of, record, site, target
from surroundings import chamber, rod, thermometer


def gyro_array(rng, title):
    """Five or six like gyros on a cone about z with half the angle 54.74 degrees, on a body that swings."""
    step_s, t = record(rng, 1800.0, 12 * 3600.0, (1.0, 1.0, 0.1, 0.5), UP_TO_ROWS)
    place = site(rng)
    case = Case("redundant", title, step_s, t, "unknown", site=place)
    case.motion = swing(rng, step_s * log_uniform(rng, 100, 1000), place["latitude_deg"] * DEGREE, place["altitude_m"],
                        amplitude=(0.02, 0.2))
    count, half = int(rng.choice([5, 5, 6])), np.arccos(1 / np.sqrt(3))
    kind = str(rng.choice(["dtg", "fog", "mems_gyro"]))
    noise = noise_of(rng, kind, step_s, t[-1])
    unit = None
    for number in range(count):
        angle = 2 * np.pi * number / count
        axis = (np.sin(half) * np.cos(angle), np.sin(half) * np.sin(angle), np.cos(half))
        made = instrument(rng, kind if kind != "dtg" else "fog", f"g{number + 1}", step_s, t[-1], axis, noise=noise)
        made.kind = kind
        if kind == "dtg":
            spin = np.cross(axis, (0.0, 0.0, 1.0))
            made.spin_axis = tuple(spin / np.linalg.norm(spin))
        unit = unit or made.unit
        made.unit, made.bias, made.scale_factor = unit, 0.0, 0.0
        case.instruments.append(made)
    case.parity = np.array([i.axis for i in case.instruments])
    case.look()
    return case


def in_array(effect):
    def make(rng):
        case = gyro_array(rng, "Redundant gyros")
        sensor, t = any_sensor(rng, case), case.t
        onset = float(rng.uniform(0.15, 0.8) * t[-1])
        more = {}
        if effect == "bias_step":
            shape, more = (t >= onset).astype(float), {"onset_s": onset}
        elif effect == "bias_drift_linear":
            shape, more = np.maximum(t - onset, 0.0), {"onset_s": onset}
        elif effect == "bias_constant":
            shape = np.ones_like(t)
        elif effect == "scale_factor":
            shape = sensor.ideal
        elif effect == "periodic_line":
            frequency = log_uniform(rng, 20 / t[-1], 0.4 / case.step_s)
            shape = np.cos(2 * np.pi * frequency * t + 1.0)
        else:
            inside, = rod(t, chamber(rng, t, 8.0), t[-1] / 30, [0.6])
            case.auxiliaries.append(Auxiliary("T", "temperature", "degC", thermometer(rng, inside), near=sensor.name))
            shape = inside - 20.0
        parameters = {"frequency_hz": frequency} if effect == "periodic_line" else dict(more)
        case.hide(sensor.name, effect, {sensor.name: shape}, target(rng), parameters, rng,
                  coefficient=None if effect == "periodic_line" else "coefficient", **more)
        lose_rows(rng, case)
        return case
    return make


def vehicle(rng, title, axes=2):
    """A log and an inertial system on one vehicle, forward and to starboard."""
    step_s, t = record(rng, 1800.0, 6 * 3600.0, (1.0, 0.5, 0.2), UP_TO_ROWS, fewest=2500)
    place = site(rng)
    case = Case("doppler", title, step_s, t, "unknown", site=place)
    case.motion = voyage(rng, t[-1], place["latitude_deg"] * DEGREE, place["altitude_m"], log_uniform(rng, 2.0, 15.0),
                         max(15 * step_s, t[-1] / 200))
    for prefix, kind, group in (("dvl", "doppler", "log"), ("ins", "ins_velocity", "inertial_system")):
        noise = noise_of(rng, kind, step_s, t[-1])
        for axis, letter in list(zip(AXES, "xyz"))[:axes]:
            case.instruments.append(instrument(rng, kind, f"{prefix}_v{letter}", step_s, t[-1], axis, group, noise))
    for made in case.instruments:
        made.scale_factor = 0.0
    case.look()
    return case


def difference_gain(case, errors):
    """Gain seen in the differences of the two instruments, axis by axis."""
    half = len(case.instruments) // 2
    total = 0.0
    for log, inertial in zip(case.instruments[:half], case.instruments[half:]):
        error = errors.get(log.name, 0.0 * case.t) - errors.get(inertial.name, 0.0 * case.t)
        total += log.nominal.plus(inertial.nominal).gain(error, case.step_s)
    return total


def in_log(effect):
    def make(rng):
        case = vehicle(rng, "Doppler log beside an inertial system")
        case.gain = lambda errors: difference_gain(case, errors)
        logs, t = case.instruments[:2], case.t
        if effect in ("time_delay", "bandwidth_lag"):
            def errors_of(delay_s):
                late = case.motion.body_velocity(t - delay_s) - case.motion.body_velocity(t)
                return {i.name: np.array(i.axis) @ late for i in logs}
            case.hide_nonlinear("log", effect, errors_of, case.step_s, target(rng), "delay_s", (1e-4, 2.0))
        elif effect == "scale_factor":
            case.hide("log", effect, {i.name: i.ideal for i in logs}, target(rng), rng=rng)
        elif effect == "misalignment":
            ahead, right = logs
            case.hide("log", effect, {ahead.name: right.ideal, right.name: -ahead.ideal}, target(rng), rng=rng,
                      coefficient=None)
        elif effect == "bias_step":
            onset, one = float(rng.uniform(0.15, 0.85) * t[-1]), any_sensor(rng, case, ("doppler",))
            case.hide(one.name, effect, {one.name: (t >= onset).astype(float)}, target(rng), {"onset_s": onset}, rng,
                      onset_s=onset)
        elif effect == "noise_outliers":
            one = any_sensor(rng, case, ("doppler",))
            spikes = rng.choice(len(t), max(6, len(t) // 500), replace=False)
            one.hidden[spikes] += rng.choice([-1, 1], len(spikes)) * one.nominal.white * rng.uniform(8, 25, len(spikes))
            case.note(one.name, effect, {}, 20.0 * len(spikes))
        lose_rows(rng, case)
        return case
    return make


CATALOGUE = {
    **{f"array_{effect}": in_array(effect) for effect in (
        "bias_step", "bias_drift_linear", "bias_constant", "scale_factor", "periodic_line", "bias_temperature")},
    **{f"log_{effect}": in_log(effect) for effect in (
        "time_delay", "scale_factor", "misalignment", "bias_step", "noise_outliers")},
}
