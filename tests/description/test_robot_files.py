"""`aerobat urdf`: a robot as files that every tool loads from anywhere; `aerobat_description` as a ROS package, too."""

import os
import re
import shutil
import subprocess
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import pinocchio as pin
import pytest
import yourdfpy
from support.commands import aerobat

import aerobat_description as description
from aerobat_description import URDF_PATH
from aerobat_pin.aerobat import load_aerobat

MINE = 'extends = "aerobat_guard"\nname = "mine"\n[scale]\nspan = 1.1\n[body]\nmass = 0.09\n'


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a folder with a morphology file of somebody's own, and stand elsewhere."""
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "my_robot.toml").write_text(MINE)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    return folder


def in_pinocchio(file: Path, dirs: list[str]) -> tuple[float, int]:
    """Return mass [kg] and number of meshes."""
    model, _, visual = pin.buildModelsFromUrdf(str(file), package_dirs=dirs, root_joint=pin.JointModelFreeFlyer())
    assert all(item.geometry.num_tris > 0 for item in visual.geometryObjects)
    return pin.computeTotalMass(model), visual.ngeoms


def in_mujoco(file: Path) -> tuple[float, int]:
    """Return mass [kg] and number of meshes."""
    model = mujoco.MjModel.from_xml_path(str(file))
    return model.body_mass.sum(), model.nmesh


def in_yourdfpy(file: Path) -> tuple[float, int]:
    """Return mass [kg] and number of meshes."""
    tree = yourdfpy.URDF.load(str(file))
    return sum(link.inertial.mass for link in tree.robot.links), len(tree.scene.geometry)


@pytest.mark.parametrize("meshes", ["package", "relative", "absolute"])
def test_a_robot_of_ones_own_loads_from_another_folder(meshes: str, mine: Path) -> None:
    """Same mass and all visible parts in each tool; Pinocchio needs package folders unless paths are absolute."""
    target = mine / "x.urdf"
    done = aerobat("urdf", str(mine / "my_robot.toml"), "--meshes", meshes, "-o", str(target), cwd=Path.cwd())
    assert done.returncode == 0, done.stderr
    dirs = {"package": [str(mine.parent)], "relative": [str(mine)], "absolute": []}[meshes]
    robot = load_aerobat(mine / "my_robot.toml")
    for found in (in_pinocchio(target, dirs), in_mujoco(target), in_yourdfpy(target)):
        assert found == (pytest.approx(robot.mass, rel=1e-12), robot.visual_model.ngeoms)
    assert os.listdir() == []


def test_a_shipped_robot_is_printed_as_it_was_committed(tmp_path: Path) -> None:
    """`aerobat urdf` is the committed file; with absolute paths it loads from anywhere."""
    assert aerobat("urdf", cwd=tmp_path).stdout == Path(URDF_PATH).read_text()
    printed = aerobat("urdf", "aerobat_light", "--meshes", "absolute", cwd=tmp_path).stdout
    (tmp_path / "light.urdf").write_text(printed)
    assert in_pinocchio(tmp_path / "light.urdf", []) == in_yourdfpy(tmp_path / "light.urdf")
    assert in_mujoco(tmp_path / "light.urdf")[0] == pytest.approx(0.020, rel=1e-12)


def test_poses_and_linkage_lie_beside_the_robot_and_leave_the_morphology_alone(mine: Path) -> None:
    """A URDF named like the morphology beside it: the linkage goes to a folder, and finds its meshes from there."""
    own = (mine / "my_robot.toml").read_text()
    done = aerobat("urdf", str(mine / "my_robot.toml"), "-o", str(mine / "my_robot.urdf"), cwd=mine)
    assert done.returncode == 0, done.stderr
    assert (mine / "my_robot.toml").read_text() == own
    model = pin.buildModelFromUrdf(str(mine / "my_robot.urdf"), pin.JointModelFreeFlyer())
    pin.loadReferenceConfigurations(model, str(mine / "my_robot.srdf"))
    poses = load_aerobat(mine / "my_robot.toml").model.referenceConfigurations
    assert {str(item.key()) for item in model.referenceConfigurations} == {str(item.key()) for item in poses}
    bars = tomllib.loads((mine / "linkage" / "my_robot.toml").read_text())["bars"]
    assert [bar["name"] for bar in bars] == [f"L{i}" for i in range(1, 8)]
    assert all((mine / bar[f"{side}_mesh"]).is_file() for bar in bars for side in ("left", "right"))


def test_force_overwrites_and_another_robots_meshes_are_not_overwritten_without_it(mine: Path) -> None:
    """Every file that would be replaced counts, not the URDF alone."""
    aerobat("urdf", "aerobat", "-o", str(mine / "a.urdf"), cwd=mine)
    again = aerobat("urdf", "aerobat", "-o", str(mine / "b.urdf"), cwd=mine)
    assert again.returncode == 2
    assert "exists; --force" in again.stderr
    assert not (mine / "b.urdf").exists()
    assert aerobat("urdf", "aerobat", "-o", str(mine / "b.urdf"), "--force", cwd=mine).returncode == 0


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
def test_cmake_installs_all_data_where_ros_looks(ament: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
