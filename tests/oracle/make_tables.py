"""Writes one recording as the tools of other people write it.

    make_tables.py DIRECTORY

Rows of a gyro at 100 Hz, with steps missing and a value missing, beside a thermometer at 10 Hz whose times are its own:
the same columns as CSV, gzipped CSV (Python), Parquet (pyarrow), MCAP with JSON (mcap) and ULog (pyulog). And as MCAP with
messages of Protobuf (mcap-protobuf-support), ROS 1 and ROS 2 (mcap-ros2-support), where the columns have other names. The
files in crates/schuler-recording/tests/samples are those of this script.
"""

import csv
import gzip
import io
import json
import math
import pathlib
import struct
import sys
import types

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer
from pyulog import ULog

START_US = 1_700_000_000_000_000
ROWS = 120
GYRO = ["sensor_gyro_0.timestamp", "sensor_gyro_0.x", "sensor_gyro_0.y", "sensor_gyro_0.counts[0]", "sensor_gyro_0.counts[1]"]
TEMPERATURE = "sensor_temp_0.temperature"


def recording():
    """Messages in the order of their times: (topic, microseconds, values)."""
    random = np.random.default_rng(20261122)
    messages = []
    for row in range(ROWS):
        x, y, temperature = map(float, random.normal(size=3))
        time_us = START_US + 10_000 * row + int(random.integers(-300, 300))
        if not 80 <= row < 87:
            y = math.nan if row == 50 else 1e-3 * y
            counts = [int(random.integers(-32768, 32768)), row]
            messages.append(("sensor_gyro", time_us, [x, y, counts]))
        if row % 10 == 3:
            messages.append(("sensor_temp", START_US + 10_000 * row + 1_700, [float(np.float32(20 + temperature))]))
    return messages


def rows(messages):
    """What a table has of them: a temperature in the row that is nearest to it."""
    gyro = [message for message in messages if message[0] == "sensor_gyro"]
    table = [[us / 1e6, x, y, counts[0], counts[1], math.nan] for _, us, (x, y, counts) in gyro]
    for topic, time_us, values in messages:
        if topic == "sensor_temp":
            nearest = min(range(len(gyro)), key=lambda row: abs(gyro[row][1] - time_us))
            spacings = [abs(gyro[row][1] - gyro[nearest][1]) for row in (nearest - 1, nearest + 1) if 0 <= row < len(gyro)]
            if abs(gyro[nearest][1] - time_us) <= min(spacings):
                table[nearest][5] = values[0]
    return table


def write_text(table, path):
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow([*GYRO, TEMPERATURE])
    writer.writerows([["" if math.isnan(value) else repr(value) for value in row] for row in table])
    path.write_text(text.getvalue(), newline="")
    with gzip.GzipFile(f"{path}.gz", "wb", mtime=0) as file:
        file.write(text.getvalue().encode())


def write_parquet(table, path):
    """Time stamps, nulls, a dictionary and two row groups, as a data frame would be written."""
    time_us, x, y, first, second, temperature = zip(*table)
    stamps = [round(time * 1e6) for time in time_us]

    def optional(values, kind):
        return pa.array([None if math.isnan(value) else value for value in values], kind)

    columns = {
        GYRO[0]: pa.array(stamps, pa.timestamp("us", tz="UTC")),
        GYRO[1]: pa.array(x, pa.float64()),
        GYRO[2]: optional(y, pa.float64()),
        GYRO[3]: pa.array(first, pa.int16()),
        GYRO[4]: pa.array(second, pa.uint16()),
        TEMPERATURE: optional(temperature, pa.float32()),
    }
    written = pa.table(columns).replace_schema_metadata({"bench": "rate table 2"})
    pyarrow.parquet.write_table(written, path, row_group_size=100, compression="zstd")


def write_json(messages, path):
    with open(path, "wb") as file:
        writer = McapWriter(file, chunk_size=4096, compression=CompressionType.LZ4)
        writer.start(profile="", library="make_tables")
        schema = writer.register_schema("sample", "jsonschema", json.dumps({"type": "object"}).encode())
        channels = {
            "sensor_gyro": writer.register_channel("sensor_gyro_0", "json", schema),
            "sensor_temp": writer.register_channel("sensor_temp_0", "json", schema),
        }
        for sequence, (topic, time_us, values) in enumerate(messages):
            fields = {"timestamp": time_us / 1e6}
            if topic == "sensor_gyro":
                x, y, counts = values
                fields |= {"x": x, "y": None if math.isnan(y) else y, "counts": counts, "note": "calm"}
            else:
                fields["temperature"] = values[0]
            time_ns = 1000 * time_us
            writer.add_message(channels[topic], time_ns + 5, json.dumps(fields).encode(), time_ns + 2, sequence)
        writer.add_metadata("bench", {"table": "2"})
        writer.finish()


def write_ulog(messages, path):
    """The least log that pyulog reads, which it then writes as it writes logs."""

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    log = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", START_US) + message("B", bytes(40))
    log += message("F", b"sensor_gyro:uint64_t timestamp;double x;double y;int16_t[2] counts;uint8_t[4] _padding0;")
    log += message("F", b"sensor_temp:uint64_t timestamp;float temperature;")
    log += message("I", bytes([16]) + b"char[3] sys_name" + b"PX4")
    log += message("A", struct.pack("<BH", 0, 7) + b"sensor_gyro") + message("A", struct.pack("<BH", 0, 8) + b"sensor_temp")
    for topic, time_us, values in messages:
        if topic == "sensor_gyro":
            x, y, counts = values
            log += message("D", struct.pack("<HQddhh", 7, time_us, x, y, *counts))
        else:
            log += message("D", struct.pack("<HQf", 8, time_us, *values))
    ULog(io.BytesIO(log)).write_ulog(str(path))


SEPARATOR = 80 * "="
IMU = f"""std_msgs/Header header
# The letters are there to put what follows off its alignment.
string label
float32[] short
bool valid
geometry_msgs/Vector3 angular_velocity
float64[9] covariance
uint8 OK=0
{SEPARATOR}
MSG: std_msgs/Header
STAMP
string frame_id
{SEPARATOR}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def imu(row, values):
    x, y, _ = values
    return {
        "label": "n" * (row % 5),
        "short": [0.5 * row] * (row % 4),
        "valid": row % 3 == 0,
        "angular_velocity": {"x": x, "y": y, "z": x + y},
        "covariance": [x * k for k in range(9)],
    }


def namespace(value):
    if isinstance(value, dict):
        return types.SimpleNamespace(**{key: namespace(inner) for key, inner in value.items()})
    return value


def write_ros2(messages, path):
    writer = Ros2Writer(str(path), chunk_size=4096)
    schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU.replace("STAMP", "builtin_interfaces/Time stamp"))
    for row, (topic, time_us, values) in enumerate(messages):
        if topic == "sensor_gyro":
            stamp = {"sec": time_us // 1_000_000, "nanosec": time_us % 1_000_000 * 1000}
            message = imu(row, values) | {"header": {"stamp": stamp, "frame_id": "body"}}
            writer.write_message("/imu", schema, namespace(message), 1000 * time_us, 1000 * time_us, row)
    writer.finish()


def write_ros1(messages, path):
    """Written by hand, as mcap-ros1-support takes classes that ROS has made; read by mcap-ros1-support in the check."""
    with open(path, "wb") as file:
        writer = McapWriter(file, chunk_size=4096, compression=CompressionType.NONE)
        writer.start(profile="ros1", library="make_tables")
        definition = "uint32 seq\n" + "time stamp"
        schema = writer.register_schema("sensor_msgs/Imu", "ros1msg", IMU.replace("STAMP", definition).encode())
        channel = writer.register_channel("/imu", "ros1", schema)
        for row, (topic, time_us, values) in enumerate(messages):
            if topic != "sensor_gyro":
                continue
            it = imu(row, values)
            label, short = it["label"].encode(), it["short"]
            data = struct.pack("<III", row, time_us // 1_000_000, time_us % 1_000_000 * 1000)
            data += struct.pack("<I", 4) + b"body" + struct.pack("<I", len(label)) + label
            data += struct.pack(f"<I{len(short)}f?", len(short), *short, it["valid"])
            data += struct.pack("<3d9d", *it["angular_velocity"].values(), *it["covariance"])
            writer.add_message(channel, 1000 * time_us, data, 1000 * time_us, row)
        writer.finish()


def write_protobuf(messages, path):
    number = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="imu.proto", package="bench", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    vector = file.message_type.add(name="Vector")
    for place, name in enumerate("xyz"):
        vector.field.add(name=name, number=place + 1, type=number.TYPE_DOUBLE, label=number.LABEL_OPTIONAL)
    message = file.message_type.add(name="Imu")
    message.field.add(
        name="stamp", number=1, type=number.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp", label=number.LABEL_OPTIONAL
    )
    message.field.add(
        name="angular_velocity", number=2, type=number.TYPE_MESSAGE, type_name=".bench.Vector", label=number.LABEL_OPTIONAL
    )
    message.field.add(name="short", number=3, type=number.TYPE_FLOAT, label=number.LABEL_REPEATED)
    message.field.add(name="valid", number=4, type=number.TYPE_BOOL, label=number.LABEL_OPTIONAL)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("bench.Imu"))
    with open(path, "wb") as sink, ProtobufWriter(sink) as writer:
        for row, (topic, time_us, values) in enumerate(messages):
            if topic == "sensor_gyro":
                it = imu(row, values)
                made = kind(short=it["short"], valid=it["valid"])
                made.stamp.seconds, made.stamp.nanos = time_us // 1_000_000, time_us % 1_000_000 * 1000
                for name, value in it["angular_velocity"].items():
                    setattr(made.angular_velocity, name, value)
                writer.write_message("/imu", made, log_time=1000 * time_us, publish_time=1000 * time_us)


def main():
    directory = pathlib.Path(sys.argv[1])
    directory.mkdir(parents=True, exist_ok=True)
    messages = recording()
    table = rows(messages)
    write_text(table, directory / "recording.csv")
    write_parquet(table, directory / "recording.parquet")
    write_json(messages, directory / "recording.mcap")
    write_ulog(messages, directory / "recording.ulg")
    write_ros2(messages, directory / "ros2.mcap")
    write_ros1(messages, directory / "ros1.mcap")
    write_protobuf(messages, directory / "protobuf.mcap")


if __name__ == "__main__":
    main()
