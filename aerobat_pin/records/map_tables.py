"""The tables of a map file as pydantic classes: which columns of a recording mean what, in which unit and axes."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from aerobat_pin.records.joint_names import JointNames
from aerobat_pin.records.robot_tables import NonZero, PayloadSection, RobotTable, Shares, ShortTime, Stretch, Three
from aerobat_pin.scenario import NonNegative, Number, ObserverSettings, Positive, Section


class TimeSection(Section):
    """The column of time in a table; bags have their own clocks."""

    column: str | None = Field(None, description="name of the column")
    unit: Literal["s", "ms", "us", "ns"] | None = Field(
        None, description="of the column; left out: s, or what a NetCDF file says"
    )
    rate: Positive | None = Field(None, description="where there is no column: samples a second [Hz]")


class LogTable(Section):
    """How to read the log."""

    delimiter: str | None = Field(
        None, min_length=1, max_length=1, description="of a table, one character; found when left out"
    )
    time: TimeSection = TimeSection()
    world: Literal["z_up", "ned"] = Field("z_up", description="world axes of the log; ned is turned to z up")
    clock: Literal["header", "recorder"] = Field(
        "header", description="stamps of a bag: the sensor's or the recorder's"
    )
    rate: Positive | None = Field(None, description="of the estimate; left out: the pose's or joints' own rate [Hz]")
    times: Literal["even", "own"] = Field(
        "even",
        description="of the estimate: evenly spaced, or the stamps of the channel with most samples, which may be "
        "uneven; with own, stamps must rise, and columns of a channel have their samples in the same rows",
    )
    longest_gap: Positive = Field(0.1, description="a longer hole in any channel ends a part of the record [s]")


class ChannelSection(Section):
    """Columns of a table, or a topic of a bag, and their unit."""

    columns: tuple[str, ...] = Field((), description="names in the log, in order")
    topic: str | None = Field(None, description="of a bag, in place of columns")
    unit: str | None = Field(None, description="left out: SI")
    delay: Number = Field(0.0, description="of the channel against the clock; taken off [s]")
    optional: bool = Field(False, description="true: the log may lack it, all of its columns together")


class PositionSection(ChannelSection):
    """Position of the base's origin in world axes."""


class QuaternionSection(ChannelSection):
    """Attitude of the base: four columns of a quaternion, or roll, pitch and yaw, about x, then y, then z."""

    order: Literal["xyzw", "wxyz"] = Field("xyzw", description="of the columns")
    sense: Literal["body_to_world", "world_to_body"] = Field("body_to_world", description="what the quaternion turns")


class VelocitySection(ChannelSection):
    """Velocity of the base's origin."""

    axes: Literal["world", "body"] | None = Field(None, description="left out: world; of the twist of base.topic, body")
    from_: Literal["pose"] | None = Field(None, alias="from", description="differentiated, in place of columns")
    window: ShortTime = Field(0.05, description="of the parabolas that differentiate (from) [s]")


class RateSection(ChannelSection):
    """Angular velocity of the base."""

    axes: Literal["body", "world"] = Field("body", description="of the columns")
    from_: Literal["pose"] | None = Field(None, alias="from", description="differentiated, in place of columns")
    window: ShortTime = Field(0.05, description="of the parabolas that differentiate (from) [s]")


class AccelerationSection(ChannelSection):
    """What the base's accelerometer shows: +g upward at rest; its axes are those of the base but for base.imu.turn."""


class ImuSection(Section):
    """The IMU of a base that has nothing else."""

    place: Three = Field((0.0, 0.0, 0.0), description="of the accelerometer from the base's origin, base axes [m]")
    turn: Three = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw of the IMU in the base [deg]")
    tilt: Number = Field(0.5, ge=0.0, description="standard deviation of roll and of pitch that the IMU states [deg]")


class BaseTable(Section):
    """Motion of a free base."""

    from_: Literal["measured", "imu", "joints"] = Field(
        "measured",
        alias="from",
        description="imu: accelerometer, gyro and attitude give the velocity, no position is read; joints: gyro "
        "and attitude alone, the velocity counts as 0, and the base's six rows are not believed",
    )
    topic: str | None = Field(
        None, description="PoseStamped, TransformStamped or Odometry: pose and, if there, twist; with from an Imu"
    )
    held: bool = Field(False, description="true: the base stands still at the world's origin, as on a load cell")
    axes: Literal["flu", "frd"] = Field("flu", description="body axes of the log; frd is turned to x ahead, z up")
    position: PositionSection | None = None
    quaternion: QuaternionSection | None = None
    velocity: VelocitySection | None = None
    rate: RateSection | None = None
    acceleration: AccelerationSection | None = None
    imu: ImuSection = ImuSection()


class JointPositionSection(ChannelSection):
    """Angles or places of joints, as `names`; a unit of angles leaves slides in SI, one of lengths leaves hinges so."""

    slide_unit: Literal["m", "mm"] | None = Field(None, description="of those that slide, beside others that turn")


class JointVelocitySection(ChannelSection):
    """Rates of joints, as `names`; a unit of angles leaves slides in SI, one of lengths leaves hinges so."""

    slide_unit: Literal["m/s", "mm/s"] | None = Field(None, description="of those that slide, beside others that turn")
    from_: Literal["position"] | None = Field(None, alias="from", description="differentiated, in place of columns")
    window: ShortTime = Field(0.02, description="of the parabolas that differentiate (from) [s]")


class EffortSection(ChannelSection):
    """What drives the joints, in the order of `names`: not passive ones; ignored rows can be left out, all of them."""

    torque_per_unit: dict[str, NonZero] = Field(
        default_factory=dict,
        description="joint -> N m (N) for each unit that the map states (A, mA, N m), with its sign, such as "
        "{knee = -0.2}; * for all others",
    )


class FrictionSection(Section):
    """Friction of the joints, fitted in a stretch of the record and taken off everywhere."""

    law: Literal["coulomb+viscous", "coulomb+viscous+inertia"] = Field(
        "coulomb+viscous", description="and a constant; inertia: of the rotors"
    )
    fit: Stretch | None = Field(
        None,
        description="from and to: nothing touches the robot there, or `to` says what does [s]; left out, for "
        "`aerobat calibrate` alone: the first three quarters",
    )
    to: Literal["check.wrench"] | None = Field(None, description="the sensor's force counts as known in the fit")
    scale: bool = Field(False, description="also fit a factor of each joint's effort, and errors of the links")


class JointsTable(Section):
    """The joints' channels."""

    topic: str | None = Field(None, description="JointState: names, positions, velocities and efforts")
    names: JointNames = Field(
        (), description='joints of the columns; or, of a topic, name there -> joint: {"Wrist 1" = "wrist_1_joint"}'
    )
    position: JointPositionSection | None = None
    velocity: JointVelocitySection | None = None
    effort: EffortSection | None = None
    held: dict[str, Number] = Field(
        default_factory=dict,
        description='joint -> where it stands still; its row is not believed; "*": all that names leaves out [rad, m]',
    )
    passive: tuple[str, ...] = Field((), description="joints without a motor: their effort is known to be 0")
    factor: dict[str, Number] = Field(
        default_factory=dict,
        description='joint -> its motion over that of its encoder, with its sign, such as 0.01 behind a gear; "*": all '
        "others; efforts are divided by it [1, m/rad]",
    )
    offset: dict[str, Number] = Field(
        default_factory=dict, description="joint -> where it is when all encoders show 0 [rad, m]"
    )
    coupling: dict[str, dict[str, Number]] = Field(
        default_factory=dict,
        description="joint -> shares of the encoders, each after its factor and called like the joint of its column, "
        "that move it, such as {pitch = {pitch = 0.5, roll = -0.5}}; efforts by the transposed inverse [-]",
    )
    friction: FrictionSection | None = None


class SpecificForceSection(ChannelSection):
    """An accelerometer at the base's origin."""

    axes: Literal["body"] = Field("body", description="of the columns")


class WrenchSection(ChannelSection):
    """A force sensor: three columns of force, or six with the moment."""

    point: str | None = Field(None, description="frame at which the sensor's force acts on the robot")
    sign: Literal[1, -1] = Field(1, description="1: force on the robot; -1: force on the sensor")
    axes: Literal["world", "frame"] = Field("world", description="of the columns")
    tare: Stretch | None = Field(None, description="stretch without force, whose mean is taken off [s]")
    filter: Positive | None = Field(
        None, description="compare estimate and sensor behind one zero-phase second-order low-pass [Hz]"
    )
    part: Stretch | None = Field(None, description="compare there alone; left out: everywhere [s]")


class CheckTable(Section):
    """Channels that are compared with the estimate and never used by it."""

    specific_force: SpecificForceSection | None = None
    wrench: WrenchSection | None = None


class SupplySection(ChannelSection):
    """A channel that scales commands, such as the battery's voltage."""

    column: str | None = Field(None, description="name in the log")
    divide: bool = Field(False, description="commands are divided by it, else multiplied")


class ThrustFitSection(Section):
    """Where the coefficients of a law come from."""

    to: Literal["check.specific_force"] = Field("check.specific_force", description="times the mass, along direction")
    part: Shares = Field((0.0, 0.5), description="share of the used record that is fitted; the rest tests it [-]")


class KnownSection(ChannelSection):
    """A known force: commands through a law, or a measured wrench (a load cell)."""

    delay: Number = Field(0.0, description="of a wrench, taken off; of commands: by which their force is later [s]")
    law: str = Field(
        "wrench", description='"polynomial 1 2": powers of the sum of the commands; "wrench": 3 or 6 columns'
    )
    frame: str | None = Field(None, description="where it acts; left out: the base's origin")
    axes: Literal["frame", "world"] = Field("frame", description="of a wrench or of direction")
    direction: Three = Field((0.0, 0.0, 1.0), description="of the force, for a polynomial [-]")
    sign: Literal[1, -1] = Field(1, description="1: force on the robot; -1: force on the sensor")
    tare: Stretch | None = Field(None, description="stretch without force, whose mean is taken off [s]")
    full_scale: Positive = Field(1.0, description="command that counts as 1 [-]")
    supply: SupplySection | None = None
    coefficients: tuple[Number, ...] = Field((), description="of the powers, if they are known [N]")
    fit: ThrustFitSection | None = None

    @property
    def powers(self) -> tuple[int, ...]:
        """The powers of a polynomial; empty for a wrench."""
        return tuple(int(word) for word in self.law.split()[1:])

    @model_validator(mode="after")
    def _law_is_one(self) -> KnownSection:
        kind, *powers = self.law.split() or [""]
        once_each = sorted({*powers} & {"1", "2", "3"}) == sorted(powers)
        if not (kind == "polynomial" and powers and once_each) and (kind, powers) != ("wrench", []):
            raise ValueError(
                f'law = "{self.law}": "wrench", or "polynomial" and some of the powers 1, 2 and 3, once each, such as '
                '"polynomial 1 2"'
            )
        if self.powers and bool(self.coefficients) == (self.fit is not None):
            raise ValueError("a polynomial needs either coefficients, one for each power, or a table fit")
        if self.powers and self.coefficients and len(self.coefficients) != len(self.powers):
            raise ValueError(f"coefficients = {list(self.coefficients)}: one for each of the powers was expected")
        return self


class ExtraSection(ChannelSection):
    """A channel that only a robot with forces of its own reads."""

    kind: Literal["length", "angle", "speed", "rate", "acceleration", "force", "torque"] | None = Field(
        None,
        description="gives it units; forces and torques are then means over each interval; left out: the robot's own "
        "unit, samples",
    )
    wraps: bool = Field(False, description="an angle that jumps by full turns, which are taken out")


class WhenSection(Section):
    """Use only the part of the record in which a column is above or below a value."""

    column: str = Field(description="name in the log")
    above: Number | None = Field(None, description="least value of the column, in its own unit")
    below: Number | None = Field(None, description="largest value of the column, in its own unit")
    trim: tuple[NonNegative, NonNegative] = Field(
        (0.0, 0.0), description="taken off at the start and the end of each such part [s]"
    )

    @model_validator(mode="after")
    def _some_bound(self) -> WhenSection:
        low, high = (-np.inf if self.above is None else self.above), (np.inf if self.below is None else self.below)
        if not np.isfinite([low, high]).any() or low >= high:
            raise ValueError("use.when: above or below was expected, or both, the first one smaller")
        return self


class UseTable(Section):
    """Which part of the record is used."""

    part: Stretch | None = Field(None, description="from and to; left out: everything [s]")
    when: WhenSection | None = None
    free: Stretch | None = Field(
        None, description="nothing touches the robot there: the force found is the error bar [s]"
    )


class ObserverTable(ObserverSettings):
    """The observers of the unknown forces; `aerobat list` names them."""

    names: tuple[str, ...] = Field(("force_level",), description="observers to run")
    gain: Positive = Field(200.0, description="K: how fast estimates follow; 1/K is the lag [1/s]")


class Map(Section):
    """The whole map."""

    robot: RobotTable
    log: LogTable = LogTable()
    base: BaseTable = BaseTable()
    joints: JointsTable = JointsTable()
    payload: PayloadSection | None = None
    check: CheckTable = CheckTable()
    known: dict[str, KnownSection] = Field(default_factory=dict, description="name -> known force")
    extra: dict[str, ExtraSection] = Field(
        default_factory=dict, description="name -> columns that only a robot with forces of its own reads"
    )
    use: UseTable = UseTable()
    observer: ObserverTable = ObserverTable()

    @property
    def sought_payload(self) -> PayloadSection | None:
        """The payload, if its centre of mass, and perhaps its mass, are left to a fit."""
        return None if self.payload is None or self.payload.com is not None else self.payload
