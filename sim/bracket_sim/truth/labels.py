"""What the hand did in a moment, as action detectors learn it; how the parts in the tray really lie, for judges.

The class of a segment is that of its last frame. An assembly of part o at position p lasts from 0.5 s before the
fingers open over the hole to 0.4 s after; carrying before that, putting back and hesitating are transit, and so is a
hand that reaches into the arm's way, until it is back. Segments whose last frame lies within 0.2 s of a change of class
are told apart: nobody could name them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.perception import ActionKind
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.scene.world import World, WorldPart
from bracket_sim.worker.event_log import ActionEvent

UPRIGHT_RAD = math.radians(5.0)
STEEP = math.cos(math.radians(60))  # vertical share of a contact's normal from which on one body carries another

Posture = Literal["upright", "lying"]
BEFORE_RELEASE_S, AFTER_RELEASE_S = 0.5, 0.4
GUARD_S = 0.2


@dataclass(frozen=True)
class Resting:
    """One part or thing of the robot's, as it rests.

    Attributes:
        name: of its body.
        part: its type, or "unknown".
        posture: upright, or on any other side.
        on: names of the bodies that carry it, beside the tray or alone.
        world_from_part: its frame.
    """

    name: str
    part: str
    posture: Posture
    on: tuple[str, ...]
    world_from_part: Pose

    @property
    def on_top(self) -> bool:
        """Whether it lies on other parts."""
        return bool(self.on)


def resting_parts(world: World) -> tuple[Resting, ...]:
    """What is in the tray, in the order of the scene."""
    carriers = _carriers(world)
    return tuple(_resting(world, part, carriers[part.body]) for part in world.bodies if part.owner == "robot")


def resting_event(resting: Resting) -> TruthEvent:
    """What the log keeps of it, at the beginning of the run."""
    fields = {
        "name": resting.name,
        "part": resting.part,
        "posture": resting.posture,
        "on": list(resting.on),
        "position_m": list(resting.world_from_part.position_m),
        "quaternion_wxyz": list(resting.world_from_part.quaternion_wxyz),
    }
    return TruthEvent(0.0, "resting", fields)


def _resting(world: World, part: WorldPart, carriers: set[str]) -> Resting:
    pose = world.part_pose(part)
    upright = math.acos(min(1.0, max(-1.0, float(pose.rotation[2, 2])))) < UPRIGHT_RAD
    return Resting(part.name, part.part, "upright" if upright else "lying", tuple(sorted(carriers)), pose)


def _carriers(world: World) -> dict[int, set[str]]:
    """Names of the parts that each part lies on, by number of its body: its contacts with them point upwards."""
    names = {part.body: part.name for part in world.bodies}
    carriers: dict[int, set[str]] = {body: set() for body in names}
    contacts = _awake(world).contact
    bodies = world.model.geom_bodyid[contacts.geom].reshape(-1, 2)
    normals = contacts.frame[:, 2]  # z of the normal, which points from the first geom to the second
    for (first, second), up in zip(bodies.tolist(), normals.tolist(), strict=True):
        if first in names and second in names and abs(up) > STEEP:
            above, below = (second, first) if up > 0 else (first, second)
            carriers[above].add(names[below])
    return carriers


def _awake(world: World) -> mujoco.MjData:
    """The state of a world with the contacts of what sleeps, too."""
    data, options = copy(world.data), world.model.opt
    kept, options.enableflags = options.enableflags, options.enableflags & ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    mujoco.mj_fwdPosition(world.model, data)
    options.enableflags = kept
    return data


@dataclass(frozen=True)
class Label:
    """A class of actions.

    Attributes:
        part, position: of an assembly only.
        released: the fingers of this assembly have opened; no part of the class.
    """

    kind: ActionKind
    part: str | None = None
    position: str | None = None
    released: bool = field(default=False, compare=False)


def labels(actions: Sequence[ActionEvent], acts: Sequence[TruthEvent], times_s: Array) -> list[Label]:
    """The class at each of n times (n,), in order."""
    starts = [event for event in actions if event.edge == "start"]
    began_s = np.array([event.time_s for event in starts])
    found = []
    for index in np.searchsorted(began_s, times_s, side="right") - 1:
        kind: ActionKind = starts[index].kind if index >= 0 else "idle"
        found.append(Label("transit" if kind == "assembly" else kind))
    for begin_s, end_s in _intrusions(acts):
        for index in np.flatnonzero((times_s >= begin_s) & (times_s <= end_s)):
            found[index] = Label("transit")
    for release in acts:
        position = release.fields.get("position")
        if release.fields.get("act") != "release" or position is None:
            continue
        inside = (times_s >= release.time_s - BEFORE_RELEASE_S) & (times_s <= release.time_s + AFTER_RELEASE_S)
        for index in np.flatnonzero(inside):
            part, released = str(release.fields["part"]), bool(times_s[index] >= release.time_s)
            found[index] = Label("assembly", part, str(position), released)
    return found


def _intrusions(acts: Sequence[TruthEvent]) -> Iterator[tuple[float, float]]:
    """When the hand reached into the arm's way, and when it was back; the last one may never be."""
    began_s: float | None = None
    for act in acts:
        if act.fields.get("act") == "intrude":
            began_s = act.time_s
        elif act.fields.get("act") == "back" and began_s is not None:
            yield began_s, act.time_s
            began_s = None
    if began_s is not None:
        yield began_s, math.inf


def guarded(found: Sequence[Label], times_s: Array) -> NDArray[np.bool_]:
    """(n,) Whether a change of class is within GUARD_S of each time, as far as the samples show."""
    changes_s = np.array([(times_s[i] + times_s[i + 1]) / 2 for i in range(len(found) - 1) if found[i] != found[i + 1]])
    if not len(changes_s):
        return np.zeros(len(found), dtype=bool)
    near: NDArray[np.bool_] = np.abs(times_s[:, None] - changes_s[None, :]).min(axis=1) <= GUARD_S
    return near
