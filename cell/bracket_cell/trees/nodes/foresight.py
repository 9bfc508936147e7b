"""Beginning a way before it is sure: where the part in the gripper will go, if the hand goes where it seems to go."""

from __future__ import annotations

import math

import numpy as np

from bracket_cell.learned.classical.foresight import foreseen
from bracket_cell.trees.nodes.people import hole_on_bench_m
from bracket_cell.trees.nodes.planning import judge, note_verdict
from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import SkillNode
from bracket_cell.trees.vocabulary import Hole, Part
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.perception import BenchView, HandSample
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Skill
from btxml.engine.causes import collecting
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

OVER_M = 0.20  # the tool over the bracket's upper side, beside it
FARTHEST_M = 0.45  # of the fingertips from a hole: a hand that is farther away goes anywhere


class PositionForeseen(CellNode):
    """From the way of a hand that carries a part: where the part in the gripper may be put once that is placed.

    The hole that the hand goes to counts as filled from a probability on; then the guard is asked. It only says where
    to wait: a part is let go by what is seen alone. What was foreseen stays so for a while.
    """

    node_type = "Condition"

    plan = InputPort(AssemblyPlan, "belief and plans")
    state = InputPort(AssemblyState, "what is placed so far")
    part = InputPort(Part, "type of the part in the gripper")
    sure = InputPort(float, "probability of a hole from which on the hand goes there", default=0.9)
    stays_s = InputPort(float, "how long it counts as foreseen", default=3.0, least=0)
    position = OutputPort(Hole, "where the part in the gripper will go")
    persistent = ("_foreseen", "_sequence", "_counts")

    _foreseen: tuple[str, str, float] | None = None  # position, for which part, since when
    _sequence = -1
    _counts = False  # whether what the hand holds counts as placed, until it is seen without it

    def update(self) -> Status:
        seen, part = self.now.observation, self.part.get()
        if seen.bench is not None and seen.bench.sequence != self._sequence:
            self._sequence = seen.bench.sequence
            if (position := self._looks(seen.bench)) is not None:
                self._foreseen = position, part, seen.time_s
        if self._foreseen is None:
            return Status.FAILURE
        position, of_part, since_s = self._foreseen
        if (
            of_part != part
            or self.compare(seen.time_s - since_s, ">", self.stays_s)
            or position in self.state.get().placed
        ):
            self._foreseen = None
            return Status.FAILURE
        self.position.set(Hole(position))
        self.feedback_message = Message("{part} will go to {position}", part=part, position=position)
        return Status.SUCCESS

    def _looks(self, view: BenchView) -> str | None:
        """Where the part in the gripper goes if the hand fills the hole that it seems to go to; None where unsure."""
        if view.hand is None or view.hand.held_part is None:
            self._counts = False
            return None
        self._counts = self._counts or view.action.position in self.state.get().placed
        if self._counts or view.hand.velocity_m_s is None:
            return None
        theirs = self._hand_goes_to(view, view.hand, view.hand.held_part, view.hand.velocity_m_s)
        if theirs is None:
            return None
        state = self.state.get().with_placement(view.hand.held_part, theirs)
        plan, part = self.tools.infer(state, self.now.observation.operator.job), self.part.get()
        for position in plan.guidance.get(part, ()):
            open_yet = position != theirs and position not in self.memory.let_go
            with collecting(None):  # of a bracket that is only supposed, in which the wait for the person begins anew
                acts = open_yet and judge(self.services, plan, state, part, position, 0.0).decision == "act"
            if acts:
                note = f"{view.hand.held_part} at {theirs}"
                note_verdict(self.services, part, position, "foreseen", note)
                return position
        return None

    def _hand_goes_to(
        self, view: BenchView, hand: HandSample, part: str, velocity_m_s: tuple[float, float]
    ) -> str | None:
        state, plan = self.state.get(), self.plan.get()
        holes_m = {
            name: (float(xy[0]), float(xy[1]))
            for name in self.tools.product.positions
            for xy in (hole_on_bench_m(self.services, name),)
            if name not in state.placed and (name not in view.holes or view.holes[name].part is None)
        }
        near = any(math.dist(hand.fingertips_m, xy) < FARTHEST_M for xy in holes_m.values())
        belongs = {name: plan.next_belief.get((part, name), 0.0) for name in holes_m}
        shares = foreseen(hand.fingertips_m, velocity_m_s, holes_m, belongs) if near else {}
        best = max(shares, key=lambda name: shares[name], default=None)
        return best if best is not None and self.compare(shares[best], ">=", self.sure) else None


class MoveBeside(SkillNode):
    """Move what the gripper holds beside a hole, as far back from the person that a hand has room over the bracket.

    An arm that is as near to the hole already stays.
    """

    traits = Traits(claims=("arm",))

    position = InputPort(Hole, "the hole")
    back_m = InputPort(float, "how far back from it", default=0.22, least=0)

    def initialise(self) -> None:
        hole_m = hole_on_bench_m(self.services, self.position.get())
        if self.compare(math.dist(self.services.tool_on_bench_m(), hole_m), ">", self.back_m):
            super().initialise()

    def update(self) -> Status:
        return Status.SUCCESS if self._skill is None else super().update()

    def make_skill(self) -> Skill:
        from bracket_cell.skills import move_to

        services, position = self.services, self.position.get()
        hole_m = hole_on_bench_m(services, position)
        motion = services.tools.motion
        here = motion.kinematics.forward(np.array(self.now.observation.arm.positions_rad))
        place = (
            float(hole_m[0]) - self.back_m.get(),
            float(hole_m[1]),
            self.tools.bench.bracket.position_m[2] + OVER_M,
        )
        words = Message("beside {position}", position=position)
        pose = Pose(place, here.quaternion_wxyz)
        return move_to.MoveToPose(motion, words, *self.surroundings, world_from_tool=pose)
