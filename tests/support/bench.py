"""Good results, over which broken runs are started, and what is wrong with the folder afterwards."""

import shutil
import time
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from support.forks import Forks, Running

SHORT = ["--set", "simulation.duration=0.02", "--set", "air.warm_up_cycles=1", "--no-report"]
RUN = ["run", "paper", "--out", "result", "--force", *SHORT]
OLD, NEW = ["--seed", "1"], ["--seed", "2"]
OWN = {"notes.txt": b"mine", "figures/mine.png": b"my picture", "deep/er/data.csv": b"1,2\n"}
HANGS = 180  # [s]: a program that runs longer hangs, on a busy machine too
Content = dict[str, bytes]


class Bench:
    """Where cases are played, in an empty folder: the good results, and the process from which programs are forked."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.count = folder, 0

    def __enter__(self) -> Self:
        self.forks = Forks().__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.forks.__exit__(*error)

    def new_folder(self) -> Path:
        """Return a new folder with an old result, `result/`, that also holds files of the user's."""
        self.count += 1
        folder = self.folder / str(self.count)
        shutil.copytree(self.folder / "old" if self.old else Path(), folder)
        for name, content in OWN.items():
            (folder / "result" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "result" / name).write_bytes(content)
        return folder

    def start(self, folder: Path, *more: str, **how: Any) -> Running:
        """Start the new run over the result in a folder, with more words; `how` is that of `Forks.start`."""
        return self.forks.start([*RUN, *NEW, *more], folder, patience=HANGS, **how)

    @cached_property
    def old(self) -> Content:
        """The files of the old result."""
        return self._made("old", OLD)

    @cached_property
    def new(self) -> Content:
        """The files of the new result."""
        return self._made("new", NEW)

    @cached_property
    def seconds(self) -> float:
        """How long an undisturbed run takes."""
        assert self.new
        folder, start = self.new_folder(), time.monotonic()
        self.start(folder).result()
        return time.monotonic() - start

    def _made(self, name: str, seed: list[str]) -> Content:
        (self.folder / name).mkdir()
        done = self.forks.start([*RUN, *seed], self.folder / name).result()
        assert done.returncode == 0, done.stderr
        return content(self.folder / name / "result")

    def wrong(self, folder: Path, *, left: bool = False) -> list[str]:
        """Return what is wrong with a folder of `new_folder`: not old, not new, or more; `kill -9` `left` a folder."""
        found = content(folder / "result")
        own = {name: found.pop(name, b"") for name in OWN}
        wrong = [] if found in (self.old, self.new) else [f"half-written: {sorted(found)}"]
        wrong += [f"the user's files: {own}"] if own != OWN else []
        others = sorted(path.name for path in folder.iterdir() if path.name != "result")
        return wrong + ([f"left behind: {others}"] if others and not left else [])


def content(folder: Path) -> Content:
    """Return the files of a folder: path -> content."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
