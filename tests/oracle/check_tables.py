"""Compares tables that `schuler` has written with what the tools of the originals' formats read.

    check_tables.py DIRECTORY

DIRECTORY is that of make_tables.py, with NAME-copy.csv, NAME-copy.csv.gz and NAME-copy.parquet beside each file NAME that
it made. Every value must be the same to the last bit. Ends with status 1 where one is not.
"""

import csv
import gzip
import json
import math
import pathlib
import struct
import sys

import pyarrow.parquet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoder
from mcap_ros1.decoder import DecoderFactory as Ros1Decoder
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder
from pyulog import ULog

from make_tables import GYRO, TEMPERATURE, rows


def bits(values):
    return ["missing" if value is None or math.isnan(value) else struct.pack("<d", value) for value in values]


def by_pyulog(path):
    log = ULog(str(path))
    gyro = log.get_dataset("sensor_gyro").data
    counts = zip(gyro["counts[0]"], gyro["counts[1]"])
    messages = [
        ("sensor_gyro", int(time), [float(x), float(y), list(map(float, both))])
        for time, x, y, both in zip(gyro["timestamp"], gyro["x"], gyro["y"], counts)
    ]
    temperature = log.get_dataset("sensor_temp").data
    messages += [
        ("sensor_temp", int(time), [float(value)]) for time, value in zip(temperature["timestamp"], temperature["temperature"])
    ]
    return table(messages)


def by_mcap(path):
    messages = []
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            fields = json.loads(message.data)
            time_us = round(fields["timestamp"] * 1e6)
            if channel.topic == "sensor_gyro_0":
                y = math.nan if fields["y"] is None else fields["y"]
                messages.append(("sensor_gyro", time_us, [fields["x"], y, fields["counts"]]))
            else:
                messages.append(("sensor_temp", time_us, [fields["temperature"]]))
    return table(messages)


def table(messages):
    return dict(zip([*GYRO, TEMPERATURE], zip(*rows(messages))))


def by_pyarrow(path):
    read = pyarrow.parquet.read_table(path)
    columns = {name: read[name].to_pylist() for name in read.column_names}
    columns[GYRO[0]] = [microseconds / 1e6 for microseconds in read[GYRO[0]].cast("int64").to_pylist()]
    return columns


def by_csv(path):
    opened = gzip.open(path, "rt") if path.suffix == ".gz" else open(path)
    with opened as file:
        header, *cells = csv.reader(file)
    return {name: [float(cell) if cell else None for cell in column] for name, column in zip(header, zip(*cells))}


def by_decoder(path, factory, seconds):
    columns = {}
    with open(path, "rb") as file:
        for _, _, message, it in make_reader(file, decoder_factories=[factory()]).iter_decoded_messages():
            values = {"/imu@log_time": message.log_time / 10**9} | seconds(it)
            values |= {f"/imu.angular_velocity.{axis}": getattr(it.angular_velocity, axis) for axis in "xyz"}
            values |= {f"/imu.short[{k}]": it.short[k] if k < len(it.short) else None for k in range(3)}
            values["/imu.valid"] = float(it.valid)
            for k, value in enumerate(getattr(it, "covariance", [])):
                values[f"/imu.covariance[{k}]"] = value
            for name, value in values.items():
                columns.setdefault(name, []).append(value)
    return columns


def ros_seconds(names):
    def of(it):
        whole, nanoseconds = (getattr(it.header.stamp, name) for name in names)
        return {"/imu.header.stamp": float(f"{whole}.{nanoseconds:09}")}

    return of


def main():
    directory = pathlib.Path(sys.argv[1])
    protobuf_seconds = lambda it: {"/imu.stamp": float(f"{it.stamp.seconds}.{it.stamp.nanos:09}")}
    originals = {
        "recording.csv": by_csv(directory / "recording.csv"),
        "recording.csv.gz": by_csv(directory / "recording.csv.gz"),
        "recording.parquet": by_pyarrow(directory / "recording.parquet"),
        "recording.mcap": by_mcap(directory / "recording.mcap"),
        "recording.ulg": by_pyulog(directory / "recording.ulg"),
        "ros2.mcap": by_decoder(directory / "ros2.mcap", Ros2Decoder, ros_seconds(["sec", "nanosec"])),
        "ros1.mcap": by_decoder(directory / "ros1.mcap", Ros1Decoder, ros_seconds(["secs", "nsecs"])),
        "protobuf.mcap": by_decoder(directory / "protobuf.mcap", ProtobufDecoder, protobuf_seconds),
    }
    compared = 0
    for name, original in originals.items():
        for ending in [".csv", ".csv.gz", ".parquet"]:
            path = directory / f"{name}-copy{ending}"
            if ending == ".parquet":
                read = pyarrow.parquet.read_table(path)
                copy = {column: read[column].to_pylist() for column in read.column_names}
            else:
                copy = by_csv(path)
            for column, values in original.items():
                if column not in copy:
                    sys.exit(f"{path.name}: lacks {column}; has {', '.join(copy)}")
                pairs = list(zip(bits(copy[column]), bits(values)))
                wrong = [row for row, (found, expected) in enumerate(pairs) if found != expected]
                if wrong or len(copy[column]) != len(values):
                    sys.exit(f"{path.name}: {column}: {len(copy[column])} values, expected {len(values)}; wrong rows {wrong}")
                compared += len(values)
    print(f"{compared} values of {len(originals)} files are the same in each of 3 formats")


main()
