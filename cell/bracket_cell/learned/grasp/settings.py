"""Settings: the gripper at a grasp, as it is and as the rule takes it, random tray scenes, and trainings.

The gripper comes straight down over a part, opened to the part's width or length plus a clearance on each side, and
closes.
"""

from __future__ import annotations

import math

from pydantic import Field

from bracket_ground.files.model import Model
from bracket_ground.interfaces.gripper import ROUND, Gripper


class GripperOutline(Model):
    """What must be free around the gripper when it comes down and closes; the defaults are what it truly occupies.

    Attributes:
        pad_size_m: thickness in the closing direction, width, length of a pad (the gripper's file);
            the links above are as thick and narrower.
        palm_size_m: extent in the closing direction, and along the fingers' width (the gripper's file).
        palm_above_tip_m: from the fingertips to the palm's lower side.
        stroke_m: widest opening.
        clearance_m: gap between each finger and the body when it comes down: the narrowest that the skills try
            (`least_finger_clearance_m` in skills/motion/settings.py).
        grasp_depth_m: fingertips reach this far below the body's top ...
        bottom_gap_m: ... but stay this far above its bottom (both in skills/motion/settings.py).
        fitting_m: the uppermost part of a body's height, a fitting that can be seen but not touched.
        margin_m: least gap between a finger and a neighbour.
        below_gap_m: a neighbour must end this far below fingertips or palm to be passed over.
        one_way: parts are grasped across their width and in the middle alone.
        middle_alone: types of parts that are grasped in the middle alone, because of their shape.
    """

    pad_size_m: tuple[float, float, float] = (0.012, 0.025, 0.022)
    palm_size_m: tuple[float, float] = (0.100, 0.062)
    palm_above_tip_m: float = Field(default=0.079, gt=0)
    stroke_m: float = Field(default=0.085, gt=0)
    clearance_m: float = Field(default=0.003, gt=0)
    grasp_depth_m: float = Field(default=0.022, gt=0)
    bottom_gap_m: float = Field(default=0.003, ge=0)
    fitting_m: float = Field(default=0.003, ge=0)
    margin_m: float = Field(default=0.0, ge=0)
    below_gap_m: float = Field(default=0.0, ge=0)
    one_way: bool = False
    middle_alone: tuple[str, ...] = ()


WITH_MARGINS = GripperOutline(palm_size_m=(0.104, 0.076), fitting_m=0.0, margin_m=0.001, below_gap_m=0.002)
"""What the rule keeps free: the narrowest room in which the skills go down, their safety margins included."""


def outline_of(gripper: Gripper, *, margins: bool = False) -> GripperOutline:
    """What a gripper occupies; with margins what the rule keeps free. A cup stands for fingers without a thickness."""
    usual, (wide, deep, _) = (
        WITH_MARGINS if margins else GripperOutline(),
        gripper.palm[1] if margins else gripper.palm_m,
    )
    cup, above_m = gripper.switched, round(gripper.tip_m - gripper.palm_m[2], ROUND)
    own: dict[str, object] = {"palm_size_m": (wide, deep), "palm_above_tip_m": above_m, "stroke_m": gripper.stroke_m}
    if gripper.fingers is not None:
        own |= {"pad_size_m": gripper.fingers.pads_m}
    if cup is not None:
        own |= {"pad_size_m": (0.0, cup.diameter_m, 0.0), "stroke_m": math.inf, "grasp_depth_m": 0.0, "one_way": True}
    return usual.model_copy(update=own)


class DetectionNoise(Model):
    """Standard deviations of what the part detector answers; the defaults are the classical one's in simulation.

    Measured (docs/research/results.md): position off by .2 to .6 mm in the median and .5 to .9 mm at 95 %, heading
    by .05 to .2 and .1 to .6 degrees; heights and sizes are the product's own.

    Attributes:
        position_m: of x and y, each.
        yaw_rad: heading.
        bottom_m: height of the body's bottom.
        size_m: length, width and height, each.
    """

    position_m: float = Field(default=0.0004, ge=0)
    yaw_rad: float = Field(default=0.0044, ge=0)
    bottom_m: float = Field(default=0.0, ge=0)
    size_m: float = Field(default=0.0, ge=0)


class SceneSettings(Model):
    """How cluttered scenes are drawn.

    Attributes:
        parts: fewest and most parts in a scene.
        neighbour_share: probability that a part is put right beside another one.
        nearest_gap_m, farthest_gap_m: gap between the bodies of such neighbours.
        crowding: of this many free places found, the one nearest to the middle of all parts is taken.
        tray_m: inner (x, y) extent of the tray; bodies lie inside.
        by_quantity: of every type at most as many as the product has.
        outline: of the gripper that the labels are about.
        noise: of the detections.
    """

    parts: tuple[int, int] = (3, 6)
    neighbour_share: float = Field(default=1.0, ge=0, le=1)
    nearest_gap_m: float = Field(default=0.003, ge=0)
    farthest_gap_m: float = Field(default=0.008, gt=0)
    crowding: int = Field(default=16, ge=1)
    tray_m: tuple[float, float] = (0.32, 0.40)
    by_quantity: bool = False
    outline: GripperOutline = GripperOutline()
    noise: DetectionNoise = DetectionNoise()


TRAY_SCENES = SceneSettings(neighbour_share=0.6, nearest_gap_m=0.004, farthest_gap_m=0.030, crowding=1)
"""As loose as the simulator's tray (sim/bracket_sim/scene/settings.py): one part in seventy cannot be grasped at once.
The default scenes are dense, so that two parts in five cannot."""

PAPER_SCENES = SceneSettings(
    nearest_gap_m=0.004, farthest_gap_m=0.030, crowding=3, by_quantity=True, outline=GripperOutline(one_way=True)
)
"""Like the paper's: 3 to 6 parts, at most 3, 2 and 1 of a type, one way to grasp, a quarter not graspable."""


class TrainingSettings(Model):
    """Data and optimiser.

    Attributes:
        scenes: drawn from the train split.
        observations: times that every scene is detected, each time with a noise of its own.
        plain_share: of the observations have the detector's own noise; that of the others lies between it and
            `most_noise`, all levels (on a logarithmic scale) alike.
        parts: fewest and most parts in a training scene; few, because moving parts away leaves few.
        test_scenes: drawn from the test split, for the scores on the model card.
        batch: parts, each as the required one, in a step.
        peak_rate: of the one-cycle schedule.
    """

    scenes: int = Field(gt=0)
    observations: int = Field(default=4, gt=0)
    plain_share: float = Field(default=0.5, ge=0, le=1)
    most_noise: DetectionNoise = DetectionNoise(position_m=0.006, yaw_rad=0.2, bottom_m=0.006, size_m=0.006)
    parts: tuple[int, int] = (1, 6)
    test_scenes: int = Field(default=1000, gt=0)
    epochs: int = Field(gt=0)
    batch: int = Field(gt=0)
    peak_rate: float = Field(gt=0)
    weight_decay: float = Field(default=0.01, ge=0)
    hidden: int = Field(gt=0)
    data: SceneSettings = SceneSettings()


class PairwiseSettings(TrainingSettings):
    """The pairwise planner.

    Attributes:
        members: how many perceptrons its committee has.
        random_share: of the scenes have parts of random sizes, so that the network knows sizes instead of types.
    """

    scenes: int = Field(default=4000, gt=0)
    epochs: int = Field(default=12, gt=0)
    batch: int = Field(default=256, gt=0)
    peak_rate: float = Field(default=0.006, gt=0)
    hidden: int = Field(default=48, gt=0)
    members: int = Field(default=4, gt=0)
    random_share: float = Field(default=0.5, ge=0, le=1)


class PaperSettings(TrainingSettings):
    """The paper's planner.

    Attributes:
        batch: scenes in a step.
        loose_share: of the scenes are drawn as loose as the simulator's tray, the others as `data` says.
        crops: nodes have features of the images' crops.
        footprint_passes: crops by which a network learns where parts stand around a part, before all else.
    """

    scenes: int = Field(default=4000, gt=0)
    observations: int = Field(default=1, gt=0)
    epochs: int = Field(default=50, gt=0)
    batch: int = Field(default=32, gt=0)
    peak_rate: float = Field(default=0.003, gt=0)
    loose_share: float = Field(default=0.5, ge=0, le=1)
    crops: bool = True
    footprint_passes: int = Field(default=120_000, gt=0)
    hidden: int = Field(default=64, gt=0)
    layers: int = Field(default=3, gt=0)
