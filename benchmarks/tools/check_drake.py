"""Drake: dynamics of the URDF, contacts over a turn, and the closed linkage of the MJCF."""

import json
import logging
import sys
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

import aerobat_description as description

logging.getLogger("drake").setLevel(logging.ERROR)  # it names each tag of the MJCF that it does not know


def loaded(path: Path) -> tuple:
    """Return plant, its context, and the port that asks for contacts."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-4)
    parser = Parser(plant)
    parser.package_map().AddPackageXml(description.PACKAGE_PATH + "/package.xml")
    parser.AddModels(str(path))
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    return plant, plant.GetMyMutableContextFromRoot(root), plant.get_geometry_query_input_port(), (diagram, root)


def dynamics_error(plant, context, joints: list[str], state: dict) -> float:
    """Compare mass matrix and bias; Drake has the base's angular velocity first, and world axes."""
    base, v = plant.GetBodyByName("base_link"), np.array(state["velocity"])
    x, y, z, w = state["quaternion"]
    R = RotationMatrix(Quaternion(w, x, y, z))
    plant.SetFreeBodyPose(context, base, RigidTransform(R, state["position"]))
    R = R.matrix()
    P, change, start = np.zeros((10, 10)), np.zeros((10, 10)), base.floating_velocities_start_in_v()
    P[start : start + 3, 3:6] = P[start + 3 : start + 6, :3] = R
    change[start + 3 : start + 6, :3] = R @ np.cross(v[3:6], np.eye(3)).T  # times the matrix of w x
    for k, (name, angle) in enumerate(zip(joints, state["angles"], strict=True)):
        joint = plant.GetJointByName(name)
        joint.set_angle(context, angle)
        P[joint.velocity_start(), 6 + k] = 1.0
    plant.SetVelocities(context, P @ v)
    M = plant.CalcMassMatrix(context)
    bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    bias = P.T @ (bias + M @ (change @ v))
    found = [(P.T @ M @ P, state["M"]), (bias, state["bias"])]
    return float(max(np.abs(ours - theirs).max() / np.abs(theirs).max() for ours, theirs in found))


def main() -> None:
    """Print the largest errors over the three robots."""
    reference, package = json.loads(Path(sys.argv[1]).read_text()), Path(description.PACKAGE_PATH)
    worst, contacts, gap, place, mass = 0.0, 0, 0.0, 0.0, 0.0
    for name, said in reference.items():
        plant, context, port, _alive = loaded(package / "urdf" / f"{name}.urdf")
        mass = float(max(mass, abs(plant.CalcTotalMass(context) / said["mass"] - 1.0)))
        for state in said["states"]:
            worst = max(worst, dynamics_error(plant, context, said["joints"], state))
        for pose in said["turn"]:
            for joint, angle in zip(said["joints"], pose * 2, strict=True):
                plant.GetJointByName(joint).set_angle(context, angle)
            contacts += len(port.Eval(context).ComputePointPairPenetration())
        plant, context, port, _alive = loaded(package / "mjcf" / f"{name}.xml")
        assert plant.num_constraints() == 6
        closed = said["closed"]
        for joint, angle in closed["angles"].items():
            plant.GetJointByName(joint).set_angle(context, angle)
        at = {body: plant.GetBodyByName(body).EvalPoseInWorld(context).GetAsMatrix4() for body in closed["places"]}
        place = float(max(place, *(np.abs(at[body] - np.array(said)).max() for body, said in closed["places"].items())))
        for body, expected in closed["masses"].items():
            mass = float(max(mass, abs(plant.GetBodyByName(body).default_mass() / expected - 1.0)))
        for first, p, second, q in closed["closing"]:
            gap = float(max(gap, np.linalg.norm(at[first] @ [*p, 1.0] - at[second] @ [*q, 1.0])))
    assert max(worst, mass, place, gap) < 1e-9
    assert contacts == 0
    print(
        f"found: mass matrix and bias forces at 15 states to {worst:.0e}; {contacts} contacts in 720 poses; MJCF: 6 "
        f"ball constraints, gaps {gap:.0e} m, placements to {place:.0e} m, masses equal"
    )


main()
