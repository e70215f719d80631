"""Write the tables of docs/crank.md and its figure: a blow on a wing whose crank a motor turns."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure
from support.pages import ROOT, Values, run, save, table

from aerobat_pin.aerobat import FlightLog, flown_robot
from aerobat_pin.flight import simulate
from aerobat_pin.scenario import Scenario, load_scenario
from aerobat_pin.visualization import style

IMPULSE, ONSET, LASTING = 5.0e-3, 0.66, 0.010  # [N s, s, s]
SHOWN = (0.45, 0.95)  # [s]
MOTOR = ("crank.drive=motor", "crank.motor.start_frequency=4.75", "crank.motor.friction=1e-4")
BOOKS = {  # channel -> its line in the books, and its sign
    "drive_power": ("motor", 1.0),
    "friction_power": ("friction", -1.0),
    "air_power": ("air", 1.0),
    "thruster_power": ("attitude hold", 1.0),
    "unknown_power": ("blow", 1.0),
}


def scenario(impulse: float, *settings: str) -> Scenario:
    """Return the page's flight with a blow upward on the left wing [N s]."""
    blow = {"impulse": impulse, "start": ONSET, "duration": LASTING, "direction": "[0, 0, 1]"}
    pushed = [f"unknown_force.0.{key}={value}" for key, value in blow.items()]
    return load_scenario("impact", ["simulation.duration=1.0", *pushed, *settings])


@cache
def flown(impulse: float, *settings: str) -> FlightLog:
    """Fly `scenario`."""
    return simulate(scenario(impulse, *settings))


def truth(log: FlightLog, name: str) -> np.ndarray:
    """Return a channel that only a simulation knows."""
    return np.asarray(log.truth[name].values)


def frequency(impulse: float) -> np.ndarray:
    """Return the crank's rate [Hz] at the samples."""
    return truth(flown(impulse, *MOTOR), "crank_rate") / (2.0 * np.pi)


def books() -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the work [J] done up to the end of each interval, line by line, and the gain of energy [J]."""
    log, chosen = flown(IMPULSE, *MOTOR), scenario(IMPULSE, *MOTOR)
    robot, motor = flown_robot(chosen), chosen.crank.motor
    data, states = robot.model.createData(), zip(log.measured["q"].values, log.measured["v"].values, strict=True)
    energy = 0.5 * motor.rotor_inertia * truth(log, "crank_rate") ** 2
    for k, (q, v) in enumerate(states):
        energy[k] += pin.computeMechanicalEnergy(robot.model, data, q, v)
    step = chosen.simulation.dt
    work = {name: sign * step * np.cumsum(truth(log, channel)) for channel, (name, sign) in BOOKS.items()}
    return work, energy[1:] - energy[0]


def blow_rows() -> Iterator[list[str]]:
    """Yield the crank's speed before and after blows against the stroke and along it."""
    before, after = round(ONSET * 1e3), round((ONSET + LASTING) * 1e3)
    calm = frequency(0.0)
    for name, impulse in (("5 mN s upward, against the stroke", IMPULSE), ("5 mN s downward, along it", -IMPULSE)):
        rate = frequency(impulse)
        cells = [f"{x:.2f}" for x in (rate[before], rate[after], calm[after])]
        yield [name, *cells, f"{rate[after] - calm[after]:+.2f}"]


def stiff_rows() -> Iterator[list[str]]:
    """Yield how far the flight is from that of a steady crank, for rotors ever heavier."""
    steady = flown(IMPULSE).measured
    for inertia in ("5e-5", "1", "100", "1e6"):
        found = flown(IMPULSE, *MOTOR, f"crank.motor.rotor_inertia={inertia}").measured
        apart = np.max(np.abs(found["q"].values - steady["q"].values), axis=0)
        torque = 1e3 * np.max(np.abs(found["motor_torque"].values - steady["motor_torque"].values))
        yield [inertia, f"{np.max(apart[:3]):.1e}", f"{np.max(apart[7:]):.1e}", f"{torque:.1e}"]


def figure() -> Figure:
    """Draw the crank's rate, its torques and the books of energy around the blow."""
    log, calm = flown(IMPULSE, *MOTOR), flown(0.0, *MOTOR)
    work, gained = books()
    drawn = Figure(figsize=(7.5, 7.2), layout="constrained")
    rate, torque, book = drawn.subplots(3, 1, sharex=True)
    rate.plot(log.time, frequency(IMPULSE), color=style.BLUE, label="with the blow")
    rate.plot(calm.time, frequency(0.0), color=style.INK, linestyle="--", label="without it")
    rate.axhline(4.75, color=style.MUTED, linestyle=":", label="ordered; a prescribed crank")
    rate.set_ylabel("crank rate [Hz]")
    middle = log.time[:-1] + 0.5 * np.diff(log.time)
    for name, colour, label in (
        ("drive_torque", style.ORANGE, "motor"),
        ("crank_torque", style.GREEN, "passed on to the linkage"),
    ):
        torque.plot(middle, 1e3 * truth(log, name), color=colour, label=label)
        torque.plot(middle, 1e3 * truth(calm, name), color=colour, linestyle="--", linewidth=0.8)
    torque.set_ylabel("torque at the crank [mN m]")
    start = np.searchsorted(log.time, SHOWN[0])
    colours = (style.ORANGE, style.MUTED, style.SKY_BLUE, style.PURPLE, style.VERMILLION)
    for (name, done), colour in zip(work.items(), colours, strict=True):
        book.plot(log.time[1:], 1e3 * (done - done[start]), color=colour, label=name)
    book.plot(log.time[1:], 1e3 * (gained - gained[start]), color=style.INK, label="gain of energy")
    total = np.sum(list(work.values()), axis=0)
    every = slice(start, None, 25)
    book.plot(log.time[1:][every], 1e3 * (total - total[start])[every], "o", color=style.INK, markersize=3, label="sum")
    book.set_ylabel("work since 0.45 s [mJ]")
    book.set_xlabel("time [s]")
    for axis in (rate, torque, book):
        axis.axvspan(ONSET, ONSET + LASTING, color=style.EVENT_ZONE, alpha=0.3, linewidth=0.0)
        axis.set_xlim(*SHOWN)
        axis.legend(ncols=2 if axis is book else 3, loc="upper left" if axis is book else "upper right")
    for axis in (rate, torque):
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.15 * (high - low))
    return drawn


def quick() -> Values:
    """Return the tables, and the largest gap in the books as a power of ten of the motor's work."""
    work, gained = books()
    lines = [(name, f"{1e3 * done[-1]:.2f}") for name, done in work.items()]
    lines.append(("gain of kinetic and potential energy, rotor included", f"{1e3 * gained[-1]:.2f}"))
    gap = np.max(np.abs(sum(work.values()) - gained)) / work["motor"][-1]
    blow = "blow on the left wing | before [Hz] | after 10 ms [Hz] | without it [Hz] | change [Hz]"
    stiff = "rotor inertia [kg m2] | position [m] | joint angles [rad] | joint torque [mN m]"
    values = {
        "blow": table(blow, blow_rows()),
        "work": table("| work in 1 s [mJ]", lines),
        "gap": f"1e{int(np.ceil(np.log10(gap)))}",
        "stiff": table(stiff, stiff_rows()),
    }
    return {"docs/crank.md": values}


def find() -> Values:
    """Draw the figure."""
    save({"crank_blow": figure()}, ROOT / "docs" / "figures")
    return {}


if __name__ == "__main__":
    run(find, quick)
