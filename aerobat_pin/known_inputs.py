"""From a flight log to what an observer is fed: configuration, velocity, and known generalised forces.

Each input says where it comes from: `measured`, or `modelled` where a believed robot and its air supply it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aerobat_pin.arrays import Array
from aerobat_pin.flight_log import KNOWN, FlightLog


@dataclass(frozen=True)
class KnownInputs:
    """What an observer is fed.

    Attributes:
        time: (m + 1,) [s].
        q, v: (m + 1, nq), (m + 1, nv).
        tau: (m, nv) motor torque at the joints, interval means.
        known: name -> (m, nv) other known generalised forces, interval means.
        source: channel -> "measured" or "modelled".
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    known: Mapping[str, Array]
    source: Mapping[str, str]


def known_inputs(log: FlightLog) -> KnownInputs:
    """Read an observer's inputs from the measured side of a log; the truth is not looked at."""
    measured = log.measured
    known = {
        str(name).removeprefix(KNOWN): np.asarray(measured[name].values, float)
        for name in measured.data_vars
        if str(name).startswith(KNOWN)
    }
    source = {"q": "measured", "v": "measured", "motor_torque": "measured", **dict.fromkeys(known, "modelled")}
    return KnownInputs(
        time=log.time,
        q=np.asarray(measured["q"].values, float),
        v=np.asarray(measured["v"].values, float),
        tau=np.asarray(measured["motor_torque"].values, float),
        known=known,
        source=source,
    )
