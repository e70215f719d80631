"""Fly a short version of the paper's experiment and print the errors of each observer's forces."""

from aerobat_pin.experiments import run
from aerobat_pin.scenario import load_scenario

experiment = run(load_scenario("paper", ["simulation.duration=0.5"]))
print(experiment.metrics["note"])
for name, scores in experiment.metrics["observers"].items():
    for wing in ("left", "right"):
        row = "  ".join(f"{axis} {one['r2']:.5f} ({1e3 * one['rmse']:.2f} mN)" for axis, one in scores[wing].items())
        print(f"{name:<12} {wing:<6} {row}")
