"""Grippers for MuJoCo, made of primitives by their files: a jaw, or a cup or magnet that pulls at what it lies on."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.gripper import Cup, Fingers, Gripper, Magnet
from bracket_sim.scene import palette
from bracket_sim.scene.palette import add_box, add_cylinder

GRIP_STIFFNESS_N_M = 20000.0  # of the jaw's position servo: force = stiffness x (opening - set point)
GRIP_DAMPING_NS_M = 220.0
LINK_SHARE = 0.8  # of a pad's width that the finger above it has
LIP_POINTS, LIP_RADIUS_M = 8, 0.0015  # around a cup's lip; it seals where all of them touch
CUP_KG, CUP_DAMPING_NS_M = 0.02, 8.0


def add_gripper(spec: mujoco.MjSpec, wrist: CameraSetup, mounted: Gripper) -> None:
    """Mount a gripper and the wrist camera on `tool0`; body `tool` is the TCP's frame."""
    tool0 = spec.body("tool0")
    hand = tool0.add_body(name="gripper", gravcomp=1.0)
    (diameter, base), (wide, deep, end) = mounted.coupling_m, mounted.palm_m
    add_cylinder(hand, (0, 0, base / 2), diameter, base, palette.LINK, palette.ROBOT_TOUCH)
    add_box(hand, (0, 0, (end + base) / 2), (wide, deep, end - base), palette.GRIPPER, palette.ROBOT_TOUCH)
    moving_kg = 2 * mounted.fingers.mass_kg if mounted.fingers else CUP_KG
    hand.mass, hand.inertia, hand.ipos = mounted.mass_kg - moving_kg, [1e-3, 1e-3, 1e-3], [0.0, 0.0, 0.05]
    hand.explicitinertial = True
    if mounted.fingers is not None:
        for name, side in (("left", 1.0), ("right", -1.0)):
            _add_finger(hand, name, side, mounted, mounted.fingers)
        _couple_fingers(spec, mounted.fingers)
    if mounted.switched is not None:
        _add_cup(spec, hand, mounted, mounted.switched)
    tool = tool0.add_body(name="tool", pos=[0.0, 0.0, mounted.tcp_from_flange_m])
    x, y, z = wrist.mount.position_m
    add_box(tool, (x, y, z - 0.02), (0.05, 0.03, 0.03), palette.GRIPPER, palette.HAND_ONLY_TOUCH)


def _add_finger(hand: mujoco.MjsBody, name: str, side: float, mounted: Gripper, fingers: Fingers) -> None:
    (thickness, width, length), tip, palm_end = fingers.pads_m, mounted.tip_m, mounted.palm_m[2]
    finger = hand.add_body(name=f"finger_{name}", gravcomp=1.0)
    finger.mass, finger.inertia, finger.ipos = fingers.mass_kg, [5e-5, 5e-5, 5e-5], [0.0, 0.0, 0.12]
    finger.explicitinertial = True
    finger.add_joint(
        name=f"finger_{name}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[side, 0.0, 0.0],
        range=[0.0, fingers.stroke_m / 2],
        armature=0.3,
    )
    link_length = tip - length - palm_end
    add_box(
        finger,
        (side * thickness / 2, 0.0, palm_end + link_length / 2),
        (thickness, width * LINK_SHARE, link_length),
        palette.GRIPPER,
        palette.ROBOT_TOUCH,
    )
    centre = (side * thickness / 2, 0.0, tip - length / 2)
    _rub(add_box(finger, centre, fingers.pads_m, palette.PAD, palette.ROBOT_TOUCH), f"pad_{name}")


def _rub(pad: mujoco.MjsGeom, name: str) -> None:
    """The pad's rubber decides the contact, whatever the part is made of."""
    pad.name, pad.priority, pad.condim, pad.friction = name, 1, 4, [1.0, 0.02, 0.0001]
    pad.solref = [0.006, 1.0]


def _couple_fingers(spec: mujoco.MjSpec, fingers: Fingers) -> None:
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
        forcerange=[-fingers.force_n[1], fingers.force_n[1]],
    )
    actuator.set_to_position(kp=GRIP_STIFFNESS_N_M, kv=GRIP_DAMPING_NS_M)


def _add_cup(spec: mujoco.MjSpec, hand: mujoco.MjsBody, mounted: Gripper, cup: Cup | Magnet) -> None:
    """A tube that gives way a little, with a ring of points as its end; pressure or magnet act where these touch."""
    body = hand.add_body(name="finger_cup", gravcomp=1.0)
    body.mass, body.inertia, body.ipos = CUP_KG, [1e-5, 1e-5, 1e-5], [0.0, 0.0, mounted.tip_m - 0.02]
    body.explicitinertial = True
    joint = body.add_joint(name="cup", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0])
    joint.range, joint.stiffness, joint.damping = (
        [-cup.travel_m, 0.0],
        [cup.stiffness_n_m, 0, 0],
        [CUP_DAMPING_NS_M, 0, 0],
    )
    end, palm_end = mounted.tip_m - LIP_RADIUS_M, mounted.palm_m[2] + cup.travel_m
    tube = (0.0, 0.0, (palm_end + end) / 2)
    add_cylinder(body, tube, cup.diameter_m / 2, end - palm_end, palette.GRIPPER, palette.ROBOT_TOUCH)
    radius = cup.diameter_m / 2 - LIP_RADIUS_M
    for number, turn in enumerate(np.arange(LIP_POINTS) * 2 * math.pi / LIP_POINTS):
        lip = body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[LIP_RADIUS_M, 0, 0], rgba=[*palette.PAD, 1.0])
        lip.pos = [radius * math.cos(turn), radius * math.sin(turn), end]
        lip.contype, lip.conaffinity = palette.ROBOT_TOUCH
        _rub(lip, f"lip_{number}")
    force = spec.add_actuator(
        name="suction", trntype=mujoco.mjtTrn.mjTRN_BODY, target="finger_cup", ctrlrange=[0.0, 1.0]
    )
    force.set_to_adhesion(gain=cup.most_n)
