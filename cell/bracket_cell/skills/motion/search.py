"""A way around what stands between two postures: RRT-Connect of OMPL, the same for the same question.

Kuffner and LaValle, RRT-Connect, ICRA 2000. The work is counted in collision checks and not in time, so that it can be
cut into pieces, and a replay finds the same way after the same number of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from ompl import base, geometric, util

from bracket_cell.skills.motion.collision import Scene
from bracket_ground.interfaces.pose import Array

SEED = 1
LEVEL_CHECKS, TILTED_CHECKS = 1200, 8000  # after so many in vain a round is given up
STEPS_M = (0.03, 0.008)  # between checks: coarse at first, fine where a way by coarse ones touches something after all
LEG_M = 0.5  # longest branch that is tried at once
SHORTCUTS, TRIES = 3, 4  # times that a way is made shorter in three manners, and tries of each
BEYOND_RAD = np.array([1.2, 1.4, 1.4, 0.0, 0.0, 2.5])  # how far over both ends ways may swing; wrist_1 as below
TILTED_RAD = BEYOND_RAD + np.array([0.0, 0.0, 0.0, 0.5, 0.5, 0.0])  # where no way is found that keeps the tool level
SAME_RAD = 1e-6
REACH_M = np.array([1.2, 1.2, 0.8, 0.3, 0.3, 0.15])  # from each axis to what it moves, of an arm of this size
# wrist_1 is told by how the tool pitches, lift + elbow + wrist_1: ways between postures with the tool down keep it so.
PITCH_FROM_JOINTS = np.eye(6)
PITCH_FROM_JOINTS[3, 1:4] = 1.0
JOINTS_FROM_PITCH = np.linalg.inv(PITCH_FROM_JOINTS)

util.setLogLevel(util.LOG_NONE)


def ways_around(
    scene: Scene, searched: Scene, ends_rad: Array, limits_rad: Array, checks: int
) -> Iterator[Array | None]:
    """Joints (k, 6) with straight ways between them, as the last answer; None after every piece of the work before it.

    Nothing more comes where none was found.

    Args:
        searched: the same as the scene with room to spare, which lets the search go in coarse steps.
        ends_rad: (2, 6) start and goal.
        limits_rad: (2, 6) the least and the most of each joint.
        checks: of postures, in a piece.
    """
    for beyond_rad, most in ((BEYOND_RAD, LEVEL_CHECKS), (TILTED_RAD, TILTED_CHECKS)):
        for step_m in STEPS_M:
            search = Search(Room(searched, ends_rad, limits_rad, beyond_rad), step_m, most)
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

    Knows nothing of OMPL, which knows it: two that knew one another would never be freed.
    """

    def __init__(self, scene: Scene, ends_rad: Array, limits_rad: Array, beyond_rad: Array = BEYOND_RAD) -> None:
        self.checks, self._scene, self._wrist_rad = 0, scene, limits_rad[:, 3]
        ends = ends_rad @ PITCH_FROM_JOINTS.T
        low, high = ends.min(axis=0) - beyond_rad, ends.max(axis=0) + beyond_rad
        joints = [0, 1, 2, 4, 5]
        low[joints], high[joints] = np.maximum(low, limits_rad[0])[joints], np.minimum(high, limits_rad[1])[joints]
        free = np.flatnonzero(high - low > SAME_RAD)
        scale = REACH_M[free]
        fixed = ends[0].copy()
        fixed[free] = 0.0
        self._fixed_rad, self._joints_from_state = JOINTS_FROM_PITCH @ fixed, JOINTS_FROM_PITCH[:, free] / scale
        self.size, self.ends = len(free), ends[:, free] * scale
        self.low, self.high = low[free] * scale - SAME_RAD, high[free] * scale + SAME_RAD

    def joints(self, state: base.State) -> Array:
        """(6,) of a state."""
        joints: Array = self._joints_from_state @ [state[number] for number in range(self.size)] + self._fixed_rad
        return joints

    def is_free(self, state: base.State) -> bool:
        """Whether nothing touches there."""
        self.checks += 1
        joints = self.joints(state)
        return bool(self._wrist_rad[0] <= joints[3] <= self._wrist_rad[1]) and not self._scene.touches(joints)


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
        """The way (k, 6), if it is found and short with so many checks more, or one try to make it shorter."""
        room, enough = self._room, self._room.checks + checks
        if not self._problem.hasExactSolution():
            self._planner.solve(base.PlannerTerminationCondition(lambda: room.checks >= enough))
        while self._problem.hasExactSolution() and room.checks < enough:
            path = self._problem.getSolutionPath()
            if not self._shorter:
                return np.array([room.joints(state) for state in path.getStates()])
            self._shorter.pop(0)(path, TRIES)
        return None
