"""How long the command line takes to answer, warm: the smallest of several runs, wall clock and processor [s].

Warm means that kernels are compiled, and that Python may keep its own compiled files.

python benchmarks/start_up.py [--times 5]
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time

COMMANDS = {
    "--help": 0.2,
    "--version": 0.2,
    "list": 1.0,
    "run paper --no-report --force": 1.5,
}  # command -> wall clock that it may take on an idle machine [s]


def seconds(words: list[str], folder: str) -> tuple[float, float]:
    """Return wall clock and processor time of one call [s]."""
    warm = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "aerobat_pin", *words]
    subprocess.run(command, cwd=folder, env=warm, check=True, capture_output=True)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure, print a table, and end with exit code 1 where a command takes longer than it may."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    times, slow = parser.parse_args().times, False
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"{'command':<38} {'wall':>5} {'processor':>10} {'may':>5}")
    with tempfile.TemporaryDirectory() as folder:
        for words, most in COMMANDS.items():
            wall, processor = map(min, zip(*(seconds(words.split(), folder) for _ in range(times)), strict=True))
            print(f"aerobat {words:<30} {wall:5.2f} {processor:10.2f} {most:5.1f}")
            slow |= wall > most
    sys.exit(int(slow))


if __name__ == "__main__":
    main()
