"""Aerobat's tables by shipped maps: the same forces as from arrays; what any table gains; which log is whose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from support.recorded import recorded

from aerobat_pin import aerobat
from aerobat_pin.aerobat.channels import MEASURED, THRUST_CHANNEL, channel, filled
from aerobat_pin.errors import LogError
from aerobat_pin.flight import simulate
from aerobat_pin.forces import KnownForces, inputs_of, observers_of
from aerobat_pin.observers import Estimate
from aerobat_pin.records import Channel, Record
from aerobat_pin.scenario import RawSection, load_scenario

POSE = "x y z qx qy qz qw".split()
TWIST = "vx vy vz wx wy wz".split()
RATES = [f"{joint}_rate" for joint in aerobat.JOINTS]
TORQUES = [f"torque_{joint}" for joint in aerobat.JOINTS]
THRUST = [f"thrust_{name}" for name in ("fx", "fy", "fz", "mx", "my", "mz")]
WIND = ["wind_x", "wind_y", "wind_z"]
GROUPS = {"pose": POSE, "twist": TWIST, "joint_angle": list(aerobat.JOINTS), "joint_rate": RATES}
GROUPS |= {"joint_torque": TORQUES, "known_thrusters": THRUST, "wind_W": WIND}
GROUPS |= {name: [name] for name in ("crank_angle", "crank_rate", "airspeed", "crank_torque")}


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Return a table of 0.2 s with every column, without units."""
    file = tmp_path_factory.mktemp("table") / "all.csv"
    aerobat.write_csv(simulate(load_scenario("paper", ["simulation.duration=0.2"])), file)
    table = pd.read_csv(file)
    table.columns = pd.Index([name.partition(" ")[0] for name in table.columns])
    t = table["time"].to_numpy()
    more = {
        "crank_rate": 30.0 + t,
        "crank_torque": 0.01 + 0.02 * t,
        "wind_x": 0.3 - t,
        "wind_y": 0.2 * t,
        "wind_z": 0 * t,
    }
    return table.assign(**more)


def arrays(table: pd.DataFrame) -> aerobat.FlightLog:
    """Return the log of a table, array by array."""
    time, made, coords = table["time"].to_numpy(), {}, {}
    for key, names in GROUPS.items():
        if set(names) <= set(table):
            values = table[names].to_numpy()
            if key == "crank_angle":
                values = np.unwrap(values, axis=0)
            if key == "pose":
                values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
            row = THRUST_CHANNEL if key == "known_thrusters" else MEASURED[key]
            values = 0.5 * (values[1:] + values[:-1]) if row.dims[0] == "interval" else values
            made[key] = filled(key, values if len(row.dims) > 1 else values[:, 0], {key: row})
    coords["time"] = channel(time, ("time",), "s", "time")
    coords["interval"] = channel(time[:-1], ("interval",), "s", "start")
    return aerobat.FlightLog(xr.Dataset(made, coords=coords))


def of_record(file: Path, log: aerobat.FlightLog) -> dict[str, Estimate]:
    """Return what observers find in the record of a table, with the usual belief about a log with its channels."""
    belief = aerobat.belief_about(log, "hall", None, [], [])
    robot = aerobat.AerobatRobot.of(aerobat.believed_robot(belief), belief.believed_air, belief.observers.torque)
    record, rows = aerobat.table_record(file, robot, belief.observers), robot.rows()
    assert rows is not None
    inputs = inputs_of(record, *record.parts[0], KnownForces(record), rows)
    observers = observers_of(record)[0]
    return {one.name: one.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known) for one in observers}


@pytest.mark.parametrize(
    ("without", "uneven"),
    [
        ([], False),
        ([*TWIST, *WIND], True),
        ([*TWIST, *RATES, "crank_rate", *WIND], False),
        ([*aerobat.JOINTS, *RATES, *TORQUES, "airspeed"], True),
        ([*aerobat.JOINTS, *WIND], False),
        (["crank_angle", "crank_rate", *WIND, *THRUST], True),
        (["crank_angle", "crank_rate", *RATES, "crank_torque", "airspeed", *WIND], False),
        ([*TORQUES, "crank_torque", *WIND], True),
    ],
    ids=str,
)
def test_a_table_gives_its_arrays_forces(frame: pd.DataFrame, without: list[str], uneven: bool, tmp_path: Path) -> None:
    """To 1e-12 of the largest, as a record and as a flight log; the crank's angle jumps, quaternions are rounded."""
    table = frame.drop(columns=without)
    if uneven:
        table = table.iloc[np.sort(np.random.default_rng(1).choice(len(table), 150, replace=False))]
    if "crank_angle" in table:
        table = table.assign(crank_angle=(table["crank_angle"] + np.pi) % (2.0 * np.pi) - np.pi)
    expected_log = arrays(table)
    table.to_csv(tmp_path / "hall.csv", index=False)
    log = aerobat.read_log(tmp_path / "hall.csv")
    for name, values in expected_log.measured.data_vars.items():
        np.testing.assert_allclose(log.measured[name], values, rtol=1e-13, atol=1e-13, err_msg=str(name))
    belief = aerobat.belief_about(expected_log, "hall", None, [], [])
    expected = aerobat.estimate_flight(expected_log, aerobat.believed_robot(belief), belief).estimates
    found = of_record(tmp_path / "hall.csv", log)
    for name, estimate in expected.items():
        largest = np.max(np.abs(estimate.components))
        np.testing.assert_allclose(found[name].components, estimate.components, rtol=0.0, atol=1e-12 * largest)


def test_raw_samples_by_the_map_give_the_forces_of_their_log(tmp_path: Path) -> None:
    """The joint smoother on the record of the table, and on the log that was written, rounded as the table is."""
    log = replace(simulate(load_scenario("raw_sensors", ["simulation.duration=0.2"])), truth=None)
    aerobat.write_csv(log, tmp_path / "raw.csv")
    settings = ["observers.raw.walk=[0.05, 0.05, 0.05]", "observers.raw.offset_error=0.0", "observers.torque=measured"]
    read = aerobat.read_log(tmp_path / "raw.csv")
    belief = aerobat.belief_about(read, "raw", None, ["smoother"], settings)
    robot = aerobat.AerobatRobot.of(aerobat.believed_robot(belief), belief.believed_air, belief.observers.torque)
    robot = replace(robot, raw=belief.observers.raw or RawSection())
    record = aerobat.table_record(tmp_path / "raw.csv", robot, belief.observers)
    time = record.times(*record.parts[0])
    np.testing.assert_allclose(time, log.time, atol=1e-9)
    found = robot.motion_from(time, record.channels, observers_of(record)[0], None)
    expected = aerobat.estimate_flight(read, aerobat.believed_robot(belief), belief).estimates
    forces = expected["smoother"].components
    found_there = found.estimates["smoother"].components
    np.testing.assert_allclose(found_there, forces, rtol=0.0, atol=1e-12 * np.max(np.abs(forces)))


BODY = {"body": {"mass": 0.03, "inertia": [1e-5, 1e-5, 2e-5]}, "points": ["centre"]}


def opened(text: str, folder: Path, **tables: object) -> Record:
    """Return the record of a table of one body."""
    (folder / "log.csv").write_text(text)
    base = {"position": {"columns": ["x", "y", "z"]}, "quaternion": {"columns": ["qx", "qy", "qz", "qw"]}}
    return recorded(folder / "log.csv", {"robot": BODY, "base": base, **tables})


def rows(step: float = 0.01, more: str = "", count: int = 20) -> str:
    """Return rows of a body at rest."""
    return "".join(f"{k * step:g},1,2,3,0,0,0,1{more.format(k=k)}\n" for k in range(count))


def test_a_header_may_state_units(tmp_path: Path) -> None:
    """They are those of the map, or the table is refused; a map can also name a column with its unit."""
    header = "t [s],x [{unit}],y [m],z [m],qx [-],qy,qz,qw\n"
    log = {"time": {"column": "t"}}
    assert opened(header.format(unit="m") + rows(), tmp_path, log=log).channels["base.position"].values[:][0, 2] == 3.0
    with pytest.raises(LogError, match=r"log\.csv: column 'x \[mm\]': m was expected"):
        opened(header.format(unit="mm") + rows(), tmp_path, log=log)
    position = {"columns": ["x [mm]", "y [m]", "z [m]"], "unit": "mm"}
    base = {"position": position, "quaternion": {"columns": ["qx", "qy", "qz", "qw"]}}
    found = opened(header.format(unit="mm") + rows(), tmp_path, log=log, base=base)
    assert found.channels["base.position"].values[:][0, 0] == pytest.approx(1e-3)
    with pytest.raises(LogError, match=r"column 't \[ms\]': s was expected"):
        opened("t [ms]" + header.format(unit="m")[5:] + rows(), tmp_path, log=log)


def test_an_optional_channel_is_there_or_not(tmp_path: Path) -> None:
    check = {"specific_force": {"columns": ["ax", "ay", "az"], "optional": True}}
    header = "t,x,y,z,qx,qy,qz,qw"
    assert "check.specific_force" not in opened(f"{header}\n{rows()}", tmp_path, check=check).channels
    whole = opened(f"{header},ax,ay,az\n{rows(more=',0,0,9.81')}", tmp_path, check=check)
    assert "check.specific_force" in whole.channels
    with pytest.raises(LogError, match="ax, ay without az: all of them or none"):
        opened(f"{header},ax,ay\n{rows(more=',0,0')}", tmp_path, check=check)


def test_a_record_can_have_the_times_of_its_table(tmp_path: Path) -> None:
    """Uneven stamps, a slower channel with empty cells, gaps as parts."""
    log = {"times": "own", "time": {"column": "t"}}
    check = {"specific_force": {"columns": ["ax", "ay", "az"]}}
    header = "t,x,y,z,qx,qy,qz,qw,ax,ay,az\n"
    times = np.cumsum(np.random.default_rng(0).uniform(0.005, 0.015, 40))
    times[20:] += 1.0
    cells = [f"{k},0,9.81" if k % 3 == 0 or k in (19, 20, 39) else ",," for k in range(40)]
    lines = [f"{time!r},{time!r},2,3,0,0,0,1,{cell}\n" for time, cell in zip(times.tolist(), cells, strict=True)]
    record = opened(header + "".join(lines), tmp_path, log=log, check=check)
    assert record.parts == ((0, 19), (20, 39))
    np.testing.assert_array_equal(record.times(0, 39), times)
    np.testing.assert_array_equal(record.at("base.position", times)[:, 0], times)
    slow = record.channels["check.specific_force"]
    assert isinstance(slow, Channel)
    np.testing.assert_array_equal(slow.time[:], times[[*range(0, 19, 3), 19, 20, *range(21, 40, 3)]])


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (
            "timestamp,x,y,z,qx,qy,qz,qw,crank",
            r"named time \(is it 'timestamp'\?\), crank_angle \(is it 'crank'\?\); if",
        ),
        ("t,x,y,z,qx,qy,qz,qw,crank_angle", r"no column named time; if it is another robot's, a map says"),
        ("TIME,X,Y,Z,QX,QY,QZ,QW,CRANK_ANGLE", r"no column named time \(is it 'TIME'\?\), x \(is it 'X'\?\), y"),
        ("time,px,py,pz,q0,q1,q2,q3,thrust_fx", r"no column named x \(is it 'px'\?\),.* qw.* crank_angle; if"),
        ("time,q1,q2,q3,tau1,tau2,tau3", r"hall\.csv: a map says .*\(--map MAP\.toml of estimate.*--suggest"),
        ("", r"hall\.csv: its first line has numbers alone .* no header"),
    ],
)
def test_a_log_that_is_none_of_aerobats_is_told_what_it_lacks(header: str, message: str, tmp_path: Path) -> None:
    """The columns, if some of the others are only Aerobat's or are called alike, or a map."""
    (tmp_path / "hall.csv").write_text(f"{header}\n" + rows())
    with pytest.raises(LogError, match=message):
        aerobat.read_log(tmp_path / "hall.csv")


def test_the_folder_of_a_run_is_told_its_log(tmp_path: Path) -> None:
    """Not to find a map for it, which `calibrate` and `check` do not ask for either."""
    (tmp_path / "flight.nc").touch()
    with pytest.raises(LogError, match=r"the folder of a run: its log .*flight\.nc was expected"):
        aerobat.read_log(tmp_path)
