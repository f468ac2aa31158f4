"""Cases at rest: biases and what they follow, heat, failures of outputs."""

import numpy as np

from case_file import DEGREE, Auxiliary, rest
from settings import (any_sensor, bench, distractor, log_uniform, lose_rows, target)
from surroundings import chamber, first_order, play, rod, smooth_wander, thermometer, tide

# What it costs, in nats, that a frequency or an onset is not known: the oracle of the bars knows it no more.
SEARCH = 6.0


def bias_constant(rng):
    case = bench(rng, "additive", "Bench run, bias of the last calibration")
    sensor = any_sensor(rng, case)
    case.hide(sensor.name, "bias_constant", {sensor.name: np.ones_like(case.t)}, target(rng), rng=rng)
    return case


def bias_step(rng):
    case = bench(rng, "additive", "Bench run")
    sensor = any_sensor(rng, case)
    onset = float(rng.uniform(0.1, 0.9) * case.t[-1])
    case.hide(sensor.name, "bias_step", {sensor.name: (case.t >= onset).astype(float)}, target(rng) + SEARCH,
              {"onset_s": onset}, rng, onset_s=onset)
    return case


def bias_drift_linear(rng):
    case = bench(rng, "additive", "Long run", least_s=7200.0)
    sensor = any_sensor(rng, case)
    if rng.random() < 0.5:
        onset, more = 0.0, {}
    else:
        onset = float(rng.uniform(0.1, 0.7) * case.t[-1])
        more = {"onset_s": onset}
    shape = np.maximum(case.t - onset, 0.0)
    case.hide(sensor.name, "bias_drift_linear", {sensor.name: shape}, target(rng), dict(more), rng, **more)
    return case


def bias_warmup(rng):
    case = bench(rng, "additive", "From switch-on", least_s=1800.0)
    sensor = any_sensor(rng, case)
    tau_s = log_uniform(rng, max(60.0, 10 * case.step_s), min(21600.0, case.t[-1] / 3))
    case.hide(sensor.name, "bias_warmup", {sensor.name: np.exp(-case.t / tau_s)}, target(rng), {"tau_s": tau_s}, rng)
    return case


def bias_restart(rng):
    case = bench(rng, "additive", "Switched off and on several times", least_s=4 * 3600.0, steps=(1.0, 2.0, 5.0))
    sensor = any_sensor(rng, case)
    runs = int(rng.integers(4, 9))
    edges = np.linspace(0, len(case.t), runs + 1).astype(int)
    shape, kept = np.zeros_like(case.t), np.ones(len(case.t), dtype=bool)
    for first, following in zip(edges[:-1], edges[1:]):
        shape[first:following] = rng.standard_normal()
        kept[following - int(0.15 * (following - first)) : following] = False
    kept[-1] = True
    # Nobody sees the edges, which are in lost rows: there the error goes over in a straight line, so that it gains nothing by them.
    shape[~kept] = np.interp(case.t[~kept], case.t[kept], shape[kept])
    case.kept = kept
    case.hide(sensor.name, "bias_restart", {sensor.name: shape}, target(rng) + 10, coefficient=None)
    return case


def periodic_line(rng):
    case = bench(rng, "additive", "Bench run beside machines")
    sensor = any_sensor(rng, case)
    frequency = log_uniform(rng, 20 / case.t[-1], 0.45 / case.step_s)
    shape = np.cos(2 * np.pi * frequency * case.t + rng.uniform(0, 6.28))
    case.hide(sensor.name, "periodic_line", {sensor.name: shape}, target(rng) + SEARCH, {"frequency_hz": frequency}, coefficient=None)
    return case


def recorded_quantity(effect, quantity, unit, level, spread, column, kind=None, **more):
    """A bias that follows a quantity that is recorded in `unit`; of a sensor of one `kind`, if only that has it."""
    def make(rng):
        case = bench(rng, "additive", f"Bench run with {quantity} recorded", least_s=3600.0)
        while kind is not None and all(instrument.kind != kind for instrument in case.instruments):
            case = bench(rng, "additive", f"Bench run with {quantity} recorded", least_s=3600.0)
        sensor = any_sensor(rng, case, kind and (kind,))
        wander = smooth_wander(rng, len(case.t), case.step_s, case.t[-1] / rng.uniform(8, 60))
        case.auxiliaries.append(Auxiliary(column, quantity, unit, level + spread * wander, **more))
        size = case.hide(sensor.name, effect, {sensor.name: wander}, target(rng), rng=rng, coefficient=None)
        case.effects[-1]["per_unit"] = {"coefficient": size / spread, "unit": unit}
        distractor(rng, case)
        lose_rows(rng, case)
        return case
    return make


def electronics_temperature(rng):
    case = bench(rng, "additive", "Electronics in a chamber of their own", least_s=7200.0)
    sensor = any_sensor(rng, case)
    here, there = chamber(rng, case.t, 3.0), chamber(rng, case.t, 8.0)
    sensor_body, = rod(case.t, here, case.t[-1] / 30, [0.5])
    electronics, = rod(case.t, there, case.t[-1] / 40, [0.5])
    case.auxiliaries.append(Auxiliary("T_sensor", "temperature", "degC", thermometer(rng, sensor_body), near=sensor.name,
                                      position_m=(0.0, 0.0, 0.0)))
    case.auxiliaries.append(Auxiliary("T_electronics", "temperature", "degC", thermometer(rng, electronics),
                                      position_m=(0.3, 0.1, 0.0)))
    case.hide(sensor.name, "bias_electronics_temperature", {sensor.name: electronics - 20.0}, target(rng), rng=rng)
    return case


def vibration_rectification(rng):
    case = bench(rng, "input", "Vibration runs", least_s=3600.0)
    sensor = any_sensor(rng, case)
    burst = np.maximum(smooth_wander(rng, len(case.t), case.step_s, case.t[-1] / 30), 0.0) * rng.uniform(0.2, 2.0) + 0.01
    unit, one = [("g", 9.80665), ("m/s^2", 1.0), ("mg", 9.80665e-3)][int(rng.integers(3))]
    case.auxiliaries.append(Auxiliary("vib_rms", "vibration_rms", unit, burst * 9.80665 / one))
    case.hide(sensor.name, "vibration_rectification", {sensor.name: (burst * 9.80665) ** 2}, target(rng), rng=rng)
    return case


def thermal(effect):
    def make(rng):
        case = bench(rng, "thermal", "Run in a climate chamber", least_s=3 * 3600.0,
                     most_s=3 * 86400.0, steps=(1.0, 1.0, 2.0, 5.0, 10.0, 0.5))
        t, duration = case.t, case.t[-1]
        sensor = any_sensor(rng, case)
        amplitude = {"bias_temperature_sq": 12.0, "bias_temperature_cubic": 18.0}.get(effect, rng.uniform(3, 15))
        slowest = log_uniform(rng, max(300.0, 5 * case.step_s), max(900.0, duration / 25))
        near, far = rod(t, chamber(rng, t, amplitude), slowest, [0.6, 0.05])
        reference = float(rng.choice([20.0, 25.0, near[0], near.mean()]))
        more, extra = {}, {}
        if effect == "bias_temperature":
            shape = near - reference
        elif effect == "bias_temperature_sq":
            shape = (near - (near.mean() if rng.random() < 0.5 else 20.0)) ** 2
        elif effect == "bias_temperature_cubic":
            shape = (near - near.mean()) ** 3
        elif effect == "bias_temperature_rate":
            shape = np.gradient(near, t)
        elif effect == "bias_thermal_lag":
            tau_s = float(np.clip(slowest * rng.uniform(0.5, 2.0), 120.0, 21600.0))
            more["tau_s"] = tau_s
            shape = first_order(t, near, tau_s) - reference
        elif effect == "bias_temperature_gradient":
            distance = 0.12
            shape = (near - far) / distance
        elif effect == "bias_thermal_hysteresis":
            width = 0.35 * (near.max() - near.min())
            shape, extra = play(near, width), {"width_K": width}
        case.auxiliaries.append(Auxiliary("temp_1", "temperature", "degC", thermometer(rng, near), near=sensor.name,
                                          position_m=(0.0, 0.0, 0.0)))
        if effect == "bias_temperature_gradient" or rng.random() < 0.25:
            case.auxiliaries.append(Auxiliary("temp_2", "temperature", "degC", thermometer(rng, far),
                                              position_m=(0.12, 0.0, 0.0)))
        case.hide(sensor.name, effect, {sensor.name: shape}, target(rng), more, rng, unsigned=effect.endswith("gradient"),
                  coefficient=None if effect == "bias_thermal_hysteresis" else "coefficient")
        distractor(rng, case)
        lose_rows(rng, case)
        return case
    return make


def earth_tide(rng):
    """A gravimeter for some days: a quiet accelerometer read against an unknown constant."""
    case = bench(rng, "additive", "Gravimeter", kinds=["accelerometer"], least_s=1.5 * 86400.0, most_s=12 * 86400.0,
                 steps=(30.0, 60.0, 60.0, 100.0))
    sensor = case.instruments[0]
    case.instruments = [sensor]
    up = rng.random() < 0.6
    sensor.axis = (0.0, 0.0, -1.0 if up else 1.0)
    sensor.bias, sensor.relative, sensor.scale_factor = 0.0, True, 0.0
    case.motion = rest(case.site, 0.0, 0.0, 0.0)
    case.look()
    case.origin_s = float(rng.integers(1_000_000_000, 1_780_000_000))
    longitude = float(f"{rng.uniform(-180, 180):.6g}")
    if rng.random() < 0.6:
        case.site["longitude_deg"] = longitude
    pull = tide(case.origin_s + case.t, case.site["latitude_deg"] * DEGREE, longitude * DEGREE, case.site["altitude_m"])
    shape = -pull if up else pull
    # The tide has the size that it has: the noise is made so that it is seen.
    sensor.nominal.white *= np.sqrt(case.gain({sensor.name: shape}))
    noise = sensor.nominal
    noise.markov.clear(), noise.exp_cos.clear()
    noise.random_walk = 0.0
    noise.white = 1e-6
    wanted = target(rng) + 30
    if rng.random() < 0.6:
        noise.markov.append((0.5e-6, log_uniform(rng, 600.0, 7200.0)))
    factor = np.sqrt(case.gain({sensor.name: shape}) / wanted)
    noise.white *= factor
    noise.markov = [(sigma * factor, tau) for sigma, tau in noise.markov]
    case.hide(sensor.name, "earth_tide", {sensor.name: shape}, wanted, coefficient=None)
    return case


def gravity_anomaly(rng):
    felt = 0.0
    while felt < 1.0:  # m/s^2; a level accelerometer does not feel gravity
        case = bench(rng, "additive", "Accelerometers at a site with a gravity anomaly", kinds=["accelerometer"])
        felt = max(np.abs(i.ideal).max() for i in case.instruments)
    for instrument in case.instruments:
        instrument.group = "accelerometers" if len(case.instruments) > 1 else None
    down = case.motion.into_body(case.t, np.array([0 * case.t, 0 * case.t, 1 + 0 * case.t]))
    shapes = {i.name: -(np.array(i.axis) @ down) for i in case.instruments}
    sensor = "accelerometers" if len(case.instruments) > 1 else case.instruments[0].name
    case.hide(sensor, "gravity_anomaly", shapes, target(rng), rng=rng, also=("bias_constant",))
    # Where one of them stands upright and the others lie level, it is a constant of that one.
    felt = [name for name, shape in shapes.items() if np.abs(shape).max() > 1e-3]
    if len(felt) == 1:
        case.effects[-1]["also_at"] = [[felt[0], "bias_constant"]]
    return case


def intermittent_jump(rng):
    case = bench(rng, "failures", "An intermittent contact", least_s=3600.0)
    sensor = any_sensor(rng, case)
    off, on = case.t[-1] / rng.uniform(8, 20), case.t[-1] / rng.uniform(15, 60)
    state, when, shape = 0, 0.0, np.zeros_like(case.t)
    while when < case.t[-1]:
        until = when + rng.exponential(on if state else off)
        shape[(case.t >= when) & (case.t < until)] = state
        state, when = 1 - state, until
    if shape.sum() < 5:
        shape[len(shape) // 3 : len(shape) // 2] = 1.0
    # Nobody knows when it jumps: each time costs what finding it among the rows does.
    jumps = np.count_nonzero(np.diff(shape))
    case.hide(sensor.name, "intermittent_jump", {sensor.name: shape}, target(rng) + jumps * np.log(len(shape) / jumps), rng=rng,
              coefficient=None)
    return case


def output_stuck(rng):
    case = bench(rng, "failures", "An output that stands still", steps=(1.0, 0.1, 0.5))
    sensor = any_sensor(rng, case)
    onset = float(rng.uniform(0.2, 0.95) * case.t[-1])

    def stick(_, values):
        return np.where(case.t >= onset, values[np.searchsorted(case.t, onset)], values)

    sensor.spoils.append(stick)
    case.note(sensor.name, "output_stuck", {"onset_s": onset}, 1000.0, onset_s=onset)
    return case


def quantisation(rng):
    case = bench(rng, "failures", "A converter that is coarser than thought")
    sensor = any_sensor(rng, case)
    step = sensor.nominal.white * log_uniform(rng, 1.5, 6.0)
    sensor.spoils.append(lambda _, values: step * np.round(values / step))
    case.note(sensor.name, "quantisation", {}, 100.0)
    return case


CATALOGUE = {
    "bias_constant": bias_constant, "bias_step": bias_step, "bias_drift_linear": bias_drift_linear,
    "bias_warmup": bias_warmup, "bias_restart": bias_restart, "periodic_line": periodic_line,
    "bias_supply_voltage": recorded_quantity("bias_supply_voltage", "voltage", "V", 27.0, 0.5, "U_supply"),
    "bias_pressure": recorded_quantity("bias_pressure", "pressure", "hPa", 1000.0, 8.0, "p_air"),
    "bias_magnetic_field": recorded_quantity("bias_magnetic_field", "magnetic_field_y", "uT", 20.0, 5.0, "B_y"),
    "bias_on_aux": recorded_quantity("bias_on_aux", "other", "%", 45.0, 8.0, "humidity"),
    "bias_on_current": recorded_quantity("bias_on_aux", "current", "mA", 850.0, 40.0, "I_motor"),
    "bias_pickoff_offset": recorded_quantity("bias_pickoff_offset", "other", "mrad", 0.02, 0.05, "pickoff_angle", kind="dtg"),
    "bias_electronics_temperature": electronics_temperature, "vibration_rectification": vibration_rectification,
    "earth_tide": earth_tide, "gravity_anomaly": gravity_anomaly, "intermittent_jump": intermittent_jump,
    "output_stuck": output_stuck, "quantisation": quantisation,
    **{effect: thermal(effect) for effect in (
        "bias_temperature", "bias_temperature_sq", "bias_temperature_cubic", "bias_temperature_rate", "bias_thermal_lag",
        "bias_temperature_gradient", "bias_thermal_hysteresis")},
}
