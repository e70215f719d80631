"""The benchmarks start, and comparisons of two checkouts mark what got worse or moved; they measure nothing here."""

import json
import runpy
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from aerobat_pin.estimation.calibration.calibration_file import FAMILY

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the benchmarks find each other, as where they start."""
    monkeypatch.syspath_prepend(BENCHMARKS)


@pytest.mark.parametrize("name", ["bench.py", "extras.py", "other_tools.py", "same_numbers.py"])
def test_a_benchmark_starts(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit, match=r"^0$"):
        runpy.run_path(str(BENCHMARKS / name), run_name="__main__")
    assert "usage" in capsys.readouterr().out


def test_every_extra_has_something_that_is_tried_with_it() -> None:
    """One that has none is not known to be complete."""
    import extras

    named = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    assert set(named) - {"test"} - set(extras.PROGRAMS) == set()


def test_a_ratio_that_got_worse_by_more_than_three_percent_is_marked() -> None:
    """By the medians; a gain is worse where it falls; times belong to the machine; what one side lacks is a dash."""
    from against import lines

    def runs(**values: list[float]) -> list[dict[str, dict[str, object]]]:
        units = {"wait": "ms"}
        named = {name.replace("_", " "): (series, units.get(name, "x")) for name, series in values.items()}
        return [{name: {"value": series[k], "unit": unit} for name, (series, unit) in named.items()} for k in range(3)]

    before = {"step": [2.0, 2.0, 9.0], "update": [1.0] * 3, "two_processes_faster_by": [1.8] * 3, "wait": [10.0] * 3}
    after = {"step": [2.1, 2.1, 2.1], "update": [1.02] * 3, "two_processes_faster_by": [1.7] * 3, "wait": [20.0] * 3}
    _, *rows = "\n".join(lines(runs(**before, gone=[1.0] * 3), runs(**after, new=[1.0] * 3))).splitlines()
    assert [" ".join(row.split()) for row in rows] == [
        "step 2.00 2.10 x +5.0 % WORSE",
        "update 1.00 1.02 x +2.0 %",
        "two processes faster by 1.80 1.70 x -5.6 % WORSE",
        "wait 10.00 20.00 ms +100.0 %",
        "gone 1.00 - x",
        "new - 1.00 x",
    ]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no repository")
def test_another_commit_is_checked_out_for_a_comparison_and_removed_again() -> None:
    """The last commit of this repository; a folder is taken as it is, and no commit ends the program."""
    from against import checkout_of

    with checkout_of("HEAD") as folder:
        assert (folder / "benchmarks" / "bench.py").is_file()
    assert not folder.exists()
    with checkout_of(str(BENCHMARKS)) as folder:
        assert folder == BENCHMARKS
    with pytest.raises(SystemExit, match=r"^--against no-such-commit:"):
        checkout_of("no-such-commit").__enter__()


def test_a_number_that_moved_is_found_and_a_text_that_is_worded_anew_is_told() -> None:
    """A key of another name is followed; one that went, a verdict, a number within a text and a clock differ."""
    from compared_numbers import FolderDifferences

    clock = np.array([0.0, 1.0, 2.0]) + 1.7e9
    before = {".given_up": 1.0, ".was.r2": 0.5, ".gone": 1, ".verdict": "good", ".text": "about 2.5 N"}
    after = {".is.r2": 0.25, ".verdict": "bad", ".text": "about 3 N", ".words": "other now", ".more": 1}
    found = FolderDifferences({"^metrics.json .given_up$": None, "[.]was[.]": ".is."})
    found.of_file(
        "metrics.json",
        {**before, ".same": [1.0, 2.0], ".words": "so far", ".time": [*clock]},
        {**after, ".same": [1.0, 2.0], ".time": [*np.add(clock, [0.0, 0.5, 0.0])]},
    )
    assert found.count == 7
    assert dict((name, size) for size, name in found.places) == {
        "metrics.json .is.r2": 0.5,
        "metrics.json .gone is missing": np.inf,
        "metrics.json .verdict": np.inf,
        "metrics.json .text": pytest.approx(0.2),
        "metrics.json .time": 0.25,
    }
    assert [*found.told] == ["reworded: metrics.json .words: so far -> other now", "new: metrics.json .more"]


def test_a_calibration_of_another_form_is_told_and_the_rest_is_compared(tmp_path: Path) -> None:
    """It ended the comparison of all works."""
    from compared_numbers import compare

    sides = [tmp_path / "before", tmp_path / "after"]
    for side in sides:
        side.mkdir()
        (side / "metrics.json").write_text(json.dumps({"mass": 1.0}))
        older = xr.Dataset({"mean": ("weight", np.ones(2))}, attrs={"kind": f"{FAMILY} 1"})
        older.to_netcdf(side / "calibration.nc", engine="h5netcdf")
    found = compare(*sides, {})
    assert found.count == 1  # of the metrics
    [told] = found.told
    assert told.startswith("not compared: calibration.nc: ")
    assert "an older file: calibrate again" in told
