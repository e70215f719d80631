"""Stretch a body and multiply its mass, with consistent centre of mass and inertia."""

from __future__ import annotations

from dataclasses import replace

from aerobat_description.morphology_tables import Body


def stretched(body: Body, mass: float, x: float, y: float) -> Body:
    """Return a body with every particle (X, Y, Z) moved to (x X, y Y, Z) and made `mass` times as heavy.

    The second moments of mass S = tr(J)/2 1 - J stretch as diag(x, y, 1) S diag(x, y, 1), and J = tr(S) 1 - S.
    """
    if mass == x == y == 1.0:
        return body
    jxx, jyy, jzz, jxy, jxz, jyz = body.inertia
    sxx, syy, szz = (x * x * (jyy + jzz - jxx) / 2, y * y * (jxx + jzz - jyy) / 2, (jxx + jyy - jzz) / 2)
    jxx, jyy, jzz, jxy, jxz, jyz = syy + szz, sxx + szz, sxx + syy, x * y * jxy, x * jxz, y * jyz
    inertia = (mass * jxx, mass * jyy, mass * jzz, mass * jxy, mass * jxz, mass * jyz)
    return replace(body, mass=mass * body.mass, com=(x * body.com[0], y * body.com[1], body.com[2]), inertia=inertia)
