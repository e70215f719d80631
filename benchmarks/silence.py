"""How long commands say nothing: the gaps between what they print, on a pipe and on a terminal, and their times.

    PYTHONPATH=tests python benchmarks/silence.py    # some six minutes; writes a table of docs/installation.md

Ends with an error if a command is silent for more than `LONGEST` seconds a second time.
"""

import os
import pty
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from support.pages import fill, measured, table

HEAD = "command | on a | takes [s] | first word after [s] | longest silences [s]"
LONGEST = 2.0  # [s]
COMMANDS = {  # what a line of the table is called -> command, after which another cache of kernels is used
    "the first `aerobat run paper`": "run paper --out cold --force",
    "`aerobat run paper`": "run paper --out warm --force",
    "`aerobat run paper --no-report`": "run paper --out bare --no-report --force",
    "`aerobat calibrate`": "calibrate free --out learnt.nc --force",
    "`aerobat check`": "check free --calibration learnt.nc --force",
    "`aerobat estimate`": "estimate free/flight.nc --out estimated --force",
    "`aerobat compare`": "compare warm bare --out both --force",
}


def gaps(words: str, folder: Path, environment: dict[str, str], *, terminal: bool) -> list[float]:
    """Run a command and return the times [s] for which it printed nothing, from its start to its end."""
    reading, writing = pty.openpty() if terminal else os.pipe()
    command = [sys.executable, "-m", "aerobat_pin", *words.split()]
    found, last = [], time.monotonic()
    with subprocess.Popen(command, cwd=folder, env=environment, stdout=writing, stderr=writing) as process:
        os.close(writing)
        said, part = b"", b"-"
        while part:
            try:
                part = os.read(reading, 65536)
            except OSError:  # Linux: the other end of a terminal is closed
                part = b""
            now = time.monotonic()
            found.append(now - last)
            said, last = said + part, now
    os.close(reading)
    if process.returncode:
        raise SystemExit(f"aerobat {words}: exit code {process.returncode}: {said.decode()[-500:]}")
    return found


def main() -> int:
    """Write the table, and return 1 if a command is silent too long a second time."""
    rows, worst = [], 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        warm = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kernels"), "PYTHONDONTWRITEBYTECODE": ""}
        for words in ("run paper --out first", "run paper --set unknown_force=[] --no-report --out free"):
            gaps(words, folder, warm, terminal=False)
        for title, words in COMMANDS.items():
            for kind, terminal in {"pipe": False, "terminal": True}.items():
                empty = {**warm, "NUMBA_CACHE_DIR": str(folder / f"kernels_{terminal}")}
                found = gaps(words, folder, empty if "first" in title else warm, terminal=terminal)
                longest = sorted(found, reverse=True)[:3]
                worst = max(worst, longest[1])
                silences = ", ".join(f"{gap:.2f}" for gap in longest)
                rows.append([title, kind, f"{sum(found):.1f}", f"{found[0]:.1f}", silences])
                print(rows[-1], flush=True)
    fill("docs/installation.md", {"silences": table(HEAD, rows), "measured": measured()})
    return int(worst > LONGEST)


if __name__ == "__main__":
    sys.exit(main())
