"""A recorded flight as a table: read as it was written, or refused with file, line, column and what was expected."""

from pathlib import Path

import numpy as np
import pytest

from aerobat_pin.aerobat import JOINTS, FlightLog, read_log, write_csv
from aerobat_pin.aerobat.kind_of_log import STATE_TABLE, table_units
from aerobat_pin.errors import LogError, OutputError
from aerobat_pin.experiments import Experiment
from aerobat_pin.flight import simulate
from aerobat_pin.records import LogTable, read_columns
from aerobat_pin.scenario import load_scenario

UNITS = table_units(STATE_TABLE)
HEADER = ["time [s]", "x [m]", "y", "z", "qx", "qy", "qz", "qw [-]", "crank_angle [rad]", "airspeed [m/s]"]


def table(count: int = 20) -> list[list[float]]:
    """Return rows of a level flight at 3 m/s with the crank turning at 5 Hz, 100 samples a second."""
    t = 0.01 * np.arange(count)
    crank = (-1.5 + 2.0 * np.pi * 5.0 * t + np.pi) % (2.0 * np.pi) - np.pi
    return np.column_stack([t, 3.0 * t, 0 * t, 0 * t, 0 * t, 0 * t, 0 * t, 1 + 0 * t, crank, 3 + 0 * t]).tolist()


def write(path: Path, header: list[str], rows: list[list[float]]) -> Path:
    path.write_text("\n".join([",".join(header), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def test_a_table_becomes_a_log_with_units(tmp_path: Path) -> None:
    """Channels, units and time; the crank angle is unwrapped, quaternions are normalised, wrenches become means."""
    rows = [[*row, *(10.0 * row[0] + k for k in range(6))] for row in table()]
    header = [*HEADER, *(f"thrust_{name}" for name in ("fx", "fy", "fz", "mx", "my", "mz"))]
    log = read_log(write(tmp_path / "hall.csv", header, rows))
    np.testing.assert_allclose(log.time, 0.01 * np.arange(20))
    np.testing.assert_allclose(log.measured["pose"].values[:, 0], 3.0 * log.time)
    np.testing.assert_allclose(np.diff(log.measured["crank_angle"].values), 0.1 * np.pi)
    np.testing.assert_allclose(log.measured["known_thrusters"].values[:, 2], 10.0 * (log.time[1:] - 0.005) + 2.0)
    assert log.measured["airspeed"].attrs["units"] == "m/s"
    assert log.measured.attrs["scenario"] == "hall"
    assert log.truth is None


def changed(row: int, column: int, value: object) -> list[list[float]]:
    rows = table()
    rows[row][column] = value  # type: ignore[call-overload]
    return rows


BOTH = "velocity and angular velocity were expected"


@pytest.mark.parametrize(
    ("header", "rows", "message"),
    [
        ([*HEADER[:-1], "air_speed"], table(), r"unknown column 'air_speed'; did you mean 'airspeed'\?"),
        (["time [ms]", *HEADER[1:]], table(), r"column 'time \[ms\]': s was expected"),
        (["x", *HEADER[1:]], table(), "column 'x' appears twice"),
        (HEADER[:9], [row[:9] for row in changed(0, 0, 0)][:2], "less than 3 samples in common"),
        (HEADER, [], r"0 rows: two or more"),
        (HEADER, changed(4, 1, "far"), r"line 6: x = 'far': a number was expected"),
        (HEADER, changed(4, 1, ""), "line 6: x is empty: all of x, y, z or none"),
        (HEADER, changed(7, 0, 0.06), r"line 9: time = 0\.06 s is repeated: rising times"),
        (HEADER, changed(7, 0, 0.02), r"line 9: time = 0\.02 s runs backwards"),
        (HEADER, [[1000.0 * row[0], *row[1:]] for row in table()], r"time rises by 10 s .*at most .*0\.5 s was"),
        (HEADER, changed(2, 7, 0.5), r"quaternion \(qx, qy, qz, qw\) has length 0\.5 at 0\.02 s: 1 was"),
        (HEADER, [*table(), [1.0, 2.0]], "line 22: 2 cells: 10, as in the header, were expected"),
        (HEADER[:8], [row[:8] for row in table()], "neither crank_angle nor the joints"),
        ([*HEADER[:8], *JOINTS, "crank_rate"], [[*row[:8], *[0.1] * 5] for row in table()], "without crank_angle"),
        (HEADER[1:], [row[1:] for row in table()], "no column named time"),
        ([*HEADER, "wx"], [[*row, 0.0] for row in table()], "wx without wy, wz: all of them or none"),
        ([*HEADER, "wx", "wy", "wz"], [[*row, 0.0, 0.0, 0.0] for row in table()], f"wx, wy, wz: {BOTH}, both or none"),
        ([*HEADER[:8], *JOINTS], [[*row[:8], *[10.0, 40.0] * 2] for row in table()], "left_shoulder = 10: radians"),
        (HEADER, [[*row[:8], 1800.0 * row[0], 3.0] for row in table()], r"crank_angle .* turns by 18 rad .* degrees\?"),
    ],
)
def test_what_is_no_flight_is_refused(tmp_path: Path, header: list[str], rows: list[list[float]], message: str) -> None:
    file = write(tmp_path / "hall.csv", header, rows)
    with pytest.raises(LogError, match=f"hall.csv.*{message}"):
        read_log(file)


def test_no_cell_is_guessed_and_every_refusal_is_a_line(tmp_path: Path) -> None:
    """What other readers take for a number, and files that are empty or full of zeros."""
    words = ["nan", "inf", "²", "0x10", 5000 * "9", "1e999", "2020-01-01", "--1", "1 2", "1,5", "TRUE"]
    good = write(tmp_path / "good.csv", HEADER, table()).read_text()
    texts = [write(tmp_path / "odd.csv", HEADER, changed(4, 1, word)).read_text() for word in words]
    for text in ["", "\n\n", good.partition("\n")[0] + "\n" + 500 * "\0", *texts]:
        (tmp_path / "hall.csv").write_text(text)
        with pytest.raises(LogError, match=r"hall\.csv") as told:
            read_log(tmp_path / "hall.csv")
        assert "\n" not in str(told.value)
        assert len(str(told.value)) < 600


def test_files_that_are_not_tables_are_refused(tmp_path: Path) -> None:
    """A picture, and none at all."""
    (tmp_path / "hall.csv").write_bytes(bytes(range(128, 256)))
    with pytest.raises(LogError, match="is no text in UTF-8"):
        read_log(tmp_path / "hall.csv")
    with pytest.raises(LogError, match=r"^log .*missing\.csv: there is no such file$"):
        read_log(tmp_path / "missing.csv")


def test_a_quote_that_does_not_end_is_refused(tmp_path: Path) -> None:
    """The rest of the file is one cell then, longer than any."""
    rows = [[*row[:9]] for row in table(4000)]
    file = write(tmp_path / "hall.csv", HEADER[:9], rows)
    file.write_text(file.read_text().replace("\n0.05,", '\n"0.05,', 1))
    with pytest.raises(LogError, match=r"hall\.csv: cannot be read as CSV: field larger"):
        read_log(file)


def test_lines_are_counted_as_an_editor_does(tmp_path: Path) -> None:
    file = write(tmp_path / "hall.csv", HEADER, changed(4, 1, "far"))
    file.write_text("\n" + file.read_text().replace("\n", "\n\n", 3))
    wrong = next(k for k, line in enumerate(file.read_text().splitlines(), start=1) if "far" in line)
    with pytest.raises(LogError, match=f"hall.csv, line {wrong}: x = 'far'"):
        read_log(file)


def test_numbers_are_read_to_the_last_bit_however_they_are_written(tmp_path: Path) -> None:
    """With blanks and quotes, and as Python itself reads them."""
    numbers = [1.0 / 3.0, 1e-300, 6.02214076e23, -0.0, 1.7976931348623157e308]
    (tmp_path / "plain.csv").write_text("a,b\n" + "".join(f"{x!r},{x:.25e}\n" for x in numbers))
    (tmp_path / "odd.csv").write_text("a,b\n" + "".join(f' {x!r} ,"{x!r}"\n\n' for x in numbers))
    for name in ("plain", "odd"):
        columns = read_columns(tmp_path / f"{name}.csv", LogTable.model_validate({"time": {"rate": 1.0}}), ("a", "b"))
        assert [columns.values[column][:].tolist() for column in "ab"] == [numbers, numbers]


def test_a_simulated_flight_comes_back_from_its_table(paper: Experiment, tmp_path: Path) -> None:
    """Samples to ten digits, each under its channel; forces and torques over their neighbours, [1, 2, 1] / 4."""
    write_csv(paper.log, tmp_path / "hall.csv")
    again, measured = read_log(tmp_path / "hall.csv").measured, paper.log.measured
    joints = list(JOINTS)
    for name, values in {
        "pose": measured["q"].values[:, :7],
        "twist": measured["v"].values[:, :6],
        "joint_angle": measured["q"].sel(q_axis=joints).values,
        "joint_rate": measured["v"].sel(v_axis=joints).values,
        "crank_angle": measured["crank_angle"].values,
        "airspeed": measured["airspeed"].values,
    }.items():
        np.testing.assert_allclose(again[name].values, values, rtol=1e-9, atol=1e-9, err_msg=name)
    for name, values in {
        "joint_torque": measured["motor_torque"].sel(v_axis=joints).values,
        "known_thrusters": measured["known_thrusters"].values[:, :6],
    }.items():
        smooth = 0.25 * (values[:-2] + 2.0 * values[1:-1] + values[2:])
        np.testing.assert_allclose(again[name].values[1:-1], smooth, rtol=1e-7, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(again[name].values[[0, -1]], values[[0, -1]], rtol=1e-7, atol=1e-9)


def test_a_recorded_table_comes_back_as_it_was_read(tmp_path: Path) -> None:
    """Every column there is, in any order, after a byte-order mark, in seconds since 1970: read, written, read."""
    rng = np.random.default_rng(1)
    t = 0.01 * np.arange(30)
    quaternion = rng.normal(size=(4, 30)) * 0.1 + np.array([[0.0], [0.0], [0.0], [1.0]])
    quaternion /= np.linalg.norm(quaternion, axis=0)
    columns = sorted(UNITS, reverse=True)
    values = {name: np.polyval(rng.normal(size=2), t) for name in columns}
    values |= {"time": 1.7e9 + t, **dict(zip(("qx", "qy", "qz", "qw"), quaternion, strict=True))}
    header, rows = [f"{name} [{UNITS[name]}]" for name in columns], np.column_stack(list(values.values())).tolist()
    file = write(tmp_path / "all.csv", header, rows)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    log = read_log(file)
    write_csv(log, tmp_path / "again.csv")
    again = read_log(tmp_path / "again.csv")
    np.testing.assert_allclose(again.time, log.time, rtol=0.0, atol=1e-6)
    for name in log.measured.data_vars:
        np.testing.assert_allclose(again.measured[name], log.measured[name], rtol=1e-8, atol=1e-8, err_msg=str(name))
    channels = {"pose", "twist", "joint_angle", "joint_rate", "wind_W", "airspeed", "crank_angle", "crank_rate"}
    channels |= {"crank_torque", "joint_torque", "known_thrusters"}
    assert set(again.measured.data_vars) == set(log.measured.data_vars) == channels
    header_again = (tmp_path / "again.csv").read_text().splitlines()[0].split(",")
    assert sorted(header_again) == sorted(header)


def test_raw_samples_come_back_at_their_own_rows(tmp_path: Path) -> None:
    """Poses every tenth row, empty cells between; a written NaN and half a sample are refused."""
    log = simulate(load_scenario("raw_sensors", ["simulation.duration=0.1"]))
    write_csv(log, tmp_path / "raw.csv")
    again = read_log(tmp_path / "raw.csv")
    assert again.is_raw
    for name in ("mocap_position", "mocap_quaternion", "gyro", "accelerometer", "encoder", "joint_torque_sample"):
        one, other = log.measured[name], again.measured[name]
        np.testing.assert_allclose(other.values, one.values, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(other[other.dims[0]].values, one[one.dims[0]].values, atol=1e-9)
    lines = (tmp_path / "raw.csv").read_text().splitlines()
    header, first, *rest = (line.split(",") for line in lines)
    for cells, text, message in (
        ([8], "nan", "line 2: wx = 'nan': a number was expected, or an empty cell"),
        ([1], "", "line 2: x is empty: all"),
        ([4, 5, 6, 7], "", "cells of qx, qy, qz, qw and of x, y, z are filled in different rows"),
    ):
        wrong = [first.copy(), *rest]
        for cell in cells:
            wrong[0][cell] = text
        (tmp_path / "wrong.csv").write_text("\n".join(",".join(row) for row in [header, *wrong]))
        with pytest.raises(LogError, match=message):
            read_log(tmp_path / "wrong.csv")
    both = [[*row, 0.0] for row in table()]
    with pytest.raises(LogError, match="ax with airspeed: an accelerometer is read from raw samples only"):
        read_log(write(tmp_path / "both.csv", [*HEADER, "ax"], both))


def test_what_a_table_cannot_hold_is_refused(paper: Experiment, tmp_path: Path) -> None:
    """A known force without a column; a folder that is not there."""
    measured = paper.log.measured
    rope = FlightLog(measured.assign(known_rope=measured["known_thrusters"]))
    with pytest.raises(LogError, match="no column for known_rope"):
        write_csv(rope, tmp_path / "rope.csv")
    with pytest.raises(OutputError, match=r"no/hall\.csv: cannot be written"):
        write_csv(paper.log, tmp_path / "no" / "hall.csv")
    assert list(tmp_path.iterdir()) == []
