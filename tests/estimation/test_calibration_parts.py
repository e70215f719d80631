"""What a calibration is made of: the physics of its causes, its file, and what is refused of these and of flights."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from support.calibrated import FreeFlight, believed
from support.mismatch import flown

from aerobat_pin import estimation
from aerobat_pin.aerobat import FlightLog, flight_record
from aerobat_pin.aerobat.air.believed_air import reconstructed_air
from aerobat_pin.aerobat.flight_record import flight_map
from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.aerobat.parameters import carrying, flexed
from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation.calibration.identify import Identified
from aerobat_pin.forces import Contact
from aerobat_pin.records import Parameter, PlainRobot, netcdf_bytes, read_netcdf
from aerobat_pin.scenario import AirSection, ObserverSection


@pytest.fixture(scope="module")
def free() -> FreeFlight:
    """Return a second of free flight, in which quasi-steady air is believed."""
    log, _ = flown("no force", 101, ("simulation.duration=1.0",))
    return believed(log, ['believed.air.model="quasi_steady"'])


@pytest.fixture(scope="module")
def learnt(free: FreeFlight) -> estimation.Calibration:
    """Return what the harmonics of the crank show in it."""
    return estimation.calibrate([free.record()], parameters=[])


def test_a_joint_bends_as_its_spring_and_damper_say(free: FreeFlight) -> None:
    """T b' + b = c tau against its closed form under tau = sin w t, within 2 %; without a lag it is c tau."""
    robot = free.plugged()
    log, w, c, T = free.log, 60.0, 5.0, 0.01
    block = flight_record(log, robot).block(0, 1000)
    middle = 0.5 * (block.time[1:] + block.time[:-1])
    block = replace(block, tau=np.tile(1e-3 * np.sin(w * middle)[:, None], (1, block.tau.shape[1])))
    for values, lag in (((c, c * T), T), ((c, 0.0), 0.0)):
        bent = flexed(block, robot.aerobat, np.array(values)).q - block.q
        true = -1e-3 * c * np.imag(np.exp(1j * w * block.time) / (1.0 + 1j * w * lag))
        apart = bent[100:-1, list(robot.aerobat.idx_q)][:, [1, 3]] - true[100:-1, None]
        assert np.max(np.abs(apart)) < 0.02 * np.max(np.abs(true))


def test_a_joint_bends_in_a_log_whose_time_comes_twice(free: FreeFlight) -> None:
    """And air acts on it, until then as if it came once."""
    robot, at = free.plugged(), [*range(51), *range(50, 101)]
    log = free.log.measured.isel(time=slice(101), interval=slice(100))
    forces = log.drop_dims("time").isel(interval=[*range(51), *range(50, 100)])
    twice = log.drop_dims("interval").isel(time=at).merge(forces)
    air = []
    for measured in (log, twice):
        block = flight_record(FlightLog(measured), robot).block(0, measured.sizes["time"] - 1)
        bent = flexed(block, robot.aerobat, np.array([5.0, 0.0]))
        air.append(reconstructed_air(robot.aerobat, robot.air, Motion.of(bent))["aerodynamic"])
    np.testing.assert_allclose(air[1][:45], air[0][:45], rtol=1e-6, atol=1e-9)
    assert np.all(np.isfinite(air[1]))


@pytest.mark.parametrize("model", ["lifting_line", "quasi_steady"])
def test_all_forces_of_air_grow_with_the_square_of_all_velocities_at_once(model: str, free: FreeFlight) -> None:
    """1.3 times as fast: per flap the state is the same, and so is the force per squared frequency, to 0.1 %."""
    robot, fast = free.plugged(), 1.3
    block = flight_record(free.log, robot).block(0, 600)
    extra = {**block.extra, "crank": block.extra["crank"] * fast ** np.arange(3.0)[:, None]}
    faster = replace(block, time=block.time / fast, v=block.v * fast, extra=extra)
    air = robot.air.model_copy(update={"model": model, "added_mass": 1.0})
    slow_state, fast_state = (robot.condition(one) for one in (block, faster))
    np.testing.assert_allclose(fast_state.values[:, :-1], slow_state.values[:, :-1], rtol=1e-12)
    np.testing.assert_allclose(fast_state.values[:, -1], fast * slow_state.values[:, -1], rtol=1e-12)
    forces = [sum(reconstructed_air(robot.aerobat, air, Motion.of(one)).values()) for one in (block, faster)]
    one, other = (state.reduced(force) for state, force in zip((slow_state, fast_state), forces, strict=True))
    assert np.max(np.abs(other - one)) < 1e-3 * np.max(np.abs(one))


def test_a_point_mass_has_the_inertia_that_pinocchio_gives_it(free: FreeFlight) -> None:
    """Against the sum of two `pin.Inertia`, for a mass that is added and one that is taken away."""
    model, place = free.robot.model, np.array([0.03, 0.01, 0.02])
    point = pin.Inertia(9.2e-3, place, np.zeros((3, 3)))
    loaded = carrying(model, 9.2e-3 * np.array([1.0, *place]))
    np.testing.assert_allclose(loaded.inertias[1].matrix(), (model.inertias[1] + point).matrix(), atol=1e-12)
    emptied = carrying(loaded, -9.2e-3 * np.array([1.0, *place]))
    np.testing.assert_allclose(emptied.inertias[1].matrix(), model.inertias[1].matrix(), atol=1e-12)


def test_trains_of_contacts_are_counted_with_their_spacing(learnt: estimation.Calibration) -> None:
    """Ten contacts, two in each cycle, are one line; five at irregular times are none."""
    time = np.linspace(0.0, 2.0, 2001)
    for onsets, told in ((0.1 + 0.1 * np.arange(10), True), (np.array([0.1, 0.13, 0.4, 0.95, 1.7]), False)):
        watch = estimation.CalibrationWatch(learnt)
        watch._contacts = [Contact("left_force_point", onset, onset, onset + 0.01) for onset in onsets.tolist()]
        watch._turns = [(time, 5.0 * time)]
        words = "10 contacts at left_force_point, one every 0.50 cycles"
        assert any(words in line for line in watch.use().warnings) == told


def test_a_robot_knows_no_causes_unless_it_says_so(free: FreeFlight) -> None:
    assert PlainRobot.suspects(free.plugged()) == {}
    assert set(free.plugged().suspects()) == {"crank_zero", "air_density", "compliance", "payload"}


def test_a_cause_leaves_the_scale_of_thrusters_that_was_learnt(free: FreeFlight) -> None:
    """Else thinner air was 5 % less thrust, too, and was named a payload."""
    robot, block = free.plugged().changed({"thruster_scale": 0.05}), flight_record(free.log, free.plugged()).block(0, 9)
    for cause, group in robot.suspects().items():
        suspected, _ = robot.suspected(cause, np.full(len(group), 1e-3), block)
        assert suspected.thruster_scale == 0.05


def test_a_file_keeps_a_calibration_and_belongs_to_its_belief(free: FreeFlight, tmp_path: Path) -> None:
    """Read again it is the same; another air, robot or torque is refused by name, and so is another file."""
    found = estimation.calibrate([free.record()], parameters=["friction"])
    file = tmp_path / "calibration.nc"
    file.write_bytes(estimation.calibration_bytes(found))
    again = estimation.read_calibration(file)
    assert estimation.calibration_bytes(again) == file.read_bytes()
    assert (again.belief, again.notes, again.records) == (found.belief, found.notes, found.records)
    assert [str(fit) for fit in again.fitted.fits] == [str(fit) for fit in found.fitted.fits]
    for kept, given in (
        (again.series.size, found.series.size),
        (again.detection.bias, found.detection.bias),
        (again.fitted.friction.coulomb, found.fitted.friction.coulomb),
    ):
        np.testing.assert_array_equal(kept, given)
    mine = found.belief

    def other(**change: Any) -> estimation.Belief:
        return estimation.belief_of(flight_map(ObserverSection()), replace(free.plugged(), **change), ())

    mine.refuse_other(other(kind="none", air=free.air.model_copy(update={"wind": (1.0, 0.0, 0.0)})))
    with pytest.raises(CalibrationError, match=r"air\.model = quasi_steady, but lifting_line is believed"):
        mine.refuse_other(other(air=AirSection()))
    with pytest.raises(CalibrationError, match="robot 'aerobat_guard' with other values"):
        mine.refuse_other(replace(mine, fingerprint="0"))
    with pytest.raises(CalibrationError, match=r"observers\.torque = motor_only, but measured is believed"):
        other(kind="motor_only").refuse_other(mine)
    free.log.save(tmp_path / "flight.nc")
    (tmp_path / "text.nc").write_bytes(b"text")
    (tmp_path / "half.nc").write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    for name in ("none.nc", "text.nc", "half.nc", "flight.nc"):
        with pytest.raises(CalibrationError, match=name):
            estimation.read_calibration(tmp_path / name)


@pytest.fixture(scope="module")
def content(learnt: estimation.Calibration, tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Return what the file of a calibration holds, with a mass that was identified."""
    mass = {"mass": Parameter("1", 0.1)}
    told = Identified(mass, np.array([0.1]), np.array([[1e-4]]), True, (1.0, 1.0), (0.1, 0.1), 0.2)
    file = tmp_path_factory.mktemp("whole") / "calibration.nc"
    file.write_bytes(estimation.calibration_bytes(replace(learnt, identified=told)))
    assert estimation.read_calibration(file).changes == {"mass": pytest.approx(0.1)}
    return read_netcdf(file, "calibration")[""]


def reworded(data: xr.Dataset, before: str, after: str) -> xr.Dataset:
    """Return a file's content with other words."""
    words = str(data["words"].values)
    assert before in words
    return data.assign(words=((), words.replace(before, after)))


IDENTIFIED, ENDLESS = "identified.values", "holds a number that is not"


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda data: reworded(data, '"mass": 1.0', '"mass": NaN'), "mass nan: a factor above 0"),
        (lambda data: reworded(data, '"array series.scale"', '"array [1000000000, 4]"'), "has no numbers"),
        (lambda data: reworded(data, '"share": ', '"share": 1e999, "was": '), f"series.share {ENDLESS}"),
        (lambda data: data.assign({IDENTIFIED: data[IDENTIFIED] * 0.0 - 2.0}), "change of -1 or less"),
        (lambda data: data.assign({"series.mean": data["series.mean"] * np.nan}), f"series.mean {ENDLESS} finite"),
        (lambda data: data.isel({"series.mean.0": slice(0, 4)}), r"series.mean has shape \(4, 10\)"),
        (lambda data: data.assign({"series.scale": data["series.scale"] * 0.0}), "units above 0 were expected"),
        (lambda data: data.isel({"detection.bias.0": [0]}), r"detection.bias has shape \(1,\)"),
        (lambda data: data.drop_vars("series.size"), "a part is missing or damaged"),
        (lambda data: reworded(data, '"mass": 1.0', '"moss": 1.0'), "a part is missing or damaged"),
        (lambda data: reworded(data, '"fits": []', '"fits": [{"name": 1}]'), "a part is missing or damaged"),
        (lambda data: data.assign_attrs(kind="other"), "a file that `aerobat calibrate` wrote was expected"),
        (lambda data: data.assign_attrs(kind="aerobat calibration 2"), "an older file: calibrate again"),
        (lambda data: data.assign_attrs(kind="aerobat calibration 99"), "a newer file: calibrate again, or install"),
    ],
)
def test_a_forged_file_is_refused(
    damage: Callable[[xr.Dataset], xr.Dataset], message: str, content: xr.Dataset, tmp_path: Path
) -> None:
    """Numbers, shapes, names and parts that no calibration has."""
    file = tmp_path / "calibration.nc"
    file.write_bytes(netcdf_bytes(damage(content)))
    with pytest.raises(CalibrationError, match=message):
        estimation.read_calibration(file)


def test_names_and_short_flights_are_refused(free: FreeFlight) -> None:
    record = free.record()
    with pytest.raises(CalibrationError, match="parameters has 'luck': of mass"):
        estimation.calibrate([record], parameters=["luck"])
    short = FlightLog(free.log.measured.isel(time=slice(0, 301), interval=slice(0, 300)))
    with pytest.raises(CalibrationError, match=r"free: 1\.4 turns of the crank: 3 or more"):
        estimation.calibrate([replace(free, log=short).record()], parameters=[])
    with pytest.raises(CalibrationError, match="no channel named crank_angle"):
        estimation.calibrate(
            [replace(free, log=FlightLog(free.log.measured.drop_vars("crank_angle"))).record()], parameters=[]
        )
    with pytest.raises(CalibrationError, match="harmonics = 99"):
        estimation.calibrate([record], harmonics=99)
    denser = replace(free, air=free.air.model_copy(update={"density": 1.3})).record()
    with pytest.raises(CalibrationError, match=r"air\.density = 1\.225, but 1\.3 is believed"):
        estimation.calibrate([record, denser])
