"""Flights that several test files look at, flown once; and the seed of the random order in which tests run."""

import fcntl
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from support.browser import opened, ready, started
from support.shipped import flown

from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.experiments import Experiment, write
from aerobat_pin.flight import Plant
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import style, write_figures_and_pages

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # in the background, under nohup
    signal.signal(signal.SIGINT, lambda *_: None)  # tests ignore Ctrl-C further on, the programs that they start do not

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # the hundreds of programs that tests start would compile every source
sys.dont_write_bytecode = False

LONGEST = (  # ten seconds and more of a slow machine
    "site tutorials strange_arm play types sweep_interrupted calibration bad_inputs planted_mistakes live_page "
    "raw_sensors explained_efforts files map_calibration wheel every_robot misread flights flying_arm replay stream "
    "moving_page recordings shipped_scenarios simulated_elsewhere docs jit legs closed_loop house "
    "ros_node aerobat_logs flight_log mistakes sensed live pages flapping_wing describe estimate_recordings maps "
    "locate linkage_pages sweep cli kalman links logs_as_left"
).split()

settings.register_profile("untimed", deadline=None)  # a busy machine is no failure
settings.load_profile("untimed")


@pytest.fixture(scope="session", autouse=True)
def optimized_programs() -> None:
    """Let `PYTHONOPTIMIZE=2 make test` hold for the programs that tests start; pytest itself needs its asserts."""
    if level := os.environ.get("PROGRAMS_PYTHONOPTIMIZE"):
        os.environ["PYTHONOPTIMIZE"] = level


@pytest.fixture(scope="session")
def paper() -> Experiment:
    """Return the paper's experiment, two seconds, seed 1."""
    return flown("paper")


@pytest.fixture(scope="session")
def paper_folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of all that `aerobat run paper` writes, one for all processes: tests write nothing into it."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    target, half = shared / "of_paper", shared / "of_paper_half"
    with (shared / "of_paper.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not target.exists():
            paper = request.getfixturevalue("paper")
            shutil.rmtree(half, ignore_errors=True)
            half.mkdir()
            write(paper, half)
            write_figures_and_pages(paper, half)
            half.rename(target)
    return target


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    with started() as running:
        yield running


@contextmanager
def papers_replay(folder: Path, browser: Any) -> Iterator[Any]:
    with opened(browser, (folder / "replay.html").as_uri()) as replay:
        ready(replay)
        yield replay


@pytest.fixture
def page(paper_folder: Path, browser: Any) -> Iterator[Any]:
    """Return the replay of the paper's flight, open in the browser and ready, for a test that uses its controls."""
    with papers_replay(paper_folder, browser) as replay:
        yield replay


@pytest.fixture(scope="module")
def shown(paper_folder: Path, browser: Any) -> Iterator[Any]:
    """Return the same replay for all tests of a file that only look at it, at times of their own."""
    with papers_replay(paper_folder, browser) as replay:
        yield replay


@pytest.fixture(scope="session")
def paper_plant() -> Plant:
    scenario = load_scenario("paper")
    return Plant(load_aerobat(scenario.robot.morphology, scenario.robot.changes), scenario)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lay figures out, but save empty files: rendering takes six seconds of a processor for each folder of results."""
    monkeypatch.setattr(style, "_rendered", lambda figure: {"png": b"", "pdf": b""})


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, so that no process is busy with one long after the others have ended."""
    places = {f"test_{name}": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.stem, len(places)))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how to run the tests in the same order again."""
    seed = config.getoption("randomly_seed", None)
    if seed is not None:
        terminalreporter.write_line(f"random order: --randomly-seed={seed} repeats it, -p no:randomly keeps the files'")
