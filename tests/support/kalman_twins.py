"""Textbook Kalman filter and Rauch-Tung-Striebel smoother in dense numpy, for the Kalman observers' kernels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from support.observer_twins import remembered

Vector = NDArray[np.float64]


@dataclass
class KalmanTwin:
    """x = (p, z): z <- A z + w, p <- p + dt (u + drift) + dt G^T z, with G the forces' Jacobian and the errors' rows.

    Attributes mean what the observer's keywords do; `sensors` (nv,) are standard deviations.
    """

    model: pin.Model
    frames: Sequence[str]
    sensors: Vector
    force_walk: float
    prior: float
    known_error: Mapping[str, float] = field(default_factory=dict)
    mass_error: float = 0.0
    error_time: float = 1.0
    misfit: float = 0.01
    frequency: float | None = None

    def run(
        self, time: Vector, q: Vector, v: Vector, tau: Vector, known: Mapping[str, Vector], smooth: bool
    ) -> tuple[Vector, Vector]:
        """Return components and standard deviations (m, c)."""
        nv, c = self.model.nv, 3 * len(self.frames)
        spread = [*self.known_error.values(), *([self.mass_error] if self.mass_error else [])]
        blocks = 1 if self.frequency is None else 3
        h, nz = blocks * c, blocks * c + len(spread)
        samples = [remembered(self.model, self.frames, *one) for one in zip(q, v, strict=True)]
        covariances = []
        for one in q:
            B = pin.crba(self.model, self.model.createData(), one) * self.sensors
            covariances.append(B @ B.T)
        x = np.concatenate([samples[0][0], np.zeros(nz)])
        P = np.zeros((nv + nz, nv + nz))
        P[:nv, :nv] = covariances[0]
        P[nv:, nv:] = np.diag([*np.full(h, self.prior**2), *np.square(spread)])
        H, doubt, first = np.eye(nv, nv + nz), np.zeros(nv), True
        track: list[tuple[Vector, ...] | None] = []
        for k, torque in enumerate(tau):
            dt = time[k + 1] - time[k]
            if dt == 0.0:
                samples[k + 1] = samples[k]
                track.append(None)
                continue
            mean = 0.5 * (samples[k] + samples[k + 1])
            angle = 2.0 * np.pi * (self.frequency or 0.0) * (0.5 * (time[k] + time[k + 1]) - time[0])
            basis = np.kron([1.0, np.cos(angle), np.sin(angle)][:blocks], np.eye(c))
            u = torque + sum((values[k] for values in known.values()), np.zeros(nv))
            a = np.exp(-dt / self.error_time)
            A = np.diag([*np.ones(h), *np.full(len(spread), a)])
            W = np.diag([*np.full(h, self.force_walk**2 * dt), *((1.0 - a * a) * np.square(spread))])
            G = np.zeros((nz, nv))
            G[:h] = basis.T @ mean[3:]
            for i, name in enumerate(self.known_error):
                G[h + i] = known[name][k]
            if self.mass_error:
                G[-1] = u + G[:h].T @ x[nv : nv + h]
            F = np.block([[np.eye(nv), dt * G.T @ A], [np.zeros((nz, nv)), A]])
            noise = np.vstack([dt * G.T, np.eye(nz)])
            square = np.sum((np.array(spread)[:, None] * G[h:]) ** 2, axis=0) if spread else np.zeros(nv)
            doubt = square if first else square + a * (doubt - square)
            first = False
            Q = noise @ W @ noise.T
            Q[:nv, :nv] += np.diag(self.misfit**2 * dt * doubt)
            ahead = F @ x + np.concatenate([dt * (u + mean[1]), np.zeros(nz)])
            P_ahead = F @ P @ F.T + Q
            R = covariances[k + 1]
            K = np.linalg.solve(H @ P_ahead @ H.T + R, H @ P_ahead).T
            x = ahead + K @ (samples[k + 1][0] - H @ ahead)
            P = (np.eye(nv + nz) - K @ H) @ P_ahead @ (np.eye(nv + nz) - K @ H).T + K @ R @ K.T  # Joseph
            track.append((F, ahead, P_ahead, x, P, basis))
        found, sure, later = [], [], None
        for step in reversed(track) if smooth else track:
            if step is None:
                found.append(None)
                sure.append(None)
                continue
            F, ahead, P_ahead, x, P, basis = step
            if smooth and later is not None:
                after, P_after, next_F, next_ahead, next_P_ahead = later
                C = np.linalg.solve(next_P_ahead, next_F @ P).T
                x, P = x + C @ (after - next_ahead), P + C @ (P_after - next_P_ahead) @ C.T
            later = x, P, F, ahead, P_ahead
            found.append(basis @ x[nv : nv + h])
            sure.append(np.sqrt(np.diag(basis @ P[nv : nv + h, nv : nv + h] @ basis.T)))
        if smooth:
            found, sure = found[::-1], sure[::-1]
        for k, one in enumerate(found):
            if one is None:
                found[k], sure[k] = found[k - 1], sure[k - 1]
        return np.array(found), np.array(sure)
