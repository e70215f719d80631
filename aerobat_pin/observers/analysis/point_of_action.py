"""The one point of a link at which a force pushes over a whole log: as it turns, its lines of action meet there.

The point r minimises sum e' S^-1 e over the log, with the misfit of the moments and its covariance

    e = m - r x f          S(r) = B Cov B'          B = [-[r]x, 1]

which is maximum likelihood for errors in force and moment alike: least squares on the moments alone would pull the
point towards the origin. The log enters through its 6 x 6 scatter sum (f, m)(f, m)' alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array
from aerobat_pin.observers.analysis.bias import correlation_length
from aerobat_pin.observers.analysis.line_of_action import FAINTEST, ROUNDING, checked_covariance

LARGEST_MISFIT = 2.0  # of the moments' variance: the covariance handed in is seldom known better


@dataclass(frozen=True)
class PointOfAction:
    """The point of a link that fits a log best, in the axes and about the origin of the wrenches.

    Attributes:
        point: (3,) [m]; where the force never turns, the point of its line nearest to the origin.
        covariance: (3, 3) of it [m2], without the part along directions that the log does not tell.
        unknown: (k, 3) unit vectors along which nothing is known; none where the force turns.
        misfit: mean square of the moments' misfit over what the covariance explains, 1 where all is well.
        limit: of the misfit of one point.
    """

    point: Array
    covariance: Array
    unknown: Array
    misfit: float
    limit: float

    @property
    def verdict(self) -> str:
        """`a point`, `a line: the force never turns`, `not one point force`, or `nothing can be said`."""
        if self.misfit > self.limit:
            return "not one point force"
        if len(self.unknown) > 1:
            return "nothing can be said"
        return "a line: the force never turns" if len(self.unknown) else "a point"


def locate_series(wrenches: ArrayLike, covariance: ArrayLike) -> PointOfAction:
    """Find the one point of a link at which a force pushes over many samples.

    Args:
        wrenches: (m, 6) forces [N] and moments [N m] in the link's axes about its origin.
        covariance: (6, 6) of each; errors may be correlated in time, as behind a filter.

    Raises:
        ShapeError: fewer than two samples, or another shape.
        ObserverError: a number is not finite, or the covariance is not symmetric and positive semidefinite.
    """
    from scipy.optimize import least_squares  # a third of a second that only this needs

    z: Array = np.array(wrenches, float)
    if z.ndim != 2 or z.shape[1] != 6 or len(z) < 2:
        raise ShapeError(f"wrenches have shape {z.shape}: (m, 6) with two samples or more was expected")
    noise, count = checked_covariance(z, covariance), len(z)
    floor = (ROUNDING * np.sqrt(np.mean(z[:, 3:] ** 2))) ** 2 + 1e-30
    scatter = np.asarray(np.linalg.qr(z, mode="r"))  # as good as the log: the same sums of products

    def whitener(r: Array) -> Array:
        S = _misfits(r, _misfits(r, noise).T) + floor * np.eye(3)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(S)))

    W = whitener(np.zeros(3))
    seen, chance = _information(z[:, :3].T @ z[:, :3], W), _information(count * noise[:3, :3], W)
    values, axes = np.linalg.eigh(seen - chance)
    doubt = np.sqrt(correlation_length(z) / count) * np.einsum("ij,ik,kj->j", axes, chance, axes)
    told = values > np.maximum(FAINTEST * doubt, 1e-9 * values[-1])
    known = axes[:, told]
    fit = (
        least_squares(
            lambda a: (_misfits(known @ a, scatter) @ whitener(known @ a).T).ravel(),
            np.zeros(known.shape[1]),
            x_scale="jac",
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
        )
        if known.size
        else None
    )
    point = known @ fit.x if fit is not None else np.zeros(3)

    W = whitener(point)
    errors = _misfits(point, z) @ W.T
    scores = np.cross(errors @ W, z[:, :3])
    length = correlation_length(scores @ known) if known.size else correlation_length(z)
    information = known.T @ _information(z[:, :3].T @ z[:, :3] - count * noise[:3, :3], W) @ known
    return PointOfAction(
        point=point,
        covariance=length * known @ np.linalg.inv(information) @ known.T,
        unknown=axes[:, ~told].T,
        misfit=float(np.sum(errors**2) / (3 * count - known.shape[1])),
        limit=max(LARGEST_MISFIT, 1.0 + FAINTEST * float(np.sqrt(2.0 * length / (3 * count)))),
    )


def _misfits(r: Array, wrenches: Array) -> Array:
    """Return m - r x f (m, 3) of wrenches (m, 6)."""
    return np.asarray(wrenches[:, 3:] - np.cross(r, wrenches[:, :3]))


def _information(F: Array, W: Array) -> Array:
    """Return sum [f]x' W' W [f]x (3, 3) about a point from the scatter F (3, 3) of the forces."""
    skews = [pin.skew(axis) for axis in np.eye(3)]
    total = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            total += F[i, j] * (W @ skews[i]).T @ (W @ skews[j])
    return total
