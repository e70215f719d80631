"""Bad folders, drawn at random: of a run that is played, and of a sweep that is resumed."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator
Change = Callable[[dict[str, Any]], object]
SWEEP = 'name = "s"\nbase = "paper"\nseeds = 2\n[set]\n"simulation.duration" = 0.01\n"air.warm_up_cycles" = 1\n'


def no_file(rng: Rng, path: Path) -> None:
    """Put where a file is expected what is none: a pipe, a folder, a link to what never ends, a terabyte of zeros."""
    choice = rng.integers(4)
    if choice == 0:
        os.mkfifo(path)
    elif choice == 1:
        path.mkdir()
    elif choice == 2:
        path.symlink_to("/dev/zero")
    else:
        path.touch()
        os.truncate(path, 10**12)


def bad_run(rng: Rng, place: Path, run: Path) -> list[str]:
    """Damage a file of a good run of 10 intervals; return the command line that plays, compares or converts it."""
    shutil.copytree(run, place / "run")
    name = str(rng.choice(["estimate.nc", "estimate.nc", "flight.nc", "scenario.toml"]))
    file = place / "run" / name
    good = file.read_bytes()
    file.unlink()
    choice = rng.integers(7)
    if choice == 0:
        file.write_bytes(good[: int(rng.integers(len(good) // 2))])
    elif choice == 1:
        file.write_bytes(b"\xff" + rng.bytes(2000))
    elif choice == 2:
        other = {"estimate.nc": "flight.nc", "flight.nc": "estimate.nc", "scenario.toml": "metrics.json"}[name]
        file.write_bytes((run / other).read_bytes())
    elif choice in (3, 4):
        no_file(rng, file)
    elif choice == 5:
        file.write_bytes(b"name = 1" if name == "scenario.toml" else good[:1000] + bytes(len(good) - 1000))
    if name == "scenario.toml":
        return ["play", "run", "--out", "out.html"]
    doors = ["play", "run", "--out", "out.html"], ["convert", "run", "--out", "out.mcap"]
    return list(doors[rng.integers(2)])


METRICS = (  # that are no scores of a run
    *(b"", b"{}", b"[]", b"3", b"{", 9000 * b"[", b"\xff\xfe", 6_000_000 * b" "),
    *(b'{"observers": NaN}', b'{"observers": 3}', b'{"observers": {"momentum": 3}}'),
    b'{"observers": {"momentum": {"left": {"Fx": 3}}}}',
    b'{"observers": {"momentum": {"left": {"Fx": {"r2": "good", "rmse": 1}}}}}',
    b'{"observers": {"momentum": {"left": {"Fx": {"r2": 1, "rmse": 1e999}}}}}',
    b'{"observers": {"a\\u001b": {"left": {"Fx": {"r2": 1, "rmse": 1}}}}}',
    b'{"observers": {"momentum": {"left": {"Fx": {"r2": 1}}}}}',
)


def bad_comparison(rng: Rng, place: Path, run: Path) -> list[str]:
    """Damage the scores of a run that is compared with a good one; arguments as of `bad_run`."""
    for name in ("run", "good"):
        shutil.copytree(run, place / name)
    scores = place / "run" / "metrics.json"
    if rng.integers(4):
        scores.write_bytes(METRICS[rng.integers(len(METRICS))])
    else:
        scores.unlink()
        no_file(rng, scores)
    runs = ["run", "good"]
    return ["compare", *(runs if rng.integers(2) else runs[::-1]), "--out", "out"]


def _line(change: Change) -> Callable[[bytes], bytes]:
    def forge(content: bytes) -> bytes:
        lines = content.splitlines()
        read = json.loads(lines[1])
        change(read)
        return b"\n".join([lines[0], json.dumps(read).encode(), b""])

    return forge


def _score(read: dict[str, Any], value: object) -> None:
    read["outcome"]["observers"]["momentum"]["left"]["Fx"]["r2"] = value


FORGED: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "text": (lambda content: b"notes\n" + content, "line 1: not what this sweep writes"),
    "zeros": (lambda content: content[:50] + b"\0\0\0\n" + content, "line 1: not what"),
    "deep": (lambda content: content + 9000 * b"[" + b"\n", "line 3: not what .*recursion"),
    "digits": (lambda content: content + b'{"run": ' + 5000 * b"9" + b"}\n", "line 3: not what"),
    "list": (lambda content: content + b"[1]\n", "line 3: not what"),
    "again": (lambda content: content + content, "line 3: .*run = 0: each number below 2 once"),
    "number": (_line(lambda read: read.update(run=7)), "line 2: .*run = 7: each number below 2"),
    "kind": (_line(lambda read: read.update(run=True)), "line 2: .*run = True"),
    "key": (_line(lambda read: read["outcome"].update(more=1)), "line 2: .*unknown key 'more'"),
    "reason": (_line(lambda read: read.update(outcome={"failed": 3})), "line 2: not what"),
    "empty": (_line(lambda read: read.update(outcome={})), "line 2: .*no key 'observers'"),
    "observer": (_line(lambda read: read["outcome"]["observers"].pop("momentum")), "the run has momentum, force"),
    "score": (_line(lambda read: _score(read, "good")), "line 2: not what"),
    "nan": (_line(lambda read: _score(read, float("nan"))), "line 2: .*NaN: a finite number"),
    "infinite": (lambda content: content.replace(b'"duration": 0.01', b'"duration": 1e999'), "line 1: .*1e999: a fin"),
    "flight": (_line(lambda read: read["outcome"]["flight"].update(z_range=[1.0])), "line 2: not what"),
    "unknown": (_line(lambda read: read["outcome"]["flight"].update(mach=2.0)), "line 2: .*mach"),
}


def bad_sweep(rng: Rng, place: Path, swept: Path) -> list[str]:
    """Damage what a sweep of `SWEEP` left in its folder; return the command line that resumes it."""
    shutil.copytree(swept, place, dirs_exist_ok=True)
    finished, manifest = place / "out" / "finished.jsonl", place / "out" / "sweep.json"
    choice = rng.integers(6)
    if choice < 3:
        name = str(rng.choice(list(FORGED)))
        finished.write_bytes(FORGED[name][0](finished.read_bytes()))
    elif choice == 3:
        finished.unlink()
        no_file(rng, finished)
    elif choice == 4:
        manifest.write_bytes([b"", b"{}", 9000 * b"[", rng.bytes(100), b'{"name": "other"}'][rng.integers(5)])
    else:
        manifest.unlink()
        if rng.integers(2):
            os.mkfifo(manifest)
    return ["sweep", "s.toml", "--out", "out", "--jobs", "1"]
