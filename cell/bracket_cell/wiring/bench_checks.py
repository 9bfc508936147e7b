"""What of a bench as configured cannot be: things in each other's place, and an arm that rests in something."""

from __future__ import annotations

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.learned.classical.box_model import View, obstacle_mask
from bracket_cell.simulator import installed
from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.pick_and_place import Pick
from bracket_cell.skills.put_down import PutDown, standing
from bracket_ground.errors import SettingError
from bracket_ground.files.model import Location
from bracket_ground.interfaces.places import BenchPlace
from bracket_ground.interfaces.product import Product

Wrong = tuple[Location, str]  # where in the configuration, and what


def bench_problems(configuration: Configuration, product: Product) -> tuple[list[Wrong], list[Wrong]]:
    """What a run would not begin with, and what is doubtful."""
    bench = configuration.bench
    stuck = _stuck(MotionPlanner(product, bench, configuration.motion))
    found = installed()
    doubtful = [] if found is None else found.overlapping(product, bench)
    if bench.obstacles:
        view = View(bench.overhead.model, bench.overhead.mount.pose)
        covered = obstacle_mask(view, bench)
        for name in product.bracket.holes_m:
            column, row = np.rint(view.pixels(np.array([hole_pose(product, bench, name).position_m]))[0]).astype(int)
            inside = 0 <= row < covered.shape[0] and 0 <= column < covered.shape[1]
            if inside and covered[row, column]:
                what = f"an obstacle stands between the overhead camera and {name}: nobody sees what is in that hole"
                doubtful.append((("bench", "obstacles"), what))
    return stuck, doubtful


def refuse_blocked(motion: MotionPlanner) -> None:
    """Raise SettingError where the arm would rest in something."""
    if stuck := _stuck(motion):
        raise SettingError(*stuck)


def _stuck(motion: MotionPlanner) -> list[Wrong]:
    stuck: list[Wrong] = [
        (("bench", pose), f"the arm rests in something: {contact}") for pose, contact in motion.blocked
    ]
    for name, place in motion.bench.places.items():
        found = {part: _unreached(motion, name, place, part) for part in place.holds or motion.product.parts}
        if place.holds or all(found.values()):
            stuck += [(("bench", "places", name), what) for what in found.values() if what]
    return stuck


def _unreached(motion: MotionPlanner, name: str, place: BenchPlace, part: str) -> str:
    """Why the arm can never put a part of a type at a spot of a place, or never take it from there; empty if it can."""
    kind = motion.product.parts[part]
    for number in range(len(place.spots_m)):
        there = standing(part, kind, place.stands(number, kind.peg_length_m))
        put = PutDown(motion, part, place.spot(number), name, place=name).why_never()
        if why := put or Pick(motion, there, place=name).why_never():
            return f"the arm can never bring {part} to spot {number} and fetch it again: {why}"
    return ""
