"""A free way to a place above something and a straight line down from there, in one motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bracket_cell.skills.grasping.phases import Move
from bracket_cell.skills.motion.motions import WayAndLine
from bracket_cell.skills.motion.planner import Looking, Plan
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.skill import Progress


@dataclass(eq=False)
class WayDown(Move):
    """The arm does not stop above: there the way goes over into the line.

    Attributes:
        on_line: what it does on the line, in words.
        way_s: from when on, in time of its trajectory, it follows nothing but the line.
    """

    motion: WayAndLine
    on_line: str
    way_s: float = field(default=math.inf, init=False)
    _on_way: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self._on_way = self.doing

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow it, and tell which piece."""
        self.doing = self.on_line if self.only_line(observation) else self._on_way
        return super().poll(observation, command)

    def only_line(self, observation: Observation, before_s: float = 0.0) -> bool:
        """Whether the arm follows nothing but the line by now, or will so soon."""
        return self.trajectory is not None and self.followed_s(observation) >= self.way_s - before_s

    def _planned(self, start_rad: Array) -> Plan | Looking:
        return self.motion.onto(start_rad, self._lasts)

    def _lasts(self, way_s: float) -> None:
        self.way_s = way_s
