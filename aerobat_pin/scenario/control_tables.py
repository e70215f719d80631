"""The tables `thrusters` and `control` of a scenario: the guard's thrusters, and the controller that commands them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from aerobat_pin.scenario.section import NonNegative, Number, Positive, Section

Tilt = Annotated[Number, Field(gt=0.0, le=60.0)]
Delay = Annotated[NonNegative, Field(le=1.0)]


class ThrustersSection(Section):
    """The thrusters of the robot's guard, as they fly; see `aerobat_pin.flight.thrusters`.

    Where they are and what they push at most stands in the morphology.
    """

    lag: Delay = Field(0.045, description="time constant of the thrust [s]")
    delay: Delay = Field(0.001, description="from a sample to the command that follows from it [s]")
    factor: Positive = Field(1.0, description="what they push, as a factor of what the morphology says [-]")


class ControlSection(Section):
    """The controller that flies the robot by its thrusters, from what the sensors show; see `aerobat_pin.control`.

    It replaces the attitude hold. It keeps the course of the start: the start's velocity, height and heading.
    """

    rate: Positive | None = Field(None, description="of the law [Hz]; at every time of the log, when left out")
    pitch_deg: Number = Field(0.0, description="attitude to keep, positive: nose up [deg]")
    roll: Positive = Field(12.0, description="natural frequency of the roll error [rad/s]")
    pitch: Positive = Field(12.0, description="of the pitch error [rad/s]")
    yaw: Positive = Field(12.0, description="of the yaw error [rad/s]")
    lateral: NonNegative = Field(2.8, description="of the sideways position's error [rad/s]")
    height: NonNegative = Field(8.0, description="of the height's error [rad/s]")
    forward: NonNegative = Field(2.0, description="of the position's error along the course [rad/s]")
    damping: Positive = Field(0.8, description="share of critical damping, of all six [-]")
    bank_limit_deg: Tilt = Field(20.0, description="largest roll that is asked for to push sideways [deg]")
    pitch_limit_deg: Tilt = Field(6.0, description="largest pitch to push forward by, where the thrusters cannot [deg]")
    lead: Annotated[Number, Field(ge=1.0, le=10.0)] = Field(
        2.0, description="how much faster the commands make the believed lag of the thrusters; 1 leaves it [-]"
    )
    integral: bool = Field(True, description="whether the errors' integrals act")
    attitude_integral: NonNegative = Field(2.0, description="share of the stiffness that it adds in a second [1/s]")
    position_integral: NonNegative = Field(1.0, description="share of the stiffness that it adds in a second [1/s]")
    feedforward: bool = Field(True, description="whether what the observer sees is compensated")
    source: Literal["observer", "filtered_truth", "truth"] = Field(
        "observer", description="who says what that is: the observer, or, to compare, what only a simulation knows"
    )
    moment_gain: Positive = Field(8.0, description="K of the observer's moments [1/s]")
    forward_gain: Positive = Field(2.0, description="K of the observer's forward force [1/s]")
    lateral_gain: Positive = Field(8.0, description="K of the observer's sideways force [1/s]")
    lift_gain: Positive = Field(10.0, description="K of the observer's upward force [1/s]")
    air: bool = Field(True, description="whether the observer knows the air; if not, only its mean")
