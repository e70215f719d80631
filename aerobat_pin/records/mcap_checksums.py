"""Whether an MCAP file has checksums, which `rosbags` compares when it reads.

A record is an opcode (1 byte), the length of its content (8 bytes, little endian), and the content. That of a chunk has
a CRC-32 of its messages before compression, 0 for none (https://mcap.dev/spec).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

MAGIC = b"\x89MCAP0\r\n"
FOOTER, CHUNK = 0x02, 0x06
RECORD_HEAD = 9  # bytes: opcode and length
CRC_IN_CHUNK = 24  # bytes of a content that are before its checksum


class _McapRecord(NamedTuple):
    """Opcode of a record, and where in the file its content begins and ends."""

    opcode: int
    begin: int
    end: int


def mcap_is_sealed(path: Path) -> bool:
    """Return whether damage to the messages of an MCAP file would be noticed; True for what is no MCAP file."""
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return True
        for record in _mcap_records(file):
            if record.opcode == CHUNK:
                file.seek(record.begin + CRC_IN_CHUNK)
                if file.read(4) == bytes(4):
                    return False
    return True


def _mcap_records(file: BinaryIO) -> Iterator[_McapRecord]:
    """Yield the records of a file, as far as it is whole."""
    place = len(MAGIC)
    while True:
        file.seek(place)
        head = file.read(RECORD_HEAD)
        if len(head) < RECORD_HEAD:
            return
        opcode, length = struct.unpack("<BQ", head)
        yield _McapRecord(opcode, place + RECORD_HEAD, place + RECORD_HEAD + length)
        if opcode == FOOTER:
            return
        place += RECORD_HEAD + length
