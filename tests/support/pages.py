"""Pages of the documentation, and what scripts find for them, between `<!-- name -->` and `<!-- /name -->`."""

import argparse
import datetime
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from aerobat_pin.visualization import style

ROOT = Path(__file__).resolve().parents[2]
Values = Mapping[str, Mapping[str, str]]  # page below the repository -> name of a mark -> what stands there


def table(head: str, rows: Iterable[Iterable[object]]) -> str:
    """Return a table: `head` names the columns as `a | b`, a row has a cell for each of them."""
    rule = "|---" * (head.count("|") + 1) + "|"
    return "\n".join([f"| {head} |", rule, *(f"| {' | '.join(map(str, row))} |" for row in rows)])


def cells(text: str) -> list[list[str]]:
    """Return the cells of all rows of the tables of a text, heads and rules too."""
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]


def measured() -> str:
    """Return when, and on how busy a machine, something was measured."""
    return f"{datetime.date.today()}, {os.cpu_count()} cores, load {os.getloadavg()[1]:.1f}"


def marked(text: str, name: str) -> tuple[str, str, str]:
    """Return a page before, between and after the marks of a name; ValueError without one."""
    head, begin, rest = text.partition(f"<!-- {name} -->")
    value, end, tail = rest.partition(f"<!-- /{name} -->")
    if not (begin and end):
        raise ValueError(f"<!-- {name} --> and <!-- /{name} --> were expected")
    return head + begin, value, end + tail


def fill(page: str, values: Mapping[str, str]) -> None:
    """Write values between the marks of a page; marks that stand on lines of their own stay there."""
    path = ROOT / page
    for name, value in values.items():
        before, old, after = marked(path.read_text(encoding="utf-8"), name)
        line = "\n" if old.startswith("\n") else ""
        path.write_text(f"{before}{line}{value}{line}{after}", encoding="utf-8")


def save(figures: Mapping[str, Figure], folder: Path) -> None:
    """Save figures by their names, without a date."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", metadata={"Software": None})


def run(find: Callable[[], Values], quick: Callable[[], Values] = dict) -> None:
    """Write what `find` draws into pages; with `--check [FOLDER]` compare with what is `quick`, and exit by 1."""
    parser = argparse.ArgumentParser(description="Write what is found into pages of the documentation.")
    folder = "write nothing, compare with the pages below this folder (default: the repository's)"
    parser.add_argument("--check", type=Path, nargs="?", const=ROOT, metavar="FOLDER", help=folder)
    other = parser.parse_args().check
    with mpl.rc_context({**style.RC, "text.parse_math": True}):  # ticks of logarithmic axes
        found = [quick(), *([find()] if other is None else [])]
    for page, values in (item for part in found for item in part.items()):
        if other is None:
            fill(page, values)
            continue
        text = (other / page).read_text(encoding="utf-8")
        different = [name for name, value in values.items() if marked(text, name)[1].strip("\n") != value]
        if different:
            sys.exit("\n".join(f"{page}: '{name}' is not what the script finds" for name in different))
