"""Writes a case and a table for each set that came later.

    more_cases.py FOLDER

As make_cases.py does. Sensors of any kind and a simulator's prediction are written as the format has them; a program that does not
know these refuses the case. Where nothing is known of a sensor's noise none is stated.
"""

import numpy as np
import pandas as pd
from common import DATA, SKAB, STANDARD_GRAVITY
from make_cases import DEGREE, sensor, temperature, write
from still import self_calibration, standstills

UNKNOWN = {"kind": "unknown"}
AXES = np.eye(3).tolist()
LETTERS = "xyz"


def read(name, **options):
    return pd.read_csv(DATA / f"{name}.csv.gz", **options)


def other(name, unit, **more):
    return {"id": name, "kind": "other", "column": name, "unit": unit, **more}


def xsens_static():
    """Units side by side at rest and level, x forward, y left, z up. Data sheet: 0.007 deg/s/sqrt(Hz), 120 ug/sqrt(Hz), over 60 Hz."""
    gyro, accelerometer = 0.007 * 60**0.5, 120e-6 * STANDARD_GRAVITY * 60**0.5
    for unit in (1, 2):
        raw = read(f"ansfl_xsens_static/x_stat_{unit}", usecols=range(10)).iloc[1:]
        raw = raw.replace([np.inf, -np.inf], np.nan)
        table = pd.DataFrame({"t_s": raw.Time, **{f"g{k}": raw[f"w_{k}"] for k in LETTERS}, **{f"a{k}": raw[f"f_{k}"] for k in LETTERS}})
        table = table.dropna()
        up = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
        sensors = [sensor(f"g{k}", "mems_gyro", "deg/s", axis, gyro) for k, axis in zip(LETTERS, up)]
        sensors += [sensor(f"a{k}", "accelerometer", "m/s^2", axis, accelerometer) for k, axis in zip(LETTERS, up)]
        motion = {"kind": "static", "attitude_deg": {"roll": 0.0, "pitch": 0.0, "heading": 0.0}}
        write(f"ansfl_xsens_static/unit_{unit}", f"MEMS unit {unit} at rest", table, 1 / 120, motion, sensors,
              site={"latitude_deg": 32.76, "altitude_m": 200.0})


def four_imus():
    """Four units on one quadrotor, nominally parallel: of twelve gyro axes nine are redundant."""
    tables = [read(f"ansfl_quadrotor_four_imus/Horizontal_path_1_IMU_{unit}") for unit in range(1, 5)]
    table, sensors = {"t_s": tables[0].time}, []
    for unit, raw in enumerate(tables, 1):
        for letter, axis in zip(LETTERS, AXES):
            name = f"gyro{unit}_{letter}"
            table[name] = raw[f"Gyr_{letter.upper()}"]
            sensors.append(sensor(name, "mems_gyro", "deg/s", axis, 0.007 * 60**0.5, group=f"unit_{unit}"))
    write("ansfl_quadrotor_four_imus/path_1", "Four units on one quadrotor", pd.DataFrame(table), 0.008333, UNKNOWN, sensors)


def turned_by_hand(name, title, raw, step_s, stretches, scale, units, white):
    """A unit at rest in many attitudes. `raw`: rate and force; the reference is a self-calibration's direction of gravity."""
    rates, forces = raw
    means = np.array([forces[a:b].mean(axis=0) for a, b in stretches])
    *_, true, _ = self_calibration(means)
    rows = np.concatenate([np.arange(a, b) for a, b in stretches])
    reference = np.concatenate([np.tile(force, (b - a, 1)) for (a, b), force in zip(stretches, true)])
    table = {"t_s": rows * step_s}
    sensors = []
    for k, letter in enumerate(LETTERS):
        table[f"reference_w{letter}"], table[f"reference_f{letter}"] = np.zeros(len(rows)), reference[:, k]
        if rates is not None:
            table[f"g{letter}"] = rates[rows, k] * scale[0]
            sensors.append(sensor(f"g{letter}", "mems_gyro", units[0], AXES[k], white[0], group="imu"))
    for k, letter in enumerate(LETTERS):
        table[f"a{letter}"] = forces[rows, k] * scale[1]
        sensors.append(sensor(f"a{letter}", "accelerometer", units[1], AXES[k], white[1], group="imu"))
    motion = {"kind": "recorded", "rate": [f"reference_w{k}" for k in LETTERS],
              "specific_force": [f"reference_f{k}" for k in LETTERS]}
    write(name, title, pd.DataFrame(table), step_s, motion, sensors)


def mikoff():
    """MPU-9150, data sheet: 0.06 deg/s rms, 400 ug/sqrt(Hz) over 50 Hz. 100 Hz; the Earth's rate is far below the noise."""
    for unit in range(3):
        rows = pd.read_csv(DATA / f"mikoff_mpu9150_five/imu{unit}.csv.gz", sep=" ", header=None).to_numpy(float)
        stretches = standstills(rows[:, 3:], 100, 0.004)
        white = [0.06 * DEGREE, 400e-6 * STANDARD_GRAVITY * 50**0.5]
        turned_by_hand(f"mikoff_mpu9150_five/imu{unit}", f"MEMS unit {unit} in many attitudes", (rows[:, 3:], rows[:, :3]), 0.01,
                       stretches, [1.0, 1.0], ["rad/s", "m/s^2"], white)


def gyrolib():
    """The rate is not stated: called 100 Hz. In the test record the unit is at rest now and then, and its thermometer drifts."""
    raw = read("rahrs_gyrolib/angles")
    rates = raw[["Wx", "Wy", "Wz"]].to_numpy(float) / 3000
    stretches = standstills(rates, 100, 0.02)
    rows = np.concatenate([np.arange(a, b) for a, b in stretches])
    # In counts: nothing says how many of them are a kelvin.
    table = pd.DataFrame({"t_s": rows * 0.01, "T": raw.temperature.to_numpy()[rows],
                          **{f"g{k}": rates[rows, i] for i, k in enumerate(LETTERS)}})
    sensors = [sensor(f"g{k}", "mems_gyro", "rad/s", axis, 0.005, relative=True) for k, axis in zip(LETTERS, AXES)]
    motion = {"kind": "static", "attitude_deg": {"roll": 0.0, "pitch": 0.0, "heading": 0.0}}
    write("rahrs_gyrolib/angles_at_rest", "MEMS gyros at rest, thermometer in counts", table, 0.01, motion, sensors,
          auxiliaries=[temperature("T")])


def pelican():
    """A quadrotor's gyros against the attitude of its autopilot; roll and pitch stand in the second and first column."""
    raw = read("qrsim_pelican/preliminaryRotation_allBalanced01_2011-09-02-20-47-53_synced-50Hz", header=None)
    table = pd.DataFrame({"t_s": raw[0], "roll": raw[2], "pitch": raw[1], "yaw": raw[3], "gx": raw[5], "gy": raw[4], "gz": raw[6]})
    # Attitude to some 0.5 mrad, differenced over 40 ms; the gyros' own noise is below.
    sensors = [sensor(f"g{k}", "mems_gyro", "rad/s", axis, 0.02, group="imu") for k, axis in zip(LETTERS, AXES)]
    motion = {"kind": "recorded", "attitude_rad": ["roll", "pitch", "yaw"]}
    write("qrsim_pelican/rotation", "Quadrotor's gyros against its attitude", table, 0.02, motion, sensors,
          site={"latitude_deg": 51.7119, "altitude_m": 80.0})


def gait():
    """A unit on a foot, in the stances only, in which it does not turn. ITG-3200 class: 0.03 deg/s/sqrt(Hz) over 128 Hz."""
    raw = read("ximu_gait/straightLine")
    rates = raw[[f"Gyroscope {k} (deg/s)" for k in "XYZ"]].to_numpy(float)
    stretches = standstills(rates, 40, 1.5)
    rows = np.concatenate([np.arange(a, b) for a, b in stretches])
    table = {"t_s": rows / 256}
    for k, letter in enumerate(LETTERS):
        table[f"g{letter}"], table[f"reference_w{letter}"] = rates[rows, k], np.zeros(len(rows))
    sensors = [sensor(f"g{k}", "mems_gyro", "deg/s", axis, 0.34, quantisation=0.0625) for k, axis in zip(LETTERS, AXES)]
    motion = {"kind": "recorded", "rate": [f"reference_w{k}" for k in LETTERS]}
    write("ximu_gait/stances", "Gyros on a foot, stances", pd.DataFrame(table), 1 / 256, motion, sensors)


def clocks():
    """Fractional frequency of oscillators from differences of their phase over one second."""
    for name in ["cs5071a", "gps_1pps"]:
        phase = pd.read_csv(DATA / f"allantools_clocks/{name}_phase.txt.gz", comment="#", header=None).iloc[:, 0].to_numpy(float)
        # In parts of 1e12: numbers near one.
        table = pd.DataFrame({"t_s": np.arange(1.0, len(phase)), "frequency": 1e12 * np.diff(phase)})
        write(f"allantools_clocks/{name}", f"Clock {name}, fractional frequency, parts of 1e12", table, 1.0, UNKNOWN,
              [other("frequency", "1e-12", relative=True)])


def testbed():
    for path in sorted((DATA / "skab_testbed").glob("*.csv.gz")):
        raw = pd.read_csv(path, sep=";")
        stamps = pd.to_datetime(raw.datetime)
        table = pd.DataFrame({"t_s": (stamps - stamps.iloc[0]).dt.total_seconds(), **{k: raw[column] for k, (column, _) in SKAB.items()}})
        name = path.name.split(".")[0]
        write(f"skab_testbed/{name}", f"Pump on a testbed, {name}", table, 1.0, UNKNOWN,
              [other(k, unit, relative=True) for k, (_, unit) in SKAB.items()])


def pendulum():
    """The motor's torque against the authors' model without friction: inertia 0.139625 kg m^2, m g l of 0.6755 kg at 0.5 m
    (their sp_parameters_openloop.yaml)."""
    gravity_torque = 0.6755 * 9.81 * 0.5
    held = read("dfki_pendulum/gravity_compensation_measured").iloc[::10]
    swing = pd.read_csv(DATA / "dfki_pendulum/data_measured.csv")
    for name, title, raw, step_s in [("held", "held against gravity", held, 0.01), ("swing", "swung up", swing, 0.003333)]:
        velocity = np.convolve(raw.velocity, np.ones(9) / 9, "same")
        acceleration = np.gradient(velocity, raw.time)
        predicted = gravity_torque * np.sin(raw.position) + (0.139625 * acceleration if name == "swing" else 0.0)
        table = pd.DataFrame({"t_s": raw.time, "torque": raw.torque, "model": predicted, "position": raw.position, "velocity": raw.velocity})
        write(f"dfki_pendulum/{name}", f"Pendulum {title}: torque against a model without friction", table, step_s, UNKNOWN,
              [other("torque", "N m", predicted="model")],
              auxiliaries=[{"column": "position", "quantity": "other", "unit": "rad"}, {"column": "velocity", "quantity": "other", "unit": "rad/s"}])


def silverbox():
    """The input that a linear model needs for the output that came, against the input that was given."""
    raw = read("silverbox/SNLS80mV", usecols=[0, 1]).to_numpy(float)
    lags = np.column_stack([np.roll(raw[:, 1], k) for k in range(-3, 4)] + [np.ones(len(raw))])
    quiet = slice(100, 6000)
    linear = np.linalg.lstsq(lags[quiet], raw[quiet, 0], rcond=None)[0]
    rows = slice(10_000, 40_000)
    table = pd.DataFrame({"t_s": np.arange(30_000) / 610.35, "drive": raw[rows, 0], "model": (lags @ linear)[rows], "output": raw[rows, 1]})
    write("silverbox/arrow", "Oscillator: drive against a linear model", table, 1 / 610.35, UNKNOWN,
          [other("drive", "V", predicted="model")], auxiliaries=[{"column": "output", "quantity": "other", "unit": "V"}])


def altimeters():
    """Height by pressure against height by satellites: a rocket's, in the way up, and a telephone's in a car."""
    raw, gnss = read("rocketpy_flights/juno3_cots_altimeter"), read("rocketpy_flights/juno3_cots_GNSS")
    height = 0.3048 * (np.interp(raw.time, gnss.time, gnss.ALT) - gnss.ALT.iloc[0])
    table = pd.DataFrame({"t_s": raw.time, "altimeter": raw.altitude, "gnss": height, "T": pd.to_numeric(raw.temperature, errors="coerce")})
    write("rocketpy_flights/juno3", "Rocket's altimeter against a satellite receiver", table, 0.05, UNKNOWN,
          [other("altimeter", "m", predicted="gnss")], auxiliaries=[temperature("T")])
    raw = read("strapdown_rs_phone/2025-06-11_20-34-24")
    stamps = pd.to_datetime(raw.time)
    table = pd.DataFrame({"t_s": (stamps - stamps.iloc[0]).dt.total_seconds(), "barometer": raw.relativeAltitude, "gnss": raw.altitude,
                          "speed": raw.speed})
    table = table.drop_duplicates("t_s")
    write("strapdown_rs_phone/drive", "Telephone's barometer against its satellite receiver", table, 1.0, UNKNOWN,
          [other("barometer", "m", predicted="gnss", relative=True)], auxiliaries=[{"column": "speed", "quantity": "speed", "unit": "m/s"}])


MAKERS = [xsens_static, four_imus, mikoff, gyrolib, pelican, gait, clocks, testbed, pendulum, silverbox, altimeters]

if __name__ == "__main__":
    for make in MAKERS:
        make()
