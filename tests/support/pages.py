"""Pages of the documentation that a script writes: it rewrites them, or checks that they still say what it finds."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
HOLE = "\N{WHITE SQUARE}"  # stands in a part for what takes too long to find again


class Part(NamedTuple):
    """A part of a page: the page's path below the repository, what the part is called, and its text."""

    page: str
    name: str
    text: str


def holds(page: str, text: str) -> bool:
    """Return whether a page holds a text to the letter; anything may stand where the text has a `HOLE`."""
    return re.search(".*?".join(map(re.escape, text.split(HOLE))), page, re.DOTALL) is not None


def run(write: Callable[[], None], parts: Callable[[], Iterable[Part]]) -> None:
    """Rewrite pages, or with `--check [FOLDER]` compare them with what their script finds now.

    Args:
        write: rewrites the pages and their figures.
        parts: yields the parts that are quick to find.

    Raises:
        SystemExit: with exit code 1, the parts that differ being named on stderr.
    """
    parser = argparse.ArgumentParser(description="Write pages of the documentation and their figures.")
    parser.add_argument(
        "--check",
        type=Path,
        nargs="?",
        const=ROOT,
        metavar="FOLDER",
        help="write nothing, compare with the pages below this folder (default: the repository's)",
    )
    folder = parser.parse_args().check
    if folder is None:
        write()
        return
    different = [part for part in parts() if not holds((folder / part.page).read_text(encoding="utf-8"), part.text)]
    if different:
        sys.exit("\n".join(f"{part.page}: '{part.name}' is not what the script finds" for part in different))
