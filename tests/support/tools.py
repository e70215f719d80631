"""Which of other people's tools are installed here, and work beside the Pinocchio that is."""

import subprocess
import sys
from functools import cache
from importlib.util import find_spec

import pinocchio as pin
import pytest

# A tenth of a metre off the frame's place costs 0.005. A Crocoddyl built for another Pinocchio says otherwise, or dies.
CROCODDYL = """
import numpy as np, pinocchio as pin, crocoddyl
model = pin.buildSampleModelHumanoid()
data, state = model.createData(), crocoddyl.StateMultibody(model)
pin.framesForwardKinematics(model, data, pin.neutral(model))
frame, act = model.nframes - 1, crocoddyl.ActuationModelFloatingBase(state)
there = crocoddyl.ResidualModelFrameTranslation(state, frame, data.oMf[frame].translation + [0.1, 0.0, 0.0], act.nu)
costs = crocoddyl.CostModelSum(state, act.nu)
costs.addCost("there", crocoddyl.CostModelResidual(state, there), 1.0)
node = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, act, costs)
work, x = node.createData(), np.concatenate([pin.neutral(model), np.zeros(model.nv)])
node.calc(work, x, np.zeros(act.nu))
node.calcDiff(work, x, np.zeros(act.nu))
assert abs(work.cost - 0.005) < 1e-12, work.cost
"""
LOADER = "import robot_descriptions.loaders.pinocchio"
PROBES = {"crocoddyl": CROCODDYL, "placo": "import placo", "robot_descriptions": LOADER}
# On PyPI, where that name differs.
PACKAGES = {"pink": "pin-pink", "adam": "adam-robotics", "jax": "mujoco-mjx", "pydrake": "drake", "rerun": "rerun-sdk"}


def need(tool: str) -> None:
    """Skip the test, with the reason, where a tool is not installed or does not work here."""
    if why := unusable(tool):
        pytest.skip(why)


@cache
def unusable(tool: str) -> str:
    """Return why a tool cannot be used here, or nothing."""
    if find_spec(tool) is None:
        return f"{tool} is not installed: pip install {PACKAGES.get(tool, tool)}"
    probe = subprocess.run([sys.executable, "-c", PROBES.get(tool, "")], capture_output=True, text=True, check=False)
    said = next((line for line in reversed(probe.stderr.splitlines()) if "Error" in line), "it dies")
    return f"{tool} does not work beside Pinocchio {pin.__version__} here: {said}" if probe.returncode else ""
