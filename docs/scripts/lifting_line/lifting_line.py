"""Write the tables and draw the figures of docs/lifting_line.md: the lifting line alone, rung by rung."""

from __future__ import annotations

import ladder
import moments
import strips
from support.pages import ROOT, Values, run, save


def quick() -> Values:
    """Return the tables that no flight of a robot is needed for."""
    tables = {"fit": moments.fit_table(), "cases": moments.cases()[1], "steps": strips.stable_steps()}
    return {"docs/lifting_line.md": tables}


def find() -> Values:
    """Draw every rung, and return the tables on flights."""
    figures = {draw.__name__: draw() for draw in (*ladder.FIGURES, moments.pitch)}
    save(figures | {"cases": moments.cases()[0]}, ROOT / "docs" / "figures" / "lifting_line")
    flights = {"robot": strips.robot_errors(), "flights": strips.free_flights()}
    return {"docs/lifting_line.md": flights}


if __name__ == "__main__":
    run(find, quick)
