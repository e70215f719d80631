"""The site: it builds without a warning or the network, its links lead somewhere, and every public name is in it."""

import importlib
import os
import re
import subprocess
import sys
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest
from typer.main import get_command

import aerobat_pin
from aerobat_pin.cli.app import app
from aerobat_pin.scenario import describe_scenario

ROOT = Path(__file__).resolve().parents[2]
DOORS = [
    "aerobat_description",
    *sorted(f"aerobat_pin.{path.parent.name}" for path in ROOT.glob("aerobat_pin/*/__init__.py")),
    "aerobat_pin.aerobat.raw",
]
NO_NETWORK = """
import socket, sys
def refuse(*_: object) -> None:
    raise OSError("the network is not there")
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
sys.argv[0] = sys.argv.pop(1)
sys.path.insert(0, __import__("os").path.dirname(sys.argv[0]))
exec(compile(open(sys.argv[0]).read(), sys.argv[0], "exec"), {"__name__": "__main__", "__file__": sys.argv[0]})
"""


class Page(HTMLParser):
    """What a page links to, what it loads, what can be linked to in it, and its words."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.names: set[str] = set()
        self.tags: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Sort the attributes of one element."""
        self.tags.add(tag)
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.names.add(value)
            elif name == "href" and value and tag == "a":
                self.links.append(value)
            elif name in ("src", "href") and value:
                self.loaded.append(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site in a process that has no network; a warning fails it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-c", NO_NETWORK, str(ROOT / "docs" / "site" / "build.py"), str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONOPTIMIZE": ""}  # pages are made of docstrings
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return folder / "html"


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in site.rglob("*.html")}


def test_every_link_of_the_site_leads_somewhere_and_nothing_is_loaded_from_elsewhere(pages: dict[Path, Page]) -> None:
    """To a file, and to a name within it; addresses elsewhere are not followed."""
    broken = []
    for path, page in pages.items():
        for link in page.links:
            target, _, name = link.partition("#")
            if target.startswith(("http:", "https:", "mailto:")):
                continue
            file = (path.parent / unquote(target)).resolve() if target else path
            known = file.exists() and (not name or file not in pages or unquote(name) in pages[file].names)
            if not known:
                broken.append(f"{path.name}: {link}")
        for address in page.loaded:
            assert "//" not in address, f"{path.name} loads {address}"
            assert (path.parent / address.partition("?")[0].partition("#")[0]).exists(), f"{path.name}: {address}"
    assert broken == []


@pytest.mark.parametrize("door", DOORS)
def test_every_public_name_of_a_room_has_an_entry(door: str, site: Path, pages: dict[Path, Page]) -> None:
    """Under the name by which it is imported; the list of all names leads there, and so does the site's search."""
    public = importlib.import_module(door).__all__
    assert [name for name in public if f"{door}.{name}" not in pages[site / "api" / f"{door}.html"].names] == []
    listed = pages[site / "api" / "names.html"].links
    assert [name for name in public if f"{door}.html#{door}.{name}" not in listed] == []
    assert [name for name in public if f'"{name}"' not in (site / "searchindex.js").read_text("utf-8")] == []


def test_the_reference_has_every_command_scenario_key_and_front_name(pages: dict[Path, Page], site: Path) -> None:
    """A heading for each command; the keys are those that `aerobat describe scenario` prints."""
    listed = {link.rpartition(".")[2] for link in pages[site / "api" / "names.html"].links}
    assert set(aerobat_pin.__all__) - {"__version__"} - listed == set()
    names = pages[site / "commands.html"].names
    assert [name for name in get_command(app).commands if f"aerobat-{name}" not in names] == []
    shown = unescape((site / "scenario_keys.html").read_text("utf-8"))
    assert [line for line in describe_scenario().splitlines() if line.strip() not in shown] == []


def test_every_page_of_the_documents_is_on_the_site(site: Path) -> None:
    """A new page in docs/ needs no edit elsewhere; README is the front page."""
    for path in (ROOT / "docs").rglob("*.md"):
        name = path.relative_to(ROOT / "docs").with_suffix(".html").as_posix().lower()
        assert (site / name).is_file(), name
        assert f'href="{name}"' in (site / "index.html").read_text("utf-8"), f"no table of contents names {name}"


def test_the_walk_through_the_paper_names_a_test_for_every_slip() -> None:
    """Every test of slips, and no test that is not there."""
    walk = (ROOT / "docs" / "paper.md").read_text("utf-8")
    named = set(re.findall(r"`(test_\w+)`", walk))
    held = {
        name
        for file in (ROOT / "tests").rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(), re.M)
    }
    slips = re.findall(r"^def (test_\w+)", (ROOT / "tests/aerobat/test_paper_slips.py").read_text(), re.MULTILINE)
    assert set(slips) - named == set()
    assert named - held == set()
