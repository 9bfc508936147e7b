"""Carries out what a tick commanded, as far as the supervisor lets it; what a device refuses is observed next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal, TypeVar

from bracket_cell.running.gripper_checks import with_hand
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.skills.grasping.phases import KNOCKED_M
from bracket_cell.watching.observer import SentCommand
from bracket_ground.interfaces.command import Command, GripperCommand
from bracket_ground.interfaces.devices import Devices, Gripper, Loaded
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.observation import ObjectStatus, Observation

Answer = TypeVar("Answer")
RESTARTED = "gripper_restarted_empty"


class GripperHold:
    """Stops moving fingers while the supervisor holds, and lets them go on; skills see fingers that still move.

    Three states: `free`; `withheld`, stopped half way; `reset`, as the gripper restarted. From the last two fingers
    are sent to their goal again once nothing holds. Fingers that grip a part are left alone where a knock moves them a
    little: stopped in such a moment, they would press no more, and the part would fall out.
    """

    def __init__(self, gripper: Gripper) -> None:
        self._gripper = gripper
        self._state: Literal["free", "withheld", "reset"] = "free"
        self._goal: GripperCommand | None = None
        self._gripped_m: float | None = None  # how far apart they are with the part that they grip

    def sent(self, goal: GripperCommand) -> None:
        """The fingers were sent to a new goal."""
        self._state, self._goal, self._gripped_m = "free", goal, None

    def seen(self, observation: Observation) -> Observation:
        """The observation as skills are to see it."""
        if self._state == "free":
            return observation
        return replace(observation, gripper=replace(observation.gripper, object_status=ObjectStatus.MOVING))

    def keep(self, observation: Observation, judgement: SafetyDecision) -> None:
        """Go to the next state, and stop or send the fingers for that."""
        gripper = observation.gripper
        held = judgement.action >= Action.HOLD and not (self._goal and with_hand(self._goal, gripper, judgement))
        if gripper.holding:
            self._gripped_m = gripper.opening_m
        if self._goal is None:
            return
        moving = gripper.object_status is ObjectStatus.MOVING and not self._knocked(gripper.opening_m)
        if not gripper.activated:
            self._state = "reset"
        elif held and moving and self._state == "free":
            self._gripper.hold()
            self._state = "withheld"
        if not held and self._state != "free":
            self._gripper.command(self._goal)
            self.sent(self._goal)

    def _knocked(self, opening_m: float) -> bool:
        """Whether the fingers are still about where they gripped a part."""
        return self._gripped_m is not None and abs(opening_m - self._gripped_m) <= KNOCKED_M


class DeviceActor:
    """Commands the devices of a cell.

    Args:
        refused: called with a device's name and what it raised.
    """

    def __init__(self, devices: Devices, operator: OperatorChannel, refused: Callable[[str, Exception], None]) -> None:
        self._devices = devices
        self._gripper = devices.gripper
        self._signals = devices.signals
        self._operator = operator
        self._refused = refused
        self._fingers, self._held = GripperHold(devices.gripper), False
        self._followed = False  # a path of ours

    def seen(self, observation: Observation) -> Observation:
        """The observation as skills are to see it: fingers that were stopped half way still move."""
        return self._fingers.seen(observation)

    def act(self, command: Command, seen: Observation, judgement: SafetyDecision) -> SentCommand:
        """Command each device once; returns what they really sent."""
        trajectory = gripper = None
        if judgement.action >= Action.HOLD:
            withhold(command, seen, judgement)
        self.pace(judgement.speed_scale)
        self._load(seen)
        self._recover(seen, judgement)
        self._command("gripper", lambda: self._fingers.keep(seen, judgement))
        foreign = seen.arm.moving and not self._followed  # of a controller that died, or given up while nobody heard
        if command.stop_arm or foreign:
            self._command("arm", self._devices.arm.stop)
        elif (follow := command.follow) is not None:
            self._followed = True
            trajectory = self._command("arm", lambda: self._devices.arm.follow(follow))
        if command.activate_gripper:
            self._command("gripper", self._gripper.activate)
        if (goal := command.gripper) is not None:
            gripper = self._command("gripper", lambda: self._gripper.command(goal))
            self._fingers.sent(goal)
        if self._signals is not None:
            for name, value in command.signals.items():
                self._command("signals", partial(self._signals.write, name, value))
        if command.look:
            self._command("camera wrist", self._devices.wrist.trigger)
        if (display := command.display) is not None:
            self._operator.shown(display)
            self._command("panel", lambda: self._devices.panel.show(display))
        return SentCommand(trajectory, gripper)

    def pace(self, share: float) -> None:
        """Let the arm go on along its path with this share of its speed, 0 to 1."""
        self._command("arm", lambda: self._devices.arm.pace(share))

    def alarm(self, text: str) -> None:
        """Let the panel show a trouble; an empty text takes it away."""
        self._command("panel", lambda: self._devices.panel.alarm(text))

    def _load(self, seen: Observation) -> None:
        """An arm that must know what it carries is told when a part is gripped or let go."""
        arm, held = self._devices.arm, seen.gripper.holding
        if isinstance(arm, Loaded) and held is not self._held:
            self._held = held
            self._command("arm", lambda: arm.carry(held))

    def _recover(self, seen: Observation, judgement: SafetyDecision) -> None:
        """Somebody acknowledged: unlock an arm that stopped by itself, let one that is off its path or lost give it up.

        An arm whose safeguard closed is brought back unasked where its row has chosen that.
        What moves waits until that person lets the cell go on, too: a gripper that restarted empty is activated then.
        """
        if seen.acknowledged or judgement.brings_back:
            self._command("arm", self._devices.arm.acknowledge)
        if not seen.acknowledged:
            return
        if judgement.gives_path_up(acknowledged=seen.acknowledged):
            self._followed = False
            self._command("arm", self._devices.arm.stop)
        restarted = any(signal == RESTARTED for signal, _ in judgement.reasons) and not seen.gripper.activated
        if restarted and seen.operator.pause != "now":
            self._command("gripper", self._gripper.activate)

    def _command(self, device: str, order: Callable[[], Answer]) -> Answer | None:
        try:
            return order()
        except Exception as error:  # the next observation tells the supervisor
            self._refused(device, error)
            return None


def withhold(command: Command, seen: Observation, judgement: SafetyDecision) -> None:
    """Take out of a command what would begin to move; nodes see it and begin again.

    A path may be exchanged where only a near hand holds the arm: it stands at the beginning of the new one, until the
    supervisor has seen that this one leads away. There, fingers may also give and take what a hand holds.
    """
    if command.gripper is not None and not with_hand(command.gripper, seen.gripper, judgement):
        command.gripper = None
    command.activate_gripper, command.signals = False, {}
    if not judgement.new_path:
        command.follow = None
