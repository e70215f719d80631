"""The point of a link at which a force acts during a whole log: the lines of action of a turning force meet there.

The point r minimises the sum of e' S^-1 e over the log, with e the misfit of the moments and S its covariance:

    e = m - r x f          S(r) = B Cov B'          B = [-[r]x, 1]

This is the maximum-likelihood estimate for errors in both force and moment. Least squares on the moments only would
bias the point towards the origin. Of the log, only its 6 x 6 scatter matrix sum (f, m)(f, m)' is needed for the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers.analysis.line_of_action import FAINTEST, ROUNDING, checked_covariance
from aerobat_pin.observers.analysis.noise_and_lag import correlation_length

LARGEST_MISFIT = 2.0  # accepted misfit: the given covariance is seldom known better than by this factor


@dataclass(frozen=True)
class PointOfAction:
    """The point of a link that fits a log best, in the frame of the wrenches.

    Attributes:
        point: (3,) the point [m]. If the force never turns, the point of its line that is nearest to the origin.
        covariance: (3, 3) covariance of the point [m2], without the directions `unknown`.
        unknown: (k, 3) unit vectors along which the log does not determine the point; none if the force turns.
        misfit: mean square of the moments' misfit relative to its covariance; about 1 for one point force.
        limit: largest misfit that is accepted for one point force.
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


@guarded()
def locate_series(wrenches: ArrayLike, covariance: ArrayLike) -> PointOfAction:
    """Compute the point of a link at which a force acts over many samples.

    Args:
        wrenches: (m, 6) forces [N] and moments [N m] in the axes of the link and about its origin.
        covariance: (6, 6) covariance of each wrench. Errors can be correlated in time, as they are after a filter.

    Raises:
        ShapeError: there are fewer than two samples, or an array has the wrong shape.
        ObserverError: a number is not finite, or the covariance is not symmetric and positive semidefinite.
    """
    from scipy.optimize import least_squares  # takes a third of a second to import; only this function needs it

    z: Array = np.array(wrenches, float)
    if z.ndim != 2 or z.shape[1] != 6 or len(z) < 2:
        raise ShapeError(f"wrenches have shape {z.shape}: (m, 6) with two samples or more was expected")
    noise, count = checked_covariance(z, covariance), len(z)
    floor = (ROUNDING * np.sqrt(np.mean(z[:, 3:] ** 2))) ** 2 + 1e-30
    scatter = np.asarray(np.linalg.qr(z, mode="r"))  # replaces the log: it has the same scatter matrix

    def whitener(r: Array) -> Array:
        S = _misfits(r, _misfits(r, noise).T) + floor * np.eye(3)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(S)))

    W = whitener(np.zeros(3))
    seen, chance = _information(z[:, :3].T @ z[:, :3], W), _information(count * noise[:3, :3], W)
    values, axes = np.linalg.eigh(seen - chance)
    doubt = np.sqrt(correlation_length(z) / count) * np.einsum("ij,ik,kj->j", axes, chance, axes)
    determined = values > np.maximum(FAINTEST * doubt, 1e-9 * values[-1])
    known = axes[:, determined]

    def weighted(place: Array) -> Array:
        r = known @ place
        return (_misfits(r, scatter) @ whitener(r).T).ravel()

    point: Array = np.zeros(3)
    if known.size:
        exact = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-14)
        point = known @ least_squares(weighted, np.zeros(known.shape[1]), x_scale="jac", **exact).x

    W = whitener(point)
    errors = _misfits(point, z) @ W.T
    scores = np.cross(errors @ W, z[:, :3])
    length = correlation_length(scores @ known) if known.size else correlation_length(z)
    information = known.T @ _information(z[:, :3].T @ z[:, :3] - count * noise[:3, :3], W) @ known
    return PointOfAction(
        point=point,
        covariance=length * known @ np.linalg.inv(information) @ known.T,
        unknown=axes[:, ~determined].T,
        misfit=float(np.sum(errors**2) / (3 * count - known.shape[1])),
        limit=max(LARGEST_MISFIT, 1.0 + FAINTEST * float(np.sqrt(2.0 * length / (3 * count)))),
    )


def _misfits(r: Array, wrenches: Array) -> Array:
    """Return the misfit m - r x f of the moments (n, 3), for wrenches (f, m) (n, 6) and a point r (3,)."""
    return np.asarray(wrenches[:, 3:] - np.cross(r, wrenches[:, :3]))


def _information(F: Array, W: Array) -> Array:
    """Return the information sum [f]x' W' W [f]x (3, 3) on a point, from the scatter matrix F (3, 3) of the forces."""
    whitened = W @ np.array([pin.skew(axis) for axis in np.eye(3)])
    return np.asarray(np.einsum("ij,ika,jkb->ab", F, whitened, whitened))
