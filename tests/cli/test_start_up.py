"""What the command line does not load, so that it starts quickly; `benchmarks/start_up.py` measures the seconds."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from aerobat_pin.observers.redundancy import low_passed

SHORT = "--set simulation.duration=0.02 --set air.warm_up_cycles=1"
SLOW = (
    "scipy.signal",
    "scipy.stats",
    "scipy.optimize",
    "dask.base",
    "distributed",
    "matplotlib",
    "jinja2",
    "joblib",
)
LIBRARIES = (*SLOW, "numpy", "numba", "pinocchio", "xarray", "pandas", "pydantic")


@pytest.mark.parametrize(
    ("words", "absent"),
    [
        ("--help", LIBRARIES),
        ("--version", LIBRARIES),
        (f"run paper --no-report --out here {SHORT}", (*SLOW, "scipy.linalg", "aerobat_pin.records.bag_columns")),
        ("list", (*SLOW, "xarray", "aerobat_pin.flight")),
    ],
)
def test_a_command_loads_nothing_slow_that_it_does_not_need(
    tmp_path: Path, words: str, absent: tuple[str, ...]
) -> None:
    """A module is absent where it is not in `sys.modules`, or only a note there that says so.

    The first of two runs may have to compile kernels, which loads the compiler and scipy's linear algebra.
    """
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


@pytest.mark.parametrize("share", [1e-3, 0.1, 0.6, 1.0])
def test_the_doubling_low_pass_is_the_recursion(share: float) -> None:
    """Against scipy's filter, over records shorter and longer than the filter remembers."""
    for length in (1, 2, 7, 3000):
        values = np.random.default_rng(length).normal(size=(length, 3))
        expected = lfilter([share], [1.0, share - 1.0], values, axis=0)
        np.testing.assert_allclose(low_passed(values, share), expected, rtol=0.0, atol=1e-14)
