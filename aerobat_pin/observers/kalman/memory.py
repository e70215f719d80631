"""What a Kalman filter keeps between calls: the memory of its kernels."""

from __future__ import annotations

from typing import NamedTuple

from aerobat_pin.numerics import Array, Integers, merged, next_size, rewind, take
from aerobat_pin.observers.kernels.memory import ObserverMemory, observer_fields, observer_sizes


class Step(NamedTuple):
    """What one interval leaves behind for its smoothing. `blocks` is 1, or 3 with harmonics; h = blocks c.

    The zeros and the rounded width are there because a product of whole vectors costs less than one of parts.

    Attributes:
        shear: (nz, n) dt G, then zeros.
        decay: (nz,) a.
        e: (nv,) the innovation.
        rows: (nv, width) S (nv, nv), P_p and [1, 0] (nv, n), and e; after the update, with S = L L^T, L^-1 times all
            that: L^T, T, L^-1, and e whitened.
        basis: (blocks,) weight of each block of c coefficients in the forces.
        z: (h,) these blocks' part of x after the update.
        Z: (h, n) theirs of P.
    """

    shear: Array
    decay: Array
    e: Array
    rows: Array
    basis: Array
    z: Array
    Z: Array


class Filter(NamedTuple):
    """What a Kalman filter keeps between calls; nz coefficients beside nv momenta make n states.

    Attributes:
        mass_in_doubt: whether the last coefficient is an error of the mass.
        power_known: whether the joints' power is known where their torques are not.
        walk_gain: (1,) factor of a walk that a gain sets, 0 for a walk that is given.
        head_start: (1,) by how much the walk leads at the first interval [s].
        pulsation: (1,) of the harmonics [rad/s], 0 for none.
        misfit: (1,) [sqrt(s)].
        elapsed: (1,) time since the start [s].
        noise: (nv,) standard deviations of the sensors.
        rate: (nz,) of coefficients that decay [1/s], 0 for those that walk.
        variance: (nz,) of coefficients that decay.
        walk: (c, c) covariance that the components gain in a second.
        scale: (c,) as in `Applications.scale`.
        information: (c, 2 c) scratch.
        hidden: (nv, nv) projector on generalised forces of which nothing is known, or empty.
        errors: (ne, nv) known forces whose size is in doubt, in this interval.
        doubt: (nv,) running mean square of what may be wrong with them.
        x: (n,) the estimate.
        P: (n, n) its covariance.
        samples: (2, 3 + c + nv, nv) as in `kernels.residual`, followed by B^T.
    """

    mass_in_doubt: int
    power_known: int
    walk_gain: Array
    head_start: Array
    pulsation: Array
    misfit: Array
    elapsed: Array
    noise: Array
    rate: Array
    variance: Array
    walk: Array
    scale: Array
    information: Array
    hidden: Array
    errors: Array
    doubt: Array
    x: Array
    P: Array
    samples: Array


class KalmanMemory(NamedTuple):
    """A Kalman filter's memory: what every observer keeps, what a filter keeps, and its latest step."""

    observer: ObserverMemory
    filter: Filter
    step: Step


@merged
def step_fields(cursor: Integers, nv: int, nz: int, c: int, blocks: int) -> Step:
    """Lay out a step's fields."""
    n, h = nv + nz, blocks * c
    width = (nv + 2 * n + 8) // 8 * 8  # rounded up to what a processor's vectors hold
    return Step(
        shear=take(cursor, (nz, n)),
        decay=take(cursor, (nz,)),
        e=take(cursor, (nv,)),
        rows=take(cursor, (nv, width)),
        basis=take(cursor, (blocks,)),
        z=take(cursor, (h,)),
        Z=take(cursor, (h, n)),
    )


@merged
def step_in(memory: Array, latest: Step) -> Step:
    """Lay out one of a record's steps, as long as the latest one, behind a cursor."""
    (nz, n), blocks = latest.shear.shape, latest.basis.shape[0]
    return step_fields(rewind(memory), n - nz, nz, latest.z.shape[0] // blocks, blocks)


def step_size(latest: Step) -> int:
    """Return the number of doubles of one of a record's steps."""
    return 1 + sum(field.size for field in latest)


@merged
def kalman_in(memory: Array) -> KalmanMemory:
    """Lay out a Kalman filter's memory: behind an observer's sizes 1 or 3 blocks, ne, nv or 0 hidden rows, choices."""
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
            noise=take(cursor, (nv,)),
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
            samples=take(cursor, (2, 3 + c + nv, nv)),
        ),
        step=step_fields(cursor, nv, nz, c, blocks),
    )
