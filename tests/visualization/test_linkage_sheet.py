"""The linkage on one page: everything named and readable, the figures beside it right, the command tidy."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread
from matplotlib.text import Annotation
from support.commands import aerobat, call

from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures import linkage as linkage_sheet

LINKAGE = KineticSculpture()


def test_every_pin_bar_and_joint_angle_is_named_and_no_name_lies_on_another() -> None:
    """L1..L7, J1..J10, theta_s and theta_e, as in the paper's Fig. 2; boxes of names do not overlap."""
    figure = linkage_sheet.draw_linkage(LINKAGE)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    mechanism = figure.axes[0]
    names = [text for axis in (mechanism, *mechanism.child_axes) for text in axis.texts if isinstance(text, Annotation)]
    shown = [text.get_text() for text in names]
    wanted = [f"L{i}" for i in range(1, 8)] + [f"J{i}" for i in range(1, 11)] + [r"$\theta_s$", r"$\theta_e$"]
    assert sorted(shown) == sorted(wanted)
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in names]
    for (one, a), (other, b) in itertools.combinations(zip(shown, boxes, strict=True), 2):
        assert not a.overlaps(b), f"{one} lies on {other}"
    for name, box in zip(shown, boxes, strict=True):
        assert mechanism.bbox.contains(box.x0, box.y0), name
        assert mechanism.bbox.contains(box.x1, box.y1), name


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


def in_the_middle(point: tuple[float, float], line: np.ndarray) -> bool:
    """Say whether a point [mm] is the middle of a stretch of a line (n, 2) [mm]."""
    return bool(np.min(np.linalg.norm(0.5 * (line[1:] + line[:-1]) - point, axis=1), initial=np.inf) < 1e-6)


def test_a_bars_name_stands_on_the_bar_of_its_lengths() -> None:
    """On a linkage whose bars all differ: each side, as the morphology's lengths say, has its name at its middle."""
    bars = replace(LINKAGE.lengths, L4=36.5e-3, L6=35.5e-3)
    bend = complex(bars.L3a + bars.L3c * np.sin(bars.alpha3), bars.L3c * np.cos(bars.alpha3))
    rocker = np.exp(-1j * bars.alpha3) * complex(-bars.L3b, bars.L3c)
    corners = {
        "L1": (0j, bars.L1),
        "L2": (0j, complex(bars.L2b, bars.L2c), bars.L2a),
        "L3": (rocker, 0j, bend),
        "L4": (0j, bars.L4),
        "L5": (complex(-bars.L5a, bars.L5b), 0j, complex(bars.L5c, bars.L5d)),
        "L6": (0j, bars.L6),
        "L7": (0j, complex(bars.L7b, bars.L7c)),
    }
    mechanism = linkage_sheet.draw_linkage(KineticSculpture(bars)).axes[0]
    labels = {text.get_text(): text for axis in (mechanism, *mechanism.child_axes) for text in axis.texts}
    for name, points in corners.items():
        sides = sorted(1e3 * abs(a - b) for a, b in itertools.combinations(points, 2))
        (drawn,) = (line for line in mechanism.lines if in_the_middle(labels[name].xy, line.get_xydata()))
        ends = np.unique(np.round(drawn.get_xydata(), 9), axis=0)
        assert sorted(np.linalg.norm(a - b) for a, b in itertools.combinations(ends, 2)) == pytest.approx(sides), name


@pytest.mark.parametrize(("kind", "begin"), [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")])
def test_the_same_linkage_gives_the_same_files(kind: str, begin: bytes) -> None:
    first, second = (style.render_figure(linkage_sheet.draw_linkage(LINKAGE), kind) for _ in range(2))
    assert first == second
    assert first.startswith(begin)


def test_the_table_holds_the_known_ranges() -> None:
    """The golden figures of the nominal linkage, measured on the laboratory's published bar lengths."""
    rows = {line[:20].strip(): line[20:].split() for line in linkage_sheet.range_table(LINKAGE).splitlines()}
    assert rows["shoulder theta_s"] == ["-83.52", "37.3", "29.40", "218.0"]
    assert rows["elbow theta_e"] == ["-108.85", "188.9", "45.67", "5.4"]
    for pin, lowest, highest in (("J4", 31.5, 145.6), ("J7", 23.8, 87.2), ("J10", 21.5, 97.6)):
        low, _, high, _ = (float(cell) for cell in rows[f"transmission at {pin}"])
        assert (low, high) == pytest.approx((lowest, highest), abs=0.05)


def test_the_command_draws_and_prints(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Into runs/linkage, into a folder, or into one file of the kind its name ends with."""
    assert call("linkage") == 0
    printed = capsys.readouterr().out
    assert "shoulder theta_s" in printed
    assert "transmission at J10" in printed
    assert "drawn to runs/linkage/aerobat.png, runs/linkage/aerobat.pdf" in printed
    assert imread(here / "runs" / "linkage" / "aerobat.png").shape[1] >= 1000
    (here / "mine").mkdir()
    assert call("linkage", "aerobat_light", "--out", "mine") == 0
    assert call("linkage", "--out", "mine/one.svg") == 0
    assert call("linkage", "--out", "mine/two.PDF") == 0
    names = ["aerobat_light.pdf", "aerobat_light.png", "one.svg", "two.PDF"]
    assert sorted(path.name for path in (here / "mine").iterdir()) == names
    assert (here / "mine" / "two.PDF").read_bytes().startswith(b"%PDF")


def test_the_command_line_warns_in_a_line_of_a_nearly_singular_linkage(tmp_path: Path) -> None:
    """Once, on standard error, without the place in our code; the picture is drawn all the same."""
    (tmp_path / "tight.toml").write_text('extends = "aerobat"\nname = "tight"\n[linkage]\nL5a = 9e-3\n')
    done = aerobat("linkage", "tight.toml", "--out", "tight.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if "nearly singular" in line]
    assert len(lines) == 1
    assert lines[0].startswith("warning: the linkage is nearly singular at J7: its bars make 13.0 deg")
    assert (tmp_path / "tight.png").exists()
