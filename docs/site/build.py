"""Build the site: `make site`, or `python docs/site/build.py [FOLDER]`; needs no network. A warning is an error."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from pages import Stage
from printed import commands_page, scenario_page
from reference import door_page, doors, names_page

ROOT = Path(__file__).resolve().parents[2]
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
    staged.write("commands", commands_page())
    staged.write("scenario_keys", scenario_page())
    names = doors(ROOT)
    staged.write("api/names", names_page(ROOT), ".rst")
    staged.write("api/index", API.format(pages="\n".join(names)))
    for door in names:
        staged.write(f"api/{door}", door_page(ROOT, door), ".rst")
    return staged.folder


def build(folder: Path) -> int:
    """Build the site into `folder`/html and return the generator's exit code."""
    from sphinx.cmd.build import build_main

    print("importing the package, and writing the pages that it describes itself on ...", flush=True)
    source = stage(folder)
    count = sum(path.suffix in (".md", ".rst") for path in source.rglob("*"))
    print(f"building {count} pages: about a minute ...", flush=True)
    words = [
        "-b",
        "html",
        "-c",
        Path(__file__).parent,
        "-d",
        folder / "doctrees",
        "-W",
        "--keep-going",
        "-q",
        "-j",
        "auto",
    ]
    return build_main([str(word) for word in [*words, source, folder / "html"]])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Build the site.")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "build" / "site", help="default: build/site")
    chosen = parser.parse_args().folder.resolve()
    code = build(chosen)
    print(f"open {chosen / 'html' / 'index.html'}" if code == 0 else "the site has warnings, see above")
    sys.exit(code)
