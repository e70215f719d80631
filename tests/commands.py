"""The command line as tests call it: in this process, or in one of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from aerobat_pin import cli


def call(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Run `aerobat` with these words in this process and return its exit code."""
    monkeypatch.setattr(sys, "argv", ["aerobat", *words])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return int(stop.value.code or 0)


def aerobat(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `aerobat` with these words in a process of its own."""
    command = [sys.executable, "-m", "aerobat_pin.cli", *words]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
