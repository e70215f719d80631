"""Observers for whoever has a robot and arrays: they need Pinocchio, numpy and numba, and no other library."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import importlib.abc, sys

NEEDED = {"pinocchio", "coal", "hppfcl", "eigenpy", "numpy", "numba", "llvmlite", "aerobat_pin", "aerobat_description"}
NEEDED |= {"lazy_loader"}  # 20 kB of Python

class Refusal(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top not in NEEDED and top not in sys.stdlib_module_names and not top.startswith(("cmeel", "_", "libpin")):
            raise ModuleNotFoundError(f"{name} is not there", name=name)

sys.meta_path.insert(0, Refusal())
import numpy as np
import pinocchio as pin
from aerobat_pin.observers import OBSERVERS

model = pin.buildSampleModelManipulator()
frame = model.frames[model.nframes - 1].name
q, v = np.tile(pin.neutral(model), (50, 1)), np.zeros((50, model.nv))
tau = np.tile(pin.rnea(model, model.createData(), q[0], v[0], v[0]), (49, 1))
for name, kind in OBSERVERS.items():
    gain = () if name in ("kalman", "smoother") else (100.0,)
    estimate = kind(model, [frame], *gain).run(1e-3 * np.arange(50), q, v, tau)
    assert np.abs(estimate.force).max() < 1e-9, name
"""


def test_observers_need_pinocchio_numpy_and_numba_alone() -> None:
    """All of them, on an arm at rest that nothing pushes, where no other library can be imported."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
