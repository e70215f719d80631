"""`aerobat node` over minutes at 500 Hz, with restarts of publisher and node: the table of docs/ros_node.md."""

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
from measure import processor_time
from support.pages import ROOT, fill, measured, table
from support.walking_log import FEET, bag_map, urdf

SECONDS, RATE = 600.0, 500
UNLIMITED = 10**9
HEAD = "run | samples | lost | late, median [ms] | 99 % [ms] | the node's processor time a sample [us]"


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

    def row(self, what: str, seconds: float) -> list[str]:
        """Publish, and return a line of the page's table."""
        before = processor_time(self.node.pid)
        assert self.publish(seconds).wait() == 0
        used = processor_time(self.node.pid) - before
        heard: dict[str, Any] = json.loads((self.folder / "out.json").read_text(encoding="utf-8"))
        samples, count = round(seconds * RATE), min(len(heard["forces"][foot]) for foot in FEET)
        half, most = np.percentile(heard["late"], [50, 99]) * 1e3
        lost = samples - 2 - count
        return [what, str(samples), str(lost), f"{half:.2f}", f"{most:.1f}", f"{1e6 * used / samples:.0f}"]


def main() -> None:
    """Measure, and write the table."""
    with tempfile.TemporaryDirectory() as name:
        network = Network(Path(name))
        network.row("the first seconds", 2.0)
        rows = [network.row(f"{SECONDS:.0f} s", SECONDS)]
        talker = network.publish(8.0)
        time.sleep(6.0)
        talker.kill()
        talker.wait()
        rows.append(network.row("a publisher that was killed, and begins again", 4.0))
        last = network.stop()
        network.start()
        network.row("the first seconds", 2.0)
        rows.append(network.row("a node that was ended, and begins again", 4.0))
        network.stop()
    fill("docs/ros_node.md", {"runs": table(HEAD, rows), "said": f"`{last}`", "measured": measured()})


if __name__ == "__main__":
    main()
