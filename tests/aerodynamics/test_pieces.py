"""Strips that lie across joints are shared between their links, so the robot's loads converge in their number."""

from __future__ import annotations

import numpy as np
import pytest
from support.flapping_robot import STEPS, flap_robot
from support.gliding import AIR, BARE, SHAPE, WING, evaluate

from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.robot.wing import LINKS


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


def test_each_strip_is_shared_by_the_links_under_it() -> None:
    """Of 16 strips 2 lie across each shoulder and elbow: 20 pieces, 2 on the body, 2 and 7 on each wing's panels.

    A piece's share is its part of the length between the strip's edges, midway between stations in theta.
    """
    pieces, shoulder, elbow = AIR.pieces, *WING.breaks[:2]
    assert np.bincount(pieces.link).tolist() == [2, 2, 7, 2, 7]
    edges = 0.5 * WING.span * np.cos(np.array([0.0, *np.arange(1.5, 16.0), 17.0]) * np.pi / 17.0)
    reach = [(-shoulder, shoulder), (shoulder, elbow), (elbow, 1.0), (-elbow, -shoulder), (-1.0, -elbow)]
    for strip, link, y, share in zip(pieces.strip, pieces.link, pieces.y, pieces.share, strict=True):
        low, high = np.clip(edges[[strip + 1, strip]], *reach[link])
        assert share == pytest.approx((high - low) / (edges[strip] - edges[strip + 1]), rel=1e-9)
        assert link == 0 or y * (1.0 if LINKS[link].startswith("left") else -1.0) > 0.0
    np.testing.assert_allclose(np.bincount(pieces.strip, pieces.share), 1.0, rtol=1e-15)


def test_a_strip_on_one_link_lies_at_its_station_and_a_shared_one_in_its_parts() -> None:
    """Arc coordinates of the pieces, back from the links' frames."""
    pieces, (shoulder, elbow, _) = AIR.pieces, WING.breaks
    stretch = (elbow - shoulder) / SHAPE.elbow[1]
    at = {0: lambda y: y, 1: lambda y: shoulder + y * stretch, 2: lambda y: elbow + y}
    arc = np.array([at[link](y) for link, y in zip(pieces.link[:10], pieces.y[:10], strict=True) if link < 3])
    assert 1e3 * arc[:6] == pytest.approx(1e3 * AIR.line.y[:6], abs=1e-9)
    edges = 1e3 * 0.5 * WING.span * np.cos(np.array([6.5, 7.5, 8.5]) * np.pi / 17.0)
    joints = 1e3 * np.array([elbow, shoulder])
    parts = [(edges[0], joints[0]), (joints[0], edges[1]), (edges[1], joints[1]), (joints[1], edges[2])]
    assert 1e3 * arc[6:10] == pytest.approx([sum(part) / 2.0 for part in parts], abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_links_power_is_the_strips_force_times_the_strips_velocity(seed: int) -> None:
    """A strip across a joint gives each link its share of force, and moves with the mean of their velocities.

    A straight wing whose quarter chord is taken at mid-chord (lead 0, broadside) has no other power than that.
    """
    rng = np.random.default_rng(seed)
    twists = np.zeros((5, 6))
    twists[:, [1, 2, 3]] = rng.normal(size=(5, 3))  # broadside: the links rise and flap, none moves forward
    wrenches, _, strips = evaluate(BARE, twists, 0.1 * rng.normal(size=BARE.state_size))
    assert not strips.lead.any()
    assert np.sum(wrenches * twists) == pytest.approx(-strips.force_z @ strips.w, rel=1e-12, abs=1e-15)


def test_the_flapping_robots_lift_converges_in_strips() -> None:
    """Mean lift over a flap of the prescribed motion, against 96 strips: -0.8, -0.3 and -0.2 % with 16, 24 and 32.

    With whole strips on the link under their station it was +4.8, +0.9 and -1.3 %, as the joints fell.
    """
    exact = flap_robot(96, STEPS // 3)[0][:, 2].mean()
    found = {strips: flap_robot(strips, STEPS // 10)[0][:, 2].mean() / exact - 1.0 for strips in (16, 20, 24, 28, 32)}
    assert [100.0 * found[strips] for strips in (16, 24, 32)] == pytest.approx([-0.77, -0.31, -0.16], abs=0.05)
    assert max(np.abs(list(found.values()))) < 0.01
