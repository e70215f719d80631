"""Strips that lie across joints are shared between their links, so the robot's loads converge in their number."""

from __future__ import annotations

import numpy as np
import pytest
from support.flapping_robot import STEPS, flap_robot

from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.robot.aerobat import load_aerobat

WING = load_aerobat().wing


@pytest.mark.parametrize("strips", [1, 2, 7, 16, 29, 64])
def test_the_pieces_cover_every_strip_and_every_link_once(strips: int) -> None:
    """Shares of a strip sum to 1; lengths on a link to the link's; mirrored links have mirrored pieces.

    A joint on a strip's edge, up to rounding, leaves no sliver: the least share is that of a real overlap.
    """
    air = RobotAir(WING, strips=strips)
    pieces, (shoulder, elbow, tip) = air.pieces, WING.breaks
    assert np.bincount(pieces.strip, pieces.share) == pytest.approx(np.ones(strips), rel=1e-14)
    edges = np.concatenate([[0.0], (np.arange(1, strips) + 0.5), [strips + 1.0]]) * np.pi / (strips + 1)
    length = -np.diff(0.5 * WING.span * np.cos(edges))[pieces.strip] * pieces.share
    on_links = [2.0 * shoulder, *[elbow - shoulder, tip - elbow] * 2]
    assert np.bincount(pieces.link, length) == pytest.approx(on_links, rel=1e-6)
    other = np.array([0, 3, 4, 1, 2])[pieces.link[::-1]]
    np.testing.assert_array_equal(pieces.link, other)
    np.testing.assert_allclose(pieces.y, -pieces.y[::-1], atol=1e-15)
    assert pieces.share.min() > 1e-3
    # The air that the links carry along is that of the strips, wherever the joints fall.
    carried = air.line.added_mass @ air.line.width
    assert sum(G[0, 0] for G in air.added_mass) == pytest.approx(carried, rel=1e-13)


def test_the_flapping_robots_lift_converges_in_strips() -> None:
    """Mean lift over a flap of the prescribed motion, against 96 strips: -0.8, -0.3 and -0.2 % with 16, 24 and 32.

    With whole strips on the link under their station it was +4.8, +0.9 and -1.3 %, as the joints fell.
    """
    exact = flap_robot(96, STEPS // 3)[0][:, 2].mean()
    found = {strips: flap_robot(strips, STEPS // 10)[0][:, 2].mean() / exact - 1.0 for strips in (16, 20, 24, 28, 32)}
    assert [100.0 * found[strips] for strips in (16, 24, 32)] == pytest.approx([-0.77, -0.31, -0.16], abs=0.05)
    assert max(np.abs(list(found.values()))) < 0.01
