"""Checksums of MCAP files: those that this package writes have them, and a bag without any is noted."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest
from support.walking_log import bag, bag_map, urdf, walk

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import estimate
from aerobat_pin.records import open_record, parse_map
from aerobat_pin.records.mcap_checksums import mcap_is_sealed, seal_mcap


def test_damage_to_a_sealed_bag_is_noticed(tmp_path: Path) -> None:
    """A bag of rosbags has no checksums, which a note says; sealed, it is refused where one bit in it is wrong."""
    pytest.importorskip("rosbags")
    (tmp_path / "quadruped.urdf").write_text(urdf())
    chosen = parse_map(bag_map(Path("quadruped.urdf")), "of the test")
    bag(walk(0.6), tmp_path / "walk")
    file = next((tmp_path / "walk").glob("*.mcap"))
    plain = estimate(open_record(file, chosen, tmp_path))
    assert [str(found) for found in plain.findings if found.check == "checksums"] == [
        f"checksums: {file.name} has none: damaged numbers would not be noticed"
    ]
    seal_mcap(file)
    assert mcap_is_sealed(file)
    sealed = estimate(open_record(file, chosen, tmp_path))
    assert not any(found.check == "checksums" for found in sealed.findings)
    content = file.read_bytes()
    start, _, summary = struct.unpack("<QQI", content[-28:-8])  # of the footer: before the closing magic
    assert summary == zlib.crc32(content[start:-12])
    end = content.index(struct.pack("<BQ", 0x0F, 4), start - 13)
    assert struct.unpack_from("<I", content, end + 9)[0] == zlib.crc32(content[:end])
    file.write_bytes(content[: start // 2] + bytes([content[start // 2] ^ 1]) + content[start // 2 + 1 :])
    with pytest.raises(LogError, match="checksum mismatch"):
        estimate(open_record(file, chosen, tmp_path))
