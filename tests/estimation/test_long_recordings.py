"""Long recordings: read, estimated and written piece by piece, in memory that does not grow with their length."""

import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from support import six_joints
from support.recorded import edited, recorded
from support.six_joints import six_map, swing

from aerobat_pin.estimation import Result, estimate
from aerobat_pin.experiments import write
from aerobat_pin.forces.stored_estimate import StoredEstimate, some_intervals
from aerobat_pin.records.spool import Series, Spool, series_of, typical_spacing

MASS = 1.5
AXES = {"position": "pxyz", "velocity": "vxyz", "rate": "wxyz"}
BODY = {"mass": MASS, "inertia": [0.01, 0.01, 0.02]}
MAP = {
    "robot": {"body": BODY, "points": ["body"], "rows": {"ignore": ["base.Mx", "base.My", "base.Mz"]}},
    "base": {key: {"columns": [f"{name[0]}{axis}" for axis in name[1:]]} for key, name in AXES.items()}
    | {"quaternion": {"columns": ["qx", "qy", "qz", "qw"]}},
    "check": {"wrench": {"columns": ["fx", "fy", "fz"], "filter": 20.0}},
}
SHORT, LONG = 2_000, 5_000  # rows


@pytest.fixture
def in_small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make all pieces small, so that short recordings count as long ones."""
    come_in, place = "aerobat_pin.records.", "aerobat_pin.estimation."
    for module in ("spool", "columns", "channels", "file_source"):
        monkeypatch.setattr(f"{come_in}{module}.EXTENT", 200)
    monkeypatch.setattr(f"{place}checks.samples.EXTENT", 200)
    monkeypatch.setattr(f"{come_in}spool.IN_MEMORY", 1)
    monkeypatch.setattr(f"{come_in}csv_columns.ROWS_AT_ONCE", 200)
    monkeypatch.setattr(f"{come_in}table_cells.BYTES_AT_ONCE", 20_000)
    monkeypatch.setattr(f"{place}checks.motion.MOST_SAMPLES", 500)
    for name in ("MANY", "MOST_SAMPLES"):
        monkeypatch.setattr(f"{place}checks.result.{name}", 500)
    observed, stored, beside = (
        import_module(f"aerobat_pin.forces.{name}")
        for name in ("run_observers", "stored_estimate", "against_reference")
    )
    monkeypatch.setattr(observed, "BLOCK", 500)
    monkeypatch.setattr(observed, "REMEMBERED", 0.0)  # a block is far longer than its beginning, not a tenth of it
    for module in (stored, observed):
        monkeypatch.setattr(module, "ROWS_READ", 500)
    monkeypatch.setattr(beside, "MOST_LAGGED", 500)
    monkeypatch.setattr(beside, "EXTENT", 200)


def swinging(rows: int, folder: Path) -> Path:
    """Write a body that swings about a point and is held by a force, at 1 kHz, and return the file."""
    t = 1e-3 * np.arange(rows)
    half, zero = 0.1 * np.sin(2.0 * t), np.zeros(rows)
    columns = {
        "t": t,
        **dict(zip(("px", "py", "pz"), (np.sin(t), np.cos(0.7 * t), 1.0 + 0.2 * np.sin(0.3 * t)), strict=True)),
        **dict(zip(("qx", "qy", "qz", "qw"), (np.sin(half), zero, zero, np.cos(half)), strict=True)),
        **dict(zip(("vx", "vy", "vz"), (np.cos(t), -0.7 * np.sin(0.7 * t), 0.06 * np.cos(0.3 * t)), strict=True)),
        **dict(zip(("wx", "wy", "wz"), (0.4 * np.cos(2.0 * t), zero, zero), strict=True)),
        "fx": -MASS * np.sin(t),
        "fy": -MASS * 0.49 * np.cos(0.7 * t),
        "fz": MASS * (9.81 - 0.018 * np.sin(0.3 * t)),
    }
    file = folder / f"swing_{rows}.csv"
    pd.DataFrame(columns).to_csv(file, index=False, float_format="%.9g")
    return file


def estimated(log: Path) -> Result:
    return estimate(recorded(log, MAP))


def peak(log: Path) -> int:
    """Return the largest memory [bytes] that Python and numpy hold while a log is estimated."""
    tracemalloc.start()
    try:
        estimated(log)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.usefixtures("in_small_pieces")
def test_memory_does_not_grow_with_the_record(tmp_path: Path) -> None:
    """A row and its estimate take 340 bytes, of which hardly any stay: tiny pieces, and stamps with their median."""
    short, long = swinging(SHORT, tmp_path), swinging(LONG, tmp_path)
    estimated(short)  # what is made once
    assert (peak(long) - peak(short)) / (LONG - SHORT) < 75.0


def test_pieces_give_what_the_whole_gives(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    """Forces, scores behind the sensor's filter, findings, and every file."""
    log = swinging(SHORT, tmp_path)
    whole = estimated(log)
    request.getfixturevalue("in_small_pieces")
    pieces = estimated(log)
    one, other = (found.estimates["force_level"] for found in (whole, pieces))
    np.testing.assert_array_equal(one.time, other.time)
    np.testing.assert_allclose(one.components, other.components, atol=1e-5)
    scores, others = (found.observers["force_level"].points["body"] for found in (whole, pieces))
    for label, score in scores.items():
        assert score.rmse < 0.05
        assert others[label].rmse == pytest.approx(score.rmse, rel=1e-3)
        assert others[label].offset == pytest.approx(score.offset, abs=1e-5)
    assert [str(finding) for finding in whole.findings][:6] == [str(finding) for finding in pieces.findings][:6]
    for name, found in (("whole", whole), ("pieces", pieces)):
        (tmp_path / name).mkdir()
        write(found, tmp_path / name)
    with (
        xr.open_dataset(tmp_path / "whole" / "estimate.nc") as first,
        xr.open_dataset(tmp_path / "pieces" / "estimate.nc") as second,
    ):
        xr.testing.assert_allclose(first.drop_vars("redundancy"), second.drop_vars("redundancy"), atol=1e-5)
    tables = [pd.read_csv(tmp_path / name / "estimate.csv") for name in ("whole", "pieces")]
    pd.testing.assert_frame_equal(*tables, atol=1e-5)


def test_errors_that_last_are_remembered_over_a_border(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A push on a link of which nobody asks ends just before it: what is believed afterwards is as in one block."""
    monkeypatch.setattr(six_joints, "RATE", 500.0)
    monkeypatch.setattr(six_joints, "SECONDS", 36.0)
    swing(tmp_path / "six.csv", 3)
    log = pd.read_csv(tmp_path / "six.csv")
    log.loc[(log.t > 28.0) & (log.t < 29.9), ["pan_i", "elbow_i", "wrist_2_i"]] += [30.0, -40.0, 20.0]
    record = recorded(tmp_path / "six.csv", edited(six_map(), {"joints.friction": None}), table=log)
    found = []
    for block in (15_000, 18_000):
        monkeypatch.setattr(import_module("aerobat_pin.forces.run_observers"), "BLOCK", block)
        found.append(estimate(record, ["force_level", "kalman"], trust=True).estimates)
    for name, whole in found[1].items():
        off = np.abs(found[0][name].components - whole.components) / whole.standard_deviation
        assert off.max() < 0.1
        assert (found[0][name].standard_deviation / whole.standard_deviation).min() > 0.9
    whole, pieces = found[1]["force_level"], StoredEstimate(Spool())
    for piece in (slice(0, 14_600), slice(14_600, len(whole.components))):
        pieces.append(some_intervals(whole, piece))
    assert pieces.worst_doubt == pytest.approx(StoredEstimate.of(whole).worst_doubt)  # its border is in the push


@pytest.mark.usefixtures("in_small_pieces")
def test_a_series_on_disk_is_read_like_an_array() -> None:
    """Slices over extents, single rows, and places in increasing numbers."""
    rng = np.random.default_rng(0)
    spool = Spool()
    time, table = np.sort(rng.uniform(0.0, 1.0, 2300)), rng.standard_normal((2300, 3))
    stamps, rows = series_of(spool, time), Series(spool, 3)
    for first in range(0, 2300, 700):
        rows.append(table[first : first + 700])
    for part in (slice(490, 1710), slice(0, 1), slice(2299, None), slice(5, 5), slice(-4, 9000)):
        np.testing.assert_array_equal(rows[part], table[part])
    np.testing.assert_array_equal(rows[-1], table[-1])
    for side in ("left", "right"):
        for value in (-1.0, 2.0, time[0], time[500], time[1499], time[-1], 0.37):
            assert stamps.index(value, side) == np.searchsorted(time, value, side=side)
    np.testing.assert_array_equal(np.concatenate(stamps.spread(2300)), time)
    assert sum(map(len, stamps.spread(1600))) == 1600


def test_a_series_on_disk_is_read_by_several_threads_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """One moved the file's place before another had read: of an estimate in threads or a pool forces were 185 N off."""
    monkeypatch.setattr("aerobat_pin.records.spool.IN_MEMORY", 1)
    numbers = np.arange(1_000_000.0)
    series = series_of(Spool(), numbers)

    def wrong(seed: int) -> int:
        begins = np.random.default_rng(seed).integers(0, len(numbers), 2000).tolist()
        return sum(not np.array_equal(series[k : k + 2000], numbers[k : k + 2000]) for k in begins)

    with ThreadPoolExecutor(4) as pool:
        assert [*pool.map(wrong, range(4))] == [0, 0, 0, 0]


def test_unix_stamps_have_the_step_of_their_samples() -> None:
    """They are rounded to 2.4e-7 s: by the median at 1 kHz, common times drifted by a sample in 8 s."""
    step = typical_spacing(series_of(Spool(), 1.7e9 + 1e-3 * np.arange(5000)))
    assert step == pytest.approx(1e-3, rel=1e-6)
