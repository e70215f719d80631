"""Rows of the joint smoother against difference quotients of what they linearise."""

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.aerobat.raw.channels import SensorSamples
from aerobat_pin.aerobat.raw.dynamics import LinearDynamics, wings_by_crank
from aerobat_pin.aerobat.raw.layout import POSE_ERROR, TWIST_ERROR, Layout
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion, wing_angles, wing_motion
from aerobat_pin.aerobat.raw.rows import ROWS_BY_SENSOR, Sensed
from aerobat_pin.linkage import joint_series

SMALL = 1e-6


def test_an_accelerometer_feels_what_its_row_says() -> None:
    """Random motions of the body, changed a little at the middle of each interval; exact to second order."""
    rng, m, layout = np.random.default_rng(2), 3, Layout(2, mount=True)
    draw = rng.standard_normal
    none, time = np.zeros((m, 0)), np.arange(m + 1.0)
    A, push, x = draw((m, 6, layout.size)), SMALL * draw((m, 6)), SMALL * draw(layout.size)
    A[:, :, layout.mount_at] = 0.0  # where a sensor sits moves nothing
    ad_half, half, up = draw((m, 6, 6)), np.full((m, 1, 1), 0.5), draw((m, 3))
    here = LinearDynamics(none, none, A, push, none, none, none, half, ad_half, draw((m, 6)), draw((m, 6)), up)
    da = push + A @ x
    twist, pose = x[TWIST_ERROR] + 0.5 * da, ad_half @ x[POSE_ERROR] + 0.5 * x[TWIST_ERROR]
    there = here._replace(
        acceleration=0.0 * A,
        push=0.0 * push,
        middle_twist=here.middle_twist + twist,
        middle_acceleration=here.middle_acceleration + da,
        up=np.array([pin.exp3(-turn) @ one for turn, one in zip(pose[:, 3:], up, strict=True)]),
    )
    place, turn, mount = draw(3), pin.exp3(draw(3)), x[layout.mount_at]
    still = NominalMotion(time, none, none, none, none)
    k, middles, values = np.arange(m), time[:-1] + 0.5, draw((m, 3))

    def rows(d: LinearDynamics, place: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sensor = SensorSamples("accelerometer", middles, values, 1.0, place, turn)
        h, e, _ = ROWS_BY_SENSOR["accelerometer"](Sensed(sensor, layout, still, d, "none", k, middles, values))
        return h, e

    h, before = rows(here, place, turn)
    _, after = rows(there, place + mount[:3], turn @ pin.exp3(mount[3:]))
    np.testing.assert_allclose(before - after, h @ x - x[layout.accelerometer_bias], atol=1e3 * SMALL**2)


def test_joints_move_with_the_crank_as_their_derivatives_say() -> None:
    """Angles, rates and accelerations of the joints by those of the crank: difference quotients, to 1e-5."""
    series, crank = joint_series(load_aerobat().linkage), np.array([[0.7], [40.0], [900.0]])

    def joints(crank: np.ndarray) -> np.ndarray:
        return np.stack(wing_motion(wing_angles(series, crank[0]), *crank[1:, :, None]), axis=1).ravel()

    found = wings_by_crank(wing_angles(series, crank[0]), *crank[1:, :, None])[0]
    for column, step in enumerate((1e-5, 1e-3, 1e-3)):
        ahead, behind = (crank + sign * step * np.eye(3)[:, column : column + 1] for sign in (1.0, -1.0))
        slope = (joints(ahead) - joints(behind)) / (2.0 * step)
        np.testing.assert_allclose(found[:, column], slope, atol=1e-5 * np.abs(slope).max())
