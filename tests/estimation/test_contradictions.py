"""A log that contradicts itself is told so, by name and with the measured figure; a good log is not."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from support.bad_logs import CONTRADICTIONS, height_in_millimetres
from support.commands import call

from aerobat_pin.aerobat import Aerobat, AerobatRobot, FlightLog, believed_robot, flight_record, flown_robot, write_csv
from aerobat_pin.control import Controller
from aerobat_pin.estimation import record_findings
from aerobat_pin.estimation.checks.agreement import agreement_findings
from aerobat_pin.experiments.experiment import NO_MAP, Experiment, run_recorded
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.records import Agreement
from aerobat_pin.scenario import AirSection, load_scenario, shipped_scenarios


@pytest.fixture(scope="module")
def recorded() -> FlightLog:
    """Fly `real_log_demo`, with the noise and rounding of its sensors, for 0.6 s."""
    return simulate(load_scenario("real_log_demo", ["simulation.duration=0.6"]))


def warned(log: FlightLog, robot: Aerobat) -> list[str]:
    """Return what the checks of a log warn of; its torques are not compared."""
    found = record_findings(flight_record(log, AerobatRobot.of(robot, AirSection())))
    return [str(one) for one in found if one.verdict in ("warning", "refused")]


def kinds(found: list[str]) -> list[str]:
    """Return the kind of each contradiction."""
    return [one.partition(": ")[0] for one in found]


def number(text: str) -> float:
    """Return the first number that stands alone in a text."""
    return float(next(word for word in text.split() if re.fullmatch(r"[\d.]+", word)))


def changed(log: FlightLog, name: str, columns: slice | list[int], values: object) -> FlightLog:
    """Return the log with columns of a channel replaced."""
    measured = log.measured.copy(deep=True)
    measured[name].values[:, columns] = values
    return FlightLog(measured)


@pytest.mark.parametrize("name", sorted(shipped_scenarios()))
def test_no_shipped_flight_contradicts_itself_but_the_one_with_slow_and_late_sensors(name: str) -> None:
    """`noisy_sensors` has a pose of 200 Hz that is 5 ms late, which holding makes 7 ms, and an airspeed of 50 Hz."""
    scenario = load_scenario(name, [] if name == "noisy_sensors" else ["simulation.duration=1.0"])
    pilot = Controller(scenario) if scenario.control is not None else None
    found = warned(simulate(scenario, pilot=pilot), believed_robot(scenario))
    if name != "noisy_sensors":
        assert found == []
        return
    assert [one.split()[2] for one in found] == ["position", "attitude", "airspeed", "attitude", "position"]
    assert kinds(found) == 3 * ["held channel"] + 2 * ["late channel"]
    assert [number(one) for one in found[:3]] == pytest.approx([200.0, 200.0, 50.0], rel=0.03)  # 2 % are lost
    assert [number(one) for one in found[3:]] == pytest.approx([7.1, 7.1], abs=0.6)  # ms


@pytest.mark.parametrize("name", sorted(CONTRADICTIONS))
def test_each_contradiction_is_named(name: str, recorded: FlightLog) -> None:
    """Two variants each, with the noise of real sensors; no other kind of warning comes with them."""
    robot = flown_robot(load_scenario("real_log_demo"))
    for seed in range(2):
        wrong = recorded.measured.copy(deep=True)
        CONTRADICTIONS[name](np.random.default_rng(seed), wrong)
        found = warned(FlightLog(wrong), robot)
        assert name in kinds(found), seed
        # a held channel is also late, by half of its period; wrong joint angles do not follow from their rates either
        joints = {"swapped joints", "joint velocities against positions"} if name == "joints off the linkage" else set()
        assert set(kinds(found)) <= {name, "late channel", *joints}


@pytest.mark.parametrize(
    ("channel", "columns", "pair"),
    [
        ("q", slice(0, 3), "position comes {} ms after velocity"),
        ("q", slice(3, 7), "attitude comes {} ms after gyro"),
        ("v", slice(3, 6), "gyro comes {} ms after attitude"),
        ("v", slice(6, 10), "joint velocities come {} ms after joint positions"),
        ("crank_angle", slice(None), "crank angle comes {} ms after joint positions"),
    ],
)
@pytest.mark.parametrize("late", [1, 12])
def test_a_delay_is_measured_to_a_tenth(channel: str, columns: slice, pair: str, late: int, paper: Experiment) -> None:
    """From one sample of 1 ms on, which costs an R2 of up to 0.1, and with its sign."""
    index = np.maximum(np.arange(len(paper.log.time)) - late, 0)
    measured = paper.log.measured.copy(deep=True)
    values = measured[channel].values
    where = (slice(None), columns) if values.ndim > 1 else slice(None)
    values[where] = values[index][where]
    told = [one for one in warned(FlightLog(measured), paper.robot) if one.startswith("late channel")]
    assert told
    assert [number(one) for one in told] == pytest.approx([late] * len(told), abs=0.1)
    assert pair.format(f"{late:.1f}") in " ".join(told)


def test_the_figures_are_those_of_the_mistake(paper: Experiment) -> None:
    """An elbow 2 deg off is told with 2 deg; a channel of 100 Hz with 100 Hz; z in mm without a velocity with m/s2."""
    log, robot = paper.log, paper.robot
    q = log.measured["q"].values
    (elbow,) = warned(changed(log, "q", [8], q[:, [8]] + np.radians(2.0)), robot)
    assert "left_elbow is 2.00 deg (rms) off" in elbow
    held = warned(changed(log, "q", slice(0, 3), q[np.arange(len(q)) // 10 * 10, :3]), robot)[0]
    assert number(held) == pytest.approx(100.0)
    short = FlightLog(
        log.measured.isel(time=slice(0, 500), interval=slice(0, 499))
    )  # it begins with a rate of exactly 0
    slow = log.measured["v"].values[np.arange(500) // 17 * 17, 3:6]
    assert "held channel" in kinds(warned(changed(short, "v", slice(3, 6), slow), robot))
    poses = log.measured["q"].isel(q_axis=slice(7)).rename(q_axis="pose_axis").copy(deep=True)
    bare = log.measured.drop_vars(["q", "v", "q_axis", "v_axis", "motor_torque", "known_thrusters"]).assign(pose=poses)
    assert warned(FlightLog(bare), robot) == []
    bare["pose"].values[:, 2] *= 1e3
    (moved,) = warned(FlightLog(bare), robot)
    assert kinds([moved]) == ["position against gravity"]
    assert "m/s2 (rms)" in moved


def test_a_rounded_slow_signal_is_not_held(paper: Experiment) -> None:
    """An encoder of 8 bits repeats its angle irregularly, and a channel that stands still repeats it always."""
    crank = np.round(paper.log.measured["crank_angle"].values / 0.0245) * 0.0245
    measured = paper.log.measured.copy(deep=True)
    measured["crank_angle"].values[:] = crank
    measured["airspeed"].values[:] = 3.0
    assert "held channel" not in kinds(warned(FlightLog(measured), paper.robot))


@pytest.mark.usefixtures("unrendered")
def test_warnings_stand_in_all_outputs(recorded: FlightLog, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`aerobat estimate` on a table whose gyro is in deg/s: three places, one text."""
    wrong = changed(recorded, "v", slice(3, 6), recorded.measured["v"].values[:, 3:6] * 180.0 / np.pi)
    write_csv(wrong, here / "hall.csv")
    words = ("estimate", "hall.csv", "--observer", "momentum", "--morphology", "aerobat_guard", "--out", "found")
    assert call(*words) == 0
    text, *more = json.loads((here / "found" / "metrics.json").read_text())["warnings"]
    assert text.startswith("gyro against attitude: in 0.1 s they differ by ")
    assert any(line.startswith("momentum: belief off by about ") for line in more)  # a gyro in deg/s is no force
    assert f"warning: {text}\n" in capsys.readouterr().out
    assert "gyro against attitude" in (here / "found" / "report.html").read_text()


def test_who_has_no_map_is_not_left_with_its_keys(recorded: FlightLog) -> None:
    """Warnings name keys of maps, such as the order of a quaternion, which Aerobat's own logs do not have."""
    scenario = load_scenario("real_log_demo", ['observers.names=["momentum"]'])
    wrong = changed(recorded, "q", slice(3, 6), -recorded.measured["q"].values[:, 3:6])
    for log, times in ((recorded, 0), (wrong, 1)):
        assert [str(one) for one in run_recorded(log, scenario).scores.findings].count(str(NO_MAP)) == times


def test_a_short_or_uneven_log_is_no_reason_to_fail(recorded: FlightLog) -> None:
    """Three samples, repeated stamps, a gap in time, and a height in mm in the rest."""
    robot = flown_robot(load_scenario("real_log_demo"))
    measured = recorded.measured.drop_dims("interval")
    for rows in (np.arange(3), np.arange(9), np.sort(np.append(np.arange(300), 10)), np.r_[0:100, 200:300]):
        assert warned(FlightLog(measured.isel(time=rows)), robot) == []
    wrong = measured.isel(time=np.r_[0:100, 200:300]).copy(deep=True)
    height_in_millimetres(np.random.default_rng(1), wrong)
    assert kinds(warned(FlightLog(wrong), robot)) == ["position against velocity"]


@pytest.mark.parametrize(
    ("seed", "late", "size", "pace", "seconds"),
    [(6, 0.0, 0.05, 0.21, 1), (51, 0.0, 0.05, 0.21, 1), (1, 0.04, 0.5, 1.0, 10)],
)
def test_a_slow_turn_is_no_late_gyro(seed: int, late: float, size: float, pace: float, seconds: int) -> None:
    """It follows from itself at another time about as well: of a second of a quiet flight 105 ms were named."""
    rng, time, alone = np.random.default_rng(seed), np.arange(100 * seconds) / 100.0, np.array([0.0, 0.0, 1.0])
    phase = rng.uniform(0.0, 6.0, 3)[2]
    turned = size / pace * np.sin(pace * time + phase)[:, None] * alone
    turned += 1e-6 * rng.standard_normal((len(time), 3)) * alone
    gyro = size * np.cos(pace * (time - late) + phase)[:, None] * alone + 3e-3 * rng.standard_normal((len(time), 3))
    pair = Agreement("-", ("attitude", "gyro"), time, turned, gyro, "rates", ("x", "y", "z"), "rad", 0.02, "-")
    assert ("late channel" in [one.check for one in agreement_findings(pair)]) == (late > 0.0)
