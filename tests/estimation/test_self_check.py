"""`--self-check`: how hard it pushes."""

import pytest

from aerobat_pin.aerobat.aerobat import believed_robot
from aerobat_pin.aerobat.estimate import belief_about
from aerobat_pin.errors import ScenarioError
from aerobat_pin.estimation.self_check import Check
from aerobat_pin.experiments.self_check import self_check


def test_it_pushes_with_a_tenth_of_the_weight_that_is_believed() -> None:
    """On the moon as well; where nothing weighs anything there is no tenth of it."""
    moon, space = (belief_about(None, "x", None, ["momentum"], [f"flight.gravity={g}"]) for g in (1.62, 0.0))
    robot = believed_robot(moon)
    checks = self_check(robot, moon)
    assert [check.applied for check in checks] == [pytest.approx(0.162 * robot.mass)] * 6
    assert all(check.ok for check in checks)
    with pytest.raises(ScenarioError, match=r"flight\.gravity = 0"):
        self_check(believed_robot(space), space)


def test_a_pose_that_hides_a_force_is_not_called_a_row_that_is_not_believed() -> None:
    """Of two joints whose rows are both believed a force along the arm leaves nothing; it was the map's fault."""
    hidden = (Check("force_level", "tip", "x", 1.0, (0.0, 0.0, 0.0), 0.0, 0.0, whole) for whole in (True, False))
    assert [str(check).rpartition("at no time: ")[2] for check in hidden] == [
        "the pose hides it",
        "the map believes no row that shows it",
    ]
