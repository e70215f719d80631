"""Added mass as a part of inertia: its energy, its momentum, and the observer that must not notice it."""

import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import instant, plant_of

from aerobat_pin.aerobat import LINKS
from aerobat_pin.aerodynamics.planform import added_mass_factor
from aerobat_pin.flight import Plant, simulate
from aerobat_pin.scenario import load_scenario

LOCAL = pin.ReferenceFrame.LOCAL
SEEDS = range(4)
COLD = "air.warm_up_cycles=0"


@pytest.fixture(scope="module")
def plant() -> Plant:
    return plant_of("paper", COLD)


def test_thin_aerofoil_theory_gives_the_mass_of_the_strips(plant: Plant) -> None:
    """Pi rho b^2 per span, a cylinder of air on each chord: 7.99 g in all, 6.60 g between open tips, 0 by factor 0."""
    line = plant.air.line
    cylinders = np.pi * 1.225 * (line.chord / 2.0) ** 2
    assert 1e3 * float(cylinders @ line.width) == pytest.approx(7.985, abs=1e-3)
    total = float((added_mass_factor(plant.robot.wing.chord, line.span, line.y) * cylinders) @ line.width)
    assert sum(G[0, 0] for G in plant.air.added_mass) == pytest.approx(total, rel=1e-12)
    assert 1e3 * total == pytest.approx(6.600, abs=1e-3)
    part = plant_of("paper", COLD, "air.added_mass=0.85")
    np.testing.assert_allclose(part.air.added_mass, 0.85 * plant.air.added_mass, rtol=1e-12, atol=1e-18)
    assert not plant_of("paper", COLD, "air.added_mass=0.0").air.added_mass.any()


def moving_air(plant: Plant) -> list[tuple[int, np.ndarray, float]]:
    """Return the air of pieces: link, row (6,) of normal velocity (mass m) or turn about span (m b^2 / 8), mass."""
    line, (strip, link, *point, share, _), up = plant.air.line, plant.air.pieces, np.array([0.0, 0.0, 1.0])
    found = []
    for i, joint, place, part in zip(strip, link, np.column_stack(point), share, strict=True):
        mass = part * line.added_mass[i] * line.width[i]
        found.append((joint, np.concatenate([up, np.cross(place, up)]), mass))
        found.append((joint, np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]), mass * line.semichord[i] ** 2 / 8.0))
    return found


@pytest.mark.parametrize("settings", [(), ("air.wind=[1.5, -0.6, 0.4]",), ("air.gust.amplitude=[2.0, 1.0, -1.0]",)])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_force_is_minus_mass_times_the_rate_of_normal_velocity(seed: int, settings: tuple[str, ...]) -> None:
    """What the plant logs against finite differences of kinematics along its own motion; no M_a, no C_a."""
    # A piece's force is -m d/dt(normal . (velocity - wind)), its couple -m b^2/8 times the rate of its turning.
    plant, time = plant_of("paper", COLD, *settings), 0.6
    q, v, joints, air, held = instant(plant, seed)
    acceleration, _, forces = plant.rates(q, v, joints, air, held, time)
    a = plant.robot.velocity(acceleration, *joints[2])
    model, data, h = plant.model, plant.model.createData(), 1e-5

    def seen(t: float) -> np.ndarray:
        here = pin.integrate(model, q, t * v + 0.5 * t * t * a)
        pin.forwardKinematics(model, data, here, v + t * a)
        pin.updateFramePlacements(model, data)
        wind, frames = plant.wind(np.array([time + t]))[0, 0], [model.getFrameId(link) for link in LINKS]
        twists = np.array([pin.getFrameVelocity(model, data, frame, LOCAL).vector for frame in frames])
        twists[:, :3] -= [data.oMf[frame].rotation.T @ wind for frame in frames]
        return np.array([row @ twists[link] for link, row, _ in air_parts])

    air_parts = moving_air(plant)
    rates = (seen(h) - seen(-h)) / (2.0 * h)
    expected = np.zeros(model.nv)
    pin.computeJointJacobians(model, data, q)
    for (link, row, mass), rate in zip(air_parts, rates, strict=True):
        joint = model.frames[model.getFrameId(LINKS[link])].parentJoint
        expected += pin.getJointJacobian(model, data, joint, LOCAL).T @ (-mass * rate * row)
    found = forces.added_mass[0]
    for rows in (slice(0, 3), slice(3, 10)):
        np.testing.assert_allclose(found[rows], expected[rows], rtol=0.0, atol=1e-6 * np.abs(expected[rows]).max())


def test_what_the_added_mass_takes_is_its_kinetic_energy() -> None:
    """Over a flap the work of its force is the fall of v M_a v / 2: power means from the stages, energy at the ends."""
    log = simulate(load_scenario("paper", ["simulation.dt=0.0005", "simulation.duration=0.2"]))
    plant = plant_of("paper", COLD)
    q, v = (log.measured[name].values for name in ("q", "v"))
    seen = plant.in_air.link_twists(q, v)[..., 2:5]
    energy = 0.5 * np.einsum("nli,lij,nlj->n", seen, plant.air.added_mass, seen)
    force = log.truth["added_mass"].values
    # The force varies little within a step: its mean times the mean velocity is its work to second order.
    work = np.cumsum(np.sum(force * 0.5 * (v[1:] + v[:-1]), axis=1)) * 5e-4
    np.testing.assert_allclose(work, energy[0] - energy[1:], rtol=0.0, atol=2e-4 * energy.max())


def test_wings_lighter_than_their_air_fly_without_trouble() -> None:
    """Ten times the air's mass on 42 g of robot: as an explicit force this would diverge within a few steps."""
    log = simulate(load_scenario("paper", ["air.added_mass=10.0", "simulation.duration=0.3", "simulation.dt=0.002"]))
    assert np.all(np.isfinite(log.measured["q"].values))
    assert np.max(np.abs(log.measured["v"].values[:, :3])) < 10.0
