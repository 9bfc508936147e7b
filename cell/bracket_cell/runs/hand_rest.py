"""Where the person's hand rests best: what a resting hand costs the arm on its ways from the tray to the holes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bracket_cell.skills.motion.person_space import PERSON, Person
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.pose import Array

BACK_M = (0.0, 0.05, 0.10)  # towards the person
ASIDE_M = (0.0, -0.15, 0.15, -0.30, 0.30)  # a forearm turns so far while the person stands
WORTH_S = 0.1  # of a part; less is no reason to move
GAP_M = 0.10  # of a palm from the middle of a bin, or from what stands on the bench
KNOWN_S = 0.1  # the usual age of what is known of hands


def rest_advice(motion: MotionPlanner, bench: Bench, ways_rad: Sequence[Array]) -> str:
    """Says a better resting place within the person's reach, and the seconds of a part that it spares; empty if none.

    Args:
        ways_rad: (2, n) joints where the arm grips a part and where it places it.
    """
    present_s = _lost_s(motion, bench, bench.hand_rest_m, ways_rad)
    if not ways_rad or present_s < WORTH_S:
        return ""
    found = [(_lost_s(motion, bench, place, ways_rad), place) for place in _places(bench)]
    least_s, place = min(found, default=(present_s, bench.hand_rest_m))
    if present_s - least_s < WORTH_S:
        return ""
    text = ", ".join(f"{value:.2f}" for value in place)
    return f"a hand that rests at [{text}] spares {present_s - least_s:.1f} s of each part: bench.hand_rest_m"


def _places(bench: Bench) -> Iterator[tuple[float, float, float]]:
    """Farther back or aside, the whole hand in the overhead camera's view, over no bin and no obstacle."""
    x, y, z = bench.hand_rest_m
    things = [obstacle.points_m[:, :2] for obstacle in bench.obstacles]
    camera, from_world = bench.overhead.model, bench.overhead.mount.pose.inverse()
    for place in ((x + back_m, y + aside_m, z) for back_m in BACK_M for aside_m in ASIDE_M):
        ends = from_world.transform(np.array(place) + np.array([[-PERSON.hand_length_m, 0.0, 0.0], [0.0, 0.0, 0.0]]))
        pixels = (ends @ camera.matrix.T)[:, :2] / ends[:, 2:]
        inside = (pixels > PERSON.edge_px) & (pixels < np.array([camera.width_px, camera.height_px]) - PERSON.edge_px)
        free = all(np.hypot(place[0] - at[0], place[1] - at[1]) > GAP_M for at in bench.bins_m.values())
        free &= not any(_meets(place, thing_m) for thing_m in things)
        if inside.all() and free:
            yield place


def _meets(place_m: Sequence[float], thing_m: Array) -> bool:
    """Whether a hand at a place lies over the rectangle about a thing's points (n, 2), or near it."""
    tips_m = (place_m[0] - PERSON.hand_length_m, place_m[1])
    return bool(np.all(thing_m.min(0) - GAP_M < place_m[:2]) and np.all(thing_m.max(0) + GAP_M > tips_m))


def _lost_s(motion: MotionPlanner, bench: Bench, rest_m: Sequence[float], ways_rad: Sequence[Array]) -> float:
    """Mean time of a way that the arm loses beside a hand that rests there."""
    x, y, z = rest_m
    middle = (bench.overhead.width_px // 2, bench.overhead.height_px // 2)
    hand = HandSample(0.0, (*middle, *middle), (x - PERSON.hand_length_m, y), (x, y), height_m=z)
    separation = motion.separation
    resting = Person(separation.persons.wall(hand), KNOWN_S, separation.settings.hand_speed_m_s, (0.0, 0.0))
    times = [motion.beside.takes_s(way, [resting]) for way in ways_rad]
    return float(np.mean([takes_s - hurried_s for takes_s, hurried_s in times])) if times else 0.0
