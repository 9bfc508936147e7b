"""Whether an arm that is too near to a hand may go on: slowly, along a path that leads away from it all the way."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np

from bracket_cell.skills.motion.arm_outline import ArmOutline
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array


@dataclass(frozen=True)
class RetreatLimits:
    """When a motion leads away from a hand. Origin: a control loop of 25 Hz; the rest chosen.

    Attributes:
        step_s: [s] between the places of a path that are examined.
        soon: [steps] that count for the speed: a tick, and the reaction.
        sway_m: [m] nearer than before that count as none: joints are measured, and trail.
    """

    step_s: float = 0.02
    soon: int = 6
    sway_m: float = 0.002


RETREAT = RetreatLimits()


def retreat_share(
    outline: ArmOutline,
    joints_rad: Array,
    ahead: tuple[JointTrajectory, float],
    person: coal.Convex,
    clear_m: float,
    speed_m_s: float,
    *,
    holding: bool,
) -> float:
    """Share of the planned speed at which the arm may follow the rest of a path; 0 where it does not lead away.

    No link may come nearer anywhere on it, as long as it is nearer than `clear_m`; at its end there is more room.

    Args:
        joints_rad: (n,) as measured.
        ahead: the trajectory, and how far along it the arm is.
        person: where the hand is.
        speed_m_s: of the fastest point, at most.
    """
    trajectory, path_s = ahead
    steps = int(np.ceil(max(0.0, trajectory.duration_s - path_s) / RETREAT.step_s))
    times_s: Array = path_s + RETREAT.step_s * np.arange(steps + 1, dtype=np.float64)
    path_rad = np.concatenate([joints_rad[np.newaxis], trajectory.along(times_s)])
    placed = outline.placed(path_rad)
    rooms_m = np.minimum(outline.rooms(placed, person, holding, clear_m).distances_m, clear_m)
    nearer_m = np.maximum.accumulate(rooms_m, axis=0) - rooms_m
    gains = rooms_m[-1].min() >= min(clear_m, rooms_m[0].min() + RETREAT.sway_m)
    if not (gains and nearer_m.max() <= RETREAT.sway_m):
        return 0.0
    corners_m = outline.corners_m(placed[1 : RETREAT.soon + 2])
    fastest_m_s = float(np.linalg.norm(np.diff(corners_m, axis=0), axis=3).max(initial=0.0)) / RETREAT.step_s
    return min(speed_m_s / max(fastest_m_s, 1e-9), 1.0)
