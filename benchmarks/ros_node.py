"""`aerobat node` over minutes at 500 Hz, with restarts of the publisher and of the node: the page docs/ros_node.md.

PYTHONPATH=tests python benchmarks/ros_node.py [--seconds 600]
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from support.walking_log import FEET, bag_map, urdf

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "ros_node.md"
RATE = 500
UNLIMITED = 10**9
TICKS = os.sysconf("SC_CLK_TCK")


def processor_time(process: subprocess.Popen[str]) -> float:
    """Return the processor time of a process so far [s]."""
    parts = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(parts[11]) + int(parts[12])) / TICKS


class Network:
    """A node and what talks to it, on topics that no other program hears."""

    def __init__(self, folder: Path) -> None:
        """Write robot and map, and start the node."""
        self.folder = folder
        (folder / "quadruped.urdf").write_text(urdf(), encoding="utf-8")
        values: dict[str, Any] = {key: part for key, part in bag_map(Path("quadruped.urdf")).items() if key != "check"}
        values["observer"] = {"names": ["momentum"], "gain": 1000.0}
        (folder / "map.toml").write_bytes(tomli_w.dumps(values).encode())
        here = {"ROS_DOMAIN_ID": str(os.getpid() % 100 + 1), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        self.environment = {**os.environ, **here}
        self.start()

    def start(self) -> None:
        """Start the node, and wait until its kernels are compiled."""
        words = ["node", "--map", str(self.folder / "map.toml"), "--name", "walk"]
        command = [sys.executable, "-m", "aerobat_pin", *words]
        self.node = subprocess.Popen(command, env=self.environment, stdout=subprocess.PIPE, text=True)
        assert self.node.stdout is not None
        self.node.stdout.readline()

    def stop(self) -> str:
        """End the node as Ctrl-C does; return its last line."""
        self.node.send_signal(signal.SIGINT)
        return self.node.communicate(timeout=60)[0].splitlines()[-1]

    def publish(self, seconds: float) -> subprocess.Popen[bytes]:
        """Start a publisher and listener."""
        program, out = ROOT / "tests" / "support" / "ros_walk.py", self.folder / "out.json"
        words = [sys.executable, program, "walk", out, RATE, round(seconds * RATE), UNLIMITED]
        return subprocess.Popen([str(word) for word in words], env=self.environment)

    def published(self, seconds: float) -> dict[str, Any]:
        """Publish, and return what came back."""
        assert self.publish(seconds).wait() == 0
        found: dict[str, Any] = json.loads((self.folder / "out.json").read_text(encoding="utf-8"))
        return found


def row(what: str, found: dict[str, Any], samples: int, used: float) -> str:
    """Return a line of the page's table."""
    count = min(len(found["forces"][foot]) for foot in FEET)
    half, most = np.percentile(found["late"], [50, 99]) * 1e3
    return f"| {what} | {samples} | {samples - 2 - count} | {half:.2f} | {most:.1f} | {1e6 * used / samples:.0f} |"


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    seconds = parser.parse_args().seconds
    lines, samples, again = [], round(seconds * RATE), round(4.0 * RATE)
    with tempfile.TemporaryDirectory() as name:
        network = Network(Path(name))
        network.published(2.0)
        before = processor_time(network.node)
        whole = network.published(seconds)
        lines.append(row(f"{seconds:.0f} s", whole, samples, processor_time(network.node) - before))
        talker = network.publish(8.0)
        time.sleep(6.0)
        talker.kill()
        talker.wait()
        before = processor_time(network.node)
        lines.append(
            row(
                "a publisher that was killed, and begins again",
                network.published(4.0),
                again,
                processor_time(network.node) - before,
            )
        )
        said = network.stop()
        network.start()
        network.published(2.0)
        before = processor_time(network.node)
        lines.append(
            row(
                "a node that was ended, and begins again",
                network.published(4.0),
                again,
                processor_time(network.node) - before,
            )
        )
        network.stop()
    load = os.getloadavg()[1]
    PAGE.write_text(
        PAGE_TEXT.format(table="\n".join(lines), said=said, load=load, cores=os.cpu_count(), day=datetime.date.today()),
        encoding="utf-8",
    )
    print(PAGE.read_text(encoding="utf-8"))


PAGE_TEXT = """# The ROS 2 node, measured

A quadruped's joints and IMU at 500 Hz and its pose at 250 Hz, published in Python with Fast DDS on one machine; four
forces and contacts come back ([recordings.md](recordings.md), "While messages arrive"). Late is the time from sending
a sample until its last force is heard; every estimate waits for a pose, so half of the samples wait 2 ms for the next.

| run | samples | lost | late, median [ms] | 99 % [ms] | the node's processor time a sample [us] |
|---|---|---|---|---|---|
{table}

The node that saw the first two runs said at its end: `{said}`.

`PYTHONPATH=tests python benchmarks/ros_node.py`, part of `make evidence`; {day}, {cores} cores, load {load:.1f}.
"""


if __name__ == "__main__":
    main()
