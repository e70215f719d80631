"""What the package says about itself: licences of others, citation, classifiers; and the sdist makes the same wheel."""

from __future__ import annotations

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

from aerobat_pin.visualization.replay.page import viewer_script

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
LEFT_OUT = shutil.ignore_patterns(".*", "build", "dist", "runs", "*.egg-info", "__pycache__", "docs", "tests")
SDIST = "import sys, setuptools.build_meta as made; print(made.build_sdist(sys.argv[1]))"


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


def test_the_citation_is_of_this_version_and_names_the_paper() -> None:
    """Version, licence, authors and identifiers."""
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    for part in (f"version: {PROJECT['version']}", "license: BSD-2-Clause", "doi: 10.48550/arXiv.2411.11218"):
        assert part in text
    assert re.findall(r"family-names: (\w+)", text) == ["Gupta", "Sihite", "Ramezani"]


def test_the_classifiers_name_the_pythons_that_are_allowed() -> None:
    """The lowest and the highest of `requires-python`, and all between."""
    low, high = map(int, re.findall(r"3\.(\d+)", PROJECT["requires-python"]))
    named = {int(found) for one in PROJECT["classifiers"] for found in re.findall(r":: 3\.(\d+)$", one)}
    assert named == set(range(low, high))


def test_the_sdist_makes_a_wheel_with_the_same_files(tmp_path: Path) -> None:
    """Built offline with this environment's setuptools, from a copy of the project."""
    if int(metadata.version("setuptools").split(".")[0]) < 77:
        pytest.fail("setuptools cannot build the sdist: pip install -e '.[test]' brings one that can")
    source, made = tmp_path / "source", tmp_path / "made"
    shutil.copytree(ROOT, source, ignore=LEFT_OUT)
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "PIP_"))}
    subprocess.run([sys.executable, "-c", SDIST, made], cwd=source, env=environment, check=True, capture_output=True)
    [archive] = made.glob("aerobat_pinocchio-*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.2 has none
        packed.extractall(tmp_path / "unpacked")
    [folder] = (tmp_path / "unpacked").iterdir()
    offline = ["--no-deps", "--no-index", "--no-build-isolation", "--quiet", "-w", made]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *offline, folder], env=environment, check=True)
    [wheel] = made.glob("*.whl")
    packed_files = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    ours = {
        path.relative_to(ROOT).as_posix()
        for package in ("aerobat_description", "aerobat_pin")
        for path in (ROOT / package).rglob("*.*")
        if path.suffix in {".py", ".toml", ".urdf", ".srdf", ".stl", ".typed", ".xml", ".html", ".css", ".svg"}
    }
    assert ours <= packed_files
