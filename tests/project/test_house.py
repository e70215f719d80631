"""The project itself: examples run, nothing points at somebody's machine, the documents hold what they promise."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from mutants import MUTANTS

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
TEXT = {".py", ".toml", ".md", ".cff", ".urdf", ".srdf", ".cfg", ".yml", ""}


def text_files() -> list[Path]:
    skipped = {"runs", "build", "dist", "__pycache__"}
    tops = [top for top in ROOT.iterdir() if top.name == ".ci" or (top.is_dir() and not top.name.startswith("."))]
    return [
        path
        for path in [*ROOT.glob("[!.]*"), *(path for top in tops for path in top.rglob("*"))]
        if path.is_file()
        and path.suffix in TEXT
        and not any(part in skipped or part.endswith(".egg-info") for part in path.relative_to(ROOT).parts)
    ]


def test_every_mutant_can_still_be_made() -> None:
    """The lines that `make mutants` changes stand where it looks for them, and the tests that should notice, too."""
    for mutant in MUTANTS:
        assert (ROOT / "aerobat_pin" / mutant.file).read_text().count(mutant.text) == 1, mutant.name
        assert all((ROOT / word.partition("::")[0]).exists() for word in mutant.tests.split()), mutant.name


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_runs(example: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At most 80 lines, no output but what it prints."""
    assert len(example.read_text().splitlines()) <= 80
    with np.printoptions():
        runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out.strip()
    assert list(here.iterdir()) == []


def test_no_file_names_an_absolute_path() -> None:
    """Home folders and work folders belong to a machine, not to the project."""
    absolute = re.compile(r"(?<![\w.])/(?:home|root|Users|work|mnt|media)/\w")
    found = [f"{path.relative_to(ROOT)}" for path in text_files() if absolute.search(path.read_text(errors="ignore"))]
    assert found == []


def test_every_link_in_the_documents_leads_somewhere() -> None:
    """Relative links and pictures of README and docs exist."""
    missing = []
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "aerobat_description" / "README.md"]:
        for target in re.findall(r"\]\(([^)#]+)", page.read_text()):
            if not target.startswith("http") and not (page.parent / target).exists():
                missing.append(f"{page.relative_to(ROOT)}: {target}")
    assert missing == []


def test_every_wall_stands_in_the_table_and_its_lines_are_counted() -> None:
    """What holds against strangers' files and sudden ends: each wall with its tests, and the page counts lines."""
    page = (ROOT / "docs" / "walls.md").read_text()
    walls = re.findall(r"^\| `([\w/]+\.py)`", page, re.MULTILINE)
    count = sum(len((ROOT / "aerobat_pin" / wall).read_text().splitlines()) for wall in walls)
    assert count <= 1500
    assert f"({count:,}, at most 1,500)" in page
    assert all((ROOT / test).is_file() for test in re.findall(r"`(tests/[\w/]+\.py)`", page))


def test_the_readme_leads_with_the_two_commands() -> None:
    """Whoever opens it sees `make demo` and `make test` first."""
    first_block = (ROOT / "README.md").read_text().split("```")[1]
    assert first_block.index("make demo") < first_block.index("make test")
