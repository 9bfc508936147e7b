"""Pictures of stacked objects with who lies on whom, as generator, files and planners hand them on."""

from __future__ import annotations

from dataclasses import dataclass

VMRD_CLASSES = (
    "box",
    "banana",
    "notebook",
    "screwdriver",
    "toothpaste",
    "apple",
    "stapler",
    "mobile phone",
    "bottle",
    "pen",
    "mouse",
    "umbrella",
    "remote controller",
    "cans",
    "tape",
    "knife",
    "wrench",
    "cup",
    "charger",
    "badminton",
    "wallet",
    "wrist developer",
    "glasses",
    "pliers",
    "headset",
    "toothbrush",
    "card",
    "paper",
    "towel",
    "shaver",
    "watch",
)
"""In VMRD's order and spelling."""

Box = tuple[float, float, float, float]  # left, top, right, bottom in pixels from 0
Corners = tuple[float, float, float, float, float, float, float, float]


@dataclass(frozen=True)
class StackedObject:
    """One object of a picture.

    Attributes:
        index: its node number in this picture; not its place in a list.
        name: of its class.
        fathers: indices of the objects that lie below it: they are taken after it.
        children: indices of the objects that lie on top of it: they are taken before it.
        top_m: height of its highest point above the table, where that is known.
        difficult: as in Pascal VOC.
    """

    index: int
    name: str
    box_px: Box
    fathers: tuple[int, ...] = ()
    children: tuple[int, ...] = ()
    top_m: float | None = None
    difficult: bool = False


@dataclass(frozen=True)
class StackGrasp:
    """A rectangle for a two-finger gripper: x and y of four corners, the first two along one finger."""

    corners_px: Corners
    index: int


@dataclass(frozen=True)
class StackedScene:
    """A picture of objects, some of which lie on others.

    Attributes:
        name: of its files.
        size_px: width and height.
        drawn_from: how many classes its objects were drawn from, where that is known.
    """

    name: str
    size_px: tuple[int, int]
    objects: tuple[StackedObject, ...]
    grasps: tuple[StackGrasp, ...] = ()
    drawn_from: int | None = None
