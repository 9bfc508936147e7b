"""What nodes remember between ticks: written by them alone, shown on the blackboard and in the log as it changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.resume import ResumeState

PREFIX = "memory_"  # of the entries of the main tree: {@memory_held_part}
IN_VAIN_N, SAME_SPOT_M = 12, 0.015  # failed grasps that are remembered; parts so near to each other are the same
NEVER_S = -1.0

Follower = Callable[[Mapping[str, object]], None]


@dataclass
class Memory:
    """The memory of one run. A value is never changed in place but replaced, so that who follows sees each change.

    Attributes:
        held_part: type of the part that was picked last, empty before; whether it is still held, the gripper tells.
        held_lying: that part was taken as it lay, and is still held so.
        tray_parts: what stands or lies in the tray as last seen, without what was taken since.
        tray_seen_s: when that was seen; negative where it is not known, as something else was moved or a grasp failed.
        put_down: what the robot stood elsewhere in this run; no camera looks there.
        places: what stands at each spot of the places with names, None for a free one.
        in_vain: parts as they were seen when a grasp failed, the newest last.
        reasons: why the robot could not get a part, and how often, since it asked last; the last one is the newest.
        turned: by type, how often one that lay was turned since any of them was seen to stand.
        unplaced: by type and position ("o1 at p2"), how often in a row a part did not go in.
        let_go: part type by position, of what was let go in a hole and is not yet seen there.
        placed_s: when a part was placed or taken out last, as it is believed; negative before.
        fingers_doubted: a part that was let go was not seen in its hole: it may stick to a finger.
        questions: how many were asked in this run.
        brackets: how many were begun in this run.
        finished: what stood in brackets whose goal was learned, type by position in the product's order.
        left_off: what a run that was broken off knew, until this one has gone on with it; then it is empty again.
    """

    held_part: str = ""
    held_lying: bool = False
    tray_parts: tuple[PartDetection, ...] = ()
    tray_seen_s: float = NEVER_S
    put_down: tuple[PartDetection, ...] = ()
    places: Mapping[str, tuple[PartDetection | None, ...]] = field(default_factory=dict)
    in_vain: tuple[PartDetection, ...] = ()
    reasons: Mapping[str, int] = field(default_factory=dict)
    turned: Mapping[str, int] = field(default_factory=dict)
    unplaced: Mapping[str, int] = field(default_factory=dict)
    let_go: Mapping[str, str] = field(default_factory=dict)
    placed_s: float = NEVER_S
    fingers_doubted: bool = False
    questions: int = 0
    brackets: int = 0
    finished: tuple[tuple[str, ...], ...] = ()
    left_off: ResumeState = field(default_factory=ResumeState)

    def __post_init__(self) -> None:
        self.follow(lambda _: None)

    def __setattr__(self, name: str, value: Any) -> None:
        known = vars(self)
        if "_follower" in known and known[name] == value:
            return
        super().__setattr__(name, value)
        if "_follower" in known:
            known["_follower"]({name: value})

    def follow(self, follower: Follower) -> None:
        """Let somebody see all fields now, and each one that changes from now on; nobody else does any more."""
        vars(self)["_follower"] = follower
        follower(self.values())

    def values(self) -> dict[str, object]:
        """All fields by name."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    @property
    def standing(self) -> tuple[PartDetection, ...]:
        """All parts that the arm keeps clear of, beside those in holes."""
        placed = tuple(spot for spots in self.places.values() for spot in spots if spot is not None)
        return self.tray_parts + self.put_down + placed

    def failed(self, reason: str) -> None:
        """Note why a part could not be had; who asks for help tells it."""
        self.reasons = {**without(self.reasons, reason), reason: self.reasons.get(reason, 0) + 1}

    def failed_at(self, part: PartDetection) -> None:
        """Note that this part could not be grasped."""
        self.in_vain = (*self.in_vain, part)[-IN_VAIN_N:]

    def room_for_lying(self) -> None:
        """Note that there is room now where there was none: parts that lie may be tried again."""
        self.in_vain = tuple(detection for detection in self.in_vain if detection.upright)

    def tried_in_vain(self, part: PartDetection) -> int:
        """How often such a part could not be grasped where this one stands."""
        return sum(detection.part == part.part and _near(detection, part) for detection in self.in_vain)


def more(counts: Mapping[str, int], key: str) -> Mapping[str, int]:
    """Counts with one more of a kind."""
    return {**counts, key: counts.get(key, 0) + 1}


def without(counts: Mapping[str, int], *keys: str) -> Mapping[str, int]:
    """Counts without some kinds."""
    return {key: count for key, count in counts.items() if key not in keys}


def _near(one: PartDetection, other: PartDetection) -> bool:
    ours, theirs = one.world_from_part.position_m, other.world_from_part.position_m
    return math.dist(ours[:2], theirs[:2]) < SAME_SPOT_M
