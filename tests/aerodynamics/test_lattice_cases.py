"""Flapping, plunging and pitching rectangles against an unsteady vortex lattice (PteraSoftware 5.1.0, k = 0.39)."""

# The line's moment is larger: half the lattice's time step adds 18 % to its own in plunge, 14 % in pitch; the rest is
# the aerodynamic centre, 0.205 c in steady flow: a lifting line knows no chordwise part of downwash.

import numpy as np
import pytest
from support.further import further
from support.lattice_cases import errors, flown
from support.references import LATTICE_FINE, indicial_rise, lattice

from aerobat_pin.aerodynamics import LiftingLine


@pytest.mark.parametrize(
    ("name", "lift", "thrust", "moment", "quarter", "centre"),
    [
        ("flap 30 deg, incidence 5 deg", 4.7, 0.890, 1.160, 0.969, 0.301),
        ("plunge 10 mm", 2.5, 0.937, 1.217, 1.180, 0.278),
        ("pitch 5 deg", 5.7, 1.034, 1.095, 1.104, 0.334),
        *further(("flap 30 deg", 4.4, 0.897, 1.172, 0.972, 0.299), ("flap 5 deg", 5.2, 0.925, 1.269, 1.127, 0.281)),
    ],
)
def test_loads_of_lattices(name: str, lift: float, thrust: float, moment: float, quarter: float, centre: float) -> None:
    """Lift rms error at most 6.5 %, thrust within 12 %; moments about leading edge and quarter chord as measured."""
    found = errors(flown(name), lattice(name))
    assert found.lift < 0.065
    assert abs(found.thrust - 1.0) < 0.12
    assert 100.0 * found.lift == pytest.approx(lift, abs=0.1)
    assert (found.thrust, found.moment, found.quarter) == pytest.approx((thrust, moment, quarter), abs=1e-3)
    assert found.centre == pytest.approx(centre, abs=1e-3)


@pytest.mark.parametrize(("name", "moment"), [("plunge 10 mm", 1.027), ("pitch 5 deg", 0.962)])
def test_the_moment_is_nearer_to_a_lattice_with_half_the_step(name: str, moment: float) -> None:
    """Sizes of the first harmonics with 128 steps a cycle: lift within 3 %, moment within 4 %."""
    ours, fine = flown(name), LATTICE_FINE[name]
    assert abs(ours.lift[1]) / abs(fine[0]) == pytest.approx(1.0, abs=0.03)
    assert abs(ours.moment[1]) / abs(fine[1]) == pytest.approx(moment, abs=1e-3)


@pytest.mark.parametrize("name", ["flap 5 deg", *further("plunge 10 mm", "pitch 5 deg")])
def test_at_small_angles_the_robots_strips_give_the_same(name: str) -> None:
    """Incidence below 10 deg: lift within 0.3 %, thrust within 1.1 %, moment within 0.1 % of `fly`."""
    line, strips = flown(name), flown(name, robot=True)
    assert abs(strips.lift[1] / line.lift[1] - 1.0) < 3e-3
    assert strips.thrust == pytest.approx(line.thrust, rel=0.011)
    assert abs(strips.moment[1] / line.moment[1] - 1.0) < 1e-3


@pytest.mark.parametrize(
    ("aspect", "off"),
    [
        (3.0, {0.0: 16.2, 1.0: 3.6, 2.0: -1.9, 5.0: -6.3, 10.0: -5.8}),
        (6.0, {0.0: 4.3, 1.0: -1.9, 2.0: -5.2, 5.0: -8.1}),
    ],
)
def test_the_indicial_rise_of_a_finite_wing_is_near_jones(aspect: float, off: dict[float, float]) -> None:
    """R. T. Jones, NACA TR 681 (1940), elliptic wings, share of the final lift at s mean semichords; in percent."""
    # The line starts higher, with Wagner's half of a lift that downwash has not reduced yet, and rises more slowly.
    s = np.array(list(off))
    line = LiftingLine(1.0, lambda y: 4.0 / (np.pi * aspect) * np.sqrt(1.0 - 4.0 * y**2))
    lift = line.step_response([*(s / 2.0 / aspect), 1e4], 1.0, 1.0) @ line.width
    assert 100.0 * (lift[:-1] / lift[-1] / indicial_rise(aspect, s) - 1.0) == pytest.approx(list(off.values()), abs=0.1)
