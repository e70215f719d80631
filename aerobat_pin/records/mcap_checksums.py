"""Checksums of MCAP files: write those that `rosbags` leaves out, and see whether a file has any.

A record is an opcode (1 byte), the length of its content (8 bytes, little endian), and the content. Three kinds have
a CRC-32, 0 for none: a chunk of its messages before compression, the end of the data of all bytes before it, and the
footer of the summary and of itself up to there (https://mcap.dev/spec).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

MAGIC = b"\x89MCAP0\r\n"
FOOTER, CHUNK, DATA_END = 0x02, 0x06, 0x0F
RECORD_HEAD = 9  # bytes: opcode and length
CRC_IN_CHUNK, CRC_IN_FOOTER = 24, 16  # bytes of a content that are before its checksum
BYTES_READ = 1_000_000  # at once


class _McapRecord(NamedTuple):
    """Opcode of a record, and where in the file its content begins and ends."""

    opcode: int
    begin: int
    end: int


def seal_mcap(path: Path) -> None:
    """Write the checksums into a file whose chunks are not compressed. Raises OSError if it cannot be written."""
    with path.open("r+b") as file:
        for record in list(_mcap_records(file)):
            if record.opcode == CHUNK:
                file.seek(record.begin)
                content = file.read(record.end - record.begin)
                name = struct.unpack_from("<I", content, CRC_IN_CHUNK + 4)[0]
                if name == 0:  # no compression
                    _write_crc(file, record.begin + CRC_IN_CHUNK, zlib.crc32(content[CRC_IN_CHUNK + 4 + 4 + 8 :]))
            elif record.opcode == DATA_END:
                _write_crc(file, record.begin, _crc_of(file, 0, record.begin - RECORD_HEAD))
            elif record.opcode == FOOTER:
                file.seek(record.begin)
                (start,) = struct.unpack("<Q", file.read(8))
                first = start or record.begin - RECORD_HEAD
                _write_crc(file, record.begin + CRC_IN_FOOTER, _crc_of(file, first, record.begin + CRC_IN_FOOTER))


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


def _crc_of(file: BinaryIO, begin: int, end: int) -> int:
    file.seek(begin)
    found, left = 0, end - begin
    while left > 0 and (piece := file.read(min(left, BYTES_READ))):
        found, left = zlib.crc32(piece, found), left - len(piece)
    return found


def _write_crc(file: BinaryIO, place: int, value: int) -> None:
    file.seek(place)
    file.write(struct.pack("<I", value))
