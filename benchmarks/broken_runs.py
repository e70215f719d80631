"""Write docs/broken_runs.md: runs that are killed at random moments, that meet a full disk, or that are four at once.

    PYTHONPATH=tests python benchmarks/broken_runs.py [--moments 100]

Every signal is sent to a process of its own, at any time from its start to its end. The other cases are those of
`tests/support/broken_runs.py`. All is done on two file systems: that of temporary folders, and /dev/shm.
"""

import argparse
import datetime
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import support.broken_runs as broken
from support.bench import HANGS, NEW, RUN, Bench, content
from support.pages import fill, table

SIGNALS = {signal.SIGKILL: 1, signal.SIGTERM: 2, signal.SIGINT: 2}  # signal -> at every which moment it is sent
PLACES = (Path(tempfile.gettempdir()), Path("/dev/shm"))
COMMAND = [sys.executable, "-m", "aerobat_pin", *RUN, *NEW]
SIZES = (1_000, 30_000, 120_000, 400_000)  # [bytes]
ENDS = ("finished", "ended in one line", "before our first line", "ended otherwise")
STATES = ("old result", "new result", "half-written", "left behind", "false statement")


def interrupt(bench: Bench, number: signal.Signals, moment: float) -> tuple[str, ...]:
    """Send a run a signal at a moment [s] after its start, and return what was seen: of `ENDS` and `STATES`."""
    folder = bench.new_folder()
    process = subprocess.Popen(COMMAND, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(moment)
    process.send_signal(number)
    _, said = process.communicate(timeout=HANGS)
    found = content(folder / "result")
    wrong = bench.wrong(folder, left=number == signal.SIGKILL)
    new = found["metrics.json"] == bench.new["metrics.json"]
    seen = ["half-written" if any("half" in text or "own" in text for text in wrong) else STATES[new]]
    seen += ["left behind"] * any(path.name != "result" for path in folder.iterdir())
    seen += ["false statement"] * (new and "nothing was written" in said)
    shutil.rmtree(folder)
    if process.returncode == 0:
        return ("finished", *seen)
    # Lines about stages may stand before it, of a run that takes longer than a second.
    if process.returncode == 128 + number and said.count("interrupted: ") == 1 and "Traceback" not in said:
        return ("ended in one line", *seen)
    ours = "aerobat_pin/" in said or "aerobat_description/" in said
    return ("before our first line" if process.returncode != -9 and not ours else "ended otherwise", *seen)


def undisturbed(bench: Bench) -> float:
    """Return how long a run takes [s] that nobody interrupts."""
    start = time.monotonic()
    subprocess.run(COMMAND, cwd=bench.new_folder(), check=True, capture_output=True)
    return time.monotonic() - start


def signal_rows(bench: Bench, place: str, moments: int, rng: np.random.Generator) -> list[list[object]]:
    """Return the rows of a file system in the table of signals."""
    undisturbed(bench)  # the first one may compile
    counts = {number: Counter[str]() for number in SIGNALS}
    for k in range(moments):
        if k % 10 == 0:  # the machine may have become busier
            longest = 1.05 * undisturbed(bench)
        for number in (number for number, every in SIGNALS.items() if k % every == 0):
            counts[number].update(interrupt(bench, number, float(rng.uniform(0.0, longest))))
        print(f"{place}: {k + 1} of {moments}", {number.name: dict(one) for number, one in counts.items()}, flush=True)
    return [
        [number.name, place, sum(count[name] for name in ENDS), *(count[name] for name in (*ENDS, *STATES))]
        for number, count in counts.items()
    ]


def case_rows(bench: Bench, place: str) -> list[list[object]]:
    """Return the rows of a file system in the table of the other cases."""
    cases = [broken.at_once(2), broken.at_once(4), *(broken.limited(size) for size in SIZES)]
    if broken.can_mount():
        cases += [broken.full_disk(size) for size in SIZES]
    good = [sum(case.play(bench, bench.new_folder()) == [] for _ in range(5)) for case in cases]
    return [[case.name, place, 5, count] for case, count in zip(cases, good, strict=True)]


def main() -> None:
    """Write the page."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts jobs in the background without it
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=100, help="random moments for each signal")
    chosen = parser.parse_args()
    rng = np.random.default_rng(1)
    signals, cases = list[list[object]](), list[list[object]]()
    for place in (place for place in PLACES if place.is_dir()):
        asked = ["df", "--output=fstype", str(place)]
        kind = subprocess.run(asked, check=True, capture_output=True, text=True).stdout.split()[-1]
        with tempfile.TemporaryDirectory(dir=place) as folder, Bench(Path(folder)) as bench:
            signals += signal_rows(bench, kind, chosen.moments, rng)
            cases += case_rows(bench, kind)
    values = {
        "measured": str(datetime.date.today()),
        "signals": table(" | ".join(("signal", "file system", "moments", *ENDS, *STATES)), signals),
        "cases": table("case | file system | tries | as it should be", cases),
    }
    fill("docs/broken_runs.md", values)


if __name__ == "__main__":
    main()
