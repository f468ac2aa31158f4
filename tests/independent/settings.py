"""Instruments, sites and records as laboratories have them, drawn at random."""

import numpy as np

from case_file import UNITS, Auxiliary, Case, Instrument, rest
from noise import Noise
from surroundings import smooth_wander

DEG_H = UNITS["deg/h"]
MICRO_G = UNITS["ug"]

# White noise in one sample of 1 s, and the slow part, SI: (least, most) each.
LEVELS = {
    "dtg": ((0.003 * DEG_H, 0.05 * DEG_H), (0.002 * DEG_H, 0.03 * DEG_H)),
    "fog": ((0.05 * DEG_H, 1.0 * DEG_H), (0.005 * DEG_H, 0.05 * DEG_H)),
    "rlg": ((0.05 * DEG_H, 0.5 * DEG_H), (0.001 * DEG_H, 0.01 * DEG_H)),
    "mems_gyro": ((5 * DEG_H, 60 * DEG_H), (2 * DEG_H, 20 * DEG_H)),
    "accelerometer": ((2 * MICRO_G, 40 * MICRO_G), (1 * MICRO_G, 15 * MICRO_G)),
    "doppler": ((0.005, 0.05), (0.005, 0.03)),
    "ins_velocity": ((0.001, 0.005), (0.001, 0.01)),
    "gnss_velocity": ((0.01, 0.05), (0.005, 0.03)),
}
UNITS_OF = {
    "dtg": ("deg/h", "deg/h", "rad/s", "deg/s"), "fog": ("deg/h", "deg/s", "rad/s"), "rlg": ("deg/h", "rad/s"),
    "mems_gyro": ("deg/s", "rad/s", "deg/h"), "accelerometer": ("m/s^2", "ug", "mg", "g"),
    "doppler": ("m/s",), "ins_velocity": ("m/s",), "gnss_velocity": ("m/s",),
}
GYRO_KINDS = ("dtg", "dtg", "fog", "rlg", "mems_gyro")
# Rows of most records: enough for every effect, and few enough for hundreds of cases in an hour.
UP_TO_ROWS = 12_000
AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def log_uniform(rng, least, most):
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))


def target(rng):
    """What an oracle gains by an effect, nats."""
    return log_uniform(rng, 14.0, 300.0)


def noise_of(rng, kind, step_s, duration_s):
    (white_least, white_most), (slow_least, slow_most) = LEVELS[kind]
    noise = Noise(white=log_uniform(rng, white_least, white_most) / np.sqrt(step_s))
    structure = rng.choice(["white", "markov", "markov", "markov", "exp_cos", "random_walk"])
    sigma = log_uniform(rng, slow_least, slow_most)
    tau_s = log_uniform(rng, max(10 * step_s, duration_s / 1000), max(20 * step_s, duration_s / 15))
    if structure == "markov":
        noise.markov.append((sigma, tau_s))
    elif structure == "exp_cos":
        noise.exp_cos.append((sigma, 1 / tau_s, log_uniform(rng, 0.5, 6.0) / tau_s))
    elif structure == "random_walk":
        noise.random_walk = sigma * np.sqrt(2 / (20 * tau_s))
    return noise


def instrument(rng, kind, name, step_s, duration_s, axis=None, group=None, noise=None):
    unit = str(rng.choice(UNITS_OF[kind]))
    made = Instrument(name, kind, unit, noise or noise_of(rng, kind, step_s, duration_s), axis=axis, group=group)
    if kind == "dtg":
        across = [a for a in AXES if abs(np.dot(a, axis)) < 0.5]
        made.spin_axis = across[int(rng.integers(len(across)))]
    if kind in ("dtg", "fog", "rlg", "mems_gyro", "accelerometer") and rng.random() < 0.5:
        made.bias = float(f"{rng.normal() * 20 * made.nominal.white / made.si:.3g}") * made.si
    if rng.random() < 0.2:
        made.scale_factor = float(f"{rng.normal() * 100:.3g}") * 1e-6
    return made


def site(rng):
    return {"latitude_deg": float(f"{rng.uniform(-65, 65):.5g}"), "altitude_m": float(f"{rng.uniform(0, 1500):.4g}")}


def record(rng, least_s, most_s, steps, rows, fewest=600):
    """A duration and a step: evenly spaced times from zero. One record in eight may be four times as long as `rows`."""
    rows *= 4 if rng.random() < 0.125 else 1
    step_s = float(rng.choice(steps))
    duration_s = log_uniform(rng, least_s, most_s)
    count = int(np.clip(duration_s / step_s, fewest, rows))
    return step_s, np.arange(count) * step_s


def lose_rows(rng, case):
    """Rows that a logger lost: now and then none, single ones, or whole stretches."""
    count = len(case.t)
    kind = rng.choice(["none", "none", "single", "stretches"])
    if kind == "none":
        return
    kept = np.ones(count, dtype=bool)
    if kind == "single":
        kept = rng.random(count) > 0.01
    else:
        for _ in range(int(rng.integers(1, 5))):
            start = int(rng.integers(count))
            kept[start : start + int(rng.integers(2, max(3, count // 40)))] = False
    kept[0] = kept[-1] = True
    case.kept = kept


def gyro_names(rng, count):
    styles = [("gyro_x", "gyro_y", "gyro_z"), ("Gx", "Gy", "Gz"), ("omega1", "omega2", "omega3"), ("DG-1", "DG-2", "DG-3")]
    return styles[int(rng.integers(len(styles)))][:count]


def accelerometer_names(rng, count):
    styles = [("acc_x", "acc_y", "acc_z"), ("Ax", "Ay", "Az"), ("QA1", "QA2", "QA3")]
    return styles[int(rng.integers(len(styles)))][:count]


def bench(rng, family, title, kinds=None, least_s=1200.0, most_s=2 * 86400.0, steps=(1.0, 1.0, 0.1, 0.5, 2.0, 10.0),
          rows=UP_TO_ROWS):
    """Sensors at rest in some attitude."""
    step_s, t = record(rng, least_s, most_s, steps, rows)
    place = site(rng)
    case = Case(family, title, step_s, t, "static", site=place)
    case.motion = rest(place, *(float(f"{a:.4g}") for a in (rng.choice([0.0, 0.0, 90.0, 33.0]), rng.choice([0.0, 0.0, 12.5]),
                                                             rng.uniform(0, 360))))
    kinds = kinds or [str(rng.choice(GYRO_KINDS)), "accelerometer"][: int(rng.integers(1, 3))]
    add_triads(rng, case, kinds)
    return case


def add_triads(rng, case, kinds, grouped=False):
    """Up to three orthogonal sensors of each kind."""
    for kind in kinds:
        count = 3 if grouped else int(rng.integers(1, 4))
        names = accelerometer_names(rng, 3) if kind == "accelerometer" else gyro_names(rng, 3)
        noise = noise_of(rng, kind, case.step_s, case.t[-1])
        unit = str(rng.choice(UNITS_OF[kind]))
        for axis, name in list(zip(AXES, names))[:count]:
            # Sensors of one kind are of one make, mostly.
            own = noise if rng.random() < 0.7 else noise_of(rng, kind, case.step_s, case.t[-1])
            made = instrument(rng, kind, name, case.step_s, case.t[-1], axis, noise=own)
            made.unit = unit
            made.group = f"{'accelerometers' if kind == 'accelerometer' else 'gyro_block'}" if grouped else None
            case.instruments.append(made)
    case.look()


def any_sensor(rng, case, kinds=None):
    eligible = [i for i in case.instruments if kinds is None or i.kind in kinds]
    return eligible[int(rng.integers(len(eligible)))]


def distractor(rng, case):
    """Now and then something is recorded that has nothing to do with anything."""
    if rng.random() < 0.5:
        quantity, unit, level, spread = [
            ("voltage", "V", 27.0, 0.3), ("temperature", "degC", 24.0, 2.0), ("pressure", "hPa", 1013.0, 5.0),
            ("other", "%", 40.0, 6.0), ("current", "A", 1.2, 0.05), ("magnetic_field_x", "uT", 18.0, 1.0),
        ][int(rng.integers(6))]
        wander = smooth_wander(rng, len(case.t), case.step_s, case.t[-1] / rng.uniform(5, 40))
        case.auxiliaries.append(Auxiliary(f"aux_{quantity}", quantity, unit, level + spread * wander))
