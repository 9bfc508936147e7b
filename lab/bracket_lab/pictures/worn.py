"""What people at benches wear and hold: gloves and tools, drawn onto hands that were cut out of photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.pose import Array

GLOVED_SHARE, TOOL_SHARE = 0.35, 0.3  # of hands
GLOVES = ((232, 224, 206), (64, 122, 198), (38, 38, 42), (186, 156, 108))  # RGB: latex, nitrile, black, leather
COLOURED, NEAR_COLOUR = 0.3, 12.0  # share of gloves of any colour; standard deviation about the others
FOLDS = 0.7  # how much of the light and shadow of skin is left on cloth, as an exponent
BLADE_PX, HANDLE_PX = (2, 5), (8, 16)  # thickness of a tool, where hands have 64 px from palm to wrist
BEYOND = (0.8, 2.5)  # how far a tool reaches beyond the fingertips, by the way from palm to pinch
OVER_HANDLE = 0.7  # share of tools that lie under the fingers


@dataclass(frozen=True, eq=False)
class CutHand:
    """A hand, and what it was cut out of.

    Attributes:
        image, behind: (height, width, 3) with the hand, and without it.
        mask: (height, width) share of the hand in each pixel.
        points_px: (21, 2) landmarks.
        left: it is a left hand.
    """

    image: Image
    behind: Image
    mask: NDArray[np.float32]
    points_px: Array
    left: bool


def dressed(hand: CutHand, palm_px: Array, pinch_px: Array, rng: np.random.Generator) -> CutHand:
    """The hand with what it wears and holds this time; its landmarks stay.

    Args:
        palm_px, pinch_px: (2,) middle of the palm, and where thumb and index meet.
    """
    if rng.random() < GLOVED_SHARE:
        near = np.array(GLOVES[rng.integers(len(GLOVES))]) + rng.normal(0.0, NEAR_COLOUR, 3)
        hand = gloved(hand, rng.uniform(0, 255, 3) if rng.random() < COLOURED else near)
    return with_tool(hand, palm_px, pinch_px, rng) if rng.random() < TOOL_SHARE else hand


def gloved(hand: CutHand, rgb: Sequence[float] | Array) -> CutHand:
    """In a glove of a colour, with the light and shadow that were on the skin."""
    light = hand.image.astype(np.float32).mean(axis=2)
    usual = float(np.median(light[hand.mask > 0.5])) if (hand.mask > 0.5).any() else 128.0
    shade = np.clip(light / max(usual, 1.0), 0.3, 1.8) ** FOLDS
    share = hand.mask[..., np.newaxis]
    cloth = shade[..., np.newaxis] * np.asarray(rgb, np.float32)
    return replace(hand, image=np.clip(hand.image * (1 - share) + cloth * share, 0, 255).astype(np.uint8))


def with_tool(hand: CutHand, palm_px: Array, pinch_px: Array, rng: np.random.Generator) -> CutHand:
    """With a rod and its handle from the palm through the fingertips; it counts as part of the hand."""
    end = pinch_px + rng.uniform(*BEYOND) * (pinch_px - palm_px)
    image, drawn = np.ascontiguousarray(hand.image).copy(), np.zeros(hand.mask.shape, np.uint8)
    for start, stop, thick, rgb in (
        (palm_px, end, rng.integers(*BLADE_PX), np.full(3, rng.uniform(60, 220))),
        (palm_px, pinch_px, rng.integers(*HANDLE_PX), rng.uniform(0, 255, 3)),
    ):
        first, last = (np.rint(point).astype(int).tolist() for point in (start, stop))
        cv2.line(image, first, last, rgb.tolist(), int(thick), cv2.LINE_AA)
        cv2.line(drawn, first, last, 255, int(thick), cv2.LINE_AA)
    if rng.random() < OVER_HANDLE:
        share = hand.mask[..., np.newaxis]
        image = np.rint(image * (1 - share) + hand.image * share).astype(np.uint8)
    return replace(hand, image=image, mask=np.maximum(hand.mask, drawn.astype(np.float32) / 255))
