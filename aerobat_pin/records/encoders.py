"""From what encoders show to joints: gears, zeros and coupled drives.

Readings r, one of each joint's column, give  q = A r + q0  and  v = A r', with A = coupling diag(factor). Efforts are
torques at the encoders; a drive without losses keeps their power, tau . v = tau_r . r', so that tau = A^-T tau_r.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.numerics import Array
from aerobat_pin.records.map_tables import JointsTable


def encoder_matrix(table: JointsTable, joints: Sequence[str]) -> Array:
    """Return A (n, n), from readings to joints [1, m/rad].

    Raises:
        MapError: a joint has no channel, or readings that do not tell the joints apart.
    """
    inner = {name for row in table.coupling.values() for name in row}
    named = {"factor": {*table.factor} - {"*"}, "offset": {*table.offset}, "coupling": {*table.coupling} | inner}
    for key, names in named.items():
        if strangers := sorted(names - set(joints)):
            raise MapError(f"map: joints.{key}: no joint '{strangers[0]}' with a channel: {', '.join(joints)}")
    factor = [table.factor.get(name, table.factor.get("*", 1.0)) for name in joints]
    shares = np.array([[table.coupling.get(j, {j: 1.0}).get(k, 0.0) for k in joints] for j in joints])
    if 0.0 in factor:
        raise MapError(f"map: joints.factor of {joints[factor.index(0.0)]} = 0: another number was expected")
    if np.linalg.matrix_rank(shares) < len(joints):
        rows = ", ".join(table.coupling)
        raise MapError(f"map: joints.coupling: its encoders do not tell {rows} apart: independent rows were expected")
    return shares.reshape(len(joints), len(joints)) * factor


def encoder_offset(table: JointsTable, joints: Sequence[str]) -> Array:
    """Return q0 (n,): where the joints are when all encoders show 0 [rad, m]."""
    return np.array([table.offset.get(name, 0.0) for name in joints])


def effort_matrix(table: JointsTable, joints: Sequence[str], driven: Sequence[str]) -> Array:
    """Return A^-T (m, m), from torques at encoders to those of the joints that have efforts.

    Raises:
        MapError: as `encoder_matrix`, or one of them is coupled to a joint without effort.
    """
    A, own = encoder_matrix(table, joints), [name in driven for name in joints]
    other = np.logical_not(own)
    tied = (A != 0.0) & (np.outer(own, other) | np.outer(other, own))
    if tied.any():
        first, second = (joints[int(k)] for k in np.argwhere(tied)[0])
        raise MapError(f"map: joints.effort: {first} and {second} are coupled: efforts of both were expected")
    return np.asarray(np.linalg.inv(A[np.ix_(own, own)]).T)


def encoder_words(table: JointsTable, joints: Sequence[str]) -> dict[str, str]:
    """Return joint -> what is made of its reading, in words."""
    A, found = encoder_matrix(table, joints), {}
    for name, row, zero in zip(joints, A, encoder_offset(table, joints), strict=True):
        terms = [f"{share:.9g} {other}" for share, other in zip(row, joints, strict=True) if share]
        found[name] = " + ".join([*terms, f"{zero:.9g}"] if zero else terms)
    return found
