"""Links of every kind at every place where something is written or read: nothing outside changes or is passed on."""

# Linux manual, open(2): O_NOFOLLOW; CWE-59, improper link resolution.

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from support.bench import SHORT
from support.commands import call
from support.damaged_kernels import small_kernel
from support.kernel_cases import compiled_only
from support.watch import watched

from aerobat_pin.errors import OutputError, output_folder, write_files
from aerobat_pin.errors import whole_files as files
from aerobat_pin.numerics import kernel_cache

RUN = ["run", "paper", *SHORT]
Content = dict[str, object]


def content(folder: Path) -> Content:
    """Return all that is in a folder: path -> content, or where a link leads."""
    return {
        str(path.relative_to(folder)): os.readlink(path) if path.is_symlink() else path.is_file() and path.read_bytes()
        for path in sorted(folder.rglob("*"))
    }


ON_BOTH = pytest.mark.parametrize("place", ["", "/dev/shm"], ids=["temporary folder", "tmpfs"], indirect=True)


@pytest.fixture
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """Return an empty folder; on each of two file systems where the exchange of folders depends on them."""
    disk = getattr(request, "param", "") or tmp_path
    if not os.access(disk, os.W_OK):
        pytest.skip("no /dev/shm")
    with TemporaryDirectory(dir=disk) as folder:
        yield Path(folder)


@pytest.fixture
def outside(place: Path) -> Path:
    """Return a folder with what a work folder or a result has, but nobody asked to write there."""
    folder = place / "outside"
    for name in ("private", "lock", "new/private", "estimate.nc", "report.html", "figures/states.png", "sweep.json"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")
    (folder / "empty").mkdir()
    return folder


@pytest.fixture
def here(place: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder: somebody else's, such as git brings it."""
    folder = place / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


OURS = "nothing, or a {} of your own, was expected there"
PLACES = [  # command, place of a link, where it leads in the folder outside, what is said
    (RUN, "runs/.aerobat-paper/lock", "private", "lock is a link; " + OURS.format("file")),
    (RUN, "runs/.aerobat-paper/lock", "missing", "lock is a link; " + OURS.format("file")),
    (RUN, "runs/.aerobat-paper/new", "new", "new is a link; " + OURS.format("folder")),
    (RUN, "runs/.aerobat-paper", "", ".aerobat-paper is a link; " + OURS.format("folder")),
    (RUN, "runs", "", "runs is a link; to write behind it, name the place itself: "),
    (RUN, "runs/paper", "empty", "paper is a link; to write behind it"),
    (RUN, "runs/paper", "missing", "paper is a link; to write behind it"),
    ([*RUN, "--force"], "runs/paper", "", "paper is a link; to write behind it"),
    ([*RUN, "--seeds", "1"], "runs/paper-seeds", "empty", "paper-seeds is a link; to write behind it"),
    (["crank"], ".aerobat-crank.html", "private", "crank.html is a link; " + OURS.format("file")),
    (["crank"], ".aerobat-crank.html", "missing", "crank.html is a link; " + OURS.format("file")),
    (["crank"], ".aerobat-crank.html", "empty", "crank.html is a link; " + OURS.format("file")),
    (["crank"], "crank.html", "missing", "crank.html is a link; to write behind it"),
    (["crank", "--force"], "crank.html", "private", "crank.html is a link; to write behind it"),
    (["crank", "-o", "pages/a.html"], "pages", "empty", "pages is a link; to write behind it"),
    (["linkage"], "runs/linkage", "empty", "linkage is a link; to write behind it"),
    (["urdf", "-o", "a.urdf"], "meshes", "empty", "meshes is a link; to write behind it"),
    (["urdf", "-o", "../here/a.urdf"], "meshes", "empty", "meshes is a link; to write behind it"),
    (["urdf", "-o", "a.urdf"], "linkage", "", "linkage is a link; to write behind it"),
    (["urdf", "-o", "a.urdf", "--force"], "a.srdf", "private", "a.srdf is a link; to write behind it"),
    (["trim", "paper", "--out", "new/a.toml"], "new", "empty", "new is a link; to write behind it"),
    (["sweep", "gain_noise"], "runs/gain_noise", "empty", "gain_noise is a link; to write behind it"),
]


@pytest.mark.parametrize(
    ("words", "link", "leads_to", "said"), PLACES, ids=[f"{one[0][0]} {one[1]} to {one[2]}" for one in PLACES]
)
def test_a_link_where_something_is_written_is_refused_and_not_followed(
    words: list[str], link: str, leads_to: str, said: str, outside: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Plain commands in somebody else's folder: one line, the link stays, and nothing outside changes."""
    (here / link).parent.mkdir(parents=True, exist_ok=True)
    (here / link).symlink_to(outside / leads_to)
    before = content(outside.parent)
    with watched(writes=[here], reads=[here]):
        assert call(*words) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("error: output ")
    assert said in printed
    assert printed.count("\n") == 1
    assert content(outside.parent) == before


@pytest.mark.parametrize("name", ["runs/.aerobat-paper/lock", ".aerobat-crank.html"])
def test_files_of_two_names_are_kept(name: str, outside: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A hard link is no link to look at, but a file of somewhere else all the same."""
    (here / name).parent.mkdir(parents=True, exist_ok=True)
    os.link(outside / "private", here / name)
    before = content(outside.parent)
    assert call(*(RUN if "paper" in name else ["crank"])) == 2
    assert "is also a file of another name; nothing, or a file of your own" in capsys.readouterr().err
    assert content(outside.parent) == before


def result(target: Path, *, force: bool = False) -> None:
    with output_folder(target, force=force, replaces=("a.txt", "figures/*.png"), sign="a.txt") as work:
        (work / "a.txt").write_text("new")
        (work / "figures").mkdir()
        (work / "figures" / "states.png").write_text("new")


@ON_BOTH
@pytest.mark.parametrize("inside", [False, True], ids=["beside", "as the current folder"])
def test_figures_that_lead_elsewhere(inside: bool, outside: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of a result that cannot exchange its name are replaced one by one: through a link, those of others."""
    (here / "old").mkdir()
    (here / "old" / "a.txt").write_text("old")
    (here / "old" / "figures").symlink_to(outside / "figures")
    before = content(outside.parent)
    if inside:
        monkeypatch.chdir(here / "old")
    with pytest.raises(OutputError, match="figures is a link; a folder was expected"):
        result(Path() if inside else Path("old"), force=True)
    assert content(outside.parent) == before


@ON_BOTH
def test_links_beside_a_result_stay_and_what_they_lead_to(outside: Path, here: Path) -> None:
    """What a killed process left is removed, but not through a link; links in the old result are kept."""
    result(Path("runs/one"))
    (here / "runs" / ".aerobat-link").symlink_to(outside)
    (here / "runs" / ".aerobat-dead").mkdir()
    (here / "runs" / ".aerobat-dead" / "lock").symlink_to(outside / "private")
    (here / "runs" / "one" / "mine").symlink_to(outside)
    (here / "runs" / "one" / "figures" / "states.png").unlink()
    (here / "runs" / "one" / "figures" / "states.png").symlink_to(outside / "private")
    before = content(outside)
    result(Path("runs/one"), force=True)
    assert content(outside) == before
    assert (here / "runs" / ".aerobat-dead" / "lock").is_symlink()
    assert (here / "runs" / "one" / "mine").is_symlink()
    assert content(here / "runs" / "one" / "figures") == {"states.png": b"new"}


def test_what_another_user_left_is_refused(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And stays: he could put links there while we write."""
    (here / ".aerobat-one" / "new").mkdir(parents=True)
    (here / ".aerobat-one" / "new" / "his").write_text("his")
    before = content(here)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(OutputError, match=r"\.aerobat-one belongs to another user; nothing, or a folder"):
        result(Path("one"))
    assert content(here) == before


def exchanged(path: Path, outside: Path, opened: Callable[..., int]) -> Callable[..., int]:
    """Return an `os.open` that finds a link at a place as soon as the first call has looked at the place's folder."""

    def swap(name: str | Path, flags: int, *more: int, **where: int) -> int:
        if str(name) == path.name and not path.is_symlink():
            with suppress(FileNotFoundError):
                path.rename(path.with_name("moved"))
            path.symlink_to(outside)
        return opened(name, flags, *more, **where)

    return swap


@ON_BOTH
@pytest.mark.parametrize("name", ["pages", "pages/.aerobat-a.html"])
def test_links_put_there_later_are_kept(name: str, outside: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the check and the moment of writing, as another user can in a folder that he may write."""
    (here / "pages").mkdir()
    before = content(outside)
    leads_to = outside if name == "pages" else outside / "private"
    with monkeypatch.context() as patched:
        patched.setattr(files.os, "open", exchanged(here / name, leads_to, os.open))
        with pytest.raises(OutputError, match="cannot be written"):
            write_files({Path("pages/a.html"): b"new"})
    assert (here / name).is_symlink()
    assert content(outside) == before


def test_the_watch_sees_what_is_written_deleted_and_read_elsewhere(outside: Path, here: Path) -> None:
    """By name, through a link, and by the descriptor of a folder; what is allowed is not held against anybody."""
    (here / "link").symlink_to(outside / "private")
    (here / "mine").write_text("mine")

    def descriptor() -> None:
        folder = os.open(outside, os.O_RDONLY)
        os.rename("lock", "moved", src_dir_fd=folder, dst_dir_fd=folder)
        os.close(folder)

    cases: dict[str, Callable[[], object]] = {
        "read: .*/private": lambda: (here / "link").read_text(),
        "changed: .*/private": lambda: (here / "link").write_text("new"),
        "changed: .*/new/private": lambda: shutil.rmtree(outside / "new"),
        "changed: .*/lock.*changed: .*/moved": descriptor,
        "changed: .*/more": lambda: (outside / "more").mkdir(),
        "changed: .*/second": lambda: os.link(here / "mine", outside / "second"),
    }
    for said, make in cases.items():
        with pytest.raises(AssertionError, match=said), watched(writes=[here], reads=[]):
            make()
    with watched(writes=[here / "a" / "b"], reads=[outside]):
        (here / "a" / "b").mkdir(parents=True)
        (here / "a" / "b" / "new").write_text((outside / "report.html").read_text())


SWEEP = 'name = "s"\nbase = "paper"\nseeds = 1\n[set]\n"simulation.duration" = 0.01\n"air.warm_up_cycles" = 1\n'


def test_the_files_of_a_sweep_lead_nowhere(outside: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each as a link and as a file of two names, resumed and started anew: refused, or replaced where it stands."""
    (here / "s.toml").write_text(SWEEP)
    words = ["sweep", "s.toml", "--out", "out", "--jobs", "1"]
    assert call(*words) == 0
    (outside / "finished.jsonl").write_bytes(b"")
    before = content(outside)
    kept = {path.name: path.read_bytes() for path in (here / "out").iterdir()}
    for name in ("finished.jsonl", "sweep.json", "base.toml", "results.csv"):
        for make in (os.symlink, os.link):
            for force in ([], ["--force"]):
                (here / "out" / name).unlink()
                make(outside / "finished.jsonl", here / "out" / name)
                code = call(*words, *force)
                printed = capsys.readouterr().err
                assert code in (0, 2), (name, make, force, printed)
                assert content(outside) == before, (name, make, force)
                (here / "out" / name).unlink(missing_ok=True)
                for other, text in kept.items():
                    (here / "out" / other).unlink(missing_ok=True)
                    (here / "out" / other).write_bytes(text)


def test_a_comparison_passes_nothing_on_and_ends(
    paper_folder: Path, outside: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A figure that is a link to a private file, lies behind one, is a pipe, too large, or no picture: refused."""
    (outside / "states.png").write_bytes(b"\x89PNG private")
    shutil.copytree(paper_folder, here / "a")
    figure = here / "a" / "figures" / "states.png"

    def fill() -> None:
        with figure.open("wb") as file:
            file.truncate(10**12)

    cases: dict[str, Callable[[], object]] = {
        "is a link": lambda: figure.symlink_to(outside / "states.png"),
        "is no file": lambda: os.mkfifo(figure),
        "bytes, at most": fill,
        "is no picture": lambda: figure.write_bytes(b"private"),
        "figures is a link": lambda: (shutil.rmtree(figure.parent), figure.parent.symlink_to(outside)),
    }
    for said, make in cases.items():
        figure.unlink()
        make()
        with watched(writes=[here], reads=[here, paper_folder]):
            assert call("compare", "a", str(paper_folder), "--out", "c") == 2
        printed = capsys.readouterr()
        assert said in printed.err
        assert printed.err.endswith("; a PNG file of the run was expected\n")
        assert (printed.err.count("\n"), printed.out) == (1, "")
        assert not (here / "c").exists()


@compiled_only
def test_a_kernel_behind_a_link_is_neither_run_nor_written(outside: Path, here: Path) -> None:
    """Index, machine code, lock and folder: what they lead to stays, and the kernel is compiled."""
    assert small_kernel(here / "whole")(np.ones(4), 0.5) == 2.0
    (whole,) = (here / "whole" / "__pycache__").glob("aerobat-*")
    for k, end in enumerate([".nbi", ".nbc", ".lock", ""]):
        folder = here / str(k)
        shutil.copytree(here / "whole", folder)
        private = folder / "__pycache__" / whole.name
        (path,) = private.glob(f"*{end}") if end else [private]
        path.rename(outside / f"kernel{end}")
        path.symlink_to(outside / f"kernel{end}")
        before = content(outside)
        kernel_cache._told.clear()
        kernel = small_kernel(folder)
        assert kernel(np.ones(4), 0.5) == 2.0
        assert content(outside) == before
        if end != ".lock":
            assert sum(kernel.stats.cache_hits.values()) == 0
