"""How far the person is from the arm, and how fast the arm may be for that (speed and separation, ISO/TS 15066).

A hand is known from above only, so it counts as a wall over the bench (`person_space`). A contact at the slow
speed is admissible. So for each share of speed the arm's braking is played through along its path: every link must be
slow before a hand that comes at full speed could be there. And a slow arm must stand before the hand that is coming, as
fast as it is seen to come, arrives; nearer than that it may only leave, slowly (`retreat`). Not safety-rated.
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
from cell.interfaces.perception import Edge, HandSample
from cell.interfaces.pose import Array
from skills.motion.arm_outline import ArmOutline
from skills.motion.collision import CollisionChecker
from skills.motion.person_space import PersonSpace
from skills.motion.retreat import Leaving
from skills.motion.settings import SeparationSettings, SixFloats

MARK_S = 0.04  # between places of the path that are looked at
MARKS = 18  # so many: the arm is slow before it is past the last
NUMBERS: Array = np.arange(-1, MARKS + 1, dtype=np.float64)
PLAY_S = 0.01  # a step of the braking that is played through
SHARES = 24  # that are tried, from the slow one to all
LEAST_BRAKING = 0.5  # of what the joints may do, also where the path itself brakes or turns
TOOL_LENGTH_M = 0.28  # from the last wrist joint to beyond the fingertips
BLIND_HEIGHT_M = 0.25  # a hand beside the tool that is so high must be in the view
TINY = 1e-9
Following = tuple[JointTrajectory, float]


@dataclass(frozen=True)
class Separation:
    """Where arm and person are.

    Attributes:
        distance_m: least distance now, of any link, the gripper or a held part; negative where they overlap.
        share: largest share of the planned speed at which the arm is slow before a hand can arrive.
        least_m: distance below which even a slow arm must stand.
        nearest: name of the link that is nearest now.
        leaving: largest share at which an arm that is too near may go on, as its path leads away; 0 where it does not,
            or where too little is known; 1 for an arm that is not too near.
    """

    distance_m: float
    share: float
    least_m: float
    nearest: str = ""
    leaving: float = 0.0


@dataclass(frozen=True)
class _Stretch:
    """The next stretch of a path as planned: K pieces of MARK_S, L links, 6 joints.

    Attributes:
        places: (K + 1, L, 4, 4) of the links at the ends of the pieces.
        speeds_m_s: (K, L) of the fastest point of each link, in this piece or the one before, as the arm trails.
        joints_rad_s, bends_rad_s2: (K, 6).
    """

    places: Array
    speeds_m_s: Array
    joints_rad_s: Array
    bends_rad_s2: Array


@dataclass(frozen=True)
class _Braking:
    """The arm brakes along a stretch, from each of SHARES shares of speed, in T steps.

    Attributes:
        times_s: (T,) since the arm began to.
        pieces: (T, SHARES) of the stretch in which it is.
        shares: (T, SHARES) of the planned speed that it still has.
    """

    times_s: Array
    pieces: NDArray[np.intp]
    shares: Array


class SeparationMonitor:
    """Geometry of arm and person; the same question has the same answer."""

    def __init__(
        self, checker: CollisionChecker, bench: Bench, settings: SeparationSettings, acceleration_rad_s2: SixFloats
    ) -> None:
        self.settings = settings
        self.outline = ArmOutline(checker)
        self._leaving = Leaving(self.outline, settings)
        self._acceleration_rad_s2 = np.array(acceleration_rad_s2)
        self._model, self._data = checker.model, checker.model.createData()
        self._camera, self._camera_from_world = bench.overhead.model, bench.overhead.mount.pose.inverse()
        self._person = PersonSpace(bench, settings)
        self._walled: tuple[HandSample | None, coal.Convex] = None, None

    def judge(
        self, joints_rad: Array, hand: HandSample, age_s: float, holding: bool, ahead: Following | None = None
    ) -> Separation:
        """Distance and admissible share of speed.

        Args:
            joints_rad: (6,) as measured.
            age_s: of the hand's sample.
            holding: a part is between the fingers.
            ahead: the trajectory that is followed, and how far along it the arm is; None for a standing arm.
        """
        if self._walled[0] is not hand:  # several ticks ask about the same one
            self._walled = hand, self._person.wall(hand)
        person = self._walled[1]
        found = self._judge(joints_rad, person, hand.velocity_m_s, age_s, holding, ahead)
        clear_m = found.least_m + self.settings.hysteresis_m
        if found.distance_m >= clear_m:
            return replace(found, leaving=1.0)
        if ahead is None or hand.velocity_m_s is None:
            return found
        if found.distance_m < self._leaving.contact_m(float(np.hypot(*hand.velocity_m_s)), age_s):
            return found
        return replace(found, leaving=self._leaving.share(joints_rad, *ahead, person, clear_m, holding=holding))

    def judge_beyond(
        self, joints_rad: Array, edges: Sequence[Edge], age_s: float, holding: bool, ahead: Following | None = None
    ) -> Separation | None:
        """The same for a hand that left the view by one of these edges; it may come back anywhere there.

        Behind the edge where the person stands a hand may stay away for long: the arm is slow before it could arrive,
        but does not wait for it.
        """
        found = []
        for edge in edges:
            one = self._judge(joints_rad, self._person.beyond[edge], None, age_s, holding, ahead)
            waits = edge != self._person.edge
            found.append(one if waits else replace(one, least_m=-np.inf))
        return nearest(found)

    def _judge(
        self,
        joints_rad: Array,
        person: coal.Convex,
        velocity_m_s: tuple[float, float] | None,
        age_s: float,
        holding: bool,
        ahead: Following | None,
    ) -> Separation:
        path_rad = joints_rad[np.newaxis][:0] if ahead is None else ahead[0].along(ahead[1] + NUMBERS * MARK_S)
        places = self.outline.placed(np.concatenate([joints_rad[np.newaxis], path_rad]))
        rooms_m, ways = (one[0] for one in self.outline.rooms(places[:1], person, holding))
        link = int(rooms_m.argmin())
        coming = self._coming_m_s(velocity_m_s, ways)
        share = 1.0
        if ahead is not None:
            share = self._share(self._stretch(path_rad, places[1:]), person, velocity_m_s, age_s, holding)
        return Separation(float(rooms_m[link]), share, self.least_m(coming[link], age_s), self.outline.names[link])

    def least_m(self, coming_m_s: float, age_s: float) -> float:
        """The protective distance of a slow arm from a hand that comes this fast."""
        slow, reaction_s = self.settings.slow_m_s, self.settings.reaction_s
        stop_s = slow / self.settings.braking_m_s2
        arm_m = slow * (reaction_s + stop_s / 2)
        return float(self.settings.margin_m + coming_m_s * (age_s + reaction_s + stop_s) + arm_m)

    def slow_share(self, path: JointTrajectory) -> float:
        """The share of speed at which no link is faster than the slow speed, wherever on a path it is."""
        times_s: Array = np.arange(0.0, path.duration_s + MARK_S, MARK_S, dtype=np.float64)
        corners_m = self.outline.corners_m(self.outline.placed(path.along(times_s)))
        fastest_m_s = float(np.linalg.norm(np.diff(corners_m, axis=0), axis=3).max(initial=0.0)) / MARK_S
        return self.settings.slow_m_s / max(fastest_m_s, self.settings.slow_m_s)

    def _stretch(self, joints: Array, places: Array) -> _Stretch:
        steps_m = np.diff(self.outline.corners_m(places), axis=0)
        between = np.linalg.norm(steps_m, axis=3).max(axis=2) / MARK_S
        return _Stretch(
            places=places[1:],
            speeds_m_s=np.maximum(between[:-1], between[1:]),
            joints_rad_s=(joints[2:] - joints[:-2]) / (2 * MARK_S),
            bends_rad_s2=(joints[2:] - 2 * joints[1:-1] + joints[:-2]) / MARK_S**2,
        )

    def _share(
        self,
        stretch: _Stretch,
        person: coal.Convex,
        velocity_m_s: tuple[float, float] | None,
        age_s: float,
        holding: bool,
    ) -> float:
        """The largest share of speed from which every link is slow before the person could be there."""
        settings = self.settings
        least = settings.slow_m_s / max(float(stretch.speeds_m_s.max()), settings.slow_m_s)
        if least >= 1:
            return 1.0
        shares: Array = np.linspace(least, 1.0, SHARES)
        braking = self._braked(stretch, shares)
        pieces = braking.pieces
        speeds_m_s = stretch.speeds_m_s[pieces] * braking.shares[..., np.newaxis]
        fast = speeds_m_s > settings.slow_m_s + TINY  # at the least share none is
        left_m, coming_m_s = self._rooms(stretch, pieces, fast, person, velocity_m_s, holding)
        comes_m = reach(age_s + braking.times_s[:, np.newaxis, np.newaxis] + PLAY_S, coming_m_s, settings)
        met = (left_m - settings.margin_m < comes_m)[np.arange(len(pieces))[:, np.newaxis], pieces]
        refused = np.flatnonzero((met & fast).any(axis=(0, 2))[1:])
        return float(shares[refused[0]]) if len(refused) else 1.0

    def _braked(self, stretch: _Stretch, shares: Array) -> _Braking:
        """From each share of speed: the arm goes on during its reaction, then it brakes along its path to the least."""
        fastest = np.maximum(np.abs(stretch.joints_rad_s), TINY)
        limits, along = (
            self._acceleration_rad_s2 / fastest,
            stretch.bends_rad_s2 * np.sign(stretch.joints_rad_s) / fastest,
        )
        least_braking = LEAST_BRAKING * limits.min(axis=1)
        now, path_s, time_s, told = shares, np.zeros(SHARES), 0.0, []
        while (now[1:] > shares[0] + TINY).any():
            piece = np.minimum((path_s / MARK_S).astype(int), MARKS - 1)
            told.append((time_s, piece, now))
            if time_s >= self.settings.reaction_s:
                square = now * now
                can = (limits[piece] + along[piece] * square[:, np.newaxis]).min(axis=1)
                now = np.maximum(now - PLAY_S * np.maximum(can, least_braking[piece]), shares[0])
            path_s, time_s = path_s + now * PLAY_S, time_s + PLAY_S
        return _Braking(*(np.array(one) for one in zip(*told, strict=True)))

    def _rooms(
        self,
        stretch: _Stretch,
        pieces: NDArray[np.intp],
        fast: NDArray[np.bool_],
        person: coal.Convex,
        velocity_m_s: tuple[float, float] | None,
        holding: bool,
    ) -> tuple[Array, Array]:
        """(K, L) how far the person is, the least at both ends of a piece, and how fast it comes nearer.

        Only of links that are fast in a piece, for as many pieces as the arm comes to; the others have no meaning.
        """
        links, last = fast.shape[2], int(pieces.max()) + 1
        used = np.zeros((last, links), dtype=bool)
        used.reshape(-1)[(pieces[..., np.newaxis] * links + np.arange(links))[fast]] = True
        asked = np.zeros((last + 1, links), dtype=bool)
        asked[:-1] |= used
        asked[1:] |= used
        rooms_m, ways = self.outline.rooms(stretch.places[: last + 1], person, holding, asked)
        return np.minimum(rooms_m[:-1], rooms_m[1:]), self._coming_m_s(velocity_m_s, ways[:-1])

    def out_of_view(self, joints_rad: Array) -> bool:
        """Whether the tool works where the overhead camera would not see a hand beside it."""
        pinocchio.forwardKinematics(self._model, self._data, joints_rad)
        x, y, z = self._data.oMi[self._model.njoints - 1].translation
        height_m = BLIND_HEIGHT_M
        if z > height_m + TOOL_LENGTH_M:
            return False
        points = self._camera_from_world.transform(np.array([[x, y, 0.0], [x, y, height_m]]))
        pixels = points @ self._camera.matrix.T
        pixels = pixels[:, :2] / pixels[:, 2:3]
        inside = (pixels >= 0).all() and (pixels < (self._camera.width_px, self._camera.height_px)).all()
        return not bool(inside)

    def _coming_m_s(self, velocity_m_s: tuple[float, float] | None, ways: Array) -> Array:
        """How fast the person comes nearer along each of the ways (..., 3): at least at half of its speed, as it may
        turn; at a hand's full speed where that is not known."""
        if velocity_m_s is None:
            return np.full(ways.shape[:-1], self.settings.hand_speed_m_s)
        velocity = np.array(velocity_m_s)
        speed, lengths = float(np.linalg.norm(velocity)), np.linalg.norm(ways[..., :2], axis=-1)
        towards = np.where(lengths < TINY, speed, ways[..., :2] @ velocity / np.maximum(lengths, TINY))
        coming: Array = np.maximum(towards, speed / 2)
        return coming


def nearest(found: Sequence[Separation]) -> Separation | None:
    """The worst of several: least room before the arm must stand, least share of speed."""
    if not found:
        return None
    worst = min(found, key=lambda one: one.distance_m - one.least_m)
    share, leaving = min(one.share for one in found), min(one.leaving for one in found)
    return replace(worst, share=share, leaving=leaving)


def reach(time_s: Array | float, speed_m_s: Array, settings: SeparationSettings) -> Array:
    """How far hands come in these times in [m], from these speeds on, as fast as hands become."""
    top, haste = settings.hand_speed_m_s, settings.hand_acceleration_m_s2
    start = np.minimum(speed_m_s + settings.speed_error_m_s, top)
    hastens_s = np.minimum(time_s, (top - start) / haste)
    way: Array = start * hastens_s + haste * hastens_s**2 / 2 + top * (time_s - hastens_s)
    return way
