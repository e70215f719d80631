"""Aerobat's own logs: the air of a motion comes back, tables give the forces of arrays, `aerobat estimate` tells."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import xarray as xr
from scipy.signal import savgol_filter
from support import commands
from support.recorded import recorded

import aerobat_pin
from aerobat_pin import aerobat, open_record, records
from aerobat_pin.aerobat import robot as robot_of_records
from aerobat_pin.aerobat.aerobat import FORCE_POINTS, Aerobat, believed_robot, flown_robot, load_morphology
from aerobat_pin.aerobat.air.believed_air import _slerp, reconstructed_air
from aerobat_pin.aerobat.channels import MEASURED, THRUST_CHANNEL, channel, filled
from aerobat_pin.aerobat.estimate import belief_about, describe_belief, estimate_flight
from aerobat_pin.aerobat.flight_log import FlightLog, true_force
from aerobat_pin.aerobat.flight_record import flight_motion, flight_record, known_inputs
from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.aerobat.tables import read_log
from aerobat_pin.errors import AerobatError, LogError, ScenarioError
from aerobat_pin.experiments import Check, Experiment, run, self_check
from aerobat_pin.flight import simulate
from aerobat_pin.forces import KnownForces, inputs_of, observers_of
from aerobat_pin.forces.scores import r_squared
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate, ForceLevelObserver, MomentumObserver
from aerobat_pin.records import Channel, Record
from aerobat_pin.scenario import AirSection, RawSection, load_scenario, scenario_toml

SHORT = ["simulation.duration=0.3"]


def stripped(log: FlightLog, every: int = 1) -> FlightLog:
    """Keep what a motion-capture hall records: body poses, crank angle and airspeed, every so many samples."""
    kept = log.measured.isel(time=slice(None, None, every))
    measured = kept[["crank_angle", "airspeed"]].drop_vars(["interval", "q_axis", "v_axis"], errors="ignore")
    measured["pose"] = xr.DataArray(kept["q"].values[:, :7], dims=("time", "pose_axis"))
    measured.attrs = log.measured.attrs
    return FlightLog(measured)


WINDY = ["air.wind=[0.5, -1.0, 0.3]", "air.gust.amplitude=[0.0, 1.0, 1.0]", "air.gust.start=0.05"]
AIRS = [[], ["air.model=quasi_steady"], ["air.added_mass=0"], WINDY, ["air.lift_limit=1.2"]]


@pytest.mark.parametrize("settings", AIRS, ids=lambda settings: " ".join(settings) or "default")
def test_the_air_of_a_flight_comes_back_from_its_motion(settings: list[str]) -> None:
    """Against the plant's interval means, which come by its stages: a thousandth of the largest force is left."""
    scenario = load_scenario("paper", [*SHORT, *settings])
    log = simulate(scenario)
    found = known_inputs(log, flown_robot(scenario)).known
    if not settings:  # the joints tell where the crank is, so that the wings have their wake
        alone = known_inputs(FlightLog(log.measured.drop_vars("crank_angle")), flown_robot(scenario)).known
        np.testing.assert_allclose(alone["aerodynamic"], found["aerodynamic"], atol=2e-4)
    for name in ("aerodynamic", "added_mass"):
        expected = log.truth[name].values
        if name not in found:
            assert not np.any(expected)
            continue
        scale = np.max(np.abs(expected), axis=0)
        worst = np.max(np.abs(found[name] - expected), axis=0)
        assert np.all(worst[scale > 1e-3] < 1e-3 * scale[scale > 1e-3]), name


def test_pose_crank_and_airspeed_are_enough_for_the_base_wrench(paper: Experiment) -> None:
    """Six base rows of the unknown generalised force, R2 of each at least 0.99 where there is a signal of 1 mN."""
    log = stripped(paper.log)
    assert set(log.measured.data_vars) == {"pose", "crank_angle", "airspeed"}
    thrusters = paper.log.measured["known_thrusters"]
    log = FlightLog(log.measured.assign(known_thrusters=thrusters).assign_coords(interval=thrusters["interval"]))
    inputs = known_inputs(log, paper.robot, "none")
    assert inputs.source == {
        **dict.fromkeys(("q", "v", "wind", "aerodynamic", "added_mass"), "reconstructed"),
        "thrusters": "measured",
        "motor_torque": "none",
    }
    observer = MomentumObserver(paper.robot.model, gain=2000.0, rows="base")
    estimate = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    truth = paper.log.truth["unknown"].values
    scores = [r_squared(estimate.residual[:, i], truth[:, i]) for i in (0, 2)]
    moments = [1.0 - np.var(estimate.residual[:, i] - truth[:, i]) / np.var(truth[:, i]) for i in range(3, 6)]
    assert min(score for score in scores if score is not None) >= 0.99
    assert moments[1] >= 0.99


@pytest.mark.parametrize("every", [2, 5])
def test_a_slow_camera_still_gives_the_air(paper: Experiment, every: int) -> None:
    """Poses at 500 and 200 Hz: intervals are flown in finer steps, the crank in between by its cubic."""
    inputs = known_inputs(stripped(paper.log, every), paper.robot, "none")
    expected = paper.log.truth["aerodynamic"].values.reshape(-1, every, 10).mean(axis=1)
    error = inputs.known["aerodynamic"] - expected
    assert np.sqrt(np.mean(error[:, 2] ** 2)) < 0.03 * np.std(expected[:, 2])


def test_a_noisy_crank_is_mended_by_its_rate() -> None:
    """1 mrad at 1 kHz, differenced twice, drowns the force; docs/recorded.md: parabolas through 21 ms, K = 500 1/s."""
    scenario = load_scenario("paper", ["sensors.crank_angle.noise=1e-3"])
    flight, robot = simulate(scenario), flown_robot(scenario)
    measured, truth = flight.measured, true_force(flight, "left_force_point")[1]
    angle = measured["crank_angle"]
    smooth = angle.copy(data=savgol_filter(angle, 21, 2, deriv=1, delta=1e-3))
    poses = measured["q"].isel(q_axis=slice(7)).rename(q_axis="pose_axis")
    twists = measured["v"].isel(v_axis=slice(6)).rename(v_axis="twist_axis")
    bare = measured.drop_vars(["q", "v"]).assign(pose=poses, twist=twists)
    for log, expected in (
        (measured, (0.97, 0.97, 0.98)),
        (bare, (0.45, 0.14, 0.58)),
        (bare.assign(crank_rate=smooth), (0.97, 0.99, 0.99)),
    ):
        inputs = known_inputs(FlightLog(log), robot)
        observer = ForceLevelObserver(robot.model, FORCE_POINTS, gain=500.0)
        found = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known).force[:, 0]
        scores = [r_squared(found[:, i], truth[:, i]) for i in range(3)]
        assert scores == pytest.approx(expected, abs=0.006)


def test_a_wrong_belief_is_a_model_error_and_nothing_else() -> None:
    """`believed.air.density` 20 % up raises the reconstructed force by 20 %; the flight itself is the same."""
    exact, wrong = (run(load_scenario("paper", [*SHORT, *extra])) for extra in ([], ["believed.air.density=1.47"]))
    np.testing.assert_array_equal(wrong.log.measured["q"].values, exact.log.measured["q"].values)
    airs = [AirSection.model_validate_json(one.log.measured.attrs["air"]) for one in (exact, wrong)]
    assert [air.density for air in airs] == [1.225, 1.47]
    right, off = (known_inputs(one.log, one.robot).known["aerodynamic"] for one in (exact, wrong))
    np.testing.assert_allclose(off[5:, 2], 1.2 * right[5:, 2], rtol=0.02, atol=2e-4)
    scores = [one.metrics["observers"]["force_level"]["left"]["Fz"]["r2"] for one in (exact, wrong)]
    assert scores[0] > 0.999 > 0.99 > scores[1]
    heavy = run(load_scenario("paper", [*SHORT, "believed.robot.changes.body.mass=0.085"]))
    assert heavy.robot.mass == exact.robot.mass
    assert heavy.metrics["observers"]["force_level"]["left"]["Fz"]["r2"] < scores[0]


def test_measured_joints_win_over_the_crank_and_the_crank_over_differences(paper: Experiment) -> None:
    """Each quantity says where it comes from; a torque at the crank is spread with its power."""
    robot, log = paper.robot, stripped(paper.log)
    closed = flight_motion(log, robot, AirSection())
    np.testing.assert_allclose(closed.q[:, 7:], paper.log.measured["q"].values[:, 7:], atol=1e-9)
    np.testing.assert_allclose(closed.v[1:-1, 6:], paper.log.measured["v"].values[1:-1, 6:], atol=2e-3)
    order = ["left_shoulder", "left_elbow", "right_shoulder", "right_elbow"]
    joints = xr.DataArray(paper.log.measured["q"].values[:, list(robot.idx_q)] + 0.1, dims=("time", "joint"))
    measured = log.measured.assign(joint_angle=joints).assign_coords(joint=order)
    found = flight_motion(FlightLog(measured), robot, AirSection())
    record = flight_record(FlightLog(measured), AerobatRobot.of(robot))
    assert record.block(*record.parts[0]).source["q"] == "measured"
    np.testing.assert_allclose(found.q[:, 7:], closed.q[:, 7:] + 0.1, atol=1e-9)
    alone = flight_motion(FlightLog(measured.drop_vars("crank_angle")), robot, AirSection())
    np.testing.assert_allclose(alone.v[1:-1, 6:], closed.v[1:-1, 6:], atol=2.0)


def test_what_a_log_cannot_give_is_refused_by_name(paper: Experiment) -> None:
    """No joints and no crank; a torque that nobody recorded; a gap through which nothing can be flown."""
    robot: Aerobat = paper.robot
    log = stripped(paper.log)

    def refused(message: str, measured: Any, torque: Any = "none") -> None:
        with pytest.raises(AerobatError, match=message):
            known_inputs(FlightLog(measured), robot, torque)

    refused("neither joints nor crank_angle", log.measured.drop_vars("crank_angle"))
    refused("no channel named motor_torque or joint_torque: torque = measured needs it", log.measured, "measured")
    refused("or crank_torque: torque = motor_only", log.measured, "motor_only")
    refused("torque = 'guessed': one of measured", log.measured, "guessed")
    for torque in ("modelled", "motor_only"):
        refused("no channel named crank_angle", paper.log.measured.drop_vars("crank_angle"), torque)
    millimetres = log.measured.assign(pose=log.measured["pose"] * [1e3, 1e3, 1e3, 1, 1, 1, 1])
    refused(r"the wings meet air at \d+ m/s at t = .*metres", millimetres)
    late = log.measured.assign_coords(time=np.where(log.time > 1.0, log.time + 1.0, log.time))
    refused(r"1 s without a sample after t = 1 s.*cut the log there", late)


def test_repeated_stamps_cost_nothing_and_turning_is_even() -> None:
    """An interval of no length has no force; half way between two attitudes lies Pinocchio's own interpolation."""
    rng = np.random.default_rng(4)
    start, end = (np.array([pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs() for _ in range(20)]) for _ in "ab")
    share = rng.uniform(size=(20, 1))
    for i, found in enumerate(_slerp(start, end, share)):
        a, b = (pin.Quaternion(one[i]).matrix() for one in (start, end))
        expected = a @ pin.exp3(share[i, 0] * pin.log3(a.T @ b))
        np.testing.assert_allclose(pin.Quaternion(found).matrix(), expected, atol=1e-9)
    scenario = load_scenario("paper", ["simulation.duration=0.02"])
    log, robot = simulate(scenario), flown_robot(scenario)
    twice = np.sort(np.append(np.arange(21), 10))
    measured = log.measured.drop_dims("interval").isel(time=twice)
    inputs = known_inputs(FlightLog(measured), robot, "none")
    once = known_inputs(FlightLog(log.measured.drop_dims("interval")), robot, "none")
    assert not np.any(inputs.known["aerodynamic"][10])
    np.testing.assert_allclose(np.delete(inputs.known["aerodynamic"], 10, axis=0), once.known["aerodynamic"], atol=1e-6)


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
    wind = {"wind_x": 0.3 - t, "wind_y": 0.2 * t, "wind_z": 0 * t}
    return table.assign(crank_rate=30.0 + t, crank_torque=0.01 + 0.02 * t, **wind)


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


HEADER = ("time [s]", "x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw", "crank_angle [rad]", "airspeed [m/s]")


@pytest.fixture
def hall(paper: Experiment, tmp_path: Path) -> Path:
    """Write what a hall records of the first 0.4 s of the paper's flight, with the thrusters' known wrench, as CSV."""
    log, count = paper.log.measured, 401
    thrust = log["known_thrusters"].values[:, :6]
    ends = np.vstack([thrust[:1], 0.5 * (thrust[1:] + thrust[:-1]), thrust[-1:]])[:count]
    columns = [log.time[:count], log["q"].values[:count, :7], log["crank_angle"][:count], log["airspeed"][:count], ends]
    pd.DataFrame(np.column_stack(columns), columns=[*HEADER, *THRUST]).to_csv(tmp_path / "hall.csv", index=False)
    return tmp_path / "hall.csv"


@pytest.mark.usefixtures("unrendered")
def test_a_simulated_log_gives_again_what_its_run_gave(paper: Experiment, tmp_path: Path) -> None:
    """Belief from the log's own notes; the same forces to the last bit, scored against the truth that is there."""
    paper.log.save(tmp_path / "flight.nc")
    done = commands.aerobat("estimate", "flight.nc", "--set", "observers.gain=2000", "--out", "found", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = xr.load_dataset(tmp_path / "found" / "estimate.nc", engine="h5netcdf")
    for name, estimate in paper.estimates.items():
        np.testing.assert_array_equal(found["force_W"].sel(observer=name).values, estimate.force)
    metrics = json.loads((tmp_path / "found" / "metrics.json").read_text())
    assert metrics["observers"] == paper.metrics["observers"]
    names = {path.relative_to(tmp_path / "found").as_posix() for path in (tmp_path / "found").rglob("*.*")}
    pages = {"report.html", "replay.html", "figures/estimation.png", "figures/estimation.pdf", "figures/states.png"}
    assert names >= {"belief.toml", "estimate.nc", "estimate.csv", "metrics.json", *pages}


def test_python_opens_a_run_as_any_other_record(paper: Experiment, tmp_path: Path) -> None:
    """The same road as the command's: folder or log without a map, forces to the last bit, scored against the truth."""
    paper.log.save(tmp_path / "flight.nc")
    with pytest.raises(LogError, match=r"not the folder of a run: scenario\.toml"):
        open_record(tmp_path)
    (tmp_path / "scenario.toml").write_text(scenario_toml(paper.scenario))
    assert repr(open_record(tmp_path)) == f"{tmp_path}: aerobat_guard, 0.09213 kg; 2 s in one part at 1000 Hz"
    for place in (tmp_path, tmp_path / "flight.nc"):
        result = aerobat_pin.estimate(open_record(place), ["force_level"])
        scores = result.metrics()["observers"]["force_level"]
        if place == tmp_path:  # the gain of the scenario, which the log alone does not know
            np.testing.assert_array_equal(result.estimates["force_level"].force, paper.estimates["force_level"].force)
            assert scores["left"] == paper.metrics["observers"]["force_level"]["left"]
        assert scores["right"]["Fz"]["r2"] > 0.99
    with pytest.deprecated_call(match="aerobat_pin.aerobat.open_record now"):
        assert records.open_record is open_record
    (tmp_path / "arm.csv").write_text("time,a,b\n0,1,2\n")
    with pytest.raises(LogError, match="a map says what its columns mean"):
        open_record(tmp_path / "arm.csv")


def test_a_sample_meets_its_air_once(paper: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """By all observers and all checks together: it is what costs most of a sample."""
    flown: list[int] = []

    def counted(robot: Aerobat, air: AirSection, moved: Motion) -> dict[str, Array]:
        flown.append(len(moved.time))
        return reconstructed_air(robot, air, moved)

    monkeypatch.setattr(robot_of_records, "reconstructed_air", counted)
    estimate_flight(paper.log, paper.robot, paper.scenario)
    assert flown == [len(paper.log.time)]


@pytest.mark.usefixtures("unrendered")
def test_a_table_from_a_hall_gives_forces_and_says_what_it_cannot(hall: Path, paper: Experiment) -> None:
    """Poses, crank, airspeed and thrust: no torque, so the squeeze is named, and what is seen is right."""
    folder = hall.parent
    words = ["--set", "robot.changes={wing={offset_x=-0.06}}", "--set", "observers.gain=500"]
    done = commands.aerobat(
        "estimate", "hall.csv", "--morphology", "aerobat_guard", *words, "--out", "found", cwd=folder
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("believed: aerobat_guard with changes, 92.1 g, from --morphology\n")
    assert "cannot be seen at all: equal and opposite along the line" in done.stdout
    for line in ("q reconstructed", "aerodynamic reconstructed", "thrusters measured"):
        assert line in done.stdout
    table = pd.read_csv(folder / "found" / "estimate.csv")
    assert [*table][:3] == ["start [s]", "end [s]", "momentum.left_force_point.Fx [N]"]
    left, right = (table[f"force_level.{side}_force_point.Fz [N]"].to_numpy() for side in ("left", "right"))
    truth = paper.log.truth["force_noise_free_W"].values[:400].sum(axis=1)[:, 2]
    settled = slice(20, None)  # the first derivative of a pose is one-sided
    assert np.corrcoef((left + right)[settled], truth[settled])[0, 1] > 0.99
    metrics = json.loads((folder / "found" / "metrics.json").read_text())
    assert metrics["torque"] == "none"
    assert metrics["observers"]["force_level"]["rank"] == 5
    assert metrics["seed"] is None


@pytest.mark.parametrize(
    ("noted", "robot", "settings", "told"),
    [
        (False, None, [], "aerobat, 42.1 g, by default; --morphology chooses another"),
        (False, "aerobat_guard", [], "aerobat_guard, 92.1 g, from --morphology"),
        (False, None, ["robot.morphology=aerobat_light"], "aerobat_light, 20.0 g, from --set"),
        (True, None, [], "aerobat_guard with changes, 92.1 g, noted in the log"),
        (True, "aerobat_guard", [], "aerobat_guard, 92.1 g, from --morphology"),
        (True, None, ["robot.changes.body.mass=0.07"], "aerobat_guard with changes, 80.8 g, noted in the log"),
    ],
)
def test_the_believed_robot_is_named(noted: bool, robot: Any, settings: list, told: str, paper: Experiment) -> None:
    """A robot of another mass makes other forces: nobody is to believe one without knowing."""
    belief = belief_about(paper.log if noted else None, "x", robot, [], settings)
    assert describe_belief(belief, robot, settings) == f"believed: {told}"


@pytest.mark.parametrize(
    ("stem", "name"), [("flight 3 (wind)", "flight_3_wind_"), ("_x", "x"), ("Flügel", "Fl_gel"), ("ü", "flight")]
)
def test_a_log_may_have_any_name(stem: str, name: str) -> None:
    """As a copy of a scenario, the belief is called what a scenario can be called."""
    assert belief_about(None, stem, None, [], []).name == name


def test_a_robot_of_ones_own_is_believed_as_the_run_copied_it(paper: Experiment, tmp_path: Path) -> None:
    """Not as its file is by now, nor where it is; a shipped robot is never a file beside the log."""
    for name, noted in (("own", "wings/bird.toml"), ("shipped", "aerobat_guard")):
        FlightLog(paper.log.measured.assign_attrs(morphology=noted)).save(tmp_path / f"{name}.nc")
    (tmp_path / "morphology.toml").write_text('extends = "aerobat_guard"\nname = "bird"\n[body]\nmass = 0.09\n')
    own, shipped = (belief_about(read_log(tmp_path / f"{name}.nc"), name, None, [], []) for name in ("own", "shipped"))
    assert load_morphology(own.robot.morphology).body.mass == 0.09
    assert shipped.robot.morphology == "aerobat_guard"


@pytest.mark.parametrize("key", ["flight.velocity", "simulation.seed", "sensors.gyro.noise", "believed.air", "name"])
def test_what_no_estimate_would_heed_cannot_be_set(key: str) -> None:
    """The message names the key and what may be set; gravity may, for the believed robot falls by it."""
    said = f"'{key}' does not belong .* keys of robot, air, observers, and flight.gravity"
    with pytest.raises(ScenarioError, match=said):
        belief_about(None, "x", None, [], [f"{key}=1"])
    assert belief_about(None, "x", None, [], ["flight.gravity=1.62"]).flight.gravity == 1.62


def test_a_known_force_is_found_where_it_acts(tmp_path: Path) -> None:
    """`--self-check` without a log: a tenth of the weight, at both wings, along every world axis."""
    done = commands.aerobat(
        "estimate", "--self-check", "--morphology", "aerobat_light", "--observer", "momentum", cwd=tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("ok   momentum: +0.0196 N") == 6
    assert done.stdout.endswith("self-check: sign, frame and unit are right\n")
    assert list(tmp_path.iterdir()) == []
    slow = commands.aerobat("estimate", "--self-check", "--set", "observers.gain=50", cwd=tmp_path)
    assert slow.returncode == 1
    assert "self-check: FAILED for momentum, whose forces lag behind wings that turn" in slow.stdout


def test_a_wrong_sign_frame_or_unit_does_not_pass() -> None:
    """Minus the force, the force in another axis or at the other point, grams for newtons."""
    good = Check("momentum", "left", "y", 0.1, (0.0, 0.1, 0.0), 0.0)
    assert good.ok
    wrong = [((0.0, -0.1, 0.0), 0.0), ((0.1, 0.0, 0.0), 0.0), ((0.0, 0.1, 0.0), 0.1), ((0.0, 10.0, 0.0), 0.0)]
    for found, elsewhere in wrong:
        bad = Check("momentum", "left", "y", 0.1, found, elsewhere)
        assert not bad.ok
        assert str(bad).startswith("BAD")


def test_the_self_check_waits_for_slow_observers() -> None:
    """At K = 30 1/s an estimate takes a tenth of a second to rise; it is right then, and not called wrong before."""
    belief = belief_about(None, "slow", "aerobat", ["force_level", "kalman"], ["observers.gain=30"])
    assert all(check.ok for check in self_check(believed_robot(belief), belief))


def test_a_log_that_another_robot_flew_shows_forces(paper: Experiment) -> None:
    """Which a self-check cannot see, as it simulates the belief itself."""
    own = belief_about(FlightLog(paper.log.measured), "x", None, ["force_level"], [])
    heavy = belief_about(paper.log, "x", None, ["force_level"], ["robot.changes.body.mass=0.1"])
    pairs = ((believed_robot(one), one) for one in (own, heavy))
    right, wrong = (estimate_flight(paper.log, *pair).estimates["force_level"].force for pair in pairs)
    weight = (0.1 - 0.0813) * 9.81  # the joint rows know that it does not hang on the wings: part of it shows
    assert 0.3 * weight < np.mean((wrong - right).sum(axis=1)[:, 2]) < weight


def test_it_pushes_with_a_tenth_of_the_weight_that_is_believed() -> None:
    """On the moon as well; where nothing weighs anything there is no tenth of it."""
    moon, space = (belief_about(None, "x", None, ["momentum"], [f"flight.gravity={g}"]) for g in (1.62, 0.0))
    robot = believed_robot(moon)
    checks = self_check(robot, moon)
    assert [check.applied for check in checks] == [pytest.approx(0.162 * robot.mass)] * 6
    assert all(check.ok for check in checks)
    with pytest.raises(ScenarioError, match=r"flight\.gravity = 0"):
        self_check(believed_robot(space), space)


def test_a_pose_that_hides_a_force_is_not_called_a_row_that_is_not_believed() -> None:
    """Of two joints whose rows are both believed a force along the arm leaves nothing; it was the map's fault."""
    hidden = (Check("force_level", "tip", "x", 1.0, (0.0, 0.0, 0.0), 0.0, 0.0, whole) for whole in (True, False))
    assert [str(check).rpartition("at no time: ")[2] for check in hidden] == [
        "the pose hides it",
        "the map believes no row that shows it",
    ]
