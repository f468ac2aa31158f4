"""Writes a case and a table for each real recording that has none.

    make_cases.py FOLDER

The recordings are read from SCHULER_DATA, else from ../shared/data beside the project; nothing of them may be kept in the
project. A nominal value is what an engineer would believe who has the part's data sheet, not what the recording shows.
Where a reference is another instrument, its own noise is in the nominal white noise as well, and the readings are
averaged over the step of the reference about its rows: a derivative of its attitude or velocity is that of the instant where the
motion is worth it, and the mean over a step is nearly the same. The car's noisy course is differenced over two steps, and so
are its readings averaged.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from common import DATA, STANDARD_GRAVITY
from scipy.spatial.transform import Rotation

FOLDER = Path(sys.argv[1])
DEGREE = np.pi / 180
# North, east, down from east, north, up.
NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def toml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    return repr(float(value))


def pairs(table):
    return "".join(f"{key} = {toml(value)}\n" for key, value in table.items())


def write(name, title, table, step_s, motion, sensors, site=None, auxiliaries=()):
    """`sensors`: dictionaries of the keys of a sensor, `nominal` among them where the noise is known."""
    folder = (FOLDER / name).parent
    folder.mkdir(parents=True, exist_ok=True)
    stem = Path(name).name
    table.to_csv(folder / f"{stem}.csv", index=False, float_format="%.10g")
    text = pairs({"format": "schuler-case/1", "title": title})
    text += "\n[recording]\n" + pairs({"path": f"{stem}.csv", "time": "t_s", "step_s": step_s})
    if site:
        text += "\n[site]\n" + pairs(site)
    text += "\n[motion]\n" + pairs(motion)
    if any("predicted" in sensor for sensor in sensors):
        text += "\n[simulation]\n" + pairs({"clock": "same"})
    for sensor in sensors:
        nominal = sensor.pop("nominal", None)
        text += "\n[[sensor]]\n" + pairs(sensor)
        if nominal:
            text += "[sensor.nominal]\n" + pairs(nominal)
    for auxiliary in auxiliaries:
        text += "\n[[aux]]\n" + pairs(auxiliary)
    (folder / f"{stem}.toml").write_text(text)
    print(folder / f"{stem}.toml")


def sensor(name, kind, unit, axis, white, **more):
    nominal = {"bias": 0.0, "white": white} | more.pop("nominal", {})
    return {"id": name, "kind": kind, "column": name, "unit": unit, "axis": list(axis), **more, "nominal": nominal}


def temperature(column, near=None):
    return {"column": column, "quantity": "temperature", "unit": "degC"} | ({"near": near} if near else {})


def block_means(values, length):
    whole = len(values) // length * length
    return values[:whole].reshape(-1, length, *values.shape[1:]).mean(axis=1)


def attitude_columns(rotation):
    yaw, pitch, roll = rotation.as_euler("ZYX").T
    return {"roll": roll, "pitch": pitch, "yaw": yaw}


def static_mems_raw():
    """ADIS16405 at 10 Hz (means of 10 samples): in 1 s means a line above 0.5 Hz is folded to below it."""
    counts = pd.read_csv(DATA / "mems_static/run1_raw_100Hz_first_3000s.csv.gz").to_numpy(float)
    means = block_means(counts * ([8.726646e-4] * 3 + [0.0326561] * 3), 10)
    table = pd.DataFrame(means, columns=["gx", "gy", "gz", "ax", "ay", "az"])
    table.insert(0, "t_s", 0.05 + 0.1 * np.arange(len(table)))
    # Data sheet: noise 0.9 deg/s and 9 mg rms per sample without filtering; a tenth of the variance in means of ten.
    gyro, accelerometer = 0.9 * DEGREE / np.sqrt(10), 9e-3 * STANDARD_GRAVITY / np.sqrt(10)
    axes = np.eye(3).tolist()
    sensors = [sensor(n, "mems_gyro", "rad/s", a, gyro, relative=True) for n, a in zip(["gx", "gy", "gz"], axes)]
    sensors += [sensor(n, "accelerometer", "m/s^2", a, accelerometer, relative=True) for n, a in zip(["ax", "ay", "az"], axes)]
    motion = {"kind": "static", "attitude_deg": {"roll": 0.0, "pitch": 0.0, "heading": 0.0}}
    write("mems_static/run1_10Hz", "MEMS unit, static, run 1, 0.1 s means", table, 0.1, motion, sensors)


def gyro_array():
    """Eight units of three gyros on one board, motion not known: 21 of the 24 axes are redundant.

    Units 2, 4, 6, 8 are turned: their sensitive axes in the board's axes are the columns of [0 -1 0; -1 0 0; 0 0 -1].
    """
    turned = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    for experiment in ["exp1", "exp3"]:
        counts = pd.read_csv(DATA / f"gyro_array/{experiment}.csv.gz")
        # The poses before the fast motion, and the whole; all units, and three for tools that check fewer axes at once.
        for part, end_s, units in [(p, end, n) for n in (8, 3) for p, end in [("poses", 480.0), ("whole", np.inf)]]:
            rows = counts[counts.t_s < end_s]
            table, sensors = {"t_s": rows.t_s}, []
            for unit in range(1, units + 1):
                axes = turned if unit % 2 == 0 else np.eye(3)
                for letter, axis in zip("xyz", axes.T):
                    name = f"gyro{unit}_{letter}"
                    table[name] = rows[f"{name}_lsb"] / 16.4
                    # Data sheet of the MPU-9150: total noise 0.06 deg/s rms (filter at 92 Hz); 16.4 counts per deg/s.
                    # Zero-rate output within 20 deg/s, scale factor within 3 %, axes within 2 %: nominally none.
                    sensors.append(
                        sensor(name, "mems_gyro", "deg/s", axis, 0.06, group=f"unit_{unit}", quantisation=1 / 16.4)
                    )
            title = f"{units} gyro units on one board, {experiment}, {part}"
            write(f"gyro_array/{experiment}_{part}_{units}_units", title, pd.DataFrame(table), 0.016, {"kind": "unknown"}, sensors)


def thermal_ramp():
    """ICM-42652 accelerometer. The sampling rate is not known: 50 samples are called one second."""
    raw = pd.read_csv(DATA / "accelerometer_thermal_ramp/icm42652_raw.csv.gz")
    means = block_means(raw[["ax_mps2", "ay_mps2", "az_mps2", "T_degC"]].to_numpy(), 50)
    table = pd.DataFrame(means, columns=["ax", "ay", "az", "T"])
    table.insert(0, "t_s", np.arange(len(table), dtype=float))
    # Without the rate the data sheet's density gives no noise of a sample: from the differences of the first tenth.
    # Data sheet: zero-g level changes by 0.15 mg/K; nominally none.
    white = np.diff(raw[["ax_mps2", "ay_mps2", "az_mps2"]].to_numpy()[:10_000], axis=0).std(axis=0) / np.sqrt(2 * 50)
    sensors = [
        sensor(name, "accelerometer", "m/s^2", axis, sigma, relative=True)
        for name, axis, sigma in zip(["ax", "ay", "az"], np.eye(3).tolist(), white)
    ]
    motion = {"kind": "static", "attitude_deg": {"roll": 0.0, "pitch": 0.0, "heading": 0.0}}
    write("accelerometer_thermal_ramp/ramp", "Accelerometer, cold soak, then heating", table, 1.0, motion, sensors,
          auxiliaries=[temperature("T")])


def hot_cold():
    """BMI270, a log in the cold and one in the heat, about 50 Hz; accelerometer in units of g/4."""
    for log in ["cold", "hot"]:
        raw = pd.read_csv(DATA / f"mems_hot_cold/{log}.csv.gz")
        table = pd.DataFrame({"t_s": raw["sample"] / 50.0, "T": raw.T_degC})
        sensors = []
        for letter, axis in zip("xyz", np.eye(3).tolist()):
            table[f"g{letter}"] = raw[f"g{letter}_radps"] / DEGREE
            # Data sheet: 0.007 deg/s/sqrt(Hz) and 160 ug/sqrt(Hz), over 25 Hz.
            sensors.append(sensor(f"g{letter}", "mems_gyro", "deg/s", axis, 0.007 * 5, relative=True))
        for letter, axis in zip("xyz", np.eye(3).tolist()):
            table[f"a{letter}"] = 4000 * raw[f"a{letter}_logged"]
            sensors.append(sensor(f"a{letter}", "accelerometer", "mg", axis, 0.16 * 5, relative=True, quantisation=4.0))
        motion = {"kind": "static", "attitude_deg": {"roll": 0.0, "pitch": 0.0, "heading": 0.0}}
        write(f"mems_hot_cold/{log}", f"MEMS unit, static, {log}", table, 0.02, motion, sensors,
              auxiliaries=[temperature("T")])


def means_about(time, reading_time, readings, half_s):
    """Mean of the readings (each the mean over the interval that ends at its time) over +-half_s about each time."""
    steps = np.diff(reading_time, prepend=2 * reading_time[0] - reading_time[1])
    integral = np.vstack([np.zeros(3), np.cumsum(readings * steps[:, None], axis=0)])
    ends = np.concatenate([[reading_time[0] - steps[0]], reading_time])
    def until(when):
        return np.column_stack([np.interp(when, ends, column, left=np.nan, right=np.nan) for column in integral.T])
    return (until(time + half_s) - until(time - half_s)) / (2 * half_s)


def car():
    """Consumer IMU (x aft, y right, z up) beside a satellite receiver with 4 Hz phase-fixed solutions.

    The receiver gives velocity. The car's yaw is its course, pitch its climb, roll none, above 3 m/s; slower it is not known.
    """
    gnss = pd.read_csv(DATA / "car_imu_rtk/drive_gnss.csv.gz")
    imu = pd.read_csv(DATA / "car_imu_rtk/drive_imu_raw.csv.gz")
    north, east, up = gnss.vn_mps.to_numpy(), gnss.ve_mps.to_numpy(), gnss.vu_mps.to_numpy()
    speed = np.hypot(north, east)
    moving = np.where(speed > 3.0, 0.0, np.nan)
    time = gnss.t_s.to_numpy()
    gyro = means_about(time, imu.t_s.to_numpy(), imu[["gx_radps", "gy_radps", "gz_radps"]].to_numpy(), 0.25)
    force = means_about(time, imu.t_s.to_numpy(), imu[["ax_mps2", "ay_mps2", "az_mps2"]].to_numpy(), 0.25)
    table = pd.DataFrame({
        "t_s": time, "vn": north, "ve": east, "vd": -up,
        "roll": moving, "pitch": np.arctan2(up, speed) + moving, "yaw": np.arctan2(east, north) + moving,
        "gyro_z": gyro[:, 2], "ax": force[:, 0], "ay": force[:, 1], "az": force[:, 2],
    })
    # The receiver states 0.04 m/s per component: at 10 m/s 0.004 rad of course, differenced over 0.5 s 0.011 rad/s, and
    # 0.12 m/s^2. A consumer gyro's 0.01 deg/s/sqrt(Hz) and accelerometer's 0.3 mg/sqrt(Hz) are far below.
    sensors = [sensor("gyro_z", "mems_gyro", "rad/s", [0, 0, -1], 0.011, group="imu")]
    for name, axis in [("ax", [-1, 0, 0]), ("ay", [0, 1, 0]), ("az", [0, 0, -1])]:
        sensors.append(sensor(name, "accelerometer", "m/s^2", axis, 0.12, group="imu"))
    motion = {"kind": "recorded", "velocity_ned": ["vn", "ve", "vd"], "attitude_rad": ["roll", "pitch", "yaw"]}
    write("car_imu_rtk/drive", "Car, consumer IMU against a satellite receiver", table, 0.25, motion, sensors,
          site={"latitude_deg": 40.099, "longitude_deg": -105.146, "altitude_m": 1592.0})


def vehicle():
    """MEMS increments beside a fibre-optic inertial system; body right, forward, up; yaw counter-clockwise from north."""
    fog = pd.read_csv(DATA / "vehicle_fog_mems/fog_ins_10Hz.csv.gz")
    mems = pd.read_csv(DATA / "vehicle_fog_mems/mems_100Hz_increments.csv.gz")
    enu = Rotation.from_euler("ZXY", fog[["yaw_rad", "pitch_rad", "roll_rad"]].to_numpy())
    # Forward, right, down from right, forward, up is the same exchange as that of the frames.
    ned = Rotation.from_matrix(NED_FROM_ENU @ enu.as_matrix() @ NED_FROM_ENU.T)
    time = fog.t_s.to_numpy()
    # A row holds the increments over the 10 ms that begin at its time.
    ends = mems.t_s.to_numpy() + 0.01
    gyro = means_about(time, ends, mems[["dthx_rad", "dthy_rad", "dthz_rad"]].to_numpy() / 0.01, 0.05)
    force = means_about(time, ends, mems[["dvx_mps", "dvy_mps", "dvz_mps"]].to_numpy() / 0.01, 0.05)
    table = pd.DataFrame({
        "t_s": time, "vn": fog.vN_mps, "ve": fog.vE_mps, "vd": -fog.vU_mps, **attitude_columns(ned),
        **dict(zip(["gx", "gy", "gz"], gyro.T)), **dict(zip(["ax", "ay", "az"], force.T)),
    })
    axes = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    # No data sheet. Automotive MEMS: 0.3 deg/sqrt(h) and 0.1 m/s/sqrt(h), in means over 0.1 s 2.8e-4 rad/s and 6e-3 m/s^2;
    # the reference, differenced over 0.2 s: attitude to 20 urad 1.4e-4 rad/s, velocity to 3 mm/s 0.02 m/s^2, twice that by a higher order.
    sensors = [sensor(n, "mems_gyro", "rad/s", a, 4e-4, group="mems") for n, a in zip(["gx", "gy", "gz"], axes)]
    sensors += [sensor(n, "accelerometer", "m/s^2", a, 0.04, group="mems") for n, a in zip(["ax", "ay", "az"], axes)]
    motion = {"kind": "recorded", "velocity_ned": ["vn", "ve", "vd"], "attitude_rad": ["roll", "pitch", "yaw"]}
    write("vehicle_fog_mems/vehicle", "Vehicle, MEMS against a fibre-optic inertial system", table, 0.1, motion, sensors,
          site={"latitude_deg": 34.432, "longitude_deg": 111.434, "altitude_m": 172.3})


def six_positions():
    """An IMU in six poses. A pose is believed to put its axis along the vertical; between poses nothing is known."""
    rows = pd.read_csv(DATA / "six_positions_three_turns/annotated_session.csv").sort_values("samples")
    up = {f"{letter}_{sense}": sign * axis for letter, axis in zip("xyz", np.eye(3)) for sense, sign in [("p", 1), ("a", -1)]}
    force = np.array([up.get(part, np.full(3, np.nan)) for part in rows.part])
    table = pd.DataFrame({"t_s": rows.samples / 204.8})
    for k, letter in enumerate("xyz"):
        table[f"g{letter}"] = rows[f"gyr_{letter}"] / 16.384
        table[f"a{letter}"] = rows[f"acc_{letter}"] / 2.048
        # The Earth's rate is a fifteenth of the gyro's noise in a second: none.
        table[f"reference_w{letter}"] = 0.0 * force[:, k]
        table[f"reference_f{letter}"] = STANDARD_GRAVITY * force[:, k]
    sensors = []
    # MPU-9250 class: 0.01 deg/s/sqrt(Hz) and 300 ug/sqrt(Hz) over 92 Hz; 16.384 counts per deg/s, 2048 per g.
    for letter, axis in zip("xyz", np.eye(3).tolist()):
        sensors.append(sensor(f"g{letter}", "mems_gyro", "deg/s", axis, 0.1, quantisation=1 / 16.384, group="imu"))
    for letter, axis in zip("xyz", np.eye(3).tolist()):
        sensors.append(sensor(f"a{letter}", "accelerometer", "mg", axis, 2.9, quantisation=1 / 2.048, group="imu"))
    motion = {"kind": "recorded", "rate": [f"reference_w{k}" for k in "xyz"], "specific_force": [f"reference_f{k}" for k in "xyz"]}
    write("six_positions_three_turns/poses", "IMU in six poses", table, 1 / 204.8, motion, sensors)


def optical():
    """MEMS IMU with optical attitude (body from a frame with z up) and position, as 28.6 Hz means over 35 ms."""
    raw = pd.read_csv(DATA / "optical_reference/trial_01.csv.gz")
    stride = 10
    rows = np.arange(2 * stride, len(raw) - 2 * stride, stride)
    time = raw.t_s.to_numpy()
    seen = raw[["qw", "px_m"]].notna().all(axis=1).to_numpy()[rows]
    quaternion = raw[["qx", "qy", "qz", "qw"]].to_numpy()[rows]
    enu = Rotation.from_quat(np.where(seen[:, None], quaternion, [0.0, 0.0, 0.0, 1.0]))
    # The sensor's axes are kept as they are, the frame with z up becomes one with z down.
    ned = Rotation.from_matrix(NED_FROM_ENU @ enu.as_matrix())
    position = raw[["px_m", "py_m", "pz_m"]].to_numpy()
    velocity = (position[rows + stride] - position[rows - stride]) / (2 * stride * 0.0035) @ NED_FROM_ENU.T
    half_s = 0.5 * stride * 0.0035
    # A sample is read as the mean over the sampling interval about its time.
    ends = time + 0.00175
    gyro = means_about(time[rows], ends, raw[["gx_radps", "gy_radps", "gz_radps"]].to_numpy(), half_s)
    force = means_about(time[rows], ends, raw[["ax_mps2", "ay_mps2", "az_mps2"]].to_numpy(), half_s)
    angles = {name: np.where(seen, values, np.nan) for name, values in attitude_columns(ned).items()}
    table = pd.DataFrame({
        "t_s": time[rows], **dict(zip(["vn", "ve", "vd"], velocity.T)), **angles,
        **dict(zip(["gx", "gy", "gz"], gyro.T)), **dict(zip(["ax", "ay", "az"], force.T)),
    })
    # MEMS: 0.007 deg/s/sqrt(Hz) and 150 ug/sqrt(Hz), in means over 35 ms 5e-4 rad/s and 6e-3 m/s^2. The cameras: 0.2 mm
    # over some 5 cm of markers, 4 mrad, differenced over 70 ms 0.08 rad/s at worst; their filter leaves about a tenth.
    # Position to 0.2 mm, differenced twice over 70 ms: 0.1 m/s^2.
    axes = np.eye(3).tolist()
    sensors = [sensor(n, "mems_gyro", "rad/s", a, 0.01, group="imu") for n, a in zip(["gx", "gy", "gz"], axes)]
    sensors += [sensor(n, "accelerometer", "m/s^2", a, 0.1, group="imu") for n, a in zip(["ax", "ay", "az"], axes)]
    motion = {"kind": "recorded", "velocity_ned": ["vn", "ve", "vd"], "attitude_rad": ["roll", "pitch", "yaw"]}
    # Berlin, where the set's authors work.
    write("optical_reference/trial_01", "MEMS unit against cameras", table, 0.035, motion, sensors,
          site={"latitude_deg": 52.5, "longitude_deg": 13.3, "altitude_m": 50.0})


if __name__ == "__main__":
    for make in [static_mems_raw, gyro_array, thermal_ramp, hot_cold, car, vehicle, six_positions, optical]:
        make()
