"""Tables of docs/structural_error.md: when contacts are found, what walks cost, and flights of another simulator."""

from itertools import product

import numpy as np

from aerobat_pin.estimation import Calibration, calibrate
from aerobat_pin.observers import moving_weight
from support.calibrated import FreeFlight, free_flight, learnt, seen_with
from support.detection_bound import detectability, earliest
from support.elsewhere import FREQUENCY, as_believed, elsewhere, seen_elsewhere
from support.mismatch import NOISY, estimated, flown, made_up, r_squared, scores, seen
from support.observer_conditions import Condition
from support.observer_conditions import estimated as on_the_benchmark
from support.observer_conditions import flown as benchmark_flight

STEEP = (  # a push of 50 ms that is there at once; those of `PUSHES` are an impulse, a soft push and a step
    'unknown_force=[{frame="left_force_point", axes="world", direction=[0,0,1], signal="step", height=0.2, '
    "start=0.9, end=0.95}]",
)
PUSHED = {  # what pushes -> flight, more settings, onset [s]
    "impulse of 5 mN s": ("pushes", (), 0.5),
    "soft push of 50 ms, 0.2 N": ("pushes", (), 0.9),
    "push of 50 ms, 0.2 N, at once": ("no force", STEEP, 0.9),
    "step of 0.1 N": ("pushes", (), 1.3),
}
QUASI_STEADY = "quasi-steady air"
SENSORS = {"exact": (), "noisy": NOISY}
SEEDS = (1, 2, 3)
WALKS = (0.33, 0.8, 2.2)  # of the robot's weight per root second


def r_squared_cells(values: np.ndarray) -> str:
    """Write R2 along three axes; infinite where nothing pushes."""
    return " / ".join("-" if np.isinf(value) else f"{value:.2f}" if value > -10 else f"{value:.0f}" for value in values)


def forces(values: np.ndarray) -> str:
    """Write three forces in mN."""
    return " / ".join(f"{1e3 * value:.1f}" if value < 0.0095 else f"{1e3 * value:.0f}" for value in values)


def contact_table() -> str:
    """Return when contacts are found, and false alarms, with quasi-steady air believed."""
    lines = [
        f"| sensors | calibration | threshold, z [mN] | {' | '.join(PUSHED)} | false alarms in 20 s |",
        "|---" * (4 + len(PUSHED)) + "|",
    ]
    for sensors, noise in SENSORS.items():
        for words in ("none", "calibrated"):
            rows = []
            for seed in SEEDS:
                free = free_flight(QUASI_STEADY, noise, 100 + seed)
                found = learnt(QUASI_STEADY, noise, 100 + seed)
                if words == "none":
                    found = calibrate([free.record()], parameters=[], harmonics=-1)
                threshold = 1e3 * float(found.detection.threshold[2])
                rows.append((threshold, latencies(found, free, seed, noise), false_alarms(found, free, seed, noise)))
            late = np.max([row[1] for row in rows], axis=0)
            alarms = ", ".join(str(row[2]) for row in rows)
            lines.append(f"| {sensors} | {words} | {max(row[0] for row in rows):.0f} | {times(late)} | {alarms} |")
    ideal = ideal_latencies(free_flight(QUASI_STEADY, NOISY), NOISY)
    for words, late in zip(
        ("any detector that must find point and axis", "told point and axis"), ideal.T[::-1], strict=True
    ):
        lines.append(f"| noisy | *the bound: {words}* | - | {times(late)} | 1 |")
    return "\n".join(lines)


def latencies(calibration: Calibration, free: FreeFlight, seed: int, noise: tuple[str, ...]) -> np.ndarray:
    """Return the time [s] from the onset of every push of `PUSHED` to its alarm; infinite where there is none."""
    late = []
    for flight, more, onset in PUSHED.values():
        contacts = seen_with(calibration, free, flight, seed, (*more, *noise)).inputs.calibration.contacts
        after = [one.alarm - onset for one in contacts if one.frame == "left_force_point"]
        late.append(min((time for time in after if 0.0 < time < 0.06), default=np.inf))
    return np.array(late)


def ideal_latencies(free: FreeFlight, noise: tuple[str, ...]) -> np.ndarray:
    """Return how early the pushes of `PUSHED` can be found [s] (4, 2) by any detector; see `detection_bound`."""
    found = []
    for flight, more, onset in PUSHED.values():
        log, scenario = flown(flight, 1, (*more, *noise))
        push = next(force for force in scenario.unknown_force if getattr(force, "start", None) == onset)
        q, dt = log.measured["q"].values, scenario.simulation.dt
        found.append(earliest(detectability(free.robot.model, q, dt, round(onset / dt), push), dt))
    return np.array(found)


def false_alarms(calibration: Calibration, free: FreeFlight, seed: int, noise: tuple[str, ...]) -> int:
    """Return the number of contacts found on both wings in 20 s of free flight."""
    long = seen_with(calibration, free, "no force", 200 + seed, ("simulation.duration=20.0", *noise))
    return len(long.inputs.calibration.contacts)


def times(late: np.ndarray) -> str:
    """Write times [s] in ms as cells of a table."""
    return " | ".join(f"{1e3 * one:.0f} ms" if np.isfinite(one) else "missed" for one in late)


def walk_table() -> str:
    """Return what walks cost on forces of a fifth of the robot's weight, and of its weight, with noisy sensors."""
    lines = [
        "| walk [weights per root second] | `smoother`, signal | `kalman` and `smoother`, contacts, z | `smoother`, "
        "made up [mN] | `kalman` and `smoother`, `observer_benchmark` |",
        "|---" * 5 + "|",
    ]
    flights = {
        flight: [seen("exact", flight, seed, NOISY) for seed in SEEDS] for flight in ("signal", "pushes", "no force")
    }
    noisy = Condition("velocity noise", noise=1.0)
    for walk in WALKS:
        size = walk * moving_weight(flights["signal"][0].model)

        def worst(name: str, flight: str, size: float = size) -> np.ndarray:
            return np.min([scores(estimated(name, one, force_walk=size), one) for one in flights[flight]], axis=0)

        made = np.max([made_up(estimated("smoother", one, force_walk=size)) for one in flights["no force"]], axis=0)
        contacts = " and ".join(f"{worst(name, 'pushes')[2]:.2f}" for name in ("kalman", "smoother"))
        yardstick = " and ".join(f"{benchmark_score(name, walk, noisy):.3f}" for name in ("kalman", "smoother"))
        cells = (f"{walk:g}", r_squared_cells(worst("smoother", "signal")), contacts, forces(made), yardstick)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def benchmark_score(name: str, walk: float, noisy: Condition) -> float:
    """Return R2 of the worst axis, wing and seed on `observer_benchmark`, with a walk in weights per root second."""
    found = []
    for seed in SEEDS:
        flight = benchmark_flight(seed, noisy.share)
        tuning = {name: {"force_walk": walk * moving_weight(flight.model)}}
        estimate, truth = on_the_benchmark(name, seed, noisy, tuning=tuning), flight.clean
        found.append(1.0 - np.mean((estimate.force - truth) ** 2, axis=0) / np.var(truth, axis=0))
    return float(np.min(found))


def other_plant() -> str:
    """Return what a calibration gives back on flights of a foreign simulator; R2 is that of the left, pushed wing."""
    free = as_believed(elsewhere("nothing", 4.0)[0])
    learnt_there = calibrate([free.record()], parameters=[])
    lines = ["| flight | | `force_level` | calibrated | `smoother` | calibrated |", "|---" * 6 + "|"]
    flights = (
        ("nothing pushes", "made up [mN]", ("nothing", 2.0, 3.02, 4.78)),
        ("nothing pushes, 3.3 m/s and 5 Hz", "made up [mN]", ("nothing", 2.0, 3.3, 5.0)),
        ("impulse, push and step upward", "R2", ("contacts", 1.0)),
        ("the force of the paper", "R2", ("signal", 2.0)),
        ("the same, side speed held", "R2", ("signal", 2.0, 3.0, FREQUENCY, True)),
        ("a force that swings at 2 Hz, all axes", "R2", ("swinging", 1.0)),
    )
    for words, what, arguments in flights:
        flight = elsewhere(*arguments)  # type: ignore[arg-type]
        cells = []
        for name, calibration in product(("force_level", "smoother"), (None, learnt_there)):
            seen_there = seen_elsewhere(flight, calibration)
            estimate = estimated(name, seen_there)
            cells.append(
                forces(made_up(estimate)) if what != "R2" else r_squared_cells(r_squared(estimate, seen_there)[0])
            )
        lines.append(f"| {words} | {what} | {' | '.join(cells)} |")
    return "\n".join(lines)
