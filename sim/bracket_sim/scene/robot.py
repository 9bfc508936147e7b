"""The arm for MuJoCo: the URDF of the robot model, which serves inverse kinematics and simulation."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import coal
import mujoco
import numpy as np

from bracket_ground.errors import SettingError
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import RobotModel
from bracket_ground.interfaces.urdf import FLANGE
from bracket_sim.scene import palette

# Servos of an arm whose file has none: so stiff for its torque, between these, with these shares of that. They are
# those of the shipped arms, which follow within a milliradian; a heavy arm's trail by TRAILS_RAD while it speeds up.
STIFFNESS, LEAST_STIFFNESS, MOST_STIFFNESS, TRAILS_RAD = 15.0, 600.0, 5000.0, 0.005
ARMATURE, DAMPING = 1 / 4500, 1 / 450
USUAL_TORQUE_NM, TORQUE_SHARE = 100.0, 4.0  # the least, and times what speeds the arm up, where nobody says
POSTURES, SEED = 100, 1
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
    _finish_links(spec, robot.joint_names[TOUCHING_FROM])
    _drive_joints(spec, robot)
    return spec


def _named_apart(text: str) -> str:
    """A URDF whose links have names that the scene has not. `world` is MuJoCo's own: its mount would be lost."""
    root = ElementTree.fromstring(text)
    for link in root.iter():
        for key in {"link": ("name",), "parent": ("link",), "child": ("link",)}.get(link.tag, ()):
            if (name := link.get(key, FLANGE)) != FLANGE:
                link.set(key, f"arm {name}")
    return ElementTree.tostring(root, encoding="unicode")


def _drive_joints(spec: mujoco.MjSpec, robot: RobotModel) -> None:
    torques_nm, needed_nm = np.array(robot.torques_nm), _speeding_up_nm(spec, robot)
    rows = zip(robot.joints, torques_nm, needed_nm, ({"rad": "N m", "m": "N"}[u] for u in robot.units), strict=True)
    if weak := [f"{joint} has {has:g} {of} and needs {needs:.2g}" for joint, has, needs, of in rows if 0 < has < needs]:
        what = f"too weak to speed up so soon: {', '.join(weak)}: more torque_nm, or less acceleration_rad_s2"
        raise SettingError((("robot",), what))
    torques_nm = np.where(torques_nm > 0, torques_nm, np.maximum(USUAL_TORQUE_NM, TORQUE_SHARE * needed_nm))
    own = np.maximum(STIFFNESS * torques_nm, needed_nm / TRAILS_RAD)  # a weak joint's torque bears no more of the rest
    stiff = np.clip(own, LEAST_STIFFNESS, np.maximum(MOST_STIFFNESS, needed_nm / TRAILS_RAD))
    driven = [row for _, row in robot.servos or ()] or [stiff, *np.outer((ARMATURE, DAMPING), np.minimum(own, stiff))]
    for name, torque, kp, armature, damping in zip(robot.joint_names, torques_nm, *driven, strict=True):
        joint = spec.joint(name)
        joint.armature, joint.damping = armature, [damping, 0.0, 0.0]
        kind, most = mujoco.mjtTrn.mjTRN_JOINT, [-torque, torque]
        actuator = spec.add_actuator(name=name, trntype=kind, target=name, forcerange=most)
        actuator.set_to_position(kp=kp, dampratio=1.0)


def _speeding_up_nm(spec: mujoco.MjSpec, robot: RobotModel) -> Array:
    """(n,) with which each joint, in half of all postures, speeds up as soon as it may."""
    model = spec.copy().compile()
    data, inertias = mujoco.MjData(model), np.zeros((POSTURES, model.nv, model.nv))
    least, most = robot.limits_rad
    postures = np.random.default_rng(SEED).uniform(least, most, (POSTURES, model.nv))
    for inertia, data.qpos[:] in zip(inertias, postures, strict=True):
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
    needed: Array = np.median(inertias, axis=0).diagonal() * robot.acceleration_rad_s2
    return needed


def _finish_links(spec: mujoco.MjSpec, touching_from: str) -> None:
    first = spec.joint(touching_from).parent
    touching = [first.name, *(body.name for body in first.find_all("body"))]
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
    told, matrix = body.explicitinertial and not np.isnan(xx), [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return not told or bool(np.linalg.eigvalsh(matrix).min() > 0)


def _read_meshes(spec: mujoco.MjSpec) -> None:
    """Meshes of formats that MuJoCo does not read, such as Collada, as the motion planner reads them."""
    for mesh in spec.meshes:
        if Path(mesh.file).suffix.lower() not in MESHES:
            read = coal.MeshLoader().load(mesh.file, np.ones(3))
            mesh.uservert = read.vertices().ravel()
            mesh.userface = np.array([[read.tri_indices(k)[c] for c in range(3)] for k in range(read.num_tris)]).ravel()
            mesh.file = ""
