"""Wrong arguments for everything public: a right call of each function, and values that do not belong there."""

import importlib
import inspect
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial, wraps
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import tomli_w
import xarray as xr

from aerobat_pin import scenario
from aerobat_pin.errors import AerobatError, ShapeError
from support import drone

DOORS = tuple("observers linkage aerodynamics scenario aerobat flight estimation control experiments".split())


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


def _anew(begin: Callable[[], object], method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method whose every call is the first after a new beginning."""

    @wraps(method)
    def first(**arguments: Any) -> Any:
        begin()
        return method(**arguments)

    return first


@cache
def calls() -> dict[str, Call]:
    """Return a call of every public function and of every method that a user calls."""
    api, folder = SimpleNamespace(**exported("records", "forces", *DOORS)), Path(tempfile.mkdtemp())
    short = ["simulation.duration=0.01", "air.strips=4", "air.warm_up_cycles=0", 'observers.names=["force_level"]']
    paper = api.load_scenario("paper", short)
    bat = api.load_aerobat()
    model, q, v = bat.model, bat.q0, np.zeros(bat.model.nv)
    done = api.run(paper)
    log, estimate = done.log, done.estimates["force_level"]
    api.write_csv(log, folder / "log.csv")
    log.save(folder / "log.nc")
    shown = api.visual_model_with_bars(bat)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    line = api.LiftingLine(1.0, 0.2, strips=4)
    air = api.robot_air(bat.wing, paper.air)
    plant = api.Plant(bat, paper)
    loop = api.load_scenario("hover_closed_loop", ["air.strips=4", "crank.frequency=0.0"])
    looped = api.believed_robot(loop)
    loop_robot = {"scenario": loop, "robot": looped}
    sculpture, dynamics = api.KineticSculpture(), api.SculptureDynamics()
    closure = sculpture.solve(np.linspace(0.0, 6.0, 5))
    rng = np.random.default_rng(1)
    noise, edges = rng.standard_normal(4000), np.arange(4001) * 1e-3
    level = api.calibrate_level(edges, noise, 0.3)
    cusum = api.calibrate_cusum(edges, noise, 0.3, 0.5)
    action = api.locate([0.0, 1.0, 1.0, 0.1, 0.0, 0.0], 1e-8 * np.eye(6))
    frame, tau = "left_force_point", np.zeros((1, model.nv))
    observer = api.ForceLevelObserver(model, [frame], 300.0)
    kalman = api.KalmanObserver(model, [frame], 300.0, known_error={"air": 0.1})
    smoother = api.SmootherObserver(model, [frame], 300.0)
    record = {"time": [0.0, 1e-3], "q": np.array([q, q]), "v": np.array([v, v]), "tau": tau, "known": {"air": tau}}
    sample = {"time": 1e-3, "q": q, "v": v, "tau": tau[0], "known": {"air": tau[0]}}
    zeros = np.zeros((2, 4, 3))
    stroke, still = api.Stroke(3.0, 0.1), api.Wind()
    steady, spun, wake = api.ConstantRate(0.1, 1.0), api.SpinUp(0.1, 1.0, 1.0), zeros[:, :, 0]
    blank = {"robot": bat, "scenario": paper, "log": log, "air": paper.air}
    quick = ["unknown_force=[]", "simulation.dt=5e-3", "simulation.duration=0.2", "crank.frequency=20", *short[1:]]
    free_paper = api.load_scenario("paper", quick)
    free = {"robot": api.AerobatRobot.of(api.believed_robot(free_paper), free_paper.air), "section": None}
    free_log = api.simulate(free_paper)
    free_flight = api.free_record(free_log, **free)
    swept = {"gain": [1.0, 2.0], "observer": ["momentum"]}
    grid = xr.Dataset({"rmse": ((*swept, "point", "axis"), np.ones((2, 1, 1, 3))), "failed": ("gain", ["", ""])}, swept)
    learnt = api.calibrate([free_flight], harmonics=1, parameters=["friction"])
    (folder / "calibration.nc").write_bytes(api.calibration_bytes(learnt))
    joints = {"q": np.outer(noise[:50], np.ones(2)), "v": np.ones((50, 2)), "a": np.ones((50, 2))}
    friction = api.fit_friction(**joints, residual_torque=np.ones((50, 2)))
    good: dict[str, Any] = {  # what an argument of this name may be, unless `own` says otherwise
        **{**blank, "belief": paper, "progress": None, "robots": (bat, bat), "drive": None, "folder": folder},
        **{"morphology": "aerobat", "changes": {}, "gravity": 9.81, "bars": "light", "wing": bat.wing, "y": [0.1]},
        **{"model": model, "data": data, "q": q, "v": v, "frame": frame, "label": f"{frame}.Fx", "dt": 1e-3, "seed": 1},
        **{"placement": q[:7], "twist": np.zeros(6), "theta_s": 0.1, "theta_e": 0.2, "twists": np.zeros((1, 5, 6))},
        **{"theta_s_dot": 0.1, "theta_e_dot": 0.2, "shoulder_torque": 0.1, "elbow_torque": 0.2, "crank_torque": 0.2},
        **{"path": folder / "log.csv", "error": AerobatError, "what": "log", "source": "here", "settings": short},
        **{"kind": "force", "axes": "world", "direction": (0.0, 0.0, 1.0), "map": np.eye(model.nv)},
        **{"linear_velocity": 0.1, "gyro": 0.1, "joint_rate": 0.1, "noise": api.SensorNoise(0.1, 0.1, 0.1)},
        **{"applications": [frame], "gain": 300.0, "rows": "all", "slope": 1.0, "observer": observer, "lag": 0.01},
        **{"sensor_noise": (0.1, 0.1, 0.1), "force_walk": 1.0, "prior": 1.0, "known_error": {"air": 0.1}},
        **{"mass_error": 0.1, "error_time": 1.0, "misfit": 0.1, "frequency": 1.0, "deviation": 1.0, "step": 10.0},
        **{"time": edges, "values": noise, "free": noise, "false_alarms": 0.3, "drift": 0.5, "delay": 0.01},
        **{"wrench": action.wrench, "covariance": 1e-8 * np.eye(6), "lengths": sculpture.lengths},
        **{"linkage": sculpture, "crank_angle": 0.1, "crank_velocity": 1.0, "crank_acceleration": 1.0},
        **{"stabilisation": 1.0, "x": dynamics.state(0.1, 1.0), "line": line, "incidence": 0.1, "plunge": 0.1},
        **{"span": 1.0, "chord": 0.1, "quarter_chord": 0.1, "strips": 4, "lift_slope": 6.0, "air_density": 1.2},
        **{"airspeed": 0.1, "normal_velocity": 1.0, "flap": 0.1, "added_mass": 1.0, "lift_limit": 1.0, "gust": None},
        **{"start": 0.1, "rate": 1.0, "duration": 1.0, "velocity": (0.0, 0.0, 1.0), "edges": edges[:3]},
        **{"measured": log.measured, "truth": log.truth, "picture": shown, "closure": closure, "link": "left_distal"},
    }
    own: dict[str, dict[str, Any]] = {  # arguments of these functions alone; those of inner rooms are not public here
        "load_scenario": {"source": "paper"},
        "parse_scenario": {"values": paper.model_dump(exclude_none=True)},
        "Tie": {"name": "tie"},
        "tie_joints": {"pairs": {"left_elbow": "right_elbow"}},
        "locate_series": {"wrenches": rng.standard_normal((50, 6))},
        "Gust": {"amplitude": (0.0, 0.0, 1.0)},
        "Tones": {name: np.ones((2, 3)) for name in ("amplitude", "rate", "phase")},
        "dryden": {"deviation": (0.1, 0.1, 0.1), "length": 1.0, "airspeed": 3.0},
        "Wind": {"tones": ()},
        "fly": {"motion": stroke, "time": [0.0, 0.01]},
        "RobotAir": {"model": "lifting_line"},
        "RobotInAir": {"air": air},
        "strips_of": {"loads": np.zeros((9, 4))},
        "with_settings": {"values": {"a": 1}, "settings": ["a=2"]},
        "explain_plainly": {"error": {"type": "missing"}, "where": "a", "known": ["a"]},
        "read_toml": {"kind": "scenario", "source": "paper", "shipped": SHIPPED},
        "Wing": {"morphology": bat.morphology},
        **{name: {"q": q[None], "v": v[None]} for name in ("euler_angles", "rotations", "world_velocity")},
        "external_forces": {"wrenches": [(1, pin.Force.Zero())]},
        "joint_wrench": {"reference_frame": pin.ReferenceFrame.LOCAL},
        "closed_state": {"model": api.closed_model()[0]},
        "Plant": {"drive": steady},
        "thrusters_of": {"morphology": looped.morphology},
        **{
            name: loop_robot
            for name in ("Controller", "nominal_flight", "loop_margins", "wrong_plant_ms", "course_rms")
        },
        "interval_means": {"forces": plant.forces},
        "write_csv": {"path": folder / "again.csv"},
        "load_sweep": {"source": next(iter(api.shipped_sweeps()))},
        "write": {"experiment": done},
        "beside_pd": {"experiment": done},
        "sweep_effects": {"grid": grid},
        "effects_text": {"effects": api.sweep_effects(grid)},
        "estimate_dataset": {"estimates": done.estimates},
        "force_columns": {"estimate": estimate},
        "belief_about": {"name": "log", "names": ["momentum"], "settings": []},
        "free_record": {"log": free_log, **free},
        "calibrate": {"records": [free_flight], "harmonics": 1, "parameters": [], "trust": False},
        "calibration_bytes": {"calibration": learnt},
        "read_calibration": {"path": folder / "calibration.nc"},
        "Expected": {**dict.fromkeys(("row_error", "stiction", "stiction_rate"), np.ones(2)), "force": np.ones(3)}
        | {"doubt": 1.0},
        "fit_friction": {**joints, "residual_torque": np.ones((50, 2)), "rate": 0.02},
        "check_names": {"names": ["momentum"]},
        "describe_belief": {"settings": []},
        "flight_summary": {"mass": 0.04},
        "LiveFlight": {"scenario": loop},
        "LiveRobot": {"name": "double_pendulum", "points": ()},
        "known_inputs": {"torque": "measured"},
        "point_label": {},
        "r_squared": {"estimate": noise, "truth": noise},
        **_recordings(api, folder, done),
    }
    methods: list[tuple[Callable[..., Any], dict[str, Any]]] = [
        (log.save, {"path": folder / "again.nc"}),
        (api.FlightLog.load, {"path": folder / "log.nc"}),
        *((method, {}) for method in (bat.with_changes, bat.configuration, bat.velocity)),
        (good["noise"].deviations, {}),
        (observer.reset, {"time": 0.0}),
        (kalman.trust_model, {"misfit": 0.1}),
        *((_anew(partial(one.reset, q, v), one.update), sample) for one in (observer, kalman)),
        *((one.run, record) for one in (observer, kalman, smoother)),
        (estimate.component, {}),
        (friction.torque, {"v": joints["v"], "a": joints["a"]}),
        (api.bias_of(noise).remove, {}),
        *((method, {}) for one in (level, cusum) for method in (one.detect, one.statistic, one.latency)),
        (action.cross, {"outline": [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]}),
        (action.seen_from, {"placement": pin.SE3.Identity()}),
        *((method, {}) for method in (sculpture.solve, sculpture.sensitivity, closure.crank_torque)),
        *((method, {}) for method in (closure.joint_torques, dynamics.state, dynamics.f_k, dynamics.g_k, dynamics.gap)),
        *((method, {}) for method in (still.field, still.drift, steady.__call__, spun.__call__)),
        (stroke.__call__, {"time": 0.1}),
        (line.step_response, {"time": [0.0, 0.1]}),
        *((method, {}) for method in (line.frequency_response, line.state_space, line.steady_circulation)),
        *((method, {}) for method in (line.steady_coefficients, air.airspeed)),
        (plant.in_air.link_twists, {"q": q[None], "v": v[None]}),
        (plant.in_air.flapping_twists, {"motion": zeros[:1, :3, :2]}),
        (plant.in_air.warmed_up, {"motion": np.zeros((3, 3, 2))}),
        (paper.unknown_force[0].interval_means, {"edges": edges[:2], "rng": np.random.default_rng(1)}),
        *((method, {}) for method in (bat.wing.attach, bat.wing.chord, bat.wing.leading_edge, bat.wing.outline)),
        *((method, {"time": edges[:3]}) for method in (plant.closure, plant.wind)),
        (plant.start, {"step_means": np.zeros((2, 2, 3)), "start": None, "endless": False}),
        (_anew(plant.start, plant.step), {"command": np.zeros(6), "crank_rate": None}),
        (plant.rates, {"joints": np.zeros((3, 2)), "air": plant.initial.air, "held": np.zeros((2, 2)), "time": 0.0}),
        (plant.fly, {"count": 2, "step_means": np.zeros((2, 2, 2)), "start": None}),
        (api.Wake(edges[:2], zeros, wake, still).mean_trailing, {"start": 0.0, "end": 1.0}),
    ]
    calls = {
        "assign": Call(partial(api.assign, {"a": 1}), {"key": "a", "value": 1, "source": "here"}),
        "JointFriction": Call(
            api.JointFriction, {**dict.fromkeys(api.FRICTION_COEFFICIENTS, np.zeros(2)), "rate": 0.02}
        ),
    }
    for name in [*own, *public_callables()]:
        if name not in calls and (name in own or name not in EXCLUDED):
            calls[name] = _call(getattr(api, name), good, own.get(name, {}))
    for method, mine in methods:
        made = _call(method, good, mine)
        name = method.__qualname__
        calls[name if name not in calls else f"{name} of {len(calls)}"] = made
    return calls


def _call(function: Callable[..., Any], good: dict[str, Any], own: dict[str, Any]) -> Call:
    """Return the call of a function with its own arguments, and with a good value for every other that has one."""
    names = inspect.signature(function).parameters
    return Call(function, {name: own.get(name, good.get(name)) for name in names if name in own or name in good})


def _recordings(api: Any, folder: Path, done: Any) -> dict[str, dict[str, Any]]:
    """Return arguments of what reads recordings of any robot: a second of a quadrotor."""
    log = folder / "drone.csv"
    drone.flight(1.5).to_csv(log, index=False)
    values: dict[str, Any] = {key: part for key, part in drone.MAP.items() if key not in ("known", "check")}
    read = api.parse_map(values, "here")
    (folder / "map.toml").write_text(tomli_w.dumps(values))
    record = api.open_record(log, read, folder)
    return {
        "load_robot": {"name": "double_pendulum"},
        "parse_map": {"values": values},
        "load_map": {"path": folder / "map.toml"},
        "with_options": {"chosen": read, "said": None, "points": ["body"], "observers": ["momentum"]},
        "open_record": {"path": folder / "log.nc", "robot": None},
        "open_by_map": {"path": log, "chosen": read, "robot": None},
        "estimate": {"record": record, "observers": ["momentum"], "calibration": None, "trust": False},
        "stream_of": {"record": record},
        "check_record": {"record": record},
        "suggested_map": {"log": log, "robot": None},
        "OnlineEstimator": {"chosen": read, "heard": None, "calibration": None, "wait": 0.0, "expected": None}
        | {"values": None},
        "LiveRecording": {"log": log, "chosen": read},
        "check_mcap_file": {"path": folder / "new.mcap", "force": False},
        "write_mcap": {"result": api.estimate(record), "path": folder / "drone.mcap"},
        "write_flight_mcap": {"estimates": api.estimate_dataset(done.estimates), "path": folder / "bat.mcap"},
    }


SHIPPED = Path(inspect.getfile(scenario)).with_name("shipped")


RESULTS = """AirConstants Strips Surfaces LiveSource LiveRow Trajectory
Belief Calibration CalibrationUse CalibrationWatch Condition Extras Parameter
Applications Bias Crossing Estimate Event Identifiability LevelDetector CusumDetector LineOfAction
PointOfAction Prediction Sample Closure Sensitivity Halves LineFlight RobotState StateSpace StripLoads Trim Wake Tree
FlightSummary KnownInputs ObserverScores Score Experiment Aerobat Observer
Redundancy JointFriction OnlineSample Result StoredEstimate PairedEstimate Channel
LoopRecord ThrusterSet Nominal Margins ControlSummary Innovation TrueEvent InnovationScore ComponentSize
Contact Cause Effect ModelCheck Suspect Finding Agreement Moments Check KnownForces StreamHealth Stance
ObserversTogether Sampled LoopState SimulatedMotion"""  # made by other functions
TABLES = """ObserverSection ObserverSettings AirSection ControlSection ThrustersSection Map Section RecordedForce
RobotSection Scenario SensorSection SensorsSection UnknownForce InertialSection MotionCaptureSection RawSection
SampledSection LoadSection PlantSection SineForce"""  # pydantic checks
MEMORY = "air_memory fill channel Pieces RateControlledMotor"  # fields of kernels, and a channel of a log
HOT = "prescribed_joint_dynamics"  # called for every sample
# Without arguments.
NOTHING = "closed_settings describe_map describe_scenario shipped_scenarios shipped_sweeps"
LONG = "run_sweep ForceNode LiveTopics"  # start processes or nodes; sweep and map come from load_sweep and load_map
# Called by other rooms, with what these have checked.
INNER = """row_names inputs_of lag map_toml read_map observers_of kind_of_log needs_map table_record requests_of
seal_netcdf netcdf_bytes torque_per_unit read_netcdf read_run joint_series
effort_findings record_findings moving_weight AllBut with_record robot_length has_free_base low_passed
twice_low_passed repeats with_angles
as_others_rub effort_limits quantity typical_step redundancy_of slow_part describe_tables explain validated fit_friction
one_unit rotation_matrices force_size said_unit name_for scenario_keys
ClosedLoop LaggedThrust Sensing Allocation DisturbanceObserver TrueDisturbance control_summary noise_slew
SeriesSculpture scenario_of_run changed_keys changes_text differing_keys keys_text blocks_of component_sizes
found_contacts belief_of described flight_log_of log_with_motion shipped_description
AerobatRobot filled flight_channels flight_record read_flight robot_of_belief"""
PROTOCOLS = "Pilot Disturbance AerobatEnv Simulator"  # what others write, and what gymnasium's checker checks
EXCLUDED = frozenset(f"{PROTOCOLS} {RESULTS} {TABLES} {MEMORY} {HOT} {NOTHING} {LONG} {INNER}".split())
HARMLESS = ("empty", "-1", "wrong shape")  # where an array of any shape or sign is allowed


def fault(name: str, argument: str, kind: str) -> str:
    """Call a function with one wrong argument: right are an AerobatError that names it, or a result if allowed."""
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
    """Draw and call with one wrong argument of one public function; return the label, and what is wrong, or nothing."""
    name = str(rng.choice(list(calls())))
    argument = str(rng.choice(list(calls()[name].arguments)))
    kind = str(rng.choice(list(WRONG)))
    return f"{name}({argument}={kind})", fault(name, argument, kind)


@cache
def environment() -> Any:
    """Return a short environment to step wrongly."""
    from aerobat_pin.control import AerobatEnv

    return AerobatEnv("hover_closed_loop", ["simulation.duration=0.05"])


def environment_case(rng: np.random.Generator) -> tuple[str, str]:
    """Make, reset or step an environment of gymnasium with a wrong value; returns as `api_case`."""
    keys = ("air.density", "robot", "simulation.duration", "control.observer", "none", "", "flight.roll_deg")
    key, kind = str(rng.choice(keys)), str(rng.choice(list(WRONG)))
    choice, value = int(rng.integers(4)), WRONG[kind]()
    label = f"environment {('scenario', 'settings', 'draw', 'action')[choice]}: {key} {kind}"
    text, made = 5000 * "9" if kind == "huge whole number" else str(value), environment()
    calls: tuple[Callable[[], object], ...] = (
        lambda: type(made)(value),
        lambda: type(made)("hover_closed_loop", [f"{key}={text}"]),
        lambda: made.reset(seed=1, options={"draw": {key: value}}),
        lambda: made.step(value),
    )
    made.reset(seed=1)
    try:
        calls[choice]()
    except AerobatError:
        return label, ""
    except Exception as error:
        return label, f"{label} raises {type(error).__name__}: {error}"
    return label, ""


def exported(*rooms: str) -> dict[str, Any]:
    """Return what the doors of these rooms export, by name."""
    modules = [importlib.import_module(f"aerobat_pin.{room}") for room in rooms]
    return {name: getattr(module, name) for module in modules for name in module.__all__}


def public_callables() -> dict[str, Callable[..., Any]]:
    """Return the functions and classes that the doors export, by name."""
    found = exported(*DOORS)
    return {name: one for name, one in found.items() if inspect.isfunction(one) or inspect.isclass(one)}
