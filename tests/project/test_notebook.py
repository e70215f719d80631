"""The notebook: kept without results, it runs from top to bottom and shows tables, a picture and a replay."""

from __future__ import annotations

from pathlib import Path

import nbformat
from nbclient import NotebookClient

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
