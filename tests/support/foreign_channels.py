"""Channels in an MCAP file that are no ROS messages, as other programs write them beside those that are."""

import struct
from pathlib import Path

from aerobat_pin.records.bag_columns import MAGIC, RECORD_HEAD, mcap_records

DATA_END = 0x0F  # opcode


def mcap_texts(*contents: bytes) -> bytes:
    """Return texts as MCAP has them, one behind the other."""
    return b"".join(struct.pack("<I", len(content)) + content for content in contents)


def mcap_record(opcode: int, content: bytes) -> bytes:
    """Return a record of MCAP."""
    return struct.pack("<BQ", opcode, len(content)) + content


def with_foreign_channels(source: Path, target: Path) -> None:
    """Copy an MCAP file with channels of JSON, protobuf, JSON without a schema; no index, no profile, as if killed."""
    more = b""
    kinds = ((b"/status", b"json", b"jsonschema"), (b"/blob", b"protobuf", b"protobuf"), (b"/bare", b"json", b""))
    for number, (topic, encoding, language) in enumerate(kinds, 901):
        if language:
            schema = struct.pack("<H", number) + mcap_texts(b"Status", language, b"\n\xff\x80{}")
            more += mcap_record(0x03, schema)
        described = struct.pack("<HH", number, number if language else 0) + mcap_texts(topic, encoding, b"")
        more += mcap_record(0x04, described)
        more += mcap_record(0x05, struct.pack("<HIQQ", number, 0, 1, 1) + b"{}")
    data = source.read_bytes()
    with source.open("rb") as file:
        records = list(mcap_records(file))
    head = MAGIC + mcap_record(0x01, mcap_texts(b"", b"library"))
    first, end = records[0][2], next(begin for opcode, begin, _ in records if opcode == DATA_END) - RECORD_HEAD
    last = mcap_record(DATA_END, bytes(4)) + mcap_record(0x02, bytes(20)) + MAGIC
    target.write_bytes(head + more + data[first:end] + last)
