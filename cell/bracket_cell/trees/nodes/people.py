"""Working beside a person: wait for what they do, keep clear of the hand, ask."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import Enum

import numpy as np

from bracket_cell.trees.nodes.clutter import seen_part
from bracket_cell.trees.nodes.planning import open_steps
from bracket_cell.trees.nodes.poses import FramedPose, world_pose
from bracket_cell.trees.nodes.services import CellNode, Services
from bracket_cell.trees.nodes.watching import SeenAction
from bracket_cell.trees.vocabulary import Hole, ShownAs
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.perception import BenchView, HandSample, PartsView
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.pose import Array
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

MAY_BE = 0.05  # a goal that is less probable does not keep a bracket from being finished
DONE_BY = {"screw": "turn a screw", "assembly": "place a part", "transit": "move your hand", "idle": "rest your hand"}
RESTS_M_S = 0.05  # chosen: above what a tracker makes of a hand that lies still
LEAVES_M_S = 0.25  # a hand that is faster is on its way; screwing hands have up to 0.2
GOES_S = 0.5  # an arm whose way was clear so long ago goes there
TELLS_S = 3.0  # the last part is in for so long before it is told why the bracket is not finished


class PersonAction(Enum):
    """Actions that can be waited for."""

    screw = "screw"
    assembly = "assembly"
    transit = "transit"
    idle = "idle"


class WaitForAction(CellNode):
    """Wait until the person begins an action of one kind; each one counts once (Alg. 1 line 13)."""

    traits = Traits(shown_as=ShownAs.AWAITS_PERSON)
    awaited = InputPort(PersonAction, "screw, assembly, transit or idle", name="kind")
    action = InputPort(SeenAction, "what the person does")
    say_s = InputPort(float, "the display says what is waited for, once, after so long", default=15.0, least=0)
    persistent = ("_served_s",)

    _served_s = -math.inf
    _began_s = 0.0
    _said = False

    def initialise(self) -> None:
        self._began_s, self._said = self.now.observation.time_s, False

    def update(self) -> Status:
        seen, awaited = self.action.get_or(None), self.awaited.get().value
        if seen is None or seen.action.kind != awaited or seen.started_s <= self._served_s:
            self.feedback_message = Message("waits for: {awaited}", awaited=awaited)
            self.what_if = f"if you {DONE_BY[awaited]}"
            self._say(awaited)
            return Status.RUNNING
        self._served_s = seen.started_s
        self.feedback_message = ""
        return Status.SUCCESS

    def _say(self, awaited: str) -> None:
        """Once, so that what is told after it stays."""
        if not self._said and self.compare(self.now.observation.time_s - self._began_s, ">=", self.say_s):
            self._said = True
            self.now.show(message=Message("waiting until you {act}", act=DONE_BY[awaited]))


class ShowHand(CellNode):
    """Wait until the overhead camera has seen a hand, which proves that it can: the beginning of a shift.

    Fails when nobody shows one in time. Once a hand was seen, it succeeds at once.
    """

    traits = Traits(shown_as=ShownAs.AWAITS_HAND)
    wait_s = InputPort(float, "how long it waits in [s]", default=600.0, least=0)
    say_s = InputPort(float, "the display asks for it after so long in [s]", default=1.0, least=0)
    persistent = ("_shown",)

    _shown = _said = False
    _began_s = 0.0

    def initialise(self) -> None:
        self._began_s, self._said = self.now.observation.time_s, False

    def update(self) -> Status:
        seen = self.now.observation
        self._shown |= seen.bench is not None and bool(seen.bench.hands)
        if self._shown:
            self.feedback_message = ""
            return Status.SUCCESS
        waited_s = seen.time_s - self._began_s
        if not self._said and self.compare(waited_s, ">=", self.say_s):
            self._said = True
            self.now.show(message="show your hand to the overhead camera")
        self.feedback_message = Message("no hand was seen for {waited_s} s", waited_s=f"{waited_s:.0f}")
        return Status.FAILURE if self.compare(waited_s, ">", self.wait_s) else Status.RUNNING


class HandWatch(CellNode):
    """Base of the nodes that wait while the hand is near the way to something, or while nothing is known of it.

    A hand that leaves is as far away as it will be when the arm arrives, one that comes is as near.
    """

    abstract = True
    traits = Traits(shown_as=ShownAs.GIVES_WAY)
    what_if = "if the hand were seen away from there"

    distance_m = InputPort(float, "how near is too near", default=0.20, least=0)
    goes_on_m = InputPort(
        float, "how near, if less, where the way was clear just now and the arm goes there", default=10.0, least=0
    )
    lookahead_s = InputPort(float, "the hand counts as where it will be after this time", default=0.0, least=0)
    way_m = InputPort(
        float, "how much of the way counts, from the tool onwards; all of it by default", default=10.0, least=0
    )
    steady_s = InputPort(
        float, "how long the way must be clear of a hand that was near, unless that leaves", default=0.0, least=0
    )
    stale_s = InputPort(float, "oldest acceptable view of the bench", default=0.5, least=0)
    persistent = ("_clear_s", "_near_s")

    _clear_s = -math.inf  # when the way was clear last
    _near_s: float | None = None  # when the hand was near it last

    def target(self) -> tuple[str, Array]:
        """What the arm goes to, in words, and where it is on the bench, (2,)."""
        raise NotImplementedError

    def update(self) -> Status:
        view = self.now.observation.bench
        if view is None or not self.compare(self.now.observation.time_s - view.time_s, "<=", self.stale_s):
            self.feedback_message = "no fresh view of the bench"
            return Status.RUNNING
        if view.hand is None:
            return Status.SUCCESS
        name, target_m = self.target()
        way = beginning(np.array(self.services.tool_on_bench_m()), target_m, self.way_m.get())
        soon = moved(view.hand, self.lookahead_s.get())
        away_m = float(np.min([distance_m(point, *way) for point in (soon.fingertips_m, soon.palm_m)]))
        given = {"lookahead_s": self.lookahead_s.get(), "way_m": self.way_m.get()}
        now_s = self.now.observation.time_s
        went = self._clear_s > max(self._near_s or 0.0, now_s - GOES_S)
        goes_on = went and self.goes_on_m.get() < self.distance_m.get()
        clear = self.compare(away_m, ">=", self.goes_on_m if goes_on else self.distance_m, name, **given)
        self._near_s = self._near_s if clear else now_s
        at_once = goes_on or self._near_s is None or (view.hand.speed_m_s or 0.0) > LEAVES_M_S
        if clear and (at_once or self.compare(now_s - (self._near_s or 0.0), ">=", self.steady_s)):
            self._clear_s = now_s
            return Status.SUCCESS
        self.feedback_message = Message("the hand is near the way to {name}", name=name)
        self.now.show(message=Message("waiting: {reason}", reason=self.feedback_message))
        return Status.RUNNING


class WaitForHandClear(HandWatch):
    """Wait while the hand is near the way to a position, or while its place is unknown."""

    position = InputPort(Hole, "position that the arm goes to")

    def target(self) -> tuple[str, Array]:
        position = self.position.get()
        return position, hole_on_bench_m(self.services, position)


class WaitForHandClearOfPart(HandWatch):
    """Wait while the hand is near the way to a part in the tray, or while its place is unknown."""

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part among the seen ones")

    def target(self) -> tuple[str, Array]:
        part = seen_part(self.parts.get(), self.index.get())
        return Message("{part} in the tray", part=part.part), np.array(part.world_from_part.position_m[:2])


class WaitForHandClearOfSpot(HandWatch):
    """Wait while the hand is near the way to a spot, or while its place is unknown."""

    spot = InputPort(FramedPose, "where the arm goes")

    def target(self) -> tuple[str, Array]:
        spot = self.spot.get()
        return str(spot), np.array(world_pose(self.services, spot).position_m[:2])


def hole_on_bench_m(services: Services, position: str) -> Array:
    """Where a hole is on the bench, (2,)."""
    hole = np.array([*services.tools.product.bracket.holes_m[position], 0.0])
    return services.tools.bench.bracket.pose.transform(hole)[:2]


def beginning(start: Array, end: Array, length_m: float) -> tuple[Array, Array]:
    """The first piece of the straight way between two points, all (2,)."""
    whole_m = float(np.linalg.norm(end - start))
    return start, end if whole_m <= length_m else start + (end - start) * (length_m / whole_m)


def moved(hand: HandSample, time_s: float) -> HandSample:
    """The hand where it will be if it goes on as it moves now."""
    if hand.velocity_m_s is None or time_s == 0.0:
        return hand
    x, y = (time_s * speed_m_s for speed_m_s in hand.velocity_m_s)
    tips, palm = hand.fingertips_m, hand.palm_m
    return replace(hand, fingertips_m=(tips[0] + x, tips[1] + y), palm_m=(palm[0] + x, palm[1] + y))


def distance_m(point: tuple[float, float], start: Array, end: Array) -> float:
    """From a point to the straight way between two points, all (2,) on the bench."""
    way = end - start
    length_squared = float(way @ way)
    share = float(np.clip((np.array(point) - start) @ way / length_squared, 0.0, 1.0)) if length_squared > 0 else 0.0
    return float(np.linalg.norm(np.array(point) - (start + share * way)))


class AssemblyFinished(CellNode):
    """Every position is filled and seen to be filled, and the hand has left (condition of Alg. 1's while).

    Where a product that is not listed is likely enough by people's own parts, there is time to take out what the robot
    placed last. A hand that is said to be at work has left, too, once it was away from every hole, or lay still beside
    them, for a while: an action detector may err as long as the hand rests. A hole that nobody could make visible
    counts as the graph has it. Where only this is waited for, the person is told what.
    """

    traits = Traits(shown_as=ShownAs.FINISHED)
    state = InputPort(AssemblyState, "what is placed so far")
    action = InputPort(SeenAction, "what the person does")
    away_m = InputPort(
        float, "how far from every hole a hand has left that is said to be at work", default=0.2, least=0
    )
    beside_m = InputPort(float, "how far from every hole a hand has left that lies still", default=0.1, least=0)
    away_s = InputPort(float, "how long it must be so far away", default=8.0, least=0)
    looks_s = InputPort(
        float,
        "time to take out what the robot placed last, where a wrong end is expected to cost more",
        default=0.0,
        least=0,
    )
    persistent = ("_full_since_s", "_away_since_s", "_stands_since_s")

    _stands_since_s: float | None = None
    _full_since_s: float | None = None
    _away_since_s: float | None = None

    def update(self) -> Status:
        services, reason = self.services, self._why_not()
        self.feedback_message = reason
        if not reason:
            services.now.show(message="the bracket is assembled", help_request=None)
            return Status.SUCCESS
        seen = services.now.observation
        due = self._full_since_s is not None and seen.time_s - self._full_since_s >= TELLS_S
        if due and not seen.arm.moving:
            services.now.show(message=Message("waiting: {reason}", reason=reason))
        return Status.FAILURE

    def _why_not(self) -> str:
        """What is still waited for; empty where it is finished."""
        services, state = self.services, self.state.get()
        view, placed = services.now.observation.bench, state.placed
        if still := open_steps(services, state):
            self._full_since_s = self._away_since_s = self._stands_since_s = None
            if unfastened := [step for step in still if step in services.tools.product.fastenings]:
                return Message("not yet fastened: {steps}", steps=", ".join(unfastened))
            return Message("{count} positions are open", count=len(still))
        if (other := self._may_need_more(state)) and not self._left(view):
            return Message("it may be {goal}, which takes more parts", goal=other)
        now_s = services.now.observation.time_s
        self._full_since_s = now_s if self._full_since_s is None else self._full_since_s
        left = self.action.get().action.kind == "idle" or self._left(view)
        asked = {position for position, part in state.kept.items() if part is None}
        seen = {} if view is None else {position: hole.part for position, hole in view.holes.items()}
        known = asked if self.tools.guard.wants_holes else asked | (placed.keys() - seen)
        if unseen := [position for position in placed if seen.get(position) is None and position not in known]:
            return Message("not yet seen filled: {unseen}", unseen=" ".join(unseen))
        if not left:
            return "the hand still moves"
        return "somebody may take out what was placed last" if self._may_object(state) else ""

    def _may_object(self, state: AssemblyState) -> bool:
        """Whether who knows a product that is not listed has not yet had time to take out the robot's last part."""
        seen, tools = self.services.now.observation, self.tools
        if seen.arm.moving or self._stands_since_s is None:
            self._stands_since_s = seen.time_s
        looked = self.compare(seen.time_s - self._stands_since_s, ">=", self.looks_s)
        if looked or state.told_goal is not None or list(state.placed)[-1] not in state.by_robot:
            return False
        return tools.guard.unlisted_s(tools.infer(state.by_people, seen.operator.job)) >= self.looks_s.get()

    def _may_need_more(self, state: AssemblyState) -> str:
        """Title of another likely goal that is not whole yet; empty where there is none."""
        services, product = self.services, self.services.tools.product
        if not product.varies or state.told_goal is not None:
            return ""
        belief = services.tools.infer(state, services.now.observation.operator.job).goal_belief
        likely = (goal for goal in product.goals if belief.get(goal, 0.0) >= MAY_BE)
        more = (goal for goal in likely if not product.accepted(goal).keys() <= state.placed.keys())
        return next((product.goal_title(goal) for goal in more), "")

    def _left(self, view: BenchView | None) -> bool:
        """Whether the hand has been away from every hole for long enough."""
        now_s = self.now.observation.time_s
        if not self._away(view):
            self._away_since_s = None
            return False
        self._away_since_s = now_s if self._away_since_s is None else self._away_since_s
        return self.compare(now_s - self._away_since_s, ">=", self.away_s)

    def _away(self, view: BenchView | None) -> bool:
        if view is None or view.hand_unknown:
            return False
        if view.hand is None:
            return True
        holes = [hole_on_bench_m(self.services, position) for position in self.tools.product.positions]
        points = (view.hand.palm_m, view.hand.fingertips_m)
        rests = view.hand.velocity_m_s is not None and math.hypot(*view.hand.velocity_m_s) <= RESTS_M_S
        nearest_m = float(np.min([math.dist(at, hole) for at in points for hole in holes]))
        return self.compare(nearest_m, ">=", self.beside_m if rests else self.away_m)
