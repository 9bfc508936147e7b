"""How far a person is from the arm, and how fast the arm may be for that: speed and separation monitoring.

The terms are those of the protective distance S_p = S_h + S_r + S_s + C + Z_d + Z_r of ISO/TS 15066, 5.5.4.2.3, which
is part of ISO 10218-2:2025 now. An arm at the reduced speed stands before the hand that is coming, as fast as it is
seen to come, arrives. And a faster link is slowed down to that speed before a hand that comes at full speed could be
there: for that, the arm's braking is played through along its path. Where a link could clamp a hand, the speed at which
it closes the gap has a limit of its own. It is no safety function: see docs/safety.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from bracket_cell.skills.motion.arm_outline import ArmOutline, Rooms, turned
from bracket_cell.skills.motion.collision import CollisionChecker, placed
from bracket_cell.skills.motion.contact import ContactMap, clamp_m_s
from bracket_cell.skills.motion.person_space import Person, PersonSpace
from bracket_cell.skills.motion.retreat import retreat_share
from bracket_cell.skills.motion.settings import LEAST_BRAKING, MotionSettings, SeparationSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array


@dataclass(frozen=True)
class SeparationLimits:
    """How `Separation` looks along a path. Origin: chosen as fine as a tick has time for, and tried in simulated
    encounters (`cell lab eval encounters`).

    Attributes:
        mark_s: [s] between the places of a path that are examined.
        marks: [places] that are examined: the arm is slow before it is past the last.
        play_s: [s] step of the braking that is played through.
        shares: [shares of speed] that are tried, from the slow one to all.
        least_braking: share of the joints' deceleration that is counted on, where the path itself brakes or turns.
        speed_frames: [frames] that the measured speed of a hand is a mean over.
        tool_length_m: [m] from the last wrist joint to beyond the fingertips (2F-85 with its camera).
        beside_m: [m] of a hand that must be seen beside the tool.
        blind_height_m: [m] height from which a hand beside the tool must be in the view.
        first_asked: [places] that are measured first: the likeliest to forbid a share. Speed of computing alone.
    """

    mark_s: float = 0.04
    marks: int = 18
    play_s: float = 0.01
    shares: int = 24
    least_braking: float = LEAST_BRAKING
    speed_frames: int = 3
    tool_length_m: float = 0.28
    beside_m: float = 0.03
    blind_height_m: float = 0.25
    first_asked: int = 8


SEPARATION = SeparationLimits()


NUMBERS: Array = np.arange(-1, SEPARATION.marks + 1, dtype=np.float64)
EPS = 1e-9
Following = tuple[JointTrajectory, float]


@dataclass(frozen=True)
class Separation:
    """Where arm and person are.

    Attributes:
        distance_m: now, of the link, gripper or held part that has the least room before it must stand; negative where
            they overlap, infinite from somebody whom the arm does not wait for.
        speed_scale: largest share of the planned speed at which the arm is slow before a hand can arrive.
        least_m: distance below which even a slow arm must stand.
        nearest: name of that link.
        retreat_scale: largest share at which an arm too near may go on, as its path leads away; 0 where it does not,
            or where too little is known; 1 for an arm that is not too near.
        may_leave: some path might; where it is not, none does, whatever its way.
    """

    distance_m: float
    speed_scale: float
    least_m: float
    nearest: str = ""
    retreat_scale: float = 0.0
    may_leave: bool = False

    @property
    def spare_m(self) -> float:
        """How much of the distance is not needed; minus infinity where that is unknown."""
        spare_m = self.distance_m - self.least_m
        return -math.inf if math.isnan(spare_m) else spare_m


UNKNOWN = Separation(math.nan, 0.0, 0.0)  # it is not known who is where: the arm stands


class SeparationMonitor:
    """Geometry of arm and person; the same question has the same answer.

    Attributes:
        outline: of the arm.
        persons: where people may be.
        contacts: where a hand could be clamped.
        arm_error_m: Z_r, how far a link may be off: the tolerance of the joints, at the arm's full reach.
    """

    def __init__(self, checker: CollisionChecker, bench: Bench, motion: MotionSettings) -> None:
        self.settings = motion.separation
        self.outline = ArmOutline(checker)
        self.persons = PersonSpace(bench, self.settings)
        self.contacts, self._clamps = ContactMap([*checker.standing_m.values()]), 1.0
        if (clamp_n := self.settings.clamp_n) is not None:
            self._clamps = self.settings.slow_m_s / clamp_m_s(motion.robot, clamp_n)
        self._acceleration_rad_s2 = np.array(motion.acceleration_limits_rad_s2)
        self._mean_over_s = SEPARATION.speed_frames / bench.overhead.rate_hz
        self._model, self._data = checker.model, checker.model.createData()
        self._eye = np.array(bench.overhead.mount.position_m)
        self._obstacles = [
            (coal.Transform3s(pose.rotation, np.array(pose.position_m)), shape)
            for pose, shape in map(placed, bench.obstacles)
        ]
        self._camera, self._camera_from_world = bench.overhead.model, bench.overhead.mount.pose.inverse()
        bones = (
            float(np.linalg.norm(joint_placement.translation))
            for joint_placement in list(self._model.jointPlacements)[2:]
        )
        self.arm_error_m = motion.arrival_tolerance_rad * (sum(bones) + SEPARATION.tool_length_m)
        self._off_m = self.settings.hand_error_m + self.arm_error_m

    def judge(
        self, joints_rad: Array, persons: Sequence[Person], holding: bool, ahead: Following | None = None
    ) -> Separation:
        """Distance, protective distance and admissible share of speed: the worst of all links and persons.

        The speed of a hand is a mean over its last frames. As it sped up through the last three, so it goes on until
        the arm stands. Where nobody tells that, it sped up evenly through them, from rest.

        Args:
            joints_rad: (n,) as measured.
            holding: a part is between the fingers.
            ahead: the trajectory that is followed, and how far along it the arm is; None for a standing arm.
        """
        path_rad = (
            np.empty((0, len(joints_rad))) if ahead is None else ahead[0].along(ahead[1] + NUMBERS * SEPARATION.mark_s)
        )
        placed = self.outline.placed(np.concatenate([joints_rad[np.newaxis], path_rad]))
        corners_m = turned(self.outline.corners_m(placed))
        known = [(person, self.outline.least_rooms(placed, corners_m, person.body, holding)) for person in persons]
        found, leaving, may_leave = [Separation(np.inf, 1.0, 0.0)], 1.0, True
        for person, rooms in ((who, of) for who, of in known if who.waited_for):
            takes_s = self._takes_s(person.age_s, self.settings.slow_m_s)
            least_left_m = rooms.least_m[0] - person.most_m_s(takes_s, self._mean_over_s) * takes_s
            asked = least_left_m == least_left_m.min()
            for _ in range(2):  # the link that may be worst, then those that may be worse
                rooms.measure(asked[np.newaxis])
                coming_m_s = person.coming_m_s(rooms.ways[0], takes_s, self._mean_over_s)
                left_m = rooms.distances_m[0] - coming_m_s * takes_s
                asked = least_left_m <= left_m.min()
            link = int(left_m.argmin())
            room_m, least_m = (
                float(rooms.distances_m[0, link]),
                self.protective_m(float(coming_m_s[link]), person.age_s, person.doubt_m),
            )
            clear_m = least_m + self.settings.hysteresis_m
            if not room_m >= clear_m:
                may_leave = may_leave and self._may_leave(person, room_m)
                leaving = min(leaving, self._leaving(joints_rad, person, holding, ahead, clear_m) if may_leave else 0.0)
            found.append(Separation(room_m, 1.0, least_m, self.outline.names[link]))
        share = 1.0 if ahead is None else self._share(path_rad, corners_m[:, :, 1:], known)
        nearest = min(found, key=lambda separation: separation.spare_m)
        return replace(nearest, speed_scale=share, retreat_scale=leaving, may_leave=may_leave)

    def protective_m(self, hand_m_s: float, age_s: float, doubt_m: float = 0.0, *, leaves: bool = False) -> float:
        """S_p but for C, which is in the person's volume, for an arm at its reduced speed.

        Args:
            hand_m_s: v_h, towards the arm.
            age_s: of what is known of the hand: part of T_r.
            doubt_m: part of Z_d: see `Person`.
            leaves: for an arm that moves away, as slowly as it may then: S_r and S_s are 0.
        """
        settings = self.settings
        arm_m_s = settings.leaving_m_s if leaves else settings.slow_m_s
        brakes_m = arm_m_s**2 / (2 * settings.braking_m_s2)
        arm_m = 0.0 if leaves else arm_m_s * settings.reaction_s + brakes_m
        off_m = settings.hand_error_m + doubt_m + self.arm_error_m
        return hand_m_s * self._takes_s(age_s, arm_m_s) + arm_m + off_m

    def _takes_s(self, age_s: float, arm_m_s: float) -> float:
        """T_r + T_s: from the exposure of the frame until the arm stands."""
        return age_s + self.settings.reaction_s + arm_m_s / self.settings.braking_m_s2

    def slow_share(self, path: JointTrajectory) -> float:
        """The share of speed at which no link is faster than the slow speed, wherever on a path it is."""
        times_s: Array = SEPARATION.mark_s * np.arange(
            int(np.ceil(path.duration_s / SEPARATION.mark_s)) + 1, dtype=np.float64
        )
        fastest_m_s = self._speeds_m_s(turned(self.outline.corners_m(self.outline.placed(path.along(times_s))))).max(
            initial=0.0
        )
        return self.settings.slow_m_s / float(np.maximum(fastest_m_s, self.settings.slow_m_s))

    def _speeds_m_s(self, corners_m: Array) -> Array:
        """(K - 1, L) of the fastest point of each link between K places of the path, from corners (3, 8, K, L).

        What closes a gap that could clamp a hand counts as faster, by how much lower its limit is.
        """
        squares = np.square(np.diff(corners_m, axis=2))
        speeds: Array = np.sqrt((squares[0] + squares[1] + squares[2]).max(axis=0, initial=0.0)) / SEPARATION.mark_s
        if not self._clamps > 1:
            return speeds
        return np.maximum(speeds, self._clamps * self.contacts.closing_m_s(corners_m, SEPARATION.mark_s))

    def _share(self, path_rad: Array, corners_m: Array, known: Sequence[tuple[Person, Rooms]]) -> float:
        """The largest share of speed from which every link is slow before anybody could be there.

        Args:
            path_rad: (MARKS + 2, 6), from the mark before the arm on, as it trails.
            corners_m: (3, 8, MARKS + 2, L) of the links there.
            known: persons, and their rooms at all places that are looked at; the last MARKS + 1 are before the arm.
        """
        between, slow_m_s = self._speeds_m_s(corners_m), self.settings.slow_m_s
        speeds_m_s = np.maximum(between[:-1], between[1:])
        if not (least := slow_m_s / float(np.maximum(speeds_m_s.max(), slow_m_s))) < 1:
            return least  # 1, or NaN: no share is known to be slow
        shares: Array = np.linspace(least, 1.0, SEPARATION.shares)
        arrivals = [_Arrival(*pair, self._off_m, self.settings) for pair in known]
        braking = self._braking(path_rad)
        for count in (2, SEPARATION.shares):  # often the first share above the least is too much already
            until_s = self._fast_until_s(braking, speeds_m_s, shares[:count])[1:]
            for budget in (SEPARATION.first_asked, None):  # likely places, then all that could forbid a smaller share
                needed_s = until_s.max(axis=0, initial=-np.inf)
                soonest: Array = np.full(needed_s.shape, np.inf)
                for arrival in arrivals:
                    soonest = np.minimum(soonest, arrival.earliest_contact_s(needed_s, budget))
                refused = ~(soonest >= until_s).all(axis=(1, 2))
                until_s = until_s[: int(refused.argmax()) + 1] if refused.any() else until_s
            if refused.any():
                return float(shares[len(until_s) - 1])
        return 1.0

    def _braking(self, path_rad: Array) -> tuple[Array, Array, Array]:
        """By how much the share of speed may fall in a second, in each piece of the path.

        Returns:
            What each joint may do (6, MARKS), what the path adds to that at full share, and the least of it (MARKS,).
        """
        ways_rad = path_rad[2:] - path_rad[:-2]
        joints_rad_s = np.maximum(np.abs(ways_rad) / (2 * SEPARATION.mark_s), EPS)
        bends_rad_s2 = (path_rad[2:] - 2 * path_rad[1:-1] + path_rad[:-2]) / SEPARATION.mark_s**2
        limits = np.ascontiguousarray((self._acceleration_rad_s2 / joints_rad_s).T)
        along = np.ascontiguousarray((bends_rad_s2 * np.sign(ways_rad) / joints_rad_s).T)
        return limits, along, SEPARATION.least_braking * limits.min(axis=0)

    def _fast_until_s(self, braking: tuple[Array, Array, Array], speeds_m_s: Array, shares: Array) -> Array:
        """(S, MARKS, L) until when a link is fast in a piece of the path; minus infinity where it never is.

        The arm goes on during its reaction; then it brakes along its path, from each of S shares to the first, the
        least: there no link is fast.
        """
        limits, along, floors = braking
        least, now, way_s, time_s = shares[0], shares, np.zeros(len(shares)), 0.0
        pieces: list[NDArray[np.int_]] = []
        played: list[Array] = []
        times_s: list[float] = []
        while now[1:].max() > least + EPS:
            piece = np.minimum((way_s / SEPARATION.mark_s).astype(int), SEPARATION.marks - 1)
            pieces.append(piece)
            played.append(now)
            times_s.append(time_s + SEPARATION.play_s)
            if time_s >= self.settings.reaction_s:
                can = (limits.take(piece, axis=1) + along.take(piece, axis=1) * (now * now)).min(axis=0)
                now = np.maximum(now - SEPARATION.play_s * np.maximum(can, floors.take(piece)), least)
            way_s, time_s = way_s + now * SEPARATION.play_s, time_s + SEPARATION.play_s
        until_s: Array = np.full((len(shares), *speeds_m_s.shape), -np.inf)
        if played:
            place = np.array(pieces)
            fast = ~(speeds_m_s[place] * np.array(played)[..., np.newaxis] <= self.settings.slow_m_s + EPS)
            step, share, link = np.nonzero(fast)  # of several steps in one piece the last counts
            until_s[share, place[step, share], link] = np.array(times_s)[step]
        return until_s

    def _may_leave(self, person: Person, room_m: float) -> bool:
        if person.velocity_m_s is None:
            return False
        hand_m_s = person.most_m_s(self._takes_s(person.age_s, self.settings.leaving_m_s), self._mean_over_s)
        return room_m >= self.protective_m(hand_m_s, person.age_s, person.doubt_m, leaves=True)

    def _leaving(
        self, joints_rad: Array, person: Person, holding: bool, ahead: Following | None, clear_m: float
    ) -> float:
        if ahead is None:
            return 0.0
        leaving_m_s = self.settings.leaving_m_s
        return retreat_share(self.outline, joints_rad, ahead, person.body, clear_m, leaving_m_s, holding=holding)

    def out_of_view(self, joints_rad: Array) -> bool:
        """Whether the tool works where the overhead camera would not see a hand beside it, as behind an obstacle."""
        pinocchio.forwardKinematics(self._model, self._data, joints_rad)
        x, y, z = self._data.oMi[self._model.njoints - 1].translation
        height_m = SEPARATION.blind_height_m
        if z > height_m + SEPARATION.tool_length_m:  # of NaN it is not known
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
        ray = coal.Capsule(SEPARATION.beside_m, length_m)
        at = coal.Transform3s(
            pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way).matrix(), self._eye + way / 2
        )
        request = coal.CollisionRequest()
        return any(
            coal.collide(ray, at, shape, place, request, coal.CollisionResult()) > 0 for place, shape in self._obstacles
        )


class _Arrival:
    """From when on somebody could be where a link is in a piece of the path.

    Args:
        rooms: of links; the last MARKS + 1 places are the ends of the pieces.
        off_m: what rooms may be less than they look, besides the person's doubt.
    """

    def __init__(self, person: Person, rooms: Rooms, off_m: float, settings: SeparationSettings) -> None:
        self._person, self._rooms, self._off_m, self._settings = person, rooms, off_m + person.doubt_m, settings
        self._least_s = self._of(rooms.least_m, np.array(person.most_m_s())) - EPS
        self._asked = np.zeros(self._least_s.shape, dtype=bool)

    def earliest_contact_s(self, deadlines_s: Array, budget: int | None) -> Array:
        """(MARKS, L), as measured where it may be before the deadlines; infinite elsewhere.

        Args:
            budget: how many, the likeliest, are measured; None for all.
        """
        urgent_s = self._least_s - deadlines_s
        asked = ~(urgent_s >= 0)
        if budget is not None and asked.sum() > budget:
            asked = urgent_s <= np.partition(urgent_s, budget, axis=None)[budget]
        self._asked |= asked
        ends = np.zeros(self._rooms.least_m.shape, dtype=bool)
        ends[-SEPARATION.marks - 1 : -1] |= asked
        ends[-SEPARATION.marks :] |= asked
        self._rooms.measure(ends)
        found = self._of(self._rooms.distances_m, self._person.coming_m_s(self._rooms.ways[-SEPARATION.marks - 1 : -1]))
        return np.where(self._asked, found, np.inf)

    def _of(self, rooms_m: Array, coming_m_s: Array) -> Array:
        rooms_m = np.minimum(rooms_m[-SEPARATION.marks - 1 : -1], rooms_m[-SEPARATION.marks :]) - self._off_m
        return arrival_s(rooms_m, coming_m_s, self._settings) - self._person.age_s


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
