"""Compiled kernels on disk, damaged in the ways that full disks, killed runs and foreign files damage them."""

import importlib.util
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.numerics import jit, kernel_cache

SOURCE = "def scaled(values, factor):\n    return factor * values.sum()\n"
DAMAGES: dict[str, Callable[[bytes, np.random.Generator], bytes]] = {
    "empty": lambda data, rng: b"",
    "cut": lambda data, rng: data[: int(rng.integers(1, len(data)))],
    "random": lambda data, rng: rng.bytes(len(data)),
    "one byte": lambda data, rng: _flipped(data, int(rng.integers(len(data)))),
    "text": lambda data, rng: b"version 1\noid sha256:0\nsize 684\n",
    "longer": lambda data, rng: data + rng.bytes(8),
    "zeros": lambda data, rng: bytes(len(data)),
}
ENDS = (".nbi", ".nbc")  # the index, and the machine code


def _flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]


KERNELS: list[Any] = []  # numba looks for what a stored kernel needs among living ones; no import finds this module


def small_kernel(folder: Path) -> Any:
    """Return a new dispatcher of a small kernel whose files lie in a folder; `scaled(ones(4), 0.5)` is 2."""
    path = folder / "small.py"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(SOURCE)
    spec = importlib.util.spec_from_file_location("small", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    KERNELS.append(jit.kernel(module.scaled))
    return KERNELS[-1]


def damage(folder: Path, end: str, how: str, rng: np.random.Generator) -> Path:
    """Compile the small kernel into a folder, and damage its index or its machine code; return that file."""
    assert small_kernel(folder)(np.ones(4), 0.5) == 2.0
    (path,) = folder.glob(f"__pycache__/aerobat-*/*{end}")
    path.write_bytes(DAMAGES[how](path.read_bytes(), rng))
    return path


def damaged_case(rng: np.random.Generator, folder: Path) -> str:
    """Run one damaged kernel, drawn at random, in an empty folder; return what went wrong, or nothing."""
    end, how = str(rng.choice(ENDS)), str(rng.choice(list(DAMAGES)))
    damage(folder, end, how, rng)
    kernel_cache._told.clear()
    again = small_kernel(folder)
    if again(np.ones(4), 0.5) != 2.0 or sum(again.stats.cache_misses.values()) != 1 or len(kernel_cache._told) != 1:
        return f"{how} {end}: {again.stats}, told {kernel_cache._told}"
    kernel_cache._told.clear()
    whole = small_kernel(folder)
    good = whole(np.ones(4), 0.5) == 2.0 and sum(whole.stats.cache_hits.values()) == 1 and not kernel_cache._told
    return "" if good else f"{how} {end}: not rebuilt in {os.listdir(folder)}"
