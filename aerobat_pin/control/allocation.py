"""Allocation: the thrusts between 0 and their limits whose wrench comes nearest to the one that is wanted.

    minimise |W (B u - w)|^2 + EVEN |W B|^2 |u|^2        0 <= u <= limit

Six thrusters cannot push sideways, and a limited one leaves something of the other five components too. The weights W
decide what is given up first: sideways is not asked for, then forward thrust, lift, yaw, and last of all roll and
pitch, without which the robot falls. Yaw comes before lift: else, where a gust has taken the need for lift away,
thrusters 5 and 6, which hardly roll the robot, would help to do so for the sake of a little lift, and turn it. Moments
count by a lever arm. Nobody is asked for more of a component than all thrusters can make of it, so that a lift far out
of reach does not crowd out the rest. The last term chooses among thrusts with the same wrench the smallest ones.

The problem is convex. The active-set method (Nocedal and Wright, Numerical Optimization, section 16.5) ends at its
solution after a few changes of the set of thrusters at a limit; none is needed where nothing is limited.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from aerobat_pin.flight import ThrusterSet
from aerobat_pin.numerics import Array, Integers, fields_of, inner, kernel, new_state, shaped, solve_positive

THRUSTER_ARM = 0.2  # [m]: about the thrusters' distance
PRIORITY = {"Fx": 0.1, "Fy": 0.0, "Fz": 3.0, "Mx": 30.0, "My": 30.0, "Mz": 10.0}
EVEN = 1.0e-9
MOST_CHANGES = 60


class Limited(NamedTuple):
    """The problem of m thrusters: `map` (6, m), `limit` (m,), and with the weights, `H` (m, m), `f` (m, 6) of it.

    `free` (m, 6) is its solution where nothing is limited, `least` and `most` (6,) the wrenches within reach. Scratch
    are `active` (m,), `A` (m, m), `b` (m,), `linear` (m,).
    """

    map: Annotated[Array, "6, m"]
    limit: Annotated[Array, "m"]
    H: Annotated[Array, "m, m"]
    f: Annotated[Array, "m, 6"]
    free: Annotated[Array, "m, 6"]
    least: Annotated[Array, "6"]
    most: Annotated[Array, "6"]
    active: Annotated[Integers, "m"]
    A: Annotated[Array, "m, m"]
    b: Annotated[Array, "m"]
    linear: Annotated[Array, "m"]


class Allocation:
    """Thrusts for a wanted wrench.

    Args:
        thrusters: the thrusters, with the limits that are believed.
        factor: what they push, as a factor of what is commanded.

    Attributes:
        free: (m, 6) thrusts per wrench where nothing is limited [-, 1/m].
    """

    def __init__(self, thrusters: ThrusterSet, factor: float = 1.0) -> None:
        self.map, self.limit = factor * thrusters.map, thrusters.limit.copy()
        self._memory = new_state(Limited, m=len(self.limit))
        fields = fields_of(self._memory, Limited)
        self.fill(fields)
        self.free = fields.free

    def fill(self, problem: Limited) -> None:
        """Write the problem into the memory of a kernel."""
        problem.map[:], problem.limit[:] = self.map, self.limit
        weight = np.array(list(PRIORITY.values())) / np.array([1.0, 1.0, 1.0, THRUSTER_ARM, THRUSTER_ARM, THRUSTER_ARM])
        weighted = weight[:, None] * self.map
        problem.H[:] = weighted.T @ weighted
        problem.H[:] += EVEN * np.trace(problem.H) * np.eye(len(self.limit))
        problem.f[:] = weighted.T * weight
        problem.free[:] = np.linalg.solve(problem.H, problem.f)
        problem.least[:] = np.minimum(self.map, 0.0) @ self.limit
        problem.most[:] = np.maximum(self.map, 0.0) @ self.limit

    def thrusts(self, wrench: Array) -> Array:
        """Return the thrusts (m,) [N] for a wanted wrench (6,) at the body's centre of mass, body axes."""
        thrust = np.empty(len(self.limit))
        allocate(self._memory, shaped(wrench, (6,), "wrench"), thrust)
        return thrust

    def unrealised(self, wrench: Array, thrust: Array) -> Array:
        """Return what thrusts (m,) leave of a wanted wrench (6,): wanted less made."""
        return np.asarray(wrench - self.map @ thrust)


@kernel
def allocate(memory: Array, wrench: Array, thrust: Array) -> None:
    """Write the thrusts (m,) for a wanted wrench (6,)."""
    limited_thrusts(fields_of(memory, Limited), wrench, thrust)


@inner
def limited_thrusts(problem: Limited, wrench: Array, thrust: Array) -> None:
    """Write the thrusts (m,) for a wanted wrench (6,); the limits are asked only where they are passed."""
    good = True
    for i in range(thrust.shape[0]):
        thrust[i] = 0.0
        for j in range(6):
            thrust[i] += problem.free[i, j] * wrench[j]
        good = good and 0.0 <= thrust[i] <= problem.limit[i]
    if good:
        return
    for i in range(thrust.shape[0]):
        problem.linear[i] = 0.0
        for j in range(6):
            problem.linear[i] += problem.f[i, j] * min(max(wrench[j], problem.least[j]), problem.most[j])
    limit_thrusts(problem, thrust)


@inner
def limit_thrusts(problem: Limited, u: Array) -> None:
    """Minimise u . H u / 2 - linear . u for 0 <= u <= limit; u (m,) is any start, and written.

    `active` is -1 and 1 for what is held at its lower and upper limit, 0 for what is free.
    """
    H, f, limit, active, A, b = problem.H, problem.linear, problem.limit, problem.active, problem.A, problem.b
    m = u.shape[0]
    for i in range(m):
        active[i] = -1 if u[i] <= 0.0 else (1 if u[i] >= limit[i] else 0)
        u[i] = min(max(u[i], 0.0), limit[i])
    for _ in range(MOST_CHANGES):
        for i in range(m):  # the step to the minimum over the free ones; the rest stays
            b[i] = f[i] if active[i] == 0 else 0.0
            for j in range(m):
                A[i, j] = H[i, j] if active[i] == 0 and active[j] == 0 else (1.0 if i == j else 0.0)
                if active[i] == 0:
                    b[i] -= H[i, j] * u[j]
        solve_positive(A, b)
        share, first = 1.0, -1
        for i in range(m):
            if active[i] == 0:
                room = limit[i] - u[i] if b[i] > 0.0 else -u[i]
                if abs(b[i]) * share > abs(room):
                    share, first = room / b[i], i
        for i in range(m):
            if active[i] == 0:
                u[i] += share * b[i]
        if first >= 0:
            active[first] = 1 if b[first] > 0.0 else -1
            u[first] = limit[first] if b[first] > 0.0 else 0.0
            continue
        release = most_held(problem, u)
        if release < 0:
            return
        active[release] = 0


@inner
def most_held(problem: Limited, u: Array) -> int:
    """Return which thruster at a limit the function would fall by most for, per newton inwards; -1 for none."""
    H, f, active, largest, held = problem.H, problem.linear, problem.active, 1e-12, -1
    for i in range(u.shape[0]):
        if active[i] != 0:
            slope = -f[i]
            for j in range(u.shape[0]):
                slope += H[i, j] * u[j]
            gain = -slope if active[i] < 0 else slope
            if gain > largest:
                largest, held = gain, i
    return held
