"""How far the person is from the arm, and how fast the arm may be for that (speed and separation, ISO/TS 15066).

A hand is known from above only, so it counts as a wall over the bench, from the fingertips along the forearm behind
them; a higher hand is nearer to the camera's axis than it seems, so the wall leans. A hand that left the view may be
anywhere beyond the edge. A contact at the slow speed is admissible, so the arm must be slow before a hand at full speed
can arrive; and it must stand before the hand that is coming, as fast as it is seen to come, arrives. Not safety-rated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio

from cell.interfaces.bench import Bench
from cell.interfaces.command import JointTrajectory
from cell.interfaces.perception import Edge, HandSample
from cell.interfaces.pose import Array
from skills.collision import CollisionChecker
from skills.person_space import PersonSpace
from skills.settings import SeparationSettings, SixFloats

AHEAD_S = (0.0, 0.1, 0.2, 0.3, 0.45)  # along the trajectory, where the arm will be before it can be slow
STEP_S = 0.02  # for the arm's speed
TOOL_LENGTH_M = 0.28  # from the last wrist joint to beyond the fingertips
HELD_RADIUS_M = 0.05  # of a sphere around a part between the fingers
EXTRA_M_S: Array = np.arange(100, dtype=np.float64) * 0.02  # speeds above the slow one that are asked for
LEAST_BRAKING = 0.5  # of what the joints may do, also where the path itself brakes or turns
BLIND_HEIGHT_M = 0.25  # a hand beside the tool that is so high must be in the view
HERE = coal.Transform3s()
TINY = 1e-9


@dataclass(frozen=True)
class Separation:
    """Where arm and person are.

    Attributes:
        distance_m: least distance now, of any link, the gripper or a held part; negative where they overlap.
        share: largest share of the planned speed at which the arm is slow before a hand can arrive.
        least_m: distance below which even a slow arm must stand.
    """

    distance_m: float
    share: float
    least_m: float


class SeparationMonitor:
    """Geometry of arm and person; the same question has the same answer."""

    def __init__(
        self, checker: CollisionChecker, bench: Bench, settings: SeparationSettings, acceleration_rad_s2: SixFloats
    ) -> None:
        self.settings = settings
        self._acceleration_rad_s2 = np.array(acceleration_rad_s2)
        self._model, self._geometry = checker.model, checker.arm_with_part(HELD_RADIUS_M)
        self._data, self._placed = self._model.createData(), self._geometry.createData()
        self._camera, self._camera_from_world = bench.overhead.model, bench.overhead.mount.pose.inverse()
        self._person = PersonSpace(bench, settings)

    def judge(
        self,
        joints_rad: Array,
        hand: HandSample,
        age_s: float,
        holding: bool,
        ahead: tuple[JointTrajectory, float] | None = None,
    ) -> Separation:
        """Distance and admissible share of speed.

        Args:
            joints_rad: (6,) as measured.
            age_s: of the hand's sample.
            holding: a part is between the fingers.
            ahead: the trajectory that is followed, and how far along it the arm is; None for a standing arm.
        """
        delay_s = age_s + self.settings.reaction_s
        wall = self._person.wall(hand)
        distance_m, way = self._nearest(joints_rad, wall, holding)
        coming = _coming_m_s(hand, way, self.settings)
        share = self._share(wall, (delay_s, coming), holding, ahead)
        return Separation(distance_m, share, self.least_m(coming, delay_s))

    def judge_beyond(
        self,
        joints_rad: Array,
        edges: Sequence[Edge],
        age_s: float,
        holding: bool,
        ahead: tuple[JointTrajectory, float] | None = None,
    ) -> Separation | None:
        """The same for a hand that left the view by one of these edges; it may come back anywhere there.

        Behind the edge where the person stands a hand may stay away for long: the arm is slow before it could arrive,
        but does not wait for it.
        """
        delay_s, coming = age_s + self.settings.reaction_s, self.settings.hand_speed_m_s
        found: list[Separation] = []
        for edge in edges:
            beyond = self._person.beyond[edge]
            distance_m, _ = self._nearest(joints_rad, beyond, holding)
            share = self._share(beyond, (delay_s, coming), holding, ahead)
            least_m = -np.inf if edge == self._person.edge else self.least_m(coming, delay_s)
            found.append(Separation(distance_m, share, least_m))
        return nearest(found)

    def _share(
        self,
        person: coal.Convex,
        arrival: tuple[float, float],
        holding: bool,
        ahead: tuple[JointTrajectory, float] | None,
    ) -> float:
        """Admissible share of speed; `arrival`: delay in [s] and how fast the person comes in [m/s]."""
        if ahead is None:
            return 1.0
        share, (delay_s, coming), (trajectory, path_s) = 1.0, arrival, ahead
        for later_s in AHEAD_S:
            if later_s and path_s + later_s > trajectory.duration_s:
                break
            room_m, _ = self._nearest(trajectory.at(path_s + later_s), person, holding)
            speed, braking = self.speed_and_braking(trajectory, path_s + later_s)
            admissible = self.admissible_m_s(room_m, delay_s, coming, braking) + braking * later_s
            share = min(share, admissible / max(speed, TINY))
        return share

    def admissible_m_s(self, distance_m: float, delay_s: float, coming_m_s: float, braking_m_s2: float) -> float:
        """Fastest speed of the arm from which it is slow before the hand has come this far.

        The hand comes during the delay and while the arm brakes to its slow speed, faster and faster; the arm moves on
        meanwhile.
        """
        settings = self.settings
        slow, brake = settings.slow_m_s, max(braking_m_s2, TINY)
        lasts_s: Array = delay_s + EXTRA_M_S / brake
        arm_m: Array = (slow + EXTRA_M_S) * delay_s + (slow + EXTRA_M_S / 2) * EXTRA_M_S / brake
        needed_m = settings.margin_m + np.add(arm_m, _reach_m(lasts_s, coming_m_s, settings))
        fits = np.flatnonzero(needed_m <= distance_m)
        return slow + (float(EXTRA_M_S[fits[-1]]) if len(fits) else 0.0)

    def least_m(self, coming_m_s: float, delay_s: float) -> float:
        """The protective distance of a slow arm from a hand that comes this fast."""
        slow, brake = self.settings.slow_m_s, self.settings.braking_m_s2
        stop_s = slow / brake
        return self.settings.margin_m + coming_m_s * (delay_s + stop_s) + slow * delay_s + slow * stop_s / 2

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

    def speed_and_braking(self, trajectory: JointTrajectory, path_s: float) -> tuple[float, float]:
        """Of the fastest of joints and tool: its planned speed in [m/s], and how it can slow down in [m/s^2].

        The arm slows along its path, all joints together: the one that needs longest for its share tells how fast.
        """
        before, here, after = (trajectory.at(path_s + step * STEP_S) for step in (-1, 0, 1))
        speeds_rad_s, bends_rad_s2 = (after - before) / (2 * STEP_S), (after - 2 * here + before) / STEP_S**2
        moves = np.abs(speeds_rad_s) > TINY
        if not moves.any():
            return 0.0, self.settings.braking_m_s2
        fastest = np.abs(speeds_rad_s[moves])
        limits = self._acceleration_rad_s2[moves] / fastest
        along = bends_rad_s2[moves] * np.sign(speeds_rad_s[moves]) / fastest
        share_per_s = max(float((limits + along).min()), LEAST_BRAKING * float(limits.min()))
        speed_m_s = self._speed_m_s(before, after)
        return speed_m_s, speed_m_s * share_per_s

    def _speed_m_s(self, before_rad: Array, after_rad: Array) -> float:
        """Of the fastest of joints and tool, between two places on its way."""
        places = []
        for joints_rad in (before_rad, after_rad):
            pinocchio.forwardKinematics(self._model, self._data, joints_rad)
            last = self._data.oMi[self._model.njoints - 1]
            tips = [last.act(TOOL_LENGTH_M * axis) for axis in np.eye(3)]
            joints = [self._data.oMi[number].translation for number in range(1, self._model.njoints)]
            places.append(np.array([*joints, *tips]))
        return float(np.linalg.norm(places[1] - places[0], axis=1).max() / (2 * STEP_S))

    def _nearest(self, joints_rad: Array, person: coal.Convex, holding: bool) -> tuple[float, Array]:
        """Least distance, and the way (3,) from the person to the arm along it."""
        pinocchio.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed, joints_rad)
        best_m, way = np.inf, np.zeros(3)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        for item, placement in zip(self._geometry.geometryObjects, self._placed.oMg, strict=True):
            if item.parentJoint <= 1 or (item.name == HELD and not holding):
                continue  # base and shoulder stand where the person does not reach
            result.clear()
            arm = coal.Transform3s(placement.rotation, placement.translation)
            distance_m = coal.distance(item.geometry, arm, person, HERE, request, result)
            if distance_m < best_m:
                best_m, way = distance_m, result.getNearestPoint1() - result.getNearestPoint2()
        return float(best_m), way


def nearest(found: Sequence[Separation]) -> Separation | None:
    """The worst of several: least room before the arm must stand, least share of speed."""
    if not found:
        return None
    worst = min(found, key=lambda one: one.distance_m - one.least_m)
    return Separation(worst.distance_m, min(one.share for one in found), worst.least_m)


HELD = "held part"


def _reach_m(time_s: Array, speed_m_s: float, settings: SeparationSettings) -> Array:
    """How far a hand comes in these times, from this speed on, as fast as hands become."""
    top, haste = settings.hand_speed_m_s, settings.hand_acceleration_m_s2
    start = min(speed_m_s + settings.speed_error_m_s, top)
    hastens_s = np.minimum(time_s, (top - start) / haste)
    reach: Array = start * hastens_s + haste * hastens_s**2 / 2 + top * (time_s - hastens_s)
    return reach


def _coming_m_s(hand: HandSample, way: Array, settings: SeparationSettings) -> float:
    """How fast the hand comes nearer, at least half of its speed, as it may turn; a hand's full speed if not known."""
    if hand.velocity_m_s is None:
        return settings.hand_speed_m_s
    length_m = float(np.linalg.norm(way[:2]))
    velocity = np.array(hand.velocity_m_s)
    speed = float(np.linalg.norm(velocity)) if length_m < TINY else float(velocity @ way[:2]) / length_m
    return max(speed, float(np.linalg.norm(velocity)) / 2)
