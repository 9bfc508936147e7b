"""The arm at its work in pictures to learn from: poses drawn at random, mostly with a part between its fingers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.pose import Array
from bracket_lab.drawing.recording import Moment
from bracket_lab.drawing.sight import GEOM_POSITIONS, GEOM_TURNS, SITE_POSITIONS
from bracket_sim.rendering.studio import ScenePoses
from bracket_sim.scene.world import World, WorldPart

PARKED_SHARE = 0.3  # of stretches in which the arm is out of the way
ARM_TRIES = 20
MOVED_M = 0.005
ARM_CLEAR_M = 0.16  # between the arm and the fingertips
ARM_LEAST_HEIGHT_M = 0.06
PAN_RAD, BEND_RAD = (-0.8, 1.3), 0.6  # of the arm about the pose from which it looks into the tray
HOLDS_SHARE = 0.6  # of these poses, in which the gripper holds a part
OPENINGS_M = (0.0, 0.0425)  # of one finger that holds nothing
FINGERS = ("finger_left", "finger_right")
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
TURNED_SHARE = 0.25  # of frames
LARGEST_TURN_RAD = 2.0  # from where people's hands point by themselves


@dataclass(frozen=True, eq=False)
class ArmPose:
    """Where the arm's shapes are, and those of a part that it holds.

    Attributes:
        geoms: (n,) their numbers.
        positions, turns: (n, 3) and (n, 9).
    """

    geoms: NDArray[np.int64]
    positions: Array
    turns: Array


class WorkingArm:
    """Poses of the arm at its work, written over those of a moment."""

    def __init__(self, world: World, look_rad: Sequence[float], rng: np.random.Generator) -> None:
        self._world, self._look_rad, self._rng = world, np.array(look_rad), rng
        self._data = mujoco.MjData(world.model)

    @cached_property
    def _geoms(self) -> NDArray[np.int64]:
        model = self._world.model
        root = model.body_rootid[model.body("tool").id]
        return np.flatnonzero(model.body_rootid[model.geom_bodyid] == root)

    @cached_property
    def _pads(self) -> list[int]:
        return [int(self._world.model.geom(name).id) for name in ("pad_left", "pad_right")]

    def moved(self, first: Moment, now: Moment) -> bool:
        """Whether it is elsewhere than it was at first."""
        before, after = (moment.exposure.moments[-1][GEOM_POSITIONS][self._geoms] for moment in (first, now))
        return bool(np.abs(after - before).max() > MOVED_M)

    def fingertips_m(self, poses: ScenePoses) -> Array:
        """(3,) Between the pads of its fingers."""
        middle: Array = poses[GEOM_POSITIONS][self._pads].mean(axis=0)
        return middle

    def points_m(self, poses: ScenePoses, pose: ArmPose | None) -> Array:
        """(shapes, 8, 3) corners of boxes around its shapes, and around what it holds in a pose of ours."""
        geoms, model = self._geoms if pose is None else pose.geoms, self._world.model
        shown = geoms[model.geom_group[geoms] < 3]
        boxes = model.geom_aabb[shown]
        corners = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
        turns = poses[GEOM_TURNS][shown].reshape(-1, 3, 3)
        points: Array = np.einsum("gij,gcj->gci", turns, corners) + poses[GEOM_POSITIONS][shown][:, None]
        return points

    def draw(self, moments: Sequence[Moment]) -> ArmPose | None:
        """A pose that keeps away from the person's fingertips; None where it stays parked."""
        if self._rng.random() < PARKED_SHARE:
            return None
        held = self._part(moments[0]) if self._rng.random() < HOLDS_SHARE else None
        for _ in range(ARM_TRIES):
            self._place(held)
            centres = self._data.geom_xpos[self._geoms]
            near_m = min(float(np.linalg.norm(centres - moment.fingertips_m, axis=1).min()) for moment in moments)
            if near_m > ARM_CLEAR_M and self._data.body("tool").xpos[2] > ARM_LEAST_HEIGHT_M:
                geoms = self._geoms
                if held is not None:
                    geoms = np.concatenate([geoms, np.flatnonzero(self._world.model.geom_bodyid == held.body)])
                return ArmPose(geoms, self._data.geom_xpos[geoms].copy(), self._data.geom_xmat[geoms].copy())
        return None

    def put(self, poses: ScenePoses, pose: ArmPose | None) -> ScenePoses:
        """The poses of a moment with the arm in another one."""
        if pose is None:
            return poses
        changed = list(poses)
        for field, values in ((GEOM_POSITIONS, pose.positions), (GEOM_TURNS, pose.turns)):
            changed[field] = poses[field].copy()
            changed[field][pose.geoms] = values
        return tuple(changed)

    def _part(self, moment: Moment) -> WorldPart | None:
        """One of those that lie in the tray."""
        tray = self._world.bench.tray
        away = np.abs(moment.parts_m[:, :2] - np.array(tray.centre_m[:2]))
        bodies = self._world.bodies
        inside = [int(body) for body in np.flatnonzero((away < np.array(tray.size_m) / 2).all(axis=1))]
        parts = [body for body in inside if bodies[body].name in self._world.parts]
        return bodies[int(self._rng.choice(parts))] if parts else None

    def _place(self, held: WorldPart | None) -> None:
        """Draw joints and fingers, and hang the part between them, its body along or across."""
        model, data = self._world.model, self._data
        data.qpos[:] = self._world.data.qpos
        data.qpos[self._world.arm_qpos] = self._joints()
        opening_m = self._rng.uniform(*OPENINGS_M)
        if held is not None:
            length_m, width_m, height_m = self._world.product.parts[held.part].size_m
            across = bool(self._rng.random() < 0.5)
            opening_m = min((length_m if across else width_m) / 2, OPENINGS_M[1])
        for name in FINGERS:
            data.qpos[model.joint(name).qposadr[0]] = opening_m
        mujoco.mj_kinematics(model, data)
        if held is None:
            return
        tool = data.body("tool")
        yaw = math.atan2(tool.xmat[3], tool.xmat[0]) + (0.0 if across else math.pi / 2)
        data.qpos[held.qpos : held.qpos + 3] = tool.xpos - (0.0, 0.0, height_m / 2)
        data.qpos[held.qpos + 3 : held.qpos + 7] = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
        mujoco.mj_kinematics(model, data)

    def _joints(self) -> Array:
        """Somewhere over tray and bracket, the tool pointing down."""
        joints = self._look_rad.copy()
        lift, elbow, turn = self._rng.uniform(-BEND_RAD, BEND_RAD, 3)
        pan = self._rng.uniform(*PAN_RAD)
        joints += (pan, lift, elbow, -lift - elbow, 0.0, 4 * turn)  # of the shipped arm, for which the networks are
        return joints


class TurnedHand:
    """Turns of hand, sleeve and what is held, written over the poses of a moment."""

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        model = world.model
        self._rng = rng
        self._geoms = np.flatnonzero(model.body_rootid[model.geom_bodyid] == model.body("hand").id)
        self._sites = np.flatnonzero(model.body_rootid[model.site_bodyid] == model.body("hand").id)

    def draw(self) -> float:
        """An angle [rad] from x to y; mostly 0."""
        turn_rad = self._rng.uniform(-LARGEST_TURN_RAD, LARGEST_TURN_RAD)
        return float(turn_rad) if self._rng.random() < TURNED_SHARE else 0.0

    def put(self, poses: ScenePoses, fingertips_m: Array, held: NDArray[np.int64], turn_rad: float) -> ScenePoses:
        """The poses with the hand turned about the vertical through its fingertips, which stay where they are.

        Args:
            held: (n,) shapes of what is in the hand.
        """
        if turn_rad == 0.0:
            return poses
        geoms = np.concatenate([self._geoms, held])
        cos, sin = math.cos(turn_rad), math.sin(turn_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        changed = list(poses)
        for field in (GEOM_POSITIONS, GEOM_TURNS, SITE_POSITIONS):
            changed[field] = poses[field].copy()
        for field, moved in ((GEOM_POSITIONS, geoms), (SITE_POSITIONS, self._sites)):
            changed[field][moved] = fingertips_m + (poses[field][moved] - fingertips_m) @ turn.T
        changed[GEOM_TURNS][geoms] = (turn @ poses[GEOM_TURNS][geoms].reshape(-1, 3, 3)).reshape(-1, 9)
        return tuple(changed)
