"""A halt of the arm takes many ticks: whatever a tree does, no motion begins before the last one has stopped."""

from __future__ import annotations

import random
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.skills.grasping.phases import Move, Phase, PhasedSkill, SetGripper
from bracket_cell.skills.motion.motions import Motion
from bracket_cell.trees.nodes.skill_node import SkillNode
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Command, GripperCommand, JointTrajectory
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.skill import Skill
from btxml.files.compile.registry import Registry
from tests.trees.conftest import load_whatever_is_reached
from tests.trees.engine.test_halting import Counted, random_tree

PERIOD_S = 0.04
STOP_TICKS = 3
SETTINGS = load_configuration().motion


class SlowArm:
    """An arm that needs three ticks to stop, and fails the test when it is told to move before it stands."""

    def __init__(self) -> None:
        self.time_s = 0.0
        self.stops_at_s = 0.0
        self.ends_at_s = 0.0
        self.begun = 0
        self.stopped_short = 0

    @property
    def moving(self) -> bool:
        return self.time_s < max(self.ends_at_s, self.stops_at_s) - 1e-9

    def observe(self) -> Observation:
        speed = 0.5 if self.moving else 0.0
        arm = ArmState(self.time_s, (0.0,) * 6, (speed,) * 6, self.moving)
        gripper = GripperState(self.time_s, True, ObjectStatus.AT_POSITION, 0.05, 0.1, 0)
        return Observation(round(self.time_s / PERIOD_S), self.time_s, arm, gripper)

    def act(self, command: Command) -> None:
        if command.stop_arm:
            assert command.follow is None, "a stop and a motion in one tick"
            if self.time_s < self.ends_at_s:
                self.stops_at_s = self.time_s + STOP_TICKS * PERIOD_S
                self.stopped_short += 1
            self.ends_at_s = 0.0
        elif command.follow is not None:
            assert not self.moving, "a motion begins while the arm still moves"
            self.ends_at_s = self.time_s + command.follow.duration_s
            self.begun += 1
        self.time_s += PERIOD_S


class Swing(PhasedSkill):
    """Two motions, with the fingers in between."""

    done = "swung"

    def prepare(self, observation: Observation) -> list[Phase]:
        assert not observation.arm.moving
        grip = SetGripper("gripping", GripperCommand(0.05), SETTINGS)
        return [Move("there", STAY), grip, Move("back", STAY)]


class Stay(Motion):
    """Five ticks on the spot."""

    def plan(self, start_rad: np.ndarray) -> JointTrajectory:
        return JointTrajectory(np.array([0.0, 5 * PERIOD_S]), np.stack([start_rad, start_rad]))


BESIDE = SimpleNamespace(see=lambda _: None)
STAY = Stay(SimpleNamespace(settings=SETTINGS, beside=BESIDE))  # type: ignore[arg-type]


class Swings(SkillNode):
    """Moves the arm."""

    def make_skill(self) -> Skill:
        return Swing()


def run(seed: int, path: Path) -> SlowArm:
    """A random tree of leaves that move and others, halted now and then; the arm watches the rules."""
    draw = random.Random(seed)
    nodes = random_tree(draw)
    for _ in range(nodes.count("<Counted/>")):
        nodes = nodes.replace("<Counted/>", "<Swings/>" if draw.random() < 0.5 else "<Counted />", 1)
    path.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{nodes}</BehaviorTree></root>')
    tree = load_whatever_is_reached(path, Registry([Counted, Swings]))
    arm, clock = SlowArm(), ManualClock()
    now = SimpleNamespace(show=lambda **_: None, observation=None, command=None)
    services = SimpleNamespace(now=now, tools=SimpleNamespace(journal=ListJournal()))
    tree.setup(services, clock)
    Counted.answers, Counted.fault_rate = draw, 0.0
    Counted.begun.clear()
    Counted.ended.clear()
    for _ in range(60):
        services.now.observation, services.now.command = arm.observe(), Command()
        if draw.random() < 0.05:
            tree.halt()
        else:
            tree.tick()
        arm.act(services.now.command)
        clock.sleep_until(arm.time_s)
    return arm


def assert_rules_hold(seeds: range, path: Path) -> None:
    arms = [run(seed, path) for seed in seeds]
    assert sum(arm.begun for arm in arms) > len(seeds)
    assert sum(arm.stopped_short for arm in arms) > len(seeds) / 2


def test_no_motion_begins_before_the_last_one_has_stopped(tmp_path: Path) -> None:
    assert_rules_hold(range(500), tmp_path / "tree.xml")


@pytest.mark.slow
def test_no_motion_begins_before_the_last_one_has_stopped_in_many_trees(tmp_path: Path) -> None:
    assert_rules_hold(range(500, 10_500), tmp_path / "tree.xml")
