"""A way around what stands between two postures: RRT-Connect of OMPL, the same for the same question.

Kuffner and LaValle, RRT-Connect, ICRA 2000. The work is counted in collision checks and not in time, so that it can be
cut into pieces, and a replay finds the same way after the same number of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from ompl import base, geometric, util

from bracket_cell.skills.motion.collision import Scene
from bracket_ground.interfaces.pose import Array

SEED = 1
LEVEL_CHECKS, TILTED_CHECKS = 800, 8000  # failed checks after which a round ends
STEPS_M = (0.03, 0.008)  # between checks: coarse at first, fine where a way by coarse ones touches something after all
LEG_M = 0.5  # longest branch that is tried at once
SHORTCUTS, TRIES = 3, 4  # times that a way is made shorter in three manners, and tries of each
SWING_RAD = 1.2  # of a joint over both ends; in [m] of one that slides
LEANS_RAD = 0.75  # of the tool from its directions at both ends: what is held stays in
SAME_M, SAME_RAD = 1e-3, 1e-6  # a way that leaves the level ones by less is one of them
LEVEL = 1e-3  # of the tool's tilt in [rad] for a turn of a joint by 1 rad: less is none

util.setLogLevel(util.LOG_NONE)


def ways_around(
    scene: Scene, searched: Scene, ends_rad: Array, limits_rad: Array, checks: int
) -> Iterator[Array | None]:
    """Joints (k, n) with straight ways between them, as the last answer; None after every piece of the work before it.

    Nothing more comes where none was found.

    Args:
        searched: the same as the scene with room to spare, which lets the search go in coarse steps.
        ends_rad: (2, n) start and goal.
        limits_rad: (2, n) the least and the most of each joint.
        checks: of postures, in a piece.
    """
    for level, most in ((True, LEVEL_CHECKS), (False, TILTED_CHECKS)):
        for step_m in STEPS_M:
            search = Search(Room(searched, ends_rad, limits_rad, level=level), step_m, most)
            while (found := search.go_on(checks)) is None and not search.over:
                yield None
            if found is None:
                break
            yield None
            found[0], found[-1] = ends_rad  # but for rounding
            if scene.is_free(found):
                yield found
                return


class Room:
    """Postures of one round as states, whose distances tell about how far the arm's points go.

    In a level one joints only move together so that the tool does not tilt at either end, and along the way between.
    Knows nothing of OMPL, which knows it: two that knew one another would never be freed.
    """

    def __init__(self, scene: Scene, ends_rad: Array, limits_rad: Array, *, level: bool) -> None:
        self.checks, self._scene = 0, scene
        self._low_rad, self._high_rad = limits_rad[0] - SAME_RAD, limits_rad[1] + SAME_RAD
        reaches_m = scene.reaches_m(ends_rad)
        ends = (ends_rad - ends_rad[0]) * reaches_m
        ways = _level_ways(scene.tilts(ends_rad) / reaches_m, ends[1]) if level else np.eye(len(reaches_m))
        ways, beyond_m = _swings(ways, SWING_RAD * reaches_m)
        self._axes = np.array([scene.tool_axis(joints) for joints in ends_rad])
        self._start, self._joints_from_state = ends_rad[0], ways / reaches_m[:, np.newaxis]
        self.size, self.ends = ways.shape[1], ends @ ways
        self.low, self.high = self.ends.min(axis=0) - beyond_m, self.ends.max(axis=0) + beyond_m

    def joints(self, state: base.State) -> Array:
        """(n,) of a state."""
        joints: Array = self._joints_from_state @ [state[number] for number in range(self.size)] + self._start
        return joints

    def is_free(self, state: base.State) -> bool:
        """Whether nothing touches there, and the tool leans little."""
        self.checks += 1
        joints = self.joints(state)
        inside = bool(((joints >= self._low_rad) & (joints <= self._high_rad)).all())
        level = float((self._axes @ self._scene.tool_axis(joints)).max()) > math.cos(LEANS_RAD) if inside else False
        return level and not self._scene.touches(joints)


def _level_ways(tilts: Array, direct: Array) -> Array:
    """(n, m) an orthonormal basis of the ways that do not tilt the tool, and of the direct one."""
    _, sizes, rows = np.linalg.svd(tilts)
    kept = rows[int((sizes > LEVEL).sum()) :]
    rest = direct - kept.T @ (kept @ direct)
    length = float(np.linalg.norm(rest))
    return (np.vstack([kept, rest / length]) if length > SAME_M else kept).T


def _swings(ways: Array, most_m: Array) -> tuple[Array, Array]:
    """The same ways (n, m) along the axes of the ellipsoid of all joints' swings (n,), and its half axes (m,)."""
    sizes, axes = np.linalg.eigh(ways.T @ (ways / most_m[:, np.newaxis] ** 2))
    return ways @ axes, 1.0 / np.sqrt(sizes)


class Search:
    """One round: trees from both ends grow until they meet."""

    def __init__(self, room: Room, step_m: float, most: float) -> None:
        self._room, self._most = room, most
        space, bounds = base.RealVectorStateSpace(room.size), base.RealVectorBounds(room.size)
        for number in range(room.size):
            bounds.setLow(number, float(room.low[number]))
            bounds.setHigh(number, float(room.high[number]))
        space.setBounds(bounds)
        util.RNG.setSeed(SEED)  # of all that is made from now on
        self._space = base.SpaceInformation(space)
        self._space.setStateValidityChecker(room.is_free)
        self._space.setStateValidityCheckingResolution(step_m / space.getMaximumExtent())
        self._space.setup()
        self._problem, ends = base.ProblemDefinition(self._space), (space.allocState(), space.allocState())
        for state, end in zip(ends, room.ends.tolist(), strict=True):
            for number, value in enumerate(end):
                state[number] = value
        self._problem.setStartAndGoalStates(*ends)
        self._planner = geometric.RRTConnect(self._space)
        self._planner.setRange(LEG_M)
        self._planner.setProblemDefinition(self._problem)
        self._planner.setup()

        simplifier = geometric.PathSimplifier(self._space)
        reduced, cut = SHORTCUTS * [simplifier.reduceVertices], SHORTCUTS * [simplifier.partialShortcutPath]
        self._shorter = [*reduced, *cut, *reduced]

    @property
    def over(self) -> bool:
        """Whether it is given up."""
        return self._room.checks >= self._most and not self._problem.hasExactSolution()

    def go_on(self, checks: int) -> Array | None:
        """The way (k, joints), if it is found and short with so many checks more, or one try to make it shorter."""
        room, enough = self._room, self._room.checks + checks
        if not self._problem.hasExactSolution():
            self._planner.solve(base.PlannerTerminationCondition(lambda: room.checks >= enough))
        while self._problem.hasExactSolution() and room.checks < enough:
            path = self._problem.getSolutionPath()
            if not self._shorter:
                return np.array([room.joints(state) for state in path.getStates()])
            self._shorter.pop(0)(path, TRIES)
        return None
