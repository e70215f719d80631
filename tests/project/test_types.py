"""Every type of the package holds, as mypy's strictest settings judge it."""

import subprocess
import sys
from pathlib import Path


def test_every_type_holds() -> None:
    """What pyproject.toml names, beside the other tests: it takes a processor for most of a minute."""
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-m", "mypy"], cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
