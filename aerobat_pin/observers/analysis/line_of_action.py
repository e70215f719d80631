"""Where one unknown point force acts: its line of action, from its wrench, and the points where this line passes.

A force f at the point r has the moment m = r x f about the origin. This determines r except for its position along f:

    r = f x m / |f|^2 + t f            pitch = f . m / |f|^2 = 0

A wrench with nonzero pitch cannot come from a single point force. A couple perpendicular to f only moves the line.
It cannot be distinguished from a force further away, unless the line then misses the robot. Errors are propagated to
first order. A panel is a flat polygon in space, such as that of a wing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.numerics import Array, guarded, shaped
from aerobat_pin.observers.analysis.noise_and_lag import correlation_length

FLAT = 1.0e-3  # largest distance of a corner from the plane, as a share of the panel's size
SIGMAS = 3.0  # standard deviations; a normal error exceeds them once in 370 cases
FAINTEST = 5.0  # standard deviations; the direction of a smaller force cannot be linearised
ROUNDING = 1.0e-6  # share of a moment that is attributed to rounding in exact data
LARGEST_MISFIT = 2.0  # accepted misfit: the given covariance is seldom known better than by this factor


class Panel:
    """A flat polygon, convex or not, by the outline of its corners (k, 3) in order [m].

    Repeated corners are removed; about the unit `normal` (3,) they run counter-clockwise. Raises ObserverError for
    fewer than three, or if they are not finite, not flat or enclose no area.
    """

    def __init__(self, outline: ArrayLike) -> None:
        corners = np.array(outline, float)
        if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 3 or not np.all(np.isfinite(corners)):
            raise ObserverError(f"outline of shape {corners.shape}: three finite corners (k, 3) or more were expected")
        corners = corners[np.any(corners != np.roll(corners, -1, axis=0), axis=1)]  # a repeated corner has no edge
        if len(corners) < 3:
            raise ObserverError("outline: three different corners or more were expected")
        arms = corners - corners[0]
        area = 0.5 * np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0)
        size = float(np.linalg.norm(area))
        reach = float(np.linalg.norm(arms, axis=1).max())
        if not size > 1e-12 * reach**2 or np.abs(arms @ area / size).max() > FLAT * reach:
            raise ObserverError("outline: the corners of a flat polygon with an area were expected")
        self.corners: Array = corners
        self.normal: Array = area / size

    def margin(self, point: Array) -> tuple[float, Array]:
        """Return how far a point (3,) in the plane is inside the outline [m], and the unit vector (3,) along that."""
        edges = np.roll(self.corners, -1, axis=0) - self.corners
        away = point - self.corners
        share = np.clip(np.sum(away * edges, axis=1) / np.maximum(np.sum(edges**2, axis=1), 1e-300), 0.0, 1.0)
        gaps = away - share[:, None] * edges
        distances = np.linalg.norm(gaps, axis=1)
        nearest = int(np.argmin(distances))
        distance = float(distances[nearest])
        across = np.cross(self.normal, edges[nearest])
        along = gaps[nearest] / distance if distance > 0.0 else across / np.linalg.norm(across)
        next_away = np.roll(away, -1, axis=0)
        turns = np.arctan2(np.cross(away, next_away) @ self.normal, np.sum(away * next_away, axis=1))
        inside = abs(turns.sum()) > np.pi  # the outline winds around the point
        return (distance if inside else -distance), along


@dataclass(frozen=True)
class Crossing:
    """The point where a line of action meets the plane of a panel.

    Attributes:
        point: (3,) the point [m].
        covariance: (3, 3) covariance of the point, which lies in the panel's plane [m2].
        margin: distance of the point from the panel's outline [m], negative outside.
        margin_deviation: standard deviation of the margin [m].
    """

    point: Array
    covariance: Array
    margin: float
    margin_deviation: float

    @property
    def verdict(self) -> str:
        """`inside`, `outside`, or `too close to the outline to tell`."""
        if abs(self.margin) < SIGMAS * self.margin_deviation:
            return "too close to the outline to tell"
        return "inside" if self.margin >= 0.0 else "outside"


@dataclass(frozen=True)
class LineOfAction:
    """The line along which one force acts, in the frame of the wrench from which it was computed.

    Attributes:
        wrench: (6,) force [N] and moment about the frame's origin [N m].
        covariance: (6, 6) covariance of the wrench.
    """

    wrench: Array
    covariance: Array

    @property
    def verdict(self) -> str:
        """`a point force`, `not a pure force`, or `nothing can be said` if force and moment are lost in the noise."""
        force, moment = self.wrench[:3], self.wrench[3:]
        if not np.linalg.norm(force) > FAINTEST * _largest(self.covariance[:3, :3]):
            seen = np.linalg.norm(moment) > FAINTEST * _largest(self.covariance[3:, 3:])
            return "not a pure force" if seen else "nothing can be said"
        doubt = SIGMAS * self.pitch_deviation + ROUNDING * np.linalg.norm(moment) / np.linalg.norm(force)
        return "not a pure force" if abs(self.pitch) > doubt else "a point force"

    @property
    def point(self) -> Array:
        """(3,) the point of the line that is nearest to the origin [m]."""
        return np.cross(self.wrench[:3], self.wrench[3:]) / self._square

    @property
    def direction(self) -> Array:
        """(3,) unit vector along the force."""
        return np.asarray(self.wrench[:3] / np.sqrt(self._square))

    @property
    def pitch(self) -> float:
        """Moment along the force divided by the force [m]; zero for a single point force."""
        return float(self.wrench[:3] @ self.wrench[3:] / self._square)

    @property
    def pitch_deviation(self) -> float:
        """Standard deviation of the pitch [m]."""
        force, moment = self.wrench[:3], self.wrench[3:]
        row = np.concatenate([moment - 2.0 * self.pitch * force, force]) / self._square
        return float(np.sqrt(row @ self.covariance @ row))

    @guarded()
    def seen_from(self, placement: pin.SE3) -> LineOfAction:
        """Return the same line in another frame.

        Args:
            placement: placement of the other frame in this line's frame, such as that of a link in the base frame.
        """
        X = placement.toActionMatrix().T
        return LineOfAction(X @ self.wrench, X @ self.covariance @ X.T)

    @guarded()
    def cross(self, outline: ArrayLike) -> Crossing:
        """Return the point where the line meets the plane of a panel.

        Args:
            outline: (k, 3) corners of a flat polygon in order [m], in the frame of the wrench.

        Raises:
            ObserverError: there is no line of action, it is parallel to the plane, or the outline is no flat polygon.
        """
        if self.verdict != "a point force":
            raise ObserverError(f"no line of action: {self.verdict}")
        panel, force = Panel(outline), self.wrench[:3]
        across = float(panel.normal @ force)
        if not abs(across) > SIGMAS * np.sqrt(panel.normal @ self.covariance[:3, :3] @ panel.normal):
            raise ObserverError("the line of action is parallel to the plane of the panel: there is no crossing")
        step = float(panel.normal @ (panel.corners[0] - self.point)) / across
        along = np.hstack([step * np.eye(3), np.zeros((3, 3))])
        J = (np.eye(3) - np.outer(force, panel.normal) / across) @ (self._point_jacobian() + along)
        point, covariance = self.point + step * force, J @ self.covariance @ J.T
        margin, outward = panel.margin(point)
        return Crossing(point, covariance, margin, float(np.sqrt(outward @ covariance @ outward)))

    @property
    def _square(self) -> float:
        square = float(self.wrench[:3] @ self.wrench[:3])
        if square == 0.0:
            raise ObserverError("no line of action: the force is zero")
        return square

    def _point_jacobian(self) -> Array:
        """Return the derivative of `point` by the wrench (3, 6)."""
        force, moment = self.wrench[:3], self.wrench[3:]
        by_force = -pin.skew(moment) - 2.0 * np.outer(self.point, force)
        return np.asarray(np.hstack([by_force, pin.skew(force)]) / self._square)


@guarded()
def locate(wrench: ArrayLike, covariance: ArrayLike) -> LineOfAction:
    """Compute the line of action of one force from its wrench.

    Args:
        wrench: (6,) force [N] and moment [N m] in the axes of a frame and about its origin. These are the components of
            an `Application(link, "wrench", "frame")`. If the link is unknown, take the first six entries of a
            free-flyer's generalised residual: the wrench on the whole robot in the frame of the base.
        covariance: (6, 6) covariance of the wrench, such as that in a free run or that from `predict`.

    Raises:
        ShapeError: an array has the wrong shape.
        ObserverError: a number is not finite, or the covariance is not symmetric and positive semidefinite.
    """
    return LineOfAction(shaped(wrench, (6,), "wrench").copy(), checked_covariance(wrench, covariance).copy())


def checked_covariance(wrenches: ArrayLike, covariance: ArrayLike) -> Array:
    """Return the covariance (6, 6) of wrenches after checking both. Raises ShapeError or ObserverError."""
    S = shaped(covariance, (6, 6), "covariance")
    if not (np.all(np.isfinite(S)) and np.all(np.isfinite(np.asarray(wrenches, float)))):
        raise ObserverError("wrench and covariance: finite numbers were expected")
    scale = np.sqrt(np.maximum(np.diag(S), 0.0))
    scale[scale == 0.0] = 1.0  # correlations, since numbers in N and N m differ by orders of magnitude
    C = S / np.outer(scale, scale)
    if not np.allclose(C, C.T, rtol=0.0, atol=1e-9) or np.linalg.eigvalsh(0.5 * (C + C.T))[0] < -1e-9:
        raise ObserverError("covariance: a symmetric, positive semidefinite matrix was expected")
    return S


def _largest(covariance: Array) -> float:
    """Return the largest standard deviation in any direction."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


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
    """Compute the point of a link at which a force acts over many samples: the lines of a turning force meet there.

    The point r minimises the sum of e' S^-1 e over the log, with e the misfit of the moments and S its covariance:

        e = m - r x f          S(r) = B Cov B'          B = [-[r]x, 1]

    This is the maximum-likelihood estimate for errors in both force and moment. Least squares on the moments only would
    bias the point towards the origin. Of the log, the fit needs only its 6 x 6 scatter matrix sum (f, m)(f, m)'.

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
