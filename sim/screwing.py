"""How the person screws parts: after which, for how long, how wide, how fast, by hand or with a tool."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.diary import Diary
from sim.handwork import Handwork, ScrewMotion, Script
from sim.person import Person, drawn, happens
from sim.worker_sight import Sight

TOOL_RADIUS_M = 0.003  # a tool that sits on a screw does not leave it


class Screwing:
    """Scripts of the hand; each `yield` is a period.

    Args:
        rng: for motions.
        chance: for what not every person does.
    """

    def __init__(
        self,
        work: Handwork,
        sight: Sight,
        person: Person,
        rng: np.random.Generator,
        chance: np.random.Generator,
        diary: Diary,
    ) -> None:
        self._work, self._sight, self._diary = work, sight, diary
        self._habits, self._waits = person.screw, person.robot.waits
        self._rng, self._chance = rng, chance
        self._unscrewed = 0

    def wanted(self) -> bool:
        """Whether the person screws after the part that was just placed."""
        self._unscrewed += 1
        wants = self._unscrewed >= self._habits.unscrewed_limit
        wants = self._rng.random() < self._habits.probability or wants
        self._unscrewed = 0 if wants else self._unscrewed
        return wants

    def screw(self, position: str) -> Script:
        """Screw the part in a hole, if there is one."""
        seen = self._sight.in_hole(position)
        if seen is None:
            return
        habits = self._habits
        motion = ScrewMotion(
            duration_s=drawn(habits.duration_s, self._rng),
            rate_hz=drawn(habits.rate_hz, self._rng),
            radius_m=drawn(habits.radius_m, self._rng),
            yaw_rad=drawn(habits.yaw_rad, self._rng),
        )
        tool = happens(habits.tool, self._chance)
        if tool:
            motion = replace(motion, radius_m=min(motion.radius_m, TOOL_RADIUS_M))
            self._diary.note("tool", position=position)
        polite = happens(self._waits, self._chance)
        yield from self._work.reach_over(seen, drawn(habits.height_m, self._rng), tool=tool)
        self._diary.begin("screw")
        yield from self._work.screw(motion, stop=lambda: polite and self._sight.arm_over_bracket)
        self._diary.begin("transit")
        yield from self._work.back_off()
