"""Open and close the fingers by themselves, without a motion of the arm."""

from __future__ import annotations

from collections.abc import Sequence

from cell.interfaces.command import GripperCommand
from cell.interfaces.observation import Observation
from skills.phases import Activate, Phase, PhasedSkill, SetGripper
from skills.settings import MotionSettings


class MoveFingers(PhasedSkill):
    """Bring the fingers to an opening, or close them on something."""

    def __init__(self, settings: MotionSettings, goal: GripperCommand, doing: str, *, must_hold: bool = False) -> None:
        super().__init__()
        self._settings, self._goal, self._doing, self._must_hold = settings, goal, doing, must_hold

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:  # noqa: ARG002
        """Activate the gripper if it is not, then one motion."""
        return [Activate(), SetGripper(self._doing, self._goal, self._settings, must_hold=self._must_hold)]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return f"{self._doing}: done"
