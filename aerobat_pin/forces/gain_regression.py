"""The regression of efforts on what the motion needs, as products of its columns, summed over blocks of time.

All columns are taken behind two low-passes: noise of accelerations, which are differences of rates, makes
masses too small (Gautier 1997). What is left over lasts longer than a sample: sums over blocks say by how much, and
each row counts the less. A joint at rest counts little, as friction there is anything up to Coulomb's.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.forces.inverse_dynamics import accelerations, contact_torque, halfway, required_torque
from aerobat_pin.forces.known_forces import KnownForces
from aerobat_pin.forces.stored_estimate import TIME_CONSTANTS_TO_SETTLE
from aerobat_pin.numerics import Array, frame_id
from aerobat_pin.observers import SMOOTH_RATE, twice_low_passed, typical_step
from aerobat_pin.records import Block, Map, Record

MOST_FITTED = 200_000  # samples of a fit; a longer record is thinned
MOST_REGRESSED = 40_000  # samples of which the regressor is computed
LASTS, FEWEST_BLOCKS = 2.5, 4  # [s] after which what is left over counts as new; shorter where there are fewer
MASS_ERROR, CENTRE_ERROR = 0.1, 0.03  # expected of each link [-, m]
GYRATION = 0.05  # [m]: radius of gyration of a payload, and of what each link's inertia may be wrong by
FRICTION_ERROR = 0.1  # expected of friction that another record showed, of Coulomb's for the offset [-]
LEAST_ERROR = 0.01  # of what is expected of the links, however exact they seem
LIKELY = 0.05  # mass of a payload over the robot's, to begin with [-]
REGRESSED = 20.0  # [1/s] of the low-passes, at most: it lets motions of joints through
BOTH_SETTLE = 1.5  # times as long as one low-pass: what is left of the past is (1 + 7.5) e^-7.5
REST = 0.1  # [rad/s, m/s] up to which a joint counts as at rest
NOTHING_LEFT = 1e-200  # square sum of a row that never moved
NEWTON_ROUNDS = 12  # of Gauss and Newton, each with weights from the last
EXACT = 1e-5  # of the rms of a row, below which no fit leaves anything; deviation of a mass that is known [-]


def fitted_blocks(
    record: Record, fit: tuple[float, float], most: int = MOST_FITTED, least: int = 0
) -> Iterator[tuple[Block, NDArray[np.bool_], NDArray[np.bool_]]]:
    """Yield blocks of a record, which of their intervals (m,) are for a fit, and which are for its test.

    A fit between two times after the start [s] is tested outside of them where nothing touches the robot, or a sensor
    says what does. A record of more than `most` intervals is thinned, to blocks of at least `least`.
    """
    tested = (-np.inf, np.inf) if fits_to_sensor(record.map) else record.map.use.free
    whole = [(first, last, True, True) for first, last in record.parts]
    if sum(last - first for first, last in record.parts) > most:
        whole = [(first, last, True, False) for first, last in record.spread(most, *fit, least=least)]
        whole += [(first, last, False, True) for first, last in record.spread(most, *(tested or ()), least=least)]
    for first, last, fits_here, tests_here in whole:
        block = record.block(first, last)
        when = block.time[:-1] - record.start
        inside = in_stretch(when, fit)
        yield block, inside & fits_here, ~inside & in_stretch(when, tested) & tests_here


def in_stretch(when: Array, stretch: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Return which times (m,) [s] are in a stretch; none if there is no stretch."""
    return np.zeros(len(when), bool) if stretch is None else (when >= stretch[0]) & (when < stretch[1])


def fits_to_sensor(chosen: Map) -> bool:
    """Return whether friction is fitted while something pushes, which a force sensor shows."""
    return chosen.joints.friction is not None and chosen.joints.friction.to is not None


def explained(record: Record, forces: KnownForces, block: Block) -> Array:
    """Return the generalised force (m, nv) of all known forces, and of a sensor that a fit knows."""
    given = sum(forces.known(block).values(), np.zeros_like(block.tau))
    return given + contact_torque(record, block) if fits_to_sensor(record.map) else given


def regression_gain(record: Record) -> float:
    """Return the gain [1/s] of both low-passes behind which rows are regressed."""
    return min(float(record.map.observer.gain), REGRESSED)


def rms_or_nan(values: Array) -> float:
    """Return the root mean square of values (m,); NaN if there are none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


@dataclass(frozen=True)
class Regression:
    """Products of the columns of n rows, summed over blocks: errors of links, payload, need, friction, effort."""

    products: Array  # (blocks, n, c, c)
    samples: int  # of all blocks together
    errors: int  # number of columns for errors of the links, each expected to be about 1
    friction: int  # number of columns of friction
    changes: bool  # whether friction is known, and these columns are what is expected to change
    payload: pin.SE3 | None  # placement of the payload's frame in its joint; None if there is no payload to fit

    def solve(
        self, precision: Array, mass: float | None = None, heavy: float = 1.0, *, learn: bool = False
    ) -> tuple[Array, Array]:
        """Return factors g (n), errors of links (p), friction (n q), the payload (10), see `carried`; covariance.

        Args:
            precision: (n + p, n + p) inverse covariance of g about 1 and of the errors of links about 0.
            mass: of the payload, if it is known [kg].
            heavy: mass [kg] that is expected of the payload else, at 1 m of its joint.
            learn: whether errors of links are taken as large as the rows show them, if that is less than expected. The
                values are then more exact than the covariance says, which holds for errors as large as expected.
        """
        n, p = len(precision) - self.errors, self.errors
        x = np.concatenate([np.ones(n), np.zeros(p + n * self.friction)])
        prior = np.zeros(2 * [len(x)])
        prior[: n + p, : n + p] = precision
        prior[range(n + p, len(x)), range(n + p, len(x))] = float(self.changes)
        if self.payload is not None:
            likely = mass or LIKELY * heavy
            x = np.concatenate([x, likely * np.array([1.0, *self.payload.translation]), np.zeros(6)])
            expected = [heavy if mass is None else EXACT * mass, *3 * [heavy], *6 * [likely * GYRATION**2]]
            prior = np.pad(prior, (0, len(expected)))
            prior[-len(expected) :, -len(expected) :] = np.diag(1.0 / np.square(expected))
        start, links = x.copy(), np.arange(n, n + p)
        for _ in range(NEWTON_ROUNDS):
            x, stated = self._step(x, start, prior)
        size, covariance = 1.0, stated
        for _ in range(NEWTON_ROUNDS if learn else 0):
            shown = p - float(np.sum(np.diag(covariance)[links])) / size**2
            size = float(np.clip(np.sqrt(x[links] @ x[links] / max(shown, 1.0)), LEAST_ERROR, 1.0))
            prior[links, links] = 1.0 / size**2
            x, covariance = self._step(x, start, prior)
        return x, stated

    def _step(self, x: Array, start: Array, prior: Array) -> tuple[Array, Array]:
        """Return better unknowns, from what they were and what is expected of them, and their covariance."""
        whole = self.products.sum(axis=0)
        normal, slope = prior.copy(), prior @ (start - x)
        for k in range(self.products.shape[1]):
            J, residual = self._row(x, k)
            weight = 1.0 / self._variance(x, k)
            normal += weight * J.T @ whole[k] @ J
            slope += weight * J.T @ whole[k] @ residual
        size = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
        inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-13, hermitian=True) / np.outer(size, size)
        return x + inverse @ slope, inverse

    def rms(self, x: Array) -> float:
        """Return the rms of what is left of all rows."""
        n = self.products.shape[1]
        residuals = [self._row(x, k)[1] for k in range(n)]
        total = sum(float(np.sum(residual @ self.products[:, k] @ residual)) for k, residual in enumerate(residuals))
        return float(np.sqrt(total / (n * self.samples))) if self.samples else float("nan")

    def needed(self, k: int) -> float:
        """Return the rms of what the motion needs in a row, less what is given [N, N m]."""
        at = self.errors + 10 * (self.payload is not None)
        return float(np.sqrt(self.products[:, k, at, at].sum() / self.samples))

    def _row(self, x: Array, k: int) -> tuple[Array, Array]:
        """Return the derivatives (c, unknowns) of row k's model as combinations of its columns, and what is left."""
        n, p, q = self.products.shape[1], self.errors, self.friction
        c = self.products.shape[2]
        at = c - q - 2  # of the need
        friction, links = slice(n + p + k * q, n + p + (k + 1) * q), slice(n, n + p)
        J, torque = np.zeros((c, len(x))), np.zeros(c)
        torque[:p], torque[at] = x[links], 1.0
        J[:p, links] = x[k] * np.eye(p)
        if self.payload is not None:
            torque[p : p + 10], slopes = carried(x[-10:])
            J[p : p + 10, -10:] = x[k] * slopes
        J[:, k] = torque
        J[at + 1 : at + 1 + q, friction] = np.eye(q)
        residual = -x[k] * torque
        residual[at + 1 : at + 1 + q], residual[-1] = -x[friction], 1.0
        return J, residual

    def _variance(self, x: Array, k: int) -> float:
        """Return the variance of what is left of row k, times the samples that are worth one."""
        (J, residual), products = self._row(x, k), self.products[:, k]
        whole, blocks, q = products.sum(axis=0), len(products), self.friction
        variance = max(float(residual @ whole @ residual), EXACT**2 * float(whole[-1, -1]), NOTHING_LEFT)
        variance /= self.samples
        n = self.products.shape[1]
        columns = J[:, [k, *range(n + self.errors + k * q, n + self.errors + (k + 1) * q)]]
        sums = products @ residual @ columns  # (blocks, 1 + q)
        power = columns.T @ whole @ columns
        inverse = np.linalg.pinv(power, hermitian=True)
        rank = max(round(float(np.trace(inverse @ power))), 1)
        repeats = float(np.einsum("bi,ij,bj->", sums, inverse, sums)) / (rank * variance)
        return variance * max(1.0, repeats * blocks / max(blocks - 1, 1))


def carried(payload: Array) -> tuple[Array, Array]:
    """Return the parameters (10,) of a body as Pinocchio orders them, and their derivatives (10, 10).

    `payload` has, in the joint's axes, mass, three first moments, and six moments of inertia about its centre.
    """
    steps = 1e-5 * max(float(np.max(np.abs(payload))), 1e-9) * np.eye(10)

    def of(values: Array) -> Array:
        point, h = max(values[0], 0.01 * abs(payload[0]), 1e-9), values[1:4]  # a mass below zero on the way is harmless
        about = (h @ h * np.eye(3) - np.outer(h, h)) / point
        return np.concatenate([values[:4], values[4:] + about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])

    slopes = [(of(payload + step) - of(payload - step)) / (2.0 * step.sum()) for step in steps]
    return of(payload), np.column_stack(slopes)


def friction_columns(law: str, v: Array, a: Array, rate: float) -> Array:
    """Return what friction of a law can be in a row with rates and accelerations (m,): (m, coefficients)."""
    inertia = [-a] if law.endswith("inertia") else []
    return np.column_stack([-np.tanh(v / rate), -v, *inertia, -np.ones(len(v))])


def link_errors(model: pin.Model) -> Array:
    """Return what expected errors of each link's mass, centre and inertia change in its parameters: (links, 10, 10)."""
    links = model.inertias.tolist()[1:]
    table = np.zeros((len(links), 10, 10))
    for k, link in enumerate(links):
        shifts = CENTRE_ERROR * np.eye(3)
        ends = [[pin.Inertia(link.mass, link.lever + side * dx, link.inertia) for side in (1, -1)] for dx in shifts]
        centres = [0.5 * (plus.toDynamicParameters() - minus.toDynamicParameters()) for plus, minus in ends]
        table[k, :, :4] = np.column_stack([MASS_ERROR * link.toDynamicParameters(), *centres])
        table[k, 4:, 4:] = link.mass * GYRATION**2 * np.eye(6)
    return table


def regression(
    forces: KnownForces,
    rows: Sequence[int],
    fit: tuple[float, float],
    rate: float = SMOOTH_RATE,
    frame: str | None = None,
) -> tuple[Regression, Regression]:
    """Return the products of the columns of rows (indices of v) over the stretch of a fit, and over what tests it.

    `fit` is from and to [s] after the start, `rate` that at which Coulomb friction sets in, and `frame` that to which a
    payload is fastened that is sought.
    """
    from scipy.linalg import block_diag  # slow to import

    record, model = forces.record, forces.record.robot.model
    section, data = record.map.joints.friction, model.createData()
    errors = block_diag(*link_errors(record.robot.stated_model))
    body = None if frame is None else model.frames[frame_id(model, frame)]
    carrier = slice(0, 0) if body is None else slice(10 * body.parentJoint - 10, 10 * body.parentJoint)
    driven = {record.robot.v_index(joint) for joint in record.driven}
    known, law = dict[int, Array](), forces.values.friction
    if section is None and law is not None:
        sizes = np.column_stack([law.coulomb, law.viscous, law.coulomb])  # the offset changes as Coulomb's does
        known = {record.robot.v_index(joint): size for joint, size in zip(forces.values.joints, sizes, strict=True)}
    friction = 3 * bool(known) if section is None else 4  # rotors have inertia, whether or not the law has
    p, at = errors.shape[1], errors.shape[1] + carrier.stop - carrier.start
    width, gain = at + friction + 2, regression_gain(record)
    settling = round(BOTH_SETTLE * TIME_CONSTANTS_TO_SETTLE / gain * record.rate)
    begin = fit[0] + settling * record.dt
    length = min(LASTS, max((fit[1] - begin) / FEWEST_BLOCKS, record.dt))
    sums, counts = [defaultdict[int, Array | float](float) for _ in range(2)], [0, 0]
    for block, *chosen in fitted_blocks(record, fit, MOST_REGRESSED, 2 * settling):
        q, a, v = halfway(record, block), accelerations(block, record), 0.5 * (block.v[1:] + block.v[:-1])
        table = np.zeros((len(rows), len(a), width))
        for k in np.flatnonzero(chosen[0] | chosen[1]).tolist():
            Y = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k]).reshape(model.nv, -1)[rows]
            table[:, k, :p], table[:, k, p:at] = Y @ errors, Y[:, carrier]
        table[:, :, at] = (required_torque(record, block, a) - explained(record, forces, block))[:, rows].T
        table[:, :, -1] = forces.torque(block)[:, rows].T
        for k, row in enumerate(rows):
            if section is not None and row in driven:
                table[k, :, at + 1 : -1] = friction_columns("inertia", v[:, row], a[:, row], rate)
            elif row in known:
                columns = friction_columns("coulomb", v[:, row], a[:, row], rate)
                table[k, :, at + 1 : -1] = FRICTION_ERROR * known[row] * columns
            table[k] = twice_low_passed(table[k], -np.expm1(-gain * typical_step(block.time)))
            if row in driven:
                table[k] *= np.tanh(np.abs(v[:, [row]]) / REST)
        settled = _settled(chosen[0] | chosen[1], settling)
        number = ((block.time[:-1] - record.start - begin) // length).astype(int)
        for which, (summed, kept) in enumerate(zip(sums, (each & settled for each in chosen), strict=True)):
            counts[which] += int(kept.sum())
            for index in np.unique(number[kept]).tolist():
                part = table[:, kept & (number == index)]
                summed[index] += part.transpose(0, 2, 1) @ part
    none = np.zeros((0, len(rows), width, width))
    products = [np.array([*summed.values()]) if summed else none for summed in sums]
    placement = None if body is None else body.placement
    tail = (p, friction, bool(known), placement)
    return Regression(products[0], counts[0], *tail), Regression(products[1], counts[1], *tail)


def _settled(chosen: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Return which intervals (m,) end a run of more than `count` that are chosen, both low-passes having settled."""
    every = np.arange(len(chosen))
    return every - np.maximum.accumulate(np.where(chosen, -1, every)) > count
