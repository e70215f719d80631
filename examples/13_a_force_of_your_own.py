"""Your robot knows a force of its own: a drone whose rotors drag, so that only what really pushes is left to find."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd

from aerobat_pin import estimate, open_record
from aerobat_pin.records import Block, Parameter, PlainRobot, Record, parse_map, robot_of_map

DRAG = 2.4e-4  # N s2/m, over the sum of the rotors' speeds [rad/s] and the drone's own speed [m/s]


@dataclass(frozen=True)
class DraggedDrone(PlainRobot):
    """A drone whose rotors drag in proportion to their speeds and to the air that meets them from the side."""

    drag: float
    parameters: ClassVar[Mapping[str, Parameter]] = {"drag": Parameter("1", 0.3)}

    def known(self, block: Block) -> Mapping[str, np.ndarray]:
        """The rotors' drag as a generalised force (m, 6), interval means; `rotors` is a channel that the map names."""
        sideways = block.v[:, :3] * [1.0, 1.0, 0.0]
        drag = -self.drag * block.extra["rotors"].sum(axis=1)[:, None] * sideways
        return {"rotor drag": np.pad(0.5 * (drag[1:] + drag[:-1]), ((0, 0), (0, 3)))}

    def changed(self, values: Mapping[str, float]) -> "DraggedDrone":
        """The drone with another drag: what a calibration changes."""
        return replace(self, drag=self.drag * (1.0 + values.get("drag", 0.0)))


MASS, PUSH = 0.8, np.array([0.0, 0.6, 0.0])  # kg; N, from 3 to 4 s: what nobody knows of
MAP = {
    "robot": {"body": {"mass": MASS, "inertia": [4e-3, 4e-3, 7e-3]}, "points": ["body"]},
    "base": {
        "position": {"columns": ["x", "y", "z"]},
        "quaternion": {"columns": ["qx", "qy", "qz", "qw"]},
        "velocity": {"columns": ["vx", "vy", "vz"]},
        "rate": {"columns": ["wx", "wy", "wz"]},
    },
    "known": {"thrust": {"columns": ["fx", "fy", "fz"]}},  # the rotors are tilted: they push wherever they are asked to
    "extra": {"rotors": {"columns": ["r1", "r2"]}},
    "observer": {"gain": 40},
}


def flight(seconds: float = 6.0, rate: float = 200.0) -> pd.DataFrame:
    """A level flight along sines as a logger would write it: pose, velocity, gyro, thrust and rotor speeds."""
    t, w = np.arange(round(seconds * rate)) / rate, np.array([1.3, 1.7, 2.1])
    place, v, a = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    rotors = 600.0 + 50.0 * np.stack([np.sin(5.0 * t), np.cos(4.0 * t)], axis=1)
    dragged = DRAG * rotors.sum(axis=1)[:, None] * v * [1.0, 1.0, 0.0]
    pushed = ((t >= 3.0) & (t < 4.0))[:, None] * PUSH
    thrust = MASS * (a + np.array([0.0, 0.0, 9.81])) + dragged - pushed
    level, still = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)), np.zeros((len(t), 3))
    columns = np.hstack([t[:, None], place, level, v, still, thrust, rotors])
    return pd.DataFrame(columns, columns="t x y z qx qy qz qw vx vy vz wx wy wz fx fy fz r1 r2".split())


def records(folder: Path) -> tuple[Record, ...]:
    """The flight as a record of a plain drone, and of one that knows its drag."""
    flight().to_csv(folder / "drone.csv", index=False)
    chosen = parse_map(MAP, "of the example")
    plain = robot_of_map(chosen.robot, folder)
    dragged = DraggedDrone(plain.model, plain.free, plain.joints, plain.title, DRAG)
    return tuple(open_record(folder / "drone.csv", chosen, folder, robot) for robot in (plain, dragged))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        for words, record in zip(("without", "with"), records(Path(folder)), strict=True):
            force = estimate(record).estimates["force_level"].force[:, 0]
            quiet, pushed = np.abs(force[100:580]).max(), force[640:780].mean(axis=0)
            print(
                f"{words} its drag: up to {quiet:.3f} N where nothing pushes; {pushed.round(3)} N while {PUSH} N push"
            )
