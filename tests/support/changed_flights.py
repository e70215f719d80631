"""Flights of `paper` that changed since a calibration by quasi-steady air, and what a calibrated estimate says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np

from aerobat_pin import aerobat
from aerobat_pin.estimation import Calibration, Result, calibrate, estimate
from aerobat_pin.flight import simulate
from aerobat_pin.observers import low_passed
from aerobat_pin.records import Record
from aerobat_pin.scenario import Scenario, load_scenario
from support.mismatch import NOISY

BELIEF = ('believed.air.model="quasi_steady"',)
FREE = ("unknown_force=[]", "simulation.duration=4.0")
OBSERVERS = ("force_level", "kalman", "smoother")
SENSORS: dict[str, tuple[str, ...]] = {"exact": (), "noisy": NOISY}
AT = ("flight.velocity=[3.0,0,0]", "crank.frequency=4.75")
AWAY = ("flight.velocity=[4.0,0,0]", "crank.frequency=4.75")
LOW = ("flight.velocity=[2.7,0,0]", "crank.frequency=4.5", "flight.pitch_deg=6")
HIGH = ("flight.velocity=[3.4,0,0]", "crank.frequency=5.0", "flight.pitch_deg=4")
OUTSIDE = ("flight.velocity=[3.6,0,0]", "crank.frequency=5.5")
LIVELY = ("flight.velocity=[3.0,-0.5,-0.1]", "flight.angular_velocity=[-2.0,1.0,-2.0]", "flight.roll_deg=-5")
DAY = (LOW, HIGH, LIVELY)  # free flights of a flight day: slow, fast and lively
MANOEUVRE = ("flight.velocity=[3.0,0.5,0.2]", "flight.angular_velocity=[2.0,1.0,1.5]", "flight.roll_deg=5")


def _push(axis: str, signal: str) -> str:
    return f'{{frame="left_force_point", axes="world", direction={axis}, {signal}}}'


PUSHES = [  # on the left wing: a soft push along each axis, and 0.3 s of a steady force downward
    *(
        _push(axis, f'signal="one_cosine", amplitude=0.2, duration=0.2, start={start}')
        for axis, start in (("[1,0,0]", 0.3), ("[0,1,0]", 0.7), ("[0,0,1]", 1.1))
    ),
    _push("[0,0,-1]", 'signal="step", height=0.1, start=1.5, end=1.8'),
]
PUSH, CONTACTS = (f"unknown_force=[{', '.join(PUSHES)}]",), len(PUSHES)
FLIGHTS: dict[str, tuple[str, ...]] = {"push": PUSH, "paper": (), "no force": ("unknown_force=[]",)}
STARTED = 0.25  # [s]: by then a rate of roll or yaw at the start has gone, and the air has forgotten it
ELBOW = ("plant.elbow.stiffness=0.2", "plant.elbow.damping=2e-3")  # lags by 10 ms; with less it rings at 19 Hz


@dataclass(frozen=True)
class Change:
    """What happens to the plant after the calibration: settings; the name that should be given to it, if it has one."""

    settings: tuple[str, ...]
    cause: str | None = None


def _gust(amplitude: str, start: float, duration: float) -> Change:
    settings = f"amplitude={amplitude}", f"start={start}", f"duration={duration}"
    return Change((*(f"air.gust.{one}" for one in settings), "believed.air.gust.amplitude=[0.0,0.0,0.0]"))


CHANGES = {
    "none": Change(()),
    "density 10 %": Change(("plant.air_density=0.9",), "air_density"),
    "payload 3 %": Change(("plant.payload.mass=0.0028", "plant.payload.position=[0.03,0,0.02]"), "payload"),
    "payload 10 %": Change(("plant.payload.mass=0.0092", "plant.payload.position=[0.03,0,0.02]"), "payload"),
    "encoder 1 deg": Change(("plant.crank_zero_deg=1.0",), "crank_zero"),
    "encoder 2 deg": Change(("plant.crank_zero_deg=2.0",), "crank_zero"),
    "gust": _gust("[0.0,0.6,0.6]", 0.5, 0.8),
    "gust of 0.4 s": _gust("[0.0,-0.6,-0.6]", 0.7, 0.4),
    "elbow 5 rad/(N m)": Change(ELBOW, "compliance"),
}


@dataclass(frozen=True)
class Verdict:
    """What one estimate says and is worth: of each observer R2, rms error [N], mean squared error over variance."""

    # `later`: error of `force_level` from `STARTED` on; `contacts`: pushes found, contacts that are none; `spacing`:
    # median time between the latter on one wing, in flaps. All of the worse wing.

    r2: Mapping[str, list[float]] = field(default_factory=dict)
    error: Mapping[str, list[float]] = field(default_factory=dict)
    later: Sequence[float] = ()
    nees: Mapping[str, list[float]] = field(default_factory=dict)
    verdict: str = ""
    ratio: float | None = None
    cause: Mapping[str, Any] | None = None
    contacts: tuple[int, int] = (0, 0)
    spacing: float | None = None


def somewhere(seed: int) -> tuple[str, ...]:
    """Return settings of a flight within the range of `LOW` and `HIGH`, drawn from a seed."""
    low, high = [2.8, 4.55, 4.2, -180.0], [3.3, 4.95, 5.8, 180.0]
    speed, frequency, pitch, crank = np.random.default_rng([29, seed]).uniform(low, high)
    return (
        f"flight.velocity=[{speed:.4f},0,0]",
        f"crank.frequency={frequency:.4f}",
        f"flight.pitch_deg={pitch:.3f}",
        f"crank.start_deg={crank:.2f}",
        f"simulation.seed={seed}",
    )


@lru_cache(maxsize=8)  # one is estimated twice, without and with its cause corrected
def flown(settings: tuple[str, ...]) -> tuple[aerobat.FlightLog, Scenario]:
    """Fly `paper` with settings."""
    scenario = load_scenario("paper", [*BELIEF, *settings])
    return simulate(scenario), scenario


def believed_in(scenario: Scenario) -> aerobat.AerobatRobot:
    """Return what is believed of a flight."""
    return aerobat.AerobatRobot.of(aerobat.believed_robot(scenario), scenario.believed_air, "measured")


def free_flight(settings: tuple[str, ...]) -> Record:
    """Return a free flight to calibrate from."""
    log, scenario = flown((*FREE, *settings))
    return aerobat.free_record(log, believed_in(scenario), scenario.observers, "free")


@cache
def learnt(*flights: tuple[str, ...]) -> Calibration:
    return calibrate([free_flight(one) for one in flights], parameters=[])


def estimated(settings: tuple[str, ...], calibration: Calibration, observers: Sequence[str] = OBSERVERS) -> Verdict:
    """Fly with settings, estimate by a calibration, and judge."""
    log, scenario = flown(settings)
    record = aerobat.flight_record(log, believed_in(scenario), scenario.observers)
    return judged(estimate(record, observers, calibration), log, scenario)


def judged(result: Result, log: aerobat.FlightLog, scenario: Scenario) -> Verdict:
    """Compare an estimate with the force of its flight, and its noise; that of `force_level` behind its low-pass."""
    estimates = result.estimates
    count = len(estimates[OBSERVERS[0]].force)
    truth = np.stack([aerobat.true_force(log, name)[0] for name in aerobat.FORCE_POINTS], axis=1)
    given = result.record.map.observer.gain
    seen = low_passed(truth.reshape(count, -1), -np.expm1(-given * result.record.dt)).reshape(truth.shape)
    errors = {name: found.force - (seen if name == "force_level" else truth) for name, found in estimates.items()}
    nees = {}
    for name, found in estimates.items():
        if found.standard_deviation is not None:
            shares = (errors[name] / found.standard_deviation.reshape(count, 2, 3)) ** 2
            nees[name] = _rounded(np.mean(shares, axis=0).max(axis=0))
    model = result.metrics()["model"]
    found, onsets = _contacts(result, truth, log.time)
    spaces = np.concatenate([np.diff(one) for one in onsets]) * scenario.crank.frequency
    return Verdict(
        {name: _rounded(_r2(error, truth)) for name, error in errors.items()},
        {name: _rounded(_rms(error)) for name, error in errors.items()},
        _rounded(_rms(errors["force_level"][log.time[:-1] >= STARTED])),
        nees,
        *(model[key] for key in ("verdict", "ratio", "cause")),
        (found, sum(map(len, onsets))),
        float(f"{np.median(spaces):.3g}") if len(spaces) else None,
    )


def corrected(calibration: Calibration) -> Calibration:
    """Return a calibration whose named cause is corrected in later flights."""
    return replace(calibration, correct=True)


def _rms(error: np.ndarray) -> np.ndarray:
    """Return the root mean square (3,) of the worse wing."""
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)).max(axis=0))


def _r2(error: np.ndarray, truth: np.ndarray) -> np.ndarray:
    size = np.var(truth, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.min(np.where(size > 1e-6, 1.0 - np.mean(error**2, axis=0) / size, np.inf), axis=0)


def _contacts(result: Result, truth: np.ndarray, time: np.ndarray) -> tuple[int, list[list[float]]]:
    """Return how many pushes were found, and the onsets of contacts of each wing that are none [s]."""
    true: set[tuple[int, int]] = set()
    false: list[list[float]] = [[] for _ in aerobat.FORCE_POINTS]
    if result.calibration is None or result.calibration.contacts is None:
        return 0, false
    pushes = np.any(np.abs(truth) > 1e-9, axis=2)
    starts = [np.flatnonzero(np.diff(one.astype(int), prepend=0) == 1) for one in pushes.T]
    for contact in result.calibration.contacts:
        wing = aerobat.FORCE_POINTS.index(contact.point)
        begin, end = np.searchsorted(time, [contact.onset - 0.03, (contact.end or time[-1]) + 0.03])
        if pushes[begin:end, wing].any():
            true |= {(wing, int(one)) for one in starts[wing] if begin - 200 <= one <= end}
        else:
            false[wing].append(contact.onset)
    return len(true), false


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{value:.5g}") for value in values]


def seeds(count: int) -> Sequence[int]:
    """Return seeds of flights that no setting was chosen with."""
    return range(1001, 1001 + count)
