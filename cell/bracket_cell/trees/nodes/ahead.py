"""Working ahead of the person: which part will be needed whatever they do, what stands in the tray, where it goes."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from bracket_cell.trees.nodes.people import distance_m, hole_on_bench_m
from bracket_cell.trees.nodes.planning import judge, note_verdict
from bracket_cell.trees.nodes.services import CellNode, Services
from bracket_cell.trees.nodes.skill_node import HELD
from bracket_cell.trees.vocabulary import Hole, Part
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.perception import PartsView
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

CLEAR_M = 0.35  # a hand that is farther from the way than this does not slow the arm there
LIKELY = 0.02  # a goal that is less probable does not keep the robot from fetching
TELLS_S = 3.0  # a robot that fetches nothing for so long says why
BUSY = ("transit", "assembly")  # the hand fetches a part or brings it: it takes one of those that remain


class ChooseSparePart(CellNode):
    """Wait until a part is sure to be needed whatever the person does next, and choose it.

    While the person fetches, one part of the type in their hand is theirs; as long as it is not seen what they hold,
    it may be any. A person whose hand rests goes first, but for the last part: the robot need not park before it, and
    brings it sooner. Of several types that one is chosen which has a position that the guard lets pass, then the one
    of which most remain.
    """

    state = InputPort(AssemblyState, "what is placed so far")
    plan = InputPort(AssemblyPlan, "belief and plans")
    patience_s = InputPort(float, "how long hand and arm must rest before the robot goes first", default=0.8, least=0)
    steady_s = InputPort(float, "how long a part must be seen in the hand: it passes over others", default=0.4, least=0)
    part = OutputPort(Part, "type of the part to fetch")

    _rests_since_s: float | None = None
    _held: str | None = None
    _held_since_s = _begun_s = 0.0

    def initialise(self) -> None:
        self._rests_since_s = self._held = None
        self._begun_s = self.now.observation.time_s

    def update(self) -> Status:
        status, seen = self._chosen(), self.now.observation
        waits = status is Status.RUNNING and seen.time_s - self._begun_s >= TELLS_S and not seen.arm.moving
        if waits and +remaining(self.services, self.state.get(), self.plan.get()):
            self.now.show(message=Message("waiting: {reason}", reason=self.feedback_message))
        return status

    def _chosen(self) -> Status:
        seen = self.now.observation
        if seen.bench is None:
            self.feedback_message = "no view of the bench yet"
            return Status.RUNNING
        if seen.bench.action.kind != "idle" or seen.arm.moving:  # some wait until the arm is parked
            self._rests_since_s = None
        elif self._rests_since_s is None:
            self._rests_since_s = seen.time_s
        held = None if seen.bench.hand is None else seen.bench.hand.held_part
        if held != self._held:
            self._held, self._held_since_s = held, seen.time_s
        rests_s = 0.0 if self._rests_since_s is None else seen.time_s - self._rests_since_s
        last = (+remaining(self.services, self.state.get(), self.plan.get())).total() == 1
        if seen.bench.action.kind == "idle" and self.compare(rests_s, "<", self.patience_s) and not last:
            self.feedback_message = "lets the person go first"
            return Status.RUNNING
        # who rests for so long waits, too: then a part is fetched that may be needed, and the guard acts, asks or waits
        spare = self._spare() or (self._spare(most=True) if seen.bench.action.kind == "idle" else Counter())
        if not spare:
            self.feedback_message = "the person may take what remains"
            return Status.RUNNING
        state, plan = self.state.get(), self.plan.get()
        sure = {part for part in spare if sure_position(self.services, plan, state, part)[0]}
        chosen = min(spare, key=lambda part: (part not in sure, -spare[part], part))
        self.part.set(Part(chosen))
        self.feedback_message = chosen
        return Status.SUCCESS

    def _spare(self, *, most: bool = False) -> Counter[str]:
        """How many of each type remain for the robot whatever the person does next.

        Args:
            most: those that are needed in any likely goal; else in every one.
        """
        bench = self.now.observation.bench
        assert bench is not None
        left = remaining(self.services, self.state.get(), self.plan.get(), most=most)
        steady = self.compare(self.now.observation.time_s - self._held_since_s, ">=", self.steady_s)
        if self._held is not None and steady:
            left[self._held] -= 1
        elif bench.action.kind in BUSY:
            left.subtract(list(left))
        for whole in self.tools.product.wholes:
            left[whole] = min(left[whole], self.services.built(whole))
        return +left


class HoldsNeededPart(CellNode):
    """The gripper holds a part that the bracket still needs."""

    node_type = "Condition"
    traits = Traits(gives=(HELD,))

    state = InputPort(AssemblyState, "what is placed so far")
    plan = InputPort(AssemblyPlan, "belief and plans: what no likely goal wants is not needed", optional=True)
    part = OutputPort(Part, "type of the part in the gripper")

    def update(self) -> Status:
        part = self.memory.held_part
        if not part or not self.now.observation.gripper.holding:
            self.feedback_message = "nothing is in the gripper"
            return Status.FAILURE
        if self.memory.held_lying:
            self.feedback_message = Message("{part} is held as it lay, and fits into no hole so", part=part)
            return Status.FAILURE
        if remaining(self.services, self.state.get(), self.plan.get_or(None), most=True)[part] <= 0:
            self.feedback_message = Message("no {part} is needed any more", part=part)
            return Status.FAILURE
        self.part.set(Part(part))
        self.feedback_message = part
        return Status.SUCCESS


class AwaitPosition(CellNode):
    """Wait until the guard allows some position for the part in the gripper; fails once none is left for it.

    While the hand is near the way there it waits, too, but not for ever: a hand may rest there.
    """

    plan = InputPort(AssemblyPlan, "belief and plans")
    state = InputPort(AssemblyState, "what is placed so far")
    part = InputPort(Part, "type of the part in the gripper")
    clear_m = InputPort(float, "how far the hand must be from the way to it", default=0.0, least=0)
    patience_s = InputPort(float, "how long the hand is waited for", default=5.0, least=0)
    position = OutputPort(Hole, "where it will be put")
    waited_s = OutputPort(float, "how long the person was waited for since a part was placed last", default="")

    _sure_since_s: float | None = None

    def initialise(self) -> None:
        self._sure_since_s = None

    def update(self) -> Status:
        part, state, plan = self.part.get(), self.state.get(), self.plan.get()
        if remaining(self.services, state, plan, most=True)[part] <= 0 or not self.now.observation.gripper.holding:
            self.feedback_message = Message("no {part} to be placed", part=part)
            return Status.FAILURE
        position, reason = sure_position(self.services, plan, state, part)
        if position is None:
            self._sure_since_s = None
        elif self._waits_for_hand(position):
            position, reason = None, Message("the hand is near the way to {position}", position=position)
        if position is None:
            if reason != self.feedback_message or not self.now.observation.arm.moving:
                self.feedback_message = reason
                self.now.show(message=Message("holding {part}; {reason}", part=part, reason=reason))
            return Status.RUNNING
        self.position.set(Hole(position))
        self.waited_s.set(self.services.waited_s)
        verdict = judge(self.services, plan, state, part, position)
        note_verdict(self.services, part, position, verdict.decision, verdict.reason)
        self.now.show(message=Message("bringing {part} to {position}", part=part, position=position))
        self.feedback_message = Message("{part} to {position}", part=part, position=position)
        return Status.SUCCESS

    def _waits_for_hand(self, position: str) -> bool:
        now_s = self.now.observation.time_s
        self._sure_since_s = now_s if self._sure_since_s is None else self._sure_since_s
        near = self.compare(_clear_m(self.services, position), "<", self.clear_m)
        return near and self.compare(now_s - self._sure_since_s, "<", self.patience_s)


class RecallTray(CellNode):
    """Take the parts that stand in the tray as last seen, without what was taken since; fails if that is not known.

    It is known after a look until a part is moved aside or put back, or a grasp fails.
    """

    parts = OutputPort(PartsView, "parts that stand in the tray")
    oldest_s = InputPort(float, "oldest look that is still believed", default=60.0, least=0)

    def update(self) -> Status:
        memory = self.memory
        if memory.fingers_doubted:
            self.feedback_message = "first the fingers are felt: a part may stick to one"
            return Status.FAILURE
        if memory.tray_seen_s < 0:
            self.feedback_message = "not known what stands in the tray"
            return Status.FAILURE
        if self.compare(self.now.observation.time_s - memory.tray_seen_s, ">", self.oldest_s):
            self.feedback_message = "the last look is too long ago"
            return Status.FAILURE
        standing = tuple(part for part in memory.tray_parts if part.upright)
        lying = tuple(part for part in memory.tray_parts if not part.upright)
        self.parts.set(PartsView(-1, memory.tray_seen_s, standing, lying))
        self.feedback_message = " ".join(part.part for part in memory.tray_parts) or "nothing"
        return Status.SUCCESS


def remaining(
    services: Services, state: AssemblyState, plan: AssemblyPlan | None = None, *, most: bool = False
) -> Counter[str]:
    """How many parts of each type may still be placed; what was let go in a hole counts as placed.

    Args:
        plan: only those that are needed in every likely goal.
        most: those that are needed in any of them.
    """
    product, placed = services.tools.product, {**services.memory.let_go, **state.placed}
    likely = [] if plan is None else [goal for goal in product.goals if plan.goal_belief.get(goal, 0.0) >= LIKELY]
    if likely and product.varies:
        left = [product.remaining(goal, placed) for goal in likely]
        return Counter({part: (max if most else min)(counter[part] for counter in left) for part in product.parts})
    left_n = Counter(product.most)
    left_n.subtract(placed.values())
    return left_n


def sure_position(services: Services, plan: AssemblyPlan, state: AssemblyState, part: str) -> tuple[str | None, str]:
    """Of the positions that the guard lets pass the one whose way is clearest of the hand, or why there is none.

    A position that the person is about to fill is left to them.
    """
    reason, sure = "nowhere to put it yet", []
    bench = services.now.observation.bench
    theirs = None if bench is None or bench.action.kind != "assembly" else bench.action.position
    for position in plan.guidance.get(part, ()):
        if position in services.memory.let_go:
            continue
        verdict = judge(services, plan, state, part, position)
        if verdict.decision != "act":
            reason = verdict.reason
        elif position == theirs:
            reason = Message("the person is filling {position}", position=position)
        else:
            sure.append(position)
    return max(sure, key=lambda position: _ease(services, position), default=None), reason


def _ease(services: Services, position: str) -> tuple[float, float]:
    """How clear of the hand the way to a position is [m], then how short [-m]."""
    length_m = float(np.linalg.norm(hole_on_bench_m(services, position) - np.array(services.tool_on_bench_m())))
    return min(CLEAR_M, round(_clear_m(services, position), 2)), -length_m


def _clear_m(services: Services, position: str) -> float:
    """Least distance of the hand from the way of the tool to a position; infinite where no hand is seen."""
    bench = services.now.observation.bench
    if bench is None or bench.hand is None:
        return math.inf
    way = np.array(services.tool_on_bench_m()), hole_on_bench_m(services, position)
    return min(distance_m(point, *way) for point in (bench.hand.palm_m, bench.hand.fingertips_m))
