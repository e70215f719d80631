"""Examine an installation: each finding says what is there, and what to do where it is wrong.

Most broken installations mix Pinocchio from several sources, with libraries that crash on each other. Pinocchio is
therefore first imported in a process of its own. A check that cannot run, for instance because a package is missing
that it needs, is a finding too; the other checks run all the same.
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
PIN_RULE = ">=4.1,<5"
# What a search path must not bring beside this installation.
FOREIGN_MODULES = ("pinocchio", "eigenpy", "coal", "hppfcl", "numpy", "scipy", "numba")
FOREIGN_LIBRARIES = ("libpinocchio*", "libeigenpy*", "libcoal*", "libhpp-fcl*")
REINSTALL = f"pip install --force-reinstall --no-deps {PROJECT}"
START_FRESH = f"make a fresh environment (python -m venv) and pip install {PROJECT} into it alone"
PINOCCHIO_PROBE = """import json, pinocchio as p
print(json.dumps([p.__file__ or "", getattr(p, "__version__", "") if hasattr(p, "crba") else ""]))"""


@dataclass(frozen=True)
class Finding:
    """One thing that was examined; `advice` is one line on what to do where it is not `ok`."""

    name: str
    ok: bool
    detail: str
    advice: str

    def __str__(self) -> str:
        """Return one line, and the advice on a second one where something is wrong."""
        return f"ok   {self.name}: {self.detail}" if self.ok else f"BAD  {self.name}: {self.detail}\n  -> {self.advice}"


def check_installation() -> list[Finding]:
    """Examine the installation; all is well if every finding is `ok`."""
    findings = _run(_platform, _pinocchio, _search_paths, _requirements, _viewer, _description, _browser)
    if all(finding.ok for finding in findings if finding.name == "pinocchio"):  # the rest needs it
        findings += _run(_urdf, _kernels)
    return findings


def _run(*checks: Callable[[], Iterator[Finding]]) -> list[Finding]:
    findings = []
    for check in checks:
        try:
            findings += list(check())
        except Exception as error:  # whatever a broken installation can raise
            name = check.__name__.strip("_")
            findings.append(Finding(name, False, f"{type(error).__name__}: {error}", START_FRESH))
    return findings


def satisfies(version: str, rule: str) -> bool:
    """Tell whether an installed version obeys a rule such as `>=4.1,<5`; no version obeys none."""
    from packaging.specifiers import SpecifierSet

    return bool(version) and SpecifierSet(rule).contains(version, prereleases=True)


def _installed(name: str) -> str:
    """Return the version of an installed distribution, or nothing."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def _platform() -> Iterator[Finding]:
    rule = str(metadata.metadata(PROJECT)["Requires-Python"]) if _installed(PROJECT) else ">=3.11"
    version = platform.python_version()
    detail = f"{version} at {sys.executable} (wanted: {rule})"
    yield Finding("python", satisfies(version, rule), detail, f"use a Python {rule}")
    libc, release = platform.libc_ver()
    good = sys.platform == "darwin" or (sys.platform == "linux" and libc == "glibc" and satisfies(release, ">=2.28"))
    advice = "pin has wheels for Linux with glibc 2.28 or later and for macOS: use one of these, a container or WSL"
    yield Finding("platform", good, f"{sys.platform} {platform.machine()} {libc} {release}".strip(), advice)


def _pinocchio() -> Iterator[Finding]:
    """Tell which Pinocchio is imported, whether it is the right one, and whether there are several."""
    probe = subprocess.run([sys.executable, "-P", "-c", PINOCCHIO_PROBE], capture_output=True, text=True, check=False)
    if probe.returncode == 0:
        file, version = json.loads(probe.stdout.splitlines()[-1])
        detail = f"{version or 'something else of that name'} from {Path(file).parent} (wanted: {PIN_RULE})"
    else:
        crash = f"importing it ends the process with code {probe.returncode}"  # minus the signal
        file, version, detail = "", "", (probe.stderr.strip().splitlines() or [crash])[-1]
    advice = f"pip install 'pin{PIN_RULE}'; if it is there, {START_FRESH}"
    yield Finding("pinocchio", satisfies(version, PIN_RULE), detail, advice)
    clash = bool(file and _installed("pin")) and "cmeel.prefix" not in Path(file).parts
    origin = " of ROS" if "/opt/ros/" in file else " of conda" if Path(sys.prefix, "conda-meta").is_dir() else ""
    detail = f"the one{origin} in {Path(file).parent} hides pip's pin {_installed('pin')}" if clash else "no second one"
    yield Finding("pinocchio's sources", not clash, detail, f"leave ROS and conda out of this shell, or {START_FRESH}")
    namesake = satisfies(_installed("pinocchio"), "<1")  # a plugin of nose; the robot library's versions start at 1
    detail = "the package 'pinocchio' is another project, the robot library is 'pin'" if namesake else "not installed"
    advice = "pip uninstall pinocchio, then pip install --force-reinstall pin"
    yield Finding("pinocchio's namesake", not namesake, detail, advice)


def _search_paths() -> Iterator[Finding]:
    """Look for other installations where Python and the loader look first; a folder that holds us is our own."""
    for variable, patterns in (("PYTHONPATH", FOREIGN_MODULES), ("LD_LIBRARY_PATH", FOREIGN_LIBRARIES)):
        folders = [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
        others = [folder for folder in folders if not (folder / "aerobat_pin").is_dir()]
        found = [str(path) for folder in others for pattern in patterns for path in folder.glob(pattern)]
        detail = f"brings {', '.join(found[:3])}" if found else "brings no second Pinocchio or numpy"
        yield Finding(variable, not found, detail, f"unset {variable} in this shell (ROS' setup files set it)")


def _requirements() -> Iterator[Finding]:
    """Compare installed packages with what the project requires here, without its extras."""
    from packaging.requirements import Requirement

    for requirement in map(Requirement, metadata.requires(PROJECT) or []):
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            name, rule, version = requirement.name, str(requirement.specifier), _installed(requirement.name)
            detail = f"{version or 'not installed'} (wanted: {rule or 'any'})"
            yield Finding(name, satisfies(version, rule), detail, f"pip install '{name}{rule}'")


def _viewer() -> Iterator[Finding]:
    """Look for what the replay needs: meshcat's page, and the part of pyzmq that meshcat imports."""
    meshcat, loop = find_spec("meshcat"), find_spec("zmq.eventloop.ioloop")
    page = Path((meshcat and meshcat.origin) or "").parent / "viewer" / "dist" / "main.min.js"
    parts = {"meshcat's viewer/dist/main.min.js": page.is_file(), "pyzmq's zmq.eventloop.ioloop": loop is not None}
    missing = ", ".join(name for name, there in parts.items() if not there)
    advice = "pip install --force-reinstall meshcat 'pyzmq<28'; only the replay needs them"
    yield Finding("viewer", not missing, f"missing: {missing}" if missing else "complete", advice)


def _description() -> Iterator[Finding]:
    """Look for every file of every morphology; a mesh must be more than an STL header or a pointer to one."""
    from aerobat_description import MORPHOLOGIES, PACKAGE_PATH

    folder = Path(PACKAGE_PATH)
    kinds = ("morphologies/{}.toml", "urdf/{}.urdf", "srdf/{}.srdf")
    files = [folder / kind.format(name) for name in MORPHOLOGIES for kind in kinds]
    for urdf in folder.glob("urdf/*.urdf"):
        files += [folder / "meshes" / name for name in re.findall(r'/meshes/([^"]+)"', urdf.read_text("utf-8"))]
    bad = [path.name for path in files if not path.is_file() or (path.suffix == ".stl" and path.stat().st_size < 200)]
    detail = f"missing or empty: {', '.join(bad)}" if bad else f"{len(files)} files in {folder}"
    yield Finding("description", not bad, detail, REINSTALL)


def _browser() -> Iterator[Finding]:
    """Look for what takes pictures of a replay, which is optional: any browser shows the replay itself."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    for name, found, advice in (
        ("chromium", chromium, "apt-get install chromium"),
        ("playwright", _installed("playwright"), f"pip install '{PROJECT}[frames]'"),
    ):
        missing = f"not installed: only `aerobat play --frames` and the tests want it (`{advice}`)"
        yield Finding(name, True, found or missing, advice)


def _urdf() -> Iterator[Finding]:
    """Read the URDF as any tool would, and weigh it."""
    import pinocchio as pin

    from aerobat_description import URDF_PATH
    from aerobat_description.morphology import Morphology

    model = pin.buildModelFromUrdf(URDF_PATH, pin.JointModelFreeFlyer())
    mass, expected = float(pin.computeTotalMass(model)), Morphology.load("aerobat").mass
    detail = f"{1e3 * mass:.3f} g, nv = {model.nv} (wanted: {1e3 * expected:.3f} g, nv = 10)"
    yield Finding("URDF", abs(mass - expected) < 1e-9 * expected and model.nv == 10, detail, REINSTALL)


def _kernels() -> Iterator[Finding]:
    """Tell where numba keeps the compiled kernels."""
    from aerobat_pin.flight import advance_stage
    from aerobat_pin.numerics import is_compiled

    folder = getattr(getattr(advance_stage, "stats", None), "cache_path", None)
    state = "compiled" if is_compiled(advance_stage) else "not compiled yet: the first run takes some 20 s more"
    detail = f"{folder}, {state}" if folder else "nowhere to write: every start compiles for about 20 s"
    yield Finding("kernel cache", bool(folder), detail, "set NUMBA_CACHE_DIR to a folder that can be written")
