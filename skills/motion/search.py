"""A way around what stands between two postures: RRT-Connect of OMPL, the same for the same question.

Kuffner and LaValle, RRT-Connect, ICRA 2000. The work is counted in collision checks and not in time, so that it can be
cut into pieces, and a replay finds the same way after the same number of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from ompl import base, geometric, util

from cell.interfaces.pose import Array
from skills.motion.collision import STEP_M, Scene

SEED = 1
ROUND_CHECKS = 8000  # after so many in vain a round is given up
LEG_M = 0.5  # longest branch that is tried at once
SHORTCUTS = 12
BEYOND_RAD = np.array([1.2, 1.4, 1.4, 0.0, 0.0, 0.8])  # how far over both ends ways may swing; wrist_1 as below
TILT_RAD = 0.5  # of an empty tool, where no way is found without
SAME_RAD = 1e-6
# wrist_1 is told by how the tool pitches: lift + elbow + wrist_1. A way between two postures with the tool down keeps it.
PITCH_FROM_JOINTS = np.eye(6)
PITCH_FROM_JOINTS[3, 1:4] = 1.0
JOINTS_FROM_PITCH = np.linalg.inv(PITCH_FROM_JOINTS)

util.setLogLevel(util.LOG_NONE)


def ways_around(
    scene: Scene, start_rad: Array, goal_rad: Array, range_rad: Array, checks: int, *, tilts: bool
) -> Iterator[Array | None]:
    """Joints (k, 6) with straight ways between them, as the last answer; None after every piece of the work before it.

    Nothing more comes where none was found.

    Args:
        range_rad: (6,) how far each joint turns, each way.
        checks: of postures, in a piece.
        tilts: the tool may also be tilted.
    """
    for tilt_rad in (0.0, TILT_RAD) if tilts else (0.0,):
        search = _Search(scene, start_rad, goal_rad, range_rad, tilt_rad)
        while not search.over:
            found = search.go_on(checks)
            yield found
            if found is not None:
                return


class _Search:
    """One round: trees from both ends grow until they meet.

    States count in [m]: each joint by how far the farthest point goes that it moves.
    """

    def __init__(self, scene: Scene, start_rad: Array, goal_rad: Array, range_rad: Array, tilt_rad: float) -> None:
        self._scene, self._checks = scene, 0
        ends = np.array([start_rad, goal_rad]) @ PITCH_FROM_JOINTS.T
        beyond = BEYOND_RAD + tilt_rad * np.array([0, 0, 0, 1, 1, 0])
        low, high = ends.min(axis=0) - beyond, ends.max(axis=0) + beyond
        joints = [0, 1, 2, 4, 5]
        low[joints], high[joints] = np.maximum(low, -range_rad)[joints], np.minimum(high, range_rad)[joints]
        self._range_rad = range_rad
        free = np.flatnonzero(high - low > SAME_RAD)
        scale = scene.reach_m[free]
        self._fixed = ends[0].copy()
        self._fixed[free] = 0.0
        self._fixed = JOINTS_FROM_PITCH @ self._fixed
        self._joints_from_state = JOINTS_FROM_PITCH[:, free] / scale
        space = base.RealVectorStateSpace(len(free))
        bounds = base.RealVectorBounds(len(free))
        for number, (least, most) in enumerate(zip(low[free] * scale, high[free] * scale, strict=True)):
            bounds.setLow(number, float(least) - 1e-9)
            bounds.setHigh(number, float(most) + 1e-9)
        space.setBounds(bounds)
        self._size = len(free)
        util.RNG.setSeed(SEED)  # of all that is made from now on
        self._space = base.SpaceInformation(space)
        self._space.setStateValidityChecker(self._is_free)
        self._space.setStateValidityCheckingResolution(STEP_M / space.getMaximumExtent())
        self._space.setup()
        self._problem = base.ProblemDefinition(self._space)
        states = [space.allocState(), space.allocState()]
        for state, end in zip(states, ends[:, free] * scale, strict=True):
            for number, value in enumerate(end):
                state[number] = float(value)
        self._problem.setStartAndGoalStates(*states)
        self._planner = geometric.RRTConnect(self._space)
        self._planner.setRange(LEG_M)
        self._planner.setProblemDefinition(self._problem)
        self._planner.setup()
        self._simplifier = geometric.PathSimplifier(self._space)
        self._ends = start_rad, goal_rad

    @property
    def over(self) -> bool:
        """Whether it is given up."""
        return self._checks >= ROUND_CHECKS

    def go_on(self, checks: int) -> Array | None:
        """The way (k, 6), if it is found with so many checks more."""
        enough = self._checks + checks
        self._planner.solve(base.PlannerTerminationCondition(lambda: self._checks >= enough))
        if not self._problem.hasExactSolution():
            return None
        path = self._problem.getSolutionPath()
        self._simplifier.reduceVertices(path, SHORTCUTS)
        self._simplifier.partialShortcutPath(path, SHORTCUTS, SHORTCUTS)
        self._simplifier.reduceVertices(path, SHORTCUTS)
        way = np.array([self._joints(state) for state in path.getStates()])
        way[0], way[-1] = self._ends
        return way

    def _joints(self, state: base.State) -> Array:
        joints: Array = self._joints_from_state @ [state[number] for number in range(self._size)] + self._fixed
        return joints

    def _is_free(self, state: base.State) -> bool:
        self._checks += 1
        joints = self._joints(state)
        return abs(joints[3]) <= self._range_rad[3] and not self._scene.touches(joints)
