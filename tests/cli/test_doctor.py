"""The doctor, in installations that are sick in a known way."""

import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pinocchio
import pytest

from aerobat_pin import flight
from aerobat_pin.cli import doctor
from aerobat_pin.cli.doctor import Verified, check_installation, satisfies


@pytest.fixture(autouse=True)
def clean_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("PYTHONPATH", "LD_LIBRARY_PATH"):
        monkeypatch.delenv(variable, raising=False)


def by_name(findings: list[Verified]) -> dict[str, Verified]:
    """Return findings by name; two of one name would hide one."""
    named = {one.name: one for one in findings}
    assert len(named) == len(findings)
    return named


def found(*checks: Callable[[], Iterator[Verified]]) -> dict[str, Verified]:
    """Check this installation, by some of the checks alone where these are given: others start a program."""
    return by_name(doctor._run(*checks) if checks else check_installation())


def assert_bad(finding: Verified, *detail: str, advice: str = "") -> None:
    """Check that a finding is bad, with these words in its detail and its advice."""
    assert not finding.ok
    assert [word for word in detail if word not in finding.detail] == []
    assert advice in finding.advice


def distribution(folder: Path, name: str, version: str) -> None:
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")


def foreign_pinocchio(folder: Path, source: str) -> Path:
    """Write a package `pinocchio` into a folder as a foreign installation has it."""
    (folder / "pinocchio").mkdir(parents=True)
    (folder / "pinocchio" / "__init__.py").write_text(source)
    return folder


def test_this_installation_is_healthy() -> None:
    """Where the tests run, everything is found, and every finding has its advice in one line."""
    findings = found()
    assert [str(one) for one in findings.values() if not one.ok] == []
    assert all(one.detail and one.advice and "\n" not in one.detail + one.advice for one in findings.values())
    expected = {"python", "platform", "pinocchio", "pin", "numpy", "typer", "viewer", "description", "URDF", "chromium"}
    assert expected <= set(findings)
    assert "cmeel.prefix" in findings["pinocchio"].detail
    assert "42.132 g" in findings["URDF"].detail


def test_versions_are_compared_by_numbers() -> None:
    """As text, 4.10 comes before 4.9; a version that is missing obeys no rule."""
    for version, rule, expected in (("4.10.0", ">=4.9", True), ("5.0", "<5,>=4.1", False), ("", "", False)):
        assert satisfies(version, rule) is expected


def test_a_missing_package_that_checks_need_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without `packaging` no version is compared; the checks that need it say so, the others run all the same."""
    monkeypatch.setitem(sys.modules, "packaging.specifiers", None)
    findings = found(doctor._platform, doctor._pinocchio, doctor._requirements, doctor._description)
    for name in ("platform", "pinocchio", "requirements"):
        assert_bad(findings[name], "packaging.specifiers", advice="in this project's folder pip install .")
    assert findings["description"].ok


@pytest.mark.parametrize(
    ("package", "version", "finding", "said", "advice"),
    [
        ("pin", "3.9.0", "pin", "3.9.0", ">=4.0"),
        ("pinocchio", "0.5.1", "pinocchio's namesake", "another project", "uninstall pinocchio"),  # of a test runner
        ("pinocchio", "4.1.0", "pinocchio's namesake", "not installed", ""),  # as builds from source may be called
    ],
)
def test_an_old_pin_and_the_package_called_pinocchio_are_unmasked(
    package: str, version: str, finding: str, said: str, advice: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The distribution found first counts."""
    distribution(tmp_path, package, version)
    monkeypatch.syspath_prepend(str(tmp_path))
    one = found(doctor._requirements if package == "pin" else doctor._pinocchio)[finding]
    assert one.ok == (not advice)
    assert said in one.detail
    assert advice in one.advice


@pytest.mark.parametrize(
    ("place", "version", "origin"), [("opt/ros/jazzy/lib", "3.4.0", "of ROS"), ("conda/lib", "4.1.0", "of conda")]
)
def test_a_second_pinocchio_is_named_with_its_folder(
    place: str, version: str, origin: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A sourced ROS shell puts its own before pip's; also one of the right version has libraries of the same names."""
    if origin == "of conda":
        (tmp_path / "conda-meta").mkdir()
        monkeypatch.setattr(sys, "prefix", str(tmp_path))
    folder = foreign_pinocchio(tmp_path / place, f"__version__ = {version!r}\ndef crba(): ...\n")
    monkeypatch.setenv("PYTHONPATH", str(folder))
    findings = found(doctor._pinocchio, doctor._search_paths)
    assert findings["pinocchio"].ok == (origin == "of conda")
    assert version in findings["pinocchio"].detail
    assert_bad(findings["pinocchio's sources"], origin)
    assert_bad(findings["PYTHONPATH"], str(folder / "pinocchio"), advice="unset PYTHONPATH")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("raise ImportError('libboost_python311.so: cannot open shared object file')", "libboost_python311.so"),
        ("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)", "ends the process with code -11"),
        ("", "something else"),
    ],
    ids=["fails", "crashes", "is another module"],
)
def test_an_import_that_does_not_give_the_robot_library_is_a_finding(
    source: str, message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The doctor survives it; the checks that need an algorithm of the library are left out."""
    monkeypatch.setenv("PYTHONPATH", str(foreign_pinocchio(tmp_path, source)))
    findings = found() if "raise" in source else found(doctor._pinocchio)
    assert_bad(findings["pinocchio"], message)
    assert "URDF" not in findings


def test_a_search_path_without_anything_of_ours_is_fine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Other people's folders, folders that do not exist, and this package itself unpacked with what it needs."""
    together = tmp_path / "together"
    for name in ("numpy", "aerobat_pin"):
        (together / name).mkdir(parents=True)
    (tmp_path / "other").mkdir()
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path / 'missing'}:{tmp_path / 'other'}::{together}")
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path / "other"))
    findings = found(doctor._search_paths)
    assert findings["PYTHONPATH"].ok
    assert findings["LD_LIBRARY_PATH"].ok


def test_foreign_libraries_before_ours_are_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The loader takes them from LD_LIBRARY_PATH, whatever Python imports."""
    (tmp_path / "libpinocchio_default.so.3.4.0").write_bytes(b"")
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    assert_bad(found(doctor._search_paths)["LD_LIBRARY_PATH"], "libpinocchio_default")


def test_a_requirement_that_is_missing_or_old_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """By the project's own metadata; extras are not required."""
    distribution(tmp_path, "pydantic", "1.10.2")
    distribution(tmp_path, "aerobat-pinocchio", "0.1.0")
    with (tmp_path / "aerobat_pinocchio-0.1.0.dist-info" / "METADATA").open("a") as file:
        file.write("Requires-Python: >=3.11\nRequires-Dist: pydantic<3,>=2.7\nRequires-Dist: nosuchthing[fast]>=1.2\n")
        file.write('Requires-Dist: norsuch>=1; extra == "test"\n')
    monkeypatch.syspath_prepend(str(tmp_path))
    findings = found(doctor._requirements)
    assert_bad(findings["pydantic"], "1.10.2")
    assert findings["nosuchthing"].detail == "not installed (wanted: >=1.2)"
    assert findings["nosuchthing"].advice == "pip install 'nosuchthing>=1.2'"
    assert "norsuch" not in findings


def test_a_python_or_platform_without_wheels_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its line has an advice below."""
    monkeypatch.setattr("platform.python_version", lambda: "3.10.4")
    assert str(found(doctor._platform)["python"]).startswith("BAD  python: 3.10.4 at ")
    for libc in (("glibc", "2.17"), ("", "")):
        monkeypatch.setattr("platform.libc_ver", lambda libc=libc: libc)
        assert not found(doctor._platform)["platform"].ok
    monkeypatch.setattr(sys, "platform", "win32")
    assert not found(doctor._platform)["platform"].ok


def test_a_pyzmq_that_dropped_what_meshcat_needs_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The replay would fail with an import error that names neither."""
    monkeypatch.setattr(doctor, "find_spec", lambda name: None if "ioloop" in name else find_spec(name))
    assert_bad(found(doctor._viewer)["viewer"], "ioloop")


def test_a_mesh_that_is_only_a_pointer_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A clone without large files has a line of text where the mesh should be."""
    import aerobat_description

    (tmp_path / "urdf").mkdir()
    (tmp_path / "meshes").mkdir()
    (tmp_path / "urdf" / "aerobat.urdf").write_text('<mesh filename="package://aerobat_description/meshes/a.stl" />')
    (tmp_path / "meshes" / "a.stl").write_text("version 1\noid sha256:0\nsize 684\n")
    monkeypatch.setattr(aerobat_description, "PACKAGE_PATH", str(tmp_path))
    assert_bad(found(doctor._description)["description"], "a.stl", "aerobat_light.srdf")


def test_a_robot_of_the_wrong_mass_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some readers of URDF give a link without an inertial one kilogram."""
    monkeypatch.setattr(pinocchio, "computeTotalMass", lambda _: 1.042)
    assert_bad(found(doctor._urdf)["URDF"], "1042.000 g")


def test_no_folder_for_the_kernels_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """It works all the same, and says why every start is slow."""
    monkeypatch.setattr(flight, "advance_stage", flight.advance_stage.py_func)
    assert_bad(found(doctor._kernels)["kernel cache"], advice="NUMBA_CACHE_DIR")


def test_no_browser_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any browser opens the replay; what pictures of it take is named all the same."""
    real = doctor.metadata.version

    def version(name: str) -> str:
        if name == "playwright":
            raise doctor.metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(doctor.metadata, "version", version)
    chromium, playwright = (found(doctor._browser)[name] for name in ("chromium", "playwright"))
    assert chromium.ok
    assert playwright.ok
    assert "not installed: only `aerobat play --frames`" in chromium.detail
    assert "apt-get install chromium" in chromium.detail
    assert "pip install 'aerobat-pinocchio[frames]'" in playwright.detail


def test_a_check_that_fails_is_a_finding_of_its_own() -> None:
    """Whatever a broken installation raises, the other findings are still printed."""

    def _broken() -> Iterator[Verified]:
        raise OSError("no such thing")

    findings = found(_broken, doctor._urdf)
    assert findings["broken"].detail == "OSError: no such thing"
    assert findings["URDF"].ok
