"""Build the site: `make site`, or `python docs/site/build.py [FOLDER]`; needs no network. A warning is an error."""

import argparse
import sys
from pathlib import Path

from pages import Stage
from reference import ROOT, door_page, doors, names_page
from sphinx.cmd.build import build_main
from typer import Context
from typer.cli import get_docs_for_click
from typer.main import get_command

from aerobat_pin.cli.app import app
from aerobat_pin.scenario import describe_scenario

KEYS = """# Keys of a scenario

A table or key can be set in the file, or with `--set table.key=value`.

```text
{keys}
```
"""
API = """# Public names

Every public name of every room, from its docstring. A room is a package of `aerobat_pin`; its door is what
`from aerobat_pin.<room> import name` gives. [The map](../architecture.md) says what each room is for, and
[all names](names.rst) stand in one list from A to Z.

```{{toctree}}
:maxdepth: 1

names
{pages}
```
"""


def stage(folder: Path) -> Path:
    """Write the pages that the generator reads into `folder`/source, and return that folder."""
    staged = Stage(ROOT, folder / "source")
    staged.write_pages()
    commands = get_command(app)
    staged.write("commands", get_docs_for_click(obj=commands, ctx=Context(commands), name="aerobat", title="Commands"))
    staged.write("scenario_keys", KEYS.format(keys=describe_scenario().rstrip()))
    names = doors()
    staged.write("api/names", names_page(), ".rst")
    staged.write("api/index", API.format(pages="\n".join(names)))
    for door in names:
        staged.write(f"api/{door}", door_page(door), ".rst")
    return staged.folder


def build(folder: Path) -> int:
    """Build the site into `folder`/html and return the generator's exit code."""
    print("writing the pages on which the package describes itself ...", flush=True)
    source = stage(folder)
    count = sum(path.suffix in (".md", ".rst") for path in source.rglob("*"))
    print(f"building {count} pages: about a minute ...", flush=True)
    places = ["-c", Path(__file__).parent, "-d", folder / "doctrees", source, folder / "html"]
    return build_main(["-W", "--keep-going", "-q", *map(str, places)])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Build the site.")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "build" / "site", help="default: build/site")
    chosen = parser.parse_args().folder.resolve()
    code = build(chosen)
    print(f"open {chosen / 'html' / 'index.html'}" if code == 0 else "the site has warnings, see above")
    sys.exit(code)
