"""Small recordings and maps: `PYTHONPATH=.:tests python -m support.small_recordings FOLDER`; arm, walk, drone, hall."""

import copy
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomli_w

from aerobat_pin import load_scenario, simulate
from aerobat_pin.flight import write_csv
from support import drone, swinging_arm, walking_log


def write_map(folder: Path, name: str, values: dict[str, Any], **tables: Any) -> None:
    (folder / f"{name}.toml").write_text(tomli_w.dumps({**values, **tables}))


def write_arm(folder: Path) -> None:
    """Write the arm with its free and its pushed recording; `arm_fit` finds friction beside a force sensor."""
    (folder / "arm.urdf").write_text(swinging_arm.arm())
    swinging_arm.recording(folder, "arm_free", pushed=False, seed=1, seconds=5.0)
    swinging_arm.recording(folder, "arm", pushed=True, seed=2, seconds=5.0)
    values = swinging_arm.arm_map()
    observer = {"names": ["force_level", "kalman"], "gain": 100}
    write_map(folder, "arm", values, observer=observer)
    friction = {"law": "coulomb+viscous+inertia", "fit": [0, 2.5], "to": "check.wrench", "scale": True}
    position, effort = values["joints"]["position"], values["joints"]["effort"]
    joints = {"names": values["joints"]["names"], "position": position, "effort": effort, "friction": friction}
    joints["velocity"] = {"from": "position", "window": 0.02}
    wrench = {"columns": ["fx", "fy", "fz"], "filter": 30}
    write_map(folder, "arm_fit", values, joints=joints, check={"wrench": wrench}, observer=observer)


def write_walk(folder: Path) -> None:
    """Write the quadruped's walk in three formats; `cell` knows the force on one foot."""
    walked, robot = walking_log.walk(1.0, 500.0), Path("walker.urdf")
    (folder / robot).write_text(walking_log.urdf())
    table = walking_log.table(walked)
    table.to_csv(folder / "walk.csv", index=False)
    table.set_index("t").to_xarray().to_netcdf(folder / "walk.nc", engine="h5netcdf")
    walking_log.bag(walked, folder / "walk")
    values: dict[str, Any] = walking_log.table_map(robot)
    observer = {"names": ["momentum", "force_level", "kalman", "smoother"], "gain": 1000.0}
    write_map(folder, "walk", values, observer=observer, log={"time": {"column": "t"}})
    write_map(folder, "walk_bag", walking_log.bag_map(robot), observer=observer)
    cell = {"columns": ["fl_fx", "fl_fy", "fl_fz"], "frame": "FL_FOOT", "axes": "world"}
    robot_table = {**values["robot"], "points": list(walking_log.FEET[1:])}
    check = {"specific_force": values["check"]["specific_force"]}
    write_map(folder, "cell", values, robot=robot_table, known={"cell": cell}, check=check)


def write_drone(folder: Path) -> None:
    """Write two flights of the quadrotor; its thrust is fitted to the accelerometer, or known."""
    drone.flight(6.0).to_csv(folder / "drone.csv", index=False)
    drone.flight(6.0, seed=2, wind=0.03).to_csv(folder / "drone_wind.csv", index=False)
    values: dict[str, Any] = copy.deepcopy(drone.MAP)
    observer = {"names": ["force_level", "smoother"], "gain": 20}
    write_map(folder, "drone", values, observer=observer)
    thrust = {**values["known"]["thrust"], "coefficients": list(drone.POWERS)}
    del thrust["fit"]
    write_map(folder, "drone_known", values, known={"thrust": thrust}, observer=observer)


def write_hall(folder: Path) -> None:
    """Write tables of Aerobat, which do not know the true forces."""
    short = ["simulation.duration=0.5"]
    free = ["unknown_force=[]", "simulation.duration=1.0"]
    for name, scenario, changes in (
        ("hall", "paper", short),
        ("hall_free", "paper", free),
        ("hall_raw", "raw_sensors", short),
    ):
        log = simulate(load_scenario(scenario, changes))
        write_csv(replace(log, truth=None), folder / f"{name}.csv")


def write_sweep(folder: Path) -> None:
    """Write a sweep of the paper's flight over noise and gain."""
    ranges = {"unknown_force.*.noise": [0.0, 0.1], "observers.gain": [200.0, 3200.0]}
    sweep = {"name": "sweep", "description": "Noise and gain", "base": "paper", "ranges": ranges}
    (folder / "sweep.toml").write_text(tomli_w.dumps(sweep))


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for write in (write_arm, write_walk, write_drone, write_hall, write_sweep):
        write(folder)


if __name__ == "__main__":
    main()
