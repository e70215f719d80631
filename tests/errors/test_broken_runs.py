"""Whatever befalls a run, its folder holds the old result or the new one, and a line says what happened."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import numpy as np
import pytest
import support.broken_runs as broken
from support.bench import RUN, Bench
from support.broken_runs import Case

from aerobat_pin.aerobat.flight_log import FlightLog

SIZES = (1_000, 30_000, 120_000, 400_000)  # [bytes]: a short run writes files of up to 0.2 MB
RNG = np.random.default_rng([13, 4])
CASES = [
    broken.at_once(2),
    broken.at_once(5),
    broken.in_the_way("metrics.json", is_folder=True),
    broken.in_the_way("figures", is_folder=False),
    broken.left_by_a_killed_run("result", b"123"),
    broken.left_by_a_killed_run("other", b""),
    broken.from_inside(below=False),
    broken.from_inside(below=True),
    *(broken.limited(size) for size in SIZES),
    *(broken.killed(float(share), signal.SIGKILL) for share in RNG.uniform(0.5, 1.0, 3)),
    *(broken.killed(float(share), signal.SIGTERM) for share in RNG.uniform(0.0, 1.0, 2)),
    *(broken.killed(float(share), signal.SIGINT) for share in RNG.uniform(0.0, 1.0, 3)),
    broken.ignored(0.5),
    broken.diverging(0.0055, 1e4),
    broken.diverging(0.002, 1e9),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Return the bench on which the cases are played."""
    with Bench(tmp_path_factory.mktemp("bench")) as made:
        yield made


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_broken_run_leaves_the_old_result_or_the_new_one(case: Case, bench: Bench) -> None:
    """A good result and files of the user's are there before; `Bench.wrong` says what must hold."""
    assert case.play(bench, bench.new_folder()) == []


@pytest.mark.skipif(not broken.can_mount(), reason="only root can mount a small disk")
@pytest.mark.parametrize("free", SIZES)
def test_a_full_disk_costs_a_message(free: int, bench: Bench) -> None:
    """A tmpfs with so many bytes left; HDF5 alone would end the process with a segmentation fault."""
    assert broken.full_disk(free).play(bench, bench.new_folder()) == []


def test_a_diverged_flight_can_be_replayed_and_estimated(bench: Bench) -> None:
    """Report, replay and `aerobat estimate` mark it; none of them goes beyond `diverged_at`."""
    folder = bench.new_folder()
    push = "unknown_force=[{frame='left_force_point', signal='step', start=0.005, height=1e5}]"
    words = [word for word in RUN if word != "--no-report"]
    done = bench.forks.start([*words, "--set", push], folder).result()
    assert done.returncode == 2
    assert "the flight diverged at t = 0.00" in done.stderr
    log = FlightLog.load(folder / "result" / "flight.nc")
    assert log.time[-1] < log.measured.attrs["diverged_at"] < 0.02
    for page in ("report.html", "replay.html"):
        assert f"DIVERGED at {log.measured.attrs['diverged_at']:.4g} s" in (folder / "result" / page).read_text()
    assert "diverged at" in (folder / "result" / "report.html").read_text()
    for words in (["play", "result", "--html", "page.html"], ["estimate", "result/flight.nc", "--out", "again"]):
        assert bench.forks.start(words, folder).result().returncode == 0
    assert "DIVERGED at" in (folder / "page.html").read_text()
    assert "DIVERGED at" in (folder / "again" / "metrics.json").read_text()
