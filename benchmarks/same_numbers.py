"""Do two checkouts give the same numbers? `python benchmarks/same_numbers.py BEFORE [AFTER]`, folders of checkouts.

Gives the same commands to both, in processes of their own: every shipped scenario, a sweep, Aerobat's tables, small
recordings of an arm, a quadruped and a drone by their maps (`tests/support/small_recordings.py` of AFTER writes them),
calibrations of each kind and their use, and the self-check. Prints a line for each: the largest relative difference of
all that it writes, of how many values, in how many seconds, and where the worst ones are. Compared are `metrics.json`,
every channel of NetCDF files, tables of text, calibrations, and the lines that a self-check prints.

* A channel's differences are relative to its largest value; those of a channel that only rises, a clock, to its span.
* Prose may be worded anew, which is told; its numbers may not change, and neither may a text of one word.
* A calibration's file of a form that is read no more is told, and is not compared: that work is then not the same.
* What only AFTER has is told. What only BEFORE has is a difference, unless `MOVED` names it.
* `--keep DIR` keeps the small recordings and the results of BEFORE; where they are there already, only AFTER runs.

Ends with exit code 1 where a difference is above that of `--limit` (default 0: equal to the last bit).
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from compared_numbers import compare

MOVED: dict[str, str | None] = {
    # "file key" of BEFORE as a pattern of re.sub -> the same in AFTER; None: no longer written
    # Checks of 2c88454 that compare something else now: integrals, axis by axis, under names of their own.
    r"^metrics\.json \.checks\.(velocity against position|gyro against pose|quaternion|accelerometer)[.#]": None,
}

HERE = Path(__file__).resolve().parents[1]
SHOWN = 5  # places of differences, and new keys, that are printed
COMMAND = """
import sys
import aerobat_pin
from aerobat_pin.cli import main

checkout = sys.argv.pop(1)
assert aerobat_pin.__file__.startswith(checkout), f"{aerobat_pin.__file__} is not in {checkout}"
sys.argv[0] = "aerobat"
if sys.argv[1] == "estimate":  # which has no --no-report: pixels take half the time, and nothing compares them
    from matplotlib.figure import Figure

    Figure.savefig = lambda *words, **more: None
main()
"""


@dataclass(frozen=True)
class Work:
    """What both checkouts do.

    In a command `{files}` are the small recordings, `{own}/NAME` are the results of another work by the same checkout,
    and `{before}/NAME` those by BEFORE. `out` is added to it as `--out`; with none, its numbers are those it prints.
    """

    name: str
    command: str
    out: str = "{own}/{name}"

    def words(self, **places: str) -> list[str]:
        """Return the words of the command."""
        out = f" --out {self.out}" if self.out else ""
        return [word.format(name=self.name, **places) for word in f"{self.command}{out}".split()]

    @property
    def needs(self) -> list[str]:
        """Names of the works whose results this one uses."""
        return re.findall(r"\{(?:own|before)\}/(\w+)", self.command)


def calibration(name: str, command: str) -> Work:
    """Return a work that writes a calibration's file."""
    return Work(name, f"calibrate {command}", "{own}/{name}/calibration.nc")


def works() -> dict[str, Work]:
    """Return all works by name, each after those that it needs."""
    shipped = sorted(path.stem for path in (HERE / "aerobat_pin" / "scenario" / "shipped").glob("*.toml"))
    free = "--no-report --set unknown_force=[] --set simulation.duration=1"
    dense, dense_air = "--set believed.air.density=1.47", "--set air.density=1.47"
    fast = "--set flight.velocity=[3.6,0,0] --set crank.frequency=5.5"
    guard = "--morphology aerobat_guard --set robot.changes.wing.offset_x=-0.060"
    four = "--observer momentum --observer force_level --observer kalman --observer smoother"
    others = "--observer second_order --observer super_twisting"
    short = "--no-report --set simulation.duration=0.5"

    def by(name: str) -> str:
        return f"--calibration {{own}}/{name}/calibration.nc"

    listed = [
        *(Work(name, f"run {name} --no-report") for name in shipped),
        Work("sweep", "sweep {files}/sweep.toml --jobs 1"),
        Work("exact", f"run paper {short}"),
        Work("exact_again", "estimate {own}/exact/flight.nc"),
        Work("exact_old", "estimate {before}/exact/flight.nc"),
        Work("noisy", f"run noisy_sensors {short} {others}"),
        Work("noisy_again", f"estimate {{own}}/noisy/flight.nc {four}"),
        Work("raw", f"run raw_sensors {short} --observer kalman --observer smoother"),
        Work("raw_again", "estimate {own}/raw/flight.nc --observer smoother"),
        Work("hall", f"estimate {{files}}/hall.csv {guard} {four}"),
        Work("hall_raw", f"estimate {{files}}/hall_raw.csv {guard} --observer smoother --observer kalman"),
        Work("self_check", "estimate --self-check --morphology aerobat_guard", ""),
        Work("self_check_light", "estimate --self-check --morphology aerobat_light", ""),
        Work("free", f"run paper {free} {dense}"),
        Work("free_fast", f"run paper {free} {dense} {fast}"),
        calibration("series", "{own}/free"),
        Work("with_series", f"run paper {short} {dense} {by('series')}"),
        calibration("density", "{own}/free --identify density --harmonics 2"),
        Work("with_density", f"run paper {short} {dense} {by('density')}"),
        calibration("varied", "{own}/free {own}/free_fast --identify none"),
        Work("with_varied", f"run paper {short} {dense} {fast} {by('varied')}"),
        calibration("table", f"{{files}}/hall_free.csv {guard} {dense_air}"),
        Work("with_table", f"estimate {{files}}/hall.csv {guard} {dense_air} {by('table')}"),
        Work("free_raw", f"run raw_sensors {free}"),
        calibration("mount", "{own}/free_raw"),
        Work("with_mount", f"run raw_sensors {short} {by('mount')}"),
        Work("arm", "estimate {files}/arm.csv --map {files}/arm_fit.toml"),
        calibration("arm_free", "{files}/arm_free.csv --map {files}/arm.toml --identify mass"),
        Work("with_arm_free", f"estimate {{files}}/arm.csv --map {{files}}/arm.toml {by('arm_free')}"),
        Work("walk", "estimate {files}/walk.csv --map {files}/walk.toml"),
        Work("walk_netcdf", "estimate {files}/walk.nc --map {files}/walk.toml"),
        Work("walk_bag", "estimate {files}/walk --map {files}/walk_bag.toml"),
        Work("walk_mcap", "estimate {files}/walk/walk.mcap --map {files}/walk_bag.toml"),
        Work("walk_cell", "estimate {files}/walk.csv --map {files}/cell.toml"),
        Work("drone", "estimate {files}/drone.csv --map {files}/drone.toml"),
        Work("drone_known", "estimate {files}/drone_wind.csv --map {files}/drone_known.toml"),
        calibration("thrust", "{files}/drone.csv --map {files}/drone.toml"),
        Work("with_thrust", f"estimate {{files}}/drone_wind.csv --map {{files}}/drone.toml {by('thrust')}"),
    ]
    return {work.name: work for work in listed}


def chosen(every: dict[str, Work], only: list[str]) -> dict[str, Work]:
    """Return these works and those that they need, in order."""
    names = set(only)
    for work in reversed(every.values()):
        names |= {*work.needs} if work.name in names else set()
    return {name: work for name, work in every.items() if name in names}


def environment(checkout: Path) -> dict[str, str]:
    """Return an environment that imports a checkout's packages, even from within another checkout's folder."""
    return {**os.environ, "PYTHONPATH": f"{checkout}{os.pathsep}{checkout / 'tests'}", "PYTHONSAFEPATH": "1"}


def do(work: Work, checkout: Path, folder: Path, **places: str) -> str:
    """Do a work within a folder that has a folder for each; return what the command says where it fails."""
    shutil.rmtree(folder / work.name, ignore_errors=True)
    (folder / work.name).mkdir(parents=True)
    words = [sys.executable, "-c", COMMAND, str(checkout), *work.words(own=".", **places)]
    ran = subprocess.run(words, cwd=folder, env=environment(checkout), capture_output=True, text=True, check=False)
    if not work.out:
        (folder / work.name / "printed.txt").write_text(ran.stdout)
    return ran.stderr.strip() or f"exit code {ran.returncode}" if ran.returncode else ""


def do_once(work: Work, checkout: Path, folder: Path, **places: str) -> None:
    """Do a work of BEFORE unless the folder has it by the same commit and command; SystemExit where it fails."""
    commit = subprocess.run(["git", "-C", checkout, "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    mark, made = folder / work.name / "made_by.txt", f"{commit.stdout.strip()} {work.command}"
    if mark.is_file() and mark.read_text() == made:
        return
    if said := do(work, checkout, folder, **places):
        raise SystemExit(f"{checkout}: aerobat {work.command}\n{said}")
    mark.write_text(made)


def write_files(checkout: Path, files: Path) -> None:
    """Write the small recordings unless they are there."""
    if not files.is_dir():
        making = files.with_name(f"{files.name}-{os.getpid()}")
        words = [sys.executable, "-m", "support.small_recordings", str(making)]
        subprocess.run(words, env=environment(checkout), check=True)
        making.rename(files)


def tell(lines: list[str]) -> None:
    """Print the first lines, and how many more there are."""
    for line in lines[:SHOWN]:
        print(f"    {line}", flush=True)
    if len(lines) > SHOWN:
        print(f"    ... {len(lines) - SHOWN} more", flush=True)


def main() -> int:
    """Run both checkouts and print a line for each work."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before", type=Path, help="checkout")
    parser.add_argument("after", type=Path, nargs="?", default=HERE, help="checkout; this one when omitted")
    parser.add_argument("--limit", type=float, default=0.0, help="largest relative difference allowed")
    parser.add_argument("--only", nargs="+", metavar="NAME", help=f"of {', '.join(works())}; all when omitted")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep, or use, what BEFORE made")
    given = parser.parse_args()
    before, after = given.before.resolve(), given.after.resolve()
    every = works()
    if unknown := set(given.only or ()) - set(every):
        parser.error(f"--only: {', '.join(sorted(unknown))}: not one of {', '.join(every)}")
    good, began = True, time.monotonic()
    with tempfile.TemporaryDirectory() as work_folder:
        folder, kept = Path(work_folder), (given.keep or Path(work_folder)).resolve()
        places = {"files": str(kept / "files"), "before": str(kept / "before")}
        kept.mkdir(parents=True, exist_ok=True)
        write_files(after, kept / "files")
        for name, work in chosen(every, given.only or list(every)).items():
            do_once(work, before, kept / "before", **places)
            start = time.monotonic()
            said = do(work, after, folder / "after", **places)
            took = time.monotonic() - start
            if said:
                print(f"{name:<24} FAILS: {said.splitlines()[-1]}", flush=True)
                good = False
                continue
            found = compare(kept / "before" / name, folder / "after" / name, MOVED)
            worst, where = found.places[0] if found.places else (0.0, "")
            good = good and found.count > 0 and worst <= given.limit
            print(f"{name:<24} {worst:.1e} of {found.count:>4} values {took:5.1f} s  {where}", flush=True)
            tell([f"{size:.1e}  {place}" for size, place in found.places[1:] if size > given.limit])
            tell(found.told)
    print(f"{time.monotonic() - began:.0f} s; {'the same' if good else 'NOT the same'} within {given.limit:g}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
