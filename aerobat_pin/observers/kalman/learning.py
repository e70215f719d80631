"""The noise that the Kalman filter reckons with.

The record itself shows the noise of the sensors, the misfit of the model and the patterns of forces that leave no
trace; a gain can ask for a random walk; torques can be unknown; and forces can jump.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, add_product, add_row_product, copy_values, dot, factorise, inner, kernel
from aerobat_pin.observers.kalman.kalman_state import Filter, Step
from aerobat_pin.observers.kernels.observer_state import ObserverState
from aerobat_pin.observers.kernels.projection import power_unit, put_rows
from aerobat_pin.observers.rows import BASE_ROWS

MEMORY_TIME = 0.2  # [s]: time over which sensor noise and misfit are averaged: one wing beat at 5 Hz
MISFIT_LAG = 0.015  # [s]: two low-passes of this time keep most sensor noise out of the misfit
CORRELATION = 2.5  # [MISFIT_LAG]: integral of the squared correlation of white noise behind both low-passes
MISFIT_TIME = 0.01  # [s]: time over which an error of the model stays what it is
DIFFERENCES = 6  # order of those that show the sensor noise: it takes out any motion below a tenth of the rate
DIFFERENCE_GAIN = np.sqrt(924.0)  # deviation of a sixth difference of white noise: sum of squared binomials
ROOT_MEAN = 0.822179  # mean of the root of |x| for a standard normal x: 2^(1/4) Gamma(3/4) / sqrt(pi)
STATED_COUNT = 2  # so many sixth differences count as much as what is stated about the sensors
LEARNING = 2 * DIFFERENCES  # number of intervals until the sensor noise is known well enough to weigh the rows by it
LEAST_NOISE = 1.0e-3  # smallest share of the stated sensor noise, which keeps the covariances invertible
LEAST_INFORMATION = 1.0e-6  # share of the total information on all patterns of forces, added to every pattern
JUMPED = 5.0  # deviations of what one interval says of a component: beyond, it has jumped
HARDLY_SHOWN = 100.0  # times worse than the best a component is shown that leaves no trace of a jump ...
NO_TRACE = 1.0e-12  # ... as does one whose trace is so small a share of what is expected, in squares
SAME_SURPRISE = 1.0e-6  # share by which surprises of components may differ that explain the innovation equally well
UNKNOWN_TORQUE = 1.0e8  # variance of the impulse of an unknown torque, relative to that of all other noise


@inner
def learn_noise(
    values: Array, known: float, recent: float, stated: Array, differences: Array, roots: Array, sensed: Array
) -> None:
    """Update the noise `sensed` of quantities (n,): the smaller of what is stated and what the record shows.

    The running mean of the roots of the sixth differences is hardly moved by a blow, which a mean square would take for
    noise. The mean starts at what is stated, and moves away from it when there are seven values. `known` is the number
    of sixth differences with the next `values` (n,), `recent` the share of `MEMORY_TIME` that an interval forgets; the
    others are fields of `Filter`.
    """
    share = max(recent, 1.0 / (max(known, 1.0) + STATED_COUNT))
    for i in range(values.shape[0]):
        latest = values[i]
        for order in range(DIFFERENCES):
            before = differences[order, i]
            differences[order, i] = latest
            latest -= before
        if known > 0.0:
            roots[i] += share * (np.sqrt(abs(latest)) - roots[i])
            shown = roots[i] * roots[i] / (ROOT_MEAN * ROOT_MEAN * DIFFERENCE_GAIN)
            sensed[i] = min(max(shown, LEAST_NOISE * stated[i]), stated[i])


@inner
def learn_misfit(remainder: Array, redundant: int, share: float, recent: float, leak: float, filter_: Filter) -> None:
    """Update the running mean square of what no force explains from one interval's rows `remainder` (nv,).

    What noise of the sensors leaves, `leak` [N^2] of `leak_of_noise`, and one deviation of its mean are no misfit. An
    interval forgets `share` of a low-pass and `recent` of the mean.
    """
    slow = filter_.slow
    size = -leak * (1.0 + np.sqrt(CORRELATION * MISFIT_LAG / (MEMORY_TIME * max(redundant, 1))))
    for i in range(remainder.shape[0]):
        slow[0, i] += share * (remainder[i] - slow[0, i])
        slow[1, i] += share * (slow[0, i] - slow[1, i])
        size += slow[1, i] * slow[1, i]
    size /= max(redundant, 1)
    recent = max(recent, 1.0 / (filter_.intervals[0] + 1.0))
    filter_.disbelief[0] += recent * (size - filter_.disbelief[0])


@inner
def leak_of_noise(
    before: Array, after: Array, dt: float, share: float, observer: ObserverState, filter_: Filter
) -> float:
    """Return the mean square [N^2] that sensor noise leaves in the rows that no force explains, behind both low-passes.

    Noise n of a sample enters the rows of the interval before it as a n, a = N (M - D dt/2) / dt, and those of the next
    one as -b n, b = N (M + D dt/2) / dt, with N the projection of weighted rows onto what no force explains. White n of
    covariance diag(s^2) leaves |a s|^2 sum(h^2) - 2 (a s).(b s) sum(h h') + |b s|^2 sum(h^2), h the response of the
    low-passes, of which an interval forgets `share`, and h' the same one interval later. What noise of the known forces
    leaves is less than half of the least misfit, and counts as misfit.
    """
    c, nv, A = filter_.walk.shape[0], before.shape[1], observer.equations
    noise_rows, ended = filter_.noise_rows, filter_.ended
    span, columns, along, unit = filter_.span, filter_.columns, filter_.along, power_unit(observer, observer.velocity)
    # An orthonormal basis of what forces explain, with the Cholesky factor that `fit_forces` left.
    for a in range(c):
        copy_values(observer.span[a], span[a])
        add_row_product(span[a], A[a, :a], span[:a], -1.0)
        inverse = 1.0 / A[a, a]
        for i in range(nv):
            span[a, i] *= inverse
            columns[i, a] = span[a, i]
    # What noise of each velocity at the start and at the end makes of the rows, without what forces explain.
    top, noise = before.shape[0] - 2 * nv, filter_.sent
    for k in range(nv):
        size, half, start, end = filter_.sensed[k] / dt, 0.5 * filter_.sensed[k], noise[k], noise[nv + k]
        M, slope, next_M, next_slope = before[top + k], before[top + nv + k], after[top + k], after[top + nv + k]
        for i in range(nv):
            start[i] = size * M[i] + half * slope[i]
            end[i] = size * next_M[i] - half * next_slope[i]
    put_rows(observer, noise, observer.velocity, unit, noise_rows)
    along[:, :] = 0.0
    add_product(along, noise_rows, columns, 1.0)
    add_product(noise_rows, along, span, -1.0)
    # (a s - b s)^2 and (a s).(b s), a of the interval before, behind both low-passes.
    apart, together, first = 0.0, 0.0, filter_.intervals[0] == 0.0
    for k in range(nv):
        for s in range(nv):
            b, a = noise_rows[k, s], noise_rows[k, s] if first else ended[k, s]
            apart += (a - b) * (a - b)
            together += a * b
            ended[k, s] = noise_rows[nv + k, s]
    kept = 1.0 - (1.0 - share) ** 2
    power = share**4 / kept**3  # sum(h^2) is (2 - kept) power, sum(h^2) - sum(h h') is share^2 power
    return float(power * ((2.0 - kept) * apart + 2.0 * share * share * together))


@inner
def drop_unseen(step: Step, start: int, values: Array) -> None:
    """Take out of rows of values (n, ...) what leaves no trace: f <- (1 - N N^T) f for every block of c coefficients.

    The first of the coefficients is row `start`. Of a covariance, the rows of its transpose follow.
    """
    unseen, c = step.unseen, step.unseen.shape[0]
    kept = np.empty(c)
    for first in range(start, start + step.z.shape[0], c):
        for j in range(values.shape[1]):
            for a in range(c):
                kept[a] = values[first + a, j]
            for a in range(c):
                for b in range(c):
                    values[first + a, j] -= unseen[a, b] * kept[b]


@inner
def misfit_variance(filter_: Filter) -> float:
    """Return the variance [N^2] that errors of the model give to every weighted row.

    Until the sensor noise is known, the model is thought to be wrong by as much as the forces: no row then counts more
    than the others.
    """
    doubt: float = max(filter_.disbelief[0], filter_.doubtful[1] * filter_.doubtful[1])
    if filter_.intervals[0] < LEARNING:
        doubt = max(doubt, filter_.doubtful[0] * filter_.doubtful[0])
    return doubt


@kernel
def set_walk_by_gain(before: Array, after: Array, filter_: Filter, rows: Array) -> None:
    """Set the random walk from the gain, in proportion to (J R^-1 J^T)^-1.

    R is the covariance of the momentum noise of one sample, so (J R^-1 J^T)^-1 is the covariance with which one sample
    determines the components' impulses. With this walk, every pattern of forces rises equally fast in every
    configuration. The share `LEAST_INFORMATION` of the total information is added to each pattern, which keeps the
    inverse finite. `rows` (nv, ...) is scratch.
    """
    c, information, scale = filter_.walk.shape[0], filter_.information, filter_.scale
    nv, blurred = rows.shape[0], filter_.blurred
    sensed = rows[:, : nv + c]
    sensed[:, :] = 0.0
    add_product(sensed[:, :nv], blurred.T, blurred, 1.0)
    if filter_.hidden.shape[0] > 0:
        add_unknown_torques(before, after, 0.0, filter_, sensed)
    for a in range(c):
        start, end = before[3 + a], after[3 + a]
        for i in range(nv):
            sensed[i, nv + a] = 0.5 * scale[a] * (start[i] + end[i])
    factorise(sensed)
    information[:, :] = 0.0
    add_product(information[:, :c], sensed[:, nv:].T, sensed[:, nv:], 1.0)
    total = 0.0
    for a in range(c):
        total += information[a, a]
    for a in range(c):
        information[a, a] += LEAST_INFORMATION * total
        information[a, c + a] = 1.0
    factorise(information)
    filter_.walk[:, :] = 0.0
    add_product(filter_.walk, information[:, c:].T, information[:, c:], filter_.walk_gain[0])
    for a in range(c):
        for b in range(c):
            filter_.walk[a, b] *= scale[a] * scale[b]


@kernel
def add_unknown_torques(before: Array, after: Array, misfit: float, filter_: Filter, P: Array) -> None:
    """Add the covariance of unknown torques to P (nv, nv).

    The torques act along the generalised forces onto which `hidden` projects. If the joints' power is known, only
    torques that do not change this power are added. `misfit` is the sum of the variances that errors of the model give
    to these generalised forces.
    """
    hidden, noise, c = filter_.hidden, filter_.noise, filter_.walk.shape[0]
    nv, size, speed = noise.shape[0], 0.0, 0.0
    for k in range(nv):
        for i in range(nv):
            for j in range(nv):
                size += noise[k] * noise[k] * after[3 + c + k, i] * hidden[i, j] * after[3 + c + k, j]
    size = UNKNOWN_TORQUE * (size + misfit)
    for i in range(nv):
        for j in range(nv):
            P[i, j] += size * hidden[i, j]
    if filter_.power_known > 0:
        for i in range(BASE_ROWS, nv):
            mean = 0.5 * (before[2, i] + after[2, i])
            speed += mean * mean + 0.5 * filter_.sensed[i] * filter_.sensed[i]
        for i in range(BASE_ROWS, nv):
            along = 0.25 * size * (before[2, i] + after[2, i]) / speed
            for j in range(BASE_ROWS, nv):
                P[i, j] -= along * (before[2, j] + after[2, j])


@inner
def write_row_errors(before: Array, after: Array, filter_: Filter) -> None:
    """Write the standard deviation of each row's lasting error in an interval, see `Expected`."""
    first = filter_.errors.shape[0] - filter_.rows.shape[1]
    for k in range(filter_.rows.shape[1]):
        sliding = np.tanh(0.5 * (before[2, k] + after[2, k]) / filter_.rows[2, k])
        filter_.errors[first + k, k] = np.sqrt(filter_.rows[0, k] + filter_.rows[1, k] * (1.0 - sliding * sliding))


@inner
def most_surprising(w: Array, squares: Array, e: Array, variance: Array, least: float) -> tuple[int, float]:
    """Return the component that is most deviations beyond `JUMPED`, and the size of its jump; -1 if none is.

    Arguments are as in `let_jump`, with `squares` (c,) w.w of each component, times `variance` no less than `least`.
    """
    surprise, size, jumping, best = JUMPED * JUMPED, 0.0, -1, 0.0
    for a in range(w.shape[0]):
        along, square, shown = 0.0, squares[a], squares[a] * variance[a]
        for i in range(w.shape[1]):
            along += w[a, i] * e[i]
        if shown > least and along * along > JUMPED * JUMPED * square:
            more = along * along / square / surprise - 1.0
            if more > SAME_SURPRISE or (more > -SAME_SURPRISE and shown > best):
                surprise, size, jumping, best = along * along / square, along / square, a, shown
    return jumping, size


@kernel
def let_jump(P: Array, variance: Array, step: Step) -> None:
    """Let forces jump, the most surprising one first, until no component is beyond `JUMPED` deviations.

    With e the whitened innovation and w = L^-1 dt J_a^T, the trace of one component, the interval says that it jumped
    by (w.e) / (w.w), with deviation 1 / |w|. Its variance grows by that size squared. It says nothing of what it shows
    `HARDLY_SHOWN` times worse than another component, beside what is expected of both, of `variance` (nz,): any size
    would do. Of components that explain it equally well, the one that it shows best jumps.
    """
    rows, shear, nv, n, c = step.rows, step.shear, step.rows.shape[0], step.shear.shape[1], step.unseen.shape[0]
    whitening, e = rows[:, nv + n : 2 * nv + n], rows[:, nv + 2 * n]
    largest = 0.0
    for i in range(nv):
        largest += e[i] * e[i]
    if largest <= JUMPED * JUMPED:  # as is then every part of it
        return
    w, squares, least = np.empty((c, nv)), np.zeros(c), NO_TRACE
    for jumps in range(c):
        for a in range(c):
            squares[a] = 0.0
            for i in range(nv):
                w[a, i] = dot(whitening[i], shear[a, :nv])
                squares[a] += w[a, i] * w[a, i]
            if jumps == 0:
                least = max(least, HARDLY_SHOWN**-2.0 * squares[a] * variance[a])
        jumping, size = most_surprising(w, squares, e, variance, least)
        if jumping < 0:
            return
        P[nv + jumping, nv + jumping] += size * size
        for i in range(nv):
            rows[i, 2 * nv + jumping] += size * size * w[jumping, i]
            for j in range(nv):
                rows[i, j] = size * size * w[jumping, i] * w[jumping, j] + (1.0 if i == j else 0.0)
        factorise(rows)
