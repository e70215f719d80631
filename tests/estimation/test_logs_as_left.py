"""Records as loggers leave them: holes, cut rows, clocks that jump, equal stamps, times of their own, great length."""

import re
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import tomli_w
import xarray as xr
from matplotlib.transforms import Bbox
from support import six_joints
from support.foreign_channels import with_foreign_channels
from support.recorded import edited, recorded
from support.robot_parts import by_axis
from support.six_joints import six_map
from support.swinging_arm import HEAVIER, JOINTS, ROTOR, arm, arm_map, recording
from support.walking_log import bag, bag_map, urdf, walk

from aerobat_pin import open_record
from aerobat_pin.errors import LogError, MapError
from aerobat_pin.estimation import OnlineEstimator, Result, estimate, record_findings
from aerobat_pin.estimation.checks.samples import sample_findings
from aerobat_pin.experiments import write
from aerobat_pin.forces import FittedValues, StoredEstimate, accelerations, fitted_by_map, settled, taken_as_free
from aerobat_pin.forces.stored_estimate import some_intervals
from aerobat_pin.observers import JointFriction
from aerobat_pin.records import Record, Spool, parse_map, series_of, suggested_map
from aerobat_pin.records.columns import GrowingTable, in_order
from aerobat_pin.records.joint_names import nearest_joints
from aerobat_pin.records.resample import failed_readings, neighbour_rates, without_turns
from aerobat_pin.records.spool import Series, typical_spacing
from aerobat_pin.visualization import draw_estimation, draw_unexplained
from aerobat_pin.visualization.figures.record import draw_motion
from aerobat_pin.visualization.replay.flight_replay import replay_result

ROBOT = {"urdf": "arm.urdf", "root": "fixed", "points": ["tool"]}
WITHOUT_FRICTION = edited(arm_map(), {"joints.friction": None})


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Return two seconds of the arm: 1000 rows."""
    folder = tmp_path_factory.mktemp("swing")
    recording(folder, "swing", pushed=True, seed=3, seconds=2.0)
    return pd.read_csv(folder / "swing.csv")


@pytest.fixture(autouse=True)
def arms_file(tmp_path: Path) -> None:
    """Write the arm's file into the folder of each test."""
    (tmp_path / "arm.urdf").write_text(arm())


def opened(table: pd.DataFrame | str, folder: Path, **joints: Any) -> Record:
    """Return the record of a table of the arm, whose file lies there, or of its text."""
    text = table if isinstance(table, str) else table.to_csv(index=False)
    (folder / "log.csv").write_text(text)
    changes = {f"joints.{key}": value for key, value in joints.items()}
    return recorded(folder / "log.csv", edited(WITHOUT_FRICTION, changes))


def said(record: Record) -> list[str]:
    """Return the notes of a record, and what its samples show."""
    return [*record.notes, *map(str, sample_findings(record))]


def counts(record: Record) -> list[int]:
    """Return the number of samples of each part."""
    return [last - first + 1 for first, last in record.parts]


@pytest.mark.parametrize(("column", "empty"), [("bend_i", ""), ("lift_q", "nan"), ("turn_v", "")])
def test_a_hole_in_a_joints_column_splits_there(column: str, empty: str, swing: pd.DataFrame, tmp_path: Path) -> None:
    """From its last sample to the next one, by joint, channel and time; the stretches outside are as they were."""
    whole = opened(swing, tmp_path)
    table = swing.astype({column: object})
    table.loc[400:599, column] = empty
    record = opened(table, tmp_path)
    assert record.parts in (((0, 399), (600, 999)), ((0, 398), (600, 999)))  # by rounding
    part = {"q": "position", "v": "velocity", "i": "effort"}[column[-1]]
    where = f"joints.{part} of {column[:-2]}"
    assert f"{where}: no sample from 0.798 to 1.200 s (0.40 s)" in record.notes
    assert f"gap: no sample of {where} for 0.40 s, from 0.80 s on: left out" in said(record)
    for first, last in record.parts:
        for name in ("q", "v", "tau"):
            one, other = (getattr(each.block(first, last), name) for each in (record, whole))
            np.testing.assert_allclose(one, other)


def test_of_many_holes_the_longest_are_told(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Each had a note for each channel and a warning, which buried what the checks found."""
    kept = np.ones(len(swing), bool)
    for k in range(9):
        kept[100 * k + 50 : 100 * k + 114 + 4 * k] = False
    record = opened(swing[kept], tmp_path)
    notes, gaps = record.notes, [text for text in said(record) if text.startswith("gap: ")]
    assert (len(record.parts), notes[-1]) == (9, "parts of 7 samples are left out")
    assert [text.partition(",")[0][-6:] for text in gaps[:-1]] == ["0.18 s", "0.19 s", "0.19 s"]
    assert gaps[-1] == "gap: 6 shorter holes are left out, too"
    assert [note for note in notes if note.startswith("joints.effort")][-1] == (
        "joints.effort: no sample in 6 shorter holes"
    )


def test_a_hole_at_an_end_of_a_column_shortens_the_record(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Before its first sample and after its last one nothing is known."""
    table = swing.copy()
    table.loc[:99, "bend_i"] = np.nan
    table.loc[900:, "turn_v"] = np.nan
    record = opened(table, tmp_path)
    assert (record.start, counts(record)) == (pytest.approx(0.2), [800])


def test_a_hole_that_is_interpolated_would_cost_a_force(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Outside of the hole the forces are those without it, to 3 %, as what is expected depends on all; in it none."""
    whole = estimate(opened(swing, tmp_path), trust=True).estimates["force_level"]
    table = swing.copy()
    table.loc[400:599, "lift_i"] = np.nan
    found = estimate(opened(table, tmp_path), trust=True).estimates["force_level"]
    at = np.searchsorted(whole.time[:-1], found.time[:-1] - 1e-9)
    settled = np.abs(found.time[:-1] - 1.0) > 0.3
    np.testing.assert_allclose(found.components[settled], whole.components[at][settled], atol=0.9)  # of 29 N
    assert not np.any((found.time > 0.81) & (found.time < 1.19))


def test_a_force_on_a_robot_that_hangs_is_not_said_to_be_upward(swing: pd.DataFrame, tmp_path: Path) -> None:
    """It is told in its root's axes, of which z points down."""
    standing = estimate(opened(swing, tmp_path))
    record = standing.record
    assert record is not None
    model = record.robot.model.copy()
    model.gravity.linear = -model.gravity.linear
    hanging = replace(standing, record=replace(record, robot=replace(record.robot, model=model)))
    assert re.search(r" N upward, at ", standing.verdict)
    assert re.search(r" N along z, at ", hanging.verdict)


@pytest.fixture
def holed(swing: pd.DataFrame, tmp_path: Path) -> Result:
    """Return the estimate of the arm that was not recorded from 0.8 to 1.2 s."""
    return estimate(opened(swing.drop(index=range(400, 600)), tmp_path))


def test_no_interval_of_an_estimates_files_goes_over_a_hole(holed: Result, tmp_path: Path) -> None:
    """Force times time is an impulse: the last interval before the hole has the length of the others."""
    (tmp_path / "found").mkdir()
    write(holed, tmp_path / "found")
    table = pd.read_csv(tmp_path / "found" / "estimate.csv")
    with xr.open_dataset(tmp_path / "found" / "estimate.nc") as data:
        for lasts in (table["end [s]"] - table["start [s]"], data["interval_end"] - data["interval"]):
            assert float(lasts.max()) == pytest.approx(2e-3)


def test_no_line_of_a_figure_goes_over_a_hole(holed: Result) -> None:
    """Nor an area: what is not known there is not called unseen, either."""
    assert holed.record is not None
    for figure in (draw_estimation(holed), draw_unexplained(holed), draw_motion(holed.record)):
        axis = figure.axes[0]
        time = axis.lines[0].get_xdata()
        assert np.nanmax(np.diff(time)) < 3e-3
        assert np.isnan(time[np.nanargmin(np.abs(time - 0.8)) :][:2]).any()
        areas = [path for part in axis.collections for path in part.get_paths()]
        assert not [area for area in areas if area.intersects_bbox(Bbox([[0.9, -1e6], [1.1, 1e6]]))]


def test_a_figure_enlarges_what_changes_in_short_parts(holed: Result) -> None:
    """Though no stretch without a hole is as long as what is enlarged."""
    whole, parts = holed.stored["force_level"], StoredEstimate(Spool())
    for first in range(0, 380, 12):
        part = whole.between(first, first + 10)
        parts.append(replace(part, components=np.where(part.time[:-1, None] > 0.5, 9.0, 0.0) + 0.0 * part.components))
    low, high = draw_estimation(replace(holed, stored={"force_level": parts})).axes[-1].get_xlim()
    assert low < 0.5 < high < 0.6


@pytest.mark.parametrize("seconds", [-1e7, 0.5])
def test_velocities_are_not_differentiated_across_a_hole(seconds: float, swing: pd.DataFrame, tmp_path: Path) -> None:
    """At its edges they are those of the motion beside it; before, they were wrong by a third."""
    velocity, table = {"from": "position", "window": 0.04}, swing.copy()
    table.loc[500:, "t"] += seconds
    whole, record = (opened(one, tmp_path, velocity=velocity) for one in (swing, table))
    expected = whole.block(0, 999).v
    for first, last in record.parts:
        v = record.block(first, last).v
        begin = 500 * int(np.argmin(np.abs(table.t.to_numpy()[[0, 500]] - record.times(first, last)[0])))
        np.testing.assert_allclose(v, expected[begin : begin + len(v)], atol=0.02)


def test_stamps_of_arrival_in_bursts_are_named_with_the_rate(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Ten rows come at once, every 20 ms: the unit of the stamps was doubted; with the rate it is read."""
    table = swing.assign(t=0.02 * (np.arange(len(swing)) // 10) + 1e-5 * (np.arange(len(swing)) % 10))
    with pytest.raises(LogError, match=r"stamped in bursts\? log\.rate = 504\.5"):
        opened(table, tmp_path)
    record = recorded(tmp_path / "log.csv", edited(WITHOUT_FRICTION, {"log.rate": 500.0}))
    assert counts(record) == [pytest.approx(990, abs=2)]


def test_a_slow_channel_is_not_split(swing: pd.DataFrame, tmp_path: Path) -> None:
    """One sample in 0.2 s is its usual step, which a note states; a hole is longer than two and a half of them."""
    rows = np.arange(len(swing))
    force = swing[["fx", "fy", "fz"]].copy()
    force[rows % 100 != 0] = np.nan
    check = {"wrench": {"columns": ["fx", "fy", "fz"], "point": "tool"}}

    def read(name: str, table: pd.DataFrame) -> Record:
        return recorded(tmp_path / name, WITHOUT_FRICTION | {"check": check}, table=table)

    slow = read("slow.csv", swing.assign(**force))
    assert counts(slow) == [901]
    assert any("check.wrench: a sample every 0.2 s" in note for note in slow.notes)
    force[(rows > 350) & (rows < 650)] = np.nan
    assert len(read("lost.csv", swing.assign(**force)).parts) == 2


@pytest.mark.parametrize("cut", [1, 3, 30])
def test_a_last_row_cut_by_a_killed_logger_is_left_out(cut: int, swing: pd.DataFrame, tmp_path: Path) -> None:
    """Whether it lacks its end, digits or cells; the other rows are all there."""
    text = swing.to_csv(index=False)
    record = opened(text[:-cut], tmp_path)
    assert counts(record) == [999]
    assert any("the last row is cut short" in note for note in record.notes)
    assert counts(opened(text, tmp_path)) == [1000]


def test_a_short_row_is_cut_only_if_it_is_the_last(swing: pd.DataFrame, tmp_path: Path) -> None:
    """A last one with too few cells is left out though its line ends; in the middle it is an error; empty lines no."""
    lines = swing.to_csv(index=False).splitlines()
    for short, cells in ((lines[7].rpartition(",")[0], 12), ("5", 1)):
        assert counts(opened("\n".join([*lines[:500], short, ""]), tmp_path)) == [499]
        with pytest.raises(LogError, match=rf"line 501: {cells} cells: 13, as in the header, were expected"):
            opened("\n".join([*lines[:500], short, *lines[500:], ""]), tmp_path)
    assert counts(opened("\n".join([*lines[:50], "", "\r", *lines[50:], ""]), tmp_path)) == [1000]


def test_lists_in_quotes_can_be_cut_too(tmp_path: Path) -> None:
    """Within the quotes, where the rest of the file would be one cell."""
    rows = [f'{k / 100},"[{k}, 1, 2]","[0, 1, {k}]","[3, {k}, 1]"\n' for k in range(50)]
    parts = (("position", "q"), ("velocity", "v"), ("effort", "i"))
    joints = {part: {"columns": [f"{name}.{k}" for k in range(3)]} for part, name in parts}
    (tmp_path / "log.csv").write_text("t,q,v,i\n" + "".join(rows)[:-5])
    assert counts(recorded(tmp_path / "log.csv", {"robot": ROBOT, "joints": {"names": JOINTS, **joints}})) == [49]


def test_a_table_without_a_header_is_asked_about(swing: pd.DataFrame, tmp_path: Path) -> None:
    """It is never read one row short; names that are numbers, as pandas writes them, are names."""
    for text in (
        swing.to_csv(index=False, header=False),
        swing.to_csv(index=False, header=False, sep=";", decimal=","),
    ):
        with pytest.raises(LogError, match=r"numbers alone .* so the table has no header: write a line") as told:
            opened(text, tmp_path)
        with pytest.raises(LogError, match="the table has no header") as asked:
            suggested_map(tmp_path / "log.csv", tmp_path / "arm.urdf")
        assert str(asked.value) == str(told.value)
    (tmp_path / "log.csv").write_text(swing.set_axis(range(13), axis=1).to_csv(index=False))
    parts = (("position", 1), ("velocity", 2), ("effort", 3))
    joints = {part: {"columns": [str(first + 3 * k) for k in range(3)]} for part, first in parts}
    values = {"robot": ROBOT, "log": {"time": {"column": "0"}}, "joints": {"names": JOINTS, **joints}}
    assert counts(recorded(tmp_path / "log.csv", values)) == [1000]


@pytest.mark.parametrize(
    ("rows", "seconds", "expected", "finding"),
    [
        ([400], 1e7, [1000], "1 of 1000 samples have no stamp, or one that does not fit"),
        ([400], -1e7, [1000], "1 of 1000 samples have no stamp, or one that does not fit"),
        ([400, 401, 402], 0.5, [1000], "3 of 1000 samples have no stamp, or one that does not fit"),
        ([0], -1e7, [999], "1 of 1000 samples have no stamp, or one that does not fit"),
        ([999], 1e7, [999], "1 of 1000 samples have no stamp, or one that does not fit"),
        (range(100), -1e7, [99, 900], "gap: no sample of joints.position (and 2 more) for 10000000"),
        (range(500, 1000), 1e7, [500, 499], "gap: no sample of joints.position (and 2 more) for 10000000"),
        (range(500, 1000), -1e7, [500, 499], "the clock was set back 1 x"),
        (range(400, 600), 1e7, [400, 400, 199], "the clock was set back 1 x"),
        (range(500, 1000), -0.3, [], "150 of 1000 samples go back in time"),
    ],
)
def test_a_clock_that_jumps_costs_no_sample_but_those_whose_time_is_lost(
    rows: Any, seconds: float, expected: list[int], finding: str, swing: pd.DataFrame, tmp_path: Path
) -> None:
    """Parts in the order of their stamps; common times need not meet those beyond a jump: one less; q is in time."""
    table = swing.copy()
    table.loc[list(rows), "t"] += seconds
    record = opened(table, tmp_path)
    assert any(finding in text for text in said(record)), said(record)
    if expected:
        assert all(abs(one - count) <= 1 for one, count in zip(sorted(counts(record)), sorted(expected), strict=True))
        for ends in record.parts:
            time = record.times(*ends)
            true = time - (0.0 if -0.01 < time[0] < 2.0 else seconds)
            q = [np.interp(true, swing["t"], swing[column]) for column in COLUMNS]
            np.testing.assert_allclose(record.block(*ends).q, np.stack(q, axis=1), atol=1e-3)


def test_stamps_that_no_clock_can_show_are_refused(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Between them the common times would not be evenly spaced any more."""
    table = swing.copy()
    table.loc[:1, "t"] -= 1e300
    with pytest.raises(LogError, match=r"its stamps go from -1e\+300 to 1\.998 s .* is one of them wrong\?"):
        opened(table, tmp_path)


def test_stamps_in_any_order_are_used_once() -> None:
    """Against plain rules: sorted, finite, no time twice from two stretches; nothing is lost that only jumps."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        time = np.arange(200) * 0.01
        for _ in range(rng.integers(1, 4)):
            first, last = np.sort(rng.integers(0, 201, 2))
            time[first:last] += rng.choice([-1e7, -300.0, 300.0, 1e7]) + rng.choice([0.0, 0.004])
        rows, counts = in_order(time)
        assert np.all(np.diff(time[rows]) >= 0.0)
        assert len(np.unique(rows)) == len(rows)
        assert len(rows) + counts["off"] + counts["backward"] == 200
        assert counts["off"] <= 9 * 6


def test_rows_in_the_order_of_arrival_are_sorted(swing: pd.DataFrame, tmp_path: Path) -> None:
    """A slow sensor's rows come behind later ones of a fast one, and each one's stamps rise: nothing is left out."""
    fast, slow = swing.drop(columns=f"{JOINTS[0]}_q"), swing.iloc[::5][["t", f"{JOINTS[0]}_q"]]
    arrival = pd.concat([fast.assign(arrives=fast["t"]), slow.assign(arrives=slow["t"] + 0.05)])
    table = arrival.sort_values("arrives", kind="stable").drop(columns="arrives").reset_index(drop=True)
    record = opened(table, tmp_path)
    assert sum(counts(record)) >= 990
    assert any(f"{len(slow)} of" in text and "stood behind later ones" in text for text in said(record))


def test_a_stamp_that_is_no_number_is_left_out() -> None:
    """As NetCDF files can hold them."""
    table = GrowingTable(Spool())
    table.add(np.array([0.0, np.nan, 1.0, 2.0]), {"x": np.arange(4.0)})
    clock, columns = table.finished()
    np.testing.assert_array_equal(columns["x"][:], [0.0, 2.0, 3.0])
    assert clock.off == 1
    table = GrowingTable(Spool())
    table.add(np.full(3, np.nan), {"x": np.arange(3.0)})
    assert len(table.finished()[0].time) == 0


def test_rows_with_one_stamp_are_merged(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Sensors that write rows of their own at one time: nothing is lost, which a note says; conflicts are a warning."""
    turn = [name for name in swing if name.startswith("turn")]
    rest = [name for name in swing if name != "t" and name not in turn]
    split = pd.concat([swing.assign(**dict.fromkeys(rest)), swing.assign(**dict.fromkeys(turn))])
    split = split.sort_values("t", kind="stable")
    whole, merged = opened(swing, tmp_path), opened(split, tmp_path)
    assert merged.parts == whole.parts
    for key, channel in whole.channels.items():
        np.testing.assert_array_equal(merged.channels[key].values[:], channel.values[:])
    found = [one for one in sample_findings(merged) if one.check == "repeated stamps"]
    told = "table: 1000 of 2000 samples have the stamp of the one before, and are merged with it"
    assert [(one.verdict, one.text) for one in found] == [("note", told)]
    twice = pd.concat([swing.iloc[:500], swing.iloc[499:].assign(turn_q=swing.turn_q + 1e-3)])
    found = [one for one in sample_findings(opened(twice, tmp_path)) if one.check == "repeated stamps"]
    assert [one.verdict for one in found] == ["warning"]
    assert "1 of them differ: the first value stays" in found[0].text


@pytest.mark.parametrize(("digits", "rounded", "most"), [(2, "0.01 s", True), (3, "", False)], ids="{}".format)
def test_stamps_with_too_few_digits(digits: int, rounded: str, most: bool, swing: pd.DataFrame, tmp_path: Path) -> None:
    """By name if most samples are lost: the verdict doubted nothing, and efforts were judged by what was left."""
    result = estimate(opened(swing.assign(t=swing.t.round(digits)), tmp_path), trust=True)
    checks = {finding.check for finding in result.findings}
    assert ("lost samples" in checks, "effort against motion" in checks) == (most, not most)
    assert (f"seem to be rounded to {rounded}: write them with more digits" in result.verdict) == most


def test_samples_that_share_stamps_are_rounded_or_lost(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Half the rate loses nothing that a verdict doubts; to repeat rows, a few at a time, is no rounding."""
    half = swing.assign(t=np.floor(np.arange(len(swing)) / 2) / 100.0)
    [found] = [one for one in sample_findings(opened(half, tmp_path)) if one.warns]
    assert (found.check, "rounded to 0.01 s" in found.text) == ("repeated stamps", True)
    rng = np.random.default_rng(0)
    stamps = np.sort(rng.uniform(0.0, 2.0, 150))[np.sort(rng.integers(0, 150, len(swing)))]
    [found] = [one for one in sample_findings(opened(swing.assign(t=stamps), tmp_path)) if one.check == "lost samples"]
    assert "rounded" not in found.text
    assert "which should tell samples apart" in found.text


@pytest.mark.parametrize("share", [0.02, 0.4])
def test_rows_that_are_lost_under_even_stamps_are_said_to_be(share: float, swing: pd.DataFrame, tmp_path: Path) -> None:
    """A unit of the velocities was named, or nothing; where these count by half, nothing is lost."""
    kept = swing[np.random.default_rng(0).random(len(swing)) > share]
    even = kept.assign(t=swing.t[: len(kept)].to_numpy())
    found = [one for one in record_findings(opened(even, tmp_path)) if one.warns]
    assert [one.check for one in found] == ["lost samples"]
    assert found[0].value == pytest.approx(1.0 - len(kept) / len(swing), abs=0.01)
    slow = swing.assign(**{f"{joint}_v": 0.5 * swing[f"{joint}_v"] for joint in ("turn", "lift", "bend")})
    assert "lost samples" not in [one.check for one in record_findings(opened(slow, tmp_path))]


@pytest.mark.parametrize(
    "more",
    [
        {"turn_q": np.nan, "lift_q": np.nan, "bend_q": np.nan},
        {"acc_x": np.nan, "acc_y": np.nan, "acc_z": np.nan},
        {"note": ["1,5", "1.5"] * 500},
        {"v": [["[1, 2]", "[1]"][k % 2] for k in range(1000)]},
        {"range": np.inf},
        {"t": pd.date_range("2026-01-01", periods=1000, freq="2ms")},
        {"t": 0.0},
    ],
    ids=["empty joints", "empty group", "both decimals", "ragged lists", "infinite", "dates", "one time"],
)
def test_a_map_is_suggested_whatever_other_columns_hold(more: Any, swing: pd.DataFrame, tmp_path: Path) -> None:
    """Columns that a map need not read: an estimate survives them, and so does the suggestion."""
    swing.assign(**more).to_csv(tmp_path / "log.csv", index=False)
    text = suggested_map(tmp_path / "log.csv", tmp_path / "arm.urdf")
    assert ("turn_q" in text) == ("turn_q" not in more)


def test_columns_that_are_empty_or_begin_late_are_said(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Half of a log was left out without a word; empty efforts were said to have no column."""
    last = f"{JOINTS[-1]}_i"
    late = opened(swing.assign(**{last: swing[last].where(swing.t >= 0.5)}), tmp_path)
    assert "the first 0.5 s are left out: not all columns of joints.effort have samples there" in late.notes
    swing.assign(**{last: np.nan}).to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(LogError, match=rf"'{last}' \(joints.effort\) has 0 samples: .* robot.rows.ignore"):
        recorded(tmp_path / "log.csv", arm_map())
    text = suggested_map(tmp_path / "log.csv", tmp_path / "arm.urdf")
    assert f'# Or nobody measures it: robot.rows = {{ignore = ["{JOINTS[-1]}"]}}' in text


def test_a_suggestion_asks_whether_the_base_moves_with_an_imu(swing: pd.DataFrame, tmp_path: Path) -> None:
    """A walking robot without odometry was suggested to be fixed, without a question."""
    groups = {"quat": "xyzw", "gyro": "xyz", "acc": "xyz"}
    columns = {f"imu_{name}_{axis}": 0.5 for name, axes in groups.items() for axis in axes}
    swing[:50].assign(**columns).to_csv(tmp_path / "log.csv", index=False)
    text = suggested_map(tmp_path / "log.csv", tmp_path / "arm.urdf")
    assert '# from = "imu"\n# quaternion = {columns = ["imu_quat_x", ' in text


def joint_states(path: Path, swing: pd.DataFrame, names: dict[str, str], apart: bool = False) -> None:
    """Write the arm as a bag of joint states, under other names, its first joint in messages of its own if `apart`."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    make, kind = store.types, "sensor_msgs/msg/JointState"
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for _, row in swing.iterrows():
            whole = round((100.0 + row.t) * 1e9)
            stamp = make["builtin_interfaces/msg/Time"](sec=whole // 10**9, nanosec=whole % 10**9)
            header = make["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            for group in (JOINTS[:1], JOINTS[1:]) if apart else (JOINTS,):
                values = (np.array([row[f"{joint}_{part}"] for joint in group]) for part in "qvi")
                message = make[kind](header, [names.get(joint, joint) for joint in group], *values)
                writer.write(connection, whole, store.serialize_cdr(message, kind))
        writer.add_connection("/gripper", kind, typestore=store)
        broken = writer.add_connection("/broken", "sensor_msgs/msg/Imu", typestore=store)
        writer.write(broken, whole, b"\0\1\0\0")


def test_messages_with_one_stamp_are_merged(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Two publishers of joint states: arm and gripper, say."""
    joint_states(tmp_path / "apart", swing[:100], {}, apart=True)
    record = recorded(tmp_path / "apart", {"robot": ROBOT, "joints": {"topic": "/joint_states"}})
    assert counts(record) == [100]
    np.testing.assert_array_equal(record.channels["joints.effort"].values[:], swing[[f"{j}_i" for j in JOINTS]][:100])
    assert any("100 of 200 samples have the stamp of the one before, and are merged" in text for text in said(record))
    some = {"topic": "/joint_states", "names": ["turn", "lift"]}
    with pytest.raises(MapError, match=r"bend have no channel; does /gripper have them\? Columns can be of several"):
        recorded(tmp_path / "apart", {"robot": ROBOT, "joints": some})


def test_joints_of_a_topic_can_be_renamed(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Those that differ; without it the error says what was heard, and what is nearest; `--suggest` writes it."""
    joint_states(tmp_path / "bag", swing[:100], {"turn": "Turn 1", "lift": "Lift 2"})

    def read(**joints: Any) -> Record:
        chosen = parse_map({"robot": ROBOT, "joints": {"topic": "/joint_states", **joints}}, "-")
        return recorded(tmp_path / "bag", chosen)

    line = r'names = \{"Turn 1" = "turn", "Lift 2" = "lift"\}'
    with pytest.raises(MapError, match=rf"turn, lift have no channel; /joint_states has Turn 1, Lift 2: .* {line}"):
        read()
    record = read(names={"Turn 1": "turn", "Lift 2": "lift"})
    assert record.joints == ("turn", "lift", "bend")
    np.testing.assert_array_equal(record.channels["joints.position"].values[:], swing[[f"{j}_q" for j in JOINTS]][:100])
    whole = estimate(record, trust=True).estimates["force_level"]
    none = np.zeros(len(JOINTS))  # of friction, which the stream would else count among the errors of its rows
    told = FittedValues(joints=record.joints, friction=JointFriction(none, none, none, none), scale=none + 1.0)
    online, heard = OnlineEstimator(record.map, tmp_path, values=told), []
    for _, row in swing[:100].iterrows():
        parts = zip(("position", "velocity", "effort"), "qvi", strict=True)
        names = dict(zip(("Turn 1", "Lift 2", "bend"), JOINTS, strict=True))
        sample = {f"{part}.{name}": row[f"{joint}_{end}"] for part, end in parts for name, joint in names.items()}
        heard += online.push(100.0 + row.t, {f"/joint_states.{name}": value for name, value in sample.items()})
    np.testing.assert_allclose(list(heard[-1].components.values()), whole.components[-1], atol=0.1)  # of 31 N
    with pytest.raises(MapError, match=r"no joint 'trun' in the robot"):
        read(names={"Turn 1": "trun"})
    for wrong in (3, ["a", 1], {"a": 1}):
        with pytest.raises(MapError, match=r"joints\.names: a list of joints, or a table"):
            read(names=wrong)
    with pytest.raises(MapError, match=r"joints\.names: each joint once"):
        read(names={"Turn 1": "turn", "Lift 2": "turn"})
    text = suggested_map(tmp_path / "bag", tmp_path / "arm.urdf")
    assert 'names = {"Turn 1" = "turn", "Lift 2" = "lift"}' in text
    assert "# topic /broken is sensor_msgs/msg/Imu: left out" in text  # one message of it is damaged
    both = [[f"{start}_{k}_joint" for k in range(7)] for start in ("lwr_arm", "lwr")]  # what all end in does not count
    assert nearest_joints(*both) == dict(zip(*both, strict=True))
    chosen = parse_map({**arm_map(), "joints": {"names": {"Turn 1": "turn"}, "position": {"columns": ["q"]}}}, "-")
    with pytest.raises(MapError, match=r"joints\.names is a table, which renames joints of joints\.topic"):
        recorded(tmp_path / "bag", chosen)


def test_a_stream_waits_for_no_effort_that_is_not_believed(swing: pd.DataFrame, tmp_path: Path) -> None:
    """A topic has none of a joint of `robot.rows.ignore`: it was asked for all the same, and no estimate came."""
    robot = {**ROBOT, "rows": {"ignore": JOINTS[-1:]}}
    stream = OnlineEstimator(parse_map({"robot": robot, "joints": {"topic": "/arm"}}, "-"), tmp_path)
    parts, heard = {"position": "q", "velocity": "v", "effort": "i"}, 0
    for _, row in swing[:100].iterrows():
        sample = {f"/arm.{part}.{name}": row[f"{name}_{end}"] for part, end in parts.items() for name in JOINTS}
        del sample[f"/arm.effort.{JOINTS[-1]}"]
        heard += len(stream.push(row.t, sample))
    assert heard > 90


def test_channels_that_nobody_reads_are_left_out_by_name(tmp_path: Path) -> None:
    """JSON, protobuf and a channel without a schema beside ROS messages; a map that needs one of them is told."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    bag(walk(0.3, 200.0), tmp_path / "walk")
    with_foreign_channels(tmp_path / "walk" / "walk.mcap", tmp_path / "mixed.mcap")
    values: Any = bag_map(Path("quadruped.urdf"))
    record = recorded(tmp_path / "mixed.mcap", values)
    plain = recorded(tmp_path / "walk", values)
    assert record.parts == plain.parts
    notes = {f"topic {topic} is {how}: left out" for topic, how in (("/status", "json"), ("/blob", "protobuf"))}
    assert {*notes, "topic /bare is json: left out"} <= set(record.notes)
    text = suggested_map(tmp_path / "mixed.mcap", tmp_path / "quadruped.urdf")
    assert 'topic = "/joint_states"' in text
    assert "# topic /blob is protobuf: left out" in text
    values["joints"]["topic"] = "/status"
    with pytest.raises(LogError, match=r"topic /status is json: a described ROS message was expected"):
        recorded(tmp_path / "mixed.mcap", values)


@pytest.mark.parametrize("rows", [11, 27])
def test_a_record_too_short_to_settle_is_estimated(rows: int, swing: pd.DataFrame, tmp_path: Path) -> None:
    """Friction beside the forces has no instant then; 5 time constants of a gain of 100 1/s are 25 rows."""
    found = estimate(opened(swing.head(rows), tmp_path)).estimates["force_level"]
    assert found.components.shape == (rows - 1, 3)


@pytest.mark.parametrize(("begin", "jitter"), [(0.0, 0.0), (0.0, 2e-3), (1.7e9, 0.0)])
def test_ten_samples_a_second_are_whole(begin: float, jitter: float, swing: pd.DataFrame, tmp_path: Path) -> None:
    """Its steps are as long as `log.longest_gap` but for rounding: half of them were holes, or all were said to be."""
    slow = swing.iloc[::50].copy()
    slow["t"] = begin + 0.1 * np.arange(len(slow)) + jitter * np.random.default_rng(1).uniform(-1.0, 1.0, len(slow))
    record = opened(slow, tmp_path)
    assert len(record.parts) == 1
    assert not any("beyond log.longest_gap" in note for note in record.notes)


def test_efforts_that_never_change_are_said(swing: pd.DataFrame, tmp_path: Path) -> None:
    """A driver that measures none may fill in zeros; of an arm at rest they may be constant."""
    efforts = [f"{joint}_i" for joint in JOINTS]
    dead = "joint efforts never change although the joints move"
    assert any(dead in text for text in said(opened(swing.assign(**dict.fromkeys(efforts, 0.0)), tmp_path)))
    one = said(opened(swing.assign(**{efforts[-1]: 0.0}), tmp_path))
    assert any(f"efforts of {JOINTS[-1]} never change although" in text and "joints.passive" in text for text in one)
    stuck = swing[efforts[-1]].where(~swing.t.between(0.5, 1.3), 0.0)
    name = f"the effort of {JOINTS[-1]} does not change for 0.80 s, from 0.50 s on, although it moves"
    assert any(name in text for text in said(opened(swing.assign(**{efforts[-1]: stuck}), tmp_path)))
    assert not any("although it moves" in text for text in said(opened(swing.round(1), tmp_path)))  # coarse
    still = pd.concat([swing.head(1)] * 50).assign(t=np.arange(50) / 500.0)
    assert not any(dead in text for text in [*said(opened(swing, tmp_path)), *said(opened(still, tmp_path))])


def test_a_robot_without_a_mass_is_refused_by_name(swing: pd.DataFrame, tmp_path: Path) -> None:
    """A URDF for drawing alone often has no inertias."""
    opened(swing, tmp_path)
    (tmp_path / "arm.urdf").write_text(re.sub("<inertial>.*?</inertial>", "", arm()))
    with pytest.raises(LogError, match="nothing that moves has a mass"):
        recorded(tmp_path / "log.csv", arm_map())


def test_a_point_that_no_joint_moves_is_not_said_to_be_unsure(swing: pd.DataFrame, tmp_path: Path) -> None:
    """No calibration would tell the force on a link's origin that lies on the axes of all joints that move it."""
    opened(swing, tmp_path)
    values = edited(WITHOUT_FRICTION, {"robot.points": ["turn_link"]})
    words = str(estimate(recorded(tmp_path / "log.csv", values), trust=True))
    assert "it cannot see turn_link.Fx" in words
    assert "would state it" not in words


def test_forces_that_no_robot_stands_are_doubted(swing: pd.DataFrame, tmp_path: Path) -> None:
    """Degrees that are read as radians agree with one another; 52 kN at an arm of 4.5 kg were a push upward."""
    angles = [f"{joint}_{part}" for joint in JOINTS for part in "qv"]
    degrees = swing.assign(**{name: np.degrees(swing[name]) for name in angles})
    for table, doubted in ((swing, False), (degrees, True)):
        result = estimate(opened(table, tmp_path), trust=True)
        assert any(finding.check == "size of forces" for finding in result.findings) is doubted


@pytest.mark.parametrize(("column", "value"), [("bend_q", 1e300), ("lift_v", -2e9), ("turn_i", 1e300)])
def test_a_number_that_no_quantity_has_is_told(column: str, value: float, swing: pd.DataFrame, tmp_path: Path) -> None:
    """Damaged cells: squares of 1e300 overflow, and the scores were NaN."""
    damaged = swing.copy()
    damaged.loc[100, column] = value
    told = rf"{column} \(joints\..*\) = {re.escape(f'{value:g}')} at 0\.2 s: a number between"
    with pytest.raises(LogError, match=told):
        opened(damaged, tmp_path)


def test_paths_may_be_texts_and_a_fixed_base_has_no_imu(swing: pd.DataFrame, tmp_path: Path) -> None:
    """As everywhere in Python; a key that nothing reads is refused."""
    opened(swing, tmp_path)
    (tmp_path / "map.toml").write_text(tomli_w.dumps(arm_map()))
    assert open_record(str(tmp_path / "log.csv"), str(tmp_path / "map.toml")).joints == tuple(JOINTS)
    (tmp_path / "map.toml").write_text(tomli_w.dumps(arm_map() | {"base": {"from": "imu"}}))
    with pytest.raises(MapError, match="the base is fixed"):
        open_record(str(tmp_path / "log.csv"), str(tmp_path / "map.toml"))


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Return six seconds of the arm, whose first joint turns on and on."""
    folder = tmp_path_factory.mktemp("turning")
    recording(folder, "turning", pushed=True, seed=3, seconds=6.0, turning=3.0)
    return pd.read_csv(folder / "turning.csv")


FROM_POSITION = {"velocity": {"from": "position", "window": 0.04}}
COLUMNS = [f"{joint}_q" for joint in JOINTS]
WRAPPED = {  # what an angle [rad] is read as, and the map of that
    "rad": (lambda q: (q + np.pi) % (2.0 * np.pi) - np.pi, {}),
    "deg": (lambda q: np.degrees(q) % 360.0, {"position": {"columns": COLUMNS, "unit": "deg"}}),
    "counts": (lambda q: np.rint(-q * 65536 / (2.0 * np.pi)) % 65536, {"factor": {"turn": -2.0 * np.pi / 65536}}),
}


@pytest.mark.parametrize(
    ("kind", "more"), [("rad", {}), ("deg", FROM_POSITION), ("counts", {}), ("rad", FROM_POSITION)]
)
def test_an_angle_that_restarts_goes_on(kind: str, more: dict[str, Any], turning: pd.DataFrame, tmp_path: Path) -> None:
    """Forces are those of the angle that does not jump, and a note counts the jumps; it was a kilonewton."""
    read, joints = WRAPPED[kind]
    table = turning.copy()
    if "position" in joints:
        table[COLUMNS] = np.degrees(table[COLUMNS])
    table["turn_q"] = read(turning.turn_q)
    if "factor" in joints:  # which rates and torques have, too
        table["turn_v"] /= joints["factor"]["turn"]
        table["turn_i"] *= joints["factor"]["turn"]
    jumps = int(np.sum(np.abs(np.diff(table.turn_q)) > 0.5 * np.ptp(table.turn_q)))
    record = opened(table, tmp_path, **joints, **more)
    assert jumps >= 2
    assert f"turn: jumps by a full turn are taken out ({jumps})" in record.notes
    pair = record, opened(turning, tmp_path, **more)
    found, whole = (estimate(one, trust=True).estimates["force_level"] for one in pair)
    np.testing.assert_allclose(found.components, whole.components, atol=0.5 if kind == "counts" else 1e-6)


def test_a_stream_takes_full_turns_out_as_a_record_does(turning: pd.DataFrame, tmp_path: Path) -> None:
    """The efforts and rates come between the angles, so that a jump would be interpolated; the same forces."""
    angles, found = set(COLUMNS), []
    for wrapped in (False, True):
        stream, estimates = OnlineEstimator(parse_map(WITHOUT_FRICTION, "-"), tmp_path), []
        for row in turning.to_dict("records"):
            row["turn_q"] = (row["turn_q"] + np.pi) % (2.0 * np.pi) - np.pi if wrapped else row["turn_q"]
            for time, chosen in ((row["t"], angles), (row["t"] + 0.0007, set(row) - angles)):
                estimates += stream.push(time, {name: row[name] for name in chosen})
        found.append(np.array([list(one.components.values()) for one in estimates]))
    np.testing.assert_allclose(found[1], found[0], atol=1e-6)


def test_readings_that_failed_are_left_out(swing: pd.DataFrame, tmp_path: Path) -> None:
    """As a bus leaves them: -pi and zeros in a row or three. Checks saw slow rates, and forces were up to 68 N off."""
    table, failed = swing.copy(), [100, 400, 401, 402, 700]
    table.loc[failed, COLUMNS] = -np.pi
    table.loc[failed, [name for name in table if name.endswith(("_v", "_i"))]] = 0.0
    record, whole = opened(table, tmp_path), opened(swing, tmp_path)
    text = f"5 readings of joints jump away and back, as where one failed: left out (at {swing.t[100]:.10g} s turn"
    assert any(note.startswith(text) for note in record.notes)
    np.testing.assert_allclose(record.block(0, 999).q, whole.block(0, 999).q, atol=2e-3)
    found, true = (estimate(each, trust=True).estimates["force_level"].components for each in (record, whole))
    np.testing.assert_allclose(found, true, atol=0.2)
    gripper, noise = np.repeat([0.0, 1.0, 0.0, 1.0, 0.0], 200), np.random.default_rng(1).normal(size=1000)
    turned = swing.turn_q.to_numpy() + 2.0 * np.pi * np.isin(np.arange(1000), failed)
    for values in (gripper, noise, np.sign(noise), turned):
        assert not len(failed_readings(values, 2.0 * np.pi, 0.01))
    tapped = 1e-4 * noise + 0.8 * (np.arange(1000) % 20 == 7)  # as a finger that taps, ten samples a second
    assert (len(failed_readings(tapped, 2.0 * np.pi, 0.1)), len(failed_readings(tapped, 2.0 * np.pi, 0.01))) == (0, 50)


def test_steps_that_grow_to_a_full_turn_are_no_jump() -> None:
    """An angle in degrees that is taken for rad passes 6.3 from sample to sample; what a slide shows never turns."""
    time = np.arange(200) / 50.0
    fast, jumps = 90.0 * np.sin(4.0 * time), np.where(time > 2.0, 3.1, -3.1)
    spool = Spool()
    for values, spread, expected in ((fast, time, 0), (jumps, time, 1), (jumps, time + 9.0 * (time > 2.0), 0)):
        assert without_turns(series_of(spool, spread), series_of(spool, values), 2.0 * np.pi, 0.1)[1] == expected
    assert np.max(np.abs(np.diff(fast))) > 6.3


Logged = tuple[Path, pd.DataFrame]  # a folder, and the table in it
PAUSE = 90.0  # [s] after which the arm goes on


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pd.DataFrame]:
    """Return a folder with the arm, and 10 s of it that nothing pushed."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "arm.urdf").write_text(arm())
    recording(folder, "free", pushed=False, seed=1)
    return folder, pd.read_csv(folder / "free.csv")


def recorded_at(times: str, folder: Path, table: pd.DataFrame, **changes: Any) -> Record:
    """Return the record of a table at even times or its own."""
    return recorded(folder / "log.csv", edited(arm_map(), {"log.times": times, **changes}), table=table)


def check_fits(record: Record) -> None:
    """Check that the arm's mass and rotors are found."""
    values = fitted_by_map(taken_as_free(record), mass=True).values
    assert values.friction is not None
    assert values.mass == pytest.approx(HEAVIER, abs=0.002)
    np.testing.assert_allclose(values.friction.inertia, ROTOR, rtol=0.1)


def test_a_pause_is_no_time_of_a_record(table: Logged) -> None:
    """Its rate, length, parts and fits are those of the samples; the mass was 1.2 times the believed one, not 1.06."""
    folder, whole = table
    stopped = whole.assign(t=whole.t + PAUSE * (whole.t >= 5.0))
    record = recorded_at("own", folder, stopped)
    assert (record.rate, record.duration) == pytest.approx((500.0, 9.996))
    assert [record.after_start(k) for k in (2499, 2499.5, 2500)] == pytest.approx([4.998, 49.999, 95.0])
    assert [record.index_after(time) for time in (4.998, 49.999, 95.0)] == pytest.approx([2499, 2499.5, 2500])
    assert list(record.spread(10_000, 1.0, 97.0)) == [(500, 2499), (2500, 3500)]
    risen = settled(record, record.times(0, 4999))
    np.testing.assert_array_equal(np.flatnonzero(~risen), [*range(25), *range(2500, 2525)])
    bands = [(band.get_x(), band.get_x() + band.get_width()) for band in draw_motion(record).get_axes()[0].patches]
    np.testing.assert_allclose(bands, [(0.0, 4.998), (95.0, 99.998)])
    rubbing = recorded_at("own", folder, stopped, **{"joints.friction": None})
    assert replay_result(estimate(rubbing, trust=True)).subtitle == "0 to 4.998 s; 9.996 s are used in all"
    check_fits(record)


@pytest.mark.parametrize("piece", [100, 1 << 16])
def test_steps_as_long_as_usual_end_no_part(table: Logged, piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 10 samples a second, those of over 0.1 s did where pieces of a long recording meet; a real hole does."""
    monkeypatch.setattr("aerobat_pin.records.file_source.EXTENT", piece)
    folder, whole = table
    count = np.arange(450)
    slow = whole.iloc[10 * count].assign(t=0.1 * count + 0.02 * np.sin(count))
    record = recorded_at("own", folder, slow.drop(slow.index[230:234]))
    assert record.parts == ((0, 229), (230, 445))


def test_pauses_are_not_looked_for_among_all_others(table: Logged, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a record with 2000 of them it took 20 s to open it."""
    reads, read, (folder, whole) = list[int](), Spool.read, table
    monkeypatch.setattr(Spool, "read", lambda spool, place, numbers: (reads.append(place), read(spool, place, numbers)))
    record = recorded_at("own", folder, whole.assign(t=whole.t + 0.15 * (np.arange(len(whole)) // 20)))
    assert len(record.parts) == len(whole) // 20
    assert len(reads) < 50 * len(record.parts)


def test_channels_are_seen_between_the_stamps(table: Logged) -> None:
    """As at even times, and beyond the last one; rows at the next stamps were given, and none beyond."""
    even, own = (recorded_at(times, *table) for times in ("even", "own"))
    for shift in (0.0005, 0.05):
        times = own.times(4000, 4999) + shift
        np.testing.assert_allclose(own.at("joints.effort", times), even.at("joints.effort", times), atol=1e-9)


def test_times_of_a_map_count_from_the_first_common_sample(table: Logged) -> None:
    """Also where efforts begin later than positions: a stretch without contact was sought before they began."""
    folder, whole = table
    late = whole.assign(**{f"{joint}_i": whole[f"{joint}_i"].where(whole.t >= 6.0) for joint in JOINTS})
    changes = {"joints.friction": None, "use.free": [1.0, 3.0]}
    results = [estimate(recorded_at(times, folder, late, **changes), trust=True) for times in ("even", "own")]
    assert [result.start for result in results] == [6.0, 6.0]
    np.testing.assert_allclose(results[1].parts, results[0].parts, atol=1e-9)
    errors = [[f.value for f in result.findings if f.check == "stretch without contact"] for result in results]
    assert errors[0][0] is not None
    assert errors[0] == pytest.approx(errors[1], rel=0.01)


def test_an_error_bar_of_moments_has_their_unit(table: Logged) -> None:
    """Of an arm without points, whose rows are in N m: the largest was said in N."""
    folder, whole = table
    changes = {"joints.friction": None, "use.free": [1.0, 3.0], "robot.points": []}
    result = estimate(recorded_at("even", folder, whole[whole.t < 4.0], **changes), trust=True)
    assert [each.unit for each in result.findings if each.check == "stretch without contact"] == ["N m"]


def test_accelerations_are_those_of_uneven_stamps(table: Logged) -> None:
    """Of an arm that is logged at 100 Hz, then at 500 Hz; the mass was 1.2 times the believed one, without rotors."""
    folder, whole = table
    uneven = whole[(whole.index % 5 == 0) | (whole.t >= 5.0)]
    record = recorded_at("own", folder, uneven)
    block = record.block(*record.parts[0])
    true = np.gradient(whole[[f"{joint}_v" for joint in JOINTS]].to_numpy(), whole.t, axis=0)
    halves = 0.5 * (block.time[1:] + block.time[:-1])
    expected = np.column_stack([np.interp(halves, whole.t, column) for column in true.T])
    np.testing.assert_allclose(accelerations(block, record)[5:-5], expected[5:-5], atol=0.01)
    check_fits(record)


def test_samples_with_the_same_time_have_the_velocity_of_their_neighbours() -> None:
    """One that turns and flies steadily; it stood still for these samples, which looked like forces of 50 N."""
    model, v = pin.buildSampleModelHumanoidRandom(), np.linspace(-0.3, 0.4, 32)
    time = np.array([0.0, 0.0, 0.1, 0.3, 0.3, 0.3, 0.4, 0.4])
    q = np.array([pin.integrate(model, pin.neutral(model), t * v[: model.nv]) for t in time])
    np.testing.assert_allclose(neighbour_rates(model, time, q), np.tile(v[: model.nv], (8, 1)), atol=1e-12)


MASS = 1.5
BODY = {"mass": MASS, "inertia": [0.01, 0.01, 0.02]}
MAP = {
    "robot": {"body": BODY, "points": ["body"], "rows": {"ignore": ["base.Mx", "base.My", "base.Mz"]}},
    "base": by_axis(position="p{}", velocity="v{}", rate="w{}", quaternion="q{}"),
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
    six_joints.swing(tmp_path / "six.csv", 3)
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
