"""A human hand: bones of human length, the postures of three grasps, and where its 21 joints are.

Hand frame as in hand.py: the pads of thumb and index finger meet in the origin, fingers point along -x, the thumb is on
the -y side. Bones are shares of the hand's length, knuckles shares of its breadth (Buchholz, Armstrong and Goldstein
1992, Ergonomics 35, Tables 2 and 3); length and breadth are the means of women and men (ANSUR II, Gordon 2014: 181 and
78 mm, 193 and 88 mm). Joints are in the order of MediaPipe's landmarks: wrist, then four for each digit, thumb first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from bracket_ground.interfaces.pose import Array

Grasp = Literal["tripod", "pinch", "lateral"]
GRASPS: tuple[Grasp, ...] = get_args(Grasp)
LENGTH_M, BREADTH_M = 0.187, 0.083
THUMB_BONES = (0.251, 0.196, 0.158)  # of the hand's length: metacarpal, proximal and distal phalanx
FINGER_BONES = ((0.245, 0.143, 0.097), (0.266, 0.170, 0.108), (0.244, 0.165, 0.107), (0.204, 0.117, 0.093))
KNUCKLES = ((0.463, 0.251), (0.446, 0.0), (0.421, -0.206), (0.414, -0.402))  # ahead of the wrist, towards the thumb
THUMB_ROOT_M = (0.106 * LENGTH_M, 0.19 * BREADTH_M, -0.010)
HEEL_M = 0.011  # from the wrist's centre to the heel of the palm, where its landmark is
TIP_M = 0.004  # from the skin's end back to the last joint of a digit
# Axes of the thumb's metacarpal in the palm's frame (ahead, to the thumb's side, to the back of the hand).
THUMB_AHEAD, THUMB_NAIL = (0.72, 0.55, -0.42), (-0.35, 0.9, 0.15)
# Postures by half the gap between the pads [m]. Each: pitch, roll and yaw of the palm [deg]; the wrist [mm]; thumb:
# abduction, flexion and turn of its root, flexion of its other joints; each finger: abduction, flexion of its three
# joints [deg]. Found by least squares: pads where the parts are pinched, joints near the middle of their range.
HALF_GAPS_M = (0.0, 0.012, 0.022, 0.040)
_Row = tuple[tuple[float, ...], ...]
POSTURES: dict[Grasp, tuple[_Row, ...]] = {
    "tripod": (
        ((7, 17, -3, 12, 11), (4, 39, 37, 21), (26, 20, 68, 36)),
        ((10, 11, -3, 11, 12), (-9, 34, 36, 20), (2, 16, 68, 36)),
        ((12, 7, -3, 10, 12), (-16, 32, 29, 17), (-9, 10, 68, 36)),
        ((17, 1, -3, 6, 9), (-28, 32, 11, 9), (-22, 2, 62, 34)),
    ),
    "pinch": (
        ((7, 8, -1, 14, 15), (17, 44, 43, 21), (1, 21, 43, 25)),
        ((9, 3, -1, 12, 15), (-3, 41, 44, 21), (1, 21, 43, 25)),
        ((10, -1, -1, 9, 13), (-14, 38, 39, 19), (-1, 21, 42, 25)),
        ((14, -7, -1, 5, 9), (-29, 37, 22, 14), (-9, 10, 34, 22)),
    ),
    "lateral": (
        ((2, 2, -1, 17, 19), (23, 34, 60, 35), (0, 39, 92, 48)),
        ((4, -2, -1, 13, 18), (1, 33, 62, 36), (0, 39, 92, 48)),
        ((5, -5, -1, 10, 15), (-12, 30, 57, 34), (0, 39, 92, 48)),
        ((8, -11, -1, 4, 10), (-29, 28, 40, 28), (0, 39, 92, 48)),
    ),
}
PALMS: dict[Grasp, tuple[float, ...]] = {  # pitch, roll, yaw [deg], wrist [m]
    "tripod": (4.0, 18.2, 26.1, 0.1205, -0.0086, 0.0640),
    "pinch": (-8.0, 13.5, 21.7, 0.1274, 0.0035, 0.0427),
    "lateral": (-2.4, 6.3, 17.9, 0.1209, 0.0103, 0.0505),
}
RING_AND_LITTLE: dict[Grasp, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "tripod": ((-2, 12, 62, 36), (-5, 14, 58, 32)),
    "pinch": ((-2, 10, 56, 32), (-5, 14, 54, 30)),
    "lateral": ((0, 40, 90, 49), (0, 39, 81, 45)),
}
# Lying on a table: angles of thumb and fingers.
FLAT = (*(-4, -22, 0, 2, 6), *(9, 6, 8, 4), *(1, 5, 8, 4), *(-6, 6, 10, 5), *(-14, 8, 12, 6))
CURLS = (0.0, 0.5, 0.7, 0.3)  # shares of the curl that the joints of ring and little finger take
PALM, FOREARM = 0, 16  # of the bones: palm, three of the thumb, three of each finger, forearm
BONES = 17
THUMB_COUNT, PALM_COUNT = 5, 6


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Where everything is in the hand frame, of a right hand of medium size.

    Attributes:
        turns: (17, 3, 3) of the bones: along the bone, to the thumb's side, to the back of the hand. The forearm's is
            that of the hand frame.
        places_m: (17, 3) their near ends.
        joints_m: (21, 3).
    """

    turns: Array
    places_m: Array
    joints_m: Array


def posture(weights: Array, thumb_m: float, index_m: float, curl_rad: float = 0.0) -> Array:
    """All values of a posture (27,): palm, thumb, fingers; [deg] and [m].

    Args:
        weights: (3,) of the grasps.
        thumb_m, index_m: half the gap, as the thumb and as the index finger have it.
        curl_rad: by how much more ring and little finger are bent.
    """
    by_gap = np.stack([_by_gap(grasp, thumb_m, index_m) for grasp in GRASPS])
    mixed: Array = np.asarray(weights) @ by_gap / max(float(np.sum(weights)), 1e-9)
    more = math.degrees(curl_rad) * np.array(CURLS * 2)
    mixed[-8:] = np.where(more != 0, np.maximum(mixed[-8:] + more, 0.0), mixed[-8:])
    return mixed


def _by_gap(grasp: Grasp, thumb_m: float, index_m: float) -> Array:
    rows = [np.concatenate(row) for row in POSTURES[grasp]]
    table = np.array(rows, dtype=float)
    gaps = [thumb_m] * THUMB_COUNT + [index_m] * (table.shape[1] - THUMB_COUNT)
    moved = [float(np.interp(gap, HALF_GAPS_M, column)) for gap, column in zip(gaps, table.T, strict=True)]
    return np.array([*PALMS[grasp], *moved, *np.concatenate(RING_AND_LITTLE[grasp])])


def skeleton(values: Array) -> Skeleton:
    """Forward kinematics of a posture."""
    pitch, roll, yaw = np.radians(values[:3])
    wrist_m = np.asarray(values[3:PALM_COUNT])
    palm = _about_z(-yaw) @ np.diag([-1.0, -1.0, 1.0]) @ _about_y(pitch) @ _about_x(roll)
    turns, places, joints = [palm], [wrist_m], [wrist_m + HEEL_M * palm[:, 0]]
    abducted, flexed, turned, *rest = np.radians(values[PALM_COUNT : PALM_COUNT + THUMB_COUNT])
    first = palm @ _thumb_axes() @ _about_z(abducted) @ _about_y(flexed) @ _about_x(turned)
    chains = [(wrist_m + palm @ THUMB_ROOT_M, first, rest, THUMB_BONES)]
    fingers = np.radians(values[PALM_COUNT + THUMB_COUNT :]).reshape(4, 4)
    for (ahead, aside), bones, (spread, *bends) in zip(KNUCKLES, FINGER_BONES, fingers, strict=True):
        knuckle_m = wrist_m + palm @ np.array([ahead * LENGTH_M, aside * BREADTH_M, 0.0])
        chains.append((knuckle_m, palm @ _about_z(spread) @ _about_y(bends[0]), bends[1:], bones))
    for start_m, turn, bends, bones in chains:
        place_m, axes = start_m, turn
        for bone, bend in zip(bones, (0.0, *bends), strict=True):
            axes = axes @ _about_y(bend)
            turns.append(axes)
            places.append(place_m)
            joints.append(place_m)
            place_m = place_m + axes[:, 0] * bone * LENGTH_M
        joints.append(place_m - axes[:, 0] * TIP_M)
    return Skeleton(np.stack([*turns, np.eye(3)]), np.stack([*places, wrist_m]), np.stack(joints))


def bone_m(bone: int) -> float:
    """Length of a phalanx or of the thumb's metacarpal."""
    digit, number = divmod(bone - 1, 3)
    return LENGTH_M * (THUMB_BONES if digit == 0 else FINGER_BONES[digit - 1])[number]


def _thumb_axes() -> Array:
    ahead = np.array(THUMB_AHEAD) / np.linalg.norm(THUMB_AHEAD)
    nail = np.array(THUMB_NAIL) - ahead * (ahead @ THUMB_NAIL)
    nail /= np.linalg.norm(nail)
    return np.stack([ahead, np.cross(nail, ahead), nail], axis=1)


def _about_x(angle: float) -> Array:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])


def _about_y(angle: float) -> Array:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])


def _about_z(angle: float) -> Array:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
