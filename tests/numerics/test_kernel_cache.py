"""Compiled kernels on disk: damaged ones are compiled again with one line, and so are another user's."""

import importlib
import os
import pickle
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from support.damaged_kernels import DAMAGES, ENDS, SOURCE, damage, small_kernel
from support.kernel_cases import compiled_only

from aerobat_pin.numerics import jit, kernel_cache

pytestmark = compiled_only


@pytest.fixture(autouse=True)
def nothing_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start as a new process does, and forget the kernels of the test at its end."""
    monkeypatch.setattr(kernel_cache, "_told", [])


@pytest.fixture(scope="module")
def kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of a kernel that each test damages and compiles again."""
    return tmp_path_factory.mktemp("kernels")


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("how", DAMAGES)
def test_damaged_kernels_are_made_again(how: str, end: str, kernels: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without the checksum, bad machine code ends the process ("Aborted.") and a bad index is an unpickling error."""
    path = damage(kernels, end, how, np.random.default_rng(1))
    assert small_kernel(kernels)(np.ones(4), 0.5) == 2.0
    told = capsys.readouterr().err
    assert told == f"the compiled kernel {path} is damaged, another's or of another version: it is compiled again\n"
    whole = small_kernel(kernels)
    assert whole(np.ones(4), 0.5) == 2.0
    assert sum(whole.stats.cache_hits.values()) == 1
    assert capsys.readouterr().err == ""


def test_of_many_processes_at_once_one_compiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The others wait for it, and load what it compiled."""
    (tmp_path / "common.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    function = importlib.import_module("common").scaled
    children = []
    for _ in range(4):
        if (child := os.fork()) == 0:
            kernel = jit.kernel(function)
            right = kernel(np.ones(4), 0.5) == 2.0
            os._exit(sum(kernel.stats.cache_misses.values()) if right else 99)
        children.append(child)
    assert sorted(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children) == [0, 0, 0, 1]


def test_a_process_does_not_wait_for_itself_nor_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that is compiled within its own compilation, and one whose lock another process keeps."""
    kernel = small_kernel(tmp_path)
    files = kernel._cache._cache_file
    with files.by_one_process():
        assert kernel(np.ones(4), 0.5) == 2.0
        monkeypatch.setattr(kernel_cache, "LONGEST_WAIT", 0.05)
        assert small_kernel(tmp_path)(np.ones(4, np.float32), 0.5) == 2.0


def test_a_whole_file_under_a_wrong_name_is_not_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As a careless copy leaves it: the checksum includes the name."""
    path = damage(tmp_path, ".nbc", "empty", np.random.default_rng(1))
    (index,) = path.parent.glob("*.nbi")
    path.write_bytes(index.read_bytes())
    assert small_kernel(tmp_path)(np.ones(4), 0.5) == 2.0
    assert "damaged, another's or of another version" in capsys.readouterr().err


def test_a_file_that_is_gone_or_irreplaceable_is_fine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder or a named pipe in the file's place; the second needs no more than to be replaced."""
    for make in (Path.mkdir, os.mkfifo):
        folder = tmp_path / make.__name__
        path = damage(folder, ".nbc", "empty", np.random.default_rng(1))
        path.unlink()
        assert small_kernel(folder)(np.ones(4), 0.5) == 2.0
        path.unlink()
        make(path)
        kernel_cache._told.clear()
        assert small_kernel(folder)(np.ones(4), 0.5) == 2.0
        assert "is compiled again" in capsys.readouterr().err
    assert (tmp_path / "mkfifo").is_dir()
    assert path.is_file()


class Planted:
    """What somebody puts in the place of a kernel: to unpickle it makes a folder."""

    def __init__(self, made: Path) -> None:
        self.made = made

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.made),)


FOREIGN = {
    "file that all can write": lambda path: path.chmod(0o666),
    "file that a group can write": lambda path: path.chmod(0o660),
    "folder that all can write": lambda path: path.parent.chmod(0o777),
    "another user's file": lambda path: os.chown(path, 65534, -1),
    "another user's folder": lambda path: os.chown(path.parent, 65534, -1),
}


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("how", FOREIGN)
def test_what_another_user_can_have_written_is_not_run(how: str, end: str, tmp_path: Path) -> None:
    """A file with the right checksum, which is no signature; it is replaced where the folder is private."""
    if os.geteuid() != 0 and "another" in how:
        pytest.skip("only root gives files away")
    path = damage(tmp_path, end, "empty", np.random.default_rng(1))
    files = small_kernel(tmp_path)._cache._cache_file
    content = pickle.dumps(Planted(tmp_path / "run"))
    path.write_bytes(content + files._seal(str(path), content))
    FOREIGN[how](path)
    kernel = small_kernel(tmp_path)
    assert kernel(np.ones(4), 0.5) == 2.0
    assert not (tmp_path / "run").exists()
    assert sum(small_kernel(tmp_path).stats.cache_hits.values()) == 0
    if "folder" in how:
        assert path.read_bytes().startswith(content)
    else:
        assert path.stat().st_mode & 0o777 == 0o600
        assert path.stat().st_uid == os.geteuid()


def test_a_right_seal_of_ones_own_is_trusted(tmp_path: Path) -> None:
    """The same planted file would run if it were this user's: the test above sees what it looks for."""
    path = damage(tmp_path, ".nbi", "empty", np.random.default_rng(1))
    files = small_kernel(tmp_path)._cache._cache_file
    content = pickle.dumps(Planted(tmp_path / "run"))
    path.write_bytes(content + files._seal(str(path), content))
    small_kernel(tmp_path)(np.ones(4), 0.5)
    assert (tmp_path / "run").exists()


def test_a_shared_folder_for_kernels_is_used_by_private_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`NUMBA_CACHE_DIR` of several users; numba alone would take what lies in it."""
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    monkeypatch.setattr("numba.config.CACHE_DIR", str(shared))
    assert small_kernel(tmp_path / "source")(np.ones(4), 0.5) == 2.0
    (path,) = shared.glob("*/*/*.nbc")
    assert path.parent.name == f"aerobat-{os.geteuid()}"
    assert path.parent.stat().st_mode & 0o777 == 0o700
    assert path.stat().st_mode & 0o777 == 0o600


def test_a_kernel_runs_where_nothing_can_be_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Code without a file; a read-only installation and no home: a file where a folder must be made stops root, too."""
    scope: dict[str, Any] = {}
    exec("def triple(x):\n    return 3.0 * x\n", scope)
    assert jit.kernel(scope["triple"])(2.0) == 6.0
    home, installed = tmp_path / "home", tmp_path / "installed"
    installed.mkdir()
    for file in (home, installed / "__pycache__"):
        file.touch()
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    for name in ("HOME", "XDG_CACHE_HOME", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(home))
    kernel = small_kernel(installed)
    with pytest.raises(RuntimeError, match="no locator available"):
        numba.njit(cache=True)(kernel.py_func)
    assert kernel(np.ones(4), 0.5) == 2.0
    assert kernel.stats.cache_path is None


def test_a_full_disk_costs_only_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The kernel runs and is not stored; one line says so."""

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    kernel = small_kernel(tmp_path)
    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile._save_data", full)
    assert kernel(np.ones(4), 0.5) == 2.0
    told = capsys.readouterr().err
    folder = tmp_path / "__pycache__" / f"aerobat-{os.geteuid()}"
    assert told == f"compiled kernels cannot be stored in {folder}: No space left on device\n"
