"""The shed wake of a flight, for pictures and sums: where each strip's vorticity was shed, and how strong it is.

Bound circulation that changes leaves its change behind (Kelvin): between two samples a strip sheds
-(Gamma_k+1 - Gamma_k) across the flow, at its trailing edge. Circulation that differs from strip to strip leaves the
difference behind along the flow: Gamma_i - Gamma_i-1 between neighbours, all of it at the tips' outer sides.

The wake is frozen: it drifts with the wind and induces nothing on itself, so that it does not roll up. The lifting
line's own wake is not this one but Wagner's and Prandtl's, straight behind the wing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import Wind
from aerobat_pin.errors import LogError
from aerobat_pin.flight.air_from_scenario import robot_air, wind_of
from aerobat_pin.flight.flight_log import FlightLog
from aerobat_pin.numerics import Array
from aerobat_pin.robot import LINKS, Aerobat
from aerobat_pin.scenario import AirSection


@dataclass(frozen=True)
class Wake:
    """A frozen wake on m samples and N strips, left tip first.

    Attributes:
        time: (m,) of shedding [s].
        position: (m, N, 3) trailing edges in world axes when they shed [m].
        bound: (m, N) circulation of the strips [m2/s].
        wind: that it drifts with.
    """

    time: Array
    position: Array
    bound: Array
    wind: Wind

    @property
    def shed(self) -> Array:
        """Circulation (m - 1, N) shed across the flow between samples [m2/s]: minus the change of the bound one."""
        return -np.diff(self.bound, axis=0)

    @property
    def trailing(self) -> Array:
        """Circulation (m, N + 1) of the vortices along the flow, between strips and outside the tips [m2/s].

        Positive turns as the bound circulation does when it is bent backward at the left end of a strip.
        """
        return np.diff(self.bound, axis=1, prepend=0.0, append=0.0)

    def mean_trailing(self, start: float, end: float) -> Array:
        """Return the mean strength (N + 1,) [m2/s] of the trailing vortices shed from `start` to `end` [s].

        Over whole flaps of a steady flight this is the structure that stays behind: minus the spanwise change of the
        mean bound circulation, while what is shed across the flow cancels.
        """
        chosen = (self.time >= start - 1e-9) & (self.time < end - 1e-9)
        return np.asarray(self.trailing[chosen].mean(axis=0))


def wake_of(log: FlightLog, robot: Aerobat, air: AirSection) -> Wake:
    """Read the wake from a simulated flight.

    Args:
        log: with its truth.
        robot: the robot that flew.
        air: the air it flew in; number of strips and wind.

    Raises:
        LogError: the log has no truth, or other strips.
    """
    if log.truth is None:
        raise LogError("the wake needs the bound circulation: this log has no group 'truth', only a simulation has")
    bound, incidence = (np.asarray(log.truth[name].values, float) for name in ("circulation", "incidence"))
    placed = robot_air(robot.wing, air)
    if bound.shape[1] != air.strips:
        raise LogError(f"the log has {bound.shape[1]} strips, air.strips = {air.strips}")
    # What trails is the rear edge, or the front one where the flow comes from behind.
    aft = np.where(np.cos(incidence) >= 0.0, -0.5, 0.5) * placed.line.chord
    data, joints = robot.model.createData(), [robot.model.getFrameId(link) for link in LINKS]
    position = np.empty((*bound.shape, 3))
    for k, q in enumerate(np.asarray(log.measured["q"].values, float)[: len(bound)]):
        pin.framesForwardKinematics(robot.model, data, q)
        for i, link in enumerate(placed.link):
            place = data.oMf[joints[link]]
            position[k, i] = place.act(placed.mid_chord[i] + np.array([aft[k, i], 0.0, 0.0]))
    return Wake(log.time[: len(bound)], position, bound, wind_of(air))
