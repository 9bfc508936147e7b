"""What kind of person stands at the bench: habits, pace, behaviour beside a robot. Read without a simulator."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from cell.interfaces.errors import InputError
from cell.interfaces.model import Model
from cell.interfaces.yaml_file import load_yaml
from sim.hand_motion import MotionSettings


def _rising(span: tuple[float, float]) -> tuple[float, float]:
    low, high = span
    if not (math.isfinite(low) and math.isfinite(high) and 0 <= low <= high):
        raise ValueError(f"[{low:g}, {high:g}] must be two finite numbers from 0 on, the smaller one first")
    return span


Span = Annotated[tuple[float, float], AfterValidator(_rising)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


class ScrewHabits(Model):
    """How the person screws.

    Attributes:
        probability: how likely it is that a part is screwed after it was placed.
        unscrewed_limit: after this many placements without screwing, the person always screws.
        duration_s: shortest and longest screwing.
        rate_hz: slowest and fastest turning.
        radius_m: least and greatest radius of the motion.
        yaw_rad: how far the hand turns, least and most.
    """

    probability: Share = 0.6
    unscrewed_limit: int = Field(default=2, ge=1)
    duration_s: Span = (4.0, 6.0)
    rate_hz: Span = (1.5, 2.0)
    radius_m: Span = (0.008, 0.008)
    yaw_rad: Span = (0.12, 0.12)


class BesideRobot(Model):
    """How the person behaves beside a robot.

    Attributes:
        waits: share of the occasions on which the person waits for the arm.
        begins_s: how long the person waits after screwing for the robot to begin.
        stands_s: how long the person watches an arm that stands still away from its parking place.
        intrusions_per_min: how often the hand goes into the way of an arm that moves.
        intrusion_m_s: top speed of such a reach, least and most.
        freezes: share of intrusions after which the hand stays there.
        pulls: share of intrusions that pull at what the robot holds; after the rest the hand withdraws at once.
        freeze_s: how long it stays, least and most.
        pull_m: how far it pulls, least and most.
    """

    waits: Share = 1.0
    begins_s: float = Field(default=2.5, ge=0, le=60)
    stands_s: float = Field(default=8.0, ge=0, le=600)
    intrusions_per_min: float = Field(default=0.0, ge=0, le=60)
    intrusion_m_s: Span = (0.8, 1.6)
    freezes: Share = 0.4
    pulls: Share = 0.2
    freeze_s: Span = (0.5, 4.0)
    pull_m: Span = (0.1, 0.25)


class Person(Model):
    """A person; of two values every one between them is as likely, and it is drawn anew each time.

    Attributes:
        order: in which order open positions are filled: at random, or p1, p2, ...
        pause_s: shortest and longest reaction before each fetch.
        retries: how often a part that does not sit well is placed again.
        motion: how the hand moves.
        screw: how the person screws.
        robot: how the person behaves beside a robot.
    """

    order: Literal["random", "positions"] = "random"
    pause_s: Span = (0.1, 0.5)
    retries: int = Field(default=2, ge=0, le=20)
    motion: MotionSettings = MotionSettings()
    screw: ScrewHabits = ScrewHabits()
    robot: BesideRobot = BesideRobot()


PERSONS = {
    "careful": Person(),
    "ordinary": Person(robot=BesideRobot(waits=0.9, intrusions_per_min=0.5, intrusion_m_s=(0.4, 1.0), pulls=0.0)),
    "careless": Person(robot=BesideRobot(waits=0.3, intrusions_per_min=6.0)),
}


def load_person(name_or_file: str) -> Person:
    """One of the shipped persons by name, or one from a YAML file.

    Raises:
        InputError: there is none of this name, or the file is wrong.
    """
    if name_or_file in PERSONS:
        return PERSONS[name_or_file]
    path = Path(name_or_file)
    if not path.exists():
        raise InputError(f"no person and no file {name_or_file!r}; legal: {', '.join(PERSONS)}, or a YAML file")
    return load_yaml(path, Person)


def drawn(span: tuple[float, float], rng: np.random.Generator) -> float:
    """A value of a span; one without width takes nothing from the generator."""
    low, high = span
    return float(rng.uniform(low, high)) if low < high else low
