"""Postures of an arm from which inverse kinematics begins: sampled over its joints' ranges, the same for the same arm.

Nothing is known of how its links lean: a posture is taken for what its flange does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio

from bracket_ground.interfaces.pose import FINGERS_DOWN, Array, Pose
from bracket_ground.interfaces.robot import RobotModel
from bracket_ground.interfaces.urdf import FLANGE

if TYPE_CHECKING:
    from bracket_cell.skills.motion.kinematics import Kinematics

SAMPLES, SEED = 6000, 1
POINTS_M = 0.3  # a flange that points elsewhere by one radian counts as so far away
HEIGHTS_M = (0.10, 0.30)  # over the table: where a bench has its parts, for the usual posture
REACHES = (0.45, 0.6, 0.75)  # shares of the arm's reach, in its front
CANDIDATES, KINDS, QUICK = 10, 12, 15  # postures that are tried, kinds that are compared, steps until one is found
HIGH_M = 0.5  # higher joints than that are no better
ALONG, LEAST_M = 0.9, 1e-6  # cosine of what is along an axis; a way that counts
LIKE_RAD = 0.3  # postures that differ by less are of one kind


class Postures:
    """Sampled postures, with what their flanges do.

    Attributes:
        turns: (n,) which joints turn, of those that can by a whole turn.
        origin: (3,) where the first turning joint is, while what is before it stands at 0.
    """

    def __init__(self, urdf_text: str, limits_rad: Array) -> None:
        self._model = model = pinocchio.buildModelFromXML(urdf_text)
        self._data = model.createData()
        self._limits_rad = limits_rad
        self._flange = model.getFrameId(FLANGE)
        self._slides = np.array([slides(model, number) for number in range(1, model.njoints)])
        self.turns = ~self._slides & (np.ptp(limits_rad, axis=0) > 2 * math.pi)
        self._first = int(np.argmin(self._slides))  # the first joint that turns
        pinocchio.forwardKinematics(model, self._data, np.clip(np.zeros(model.nq), *limits_rad))
        places = self._data.oMi
        self._along = [places[joint + 1].rotation @ axis_of(model, joint + 1)[:3] for joint in range(self._first)]
        self.origin: Array = places[self._first + 1].translation.copy()
        self._about: Array = places[self._first + 1].rotation @ axis_of(model, self._first + 1)[3:]
        self._last: Array = model.frames[self._flange].placement.rotation.T @ axis_of(model, model.nq)[3:]

    @property
    def led(self) -> bool:
        """Whether an axis carries the first joint that turns."""
        return self._first > 0

    @cached_property
    def reach_m(self) -> float:
        """How far from the first turning joint the flange gets."""
        return float(np.linalg.norm(self._flanges[0][:, :3, 3] - self._flanges[1], axis=1).max())

    @cached_property
    def _joints(self) -> Array:
        """(SAMPLES, n), within half a turn each way where that is within the limits."""
        low, high = self._limits_rad
        least, most = np.maximum(low, -math.pi), np.minimum(high, math.pi)
        beyond = least >= most
        return np.random.default_rng(SEED).uniform(
            np.where(beyond, low, least), np.where(beyond, high, most), (SAMPLES, len(low))
        )

    @cached_property
    def _flanges(self) -> tuple[Array, Array]:
        """Of the samples: the flange (SAMPLES, 4, 4), and where the first turning joint is (SAMPLES, 3)."""
        model, data, flanges, firsts = self._model, self._data, [], []
        for joints in self._joints:
            pinocchio.forwardKinematics(model, data, joints)
            flanges.append(pinocchio.updateFramePlacement(model, data, self._flange).homogeneous)
            firsts.append(data.oMi[self._first + 1].translation.copy())
        return np.array(flanges), np.array(firsts)

    @cached_property
    def _features(self) -> Array:
        return self._featured(*self._flanges)

    @staticmethod
    def of(urdf_text: str, limits_rad: Array) -> Postures:
        """Those of an arm, sampled once."""
        return _sampled(urdf_text, tuple(map(tuple, limits_rad.tolist())))

    def near(self, flange: Array, count: int) -> Array:
        """(count, n) whose flange is nearest to a pose (4, 4), wherever the first joints lead it."""
        wanted = self._featured(flange[np.newaxis], self.origin[np.newaxis])
        off = np.linalg.norm(self._features - wanted, axis=1)
        return self._joints[np.argsort(off, kind="stable")[:count]]

    def led_to(self, joints_rad: Array, at_m: Array, flange: Array) -> Array:
        """A posture with its flange at a place (3,) led towards a pose (4, 4) by axis and first turning joint alone."""
        joints: Array = np.array(joints_rad, dtype=float)
        goal_m = flange[:3, 3]
        for number in range(self._first):
            along = self._along[number]
            way = float(along @ (goal_m - at_m))
            joints[number] = np.clip(joints[number] + way, *self._limits_rad[:, number])
            at_m = at_m + along * (joints[number] - joints_rad[number])
        return self._turned(joints, self._first, _angle(self._about, at_m - self.origin, goal_m - self.origin))

    def headed(self, joints_rad: Array, turn: Array) -> Array:
        """A posture whose last joint turns the flange as far as it can towards a heading (3, 3) in its frame."""
        if self._slides[-1]:
            return joints_rad
        axis = self._last
        skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        angle = math.atan2(float(axis @ skew), float(np.trace(turn) - axis @ turn @ axis))
        return self._turned(joints_rad, len(joints_rad) - 1, angle)

    def _turned(self, joints_rad: Array, number: int, angle: float) -> Array:
        """A joint turned by an angle, or by that and a whole turn where the limits ask it."""
        least, most = self._limits_rad[:, number]
        wanted = joints_rad[number] + angle + 2 * math.pi * np.array([0.0, -1.0, 1.0])
        allowed = [turned_rad for turned_rad in wanted if least <= turned_rad <= most]
        joints: Array = np.array(joints_rad, dtype=float)
        joints[number] = min(allowed, key=abs) if allowed else np.clip(wanted[0], least, most)
        return joints

    def _featured(self, flanges: Array, origins: Array) -> Array:
        """(k, 5) of flanges: how far from the first axis and along it, and where they point, seen from that axis."""
        off, axis, points = flanges[:, :3, 3] - origins, self._about, flanges[:, :3, 2]
        for along in self._along:  # which lead it anywhere along them
            off = off - np.outer(off @ along, along)
        high = off @ axis
        out = off - np.outer(high, axis)
        far = np.linalg.norm(out, axis=1)
        outwards = out / np.maximum(far, 1e-9)[:, np.newaxis]
        sideways = np.cross(axis, outwards)
        seen = [(outwards * points).sum(axis=1), (sideways * points).sum(axis=1), points @ axis]
        return np.column_stack([far, high, *(POINTS_M * coordinates for coordinates in seen)])


@lru_cache(maxsize=8)
def _sampled(urdf_text: str, limits: tuple[tuple[float, ...], ...]) -> Postures:
    return Postures(urdf_text, np.array(limits))


def usual_posture(arm: Kinematics, postures: Postures) -> Array:
    """A posture (n,) with the fingers down in front of the arm, from which it reaches most of what a bench has there.

    Of those that reach as much it is the one whose links are highest, away from the limits of its joints.
    """
    x, y, _ = postures.origin
    places = [(x + share * postures.reach_m, y, high) for share in REACHES for high in HEIGHTS_M]
    spots = [Pose((float(a), float(b), c), FINGERS_DOWN.quaternion_wxyz) for a, b, c in places]
    best: Array = arm.limits_rad.mean(axis=0)
    best_score = -math.inf
    kinds: list[Array] = []
    for number, spot in enumerate((*spots[2:4], *spots[:2], *spots[4:])):
        if number > 1 and kinds:
            break
        for start in arm.starts_near(spot, CANDIDATES):
            joints = arm.solved(spot, start, QUICK)
            if joints is None or len(kinds) > KINDS or any(np.abs(joints - kind).max() < LIKE_RAD for kind in kinds):
                continue
            kinds.append(joints)
            if (score := _score(arm, joints, spots)) > best_score:
                best, best_score = joints, score
    return best


def _score(arm: Kinematics, joints_rad: Array, spots: Sequence[Pose]) -> float:
    """How many places are reached from a posture by answers of its kind; how high its links are; how free they are."""
    found = [arm.solved(spot, arm.turned_to(joints_rad, spot), QUICK) for spot in spots]
    least, width = arm.limits_rad[0], np.ptp(arm.limits_rad, axis=0)
    rooms = [float((0.5 - np.abs((answer - least) / width - 0.5)).min()) for answer in found if answer is not None]
    lowest_m = float(arm.heights_m(joints_rad).min())
    return sum(room > 0.0 for room in rooms) + 2 * min(lowest_m, HIGH_M) + float(np.mean(rooms or [0.0]))


def axis_of(model: pinocchio.Model, number: int) -> Array:
    """(6,) how a joint moves what it carries, linear before angular."""
    data = model.joints[number].createData()
    model.joints[number].calc(data, np.zeros(model.nq))
    axis: Array = np.asarray(data.S).ravel()
    return axis


def misplaced_flange(robot: RobotModel) -> list[str]:
    """Whether the flange's z points away from the arm, as the last joint carries it; in words where it does not."""
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    flange, last = model.frames[model.getFrameId(FLANGE)], model.njoints - 1
    z, axis = flange.placement.rotation[:, 2], axis_of(model, last)
    outwards = flange.placement.translation - model.jointPlacements[last].inverse().translation
    if slides(model, last) or (abs(z @ axis[3:]) > ALONG and z @ outwards > -LEAST_M):
        return []
    where = "into the arm" if abs(z @ axis[3:]) > ALONG else "aside"
    remedy = "name a link whose z points away from it, or add one to the URDF by a fixed joint"
    return [f"z of the flange {robot.flange!r} points {where}: {remedy}"]


def slides(model: pinocchio.Model, number: int) -> bool:
    """Whether a joint moves along its axis instead of turning about it."""
    return not np.any(axis_of(model, number)[3:])


def _angle(axis: Array, first: Array, second: Array) -> float:
    """By how much one way (3,) is to be turned about an axis to point as another."""
    a, b = first - axis * (axis @ first), second - axis * (axis @ second)
    return math.atan2(float(axis @ np.cross(a, b)), float(a @ b))
