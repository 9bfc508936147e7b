"""How far a person is from the arm, and how fast the arm may be for that: speed and separation monitoring.

The terms are those of the protective distance S_p = S_h + S_r + S_s + C + Z_d + Z_r of ISO/TS 15066, 5.5.4.2.3, which
is part of ISO 10218-2:2025 now. An arm at the reduced speed stands before the hand that is coming, as fast as it is
seen to come, arrives. And a faster link is slowed down to that speed before a hand that comes at full speed could be
there: for that, the arm's braking is played through along its path. It is no safety function: see docs/safety.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from cell.interfaces.bench import Bench
from cell.interfaces.command import JointTrajectory
from cell.interfaces.pose import Array
from skills.motion.arm_outline import ArmOutline
from skills.motion.collision import CollisionChecker, placed
from skills.motion.person_space import Person, PersonSpace
from skills.motion.retreat import retreat_share
from skills.motion.settings import MotionSettings, SeparationSettings

MARK_S = 0.04  # between places of the path that are looked at
MARKS = 18  # enough of them: the arm is slow before it is past the last
NUMBERS: Array = np.arange(-1, MARKS + 1, dtype=np.float64)
PLAY_S = 0.01  # a step of the braking that is played through
SHARES = 24  # that are tried, from the slow one to all
LEAST_BRAKING = 0.5  # of what the joints may do, also where the path itself brakes or turns
SPEED_FRAMES = 3  # that the measured speed of a hand is a mean over
TOOL_LENGTH_M = 0.28  # from the last wrist joint to beyond the fingertips
BESIDE_M = 0.03  # what of a hand must be seen beside the tool
BLIND_HEIGHT_M = 0.25  # a hand beside the tool that is so high must be in the view
TINY = 1e-9
Following = tuple[JointTrajectory, float]


@dataclass(frozen=True)
class Separation:
    """Where arm and person are.

    Attributes:
        distance_m: now, of the link, gripper or held part that has the least room before it must stand; negative where
            they overlap, infinite from somebody whom the arm does not wait for.
        share: largest share of the planned speed at which the arm is slow before a hand can arrive.
        least_m: distance below which even a slow arm must stand.
        nearest: name of that link.
        leaving: largest share at which an arm that is too near may go on, as its path leads away; 0 where it does not,
            or where too little is known; 1 for an arm that is not too near.
    """

    distance_m: float
    share: float
    least_m: float
    nearest: str = ""
    leaving: float = 0.0


class SeparationMonitor:
    """Geometry of arm and person; the same question has the same answer.

    Attributes:
        outline: of the arm.
        persons: where people may be.
        arm_error_m: Z_r, how far a link may be off: the tolerance of the joints, at the arm's full reach.
    """

    def __init__(self, checker: CollisionChecker, bench: Bench, motion: MotionSettings) -> None:
        self.settings = motion.separation
        self.outline = ArmOutline(checker)
        self.persons = PersonSpace(bench, self.settings)
        self._acceleration_rad_s2 = np.array(motion.acceleration_limits_rad_s2)
        self._mean_over_s = SPEED_FRAMES / bench.overhead.rate_hz
        self._model, self._data = checker.model, checker.model.createData()
        self._eye = np.array(bench.overhead.mount.position_m)
        self._obstacles = [
            (coal.Transform3s(pose.rotation, np.array(pose.position_m)), shape)
            for pose, shape in map(placed, bench.obstacles)
        ]
        self._camera, self._camera_from_world = bench.overhead.model, bench.overhead.mount.pose.inverse()
        bones = (float(np.linalg.norm(one.translation)) for one in list(self._model.jointPlacements)[2:])
        self.arm_error_m = motion.arrival_tolerance_rad * (sum(bones) + TOOL_LENGTH_M)

    def judge(
        self, joints_rad: Array, persons: Sequence[Person], holding: bool, ahead: Following | None = None
    ) -> Separation:
        """Distance, protective distance and admissible share of speed: the worst of all links and persons.

        The speed of a hand is a mean over its last frames. As it sped up through the last three, so it goes on until
        the arm stands. Where nobody tells that, it sped up evenly through them, from rest.

        Args:
            joints_rad: (6,) as measured.
            holding: a part is between the fingers.
            ahead: the trajectory that is followed, and how far along it the arm is; None for a standing arm.
        """
        path_rad = np.empty((0, 6)) if ahead is None else ahead[0].along(ahead[1] + NUMBERS * MARK_S)
        placed = self.outline.placed(np.concatenate([joints_rad[np.newaxis], path_rad]))
        worst, leaving = Separation(np.inf, 1.0, 0.0), 1.0
        for person in (one for one in persons if one.waited_for):
            (rooms_m,), (ways,) = self.outline.rooms(placed[:1], person.body, holding)
            takes_s = self._takes_s(person.age_s, self.settings.slow_m_s)
            coming_m_s = person.coming_m_s(ways, takes_s, self._mean_over_s)
            link = int((rooms_m - coming_m_s * takes_s).argmin())
            room_m, least_m = float(rooms_m[link]), self.protective_m(float(coming_m_s[link]), person.age_s)
            clear_m = least_m + self.settings.hysteresis_m
            if room_m < clear_m:
                leaving = min(leaving, self._leaving(joints_rad, person, holding, ahead, room_m, clear_m))
            if room_m - least_m < worst.distance_m - worst.least_m:
                worst = Separation(room_m, 1.0, least_m, self.outline.names[link])
        share = 1.0 if ahead is None else self._share(path_rad, placed[1:], persons, holding)
        return replace(worst, share=share, leaving=leaving)

    def protective_m(self, hand_m_s: float, age_s: float, *, leaves: bool = False) -> float:
        """S_p but for C, which is in the person's volume, for an arm at its reduced speed.

        Args:
            hand_m_s: v_h, towards the arm.
            age_s: of what is known of the hand: part of T_r.
            leaves: for an arm that moves away, as slowly as it may then: S_r and S_s are 0.
        """
        settings = self.settings
        arm_m_s = settings.leaving_m_s if leaves else settings.slow_m_s
        brakes_m = arm_m_s**2 / (2 * settings.braking_m_s2)
        arm_m = 0.0 if leaves else arm_m_s * settings.reaction_s + brakes_m
        return hand_m_s * self._takes_s(age_s, arm_m_s) + arm_m + settings.hand_error_m + self.arm_error_m

    def _takes_s(self, age_s: float, arm_m_s: float) -> float:
        """T_r + T_s: from the exposure of the frame until the arm stands."""
        return age_s + self.settings.reaction_s + arm_m_s / self.settings.braking_m_s2

    def slow_share(self, path: JointTrajectory) -> float:
        """The share of speed at which no link is faster than the slow speed, wherever on a path it is."""
        times_s: Array = MARK_S * np.arange(int(np.ceil(path.duration_s / MARK_S)) + 1, dtype=np.float64)
        fastest_m_s = self._speeds_m_s(self.outline.placed(path.along(times_s))).max(initial=0.0)
        return self.settings.slow_m_s / max(float(fastest_m_s), self.settings.slow_m_s)

    def _speeds_m_s(self, placed: Array) -> Array:
        """(K - 1, L) of the fastest point of each link between K places of the path."""
        steps_m = np.linalg.norm(np.diff(self.outline.corners_m(placed), axis=0), axis=3)
        speeds: Array = steps_m.max(axis=2, initial=0.0) / MARK_S
        return speeds

    def _share(self, path_rad: Array, placed: Array, persons: Sequence[Person], holding: bool) -> float:
        """The largest share of speed from which every link is slow before anybody could be there.

        The arm goes on during its reaction; then it brakes along its path, from each of SHARES shares to the least.

        Args:
            path_rad: (MARKS + 2, 6), from the mark before the arm on, as it trails.
            placed: (MARKS + 2, L, 4, 4) of the links there.
        """
        between, slow_m_s = self._speeds_m_s(placed), self.settings.slow_m_s
        speeds_m_s = np.maximum(between[:-1], between[1:])
        if (least := slow_m_s / max(float(speeds_m_s.max()), slow_m_s)) >= 1:
            return 1.0
        arrives_s = self._arrives_s(placed[1:], speeds_m_s > slow_m_s, persons, holding)
        joints_rad_s = np.maximum(np.abs(path_rad[2:] - path_rad[:-2]) / (2 * MARK_S), TINY)
        bends_rad_s2 = (path_rad[2:] - 2 * path_rad[1:-1] + path_rad[:-2]) / MARK_S**2
        limits = self._acceleration_rad_s2 / joints_rad_s
        along = bends_rad_s2 * np.sign(path_rad[2:] - path_rad[:-2]) / joints_rad_s
        shares: Array = np.linspace(least, 1.0, SHARES)
        now, way_s, time_s, refused = shares, np.zeros(SHARES), 0.0, np.zeros(SHARES, dtype=bool)
        while (now[1:] > least + TINY).any():
            piece = np.minimum((way_s / MARK_S).astype(int), MARKS - 1)
            fast = speeds_m_s[piece] * now[:, np.newaxis] > slow_m_s + TINY  # at the least share none is
            refused |= (fast & (arrives_s[piece] < time_s + PLAY_S)).any(axis=1)
            if time_s >= self.settings.reaction_s:
                can = (limits[piece] + along[piece] * (now * now)[:, np.newaxis]).min(axis=1)
                can = np.maximum(can, LEAST_BRAKING * limits[piece].min(axis=1))
                now = np.maximum(now - PLAY_S * can, least)
            way_s, time_s = way_s + now * PLAY_S, time_s + PLAY_S
        first = int(refused[1:].argmax())
        return float(shares[first]) if refused[1:].any() else 1.0

    def _arrives_s(self, placed: Array, fast: NDArray[np.bool_], persons: Sequence[Person], holding: bool) -> Array:
        """(MARKS, L) from when on somebody could be where a link is that is fast in a piece; infinite for others."""
        asked = np.zeros((len(fast) + 1, fast.shape[1]), dtype=bool)
        asked[:-1] |= fast
        asked[1:] |= fast
        soonest: Array = np.full(fast.shape, np.inf)
        for person in persons:
            rooms_m, ways = self.outline.rooms(placed, person.body, holding, asked)
            rooms_m = np.minimum(rooms_m[:-1], rooms_m[1:]) - self.settings.hand_error_m - self.arm_error_m
            arrives_s = arrival_s(rooms_m, person.coming_m_s(ways[:-1]), self.settings) - person.age_s
            soonest = np.minimum(soonest, arrives_s)
        return soonest

    def _leaving(
        self, joints_rad: Array, person: Person, holding: bool, ahead: Following | None, room_m: float, clear_m: float
    ) -> float:
        if ahead is None or person.velocity_m_s is None:
            return 0.0
        if room_m < self.protective_m(float(np.hypot(*person.velocity_m_s)), person.age_s, leaves=True):
            return 0.0
        leaving_m_s = self.settings.leaving_m_s
        return retreat_share(self.outline, joints_rad, ahead, person.body, clear_m, leaving_m_s, holding=holding)

    def out_of_view(self, joints_rad: Array) -> bool:
        """Whether the tool works where the overhead camera would not see a hand beside it, as behind an obstacle."""
        pinocchio.forwardKinematics(self._model, self._data, joints_rad)
        x, y, z = self._data.oMi[self._model.njoints - 1].translation
        height_m = BLIND_HEIGHT_M
        if z > height_m + TOOL_LENGTH_M:
            return False
        points = self._camera_from_world.transform(np.array([[x, y, 0.0], [x, y, height_m]]))
        pixels = points @ self._camera.matrix.T
        pixels = pixels[:, :2] / pixels[:, 2:3]
        inside = (pixels >= 0).all() and (pixels < (self._camera.width_px, self._camera.height_px)).all()
        return not bool(inside) or any(self._hidden(np.array([x, y, height])) for height in (0.0, height_m))

    def _hidden(self, point_m: Array) -> bool:
        """Whether an obstacle is between the camera and a point, or what is beside it."""
        if not self._obstacles:
            return False
        way = point_m - self._eye
        length_m = float(np.linalg.norm(way))
        ray = coal.Capsule(BESIDE_M, length_m)
        at = coal.Transform3s(
            pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way).matrix(), self._eye + way / 2
        )
        request = coal.CollisionRequest()
        return any(
            coal.collide(ray, at, shape, place, request, coal.CollisionResult()) > 0 for place, shape in self._obstacles
        )


def arrival_s(rooms_m: Array, speeds_m_s: Array, settings: SeparationSettings) -> Array:
    """How soon hands come so far, from these speeds on, as fast as hands become: S_h turned round."""
    top, haste = np.maximum(settings.hand_speed_m_s, speeds_m_s), settings.hand_acceleration_m_s2
    rooms_m = rooms_m.clip(0.0)
    start = np.minimum(speeds_m_s + settings.speed_error_m_s, top)
    hastens_s = (top - start) / haste
    hastens_m = (start + top) / 2 * hastens_s
    soon: Array = (np.sqrt(start**2 + 2 * haste * np.minimum(rooms_m, hastens_m)) - start) / haste
    later: Array = np.maximum(rooms_m - hastens_m, 0.0) / top
    return soon + later
