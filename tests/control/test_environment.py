"""The gymnasium environment."""

import itertools
import warnings
from typing import Any

import numpy as np
import pytest

from aerobat_pin.control import ENVIRONMENTS, AerobatEnv, Controller
from aerobat_pin.errors import ScenarioError, ShapeError, SimulationError

gymnasium = pytest.importorskip("gymnasium")
COARSE = ["air.strips=8", "simulation.duration=0.3"]
QUICK = ["air.strips=4", "air.warm_up_cycles=1", "simulation.duration=0.1"]


def test_the_checker_of_gymnasium_has_nothing_to_say() -> None:
    """Spaces, seeds, types and shapes; its advice about infinite bounds is none of ours."""
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(AerobatEnv(settings=COARSE), skip_render_check=True)


def test_the_shipped_controller_flies_an_episode() -> None:
    """At 100 Hz, from what the environment shows: it stays on its course until the time is over."""
    env = AerobatEnv(settings=["simulation.duration=1.0", "unknown_force=[]"])
    pilot = Controller(env.scenario)
    seen, info = env.reset(seed=3)
    pilot.begin(0.0, info["q"], info["v"], info["crank_angle"])
    total, steps, terminated, truncated = 0.0, 0, False, False
    while not (terminated or truncated):
        thrust = pilot.command(info["time"], info["q"], info["v"], info["crank_angle"])
        seen, reward, terminated, truncated, info = env.step(2.0 * thrust / pilot.thrusters.limit - 1.0)
        total, steps = total + reward, steps + 1
        assert np.linalg.norm(seen[:3]) < 0.05
    assert (terminated, truncated, steps) == (False, True, 100)
    assert total > 95.0


def test_seeds_decide_the_noise_and_nothing_else_does() -> None:
    """Same seed and actions, same observations to the bit; a fall terminates the episode."""
    env = AerobatEnv(settings=["simulation.duration=2.0", "air.strips=8"])
    episodes = []
    for seed in (5, 5, 6):
        seen = [env.reset(seed=seed)[0]]
        seen += [env.step(env.neutral)[0] for _ in range(10)]
        episodes.append(np.array(seen))
    np.testing.assert_array_equal(episodes[0], episodes[1])
    assert not np.array_equal(episodes[0], episodes[2])
    env.reset(seed=1)
    off = -np.ones(6)
    ends = [env.step(off)[2:4] for _ in range(40)]
    assert not ends[0][0]
    while not (end := env.step(off))[2]:
        assert end[4]["state"] == "OK"
    assert end[4]["state"] == "LOST"


def test_what_an_environment_gives_away_is_not_its_robot() -> None:
    """With exact sensors, q and v in `info` were those of the plant: who wrote into them moved the robot."""
    env, ends = AerobatEnv(settings=[*QUICK, "sensors={}"]), []
    for written in (False, True):
        _, info = env.reset(seed=1)
        for name in ("q", "v"):
            info[name] += 9.0 * written
        ends.append(env.step(env.neutral)[0])
    np.testing.assert_array_equal(*ends)


def test_what_cannot_be_flown_is_refused() -> None:
    """A scenario without thrusters, a step before the start."""
    with pytest.raises(ScenarioError, match="no table control"):
        AerobatEnv("paper")
    env = AerobatEnv(settings=COARSE)
    with pytest.raises(SimulationError, match=r"reset\(\) must come before"):
        env.step(env.neutral)
    env.reset(seed=1)
    for wrong in (np.nan, np.inf):
        with pytest.raises(ShapeError, match="action holds NaN or infinity"):
            env.step(np.append(env.neutral[:5], wrong))


def test_an_episode_that_diverges_ends_with_numbers() -> None:
    """30 N on a wing; before, the last observation and its reward were NaN, which no law learns from."""
    push = 'unknown_force=[{frame="left_force_point", signal="step", height=30.0, start=0.05}]'
    env = AerobatEnv(settings=["simulation.duration=0.3", push])
    env.reset(seed=1)
    seen, reward, fallen = np.zeros(0), 0.0, False
    states = list[dict[str, Any]]()
    while not fallen:
        seen, reward, fallen, _, info = env.step(env.neutral)
        states.append(info)
    assert np.all(np.isfinite(seen))
    assert (reward, info["state"], states[0]["state"]) == (-100.0, "LOST", "OK")
    assert all(one is not other for one, other in itertools.pairwise(states))


def test_starts_wind_and_parameters_are_drawn_anew_at_each_reset() -> None:
    """By the seed; within their limits; the course stays; a reset's own draw counts for that reset."""
    draw = {"flight.roll_deg": (-5.0, 5.0), "air.wind": ((-1.0, -1.0, 0.0), (1.0, 1.0, 0.0))}
    more = {"thrusters.factor": (0.9, 1.1), "air.turbulence.seed": (1, 9)}
    env = AerobatEnv(settings=[*COARSE, "air.turbulence.deviation=[0.1, 0.1, 0.1]"], draw={**draw, **more})
    course = env.scenario
    found = []
    for seed in (1, 2, None, 1):
        seen = [env.reset(seed=seed)[0], env.step(env.neutral)[0]]
        found.append(np.array(seen))
        flown = env._plant.scenario
        assert abs(flown.flight.roll_deg) <= 5.0
        assert 0.9 <= flown.thrusters.factor <= 1.1
        assert np.max(np.abs(flown.air.wind)) <= 1.0
        assert isinstance(flown.air.turbulence.seed, int)
    np.testing.assert_array_equal(found[0], found[3])
    assert len({tuple(seen[0]) for seen in found}) == 3
    assert env.scenario is course
    still = env.reset(seed=1, options={"draw": {}})[0]
    assert abs(still[3]) < 0.03 < abs(env.reset(seed=1, options={"draw": {"flight.roll_deg": (5.0, 5.0)}})[0][3])
    for dt, steps in ((0.02, 15), (0.005, 60)):
        env.reset(seed=1, options={"draw": {"simulation.dt": (dt, dt)}})
        times = [env.step(env.neutral)[4]["time"] for _ in range(steps)]
        np.testing.assert_allclose(times, dt * np.arange(1, steps + 1))
        with pytest.raises(SimulationError, match="the episode is over"):
            env.step(env.neutral)
    huge = {"thrusters.lag": 10**5000}  # which Python does not print
    for wrong in ({"flight.rol_deg": (0.0, 1.0)}, {"thrusters.factor": (-2.0, -1.0)}, {"thrusters.lag": 1.0}, huge):
        with pytest.raises(ScenarioError, match=next(iter(wrong)).split(".")[1]):
            env.reset(options={"draw": wrong})
    with pytest.raises(ScenarioError, match="draw was expected"):
        env.reset(options={"start": 1})


def test_the_crank_is_where_its_sensor_shows_it() -> None:
    """A wrong zero of 0.5 rad is in the observation and in `info`."""
    env = AerobatEnv(settings=[*QUICK, "sensors={crank_angle={bias=0.5}}"])
    seen, info = env.reset(seed=1)
    shown = np.radians(env.scenario.crank.start_deg) + 0.5
    assert info["crank_angle"] == pytest.approx(shown, abs=1e-12)
    np.testing.assert_allclose(seen[12:14], [np.sin(shown), np.cos(shown)], atol=1e-12)


@pytest.mark.parametrize("factor", [1.0, 0.7])
def test_the_neutral_action_makes_the_nominal_lift(factor: float) -> None:
    """Of weak thrusters, too, as their controller's first command does."""
    env = AerobatEnv(settings=[*QUICK, f"thrusters.factor={factor}"])
    nominal = Controller(env.scenario).nominal.wrench
    wrench = factor * env._thrusters.map @ (0.5 * (env.neutral + 1.0) * env._thrusters.limit)
    assert wrench[2] == pytest.approx(nominal[2], rel=0.01)


def test_a_payload_is_carried_once_however_often_something_is_drawn() -> None:
    """The robot weighs the same in each episode."""
    payload = ["plant.payload.mass=0.005", "plant.payload.position=[0.02, 0, 0]"]
    env = AerobatEnv(settings=[*QUICK, *payload], draw={"flight.roll_deg": (-1.0, 1.0)})
    masses = [env._plant.robot.mass]
    for seed in (1, 2, 3):
        env.reset(seed=seed)
        masses.append(env._plant.robot.mass)
    np.testing.assert_allclose(masses, masses[0], rtol=1e-12)


@pytest.mark.parametrize("name", sorted(ENVIRONMENTS))
def test_gymnasium_knows_the_environments_by_name(name: str) -> None:
    """`make` builds the scenario's, with the settings that it is given."""
    env = gymnasium.make(name, settings=["air.strips=8", "simulation.duration=0.05"])
    assert env.unwrapped.scenario.name == ENVIRONMENTS[name]
    seen, _ = env.reset(seed=1)
    assert env.observation_space.contains(seen)
    ends = [env.step(env.unwrapped.neutral)[2:4] for _ in range(5)]
    assert ends == [(False, False)] * 4 + [(False, True)]


def test_environments_in_processes_of_their_own_are_those_of_one_process() -> None:
    """Two at once, with a seed each; observations are equal to the bit."""
    settings = {"settings": ["air.strips=4", "simulation.duration=0.05", "air.warm_up_cycles=1"]}
    many = gymnasium.make_vec("aerobat_pin/Hover-v0", 2, vectorization_mode="async", **settings)
    try:
        seen = [many.reset(seed=[1, 2])[0], many.step(np.zeros((2, 6)))[0]]
    finally:
        many.close()
    for i, seed in enumerate((1, 2)):
        one = gymnasium.make("aerobat_pin/Hover-v0", **settings)
        np.testing.assert_array_equal([one.reset(seed=seed)[0], one.step(np.zeros(6))[0]], [both[i] for both in seen])
