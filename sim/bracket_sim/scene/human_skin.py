"""The visible surface of a human hand: a convex piece for each bone, posed by where the hidden, touching shapes are.

A piece is the hull of balls around its bone's ends, so that neighbours share the ball of their joint. Pieces and joints
belong to one body; `Fingers.pose` puts them where the digits that move by physics ask for. What is touched are
capsules (hand.py), about the same bones of the usual posture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.pose import Array
from bracket_sim.scene import human_hand as human
from bracket_sim.scene.look import Appearance
from bracket_sim.scene.palette import NO_TOUCH

Ball = tuple[tuple[float, float, float], float]  # centre in the bone's frame and radius, in [m]
Balls = Sequence[Ball]
Segment = tuple[tuple[float, float, float], tuple[float, float, float], float]  # as in hand.py

SPHERE_POINTS = 72
GLOVE = 1.07  # of the radii: what a glove adds
PALM_RADIUS_M = 0.0115
THUMB_RADII_M = (0.0145, 0.0120, 0.0105, 0.0080)  # root, knuckle, joint, tip
FINGER_RADII_M = (0.0104, 0.0091, 0.0079, 0.0066)
FINGER_SIZES = (1.0, 1.03, 0.97, 0.87)
PAD_BEGINS = 0.5  # of the last phalanx: from there on its pad touches
FLAT_TIP = 0.86  # thickness of a finger's end against its width
NAIL_M, NAIL_OUT = (0.0055, 0.0046, 0.0012), 0.80
FOREARM_ALONG = (0.93, 0.22, 0.24)  # from the wrist to the elbow, in the hand frame
WRIST_HALF_M, WRIST_RADIUS_M = 0.0125, 0.0165
SLEEVE_RADIUS_M, SLEEVE_END_M = 0.031, 0.55
TEXTURE_PX, BLOTCHES_PX, BLOTCHY = 32, 3.0, 0.16
FLESH_RED = np.array([1.0, 0.97, 0.95])
REST = human.posture(np.array([1.0, 0.0, 0.0]), human.HALF_GAPS_M[1], human.HALF_GAPS_M[1])
GRASP_USER = len(human.GRASPS)  # numbers in mjData.userdata: weights of the grasps
FIT_NUMERIC = "hand_fit"  # scale and mirror


def pieces(gloved: bool) -> list[tuple[int, Balls]]:
    """The bone and the balls of each piece; the palm first."""
    wide = GLOVE if gloved else 1.0
    length, breadth, root = human.LENGTH_M, human.BREADTH_M, human.THUMB_ROOT_M
    knuckles = [((a * length, s * breadth, -0.003), PALM_RADIUS_M * f) for (a, s), f in _sized()]
    wrist: list[Ball] = [((0.0, 0.0115, -0.001), 0.0150), ((0.0, -0.0115, -0.001), 0.0150)]
    heel: list[Ball] = [((0.032, -0.024, -0.007), 0.0145), ((0.032, 0.016, -0.004), 0.0140)]
    found: list[tuple[int, Balls]] = [(human.PALM, [*wrist, *heel, *knuckles])]
    root_r, knuckle_r, joint_r, tip_r = THUMB_RADII_M
    metacarpal, proximal, distal = (human.bone_m(bone) for bone in (1, 2, 3))
    found.append((1, [((0.0, 0.0, 0.0), root_r), ((metacarpal, 0.0, 0.0), knuckle_r)]))
    found.append((human.PALM, [(root, root_r), ((0.06, 0.012, -0.012), 0.0105), ((0.028, -0.004, -0.009), 0.012)]))
    thumb = [_in_palm(joint) for joint in (1, 2)]
    middle = tuple(float(x) for x in 0.45 * np.array(thumb[0]) + 0.55 * np.array(thumb[1]))
    web: list[Ball] = [(thumb[0], 0.012), (thumb[1], 0.0075), (middle, 0.0105)]  # type: ignore[list-item]
    found.append((human.PALM, [*web, ((0.040, 0.017, -0.006), 0.0100), ((0.066, 0.019, -0.006), 0.0075)]))
    found.append((2, [((0.0, 0.0, 0.0), knuckle_r), ((proximal, 0.0, 0.0), joint_r)]))
    found.append((3, _tip(distal, joint_r, tip_r)))
    for finger, size in enumerate(FINGER_SIZES):
        radii = [size * radius for radius in FINGER_RADII_M]
        for number in range(2):
            bone = 4 + 3 * finger + number
            ends: Balls = [((0.0, 0.0, 0.0), radii[number]), ((human.bone_m(bone), 0.0, 0.0), radii[number + 1])]
            found.append((bone, ends))
        found.append((6 + 3 * finger, _tip(human.bone_m(6 + 3 * finger), radii[2], radii[3])))
    return [(bone, [(centre, wide * radius) for centre, radius in balls]) for bone, balls in found]


def _in_palm(joint: int) -> tuple[float, float, float]:
    """A joint of the usual posture in the palm's frame."""
    bones = human.skeleton(REST)
    return _point((bones.joints_m[joint] - bones.places_m[human.PALM]) @ bones.turns[human.PALM])


def _sized() -> list[tuple[tuple[float, float], float]]:
    return list(zip(human.KNUCKLES, FINGER_SIZES, strict=True))


def _tip(length_m: float, near_m: float, far_m: float) -> Balls:
    """The last phalanx: its end is wider than thick."""
    aside = far_m * (1 - FLAT_TIP)
    end = length_m - far_m
    return [
        ((0.0, 0.0, 0.0), near_m),
        ((0.55 * end, 0.0, -0.0008), near_m),
        ((end, aside, 0.0), far_m * FLAT_TIP),
        ((end, -aside, 0.0), far_m * FLAT_TIP),
    ]


def add_skin(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, person: Appearance, values: Array, *, left: bool, gloved: bool
) -> None:
    """Pieces, nails, wrist and sleeve of one hand, in its body's frame; palm first, wrist and sleeve last."""
    name = body.name
    bones = human.skeleton(values)
    _add_materials(spec, person, name, gloved)
    scale = (person.hand_size, -person.hand_size if left else person.hand_size, person.hand_size)

    def add(number: int, bone: int, points: Array, material: str) -> None:
        placed = bones.places_m[bone] + points @ bones.turns[bone].T
        mesh = spec.add_mesh(name=f"{name}_piece_{number}", uservert=placed.ravel().tolist(), scale=scale)
        body.add_geom(
            name=f"{name}_bone_{bone}_{number}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            material=material,
            contype=NO_TOUCH[0],
            conaffinity=NO_TOUCH[1],
            mass=0.0,
        )

    shapes = [(bone, _surface(balls), f"{name}_skin") for bone, balls in pieces(gloved)]
    if not gloved:
        shapes += [(bone, _nail(bone), f"{name}_nail") for bone in range(3, human.FOREARM, 3)]
    cuff = _elbow(person.cuff_m)
    shapes.append((human.FOREARM, _surface(_forearm(0.0, person.cuff_m + 0.01, 1.0)), f"{name}_arm"))
    shapes.append((human.FOREARM, _surface(_forearm(person.cuff_m, SLEEVE_END_M, cuff)), f"{name}_sleeve"))
    for number, shape in enumerate(shapes):
        add(number, *shape)
    mirror = np.array(scale)
    for number, joint in enumerate([*bones.joints_m, _palm_m(bones)]):
        body.add_site(name=f"{name}_joint_{number}", pos=(joint * mirror).tolist(), group=5, size=[0.002] * 3)


def _add_materials(spec: mujoco.MjSpec, person: Appearance, name: str, gloved: bool) -> None:
    hand_rgb = np.array(person.hand_rgb if gloved else person.skin_rgb)
    nail_rgb = np.clip(0.75 * np.array(person.skin_rgb) + 0.25 * np.array([1.0, 0.85, 0.82]), 0, 1)
    texture = spec.add_texture(
        name=f"{name}_texture",
        type=mujoco.mjtTexture.mjTEXTURE_CUBE,
        width=TEXTURE_PX,
        height=6 * TEXTURE_PX,
        nchannel=3,
    )
    texture.data = skin_texture(round(999_999 * person.skin_tone)).tobytes()
    bare, sleeve = np.array(person.skin_rgb), np.array(person.sleeve_rgb)
    colours = {"skin": hand_rgb, "arm": bare, "nail": nail_rgb, "sleeve": sleeve}
    for part, rgb in colours.items():
        shine = 0.25 if part == "nail" else 0.1
        material = spec.add_material(name=f"{name}_{part}", rgba=(*rgb, 1.0), specular=shine, shininess=shine)
        if part in ("skin", "arm"):
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name


def skin_texture(number: int) -> NDArray[np.uint8]:
    """Faint blotches, redder where darker (6 * TEXTURE_PX, TEXTURE_PX, 3): a factor on the skin's colour."""
    rng = np.random.default_rng(number)
    noise = rng.standard_normal((6 * TEXTURE_PX, TEXTURE_PX)).astype(np.float32)
    soft = cv2.GaussianBlur(noise, (0, 0), BLOTCHES_PX)
    shade = 1 - BLOTCHY * (soft - soft.min()) / (soft.max() - soft.min())
    tinted: NDArray[np.uint8] = np.rint(255 * shade[..., np.newaxis] ** (1 / FLESH_RED**6)).astype(np.uint8)
    return tinted


def _surface(balls: Balls) -> Array:
    """Points (n, 3) on balls; MuJoCo takes their hull."""
    return np.concatenate([np.array(centre) + radius * SPHERE for centre, radius in balls])


def _sphere() -> Array:
    number = np.arange(SPHERE_POINTS) + 0.5
    polar, around = np.arccos(1 - 2 * number / SPHERE_POINTS), math.pi * (1 + math.sqrt(5)) * number
    sin = np.sin(polar)
    return np.stack([np.cos(around) * sin, np.sin(around) * sin, np.cos(polar)], axis=1)


SPHERE = _sphere()


def _nail(bone: int) -> Array:
    finger = bone // 3 - 2
    radius = THUMB_RADII_M[3] if finger < 0 else FINGER_RADII_M[3] * FINGER_SIZES[finger]
    size = 1.35 if finger < 0 else FINGER_SIZES[finger]
    middle = np.array([human.bone_m(bone) - 1.15 * radius, 0.0, NAIL_OUT * radius])
    points: Array = middle + size * SPHERE * np.array(NAIL_M)
    return points


def _elbow(along_m: float) -> float:
    """How much wider than the wrist the bare arm is, so far from it."""
    return 1.0 + 2.6 * min(along_m, 0.2)


def _forearm(from_m: float, to_m: float, wide: float) -> Balls:
    along = np.array(FOREARM_ALONG) / np.linalg.norm(FOREARM_ALONG)
    aside = np.array([0.0, 1.0, 0.0]) - along * along[1]
    aside /= np.linalg.norm(aside)
    balls: list[Ball] = []
    sleeve = wide > 1.0
    for where_m in (from_m, to_m):
        radius = WRIST_RADIUS_M * (_elbow(where_m) + (0.22 if sleeve else 0.0))
        half = WRIST_HALF_M * (1.0 + 0.25 * sleeve)
        for sign in (-1, 1):
            x, y, z = along * where_m + sign * half * aside
            balls.append(((float(x), float(y), float(z)), min(radius, SLEEVE_RADIUS_M)))
    return balls


def _palm_m(bones: human.Skeleton) -> Array:
    """The palm's middle: halfway from the wrist to the knuckles of middle and ring finger."""
    middle: Array = 0.5 * bones.places_m[human.PALM] + 0.25 * (bones.joints_m[9] + bones.joints_m[13])
    return middle


@dataclass(frozen=True, eq=False)
class _Moving:
    """Numbers in the compiled model: geoms with their bones, and sites."""

    geoms: NDArray[np.int64]
    bones: NDArray[np.int64]
    sites: NDArray[np.int64]


class Fingers:
    """Poses the pieces and joints of the hand that works in a compiled world; without a human hand, none."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        names = [model.geom(index).name for index in range(model.ngeom)]
        geoms = [index for index, name in enumerate(names) if name.startswith("hand_bone_")]
        bones = [int(names[index].split("_")[2]) for index in geoms]
        sites = [index for index in range(model.nsite) if model.site(index).name.startswith("hand_joint_")]
        self._moving = _Moving(np.array(geoms, np.int64), np.array(bones, np.int64), np.array(sites, np.int64))
        if not geoms:
            return
        size, mirror = model.numeric(FIT_NUMERIC).data
        self._fit: Array = size * np.array([1.0, mirror, 1.0])
        self._body = int(model.body("hand").id)
        self._slides = [int(model.joint(name).qposadr[0]) for name in ("hand_thumb", "hand_index")]
        joints = {model.joint(index).name for index in range(model.njnt)}
        self._curl = int(model.joint("hand_curl").qposadr[0]) if "hand_curl" in joints else None
        self._rest = human.skeleton(REST)
        self._turns: Array = np.zeros((len(geoms), 9))
        for row, index in enumerate(geoms):
            mujoco.mju_quat2Mat(self._turns[row], model.geom_quat[index])

    def pose(self, data: mujoco.MjData) -> None:
        """Put pieces and joints where digits and grasp ask for; what follows from the joints is computed first."""
        if not len(self._moving.geoms):
            return
        thumb_m, index_m = (float(data.qpos[slide]) / self._fit[0] for slide in self._slides)
        curl_rad = 0.0 if self._curl is None else float(data.qpos[self._curl])
        weights = data.userdata[:GRASP_USER] if data.userdata[:GRASP_USER].any() else np.array([1.0, 0.0, 0.0])
        now = human.skeleton(human.posture(weights, thumb_m, index_m, curl_rad))
        moved = now.turns @ self._rest.turns.transpose(0, 2, 1)
        mirror = np.sign(self._fit)
        shifts = (now.places_m - np.einsum("bij,bj->bi", moved, self._rest.places_m)) * self._fit
        moved = mirror[:, np.newaxis] * moved * mirror
        body_m, body = data.xpos[self._body], data.xmat[self._body].reshape(3, 3)
        geoms, bones = self._moving.geoms, self._moving.bones
        places = np.einsum("gij,gj->gi", moved[bones], self._model.geom_pos[geoms]) + shifts[bones]
        data.geom_xpos[geoms] = body_m + places @ body.T
        data.geom_xmat[geoms] = (body @ moved[bones] @ self._turns.reshape(-1, 3, 3)).reshape(-1, 9)
        joints = np.concatenate([now.joints_m, _palm_m(now)[np.newaxis]]) * self._fit
        data.site_xpos[self._moving.sites] = body_m + joints @ body.T


def capsules(values: Array) -> dict[str, list[Segment]]:
    """What is touched, by the body that it moves with: hand, thumb, index, and fingers (the ends of the last two).

    The ends of the fingers that do not grip give way to parts: only the robot touches them.
    """
    bones = human.skeleton(values)
    root_r, knuckle_r, joint_r, _ = THUMB_RADII_M
    wrist_m, joints = bones.places_m[human.PALM], [_point(joint) for joint in bones.joints_m]
    palm = [(_point(wrist_m), joints[5 + 4 * finger], PALM_RADIUS_M) for finger in range(4)]
    palm += [(joints[1], joints[2], root_r), (joints[5], joints[6], FINGER_RADII_M[0])]
    palm += [(joints[first], joints[first + 1], FINGER_RADII_M[0] * 0.9) for first in (9, 13, 17)]
    bent = [(joints[j], joints[j + 1], FINGER_RADII_M[1] * 0.9) for first in (14, 18) for j in (first, first + 1)]
    ends = [_point(bones.joints_m[j] + PAD_BEGINS * (bones.joints_m[j + 1] - bones.joints_m[j])) for j in (3, 7)]
    thumb = [(joints[2], joints[3], knuckle_r), (joints[3], ends[0], joint_r * 0.75)]
    index = [(joints[6], joints[7], FINGER_RADII_M[1]), (joints[7], ends[1], FINGER_RADII_M[2] * 0.85)]
    back = {"thumb": (0.0, human.HALF_GAPS_M[1], 0.0), "index": (0.0, -human.HALF_GAPS_M[1], 0.0)}
    slid = {name: [_shifted(ring, back[name]) for ring in own] for name, own in (("thumb", thumb), ("index", index))}
    return {"hand": palm, "fingers": bent, **slid}


def arm_capsules(values: Array) -> list[Segment]:
    """The forearm to where the sleeve begins, and the sleeve."""
    wrist_m = human.skeleton(values).places_m[human.FOREARM]
    along = np.array(FOREARM_ALONG) / np.linalg.norm(FOREARM_ALONG)
    wrist, middle, end = (_point(wrist_m + length * along) for length in (0.0, 0.07, 0.31))
    return [(wrist, middle, 0.024), (middle, end, 0.034)]


def _point(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _shifted(segment: Segment, by: tuple[float, float, float]) -> Segment:
    start, end, radius = segment
    return _point(np.add(start, by)), _point(np.add(end, by)), radius
