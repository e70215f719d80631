"""The table `bars` of a morphology file: masses of the linkage's bars."""

from __future__ import annotations

from dataclasses import dataclass

from aerobat_description.reading import positive


@dataclass(frozen=True)
class Bars:
    """Masses of the linkage's bars that are not wing links, of one side [kg].

    The tree of the URDF takes these bars as massless, as the paper does; the closed linkage of the MJCF has them.
    """

    L1: float
    L2: float
    L4: float
    L5: float
    L6: float

    def check(self, where: str) -> None:
        """Raise MorphologyError unless every mass is positive."""
        positive(self, where, "L1", "L2", "L4", "L5", "L6")

    @property
    def mass(self) -> float:
        """Mass of the bars of one side [kg]."""
        return self.L1 + self.L2 + self.L4 + self.L5 + self.L6
