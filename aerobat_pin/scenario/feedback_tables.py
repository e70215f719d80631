"""The tables of what closes a loop: sensors with their errors, thrusters, and the controller between them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from aerobat_pin.scenario.tables import NonNegative, Number, PerAxis, Positive, Section, Triple, Whole

Tilt = Annotated[Number, Field(gt=0.0, le=60.0)]
Delay = Annotated[NonNegative, Field(le=1.0)]
LawRate = Annotated[Number, Field(ge=0.1)]


class ThrusterFaultSection(Section):
    """A thruster that pushes less than the others; no controller is told."""

    thruster: Annotated[Whole, Field(ge=1)] = Field(description="which one, counted from 1")
    factor: NonNegative = Field(0.0, description="what it pushes then, as a factor of what it would [-]")
    start: NonNegative = Field(0.0, description="from when on [s]")


class ThrustersSection(Section):
    """The thrusters of the robot's guard, as they fly; see `aerobat_pin.flight.thrusters`.

    Where they are and what they push at most stands in the morphology.
    """

    lag: Delay = Field(0.045, description="time constant of the thrust [s]")
    delay: Delay = Field(0.001, description="from a sample to the command that follows from it [s]")
    factor: Positive = Field(1.0, description="what they push, as a factor of what the morphology says [-]")
    fault: ThrusterFaultSection | None = Field(None, description="one that pushes less from some time on")


class ControlSection(Section):
    """The controller that flies the robot by its thrusters, from what the sensors show; see `aerobat_pin.control`.

    It replaces the attitude hold. It keeps the course of the start: the start's velocity, height and heading.
    """

    rate: LawRate | None = Field(
        None, description="of the law: samples of the log a second, or those by a whole number; all, when left out [Hz]"
    )
    pitch_deg: Number = Field(0.0, description="attitude to keep, positive: nose up [deg]")
    roll: Positive = Field(12.0, description="natural frequency of the roll error [rad/s]")
    pitch: Positive = Field(12.0, description="of the pitch error [rad/s]")
    yaw: Positive = Field(12.0, description="of the yaw error [rad/s]")
    lateral: NonNegative = Field(2.8, description="of the sideways position's error [rad/s]")
    height: NonNegative = Field(8.0, description="of the height's error [rad/s]")
    forward: NonNegative = Field(2.0, description="of the position's error along the course [rad/s]")
    damping: PerAxis = Field(
        (0.8,), description="share of critical damping; one, or of forward, lateral, height, roll, pitch, yaw [-]"
    )
    bank_limit_deg: Tilt = Field(20.0, description="largest roll that is asked for to push sideways [deg]")
    pitch_limit_deg: Tilt = Field(6.0, description="largest pitch to push forward by, where the thrusters cannot [deg]")
    lead: Annotated[Number, Field(ge=1.0, le=10.0)] = Field(
        2.0, description="how much faster the commands make the believed lag of the thrusters; 1 leaves it [-]"
    )
    integral: bool = Field(True, description="whether the errors' integrals act")
    attitude_integral: PerAxis = Field(
        (2.0,), description="share of the stiffness that it adds in a second; one, or of roll, pitch, yaw [1/s]"
    )
    position_integral: PerAxis = Field(
        (1.0,), description="likewise; one, or of forward, lateral, height; only forward's beside an observer [1/s]"
    )
    bias: Annotated[NonNegative, Field(le=100.0)] = Field(
        30.0,
        description="how fast a bias of the velocity is found and taken out, with the integrals; 0 does not [rad/s]",
    )
    smoothing: NonNegative = Field(
        300.0, description="pole of the forces upwards and sideways, against noise; 0 for none [rad/s]"
    )
    feedforward: bool = Field(True, description="whether what the observer sees is compensated")
    source: Literal["observer", "filtered_truth", "truth"] = Field(
        "observer", description="who says what that is: the observer, or, to compare, what only a simulation knows"
    )
    moment_gain: PerAxis = Field((8.0,), description="K of the observer's moments; one, or of roll, pitch, yaw [1/s]")
    forward_gain: Positive = Field(2.0, description="K of the observer's forward force [1/s]")
    lateral_gain: Positive = Field(8.0, description="K of the observer's sideways force [1/s]")
    lift_gain: Positive = Field(10.0, description="K of the observer's upward force [1/s]")
    air: bool = Field(True, description="whether the observer knows the air; if not, only its mean")

    @property
    def frequencies(self) -> tuple[float, ...]:
        """Natural frequencies of forward, lateral, height, roll, pitch, yaw [rad/s]."""
        return self.forward, self.lateral, self.height, self.roll, self.pitch, self.yaw

    @model_validator(mode="after")
    def _as_many_as_axes(self) -> ControlSection:
        for key, axes in (("damping", 6), ("attitude_integral", 3), ("position_integral", 3), ("moment_gain", 3)):
            given = getattr(self, key)
            if len(given) not in (1, axes):
                raise ValueError(f"control.{key} = {list(given)}: one number, or {axes}, were expected")
            if min(given) < 0.0 or (min(given) == 0.0 and key in ("damping", "moment_gain")):
                raise ValueError(f"control.{key} = {list(given)}: positive numbers were expected")
        return self


class SampledSection(Section):
    """When a sensor takes its samples and when it shows them."""

    rate: Positive | None = Field(None, description="of its samples [Hz]; one at every time of the log, when left out")
    delay: Annotated[NonNegative, Field(le=60.0)] = Field(0.0, description="from taking a sample to showing it [s]")
    dropout: Annotated[Number, Field(ge=0.0, lt=1.0)] = Field(0.0, description="probability to lose a sample [-]")


class SensorSection(SampledSection):
    """The errors of one sensor, in the unit of its channel; see `aerobat_pin.flight.sensors`."""

    noise: PerAxis = Field((0.0,), description="standard deviation of each sample; one number, or one per axis [unit]")
    bias: PerAxis = Field((0.0,), description="constant; one number, or one per axis [unit]")
    walk: NonNegative = Field(0.0, description="random walk of the bias: its deviation after one second [unit/sqrt(s)]")
    quantum: NonNegative = Field(0.0, description="step to whose multiples samples are rounded; 0 does not [unit]")


class InertialSection(SensorSection):
    """A gyro or an accelerometer on the body; its place and turn are noted in a raw log, so observers know them."""

    place: Triple = Field((0.0, 0.0, 0.0), description="of the sensor from the body's COM, body axes [m]")
    turn_deg: Triple = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw of its axes in the body [deg]")


class MotionCaptureSection(SampledSection):
    """Motion capture of a rigid body of markers on the robot; see `aerobat_pin.flight.raw_sensors`."""

    position_noise: NonNegative = Field(1.0e-3, description="deviation of a sample, each world axis [m]")
    orientation_noise: NonNegative = Field(3.0e-3, description="deviation of small turns about body axes [rad]")
    place: Triple = Field((0.0, 0.0, 0.0), description="of the markers' origin from the body's COM, body axes [m]")
    turn_deg: Triple = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw of the markers' axes in the body [deg]")


class EncoderSection(SampledSection):
    """An encoder of the crank's absolute angle."""

    counts: Annotated[Whole, Field(ge=2)] = Field(4096, description="in a turn [-]")


class SensorsSection(Section):
    """The sensors of the measured channels; a channel without a table is measured without error.

    With `motion_capture` the log is raw: it contains the samples of motion_capture, gyro, accelerometer, crank_encoder
    and motor_torque, each with times of its own, and no configuration or velocity; no controller flies by them. The
    value "none" removes a sensor.
    """

    position: SensorSection | None = Field(None, description="of the body's COM in world axes [m]")
    attitude: SensorSection | None = Field(None, description="small turns about body axes; rounded: Euler angles [rad]")
    velocity: SensorSection | None = Field(None, description="of the body's COM in body axes [m/s]")
    gyro: InertialSection | None = Field(None, description="body rate in body axes [rad/s]")
    joint_angle: SensorSection | None = Field(None, description="left shoulder, elbow, right shoulder, elbow [rad]")
    joint_rate: SensorSection | None = Field(None, description="of the same joints [rad/s]")
    crank_angle: SensorSection | None = Field(None, description="absolute crank angle t1 [rad]")
    airspeed: SensorSection | None = Field(None, description="along the body's x axis [m/s]")
    motor_torque: SensorSection | None = Field(None, description="at the same joints, mean over each interval [N m]")
    motion_capture: MotionCaptureSection | None = Field(None, description="poses of the body; makes the log raw")
    accelerometer: InertialSection | None = Field(None, description="specific force in its axes, in a raw log [m/s2]")
    crank_encoder: EncoderSection | None = Field(None, description="absolute crank angle t1, in a raw log [rad]")

    @model_validator(mode="before")
    @classmethod
    def _without_those_taken_away(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        return {k: v for k, v in values.items() if v != "none" or k not in cls.model_fields}

    @model_validator(mode="after")
    def _raw_or_not(self) -> SensorsSection:
        given = {name for name in type(self).model_fields if getattr(self, name) is not None}
        if self.raw:
            wrong = sorted(given - set(RAW_SENSORS))
            if wrong:
                raise ValueError(
                    f"sensors.{wrong[0]} with sensors.motion_capture: a raw log has {', '.join(RAW_SENSORS)} alone"
                )
        elif given & {"accelerometer", "crank_encoder"}:
            name = min(given & {"accelerometer", "crank_encoder"})
            raise ValueError(f"sensors.{name} without sensors.motion_capture: only a raw log has this sensor")
        elif self.gyro is not None and (any(self.gyro.place) or any(self.gyro.turn_deg)):
            raise ValueError("sensors.gyro has a place or a turn: only in a raw log, with sensors.motion_capture")
        return self

    @model_validator(mode="after")
    def _as_many_as_axes(self) -> SensorsSection:
        given = self.fitted if self.accelerometer is None else {**self.fitted, "accelerometer": self.accelerometer}
        for name, sensor in given.items():
            axes = AXES_OF_SENSOR.get(name, 3)
            for key in ("noise", "bias"):
                given = getattr(sensor, key)
                if len(given) not in (1, axes):
                    expected = "one number was" if axes == 1 else f"one number, or {axes}, were"
                    raise ValueError(f"sensors.{name}.{key} = {list(given)}: {expected} expected")
            if min(sensor.noise) < 0.0:
                raise ValueError(f"sensors.{name}.noise = {list(sensor.noise)}: deviations are not negative")
        return self

    @property
    def fitted(self) -> dict[str, SensorSection]:
        """The sensors that are given, by channel: name -> sensor; all other channels are exact."""
        return {name: getattr(self, name) for name in AXES_OF_SENSOR if getattr(self, name) is not None}

    @property
    def raw(self) -> bool:
        """Whether the log contains raw samples, each sensor's with times of its own."""
        return self.motion_capture is not None

    @property
    def sampled(self) -> dict[str, SampledSection]:
        """All sensors that are given: name -> sensor."""
        return {name: sensor for name in type(self).model_fields if (sensor := getattr(self, name)) is not None}


AXES_OF_SENSOR = {
    "position": 3,
    "attitude": 3,
    "velocity": 3,
    "gyro": 3,
    "joint_angle": 4,
    "joint_rate": 4,
    "crank_angle": 1,
    "airspeed": 1,
    "motor_torque": 4,
}
RAW_SENSORS = ("motion_capture", "gyro", "accelerometer", "crank_encoder", "motor_torque")
