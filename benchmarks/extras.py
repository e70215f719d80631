"""Install the project and each of its extras into a fresh environment, and do there what the extra is for.

    PYTHONPATH=tests python benchmarks/extras.py                # all, some ten minutes; a table of docs/installation.md
    PYTHONPATH=tests python benchmarks/extras.py --only gym ros # writes the rows of some

An environment has nothing but the project and the extra; it is removed afterwards. Ends with an error if one fails.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

from support.pages import ROOT, cells, fill, marked, table

PAGE = "docs/installation.md"
FLIGHT = "aerobat run paper --set simulation.duration=0.02 --set air.warm_up_cycles=1 --out made"
# Extra -> what it is for, in words, and either commands or a program that does it in an empty folder.
PROGRAMS = {
    "none": ("a flight, its estimate, a report and a replay", FLIGHT),
    "docs": ("this site", f"aerobat --version\npython {ROOT}/docs/site/build.py made"),
    "ros": (
        "an MCAP file of a flight, read again",
        f"{FLIGHT} --no-report\naerobat convert made --out flight.mcap\naerobat estimate flight.mcap --suggest",
    ),
    "frames": (
        "pictures of a replay, by an installed Chromium",
        f"{FLIGHT} --no-report\naerobat play made --frames pictures --rate 1",
    ),
    "gym": (
        "a step of `AerobatEnv`",
        """
from aerobat_pin.control import AerobatEnv
env = AerobatEnv("hover_closed_loop", ["simulation.duration=0.1"])
env.reset(seed=0)
assert len(env.step(env.action_space.sample())) == 5
""",
    ),
    "cluster": (
        "a sweep of two flights by a worker of Dask",
        """
from pathlib import Path
from distributed import LocalCluster
from aerobat_pin.experiments import load_sweep, run_sweep
if __name__ == "__main__":
    Path("two.toml").write_text('''name = "two"
base = "paper"
seeds = 2
[set]
"simulation.duration" = 0.02
"air.warm_up_cycles" = 1
''')
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        grid = run_sweep(load_sweep("two.toml"), Path("made"), cluster=cluster.scheduler_address)
    assert not any(grid["failed"].values.flat)
""",
    ),
    "ros2": (
        "a ROS 2 node that hears its own force",
        """
import rclpy
from geometry_msgs.msg import WrenchStamped
rclpy.init()
node, heard = rclpy.create_node("tried"), []
node.create_subscription(WrenchStamped, "force", heard.append, 10)
said = node.create_publisher(WrenchStamped, "force", 10)
for _ in range(100):
    said.publish(WrenchStamped())
    rclpy.spin_once(node, timeout_sec=0.1)
    if heard:
        break
assert heard
""",
    ),
    "robots": (
        "a UR5 and a Go2 by name",
        """
from aerobat_pin import load_robot
assert (load_robot("ur5").model.nv, load_robot("go2").model.nv) == (6, 18)
""",
    ),
    "mujoco": ("the closed linkage in MuJoCo", f"{FLIGHT} --no-report --plant mujoco"),
    "live": ("a web server", "\nimport tornado.web\ntornado.web.Application()\n"),
}


def tried(extra: str) -> list[str]:
    """Install an extra into a fresh environment, do what it is for, and return its row of the table."""
    words, program = PROGRAMS[extra]
    with tempfile.TemporaryDirectory() as name:
        place, begin = Path(name), time.monotonic()
        subprocess.run([sys.executable, "-m", "venv", place / "venv"], check=True)
        programs, what = place / "venv" / "bin", str(ROOT) if extra == "none" else f"{ROOT}[{extra}]"
        pip = ["-m", "pip", "install", "--quiet", "--no-compile", "--disable-pip-version-check", "--editable", what]
        subprocess.run([programs / "python", *pip], check=True)
        spent = time.monotonic() - begin
        size = subprocess.run(["du", "-sm", "venv"], cwd=place, capture_output=True, text=True, check=True).stdout
        (place / "tried.py").write_text(program, encoding="utf-8")
        bare = {**os.environ, "PYTHONPATH": ""}
        for line in ["python tried.py"] if program.startswith("\n") else program.splitlines():
            command, *arguments = line.split()
            done = subprocess.run([programs / command, *arguments], cwd=place, env=bare, capture_output=True, text=True)
            if done.returncode != 0:
                raise SystemExit(f"extra {extra}: {line}: {done.stderr or done.stdout}")
    return [extra if extra == "none" else f"`{extra}`", f"{size.split()[0]} MiB", f"{spent:.0f} s", words]


def main() -> None:
    """Try all extras, or those that are named, and write the table."""
    parser = argparse.ArgumentParser(description="Install each extra into a fresh environment, and use it.")
    parser.add_argument("--only", nargs="+", help="write the rows of these alone; 'none' is the default install")
    only = parser.parse_args().only
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    named = ["none", *(name for name in extras if name != "test")]
    _, before, _ = marked((ROOT / PAGE).read_text("utf-8"), "extras")
    rows = {row[0].strip("`"): row for row in cells(before)}
    for extra in only or named:
        rows[extra] = tried(extra)
        print(rows[extra], flush=True)
    of_named = (rows[extra] for extra in named if extra in rows)
    fill(PAGE, {"extras": table("extra | on disk | installed in | what was done with it", of_named)})


if __name__ == "__main__":
    main()
