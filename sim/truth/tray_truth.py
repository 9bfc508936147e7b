"""How the parts in the tray really lie: upright, lying, on top of others, or of no type; for labels and judges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from cell.interfaces.devices import TruthEvent
from cell.interfaces.pose import Pose
from sim.scene.world import World, WorldPart

UPRIGHT_RAD = math.radians(5.0)
STEEP = math.cos(math.radians(60))  # vertical share of a contact's normal from which on one body carries another

Posture = Literal["upright", "lying"]


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


def resting_event(one: Resting) -> TruthEvent:
    """What the log keeps of it, at the beginning of the run."""
    fields = {
        "name": one.name,
        "part": one.part,
        "posture": one.posture,
        "on": list(one.on),
        "position_m": list(one.world_from_part.position_m),
        "quaternion_wxyz": list(one.world_from_part.quaternion_wxyz),
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
    bodies = world.model.geom_bodyid[world.data.contact.geom].reshape(-1, 2)
    normals = world.data.contact.frame[:, 2]  # z of the normal, which points from the first geom to the second
    for (first, second), up in zip(bodies.tolist(), normals.tolist(), strict=True):
        if first in names and second in names and abs(up) > STEEP:
            above, below = (second, first) if up > 0 else (first, second)
            carriers[above].add(names[below])
    return carriers
