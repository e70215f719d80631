"""Pinocchio's geometry objects, made from the meshes of the robot description."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from aerobat_description.meshes import parts
from aerobat_description.morphology import Morphology
from aerobat_description.solids import Mesh
from aerobat_description.write_urdf import MATERIALS
from aerobat_pin.numerics import frame_id


def visual_model(model: pin.Model, morphology: Morphology) -> pin.GeometryModel:
    """Return the visible parts of the robot, each attached to the joint that carries its link."""
    visual = pin.GeometryModel()
    for name, part in parts(morphology).items():
        visual.addGeometryObject(geometry_object(model, name, part.link, part.mesh, part.material))
    return visual


def geometry_object(model: pin.Model, name: str, link: str, mesh: Mesh, material: str) -> pin.GeometryObject:
    """Return a geometry object for a mesh whose points are in the frame of a link."""
    frame = frame_id(model, link)
    placement = model.frames[frame].placement
    item = pin.GeometryObject(name, model.frames[frame].parentJoint, frame, placement, _bvh(mesh))
    item.meshColor = np.array(MATERIALS[material])
    return item


def _bvh(mesh: Mesh) -> coal.BVHModelOBBRSS:
    corners = [point for triangle in mesh for point in triangle]
    unique = {point: i for i, point in enumerate(dict.fromkeys(corners))}
    shape = coal.BVHModelOBBRSS()
    shape.beginModel(len(mesh), len(unique))
    shape.addVertices(np.array(list(unique)))
    shape.addTriangles(np.array([[unique[point] for point in triangle] for triangle in mesh]))
    shape.endModel()
    return shape
