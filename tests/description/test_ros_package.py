"""`aerobat_description` is also a ROS package: valid, installed by CMake, and found by those who look the ROS way."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from xml.etree import ElementTree as ET

import pinocchio as pin
import pytest

import aerobat_description as description

PACKAGE = Path(description.PACKAGE_PATH)
PROJECT = tomllib.loads((Path(__file__).resolve().parents[2] / "pyproject.toml").read_text())["project"]
VISIBLE_PARTS = Path(description.URDF_PATH).read_text().count("<mesh ")
CMAKE = shutil.which("cmake")
# What ament_package() does, as far as a package of data sees it: install the manifest, leave a mark in the index.
AMENT = """
macro(ament_package)
  install(FILES package.xml DESTINATION share/${PROJECT_NAME})
  file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/mark "")
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/mark
    DESTINATION share/ament_index/resource_index/packages RENAME ${PROJECT_NAME})
endmacro()
"""


def visible_parts(urdf: str | Path) -> int:
    """Count the meshes that Pinocchio finds without being told any folder."""
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    return int(pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL).ngeoms)


def test_the_manifest_is_of_format_3_and_agrees_with_the_project() -> None:
    """REP 149: name, version, description, maintainer with an address and licence; built by ament_cmake."""
    package = ET.parse(PACKAGE / "package.xml").getroot()
    assert (package.tag, package.get("format")) == ("package", "3")
    required = {"name", "version", "description", "maintainer", "license"}
    assert required <= {element.tag for element in package}
    assert package.findtext("name") == description.__name__
    assert package.findtext("version") == PROJECT["version"]
    assert package.findtext("license") == PROJECT["license"]
    assert package.find("maintainer").text == PROJECT["authors"][0]["name"]
    assert re.fullmatch(r"[\w.]+@[\w.]+\.[a-z]{2,}", package.find("maintainer").get("email"))
    assert package.findtext("buildtool_depend") == package.findtext("export/build_type") == "ament_cmake"


def test_whoever_looks_in_ros_package_path_finds_the_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    """ROS's variable names the folder that holds the package's folder."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setenv("ROS_PACKAGE_PATH", description.REPOSITORY_PATH)
    assert visible_parts(description.URDF_PATH) == VISIBLE_PARTS


@pytest.mark.skipif(CMAKE is None, reason="no CMake on this machine: install it, e.g. `apt-get install cmake`")
@pytest.mark.parametrize("ament", [True, False], ids=["ament", "plain"])
def test_cmake_installs_every_data_file_where_ros_looks(
    ament: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With ament_cmake (a stand-in of it) and without; then Pinocchio finds the meshes through AMENT_PREFIX_PATH."""
    build, prefix, stand_in = tmp_path / "build", tmp_path / "prefix", tmp_path / "ament"
    stand_in.mkdir()
    if ament:
        (stand_in / "ament_cmakeConfig.cmake").write_text(AMENT)
    found = f"-Dament_cmake_DIR={stand_in}" if ament else "-DCMAKE_DISABLE_FIND_PACKAGE_ament_cmake=ON"
    for command in (
        [CMAKE, "-S", PACKAGE, "-B", build, f"-DCMAKE_INSTALL_PREFIX={prefix}", found],
        [CMAKE, "--install", build],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
        assert done.returncode == 0, done.stderr
        assert "warning" not in (done.stdout + done.stderr).lower()
    share = prefix / "share" / "aerobat_description"
    data = {name: PACKAGE / name for name in ("LICENSE", "package.xml")}
    for folder in ("linkage", "meshes", "mjcf", "morphologies", "srdf", "urdf"):
        data |= {str(file.relative_to(PACKAGE)): file for file in (PACKAGE / folder).rglob("*") if file.is_file()}
    assert {str(file.relative_to(share)) for file in share.rglob("*") if file.is_file()} == set(data)
    assert all((share / name).read_bytes() == file.read_bytes() for name, file in data.items())
    assert (prefix / "share/ament_index/resource_index/packages/aerobat_description").exists() == ament
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    assert visible_parts(share / "urdf" / "aerobat.urdf") == VISIBLE_PARTS
