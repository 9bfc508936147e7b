"""What of a bench as configured cannot be: things in each other's place, and an arm that rests in something."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Set

import numpy as np
from numpy.typing import NDArray

from bracket_cell.configuration import Configuration
from bracket_cell.learned.classical.box_model import View, obstacle_mask
from bracket_cell.simulator import installed
from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.skills.pick_and_place import Pick, can_place
from bracket_cell.skills.put_down import PutDown, standing
from bracket_cell.trees.nodes.arm import MoveStraight, MoveToPose
from bracket_cell.trees.nodes.places import Pick as PickNode
from bracket_cell.trees.nodes.places import Place as PlaceNode
from bracket_cell.trees.nodes.poses import FramedPose, fixed_frame, near_bracket
from bracket_cell.trees.nodes.tray import PutDown as PutDownNode
from bracket_ground.errors import Place, Problem, SettingError
from bracket_ground.files.model import Location
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.places import BenchPlace
from bracket_ground.interfaces.pose import FINGERS_DOWN, Array, Pose
from bracket_ground.interfaces.product import Product
from btxml.engine.node import TreeNode
from btxml.engine.ports import Input
from btxml.engine.tree import Tree

UNSEEN = "nobody sees what is in there"
Wrong = tuple[Location, str]  # where in the configuration, and what


def bench_problems(configuration: Configuration, product: Product) -> tuple[list[Wrong], list[Wrong]]:
    """What a run would not begin with, and what is doubtful."""
    bench = configuration.bench
    motion = MotionPlanner(product, bench, configuration.motion)
    stuck, found = _stuck(motion), installed()
    doubtful = [] if found is None else found.overlapping(product, bench)
    doubtful += _unseen(bench, product)
    if configuration.robot.gripper.nothing:
        where: Location = ("robot",) if configuration.gripper is None else ("gripper",)
        return stuck, [*doubtful, (where, "the arm has no gripper: the cell watches, and the person places every part")]
    unheld = _unheld(configuration, product)
    doubtful += _beyond(motion, product, product.parts.keys() - unheld.keys())
    nothing_held = len(unheld) == len(+product.most)
    told = list(unheld.values())
    return [*stuck, *told * nothing_held], [*doubtful, *told * (not nothing_held)]


def _unseen(bench: Bench, product: Product) -> Iterator[Wrong]:
    """Holes outside of the overhead image, or behind an obstacle."""
    view = View(bench.overhead.model, bench.overhead.mount.pose)
    covered = obstacle_mask(view, bench)
    outside, behind = list[str](), list[str]()
    for name in product.bracket.holes_m:
        column, row = np.rint(view.pixels(np.array([hole_pose(product, bench, name).position_m]))[0]).astype(int)
        if not (0 <= row < covered.shape[0] and 0 <= column < covered.shape[1]):
            outside.append(name)
        elif covered[row, column]:
            behind.append(name)
    if outside:
        yield ("bench", "overhead"), f"the image of the overhead camera ends before {', '.join(outside)}: {UNSEEN}"
    if behind:
        what = f"an obstacle stands between the overhead camera and {', '.join(behind)}: {UNSEEN}"
        yield ("bench", "obstacles"), what


def _beyond(motion: MotionPlanner, product: Product, held: Set[str]) -> Iterator[Wrong]:
    """Holes into which the arm can never put a part that it holds and that a goal takes there."""
    holes = defaultdict[str, list[str]](list)
    for name in product.bracket.holes_m:
        if never := [part for part in sorted(product.types_at(name) & held) if not can_place(motion, part, name)]:
            holes[", ".join(never)].append(name)
    for parts, names in holes.items():
        yield ("robot",), f"the arm cannot put {parts} into {', '.join(names)}: the person places it"


def _unheld(configuration: Configuration, product: Product) -> dict[str, Wrong]:
    """By type, why the gripper cannot hold such a part however it stands: the person places it."""
    gripper, clearance_m = configuration.robot.gripper, configuration.motion.least_finger_clearance_m
    where: Location = ("robot",) if configuration.gripper is None else ("gripper",)
    reasons = {name: gripper.why_not(product.parts[name], clearance_m) for name in +product.most}
    return {name: (where, f"{gripper.name} cannot hold {name}, which {why}") for name, why in reasons.items() if why}


def refuse_blocked(motion: MotionPlanner) -> None:
    """Raise SettingError where the arm would rest in something, or look past the tray."""
    if stuck := _stuck(motion):
        raise SettingError(*stuck)


def _stuck(motion: MotionPlanner) -> list[Wrong]:
    stuck: list[Wrong] = [
        (("bench", pose), f"the arm rests in something: {contact}; {pose} left out, another is found")
        for pose, contact in motion.blocked
    ]
    bench, look_rad = motion.bench, np.array(motion.bench.arm_look_rad)
    places_m = np.multiply([(i, j, 0) for i in (-1, 0, 1) for j in (-1, 0, 1)], (*bench.tray.size_m, 0)) / 2
    eye = motion.kinematics.forward(look_rad) @ bench.wrist.mount.pose
    if not in_view(bench.wrist, eye, places_m + bench.tray.centre_m).any():
        what = "from arm_look_rad the wrist camera sees nothing of the tray; left out, another is found"
        stuck.append((("bench", "arm_look_rad"), what))
    for name, place in bench.places.items():
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


def never_reached(motion: MotionPlanner, tree: Tree) -> Iterator[Problem]:
    """Poses and spots that a tree file spells out, and that the arm can never reach on this bench."""
    for node, places in zip(tree.nodes, tree.places, strict=True):
        for key, why in _why_never(motion, node):
            if why:
                place = places.get(key) or places[""]
                yield Problem(Place(place.file, place.line, place.column), f"{type(node).__name__}: {why}")


def _why_never(motion: MotionPlanner, node: TreeNode) -> Iterator[tuple[str, str | None]]:
    """By port, why what it says can never work; empty or None where it can, or where only the run knows."""
    if isinstance(node, PutDownNode) and (spot := _constant(motion, node.spot)) is not None:
        parts = (node.part.get(),) if node.part.constant else tuple(motion.product.parts)
        puts = (PutDown(motion, part, spot, str(node.spot.get())) for part in parts)
        at_bracket = near_bracket(motion.bench, motion.product, spot)
        yield "spot", "it is at the bracket, where PlacePart puts parts" if at_bracket else _of_all(puts)
    elif isinstance(node, MoveToPose | MoveStraight) and (pose := _constant(motion, node.pose)) is not None:
        found = motion.reach([pose @ FINGERS_DOWN], np.array(motion.bench.arm_park_rad), Load(0.0, close=True))
        yield "pose", found if isinstance(found, str) else None
    elif isinstance(node, PlaceNode | PickNode):
        yield from _why_not_at(motion, node)


def _why_not_at(motion: MotionPlanner, node: PlaceNode | PickNode) -> Iterator[tuple[str, str | None]]:
    """Of a place, whose spots the bench's own check reaches for: a spot or a type of part that it does not have."""
    where, part = (node.at, node.part) if isinstance(node, PlaceNode) else (node.source, node.wanted)
    if not where.constant:
        return
    name = where.get()
    place = motion.bench.places[name]
    if node.spot.constant and node.spot.get() >= len(place.spots_m):
        yield "spot", f"{name} has {len(place.spots_m)} spots, from 0"
    if part.constant and not place.takes(part.get()):
        yield part.port.name, f"{name} holds {', '.join(place.holds)}"


def _of_all(puts: Iterable[PutDown]) -> str | None:
    """Why none of several types can be put down; None where one can."""
    why: str | None = None
    for put in puts:
        if (why := put.why_never()) is None:
            return None
    return why


def _constant(motion: MotionPlanner, port: Input[FramedPose]) -> Pose | None:
    """World pose that a file spells out, in a frame that stands still."""
    if not port.constant:
        return None
    pose = port.get()
    frame = fixed_frame(motion.bench, motion.product, pose.frame)
    return None if frame is None else frame @ pose.pose


def in_view(setup: CameraSetup, world_from_camera: Pose, places_m: Array) -> NDArray[np.bool_]:
    """Which places (n, 3) are inside a camera's image."""
    deep = world_from_camera.inverse().transform(places_m)[:, 2] > 0
    pixels = setup.model.project(world_from_camera, places_m)
    inside: NDArray[np.bool_] = (
        deep & (pixels >= 0).all(axis=1) & (pixels <= (setup.width_px - 1, setup.height_px - 1)).all(axis=1)
    )
    return inside
