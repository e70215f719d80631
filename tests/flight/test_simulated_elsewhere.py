"""Another simulator in the plant's place: MuJoCo with the closed linkage, and one that is none of ours."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from support.commands import call
from support.further import further

from aerobat_pin.aerobat import FlightLog, flown_robot
from aerobat_pin.control import AerobatEnv, Controller
from aerobat_pin.errors import ExtraError, ScenarioError, ShapeError, TrimError
from aerobat_pin.experiments import LiveFlight, run
from aerobat_pin.flight import MujocoRobot, SimulatedMotion, find_trim, simulate
from aerobat_pin.scenario import Scenario, load_scenario


def in_both(scenario: Scenario) -> tuple[FlightLog, FlightLog]:
    pilots = [None if scenario.control is None else Controller(scenario) for _ in range(2)]
    ours = simulate(scenario, pilot=pilots[0])
    return ours, simulate(scenario, pilot=pilots[1], simulator=MujocoRobot(flown_robot(scenario)))


def apart(ours: FlightLog, theirs: FlightLog) -> np.ndarray:
    """Return the distance (n,) of two flights [m]."""
    return np.linalg.norm((ours.measured["q"].values - theirs.measured["q"].values)[:, :3], axis=1)


@pytest.mark.parametrize(
    ("name", "most"), [("paper_open_loop", 0.1e-3), *further(("paper", 0.02e-3), ("paper_left", 0.03e-3))]
)
def test_the_papers_flights_are_those_of_an_independent_integrator(name: str, most: float) -> None:
    """A quarter of a second; the crank keeps its angle within 0.05 deg under the loads of the air."""
    pytest.importorskip("mujoco")
    ours, theirs = in_both(load_scenario(name, ["simulation.duration=0.25"]))
    assert apart(ours, theirs)[-1] < most
    cranks = ours.measured["crank_angle"].values - theirs.measured["crank_angle"].values
    assert np.max(np.abs(cranks)) < np.radians(0.05)
    assert np.max(np.abs(cranks)) > 0.0


def test_an_observer_finds_the_forces_in_a_flight_of_mujoco() -> None:
    """The joint torques are those of MuJoCo's constraints; on 0.4 s of `paper` R2 is above 0.995."""
    pytest.importorskip("mujoco")
    scenario = load_scenario("paper", ["simulation.duration=0.4", 'observers.names=["force_level"]'])
    found = run(scenario, simulator=MujocoRobot(flown_robot(scenario)))
    scores = found.metrics["observers"]["force_level"]
    assert min(scores[side][axis]["r2"] for side in ("left", "right") for axis in ("Fx", "Fy", "Fz")) > 0.995


def test_the_controller_flies_the_robot_of_mujoco() -> None:
    """From noisy sensors, by six thrusters: within 0.05 mm rms of our plant."""
    pytest.importorskip("mujoco")
    ours, theirs = in_both(load_scenario("paper_left_closed_loop", ["simulation.duration=0.25"]))
    assert np.sqrt(np.mean(apart(ours, theirs) ** 2)) < 0.05e-3


class Glider:
    """A robot that goes on as it began, whatever pushes."""

    def start(self, q: np.ndarray, v: np.ndarray, crank_angle: float, crank_rate: float) -> None:
        """Keep where it is."""
        self.q, self.v = q.copy(), v.copy()

    def step(self, force: np.ndarray, crank_angle: float, crank_rate: float, dt: float) -> SimulatedMotion:
        """Fly straight on."""
        self.force = force
        self.q = self.q.copy()
        self.q[0] += 3.0 * dt
        return SimulatedMotion(self.q, self.v, crank_angle, crank_rate, np.zeros(4))


def test_any_object_with_two_methods_is_a_simulator() -> None:
    """The log has its motion and its torques, and our forces at it; what it cannot fly is refused."""
    scenario, glider = load_scenario("paper", ["simulation.duration=0.05"]), Glider()
    log = simulate(scenario, simulator=glider)
    np.testing.assert_allclose(log.measured["q"].values[:, 0], 3.0 * log.time, atol=1e-12)
    assert not log.measured["motor_torque"].values.any()
    assert glider.force[2] == pytest.approx(
        sum(log.truth[name].values[-1, 2] for name in ("aerodynamic", "added_mass", "unknown"))
        + log.measured["known_thrusters"].values[-1, 2],
        abs=0.02,
    )
    for setting in ('crank.drive="motor"', "plant.payload.mass=0.001", "plant.elbow.stiffness=0.2"):
        with pytest.raises(ScenarioError, match="a simulator flies it"):
            simulate(load_scenario("paper", ["simulation.duration=0.05", setting]), simulator=glider)
    wrong = Glider()
    wrong.step = lambda *_: SimulatedMotion(wrong.q[:5], wrong.v, 0.0, 0.0, np.zeros(4))  # type: ignore[method-assign]
    with pytest.raises(ShapeError, match=r"SimulatedMotion\.q"):
        simulate(scenario, simulator=wrong)


def test_what_the_scenario_names_flies_everywhere_or_is_refused() -> None:
    """An environment moves in MuJoCo; what cannot says so. Before, both flew our own plant without a word."""
    pytest.importorskip("mujoco")
    named = ["air.strips=4", "air.warm_up_cycles=1", "plant.simulator=mujoco"]
    ours, theirs = (AerobatEnv(settings=settings) for settings in (named[:2], named))
    for env in (ours, theirs):
        env.reset(seed=1)
    apart = np.abs(ours.step(ours.neutral)[0] - theirs.step(theirs.neutral)[0])[:12].max()
    assert 0.0 < apart < 0.05
    with pytest.raises(ScenarioError, match="a simulator flies it"):
        LiveFlight(load_scenario("hover_closed_loop", named))
    with pytest.raises(TrimError, match=r"plant\.simulator"):
        find_trim(load_scenario("paper_open_loop", named))


def test_the_command_line_flies_in_mujoco(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    """`--plant mujoco` writes a run like any other; without the extra, one line says what to install."""
    pytest.importorskip("mujoco")
    words = ["run", "paper", "--plant", "mujoco", "--no-report", "--set", "simulation.duration=0.02"]
    assert call(*words) == 0
    assert (here / "runs" / "paper" / "flight.nc").exists()
    again = ["run", "runs/paper/scenario.toml", "--no-report", "--out", "again"]
    assert call(*again) == 0
    first, second = (json.loads(Path(folder, "metrics.json").read_text()) for folder in ("runs/paper", "again"))
    assert first["observers"] == second["observers"]
    assert first["changed"]["plant.simulator"] == "mujoco"
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraError, match=r"aerobat-pinocchio\[mujoco\]"):
        MujocoRobot(flown_robot(load_scenario("paper")))
