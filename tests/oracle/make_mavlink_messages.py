"""The layouts of MAVLink messages, as crates/schuler-recording/src/table/mavlink/messages.txt has them.

    python make_mavlink_messages.py > messages.txt

A line a message of the dialect ardupilotmega, which has those of `common`: number, name, the byte that its checksum begins
with, and the fields in the order of the wire, each NAME:LETTER as of Python's struct, `*N` behind arrays and `!` behind the
field that tells instances. It needs pymavlink (2.4.50).
"""

from pymavlink.dialects.v20 import ardupilotmega

LETTERS = {
    "char": "c", "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I",
    "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d",
}


def main():
    for number, kind in sorted(ardupilotmega.mavlink_map.items()):
        types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
        fields = []
        for name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
            array = f"*{length}" if length else ""
            instance = "!" if name == kind.instance_field else ""
            fields.append(f"{name}:{LETTERS[types[name]]}{array}{instance}")
        print(number, kind.msgname, kind.crc_extra, *fields)


if __name__ == "__main__":
    main()
