"""Give a part to a hand, take one from a hand, and hold one while a hand fastens it.

Giving has four steps (Ortenzi et al., Object Handovers, IEEE T-RO 2021): the arm brings the part and stands, a hand
comes, its pull is felt, the fingers open. A pull draws towards a hand that is seen at the part; without one the fingers
keep what they hold, whatever pushes the arm, and a hand that bumps into the part pushes it away.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bracket_cell.skills.grasping.handling import (
    LetGo,
    bracket_boxes,
    carried,
    joints_of,
    present_hold,
    seen_in_holes,
    tray_boxes,
)
from bracket_cell.skills.grasping.phases import (
    DROPPED_TICKS,
    KNOCKED_M,
    Activate,
    Move,
    Phase,
    PhasedSkill,
    SetGripper,
    failed,
)
from bracket_cell.skills.grasping.phases import done as ended
from bracket_cell.skills.motion.grasp_pose import fits, hole_pose
from bracket_cell.skills.motion.motions import WayOutOrFree
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.skills.pick_and_place import Place
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, GripperCommand, HandCommand
from bracket_ground.interfaces.faults import HAND_TOO_NEAR
from bracket_ground.interfaces.grasping import PAD_WIDTH_M
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus

AT_PART_M = 0.18  # a hand of which something is seen so near to the tool may hold what is between its fingers
FELT_S = 0.2  # a pull that lasts shorter is a knock
RESTS_S = 0.12  # for so long without a hand the force of the part alone is measured
BETWEEN_M = 0.10  # and one so near may hold something between open fingers
STEADY_S, STEADY_M_S = 0.6, 0.05  # a hand that gives a part holds it still for so long
LEFT_S = 0.3  # for so long no hand is seen at the part before it counts as gone
AT_PADS_M = PAD_WIDTH_M / 2  # a tool less far ahead of a hand's fingertips has the hand between its pads, or beside it
LEAST_SPEED_M_S, LEAST_FORCE_N = 0.02, 20.0  # of the fingers beside a hand

_Ask = Literal["give", "hand", "other"]
WHY_OPEN: Mapping[SkillStatus, _Ask] = {
    SkillStatus.RUNNING: "hand",
    SkillStatus.SUCCESS: "other",
    SkillStatus.FAILURE: "give",
}  # of what became of closing fingers


def hand_away_m(planner: MotionPlanner, observation: Observation) -> float:
    """How far the nearest fingertips or palm are from the tool, seen from above; NaN where hands are not known."""
    return _hand_at(planner, observation)[0]


def _hand_at(planner: MotionPlanner, observation: Observation) -> tuple[float, Array, float]:
    """The same, the way (2,) from the tool to the palm of that hand, and how far the tool is ahead of its fingers."""
    view = observation.bench
    if view is None or view.hand_unknown:
        return math.nan, np.zeros(2), math.nan
    tool_m = planner.kinematics.forward(joints_of(observation)).position_m[:2]
    away = [(min(math.dist(hand.fingertips_m, tool_m), math.dist(hand.palm_m, tool_m)), hand) for hand in view.hands]
    if not away:
        return math.inf, np.zeros(2), math.inf
    away_m, hand = min(away, key=lambda found: found[0])
    points = np.subtract(hand.fingertips_m, hand.palm_m)
    ahead_m = float(np.subtract(tool_m, hand.fingertips_m) @ points) / max(float(np.linalg.norm(points)), 1e-9)
    return away_m, np.subtract(hand.palm_m, tool_m), ahead_m


@dataclass(eq=False)
class Pull:
    """Feels with how much force something draws at the tool, beyond what hangs there by itself.

    Attributes:
        rest_n: (3,) of the part alone; None until it was measured without a hand.
        force_n: beyond it now.
        along_n: (x, y) of that.
    """

    rest_n: tuple[float, float, float] | None = None
    force_n: float = 0.0
    along_n: Array = field(default_factory=lambda: np.zeros(2))
    _told_n: list[tuple[float, float, float]] = field(default_factory=list)
    _alone_since_s: float | None = None

    def feel(self, observation: Observation, away_m: float) -> bool:
        """One more tick; returns whether the force of the part alone is known by now."""
        force_n, now_s = observation.arm.force_n, observation.time_s
        if force_n is None or not all(map(math.isfinite, force_n)):
            self.force_n, self.along_n = 0.0, np.zeros(2)
            return self.rest_n is not None
        if self.rest_n is None:
            if not away_m > AT_PART_M:  # NaN: nobody knows
                self._told_n, self._alone_since_s = [], None
                return False
            self._alone_since_s = now_s if self._alone_since_s is None else self._alone_since_s
            self._told_n.append(force_n)
            if now_s - self._alone_since_s >= RESTS_S:
                x, y, z = np.median(np.array(self._told_n), axis=0).tolist()
                self.rest_n = x, y, z
            return False
        self.force_n, self.along_n = math.dist(force_n, self.rest_n), np.subtract(force_n, self.rest_n)[:2]
        return True

    def towards_n(self, way: Array) -> float:
        """How hard something draws along a way (2,); negative for a push against it, 0 where there is no way."""
        length = float(np.linalg.norm(way))
        return float(self.along_n @ way) / length if length else 0.0


@dataclass(eq=False)
class Offer:
    """A phase: hold a part out, and open the fingers once a hand that is seen at it pulls.

    Attributes:
        name: type of the part.
        pull_n: force that is a pull.
        limit_n: a force that is greater is no pull: the fingers keep the part, and the phase fails.
        wait_s: how long somebody may take to come and pull.
        gripped_m: where the fingers grip it.
        opening_m: of the fingers that let go.
    """

    name: str
    planner: MotionPlanner = field(repr=False)
    pull_n: float
    limit_n: float
    wait_s: float
    gripped_m: float
    opening_m: float
    _pull: Pull = field(default_factory=Pull, init=False)
    _begun_s: float | None = field(default=None, init=False)
    _pulled_since_s: float | None = field(default=None, init=False)
    _empty_ticks: int = field(default=0, init=False)
    _release: SetGripper | None = field(default=None, init=False)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Feel, and let go."""
        if self._release is not None:
            return self._release.poll(observation, command)
        now_s, away_m = observation.time_s, hand_away_m(self.planner, observation)
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        pulled, kept = self.pulled(observation), observation.gripper.holding or self.knocked(observation)
        self._empty_ticks = 0 if kept else self._empty_ticks + 1
        if self._empty_ticks >= DROPPED_TICKS:
            return failed(Message("{name} was pulled out of the closed fingers", name=self.name))
        if observation.arm.force_n is None:
            return failed(Message("cannot hand {name} over: the arm does not tell what pulls at it", name=self.name))
        if self._pull.force_n > self.limit_n:
            return failed(self._words("{name} is kept: {force} N at it is more than a pull, {limit} N"))
        if pulled:
            return self._let_go(observation, command)
        if now_s - self._begun_s > self.wait_s:
            return failed(self._words("nobody took {name} in {wait_s} s"))
        if self._pull.force_n >= self.pull_n and not away_m < AT_PART_M:
            return Progress(SkillStatus.RUNNING, Message("{name} is kept: no hand is seen at it", name=self.name))
        return Progress(SkillStatus.RUNNING, Message("please take {name}", name=self.name))

    def knocked(self, observation: Observation) -> bool:
        """Whether a hand at the part moved the fingers a little: what they say of a grip then is no drop."""
        moved_m = abs(observation.gripper.opening_m - self.gripped_m)
        return hand_away_m(self.planner, observation) < AT_PART_M and moved_m <= KNOCKED_M

    def pulled(self, observation: Observation) -> bool:
        """Whether a hand that is seen at the part has pulled at it for long enough; asked in every tick."""
        now_s, (away_m, way, _) = observation.time_s, _hand_at(self.planner, observation)
        felt = self._pull.feel(observation, away_m) and self._pull.force_n <= self.limit_n
        if not (felt and away_m < AT_PART_M and self._pull.towards_n(way) >= self.pull_n):
            self._pulled_since_s = None
        elif self._pulled_since_s is None:
            self._pulled_since_s = now_s
        return self._pulled_since_s is not None and now_s - self._pulled_since_s >= FELT_S

    def _let_go(self, observation: Observation, command: Command) -> Progress:
        doing = Message("letting go of {name}", name=self.name)
        goal = HandCommand(self.opening_m, self.planner.settings.gripper_speed_m_s, LEAST_FORCE_N)
        self._release = SetGripper(doing, goal, self.planner.settings)
        return self._release.poll(observation, command)

    def _words(self, words: str) -> str:
        force, limit, wait_s = (f"{value:.0f}" for value in (self._pull.force_n, self.limit_n, self.wait_s))
        return Message(words, name=self.name, force=force, limit=limit, wait_s=wait_s)


@dataclass(eq=False)
class Bring:
    """A phase: the way out, which ends early where a hand has stopped the arm and pulls already.

    Attributes:
        offer: the phase after it, which then lets go.
    """

    move: Move
    offer: Offer

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Go on, and feel."""
        held = observation.holding_faults == (HAND_TOO_NEAR,)
        pulled, kept = self.offer.pulled(observation), observation.gripper.holding or self.offer.knocked(observation)
        if pulled and held and kept and observation.arm.stands:
            command.follow, command.stop_arm = None, True
            return ended(self.move.doing)
        if held and kept and not observation.gripper.holding:
            return Progress(SkillStatus.RUNNING, self.move.doing)
        return self.move.poll(observation, command)


@dataclass(eq=False)
class HandLeaves:
    """A phase: wait until no hand is seen at the tool.

    Attributes:
        wait_s: after so long it goes on all the same: the arm stands as long as the hand is near.
    """

    doing: str
    planner: MotionPlanner = field(repr=False)
    wait_s: float
    _begun_s: float | None = field(default=None, init=False)
    _gone_since_s: float | None = field(default=None, init=False)

    def poll(self, observation: Observation, command: Command) -> Progress:  # noqa: ARG002
        """Look."""
        now_s = observation.time_s
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        if not hand_away_m(self.planner, observation) > AT_PART_M:
            self._gone_since_s = None
        elif self._gone_since_s is None:
            self._gone_since_s = now_s
        gone = self._gone_since_s is not None and now_s - self._gone_since_s >= LEFT_S
        if gone or now_s - self._begun_s > self.wait_s:
            return ended(self.doing)
        return Progress(SkillStatus.RUNNING, self.doing)


@dataclass(eq=False)
class _HeldOut(PhasedSkill):
    """Base: bring the tool to where a hand reaches it.

    Attributes:
        part: type of the part.
        world_from_tool: where that is.
        standing: parts that the arm keeps clear of.
    """

    planner: MotionPlanner = field(repr=False)
    part: str
    world_from_tool: Pose
    standing: Sequence[PartDetection] = ()
    wait_s: float = field(default=20.0, kw_only=True)

    def way(self, observation: Observation, held: str | None) -> Move | str:
        """The motion there, or why there is none."""
        planner = self.planner
        held, boxes = carried(planner, held, observation)
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self.standing))
        load = Load(planner.settings.gripper.within(observation.gripper.opening_m), obstacles, boxes)
        found = planner.reach([self.world_from_tool], joints_of(observation), load)
        if isinstance(found, str):
            return Message("cannot hold {part} out there: {found}", part=self.part, found=found)
        doing = Message("holding {part} out", part=self.part) if held else "holding the open fingers out"
        return Move(doing, WayOutOrFree(planner, found[1], load, observation), holding=held)


@dataclass(eq=False)
class HandOver(_HeldOut):
    """Hold the part in the gripper out, and let go of it once a hand pulls.

    Attributes:
        pull_n, limit_n: see `Offer`.
        wait_s: how long somebody may take to come and pull.
    """

    pull_n: float = field(default=8.0, kw_only=True)
    limit_n: float = field(default=60.0, kw_only=True)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """There, wait for the pull, wait for the hand to leave."""
        if not observation.gripper.holding:
            return Message("cannot hand {part} over: the gripper holds nothing", part=self.part)
        if present_hold(self.planner, self.part, observation).grip is not Grip.WIDTH:
            return Message(
                "cannot hand {part} over: the fingers are at its ends, where a hand takes it", part=self.part
            )
        way = self.way(observation, self.part)
        if isinstance(way, str):
            return way
        gripped_m = observation.gripper.opening_m
        opening_m = self.planner.settings.gripper.within(gripped_m + 2 * self.planner.open_m / 5)
        offer = Offer(self.part, self.planner, self.pull_n, self.limit_n, self.wait_s, gripped_m, opening_m)
        leaves = HandLeaves(Message("{part} is taken", part=self.part), self.planner, self.wait_s)
        return [Bring(way, offer), offer, leaves]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{part} was handed over", part=self.part)


@dataclass(eq=False)
class CloseOnGiven:
    """A phase: close the fingers gently once a hand holds something still between them, until it is the part.

    They open again, and say so, where they closed on another width, and where a hand comes between or is lost.

    Attributes:
        name: type of the part.
        wait_s: how long somebody may take to bring it.
    """

    name: str
    planner: MotionPlanner = field(repr=False)
    wait_s: float
    _begun_s: float | None = field(default=None, init=False)
    _steady_since_s: float | None = field(default=None, init=False)
    _fingers: SetGripper | None = field(default=None, init=False)
    _why: _Ask = field(default="give", init=False)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Look, close, and open again around what it is not, and from a hand that comes between."""
        now_s = observation.time_s
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        if self._fingers is None and self._steady(observation):
            self._send(0.0)
        if self._fingers is None:
            if now_s - self._begun_s > self.wait_s:
                return failed(Message("nobody gave {name} in {wait_s} s", name=self.name, wait_s=f"{self.wait_s:.0f}"))
            return self._asks("hand" if self._between(observation) else self._why)
        progress, opens = self._fingers.poll(observation, command), not self._fingers.must_hold
        if progress.status is SkillStatus.RUNNING and (opens or not self._between(observation)):
            return self._asks(self._why) if opens else progress
        if opens:
            self._fingers = self._steady_since_s = None
        elif progress.status is SkillStatus.SUCCESS and self._fits(observation):
            return progress
        else:
            self._why = WHY_OPEN[progress.status]
            self._send(self.planner.open_m)
        return self._asks(self._why)

    def _asks(self, what: _Ask) -> Progress:
        words = {
            "give": Message("please put {name} between the fingers", name=self.name),
            "hand": Message("a hand is between the fingers: please put {name} there by one end", name=self.name),
            "other": Message(
                "this is no {name}, or something is beside it: please put it between the fingers by one end",
                name=self.name,
            ),
        }
        return Progress(SkillStatus.RUNNING, words[what])

    def _send(self, opening_m: float) -> None:
        goal, closes = HandCommand(opening_m, LEAST_SPEED_M_S, LEAST_FORCE_N), not opening_m
        doing = Message("taking {name}", name=self.name) if closes else "opening the fingers"
        self._fingers = SetGripper(doing, goal, self.planner.settings, must_hold=closes)

    def _fits(self, observation: Observation) -> bool:
        return fits(self.planner.product.parts[self.name], observation.gripper.opening_m, self.planner.settings)

    def _between(self, observation: Observation) -> bool:
        """Whether a hand at the tool does not end before the pads, or nobody knows."""
        away_m, _, ahead_m = _hand_at(self.planner, observation)
        return not away_m >= BETWEEN_M and not ahead_m >= AT_PADS_M

    def _steady(self, observation: Observation) -> bool:
        """Whether a hand has held something still at the tool for a while."""
        now_s, view = observation.time_s, observation.bench
        near = hand_away_m(self.planner, observation) < BETWEEN_M and not self._between(observation)
        speeds = [hand.speed_m_s for hand in view.hands] if near and view is not None else []
        if not speeds or not all(speed is not None and speed < STEADY_M_S for speed in speeds):
            self._steady_since_s = None
        elif self._steady_since_s is None:
            self._steady_since_s = now_s
        return self._steady_since_s is not None and now_s - self._steady_since_s >= STEADY_S


@dataclass(eq=False)
class TakeFromHand(_HeldOut):
    """Hold the open fingers out, close them on the part that a hand puts between them, and wait for the hand to leave.

    Attributes:
        wait_s: how long somebody may take to bring it.
    """

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """There, close on what is given, wait for the hand to leave, and hold it as firmly as any part."""
        planner, settings = self.planner, self.planner.settings
        if observation.gripper.holding:
            return Message("cannot take {part}: the gripper holds something", part=self.part)
        way = self.way(observation, None)
        if isinstance(way, str):
            return way
        planner.hold, planner.lying = Hold(Grip.WIDTH), None
        firm = GripperCommand(0.0, settings.gripper_speed_m_s, settings.grip_force_n)
        taken = Message("{part} is given", part=self.part)
        return [
            Activate(),
            SetGripper(
                "opening the fingers", GripperCommand(settings.gripper.stroke_m, settings.gripper_speed_m_s), settings
            ),
            way,
            CloseOnGiven(self.part, planner, self.wait_s),
            HandLeaves(taken, planner, self.wait_s),
            SetGripper(Message("holding {part}", part=self.part), firm, settings, must_hold=True),
        ]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("holding {part}", part=self.part)


@dataclass(eq=False)
class HoldStill:
    """A phase: hold a part in its hole until it was fastened there, which is reported by a tool or seen.

    Attributes:
        name: type of the part.
        at_m: (x, y) of its hole.
        wait_s: after so long without a fastening the part is let go, and the phase fails.
        let_go: opens the fingers.
    """

    name: str
    planner: MotionPlanner = field(repr=False)
    at_m: tuple[float, float]
    wait_s: float
    let_go: Phase
    _begun_s: float | None = field(default=None, init=False)
    _seen: bool = field(default=False, init=False)
    _late: bool = field(default=False, init=False)
    _leaves: HandLeaves = field(init=False)

    def __post_init__(self) -> None:
        self._leaves = HandLeaves(Message("{name} is fastened", name=self.name), self.planner, self.wait_s)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Look and listen."""
        now_s = observation.time_s
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        if self._late:
            progress = self.let_go.poll(observation, command)
            return progress if progress.status is SkillStatus.RUNNING else self._vain()
        self._seen = self._seen or self._worked(observation) or self._reported(observation)
        if self._seen and not self._worked(observation):
            return self._leaves.poll(observation, command)
        self._late = now_s - self._begun_s > self.wait_s
        return Progress(SkillStatus.RUNNING, Message("holding {name}: please fasten it", name=self.name))

    def _vain(self) -> Progress:
        wait_s = f"{self.wait_s:.0f}"
        return failed(Message("nobody fastened {name} in {wait_s} s; it was let go", name=self.name, wait_s=wait_s))

    def _worked(self, observation: Observation) -> bool:
        """Whether a hand is seen to screw at the part."""
        view = observation.bench
        if view is None or view.hand is None or view.action.kind != "screw":
            return False
        return math.dist(view.hand.fingertips_m, self.at_m) <= AT_PART_M

    def _reported(self, observation: Observation) -> bool:
        said = observation.operator.said
        return any(order.kind == "fastened" and order.time_s >= (self._begun_s or 0.0) for order in said)


@dataclass(eq=False)
class HoldForPerson(PhasedSkill):
    """Put the held part into its hole and hold it there, as a third hand, until somebody has fastened it.

    Attributes:
        position: name of the hole.
        part: type of the part that the gripper holds.
        tray_parts: parts that the arm keeps clear of.
        wait_s: how long somebody may take to fasten it.
    """

    planner: MotionPlanner = field(repr=False)
    position: str
    part: str
    tray_parts: Sequence[PartDetection] = ()
    wait_s: float = field(default=60.0, kw_only=True)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """As for placing, with a wait before the fingers open."""
        place = Place(self.planner, self.position, self.part, self.tray_parts)
        phases = place.prepare(observation)
        if isinstance(phases, str):
            return phases
        x, y, _ = hole_pose(self.planner.product, self.planner.bench, self.position).position_m
        *down, let_go = phases
        assert isinstance(let_go, LetGo), "a part is let go last"
        goal = let_go.goal
        beside = replace(let_go, goal=HandCommand(goal.opening_m, goal.speed_m_s, goal.force_n))
        return [*down, HoldStill(self.part, self.planner, (x, y), self.wait_s, beside), let_go]

    @property
    def holds(self) -> bool:
        """Whether the part is in its hole, and held there."""
        return any(isinstance(phase, HoldStill) for phase in (self._phases or [])[:1])

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{part} was held at {position} until it was fastened", part=self.part, position=self.position)
