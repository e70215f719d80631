"""Time and memory of `aerobat estimate` on an hour of 1 kHz data of one rigid body; an error if it is slow or large."""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tomli_w
from support.drone import MAP

SECONDS, LONGEST, LARGEST = 3600.0, 120.0, 0.6  # [s] of one core, whatever else the machine does; [GB]


def write_log(path: Path, seconds: float) -> None:
    """Write a body that swings about a point, at 1 kHz, in pieces."""
    with path.open("w") as file:
        file.write(",".join(["t", *(name for part in MAP["base"].values() for name in part["columns"])]) + "\n")
        for first in np.arange(0.0, seconds, 60.0):
            t = first + np.arange(round(min(60.0, seconds - first) * 1000)) * 1e-3
            half = 0.1 * np.sin(2.0 * t)
            zero = np.zeros_like(t)
            place = [np.sin(t), np.cos(0.7 * t), 1.0 + 0.2 * np.sin(0.3 * t)]
            turn = [np.sin(half), zero, zero, np.cos(half)]
            speed = [np.cos(t), -0.7 * np.sin(0.7 * t), 0.06 * np.cos(0.3 * t)]
            rate = [0.4 * np.cos(2.0 * t), zero, zero]
            np.savetxt(file, np.column_stack([t, *place, *turn, *speed, *rate]), fmt="%.7g", delimiter=",")


def main() -> None:
    """Write the log, estimate it in a process of its own, and print what it took."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_log(folder / "hour.csv", SECONDS)
        (folder / "map.toml").write_text(tomli_w.dumps({key: MAP[key] for key in ("robot", "base")}))
        words = [sys.executable, "-m", "aerobat_pin", "estimate", "hour.csv", "--map", "map.toml", "--out", "out"]
        start = time.perf_counter()
        subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        passed = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    took, memory = used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6
    print(
        f"{SECONDS:g} s at 1 kHz: {took:.0f} s of one core ({passed:.0f} s passed), at most {memory:.3f} GB of memory"
    )
    if took > LONGEST or memory > LARGEST:
        raise SystemExit(f"more than {LONGEST:g} s or {LARGEST:g} GB")


if __name__ == "__main__":
    main()
