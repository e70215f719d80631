"""What a sweep refuses before its first flight: its size, its names, and a folder that holds what no sweep wrote."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from support.bad_folders import FORGED

from aerobat_pin.errors import OutputError, ScenarioError, SweepError
from aerobat_pin.experiments import load_sweep, run_sweep

SHORT = 'name = "short"\nbase = "paper"\nseeds = 2\n[set]\n"simulation.duration" = 0.01\n"air.warm_up_cycles" = 1\n'
KEY = '"observers.gain"'


def written(folder: Path, text: str) -> Path:
    """Write a sweep file."""
    (folder / "short.toml").write_text(text)
    return folder / "short.toml"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SHORT.replace("seeds = 2", "seeds = 1_000_000_000"), "1000000000 seed are 1000000000 runs, about .* days"),
        (SHORT + f"[ranges]\n{KEY} = {{from = 1, to = 2, count = 1_000_000_000}}", "at most 100000 runs and 30 days"),
        (SHORT + '[draws]\ncount = 1_000_000_000\n[draws.values]\n"air.density" = {distribution = "normal", mean = 1, '
        "deviation = 0.1}", "1000000000 draw x 2 seed are 2000000000 runs"),
        (SHORT + '[variants."a/b"]\nc = {}', "dimension 'a/b': a name without / of 1 to 255 bytes"),
        (SHORT + '[variants.""]\nc = {}', "dimension '': a name"),
        (SHORT + '[variants."."]\nc = {}', r"dimension '\.': a name"),
        (SHORT + f'[factors."a\\nb"]\nvalues = [1]\nof = {{{KEY} = 1}}', r"dimension 'a\\nb': a name"),
        (SHORT + f'[factors."{300 * "é"}"]\nvalues = [1]\nof = {{{KEY} = 1}}', "a name without /"),
        (SHORT + '[draws]\ncount = 1\n[draws.values]\n"robot.changes.a/b" = {distribution = "normal", mean = 1, '
        "deviation = 0.1}", "dimension 'robot.changes.a/b'"),
        (SHORT + '[ranges]\n"simulation.dt" = [1e-12]', "at simulation.dt = 1e-12, .*at most 2 GB and 3600 s"),
    ],
)  # fmt: skip
def test_size_and_names_are_checked_before_anything_is_laid_out(text: str, message: str, tmp_path: Path) -> None:
    """A thousand million seeds used to be counted up first, and a name with a / failed after the last flight."""
    start = time.process_time()
    with pytest.raises((SweepError, ScenarioError), match=message):
        load_sweep(written(tmp_path, text))
    assert time.process_time() - start < 5.0  # [s] of this process alone; milliseconds are usual


def test_many_long_runs_are_refused_though_each_is_allowed(tmp_path: Path) -> None:
    """Flights of 25 minutes take 150 s each, so 20,000 of them take 35 days."""
    text = SHORT.replace("0.01", "1500.0") + '"air.strips" = 4\n'
    assert len(load_sweep(written(tmp_path, text.replace("seeds = 2", "seeds = 100"))).scenarios) == 100
    with pytest.raises(SweepError, match=r"20000 seed are 20000 runs, about 34\.\d days on one processor"):
        load_sweep(written(tmp_path, text.replace("seeds = 2", "seeds = 20_000")))


def test_labels_that_no_table_can_hold_are_refused_before_the_first_flight(tmp_path: Path) -> None:
    """NetCDF has no integers above 64 bits."""
    with pytest.raises(SweepError, match=r"sweep short: labels 1\d+, 1\d+, \.\.\. of seed"):
        run_sweep(load_sweep(written(tmp_path, SHORT + '"simulation.seed" = 1' + 30 * "0")), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fly two runs."""
    folder = tmp_path_factory.mktemp("swept")
    run_sweep(load_sweep(written(folder, SHORT)), folder / "out")
    return folder


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_line_is_refused_and_named(name: str, swept: Path) -> None:
    """What is there stays; before, there was a traceback after the last flight, or the line was deleted."""
    forge, message = FORGED[name]
    path = swept / "out" / "finished.jsonl"
    good = path.read_bytes()
    path.write_bytes(forge(good))
    try:
        with pytest.raises(OutputError, match=message):
            run_sweep(load_sweep(swept / "short.toml"), swept / "out")
        assert path.read_bytes() == forge(good)
    finally:
        path.write_bytes(good)


def test_what_is_no_file_of_ours_is_not_read(tmp_path: Path) -> None:
    """A pipe has no end, a link leads elsewhere, and a file can be larger than all memory; likewise `sweep.json`."""
    sweep = load_sweep(written(tmp_path, SHORT))
    out, other = tmp_path / "out", tmp_path / "mine.txt"
    run_sweep(sweep, out)
    path, manifest = out / "finished.jsonl", out / "sweep.json"
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(OutputError, match=r"finished\.jsonl: is no file that a sweep wrote"):
        run_sweep(sweep, out)
    path.unlink()
    other.write_text("")
    path.symlink_to(other)
    with pytest.raises(OutputError, match="is no file that a sweep wrote"):
        run_sweep(sweep, out)
    path.unlink()
    with path.open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(OutputError, match="1000000000000 bytes, at most 2000000 were expected"):
        run_sweep(sweep, out)
    manifest.write_text(9000 * "[")
    with pytest.raises(OutputError, match=r"sweep\.json: cannot be read: an object was expected"):
        run_sweep(sweep, out)
    assert other.read_text() == ""
