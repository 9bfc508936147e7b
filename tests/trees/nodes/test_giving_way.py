"""A person who waits until the arm has left, and an arm that waits until the hand has left: one of them gives way.

The arm follows its path exactly, at the share of speed that the real supervisor allows; nothing is rendered.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_faults
from bracket_cell.running.device_writer import withhold
from bracket_cell.running.supervisor import make_supervisor
from bracket_cell.skills.motion.near_hand import separation_of
from bracket_cell.skills.motion.planner import at_height
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Command, JointTrajectory
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.perception import Action, BenchView, Edge, HandSample
from btxml.engine.status import Status
from tests.integration.cell_rig import BENCH, motion_planner
from tests.trees.nodes.rig import services

TICK_S = 0.04
TABLE = load_faults(load_configuration())
PLANNER = motion_planner()
S = PLANNER.separation.settings
PARK = np.array(BENCH.arm_park_rad)
_lowering = PLANNER.kinematics.forward(np.array([0.131, -1.315, 1.9, -2.155, -1.571, 0.131]))
_over = PLANNER.kinematics.inverse(at_height(_lowering, 0.25), PARK)
assert _over is not None
OVER_P2_RAD = _over
TOOL_M = PLANNER.kinematics.forward(OVER_P2_RAD).position_m
GRIPPER = GripperState(0.0, True, ObjectStatus.AT_POSITION, 0.085, 0.0, 0)
WORK = """<root BTCPP_format="4" main_tree_to_execute="Work">
  <BehaviorTree ID="Work">
    <ReactiveSequence>
      {before}
      <MoveToPose pose="{goal}"/>
    </ReactiveSequence>
  </BehaviorTree>
</root>"""
GOAL = f"world: {TOOL_M[0] + 0.1:.3f} {TOOL_M[1]:.3f} {TOOL_M[2]:.3f}"
PERSONS_EDGE: Edge = "bottom"  # by which a hand leaves the overhead image
Hand = Callable[["World"], HandSample | None]


@dataclass
class World:
    """An arm over the bracket that is to go on towards the person, and a hand.

    Attributes:
        hand: where it is by now; None where no hand is in view.
        rooms: least distance of arm and hand and the speed of its fastest point in every tick.
    """

    hand: Hand
    time_s: float = 0.0
    joints: np.ndarray = field(default_factory=OVER_P2_RAD.copy)
    speeds: np.ndarray = field(default_factory=lambda: np.zeros(6))
    path: JointTrajectory | None = None
    path_s: float = 0.0
    rooms: list[tuple[float, float]] = field(default_factory=list)
    unknown: str = ""
    tick: int = 0
    worked_s: float = 0.0

    @property
    def away_m(self) -> float:
        """How far the tool is from where it began."""
        return float(np.linalg.norm(np.subtract(PLANNER.kinematics.forward(self.joints).position_m, TOOL_M)))

    def observe(self) -> Observation:
        moving = self.path is not None and self.path_s < self.path.duration_s
        path_s = None if self.path is None else self.path_s
        arm = ArmState(self.time_s, tuple(self.joints), tuple(self.speeds), moving, path_s=path_s)
        hand = self.hand(self)
        hand = hand and replace(hand, time_s=self.time_s)
        left_by: tuple[Edge, ...] = () if hand or self.unknown else (PERSONS_EDGE,)
        view = BenchView(
            self.tick, self.time_s, hand, {}, Action("idle", 1.0), hand_unknown=self.unknown, left_by=left_by
        )
        gripper = replace(GRIPPER, time_s=self.time_s)
        return Observation(self.tick, self.time_s, arm, gripper, view, work_s=self.worked_s)

    def act(self, command: Command, share: float) -> None:
        before = self.joints
        if command.stop_arm:
            self.path = None
        elif command.follow is not None:
            self.path, self.path_s = command.follow, 0.0
        if self.path is not None:
            self.path_s = min(self.path_s + share * TICK_S, self.path.duration_s)
            self.joints = self.path.at(self.path_s)
            near_s = self.path_s + np.array([-1e-3, 1e-3])
            self.speeds = share * np.diff(self.path.along(near_s), axis=0)[0] / 2e-3
        else:
            self.speeds = np.zeros(6)
        placed = PLANNER.separation.outline.placed(np.array([before, self.joints]))
        gone = np.diff(PLANNER.separation.outline.corners_m(placed), axis=0)
        found = separation_of(PLANNER.separation, self.observe(), None)
        room_m = np.inf if found is None else found.distance_m
        self.rooms.append((room_m, float(np.linalg.norm(gone, axis=3).max()) / TICK_S))
        self.worked_s += share * TICK_S
        self.time_s, self.tick = self.time_s + TICK_S, self.tick + 1


def run(world: World, before: str, tmp_path: Path, limit_s: float) -> Status:
    """Tick a tree under the supervisor until it ends or time is over."""
    file = tmp_path / "work.xml"
    file.write_text(WORK.replace("{before}", before).replace("{goal}", GOAL))
    tree = load_tree(file, node_registry())
    at = services(motion=PLANNER)
    tree.setup(at, ManualClock())
    supervisor, status = make_supervisor(TABLE, PLANNER), Status.RUNNING
    while status is Status.RUNNING and world.time_s < limit_s:
        seen = world.observe()
        judgement = supervisor.judge(seen)
        at.now.observation = seen = replace(
            seen, speed_scale=judgement.speed_scale, holding_faults=judgement.holding_faults
        )
        at.now.command = Command()
        status = tree.tick()
        judgement = supervisor.judge_command(seen, at.now.command)
        if judgement.speed_scale == 0:
            withhold(at.now.command, seen, judgement)
        world.act(at.now.command, judgement.speed_scale)
    return status


def resting(room_m: float) -> HandSample:
    """A hand that rests so far towards the person from where the arm begins."""

    def at(x_m: float) -> HandSample:
        palm = (x_m + 0.1, TOOL_M[1])
        return HandSample(0.0, (99, 99, 200, 200), (x_m, TOOL_M[1]), palm, velocity_m_s=(0.0, 0.0), height_m=0.15)

    near, far = TOOL_M[0], 1.3
    for _ in range(30):
        middle = (near + far) / 2
        room = PLANNER.separation.outline.distances(OVER_P2_RAD, PLANNER.separation.persons.wall(at(middle)), False)[
            0
        ].min()
        near, far = (near, middle) if room > room_m else (middle, far)
    return at(far)


def waits_until_the_arm_has_left(room_m: float) -> Hand:
    """The hand rests until the arm is at its parking place; then it goes away for good."""
    rests, gone = resting(room_m), []

    def hand(world: World) -> HandSample | None:
        if np.abs(world.joints - PARK).max() < 0.05:
            gone.append(True)
        return None if gone else rests

    return hand


def test_without_it_person_and_arm_wait_for_each_other_for_ever(tmp_path: Path) -> None:
    world = World(waits_until_the_arm_has_left(0.045))
    assert run(world, "<AlwaysSuccess/>", tmp_path, 10.0) is Status.RUNNING
    assert world.away_m < 0.001


@pytest.mark.long
def test_the_arm_goes_out_of_the_way_of_a_hand_that_waits_and_goes_on_when_it_has_left(tmp_path: Path) -> None:
    world = World(waits_until_the_arm_has_left(0.045))
    assert run(world, "<GiveWay/>", tmp_path, 60.0) is Status.SUCCESS
    assert world.away_m == pytest.approx(0.1, abs=0.005)
    began_m = world.rooms[0][0]
    for room_m, speed_m_s in world.rooms:
        assert room_m > began_m - 0.002
        if room_m < 0.06:  # the protective distance of a slow arm from a hand at rest
            assert speed_m_s <= S.leaving_m_s + 0.03


def test_it_gives_way_after_a_while_only(tmp_path: Path) -> None:
    world = World(waits_until_the_arm_has_left(0.045))
    assert run(world, '<GiveWay after_s="4"/>', tmp_path, 3.9) is Status.RUNNING
    assert world.away_m < 0.001


@pytest.mark.parametrize(("held", "gone"), [("o1", True), (None, False)])
def test_a_hand_that_brings_a_part_is_given_way_to_sooner(held: str | None, gone: bool, tmp_path: Path) -> None:
    rests = replace(resting(0.2), held_part=held)
    world = World(lambda _: rests)
    wait = '<GiveWay/><WaitForHandClearOfSpot spot="{goal}" distance_m="0.5"/>'
    assert run(world, wait, tmp_path, 5.0) is Status.RUNNING
    assert (world.away_m > 0.1) is gone


def test_a_hand_that_is_not_near_is_not_given_way_to(tmp_path: Path) -> None:
    world = World(lambda _: resting(0.5))
    assert run(world, "<GiveWay/>", tmp_path, 60.0) is Status.SUCCESS
    assert world.time_s < 8.0


def test_an_arm_that_waits_before_a_resting_hand_gives_way_too(tmp_path: Path) -> None:
    """Nothing holds it: a condition of the tree lets it wait, and the person waits until it has left."""
    world = World(waits_until_the_arm_has_left(0.2))
    wait = '<GiveWay/><WaitForHandClearOfSpot spot="{goal}" distance_m="0.5"/>'
    assert run(world, wait, tmp_path, 30.0) is Status.SUCCESS
    assert world.away_m == pytest.approx(0.1, abs=0.005)
    assert world.time_s > 8.0


def test_an_arm_that_waits_before_a_hand_at_work_stays(tmp_path: Path) -> None:
    rests = resting(0.2)

    def works(world: World) -> HandSample:
        x, y = rests.palm_m
        return replace(rests, palm_m=(x, y + 0.05 * float(np.sin(world.time_s))))

    world = World(works)
    wait = '<GiveWay/><WaitForHandClearOfSpot spot="{goal}" distance_m="0.5"/>'
    assert run(world, wait, tmp_path, 12.0) is Status.RUNNING
    assert world.away_m < 0.001


@pytest.mark.long
def test_a_hand_that_stays_for_ever_keeps_the_arm_away(tmp_path: Path) -> None:
    """It comes again after a while to see, and never nearer than it was."""
    rests = resting(0.045)
    world = World(lambda _: rests)
    assert run(world, '<GiveWay after_s="2" wait_s="3"/>', tmp_path, 18.0) is Status.RUNNING
    assert min(room for room, _ in world.rooms) > world.rooms[0][0] - 0.002


@pytest.mark.long
@pytest.mark.parametrize("what", ["touches", "speed not known", "blind"])
def test_where_too_little_is_known_nothing_moves(what: str, tmp_path: Path) -> None:
    rests = resting(0.01 if what == "touches" else 0.045)
    if what == "speed not known":
        rests = replace(rests, velocity_m_s=None)
    world = World(lambda _: rests, unknown="it vanished" if what == "blind" else "")
    assert run(world, '<GiveWay after_s="2"/>', tmp_path, 4.0) is Status.RUNNING
    assert world.away_m < 0.001
