"""Every signal of an unknown force acts with its exact mean over each interval; the paper's on its own clock."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from aerobat_pin.aerobat import true_force
from aerobat_pin.errors import ScenarioError
from aerobat_pin.experiments import run, write
from aerobat_pin.flight import simulate
from aerobat_pin.scenario import Scenario, load_scenario, parse_scenario, scenario_toml
from aerobat_pin.scenario.unknown_forces import PaperForce, tick_means

FRAME = "left_force_point"
UNEVEN = np.cumsum(np.concatenate([[0.0], np.random.default_rng(3).uniform(1e-4, 0.02, 120)]))


def scenario(**force: Any) -> Scenario:
    """Return a scenario with one unknown force on a robot without air."""
    return parse_scenario(
        {
            "name": "one-force",
            "air": {"warm_up_cycles": 0, "strips": 4},
            "unknown_force": [{"frame": FRAME, "axes": "world", **force}],
            "simulation": {"duration": 0.04},
        },
        "test",
    )


def means(edges: np.ndarray, **force: Any) -> np.ndarray:
    [signal] = scenario(**force).unknown_force
    return signal.interval_means(edges, np.random.default_rng(1))[1]


def window(t: float, start: float, duration: float) -> float:
    """Return how much of a push is over, 0..1."""
    return min(max((t - start) / duration, 0.0), 1.0)


# Each signal as it is described, value by time, and where it has corners.
SIGNALS: dict[str, tuple[dict[str, Any], Any, list[float]]] = {
    "step": ({"height": 0.3, "start": 0.31, "end": 0.52}, lambda t: 0.3 * (0.31 < t <= 0.52), [0.31, 0.52]),
    "endless step": ({"height": -0.3, "start": 0.31}, lambda t: -0.3 * (t > 0.31), [0.31]),
    "impulse": (
        {"impulse": 0.02, "start": 0.4, "duration": 0.05},
        lambda t: 0.02 * np.pi / 2.0 / 0.05 * np.sin(np.pi * window(t, 0.4, 0.05)),
        [0.4, 0.45],
    ),
    "boxcar impulse": (
        {"impulse": 0.02, "start": 0.4, "duration": 0.05, "shape": "boxcar"},
        lambda t: 0.4 * (0.4 < t < 0.45),
        [0.4, 0.45],
    ),
    "sine": (
        {"amplitude": 0.2, "frequency": 7.0, "phase_deg": 30.0},
        lambda t: 0.2 * np.sin(2.0 * np.pi * 7.0 * t + np.pi / 6.0),
        [],
    ),
    "one_cosine": (
        {"amplitude": 0.2, "start": 0.2, "duration": 0.4},
        lambda t: 0.1 * (1.0 - np.cos(2.0 * np.pi * window(t, 0.2, 0.4))),
        [0.2, 0.6],
    ),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_an_interval_sees_the_mean_of_the_signal(name: str) -> None:
    """Against numerical integration of the signal as described, on uneven intervals of 0.1 to 20 ms."""
    values, force, corners = SIGNALS[name]
    found = means(UNEVEN, signal=name.split()[-1], **values)
    for k in range(len(found)):
        start, end = UNEVEN[k], UNEVEN[k + 1]
        edges = [start, *(corner for corner in corners if start < corner < end), end]
        whole = sum(quad(force, a, b)[0] for a, b in itertools.pairwise(edges))
        assert found[k] == pytest.approx(whole / (end - start), abs=1e-9)


def test_an_impulse_is_complete_however_short_against_the_step() -> None:
    """2 mN s within 0.1 ms, seen by steps of 5 ms: not one newton second is lost."""
    edges = np.linspace(0.0, 1.0, 201)
    for shape in ("half_sine", "boxcar"):
        push = means(edges, signal="impulse", impulse=2e-3, start=0.5024, duration=1e-4, shape=shape)
        assert push @ np.diff(edges) == pytest.approx(2e-3, rel=1e-12)
        assert np.count_nonzero(np.abs(push) > 1e-9) == 1


def series(path: Path, text: str = "time [s], force [N], other\n0.1, 0.0, 1\n0.2, 0.4, 1\n0.5, -0.2, 1\n") -> str:
    path.write_text(text)
    return str(path)


def test_a_recorded_series_is_straight_between_its_samples_and_nothing_outside(tmp_path: Path) -> None:
    file = series(tmp_path / "push.csv")
    fine = np.linspace(0.0, 0.8, 80_001)
    middle = 0.5 * (fine[1:] + fine[:-1])
    polygon = np.interp(middle, [0.1, 0.2, 0.5], [0.0, 0.4, -0.2], right=0.0)
    edges = fine[::1000]
    expected = polygon.reshape(len(edges) - 1, -1).mean(axis=1)
    assert means(edges, signal="recorded", file=file) == pytest.approx(expected, abs=1e-9)
    other = means(np.array([0.0, 0.1, 0.5, 1.0]), signal="recorded", file=file, column="other")
    assert other == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "there is no such file"),
        ("", "cannot be read as CSV"),
        ("time, push\n0, 1\n1, 2\n", "no column named 'force'; its header has time, push"),
        ("time [s], force [mN]\n0, 1\n1, 2\n", r"force \[mN\]: N was expected"),
        ("time [ms], force [N]\n0, 1\n1, 2\n", r"time \[ms\]: s was expected"),
        ("time, force\n0, 1\n", "two rows or more"),
        ("time, force\n0, 1\n0, 2\n", "rising times"),
        ("time, force\n0, 1\n1, nan\n", "line 3: force = nan: a finite number was expected"),
        ("time, force\n0, 1\n1, much\n", "line 3: force = much: a finite number was expected"),
        ("time, force\n0, 1\n\n1\n", "line 4: force = nan: a finite number was expected"),
        ("time, force\n0, 1, 2\n1, 2, 3\n", "cannot be read as CSV: Length of header"),
    ],
)
def test_a_file_that_is_no_series_is_refused(tmp_path: Path, text: str | None, message: str) -> None:
    """One message with the file's name, before anything flies."""
    file = str(tmp_path / "push.csv") if text is None else series(tmp_path / "push.csv", text)
    with pytest.raises(ScenarioError, match=f"push.csv.*{message}"):
        simulate(scenario(signal="recorded", file=file))


def test_every_signal_may_carry_noise_of_its_own_stream() -> None:
    """The same noise as the paper's signal at the same place in the list: 5 standard errors; held however long."""
    edges = np.arange(20_001) * 1e-3
    [noisy] = scenario(signal="sine", noise=0.03).unknown_force
    [papers] = scenario(noise=0.03).unknown_force
    drawn = noisy.interval_means(edges, np.random.default_rng(5))[0]
    assert drawn.std() == pytest.approx(0.03, rel=5.0 / np.sqrt(4e4))
    np.testing.assert_array_equal(drawn, papers.interval_means(edges, np.random.default_rng(5))[0])
    [held] = scenario(noise=0.03, tick=1e9).unknown_force
    whole = held.interval_means(edges, np.random.default_rng(5))[0]
    np.testing.assert_allclose(whole, 0.03 * np.random.default_rng(5).standard_normal(), rtol=1e-9)


def test_all_signals_survive_writing_and_reading(tmp_path: Path) -> None:
    """Every kind in one scenario, through TOML; a table without `signal` is the paper's."""
    forces = [{"frame": FRAME, "signal": name.split()[-1], **values} for name, (values, _, _) in SIGNALS.items()]
    forces += [{"frame": FRAME}, {"frame": FRAME, "signal": "recorded", "file": series(tmp_path / "push.csv")}]
    given = parse_scenario({"name": "all", "unknown_force": forces}, "test")
    assert [force.signal for force in given.unknown_force][-2:] == ["paper", "recorded"]
    (tmp_path / "all.toml").write_text(scenario_toml(given))
    assert load_scenario(tmp_path / "all.toml") == given


def test_a_recorded_series_is_found_beside_its_scenario_and_travels_with_the_results(tmp_path: Path) -> None:
    """As a morphology does: the results hold a copy and run again without the original."""
    mine = tmp_path / "mine"
    mine.mkdir()
    series(mine / "push.csv", "time,force\n0,0.0\n0.01,0.1\n")
    (mine / "flight.toml").write_text(
        f'name = "flight"\n[simulation]\nduration = 0.01\n[air]\nwarm_up_cycles = 0\n[[unknown_force]]\n'
        f'frame = "{FRAME}"\nsignal = "recorded"\nfile = "push.csv"\n'
    )
    first = run(load_scenario(mine / "flight.toml"))
    out = tmp_path / "out"
    out.mkdir()
    write(first, out)
    (mine / "push.csv").unlink()
    again = run(load_scenario(out / "scenario.toml"))
    assert again.metrics == first.metrics
    assert np.ptp(true_force(again.log, FRAME)[0]) > 0.05


SIGNAL = PaperForce(frame="left_force_point")


def clock(duration: float, dt: float = 1e-3) -> np.ndarray:
    """Return the edges of equal intervals from 0 [s]."""
    return np.arange(round(duration / dt) + 1) * dt


def test_the_step_is_on_for_more_than_1_s_up_to_1_6_s() -> None:
    """Section III-A: plus 0.15 N while 1 s < t <= 1.6 s; sampled on the 1 ms clock that means ticks 1001 to 1600."""
    _, step = SIGNAL.interval_means(clock(2.0), np.random.default_rng(1))
    tick = np.arange(2000)
    assert step == pytest.approx(np.where((tick > 1000) & (tick <= 1600), 0.15, 0.0), abs=1e-12)


def test_the_noise_is_a_hundredth_of_a_newton_and_the_seeds_alone() -> None:
    """Section III-A: N(0, 0.01^2), white, within five standard errors; equal seeds give equal noise, two forces not."""
    edges = clock(20.0)
    one, again = (SIGNAL.interval_means(edges, np.random.default_rng([1, 0]))[0] for _ in range(2))
    other_force = SIGNAL.interval_means(edges, np.random.default_rng([1, 1]))[0]
    other_seed = SIGNAL.interval_means(edges, np.random.default_rng([2, 0]))[0]
    assert np.array_equal(one, again)
    assert one.std() == pytest.approx(0.01, rel=5.0 / np.sqrt(2.0 * len(one)))
    for stranger in (other_force, other_seed, np.roll(one, 1)):
        assert abs(np.corrcoef(one, stranger)[0, 1]) < 5.0 / np.sqrt(len(one))


def test_a_signal_that_is_not_sampled_on_its_ticks_still_covers_the_run() -> None:
    """A run that ends between two ticks draws the last tick as well; an interval across an edge mixes both values."""
    signal = PaperForce(frame="left_force_point", noise=1.0, tick=0.1)
    noise, _ = signal.interval_means(np.array([0.0, 0.05, 0.15, 0.25]), np.random.default_rng(2))
    a, b, c = np.random.default_rng(2).standard_normal(3)
    assert noise == pytest.approx([a, (a + b) / 2.0, (b + c) / 2.0], abs=1e-12)


@settings(max_examples=100, derandomize=True)
@given(st.lists(st.floats(1e-5, 0.02), min_size=1, max_size=60), st.integers(0, 2**32 - 1))
def test_averaging_conserves_the_impulse(intervals: list[float], seed: int) -> None:
    """Means times lengths add up to the integral of the held series, on any intervals; no mean leaves its range."""
    edges = np.concatenate([[0.0], np.cumsum(intervals)])
    ticks = int(np.ceil(edges[-1] / 1e-3))
    values = np.random.default_rng(seed).normal(size=ticks)
    means = tick_means(values, 1e-3, edges)
    whole = int(edges[-1] / 1e-3 + 1e-9)
    integral = values[:whole].sum() * 1e-3
    if whole < ticks:
        integral += values[whole] * (edges[-1] - whole * 1e-3)
    assert means @ np.diff(edges) == pytest.approx(integral, abs=1e-12)
    assert values.min() - 1e-9 < means.min()
    assert means.max() < values.max() + 1e-9


def test_a_later_window_draws_its_own_noise_only() -> None:
    """Ten minutes into a flight, 50 intervals take 50 random numbers, and the signal is that of the whole record."""
    late = SIGNAL.model_copy(update={"step_start": 600.01, "step_end": 600.03})
    edges = clock(600.05)
    rng, same = np.random.default_rng(1), np.random.default_rng(1)
    _, step = late.interval_means(edges[-51:], rng)
    same.standard_normal(50)
    assert rng.random() == same.random()
    np.testing.assert_allclose(step, late.interval_means(edges, rng)[1][-50:], rtol=0.0, atol=1e-9)
    assert step.max() == pytest.approx(SIGNAL.step)
