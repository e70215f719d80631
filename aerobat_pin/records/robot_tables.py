"""The tables of a map about the robot itself: its file, where something may push, and what it carries."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from aerobat_pin.scenario import NonNegative, Number, Positive, Section


def _rising(given: tuple[float, float]) -> tuple[float, float]:
    if not given[0] < given[1]:
        raise PydanticCustomError("stretch", "from and to were expected, the smaller one first")
    return given


def _not_zero(given: float) -> float:
    if given == 0.0:
        raise PydanticCustomError("zero", "another number than 0 was expected")
    return given


Share = Annotated[Number, Field(ge=0.0, le=1.0)]
ShortTime = Annotated[Number, Field(gt=0.0, le=1.0)]  # [s]: half of it reaches over the border of a block
NonZero = Annotated[Number, AfterValidator(_not_zero)]
Stretch = Annotated[tuple[Number, Number], AfterValidator(_rising)]  # of time since the record's start [s]
Shares = Annotated[tuple[Share, Share], AfterValidator(_rising)]  # of a record
Three = tuple[Number, Number, Number]


class BodySection(Section):
    """One rigid body by numbers; its frame `body` is at the origin of the axes in which the pose is measured."""

    mass: Positive = Field(description="of the body [kg]")
    inertia: tuple[Positive, Positive, Positive] = Field(description="about the centre of mass, body axes [kg m2]")
    centre: Three = Field((0.0, 0.0, 0.0), description="centre of mass in body axes [m]")


class RowsSection(Section):
    """Which equations of the robot are not used."""

    ignore: tuple[str, ...] = Field((), description="joints (rail), base, or parts of it (base.Mx)")


class RobotTable(Section):
    """The robot: a file that Pinocchio reads, one rigid body, or a known one; exactly one of body, urdf, mjcf, name."""

    body: BodySection | None = None
    urdf: str | None = Field(None, description="URDF file, relative to the map")
    mjcf: str | None = Field(None, description="MJCF file, relative to the map")
    name: str | None = Field(None, description="a robot of the extra `robots`, such as ur5; a wrong name lists them")
    root: Literal["free_flyer", "fixed"] | None = Field(
        None, description="whether the base moves; left out: free_flyer, or as the robot of that name does"
    )
    points: tuple[str, ...] = Field(
        (), description="frames at whose origins an unknown force acts; [] for the joints' residuals alone"
    )
    wrenches: tuple[str, ...] = Field((), description="frames at which an unknown force and moment act")
    rows: RowsSection = RowsSection()
    gravity: NonNegative = Field(9.81, description="along `down`; 0 in an orbit [m/s2]")
    down: Three = Field(
        (0.0, 0.0, -1.0), description="of a fixed robot, in its root's axes: on a wall it is not -z [-]"
    )


class PayloadSection(Section):
    """What the robot carries: a point, or a small body, known or sought."""

    frame: str = Field(description="of the robot's file, to which it is fastened")
    mass: Positive | None = Field(None, description="left out: it is sought [kg]")
    com: Three | None = Field(None, description="centre of mass in the frame's axes; left out: it is sought [m]")
    inertia: tuple[NonNegative, NonNegative, NonNegative] = Field(
        (0.0, 0.0, 0.0), description="about the centre of mass, the frame's axes [kg m2]"
    )
    fit: Stretch | None = Field(
        None,
        description="from and to: nothing touches the robot and it is sought there; left out: use.free, for "
        "`aerobat calibrate` the first three quarters [s]",
    )

    @model_validator(mode="after")
    def _centre_belongs_to_mass(self) -> PayloadSection:
        if self.mass is None and self.com is not None:
            raise ValueError("com without mass: both were expected, or mass alone (com is sought), or neither")
        return self
