"""Which file of the repository becomes which page of the site, and where links between them lead."""

import ast
import json
import os
import re
import shutil
from pathlib import Path

NAMED_BY_FILE = re.compile(r"\[[\w./-]+\.md\](?=\()")  # in empty brackets the generator puts the page's title
LINK = re.compile(r"(\]\()([^)#\s]+)((?:#[^)\s]*)?\))")
CODE = {".py": "python", ".toml": "toml", ".cff": "yaml", ".json": "json"}
PICTURES = {".png", ".svg", ".gif"}
# Caption -> pages in order, as paths of the repository; a star stands for every page that no other line names.
SECTIONS = {
    "Start": ["docs/start.md", "docs/installation.md", "docs/glossary.md", "docs/limits.md"],
    "Method": ["docs/method.md", "docs/paper.md"],
    "Tutorials": ["docs/tutorials/*.md"],
    "How to": ["docs/*.md"],
    "Examples": ["examples/*.ipynb", "examples/*.py"],
    "Measured": [
        "docs/results.md",
        "docs/observer_results.md",
        "docs/control_results.md",
        "docs/studies.md",
        "docs/lifting_line.md",
        "docs/section_law.md",
        "docs/structural_error.md",
        "docs/learnt_error.md",
        "docs/legs.md",
        "docs/named_robots.md",
        "docs/live.md",
        "docs/reliability.md",
        "docs/broken_runs.md",
        "docs/reproducibility.md",
    ],
    "Reference": ["docs/conventions.md", "aerobat_description/README.md", "docs/upstream.md"],
    "Design": [
        *("docs/architecture.md", "CONTRIBUTING.md", "docs/design/*.md", "SECURITY.md", "docs/walls.md"),
        *("docs/licences.md", "CHANGELOG.md"),
    ],
}
MADE = ["commands", "scenario_keys", "api/index"]  # pages that stand in no file


def sections(root: Path) -> dict[str, list[Path]]:
    """Return caption -> files of the repository, patterns filled in; a file stands where it is named first."""
    named = {entry for entries in SECTIONS.values() for entry in entries if "*" not in entry}
    found: dict[str, list[Path]] = {}
    for caption, entries in SECTIONS.items():
        found[caption] = []
        for entry in entries:
            files = sorted(root.glob(entry))
            if "*" in entry:
                files = [file for file in files if file.relative_to(root).as_posix() not in named]
            found[caption] += files
    return found


def page_name(path: str) -> str:
    """Return the page that a file of the repository becomes, without suffix."""
    if path == "README.md":
        return "index"
    stem = path.removesuffix(".md").removesuffix(".py").removesuffix(".ipynb")
    return stem.removeprefix("docs/").lower().replace("aerobat_description/readme", "description")


class Stage:
    """A folder of pages for the generator, made from the repository.

    Args:
        root: the repository.
        folder: where the pages go; emptied first.
    """

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self.folder = root, folder
        self.sections = sections(root)
        files = [root / "README.md", *(file for files in self.sections.values() for file in files)]
        self.pages = {file: page_name(file.relative_to(root).as_posix()) for file in files}
        self.shown: set[Path] = set()  # files that are shown as they are, because a page links to them
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)

    def write(self, page: str, text: str, suffix: str = ".md") -> None:
        """Write a page."""
        path = self.folder / f"{page}{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def write_pages(self) -> None:
        """Write every page of the sections, and every file that one of them links to."""
        texts = {".py": self.example, ".ipynb": self.notebook, ".md": self.linked}
        for file, page in self.pages.items():
            self.write(page, texts[file.suffix](file) + (self.contents() if page == "index" else ""))
        done: set[Path] = set()
        while left := self.shown - done:
            for path in left:
                self.write(self.as_source(path), f"---\norphan: true\n---\n{self.source(path)}")
            done |= left

    def example(self, file: Path) -> str:
        """Return the page of an example: its name as a title, what its docstring says, and its code."""
        said = (ast.get_docstring(ast.parse(file.read_text("utf-8"))) or "").split("\n\n")[0].replace("\n", " ")
        title = file.stem.lstrip("0123456789_").replace("_", " ").capitalize()
        return f"# {title}\n\n{said}\n\n`{file.relative_to(self.root).as_posix()}`\n\n{fenced(file)}"

    def notebook(self, file: Path) -> str:
        """Return the page of a notebook: its words and its code, without what the code shows."""
        cells = json.loads(file.read_text("utf-8"))["cells"]
        texts = [("".join(cell["source"]), cell["cell_type"] == "code") for cell in cells]
        said, *rest = [f"```ipython3\n{text}\n```" if code else text for text, code in texts]
        title, _, words = said.partition("\n")
        where = f"A notebook: `{file.relative_to(self.root).as_posix()}`."
        return "\n\n".join([f"{title}: a notebook", where, words.strip(), *rest]) + "\n"

    def contents(self) -> str:
        """Return the tables of contents, which stand behind the README."""
        text = ""
        for caption, files in self.sections.items():
            entries = [self.pages[file] for file in files] + (MADE if caption == "Reference" else [])
            if entries:
                text += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(entries) + "\n```\n"
        return text

    def linked(self, file: Path) -> str:
        """Return the text of a file with links that lead to pages of the site; code blocks stay as they are."""

        def relink(match: re.Match[str]) -> str:
            before, target, after = match.groups()
            if re.match(r"[a-z]+:", target):
                return match[0]
            path = Path(os.path.normpath(file.parent / target))
            if not path.exists():
                said, missing = (one.relative_to(self.root).as_posix() for one in (file, path))
                raise SystemExit(f"{said} links to {missing}, which does not exist")
            return f"{before}{os.path.relpath(self.place(path), Path(self.pages[file]).parent)}{after}"

        parts = re.split(r"(^```.*?^```$)", file.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
        parts[::2] = [LINK.sub(relink, NAMED_BY_FILE.sub("[]", part)) for part in parts[::2]]
        return "".join(parts)

    def place(self, path: Path) -> str:
        """Return where a file of the repository stands on the site, and see that it does."""
        if path in self.pages:
            return f"{self.pages[path]}.md"
        if path == self.root / "docs" / "design":
            return "design/0001-linkage-below-the-robot.md"
        if path.suffix in PICTURES:
            name = path.relative_to(self.root).as_posix().removeprefix("docs/")
            target = self.folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
            return name
        self.shown.add(path)
        return f"{self.as_source(path)}.md"

    def as_source(self, path: Path) -> str:
        """Return the page that shows a file as it is."""
        return f"source/{path.relative_to(self.root).as_posix().replace('.', '_')}"

    def source(self, path: Path) -> str:
        """Return the page of a file as it is, or of the files of a folder."""
        title = f"# `{path.relative_to(self.root).as_posix()}`\n\n"
        if path.is_dir():
            return title + "".join(f"## `{one.name}`\n\n{fenced(one)}\n" for one in sorted(path.glob("*.*")))
        return title + fenced(path)


def fenced(path: Path) -> str:
    """Return a file as a code block."""
    return f"````{CODE.get(path.suffix, 'text')}\n{path.read_text('utf-8').rstrip()}\n````\n"
