"""Samples that cannot be used, and what the controller says of its flight."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands import aerobat
from support.further import further

from aerobat_pin.aerobat import flown_robot
from aerobat_pin.control import FAILED, Controller
from aerobat_pin.control.monitor import AT_LIMITS, Monitor
from aerobat_pin.control.sensed_channels import CHANNELS
from aerobat_pin.errors import ShapeError, SimulationError
from aerobat_pin.flight import ClosedLoop, Plant, simulate
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import load_scenario

COLUMNS: dict[str, tuple[int, slice]] = {  # of q, v and crank angle
    **{
        "position": (0, slice(0, 3)),
        "attitude": (0, slice(3, 7)),
        "velocity": (1, slice(0, 3)),
        "gyro": (1, slice(3, 6)),
    },
    **{"joint_angle": (0, slice(7, 11)), "joint_rate": (1, slice(6, 10)), "crank_angle": (2, slice(0, 1))},
}
FIRST, APART = 200, 120  # sample of the first fault; from one channel's to the next one's
Spoiling = Callable[[Array, Array], Array]  # (sample, the one before) -> what is shown
KINDS: dict[str, Spoiling] = {
    "NaN": lambda now, _: np.full_like(now, np.nan),
    "infinite": lambda now, _: np.full_like(now, np.inf),
    "zero": lambda now, _: np.zeros_like(now),
    "held": lambda _, before: before,
    "swapped": lambda now, _: np.roll(now, 1) if len(now) > 1 else -now,
}


def flown(
    settings: list[str], spoil: Callable[[int, str, Array, Array], Array] | None = None
) -> tuple[Array, Controller]:
    """Fly, with the samples of each channel changed by a function of sample, channel, value, and value before."""
    scenario = load_scenario("paper_left_closed_loop", ["simulation.duration=1.1", "air.strips=8", *settings])
    pilot = Controller(scenario)
    loop, shown = ClosedLoop(Plant(flown_robot(scenario), scenario), pilot), {}
    command = pilot.command

    def spoiled(time: float, q: Array, v: Array, crank_angle: float) -> Array:
        tables = [q.copy(), v.copy(), np.array([crank_angle])]
        for name, (table, columns) in COLUMNS.items():
            values = tables[table][columns]
            values[:] = shown[name] = np.array(spoil(loop.done, name, values.copy(), shown.get(name, values.copy())))
        return command(time, tables[0], tables[1], float(tables[2][0]))

    if spoil is not None:
        pilot.command = spoiled  # type: ignore[method-assign]
    try:
        return loop.fly(scenario.simulation.count).q, pilot
    except SimulationError as error:
        kept: Any = error.kept
        return kept.q, pilot


@pytest.fixture(scope="module")
def undisturbed() -> Array:
    return flown([])[0]


@pytest.mark.parametrize(
    ("kind", "length"),
    [
        *[("NaN", 1), ("NaN", 50), ("zero", 50), ("held", 50), ("swapped", 1), ("swapped", 50)],
        *further(("infinite", 1), ("infinite", 50), ("zero", 1), ("held", 1)),
    ],
)
def test_bad_samples_of_any_channel_hardly_matter_and_are_counted(kind: str, length: int, undisturbed: Array) -> None:
    """Channels in turn in one flight: within 10 mm of the flight without; 50 ms of swapped axes of velocity alone."""
    flights: list[tuple[str, ...]] = [CHANNELS]
    if (kind, length) == ("swapped", 50):
        flights = [("velocity",), tuple(name for name in CHANNELS if name != "velocity")]
    for spoilt in flights:

        def spoil(k: int, name: str, now: Array, before: Array, spoilt: tuple[str, ...] = spoilt) -> Array:
            begun = FIRST + APART * CHANNELS.index(name)
            return KINDS[kind](now, before) if name in spoilt and begun <= k < begun + length else now

        q, pilot = flown([], spoil)
        assert np.linalg.norm(q[:, :3] - undisturbed[:, :3], axis=1).max() < 0.010
        state = pilot.state
        for name in spoilt:
            if name == "gyro" and kind in ("zero", "swapped") and length == 1:
                continue  # rates that are nearly alike, or nearly zero: nothing to be noticed, and nothing that matters
            least = 15 if (name, kind) == ("gyro", "swapped") else int(0.9 * length)
            assert sum(state.unused.get(name, {}).values()) >= least, (name, state.unused)
        assert state.word not in FAILED


def test_a_blow_is_not_taken_for_bad_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wing is hit by 50 mN s: within 1 mm of no check of the gyro, no sample bad; the first jump waits 1 ms."""
    hit = 'unknown_force=[{frame="left_force_point", signal="impulse", impulse=0.05, start=0.3, direction=[0, 0, -1]}]'
    short = ["simulation.duration=0.6", "simulation.seed=5", hit]
    checked, pilot = flown(short)
    assert pilot.state.unused == {}
    for name in ("SLACK", "UNKNOWN_SPIN"):
        monkeypatch.setattr(f"aerobat_pin.control.sensed.{name}", np.inf)
    monkeypatch.setattr("aerobat_pin.control.sensed.REACH", dict.fromkeys(CHANNELS, (np.inf, 0.0, 0.0)))
    free, _ = flown(short)
    assert np.abs(free[-1, :3] - [1.8, 0.0, 0.0]).max() > 0.03
    assert np.linalg.norm(checked[:, :3] - free[:, :3], axis=1).max() < 1e-3


@pytest.mark.parametrize("channel", CHANNELS)
def test_a_channel_that_stays_silent_is_lost_after_a_quarter_of_a_second(channel: str) -> None:
    """NaN for ever; the law flies on with what it has."""
    q, pilot = flown(
        ["simulation.duration=0.5"], lambda k, name, now, _: now * np.nan if name == channel and k > 200 else now
    )
    assert pilot.state.line == f"LOST at {pilot.state.since:.3f} s: no good sample of {channel} for 0.25 s"
    assert pilot.state.since == pytest.approx(0.451, abs=0.003)
    assert np.isfinite(q).all()


def test_a_dead_thruster_is_said_within_half_a_second_of_being_lost() -> None:
    """Without thruster 3 the robot cannot fly; it says so as soon as it is tilted by 60 degrees or 1 m off."""
    q, pilot = flown(["simulation.duration=2.0", "thrusters.fault={thruster=3, start=0.3}"])
    upright = 1.0 - 2.0 * (q[:, 3] ** 2 + q[:, 4] ** 2)
    off = np.linalg.norm(q[:, :3] - [[3e-3 * k, 0.0, 0.0] for k in range(len(q))], axis=1)
    lost = 1e-3 * np.flatnonzero((upright < 0.5) | (off > 1.0))[0]
    assert pilot.state.word == "LOST"
    assert lost - 0.02 < pilot.state.since < lost + 0.5


def test_late_poses_are_carried_to_now() -> None:
    """Position, attitude and velocity at 100 Hz, 10 ms late: 3 m/s times 10 to 20 ms would be 30 to 60 mm."""
    poses = [f"sensors.{name}={{rate=100.0, delay=0.01}}" for name in ("position", "attitude", "velocity")]
    late, pilot = flown([*poses, "unknown_force=[]"])
    off = late[:, :3] - [[3e-3 * k, 0.0, 0.0] for k in range(len(late))]
    assert np.sqrt(np.mean(off[:, 1] ** 2)) < 0.006
    assert np.abs(off[:, 0]).max() < 0.02
    assert pilot.state.word == "OK"


def test_a_delay_that_is_no_whole_number_of_samples_is_believed_as_it_flies() -> None:
    """10.4 ms are shown at the eleventh sample; before, the tenth was believed, 2 mm off the course and DEGRADED."""
    names = ("position", "attitude", "velocity", "gyro")
    late = [[f"sensors.{name}.delay={delay}" for name in names] for delay in (0.0104, 0.011)]
    odd, even = (flown(["unknown_force=[]", *one]) for one in late)
    np.testing.assert_array_equal(odd[0], even[0])
    assert odd[1].state.word == "OK"


def test_the_word_of_a_flight_is_that_of_its_worst_window() -> None:
    """Swings of 10 degrees that stay; swings that halve each window; commands at a limit; nothing."""
    pilot = Controller(load_scenario("hover_closed_loop", ["air.strips=4"]))
    time, limit = 1e-3 * np.arange(2000), pilot.thrusters.limit
    for size, at_limit, word in ((0.2, 0.0, "UNSTABLE"), (0.0, 2.0 * AT_LIMITS, "SATURATED"), (0.0, 0.0, "OK")):
        monitor = Monitor(limit, 1e-3, pilot.sensed)
        pilot.sensed.restart()
        pilot.sensed.q[:] = pilot._robot.q0
        for t in time:
            pilot.sensed.error[:] = [0.0, 0.0, 0.0, size * np.sin(20.0 * t), 0.0, 0.0]
            monitor.take(np.where(np.arange(6) < 6.0 * at_limit, limit, 0.5 * limit), np.zeros(6))
        assert monitor.state.word == word
    monitor.restart()
    for t in time:
        pilot.sensed.error[3] = 0.5 * 0.5 ** (2.0 * t) * np.sin(20.0 * t)
        monitor.take(0.5 * limit, np.zeros(6))
    assert monitor.state.word == "OK"


def test_a_lost_flight_is_a_result_with_exit_code_2(tmp_path: Path) -> None:
    """The word is in the last lines, in the metrics, and among the warnings."""
    short = ("simulation.duration=0.9", "air.strips=4", "thrusters.fault={thruster=3}")
    settings = [word for one in short for word in ("--set", one)]
    done = aerobat("run", "paper_left_closed_loop", *settings, "--observer=momentum", "--no-report", cwd=tmp_path)
    assert done.returncode == 2
    assert "the controller is LOST at 0." in done.stderr.splitlines()[-1]
    metrics = json.loads((tmp_path / "runs/paper_left_closed_loop/metrics.json").read_text())
    assert metrics["control"]["state"] == "LOST"
    assert any("LOST at 0." in line for line in metrics["warnings"])


def test_samples_that_were_not_used_are_said_and_the_flight_is_a_success(tmp_path: Path) -> None:
    """DEGRADED: a velocity twenty times as noisy as is believed, of which more than half is farther off than can be."""
    noisy = ("sensors.velocity.noise=0.1", "believed.sensors.velocity.noise=0.005")
    settings = [word for one in ("simulation.duration=0.2", "air.strips=4", *noisy) for word in ("--set", one)]
    done = aerobat("run", "paper_left_closed_loop", *settings, "--observer=momentum", "--no-report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "control: DEGRADED: samples not used: " in done.stdout
    control = json.loads((tmp_path / "runs/paper_left_closed_loop/metrics.json").read_text())["control"]
    assert (control["state"], control["state_since"]) == ("DEGRADED", 0.0)
    assert control["unused_samples"]["velocity"]["jumped"] > 50


def test_a_violent_tumble_is_a_lost_flight_and_no_runaway_estimate() -> None:
    """30 N on a wing turn the body by hundreds of rad/s: what is sensed stays as large as that, and it flies on."""
    push = ["unknown_force.0.signal=step", "unknown_force.0.height=30.0", "unknown_force.0.start=0.2"]
    scenario = load_scenario("hover_closed_loop", ["simulation.duration=0.5", "air.strips=4", *push])
    pilot = Controller(scenario)
    loop = ClosedLoop(Plant(flown_robot(scenario), scenario), pilot)
    loop.fly(scenario.simulation.count)
    assert pilot.state.word == "LOST"
    assert np.abs(pilot.sensed.v[3:6]).max() < 1e3


def test_a_controller_that_fails_in_flight_ends_it_with_what_was_flown() -> None:
    """From the 21st sample on, its commands cannot be made: 21 samples are kept; at the first one nothing has flown."""
    scenario = load_scenario("hover_closed_loop", ["simulation.duration=0.1", "air.strips=4", "air.warm_up_cycles=1"])
    pilot = Controller(scenario)
    command, fails_at = pilot.command, 20

    def failing(time: float, q: Array, v: Array, crank_angle: float) -> Array:
        if time > (fails_at - 0.5) * scenario.simulation.dt:
            raise ShapeError("command: no such thrust")
        return command(time, q, v, crank_angle)

    pilot.command = failing  # type: ignore[method-assign]
    with pytest.raises(SimulationError, match=r"failed at t = 0\.0200 s: command: no such thrust") as raised:
        simulate(scenario, pilot=pilot)
    kept: Any = raised.value.kept
    assert len(kept.time) == 21
    fails_at = 0
    with pytest.raises(ShapeError, match="no such thrust"):
        simulate(scenario, pilot=pilot)
