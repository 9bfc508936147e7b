"""A free way to a place above something and a straight line down from there, in one motion."""

from __future__ import annotations

import math
from collections.abc import Callable

from cell.interfaces.command import Command
from cell.interfaces.observation import Observation
from cell.interfaces.pose import Array
from cell.interfaces.skill import Progress
from skills.grasping.phases import Move
from skills.motion.planner import Load, MotionPlanner, Plan


class WayDown(Move):
    """The arm does not stop above: there the way goes over into the line.

    Attributes:
        way_s: from when on, in time of its trajectory, it follows nothing but the line.
    """

    def __init__(
        self,
        doing: tuple[str, str],
        planner: MotionPlanner,
        above_rad: Array,
        load: Load,
        line: Callable[[], Plan],
        *,
        holding: str | None = None,
        most: float = 1.0,
    ) -> None:
        """Args:
        doing: on the way, and on the line.
        load: on the way.
        line: plans the line from above.
        holding: type of the part that the gripper must not lose.
        most: as in `way_and_line`.
        """
        self.way_s, self._words = math.inf, doing
        super().__init__(
            doing[0],
            lambda start: planner.way_and_line(start, above_rad, load, line, self._lasts, most),
            planner.settings,
            holding=holding,
        )

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow it, and tell which piece."""
        self._doing = self._words[self.only_line(observation)]
        return super().poll(observation, command)

    def only_line(self, observation: Observation, before_s: float = 0.0) -> bool:
        """Whether the arm follows nothing but the line by now, or will so soon."""
        return self.trajectory is not None and self.followed_s(observation) >= self.way_s - before_s

    def _lasts(self, way_s: float) -> None:
        self.way_s = way_s
