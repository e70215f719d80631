"""The package's errors. Each also derives from the builtin error that fits it; its message says what to try."""

import math


class AerobatError(Exception):
    """Base class of errors in what the caller gave. A fault of the package itself is never an AerobatError."""


class MorphologyFileError(AerobatError, ValueError):
    """A morphology cannot be read or cannot be a robot."""


class LinkageError(AerobatError, ValueError):
    """The linkage cannot close.

    `dyad` names the pin, `crank_angle` the first angle [rad] at which it fails, `nearest` the lengths [m] that, each
    changed alone, let the crank turn.
    """

    def __init__(self, message: str, dyad: str, crank_angle: float, nearest: dict[str, float]) -> None:
        """Store the message, the place and the lengths that would help."""
        super().__init__(message)
        self.dyad = dyad
        self.crank_angle = crank_angle
        self.nearest = nearest


class CrankError(AerobatError, ValueError):
    """A crank drive's angle, rate and acceleration do not fit together."""


class NearSingularWarning(UserWarning):
    """The linkage comes close to locking: two bars nearly in line transmit hardly any torque.

    `dyad` names the pin, `transmission` the angle [rad] between its bars, `crank_angle` where that is [rad].
    """

    def __init__(self, dyad: str, transmission: float, crank_angle: float) -> None:
        """Build the message from where it happens."""
        super().__init__(
            f"the linkage is nearly singular at {dyad}: its bars make {math.degrees(transmission):.1f} deg at a crank "
            f"angle of {math.degrees(crank_angle):.1f} deg; it locks at 0 and 180"
        )
        self.dyad = dyad
        self.transmission = transmission
        self.crank_angle = crank_angle


class FrameNotFoundError(AerobatError, KeyError):
    """The model has no frame of that name. `known` lists those it has."""

    def __init__(self, name: str, known: list[str]) -> None:
        """Build the message from the name and the frames there are."""
        super().__init__(f"no frame named '{name}' in the model; it has: {', '.join(known)}")
        self.name = name
        self.known = known

    def __str__(self) -> str:
        """Return the message as it is: KeyError would print it in quotes."""
        return str(self.args[0])


class ShapeError(AerobatError, ValueError):
    """An array has the wrong shape, or holds NaN or infinity."""


class ScenarioError(AerobatError, ValueError):
    """A scenario, or a value set on the command line, is wrong. The message names the key, the value and the rule."""


class SweepError(AerobatError, ValueError):
    """A sweep file is wrong. The message names the key, the value and the rule."""


class WorkersLostError(AerobatError, RuntimeError):
    """Runs of a sweep are missing because the processes that fly them died or cannot be reached."""


class ObserverError(AerobatError, ValueError):
    """An observer cannot be built or fed as asked."""


class LogError(AerobatError, ValueError):
    """A file is not a flight log, or the log lacks channels."""


class OutputError(AerobatError, OSError):
    """Results cannot be written where they were asked for."""


class BrowserError(AerobatError, RuntimeError):
    """No browser is installed to take pictures with. The message says what to install."""


class SimulationError(AerobatError, ArithmeticError):
    """The flight diverged."""


class TrimError(AerobatError, ArithmeticError):
    """No periodic flight was found."""
