"""The tutorials and the notebook, as a reader would type and run them, in an empty folder."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from support.commands import call

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
CHECKS = {
    "01-first-flight": 'found["force_level"][-1] > 0.999 and r2["windy"][1] < r2["paper"][1]',
    "02-your-log": '(table.filter(like="F").abs().max() < 1.0).all()',
    "03-your-robot": "np.allclose(estimate.force[-1, 0], [3.0, 0.0, 0.0], atol=0.05) and known.rank == 3",
    "04-your-wing": 'flight["aerodynamic_lift_over_weight"] > 0.1',
    "05-a-sweep": "r2.loc[0.0, 1000.0] > r2.loc[0.01, 1000.0]",
    "06-closing-the-loop": 'sideways["gust_closed_loop"] < sideways["without"] < timid < 0.1 and not roll.stable',
}


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_does_what_it_says(page: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Commands end with code 0, Python runs through, and files appear; `console` shows what needs several machines."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, Any] = {"np": np}
    for language, text in BLOCK.findall(page.read_text("utf-8")):
        if language == "sh":
            for line in text.replace("\\\n", " ").splitlines():
                program, *words = shlex.split(line, comments=True)
                assert program == "aerobat", line
                assert call(monkeypatch, *words) == 0, line
        elif language in ("toml", "xml"):
            name = text.split("\n")[0].strip("# <!->")
            (tmp_path / name).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, page.name, "exec"), names)
        else:
            assert language == "console"
    assert eval(CHECKS[page.stem], names) if page.stem in CHECKS else True


def test_the_python_of_the_page_on_studies_reads_a_sweep(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of a sweep with the name that it says, two short flights large."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(
        'name = "morphology"\nbase = "paper"\n[set]\n"simulation.duration" = 0.02\n"air.warm_up_cycles" = 1\n'
        '[ranges]\n"crank.frequency" = [4.75, 5.0]\n'
    )
    assert call(monkeypatch, "sweep", "small.toml", "--jobs", "1") == 0
    [script] = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "studies.md").read_text("utf-8"), re.DOTALL)
    *before, last = script.strip().splitlines()
    names: dict[str, Any] = {}
    exec(compile("\n".join(before), "docs/studies.md", "exec"), names)
    assert set(eval(last, names).dims) == {"point", "seed"}


NOTEBOOK = Path(__file__).resolve().parents[2] / "examples" / "first_flight.ipynb"


def test_the_notebook_runs_and_shows_what_it_says(tmp_path: Path) -> None:
    """In a kernel of its own, in an empty folder: fly, estimate, plot, replay."""
    book = nbformat.read(NOTEBOOK, as_version=4)
    assert [cell for cell in book.cells if cell.get("outputs") or cell.get("execution_count")] == []
    NotebookClient(book, timeout=900, resources={"metadata": {"path": str(tmp_path)}}).execute()
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    shown = [{kind: text for one in cell.outputs for kind, text in one.get("data", {}).items()} for cell in code]
    printed = ["".join(one.get("text", "") for one in cell.outputs) for cell in code]
    assert "<th>R2</th>" in shown[0]["text/html"]
    assert "<td>crank_angle</td>" in shown[1]["text/html"]
    assert len(shown[2]["image/png"]) > 10_000
    assert "all torques: rank 6\nno torque: rank 5 equal and opposite along the line" in printed[3]
    assert shown[4]["text/html"].startswith("<iframe srcdoc=")
    assert len(shown[4]["text/html"]) > 1_000_000
    assert list(tmp_path.iterdir()) == []
