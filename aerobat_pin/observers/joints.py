"""Joints as observers need them: axes fixed in the link that the joint carries, and a name and a unit for every row.

Pinocchio's Coriolis matrix assumes such axes. It is wrong where the axes of a joint turn with the joint's own angles:
two hinges between the same two links (a `Composite` joint, as MJCF makes it), `SphericalZYX`, `Universal`. These joints
are chains of simpler joints with massless links between them, so an observer computes with the chain instead. Its q, v
and frames are those of the joint. A joint that is no such chain (`Ellipsoid`), or that has no coordinate of its own
(`Mimic`), is refused.
"""

from __future__ import annotations

import pinocchio as pin

from aerobat_pin.errors import ObserverError

HINGES = [f"R{axis}" for axis in "XYZ"] + [f"RUB{axis}" for axis in "XYZ"] + [f"H{axis}" for axis in "XYZ"]
HINGES += ["RevoluteUnaligned", "RevoluteUnboundedUnaligned", "HelicalUnaligned"]
SLIDES = ["PX", "PY", "PZ", "PrismaticUnaligned"]
# Rows of a joint: F is a force [N], M a moment [N m].
PARTS = {
    "JointModelFreeFlyer": ("Fx", "Fy", "Fz", "Mx", "My", "Mz"),
    "JointModelTranslation": ("Fx", "Fy", "Fz"),
    "JointModelPlanar": ("Fx", "Fy", "Mz"),
    "JointModelSpherical": ("Mx", "My", "Mz"),
    **{f"JointModel{kind}": ("F",) for kind in SLIDES},
    **{f"JointModel{kind}": ("M",) for kind in HINGES},
}


def has_free_base(model: pin.Model) -> bool:
    """Say whether the first joint of a model is a free-flyer."""
    return bool(model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer")


def row_names(model: pin.Model) -> dict[str, str]:
    """Return the name of each row of the generalised residual and its unit, `N` or `N m`, in the order of v.

    A row is called like its joint (`elbow`), or, if the joint has several, joint and part (`ball.Mx`). A free-flyer
    that is the first joint is called `base`.
    """
    rows = {}
    for joint, name in zip(model.joints.tolist()[1:], model.names.tolist()[1:], strict=True):
        title, parts = "base" if joint.id == 1 and has_free_base(model) else name, PARTS[joint.shortname()]
        for part in parts:
            rows[title if len(parts) == 1 else f"{title}.{part}"] = "N" if part[0] == "F" else "N m"
    return rows


def serial_model(model: pin.Model) -> pin.Model:
    """Return a model with the same q, v and frames whose joints all have axes fixed in the link that they carry.

    The joints of a chain are called like the joint that they replace, with a number: `hip.0`, `hip.1`. A model that
    needs no change is returned itself.

    Raises:
        ObserverError: a joint is no chain of joints with fixed axes, or follows another joint.
    """
    joints, names = model.joints.tolist(), model.names.tolist()
    if all(joint.shortname() in PARTS for joint in joints[1:]):
        return model
    serial, link = pin.Model(), [0]  # link: the joint of the new model that carries the link of each joint
    for joint, name in zip(joints[1:], names[1:], strict=True):
        chain, at = _chain(joint.extract(), name), link[model.parents[joint.id]]
        chain[0] = chain[0][0], model.jointPlacements[joint.id] * chain[0][1]
        for k, (part, placement) in enumerate(chain):
            at = serial.addJoint(at, part, placement, name if len(chain) == 1 else f"{name}.{k}")
        serial.inertias[at] = model.inertias[joint.id]
        link.append(at)
    for frame in model.frames.tolist()[1:]:
        moved = pin.Frame(frame.name, link[frame.parentJoint], frame.parentFrame, frame.placement, frame.type)
        serial.addFrame(moved, False)
    for constant in ("name", "gravity", "armature", "lowerPositionLimit", "upperPositionLimit"):
        setattr(serial, constant, getattr(model, constant))
    return serial


def _chain(joint: pin.JointModel, name: str) -> list[tuple[pin.JointModel, pin.SE3]]:
    """Return the joints, with placements, to which a joint is equal. Raises ObserverError if there are none."""
    kind, here = joint.shortname(), pin.SE3.Identity()
    if kind in PARTS:
        return [(joint, here)]
    if kind == "JointModelSphericalZYX":
        return [(pin.JointModelRZ(), here), (pin.JointModelRY(), here), (pin.JointModelRX(), here)]
    if kind == "JointModelUniversal":
        return [(pin.JointModelRevoluteUnaligned(axis), here) for axis in (joint.axis1, joint.axis2)]
    if kind == "JointModelComposite":
        chain = []
        for part, placement in zip(joint.joints.tolist(), joint.jointPlacements.tolist(), strict=True):
            (first, offset), *rest = _chain(part.extract(), name)
            chain += [(first, placement * offset), *rest]
        return chain
    if kind == "JointModelMimic":
        advice = "build the model without mimic joints (buildModelFromUrdf(..., mimic=False)) and tie the two by a Tie"
    else:
        advice = f"a joint with fixed axes was expected, or a chain of them: {', '.join(known[10:] for known in PARTS)}"
    raise ObserverError(f"joint '{name}' of type {kind[10:]}: observers cannot use it; {advice}")
