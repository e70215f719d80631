"""A pitching section has Theodorsen's lift and moment and Garrick's thrust, through `fly` and the robot's kernel.

Axes at the 1/4, 1/2 and 3/4 chord; reduced frequencies from 0.05 to 2; 1 mrad. The line has the C(k) of R. T. Jones's
fit, so that against the C(k) of Theodorsen the fit's own error of up to 2.3 % comes in.
"""

from __future__ import annotations

import numpy as np
import pytest
from support.references import Pitch, jones_harmonic, pitch, theodorsen
from support.section_law import ENDLESS, STEPS, fly_on_links

from aerobat_pin.aerodynamics import LiftingLine, Stroke, fly

SPEED, SEMICHORD, ANGLE = 4.0, 0.05, 1e-3
FREQUENCIES = [0.05, 0.1, 0.39, 1.0, 2.0]
AXES = (-0.5, 0.0, 0.5)  # semichords behind mid-chord


def line_about(*axes: float) -> LiftingLine:
    """Return an endless wing whose strips have the pitch axis, x = 0, at different places of their chords."""
    quarter = [(axis + 0.5) * SEMICHORD for axis in axes]
    return LiftingLine(
        ENDLESS, 2.0 * SEMICHORD, strips=len(axes), quarter_chord=quarter if len(axes) > 1 else quarter[0]
    )


def stroke_of(k: float) -> tuple[Stroke, int]:
    """Return a pitching motion and the number of its cycles, after which the start is forgotten."""
    frequency = k * SPEED / SEMICHORD / (2.0 * np.pi)
    return Stroke(SPEED, frequency=frequency, pitch=ANGLE), max(4, int(np.ceil(80.0 * k / (2.0 * np.pi))))


def assert_section(found: Pitch, k: float, axis: float) -> None:
    """Compare with both C(k): lift and moment relative to their sizes, as complex amplitudes."""
    for lag, lift, moment in ((jones_harmonic(k), 1e-3, 1e-3), (theodorsen(k), 0.0234, 0.0234)):
        theory = pitch(k, axis, ANGLE, SPEED, SEMICHORD, complex(lag))
        assert abs(found.lift - theory.lift) < lift * abs(theory.lift)
        assert abs(found.moment - theory.moment) < moment * abs(theory.moment)
    fit = pitch(k, axis, ANGLE, SPEED, SEMICHORD, complex(jones_harmonic(k)))
    assert found.thrust == pytest.approx(fit.thrust, abs=1e-3 * abs(fit.lift) * ANGLE)


@pytest.mark.parametrize("k", FREQUENCIES)
def test_a_pitching_section_is_theodorsens_and_garricks(k: float) -> None:
    """Through `fly`: with Jones's C(k) to 0.1 %, with the exact one to 2.34 %. Two axes in one flight."""
    (stroke, cycles), axes = stroke_of(k), [AXES[:2], AXES[2:]]
    phase = np.arange(64) / 64.0
    time = (cycles - 1.0 + phase) / stroke.frequency
    turn = 2.0 * np.exp(-2j * np.pi * phase) / 64.0 * 1j  # of a sine
    for pair in axes:
        line = line_about(*pair)
        flight = fly(line, stroke, [0.0, *time] if time[0] > 0.0 else time)
        for strip, axis in enumerate(pair):
            width, last = line.width[strip], slice(-64, None)
            lift, thrust = (flight.strip_force[last, strip, i] / width for i in (2, 0))
            found = Pitch(lift @ turn, -flight.wrench[last, strip, 4] / width @ turn, thrust.mean())
            assert_section(found, k, axis)


@pytest.mark.parametrize("k", [0.05, 0.39, 2.0])
@pytest.mark.parametrize("axis", AXES)
def test_a_pitching_section_of_the_robots_is_theodorsens_and_garricks(k: float, axis: float) -> None:
    """The same through the kernel: its law is the line's up to the square of the incidence."""
    stroke, cycles = stroke_of(k)
    line = line_about(axis)
    force, moment = (part / line.width.sum() for part in fly_on_links(line, stroke, cycles))
    turn = 2.0 * np.exp(-2j * np.pi * np.arange(STEPS) / STEPS) / STEPS * 1j
    assert_section(Pitch(force[:, 2] @ turn, -moment[:, 1] @ turn, force[:, 0].mean()), k, axis)


def test_garricks_thrust_of_pitching_is_known_to_the_fits_error() -> None:
    """Pitch about mid-chord pulls at high k, drags at low k; with the exact C(k) within 2.5 % of lift times angle."""
    for k, pulls in ((0.1, False), (0.39, False), (4.0, True)):
        exact, fit = (pitch(k, 0.0, ANGLE, SPEED, SEMICHORD, complex(f(k))) for f in (theodorsen, jones_harmonic))
        assert (exact.thrust > 0.0) == pulls
        assert fit.thrust == pytest.approx(exact.thrust, abs=0.025 * abs(exact.lift) * ANGLE)
