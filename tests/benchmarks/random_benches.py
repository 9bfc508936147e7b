"""Ways between tray and holes on random benches with 3 to 8 obstacles: which are found, how soon, how long they are.

A way that is not found is asked of the same search with a minute and the joints' whole range: those that it finds are
missed. The work of a tick is told beside, as a piece of it is all that a tick does.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion import search
from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.skills.motion.trajectory import limit_ratios
from bracket_ground.interfaces.bench import Bench, Obstacle
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.storage import overlapping

DOWN = (0.0, 1.0, 0.0, 0.0)
OPENING_M = 0.04
OVER_TRAY_M, OVER_HOLE_M = 0.18, 0.16
HANGS = 0.25  # share of obstacles that stand on nothing, as lamps do
MINUTE_S = 60.0
CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)


@dataclass
class Tally:
    """What was asked and found; times in [s]."""

    ways: int = 0
    missed: int = 0
    plans_s: list[float] = field(default_factory=list)
    pieces_s: list[float] = field(default_factory=list)
    lasts_s: list[float] = field(default_factory=list)
    limits: list[float] = field(default_factory=list)


def obstacle(rng: np.random.Generator, number: int) -> Obstacle:
    """A post, a box or a beam somewhere on the bench."""
    x, y = rng.uniform((0.25, -0.65), (1.05, 0.55))
    turn = Pose.from_yaw((0.0, 0.0, 0.0), rng.uniform(0, np.pi)).quaternion_wxyz
    if rng.random() < HANGS:
        size = (rng.uniform(0.15, 0.4), 0.05, 0.05)
        return Obstacle(
            name=f"beam {number}", position_m=(x, y, rng.uniform(0.45, 0.75)), quaternion_wxyz=turn, box_m=size
        )
    height = rng.uniform(0.08, 0.60)
    at = (x, y, height / 2)
    if rng.random() < 0.5:
        return Obstacle(name=f"post {number}", position_m=at, cylinder_m=(rng.uniform(0.03, 0.10), height))
    size = (rng.uniform(0.04, 0.14), rng.uniform(0.04, 0.14), height)
    return Obstacle(name=f"box {number}", position_m=at, quaternion_wxyz=turn, box_m=size)


def random_bench(product: Product, bench: Bench, rng: np.random.Generator) -> Bench:
    """With 3 to 8 obstacles, none of which is where something else stands or the arm rests."""
    wanted = int(rng.integers(3, 9))
    kept: tuple[Obstacle, ...] = ()
    while len(kept) < wanted:
        tried = bench.model_copy(update={"obstacles": (*kept, obstacle(rng, len(kept)))})
        if not overlapping(product, tried) and not MotionPlanner(product, tried).blocked:
            kept = tried.obstacles
    return bench.model_copy(update={"obstacles": kept})


def questions(planner: MotionPlanner) -> Iterator[tuple[Array, Array, Load]]:
    """Ways from over the tray to over holes, both of which the arm can reach."""
    load, near = Load(OPENING_M), np.array(planner.bench.arm_look_rad)
    for x in (0.46, 0.56, 0.66):
        for y in (-0.48, -0.38, -0.28):
            start = planner.reach([Pose((x, y, OVER_TRAY_M), DOWN)], near, load)
            for hole in planner.product.bracket.holes_m:
                a, b, c = hole_pose(planner.product, planner.bench, hole).position_m
                if isinstance(start, str):
                    continue
                goal = planner.reach([Pose((a, b, c + OVER_HOLE_M), DOWN)], start[1], load)
                if not isinstance(goal, str):
                    yield start[1], goal[1], load


def ask(planner: MotionPlanner, start: Array, goal: Array, load: Load, tally: Tally) -> bool:
    """Whether a way is found, piece by piece as in ticks."""
    pieces, begun_s = [], time.process_time()
    found = planner.free_way(start, goal, load)
    pieces.append(time.process_time() - begun_s)
    for plan in () if isinstance(found, JointTrajectory | str) else found:
        pieces.append(time.process_time() - begun_s - sum(pieces))
        if plan is not None:
            found = plan
            break
    tally.plans_s.append(sum(pieces))
    tally.pieces_s.append(max(pieces))
    if isinstance(found, JointTrajectory):
        tally.lasts_s.append(found.duration_s)
        tally.limits.append(float(limit_ratios(found.times_s, found.positions_rad, planner.settings).max()))
    return isinstance(found, JointTrajectory)


def found_in_a_minute(planner: MotionPlanner, start: Array, goal: Array, load: Load) -> bool:
    """Whether the search finds it within a minute, also with a tool that tilts."""
    scene, limits_rad = planner.scene(load), planner.kinematics.limits_rad
    room = search.Room(scene, np.array([start, goal]), limits_rad, level=False)
    trees, until_s = search.Search(room, search.STEPS_M[1], np.inf), time.process_time() + MINUTE_S
    while time.process_time() < until_s:
        if trees.go_on(search.TILTED_CHECKS) is not None:
            return True
    return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--benches", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    tally, rng = Tally(), np.random.default_rng(arguments.seed)
    for _ in range(arguments.benches):
        planner = MotionPlanner(PRODUCT, random_bench(PRODUCT, CONFIGURATION.bench, rng), CONFIGURATION.motion)
        for start, goal, load in questions(planner):
            if ask(planner, start, goal, load, tally):
                tally.ways += 1
            elif found_in_a_minute(planner, start, goal, load):
                tally.ways, tally.missed = tally.ways + 1, tally.missed + 1
    plans_ms = 1e3 * np.array(tally.plans_s)
    report = {
        "ways": tally.ways,
        "found": round(1 - tally.missed / max(tally.ways, 1), 4),
        "plan_ms": {
            "median": round(float(np.median(plans_ms)), 1),
            "p95": round(float(np.quantile(plans_ms, 0.95)), 1),
        },
        "most_in_a_tick_ms": round(1e3 * max(tally.pieces_s), 1),
        "most_of_a_joints_limit": round(max(tally.limits), 4),
        "way_s": {"median": round(float(np.median(tally.lasts_s)), 2), "most": round(max(tally.lasts_s), 2)},
    }
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
