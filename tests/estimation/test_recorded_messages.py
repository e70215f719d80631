"""The stream of docs/recordings.md runs with recorded messages; currents become torques; checksums of MCAP files."""

import re
import struct
import zlib
from ast import literal_eval
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import tomli_w
from support.pages import ROOT
from support.recorded import edited, recorded
from support.walking_log import bag, bag_map, table, table_map, urdf, walk

from aerobat_pin import open_record
from aerobat_pin.errors import LogError, MapError, OutputError
from aerobat_pin.estimation import estimate
from aerobat_pin.experiments.write_mcap import McapStretch, write_mcap_stretches
from aerobat_pin.records import LogTable, mcap_is_sealed, parse_map, read_columns, stamp


@pytest.fixture
def folder(here: Path) -> Path:
    """Return the current folder, with the quadruped's URDF."""
    (here / "quadruped.urdf").write_text(urdf())
    return here


def test_the_stream_of_the_docs_finds_the_forces(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its text as it stands, with recorded messages in the order of their stamps, against the bag as a whole."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    bag(walk(), folder / "walk")
    values = edited(bag_map(Path("quadruped.urdf")), {"check": None})
    (folder / "map.toml").write_text(tomli_w.dumps(values))
    whole = estimate(recorded(folder / "walk", values)).estimates["force_level"]
    with highlevel.AnyReader([folder / "walk"]) as reader:
        messages = [(one.topic, reader.deserialize(raw, one.msgtype)) for one, _, raw in reader.messages()]
    text = (ROOT / "docs" / "recordings.md").read_text()
    [stream] = [code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "OnlineEstimator" in code]
    space = {"messages": sorted(messages, key=lambda item: stamp(item[1]))}
    exec(stream, space)
    said = re.findall(r"^([\d.]+) (\{.*\}) True$", capsys.readouterr().out, re.MULTILINE)
    assert len(said) > 1400
    end, found = np.array([time for time, _ in said], float), [literal_eval(forces) for _, forces in said]
    up = [forces["FL_FOOT.Fz"] for forces in found[100:]]
    np.testing.assert_allclose(up, np.interp(end - 1.7e9, walk().time, walk().force[:, 0, 2])[100:], atol=1.0)
    for k in range(100, 1400, 100):
        at = int(np.argmin(np.abs(whole.time[1:] - end[k])))
        np.testing.assert_allclose([*found[k].values()], whole.components[at], atol=0.06)  # which knows friction
    online = space["stream"]
    first = next(message for topic, message in messages if topic == "/joint_states")
    assert online.message("/joint_states", first) == []
    assert online.health.samples["joints.position"]["late"] + online.health.samples["joints.position"]["outlier"] == 1
    assert online.health.starts == 1


def test_threads_that_read_bags_at_once_leave_their_reader_as_it_was(folder: Path) -> None:
    """One put back what another had replaced: a budget of unpacked bytes stayed for all that is read later."""
    storage = pytest.importorskip("rosbags.rosbag2.storage_mcap")
    own = storage.DECOMPRESSORS
    bag(walk(0.3), folder / "walk")
    with ThreadPoolExecutor(3) as pool:
        read = pool.map(lambda _: read_columns(folder / "walk", LogTable()), range(9))
        assert len({columns.names for columns in read}) == 1
    assert storage.DECOMPRESSORS is own


def test_currents_of_all_joints_have_one_constant(folder: Path) -> None:
    """Of each unit that the map states, A or mA; `*` stands for every joint; a foreign name does not."""
    frame, values = table(walk(1.0)), table_map(Path("quadruped.urdf"))
    columns = values["joints"]["effort"]["columns"]
    frame.assign(**{name: frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "A", "torque_per_unit": {"*": 3.0}}
    found = estimate(recorded(Path("walk.csv"), values))
    assert found.warnings == []
    frame.assign(**{name: 1e3 * frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "mA", "torque_per_unit": {"*": 0.003}}
    again = recorded(Path("walk.csv"), values)
    np.testing.assert_allclose(again.block(0, 300).tau, found.record.block(0, 300).tau, atol=1e-9)
    values["joints"]["effort"]["torque_per_unit"] = {"knee": 3.0}
    with pytest.raises(MapError, match=r"torque_per_unit: no joint 'knee'"):
        recorded(Path("walk.csv"), values)


def test_damage_to_a_sealed_bag_is_noticed(tmp_path: Path) -> None:
    """A bag of rosbags has no checksums, which a note says; sealed, it is refused where one bit in it is wrong."""
    pytest.importorskip("rosbags")
    mcap_reader, mcap_writer = pytest.importorskip("mcap.reader"), pytest.importorskip("mcap.writer")
    (tmp_path / "quadruped.urdf").write_text(urdf())
    chosen = parse_map(bag_map(Path("quadruped.urdf")), "of the test")
    bag(walk(0.6), tmp_path / "walk")
    file = next((tmp_path / "walk").glob("*.mcap"))
    plain = estimate(open_record(file, chosen, tmp_path))
    told = [str(found) for found in plain.findings if found.check == "checksums"]
    assert told == [f"checksums: {file.name} has none: damaged numbers would not be noticed"]
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
    stretch = McapStretch(model, time, q, v, None, {"/truth/here": ("universe", force)}, 4.0)
    with pytest.raises(OutputError, match=r"forces\.mcap: time -1 s: MCAP of ROS 2 has 0 to"):
        write_mcap_stretches([replace(stretch, time=time - 1.0)], path)
    write_mcap_stretches([stretch], path)
    assert mcap_is_sealed(path)
    content = path.read_bytes()
    start, _, summary = struct.unpack("<QQI", content[-28:-8])  # of the footer: before the closing magic
    assert summary == zlib.crc32(content[start:-12])
    end = start - 13  # the end of the data: opcode, length and checksum
    assert struct.unpack("<BQI", content[end:start]) == (0x0F, 4, zlib.crc32(content[:end]))
    with path.open("rb") as file:
        counts = reader.make_reader(file, validate_crcs=True).get_summary().statistics.channel_message_counts
    assert sorted(counts.values()) == [34, 34, 100, 100, 100]
