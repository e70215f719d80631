"""Wrong arguments for everything public: a right call of each function, and values that do not belong there."""

from __future__ import annotations

import importlib
import inspect
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial, wraps
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import tomli_w

from aerobat_pin import aerodynamics, control, estimation, experiments, flight, linkage, observers, robot, scenario
from aerobat_pin.errors import AerobatError, ShapeError
from support import drone

DOORS = ("observers", "linkage", "aerodynamics", "scenario", "robot", "flight", "estimation", "control", "experiments")


class Stranger:
    """An object of no use to any function."""


WRONG: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "text": lambda: "text",
    "bytes": lambda: b"bytes",
    "object": Stranger,
    "complex number": lambda: 1j,
    "complex array": lambda: np.ones(3) * 1j,
    "texts": lambda: ["a", "b", "c"],
    "NaN": lambda: float("nan"),
    "infinity": lambda: float("inf"),
    "1e300": lambda: 1e300,
    "-1": lambda: -1.0,
    "NaN array": lambda: np.full(3, np.nan),
    "wrong shape": lambda: np.zeros((2, 1, 3, 5)),
    "ragged": lambda: [[1.0, 2.0], [3.0]],
    "empty": lambda: [],
    "dict": lambda: {"a": 1.0, 2: "b"},
    "True": lambda: True,
    "huge whole number": lambda: 10**5000,
}


@dataclass(frozen=True)
class Call:
    """A call that works: what is called, and its arguments by name."""

    function: Callable[..., Any]
    arguments: dict[str, Any]

    def __call__(self, **changed: Any) -> Any:
        """Call with some arguments replaced; a context manager is entered and left."""
        made = self.function(**{**self.arguments, **changed})
        if hasattr(made, "__enter__"):
            with made as made:
                pass
        if inspect.isgenerator(made):
            made = list(made)
        return made


def _stepped(plant: flight.Plant) -> Callable[..., Any]:
    """Return the first step of a flight that begins anew with every call."""

    @wraps(plant.step)
    def step(**arguments: Any) -> Any:
        plant.start()
        return plant.step(**arguments)

    return step


@cache
def calls() -> dict[str, Call]:
    """Return a call of every public function and of every method that a user calls."""
    folder = Path(tempfile.mkdtemp())
    short = ["simulation.duration=0.01", "air.strips=4", "air.warm_up_cycles=0", 'observers.names=["force_level"]']
    paper = scenario.load_scenario("paper", short)
    bat = robot.load_aerobat()
    model, q, v = bat.model, bat.q0, np.zeros(bat.model.nv)
    done = experiments.run(paper)
    log, estimate = done.log, done.estimates["force_level"]
    flight.write_csv(log, folder / "log.csv")
    log.save(folder / "log.nc")
    shown = robot.visual_model_with_bars(bat)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    line = aerodynamics.LiftingLine(1.0, 0.2, strips=4)
    air = flight.robot_air(bat.wing, paper.air)
    plant = flight.Plant(bat, paper)
    loop = scenario.load_scenario("hover_closed_loop", ["air.strips=4", "crank.frequency=0.0"])
    looped = robot.believed_robot(loop)
    sculpture, dynamics = linkage.KineticSculpture(), linkage.SculptureDynamics()
    closure = sculpture.solve(np.linspace(0.0, 6.0, 5))
    rng = np.random.default_rng(1)
    noise, edges = rng.standard_normal(4000), np.arange(4001) * 1e-3
    level = observers.calibrate_level(edges, noise, 0.3)
    cusum = observers.calibrate_cusum(edges, noise, 0.3, 0.5)
    action = observers.locate([0.0, 1.0, 1.0, 0.1, 0.0, 0.0], 1e-8 * np.eye(6))
    frame, tau, point = "left_force_point", np.zeros((1, model.nv)), bat.q0[:7]
    observer = observers.ForceLevelObserver(model, [frame], 300.0)
    kalman = observers.KalmanObserver(model, [frame], 300.0, known_error={"air": 0.1})
    record = {"time": [0.0, 1e-3], "q": np.array([q, q]), "v": np.array([v, v]), "tau": tau, "known": {"air": tau}}
    sample = {"time": 1e-3, "q": q, "v": v, "tau": tau[0], "known": {"air": tau[0]}}
    made = {"model": model, "applications": [frame], "gain": 300.0, "rows": "all"}
    blank = {"robot": bat, "scenario": paper, "log": log, "air": paper.air}
    rates = {
        "q": q,
        "v": v,
        "joints": np.zeros((3, 2)),
        "air": plant.initial.air,
        "held": np.zeros((2, 2)),
        "time": 0.0,
    }
    wings = np.zeros((1, 3, 2))
    stroke = aerodynamics.Stroke(3.0, 0.1)
    paper_force = paper.unknown_force[0]
    quick = ["unknown_force=[]", "simulation.dt=5e-3", "simulation.duration=0.2", "crank.frequency=20", *short[1:]]
    free_paper = scenario.load_scenario("paper", quick)
    free = {"robot": robot.believed_robot(free_paper), "air": free_paper.air, "torque": "measured"}
    free_flight = estimation.FreeFlight(name="free", log=flight.simulate(free_paper), **free)
    learnt = estimation.calibrate([free_flight], harmonics=1, parameters=["friction"])
    (folder / "calibration.nc").write_bytes(estimation.calibration_bytes(learnt))
    joints = {"q": np.outer(noise[:50], np.ones(2)), "v": np.ones((50, 2)), "a": np.ones((50, 2))}
    friction = observers.fit_friction(**joints, residual_torque=np.ones((50, 2)))
    found: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
        "run": (experiments.run, {"scenario": paper, "progress": None, "robots": (bat, bat)}),
        "run_recorded": (experiments.run_recorded, {"log": log, "belief": paper, "progress": None}),
        "simulate": (flight.simulate, {"scenario": paper, "progress": None, "drive": None, "robot": bat}),
        "FlightLog": (flight.FlightLog, {"measured": log.measured, "truth": log.truth}),
        "FlightLog.save": (log.save, {"path": folder / "again.nc"}),
        "FlightLog.load": (flight.FlightLog.load, {"path": folder / "log.nc"}),
        "load_aerobat": (robot.load_aerobat, {"morphology": "aerobat", "changes": {}, "gravity": 9.81}),
        "load_morphology": (robot.load_morphology, {"morphology": "aerobat", "changes": {}}),
        "Aerobat.with_changes": (bat.with_changes, {"changes": {}}),
        "Aerobat.configuration": (bat.configuration, {"placement": point, "theta_s": 0.1, "theta_e": 0.2}),
        "Aerobat.velocity": (bat.velocity, {"twist": np.zeros(6), "theta_s_dot": 0.1, "theta_e_dot": 0.2}),
        "load_scenario": (scenario.load_scenario, {"source": "paper", "settings": short}),
        "parse_scenario": (scenario.parse_scenario, {"values": paper.model_dump(exclude_none=True), "source": "here"}),
        "scenario_toml": (scenario.scenario_toml, {"scenario": paper}),
        "Application": (
            observers.Application,
            {"frame": frame, "kind": "force", "axes": "world", "direction": (0.0, 0.0, 1.0)},
        ),
        "SensorNoise": (observers.SensorNoise, {"linear_velocity": 0.1, "gyro": 0.1, "joint_rate": 0.1}),
        "SensorNoise.deviations": (observers.SensorNoise(0.1, 0.1, 0.1).deviations, {"model": model}),
        "Tie": (observers.Tie, {"name": "tie", "map": np.eye(model.nv)}),
        "tie_joints": (
            observers.tie_joints,
            {"model": model, "pairs": {"left_elbow": "right_elbow"}, "name": "elbows"},
        ),
        **{f"{kind.__name__}": (kind, made) for kind in (*observers.OBSERVERS.values(),)},
        "KalmanObserver ": (
            observers.KalmanObserver,
            {
                **made,
                "sensor_noise": (0.1, 0.1, 0.1),
                "force_walk": 1.0,
                "prior": 1.0,
                "known_error": {"air": 0.1},
                "mass_error": 0.1,
                "error_time": 1.0,
                "misfit": 0.1,
                "frequency": 5.0,
            },
        ),
        "SuperTwistingObserver ": (observers.SuperTwistingObserver, {**made, "slope": 1.0}),
        "Observer.reset": (observer.reset, {"q": q, "v": v, "time": 0.0}),
        "Observer.update": (_streamed(observer, q, v), sample),
        "KalmanObserver.update": (_streamed(kalman, q, v), sample),
        "Observer.run": (observer.run, record),
        "KalmanObserver.run": (kalman.run, record),
        "SmootherObserver.run": (observers.SmootherObserver(model, [frame], 300.0).run, record),
        "Estimate.component": (estimate.component, {"label": f"{frame}.Fx"}),
        "Bias.remove": (observers.bias_of(noise).remove, {"values": noise}),
        "bias_of": (observers.bias_of, {"free": noise}),
        "calibrate_level": (
            observers.calibrate_level,
            {"time": edges, "free": noise, "false_alarms": 0.3, "delay": 0.01},
        ),
        "calibrate_cusum": (
            observers.calibrate_cusum,
            {"time": edges, "free": noise, "false_alarms": 0.3, "drift": 0.5, "delay": 0.01},
        ),
        **{
            f"{type(one).__name__}.{name}": (getattr(one, name), {"time": edges, "values": noise})
            for one in (level, cusum)
            for name in ("detect", "statistic")
        },
        "LevelDetector.latency": (level.latency, {"step": 10.0}),
        "CusumDetector.latency": (cusum.latency, {"step": 10.0}),
        "predict": (
            observers.predict,
            {"observer": observer, "q": q, "dt": 1e-3, "noise": observers.SensorNoise(0.1, 0.1, 0.1)},
        ),
        "gain_for_lag": (observers.gain_for_lag, {"observer": observer, "dt": 1e-3, "lag": 0.01}),
        "gain_for_deviation": (
            observers.gain_for_deviation,
            {
                "observer": observer,
                "q": q,
                "dt": 1e-3,
                "noise": observers.SensorNoise(0.1, 0.1, 0.1),
                "label": f"{frame}.Fx",
                "deviation": 1.0,
            },
        ),
        "locate": (observers.locate, {"wrench": action.wrench, "covariance": 1e-8 * np.eye(6)}),
        "locate_series": (
            observers.locate_series,
            {"wrenches": rng.standard_normal((50, 6)), "covariance": 1e-8 * np.eye(6)},
        ),
        "LineOfAction.cross": (action.cross, {"outline": [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]}),
        "LineOfAction.seen_from": (action.seen_from, {"placement": pin.SE3.Identity()}),
        "KineticSculpture": (linkage.KineticSculpture, {"lengths": sculpture.lengths}),
        "KineticSculpture.solve": (
            sculpture.solve,
            {"crank_angle": 0.1, "crank_velocity": 1.0, "crank_acceleration": 1.0},
        ),
        "KineticSculpture.sensitivity": (sculpture.sensitivity, {"crank_angle": 0.1}),
        "SculptureDynamics": (linkage.SculptureDynamics, {"lengths": sculpture.lengths, "stabilisation": 1.0}),
        "SculptureDynamics.state": (dynamics.state, {"crank_angle": 0.1, "crank_velocity": 1.0}),
        **{
            f"SculptureDynamics.{name}": (getattr(dynamics, name), {"x": dynamics.state(0.1, 1.0)})
            for name in ("f_k", "g_k", "gap")
        },
        "Closure.crank_torque": (closure.crank_torque, {"shoulder_torque": 0.1, "elbow_torque": 0.2}),
        "Closure.joint_torques": (closure.joint_torques, {"crank_torque": 0.2}),
        "Gust": (aerodynamics.Gust, {"amplitude": (0.0, 0.0, 1.0), "start": 0.1, "duration": 1.0}),
        "Wind": (aerodynamics.Wind, {"velocity": (0.0, 0.0, 1.0), "gust": None}),
        "Wind.field": (aerodynamics.Wind().field, {"time": edges}),
        "Wind.drift": (aerodynamics.Wind().drift, {"time": edges}),
        "Stroke": (aerodynamics.Stroke, dict.fromkeys(["airspeed", "incidence", "frequency", "plunge", "flap"], 0.1)),
        "Stroke.__call__": (stroke.__call__, {"time": 0.1}),
        "fly": (aerodynamics.fly, {"line": line, "motion": stroke, "time": [0.0, 0.01], "added_mass": 1.0}),
        "LiftingLine": (
            aerodynamics.LiftingLine,
            {
                "span": 1.0,
                "chord": 0.1,
                "quarter_chord": 0.1,
                "strips": 4,
                "lift_slope": 6.0,
                "air_density": 1.2,
            },
        ),
        "LiftingLine.frequency_response": (
            line.frequency_response,
            {"frequency": 1.0, "airspeed": 1.0, "normal_velocity": 1.0},
        ),
        "LiftingLine.step_response": (
            line.step_response,
            {"time": [0.0, 0.1], "airspeed": 1.0, "normal_velocity": 1.0},
        ),
        "LiftingLine.state_space": (line.state_space, {"airspeed": 1.0}),
        "LiftingLine.steady_circulation": (line.steady_circulation, {"normal_velocity": 1.0}),
        "LiftingLine.steady_coefficients": (line.steady_coefficients, {"incidence": 0.1}),
        "RobotAir": (
            aerodynamics.RobotAir,
            {
                "wing": bat.wing,
                "strips": 4,
                "air_density": 1.2,
                "model": "lifting_line",
                "lift_limit": 1.0,
                "added_mass": 1.0,
            },
        ),
        "RobotAir.airspeed": (air.airspeed, {"twists": np.zeros((1, 5, 6))}),
        "RobotInAir": (aerodynamics.RobotInAir, {"robot": bat, "air": air}),
        "RobotInAir.link_twists": (plant.in_air.link_twists, {"q": q[None], "v": v[None]}),
        "RobotInAir.flapping_twists": (
            plant.in_air.flapping_twists,
            {"placement": point, "twist": np.zeros(6), "motion": wings},
        ),
        "RobotInAir.warmed_up": (
            plant.in_air.warmed_up,
            {"placement": point, "twist": np.zeros(6), "motion": np.zeros((3, 3, 2)), "dt": 1e-3},
        ),
        "strips_of": (aerodynamics.strips_of, {"loads": np.zeros((9, 4))}),
        "TextTable": (
            scenario.TextTable,
            {"path": folder / "log.csv", "what": "log", "error": AerobatError},
        ),
        "RecordedForce.interval_means": (
            paper_force.interval_means,
            {"edges": np.array([0.0, 0.1]), "rng": np.random.default_rng(1)},
        ),
        "assign": (partial(scenario.assign, {"a": 1}), {"key": "a", "value": 1, "source": "here"}),
        "with_settings": (scenario.with_settings, {"values": {"a": 1}, "settings": ["a=2"]}),
        "explain_plainly": (
            scenario.explain_plainly,
            {"error": {"type": "missing"}, "where": "a", "known": ["a"]},
        ),
        "read_toml": (
            scenario.read_toml,
            {"kind": "scenario", "source": "paper", "shipped": SHIPPED, "error": AerobatError},
        ),
        "shipped_names": (scenario.shipped_names, {"folder": folder}),
        "Wing": (robot.Wing, {"morphology": bat.morphology}),
        "Wing.attach": (bat.wing.attach, {"y": [0.1]}),
        "Wing.chord": (bat.wing.chord, {"y": [0.1]}),
        "Wing.leading_edge": (bat.wing.leading_edge, {"y": [0.1]}),
        "Wing.outline": (bat.wing.outline, {"link": "left_distal"}),
        "load_robot": (robot.load_robot, {"scenario": paper}),
        "believed_robot": (robot.believed_robot, {"scenario": paper}),
        "euler_angles": (robot.euler_angles, {"q": q[None]}),
        "rotations": (robot.rotations, {"q": q[None]}),
        "world_velocity": (robot.world_velocity, {"q": q[None], "v": v[None]}),
        "external_forces": (robot.external_forces, {"model": model, "wrenches": [(1, pin.Force.Zero())]}),
        "joint_table": (robot.joint_table, {"closure": closure}),
        "joint_wrench": (
            robot.joint_wrench,
            {
                "model": model,
                "data": data,
                "frame": frame,
                "wrench": np.zeros(6),
                "reference_frame": pin.ReferenceFrame.LOCAL,
            },
        ),
        "closed_model": (robot.closed_model, {"morphology": "aerobat", "bars": "light", "gravity": 9.81}),
        "closed_state": (
            robot.closed_state,
            {"model": robot.closed_model()[0], "linkage": sculpture, "crank_angle": 0.1, "crank_velocity": 1.0},
        ),
        "place_bars": (robot.place_bars, {"robot": bat, "picture": shown, "crank_angle": 0.1}),
        "visual_model_with_bars": (robot.visual_model_with_bars, {"robot": bat}),
        "tree_of": (robot.tree_of, {"model": model}),
        "ConstantRate": (flight.ConstantRate, {"start": 0.1, "rate": 1.0}),
        "ConstantRate.__call__": (flight.ConstantRate(0.1, 1.0).__call__, {"time": edges}),
        "SpinUp": (flight.SpinUp, {"start": 0.1, "rate": 1.0, "duration": 1.0}),
        "SpinUp.__call__": (flight.SpinUp(0.1, 1.0, 1.0).__call__, {"time": edges}),
        "Plant": (flight.Plant, {"robot": bat, "scenario": paper, "drive": flight.ConstantRate(0.1, 1.0)}),
        "Plant.closure": (plant.closure, {"time": edges[:3]}),
        "Plant.wind": (plant.wind, {"time": edges[:3]}),
        "thrusters_of": (flight.thrusters_of, {"morphology": looped.morphology}),
        "AirStream": (estimation.AirStream, {"robot": bat, "air": paper.air, "dt": 1e-3}),
        "Controller": (control.Controller, {"scenario": loop, "robot": looped}),
        "nominal_flight": (control.nominal_flight, {"scenario": loop, "robot": looped}),
        "loop_margins": (control.loop_margins, {"scenario": loop}),
        "course_rms": (control.course_rms, {"scenario": loop, "log": log}),
        "Plant.start": (plant.start, {"held": np.zeros((2, 2, 3)), "dt": 1e-3, "start": None, "endless": False}),
        "Plant.step": (_stepped(plant), {"command": np.zeros(6), "crank_rate": None}),
        "Plant.rates": (plant.rates, rates),
        "Plant.fly": (plant.fly, {"count": 2, "dt": 1e-3, "held": np.zeros((2, 2, 2)), "progress": None}),
        "Wake.mean_trailing": (
            flight.Wake(edges[:2], np.zeros((2, 4, 3)), np.zeros((2, 4)), aerodynamics.Wind()).mean_trailing,
            {"start": 0.0, "end": 1.0},
        ),
        "find_trim": (flight.find_trim, {"scenario": paper}),
        "interval_means": (flight.interval_means, {"forces": plant.forces, "edges": edges[:3], "seed": 1}),
        "read_csv": (flight.read_csv, {"path": folder / "log.csv"}),
        "write_csv": (flight.write_csv, {"log": log, "path": folder / "again.csv"}),
        "robot_air": (flight.robot_air, {"wing": bat.wing, "air": paper.air}),
        "wind_of": (flight.wind_of, {"air": paper.air}),
        "wake_of": (flight.wake_of, {"log": log, "robot": bat, "air": paper.air}),
        "belief_about": (
            estimation.belief_about,
            {"log": log, "name": "log", "morphology": "aerobat", "names": ["momentum"], "settings": []},
        ),
        "FreeFlight": (estimation.FreeFlight, {"name": "free", "log": log, **free}),
        "calibrate": (
            estimation.calibrate,
            {"flights": [free_flight], "harmonics": 1, "vary": ["speed"], "parameters": [], "progress": None},
        ),
        "calibration_bytes": (estimation.calibration_bytes, {"calibration": learnt}),
        "read_calibration": (estimation.read_calibration, {"path": folder / "calibration.nc"}),
        "JointFriction": (
            observers.JointFriction,
            {name: np.zeros(2) for name in ("coulomb", "viscous", "inertia", "offset")} | {"rate": 0.02},
        ),
        "JointFriction.torque": (friction.torque, {"v": joints["v"], "a": joints["a"]}),
        "fit_friction": (observers.fit_friction, {**joints, "residual_torque": np.ones((50, 2)), "rate": 0.02}),
        "check_names": (estimation.check_names, {"names": ["momentum"]}),
        "describe_belief": (estimation.describe_belief, {"belief": paper, "morphology": "aerobat", "settings": []}),
        "estimate_log": (estimation.estimate_log, {"log": log, "robot": bat, "belief": paper, "progress": None}),
        "flight_summary": (estimation.flight_summary, {"log": log, "mass": 0.04}),
        "known_inputs": (
            estimation.known_inputs,
            {"log": log, "robot": bat, "torque": "measured", "air": paper.air},
        ),
        "motion": (estimation.motion, {"log": log, "robot": bat, "air": blank["air"]}),
        "point_label": (estimation.point_label, {"frame": frame}),
        "r_squared": (estimation.r_squared, {"estimate": noise, "truth": noise}),
        "read_log": (estimation.read_log, {"path": folder / "log.csv"}),
        "self_check": (estimation.self_check, {"robot": bat, "belief": paper}),
        "true_events": (estimation.true_events, {"log": log}),
        "true_force": (estimation.true_force, {"log": log, "frame": frame}),
        "estimate_dataset": (experiments.estimate_dataset, {"estimates": done.estimates}),
        "flight_note": (experiments.flight_note, {"scenario": paper, "robot": bat, "log": log}),
        "recorded_note": (experiments.recorded_note, {"log": log, "robot": bat}),
        "load_sweep": (experiments.load_sweep, {"source": next(iter(experiments.shipped_sweeps()))}),
        "write": (experiments.write, {"experiment": done, "folder": folder}),
        **_recordings(folder, model, log, done),
    }
    return {name: Call(*pair) for name, pair in found.items()}


def _recordings(
    folder: Path, model: pin.Model, log: Any, done: Any
) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Return calls of what reads recordings of any robot: a second of a quadrotor."""
    drone.flight(1.5).to_csv(folder / "drone.csv", index=False)
    values: dict[str, Any] = {key: part for key, part in drone.MAP.items() if key not in ("known", "check")}
    read = estimation.parse_map(values, "here")
    (folder / "map.toml").write_text(tomli_w.dumps(values))
    found = estimation.estimate_recording(folder / "drone.csv", read, folder)
    data = experiments.estimate_dataset(done.estimates)
    fitted = estimation.parse_map(drone.MAP, "here")
    learnt = estimation.calibrate_recording(folder / "drone.csv", fitted, folder)
    (folder / "drone.nc").write_bytes(estimation.map_calibration_bytes(learnt))
    return {
        "calibrate_recording": (
            estimation.calibrate_recording,
            {"log": folder / "drone.csv", "chosen": fitted, "folder": folder, "identify": [], "trust": False},
        ),
        "map_calibration_bytes": (estimation.map_calibration_bytes, {"calibration": learnt}),
        "read_map_calibration": (estimation.read_map_calibration, {"path": folder / "drone.nc"}),
        "parse_map": (estimation.parse_map, {"values": values, "source": "here"}),
        "load_map": (estimation.load_map, {"path": folder / "map.toml"}),
        "with_options": (
            estimation.with_options,
            {"chosen": read, "urdf": None, "points": ["body"], "observers": ["momentum"]},
        ),
        "estimate_recording": (
            estimation.estimate_recording,
            {"log": folder / "drone.csv", "chosen": read, "folder": folder, "progress": None, "trust": False}
            | {"calibration": None},
        ),
        "suggested_map": (estimation.suggested_map, {"log": folder / "drone.csv", "urdf": None}),
        "OnlineEstimator": (
            estimation.OnlineEstimator,
            {"chosen": read, "folder": folder, "heard": None, "calibration": None},
        ),
        "write_mcap": (estimation.write_mcap, {"found": found, "path": folder / "drone.mcap"}),
        "write_flight_mcap": (
            estimation.write_flight_mcap,
            {"model": model, "log": log, "estimates": data, "path": folder / "bat.mcap"},
        ),
    }


def _streamed(observer: Any, q: Any, v: Any) -> Callable[..., Any]:
    """Return `update` as the second sample of a new stream."""

    @wraps(observer.update)
    def update(**sample: Any) -> Any:
        observer.reset(q, v)
        return observer.update(**sample)

    return update


SHIPPED = Path(inspect.getfile(scenario)).with_name("shipped")


RESULTS = """Belief Calibration CalibrationUse MapCalibration
Bias Crossing Estimate Event Identifiability KalmanSample LevelDetector CusumDetector LineOfAction
PointOfAction Prediction Sample Closure Sensitivity Halves LineFlight RobotMemory StateSpace StripLoads Trim Wake Tree
FlightSummary KnownInputs ObserverScores Score Experiment Aerobat Observer
Redundancy JointFriction OnlineSample Result StoredEstimate Compared LogChannel StoredVariable
LoopRecord ThrusterSet Nominal Margins ControlSummary Innovation TrueEvent"""  # made by other functions
TABLES = """AirSection ControlSection ThrustersSection Map Section RecordedForce RobotSection Scenario SensorSection
SensorsSection UnknownForce InertialSection MotionCaptureSection RawSection SampledSection"""  # pydantic checks
MEMORY = "air_memory fill channel Pieces RateControlledMotor"  # fields of kernels, and a channel of a log
HOT = "prescribed_joint_dynamics"  # called for every sample
NOTHING = "closed_settings describe_map describe_scenario shipped_scenarios shipped_sweeps"  # no arguments
LONG = "run_sweep"  # starts processes; its sweep comes from load_sweep
# Called by other rooms, with what these have checked.
INNER = """seal_netcdf netcdf_bytes read_netcdf netcdf_variables read_run contradictions joint_series
moving_weight AllBut redundancy_of slow_part describe_tables explain fit_friction ClosedLoop
LaggedThrust Sensing Allocation DisturbanceObserver TrueDisturbance control_summary SeriesSculpture changed_keys
changes_text differing_keys keys_text described log_with_motion shipped_description"""
PROTOCOLS = "Pilot Disturbance AerobatEnv"  # what others write, and what gymnasium's checker checks
EXCLUDED = frozenset(f"{PROTOCOLS} {RESULTS} {TABLES} {MEMORY} {HOT} {NOTHING} {LONG} {INNER}".split())
HARMLESS = ("empty", "-1", "wrong shape")  # where an array of any shape or sign is allowed


def fault(name: str, argument: str, kind: str) -> str:
    """Call a function with one wrong argument; return what is wrong with its answer, or nothing.

    Right answers are an AerobatError that names the argument or the value, and a result if the value is allowed.
    """
    call, value = calls()[name], WRONG[kind]()
    label = f"{name}({argument}={kind})"
    try:
        call(**{argument: value})
    except AerobatError as error:
        others = call.arguments if isinstance(error, ShapeError) else ()
        known = any(word in str(error) for word in (argument, *others, *NAMED.get(kind, ())))
        return "" if known else f"{label} does not name it: {error}"
    except Exception as error:
        return f"{label} raises {type(error).__name__}: {error}"
    annotation = str(inspect.signature(call.function).parameters[argument].annotation)
    allowed = kind in HARMLESS or any(word in annotation for word in ("Any", *ALLOWED.get(kind, ())))
    return "" if allowed or (kind == "True" and argument == "time") else f"{label} is accepted"


NAMED = {"text": ("text",), "texts": ("'a'", "--set a")}
ALLOWED = {"None": ("None",), "text": ("str", "Path"), "texts": ("Sequence[str]", "Iterable[str]"), "True": ("bool",)}


def api_case(rng: np.random.Generator) -> tuple[str, str]:
    """Draw one wrong argument of one public function, and call it.

    Returns:
        The label of the case, and what is wrong with the answer: nothing if the case is refused as it should be.
    """
    name = str(rng.choice(list(calls())))
    argument = str(rng.choice(list(calls()[name].arguments)))
    kind = str(rng.choice(list(WRONG)))
    return f"{name}({argument}={kind})", fault(name, argument, kind)


def public_callables() -> Iterator[str]:
    """Yield the names of functions and classes that the doors export."""
    for door in DOORS:
        module = importlib.import_module(f"aerobat_pin.{door}")
        for name in module.__all__:
            if inspect.isfunction(getattr(module, name)) or inspect.isclass(getattr(module, name)):
                yield name
