"""The arm and its gripper for MuJoCo: the URDF of the robot model and a parallel jaw of primitives.

The jaw has the 2F-85's stroke, speed and force. One description of the arm serves inverse kinematics and simulation.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco

from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.robot import RobotModel, Servos, Tool
from bracket_sim.scene import palette
from bracket_sim.scene.palette import add_box, add_cylinder

STROKE_M = 0.085
PAD_SIZE_M = (0.012, 0.025, 0.022)  # thickness along tool x, width along y, length along z
PALM_END_M = 0.085  # from tool0: the palm must clear tall neighbours of a low part
GRIP_STIFFNESS_N_M = 20000.0  # of the jaw's position servo: force = stiffness x (opening - set point)
GRIP_DAMPING_NS_M = 220.0
FORCE_LIMIT_N = 235.0

# Servos of an arm whose file has none: so stiff for its torque, between these, with these shares of that. They are
# those of the shipped arms, which follow within a milliradian.
STIFFNESS, LEAST_STIFFNESS, MOST_STIFFNESS, USUAL_TORQUE_NM = 15.0, 600.0, 5000.0, 100.0
ARMATURE, DAMPING = 1 / 4500, 1 / 450
LEAST_MASS_KG, LEAST_INERTIA_KG_M2 = 0.1, 1e-3  # of a link that has no mass
TOUCHING_FROM = 2  # what this joint and the later ones carry touches parts and bench
JOINT_WORDS = ("wrist", "shoulder")  # in names of links that are drawn darker


def arm_spec(robot: RobotModel) -> mujoco.MjSpec:
    """The arm with position servos, meshes as its only geometry, and `tool0` kept as a body."""
    # MuJoCo's `discardvisual` would delete every geom without contacts from the final model; the text has none left.
    options = '<mujoco><compiler strippath="false" fusestatic="false" discardvisual="false"/></mujoco>'
    spec = mujoco.MjSpec.from_string(robot.urdf_text.replace("</robot>", options + "</robot>"))
    _drive_joints(spec, robot)
    _finish_links(spec, robot.joint_names[TOUCHING_FROM])
    return spec


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
        if body.joints and not body.geoms and not body.mass:
            body.mass, body.inertia, body.explicitinertial = LEAST_MASS_KG, [LEAST_INERTIA_KG_M2] * 3, True
        for geom in body.geoms:
            geom.rgba = [*(palette.JOINT if any(word in body.name for word in JOINT_WORDS) else palette.LINK), 1.0]
            touch = palette.ROBOT_TOUCH if body.name in touching else palette.HAND_ONLY_TOUCH
            geom.contype, geom.conaffinity = touch


def _carried(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """A body and all that hangs on it."""
    yield body
    for child in body.bodies:
        yield from _carried(child)


def add_gripper(spec: mujoco.MjSpec, wrist: CameraSetup, mounted: Tool) -> None:
    """Mount the jaw and the wrist camera on `tool0`; body `tool` is the TCP's frame."""
    tool0 = spec.body("tool0")
    hand = tool0.add_body(name="gripper", gravcomp=1.0)
    add_cylinder(hand, (0, 0, 0.010), 0.075, 0.020, palette.LINK, palette.ROBOT_TOUCH)
    palm_centre, palm_size = (0, 0, (PALM_END_M + 0.02) / 2), (0.10, 0.062, PALM_END_M - 0.02)
    add_box(hand, palm_centre, palm_size, palette.GRIPPER, palette.ROBOT_TOUCH)
    hand.mass, hand.inertia, hand.ipos = 0.75, [1e-3, 1e-3, 1e-3], [0.0, 0.0, 0.05]
    hand.explicitinertial = True
    for name, side in (("left", 1.0), ("right", -1.0)):
        _add_finger(hand, name, side, mounted.tcp_from_flange_m + mounted.fingertip_beyond_tcp_m)
    _couple_fingers(spec)
    tool = tool0.add_body(name="tool", pos=[0.0, 0.0, mounted.tcp_from_flange_m])
    x, y, z = wrist.mount.position_m
    add_box(tool, (x, y, z - 0.02), (0.05, 0.03, 0.03), palette.GRIPPER, palette.HAND_ONLY_TOUCH)


def _add_finger(hand: mujoco.MjsBody, name: str, side: float, tip: float) -> None:
    thickness, width, length = PAD_SIZE_M
    finger = hand.add_body(name=f"finger_{name}", gravcomp=1.0)
    finger.mass, finger.inertia, finger.ipos = 0.08, [5e-5, 5e-5, 5e-5], [0.0, 0.0, 0.12]
    finger.explicitinertial = True
    finger.add_joint(
        name=f"finger_{name}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[side, 0.0, 0.0],
        range=[0.0, STROKE_M / 2],
        armature=0.3,
    )
    link_length = tip - length - PALM_END_M
    add_box(
        finger,
        (side * thickness / 2, 0.0, PALM_END_M + link_length / 2),
        (thickness, width * 0.8, link_length),
        palette.GRIPPER,
        palette.ROBOT_TOUCH,
    )
    centre = (side * thickness / 2, 0.0, tip - length / 2)
    pad = add_box(finger, centre, PAD_SIZE_M, palette.PAD, palette.ROBOT_TOUCH)
    # The pad's rubber decides the contact, whatever the part is made of.
    pad.name, pad.priority, pad.condim, pad.friction = f"pad_{name}", 1, 4, [1.0, 0.02, 0.0001]
    pad.solref = [0.006, 1.0]


def _couple_fingers(spec: mujoco.MjSpec) -> None:
    """Both fingers move alike, driven through the opening between them."""
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1="finger_left",
        name2="finger_right",
        data=[0.0, 1.0] + [0.0] * (mujoco.mjNEQDATA - 2),  # left = 0 + 1 x right
        solref=[0.004, 1.0],
    )
    opening = spec.add_tendon(name="opening")
    opening.wrap_joint("finger_left", 1.0)
    opening.wrap_joint("finger_right", 1.0)
    actuator = spec.add_actuator(
        name="opening",
        trntype=mujoco.mjtTrn.mjTRN_TENDON,
        target="opening",
        forcerange=[-FORCE_LIMIT_N, FORCE_LIMIT_N],
    )
    actuator.set_to_position(kp=GRIP_STIFFNESS_N_M, kv=GRIP_DAMPING_NS_M)
