"""Pick: take a seen part out of the tray and hold it high (Alg. 1 "pick", Alg. 2 "grasp")."""

from __future__ import annotations

from collections.abc import Sequence

from cell.interfaces.observation import Observation
from cell.interfaces.perception import PartDetection
from skills.handling import carry_over_bracket_m, choose_grasp, joints_of, take_phases, why_not_empty
from skills.phases import Phase, PhasedSkill
from skills.planner import MotionPlanner


class Pick(PhasedSkill):
    """Grasp a part from straight above and lift it; done when it is held high."""

    def __init__(self, planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection] = ()) -> None:
        """Args:
        part: the part to take, as last seen.
        others: all other parts seen in the tray; the arm keeps clear of them.
        """
        super().__init__()
        self._planner, self._part, self._others = planner, part, tuple(others)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Choose a grasp."""
        if (full := why_not_empty(observation)) is not None:
            return f"cannot take {self._part.part}: {full}"
        planner = self._planner
        chosen = choose_grasp(planner, self._part, self._others, joints_of(observation))
        if isinstance(chosen, str):
            return chosen
        carry_m = carry_over_bracket_m(planner, planner.product.parts[self._part.part])
        return take_phases(planner, self._part, self._others, chosen, carry_m)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return f"holding {self._part.part}"
