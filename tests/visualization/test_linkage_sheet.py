"""The linkage on one page: everything named and readable, the figures beside it right, the command tidy."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from support.commands import aerobat, call

from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures import linkage as linkage_sheet

LINKAGE = KineticSculpture()


def test_the_pose_is_the_linkages_own_over_faint_ones_of_a_whole_turn() -> None:
    """Pins where the closure has them; twelve faint poses; both joint angles over the crank angle beside it."""
    figure = linkage_sheet.draw_linkage(LINKAGE)
    mechanism, curves = figure.axes[:2]
    shown = LINKAGE.solve(np.radians(linkage_sheet.SHOWN_DEG))
    marks = {tuple(np.round(line.get_xydata()[0], 9)) for line in mechanism.lines if line.get_marker() in "so"}
    assert {tuple(np.round(1e3 * pin, 9)) for pin in shown.pins.values()} <= marks
    faint = [line for line in mechanism.lines if line.get_color() == style.FAINT]
    assert len(faint) == 12
    for line, crank in zip(faint, range(-90, 270, 30), strict=True):
        assert line.get_xydata()[1] == pytest.approx(1e3 * LINKAGE.solve(np.radians(crank)).pins["J6"])
    shoulder, elbow = curves.lines[:2]
    turn = LINKAGE.solve(np.radians(shoulder.get_xdata()))
    assert np.radians(shoulder.get_ydata()) == pytest.approx(turn.theta_s)
    assert np.radians(elbow.get_ydata()) == pytest.approx(turn.theta_e)


def test_the_command_draws_and_prints(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Into runs/linkage, the same bytes every time, or into one file of the kind its name ends with."""
    assert call("linkage") == 0
    printed = capsys.readouterr().out
    assert "shoulder theta_s" in printed
    assert "transmission at J10" in printed
    assert "drawn to runs/linkage/aerobat.png, runs/linkage/aerobat.pdf" in printed
    assert imread(here / "runs" / "linkage" / "aerobat.png").shape[1] >= 1000
    assert call("linkage", "aerobat_light", "--out", "two.PDF") == 0
    assert (here / "two.PDF").read_bytes().startswith(b"%PDF")
    before = (here / "runs" / "linkage" / "aerobat.png").read_bytes()
    assert call("linkage", "--force") == 0
    assert (here / "runs" / "linkage" / "aerobat.png").read_bytes() == before


def test_the_command_line_warns_in_a_line_of_a_nearly_singular_linkage(tmp_path: Path) -> None:
    """Once, on standard error, without the place in our code; the picture is drawn all the same."""
    (tmp_path / "tight.toml").write_text('extends = "aerobat"\nname = "tight"\n[linkage]\nL5a = 9e-3\n')
    done = aerobat("linkage", "tight.toml", "--out", "tight.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if "nearly singular" in line]
    assert len(lines) == 1
    assert lines[0].startswith("warning: the linkage is nearly singular at J7: its bars make 13.0 deg")
    assert (tmp_path / "tight.png").exists()
