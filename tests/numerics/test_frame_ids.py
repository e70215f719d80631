"""Frames by name, also where a URDF gives one name to a joint and to its link."""

import pinocchio as pin
import pytest

from aerobat_pin.errors import ArgumentError
from aerobat_pin.numerics import frame_id

URDF = """<robot name="arm"><link name="base"/><link name="tip"/><joint name="tip" type="fixed">
<parent link="base"/><child link="tip"/><origin xyz="0 0 0.3"/></joint></robot>"""


def test_a_joint_and_a_link_of_one_name_are_one_frame() -> None:
    """Pinocchio gives both a frame, at the same place, and refuses the name alone."""
    model = pin.buildModelFromXML(URDF)
    with pytest.raises(ValueError, match="Several frames"):
        model.getFrameId("tip")
    assert model.frames[frame_id(model, "tip")].placement.translation[2] == 0.3


def test_frames_of_one_name_at_different_places_are_refused() -> None:
    """Nobody can say which is meant."""
    model = pin.buildModelFromXML(URDF)
    model.addFrame(pin.Frame("tip", 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with pytest.raises(ArgumentError, match="frame 'tip': 3 frames have this name, at different places"):
        frame_id(model, "tip")
