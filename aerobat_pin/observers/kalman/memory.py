"""Memory of the Kalman filter's kernels: the data that the filter keeps between calls."""

from __future__ import annotations

from typing import NamedTuple

from aerobat_pin.numerics import Array, Integers, merged, next_size, rewind, take, take_integers
from aerobat_pin.observers.kernels.memory import ObserverMemory, observer_fields, observer_sizes


class Step(NamedTuple):
    """Data of one interval that the smoother needs later; shapes are in `step_fields`, symbols in `kernels`.

    Arrays are padded with zeros and widths rounded up because products of whole processor vectors are faster.
    """

    shear: Array  # dt G, padded with zero columns
    onward: Array  # A^T: what an error of the velocity at the start is at the end, as a momentum, see `kernels`
    decay: Array  # a, decay factor of each coefficient
    e: Array  # the innovation
    rows: Array  # S, [-B diag(s), X_pz], [1, 0], e; after the update times L^-1: L^T, U, [L^-1, 0], L^-1 e (S = L L^T)
    basis: Array  # weight of each block of c coefficients in the forces
    z: Array  # coefficients of the forces in x after the update
    Z: Array  # rows of P for these coefficients after the update
    blind: Array  # number of patterns of forces that left no trace
    unseen: Array  # projector onto these patterns; valid if `blind` is not zero


class Filter(NamedTuple):
    """Data that a Kalman filter keeps between calls; shapes are in `kalman_in`."""

    mass_in_doubt: int  # whether the last coefficient is an error of the mass
    power_known: int  # whether the joints' total power is known although their torques are not
    walk_gain: Array  # factor of the random walk if the gain sets it, 0 if the walk is given
    head_start: Array  # extra time of random walk added in the first interval [s]
    pulsation: Array  # pulsation of the harmonics [rad/s], 0 for none
    misfit: Array  # the setting `misfit` of `KalmanObserver` [sqrt(s)]
    elapsed: Array  # time since the start [s]
    intervals: Array  # number of intervals since the start
    doubtful: Array  # standard deviation of the forces at the start, and the least misfit of the model [N]
    disbelief: Array  # running mean square of what no force explains, per redundant row [N^2]
    noise: Array  # standard deviations of the sensor noise as stated
    sensed: Array  # the same as the record shows it, at most as stated
    roots: Array  # running mean of the roots of the sixth differences of the velocities
    differences: Array  # velocity, first, ..., fifth difference at the latest sample
    known_noise: Array  # noise of the known generalised force, largest standard deviations of an interval mean
    known_sensed: Array  # the same as the record shows it
    known_roots: Array  # as `roots`
    known_differences: Array  # as `differences`
    slow: Array  # the weighted rows that no force explains, low-passed once and twice
    rate: Array  # decay rate of each coefficient [1/s], 0 for a random walk
    variance: Array  # stationary variance of coefficients that decay
    walk: Array  # covariance added to the components per second of random walk
    scale: Array  # as `Applications.scale`
    information: Array  # scratch
    hidden: Array  # projector onto generalised forces that do not change the rows in use, or empty
    errors: Array  # known forces with an uncertain factor, in the current interval
    doubt: Array  # running mean square of the possible errors of known forces and mass, for each row
    x: Array  # estimate of the state
    P: Array  # covariance of the estimate
    samples: Array  # the two latest samples as in `kernels.residual`, each followed by M and D^T
    inertias: Integers  # address of the subtrees' inertias, see `subtrees.inertias_at`
    tree: Integers  # see `subtrees.kinship_of`
    gravity: Array  # acceleration of gravity (6,), linear and angular, world axes
    twist: Array  # scratch, like all fields below but `blurred`
    subtree: Array
    carried: Array
    pushes: Array
    turns: Array
    across: Array
    right: Array  # scratch: covariance of the right side of an interval's equation, as it is made
    blurred: Array  # B^T, see `kernels`
    phi: Array
    seen: Array
    span: Array  # scratch: orthonormal basis of the weighted rows that forces explain
    columns: Array  # scratch: the same, transposed
    sent: Array  # scratch: generalised forces that noise of the two samples' velocities makes
    made: Array  # scratch: their weighted rows in use
    along: Array  # scratch: the part of it that forces explain
    ended: Array  # what no force explains of the rows made by the latest sample's noise


class KalmanMemory(NamedTuple):
    """Memory of a Kalman filter: the data of every observer, the data of the filter, and its latest step."""

    observer: ObserverMemory
    filter: Filter
    step: Step


@merged
def step_fields(cursor: Integers, nv: int, nz: int, c: int, blocks: int) -> Step:
    """Lay out the fields of a step."""
    n, h = nv + nz, blocks * c
    width = (nv + 2 * n + 8) // 8 * 8  # rounded up to a multiple of 8 doubles, the size of a processor's vectors
    return Step(
        shear=take(cursor, (nz, n)),
        onward=take(cursor, (nv, nv)),
        decay=take(cursor, (nz,)),
        e=take(cursor, (nv,)),
        rows=take(cursor, (nv, width)),
        basis=take(cursor, (blocks,)),
        z=take(cursor, (h,)),
        Z=take(cursor, (h, n)),
        blind=take(cursor, (1,)),
        unseen=take(cursor, (c, c)),
    )


@merged
def step_in(memory: Array, latest: Step) -> Step:
    """Lay out one step of a record, with the same shapes as the latest step, after a cursor."""
    (nz, n), blocks = latest.shear.shape, latest.basis.shape[0]
    return step_fields(rewind(memory), n - nz, nz, latest.z.shape[0] // blocks, blocks)


def step_size(latest: Step) -> int:
    """Return the number of doubles that one step of a record takes."""
    return 1 + sum(field.size for field in latest)


@merged
def kalman_in(memory: Array) -> KalmanMemory:
    """Lay out the memory of a Kalman filter.

    Sizes, after those of an observer: number of blocks (1, or 3 with harmonics), number ne of known forces with an
    uncertain factor, number of rows of `hidden` (nv or 0), `mass_in_doubt`, `power_known`.
    """
    cursor = rewind(memory)
    sizes = observer_sizes(cursor)
    blocks, ne, hidden = next_size(cursor), next_size(cursor), next_size(cursor)
    mass_in_doubt, power_known = next_size(cursor), next_size(cursor)
    nv, c = sizes.nv, sizes.components
    nz = blocks * c + ne + mass_in_doubt
    return KalmanMemory(
        observer=observer_fields(cursor, sizes),
        filter=Filter(
            mass_in_doubt=mass_in_doubt,
            power_known=power_known,
            walk_gain=take(cursor, (1,)),
            head_start=take(cursor, (1,)),
            pulsation=take(cursor, (1,)),
            misfit=take(cursor, (1,)),
            elapsed=take(cursor, (1,)),
            intervals=take(cursor, (1,)),
            doubtful=take(cursor, (2,)),
            disbelief=take(cursor, (1,)),
            noise=take(cursor, (nv,)),
            sensed=take(cursor, (nv,)),
            roots=take(cursor, (nv,)),
            differences=take(cursor, (6, nv)),
            known_noise=take(cursor, (nv,)),
            known_sensed=take(cursor, (nv,)),
            known_roots=take(cursor, (nv,)),
            known_differences=take(cursor, (6, nv)),
            slow=take(cursor, (2, nv)),
            rate=take(cursor, (nz,)),
            variance=take(cursor, (nz,)),
            walk=take(cursor, (c, c)),
            scale=take(cursor, (c,)),
            information=take(cursor, (c, 2 * c)),
            hidden=take(cursor, (hidden, hidden)),
            errors=take(cursor, (ne, nv)),
            doubt=take(cursor, (nv,)),
            x=take(cursor, (nv + nz,)),
            P=take(cursor, (nv + nz, nv + nz)),
            samples=take(cursor, (2, 3 + c + 2 * nv, nv)),
            inertias=take_integers(cursor, (1,)),
            tree=take_integers(cursor, (nv, nv + 1)),
            gravity=take(cursor, (6,)),
            twist=take(cursor, (6,)),
            subtree=take(cursor, (6,)),
            carried=take(cursor, (6, nv)),
            pushes=take(cursor, (6, nv)),
            turns=take(cursor, (6, nv)),
            across=take(cursor, (nv, nv)),
            right=take(cursor, (nv, nv + nz)),
            blurred=take(cursor, (nv, nv)),
            phi=take(cursor, (nv,)),
            seen=take(cursor, (c, nv + nz)),
            span=take(cursor, (c, nv)),
            columns=take(cursor, (nv, c)),
            sent=take(cursor, (2 * nv, nv)),
            made=take(cursor, (2 * nv, nv)),
            along=take(cursor, (2 * nv, c)),
            ended=take(cursor, (nv, nv)),
        ),
        step=step_fields(cursor, nv, nz, c, blocks),
    )
