"""What can be wrong with an installation: each finding says what is there and what to do about it.

Most broken installations mix Pinocchio from several sources. It is therefore first imported in a process of its own:
libraries that do not fit each other end that process, not this one.
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
PIN = ">=4.1,<5"
PACKAGES = ("pinocchio", "eigenpy", "coal", "hppfcl", "numpy", "scipy", "numba")  # nobody else should bring these
LIBRARIES = ("libpinocchio*", "libeigenpy*", "libcoal*", "libhpp-fcl*")
FRESH = "make a fresh environment (python -m venv) and pip install aerobat-pinocchio into it alone"
PROBE = """import json, pinocchio as p
print(json.dumps([p.__file__ or "", getattr(p, "__version__", "") if hasattr(p, "crba") else ""]))"""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at; `advice` is one line on what to do where it is not `ok`."""

    name: str
    ok: bool
    detail: str
    advice: str

    def __str__(self) -> str:
        """Return one line, and the advice on a second one where something is wrong."""
        return f"ok   {self.name}: {self.detail}" if self.ok else f"BAD  {self.name}: {self.detail}\n  -> {self.advice}"


def check() -> list[Finding]:
    """Examine the installation; all is well if every finding is `ok`. A check that itself fails is a finding too."""
    found = _run(_platform, _pinocchio, _search_paths, _requirements, _viewer, _description, _browser)
    if all(one.ok for one in found if one.name == "pinocchio"):  # what needs it could only say once more that it is bad
        found += _run(_model, _kernels)
    return found


def _run(*checks: Callable[[], Iterator[Finding]]) -> list[Finding]:
    found = []
    for one in checks:
        try:
            found += list(one())
        except Exception as error:  # whatever a broken installation can raise
            found.append(Finding(one.__name__.strip("_"), False, f"{type(error).__name__}: {error}", FRESH))
    return found


def satisfies(version: str, rule: str) -> bool:
    """Tell whether a version obeys a rule such as `>=4.1,<5`, by numbers: 4.10 comes after 4.9."""
    try:
        from packaging.specifiers import SpecifierSet
    except ImportError:
        return satisfies_by_release(version, rule)
    return bool(version) and SpecifierSet(rule).contains(version, prereleases=True)


def satisfies_by_release(version: str, rule: str) -> bool:
    """Do as `satisfies` without `packaging`: compare releases alone, by >=, <=, >, <, == and !=."""
    allowed = {">=": (0, 1), "<=": (0, -1), ">": (1,), "<": (-1,), "==": (0,), "!=": (-1, 1)}
    here = _release(version)
    pairs = [(operator, _release(text)) for operator, text in re.findall(r"([<>=!]=|[<>])\s*([^,\s]+)", rule)]
    return bool(version) and all((here > there) - (here < there) in allowed[operator] for operator, there in pairs)


def _release(version: str) -> tuple[int, ...]:
    numbers = re.findall(r"\d+", re.sub(r"[^\d.].*", "", version))
    return tuple(int(number) for number in [*numbers, *"000000"][:6])


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
    done = subprocess.run([sys.executable, "-P", "-c", PROBE], capture_output=True, text=True, check=False)
    if done.returncode == 0:
        file, version = json.loads(done.stdout.splitlines()[-1])
        detail = f"{version or 'something else of that name'} from {Path(file).parent} (wanted: {PIN})"
    else:
        crash = f"importing it ends the process with code {done.returncode}"  # minus the signal
        file, version, detail = "", "", (done.stderr.strip().splitlines() or [crash])[-1]
    yield Finding("pinocchio", satisfies(version, PIN), detail, f"pip install 'pin{PIN}'; if it is there, {FRESH}")
    clash = bool(file and _installed("pin")) and "cmeel.prefix" not in Path(file).parts
    origin = " of ROS" if "/opt/ros/" in file else " of conda" if Path(sys.prefix, "conda-meta").is_dir() else ""
    detail = f"the one{origin} in {Path(file).parent} hides pip's pin {_installed('pin')}" if clash else "no second one"
    yield Finding("pinocchio's sources", not clash, detail, f"leave ROS and conda out of this shell, or {FRESH}")
    foreign = satisfies(_installed("pinocchio"), "<1")  # a plugin of nose; the real one's versions start at 1
    detail = "the package 'pinocchio' is another project, the robot library is 'pin'" if foreign else "not installed"
    advice = "pip uninstall pinocchio, then pip install --force-reinstall pin"
    yield Finding("pinocchio's namesake", not foreign, detail, advice)


def _search_paths() -> Iterator[Finding]:
    """Look for what is not ours where Python and the loader look first. A folder with us inside is one installation."""
    for variable, names in (("PYTHONPATH", PACKAGES), ("LD_LIBRARY_PATH", LIBRARIES)):
        folders = [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
        foreign = [folder for folder in folders if not (folder / "aerobat_pin").is_dir()]
        found = [str(path) for folder in foreign for name in names for path in folder.glob(name)]
        detail = f"brings {', '.join(found[:3])}" if found else "brings no second Pinocchio or numpy"
        yield Finding(variable, not found, detail, f"unset {variable} in this shell (ROS' setup files set it)")


def _requirements() -> Iterator[Finding]:
    """Hold every installed package against the project's own requirements."""
    for requirement in metadata.requires(PROJECT) or []:
        parts = re.match(r"([\w.-]+)\s*(?:\[[^]]*\])?\s*\(?([^;)]*)\)?\s*(;.*)?$", requirement)
        if parts and "extra" not in (parts.group(3) or ""):
            name, rule = parts.group(1), parts.group(2).strip()
            version = _installed(name)
            detail = f"{version or 'not installed'} (wanted: {rule or 'any'})"
            yield Finding(name, satisfies(version, rule), detail, f"pip install '{name}{rule}'")


def _viewer() -> Iterator[Finding]:
    """The replay needs meshcat's page, and meshcat a part of pyzmq that will go one day."""
    meshcat, loop = find_spec("meshcat"), find_spec("zmq.eventloop.ioloop")
    page = Path((meshcat and meshcat.origin) or "").parent / "viewer" / "dist" / "main.min.js"
    parts = {"meshcat's viewer/dist/main.min.js": page.is_file(), "pyzmq's zmq.eventloop.ioloop": loop is not None}
    missing = [name for name, there in parts.items() if not there]
    advice = "pip install --force-reinstall meshcat 'pyzmq<28'; only the replay needs them"
    yield Finding("viewer", not missing, f"missing: {', '.join(missing)}" if missing else "complete", advice)


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
    yield Finding("description", not bad, detail, f"pip install --force-reinstall --no-deps {PROJECT}")


def _browser() -> Iterator[Finding]:
    """Any browser shows the replay; pictures of it, which are optional, take Playwright and a Chromium."""
    path = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
        "no Chromium in PATH: only `aerobat play --frames` and the tests want one (`apt-get install chromium`)",
    )
    yield Finding("browser", True, path, "any browser shows the replay")
    version, advice = _installed("playwright"), f"pip install '{PROJECT}[frames]'"
    missing = f"not installed: only `aerobat play --frames` and the tests want it (`{advice}`)"
    yield Finding("playwright", True, version or missing, advice)


def _model() -> Iterator[Finding]:
    """Read the URDF as any tool would, and weigh it."""
    import pinocchio as pin

    from aerobat_description import URDF_PATH
    from aerobat_description.morphology import Morphology

    model = pin.buildModelFromUrdf(URDF_PATH, pin.JointModelFreeFlyer())
    mass, expected = float(pin.computeTotalMass(model)), Morphology.load("aerobat").mass
    detail = f"{1e3 * mass:.3f} g, nv = {model.nv} (wanted: {1e3 * expected:.3f} g, nv = 10)"
    good = abs(mass - expected) < 1e-9 * expected and model.nv == 10
    yield Finding("URDF", good, detail, f"pip install --force-reinstall --no-deps {PROJECT}")


def _kernels() -> Iterator[Finding]:
    """Tell where numba keeps the compiled kernels."""
    from aerobat_pin.flight import advance_stage
    from aerobat_pin.numerics import is_compiled

    folder = getattr(getattr(advance_stage, "stats", None), "cache_path", None)
    detail = "nowhere to write: every start compiles for about 20 s"
    if folder:
        state = "compiled" if is_compiled(advance_stage) else "not compiled yet: the first run takes some 20 s more"
        detail = f"{folder}, {state}"
    yield Finding("kernel cache", bool(folder), detail, "set NUMBA_CACHE_DIR to a folder that can be written")
