"""Compares the topics of a PX4 log that `schuler` has written as tables with what pyulog reads.

    check_log.py LOG DIRECTORY

DIRECTORY has TOPIC_INSTANCE.parquet for each topic of LOG with all its fields. Every value must be the same to the last bit.
Ends with status 1 where one is not.
"""

import math
import pathlib
import struct
import sys

import pyarrow.parquet
from pyulog import ULog


def bits(value):
    return "missing" if value is None or not math.isfinite(value) else struct.pack("<d", value)


def main():
    log, directory = ULog(sys.argv[1]), pathlib.Path(sys.argv[2])
    compared = 0
    for dataset in log.data_list:
        name = f"{dataset.name}_{dataset.multi_id}"
        table = pyarrow.parquet.read_table(directory / f"{name}.parquet")
        for field, values in dataset.data.items():
            # What only fills a nested message up to its alignment is nobody's value.
            if field.rpartition(".")[2].startswith("_padding"):
                continue
            column = f"{name}.{field}"
            if column not in table.column_names:
                sys.exit(f"{name}: lacks {column}; has {', '.join(table.column_names)}")
            # Both are the double nearest to the microseconds.
            stamp = field in ("timestamp", "timestamp_sample")
            expected = [int(value) / 10**6 if stamp else float(value) for value in values]
            found = table[column].to_pylist()
            wrong = [row for row, pair in enumerate(zip(found, expected)) if bits(pair[0]) != bits(pair[1])]
            if wrong or len(found) != len(expected):
                sys.exit(f"{column}: {len(found)} values, expected {len(expected)}; wrong rows {wrong[:10]}")
            compared += len(found)
    # A topic of which nothing was ever said is none to pyulog.
    tables = (pyarrow.parquet.read_metadata(path) for path in directory.glob("*.parquet"))
    topics = sum(table.num_rows > 0 for table in tables)
    if topics != len(log.data_list):
        sys.exit(f"{topics} topics, expected {len(log.data_list)}")
    print(f"{compared} values of {topics} topics are the same")


main()
