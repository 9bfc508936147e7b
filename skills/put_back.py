"""PutBack: stand the held part where the tray is free, because it is not wanted after all."""

from __future__ import annotations

from collections.abc import Sequence

from cell.interfaces.observation import Observation
from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Pose
from skills.handling import (
    bracket_boxes,
    carry_over_bracket_m,
    joints_of,
    present_hold,
    put_phases,
    seen_in_holes,
    slips_m,
    tray_boxes,
)
from skills.lying import put_lying_back
from skills.move_aside import free_spots
from skills.phases import Phase, PhasedSkill
from skills.planner import MotionPlanner


class PutBack(PhasedSkill):
    """Carry the held part to a free spot of the tray, let go and rise."""

    def __init__(self, planner: MotionPlanner, part: str, tray_parts: Sequence[PartDetection]) -> None:
        """Args:
        part: type of the part that the gripper holds.
        tray_parts: parts that stand in the tray, as last seen.
        """
        super().__init__()
        self._planner, self._part, self._tray_parts = planner, part, tuple(tray_parts)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Find a spot, then a way."""
        planner = self._planner
        if planner.lying is not None:
            return put_lying_back(planner, self._part, observation, self._tray_parts)
        kind = planner.product.parts[self._part]
        tray = planner.bench.tray
        obstacles = (
            *bracket_boxes(planner, seen_in_holes(observation)),
            *tray_boxes(planner, self._tray_parts),
        )
        held = PartDetection(self._part, 1.0, Pose(tray.centre_m), kind.size_m, (0, 0, 0, 0))
        hold = present_hold(planner, self._part, observation)
        reason = f"no free spot in the tray for {self._part}"
        for target in free_spots(held, kind, self._tray_parts, tray, planner.settings):
            phases = put_phases(
                planner,
                self._part,
                hold,
                target,
                obstacles,
                joints_of(observation),
                carry_over_bracket_m(planner, kind),
                slipped_m=slips_m(kind),
            )
            if not isinstance(phases, str):
                return phases
            reason = phases
        return reason

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return f"{self._part} put back into the tray"
