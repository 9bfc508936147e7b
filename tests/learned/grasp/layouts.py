"""Hand-made trays for the tests of the grasp planner."""

from __future__ import annotations

import math
from pathlib import Path

from bracket_cell.learned.grasp.boxes import Boxes
from bracket_cell.learned.grasp.candidates import CANDIDATES, touching
from bracket_cell.learned.grasp.settings import GripperOutline
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

ROOT = Path(__file__).parents[3]
PRODUCT = load_yaml(ROOT / "config" / "products.yaml", Product)
WEIGHTS = ROOT / "learned" / "weights"


def standing(name: str, x_m: float, y_m: float, yaw_rad: float = 0.0) -> PartDetection:
    """A part on its peg on a floor at height 0, seen exactly."""
    part = PRODUCT.parts[name]
    pose = Pose.from_yaw((x_m, y_m, part.peg_length_m), yaw_rad)
    return PartDetection(name, 0.95, pose, part.size_m, (0, 0, 10, 10))


def moved(part: PartDetection, x_m: float, y_m: float, yaw_rad: float) -> PartDetection:
    """The part after the whole scene was turned about the origin and then shifted."""
    world = Pose.from_yaw((x_m, y_m, 0.0), yaw_rad) @ part.world_from_part
    return PartDetection(part.part, part.confidence, world, part.size_m, part.box_px)


def walled(name: str, wall: str) -> tuple[PartDetection, ...]:
    """A part with a tall one close along each of its long sides."""
    beside = (PRODUCT.parts[name].size_m[1] + PRODUCT.parts[wall].size_m[1]) / 2 + 0.006
    return (standing(name, 0.0, 0.0), standing(wall, 0.0, beside), standing(wall, 0.0, -beside))


def enclosed() -> tuple[PartDetection, ...]:
    """A low part between two tall walls, with a low part at each of its ends that only the walls keep from moving."""
    end = PRODUCT.parts["o1"].size_m[0] + 0.006
    return (*walled("o1", "o3"), standing("o1", end, 0.0), standing("o1", -end, 0.0))


def chain() -> tuple[PartDetection, ...]:
    """Part 2 blocks part 1, which blocks part 0 with its end; all are too long to be grasped by their ends."""
    return (
        standing("o3", 0.0, 0.0),
        standing("o3", 0.0, 0.0695, math.pi / 2),
        standing("o3", 0.0695, 0.0695),
    )


def can_grasp(boxes: Boxes, required: int, candidate: str, outline: GripperOutline | None = None) -> bool:
    """The label: whether the gripper can take a part by a candidate ("width" or "length") without touching another."""
    return not touching(boxes, outline or GripperOutline())[required, CANDIDATES.index(candidate)].any()
