"""State of the Kalman filter's kernels: the data that the filter keeps between calls."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from aerobat_pin.numerics import Array, Integers, directory_size, new_state
from aerobat_pin.observers.kernels.observer_state import ObserverState


class Step(NamedTuple):
    """Data of one interval that the smoother needs later; symbols as in `kernels`.

    There are nv velocities, c components in a number of blocks, and nz coefficients. Arrays are padded with zeros and
    widths rounded up to eight doubles, because products of whole processor vectors are faster. `rows` are S,
    [-B diag(s), X_pz], [1, 0], e; after the update, times L^-1: L^T, U, [L^-1, 0], L^-1 e, with S = L L^T.
    """

    shear: Annotated[Array, "nz, nv + nz"]  # dt G, padded with zero columns
    onward: Annotated[Array, "nv, nv"]  # A^T: the momentum at the end that an error of the velocity at the start makes
    decay: Annotated[Array, "nz"]  # a, decay factor of each coefficient
    e: Annotated[Array, "nv"]  # the innovation
    rows: Annotated[Array, "nv, (nv + 2 * (nv + nz) + 8) // 8 * 8"]  # see above
    basis: Annotated[Array, "blocks"]  # weight of each block of c coefficients in the forces
    z: Annotated[Array, "blocks * c"]  # coefficients of the forces in x after the update
    Z: Annotated[Array, "blocks * c, nv + nz"]  # rows of P for these coefficients after the update
    blind: Annotated[Array, "1"]  # number of patterns of forces that left no trace
    unseen: Annotated[Array, "c, c"]  # projector onto these patterns; valid if `blind` is not zero


class Filter(NamedTuple):
    """Data that a Kalman filter keeps between calls.

    There are ne known forces with an uncertain factor and lasting errors of rows, nr (nv or none) of the latter, and nh
    rows of `hidden`, nv or none; the other sizes are those of `Step`.
    """

    mass_in_doubt: int  # whether the last coefficient is an error of the mass
    power_known: int  # whether the joints' total power is known although their torques are not
    walk_gain: Annotated[Array, "1"]  # factor of the random walk if the gain sets it, 0 if the walk is given
    head_start: Annotated[Array, "1"]  # extra time of random walk added in the first interval [s]
    pulsation: Annotated[Array, "1"]  # pulsation of the harmonics [rad/s], 0 for none
    misfit: Annotated[Array, "1"]  # the setting `misfit` of `KalmanObserver` [sqrt(s)]
    elapsed: Annotated[Array, "1"]  # time since the start [s]
    intervals: Annotated[Array, "1"]  # number of intervals since the start
    doubtful: Annotated[Array, "2"]  # deviation of the forces at the start, least misfit of the model [N]
    disbelief: Annotated[Array, "1"]  # running mean square of what no force explains, per redundant row [N^2]
    noise: Annotated[Array, "nv"]  # standard deviations of the sensor noise as stated
    sensed: Annotated[Array, "nv"]  # the same as the record shows it, at most as stated
    roots: Annotated[Array, "nv"]  # running mean of the roots of the sixth differences of the velocities
    differences: Annotated[Array, "6, nv"]  # velocity, first, ..., fifth difference at the latest sample
    known_noise: Annotated[Array, "nv"]  # largest deviations of the known force's noise, interval means
    known_sensed: Annotated[Array, "nv"]  # the same as the record shows it
    known_roots: Annotated[Array, "nv"]  # as `roots`
    known_differences: Annotated[Array, "6, nv"]  # as `differences`
    slow: Annotated[Array, "2, nv"]  # the weighted rows that no force explains, low-passed once and twice
    rate: Annotated[Array, "nz"]  # decay rate of each coefficient [1/s], 0 for a random walk
    variance: Annotated[Array, "nz"]  # stationary variance of coefficients that decay
    walk: Annotated[Array, "c, c"]  # covariance added to the components per second of random walk
    scale: Annotated[Array, "c"]  # as `Applications.scale`
    information: Annotated[Array, "c, 2 * c"]  # scratch
    hidden: Annotated[Array, "nh, nh"]  # projector onto generalised forces that do not change the rows in use, or empty
    errors: Annotated[Array, "ne, nv"]  # known forces of uncertain factor, then row errors, in the current interval
    rows: Annotated[Array, "3, nr"]  # of row errors: variance in motion, what stiction adds, rate at which that fades
    doubt: Annotated[Array, "nv"]  # running mean square of the possible errors of known forces and mass, for each row
    x: Annotated[Array, "nv + nz"]  # estimate of the state
    P: Annotated[Array, "nv + nz, nv + nz"]  # covariance of the estimate
    samples: Annotated[Array, "2, 3 + c + 2 * nv, nv"]  # the two latest, see `noisy_sample`
    inertias: Annotated[Integers, "1"]  # address of the subtrees' inertias, see `noisy_sample.inertias_at`
    tree: Annotated[Integers, "nv, nv + 1"]  # see `noisy_sample.kinship_of`
    gravity: Annotated[Array, "6"]  # acceleration of gravity (6,), linear and angular, world axes
    twist: Annotated[Array, "6"]  # scratch, like all fields below but `blurred`
    subtree: Annotated[Array, "6"]
    carried: Annotated[Array, "6, nv"]
    pushes: Annotated[Array, "6, nv"]
    turns: Annotated[Array, "6, nv"]
    across: Annotated[Array, "nv, nv"]
    right: Annotated[Array, "nv, nv + nz"]  # scratch: covariance of the right side of an interval's equation
    blurred: Annotated[Array, "nv, nv"]  # B^T, see `kernels`
    phi: Annotated[Array, "nv"]
    span: Annotated[Array, "c, nv"]  # scratch: orthonormal basis of the weighted rows that forces explain
    columns: Annotated[Array, "nv, c"]  # scratch: the same, transposed
    sent: Annotated[Array, "2 * nv, nv"]  # scratch: generalised forces that noise of the two samples' velocities makes
    noise_rows: Annotated[Array, "2 * nv, nv"]  # scratch: their weighted rows in use
    along: Annotated[Array, "2 * nv, c"]  # scratch: the part of it that forces explain
    ended: Annotated[Array, "nv, nv"]  # what no force explains of the rows made by the latest sample's noise


class KalmanState(NamedTuple):
    """State of a Kalman filter: the data of every observer, the data of the filter, and its latest step."""

    observer: ObserverState
    filter: Filter
    step: Step


def new_steps(count: int, **sizes: int) -> Array:
    """Return states (count, size) of `Step`, one for each interval of a record."""
    first = new_state(Step, **sizes)
    steps = np.empty((count, len(first)))
    steps[:, : directory_size(Step)] = first[: directory_size(Step)]
    return steps
