"""A small quadrotor with known drag as a table, and the plain way to its drag: what a map must reproduce."""

import numpy as np
import pandas as pd
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from support.robot_parts import by_axis

MASS, GRAVITY = 0.027, 9.81
UP = np.array([0.0, 0.0, GRAVITY])
DRAG = np.array([0.0116, 0.0104, 0.008])  # [N s/m] along world x, y, z
POWERS = (0.0067, 0.00132)  # [N] of U and U^2, U the sum of the commands over full scale times the voltage
LEAD = 0.04  # [s] by which commands are earlier than their force


def flight(seconds: float = 30.0, rate: float = 100.0, seed: int = 1, wind: float = 0.0) -> pd.DataFrame:
    """Return a flight along sines as a table like those of public data sets; `wind` pushes along x [N]."""
    rng, dt = np.random.default_rng(seed), 1.0 / rate
    time = np.arange(round(seconds * rate)) * dt

    def place(t: np.ndarray) -> np.ndarray:
        return np.stack(
            [0.8 * np.sin(1.3 * t), 0.6 * np.sin(1.7 * t + 0.5), 1.0 + 0.1 * np.sin(3.1 * t) + 0.02 * np.sin(11.0 * t)],
            axis=1,
        )

    def moving(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Velocity, acceleration, attitude (body z along the thrust) and thrust."""
        h = 1e-3
        v, a = (place(t + h) - place(t - h)) / (2 * h), (place(t + h) - 2 * place(t) + place(t - h)) / h**2
        push = MASS * (a + UP) + DRAG * v - np.array([wind, 0.0, 0.0])
        thrust = np.linalg.norm(push, axis=1)
        up = push / thrust[:, None]
        left = np.cross(up, [1.0, 0.0, 0.0])
        left /= np.linalg.norm(left, axis=1)[:, None]
        return v, a, np.stack([np.cross(left, up), left, up], axis=2), thrust

    v, a, R, _ = moving(time)
    ahead = moving(time + LEAD)[3]
    sums = (-POWERS[0] + np.sqrt(POWERS[0] ** 2 + 4 * POWERS[1] * ahead)) / (2 * POWERS[1])
    voltage = 4.1 - 0.4 * time / seconds
    nearby = [Rotation.from_matrix(moving(time + shift)[2]) for shift in (-1e-3, 1e-3)]
    rate_body = (nearby[0].inv() * nearby[1]).as_rotvec() / 2e-3
    felt = np.einsum("nji,nj->ni", R, a + UP) / 9.80665 + 0.01 * rng.standard_normal((len(time), 3))
    columns = {"t": 1.7e9 + time}
    for name, values in (
        ("p", place(time)),
        ("v", v + 0.002 * rng.standard_normal(v.shape)),
        ("imu_acc_", felt),
        ("imu_gyro_", rate_body + 0.01 * rng.standard_normal(v.shape)),
    ):
        columns |= {f"{name}{axis}": values[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"q{axis}": Rotation.from_matrix(R).as_quat()[:, k] for k, axis in enumerate("xyzw")}
    shares = {k: 1 + 0.05 * (-1) ** k * np.sin(time) for k in range(1, 5)}
    columns |= {f"m{k}": np.round(65535 * sums / voltage / 4 * share) for k, share in shares.items()}
    return pd.DataFrame({**columns, "vbat": np.round(voltage, 2)})


MAP = {
    "robot": {
        "body": {"mass": MASS, "inertia": [1.66e-5, 1.67e-5, 2.93e-5]},
        "points": ["body"],
        "rows": {"ignore": ["base.Mx", "base.My", "base.Mz"]},
    },
    "base": by_axis(position="p{}", quaternion="q{}", velocity="v{}", rate="imu_gyro_{}"),
    "check": {"specific_force": {"columns": ["imu_acc_x", "imu_acc_y", "imu_acc_z"], "unit": "g"}},
    "known": {
        "thrust": {
            "columns": ["m1", "m2", "m3", "m4"],
            "full_scale": 65535,
            "supply": {"column": "vbat", "unit": "V"},
            "law": "polynomial 1 2",
            "fit": {"to": "check.specific_force", "part": [0, 0.5]},
            "delay": LEAD,
        }
    },
    "observer": {"gain": 20},
}


def plain_force(table: pd.DataFrame) -> np.ndarray:
    """Return the force that is left over (n, 3) [N], world axes, without an observer and without a map."""
    # m (dv/dt + g) - R (0, 0, T), dv/dt by parabolas over 0.15 s, T the polynomial that fits half of the accelerometer.
    time = table["t"].to_numpy()
    dt = float(np.median(np.diff(time)))
    v = table[["vx", "vy", "vz"]].to_numpy()
    R = Rotation.from_quat(table[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
    commands = np.interp(time - LEAD, time, table[["m1", "m2", "m3", "m4"]].sum(axis=1).to_numpy() / 65535.0)
    U, first = commands * table["vbat"].to_numpy(), len(table) // 2
    felt = 9.80665 * MASS * table["imu_acc_z"].to_numpy()
    shape = np.column_stack([U, U**2])
    thrust = shape @ np.linalg.lstsq(shape[:first], felt[:first], rcond=None)[0]
    slope = savgol_filter(v, 2 * round(0.075 / dt) + 1, 2, deriv=1, delta=dt, axis=0)
    return np.asarray(MASS * (slope + np.array([0.0, 0.0, GRAVITY])) - R[:, :, 2] * thrust[:, None])


def drag_slopes(force: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the slopes (2,) [N s/m] of force on velocity along world x and y, with a constant each."""
    return np.array([np.polyfit(velocity[:, k], force[:, k], 1)[0] for k in range(2)])
