"""The tables of a scenario file as pydantic classes: every key with its default, rule, unit and meaning.

`Section` is the base class of all of them, here and in the files of further tables.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

LARGEST_NUMBER = 1.0e12  # no key needs a larger number, in any of its units
FARTHEST_START = 1.0e6  # [m]: further out, positions lose their digits
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Whole = Annotated[int, Field(strict=True)]
Positive = Annotated[Number, Field(gt=0.0)]
NonNegative = Annotated[Number, Field(ge=0.0)]
Triple = tuple[Number, Number, Number]
Coordinate = Annotated[Number, Field(ge=-FARTHEST_START, le=FARTHEST_START)]
PerAxis = Annotated[
    tuple[Number, ...], BeforeValidator(lambda given: (given,) if isinstance(given, int | float) else given)
]
Limits = tuple[Positive, Positive, Positive]
PerWorldAxis = Annotated[
    tuple[Positive, Positive, Positive],
    BeforeValidator(lambda given: (given,) * 3 if isinstance(given, int | float) else given),
]


class Section(BaseModel):
    """Base class of a scenario file's tables: unknown keys are errors, and values cannot change after reading."""

    # A table is built when one is first read, with those inside it: most commands read few of them.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def _false_for_none(values: Any) -> Any:
    """Replace every None by False: both remove a part such as the tail, but TOML has no None."""
    if isinstance(values, dict):
        return {key: _false_for_none(value) for key, value in values.items()}
    return False if values is None else values


RobotValues = Annotated[dict[str, Any], BeforeValidator(_false_for_none)]


class RobotSection(Section):
    """Which robot flies."""

    morphology: str = Field("aerobat", description="shipped name or TOML file")
    changes: RobotValues = Field(default_factory=dict, description="nested values laid over the morphology")


class FlightSection(Section):
    """How the flight starts."""

    position: tuple[Coordinate, Coordinate, Coordinate] = Field((0.0, 0.0, 0.0), description="body COM in world [m]")
    velocity: Triple = Field((3.0, 0.0, 0.0), description="of the body COM in world axes [m/s]")
    roll_deg: Number = Field(0.0, description="positive: right wing down [deg]")
    pitch_deg: Number = Field(0.0, description="positive: nose up [deg]")
    yaw_deg: Number = Field(0.0, description="positive: nose to the left [deg]")
    angular_velocity: Triple = Field((0.0, 0.0, 0.0), description="of the body in body axes [rad/s]")
    gravity: NonNegative = Field(9.81, description="downward, along -z of the world [m/s2]")


class SpinUpSection(Section):
    """A crank that is at rest until t = 0 and then speeds up smoothly; see `aerobat_pin.flight.crank`."""

    duration: Positive = Field(0.5, description="until the crank turns at its frequency [s]")


class MotorSection(Section):
    """A motor that controls the crank's rate against all forces on it; see `aerobat_pin.flight.crank`."""

    start_frequency: NonNegative = Field(0.0, description="of the crank at t = 0, and steadily before [Hz]")
    rotor_inertia: Positive = Field(5.0e-5, description="seen at the crank: rotor times gear ratio squared [kg m2]")
    friction: NonNegative = Field(0.0, description="seen at the crank: motor's times gear ratio squared [N m s/rad]")
    torque_limit: Positive = Field(0.15, description="at the crank: motor's times gear ratio [N m]")
    lag: Positive = Field(0.005, description="time constant of the torque [s]")
    gain: Positive = Field(0.01, description="on the miss of the rate [N m s/rad]")
    integral_gain: NonNegative = Field(0.1, description="on its integral [N m/rad]")


class CrankSection(Section):
    """How the crank turns; the drives `spin_up` and `motor` have further keys in a table of the same name."""

    drive: Literal["constant", "spin_up", "motor"] = Field("constant", description="steady, from rest, or by a motor")
    frequency: NonNegative = Field(4.75, description="flapping frequency, one turn a flap; where a drive leads to [Hz]")
    start_deg: Number = Field(-90.0, description="absolute crank angle t1 at the start [deg]")
    spin_up: SpinUpSection | None = None
    motor: MotorSection | None = None

    @model_validator(mode="before")
    @classmethod
    def _drives_own_table(cls, values: Any) -> Any:
        """Add the table of the chosen drive, with default values, if the file does not contain it."""
        if isinstance(values, dict) and values.get("drive") in ("spin_up", "motor"):
            return {values["drive"]: {}, **values}
        return values

    @model_validator(mode="after")
    def _no_other_table(self) -> CrankSection:
        for name in ("spin_up", "motor"):
            if getattr(self, name) is not None and self.drive != name:
                raise ValueError(f'crank.{name} is given, but crank.drive = "{self.drive}"; write drive = "{name}"')
        return self


class HoldSection(Section):
    """Attitude hold: an ideal controller that keeps the attitude, height and speed of the start.

    It acts as a wrench on the body that the observers know; see `aerobat_pin.flight.attitude_hold`.
    """

    attitude_stiffness: tuple[NonNegative, NonNegative, NonNegative] = Field(description="roll, pitch, yaw [N m/rad]")
    attitude_damping: tuple[NonNegative, NonNegative, NonNegative] = Field(description="roll, pitch, yaw [N m s/rad]")
    torque_limit: Limits = Field(description="roll, pitch, yaw [N m]")
    speed_gain: NonNegative = Field(description="world x [N s/m]")
    thrust_limit: Positive = Field(description="world x [N]")
    lift: Number = Field(description="constant, world z [N]")
    height_stiffness: NonNegative = Field(description="world z [N/m]")
    height_damping: NonNegative = Field(description="world z [N s/m]")
    lift_limit: Positive = Field(description="of stiffness and damping together, world z [N]")


class SimulationSection(Section):
    """Duration, time step and random seed of the simulation."""

    duration: Positive = Field(2.0, description="of the flight [s]")
    dt: Annotated[Number, Field(gt=0.0, le=0.02)] = Field(1.0e-3, description="integration and logging step [s]")
    seed: Whole = Field(1, ge=0, description="of all random numbers")

    @property
    def count(self) -> int:
        """Number of integration steps."""
        return round(self.duration / self.dt)

    @model_validator(mode="after")
    def _whole_steps(self) -> SimulationSection:
        steps = self.duration / self.dt
        if not 0.5 <= steps < math.inf or abs(steps - round(steps)) > 1e-6 * steps:
            raise ValueError(f"duration = {self.duration} s is not a whole number of steps of dt = {self.dt} s")
        return self


class KalmanSection(Section):
    """What the observers `kalman` and `smoother` assume of sensors and models; see `aerobat_pin.observers.kalman`."""

    sensor_noise: tuple[Positive, Positive, Positive] = Field(
        (0.02, 0.01, 0.05), description="largest deviation of a sample: velocity, gyro, joints [m/s, rad/s, rad/s]"
    )
    force_walk: Positive | Literal["gain"] | None = Field(
        None,
        description="how much a force changes in a second; left out: 2.2 weights, or by a map forces of the size that "
        'is expected, each for error_time; "gain": as observers.gain says [N/sqrt(s)]',
    )
    prior: Positive | None = Field(
        None, description="deviation of the forces at the start; left out: 0.33 weights, by a map what is expected [N]"
    )
    known_error: dict[str, Positive] = Field(
        default_factory=dict, description="deviations of known forces' factors, such as {aerodynamic = 0.2} [-]"
    )
    mass_error: NonNegative = Field(0.0, description="deviation of the mass's factor; 0 trusts it [-]")
    error_time: Positive = Field(1.0, description="how long such a factor, or what is expected, lasts [s]")
    misfit: Positive = Field(0.01, description="fast errors, as a share of what these factors make of a row [sqrt(s)]")
    frequency: Positive | None = Field(
        None, description="flapping frequency, for forces that also swing with it; left out: a plain walk [Hz]"
    )


class SuperTwistingSection(Section):
    """Settings of the observer `super_twisting`."""

    slope: Positive = Field(1.0, description="of a force that is followed exactly [N/s]")


class RawNoiseSection(Section):
    """Deviations of raw samples; a value that is left out is the one noted in the log, else that of a good sensor."""

    position: Positive | None = Field(None, description="of motion capture, each world axis; else 1 mm [m]")
    orientation: Positive | None = Field(None, description="of motion capture, about body axes; else 3 mrad [rad]")
    gyro: Positive | None = Field(None, description="else 3 mrad/s [rad/s]")
    accelerometer: Positive | None = Field(None, description="else 0.05 m/s2 [m/s2]")
    crank: Positive | None = Field(None, description="else a 4096th of a turn over sqrt(12) [rad]")
    torque: Positive | None = Field(None, description="else 0.5 mN m [N m]")


class RawSection(Section):
    """What `smoother` and `kalman` assume of raw samples; see `aerobat_pin.aerobat.raw`."""

    walk: PerWorldAxis | None = Field(
        None, description="change of each force in a second, world x, y, z; left out: by likelihood [N/sqrt(s)]"
    )
    bend: PerWorldAxis | None = Field(
        None, description="change of each force's slope in a second, world x, y, z; left out: by likelihood [N/s^1.5]"
    )
    alike: PerWorldAxis | None = Field(
        None, description="common changes of the forces over those in which they differ; left out: by likelihood [-]"
    )
    crank_jerk: Positive | None = Field(
        None, description="white noise of the crank's jerk; left out: by likelihood [rad/s^2.5]"
    )
    white: PerWorldAxis | None = Field(
        None, description="noise of each force, mean over 1 ms, world x, y, z; left out: by likelihood [N]"
    )
    mass_error: NonNegative = Field(0.0, description="deviation of the mass's factor, which is estimated; 0 trusts [-]")
    air_error: NonNegative = Field(0.0, description="deviation of the air's factor, which is estimated; 0 trusts [-]")
    offset_error: NonNegative = Field(
        2.0e-3, description="deviation of the clock offsets that are looked for; 0 looks for none [s]"
    )
    apply_offsets: bool = Field(False, description="whether clock offsets that are found are applied")
    iterations: Annotated[Whole, Field(ge=1, le=20)] = Field(8, description="linearisations of the record, at most")
    noise: RawNoiseSection = RawNoiseSection()


class ObserverSettings(Section):
    """Settings that only one kind of observer has."""

    kalman: KalmanSection | None = Field(None, description="settings of the observer kalman")
    smoother: KalmanSection | None = Field(None, description="settings of the observer smoother")
    super_twisting: SuperTwistingSection | None = Field(None, description="settings of the observer super_twisting")

    def settings(self, name: str) -> dict[str, Any]:
        """Return the settings of one observer as keyword arguments; empty if the file has no table of its name."""
        table = getattr(self, name, None)
        return table.model_dump(exclude_none=True) if isinstance(table, Section) else {}


class ObserverSection(ObserverSettings):
    """The observers of the unknown forces."""

    names: tuple[str, ...] = Field(("momentum", "force_level"), description="observers to run")
    gain: Positive = Field(1000.0, description="K: how fast estimates follow; 1/K is the lag [1/s]")
    torque: Literal["measured", "modelled", "motor_only", "none"] = Field(
        "measured",
        description="what is known of the joint torques: all of them; a model without the unknown force; the motor's "
        "torque at the crank alone; nothing",
    )
    frames: tuple[str, ...] = Field(
        ("left_force_point", "right_force_point"), description="frames at which forces are sought"
    )
    raw: RawSection | None = Field(None, description="settings of kalman and smoother on a log of raw samples")

    @model_validator(mode="after")
    def _each_once(self) -> ObserverSection:
        for key, values in (("names", self.names), ("frames", self.frames)):
            twice = [value for i, value in enumerate(values) if value in values[:i]]
            if twice:
                raise ValueError(f"observers.{key} = {list(values)}: '{twice[0]}' is there twice; once was expected")
        return self


class ElasticSection(Section):
    """A joint of both wings that turns on a spring: its angle is the linkage's plus a deflection of its own."""

    stiffness: Positive = Field(description="of the spring; without the table the joint is rigid [N m/rad]")
    damping: NonNegative = Field(0.0, description="torque per rate of the deflection [N m s/rad]")


class LoadSection(Section):
    """A point mass on the body."""

    mass: Positive = Field(description="of the payload [kg]")
    position: Triple = Field((0.0, 0.0, 0.0), description="from the body's COM without it, body axes [m]")


class PlantSection(Section):
    """What moves the robot, and what has changed in it and its air since the tables robot and air were written.

    Observers do not know of it: they believe these tables, with `believed` laid over them.
    """

    simulator: Literal["mujoco"] | None = Field(
        None, description="what moves the robot in our air; needs the extra of its name"
    )
    air_density: Positive = Field(1.0, description="of the air that flies, as a factor of air.density [-]")
    crank_zero_deg: Number = Field(
        0.0, description="what the crank's encoder shows too much; the wings do not move [deg]"
    )
    payload: LoadSection | None = None
    shoulder: ElasticSection | None = None
    elbow: ElasticSection | None = None

    @property
    def shows_joints(self) -> bool:
        """Whether joint angles, unless they are measured themselves, are those that follow from the crank's encoder."""
        return bool(self.crank_zero_deg) or self.shoulder is not None or self.elbow is not None


class BelievedSection(Section):
    """Deliberate model errors: values of robot, air, thrusters, sensors assumed in place of the true ones."""

    robot: RobotValues = Field(default_factory=dict, description="values laid over the table robot")
    air: dict[str, Any] = Field(default_factory=dict, description="values laid over the table air")
    thrusters: dict[str, Any] = Field(default_factory=dict, description="values laid over the table thrusters")
    sensors: dict[str, Any] = Field(default_factory=dict, description="values laid over the table sensors")


def sections_of(annotation: Any) -> dict[str, type[Section]]:
    """Return name -> section class for those that a field of this annotation can contain.

    The name is the value of the class's key `signal` if it has one, else the class name.
    """
    if isinstance(annotation, type) and issubclass(annotation, Section):
        signal = annotation.model_fields.get("signal")
        return {annotation.__name__ if signal is None else get_args(signal.annotation)[0]: annotation}
    return {name: kind for inner in get_args(annotation) for name, kind in sections_of(inner).items()}
