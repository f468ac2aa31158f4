"""Cases in known motion: rate tables, tumbling, vehicles. The motion is continuous and is sampled by each sensor."""

import copy

import numpy as np

from case_file import DEGREE, Auxiliary, Case
from motion import Course, Motion, swing, tumble, voyage
from settings import AXES, UP_TO_ROWS, add_triads, any_sensor, distractor, log_uniform, lose_rows, record, site, target
from surroundings import chamber, first_order, rod, thermometer

GYRO_KINDS = ("dtg", "dtg", "fog", "rlg", "mems_gyro")


def moving(rng, family, title, motion, kinds, grouped=False, least_s=600.0, most_s=4 * 3600.0, steps=(1.0, 0.1, 0.02),
           fewest=3000, recorded=None):
    """Sensors on a body whose motion was recorded."""
    step_s, t = record(rng, least_s, most_s, steps, UP_TO_ROWS, fewest)
    place = site(rng)
    case = Case(family, title, step_s, t, "recorded", site=place)
    case.motion = motion(rng, case, place["latitude_deg"] * DEGREE, place["altitude_m"])
    case.recorded = recorded or str(rng.choice(["rate", "attitude", "both"]))
    add_triads(rng, case, kinds, grouped)
    return case


def swinging(rng, case, latitude, altitude_m):
    return swing(rng, case.step_s * log_uniform(rng, 80, 600), latitude, altitude_m)


def tumbling(rng, case, latitude, altitude_m):
    return tumble(rng, case.t[-1], case.step_s, latitude, altitude_m)


def driving(rng, case, latitude, altitude_m):
    speed = log_uniform(rng, 3.0, 60.0)
    return voyage(rng, case.t[-1], latitude, altitude_m, speed, max(30 * case.step_s, case.t[-1] / 150))


def spinning(rng, case, latitude, altitude_m):
    """A table that turns for a while, one way or the other, and rests."""
    yaw = Course(rng.uniform(0, 6))
    bursts = int(rng.integers(4, 9))
    for burst in range(bursts):
        half = case.t[-1] / bursts * rng.uniform(0.05, 0.12)
        yaw.steps.append((rng.choice([-1, 1]) * rng.uniform(0.3, 1.5) * 2 * half, (burst + 0.4) * case.t[-1] / bursts,
                          half))
    still = Course()
    return Motion(Course(rng.uniform(-0.2, 0.2)), Course(rng.uniform(-0.2, 0.2)), yaw, still, still, still, latitude, altitude_m)


def accelerating(rng, case, latitude, altitude_m):
    """Runs on a sled: hard acceleration, rest."""
    motion = voyage(rng, case.t[-1], latitude, altitude_m, 0.01, case.t[-1] / 20)
    north = Course()
    speed = 0.0
    runs = int(rng.integers(4, 9))
    for run in range(runs):
        change = rng.uniform(100, 300) * (1 if speed <= 0 else -1)
        speed += change
        north.steps.append((change, (run + 0.5) * case.t[-1] / runs, max(5 * case.step_s, 8.0)))
    motion.north = north
    motion.yaw = Course(rng.uniform(-0.3, 0.3))
    return motion


def across(sensor):
    """Another axis than the sensor's own."""
    return [a for a in AXES if abs(np.dot(a, sensor.axis)) < 0.5]


def with_input(effect, shape_of, kinds=None, motion=swinging, group_share=0.0, **settings):
    """An effect that is linear in its coefficient; `shape_of(rng, case, sensor) -> series` in SI units."""
    def make(rng):
        kind = str(rng.choice(kinds or (*GYRO_KINDS, "accelerometer", "accelerometer")))
        case = moving(rng, "input", f"{motion.__name__.capitalize()} body, {kind}", motion, [kind], **settings)
        sensor = any_sensor(rng, case)
        shape = shape_of(rng, case, sensor)
        case.hide(sensor.name, effect, {sensor.name: shape}, target(rng), rng=rng,
                  unsigned=effect in ("g_quadrature", "g_spin", "g2_cross", "g2_anisoelasticity", "anisoinertia"))
        if rng.random() < 0.3:
            distractor(rng, case)
        lose_rows(rng, case)
        return case
    return make


def along(case, axis, what):
    return np.array(axis) @ (case.motion.rate(case.t) if what == "rate" else case.motion.specific_force(case.t))


def own(case, sensor):
    return sensor.ideal


def felt(case, sensor, direction):
    """Specific force along the input, the other input or the spin axis of a tuned gyro."""
    spin, inward = np.array(sensor.spin_axis), np.array(sensor.axis)
    return along(case, {"input": inward, "spin": spin, "other": np.cross(spin, inward)}[direction], "force")


def across_input(rng, case, sensor):
    axis = across(sensor)[int(rng.integers(2))]
    return along(case, axis, "force" if sensor.kind == "accelerometer" else "rate")


def heated(rng, case, sensor):
    """Temperature less 20 degC, with its thermometer put into the case."""
    inside, = rod(case.t, chamber(rng, case.t, 10.0), case.t[-1] / 30, [0.6])
    case.auxiliaries.append(Auxiliary("temp", "temperature", "degC", thermometer(rng, inside), near=sensor.name))
    return inside - 20.0


def dead_zone(rng):
    """A gyro that does not answer to small rates; the table crosses zero slowly."""
    case = moving(rng, "failures", "Slow swing through zero rate", lambda rng, case, latitude, altitude: swing(
        rng, case.step_s * 1500, latitude, altitude, amplitude=(0.0003, 0.002)), ["dtg"], steps=(0.1, 0.02))
    sensor = any_sensor(rng, case)
    shape = lambda limit: {sensor.name: np.where(np.abs(sensor.ideal) < limit, -sensor.ideal, 0.0)}
    case.hide_nonlinear(sensor.name, "dead_zone", shape, 3 * sensor.nominal.white, target(rng), "threshold",
                        (0.1 * sensor.nominal.white, 0.5 * np.abs(sensor.ideal).max()))
    return case


def output_saturated(rng):
    kind = str(rng.choice(["fog", "mems_gyro", "accelerometer"]))
    case = moving(rng, "failures", "Beyond the range", swinging, [kind])
    sensor = any_sensor(rng, case)
    middle = sensor.bias
    limit = middle + float(np.quantile(np.abs(sensor.ideal), rng.uniform(0.9, 0.99)))
    sensor.spoils.append(lambda _, values: np.clip(values, -limit, limit))
    beyond = np.maximum(np.abs(sensor.ideal) - limit, 0.0)
    case.note(sensor.name, "output_saturated", {"limit": limit}, min(case.gain({sensor.name: beyond}), 1e6))
    return case


def later(rng, effect):
    """The whole instrument, or one sensor of it, is late: a pure delay, or a first-order lag."""
    grouped = rng.random() < 0.6
    kind = str(rng.choice([*GYRO_KINDS, "accelerometer"]))
    case = moving(rng, "input", "Instrument beside a reference", swinging if kind != "accelerometer" or rng.random() < 0.5
                  else driving, [kind], grouped=grouped, steps=(0.1, 0.02, 0.01, 0.001))
    late = [i for i in case.instruments] if grouped else [any_sensor(rng, case)]
    quantity = case.motion.specific_force if kind == "accelerometer" else case.motion.rate

    def errors_of(delay_s):
        if effect == "time_delay":
            moved = quantity(case.t - delay_s) - quantity(case.t)
        else:
            # Twice as fine as the samples, so that the motion between them counts.
            fine = np.arange(2 * len(case.t)) * case.step_s / 2
            felt = quantity(fine)
            moved = np.array([first_order(fine, row, delay_s)[::2] - row[::2] for row in felt])
        return {i.name: np.array(i.axis) @ moved for i in late}

    name = "delay_s" if effect == "time_delay" else "tau_s"
    case.hide_nonlinear(case.instruments[0].group if grouped else late[0].name, effect, errors_of, case.step_s, target(rng),
                        name, (1e-7, 0.6))
    return case


def mounting(rng):
    """An instrument that was put in turned by a small angle."""
    kind = str(rng.choice([*GYRO_KINDS, "accelerometer"]))
    case = moving(rng, "input", "Instrument mounted by hand", swinging if kind != "accelerometer" else tumbling, [kind],
                  grouped=True)
    angle = rng.standard_normal(3)
    what = case.motion.specific_force(case.t) if kind == "accelerometer" else case.motion.rate(case.t)
    turned = -np.cross(angle / np.linalg.norm(angle), what, axis=0)
    shapes = {i.name: np.array(i.axis) @ turned for i in case.instruments}
    case.hide(case.instruments[0].group, "misalignment", shapes, target(rng) + 20, coefficient=None)
    return case


def lever_arm(rng):
    case = moving(rng, "input", "Accelerometers away from the reference point", swinging, ["accelerometer"], grouped=True,
                  steps=(0.02, 0.01, 0.005))
    arm = rng.standard_normal(3)
    arm /= np.linalg.norm(arm)
    felt_there = case.motion.felt_at(case.t, arm)
    shapes = {i.name: np.array(i.axis) @ felt_there for i in case.instruments}
    size = np.sqrt((target(rng) + 20) / case.gain(shapes))
    for name, shape in shapes.items():
        case.instrument(name).hidden += size * shape
    case.note(case.instruments[0].group, "lever_arm", dict(zip(("arm_x_m", "arm_y_m", "arm_z_m"), size * arm)),
              case.gain({name: size * shape for name, shape in shapes.items()}))
    return case


def earth_rate_attitude(rng):
    """A heading that is wrong by a small angle: the Earth's rate is projected wrongly."""
    case = moving(rng, "input", "Turns of a table, heading by compass", tumbling, [str(rng.choice(["dtg", "fog", "rlg"]))],
                  grouped=True, steps=(1.0, 0.5), least_s=3600.0, recorded="attitude")

    def errors_of(angle):
        real = copy.deepcopy(case.motion)
        real.yaw.constant += angle
        rate = real.rate(case.t) - case.motion.rate(case.t)
        return {i.name: np.array(i.axis) @ rate for i in case.instruments}

    case.hide_nonlinear(case.instruments[0].group, "earth_rate_attitude", errors_of, 0.01, target(rng), "heading", (1e-6, 0.5))
    return case


def coning(rng):
    """Part of a coning motion that the digital integration of the rates rectifies."""
    case = moving(rng, "input", "Coning table", lambda rng, case, latitude, altitude: swing(
        rng, case.step_s * 40, latitude, altitude, amplitude=(0.02, 0.05), leaning=0.0), [str(rng.choice(["fog", "rlg"]))],
        steps=(0.01, 0.005), recorded="rate")
    sensor = any_sensor(rng, case)
    angles = case.motion.attitude(case.t)
    angles = angles - angles.mean(axis=1, keepdims=True)
    rates = case.motion.rate(case.t)
    product = 0.5 * np.cross(angles, rates, axis=0)
    case.hide(sensor.name, "coning_sculling", {sensor.name: np.array(sensor.axis) @ product}, target(rng), rng=rng,
              coefficient=None)
    return case


def torquer_self_heating(rng):
    case = moving(rng, "input", "Bursts of rate", spinning, ["dtg"], grouped=True, least_s=3600.0, steps=(1.0, 0.5))
    sensor = max(case.instruments, key=lambda i: np.abs(i.ideal).max())
    tau_s = log_uniform(rng, 20.0, case.t[-1] / 12)
    heat = first_order(case.t, sensor.ideal**2, tau_s)
    case.hide(sensor.name, "torquer_self_heating", {sensor.name: heat}, target(rng), {"tau_s": tau_s}, rng)
    return case


def post_g_transient(rng):
    case = moving(rng, "input", "Sled", accelerating, ["accelerometer"], least_s=1800.0, steps=(1.0, 0.5))
    sensor = case.instruments[0]
    tau_s = log_uniform(rng, 60.0, case.t[-1] / 15)
    strain = first_order(case.t, sensor.ideal, tau_s)
    case.hide(sensor.name, "post_g_transient", {sensor.name: strain}, target(rng), {"tau_s": tau_s}, rng)
    return case


TUMBLE = {"motion": tumbling, "kinds": ("dtg",), "steps": (1.0, 0.5, 2.0), "least_s": 1800.0, "most_s": 6 * 3600.0}
CATALOGUE = {
    "scale_factor": with_input("scale_factor", lambda rng, case, s: s.ideal),
    "scale_factor_asymmetry": with_input("scale_factor_asymmetry", lambda rng, case, s: np.abs(s.ideal), GYRO_KINDS),
    "scale_factor_quadratic": with_input("scale_factor_quadratic", lambda rng, case, s: s.ideal**2, ("accelerometer",), tumbling),
    "scale_factor_cubic": with_input("scale_factor_cubic", lambda rng, case, s: s.ideal**3, ("accelerometer", "fog")),
    "scale_factor_odd_quadratic": with_input("scale_factor_odd_quadratic", lambda rng, case, s: s.ideal * np.abs(s.ideal),
                                             ("accelerometer",), tumbling),
    "scale_factor_temperature": with_input("scale_factor_temperature", lambda rng, case, s: s.ideal * heated(rng, case, s)),
    "misalignment": with_input("misalignment", across_input),
    "misalignment_temperature": with_input("misalignment_temperature", lambda rng, case, s: across_input(rng, case, s)
                                           * heated(rng, case, s)),
    "cross_coupling": with_input("cross_coupling", lambda rng, case, s: s.ideal * across_input(rng, case, s),
                                 ("accelerometer",), tumbling),
    "g_mass_unbalance": with_input("g_mass_unbalance", lambda rng, case, s: felt(case, s, "input"), **TUMBLE),
    "g_quadrature": with_input("g_quadrature", lambda rng, case, s: felt(case, s, "other"), **TUMBLE),
    "g_spin": with_input("g_spin", lambda rng, case, s: felt(case, s, "spin"), **TUMBLE),
    "g2_anisoelasticity": with_input("g2_anisoelasticity", lambda rng, case, s: felt(case, s, "input") * felt(case, s, "spin"),
                                     **TUMBLE),
    "g2_cross": with_input("g2_cross", lambda rng, case, s: felt(case, s, "other") * felt(case, s, "spin"), **TUMBLE),
    "g_mass_unbalance_temperature": with_input("g_mass_unbalance_temperature", lambda rng, case, s: felt(case, s, "input")
                                               * heated(rng, case, s), **TUMBLE),
    "anisoinertia": with_input("anisoinertia", lambda rng, case, s: s.ideal * along(case, s.spin_axis, "rate"), ("dtg",)),
    "angular_acceleration": with_input("angular_acceleration", lambda rng, case, s: np.array(s.axis)
                                       @ case.motion.angular_acceleration(case.t), ("dtg", "fog")),
    "time_delay": lambda rng: later(rng, "time_delay"), "bandwidth_lag": lambda rng: later(rng, "bandwidth_lag"),
    "mounting": mounting, "lever_arm": lever_arm, "earth_rate_attitude": earth_rate_attitude, "coning_sculling": coning,
    "torquer_self_heating": torquer_self_heating, "post_g_transient": post_g_transient, "dead_zone": dead_zone,
    "output_saturated": output_saturated,
}
