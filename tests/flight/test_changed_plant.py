"""A plant that is not what is believed: elastic joints, a slipped encoder, a payload, other air."""

import copy
import re
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import plant_of

from aerobat_pin.aerobat import JOINTS, FlightLog, believed_robot, flown_robot
from aerobat_pin.errors import ScenarioError
from aerobat_pin.flight import Plant, Trajectory, simulate
from aerobat_pin.linkage import SeriesSculpture
from aerobat_pin.scenario import Scenario, load_scenario

SHORT = ("simulation.duration=0.3", "air.warm_up_cycles=1")
ELBOW = ("plant.elbow.stiffness=0.2", "plant.elbow.damping=2e-4")
BOTH = (*ELBOW, "plant.shoulder.stiffness=0.5", "plant.shoulder.damping=1e-3")
VACUUM = ("plant.air_density=1e-12", "air.warm_up_cycles=0")
SLIPPED = ("plant.crank_zero_deg=2.0",)
PAYLOAD = ("plant.payload.mass=0.009", "plant.payload.position=[0.03,0.005,0.02]")


def still(plant: Plant, duration: float, bent: list[float], dt: float = 1e-3) -> Trajectory:
    count = round(duration / dt)
    start = replace(plant.initial, bent=np.array(bent))
    return plant.fly(count, dt, np.zeros((2, len(plant.forces), count)), start=start)


@cache
def flown(*settings: str) -> tuple[FlightLog, Scenario]:
    """Fly `paper` for 0.3 s."""
    scenario = load_scenario("paper", [*SHORT, *settings])
    return simulate(scenario), scenario


@pytest.mark.parametrize(("stiffness", "damping"), [(0.2, 2e-4), (0.1, 8e-3)])
def test_one_joint_swings_at_its_frequency_and_decays_by_its_damping(stiffness: float, damping: float) -> None:
    """On a body too heavy to move, without air and gravity: I d'' + c d' + k d = 0, I the outer wing's at its hinge."""
    springs = (f"plant.elbow.stiffness={stiffness}", f"plant.elbow.damping={damping}")
    rest = ("flight.gravity=0", "crank.frequency=0", "flight.angular_velocity=[0,0,0]", "unknown_force=[]")
    scenario = load_scenario("tumble", [*VACUUM, *rest, *springs])
    robot = flown_robot(scenario)
    robot = replace(robot, model=robot.model.copy())
    robot.model.inertias[1] = pin.Inertia(1e9, np.zeros(3), 1e9 * np.eye(3))
    plant = Plant(robot, scenario)
    found = still(plant, 0.2, [0.1, 0.1, 0.0, 0.0], 2.5e-4)
    wing = plant.model.inertias[plant.model.getJointId("left_elbow")]
    c = wing.lever
    about = wing.inertia + wing.mass * (c @ c * np.eye(3) - np.outer(c, c))
    hinge = np.ravel(plant.fields.robot.tree.axis[plant.elastic.links[0]])
    inertia = float(hinge @ about @ hinge)
    decay, t = 0.5 * damping / inertia, np.arange(801) * 2.5e-4
    swing = np.sqrt(complex(stiffness / inertia - decay**2))
    expected = 0.1 * np.real(np.exp(-decay * t) * (np.cos(swing * t) + decay / swing * np.sin(swing * t)))
    np.testing.assert_allclose(found.deflection[:, 1], expected, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found.deflection[:, 3], expected, rtol=0.0, atol=1e-6)
    assert not found.deflection[:, [0, 2]].any()


def test_four_elastic_joints_fly_as_in_mujoco() -> None:
    """Gravity, flapping, payload: MuJoCo's reading of the URDF, matrix and Runge-Kutta, with our law of springs."""
    plant = plant_of("tumble", *VACUUM, *BOTH, *PAYLOAD, "unknown_force=[]")
    robot, bent = plant.robot, [0.1, -0.05, 0.02, 0.08, 0.0, 0.0, 1.0, -2.0]
    found = still(plant, 0.2, bent)
    text = re.sub(r"<(visual|collision|mujoco)\b.*?</\1>", "", robot.text, flags=re.DOTALL)
    floating = '<joint name="free" type="floating"><parent link="world"/><child link="base_link"/></joint>'
    point = (
        '<inertial><origin xyz="0.03 0.005 0.02"/><mass value="0.009"/><inertia ixx="1e-12" iyy="1e-12" izz="1e-12" '
    )
    fixed = '<joint name="holds" type="fixed"><parent link="base_link"/><child link="payload"/></joint>'
    more = (
        f'<link name="payload">{point}ixy="0" ixz="0" iyz="0"/></inertial></link>{fixed}<link name="world"/>{floating}'
    )
    options = '<mujoco><compiler balanceinertia="false" boundmass="0" boundinertia="0"/></mujoco>'
    model = mujoco.MjModel.from_xml_string(text.replace("</robot>", f"{options}{more}</robot>"))
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 2e-4
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, linkage = mujoco.MjData(model), SeriesSculpture(robot.linkage)
    q, v = found.q[0], found.v[0]
    data.qpos[:3], data.qpos[3:7] = q[:3], q[[6, 3, 4, 5]]
    rotation = pin.Quaternion(q[3:7]).matrix()
    data.qvel[:3], data.qvel[3:6] = rotation @ v[:3], v[3:6]
    places = [(model.joint(name).qposadr[0], model.joint(name).dofadr[0]) for name in JOINTS]
    angles, rates = (list(one) for one in zip(*places, strict=True))
    data.qpos[angles], data.qvel[rates] = q[list(robot.idx_q)], v[list(robot.idx_v)]
    k, c = np.array([0.5, 0.2, 0.5, 0.2]), np.array([1e-3, 2e-4, 1e-3, 2e-4])
    crank = found.crank_rate[0]

    def springs(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        at = linkage.solve(found.crank_angle[0] + crank * data.time, crank)
        away = data.qpos[angles] - [at.theta_s, at.theta_e] * 2
        data.qfrc_applied[rates] = -k * away - c * (data.qvel[rates] - [at.theta_s_dot, at.theta_e_dot] * 2)

    rows = []
    mujoco.set_mjcb_control(springs)
    try:
        for _ in range(200):
            for _ in range(5):
                mujoco.mj_step(model, data)
            rows.append([*data.qpos[:3], *data.qpos[[4, 5, 6, 3]], *data.qpos[angles]])
    finally:
        mujoco.set_mjcb_control(None)
    theirs, ours = np.array(rows), found.q[1:][:, [*range(7), *robot.idx_q]]
    assert np.ptp(ours[:, 2]) > 0.05
    assert np.max(np.abs(found.deflection)) > 0.2
    np.testing.assert_allclose(ours[:, :3], theirs[:, :3], rtol=0.0, atol=2e-6)
    np.testing.assert_allclose(ours[:, 3:7], theirs[:, 3:7], rtol=0.0, atol=2e-5)
    np.testing.assert_allclose(ours[:, 7:], theirs[:, 7:], rtol=0.0, atol=2e-4)


def test_energy_goes_through_springs_and_no_other_way() -> None:
    """In air, held, pushed, the crank on its motor: what drive, air, hold and pushes give is stored or damped."""
    log, scenario = flown(*BOTH, "crank.drive=motor", "crank.motor.start_frequency=4.75")
    truth, robot, dt = log.truth, flown_robot(scenario), scenario.simulation.dt
    data = robot.model.createData()
    states = zip(truth["q"].values, truth["v"].values, strict=True)
    stored = [pin.computeMechanicalEnergy(robot.model, data, q, v) for q, v in states]
    d, k, c = truth["deflection"].values, np.array([0.5, 0.2, 0.5, 0.2]), np.array([1e-3, 2e-4, 1e-3, 2e-4])
    energy = np.array(stored) + 0.5 * d**2 @ k
    given = sum(truth[f"{name}_power"].values for name in ("motor", "air", "thruster", "unknown"))
    linkage = robot.linkage.solve(truth["crank_angle"].values, truth["crank_rate"].values)
    driven = np.stack([linkage.theta_s_dot, linkage.theta_e_dot] * 2, axis=1)
    rates = truth["v"].values[:, list(robot.idx_v)] - driven
    lost = rates**2 @ c
    balance = energy[0] + dt * np.cumsum(given - 0.5 * (lost[1:] + lost[:-1]))
    np.testing.assert_allclose(energy[1:], balance, rtol=0.0, atol=2e-3 * np.ptp(energy))


def test_a_robot_without_sensors_at_its_joints_shows_what_its_encoder_makes_of_them() -> None:
    """Elastic or slipped: measured joints follow the linkage at the encoder's angle; those that moved are the truth."""
    for settings, zero in ((ELBOW, 0.0), (SLIPPED, np.radians(2.0))):
        log, scenario = flown(*settings)
        robot, truth = believed_robot(scenario), log.truth
        np.testing.assert_allclose(log.measured["crank_angle"] - truth["crank_angle"], zero, rtol=0.0, atol=1e-12)
        shown = robot.linkage.solve(log.measured["crank_angle"].values)
        joints = log.measured["q"].values[:, list(robot.idx_q)]
        np.testing.assert_array_equal(joints, np.stack([shown.theta_s, shown.theta_e] * 2, axis=1))
        away = np.abs(truth["q"].values[:, list(robot.idx_q)] - joints).max(axis=0)
        assert away[1] > 0.02
        np.testing.assert_array_equal(truth["q"].values[:, :7], log.measured["q"].values[:, :7])
    seen, scenario = flown(*ELBOW, "sensors.joint_angle.noise=0", "sensors.joint_rate.noise=0")
    hidden, _ = flown(*ELBOW)
    for name in ("q", "v"):
        np.testing.assert_array_equal(seen.measured[name], hidden.truth[name])


def test_raw_samples_come_from_a_slipped_encoder_too() -> None:
    """The encoder's counts are two degrees further, the truth is not."""
    settings = ["simulation.duration=0.1", "air.warm_up_cycles=0"]
    good, slipped = (simulate(load_scenario("raw_sensors", [*settings, *more])) for more in ((), SLIPPED))
    away = slipped.measured["encoder"].values - good.measured["encoder"].values
    assert np.degrees(away) == pytest.approx(2.0, abs=0.1)
    for name in ("q", "v", "crank_angle", "motor_torque"):
        np.testing.assert_array_equal(slipped.truth[name], good.truth[name])


def test_payload_and_air_change_the_flight_and_no_belief() -> None:
    """Weight and lever at rest, lift with the density; the log tells the belief of a flight without them."""
    plain, changed = plant_of("paper"), plant_of("paper", *PAYLOAD, "plant.air_density=0.9")
    assert changed.robot.mass == pytest.approx(plain.robot.mass + 0.009, rel=1e-12)
    body, loaded = plain.model.inertias[1], changed.model.inertias[1]
    lever = (loaded.mass * loaded.lever - body.mass * body.lever) / 0.009 - body.lever
    np.testing.assert_allclose(lever, [0.03, 0.005, 0.02], rtol=0.0, atol=1e-12)
    log, scenario = flown(*PAYLOAD, "plant.air_density=0.9")
    good, _ = flown()
    for name in ("air", "morphology", "morphology_changes"):
        assert log.measured.attrs[name] == good.measured.attrs[name]
    assert believed_robot(scenario).mass == pytest.approx(plain.robot.mass, rel=1e-12)
    again = copy.deepcopy(changed)
    assert again.robot.mass == changed.robot.mass


def test_a_joint_too_stiff_for_the_step_is_refused_with_what_would_do() -> None:
    """Cutting steps ever finer would take for ever, and nobody asked for it."""
    with pytest.raises(ScenarioError, match=r"plant.elbow: the fastest mode.*at most 20 were expected.*rigid joint"):
        plant_of("paper", "plant.elbow.stiffness=1e4", "air.warm_up_cycles=1")
