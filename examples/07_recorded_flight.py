"""Write a simulated flight to a table as a laboratory would record it, and estimate forces only from this table."""

import tempfile
from pathlib import Path

from aerobat_pin.aerobat import belief_about, believed_robot, estimate_flight, read_log, true_force, write_csv
from aerobat_pin.flight import simulate
from aerobat_pin.forces import r_squared
from aerobat_pin.scenario import load_scenario

flight = simulate(load_scenario("real_log_demo"))
with tempfile.TemporaryDirectory() as folder:
    table = Path(folder) / "hall.csv"
    write_csv(flight, table)
    print("columns:", table.read_text().splitlines()[0])
    log = read_log(table)

# What the observers assume: the robot, and the noise of its sensors (m/s, rad/s, rad/s per sample).
settings = [
    "robot.changes.wing.offset_x=-0.060",
    "observers.gain=100",
    "observers.smoother.sensor_noise=[0.05, 0.05, 0.3]",  # at most: see docs/recorded.md
    "observers.smoother.force_walk=0.3",
]
belief = belief_about(log, "hall", "aerobat_guard", ["force_level", "smoother"], settings)
result = estimate_flight(log, believed_robot(belief), belief)
print("inputs:", ", ".join(f"{name} {source}" for name, source in result.inputs.items()))

# The true forces are known only because this flight was simulated.
truth, _ = true_force(flight, "left_force_point")
for name, estimate in result.estimates.items():
    scores = (r_squared(estimate.force[:, 0, axis], truth[:, axis]) for axis in range(3))
    print(name, *(f"F{axis} R2 {score:.2f}" for axis, score in zip("xyz", scores, strict=True)))
