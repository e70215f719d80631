"""Checksums of MCAP files: those that this package writes have them, and a bag without any is noted."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.walking_log import bag, bag_map, urdf, walk

from aerobat_pin import open_record
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import estimate
from aerobat_pin.experiments.write_mcap import McapStretch, write_mcap_stretches
from aerobat_pin.records import mcap_is_sealed, parse_map


def test_damage_to_a_sealed_bag_is_noticed(tmp_path: Path) -> None:
    """A bag of rosbags has no checksums, which a note says; sealed, it is refused where one bit in it is wrong."""
    pytest.importorskip("rosbags")
    mcap_reader, mcap_writer = pytest.importorskip("mcap.reader"), pytest.importorskip("mcap.writer")
    (tmp_path / "quadruped.urdf").write_text(urdf())
    chosen = parse_map(bag_map(Path("quadruped.urdf")), "of the test")
    bag(walk(0.6), tmp_path / "walk")
    file = next((tmp_path / "walk").glob("*.mcap"))
    plain = estimate(open_record(file, chosen, tmp_path))
    assert [str(found) for found in plain.findings if found.check == "checksums"] == [
        f"checksums: {file.name} has none: damaged numbers would not be noticed"
    ]
    sealed_file = tmp_path / "sealed.mcap"
    with file.open("rb") as source, sealed_file.open("wb") as target:
        writer = mcap_writer.Writer(target, compression=mcap_writer.CompressionType.NONE)
        writer.start("ros2")
        channels: dict[str, int] = {}
        for schema, channel, message in mcap_reader.make_reader(source).iter_messages():
            if channel.topic not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", kind)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    assert mcap_is_sealed(sealed_file)
    sealed = estimate(open_record(sealed_file, chosen, tmp_path))
    assert not any(found.check == "checksums" for found in sealed.findings)
    content = sealed_file.read_bytes()
    sealed_file.write_bytes(content[:5000] + bytes([content[5000] ^ 1]) + content[5001:])
    with pytest.raises(LogError, match="checksum mismatch"):
        estimate(open_record(sealed_file, chosen, tmp_path))


def test_our_own_file_is_whole(tmp_path: Path) -> None:
    """Every checksum that the format has, of the chunks, the data and the summary, as its own library computes them."""
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "forces.mcap"
    model = pin.buildSampleModelHumanoidRandom()
    time, force = np.linspace(0.0, 1.0, 101), np.tile([1.0, 2.0, 3.0], (100, 1))
    q, v = np.tile(pin.neutral(model), (101, 1)), np.zeros((101, model.nv))
    write_mcap_stretches([McapStretch(model, time, q, v, None, {"/truth/here": ("universe", force)}, 4.0)], path)
    assert mcap_is_sealed(path)
    content = path.read_bytes()
    start, _, summary = struct.unpack("<QQI", content[-28:-8])  # of the footer: before the closing magic
    assert summary == zlib.crc32(content[start:-12])
    end = start - 13  # the end of the data: opcode, length and checksum
    assert struct.unpack("<BQI", content[end:start]) == (0x0F, 4, zlib.crc32(content[:end]))
    with path.open("rb") as file:
        counts = reader.make_reader(file, validate_crcs=True).get_summary().statistics.channel_message_counts
    assert sorted(counts.values()) == [34, 34, 100, 100, 100]
