"""A case in the making: instruments, what is hidden in them, and the files that RECORDING describes."""

import gzip
import json
from dataclasses import dataclass, field

import numpy as np

from motion import Motion, at_rest
from noise import Noise, gain_in

DEGREE = np.pi / 180.0
UNITS = {
    "rad/s": 1.0, "deg/s": DEGREE, "deg/h": DEGREE / 3600.0,
    "m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "ug": 9.80665e-6, "m/s": 1.0,
}
GYROS = ("dtg", "fog", "rlg", "mems_gyro")


@dataclass
class Instrument:
    """A sensor: values in SI units."""

    name: str
    kind: str
    unit: str
    nominal: Noise
    axis: tuple = None
    spin_axis: tuple = None
    group: str = None
    relative: bool = False
    quantum: float = 0.0
    bias: float = 0.0
    scale_factor: float = 0.0
    says_nothing: bool = False  # the case has no [sensor.nominal]
    temperature_bias: dict = None
    truth: Noise = None  # None: as nominal
    ideal: np.ndarray = None  # what a perfect sensor would read
    hidden: np.ndarray = None  # what hidden effects add
    extra_noise: list = field(default_factory=list)  # functions of (rng, count) -> series
    spoils: list = field(default_factory=list)  # functions of (rng, readings) -> readings
    column: str = None

    @property
    def si(self):
        return UNITS[self.unit]


@dataclass
class Auxiliary:
    column: str
    quantity: str
    unit: str
    values: np.ndarray
    near: str = None
    position_m: tuple = None


@dataclass
class Case:
    family: str
    title: str
    step_s: float
    t: np.ndarray  # from 0, evenly spaced
    motion_kind: str
    motion: Motion = None
    recorded: str = "rate"  # rate | attitude | both: how a recorded motion is given
    instruments: list = field(default_factory=list)
    auxiliaries: list = field(default_factory=list)
    site: dict = None
    loop: dict = None
    loop_model: tuple = None  # state space of the loop's noise, for gains
    parity: np.ndarray = None  # axes of redundant sensors: only what they disagree in is seen
    effects: list = field(default_factory=list)
    kind: str = "hidden"  # hidden | null | out_of_catalogue
    kept: np.ndarray = None  # rows that are in the table
    origin_s: float = 0.0
    static_tilt_deg: tuple = None

    def instrument(self, name):
        return next(i for i in self.instruments if i.name == name)

    def look(self):
        """Ideal readings of all instruments from the motion."""
        rate = force = velocity = None
        for instrument in self.instruments:
            axis = np.array(instrument.axis if instrument.axis is not None else (1.0, 0.0, 0.0))
            if instrument.kind in GYROS:
                rate = self.motion.rate(self.t) if rate is None else rate
                instrument.ideal = axis @ rate
            elif instrument.kind == "accelerometer":
                force = self.motion.specific_force(self.t) if force is None else force
                instrument.ideal = axis @ force
            else:
                velocity = self.motion.body_velocity(self.t) if velocity is None else velocity
                instrument.ideal = axis @ velocity
            instrument.hidden = np.zeros_like(self.t)

    def gain(self, errors):
        """Nats that an oracle is expected to gain by `errors`, a dictionary of series by name of the instrument."""
        share = 1.0 if self.kept is None else self.kept.mean()
        if self.loop_model is not None:
            return share * sum(gain_in(self.loop_model, error) for error in errors.values())
        if self.parity is not None:
            names = [i.name for i in self.instruments]
            stacked = np.array([errors.get(name, 0.0 * self.t) for name in names])
            rows = np.linalg.svd(self.parity)[0][:, self.parity.shape[1]:].T
            if len(names) == 2:  # two different sensors: the noise of their difference
                noise = self.instruments[0].nominal.plus(self.instruments[1].nominal)
                return share * noise.gain(stacked[0] - stacked[1], self.step_s)
            noise = self.instruments[0].nominal
            return share * sum(noise.gain(row @ stacked, self.step_s) for row in rows)
        total = 0.0
        for name, error in errors.items():
            instrument = self.instrument(name)
            noise = instrument.nominal
            if instrument.quantum > 0.0:
                noise = noise.plus(Noise(white=instrument.quantum / np.sqrt(12.0)))
            total += noise.gain(error, self.step_s, instrument.relative)
        return share * total

    def hide(self, sensor, effect, shapes, target, parameters=None, rng=None, coefficient="coefficient", **more):
        """Hides `size * shapes` with the size that gains `target` nats; `shapes` by instrument, in SI units."""
        size = np.sqrt(target / self.gain(shapes))
        if rng is not None and rng.random() < 0.5:
            size = -size
        for name, shape in shapes.items():
            self.instrument(name).hidden += size * shape
        found = dict(parameters or {})
        if coefficient:
            found[coefficient] = size
        self.note(sensor, effect, found, target, **more)
        return size

    def hide_nonlinear(self, sensor, effect, errors_of, start, target, name, limit, parameters=None, **more):
        """Hides `errors_of(value)` with the value that gains `target` nats, by regula falsi on the root of the gain."""
        value = start
        for _ in range(6):
            gain = self.gain(errors_of(value))
            value = float(np.clip(value * np.sqrt(target / max(gain, 1e-300)), *limit))
        errors = errors_of(value)
        for key, error in errors.items():
            self.instrument(key).hidden += error
        self.note(sensor, effect, {name: value, **(parameters or {})}, self.gain(errors), **more)
        return value

    def note(self, sensor, effect, parameters, gain, onset_s=None, unsigned=False, also=()):
        """What the answer says: parameters in SI units; `also`: identifiers that name the same physics."""
        self.effects.append({
            "sensor": sensor, "effect": effect, "also": list(also), "onset_s": onset_s, "gain_nats": float(gain),
            "parameters": {key: float(value) for key, value in parameters.items()}, "unsigned": unsigned,
        })

    def readings(self, rng):
        """Columns of the instruments in their units."""
        columns = {}
        for instrument in self.instruments:
            values = (1 + instrument.scale_factor) * instrument.ideal + instrument.bias + instrument.hidden
            noise = instrument.truth or instrument.nominal
            values = values + noise.sample(rng, len(self.t), self.step_s)
            for extra in instrument.extra_noise:
                values = values + extra(rng, len(self.t))
            for spoil in instrument.spoils:
                values = spoil(rng, values)
            if instrument.quantum > 0.0:
                values = instrument.quantum * np.round(values / instrument.quantum)
            columns[instrument.column] = values / instrument.si
        return columns

    def answer(self):
        return {"format": "independent-answer/1", "kind": self.kind, "family": self.family, "step_s": self.step_s,
                "duration_s": float(self.t[-1]), "rows": int(len(self.t)), "effects": self.effects,
                "units": {i.name: i.unit for i in self.instruments}}


# How the columns of a laboratory are called; {} is the sensor.
COLUMN_STYLES = ("{}", "{}_out", "{} [{unit}]", "IMU.{}", "ch_{}", "{}  raw")


def write(case, rng, folder):
    """Writes case.toml and its table."""
    folder.mkdir(parents=True, exist_ok=True)
    style = str(rng.choice(COLUMN_STYLES))
    for instrument in case.instruments:
        instrument.column = style.format(instrument.name, unit=instrument.unit)
    time = str(rng.choice(["t", "time", "time_s", "UTC", "Zeit", "seconds since start"]))
    case.origin_s = float(case.origin_s or rng.choice([0.0, 0.0, -3600.0, 1.7e9, 345600.0, 12.5]))
    columns = {time: case.origin_s + case.t}
    columns.update(case.readings(rng))
    for auxiliary in case.auxiliaries:
        columns[auxiliary.column] = auxiliary.values
    columns.update(motion_columns(case))
    table = np.array(list(columns.values()))
    if case.kept is not None:
        table = table[:, case.kept]
    # Now and then a reading is missing.
    if rng.random() < 0.3:
        lost = rng.random((len(case.instruments), table.shape[1])) < rng.choice([0.001, 0.02])
        block = table[1 : 1 + len(case.instruments)]
        block[lost] = np.nan
    form = str(rng.choice(["csv", "csv", "csv.gz", "parquet"]))
    write_table(folder / f"recording.{form}", list(columns), table, rng)
    (folder / "case.toml").write_text(case_text(case, f"recording.{form}", time))


def motion_columns(case):
    if case.motion_kind != "recorded" and not (case.motion_kind == "velocity_error" and case.motion is not None):
        return {}
    columns = {}
    if case.recorded in ("rate", "both") and case.motion_kind == "recorded":
        columns.update(zip(("ref_wx", "ref_wy", "ref_wz"), case.motion.rate(case.t)))
    if case.recorded in ("rate", "both", "force"):
        columns.update(zip(("ref_fx", "ref_fy", "ref_fz"), case.motion.specific_force(case.t)))
    if case.recorded in ("attitude", "both"):
        roll, pitch, yaw = case.motion.attitude(case.t)
        # Angles as instruments give them: between -180 and 180 degrees.
        columns.update(zip(("roll", "pitch", "yaw"), ((a + np.pi) % (2 * np.pi) - np.pi for a in (roll, pitch, yaw))))
        columns.update(zip(("vn", "ve", "vd"), case.motion.velocity_ned(case.t)))
    return columns


def write_table(path, names, table, rng):
    if path.suffix == ".parquet":
        import pyarrow
        import pyarrow.parquet
        arrays = [pyarrow.array(column, from_pandas=True) for column in table]
        pyarrow.parquet.write_table(pyarrow.table(arrays, names=names), path)
        return
    missing = str(rng.choice(["nan", "", "NaN"]))
    quoted = [f'"{name}"' if "," in name or rng.random() < 0.1 else name for name in names]
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "wt", encoding="utf-8") as file:
        file.write(",".join(quoted) + "\n")
        for moment, *row in table.T:
            cells = [f"{value:.12g}" if value == value else missing for value in row]
            file.write(",".join([f"{moment:.16g}", *cells]) + "\n")


def toml(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return repr(float(f"{float(value):.9g}"))


def section(header, entries):
    lines = [header] + [f"{key} = {toml(value)}" for key, value in entries.items() if value is not None]
    return "\n".join(lines) + "\n"


def case_text(case, path, time):
    text = [f'format = "schuler-case/1"\ntitle = {toml(case.title)}\n']
    text.append(section("[recording]", {"path": path, "time": time, "step_s": case.step_s}))
    if case.site:
        text.append(section("[site]", case.site))
    motion = {"kind": case.motion_kind}
    if case.motion_kind == "static":
        roll, pitch, yaw = np.degrees(case.motion.attitude(np.zeros(1))[:, 0])
        motion["attitude_deg"] = {"roll": roll, "pitch": pitch, "heading": yaw % 360.0}
    columns = motion_columns(case)
    for key, names in (("rate", ("ref_wx", "ref_wy", "ref_wz")), ("specific_force", ("ref_fx", "ref_fy", "ref_fz")),
                       ("velocity_ned", ("vn", "ve", "vd")), ("attitude_rad", ("roll", "pitch", "yaw"))):
        if names[0] in columns:
            motion[key] = names
    text.append(section("[motion]", motion))
    if case.loop:
        text.append(section("[loop]", case.loop))
    for instrument in case.instruments:
        text.append(section("[[sensor]]", {
            "id": instrument.name, "kind": instrument.kind, "column": instrument.column, "unit": instrument.unit,
            "axis": instrument.axis, "spin_axis": instrument.spin_axis, "group": instrument.group,
            "quantisation": instrument.quantum / instrument.si if instrument.quantum else None,
            "relative": True if instrument.relative else None,
        }))
        if not instrument.says_nothing:
            text.append(section("  [sensor.nominal]", nominal(instrument)))
    for auxiliary in case.auxiliaries:
        text.append(section("[[aux]]", {
            "column": auxiliary.column, "quantity": auxiliary.quantity, "unit": auxiliary.unit,
            "near": auxiliary.near, "position_m": auxiliary.position_m,
        }))
    return "\n".join(text)


def nominal(instrument):
    noise, si = instrument.nominal, instrument.si
    entries = {"bias": instrument.bias / si}
    if instrument.scale_factor:
        entries["scale_factor_ppm"] = instrument.scale_factor * 1e6
    entries["white"] = noise.white / si
    for sigma, tau_s in noise.markov:
        entries["markov"] = {"sigma": sigma / si, "tau_s": tau_s}
    for sigma, alpha, beta in noise.exp_cos:
        entries["exp_cos"] = {"sigma": sigma / si, "alpha": alpha, "beta": beta}
    if noise.random_walk:
        entries["random_walk"] = noise.random_walk / si
    if instrument.temperature_bias:
        entries["temperature_bias"] = instrument.temperature_bias
    return entries


def rest(case_site, roll=0.0, pitch=0.0, yaw=0.0):
    """The motion of a body at rest at a site; angles in degrees."""
    return at_rest(case_site["latitude_deg"] * DEGREE, case_site["altitude_m"], roll * DEGREE, pitch * DEGREE,
                   yaw * DEGREE)
