"""A hand that is near, as an observation shows it: how far the arm is from it, and a way that leads away from it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from bracket_cell.skills.motion.known_bench import Implausible, KnownBench
from bracket_cell.skills.motion.planner import Load, Looking, MotionPlanner, Plan
from bracket_cell.skills.motion.separation import UNKNOWN, Following, Separation, SeparationMonitor
from bracket_cell.skills.motion.trajectory import joined
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.pose import Array, Pose

BACK_M = (0.08, 0.16, 0.24)  # the tool is drawn back so far, before it turns away
RISES_M = (0.0, 0.08)  # and lifted so far before that


def separation_of(
    monitor: SeparationMonitor, seen: Observation, ahead: Following | None, joints_rad: Array | None = None
) -> Separation | None:
    """From every hand that is seen, and from where others may be; None without a view of the bench.

    Where hands, joints or the place on the path are no sound numbers, it is `UNKNOWN`, which holds the arm.

    Args:
        ahead: the trajectory that the arm follows or would follow, and how far along it the arm is.
        joints_rad: (n,) where the arm would stand; as measured by default.
    """
    joints = seen.arm.known_rad(monitor.outline.joints) if joints_rad is None else joints_rad
    if seen.bench is None:
        return None
    if joints is None or not (ahead is None or 0 <= ahead[1] < math.inf):
        return UNKNOWN
    try:
        persons = monitor.persons.of(KnownBench(monitor.persons.view_range, seen.bench, seen.time_s))
    except Implausible:
        return UNKNOWN
    return monitor.judge(np.array(joints), persons, seen.gripper.holding, ahead)


def way_out(planner: MotionPlanner, seen: Observation, start_rad: Array, goal_rad: Array, load: Load) -> Looking:
    """A free way to joints that leads away from the near hand all the way; or why there is none.

    Turned about the arm's base, the tool often comes nearer to the person first: then it is drawn back before.
    """
    stands = separation_of(planner.separation, seen, None)
    for path in _ways(planner, seen, start_rad, goal_rad, load) if stands is not None and stands.may_leave else ():
        found = None if isinstance(path, str) else separation_of(planner.separation, seen, (path, 0.0))
        yield path if found is not None and found.retreat_scale > 0 else None
    yield "no way leads away from the hand"


def _ways(planner: MotionPlanner, seen: Observation, start_rad: Array, goal_rad: Array, load: Load) -> Iterator[Plan]:
    """Straight there, or first away from a hand or towards the arm's base, each also after a lift."""
    yield planner.near_move(start_rad, goal_rad, load)
    tool = planner.kinematics.forward(start_rad)
    here = np.array(tool.position_m[:2])
    back = [-here, *(here - np.array(hand.fingertips_m) for hand in (seen.bench.hands if seen.bench else ()))]
    for rise_m, back_m, along in product(RISES_M, BACK_M, back):
        x, y = here + along * (back_m / max(float(np.linalg.norm(along)), 1e-9))
        z = tool.position_m[2] + rise_m
        lift = planner.rise(start_rad, z, load.opening_m) if rise_m else None
        if isinstance(lift, str):
            continue
        lifted_rad = start_rad if lift is None else lift.positions_rad[-1]
        drawn = planner.straight_move(lifted_rad, Pose((float(x), float(y), z), tool.quaternion_wxyz), load)
        if isinstance(drawn, str):
            continue
        rest = planner.near_move(drawn.positions_rad[-1], goal_rad, load)
        if not isinstance(rest, str):
            yield joined([leg for leg in (lift, drawn, rest) if leg is not None])
