"""A stream is the road of records, a sample at a time: equal to the batch, and nothing that arrives ends it."""

import pickle
import tracemalloc
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.further import further
from support.recorded import edited, recorded
from support.stream_faults import Fault, faulty
from support.walking_log import FEET, Walk, table, table_map, urdf, walk

from aerobat_pin.errors import MapError
from aerobat_pin.estimation import OnlineEstimator, OnlineSample, estimate, stream_of
from aerobat_pin.estimation.stream_rings import LENGTH
from aerobat_pin.observers import DOUBTFUL
from aerobat_pin.records import LARGEST_VALUE, Map, parse_map

# Channel -> rate [Hz] and first stamp [s].
CLOCKS = {"base.position": (120.0, 0.0031), "base.quaternion": (333.0, 0.0007), "base.velocity": (250.0, 0.0)}
CLOCKS |= {"base.rate": (411.0, 0.0013), "joints.position": (500.0, 0.002), "joints.velocity": (499.0, 0.0)}
CLOCKS |= {"joints.effort": (777.0, 0.0004)}
Stamped = list[tuple[float, dict[str, float]]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the quadruped's file."""
    path = tmp_path_factory.mktemp("stream")
    (path / "quadruped.urdf").write_text(urdf())
    return path


def mapped(folder: Path, rate: float | None = 500.0, **more: Any) -> Map:
    """Return the map of the walk's table, without what is only compared."""
    changes = {"check": None, "log": {"time": {"column": "t"}, "rate": rate}, **more}
    return parse_map(edited(table_map(folder / "quadruped.urdf"), changes), "of the test")


def columns_of(chosen: Map) -> dict[str, tuple[str, ...]]:
    """Return channel -> its columns."""
    parts = {"base": ("position", "quaternion", "velocity", "rate", "acceleration")}
    parts["joints"] = ("position", "velocity", "effort")
    sections = {f"{name}.{key}": getattr(getattr(chosen, name), key) for name, keys in parts.items() for key in keys}
    return {channel: section.columns for channel, section in sections.items() if section is not None}


def messages(walked: Walk) -> Stamped:
    """Return the rows of the walk's table: time [s] and columns."""
    return [(row["t"], row) for row in table(walked).to_dict("records")]


def on_own_clocks(chosen: Map, begin: float = 0.0, seconds: float = 1.0) -> Stamped:
    """Return samples of every channel at times of its own, in the order of their stamps."""
    whole = table(walk())
    found: Stamped = []
    for key, names in columns_of(chosen).items():
        rate, first = CLOCKS.get(key, CLOCKS["base.rate"])
        for time in np.arange(first, seconds, 1.0 / rate):
            found.append((begin + time, {name: float(np.interp(time, whole["t"], whole[name])) for name in names}))
    return sorted(found, key=lambda one: one[0])


def batch(folder: Path, chosen: Map, stamped: Stamped) -> tuple[dict[str, Any], OnlineEstimator]:
    """Return the estimates of the record as a whole, by observer, and a stream that expects what it shows."""
    rows = [{**values, "t": time} for time, values in stamped]
    names = ["t", *(name for part in columns_of(chosen).values() for name in part)]
    pd.DataFrame(rows)[names].to_csv(folder / "log.csv", index=False, float_format="%.17g")
    record = recorded(folder / "log.csv", chosen)
    return dict(estimate(record, trust=True).estimates), stream_of(record)


def streamed(stream: OnlineEstimator, stamped: Stamped) -> list[OnlineSample]:
    """Return the estimates of samples, one after the other."""
    return [one for time, values in stamped for one in stream.push(time, values)]


def values_of(found: list[OnlineSample], observer: str = "force_level") -> np.ndarray:
    """Return the components (m, c) of one observer."""
    return np.array([list(one.components.values()) for one in found if one.observer == observer])


@pytest.mark.parametrize("source", ["imu", "joints", *further("measured")])
@pytest.mark.parametrize("begin", [1_700_000_000.25, *further(0.0)])
def test_seven_clocks_give_the_estimates_of_the_record(folder: Path, begin: float, source: str) -> None:
    """Each channel at a rate and phase of its own: within 1e-9 N, deviations included, Unix stamps or not."""
    values = mapped(folder).base.model_dump(by_alias=True, exclude_none=True)
    if source != "measured":
        values = {key: values[key] for key in ("quaternion", "rate")} | {"from": source}
    if source == "imu":
        values |= {"acceleration": {"columns": ["acc_x", "acc_y", "acc_z"]}, "imu": {"place": [0.1, 0.0, 0.05]}}
    chosen = mapped(folder, base=values, observer={"names": ["force_level", "momentum", "kalman"], "gain": 300.0})
    stamped = on_own_clocks(chosen, begin, 0.5)
    whole, stream = batch(folder, chosen, stamped)
    found = streamed(stream, stamped)
    for name, one in whole.items():
        count = len(values_of(found, name))
        assert count >= 220
        np.testing.assert_allclose([s.end for s in found if s.observer == name], one.time[1 : count + 1], atol=1e-9)
        np.testing.assert_allclose(values_of(found, name), one.components[:count], rtol=0.0, atol=1e-9)
        deviation = [list(s.deviation.values()) for s in found if s.observer == name]
        np.testing.assert_allclose(deviation, one.standard_deviation[:count], rtol=1e-6)
    assert stream.health.starts == 1


def test_by_the_stamps_of_its_joints_a_stream_is_the_record(folder: Path) -> None:
    """Without log.rate; a batch of even stamps has the same times."""
    chosen = mapped(folder, None)
    stamped = messages(walk(1.2))
    whole, stream = batch(folder, chosen, stamped)
    found = streamed(stream, stamped)
    assert len(found) == 600
    np.testing.assert_allclose(values_of(found), whole["force_level"].components, rtol=0.0, atol=1e-9)
    assert set(found[-1].seen) == set(found[-1].components)
    assert max(found[-1].seen.values()) <= 1.0
    assert not found[0].settled
    assert found[-1].settled


def test_a_copy_of_a_stream_begins_anew(folder: Path) -> None:
    """It found no force at all (0 N): its kernels wrote into other memory than it read."""
    stamped = messages(walk(0.1))
    stream = OnlineEstimator(mapped(folder, None), folder)
    streamed(stream, stamped[:10])
    stream.tune("momentum", 300.0)
    fresh = OnlineEstimator(mapped(folder, None, observer={"names": ["momentum"], "gain": 300.0}), folder)
    expected = values_of(streamed(fresh, stamped), "momentum")
    for copy in (deepcopy(stream), pickle.loads(pickle.dumps(stream))):
        np.testing.assert_array_equal(values_of(streamed(copy, stamped), "momentum"), expected)


def test_a_leg_in_the_air_tells_a_stream_what_it_tells_a_record(folder: Path) -> None:
    """A foot carries nothing after 1 s, and its joints rub: a stream expects the errors of rows that a record shows."""
    walked, rub = walk(), np.array([0.4, 0.2, 0.1])  # [N m]
    model = pin.buildModelFromXML(urdf(), pin.JointModelFreeFlyer())
    data, foot = model.createData(), model.getFrameId(FEET[0])
    tau = walked.tau.copy()
    tau[:, :3] += rub * np.sign(np.sin(20.0 * walked.time))[:, None]
    for k in range(500, len(tau)):
        J = pin.computeFrameJacobian(model, data, walked.q[k], foot, pin.LOCAL_WORLD_ALIGNED)[:3, 6:9]
        tau[k, :3] += J.T @ walked.force[k, 0]
    base = mapped(folder).base.model_dump(by_alias=True, exclude_none=True)
    chosen = mapped(folder, None, base={key: base[key] for key in ("quaternion", "rate")} | {"from": "joints"})
    stamped = messages(replace(walked, tau=tau))
    stream = OnlineEstimator(chosen, folder)
    streamed(stream, stamped)
    _, whole = batch(folder, chosen, stamped)
    learnt, told = (one._observers[0].expected.row_error[6:9] for one in (stream, whole))
    assert np.abs(np.log(told / learnt)).max() < np.log(1.55)  # a record knows more: of 0.1 it says 0.16, a stream 0.24
    assert np.all(told > 0.9 * rub)


def test_friction_of_legs_that_are_never_in_the_air_counts(folder: Path) -> None:
    """Joints of a robot that stays on its feet rub: 31 % of its forces were beyond two deviations."""
    walked, rub = walk(1.6), 0.4 * np.array([1.0, 0.5, 0.25])  # [N m]
    rates = np.gradient(walked.q[:, 7:], walked.time, axis=0)
    tau = walked.tau + np.tile(rub, 4) * np.tanh(rates / 0.02)
    found = streamed(OnlineEstimator(mapped(folder, None), folder), messages(replace(walked, tau=tau)))[225:]
    errors = np.abs(values_of(found) - walked.force.reshape(len(walked.force), -1)[225 : len(found) + 225])
    beyond = errors > 2.0 * np.array([list(one.deviation.values()) for one in found])
    assert beyond.mean() < 0.05
    assert np.sqrt(np.mean(errors**2)) < 1.0


@pytest.mark.parametrize("jitter", [0.0, 2e-3])
def test_ten_samples_a_second_have_no_holes(folder: Path, jitter: float) -> None:
    """Steps as long as `log.longest_gap` but for jitter are no holes, as in a record: the stream begins once."""
    late = jitter * np.random.default_rng(1).uniform(-1.0, 1.0, 41)
    stamped = [(t + dt, row | {"t": t + dt}) for (t, row), dt in zip(messages(walk(4.0, 10.0)), late, strict=True)]
    _, stream = batch(folder, mapped(folder, 10.0), stamped)
    assert len(streamed(stream, stamped)) >= 38
    assert stream.health.starts == 1


@pytest.fixture(scope="module")
def clean(folder: Path) -> tuple[OnlineEstimator, Stamped, np.ndarray]:
    """Return a stream, samples without a fault, and their estimates."""
    stream = OnlineEstimator(mapped(folder, None), folder)
    stamped = messages(walk(1.2))
    return stream, stamped, values_of(streamed(stream, stamped))


def test_what_is_refused_costs_at_most_an_estimate(clean: tuple[OnlineEstimator, Stamped, np.ndarray]) -> None:
    """NaN, infinity, a zero quaternion, 1e300, text, None: counted, and the filters go on."""
    stream, stamped, usual = clean
    wrong = [("FL_HAA_pos", bad) for bad in (np.nan, np.inf, -np.inf, 1e300, "text", None)]
    wrong += [(column, np.nan) for column in ("gyro_x", "qw", "RR_KFE_tau")]
    spoilt = {300 + 10 * k: {column: bad} for k, (column, bad) in enumerate(wrong)}
    before = stream.health
    stream.reset()
    found = streamed(stream, [(t, row | spoilt.get(i, {})) for i, (t, row) in enumerate(stamped)])
    assert stream.health.count("refused") == before.count("refused") + len(wrong)
    assert len(found) >= len(usual) - len(wrong)
    assert stream.health.starts == before.starts + 1
    stream.reset()
    nothing = {"qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 0.0}
    found = streamed(stream, [(t, row | nothing if i == 300 else row) for i, (t, row) in enumerate(stamped)])
    assert len(found) == len(usual)
    assert stream.push(np.nan, stamped[0][1]) == []


def test_a_stream_takes_numbers_as_large_as_a_record_does(clean: tuple[OnlineEstimator, Stamped, np.ndarray]) -> None:
    """An excavator's effort of 3e6 N m; beyond `LARGEST_VALUE` nothing."""
    stream, stamped, _ = clean
    for effort, refused in ((3e6, 0), (1.1 * LARGEST_VALUE, 1)):
        stream.reset()
        before = stream.health.count("refused")
        stream.push(0.0, stamped[0][1] | {"RR_KFE_tau": effort})
        assert stream.health.count("refused") - before == refused


def test_duplicates_and_late_samples(clean: tuple[OnlineEstimator, Stamped, np.ndarray], folder: Path) -> None:
    """The first of two is kept; a late sample is inserted where nothing has been estimated behind it, else dropped."""
    stream, stamped, usual = clean
    stream.reset()
    before = stream.health
    doubled = [one for t, row in stamped for one in ((t, row), (t, {key: 0.5 * x for key, x in row.items()}))]
    found = values_of(streamed(stream, doubled))
    assert stream.health.count("duplicate") - before.count("duplicate") == 6 * len(stamped)
    assert stream.health.count("refused") - before.count("refused") == len(stamped)  # half a quaternion
    shape = min(len(found), len(usual))
    assert shape == len(usual)
    rng = np.random.default_rng(3)
    arrival = sorted(((t + 0.02 * rng.random(), t, row) for t, row in stamped), key=lambda one: one[0])
    for wait, late in ((0.02, False), (0.0, True)):
        waiting = OnlineEstimator(mapped(folder, None), folder, wait=wait)
        heard = streamed(waiting, [(t, row) for _, t, row in arrival])
        assert (waiting.health.count("late") > 0) == late
        assert waiting.health.starts <= 3  # that overtake each other is no clock that was set
        if not late:
            ends = np.array([one.end for one in heard])
            assert np.all(np.diff(ends) > 0.0)
            assert len(heard) >= len(usual) - 12
            assert waiting.health.starts == 1
            np.testing.assert_allclose(values_of(heard)[50:], usual[50 : len(heard)], atol=0.2)  # sizes learnt later


def test_clocks_that_step_and_channels_that_stall(clean: tuple[OnlineEstimator, Stamped, np.ndarray]) -> None:
    """One stamp an hour ahead is off; a clock that is set is followed from the third stamp on, with one new start."""
    stream, stamped, usual = clean
    stream.reset()
    before = stream.health
    found = streamed(stream, [(t + 3600.0 if i == 300 else t, row) for i, (t, row) in enumerate(stamped)])
    assert stream.health.count("outlier") == before.count("outlier") + 7
    assert stream.health.starts == before.starts + 1
    assert len(found) == len(usual) - 1
    for step in (3600.0, -2.0):
        stream.reset()
        before = stream.health
        found = streamed(stream, [(t + step if i >= 300 else t, row) for i, (t, row) in enumerate(stamped)])
        assert stream.health.count("clock_step") == before.count("clock_step") + 7
        assert stream.health.starts == before.starts + 2
        assert len(found) >= len(usual) - 5
    stream.reset()
    before = stream.health
    for i, (t, row) in enumerate(stamped):
        silent = 200 <= i < 450  # half a second without gyro
        stream.push(t, {key: x for key, x in row.items() if not (silent and key.startswith("gyro"))})
        if i == 400:
            assert stream.health.stalled == ("base.rate",)
    assert stream.health.stalled == ()
    assert stream.health.starts == before.starts + 2
    assert stream.health.skipped > before.skipped
    assert stream.health.settled


@pytest.mark.parametrize(
    ("step", "wait"), [(0.0203, 0.05), (0.2, 0.0), *further((0.0203, 0.0), (0.02, 0.0), (0.02, 0.05), (0.2, 0.05))]
)
def test_clocks_set_back_a_little_are_followed(folder: Path, step: float, wait: float) -> None:
    """Samples of before and after are not laid between each other: new starts, then the forces of clocks not set."""
    chosen = mapped(folder, None, observer={"names": ["force_level", "kalman"]})
    stamped = on_own_clocks(chosen, seconds=0.8)
    usual, stream = OnlineEstimator(chosen, folder, wait=wait), OnlineEstimator(chosen, folder, wait=wait)
    expected = streamed(usual, stamped)
    found = streamed(stream, [(t - step * (t > 0.4), row) for t, row in stamped])
    assert usual.health.starts == 1
    assert 2 <= stream.health.starts <= 4
    assert stream.health.count("clock_step") >= 3
    assert stream.health.count("inserted") == 0
    assert not all(one.settled for one in found[-800:])
    for name in ("force_level", "kalman"):
        last, wanted = (values_of(part, name)[-100:] for part in (found, expected))
        np.testing.assert_allclose(last, wanted, atol=1.0)


def test_a_channel_that_hangs_is_named(clean: tuple[OnlineEstimator, Stamped, np.ndarray]) -> None:
    """A driver repeats its last sample for 0.7 s: after 0.5 s it is named, and no estimate is called settled."""
    stream, stamped, usual = clean
    for part, keys in (("gyro", ("base.rate",)), ("tau", ("joints.effort",)), ("pos", ())):  # joints may stand
        stream.reset()
        found = list[OnlineSample]()
        for i, (t, row) in enumerate(stamped):
            hangs = {key: stamped[100][1][key] for key in row if part in key.split("_")} if 100 < i < 450 else {}
            assert hangs or not 100 < i < 450
            found += stream.push(t, row | hangs)
            assert stream.health.stuck == (keys if 350 < i < 450 else ())
            assert stream.health.settled == (found[-1].settled if found else False)
        assert not keys or not any(one.settled for one in found if 0.704 < one.end < 0.9)
        assert found[340].settled
        assert len(found) == len(usual)
        assert stream.health.stalled == ()


def test_a_wrong_belief_is_said_while_the_stream_runs(clean: tuple[OnlineEstimator, Stamped, np.ndarray]) -> None:
    """All efforts reversed: k of the last seconds is large, with every estimate."""
    stream, stamped, _ = clean
    stream.reset()
    assert max(one.k for one in streamed(stream, stamped)[100:]) < DOUBTFUL
    assert stream.health.doubts == ()
    stream.reset()
    found = streamed(stream, [(t, {key: -x if "_tau" in key else x for key, x in row.items()}) for t, row in stamped])
    assert found[-1].k == stream.health.k > 3.0 * DOUBTFUL
    assert "times as large as stated: forces elsewhere, a moment, or a wrong model" in str(stream.health)


def test_what_keeps_a_stream_from_estimates_is_said(folder: Path) -> None:
    """Joints of two publishers, also after a good start, stamps of zero, more samples than a ring keeps in the wait."""
    stamped = messages(walk(0.3))
    stream = OnlineEstimator(mapped(folder, None), folder)
    streamed(stream, stamped[:50])
    for t, row in stamped[50:]:
        stream.push(t, {key: value for key, value in row.items() if key != "FL_HAA_tau"})
    assert "FL_HAA_tau missing where others are" in str(stream.health)
    streamed(stream, stamped[-1:])
    assert stream.health.obstacles == ()
    stream = OnlineEstimator(mapped(folder, None), folder)
    for t, row in stamped:
        for leg in ("FL", "RR"):
            stream.push(t, {key: value for key, value in row.items() if key.startswith(leg) or "_tau" not in key})
    assert stream.health.estimates == 0
    [obstacle] = stream.health.obstacles
    assert obstacle.startswith("no message of late has all of joints.effort: FL_HAA_tau missing where others are")
    assert obstacle in str(stream.health)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    state = SimpleNamespace(header=header, name=["a"], position=[0.0], velocity=[0.0], effort=[0.0])
    assert stream.message("/joint_states", state) == []
    assert "/joint_states: its messages have no stamp" in stream.health.obstacles
    stream, header.stamp.sec = OnlineEstimator(mapped(folder, joints={"topic": "/js"}), folder), 1
    zeros = [0.0] * len(stream.joints)
    for header.stamp.nanosec in range(10):
        state = SimpleNamespace(header=header, name=stream.joints, position=zeros, velocity=zeros)
        state.effort = [*zeros[1:], np.nan]  # as ROS 2's broadcaster writes that a joint has none
        stream.message("/js", state)
    assert f"all of joints.effort: /js.effort.{stream.joints[-1]} missing" in str(stream.health)
    waiting = OnlineEstimator(mapped(folder, None), folder, wait=0.5)
    for k in range(LENGTH + 1):
        waiting.push(1e-4 * k, stamped[0][1])
    assert waiting.health.estimates == 0
    assert any("2048 samples are kept, 0.2 s, less than" in one for one in waiting.health.obstacles)


def test_thousands_of_random_faults_neither_raise_nor_fill_memory(folder: Path) -> None:
    """Every kind at random, at one place in ten; afterwards the stream gives the forces of the clean samples."""
    stream = OnlineEstimator(mapped(folder, None, observer={"names": ["force_level", "kalman"]}), folder)
    stamped = messages(walk(1.2))
    rng, faults = np.random.default_rng(1), 0
    tracemalloc.start()
    sizes = []
    for turn in range(5):
        shifted = [(t + 1.2 * turn, row) for t, row in stamped[:-1]]
        for time, row, kind in faulty(shifted, rng, share=0.1):
            faults += kind is not Fault.NONE
            for one in stream.push(time, row):
                assert all(map(np.isfinite, one.components.values()))
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert faults > 200
    assert sizes[-1] - sizes[2] < 50_000
    stream.reset()
    rest = values_of(streamed(stream, stamped))
    assert np.abs(rest).max() < 500.0
    assert all(len(ring) == LENGTH for ring in stream._rings.time)


def test_what_a_stream_cannot_do_is_refused_with_its_reason(folder: Path) -> None:
    with pytest.raises(MapError, match="smoother corrects every estimate by what comes later"):
        OnlineEstimator(mapped(folder, observer={"names": ["smoother"]}), folder)
    with pytest.raises(MapError, match=r"wait = 2\.0: at least 0 s and less than 1 s"):
        OnlineEstimator(mapped(folder), folder, wait=2.0)
    with pytest.raises(MapError, match=r"robot\.points = \[\]: a point at which a force is sought was expected"):
        OnlineEstimator(mapped(folder, **{"robot.points": []}), folder)
    stream = OnlineEstimator(mapped(folder), folder)
    with pytest.raises(MapError, match="smoother"):
        stream.tune("smoother", 1.0)
    assert {one.settled for one in streamed(stream, messages(walk(0.3)))} == {False, True}  # by the gain that it has
