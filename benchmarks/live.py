"""`aerobat live` in a software-rendered Chromium: the table of docs/live.md."""

import time
from typing import Any

from measure import processor_time
from support.browser import opened, started
from support.commands import served
from support.pages import fill, measured, table

ROBOTS = {"Aerobat, hovering": (), "UR5": ("ur5",), "Solo12": ("solo12",)}
HEAD = (
    "robot | messages a second | pictures a second | of real time | set to shown, median [ms] | a picture [ms] | "
    "share of a processor"
)
ANSWERS, SECONDS = 20, 10.0
ANSWER = """async (force) => {
  const begun = performance.now();
  push([0, 0, force]);
  while (!live.true || Math.abs(live.true[2] - force) > 1e-6) await new Promise((done) => setTimeout(done, 1));
  return performance.now() - begun;
}"""


def shown(browser: Any, words: tuple[str, ...]) -> list[float]:
    """Return messages and pictures a second, pace, answer [ms], drawing [ms], share of a processor of the program."""
    with served("live", *words) as (server, address), opened(browser, address, "http://127.0.0.1", "ws:") as page:
        counts = "[performance.now() / 1000, live.messages, live.pictures, now ? now.time : 0]"
        while page.evaluate("live.pictures") < 20:
            time.sleep(0.1)
        worked, begin = processor_time(server.pid), page.evaluate(counts)
        time.sleep(SECONDS)
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
    """Measure, and write the table."""
    rows = []
    with started() as browser:
        for name, words in ROBOTS.items():
            values = shown(browser, words)
            rows.append([name, *map(format, values, (".1f", ".1f", ".2f", ".0f", ".1f", ".2f"))])
            print(rows[-1], flush=True)
    fill("docs/live.md", {"robots": table(HEAD, rows), "measured": f"{SECONDS:.0f} s each; {measured()}"})


if __name__ == "__main__":
    main()
