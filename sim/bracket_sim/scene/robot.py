"""The arm for MuJoCo: the URDF of the robot model, which serves inverse kinematics and simulation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import coal
import mujoco
import numpy as np

from bracket_ground.interfaces.robot import RobotModel, Servos
from bracket_ground.interfaces.urdf import FLANGE
from bracket_sim.scene import palette

# Servos of an arm whose file has none: so stiff for its torque, between these, with these shares of that. They are
# those of the shipped arms, which follow within a milliradian.
STIFFNESS, LEAST_STIFFNESS, MOST_STIFFNESS, USUAL_TORQUE_NM = 15.0, 600.0, 5000.0, 100.0
ARMATURE, DAMPING = 1 / 4500, 1 / 450
LEAST_MASS_KG, LEAST_INERTIA_KG_M2 = 0.1, 1e-3  # of a link that has no mass, or an inertia that no body has
MESHES = (".stl", ".obj", ".msh")  # that MuJoCo reads
TOUCHING_FROM = 2  # what this joint and the later ones carry touches parts and bench
JOINT_WORDS = ("wrist", "shoulder")  # in names of links that are drawn darker


def arm_spec(robot: RobotModel) -> mujoco.MjSpec:
    """The arm with position servos, meshes as its only geometry, and `tool0` kept as a body."""
    # MuJoCo's `discardvisual` would delete every geom without contacts from the final model; the text has none left.
    options = '<mujoco><compiler strippath="false" fusestatic="false" discardvisual="false"/></mujoco>'
    spec = mujoco.MjSpec.from_string(_named_apart(robot.urdf_text).replace("</robot>", options + "</robot>"))
    spec.compiler.balanceinertia = True  # public descriptions round their inertias
    _read_meshes(spec)
    _drive_joints(spec, robot)
    _finish_links(spec, robot.joint_names[TOUCHING_FROM])
    return spec


def _named_apart(text: str) -> str:
    """A URDF whose links have names that the scene has not. `world` is MuJoCo's own: its mount would be lost."""
    root = ElementTree.fromstring(text)
    for link in root.iter():
        for key in {"link": ("name",), "parent": ("link",), "child": ("link",)}.get(link.tag, ()):
            if (name := link.get(key, FLANGE)) != FLANGE:
                link.set(key, f"arm {name}")
    return ElementTree.tostring(root, encoding="unicode")


def servos(robot: RobotModel) -> Servos:
    """How an arm's joints are driven; see `RobotModel.servos`."""
    if robot.servos is not None:
        return robot.servos
    wanted = (STIFFNESS * (torque or USUAL_TORQUE_NM) for torque in robot.torques_nm)
    stiffness = tuple(min(max(value, LEAST_STIFFNESS), MOST_STIFFNESS) for value in wanted)
    armature, damping = (tuple(share * value for value in stiffness) for share in (ARMATURE, DAMPING))
    return Servos(stiffness_nm_rad=stiffness, armature_kg_m2=armature, damping_nm_s_rad=damping)


def _drive_joints(spec: mujoco.MjSpec, robot: RobotModel) -> None:
    driven = servos(robot)
    values = driven.stiffness_nm_rad, robot.torques_nm, driven.armature_kg_m2, driven.damping_nm_s_rad
    for name, stiffness, most, armature, damping in zip(robot.joint_names, *values, strict=True):
        torque, joint = most or USUAL_TORQUE_NM, spec.joint(name)
        joint.armature = armature
        joint.damping = [damping, 0.0, 0.0]
        actuator = spec.add_actuator(
            name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name, forcerange=[-torque, torque]
        )
        actuator.set_to_position(kp=stiffness, dampratio=1.0)


def _finish_links(spec: mujoco.MjSpec, touching_from: str) -> None:
    touching = [body.name for body in _carried(spec.joint(touching_from).parent)]
    for body in spec.bodies:
        body.gravcomp = 1.0
        if (body.joints and not body.geoms and not body.mass) or not _has_inertia(body):
            body.mass, body.explicitinertial = max(body.mass, LEAST_MASS_KG), True
            body.fullinertia = [*[LEAST_INERTIA_KG_M2] * 3, 0, 0, 0]
        for geom in body.geoms:
            geom.rgba = [*(palette.JOINT if any(word in body.name for word in JOINT_WORDS) else palette.LINK), 1.0]
            touch = palette.ROBOT_TOUCH if body.name in touching else palette.HAND_ONLY_TOUCH
            geom.contype, geom.conaffinity = touch


def _has_inertia(body: mujoco.MjsBody) -> bool:
    """Whether what a file says of a body's inertia is that of some body, or it says nothing."""
    xx, yy, zz, xy, xz, yz = body.fullinertia
    if not body.explicitinertial or np.isnan(xx):
        return True
    return bool(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).min() > 0)


def _read_meshes(spec: mujoco.MjSpec) -> None:
    """Meshes of formats that MuJoCo does not read, such as Collada, as the motion planner reads them."""
    for mesh in spec.meshes:
        if Path(mesh.file).suffix.lower() not in MESHES:
            read = coal.MeshLoader().load(mesh.file, np.ones(3))
            mesh.uservert = read.vertices().ravel()
            mesh.userface = np.array([[read.tri_indices(k)[c] for c in range(3)] for k in range(read.num_tris)]).ravel()
            mesh.file = ""


def _carried(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """A body and all that hangs on it."""
    yield body
    for child in body.bodies:
        yield from _carried(child)
