"""When a controller is killed: within the work, a random time after a random part, and in a state that is drawn."""

from __future__ import annotations

import random
from typing import Literal, get_args

import numpy as np

from bracket_sim.cell import SimCell
from bracket_sim.worker.worker_sight import ARM_MOVING_RAD_S

State = Literal["stands", "moves", "holds", "places", "asks"]
STATES: tuple[State, ...] = get_args(State)
EARLIEST_S, MOST_AFTER_S = 1.0, 6.0  # after the start, and after the part before the kill
AWAITS_S, AWAITS_QUESTION_S = 25.0, 60.0  # how long the drawn state is waited for; then it is any
LOOKS_S = 0.1  # how often the parts in the bracket are counted
NEAR_HOLE_M, HELD_M = 0.13, 0.04


class Moment:
    """When the controller is killed, and in which state of the cell: of both a part is drawn, the rest is its own.

    Args:
        parts: that one run places, over all its brackets.
    """

    def __init__(self, cell: SimCell, wanted: State, parts: int, chance: random.Random) -> None:
        self._cell, self._wanted, self._parts = cell, wanted, parts
        self._after_n = 0 if wanted == "asks" else chance.randrange(parts)
        self._wait_s = chance.uniform(0.0, MOST_AFTER_S)
        self._looked_s = 0.0
        self._standing = 0
        self._due_s: float | None = None
        self.asks = False

    def come(self, time_s: float) -> bool:
        """Whether it is now."""
        if time_s >= self._looked_s:
            self._looked_s = time_s + LOOKS_S
            done = len(self._cell.devices.finished()) * len(self._cell.world.product.positions)
            self._standing = done + len(self._cell.score.placements())
        if self._due_s is None and time_s >= EARLIEST_S and self._standing >= self._after_n:
            self._due_s = time_s + self._wait_s
        if self._standing >= self._parts:
            return True
        if self._due_s is None or time_s < self._due_s:
            return False
        longest_s = AWAITS_QUESTION_S if self._wanted == "asks" else AWAITS_S
        return self.state() == self._wanted or time_s > self._due_s + longest_s

    def state(self) -> State:
        """What the cell does now, in truth."""
        if self.asks:
            return "asks"
        world = self._cell.world
        tool_m = np.array(world.tool_pose().position_m)
        if held_part(self._cell) is not None:
            bracket, places_m = world.bench.bracket.pose, world.product.bracket.holes_m.values()
            holes = [bracket.transform(np.array([*xy, 0.0])) for xy in places_m]
            near = min(float(np.linalg.norm((hole - tool_m)[:2])) for hole in holes) < NEAR_HOLE_M
            return "places" if near else "holds"
        moving = float(np.abs(np.array(self._cell.arm.state().velocities_rad_s)).max()) > ARM_MOVING_RAD_S
        return "moves" if moving else "stands"


def held_part(cell: SimCell) -> str | None:
    """Type of the part between the fingers, in truth."""
    tool_m = np.array(cell.world.tool_pose().position_m)
    for body in cell.world.bodies:
        if float(np.linalg.norm(cell.world.data.xpos[body.body] - tool_m)) < HELD_M:
            return body.part
    return None
