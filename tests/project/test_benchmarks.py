"""The benchmarks start, and comparisons of two checkouts mark what got worse or moved; they measure nothing here."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COMPARE = """
import sys
sys.path.insert(0, sys.argv[1])
from against import lines

def runs(**values):
    units = {"wait": "ms"}
    names = {name: name.replace("_", " ") for name in values}
    return [{names[name]: {"value": series[k], "unit": units.get(name, "x")} for name, series in values.items()}
            for k in range(3)]

print("\\n".join(lines(
    runs(step=[2.0, 2.0, 9.0], update=[1.0] * 3, two_processes_faster_by=[1.8] * 3, wait=[10.0] * 3, gone=[1.0] * 3),
    runs(step=[2.1, 2.1, 2.1], update=[1.02] * 3, two_processes_faster_by=[1.7] * 3, wait=[20.0] * 3, new=[1.0] * 3),
)))
"""

DIFFERENCES = """
import sys
sys.path.insert(0, sys.argv[1])
from compared_numbers import FolderDifferences

found = FolderDifferences({"^metrics.json .given_up$": None, "[.]was[.]": ".is."})
found.of_file(
    "metrics.json",
    {".given_up": 1.0, ".was.r2": 0.5, ".same": [1.0, 2.0], ".gone": 1, ".verdict": "good", ".text": "about 2.5 N",
     ".words": "so far", ".time": [1.7e9, 1.7e9 + 1.0, 1.7e9 + 2.0]},
    {".is.r2": 0.25, ".same": [1.0, 2.0], ".verdict": "bad", ".text": "about 3 N", ".words": "other now", ".more": 1,
     ".time": [1.7e9, 1.7e9 + 1.5, 1.7e9 + 2.0]},
)
print(found.count, *found.places, *found.told, sep="\\n")
"""


FORMS = """
import json, sys
from pathlib import Path
import numpy as np
import xarray as xr
sys.path.insert(0, sys.argv[1])
from compared_numbers import compare
from aerobat_pin.estimation.calibration.calibration_file import FAMILY

for side in ("before", "after"):
    Path(side).mkdir()
    Path(side, "metrics.json").write_text(json.dumps({"mass": 1.0}))
    older = xr.Dataset({"mean": ("weight", np.ones(2))}, attrs={"kind": f"{FAMILY} 1"})
    older.to_netcdf(Path(side, "calibration.nc"), engine="h5netcdf")
found = compare(Path("before"), Path("after"), {})
print(found.count, *found.places, *found.told, sep="\\n")
"""


def python(*words: str, cwd: Path | None = None) -> str:
    """Run Python on this checkout's packages and return what it prints."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tests")))}
    words = (sys.executable, *words)
    return subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("name", ["bench.py", "extras.py", "other_tools.py", "same_numbers.py"])
def test_a_benchmark_starts(name: str) -> None:
    """All that it imports is there."""
    assert "usage" in python(str(ROOT / "benchmarks" / name), "--help")


def test_every_extra_has_something_that_is_tried_with_it() -> None:
    """One that has none is not known to be complete."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    tried = python("-c", "import sys; sys.path.insert(0, 'benchmarks'); import extras; print(*extras.PROGRAMS)").split()
    assert set(extras) - {"test"} - set(tried) == set()


def test_a_ratio_that_got_worse_by_more_than_three_percent_is_marked() -> None:
    """By the medians; a gain is worse where it falls; times belong to the machine; what one side lacks is a dash."""
    _, *rows = python("-c", COMPARE, str(ROOT / "benchmarks")).splitlines()
    assert [" ".join(row.split()) for row in rows] == [
        "step 2.00 2.10 x +5.0 % WORSE",
        "update 1.00 1.02 x +2.0 %",
        "two processes faster by 1.80 1.70 x -5.6 % WORSE",
        "wait 10.00 20.00 ms +100.0 %",
        "gone 1.00 - x",
        "new - 1.00 x",
    ]


def test_another_commit_is_checked_out_for_a_comparison_and_removed_again() -> None:
    """The last commit of this repository; a folder is taken as it is, and no commit ends the program."""
    if not (ROOT / ".git").exists():
        pytest.skip("no repository")
    script = """
import sys
sys.path.insert(0, sys.argv[1])
from against import checkout_of

with checkout_of("HEAD") as folder:
    print((folder / "benchmarks" / "bench.py").is_file())
print(folder.exists())
with checkout_of(sys.argv[1]) as folder:
    print(str(folder) == sys.argv[1])
try:
    checkout_of("no-such-commit").__enter__()
except SystemExit as error:
    print(str(error).partition(":")[0])
"""
    told = python("-c", script, str(ROOT / "benchmarks")).splitlines()
    assert told == ["True", "False", "True", "--against no-such-commit"]


def test_a_number_that_moved_is_found_and_a_text_that_is_worded_anew_is_told() -> None:
    """A key of another name is followed; one that went, a verdict, a number within a text and a clock differ."""
    assert python("-c", DIFFERENCES, str(ROOT / "benchmarks")).splitlines() == [
        "7",
        "(0.5, 'metrics.json .is.r2')",
        "(inf, 'metrics.json .gone is missing')",
        "(inf, 'metrics.json .verdict')",
        "(0.2, 'metrics.json .text')",
        "(0.25, 'metrics.json .time')",
        "reworded: metrics.json .words: so far -> other now",
        "new: metrics.json .more",
    ]


def test_a_calibration_of_another_form_is_told_and_the_rest_is_compared(tmp_path: Path) -> None:
    """It ended the comparison of all works."""
    count, *told = python("-c", FORMS, str(ROOT / "benchmarks"), cwd=tmp_path).splitlines()
    assert count == "1"  # of the metrics
    assert len(told) == 1
    assert told[0].startswith("not compared: calibration.nc: ")
    assert "an older file: calibrate again" in told[0]
