"""Cases with up to four effects at once, with nothing hidden, and with what no catalogue has."""

import numpy as np

from case_file import Auxiliary
from in_motion import driving, moving, swinging, tumbling
from schuler_loop import loop_case
from settings import any_sensor, bench, distractor, lose_rows, target
from surroundings import chamber, first_order, rod, smooth_wander, thermometer
from unknown_motion import gyro_array, vehicle


def at_rest_together(rng):
    """Two to four of: temperature, its rate, voltage, a step, a drift, a line, a warm-up, a constant."""
    case = bench(rng, "several", "Bench run with everything recorded", least_s=3 * 3600.0, kinds=["dtg", "accelerometer"])
    t, duration = case.t, case.t[-1]
    body, = rod(t, chamber(rng, t, 8.0), duration / 40, [0.6])
    voltage = smooth_wander(rng, len(t), case.step_s, duration / 30)
    case.auxiliaries.append(Auxiliary("T", "temperature", "degC", thermometer(rng, body)))
    case.auxiliaries.append(Auxiliary("U", "voltage", "V", 28.0 + 0.4 * voltage))
    onset, frequency = float(rng.uniform(0.2, 0.8) * duration), float(rng.uniform(30 / duration, 0.3 / case.step_s))
    choices = [
        ("bias_temperature", body - 20.0, {}), ("bias_temperature_rate", np.gradient(body, t), {}),
        ("bias_supply_voltage", voltage * 0.4, {}), ("bias_step", (t >= onset).astype(float), {"onset_s": onset}),
        ("bias_drift_linear", t.copy(), {}), ("periodic_line", np.cos(2 * np.pi * frequency * t), {"frequency_hz": frequency}),
        ("bias_warmup", np.exp(-t / (duration / 8)), {"tau_s": duration / 8}), ("bias_constant", np.ones_like(t), {}),
    ]
    return hide_some(rng, case, choices)


def in_motion_together(rng):
    case = moving(rng, "several", "Swinging table in a chamber", swinging, [str(rng.choice(["fog", "rlg"])), "accelerometer"],
                  least_s=1800.0)
    t = case.t
    body, = rod(t, chamber(rng, t, 8.0), t[-1] / 40, [0.6])
    case.auxiliaries.append(Auxiliary("T", "temperature", "degC", thermometer(rng, body)))
    onset = float(rng.uniform(0.2, 0.8) * t[-1])
    choices = [
        ("scale_factor", lambda s: s.ideal, {}), ("bias_temperature", lambda s: body - 20.0, {}),
        ("bias_step", lambda s: (t >= onset).astype(float), {"onset_s": onset}), ("bias_constant", lambda s: np.ones_like(t), {}),
        ("misalignment", lambda s: crosswise(case, s), {}), ("scale_factor_temperature", lambda s: s.ideal * (body - 20), {}),
    ]
    return hide_some(rng, case, choices)


def crosswise(case, sensor):
    across = np.roll(np.array(sensor.axis), 1)
    what = case.motion.specific_force if sensor.kind == "accelerometer" else case.motion.rate
    return across @ what(case.t)


def hide_some(rng, case, choices):
    count = int(rng.integers(2, 5))
    for index in rng.choice(len(choices), count, replace=False):
        effect, shape, parameters = choices[index]
        sensor = any_sensor(rng, case)
        series = shape(sensor) if callable(shape) else shape
        case.hide(sensor.name, effect, {sensor.name: series}, target(rng) + 10, dict(parameters), rng,
                  onset_s=parameters.get("onset_s"), coefficient=None if effect == "periodic_line" else "coefficient")
    lose_rows(rng, case)
    return case


def nothing(rng):
    """Nothing hidden, in every kind of case."""
    kind = rng.choice(["bench", "chamber", "swing", "tumble", "drive", "array", "log", "loop"])
    if kind in ("bench", "chamber"):
        case = bench(rng, "null", "As it should be")
        if kind == "chamber":
            body, = rod(case.t, chamber(rng, case.t, 8.0), case.t[-1] / 30, [0.6])
            case.auxiliaries.append(Auxiliary("T", "temperature", "degC", thermometer(rng, body)))
            # The case knows how the bias follows the temperature.
            sensor = any_sensor(rng, case)
            coefficient = float(f"{sensor.nominal.white / sensor.si * rng.normal() / 3:.3g}")
            sensor.hidden += coefficient * sensor.si * (body - 25.0)
            sensor.temperature_bias = {"column": "T", "reference_degC": 25.0, "coefficients": [coefficient]}
        distractor(rng, case)
    elif kind in ("swing", "tumble", "drive"):
        motion = {"swing": swinging, "tumble": tumbling, "drive": driving}[kind]
        case = moving(rng, "null", "As it should be", motion, ["fog", "accelerometer"], grouped=rng.random() < 0.5)
        distractor(rng, case)
    elif kind == "array":
        case = gyro_array(rng, "As it should be")
    elif kind == "log":
        case = vehicle(rng, "As it should be")
    else:
        case = loop_case(rng, "As it should be")
    if rng.random() < 0.15 and kind in ("bench", "swing"):
        # An engineer who knows nothing of the noise.
        for instrument in case.instruments:
            instrument.says_nothing = True
            instrument.bias = instrument.scale_factor = 0.0
            instrument.nominal.random_walk = 0.0
    case.kind = "null"
    lose_rows(rng, case)
    return case


def outside(rng):
    """Effects that no catalogue has: a pulse, a chirp, a sawtooth, a product of two recorded quantities, a square root."""
    case = bench(rng, "out_of_catalogue", "Bench run", least_s=3600.0)
    sensor, t, duration = any_sensor(rng, case), case.t, case.t[-1]
    kind = str(rng.choice(["pulse", "chirp", "sawtooth", "product", "creep"]))
    if kind == "pulse":
        shape = np.exp(-0.5 * ((t - rng.uniform(0.3, 0.7) * duration) / (duration / 40)) ** 2)
    elif kind == "chirp":
        shape = np.sin(2 * np.pi * (8 * t / duration + 25 * (t / duration) ** 2))
    elif kind == "sawtooth":
        shape = (7.3 * t / duration) % 1.0 - 0.5
    elif kind == "creep":
        shape = np.sqrt(np.maximum(t - 0.3 * duration, 0.0) / duration)
    else:
        one, other = (smooth_wander(rng, len(t), case.step_s, duration / 25) for _ in range(2))
        case.auxiliaries.append(Auxiliary("U", "voltage", "V", 27.0 + one))
        case.auxiliaries.append(Auxiliary("p", "pressure", "hPa", 1000.0 + 5 * other))
        shape = one * other
    case.hide(sensor.name, f"outside_{kind}", {sensor.name: shape}, target(rng) + 20, coefficient=None)
    case.kind = "out_of_catalogue"
    return case


CATALOGUE = {"at_rest_together": at_rest_together, "in_motion_together": in_motion_together}
