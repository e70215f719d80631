"""The observers run with Pinocchio, numpy and numba alone, without anything else that this package installs."""

import subprocess
import sys

ALONE = """
import sys

OURS = {"aerobat_pin", "aerobat_description"}
ALLOWED = OURS | {"pinocchio", "coal", "numpy", "numba", "llvmlite", "lazy_loader"} | sys.stdlib_module_names
LOADED = {name.partition(".")[0] for name in sys.modules}  # by the interpreter's own start


class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in ALLOWED | LOADED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Nothing())

import numpy as np
import pinocchio as pin

from aerobat_pin import observers

for name in observers.__all__:
    getattr(observers, name)
model = pin.buildSampleModelManipulator()
frame = model.addFrame(pin.Frame("tool", model.njoints - 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
data, time = model.createData(), np.arange(201) * 1e-3
q, v = np.tile(np.linspace(0.2, 0.7, model.nq), (len(time), 1)), np.zeros((len(time), model.nv))
pin.computeJointJacobians(model, data, q[0])
pin.updateFramePlacements(model, data)
J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
push = np.array([1.0, -2.0, 3.0])
tau = np.tile(pin.rnea(model, data, q[0], v[0], v[0]) - J.T @ push, (len(time) - 1, 1))
for name, kind in observers.OBSERVERS.items():
    observer = kind(model, ["tool"], 200.0)
    found = observer.run(time, q, v, tau).force[-1, 0]
    assert np.abs(found - push).max() < 0.01, (name, found)
    if name != "smoother":
        observer.reset(q[0], v[0])
        sample = observer.update(1e-3, q[1], v[1], tau[0])
        assert np.isfinite(sample.components).all(), name
print(*observers.OBSERVERS)
"""


def test_observers_need_pinocchio_numpy_and_numba_alone() -> None:
    """Each finds a push on an arm that stands, record and stream, where importing anything else fails."""
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["momentum", "force_level", "second_order", "super_twisting", "kalman", "smoother"]
