"""MediaPipe's networks as a tracker of the bench: they find hands and landmarks.

How high a hand is, how large, and what it holds MediaPipe does not know: the small tracker's networks look at the same
places, and tell it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bracket_cell.learned.hands.mediapipe.hands import (
    FETCH,
    INDEX_BASE,
    INDEX_TIP,
    LITTLE_BASE,
    MIDDLE_BASE,
    MOST_HANDS,
    ON_THE_BENCH,
    RING_BASE,
    THUMB_TIP,
    WRIST,
    MediaPipeHands,
    folder_in_use,
    model_folder,
    network_file,
)
from bracket_cell.learned.hands.mediapipe.hands import Landmarks as Hand
from bracket_cell.learned.hands.mediapipe.palms import LEAST_SCORE, PLAIN, Roi, Tint
from bracket_cell.learned.hands.model import NEAR_PX, SURE, SlimReader, slim_files
from bracket_cell.learned.hands.reading import Reading, RegionReader, over_table
from bracket_cell.learned.hands.regions import Image
from bracket_cell.learned.hands.tracking import HandTracks
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

KNUCKLES = (INDEX_BASE, MIDDLE_BASE, RING_BASE, LITTLE_BASE)
# What the bench calls palm, wrist and edges, by the simulator's human hand. Its wrist lies behind the landmark, where
# the forearm begins. Shares of the way from wrist to knuckles, and of that between the outer knuckles:
PALM_AHEAD, WRIST_BEHIND, HALF_BREADTH = 0.42, 0.34, 0.62
PALM_TO_WRIST_M = 0.063
USUAL_M, BELIEVED = 0.10, 0.25  # height over the table, and how much of its difference from that a hand's size proves:
# hands differ in size by a tenth, as much as 14 cm of height, and work within some 8 cm of the usual height
BOX_MARGIN = 0.12  # of the hand's extent
UNKNOWN = 0.5  # whether a hand acts, by MediaPipe
# The square about a hand, by the small networks' points: its middle ahead of the wrist and its side, in lengths from
# wrist to palm.
ROI_AHEAD, ROI_SIDE = 1.45, 4.6


def bench_points(points: Array) -> dict[str, Array]:
    """The points of a hand that the bench knows by name, of its landmarks (21, 2)."""
    wrist, ahead = points[WRIST], points[list(KNUCKLES)].mean(axis=0) - points[WRIST]
    palm, aside = wrist + PALM_AHEAD * ahead, HALF_BREADTH * (points[INDEX_BASE] - points[LITTLE_BASE])
    thumb, index = points[THUMB_TIP], points[INDEX_TIP]
    return {
        "palm": palm,
        "pinch": (thumb + index) / 2,
        "thumb": thumb,
        "index": index,
        "wrist": wrist - WRIST_BEHIND * ahead,
        "radial": palm + aside,
        "ulnar": palm - aside,
    }


def mediapipe_files(weights: Path | None, folder: Path) -> dict[str, Path]:
    """MediaPipe's networks in the user's cache, or beside `weights` where they are there; the small tracker's."""
    fetched = model_folder() if weights is None else folder_in_use(weights)
    landmark, palm = (network_file(fetched, network, ON_THE_BENCH) for network in ("landmark", "palm"))
    slim = slim_files(None, folder)
    return {"hands": landmark, "hands.palm": palm, "hands.closer": slim.pop("hands"), **slim}


def mediapipe_tracker(bench: Bench, product: Product, files: Mapping[str, Path]) -> HandTracks:
    """A tracker with the networks of `mediapipe_files`.

    Raises:
        ModelError: they were not fetched yet, or the small tracker's weights cannot be used.
    """
    slim = SlimReader(bench.overhead, tuple(product.parts), files["hands.closer"])
    return HandTracks(bench, MediaPipeReader(bench.overhead, mediapipe_hands(files), slim), slim.palm_length)


def mediapipe_hands(
    files: Mapping[str, Path],
    most_hands: int = MOST_HANDS,
    least_score: float = LEAST_SCORE,
    tints: Sequence[Tint] = (PLAIN,),
) -> MediaPipeHands:
    """MediaPipe's networks, of `mediapipe_files`.

    Raises:
        ModelError: they were not fetched yet.
    """
    try:
        return MediaPipeHands(files["hands"].parent, ON_THE_BENCH, most_hands, least_score, tints)
    except ModelError as error:
        raise ModelError(f"MediaPipe's networks are not shipped; fetch them once with: {FETCH} ({error})") from None


class MediaPipeReader:
    """Reads the hands of a stream of images (HandReader).

    Args:
        closer: tells heights, sizes and what is held; without it, heights are by size alone.
    """

    def __init__(self, setup: CameraSetup, hands: MediaPipeHands, closer: RegionReader | None = None) -> None:
        self._setup, self._hands, self._closer = setup, hands, closer

    def read(self, image: Image, expected_px: Sequence[Array] = ()) -> list[Reading]:
        """All hands in the next RGB image; where none is expected, it stands alone, whatever came before it."""
        hands = self._hands.frame(image) if len(expected_px) else self._hands.picture(image)
        found = [self._reading(hand) for hand in hands]
        return found if self._closer is None else [completed(reading, self._closer, image) for reading in found]

    def read_at(self, image: Image, where: Reading) -> Reading | None:
        """What MediaPipe sees of a hand that another reader saw, however little it believes it; None of no size."""
        ahead = where.points_px["palm"] - where.points_px["wrist"]
        length_px = float(np.linalg.norm(ahead))
        turn_rad = math.atan2(ahead[0], -ahead[1])
        square = Roi(where.points_px["wrist"] + ROI_AHEAD * ahead, ROI_SIDE * length_px, turn_rad)
        return self._reading(self._hands.landmarks(image, square)) if length_px > 0 else None

    def _reading(self, hand: Hand) -> Reading:
        points = hand.points_px
        height = self._height_m(hand)
        low, high = points.min(axis=0), points.max(axis=0)
        margin = BOX_MARGIN * (high - low)
        left, top, right, bottom = (float(value) for value in (*(low - margin), *(high + margin)))
        return Reading(
            confidence=hand.presence,
            left=hand.left,
            acting=UNKNOWN,
            points_px=bench_points(points),
            box_px=(left, top, right, bottom),
            heights_m=(height, height),
        )

    def _height_m(self, hand: Hand) -> float:
        """Over the table, from the size of the palm: some of its lengths in metres against those in the image."""
        bones = [(WRIST, INDEX_BASE), (WRIST, MIDDLE_BASE), (WRIST, LITTLE_BASE), (INDEX_BASE, LITTLE_BASE)]
        metres = sum(float(np.linalg.norm(hand.world_m[a, :2] - hand.world_m[b, :2])) for a, b in bones)
        pixels = sum(float(np.linalg.norm(hand.points_px[a] - hand.points_px[b])) for a, b in bones)
        depth_m = self._setup.focal_px * metres / max(pixels, 1e-6)
        by_size = self._setup.mount.position_m[2] - depth_m
        return over_table(USUAL_M + BELIEVED * (by_size - USUAL_M))


def completed(found: Reading, closer: RegionReader, image: Image) -> Reading:
    """A hand with what a closer look at it tells; as it was where that sees none."""
    for seen in closer.read_at(image, [found.centre_px]):
        if float(np.linalg.norm(seen.centre_px - found.centre_px)) < NEAR_PX:
            held = {"held": seen.points_px["held"]} if "held" in seen.points_px else {}
            points = {**found.points_px, **held}
            hand = replace(found, points_px=points, heights_m=seen.heights_m, held_part=seen.held_part, size=seen.size)
            return replace(hand, acting=seen.acting) if seen.confidence >= SURE else hand
    return found
