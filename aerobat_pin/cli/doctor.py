"""Examine an installation: each finding says what is installed, and what to do if something is wrong.

Most broken installations mix copies of Pinocchio from several sources, and their libraries crash when they are loaded
together. Pinocchio is therefore first imported in a separate process. If a check cannot run, for instance because a
package that it needs is missing, this is reported as a finding, and the other checks still run.
"""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

PROJECT = "aerobat-pinocchio"
PIN_RULE = ">=4.0,<5"
# Modules and libraries that other folders of the search paths must not contain.
FOREIGN_MODULES = ("pinocchio", "eigenpy", "coal", "hppfcl", "numpy", "scipy", "numba")
FOREIGN_LIBRARIES = ("libpinocchio*", "libeigenpy*", "libcoal*", "libhpp-fcl*")
REINSTALL = "pip install --force-reinstall --no-deps . in this project's folder"
START_FRESH = "make a fresh environment (python -m venv), and in this project's folder pip install . into it alone"
PINOCCHIO_PROBE = """import json, pinocchio as p
print(json.dumps([p.__file__ or "", getattr(p, "__version__", "") if hasattr(p, "crba") else ""]))"""


@dataclass(frozen=True)
class Verified:
    """The result of one check; `advice` is a line that says what to do if the result is not `ok`."""

    name: str
    ok: bool
    detail: str
    advice: str

    def __str__(self) -> str:
        """Return the finding as one line of text; if it is not `ok`, a second line has the advice."""
        return f"ok   {self.name}: {self.detail}" if self.ok else f"BAD  {self.name}: {self.detail}\n  -> {self.advice}"


def check_installation() -> list[Verified]:
    """Run all checks and return their findings; the installation works if every finding is `ok`."""
    findings = _run(_platform, _pinocchio, _search_paths, _requirements, _viewer, _description, _browser)
    if all(finding.ok for finding in findings if finding.name == "pinocchio"):  # the other checks import Pinocchio
        findings += _run(_urdf, _kernels)
    return findings


def _run(*checks: Callable[[], Iterator[Verified]]) -> list[Verified]:
    findings = []
    for check in checks:
        try:
            findings += list(check())
        except Exception as error:  # a broken installation can raise anything
            name = check.__name__.strip("_")
            findings.append(Verified(name, False, f"{type(error).__name__}: {error}", START_FRESH))
    return findings


def satisfies(version: str, rule: str) -> bool:
    """Return whether a version satisfies a rule such as `>=4.1,<5`; an empty version satisfies no rule."""
    from packaging.specifiers import SpecifierSet

    return bool(version) and SpecifierSet(rule).contains(version, prereleases=True)


def _installed(name: str) -> str:
    """Return the version of an installed distribution, or an empty string."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def _platform() -> Iterator[Verified]:
    rule = str(metadata.metadata(PROJECT)["Requires-Python"]) if _installed(PROJECT) else ">=3.11"
    version = platform.python_version()
    detail = f"{version} at {sys.executable} (wanted: {rule})"
    yield Verified("python", satisfies(version, rule), detail, f"use a Python {rule}")
    libc, release = platform.libc_ver()
    good = sys.platform == "darwin" or (sys.platform == "linux" and libc == "glibc" and satisfies(release, ">=2.28"))
    advice = "pin has wheels for Linux with glibc 2.28 or later and for macOS: use one of these, a container or WSL"
    yield Verified("platform", good, f"{sys.platform} {platform.machine()} {libc} {release}".strip(), advice)


def _pinocchio() -> Iterator[Verified]:
    """Report which Pinocchio is imported, whether its version is right, and whether several are installed."""
    probe = subprocess.run([sys.executable, "-P", "-c", PINOCCHIO_PROBE], capture_output=True, text=True, check=False)
    if probe.returncode == 0:
        file, version = json.loads(probe.stdout.splitlines()[-1])
        detail = f"{version or 'something else of that name'} from {Path(file).parent} (wanted: {PIN_RULE})"
    else:
        crash = f"importing it ends the process with code {probe.returncode}"  # negative: number of the signal
        file, version, detail = "", "", (probe.stderr.strip().splitlines() or [crash])[-1]
    advice = f"pip install 'pin{PIN_RULE}'; if it is there, {START_FRESH}"
    yield Verified("pinocchio", satisfies(version, PIN_RULE), detail, advice)
    clash = bool(file and _installed("pin")) and "cmeel.prefix" not in Path(file).parts
    origin = " of ROS" if "/opt/ros/" in file else " of conda" if Path(sys.prefix, "conda-meta").is_dir() else ""
    detail = f"the one{origin} in {Path(file).parent} hides pip's pin {_installed('pin')}" if clash else "no second one"
    yield Verified("pinocchio's sources", not clash, detail, f"leave ROS and conda out of this shell, or {START_FRESH}")
    namesake = satisfies(_installed("pinocchio"), "<1")  # a plugin of nose; the robot library's versions start at 1
    detail = "the package 'pinocchio' is another project, the robot library is 'pin'" if namesake else "not installed"
    advice = "pip uninstall pinocchio, then pip install --force-reinstall pin"
    yield Verified("pinocchio's namesake", not namesake, detail, advice)


def _search_paths() -> Iterator[Verified]:
    """Search PYTHONPATH and LD_LIBRARY_PATH for other installations; folders that contain this package are skipped."""
    for variable, patterns in (("PYTHONPATH", FOREIGN_MODULES), ("LD_LIBRARY_PATH", FOREIGN_LIBRARIES)):
        folders = [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
        others = [folder for folder in folders if not (folder / "aerobat_pin").is_dir()]
        foreign = [str(path) for folder in others for pattern in patterns for path in folder.glob(pattern)]
        detail = f"brings {', '.join(foreign[:3])}" if foreign else "brings no second Pinocchio or numpy"
        yield Verified(variable, not foreign, detail, f"unset {variable} in this shell (ROS' setup files set it)")


def _requirements() -> Iterator[Verified]:
    """Compare the installed packages with the requirements of the project, without its extras."""
    from packaging.requirements import Requirement

    for requirement in map(Requirement, metadata.requires(PROJECT) or []):
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            name, rule, version = requirement.name, str(requirement.specifier), _installed(requirement.name)
            detail = f"{version or 'not installed'} (wanted: {rule or 'any'})"
            yield Verified(name, satisfies(version, rule), detail, f"pip install '{name}{rule}'")


def _viewer() -> Iterator[Verified]:
    """Check what the replay needs: the page of meshcat, and the part of pyzmq that meshcat imports."""
    meshcat, loop = find_spec("meshcat"), find_spec("zmq.eventloop.ioloop")
    page = Path((meshcat and meshcat.origin) or "").parent / "viewer" / "dist" / "main.min.js"
    parts = {"meshcat's viewer/dist/main.min.js": page.is_file(), "pyzmq's zmq.eventloop.ioloop": loop is not None}
    missing = ", ".join(name for name, present in parts.items() if not present)
    advice = "pip install --force-reinstall meshcat 'pyzmq<28'; only the replay needs them"
    yield Verified("viewer", not missing, f"missing: {missing}" if missing else "complete", advice)


def _description() -> Iterator[Verified]:
    """Check every file of every morphology; an STL file of less than 200 bytes is no mesh (header or LFS pointer)."""
    from aerobat_description import MORPHOLOGIES, PACKAGE_PATH

    folder = Path(PACKAGE_PATH)
    kinds = ("morphologies/{}.toml", "urdf/{}.urdf", "srdf/{}.srdf")
    files = [folder / kind.format(name) for name in MORPHOLOGIES for kind in kinds]
    for urdf in folder.glob("urdf/*.urdf"):
        files += [folder / "meshes" / name for name in re.findall(r'/meshes/([^"]+)"', urdf.read_text("utf-8"))]
    bad = [path.name for path in files if not path.is_file() or (path.suffix == ".stl" and path.stat().st_size < 200)]
    detail = f"missing or empty: {', '.join(bad)}" if bad else f"{len(files)} files in {folder}"
    yield Verified("description", not bad, detail, REINSTALL)


def _browser() -> Iterator[Verified]:
    """Check what is needed to take pictures of a replay; this is optional, as any browser can show the replay."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    for name, path, advice in (
        ("chromium", chromium, "apt-get install chromium"),
        ("playwright", _installed("playwright"), f"pip install '{PROJECT}[frames]'"),
    ):
        missing = f"not installed: only `aerobat play --frames` and the tests want it (`{advice}`)"
        yield Verified(name, True, path or missing, advice)


def _urdf() -> Iterator[Verified]:
    """Load the URDF with Pinocchio, and compare its mass with that of the morphology."""
    import pinocchio as pin

    from aerobat_description import URDF_PATH
    from aerobat_description.morphology import Morphology

    model = pin.buildModelFromUrdf(URDF_PATH, pin.JointModelFreeFlyer())
    mass, expected = float(pin.computeTotalMass(model)), Morphology.load("aerobat").mass
    detail = f"{1e3 * mass:.3f} g, nv = {model.nv} (wanted: {1e3 * expected:.3f} g, nv = 10)"
    yield Verified("URDF", abs(mass - expected) < 1e-9 * expected and model.nv == 10, detail, REINSTALL)


def _kernels() -> Iterator[Verified]:
    """Report the folder in which the compiled kernels of one room are kept."""
    from aerobat_pin.aerobat import estimate_flight  # noqa: F401  # imports all kernels
    from aerobat_pin.flight import advance_stage
    from aerobat_pin.numerics import is_compiled

    folder = getattr(getattr(advance_stage, "stats", None), "cache_path", None)
    state = "compiled" if is_compiled(advance_stage) else "not compiled yet: the first run takes some 20 s more"
    detail = f"{folder}, {state}" if folder else "nowhere to write: every start compiles for about 20 s"
    yield Verified("kernel cache", bool(folder), detail, "set NUMBA_CACHE_DIR to a folder that can be written")
