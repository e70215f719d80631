"""Read an HDF5 file of others once, in a process whose memory and time are limited.

The HDF5 library believes the lengths in a file: a wrong one lets it read for ever, or ends the process. So a file
without a checksum of ours is first read here, from end to end, and then judged in `checked_netcdf.py`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

MEMORY = 1_500_000_000  # bytes of addresses, half of which are those of the libraries
TRIAL_SECONDS, BYTES_A_SECOND = 3, 20_000_000  # of the processor: more only in a hang
BYTES_TRIED, LARGEST_TRIED = 4_000_000, 2e9  # bytes that are read at once, and of values that will be refused anyway
MEMORY_SHORT = 3  # exit code


def fails_in_a_trial(path: Path) -> str | None:
    """Return how a process ended that read an HDF5 file; None if it read it, or was told an error by the library."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    words = [sys.executable, "-I", __file__, os.fspath(path)]
    code = subprocess.run(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
    if code == MEMORY_SHORT:
        return "it takes more memory than its size explains"
    return f"the HDF5 library ends by signal {-code} or does not end" if code < 0 else None


def _read(file: Any, item: Any) -> None:
    """Read an object's attributes and what their references name, and all its numbers, piece by piece."""
    import h5py

    for key in item.attrs:
        if item.attrs.get_id(key).get_storage_size() <= BYTES_TRIED:
            for cell in getattr(item.attrs[key], "ravel", lambda: ())():
                for reference in cell if hasattr(cell, "__len__") and not isinstance(cell, str | bytes) else (cell,):
                    if isinstance(reference, h5py.Reference) and reference:
                        file[reference].name  # noqa: B018
    if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiuS" or item.is_virtual or item.external:
        return
    if item.shape and item.size * item.dtype.itemsize <= LARGEST_TRIED:
        row = max(item.size // max(item.shape[0], 1), 1) * item.dtype.itemsize
        step = max(int(BYTES_TRIED // row), 1)
        for first in range(0, item.shape[0], step):
            item[first : first + step]


def main() -> None:
    """Read the file that the command line names, within the limits: `python hdf5_trial.py FILE`."""
    import resource

    limit = TRIAL_SECONDS + os.path.getsize(sys.argv[1]) // BYTES_A_SECOND
    for kind, most in ((resource.RLIMIT_CPU, limit), (resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, MEMORY)):
        known = resource.getrlimit(kind)[1]  # of the process that started this one
        most = most if known == resource.RLIM_INFINITY else min(most, known)
        resource.setrlimit(kind, (most, most))
    try:
        import h5py

        with h5py.File(sys.argv[1], "r") as file:
            _read(file, file)
            file.visititems(lambda _, item: _read(file, item))
    except MemoryError:
        sys.exit(MEMORY_SHORT)


if __name__ == "__main__":
    main()
