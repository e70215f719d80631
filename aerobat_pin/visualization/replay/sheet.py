"""A sheet that trails behind a replayed robot."""

from __future__ import annotations

from dataclasses import dataclass

from aerobat_pin.numerics import Array


@dataclass(frozen=True)
class Sheet:
    """A translucent sheet that trails behind the robot, such as its wake.

    Each keyframe adds a row of points, which is then shown for a fixed time.

    Attributes:
        label: text in the legend.
        colour: colour of the mark in the legend, hexadecimal.
        points: (m, k, 3) points of each row where they would be without drift, world axes [m].
        colours: (m, k, 3) red, green and blue of each point, from 0 to 1.
        drift: (m, 3) displacement of the whole sheet at each keyframe, world axes [m].
        lasting: time for which a row is shown [s].
    """

    label: str
    colour: str
    points: Array
    colours: Array
    drift: Array
    lasting: float
