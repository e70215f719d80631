"""Write the tables of docs/structural_error.md: what wrong beliefs cost every observer, what a calibration gives back.

Some three minutes.
"""

from collections.abc import Iterator

from support.calibrated import FREE, SIX_ERRORS, FreeFlight, believed, free_flight, learnt, seen_with, with_six_errors
from support.error_tables import QUASI_STEADY, SENSORS, contact_table, forces, other_plant, r_squared_cells, walk_table
from support.mismatch import MISMATCHES, NOISY, Seen, estimated, flown, made_up, scores, seen
from support.pages import Values, run, table

from aerobat_pin.estimation import Calibration, calibrate
from aerobat_pin.observers import OBSERVERS

STARTS = ("flight.pitch_deg=5.5", "crank.start_deg=40")  # of the flight in which nothing pushes: not the one learnt
LEARNT_FLIGHTS = (
    ("flight.velocity=[2.7,0,0]",),
    ("flight.velocity=[3.3,0,0]",),
    ("crank.frequency=4.5",),
    ("crank.frequency=5.1",),
    ("flight.pitch_deg=8",),
    ("flight.roll_deg=6", "flight.yaw_deg=4"),
    ("flight.velocity=[3.0,0.2,0]", "crank.frequency=4.8"),
)
OTHER_FLIGHTS = {
    "as the first, from another start": (),
    "3.15 m/s, 4.9 Hz": ("flight.velocity=[3.15,0,0]", "crank.frequency=4.9"),
    "2.85 m/s, drifting, pitch 6.5 deg": ("flight.velocity=[2.85,0.1,0]", "flight.pitch_deg=6.5"),
    "roll -4 deg, 5 Hz": ("flight.roll_deg=-4", "crank.frequency=5.0"),
}


def pair(row: str, flight: str, sensors: str) -> tuple[Seen, Seen]:
    """Return a flight as seen with a wrong belief, without and with a calibration learnt under this belief."""
    noise = SENSORS[sensors]
    start = STARTS if flight == "no force" else ()
    more = (*MISMATCHES[row].true, *start, *noise)
    free = free_flight(row, noise)
    return seen(row, flight, 1, (*start, *noise)), seen_with(learnt(row, noise), free, flight, 1, more)


def matrix(observer: str, sensors: str) -> Iterator[list[str]]:
    """Yield the mismatch matrix of one observer."""
    for row in MISMATCHES:
        cells = [row]
        for flight in ("signal", "pushes", "no force"):
            for i, one in enumerate(pair(row, flight, sensors)):
                found = estimated(observer, one)
                if flight == "signal" and i == 0:
                    check = found.redundancy
                    cells.append(f"{check.verdict}, {1e3 * check.belief:.1f} mN a row")
                if flight == "no force":
                    cells.append(forces(made_up(found)))
                else:
                    score = scores(found, one)
                    cells.append(r_squared_cells(score if flight == "signal" else score[2:]))
        yield cells


def every_observer() -> Iterator[list[str]]:
    """Yield R2 and what is made up of every observer, with quasi-steady air believed and exact sensors."""
    signal, still = (pair(QUASI_STEADY, flight, "exact") for flight in ("signal", "no force"))
    for name in OBSERVERS:
        cells = [r_squared_cells(scores(estimated(name, one), one)) for one in signal]
        yield [f"`{name}`", *cells, *(forces(made_up(estimated(name, one))) for one in still)]


def identified() -> tuple[str, str]:
    """Return what six errors at once become: the report of `aerobat calibrate`, and R2 on a held-out flight."""
    log, _ = flown("no force", 101, (*FREE, *NOISY))
    free = believed(log, SIX_ERRORS, with_six_errors)
    found = calibrate([free.record()])
    other = ("flight.velocity=[3.6,0,0]", "crank.frequency=5.5")
    nothing = Calibration(found.belief, found.records)
    rows = []
    for words, one in (("as believed", nothing), ("identified", found)):
        flight = seen_with(one, free, "signal", 1, other)
        cells = [r_squared_cells(scores(estimated(name, flight), flight)) for name in ("force_level", "smoother")]
        rows.append([words, *cells])
    notes = "\n".join(["```", *found.notes, "```"])
    return notes, table("| R2 of the signal, `force_level` | `smoother`", rows)


def varied() -> Iterator[list[str]]:
    """Yield what is made up on flights between those that were learnt, learnt from one, two and seven flights."""

    def flight(more: tuple[str, ...]) -> FreeFlight:
        log, _ = flown("no force", 101, ("simulation.duration=2.0", *more))
        return believed(log, MISMATCHES[QUASI_STEADY].believed)

    several = [flight(more) for more in LEARNT_FLIGHTS]
    ways = {
        "one flight at 3 m/s, 4.75 Hz": calibrate([flight(()).record()], parameters=[]),
        "two flights, 2.7 and 3.3 m/s": calibrate([one.record() for one in several[:2]], parameters=[]),
        "seven flights": calibrate([one.record() for one in several], parameters=[]),
    }
    for words, found in ways.items():
        cells = []
        for more in OTHER_FLIGHTS.values():
            one = seen_with(found, several[0], "no force", 1, more)
            cells.append(forces(made_up(estimated("force_level", one))))
        yield [words, *cells]


def find() -> Values:
    """Return all tables."""
    head = (
        "belief wrong by | verdict | R2 of the signal | calibrated | R2 of contacts, z | calibrated | made up [mN] | "
        "calibrated"
    )
    observers = "observer | R2 of the signal | calibrated | made up [mN] | calibrated"
    notes, other_flight = identified()
    values = {
        "observers": table(observers, every_observer()),
        "exact": table(head, matrix("force_level", "exact")),
        "noisy": table(head, matrix("smoother", "noisy")),
        "walks": walk_table(),
        "flights": table(" | ".join(["learnt from", *OTHER_FLIGHTS]), varied()),
        "contacts": contact_table(),
        "identified": notes,
        "held-out": other_flight,
        "elsewhere": other_plant(),
    }
    return {"docs/structural_error.md": values}


if __name__ == "__main__":
    run(find)
