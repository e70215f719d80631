"""The wheel, built offline from a copy of the project and run from elsewhere; what the package says about itself."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from support.lowest import lowest

from aerobat_pin.visualization.template import viewer_script

ROOT = Path(__file__).resolve().parents[2]
LEFT_OUT = shutil.ignore_patterns(".*", "build", "dist", "runs", "*.egg-info", "__pycache__")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
SDIST = "import sys, setuptools.build_meta as made; print(made.build_sdist(sys.argv[1]))"
PACKAGES = ("aerobat_description", "aerobat_pin")
SHORT = ["--set", "simulation.duration=0.01", "--set", "air.warm_up_cycles=0"]
OFFLINE = ["--no-deps", "--no-index", "--no-cache-dir", "--disable-pip-version-check", "--quiet"]
BUILD = [sys.executable, "-m", "pip", "wheel", *OFFLINE, "--no-build-isolation", "-w"]


def environment(**changes: str) -> dict[str, str]:
    """Return this process's environment with nothing in it that finds packages or caches."""
    ours = ("PYTHON", "NUMBA_", "XDG_CACHE_HOME", "PIP_")
    return {key: value for key, value in os.environ.items() if not key.startswith(ours)} | changes


def run(*command: str | Path, cwd: Path, **changes: str) -> subprocess.CompletedProcess[str]:
    """Run a program in an environment of its own; it must succeed."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, env=environment(**changes), capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}\n{done.stderr}"
    return done


def copied(folder: Path) -> Path:
    """Copy the project, for this environment's setuptools to build from: an old `build/` would slip in."""
    setuptools = next((found.version for found in metadata.distributions(name="setuptools")), "0")
    advice = f"setuptools {setuptools} cannot build the wheel: pip install -e '.[test]' brings one that can"
    assert int(setuptools.split(".")[0]) >= 77, advice
    return Path(shutil.copytree(ROOT, folder / "project", ignore=LEFT_OUT))


def files_of(wheel: Path) -> set[str]:
    names = zipfile.ZipFile(wheel).namelist()
    return {name for name in names if not name.endswith("/") and ".dist-info/" not in name}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("wheel")
    run(*BUILD, target, copied(tmp_path_factory.mktemp("source")), cwd=target)
    (made,) = target.iterdir()
    return made


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel alone into an empty folder; what it needs comes from this environment."""
    target = tmp_path_factory.mktemp("installed")
    run(sys.executable, "-m", "pip", "install", *OFFLINE, "--target", target, wheel, cwd=target)
    return target


def python(code: str, installed: Path, cwd: Path, **changes: str) -> str:
    """Run a piece of Python that sees the installed folder; return what it prints."""
    return run(sys.executable, "-c", code, cwd=cwd, PYTHONPATH=str(installed), **changes).stdout.strip()


def test_the_wheel_holds_the_packages_their_data_and_nothing_else(wheel: Path) -> None:
    """Every file of the two packages, the licence, no tests, no documents, under 1.24 MB (95 kB: equal meshes)."""
    names = zipfile.ZipFile(wheel).namelist()
    info = next(name.split("/")[0] for name in names if name.endswith(".dist-info/METADATA"))
    ours = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.name == "LICENSE"
        or path.suffix
        in {".py", ".pyi", ".toml", ".urdf", ".srdf", ".stl", ".obj", ".typed", ".xml", ".txt", ".html", ".css", ".svg"}
    }
    assert files_of(wheel) == ours
    described = [f"aerobat_description/{name}" for name in ("py.typed", "package.xml", "CMakeLists.txt")]
    shipped = ("py.typed", "scenario/shipped/paper.toml", "experiments/sweep/shipped/morphology.toml")
    for one in (*described, *(f"aerobat_pin/{name}" for name in shipped)):
        assert one in ours
    for end in (".toml", ".urdf", ".srdf", ".stl"):
        assert sum(name.startswith("aerobat_description/") and name.endswith(end) for name in ours) >= 3
    assert f"{info}/licenses/LICENSE" in names
    assert wheel.name.endswith("-py3-none-any.whl")
    assert wheel.stat().st_size < 1_240_000


def test_the_wheel_names_no_machine(wheel: Path) -> None:
    """Neither this project's folder nor anybody's home, in any file, binary or not."""
    folder = re.compile(rb"(?<![\w.])/(?:home|root|Users|work|mnt|media|tmp)/\w|[A-Z]:\\\\")
    here = str(ROOT).encode()
    with zipfile.ZipFile(wheel) as archive:
        texts = {name: archive.read(name) for name in archive.namelist()}
    assert [name for name, text in texts.items() if here in text or folder.search(text)] == []


def test_the_installed_program_lists_and_flies(installed: Path, tmp_path: Path) -> None:
    """The script that the wheel installs, from an empty folder; interpreted, as all kernels take half a minute."""
    program = installed / "bin" / "aerobat"
    listed = run(program, "list", cwd=tmp_path, PYTHONPATH=str(installed)).stdout
    for name in ("paper", "aerobat_guard", "momentum"):
        assert name in listed
    run(program, "run", "paper", "--no-report", *SHORT, cwd=tmp_path, PYTHONPATH=str(installed), NUMBA_DISABLE_JIT="1")
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    results = tmp_path / "runs" / "paper"
    assert {path.name for path in results.iterdir()} == {"estimate.nc", "flight.nc", "metrics.json", "scenario.toml"}
    metrics = json.loads((results / "metrics.json").read_text())
    assert metrics["versions"]["aerobat-pinocchio"] == metadata.version("aerobat-pinocchio")


def test_the_installed_robot_comes_with_all_its_parts(installed: Path, tmp_path: Path) -> None:
    """Imported from the folder and not from this project; every visible part has triangles; the URDF is read."""
    code = """
import json, pathlib
import pinocchio as pin
import aerobat_description as described, aerobat_pin
robot = aerobat_pin.load_aerobat()
read, _, visual = pin.buildModelsFromUrdf(described.URDF_PATH, described.PACKAGE_DIRS, pin.JointModelFreeFlyer())
print(json.dumps({
    "files": [aerobat_pin.__file__, described.__file__, described.URDF_PATH, described.SRDF_PATH],
    "triangles": [item.geometry.num_tris for item in robot.visual_model.geometryObjects],
    "read": [item.geometry.num_tris for item in visual.geometryObjects],
    "mass": [robot.mass, pin.computeTotalMass(read)],
}))
"""
    printed = json.loads(python(code, installed, tmp_path))
    assert all(Path(file).is_file() and Path(file).is_relative_to(installed) for file in printed["files"])
    assert len(printed["triangles"]) >= 6
    assert min(printed["triangles"]) > 10
    assert sorted(printed["read"]) == sorted(printed["triangles"])
    assert printed["mass"][0] == pytest.approx(printed["mass"][1], rel=1e-12)


def test_the_page_of_licences_names_every_library() -> None:
    """Those of the package and of each extra, in words of their own."""
    page = (ROOT / "docs" / "licences.md").read_text("utf-8")
    extras = PROJECT["optional-dependencies"]
    needed = [*PROJECT["dependencies"], *(one for listed in extras.values() for one in listed)]
    names = {re.split(r"[\[<>=~ ]", one)[0] for one in needed}
    assert [name for name in sorted(names) if not re.search(rf"(?<![\w-]){name}(?![\w-])", page)] == []
    assert [extra for extra in extras if f"| `{extra}` |" not in page] == []


def test_the_replay_carries_the_licences_of_its_viewer() -> None:
    """Copyright lines of meshcat, three.js and all the others, in a comment before the script."""
    comment, _, script = str(viewer_script()).partition("*/")
    for name in ("Robin Deits", "three.js authors", "Apache License", "ieee754", "Yusuke Kawasaki"):
        assert name.lower() in comment.lower(), name
    assert "</" not in comment
    assert len(script) > 500_000


def test_lower_bounds_are_tried_pythons_are_named_and_the_citation_is_of_this_version() -> None:
    """By `make test-lowest`, which installs exactly these; classifiers have all that `requires-python` allows."""
    bounds = lowest((ROOT / "pyproject.toml").read_text("utf-8"))
    assert [bound for bound in bounds if not re.fullmatch(r"[\w-]+==[\d.]+", bound)] == []
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    for part in (f"version: {PROJECT['version']}", "license: BSD-2-Clause", "doi: 10.48550/arXiv.2411.11218"):
        assert part in text
    assert re.findall(r"family-names: (\w+)", text) == ["Gupta", "Sihite", "Ramezani"]
    low, high = map(int, re.findall(r"3\.(\d+)", PROJECT["requires-python"]))
    named = {int(found) for one in PROJECT["classifiers"] for found in re.findall(r":: 3\.(\d+)$", one)}
    assert named == set(range(low, high))


def test_the_sdist_makes_a_wheel_with_the_same_files(wheel: Path, tmp_path: Path) -> None:
    """Built offline, like the wheel itself."""
    run(sys.executable, "-c", SDIST, tmp_path, cwd=copied(tmp_path))
    [archive] = tmp_path.glob("aerobat_pinocchio-*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.2 has none
        packed.extractall(tmp_path / "unpacked")
    [folder] = (tmp_path / "unpacked").iterdir()
    run(*BUILD, tmp_path, folder, cwd=tmp_path)
    [made] = tmp_path.glob("*.whl")
    assert files_of(made) == files_of(wheel)
