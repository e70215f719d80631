"""What the controller says of its own flight: the first of these that fits, worst first.

| word | when |
|---|---|
| LOST | at any sample: a channel without a good sample for `SILENT`, `FARTHEST_OFF` its course, tilted by `TILTED` |
| UNSTABLE | in a window: an axis swings (two changes of sign) by more than `SWINGS` rms, and does not calm down |
| SATURATED | in a window: more than `AT_LIMITS` of all commands at a limit |
| DEGRADED | a sample was not used, see `sensed` |
| OK | none of them |

A window lasts `WATCHED_TIME`. The word of a flight is the worst so far; it does not get better again. An axis calms
down if it swings by a tenth less than in the window before. All is judged by what the sensors show, so that a robot can
say it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import Annotated, NamedTuple

import numpy as np

from aerobat_pin.control.sensed import SensedMotion
from aerobat_pin.control.sensed_channels import CHANNELS, FAULTS
from aerobat_pin.numerics import Array, Integers, Viewed, fields_of, inner, kernel, new_state

STATE_WORDS = ("OK", "DEGRADED", "SATURATED", "UNSTABLE", "LOST")
FAILED = ("UNSTABLE", "LOST")  # the flight is no success: the command line ends with exit code 2
WATCHED_TIME = 0.5  # [s]
SILENT = 0.25  # [s]
FARTHEST_OFF = 1.0  # [m]
TILTED = 60.0  # [deg]
SWINGS = (0.040, 0.040, 0.040, *[8.0 * pi / 180.0] * 3)  # [m], [rad]
AT_LIMITS = 0.2
CALMER = 0.9
AXES = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class LoopState:
    """What a controller says of its flight so far.

    Attributes:
        word: one of `STATE_WORDS`.
        since: when it was first so, since the begin [s]; 0 for OK and DEGRADED.
        line: one line with the word, when and why.
        unused: channel -> fault -> number of samples that were not used; channels without any are left out.
    """

    word: str
    since: float
    line: str
    unused: dict[str, dict[str, int]]


class WatchState(NamedTuple):
    """State of the monitor.

    Constants: `limit` (m,) of the thrusters [N], `samples` (1,) in a window, `silent` (1,) in ticks, `swings` (6,).

    State of a window: `seen` (1,) samples, `squares`, `signs`, `crossings` (6,), `limited` () commands at a limit,
    `short` (2,) squares of what they left of roll and lift; of the window before: `before` (6,) rms.

    Results: `word` (1,) index in `STATE_WORDS`, `at` (1,) sample of its begin, `why` (1,) channel, axis, or 7 off, 8
    tilted, `size` () by how much, `share` () largest at limits, `lacking` (2,) rms left of roll [N m] and lift [N] in
    that window, `ticks` (1,) all samples.
    """

    limit: Annotated[Array, "m"]
    samples: Annotated[Integers, "1"]
    silent: Annotated[Integers, "1"]
    swings: Annotated[Array, "6"]
    seen: Annotated[Integers, "1"]
    squares: Annotated[Array, "6"]
    signs: Annotated[Array, "6"]
    crossings: Annotated[Array, "6"]
    limited: Annotated[Array, ""]
    short: Annotated[Array, "2"]
    before: Annotated[Array, "6"]
    word: Annotated[Integers, "1"]
    at: Annotated[Integers, "1"]
    why: Annotated[Integers, "1"]
    size: Annotated[Array, ""]
    share: Annotated[Array, ""]
    lacking: Annotated[Array, "2"]
    ticks: Annotated[Integers, "1"]


CONSTANTS = 4  # fields
OFF, TILT = 7, 8
DEGRADED, SATURATED, UNSTABLE, LOST = 1, 2, 3, 4


class Monitor(Viewed):
    """Watches a flight, sample by sample, and says how it is.

    Args:
        limit: (m,) limits of the thrusters [N].
        dt: time between samples [s].
        sensed: what the sensors show.
    """

    def __init__(self, limit: Array, dt: float, sensed: SensedMotion) -> None:
        self._memory = new_state(WatchState, m=len(limit))
        self._view()
        fields = self._fields
        fields.limit[:], fields.samples[:], fields.swings[:] = limit, round(WATCHED_TIME / dt), SWINGS
        fields.silent[:] = np.ceil(SILENT / dt)
        self._dt, self._sensed = dt, sensed
        self.restart()

    def _view(self) -> None:
        self._fields = fields_of(self._memory, WatchState)

    def restart(self) -> None:
        """Begin a flight."""
        for state in self._fields[CONSTANTS:]:
            state[...] = 0
        self._fields.before[:] = np.inf

    def take(self, command: Array, unrealised: Array) -> None:
        """Take the commands (m,) [N] that followed from the sample, and what limits left of their wrench (6,)."""
        sensed = self._sensed
        watch(self._memory, sensed.q, sensed.error, sensed.beyond, command, unrealised)

    @property
    def state(self) -> LoopState:
        """What is said of the flight so far."""
        fields, worst = self._fields, int(self._fields.word[0])
        word = STATE_WORDS[max(worst, 1) if self._sensed.faults.any() else worst]
        since = float(fields.at[0]) * self._dt if word not in ("OK", "DEGRADED") else 0.0
        unused = {
            channel: {fault: int(n) for fault, n in zip(FAULTS, row, strict=True) if n}
            for channel, row in zip(CHANNELS, self._sensed.faults, strict=True)
            if row.any()
        }
        return LoopState(word, since, f"{word}{self._reason(word, since, unused)}", unused)

    def _reason(self, word: str, since: float, unused: dict[str, dict[str, int]]) -> str:
        fields, why = self._fields, int(self._fields.why[0])
        size = float(fields.size[()])
        if word == "LOST":
            what = {OFF: f"{size:.2f} m off its course", TILT: f"tilted by {np.degrees(size):.0f} deg"}
            return f" at {since:.3f} s: {what.get(why) or f'no good sample of {CHANNELS[why]} for {SILENT:g} s'}"
        if word == "UNSTABLE":
            swing = f"{1e3 * size:.0f} mm" if why < 3 else f"{np.degrees(size):.1f} deg"
            return f" since {since:.2f} s: {AXES[why]} swings by {swing} rms and does not calm down"
        if word == "SATURATED":
            roll, lift = 1e3 * fields.lacking
            share = 100.0 * float(fields.share[()])
            return (
                f" since {since:.2f} s: up to {share:.0f} % of the commands of half a second at a limit; short then by "
                f"{roll:.1f} mN m of roll and {lift:.0f} mN of lift, rms"
            )
        if word == "DEGRADED":
            counts = ", ".join(
                f"{sum(faults.values())} of {channel} ({', '.join(faults)})" for channel, faults in unused.items()
            )
            return f": samples not used: {counts}"
        return ""


@kernel
def watch(memory: Array, q: Array, error: Array, beyond: Integers, command: Array, unrealised: Array) -> None:
    """Take configuration, errors (6,), ticks without a sample (7,), commands (m,) and unrealised wrench (6,)."""
    w = fields_of(memory, WatchState)
    m = w.limit.shape[0]
    for c in range(7):
        if beyond[c] > w.silent[0]:
            worsen(w, LOST, c, 0.0)
    off = sqrt(error[0] * error[0] + error[1] * error[1] + error[2] * error[2])
    if off > FARTHEST_OFF:
        worsen(w, LOST, OFF, off)
    upright = 1.0 - 2.0 * (q[3] * q[3] + q[4] * q[4])
    if upright < np.cos(TILTED * pi / 180.0):
        worsen(w, LOST, TILT, np.arccos(min(max(upright, -1.0), 1.0)))
    for i in range(6):
        w.squares[i] += error[i] * error[i]
        if error[i] * w.signs[i] < 0.0:
            w.crossings[i] += 1.0
        w.signs[i] = 1.0 if error[i] > 0.0 else -1.0
    for j in range(m):
        if command[j] <= 0.0 or command[j] >= w.limit[j]:
            w.limited[()] += 1.0 / m
    w.short[0] += unrealised[3] * unrealised[3]
    w.short[1] += unrealised[2] * unrealised[2]
    w.seen[0] += 1
    w.ticks[0] += 1
    if w.seen[0] >= w.samples[0]:
        judge_window(w)


@inner
def judge_window(w: WatchState) -> None:
    """Judge a window that has ended, and begin the next one."""
    n = w.seen[0]
    for i in range(6):
        rms = sqrt(w.squares[i] / n)
        if rms > w.swings[i] and w.crossings[i] >= 2.0 and rms > CALMER * w.before[i]:
            worsen(w, UNSTABLE, i, rms)
        w.before[i] = rms
        w.squares[i] = w.crossings[i] = 0.0
    share = w.limited[()] / n
    if share > AT_LIMITS:
        worsen(w, SATURATED, 0, share)
    if share > w.share[()]:
        w.share[()] = share
        w.lacking[0], w.lacking[1] = sqrt(w.short[0] / n), sqrt(w.short[1] / n)
    w.limited[()] = w.short[0] = w.short[1] = 0.0
    w.seen[0] = 0


@inner
def worsen(w: WatchState, word: int, why: int, size: float) -> None:
    """Remember a word that is worse than the one so far, from the begin of its window; LOST from this sample."""
    if word > w.word[0]:
        w.word[0], w.why[0], w.size[()] = word, why, size
        w.at[0] = w.ticks[0] if word == LOST else w.ticks[0] - w.seen[0]
