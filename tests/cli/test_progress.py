"""Long work shows itself, with a terminal and without; what the command line does not load, to start quickly."""

import os
import pty
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from aerobat_pin.cli import console, spoken_progress
from aerobat_pin.experiments.experiment import run
from aerobat_pin.numerics import told_of_compilation
from aerobat_pin.numerics.jit import kernels_within
from aerobat_pin.observers.redundancy import low_passed
from aerobat_pin.scenario.scenario import load_scenario


@numba.njit
def halved(x: float) -> float:
    """Return x / 2."""
    return 0.5 * x


@numba.njit
def middle(x: float) -> float:
    """Return x / 4."""
    return float(halved(halved(x)))


@numba.njit(inline="always")
def one() -> float:
    """Return 1, within those that call it."""
    return 1.0


@numba.njit
def outer(x: float) -> float:
    """Return 3 x / 4 + 1."""
    return float(middle(x) + halved(x) + one())


SHORT = ["simulation.duration=0.02", "air.warm_up_cycles=1"]


def test_what_is_compiled_is_told_by_its_name() -> None:
    """Once, when it is compiled; not when it is called again. Kernels of others are not ours to tell."""

    def doubled(x: float) -> float:
        return 2.0 * x

    doubled.__module__ = "aerobat_pin.observers.somewhere"
    told: list[tuple[str, float]] = []
    compiled = numba.njit(doubled)
    with told_of_compilation(lambda *words: told.append(words)):
        assert compiled(2.0) == 4.0
        assert compiled(3.0) == 6.0
    words = "compiling doubled of observers, {} of 1 kernels left, once per installation"
    assert told == [(words.format(1), 0.0), (words.format(0), 1.0)]


def test_kernels_that_are_left_are_counted() -> None:
    """Those that a kernel calls by name and those that they call, each once, when they are compiled; none of others."""
    assert kernels_within(outer) == 3
    told: list[tuple[str, float]] = []
    for each in (halved, middle, outer):
        each.py_func.__module__ = "aerobat_pin.observers.somewhere"
    with told_of_compilation(lambda *words: told.append(words)):
        assert outer(4.0) == 4.0
        assert outer(8.0) == 7.0
    assert [share for _, share in told].count(1.0) == 1
    assert told[-1] == ("compiling outer of observers, 0 of 3 kernels left, once per installation", 1.0)
    unnamed = numba.njit(lambda x: x + 1.0)
    around = numba.njit(lambda x: unnamed(x))
    unnamed.py_func.__module__ = around.py_func.__module__ = "aerobat_pin.observers.somewhere"
    with told_of_compilation(lambda *words: told.append(words)):
        assert around(1.0) == 2.0
    counted = re.findall(r"\d of \d", " ".join(words for words, _ in told))
    assert counted[-3:] == ["1 of 1", "1 of 2", "0 of 2"]


def test_each_observer_is_a_stage_of_its_own() -> None:
    seen: list[tuple[str, float]] = []
    scenario = load_scenario("paper", [*SHORT, 'observers.names=["momentum", "kalman", "smoother"]'])
    run(scenario, lambda label, share: seen.append((label, share)))
    labels = list(dict.fromkeys(label for label, _ in seen))
    assert labels == ["flying", "estimating with momentum", "estimating with kalman", "estimating with smoother"]
    assert all(0.0 <= share <= 1.0 for _, share in seen)


def test_without_a_terminal_slow_work_is_told_in_lines(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A quick command says nothing; no other is silent for two seconds, whatever step of it takes long."""
    clock = [0.0]
    monkeypatch.setattr(spoken_progress.time, "monotonic", lambda: clock[0])
    lines = spoken_progress.Voice()
    flying = [(0.5, "flying", 0.0), (1.0, "flying", 0.5), (1.6, "flying", 0.6), (2.0, "drawing figures", 0.0)]
    for now, label, share in [*flying, *((later, "", 0.0) for later in (3.2, 4.8, 100.0, 109.0))]:
        clock[0] = now
        if label:
            lines(label, share)
        lines.tick()
    drawn = [f"drawing figures{late}" for late in ("", ", 5 s", ", 100 s")]
    assert capfd.readouterr().err.splitlines() == ["flying: 60 %", *drawn]


def test_a_step_that_says_nothing_is_told(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """By a thread of its own, which ends with the work."""
    monkeypatch.setattr(spoken_progress, "QUIET", 0.02)
    monkeypatch.setattr(spoken_progress, "TICK_TIME", 0.005)
    before = threading.active_count()
    with console.doing("searching"):
        time.sleep(0.2)
    assert capfd.readouterr().err.startswith("searching\nsearching, 0 s\n")
    assert threading.active_count() == before


def test_on_a_terminal_each_stage_is_a_bar(tmp_path: Path) -> None:
    """Flying, each observer; they vanish, and standard output is the table alone."""
    ours, theirs = pty.openpty()
    words = ["run", "paper", "--no-report", "--out", "here", *(w for one in SHORT for w in ("--set", one))]
    command = [sys.executable, "-m", "aerobat_pin", *words]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs) as process:
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 65536):
                shown += part
        except OSError:  # Linux: the other end is closed
            pass
        printed = process.stdout.read().decode()
    os.close(ours)
    for label in ("flying", "estimating with momentum", "estimating with force_level"):
        assert label.encode() in shown
    assert printed.startswith("\nmomentum finds ")


SLOW = "scipy.signal scipy.stats scipy.optimize dask.base distributed matplotlib jinja2 joblib gymnasium".split()
LIBRARIES = [*SLOW, "numpy", "numba", "pinocchio", "xarray", "pandas", "pydantic"]
FURTHER = ["scipy.linalg", "aerobat_pin.records.bag_columns"]


@pytest.mark.parametrize(
    ("words", "absent"),
    [
        ("--help", LIBRARIES),
        ("run paper --no-report --out here --set " + " --set ".join(SHORT), [*SLOW, *FURTHER]),
        ("list", [*SLOW, "xarray", "aerobat_pin.flight"]),
    ],
)
def test_a_command_loads_nothing_slow_without_need(tmp_path: Path, words: str, absent: list[str]) -> None:
    """A module is absent where it is not in `sys.modules`, or only a note there that says so."""
    # The first of two runs may have to compile kernels, which loads the compiler and scipy's linear algebra.
    code = (
        "import atexit, os, sys; from aerobat_pin.cli import main; "
        f"atexit.register(lambda: open('loaded', 'w').write(' '.join(m for m in {absent} if sys.modules.get(m)))); "
        f"sys.argv[1:] = {words.split()}; main()"
    )
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        command = [sys.executable, "-c", code]
        subprocess.run(command, cwd=tmp_path / name, check=True, capture_output=True, env=dict(os.environ))
        loaded = (tmp_path / name / "loaded").read_text()
        if not loaded:
            break
    assert loaded == ""


@pytest.mark.parametrize("share", [1e-3, 0.1, 0.6, 1.0, None])
def test_the_doubling_low_pass_is_the_recursion(share: float | None) -> None:
    """y_n = y_(n-1) + share_n (x_n - y_(n-1)), over records shorter and longer than the filter remembers."""
    for length in (1, 2, 7, 3000):
        rng, y = np.random.default_rng(length), np.zeros(3)
        values = rng.normal(size=(length, 3))
        shares = rng.uniform(0.01, 0.9, length) if share is None else np.full(length, share)
        expected = np.array([y := y + one * (x - y) for x, one in zip(values, shares, strict=True)])
        for given in (shares, *(() if share is None else (share,))):
            np.testing.assert_allclose(low_passed(values, given), expected, rtol=0.0, atol=1e-14)
