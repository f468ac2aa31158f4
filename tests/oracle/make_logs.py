"""Small logs in formats of other people's tools, of the same readings: 400 rows at 200 Hz, x = sin(row / 10), y = row.

    python make_logs.py DIRECTORY

`imu.bag` is written by rosbags, in chunks compressed with LZ4, and `plain.bag`, its first 40 rows, without; `imu.bin`, an ArduPilot DataFlash log of two
instances, is written here and read back by pymavlink, which has no writer. `imu.tlog` is written by pymavlink: attitudes in version 2 of
MAVLink, readings of an IMU in version 1 (x in thousandths), and heartbeats of two senders. `fields.npy` is a structured array with a `datetime64`,
`arrays.npz` two arrays, deflated, and `two.npz` the same, stored, with one of big-endian integers in Fortran's order;
`packed.mat` and `plain.mat` are the same with a structure, written by SciPy for MATLAB 5, compressed or not. `matlab73.mat` is the same,
written by hdf5storage for MATLAB 7.3, `arrays.h5` by h5py: in chunks, deflated, with a group, records and text. `described.db3` is a ROS 2 bag in
SQLite, written by rosbags, of 40 rows and as many messages of a kind of its own; `undescribed.db3` is the same without
the definitions, as before ROS 2 Iron. They stand in crates/schuler-recording/tests/samples. It needs numpy, scipy, lz4, rosbags (0.11.9),
pymavlink (2.4.50), h5py (3.16.0) and hdf5storage (0.2.2).
"""

import math
import shutil
import sqlite3
import struct
import sys
from pathlib import Path

import h5py
import hdf5storage
import numpy as np
import scipy.io
from pymavlink import DFReader, mavutil
from pymavlink.dialects.v10 import ardupilotmega as first
from pymavlink.dialects.v20 import ardupilotmega as second
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROWS = 400
STEP_NS = 5_000_000
START_NS = 1_700_000_000_123_456_789


def readings(row):
    """The two readings of a row."""
    return math.sin(row / 10), float(row)


def imu_message(store, row, **of_header):
    """Time of a row in nanoseconds, and its readings as sensor_msgs/Imu; `of_header` is what the header has beside them."""
    kinds = store.types
    header, time = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    vector, quaternion = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    stamp = START_NS + STEP_NS * row
    x, y = readings(row)
    message = kinds["sensor_msgs/msg/Imu"](
        header=header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="imu", **of_header),
        orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=vector(x=x, y=y, z=0.0),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(x=0.0, y=0.0, z=-9.8),
        linear_acceleration_covariance=np.zeros(9),
    )
    return stamp, message


def write_bag(path, compression, rows):
    """A ROS 1 bag of sensor_msgs/Imu, stamped 2 ms before it is recorded."""
    store = get_typestore(Stores.ROS1_NOETIC)
    imu = store.types["sensor_msgs/msg/Imu"]
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connection = writer.add_connection("/imu", imu.__msgtype__, typestore=store)
        for row in range(rows):
            stamp, message = imu_message(store, row, seq=row)
            writer.write(connection, stamp + 2_000_000, store.serialize_ros1(message, imu.__msgtype__))


def text(value, size):
    """Text padded with zeros."""
    return value.encode().ljust(size, b"\0")


def write_dataflash(path):
    """IMU messages of two instances, and attitudes in hundredths of a degree at half the rate."""
    kinds = {
        128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "<BB4s16s64s"),
        129: ("IMU", "QBffn", "TimeUS,I,GyrX,GyrY,Tag", "<QBff4s"),
        130: ("ATT", "Qcc", "TimeUS,Roll,Pitch", "<Qhh"),
    }
    with open(path, "wb") as log:
        def write(kind, *values):
            log.write(struct.pack("<BBB", 0xA3, 0x95, kind) + struct.pack(kinds[kind][3], *values))

        for kind, (name, letters, labels, layout) in kinds.items():
            size = 3 + struct.calcsize(layout)
            write(128, kind, size, text(name, 4), text(letters, 16), text(labels, 64))
        for row in range(ROWS):
            x, y = readings(row)
            time_us = 1_000_000 + 5000 * row
            write(129, time_us, 0, x, y, b"A")
            write(129, time_us + 100, 1, -x, -y, b"B")
            if row % 2 == 0:
                write(130, time_us + 200, row, -row)


def check_dataflash(path):
    """What pymavlink reads is what was written."""
    log = DFReader.DFReader_binary(str(path))
    found = []
    while (message := log.recv_match(type=["IMU", "ATT"])) is not None:
        found.append(message)
    first = [message for message in found if message.get_type() == "IMU" and message.I == 0]
    attitudes = [message for message in found if message.get_type() == "ATT"]
    assert len(first) == ROWS and len(attitudes) == ROWS // 2, (len(first), len(attitudes))
    for row, message in enumerate(first):
        x, y = readings(row)
        assert abs(message.GyrX - x) < 1e-7 and message.GyrY == y
        assert message.TimeUS == 1_000_000 + 5000 * row
    assert all(abs(message.Roll - 0.02 * row) < 1e-9 for row, message in enumerate(attitudes))


def write_tlog(path):
    """Attitudes, at half the rate readings of an IMU, every second heartbeats."""
    vehicle = second.MAVLink(None, srcSystem=1, srcComponent=1)
    old = first.MAVLink(None, srcSystem=1, srcComponent=1)
    ground = first.MAVLink(None, srcSystem=255, srcComponent=190)
    with open(path, "wb") as log:
        def write(stamp, message, sender):
            log.write(struct.pack(">Q", stamp) + message.pack(sender))

        for row in range(ROWS):
            x, y = readings(row)
            stamp = START_NS // 1000 + 5000 * row
            write(stamp, second.MAVLink_attitude_message(5 * row, x, y, 0.0, 0.0, 0.0, 0.0), vehicle)
            if row % 2 == 0:
                imu = first.MAVLink_raw_imu_message(5000 * row, round(1000 * x), row, 0, 0, 0, 0, 0, 0, 0)
                write(stamp + 200, imu, old)
            if row % 200 == 0:
                for index, sender in enumerate([old, ground]):
                    write(stamp + 300 + index, first.MAVLink_heartbeat_message(2, 3, 0, row, 4, 3), sender)


def check_tlog(path):
    """What pymavlink reads is what was written."""
    log = mavutil.mavlink_connection(str(path))
    found = []
    while (message := log.recv_match(type=["ATTITUDE", "RAW_IMU"])) is not None:
        found.append(message)
    attitudes = [message for message in found if message.get_type() == "ATTITUDE"]
    assert len(attitudes) == ROWS and len(found) == ROWS + ROWS // 2, len(found)
    for row, message in enumerate(attitudes):
        x, y = readings(row)
        assert abs(message.roll - x) < 1e-7 and message.pitch == y and message.time_boot_ms == 5 * row


def write_arrays(folder):
    """The first 40 rows as arrays of NumPy."""
    rows = np.arange(40)
    x = np.sin(rows / 10)
    fields = np.zeros(40, dtype=[("when", "M8[ns]"), ("x", "<f8"), ("y", "<i2"), ("note", "U3")])
    fields["when"] = np.datetime64(START_NS, "ns") + STEP_NS * rows
    fields["x"], fields["y"] = x, rows
    np.save(folder / "fields.npy", fields)
    np.savez_compressed(folder / "arrays.npz", t=rows * 0.005, gyro=np.stack([x, rows], axis=1), short=np.zeros(3))
    np.savez(folder / "two.npz", t=rows * 0.005, gyro=np.asfortranarray(np.stack([rows, -rows], axis=1).astype(">i4")))
    two = {"t": rows * 0.005, "gyro": np.stack([x, rows], axis=1), "note": "at rest", "z": np.array([1j, 2])}
    two["imu"] = {"count": rows.astype(np.int16), "more": {"x": np.float32(x)}}
    for name, compressed in [("packed.mat", True), ("plain.mat", False)]:
        scipy.io.savemat(folder / name, two, do_compression=compressed)
        # The header says when it was written.
        content = bytearray((folder / name).read_bytes())
        content[:116] = b"MATLAB 5.0 MAT-file, by SciPy".ljust(116)
        (folder / name).write_bytes(content)


def write_hdf5(folder):
    """The first 40 rows as datasets, and as variables of MATLAB 7.3."""
    rows = np.arange(40)
    x = np.sin(rows / 10)
    gyro = np.stack([x, rows], axis=1)
    with h5py.File(folder / "arrays.h5", "w", track_order=True) as file:
        file["t"] = rows * 0.005
        file.create_dataset("gyro", data=gyro, chunks=(16, 1), compression="gzip", shuffle=True, fletcher32=True)
        imu = file.create_group("imu")
        imu["counts"] = rows.astype(">i2")
        imu["ok"] = rows % 2 == 0
        records = np.zeros(40, dtype=[("note", "S4"), ("x", "<f4"), ("y", "<u2")])
        records["note"], records["x"], records["y"] = b"at", x, rows
        imu.create_dataset("records", data=records, chunks=(16,), compression="gzip")
        file["note"] = "at rest"
        file["z"] = np.array([1j, 2])
    two = {"t": rows * 0.005, "gyro": gyro, "note": "at rest", "z": np.array([1j, 2]), "none": np.zeros((0, 3))}
    two["imu"] = {"count": rows.astype(np.int16), "more": {"x": np.float32(x)}}
    path = folder / "matlab73.mat"
    path.unlink(missing_ok=True)
    hdf5storage.savemat(str(path), two, format="7.3", oned_as="column", store_python_metadata=False)
    # The header says when it was written.
    content = bytearray(path.read_bytes())
    content[:116] = b"MATLAB 7.3 MAT-file, by hdf5storage".ljust(116)
    path.write_bytes(content)
    assert np.array_equal(h5py.File(path)["gyro"][()].T, gyro)


def write_rosbag2(folder):
    """Bags of sensor_msgs/Imu, stamped 2 ms before it is recorded, and of a message that is no standard one."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64[3] rate\nint32 count\n", "lab/msg/Reading"))
    imu, reading = store.types["sensor_msgs/msg/Imu"], store.types["lab/msg/Reading"]
    bag = folder / "bag2"
    shutil.rmtree(bag, ignore_errors=True)
    with Writer2(bag, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        standard = writer.add_connection("/imu", imu.__msgtype__, typestore=store)
        own = writer.add_connection("/lab", reading.__msgtype__, typestore=store)
        for row in range(40):
            stamp, message = imu_message(store, row)
            writer.write(standard, stamp + 2_000_000, store.serialize_cdr(message, imu.__msgtype__))
            message = reading(rate=np.array([*readings(row), 1.0]), count=row)
            writer.write(own, stamp + 3_000_000, store.serialize_cdr(message, reading.__msgtype__))
    (made,) = bag.glob("*.db3")
    shutil.copy(made, folder / "described.db3")
    shutil.copy(made, folder / "undescribed.db3")
    shutil.rmtree(bag)
    for name, change in [("described", ""), ("undescribed", "DROP TABLE message_definitions;")]:
        database = sqlite3.connect(folder / f"{name}.db3")
        database.executescript(change + "VACUUM;")
        database.close()


def main():
    folder = Path(sys.argv[1])
    for name, compression, rows in [("imu.bag", Writer.CompressionFormat.LZ4, ROWS), ("plain.bag", None, 40)]:
        (folder / name).unlink(missing_ok=True)
        write_bag(folder / name, compression, rows)
    write_dataflash(folder / "imu.bin")
    check_dataflash(folder / "imu.bin")
    write_tlog(folder / "imu.tlog")
    check_tlog(folder / "imu.tlog")
    write_arrays(folder)
    write_hdf5(folder)
    write_rosbag2(folder)


if __name__ == "__main__":
    main()
