"""Channels in an MCAP file that are no ROS messages, as other programs write them beside those that are."""

import struct
from pathlib import Path

from aerobat_pin.records.bag_columns import MAGIC, RECORD_HEAD, mcap_records

DATA_END = 0x0F  # opcode


def _text(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def _written(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def with_foreign_channels(source: Path, target: Path) -> None:
    """Copy an MCAP file with three more channels: of JSON, of protobuf, and of JSON without a schema.

    The copy has no index, as that of a recorder that was killed.
    """
    more = b""
    for number, (topic, encoding, language) in enumerate(
        ((b"/status", b"json", b"jsonschema"), (b"/blob", b"protobuf", b"protobuf"), (b"/bare", b"json", b"")), 901
    ):
        if language:
            schema = struct.pack("<H", number) + _text(b"Status") + _text(language) + _text(b"\n\xff\x80{}")
            more += _written(0x03, schema)
        more += _written(
            0x04, struct.pack("<HH", number, number if language else 0) + _text(topic) + _text(encoding) + _text(b"")
        )
        more += _written(0x05, struct.pack("<HIQQ", number, 0, 1, 1) + b"{}")
    data = source.read_bytes()
    with source.open("rb") as file:
        records = list(mcap_records(file))
    head, end = records[0][2], next(begin for opcode, begin, _ in records if opcode == DATA_END) - RECORD_HEAD
    last = _written(DATA_END, bytes(4)) + _written(0x02, bytes(20)) + MAGIC
    target.write_bytes(data[:head] + more + data[head:end] + last)
