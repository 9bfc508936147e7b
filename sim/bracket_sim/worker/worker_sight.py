"""What the person at the bench sees: parts, holes and whether the robot is in the way. Truth, for the worker alone."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

NEAR_HOLE_M = 0.03  # a part whose origin is this close to a hole's axis belongs to that hole
NEAR_HOLE_HEIGHT_M = 0.06
SEATED_HEIGHT_M = 0.003
SEATED_SLACK_M = 0.002
SEATED_TILT_RAD = math.radians(5)
GRASPABLE_TILT_RAD = math.radians(35)
OWN_BIN_M = 0.16  # parts this close to a bin's middle lie in it
BEFORE_BRACKET_M, BESIDE_BRACKET_M, LYING_M = (0.07, 0.25), 0.35, 0.06  # where parts on the table are noticed
ARM_NEAR_BRACKET_M = 0.13
HELD_OUT_M, HELD_M = 0.15, 0.05  # a tool this far beyond the bracket holds out what is this close to it
OPEN_M, GRIPPED_M = 0.06, 0.004  # fingers so wide are open, and closed where hardly wider than the part
STILL_M_S = 0.003
ARM_MOVING_RAD_S = 0.02
ARM_PARKED_RAD = 0.05
ARM_LEAVES_M_S = 0.05


class WorkerWorld(Protocol):
    """What the worker needs of the simulated world."""

    @property
    def model(self) -> mujoco.MjModel: ...

    @property
    def data(self) -> mujoco.MjData: ...

    @property
    def parts(self) -> Mapping[str, str]:
        """Part type by body name; a body's frame is the part frame."""
        ...


@dataclass(frozen=True)
class SeenPart:
    """One part as it stands now.

    Attributes:
        body: name of its body in the world.
        tilt_rad: angle between its axis and the vertical.
    """

    body: str
    part: str
    pose: Pose
    tilt_rad: float


class Sight:
    """Reads the world as a person's eyes do; everything is looked up anew at each call."""

    def __init__(self, world: WorkerWorld, product: Product, bench: Bench) -> None:
        self.bracket_m = bench.bracket.position_m
        self._model, self._data = world.model, world.data
        self._product, self.kinds = product, product.parts
        self._bench = bench
        model = world.model
        self._ids = {name: int(model.body(name).id) for name in world.parts}
        self._parts = world.parts
        bracket = bench.bracket.pose
        self.holes_m = {
            position: bracket.transform(np.array(product.slot_m(position))) for position in product.positions
        }
        bodies = {model.body(index).name: index for index in range(model.nbody)}
        self._fingers = [name for name in ("finger_left", "finger_right") if name in bodies]
        self._flange, self._tool = bodies.get("tool0"), bodies.get("tool")
        joints = [model.joint(number) for number in _moving(model, self._flange or 0)]
        self._arm_qpos = [int(joint.qposadr[0]) for joint in joints]
        self._arm_dofs = [int(joint.dofadr[0]) for joint in joints]
        self._links = [] if self._tool is None else _upwards(model, self._tool)

    def part(self, body: str) -> SeenPart:
        """One part by the name of its body."""
        index, part = self._ids[body], self._parts.get(body, "")
        pose = Pose(_triple(self._data.xpos[index]), _quadruple(self._data.xquat[index]))
        cosine = float(self._data.xmat[index][8])
        return SeenPart(body, part, pose, math.acos(min(max(cosine, -1.0), 1.0)))

    def in_hole(self, position: str) -> SeenPart | None:
        """The part in or on a hole."""
        hole = self.holes_m[position]
        for body in self._parts:
            seen = self.part(body)
            offset = np.array(seen.pose.position_m) - hole
            near = math.hypot(offset[0], offset[1]) < NEAR_HOLE_M and abs(offset[2]) < NEAR_HOLE_HEIGHT_M
            if near and self._is_nearest(position, np.array(seen.pose.position_m)):
                return seen
        return None

    def _is_nearest(self, position: str, at_m: Array) -> bool:
        """Whether no other slot of the same stack is nearer to a place."""
        away_m = float(np.linalg.norm(at_m - self.holes_m[position]))
        return all(float(np.linalg.norm(at_m - other)) >= away_m for other in self.holes_m.values())

    @property
    def tops_m(self) -> Array:
        """Where the parts in the bracket end above (n, 3)."""
        standing = [seen for name in self.holes_m if (seen := self.in_hole(name)) is not None]
        heights = [self._product.parts[seen_part.part].size_m[2] for seen_part in standing]
        tops: Array = np.array([seen_part.pose.position_m for seen_part in standing]).reshape(-1, 3)
        tops[:, 2] += heights
        return tops

    def seated(self, seen: SeenPart, position: str) -> bool:
        """Whether a part stands in a hole as it should."""
        offset = np.array(seen.pose.position_m) - self.holes_m[position]
        slack_m = self._product.bracket.hole_clearance_m + SEATED_SLACK_M
        return (
            math.hypot(offset[0], offset[1]) < slack_m
            and abs(offset[2]) < SEATED_HEIGHT_M
            and seen.tilt_rad < SEATED_TILT_RAD
        )

    def spares(self, part: str) -> list[SeenPart]:
        """Parts of a type on the person's side, the rightmost first: there a right hand has most room."""
        built = part in self._product.wholes
        own = [
            seen_part
            for seen_part in self._of_type(part)
            if built or self._on_own_side(np.array(seen_part.pose.position_m))
        ]
        return sorted(own, key=lambda seen_part: -seen_part.pose.position_m[1])

    def in_tray(self, part: str) -> list[SeenPart]:
        """Parts of a type in the robot's tray, the nearest to the person first."""
        middle, half = np.array(self._bench.tray.centre_m), np.array(self._bench.tray.size_m) / 2
        lying = [
            seen_part
            for seen_part in self._of_type(part)
            if np.all(np.abs(np.array(seen_part.pose.position_m) - middle)[:2] < half)
        ]
        return sorted(lying, key=lambda seen_part: -seen_part.pose.position_m[0])

    def left(self, part: str) -> SeenPart | None:
        """A part of a type on the table between person and bracket, where the robot puts down what it brings."""
        lying = (
            seen_part for seen_part in self._of_type(part) if self._before_bracket(np.array(seen_part.pose.position_m))
        )
        return next(lying, None)

    def handed(self, part: str, *, brought: bool = False) -> SeenPart | None:
        """A part of a type that the arm holds still, out to the person; or that it still brings there, too."""
        tool_m = self.held_out_m(brought=brought)
        if tool_m is None:
            return None
        return next((seen for seen in self._of_type(part) if self._beside_m(seen, tool_m) < HELD_M), None)

    def _beside_m(self, seen: SeenPart, point_m: Array) -> float:
        """How far a point (3,) is from a part's axis, from its bottom to its top."""
        off_m = seen.pose.inverse().transform(point_m)
        off_m[2] -= np.clip(off_m[2], 0.0, self.kinds[seen.part].size_m[2])
        return float(np.linalg.norm(off_m))

    @property
    def open_fingers_m(self) -> Array | None:
        """Where the arm holds its open fingers out to the person, with nothing between them; None where it does not."""
        tool_m = self.held_out_m()
        if tool_m is None or self.fingers_m < OPEN_M or any(self.handed(part) for part in self._product.parts):
            return None
        return tool_m

    @property
    def fingers_m(self) -> float:
        """Distance between the arm's fingers."""
        return float(sum(self._data.joint(name).qpos[0] for name in self._fingers))

    def gripped(self, part: str) -> bool:
        """Whether the arm's fingers, that stand, are as far apart as such a part is wide."""
        speed_m_s = sum(abs(self._data.joint(name).qvel[0]) for name in self._fingers)
        return self.fingers_m < self._product.parts[part].size_m[1] + GRIPPED_M and speed_m_s < STILL_M_S

    def held_in_hole(self) -> str | None:
        """A hole in which the arm, that stands, still holds a part."""
        if self._tool is None or self.arm_moving:
            return None
        tool_m, kinds = self._data.xpos[self._tool], self._product.parts
        for name, hole_m in self.holes_m.items():
            seen = self.in_hole(name) if np.linalg.norm((tool_m - hole_m)[:2]) < HELD_M / 2 else None
            if seen is not None and self.fingers_m < kinds[seen.part].size_m[1] + GRIPPED_M:
                return name
        return None

    def held_out_m(self, *, brought: bool = False) -> Array | None:
        """Where the tool is (3,), if it is held out to the person."""
        if self._tool is None or (self.arm_moving and not brought):
            return None
        tool_m: Array = self._data.xpos[self._tool].copy()
        return None if tool_m[0] < self.bracket_m[0] + HELD_OUT_M else tool_m

    def set_down_m(self, part: str) -> Array:
        """Where a part (its bottom) may be put on the table, before the bracket."""
        x, y, _ = self.bracket_m
        return np.array([x + sum(BEFORE_BRACKET_M) / 2, y, self._product.parts[part].peg_length_m])

    def _of_type(self, part: str) -> list[SeenPart]:
        return [self.part(body) for body, name in self._parts.items() if name == part]

    def spot_m(self, whole: str) -> Array:
        """Where a sub-assembly is built: the first spot of its place (3,)."""
        return np.array(self._bench.places[self._product.parts[whole].built_at].spot(0).position_m)

    def unbuilt(self, wanted: Collection[str]) -> str | None:
        """A sub-assembly that is wanted and not built, whose spot is free, and whose parts are at hand."""
        there = Counter(self._parts.values())
        for whole, count in Counter(part for part in wanted if part in self._product.wholes).items():
            away_m = [np.linalg.norm(self._data.xpos[self._ids[part]] - self.spot_m(whole)) for part in self._parts]
            free = min(away_m) > NEAR_HOLE_HEIGHT_M
            needed = Counter(self._product.parts[whole].made_of)
            if there[whole] < count and free and all(len(self.spares(part)) >= n for part, n in needed.items()):
                return whole
        return None

    def _on_own_side(self, position_m: Array) -> bool:
        near_bin = any(
            np.linalg.norm(position_m - np.array(bin_m)) < OWN_BIN_M for bin_m in self._bench.bins_m.values()
        )
        return bool(near_bin or self._before_bracket(position_m))

    def _before_bracket(self, position_m: Array) -> bool:
        off = position_m - np.array(self.bracket_m)
        near = BEFORE_BRACKET_M[0] < off[0] < BEFORE_BRACKET_M[1] and abs(off[1]) < BESIDE_BRACKET_M
        return bool(near and position_m[2] < LYING_M)

    @property
    def has_arm(self) -> bool:
        """Whether a robot stands at the bench."""
        return self._tool is not None

    def tool(self) -> tuple[Array, Array]:
        """Where the arm's tool is (3,) and its velocity (3,) in [m/s]; only where there is an arm."""
        assert self._tool is not None
        spin_and_speed = np.zeros(6)
        kind = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(self._model, self._data, kind, self._tool, spin_and_speed, 0)
        return self._data.xpos[self._tool].copy(), spin_and_speed[3:]

    @property
    def links_m(self) -> Array:
        """Origins (n, 3) of the arm's links, from the tool on; none where there is no arm."""
        links: Array = self._data.xpos[self._links].reshape(-1, 3).copy()
        return links

    @property
    def arm_moving(self) -> bool:
        """Whether any joint of the arm moves."""
        return bool(self._arm_dofs) and float(np.abs(self._data.qvel[self._arm_dofs]).max()) > ARM_MOVING_RAD_S

    @property
    def arm_leaves(self) -> bool:
        """Whether the arm moves away from the bracket, and is no longer over it."""
        if self._tool is None or self.arm_over_bracket:
            return False
        tool_m, tool_m_s = self.tool()
        away = (tool_m - np.array(self.bracket_m))[:2]
        return float(tool_m_s[:2] @ away) > ARM_LEAVES_M_S * float(np.linalg.norm(away))

    @property
    def arm_parked(self) -> bool:
        """Whether the arm stands at its parking place, however its wrist is turned."""
        if not self._arm_qpos:
            return True
        off = np.abs(self._data.qpos[self._arm_qpos] - np.array(self._bench.arm_park_rad))[:-1]
        return float(off.max()) < ARM_PARKED_RAD and not self.arm_moving

    @property
    def arm_over_bracket(self) -> bool:
        """Whether the arm's hand is over the bracket or right beside it."""
        if self._flange is None:
            return False
        holes: Array = np.array(list(self.holes_m.values()))
        flange = self._data.xpos[self._flange]
        low, high = holes.min(axis=0) - ARM_NEAR_BRACKET_M, holes.max(axis=0) + ARM_NEAR_BRACKET_M
        return bool(np.all(flange[:2] > low[:2]) and np.all(flange[:2] < high[:2]))


def _upwards(model: mujoco.MjModel, body: int) -> list[int]:
    """A body and those that carry it, up to the world."""
    return [body, *_upwards(model, int(model.body_parentid[body]))] if body else []


def _moving(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints that move a body, from the world on."""
    bodies = reversed(_upwards(model, body))
    return [
        joint for at in bodies for joint in range(model.body_jntadr[at], model.body_jntadr[at] + model.body_jntnum[at])
    ]


def _triple(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _quadruple(values: Array) -> tuple[float, float, float, float]:
    return float(values[0]), float(values[1]), float(values[2]), float(values[3])
