"""What a Kalman filter keeps between calls: the memory of its kernels."""

from __future__ import annotations

from typing import NamedTuple

from aerobat_pin.numerics import Array, Integers, merged, next_size, rewind, take
from aerobat_pin.observers.kernels.memory import ObserverMemory, observer_fields, observer_sizes


class Step(NamedTuple):
    """What one interval leaves behind for its smoothing; `step_fields` says the shapes, `kernels` the symbols.

    The zeros and the rounded width are there because a product of whole vectors costs less than one of parts.
    """

    shear: Array  # dt G, then zeros
    decay: Array  # a
    e: Array  # the innovation
    rows: Array  # S, P_p, [1, 0] and e; after the update, with S = L L^T, L^-1 times all that: L^T, T, L^-1, e whitened
    basis: Array  # weight of each block of c coefficients in the forces
    z: Array  # these blocks' part of x after the update
    Z: Array  # theirs of P


class Filter(NamedTuple):
    """What a Kalman filter keeps between calls; `kalman_in` says the shapes."""

    mass_in_doubt: int  # whether the last coefficient is an error of the mass
    power_known: int  # whether the joints' power is known where their torques are not
    walk_gain: Array  # factor of a walk that a gain sets, 0 for a walk that is given
    head_start: Array  # by how much the walk leads at the first interval [s]
    pulsation: Array  # of the harmonics [rad/s], 0 for none
    misfit: Array  # [sqrt(s)]
    elapsed: Array  # time since the start [s]
    noise: Array  # standard deviations of the sensors
    rate: Array  # of coefficients that decay [1/s], 0 for those that walk
    variance: Array  # of coefficients that decay
    walk: Array  # covariance that the components gain in a second
    scale: Array  # as `Applications.scale`
    information: Array  # scratch
    hidden: Array  # projector on generalised forces of which nothing is known, or empty
    errors: Array  # known forces whose size is in doubt, in this interval
    doubt: Array  # running mean square of what may be wrong with them
    x: Array  # the estimate
    P: Array  # its covariance
    samples: Array  # as in `kernels.residual`, followed by B^T


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
