"""What the joint smoother and the causal filter find from raw samples: the tables of docs/raw_sensors.md.

Each row is the worse wing and the worst of the seeds, against the true force without its noise. A quarter of an hour.
"""

import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin
from long_paths import GIVEN
from support.own_model import own_model_errors
from support.pages import Values, run, table

from aerobat_pin import load_scenario, simulate
from aerobat_pin.aerobat import FORCE_POINTS, FlightLog, believed_robot, flight_channels, read_log, write_csv
from aerobat_pin.aerobat.raw import JointEstimate, JointFilter, JointSmoother, find_mount, mounted, raw_record
from aerobat_pin.aerobat.raw.channels import part_of
from aerobat_pin.aerobat.raw.layout import first_prior
from aerobat_pin.aerobat.raw.nominal_motion import first_guess
from aerobat_pin.forces import r_squared
from aerobat_pin.scenario import RawSection, Scenario

SEEDS, DRAWS = (1, 2, 3, 4, 5), 10
GUARD = (  # observer_benchmark on the heavy robot
    "robot.morphology=aerobat_guard",
    "crank.frequency=4.75",
    "hold.attitude_stiffness=[0.291,0.108,0.351]",
    "hold.attitude_damping=[0.0388,0.0144,0.0468]",
    "hold.speed_gain=0.369",
    "hold.lift=0.711",
    "hold.height_stiffness=2.30",
    "hold.height_damping=0.737",
)


@dataclass(frozen=True)
class Case:
    """A flight through raw sensors, and what is believed about it."""

    name: str
    scenario: str = "raw_sensors"
    torque: str = "measured"
    accelerometer: bool = True
    settings: tuple[str, ...] = ()
    raw: RawSection = field(default_factory=RawSection)
    late: str = ""
    table: bool = False


def four(name: str, scenario: str, *settings: str) -> Iterator[Case]:
    """Yield the cases of a flight: all torques or the motor's alone, with an accelerometer and without."""
    for torque in ("measured", "motor_only"):
        for there in (True, False):
            words = f"{'all' if torque == 'measured' else 'motor'}{'' if there else ', no accelerometer'}"
            yield Case(f"{name}, {words}", scenario, torque, there, settings)


STEP_OF_ONE = ("unknown_force.1.step=0.0",)  # of the two equal forces, one has no step
HEAVIER = ("believed.robot.changes.scale.wing_mass=1.05", "believed.robot.changes.scale.body_mass=1.05")
CASES = (
    *four("paper", "raw_sensors"),
    Case("paper, no torque", torque="none"),
    Case("paper, from a table, no accelerometer", accelerometer=False, table=True),
    Case("paper, step on one wing, all", settings=STEP_OF_ONE),
    Case("paper, step on one wing, motor, no accelerometer", "raw_sensors", "motor_only", False, STEP_OF_ONE),
    *four("guard", "observer_benchmark", *GUARD),
    *four("benchmark", "observer_benchmark"),
    Case(
        "paper, mass +5 %, air +20 %, factors",
        settings=(*HEAVIER, "believed.air.density=1.47"),
        raw=RawSection(mass_error=0.05, air_error=0.2),
    ),
    *(Case(f"paper, {one} 1 ms late", late=one) for one in ("gyro", "accelerometer", "crank_encoder", "motor_torque")),
)
FREE_FLIGHTS = 24  # that show whether the deviations of place and turn are true
OWN_FLIGHTS = ("paper", "observer_benchmark", "tumble")
CAUSAL = ("paper, all", "paper, all, no accelerometer", "benchmark, all")  # rows that the causal filter has too


def scenario_of(case: Case, seed: int) -> Scenario:
    """Return the scenario of a case: its flight through the sensors of `raw_sensors`."""
    scenario = load_scenario(case.scenario, [f"simulation.seed={seed}", *case.settings])
    sensors = load_scenario("raw_sensors").sensors
    if not case.accelerometer:
        sensors = sensors.model_copy(update={"accelerometer": None})
    if case.late:
        late = getattr(sensors, case.late).model_copy(update={"delay": 1.0e-3})
        sensors = sensors.model_copy(update={case.late: late})
    return scenario.model_copy(update={"sensors": sensors})


def through_a_table(log: FlightLog) -> FlightLog:
    """Return the samples of a log as they are read from a table: without notes on noise and place, without a truth."""
    with TemporaryDirectory() as folder:
        write_csv(log, Path(folder, "hall.csv"))
        return read_log(Path(folder, "hall.csv"))


def true_forces(log: FlightLog) -> np.ndarray:
    """Return the true forces without noise (m, 2, 3)."""
    return log.truth["force_noise_free_W"].sel(point=list(FORCE_POINTS)).values


def figures(force: np.ndarray, covariance: np.ndarray, truth: np.ndarray, *, total: bool) -> list[float]:
    """Return R2 (3), rms error (3) [mN], normalised error squared, stated deviation over rms error."""
    if total:
        adding = np.tile(np.eye(3), 2)
        force, truth = force.sum(axis=1, keepdims=True), truth.sum(axis=1, keepdims=True)
        covariance = adding @ covariance @ adding.T
    r2 = [[r_squared(force[:, i, k].copy(), truth[:, i, k].copy()) for k in range(3)] for i in range(force.shape[1])]
    error = (force - truth).reshape(len(force), -1)
    nees = np.mean(np.einsum("ki,kij,kj->k", error, np.linalg.inv(covariance), error)) / error.shape[1]
    rms, stated = np.sqrt(np.mean(error**2, axis=0)), np.sqrt(np.mean(np.einsum("kii->ki", covariance), axis=0))
    worst = np.min(np.array(r2, float), axis=0)
    by_axis = 1e3 * np.max(rms.reshape(-1, 3), axis=0)
    return [*worst.tolist(), *by_axis.tolist(), float(nees), float(np.max(stated / rms))]


def measured(case: Case, seed: int, *, causal: bool) -> tuple[list[list[float]], JointEstimate, float, float]:
    """Return the figures of smoother (and filter) on one flight, the estimate, and the seconds they took."""
    scenario = scenario_of(case, seed)
    log, robot = simulate(scenario), believed_robot(scenario)
    samples_of = through_a_table(log) if case.table else log
    record = raw_record(samples_of.time, flight_channels(samples_of, robot), robot, case.torque, case.raw)  # type: ignore[arg-type]
    start = time.process_time()
    smoother = JointSmoother(robot, scenario.believed_air, FORCE_POINTS, case.raw)
    found = smoother.run(record)
    took, truth, total = time.process_time() - start, true_forces(log), case.torque == "none"
    rows, sample_time = [figures(found.force, found.force_covariance, truth, total=total)], 0.0
    if causal:
        start = time.process_time()
        samples = JointFilter(smoother, found.tuning, record.channels, record.torque).run(record)
        sample_time = (time.process_time() - start) / len(samples)
        use = [k for k, sample in enumerate(samples[1:]) if sample is not None and record.time[k] > 0.1]
        force = np.array([samples[k + 1].force for k in use])  # type: ignore[union-attr]
        covariance = np.array([samples[k + 1].covariance for k in use])  # type: ignore[union-attr]
        rows.append(figures(force, covariance, truth[use], total=total))
    return rows, found, took, sample_time


def smoother_rows() -> Iterator[list[str]]:
    """Yield a row for each case, and a row for each factor or offset that was found."""
    for case in CASES:
        made = [measured(case, seed, causal=case.name in CAUSAL) for seed in SEEDS]
        for i, label in enumerate(("", ", causal filter")[: len(made[0][0])]):
            values = np.array([rows[i] for rows, _, _, _ in made])
            r2 = "/".join("-" if np.isnan(v) else f"{v:.4f}" for v in values[:, :3].min(0))
            rms = "/".join(f"{v:.1f}" for v in values[:, 3:6].max(0))
            nees = f"{values[:, 6].min():.2f} to {values[:, 6].max():.2f}"
            cost = f"{min(m[2] for m in made):.1f} s" if i == 0 else f"{1e3 * min(m[3] for m in made):.1f} ms a sample"
            yield [f"{case.name}{label}", r2, rms, nees, f"{values[:, 7].max():.2f}", cost]
        found = [one for _, one, _, _ in made]
        for name in found[0].factors:
            factors = [one.factors[name][0] for one in found]
            yield [f"... factor of the {name}", f"{min(factors):.4f} to {max(factors):.4f}", "", "", "", ""]
        sure = [offset for one in found for offset in one.offsets if offset.sure]
        for sensor in dict.fromkeys(offset.sensor for offset in sure):
            lags = [1e3 * offset.seconds for offset in sure if offset.sensor == sensor]
            least = min(offset.gain for offset in sure if offset.sensor == sensor)
            late = f"{min(lags):.2f} to {max(lags):.2f} ms late in {len(lags)} of {len(found)} flights"
            yield [f"... reported: {sensor}", f"{late}, gain {least:.0f} or more", "", "", "", ""]


def own_model_rows() -> Iterator[list[str]]:
    """Yield the mean normalised error squared, and the coverage of 95 %, on truths of the smoother's own model."""
    settings = RawSection(iterations=3, offset_error=0.0)
    for name in OWN_FLIGHTS:
        scenario = scenario_of(Case(name, name), 1)
        log, robot = simulate(scenario), believed_robot(scenario)
        record = part_of(raw_record(log.time, flight_channels(log, robot), robot, "measured", settings), 0, 1000)
        smoother = JointSmoother(robot, scenario.believed_air, FORCE_POINTS, settings)
        guess = first_guess(record)
        prior = first_prior(smoother.layout, guess, smoother.weight, settings)
        solved = smoother.solve(record, guess, prior, None)
        rngs = map(np.random.default_rng, range(DRAWS))
        drawn = [own_model_errors(solved.linear, prior, solved.tuning, rng) for rng in rngs]
        for kind in ("smoother", "filter"):
            nees = np.mean([one[f"{kind}_nees"] for one in drawn])
            covered = np.mean([np.abs(one[f"{kind}_z"]) < 1.96 for one in drawn])
            yield [f"{name}, {kind}", f"{nees:.3f}", f"{100 * covered:.1f} %"]


def mount_rows() -> Iterator[list[str]]:
    """Yield rows for an accelerometer that is exact, off, and off but calibrated."""
    frames, settings, off = FORCE_POINTS, RawSection(), {"place": [0.0, 0.0, 0.0], "turn_deg": [0.0, 0.0, 0.0]}
    place = ("sensors.accelerometer.place=[0.005,0,0]", "sensors.accelerometer.turn_deg=[0.5,0.5,0.5]")
    found: dict[str, list[list[float]]] = {"exact": [], "off": [], "off, calibrated": []}
    misses = []
    for seed in range(1, FREE_FLIGHTS + 1):
        records = []
        for forces in ((), ("unknown_force=[]", "flight.angular_velocity=[6,0,6]")):
            scenario = load_scenario("raw_sensors", [f"simulation.seed={seed}", *place, *forces])
            log, robot = simulate(scenario), believed_robot(scenario)
            exact = raw_record(log.time, flight_channels(log, robot), robot, "measured", settings)
            log.measured["accelerometer"].attrs.update(off)
            records.append((log, exact, raw_record(log.time, flight_channels(log, robot), robot, "measured", settings)))
        (log, exact, wrong), (_, _, free) = records
        air, truth = scenario.believed_air, true_forces(log)
        mount = find_mount([free], robot, air, frames, settings)
        true = exact.channels["accelerometer"]
        turn = np.degrees(pin.log3(true.turn.T @ mount.turn))
        spread = np.sqrt(np.diag(mount.covariance))
        misses.append([*(1e3 * (mount.place - true.place)), *(1e3 * spread[:3]), *turn, *np.degrees(spread[3:])])
        if seed not in SEEDS:
            continue
        smoother = JointSmoother(robot, air, frames, settings)
        for label, record in zip(found, (exact, wrong, mounted(wrong, mount)), strict=True):
            made = smoother.run(record)
            found[label].append(figures(made.force, made.force_covariance, truth, total=False))
    typical = np.sqrt(np.mean(np.square(misses), axis=0))
    cells = ["/".join(f"{value:.3f}" for value in typical[3 * i : 3 * i + 3]) for i in range(4)]
    for label, rows in found.items():
        r2 = "/".join(f"{value:.4f}" for value in np.min(rows, axis=0)[:3])
        yield [label, r2, *(cells if label == "off, calibrated" else [""] * 4)]


def memory_beyond(seconds: int) -> float:
    """Return the memory [MB] that this process needs at most to smooth so long a flight, beyond its log's."""
    scenario = load_scenario("raw_sensors", [f"simulation.duration={seconds}"])
    log, robot, settings = simulate(scenario), believed_robot(scenario), GIVEN.model_copy(update={"offset_error": 0.0})
    record = raw_record(log.time, flight_channels(log, robot), robot, "measured", settings)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    JointSmoother(robot, scenario.believed_air, FORCE_POINTS, settings).run(record)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0


def find() -> Values:
    """Return tables and costs; the least of three times that 2 s with given walks, no offsets sought, take."""
    given = min(measured(Case("given", raw=GIVEN), 1, causal=False)[2] for _ in range(3))
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:  # a process of its own for each flight
        short, long = (pool.apply(memory_beyond, (seconds,)) for seconds in (10, 60))
    errors = "error of place x/y/z [mm] | deviation | error of turn roll/pitch/yaw [deg] | deviation"
    values = {
        "flights": table("flight | R2 of Fx/Fy/Fz | rms error [mN] | NEES | deviation/error | cost", smoother_rows()),
        "own": table("flight | NEES | inside 1.96 deviations", own_model_rows()),
        "mount": table(f"paper, all | R2 of Fx/Fy/Fz | {errors}", mount_rows()),
        "given": f"{given:.1f}",
        "short": f"{short:.0f}",
        "long": f"{long:.0f}",
    }
    return {"docs/raw_sensors.md": values}


if __name__ == "__main__":
    run(find)
