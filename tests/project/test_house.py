"""The project itself: examples run, nothing points at somebody's machine, the documents hold what they promise."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
TEXT = {".py", ".toml", ".md", ".cff", ".urdf", ".srdf", ".cfg", ".yml", ""}


def text_files() -> list[Path]:
    """Return the project's own text files."""
    skipped = {"runs", "build", "dist", "__pycache__"}
    return [
        path
        for path in ROOT.rglob("*")
        if path.is_file()
        and path.suffix in TEXT
        and not any(part in skipped or part.endswith(".egg-info") for part in path.relative_to(ROOT).parts)
        and not (path.relative_to(ROOT).parts[0].startswith(".") and path.relative_to(ROOT).parts[0] != ".ci")
    ]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_runs(example: Path, tmp_path: Path) -> None:
    """At most 80 lines, no output but what it prints."""
    assert len(example.read_text().splitlines()) <= 80
    done = subprocess.run([sys.executable, str(example)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert list(tmp_path.iterdir()) == []


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


def test_the_readme_leads_with_the_two_commands() -> None:
    """Whoever opens it sees `make demo` and `make test` first."""
    first_block = (ROOT / "README.md").read_text().split("```")[1]
    assert first_block.index("make demo") < first_block.index("make test")
