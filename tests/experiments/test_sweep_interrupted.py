"""Sweeps that are killed or refused: what is finished stays, the end is that of an undisturbed one; clusters, too."""

import contextlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from distributed import LocalCluster
from support.bad_folders import FORGED
from support.commands import aerobat

from aerobat_pin.errors import OutputError
from aerobat_pin.experiments import load_sweep, run_sweep
from aerobat_pin.experiments.sweep import run_sweep as executors

RUNS = 24
PROGRAM = [sys.executable, "-m", "aerobat_pin", "sweep"]
SWEEP = """
name = "short"
base = "paper"
seeds = 6
[set]
"simulation.duration" = 0.05
"air.strips" = 4
"air.warm_up_cycles" = 1
[ranges]
"observers.gain" = [500.0, 1000.0]
"robot.changes.scale.span" = [1.0, 1.1]
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sweep") / "short.toml"
    path.write_text(SWEEP)
    return path


@pytest.fixture(scope="module")
def uninterrupted(file: Path) -> Path:
    run_sweep(load_sweep(file), file.parent / "uninterrupted")
    return file.parent / "uninterrupted"


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as running:
        yield running


def lines(folder: Path) -> list[str]:
    path = folder / "finished.jsonl"
    return path.read_text().splitlines(keepends=True) if path.exists() else []


def wait_for(folder: Path, count: int, process: subprocess.Popen[bytes]) -> None:
    while len(lines(folder)) < count and process.poll() is None:
        time.sleep(0.002)


def workers_of(process: psutil.Process) -> list[psutil.Process]:
    """Return the processes that fly for a process, whether they are ready or just starting."""
    found = []
    for one in process.children():
        with contextlib.suppress(psutil.NoSuchProcess):  # ended meanwhile
            if "popen_loky_posix" in " ".join(one.cmdline()):
                found.append(one)
    return found


def same_tables(one: Path, other: Path) -> None:
    for name in ("results.csv", "results.nc"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def interrupted(file: Path, folder: Path, count: int) -> None:
    """Press Ctrl-C in a sweep on two processes when so many runs are finished; check what it says."""
    command = [*PROGRAM, str(file), "--jobs", "2", "--out", str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    while process.poll() is None and len(workers_of(psutil.Process(process.pid))) < 2:
        time.sleep(0.05)  # to look costs much of a processor
    wait_for(folder, count, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers too
    _, said = process.communicate()
    assert process.returncode == 130, said
    told = rb"\d+ of %d runs are finished" % RUNS
    progress = rb"((starting|" + told + rb")[^\n]*\n)*"
    assert re.fullmatch(progress + rb"\ninterrupted: " + told + rb"; the same command goes on from there\n", said), said
    assert count <= len(lines(folder)) < RUNS


def test_a_sweep_interrupted_and_killed_ends_undisturbed(file: Path, uninterrupted: Path, tmp_path: Path) -> None:
    """Ctrl-C and `kill -9` at random moments: no line is lost or flown again; code 130, one line, and it goes on."""
    tmp_path = tmp_path / "out"
    interrupted(file, tmp_path, 3)
    chance, kept = random.Random(time.time_ns()), [line for line in lines(tmp_path) if line.endswith("\n")]
    while True:
        command = [*PROGRAM, str(file), "--jobs", "2", "--out", str(tmp_path)]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for(tmp_path, len(kept) + 1 + chance.randrange(5), process)
        time.sleep(chance.uniform(0.0, 0.05))
        if process.poll() is None:
            break
        assert process.returncode == 0  # it was quicker than this process, on a busy machine: once more
        shutil.rmtree(tmp_path)
        kept = []
    workers = psutil.Process(process.pid).children()
    process.kill()
    process.wait()
    assert not psutil.wait_procs(workers, timeout=120.0)[1], "its workers outlive it"
    now = lines(tmp_path)
    assert now[: len(kept)] == kept
    kept = [line for line in now if line.endswith("\n")]
    assert not (tmp_path / "results.nc").exists()
    done = aerobat("sweep", str(file), "--jobs", "1", "--out", str(tmp_path), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"going on: {len(kept)} of {RUNS} runs are finished" in done.stdout
    assert lines(tmp_path)[: len(kept)] == kept
    assert sorted(json.loads(line)["run"] for line in lines(tmp_path)) == list(range(RUNS))
    same_tables(tmp_path, uninterrupted)


@pytest.mark.evidence
def test_ctrl_c_says_how_to_go_on_while_workers_are_starting(file: Path, uninterrupted: Path, tmp_path: Path) -> None:
    interrupted(file, tmp_path, 0)
    run_sweep(load_sweep(file), tmp_path)
    same_tables(tmp_path, uninterrupted)


def test_what_a_thread_of_joblib_raises_at_an_interruption_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """It can fail while joblib takes tasks away, before the loop over its generator hears of Ctrl-C."""
    shown: list[object] = []
    monkeypatch.setattr(threading, "excepthook", shown.append)

    def raise_in(name: str) -> None:
        thread = threading.Thread(target={}.__getitem__, args=(1,), name=name)
        thread.start()
        thread.join()

    def outcomes(_: object) -> Iterator[None]:
        yield
        raise_in("ExecutorManagerThread")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), executors._started(outcomes, []) as ends:
        list(ends)
    raise_in("another")
    assert len(shown) == 1


def test_a_killed_worker_costs_nothing_but_time(file: Path, uninterrupted: Path, tmp_path: Path) -> None:
    """A process of the pool dies, as if the machine had taken its memory: new ones fly what is left."""

    def progress(finished: int, count: int, failed: int) -> None:
        if finished == 5:
            workers_of(psutil.Process())[0].kill()

    run_sweep(load_sweep(file), tmp_path, jobs=2, progress=progress)
    same_tables(tmp_path, uninterrupted)


@pytest.mark.evidence
def test_a_cluster_survives_a_death(file: Path, uninterrupted: Path, cluster: LocalCluster, tmp_path: Path) -> None:
    pids = [worker.pid for worker in cluster.workers.values()]

    def progress(finished: int, count: int, failed: int) -> None:
        if finished == 5:
            os.kill(pids[0], signal.SIGKILL)

    run_sweep(load_sweep(file), tmp_path, cluster=cluster.scheduler_address, progress=progress)
    same_tables(tmp_path, uninterrupted)


SHORT = 'name = "short"\nbase = "paper"\nseeds = 2\n[set]\n"simulation.duration" = 0.01\n"air.warm_up_cycles" = 1\n'


def written(folder: Path, text: str) -> Path:
    (folder / "short.toml").write_text(text)
    return folder / "short.toml"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_a_sweep_whose_recorded_force_has_changed_is_another_sweep(tmp_path: Path) -> None:
    """Its finished runs were flown with the force of before."""
    force, pushed = tmp_path / "force.csv", 'frame = "left_force_point"\nsignal = "recorded"\nfile = "force.csv"\n'
    (tmp_path / "base.toml").write_text('name = "mine"\n[[unknown_force]]\n' + pushed)
    force.write_text("time,force\n0,0.1\n1,0.1\n")
    sweep = load_sweep(written(tmp_path, SHORT.replace('"paper"', '"base.toml"')))
    run_sweep(sweep, tmp_path / "out")
    force.write_text("time,force\n0,5.0\n1,5.0\n")
    with pytest.raises(OutputError, match="another sweep: a scenario or a file that it reads differ"):
        run_sweep(sweep, tmp_path / "out")


def test_what_is_no_file_of_ours_is_not_read(tmp_path: Path) -> None:
    """A pipe has no end, a link leads elsewhere, and a file can be larger than all memory; likewise `sweep.json`."""
    sweep = load_sweep(written(tmp_path, SHORT))
    out, other = tmp_path / "out", tmp_path / "mine.txt"
    run_sweep(sweep, out)
    path, manifest = out / "finished.jsonl", out / "sweep.json"
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(OutputError, match=r"finished\.jsonl: cannot be read: is no file; --force"):
        run_sweep(sweep, out)
    path.unlink()
    other.write_text("")
    path.symlink_to(other)
    with pytest.raises(OutputError, match="cannot be read: is a link; a file was expected; --force"):
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
