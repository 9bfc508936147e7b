"""Hands of photographs put onto the bench, as rows that the tracker learns from; MediaPipe is the teacher.

A hand is found by MediaPipe, cut out (GrabCut, Rother 2004), and laid onto what lay behind it or onto
frames of the bench, as large as hands are there. It gets an arm to the image's edge, mostly in a sleeve.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.hands.mediapipe.hands import MediaPipeHands
from bracket_cell.learned.hands.mediapipe.tracker import PALM_TO_WRIST_M, bench_points
from bracket_cell.learned.hands.records import HandRow
from bracket_cell.learned.records import read_image
from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.pose import Array
from bracket_lab.pictures.handless import Compositor
from bracket_lab.pictures.origins import Photograph
from bracket_lab.pictures.worn import CutHand, dressed

FINGERS = ((0, 1, 2, 3, 4), (0, 5, 6, 7, 8), (5, 9, 10, 11, 12), (9, 13, 14, 15, 16), (0, 17, 18, 19, 20))
PALM_OUTLINE = (0, 1, 5, 9, 13, 17)
SURE, LIKELY = 0.16, 0.42  # width of a finger that is surely hand, and of what may be, by the length from palm to wrist
WORKED_PX = 64.0  # from palm to wrist where hands are cut out; larger photographs are made smaller
ROUNDS = 4  # of GrabCut
HEIGHTS_M, SIZES = (0.0, 0.3), 0.12  # of palms; standard deviation of the logarithm of a hand's size
ODD_SIZES, ODD_SHARE = (0.7, 1.7), 0.3  # of hands nearer to the camera or farther away than at the usual bench
TURN_RAD, ANY_TURN = 1.2, 0.25  # fingers point away from the person, give or take; share that point anywhere
INSIDE_PX = 40  # of a hand's middle, from the image's edge
BARE_SHARE = 0.25  # of hands that stay before what lay behind them
GAIN = 0.2  # of the light, channel by channel
SLEEVE = (0.75, 1.15)  # half its width, by the length from palm to wrist
BARE_ARMS = 0.4  # share of arms without a sleeve: they have the hand's colour


def cut_hands(image: Image, hands: MediaPipeHands) -> Iterator[CutHand]:
    """Each hand that MediaPipe finds in a photograph, cut out; what lies behind it shows none of them."""
    found = hands.picture(image)
    for hand in found:
        points = bench_points(hand.points_px)
        length_px = float(np.linalg.norm(points["palm"] - points["wrist"]))
        scale = min(1.0, WORKED_PX / length_px)
        seen = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        mask = _cut(seen, hand.points_px * scale, length_px * scale)
        around = (mask > 0.05).astype(np.uint8)
        for other in (other for other in found if other is not hand):
            outline = cv2.convexHull((other.points_px * scale).astype(np.int32))
            cv2.fillConvexPoly(around, outline, 1)
            cv2.polylines(around, [outline], True, 1, round(LIKELY * length_px * scale))
        around = cv2.dilate(around, np.ones((5, 5), np.uint8)).astype(np.uint8)
        behind = np.asarray(cv2.inpaint(np.ascontiguousarray(seen), around, 3, cv2.INPAINT_TELEA), np.uint8)
        yield CutHand(seen, behind, mask, hand.points_px * scale, hand.left > 0.5)


def _cut(image: Image, points: Array, length_px: float) -> NDArray[np.float32]:
    """(height, width) How much of each pixel is hand."""
    sure, likely = (np.zeros(image.shape[:2], np.uint8) for _ in range(2))
    for drawn, width in ((sure, SURE), (likely, LIKELY)):
        thick = max(1, round(width * length_px))
        for chain in FINGERS:
            for one, other in pairwise(chain):
                cv2.line(drawn, _pixel(points[one]), _pixel(points[other]), 1, thick)
        cv2.fillConvexPoly(drawn, cv2.convexHull(points[list(PALM_OUTLINE)].astype(np.int32)), 1)
        wrist, beyond = bench_points(points)["wrist"], points[0]
        cv2.line(drawn, _pixel(beyond), _pixel(wrist), 1, max(1, round((width + 0.5) * length_px)))
    marks = np.where(sure > 0, cv2.GC_FGD, np.where(likely > 0, cv2.GC_PR_FGD, cv2.GC_BGD)).astype(np.uint8)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    try:
        cv2.grabCut(np.ascontiguousarray(image[..., ::-1]), marks, (0, 0, 0, 0), *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    except cv2.error:  # all of it is hand, or none
        marks = np.where(sure > 0, cv2.GC_FGD, cv2.GC_BGD).astype(np.uint8)
    hand = np.isin(marks, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(hand, (0, 0), 0.8), np.float32)


def _pixel(point: Array) -> tuple[int, int]:
    return round(float(point[0])), round(float(point[1]))


def compose(
    hand: CutHand, onto: tuple[Image, Sequence[HandRow]] | None, setup: CameraSetup, rng: np.random.Generator
) -> tuple[Image, list[HandRow]]:
    """A hand on the bench, and all hands that are seen there.

    Args:
        onto: a frame and its hands; None for what lay behind the hand.
    """
    size = setup.width_px, setup.height_px
    height_m, larger = rng.uniform(*HEIGHTS_M), math.exp(rng.normal(0.0, SIZES))
    if rng.random() < ODD_SHARE:
        larger = math.exp(rng.uniform(*np.log(ODD_SIZES)))
    length_px = setup.focal_px * PALM_TO_WRIST_M * larger / (setup.mount.position_m[2] - height_m)
    turn = -math.pi / 2 + (rng.uniform(-math.pi, math.pi) if rng.random() < ANY_TURN else rng.normal(0.0, TURN_RAD / 2))
    move = _onto(hand, length_px, turn, size, rng, [] if onto is None else [row.box_px for row in onto[1]])
    scale = float(np.linalg.norm(move[:, 0]))
    gains = np.exp(rng.normal(0.0, GAIN, 3) * 0.4 + rng.normal(0.0, GAIN)).astype(np.float32)
    drawn = cv2.warpAffine(_soft(hand.image, scale), move, size).astype(np.float32)
    mask = cv2.warpAffine(_soft(hand.mask, scale), move, size)[..., np.newaxis]
    if onto is None:
        behind = cv2.warpAffine(_soft(hand.behind, scale), move, size, borderMode=cv2.BORDER_REFLECT)
        ground = behind.astype(np.float32) * gains
    else:
        ground = onto[0].astype(np.float32)
    points = hand.points_px @ move[:, :2].T + move[:, 2]
    sleeve = _sleeve(points, length_px, size, rng)
    skin = np.median(hand.image[hand.mask > hand.mask.max() / 2], axis=0) * gains
    colour = skin if rng.random() < BARE_ARMS else rng.uniform(20.0, 220.0, 3)
    ground = ground * (1 - sleeve[..., :1]) + colour * sleeve[..., 1:] * sleeve[..., :1]
    image = np.clip(ground * (1 - mask) + drawn * gains * mask, 0, 255).astype(np.uint8)
    covered = np.maximum(mask, sleeve[..., :1])
    return image, [_row(points, hand.left, size), *(_under(row, covered) for row in (() if onto is None else onto[1]))]


def _soft(picture: NDArray[Any], scale: float) -> NDArray[Any]:
    """As it may be made smaller without steps."""
    return picture if scale >= 1 else np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.35 / scale), picture.dtype)


def _onto(
    hand: CutHand,
    length_px: float,
    turn: float,
    size: tuple[int, int],
    rng: np.random.Generator,
    taken: Sequence[tuple[float, ...]],
) -> Array:
    """(2, 3) From the photograph to the image: so long from palm to wrist, fingers that way, on no other hand."""
    named = bench_points(hand.points_px)
    ahead = named["palm"] - named["wrist"]
    scale = length_px / float(np.linalg.norm(ahead))
    by = turn - math.atan2(ahead[1], ahead[0])
    turning = scale * np.array([[math.cos(by), -math.sin(by)], [math.sin(by), math.cos(by)]])
    middle = turning @ named["palm"]
    for _ in range(20):
        place = rng.uniform((INSIDE_PX, INSIDE_PX), (size[0] - INSIDE_PX, size[1] - INSIDE_PX))
        away = [np.maximum(np.array(box[:2]) - place, place - np.array(box[2:])).max() for box in taken]
        if min(away, default=math.inf) > 2 * length_px:
            break
    return np.column_stack([turning, place - middle])


def _sleeve(points: Array, length_px: float, size: tuple[int, int], rng: np.random.Generator) -> Any:
    """(height, width, 2) Share and light of a sleeve from the wrist to beyond the image's edge."""
    named = bench_points(points)
    back = (named["wrist"] - named["palm"]) / max(1e-6, float(np.linalg.norm(named["wrist"] - named["palm"])))
    aside = np.array([-back[1], back[0]]) * rng.uniform(*SLEEVE) * length_px / 2
    first, last = named["wrist"] - 0.25 * length_px * back, named["wrist"] + 700.0 * back
    outline = np.array([first - aside, first + aside, last + 1.3 * aside, last - 1.3 * aside])
    mask = np.zeros(size[::-1], np.float32)
    cv2.fillConvexPoly(mask, outline.round().astype(np.int32), 1.0)
    line, column = np.mgrid[0 : size[1], 0 : size[0]]
    across = ((column - first[0]) * aside[0] + (line - first[1]) * aside[1]) / float(aside @ aside)
    return np.stack([cv2.GaussianBlur(mask, (0, 0), 1.0), 1.0 - 0.35 * np.clip(across, -1.3, 1.3) ** 2], axis=2)


def _under(row: HandRow, covered: NDArray[Any]) -> HandRow:
    """A hand of the frame, as much as the new one leaves of it."""
    left, top, right, bottom = (max(0, round(value)) for value in row.box_px)
    share = float(covered[top : bottom + 1, left : right + 1].mean()) if covered[top:, left:].size else 0.0
    return row.model_copy(update={"visible": row.visible * (1 - share)})


def _row(points: Array, left: bool, size: tuple[int, int]) -> HandRow:
    named = bench_points(points)
    low, high = points.min(axis=0), points.max(axis=0)
    wider = 0.06 * (high - low)
    left_px, top = np.maximum(low - wider, 0.0)
    right, bottom = np.minimum(high + wider, np.array(size, np.float64))
    return HandRow(
        side="left" if left else "right",
        box_px=(float(left_px), float(top), float(right), float(bottom)),
        points_px={name: (float(x), float(y)) for name, (x, y) in named.items()},
        across=True,
    )


def write_photographs(photographs: Sequence[Photograph], compositor: Compositor) -> list[Photograph]:
    """Rows of hands.jsonl; returns the photographs that show a hand."""
    seen = []
    for number, photograph in enumerate(photographs):
        rng = np.random.default_rng([compositor.seed, number])
        found = list(cut_hands(read_image(photograph.file), compositor.teacher))
        seen += [photograph] * bool(found)
        for which, hand in enumerate(found):
            for copy in range(compositor.copies):
                frame = compositor.frame(1 - BARE_SHARE, rng)
                under = None if frame is None else (read_image(frame.file), frame.row.hands)
                named = bench_points(hand.points_px)
                worn = dressed(hand, named["palm"], named["pinch"], rng)
                image, rows = compose(worn, under, compositor.setup, rng)
                compositor.write(f"photograph-{number:05d}", f"-{which}-{copy}", photograph, image, rows)
    return seen
