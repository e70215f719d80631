"""The robot as drawn: bars meet at their pins, wings hang on the shoulders, and nothing passes through the body."""

import itertools
import tomllib
from functools import cache

import coal
import numpy as np
import pinocchio as pin
import pytest
from support.readers import PACKAGE, ROBOTS

from aerobat_description.bars import LAYERS, LINK_OF, linkage_bars
from aerobat_description.meshes import panels
from aerobat_pin.aerobat import Aerobat, load_aerobat, place_bars, visual_model_with_bars
from aerobat_pin.aerobat.closed_model import bar_placements
from aerobat_pin.errors import ShapeError

SIDES = ("left", "right")
MEMBRANES = ("proximal_membrane", "distal_membrane")
TURN = np.radians(np.arange(0.0, 360.0, 10.0))
TILTED = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.7, 2.1), np.array([1.0, -2.0, 3.0]))


@cache
def robot(name: str) -> Aerobat:
    return load_aerobat(name)


def configuration(one: Aerobat, crank_angle: float, base: pin.SE3) -> np.ndarray:
    closure = one.linkage.solve(crank_angle)
    return one.configuration(pin.SE3ToXYZQUAT(base), closure.theta_s, closure.theta_e)


def pins_of(one: Aerobat, crank_angle: float, base: pin.SE3) -> dict[tuple[str, str, str], np.ndarray]:
    """Return every pin of every bar in world axes by side, bar and pin: L3 and L7 from the tree, the rest as placed."""
    data = one.model.createData()
    pin.framesForwardKinematics(one.model, data, configuration(one, crank_angle, base))
    placed, found = {bar: base * place for bar, place in bar_placements(one, crank_angle).items()}, {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for name, bar in linkage_bars(one.morphology.linkage).items():
            if name in LINK_OF:
                frame = data.oMf[one.model.getFrameId(f"{side}_{LINK_OF[name]}")]
            else:
                frame = placed[f"{side}_{name}"]
            for pivot, at in bar.pins.items():
                found[side, name, pivot] = frame.act(np.array([0.0, sign * at.real, at.imag]))
        for pivot in ("J1", "J8"):
            found[side, "body", pivot] = data.oMf[one.model.getFrameId(f"{side}_linkage_{pivot}")].translation.copy()
    return found


@ROBOTS
def test_bars_meet_their_neighbours_at_every_pin(name: str) -> None:
    """To 1e-9 m over a turn, both sides, in world axes with a tilted base; a pin joins two bars, or bar and body."""
    for crank_angle in TURN:
        found = pins_of(robot(name), crank_angle, TILTED)
        for side in SIDES:
            for number in (1, 2, 3, 4, 6, 7, 8, 9, 10):
                meeting = [at for (s, _, pivot), at in found.items() if (s, pivot) == (side, f"J{number}")]
                assert len(meeting) == 2
                assert np.linalg.norm(meeting[0] - meeting[1]) < 1e-9


def test_a_crank_angle_that_is_no_number_is_refused() -> None:
    with pytest.raises(ShapeError, match="finite"):
        bar_placements(robot("aerobat"), float("nan"))


@ROBOTS
def test_the_linkage_beside_the_urdf_animates_the_robot(name: str) -> None:
    """From the TOML file alone, as its header says: bars meet, tree angles are the linkage's, meshes are there."""
    one = robot(name)
    data = tomllib.loads((PACKAGE / "linkage" / f"{name}.toml").read_text())
    turn = {key: np.array(values) for key, values in data["turn"].items()}
    closure = one.linkage.solve(turn["L1"])
    for angle, exact in (("theta_s", closure.theta_s), ("theta_e", closure.theta_e)):
        assert np.max(np.abs(turn[angle] - exact)) < 1e-9
        joint = next(joint for joint in data["joints"] if joint["angle"] == angle)
        assert joint["range"] == pytest.approx([exact.min(), exact.max()], abs=1e-9)
        assert all(one.model.existJointName(joint[side]) for side in SIDES)
    assert np.max(np.abs(turn["L7"] - turn["L3"] - turn["theta_e"])) < 1e-8
    assert all(np.max(np.abs(np.diff(column))) < 0.3 for column in turn.values())
    pins: dict[tuple[str, str], np.ndarray] = {("base_link", p): np.array(data["pivots"][p]) for p in ("J1", "J8")}
    for bar in data["bars"]:
        assert all((PACKAGE / bar[f"{side}_mesh"]).is_file() for side in SIDES)
        along = np.exp(1j * turn[bar["name"]])
        if "carrier" in bar:
            start = pins[bar["carrier"], bar["origin"]]
        else:  # a link of the tree: the shoulder, or the elbow on the humerus
            assert one.model.existFrame(bar["left_link"])
            start = np.array(data["pivots"]["J5"]) if bar["origin"] == "J5" else pins["L3", "J6"]
        for pivot, (out, up) in bar["pins"].items():
            at = along * complex(out, up)
            pins[bar["name"], pivot] = start + np.column_stack([at.real, at.imag])
    for first, second, pivot in (("L2", "L3", "J4"), ("L4", "L5", "J7"), ("L6", "L7", "J10")):
        assert np.max(np.abs(pins[first, pivot] - pins[second, pivot])) < 1e-9


def clearance(one: Aerobat, pairs: list[tuple[str, str]]) -> float:
    """Return the least distance [m] between pairs of visible parts over a turn of the crank."""
    picture, data = visual_model_with_bars(one), one.model.createData()
    found = []
    for crank_angle in TURN:
        place_bars(one, picture, crank_angle)
        placed = picture.createData()
        q = configuration(one, crank_angle, pin.SE3.Identity())
        pin.updateGeometryPlacements(one.model, data, picture, placed, q)
        for pair in pairs:
            sides = []
            for part in pair:
                index = picture.getGeometryId(part)
                at = placed.oMg[index]
                sides += [picture.geometryObjects[index].geometry, coal.Transform3s(at.rotation, at.translation)]
            found.append(coal.distance(*sides, coal.DistanceRequest(), coal.DistanceResult()))
    return float(min(found))


@ROBOTS
def test_bars_of_a_wing_touch_only_where_a_pin_joins_them(name: str) -> None:
    """Every pair of bars without a common pin keeps clear over the turn."""
    bars = linkage_bars(robot(name).morphology.linkage)
    apart = [(a, b) for a, b in itertools.combinations(bars, 2) if not set(bars[a].pins) & set(bars[b].pins)]
    assert len(apart) == 21 - 7
    assert clearance(robot(name), [(f"left_{a}", f"left_{b}") for a, b in apart]) > 0.1e-3


def test_the_guard_keeps_clear_of_wings_and_bars() -> None:
    """Ring, arms, motors and propellers, by 2 mm; the ring passes through the thrusters that it carries."""
    one = robot("aerobat_guard")
    moving = [f"{side}_{part}" for side in SIDES for part in (*MEMBRANES, *LAYERS)]
    assert clearance(one, [(part, other) for part in ("guard", "motors", "propellers") for other in moving]) > 2e-3
    ring = one.morphology.guard
    for thruster in one.morphology.thrusters:
        x, y, _ = thruster.position
        level = np.hypot((x - ring.centre) / ring.radius[0], y / ring.radius[1])
        assert level == pytest.approx(0.833 if thruster.name in ("thruster_3", "thruster_4") else 1.0, abs=3e-3)


@ROBOTS
def test_wings_hang_on_the_shoulders_and_meet_at_the_elbows(name: str) -> None:
    """The root edge is 5 mm outboard of the shoulder axis, and the panels share their edge on the elbow axis."""
    one = robot(name)
    drawn, elbow = panels(one.morphology), np.array(one.morphology.elbow)
    for corner in drawn["proximal"][0]:
        assert np.hypot(*corner[1:]) == pytest.approx(5e-3, abs=1e-9)
    for inner, outer in zip(drawn["proximal"][-1], drawn["distal"][0], strict=True):
        assert np.array(inner) == pytest.approx(elbow + outer, abs=1e-12)
    picture = {item.name: item.geometry.vertices() for item in one.visual_model.geometryObjects}
    for panel in MEMBRANES:  # and this is what the picture shows, on both sides
        corners = np.array(drawn[panel.removesuffix("_membrane")]).reshape(-1, 3)
        for side, sign in (("left", 1.0), ("right", -1.0)):
            away = picture[f"{side}_{panel}"][:, None] - corners * [1.0, sign, 1.0]
            assert np.linalg.norm(away, axis=2).min(axis=1).max() < 0.5e-3


@ROBOTS
def test_wings_and_bars_pass_the_body_and_those_of_the_other_side(name: str) -> None:
    """Half a millimetre at least over a full flap."""
    wings = [f"{side}_{panel}" for side in SIDES for panel in MEMBRANES]
    pairs = [(part, wing) for part in ("body", "frame", "tail") for wing in wings]
    pairs += [("body", f"{side}_{bar}") for side in SIDES for bar in LAYERS]
    for kind in (MEMBRANES, LAYERS):
        pairs += [(f"left_{one}", f"right_{other}") for one in kind for other in kind]
    assert clearance(robot(name), pairs) > 0.5e-3
