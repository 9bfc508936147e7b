"""How long a way takes beside a person: near hands, and the edge where they come in, the arm is slow, or held."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from bracket_cell.skills.motion.arm_outline import Rooms, turned
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.known_bench import Implausible, KnownBench
from bracket_cell.skills.motion.person_space import Person
from bracket_cell.skills.motion.separation import SeparationMonitor, arrival_s
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.pose import Array, Pose

MARK_RAD = 0.1  # between places of a way that are looked at
SEEN_S = 0.1  # the usual age of what is known of hands
BRAKES_M_S2 = 4.0  # how fast a fast arm becomes slow; what it may really do, the supervisor reckons
BACK_M = (0.12, 0.22, 0.32)  # from the end of a way that is nearest to the person
WORKS_M_S = 0.5  # a hand that is faster is on its way, and will be elsewhere; such have 1 m/s and more
HELD_S = 2.5  # that a hand holds the arm which is in its way: half of what a screw takes
SLOWED_S = 0.3  # a way that is slowed down by less has no better one
CORNER_S = 0.3  # that a corner takes
TRIED = 3  # ways
LEAST_M = 0.03  # a shorter way back is none


class BesidePerson:
    """Tells ways apart by how long they take beside hands that work, and hands that may come over the person's edge."""

    def __init__(self, separation: SeparationMonitor, kinematics: Kinematics, speeds_rad_s: Sequence[float]) -> None:
        """Args:
        speeds_rad_s: of each joint, at most.
        """
        self._separation, self._kinematics = separation, kinematics
        self._speeds_rad_s = np.array(speeds_rad_s)
        self._behind = separation.persons.behind(separation.persons.edge, SEEN_S)
        self._people: tuple[Person, ...] = (self._behind,)

    def see(self, seen: Observation) -> None:
        """Reckon from now on with hands that rest or work where they are seen, as far as that is known."""
        persons, self._people = self._separation.persons, (self._behind,)
        if seen.bench is not None:
            with suppress(Implausible):
                found = persons.of(KnownBench(persons.view_range, seen.bench, seen.time_s))
                self._people += tuple(person for person in found if person.works(WORKS_M_S))

    def soonest(self, start_rad: Array, goal_rad: Array) -> list[Array]:
        """Ways (k, n) between two postures, straight between their rows; the one that takes the least time first."""
        direct = np.array([start_rad, goal_rad])
        takes_s, hurried_s = self.takes_s(direct)
        if takes_s - hurried_s < SLOWED_S:
            return [direct]
        found = [(takes_s, direct)]
        found += [(self.takes_s(way)[0] + CORNER_S * (len(way) - 2), way) for way in self._ways_back(direct)]
        return [way for _, way in sorted(found, key=lambda candidate: candidate[0])[:TRIED]]

    def takes_s(self, way_rad: Array, people: Sequence[Person] | None = None) -> tuple[float, float]:
        """How long the arm needs for a way (k, joints) at the speeds that people allow, held where it is too near.

        And how long at its own speed; both without the time in which it gathers speed.

        Args:
            people: by default those that were seen last, and whoever may come over the edge.
        """
        monitor = self._separation
        gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way_rad, axis=0)).max(axis=1))])
        marks = np.linspace(0.0, gone[-1], max(2, math.ceil(gone[-1] / MARK_RAD) + 1))
        rows = np.column_stack([np.interp(marks, gone, column) for column in way_rad.T])
        placed = monitor.outline.placed(rows)
        corners_m = monitor.outline.corners_m(placed)
        steps_m = np.linalg.norm(np.diff(corners_m, axis=0), axis=3).max(axis=2)
        hurried_s = (np.abs(np.diff(rows, axis=0)) / self._speeds_rad_s).max(axis=1)
        takes_s, held_s = hurried_s, 0.0
        for person in self._people if people is None else people:
            rooms = monitor.outline.least_rooms(placed, turned(corners_m), person.body, holding=False)
            takes_s = np.maximum(takes_s, self._slowed_s(rooms, steps_m, person, takes_s))
            if person.waited_for:
                least_m = monitor.protective_m(person.most_m_s(), person.age_s, person.doubt_m)
                rooms.measure(rooms.least_m < least_m)
                held_s = HELD_S if rooms.distances_m.min() < least_m else held_s
        return float(takes_s.sum()) + held_s, float(hurried_s.sum())

    def _slowed_s(self, rooms: Rooms, steps_m: Array, person: Person, takes_s: Array) -> Array:
        """(K - 1,) how long the slowest link takes for each piece of a way beside a person, as far as that is longer.

        Distances are measured link by link, the one first that may be the slowest, until a measured one is.
        """
        known_m = rooms.least_m
        while True:
            longest_s = steps_m / self._may_m_s(person, known_m)
            slowest = longest_s == longest_s.max(axis=1, keepdims=True)
            asked = _ends(slowest & (longest_s > takes_s[:, np.newaxis])) & np.isinf(rooms.distances_m)
            if not asked.any():
                return np.asarray(longest_s.max(axis=1))
            rooms.measure(asked)
            known_m = np.where(np.isinf(rooms.distances_m), rooms.least_m, rooms.distances_m)

    def _may_m_s(self, person: Person, rooms_m: Array) -> Array:
        """(K - 1, L) how fast links may be beside a person, from their distances (K, L)."""
        monitor, settings = self._separation, self._separation.settings
        free_m = np.minimum(rooms_m[:-1], rooms_m[1:]) - settings.hand_error_m - monitor.arm_error_m
        spare_s = arrival_s(free_m, np.full(free_m.shape, person.most_m_s()), settings)
        may_m_s: Array = settings.slow_m_s + BRAKES_M_S2 * (spare_s - person.age_s - settings.reaction_s).clip(0.0)
        return may_m_s

    def _ways_back(self, ends_rad: Array) -> Iterator[Array]:
        """Ways (k, joints) that lead back from the person at first, or come to them last; also by a middle between."""
        poses = [self._kinematics.forward(joints) for joints in ends_rad]
        nearest_m = max(pose.position_m[0] for pose in poses)
        for back_m in BACK_M:
            start, goal = (self._drawn(*end, nearest_m - back_m) for end in zip(ends_rad, poses, strict=True))
            if start is None or goal is None:
                continue
            yield np.concatenate([ends_rad[:1], start, goal, ends_rad[1:]])
            middle = self._middle(start[-1] if len(start) else ends_rad[0], goal[0] if len(goal) else ends_rad[1])
            if middle is not None:
                yield np.concatenate([ends_rad[:1], start, [middle], goal, ends_rad[1:]])

    def _drawn(self, joints_rad: Array, pose: Pose, behind_m: float) -> Array | None:
        """Joints (1, n) of a place behind an end of a way, (0, n) where it is behind already, None out of reach."""
        x, y, z = pose.position_m
        if x - behind_m < LEAST_M:
            return np.empty((0, len(joints_rad)))
        behind = self._kinematics.follow(Pose((behind_m, y, z), pose.quaternion_wxyz), joints_rad)
        return None if behind is None or not self._kinematics.within_limits(behind) else behind[np.newaxis]

    def _middle(self, first_rad: Array, last_rad: Array) -> Array | None:
        """The joints between, without the arc that the tool makes about the base; None out of reach."""
        first, last = (np.array(self._kinematics.forward(end).position_m) for end in (first_rad, last_rad))
        between_rad = (first_rad + last_rad) / 2
        x, y, z = ((first + last) / 2).tolist()
        pose = Pose((min(x, float(first[0])), y, z), self._kinematics.forward(between_rad).quaternion_wxyz)
        found = self._kinematics.follow(pose, between_rad)
        return found if found is not None and self._kinematics.within_limits(found) else None


def _ends(pieces: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(K, L) the places where pieces (K - 1, L) begin or end."""
    none = np.zeros_like(pieces[:1])
    ends: NDArray[np.bool_] = np.concatenate([pieces, none]) | np.concatenate([none, pieces])
    return ends
