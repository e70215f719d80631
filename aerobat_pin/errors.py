"""What can go wrong, by name. Each error also is the builtin that fits; its message says what to try."""


class AerobatError(Exception):
    """Anything wrong with what the caller gave. Failures of our own code are never an AerobatError."""


class MorphologyFileError(AerobatError, ValueError):
    """A morphology cannot be read or cannot be a robot."""


class LinkageError(AerobatError, ValueError):
    """The linkage cannot close. `dyad` names the pin, `crank_angle` the first angle [rad] at which it fails."""

    def __init__(self, message: str, dyad: str, crank_angle: float) -> None:
        """Keep the message and where it happened."""
        super().__init__(message)
        self.dyad = dyad
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


class ObserverError(AerobatError, ValueError):
    """An observer cannot be built or fed as asked."""


class LogError(AerobatError, ValueError):
    """A flight log misses channels or is not one."""


class OutputError(AerobatError, OSError):
    """Results cannot be written where they were asked for."""


class SimulationError(AerobatError, ArithmeticError):
    """The flight diverged."""


class TrimError(AerobatError, ArithmeticError):
    """No periodic flight was found."""
