"""The package's errors. Each also derives from the closest builtin error, and its message says what to try."""

import math

from aerobat_description.reading import did_you_mean


class AerobatError(Exception):
    """Base class of errors in the caller's input or environment; a bug in the package never raises an AerobatError."""


class MorphologyFileError(AerobatError, ValueError):
    """A morphology file cannot be read, or no robot can have its values."""


class LinkageError(AerobatError, ValueError):
    """The linkage cannot close: at some crank angle two of its bars do not reach each other.

    Attributes:
        dyad: name of the pin that should join the two bars.
        crank_angle: first crank angle at which the bars do not reach each other [rad].
        nearest: bar length -> new value [m] that lets the crank turn if only this length is changed.
    """

    def __init__(self, message: str, dyad: str, crank_angle: float, nearest: dict[str, float]) -> None:
        super().__init__(message)
        self.dyad, self.crank_angle, self.nearest = dyad, crank_angle, nearest


class CrankError(AerobatError, ValueError):
    """The angle, rate and acceleration that a crank drive returns do not fit together."""


class NearSingularWarning(UserWarning):
    """The linkage comes close to locking: two bars that are nearly in line transmit hardly any torque.

    Attributes:
        dyad: name of the pin that joins the two bars.
        transmission: angle between the two bars [rad].
        crank_angle: crank angle at which they are nearly in line [rad].
    """

    def __init__(self, dyad: str, transmission: float, crank_angle: float) -> None:
        super().__init__(
            f"the linkage is nearly singular at {dyad}: its bars make {math.degrees(transmission):.1f} deg at a crank "
            f"angle of {math.degrees(crank_angle):.1f} deg; it locks at 0 and 180"
        )
        self.dyad, self.transmission, self.crank_angle = dyad, transmission, crank_angle


class FrameNotFoundError(AerobatError, KeyError):
    """The model has no frame of the requested name; the attribute `known` lists the frames of the model."""

    def __init__(self, name: str, known: list[str]) -> None:
        super().__init__(f"no frame named '{name}' in the model: {did_you_mean(name, known, 'it has')}")
        self.name, self.known = name, known

    def __str__(self) -> str:
        """Return the message without the quotes that KeyError would add."""
        return str(self.args[0])


class ArgumentError(AerobatError, TypeError):
    """An argument has the wrong type. The message names the argument, its value and what was expected."""


class ShapeError(AerobatError, ValueError):
    """An array has the wrong shape, or a number is NaN, infinite, far too large or of the wrong sign."""


class ScenarioError(AerobatError, ValueError):
    """A scenario or a `--set` value is wrong. The message names the key, the value and the rule that it breaks."""


class SweepError(AerobatError, ValueError):
    """A sweep file is wrong. The message names the key, the value and the rule that it breaks."""


class WorkersLostError(AerobatError, RuntimeError):
    """Runs of a sweep are missing because the processes that simulate them died or cannot be reached."""


class ObserverError(AerobatError, ValueError):
    """An observer cannot be built from its arguments, or cannot process the data it is given."""


class LogError(AerobatError, ValueError):
    """A file is not a flight log, or the log lacks a channel that is needed."""


class CalibrationError(AerobatError, ValueError):
    """A calibration cannot be learnt from these flights, or does not fit the belief that it is used with."""


class MapError(AerobatError, ValueError):
    """A map of a recording is wrong, or does not fit its log. The message names the key and what was expected."""


class OutputError(AerobatError, OSError):
    """Results cannot be written to the requested file or folder."""


class ControlWarning(UserWarning):
    """The thrusters cannot fly the course that is asked for."""


class OutputWarning(UserWarning):
    """Results were written, but not in one step."""


class ExtraError(AerobatError, ImportError):
    """A package that one of the extras brings is not installed. The message says which."""


class BrowserError(AerobatError, RuntimeError):
    """No browser can take pictures of a replay. The message says what to install."""


class SimulationError(AerobatError, ArithmeticError):
    """The simulated flight diverged, or its controller failed in flight.

    Attributes:
        diverged_at: time of the first sample at which a limit was passed, or the controller failed [s].
        kept: what was flown before, in the form that the caller would have got (`Trajectory`, `FlightLog`,
            `Experiment`); None if there is less than one interval.
    """

    def __init__(self, message: str, diverged_at: float, kept: object = None) -> None:
        super().__init__(message)
        self.diverged_at, self.kept = diverged_at, kept


class TrimError(AerobatError, ArithmeticError):
    """The trim search found no periodic flight."""
