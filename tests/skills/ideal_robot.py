"""An arm that follows exactly and fingers that close on what they are told, for tests of skills."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bracket_ground.interfaces.command import Command, JointTrajectory
from bracket_ground.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.perception import Action, BenchView, HoleView
from bracket_ground.interfaces.skill import Progress, Skill, SkillStatus

TICK_S = 0.040


class IdealRobot:
    """Carries commands out without error, one tick late as the controller does.

    Attributes:
        part_m: width of what stands between the fingers when they close; None for nothing.
        blocked: the arm does not move although it was told to.
        held_until_s: the supervisor lets nothing begin before.
        sent: all commands, in order.
    """

    def __init__(self, joints_rad: tuple[float, ...], part_m: float | None = None) -> None:
        self.part_m, self.blocked = part_m, False
        self.held_until_s = self._work_s = 0.0
        self.sent: list[Command] = []
        self.holes: dict[str, str] = {}
        self.tick = 0
        self._joints = tuple(joints_rad)
        self._trajectory: JointTrajectory | None = None
        self._started_s = 0.0
        self._opening_m = 0.085
        self._status = ObjectStatus.AT_POSITION

    @property
    def time_s(self) -> float:
        return self.tick * TICK_S

    def observe(self) -> Observation:
        """The state after the last command."""
        speed = 0.5 if self._moving else 0.0
        arm = ArmState(self.time_s, self._joints, (speed,) * 6, self._moving, path_s=self._path_s)
        gripper = GripperState(self.time_s, True, self._status, self._opening_m, 0.1, 0)
        share = 1.0 if self.held_until_s <= self.time_s else 0.0
        bench = self._bench(self.holes)
        return Observation(self.tick, self.time_s, arm, gripper, bench, speed_scale=share, work_s=self._work_s)

    def act(self, command: Command) -> None:
        """Carry a command out and go on by one tick."""
        self.sent.append(command)
        if command.stop_arm:
            self._trajectory = None
        elif command.follow is not None and not self.blocked:
            self._trajectory, self._started_s = command.follow, self.time_s
        if command.gripper is not None:
            self._close(command.gripper.opening_m)
        self._work_s += TICK_S if self.held_until_s <= self.time_s else 0.0
        self.tick += 1
        if self._trajectory is not None:
            self._joints = tuple(self._trajectory.at(self.time_s - self._started_s))

    def lose_path(self, held_s: float) -> None:
        """A protective stop: the arm stands, has forgotten its trajectory, and is held for a while."""
        self._trajectory, self.held_until_s = None, self.time_s + held_s

    def drop(self) -> None:
        """Lose the part."""
        self._status, self._opening_m = ObjectStatus.AT_POSITION, 0.0

    def run(self, skill: Skill, limit_s: float = 60.0) -> Progress:
        """Poll a skill until it ends."""
        for _ in range(round(limit_s / TICK_S)):
            command = Command()
            progress = skill.poll(self.observe(), command)
            self.act(command)
            if progress.status is not SkillStatus.RUNNING:
                return progress
        raise AssertionError(f"still running: {progress.reason}")

    @property
    def trajectories(self) -> list[JointTrajectory]:
        """All trajectories that were sent."""
        return [command.follow for command in self.sent if command.follow is not None]

    @property
    def _moving(self) -> bool:
        return self._trajectory is not None and self.time_s < self._started_s + self._trajectory.duration_s

    @property
    def _path_s(self) -> float | None:
        if self._trajectory is None:
            return None
        return min(self.time_s - self._started_s, self._trajectory.duration_s)

    def _close(self, goal_m: float) -> None:
        if self.part_m is not None and goal_m < self.part_m:
            self._status, self._opening_m = ObjectStatus.CONTACT_CLOSING, self.part_m
        else:
            self._status, self._opening_m = ObjectStatus.AT_POSITION, goal_m

    def _bench(self, holes: Mapping[str, str]) -> BenchView:
        views = {position: HoleView(part, 1.0, self.time_s) for position, part in holes.items()}
        return BenchView(0, self.time_s, None, views, Action("idle", 1.0))

    def at(self, joints_rad: np.ndarray) -> bool:
        """Whether the arm is there."""
        return bool(np.allclose(self._joints, joints_rad, atol=1e-6))
