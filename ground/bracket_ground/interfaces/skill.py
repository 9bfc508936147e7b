"""A skill: work that goes on over many ticks; started, polled, and halted at any tick."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation


class SkillStatus(Enum):
    """Where a skill stands."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


@dataclass(frozen=True)
class Progress:
    """A skill's answer to one tick.

    Attributes:
        reason: what it does now, or why it failed, in words for an operator.
    """

    status: SkillStatus
    reason: str


class Skill(Protocol):
    """Never waits: each call reads the observation and fills the command."""

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Carry on; the first call starts the skill."""
        ...

    def halt(self, command: Command) -> None:
        """Stop within the limits; the gripper keeps what it holds."""
        ...
