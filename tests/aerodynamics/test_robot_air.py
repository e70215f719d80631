"""The air pushes each link where it should, mirrors with the motion, divides by no speed; from every side, in wind."""

# Twists are those of each link at and in its own frame, linear part first, as Pinocchio's LOCAL velocities.

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.further import further
from support.section_law import AIR, BARE, NO_DRAG, SHAPE, WING, evaluate, gliding

from aerobat_pin.aerobat import LINKS, Aerobat, RobotAir, RobotInAir, Wing, flown_robot, load_aerobat
from aerobat_pin.aerodynamics import AirConstants
from aerobat_pin.errors import AerobatError
from aerobat_pin.flight import Plant, simulate
from aerobat_pin.numerics import fields_of
from aerobat_pin.scenario import load_scenario

DRAGLESS = replace(SHAPE, aerodynamics=NO_DRAG)
MIRRORED_LINKS = [0, 3, 4, 1, 2]
POLAR, AXIAL = np.array([1.0, -1.0, 1.0]), np.array([-1.0, 1.0, -1.0])
SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def robot() -> Aerobat:
    return load_aerobat("aerobat")


def mirror_state(state: np.ndarray) -> np.ndarray:
    """Swap left and right strips in each of the three kinds of state."""
    return state.reshape(3, -1)[:, ::-1].ravel()


def test_the_planform_has_the_published_area_and_spans() -> None:
    """239.15 cm2 a wing; arc of 20.67 (shoulder), 69.47 (elbow) and 201.47 mm (tip) along the joint axes."""
    assert 1e4 * WING.morphology.wing_area == pytest.approx(239.15, abs=5e-3)
    assert 1e3 * np.array(WING.breaks) == pytest.approx([20.6732, 69.4657, 201.4657], abs=5e-5)
    assert 1e3 * WING.span == pytest.approx(402.93, abs=5e-3)
    proximal, distal = SHAPE.wing.proximal_stations[-1], SHAPE.wing.distal_stations[-1]
    assert 2.0 * (25e-3 + proximal + distal) == pytest.approx(0.414)  # the drawing's own span


def test_the_left_wing_is_where_y_is_positive(robot: Aerobat) -> None:
    """Body axes point ahead, left and up, in the arc's coordinate as in the URDF's names."""
    shoulder, elbow, tip = robot.wing.breaks
    places = np.array([-elbow - tip, -shoulder - elbow, 0.0, shoulder + elbow, 1.8 * tip])
    link, _ = robot.wing.attach(0.5 * places)
    names = [LINKS[k] for k in link]
    assert names == ["right_distal", "right_proximal", "base_link", "left_proximal", "left_distal"]


def test_strips_lie_on_the_membrane(robot: Aerobat) -> None:
    """Chords equal the planform's at root, elbow and mid-span; mid-chords lie half a chord behind the leading edge."""
    shoulder, elbow, tip = WING.breaks
    chords = [159.1e-3, 159.1e-3, 187.5e-3, 100.95e-3, 25e-3]
    assert WING.chord([0.0, shoulder, elbow, elbow + 84e-3, tip]) == pytest.approx(chords)
    assert AIR.line.chord == pytest.approx(WING.chord(AIR.line.y))
    # In world axes, wings spread, a strip's leading edge lies where the arc and the planform put it.
    data, pieces = robot.model.createData(), AIR.pieces
    pin.framesForwardKinematics(robot.model, data, pin.neutral(robot.model))
    for strip, link, *point in zip(*pieces[:5], strict=True):
        if np.count_nonzero(pieces.strip == strip) == 1:
            y, chord = AIR.line.y[strip], AIR.line.chord[strip]
            place = data.oMf[robot.model.getFrameId(LINKS[link])].act(np.array(point))
            assert place[0] + chord / 2.0 == pytest.approx(SHAPE.wing.offset_x + WING.leading_edge(y), abs=1e-15)


@settings(max_examples=30, derandomize=True)
@given(SEEDS)
def test_mirrored_motion_gives_mirrored_wrenches(seed: int) -> None:
    """Reflection in the x-z plane: velocities and forces flip y, rates and moments flip x and z, sides change."""
    rng = np.random.default_rng(seed)
    twists, state = 3.0 * rng.normal(size=(5, 6)), 0.1 * rng.normal(size=AIR.state_size)
    flip = np.concatenate([POLAR, AXIAL])
    wrenches, rates, strips = evaluate(AIR, twists, state)
    mirrored, mirrored_rates, mirrored_strips = evaluate(AIR, twists[MIRRORED_LINKS] * flip, mirror_state(state))
    assert mirrored == pytest.approx(wrenches[MIRRORED_LINKS] * flip, rel=1e-9, abs=1e-9 * np.abs(wrenches).max())
    assert mirrored_rates == pytest.approx(mirror_state(rates), rel=1e-9, abs=1e-9 * np.abs(rates).max())
    assert mirrored_strips.force_z == pytest.approx(strips.force_z[::-1], rel=1e-9, abs=1e-9)


def test_the_tail_pushes_against_sink_and_pitching() -> None:
    """Sinking lifts it (nose down), pitching nose up is damped, its nose-up angle lifts, downwash presses it."""
    air, without = (RobotAir(Wing(replace(DRAGLESS, tail=tail))) for tail in (SHAPE.tail, None))
    raised = RobotAir(Wing(replace(DRAGLESS, tail=replace(SHAPE.tail, incidence=0.03))))

    def push(twists: np.ndarray, which: RobotAir = air, circulation: float = 0.0) -> np.ndarray:
        state = np.concatenate([np.zeros(32), np.full(16, circulation)])
        return evaluate(which, twists, state)[0][0] - evaluate(without, twists, state)[0][0]

    sinking, pitching = push(gliding(3.0, np.radians(2.0))), gliding(3.0, 0.0)
    pitching[:, 4] = -1.0  # nose up, so the tail moves down
    assert min(sinking[2], sinking[4], push(pitching)[4], push(gliding(3.0, 0.0), raised)[2]) > 0.0
    assert push(gliding(3.0, 0.0), circulation=0.1)[2] < 0.0


@pytest.mark.parametrize("incidence", [0.0, 30.0, 90.0, 150.0, 180.0, -90.0])
@pytest.mark.parametrize("speed", [0.0, 1e-300, 1e-9, 5.0])
def test_any_speed_and_incidence_gives_finite_loads_without_a_warning(speed: float, incidence: float) -> None:
    """Rest, creeping, broadside, backward, one link still. At 1e-300 m/s, with no square, a product may round to 0."""
    twists = gliding(speed, np.radians(incidence))
    state = 0.1 * np.random.default_rng(9).normal(size=AIR.state_size)
    with np.errstate(all="raise", under="ignore" if speed == 1e-300 else "raise"):
        for still in (None, 0, 2):
            if still is not None:
                twists[still] = 0.0
            for array in evaluate(AIR, twists, state)[:2]:
                assert np.all(np.isfinite(array))
    if speed == 0.0:
        wrenches, _, _ = evaluate(AIR, gliding(0.0, 0.0), np.zeros(AIR.state_size))
        assert not wrenches.any()


def test_the_log_holds_what_each_strip_and_link_does() -> None:
    """Incidence, downwash, circulation and forces per strip; wrench per link; power; as the object gives them."""
    scenario = load_scenario("paper", ["simulation.duration=0.01"])
    log, plant = simulate(scenario), Plant(flown_robot(scenario), scenario)
    q, v = (log.measured[name].values[7:8] for name in ("q", "v"))
    twists = RobotInAir(plant.robot, AIR).link_twists(q, v)[0]
    _, _, strips = evaluate(plant.air, twists, log.truth["air_state"].values[7])
    for name in "airspeed incidence downwash circulation strip_force_x strip_force_z".split():
        found = getattr(strips, name.removeprefix("strip_"))
        assert log.truth[name].dims == ("interval", "strip")
        assert log.truth[name].values[7] == pytest.approx(found, rel=1e-9, abs=1e-12)
    downwash = plant.air.line.downwash @ strips.circulation
    assert strips.downwash == pytest.approx(downwash, rel=1e-9, abs=1e-12)
    assert log.truth["link_wrench"].shape == (10, 5, 6)
    assert log.truth["air_power"].attrs["units"] == "W"


WIND = np.array([-1.3, 0.8, 0.5])


@pytest.mark.parametrize("model", ["lifting_line", "quasi_steady"])
def test_flying_in_moving_air_is_flying_in_still_air_seen_from_a_moving_cart(model: str) -> None:
    """Galilei: wind and start shifted by one velocity: the same flight, shifted by it times time; with added mass."""
    start = np.array([5.0, 0.0, 0.0])
    options = ["unknown_force=[]", f"air.model={model}", "simulation.duration=0.3", "flight.gravity=2.0"]
    logs = []
    for wind in (np.zeros(3), WIND):
        moving = f"air.wind={wind.tolist()}", f"flight.velocity={(start + wind).tolist()}"
        logs.append(simulate(load_scenario("paper_open_loop", [*moving, *options])))
    still, windy = (log.measured for log in logs)
    drift = np.outer(still["time"].values, WIND)
    np.testing.assert_allclose(windy["q"].values[:, :3] - drift, still["q"].values[:, :3], atol=1e-9)
    np.testing.assert_allclose(windy["q"].values[:, 3:], still["q"].values[:, 3:], atol=1e-9)
    for name in ("aerodynamic", "added_mass", "motor_torque"):
        side = "measured" if name == "motor_torque" else "truth"
        expected, found = (getattr(log, side)[name].values for log in logs)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(logs[1].truth["circulation"], logs[0].truth["circulation"], atol=1e-7)


def test_flow_from_behind_is_flow_from_ahead_in_a_mirror() -> None:
    """All velocities turned by half a turn about z, chords' ends swapped: the same strip from behind; Fx, My turn."""
    air = RobotAir(Wing(replace(SHAPE, tail=None)))
    fields_of(air.memory, AirConstants).pieces.x[:] = 0.0
    turn = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])  # reflection in the y-z plane: u, omega_y, omega_z change sign
    rng = np.random.default_rng(12)
    twists, state = rng.normal(size=(5, 6)), 0.1 * rng.normal(size=air.state_size)
    ahead, rates, strips = evaluate(air, twists, state)
    behind, same, mirrored = evaluate(air, twists * turn, state)
    assert behind == pytest.approx(ahead * turn, rel=1e-12, abs=1e-15)
    assert same == pytest.approx(rates, rel=1e-12)
    assert mirrored.lead == pytest.approx(-strips.lead, rel=1e-12)


@pytest.mark.parametrize("options", [{}, *further({"lift_limit": 1.5}, {"model": "quasi_steady"})])
def test_no_load_jumps_as_the_flow_turns_all_the_way_round(options: dict[str, Any]) -> None:
    """Loads at 8,000 incidences: no step of 0.8 mrad changes one by more than others, as suction at broadside did."""
    air = RobotAir(WING, **options)
    state = 0.05 * np.random.default_rng(13).normal(size=air.state_size)
    angles = np.linspace(-np.pi, np.pi, 8001)
    found = np.array([evaluate(air, gliding(3.0, angle), state)[0].ravel() for angle in angles])
    step = np.max(np.abs(np.diff(found, axis=0)), axis=0)
    assert np.all(step <= 0.01 * np.ptp(found, axis=0) + 1e-12)


def test_the_lift_limit_bends_the_lift_and_is_never_passed() -> None:
    """Steady CL of the strips: 1.5 % less at half the limit, 2^(-1/4) of it where the line alone would reach it."""
    free, limited = (RobotAir(Wing(replace(SHAPE, tail=None)), lift_limit=limit) for limit in (None, 1.5))
    line, state = free.line, np.zeros(free.state_size)
    for degrees in np.linspace(-80.0, 80.0, 33):
        twists = gliding(3.0, np.radians(degrees))
        cl, bent = (
            2.0 * 2.0 * np.pi * evaluate(air, twists, 0.0 * state)[2].effective_velocity / 3.0 / 2.0
            for air in (free, limited)
        )
        assert np.all(np.abs(bent) < 1.5)
        assert bent == pytest.approx(cl / (1.0 + (cl / 1.5) ** 4) ** 0.25, rel=1e-12)
    assert line.strips == limited.line.strips
    wild = evaluate(RobotAir(Wing(SHAPE), lift_limit=1.5), gliding(3.0, 0.7), np.full(48, 10.0))[2]
    assert np.all(np.abs(2.0 * np.pi * wild.effective_velocity / wild.airspeed) <= 1.5)


@pytest.mark.parametrize(
    ("degrees", "cl", "cd"), [(0.0, 0.0, 0.3927), (9.0, 0.5527, 0.3872), (45.0, 1.8046, 1.7037), (90.0, 0.0, 3.4609)]
)
def test_the_quasi_steady_wing_has_dickinsons_coefficients(degrees: float, cl: float, cd: float) -> None:
    """CL = 0.225 + 1.58 sin(2.13 a - 7.2), CD = 1.92 - 1.55 cos(2.04 a - 9.82), by hand; CL led to 0 at 0 and 90."""
    # Source: Dickinson, Lehmann & Sane 1999, Science 284, 1954.
    air = RobotAir(Wing(replace(SHAPE, tail=None, aerodynamics=NO_DRAG)), model="quasi_steady")
    angle, area = np.radians(degrees), air.line.width * air.line.chord
    wrenches, rates, strips = evaluate(air, gliding(4.0, angle), np.zeros(0))
    assert rates.shape == (0,)
    dynamic = 0.5 * 1.225 * 16.0 * area
    lift = (strips.force_x * np.sin(angle) + strips.force_z * np.cos(angle)) / dynamic
    drag = (-strips.force_x * np.cos(angle) + strips.force_z * np.sin(angle)) / dynamic
    assert lift == pytest.approx(np.full(16, cl), abs=1e-4)
    assert drag == pytest.approx(np.full(16, cd), abs=1e-4)
    kutta = 1.225 * 4.0 * strips.circulation * air.line.width
    assert kutta == pytest.approx(cl * dynamic, abs=1e-4 * dynamic.max())
    down = evaluate(air, gliding(4.0, -angle), np.zeros(0))[0]
    assert down[1:, 2] == pytest.approx(-wrenches[1:, 2], rel=1e-12, abs=1e-15)


def test_nonsense_is_refused_by_name() -> None:
    """An unknown model, limits and factors that are none."""
    for options, message in (
        ({"model": "vortex"}, "one of lifting_line, quasi_steady was expected"),
        ({"lift_limit": 0.0}, "lift_limit = 0.0"),
        ({"added_mass": -1.0}, "added_mass = -1.0"),
        ({"air_density": -1.0}, "air_density = -1.0"),
    ):
        with pytest.raises(AerobatError, match=message):
            RobotAir(WING, **options)


@pytest.mark.parametrize("strips", [1, 2, 7, 16, 29, 64])
def test_the_pieces_cover_every_strip_and_every_link_once(strips: int) -> None:
    """Shares of a strip sum to 1, lengths to the link's, mirrored; a joint on a strip's edge leaves no sliver."""
    air = RobotAir(WING, strips=strips)
    pieces, (shoulder, elbow, tip) = air.pieces, WING.breaks
    assert np.bincount(pieces.strip, pieces.share) == pytest.approx(np.ones(strips), rel=1e-14)
    edges = np.concatenate([[0.0], (np.arange(1, strips) + 0.5), [strips + 1.0]]) * np.pi / (strips + 1)
    length = -np.diff(0.5 * WING.span * np.cos(edges))[pieces.strip] * pieces.share
    on_links = [2.0 * shoulder, *[elbow - shoulder, tip - elbow] * 2]
    assert np.bincount(pieces.link, length) == pytest.approx(on_links, rel=1e-6)
    other = np.array([0, 3, 4, 1, 2])[pieces.link[::-1]]
    np.testing.assert_array_equal(pieces.link, other)
    np.testing.assert_allclose(pieces.y, -pieces.y[::-1], atol=1e-15)
    assert pieces.share.min() > 1e-3
    # The air that the links carry along is that of the strips, wherever the joints fall.
    carried = air.line.added_mass @ air.line.width
    assert sum(G[0, 0] for G in air.added_mass) == pytest.approx(carried, rel=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_the_links_power_is_the_strips_force_times_the_strips_velocity(seed: int) -> None:
    """A strip across a joint gives each link its share of force, and moves with their mean velocity: equal power."""
    rng = np.random.default_rng(seed)
    twists = np.zeros((5, 6))
    twists[:, [1, 2, 3]] = rng.normal(size=(5, 3))  # broadside: the links rise and flap, none moves forward
    wrenches, _, strips = evaluate(BARE, twists, 0.1 * rng.normal(size=BARE.state_size))
    assert not strips.lead.any()
    assert np.sum(wrenches * twists) == pytest.approx(-strips.force_z @ strips.w, rel=1e-12, abs=1e-15)
