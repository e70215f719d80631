"""`aerobat live` in a software-rendered Chromium: messages, pictures, time to the estimate, processor time.

PYTHONPATH=tests python benchmarks/live.py [--seconds 10] [--write docs/live.md]
"""

from __future__ import annotations

import argparse
import datetime
import os
import re
import time
from pathlib import Path
from typing import Any

from support.browser import opened, started
from support.commands import served

ROBOTS = {"Aerobat, hovering": (), "UR5": ("ur5",), "Solo12": ("solo12",)}
TICKS = os.sysconf("SC_CLK_TCK")
ANSWERS = 20
ANSWER = """async (force) => {
  const begun = performance.now();
  push([0, 0, force]);
  while (!live.true || Math.abs(live.true[2] - force) > 1e-6) await new Promise((done) => setTimeout(done, 1));
  return performance.now() - begun;
}"""


def processor_time(process: int) -> float:
    """Return the processor time of a process so far [s]."""
    parts = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(parts[11]) + int(parts[12])) / TICKS


def measured(browser: Any, words: tuple[str, ...], seconds: float) -> list[float]:
    """Return messages and pictures a second, pace, answer [ms], drawing [ms], share of a processor of the program."""
    with served("live", *words) as (server, address), opened(browser, address, "http://127.0.0.1", "ws:") as page:
        counts = "[performance.now() / 1000, live.messages, live.pictures, now ? now.time : 0]"
        while page.evaluate("live.pictures") < 20:
            time.sleep(0.1)
        worked, begin = processor_time(server.pid), page.evaluate(counts)
        time.sleep(seconds)
        end, worked = page.evaluate(counts), processor_time(server.pid) - worked
        took, *parts = (after - before for before, after in zip(begin, end, strict=True))
        answers = [page.evaluate(ANSWER, page.evaluate("told.limit") * (0.1 + 0.02 * k)) for k in range(ANSWERS)]
        drawn = page.evaluate(
            "(() => { const t = performance.now(); for (let k = 0; k < 50; k++) { draw(); curves(); }"
            " return (performance.now() - t) / 50; })()"
        )
    messages, pictures, pace = (part / took for part in parts)
    return [messages, pictures, pace, sorted(answers)[ANSWERS // 2], drawn, worked / took]


def main() -> None:
    """Measure, print, and write the table into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--write", type=Path)
    given = parser.parse_args()
    lines = [
        "| robot | messages a second | pictures a second | of real time | set to shown, median [ms] | a picture [ms] "
        "| share of a processor |",
        "|---|---|---|---|---|---|---|",
    ]
    with started() as browser:
        for name, words in ROBOTS.items():
            messages, pictures, pace, answer, drawn, worked = measured(browser, words, given.seconds)
            cells = f"{messages:.1f} | {pictures:.1f} | {pace:.2f} | {answer:.0f} | {drawn:.1f} | {worked:.2f}"
            lines.append(f"| {name} | {cells} |")
            print(lines[-1], flush=True)
    load = os.getloadavg()[0]
    lines += ["", f"{given.seconds:.0f} s each; {datetime.date.today()}, {os.cpu_count()} cores, load {load:.1f}."]
    if given.write is not None:
        page = given.write.read_text(encoding="utf-8")
        table = "\n".join(lines)
        given.write.write_text(re.sub(r"(?s)\| robot \|.*?load [\d.]+\.", table, page), encoding="utf-8")


if __name__ == "__main__":
    main()
