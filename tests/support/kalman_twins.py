"""Textbook Kalman filter and Rauch-Tung-Striebel smoother in dense numpy; what they learn, from lists of samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from support.observer_twins import believed, project, remembered

Vector = NDArray[np.float64]


@dataclass
class KalmanTwin:
    """x = (p, z): z <- A (z + w), p <- p + dt (u + drift) + dt G^T z, G the forces' Jacobian and the errors' rows."""

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
    rows: str = "all"

    def run(
        self, time: Vector, q: Vector, v: Vector, tau: Vector, known: Mapping[str, Vector], smooth: bool
    ) -> tuple[Vector, Vector]:
        """Return components and standard deviations (m, c)."""
        nv, c = self.model.nv, 3 * len(self.frames)
        spread = [*self.known_error.values(), *([self.mass_error] if self.mass_error else [])]
        blocks = 1 if self.frequency is None else 3
        h, nz = blocks * c, blocks * c + len(spread)
        samples = [remembered(self.model, self.frames, *one) for one in zip(q, v, strict=True)]
        inertias = [pin.crba(self.model, self.model.createData(), one).copy() for one in q]
        slopes = [self.slope(*one) for one in zip(q, v, strict=True)]
        weight = 9.81 * pin.computeTotalMass(self.model)
        weights = np.diag(believed(self.model, "all", v[0]))
        x = np.concatenate([samples[0][0], np.zeros(nz)])
        P = np.zeros((nv + nz, nv + nz))
        P[:nv, :nv] = inertias[0] @ np.diag(self.sensors**2) @ inertias[0]
        P[nv:, nv:] = np.diag([*np.full(h, self.prior**2), *np.square(spread)])
        H, doubt, first = np.eye(nv, nv + nz), np.zeros(nv), True
        speeds, rests, misfit, count = [v[0]], [np.zeros((2, nv))], 0.0, 0
        ended: Vector | None = None
        roots = 0.822179 * np.sqrt(np.sqrt(924.0) * self.sensors)
        pushes, told = [], 0.02 * weight / weights
        told_roots = 0.822179 * np.sqrt(np.sqrt(924.0) * told)
        track: list[tuple[Vector, ...] | None] = []
        for k, torque in enumerate(tau):
            dt = time[k + 1] - time[k]
            if dt == 0.0:
                samples[k + 1], inertias[k + 1], slopes[k + 1] = samples[k], inertias[k], slopes[k]
                track.append(None)
                continue
            mean = 0.5 * (samples[k] + samples[k + 1])
            angle = 2.0 * np.pi * (self.frequency or 0.0) * (0.5 * (time[k] + time[k + 1]) - time[0])
            basis = np.kron([1.0, np.cos(angle), np.sin(angle)][:blocks], np.eye(c))
            u = torque + sum((values[k] for values in known.values()), np.zeros(nv))
            speeds.append(samples[k + 1][2])
            count += 1
            errors = (x[nv + h + i] * known[name][k] for i, name in enumerate(self.known_error))
            repaired = u + sum(errors, np.zeros(nv))
            if self.mass_error:
                repaired = repaired + x[-1] * u
            rest, unseen, shown = self.explain(samples[k], samples[k + 1], repaired, dt)
            rests.append(low_passed(rests[-1], rest, dt))
            recent = 1.0 - np.exp(-dt / 0.2)
            redundant = max(len(believed(self.model, self.rows, v[0])) - c + unseen.shape[1], 1)
            sensors = self.sensors
            if count >= 6:
                root = np.sqrt(np.abs(np.diff(speeds[-7:], 6, axis=0)[0]))
                roots += max(recent, 1.0 / (count - 3)) * (root - roots)
                sensors = np.clip(roots**2 / (0.822179**2 * np.sqrt(924.0)), 1e-3 * self.sensors, self.sensors)
            pushes.append(u)
            known_noise = told
            if count >= 7:
                root = np.sqrt(np.abs(np.diff(pushes[-7:], 6, axis=0)[0]))
                told_roots += max(recent, 1.0 / (count - 4)) * (root - told_roots)
                known_noise = np.clip(told_roots**2 / (0.822179**2 * np.sqrt(924.0)), 1e-3 * told, told)
            half = 0.5 * dt
            begun, ends = (
                shown @ (M + side * D) * sensors / dt
                for M, D, side in ((inertias[k], slopes[k], half), (inertias[k + 1], slopes[k + 1], -half))
            )
            leak = leaked(begun if ended is None else ended, begun, dt)
            ended = ends
            if len(believed(self.model, self.rows, v[0])) == c - unseen.shape[1]:
                leak = 0.0
            sure_of = 1.0 + np.sqrt(2.5 * 0.015 / 0.2 / redundant)
            misfit += max(recent, 1.0 / count) * ((np.sum(rests[-1][1] ** 2) - sure_of * leak) / redundant - misfit)
            disbelief = max(misfit, (0.004 * weight) ** 2)
            if count <= 12:
                disbelief = max(disbelief, self.prior**2)
            a = np.exp(-dt / self.error_time)
            A = np.diag([*np.ones(h), *np.full(len(spread), a)])
            seen = np.eye(nz)
            seen[:h, :h] -= np.kron(np.eye(blocks), unseen @ unseen.T)
            A = seen @ A
            W = np.diag([*np.full(h, self.force_walk**2 * dt), *((1.0 - a * a) * np.square(spread))])
            G = np.zeros((nz, nv))
            G[:h] = basis.T @ mean[3:]
            for i, name in enumerate(self.known_error):
                G[h + i] = known[name][k]
            if self.mass_error:
                G[-1] = u + G[:h].T @ (seen @ x[nv:])[:h]
            onward = (inertias[k] + half * slopes[k]) @ np.linalg.inv(inertias[k])
            bent = inertias[k + 1] - half * slopes[k + 1]
            own = np.eye(nv + nz)
            own[:nv, :nv] = inertias[k + 1] @ np.linalg.inv(bent)  # C^T v of the velocity sought
            F = np.block([[onward, dt * G.T @ A], [np.zeros((nz, nv)), A]])
            noise = np.vstack([dt * G.T, np.eye(nz)]) @ seen
            square = np.sum((np.array(spread)[:, None] * G[h:]) ** 2, axis=0) if spread else np.zeros(nv)
            doubt = square if first else square + a * (doubt - square)
            first = False
            Q = noise @ W @ noise.T
            wrong = 0.01 * dt * disbelief / weights**2 + np.square(dt * known_noise)
            Q[:nv, :nv] += np.diag(self.misfit**2 * dt * doubt + wrong)
            if self.rows != "all":
                Q[:nv, :nv] += self.unknown_torques(inertias[k + 1], wrong)
            measured = half * (slopes[k] @ v[k] + slopes[k + 1] @ v[k + 1])
            ahead = F @ x + np.concatenate([dt * (u + mean[1]) - measured, np.zeros(nz)])
            P_ahead = F @ P @ F.T + Q
            earlier = F, ahead, P_ahead, own
            ahead, P_ahead = own @ ahead, own @ P_ahead @ own.T
            R = inertias[k + 1] @ np.diag(sensors**2) @ inertias[k + 1]
            K = np.linalg.solve(H @ P_ahead @ H.T + R, H @ P_ahead).T
            x = ahead + K @ (samples[k + 1][0] - H @ ahead)
            P = (np.eye(nv + nz) - K @ H) @ P_ahead @ (np.eye(nv + nz) - K @ H).T + K @ R @ K.T  # Joseph
            track.append((*earlier, x, P, basis, unseen))
        found, sure, later = [], [], None
        for step in reversed(track) if smooth else track:
            if step is None:
                found.append(None)
                sure.append(None)
                continue
            *earlier, x, P, basis, unseen = step
            if smooth and later is not None:
                after, P_after, next_F, next_ahead, next_P_ahead, next_own = later
                back = np.linalg.inv(next_own)
                after, P_after = back @ after, back @ P_after @ back.T
                scale = np.sqrt(np.diag(next_P_ahead))  # unknown torques are 1e8 times as large as all else
                balanced = next_P_ahead / np.outer(scale, scale)
                inverse = np.linalg.pinv(balanced, 1e-11 if unseen.size else 0.0, hermitian=True)
                C = P @ next_F.T / scale @ inverse / scale
                x, P = x + C @ (after - next_ahead), P + C @ (P_after - next_P_ahead) @ C.T
            later = x, P, *earlier
            found.append(basis @ x[nv : nv + h])
            deviation = np.sqrt(np.diag(basis @ P[nv : nv + h, nv : nv + h] @ basis.T))
            sure.append(np.where(np.any(np.abs(unseen) > 1e-3, axis=1), np.inf, deviation))
        if smooth:
            found, sure = found[::-1], sure[::-1]
        for k, one in enumerate(found):
            if one is None:
                found[k], sure[k] = found[k - 1], sure[k - 1]
        return np.array(found), np.array(sure)

    def slope(self, q: Vector, v: Vector) -> Vector:
        """Return d(C^T v)/dv: C^T v is quadratic in v, so differences of any size are exact."""
        data = self.model.createData()

        def drift(rate: Vector) -> Vector:
            return pin.computeCoriolisMatrix(self.model, data, q, rate).T @ rate

        return np.column_stack([0.5 * (drift(v + unit) - drift(v - unit)) for unit in np.eye(self.model.nv)])

    def explain(self, before: Vector, after: Vector, u: Vector, dt: float) -> tuple[Vector, Vector, Vector]:
        """Return rows (nv,) that no force explains, patterns (c, k) that leave no trace, and the map to the former."""
        mean, nv = 0.5 * (before + after), self.model.nv
        phi = (after[0] - before[0]) / dt - mean[1] - u
        _, sizes, patterns = np.linalg.svd(believed(self.model, self.rows, after[2]) @ after[3:].T)
        known = int(np.sum(sizes > 1e-5 * np.linalg.norm(sizes)))
        W = believed(self.model, self.rows, mean[2])
        J, unseen = mean[3:], patterns[known:].T
        A, B, lost = J @ W.T @ W @ J.T, J @ W.T, unseen @ unseen.T
        held = A + np.trace(A) * (lost + 1e-12 * np.eye(len(J)))
        force = project(J, W, phi)
        if unseen.size:  # J is the mean of both ends: unseen patterns leave a small trace in it, not to be magnified
            force = np.linalg.solve(held, (np.eye(len(J)) - lost) @ B @ W @ phi)
        left = W @ (phi - J.T @ force)
        shown = W - B.T @ np.linalg.solve(held, B @ W)
        return np.pad(left, (0, nv - len(left))), unseen, shown

    def unknown_torques(self, M: Vector, misfit: Vector) -> Vector:
        """Return the covariance (nv, nv) of the impulse of any torque at the joints behind a free base."""
        hidden = np.diag(np.arange(self.model.nv) >= 6).astype(float)
        return 1e8 * np.trace((M @ np.diag(self.sensors**2) @ M + np.diag(misfit)) @ hidden) * hidden


def low_passed(state: Vector, value: Vector, dt: float) -> Vector:
    """Return the state (2, nv) of two low-passes of 15 ms in a row after an interval."""
    share = 1.0 - np.exp(-dt / 0.015)
    first = state[0] + share * (value - state[0])
    return np.array([first, state[1] + share * (first - state[1])])


def leaked(ended: Vector, begun: Vector, dt: float) -> float:
    """Return the power that white noise n leaves behind both low-passes: `ended` n in an interval, -`begun` n after."""
    share = 1.0 - np.exp(-dt / 0.015)
    steps = np.arange(4000)
    response = share**2 * (steps + 1) * (1.0 - share) ** steps
    later = np.outer(response[1:], ended) - np.outer(response[:-1], begun)
    return float(np.sum(later**2) + np.sum((response[0] * ended) ** 2))
