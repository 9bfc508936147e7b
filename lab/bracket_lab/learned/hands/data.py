"""Training data of the small tracker: frames of `cell lab data hands` or `cell label` as arrays."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.records import FrameRow, HandRow
from bracket_cell.learned.hands.regions import FINDER_PX, PATCH_PX, POINTS, Image, Regions
from bracket_cell.learned.records import one_of, read_image, read_rows
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.pose import Array
from bracket_lab.pictures.origins import by_source

ROWS = "hands.jsonl"
LEAST_VISIBLE = 0.25  # of a hand that is to be found; less is neither right nor wrong
EDGE_PX = 4.0  # a hand whose centre is nearer to the image's edge is neither, too
NO_HAND_WITHIN = 0.42  # of a region: what is so far from the middle of every hand is shown as no hand
NO_HANDS, WITHOUT_HANDS = 2, 5  # places that are shown as none, at most: of a frame with hands, and of one without
JITTER = 0.12  # of a region, standard deviation: what looks like a hand may be seen in any part of it
NOT_KNOWN = -1  # number of a part that is held, where nobody knows
FOREARM = (0.8, 4.0)  # of the length from palm to wrist, beyond the wrist: sleeves look like hands


@dataclass(frozen=True, eq=False)
class HandData:
    """Frames for the finder and patches for the reader.

    Attributes:
        small: (frames, 120, 160, 3) whole images.
        centres: (hands, 3): frame, and centre of a hand as shares of the image.
        unsure: (hands, 3) the same of hands that may be found or not.
        patches: (n, 192, 192, 3) about hands and empty places.
        frames: (n,) number of the image that each is of.
        centres_px: (n, 2) of each, in the image.
        points: (n, 8, 2) shares of the middle region of a patch; not a number where there is none.
        boxes: (n, 4) shares: left, top, right, bottom.
        facts: (n, 3) 0 or 1: there is a hand, a left one (not a number where unknown), the one that works.
        heights_m: (n, 2) of palm and pinch; not a number where unknown, as `log_angles`.
        log_angles: (n,) apparent size: logarithm of the length from palm to wrist over the distance from the camera.
        held: (n,) 0 for nothing, 1 + number of the type, or NOT_KNOWN.
        palm_lengths_m: (hands,) from palm to wrist.
        regions: of the camera.
        photographs: how many under which licence, by source.
    """

    small: NDArray[np.uint8]
    centres: Array
    unsure: Array
    patches: NDArray[np.uint8]
    frames: NDArray[np.int64]
    centres_px: Array
    points: NDArray[np.float32]
    boxes: NDArray[np.float32]
    facts: NDArray[np.float32]
    heights_m: NDArray[np.float32]
    log_angles: NDArray[np.float32]
    held: NDArray[np.int64]
    palm_lengths_m: Array
    regions: Regions
    sha256: str
    photographs: dict[str, str]


class _Sample(NamedTuple):
    """One row of the reader's arrays but for its patch, each under its name in HandData."""

    frames: np.int64
    centres_px: Array
    points: NDArray[np.float32]
    boxes: NDArray[np.float32]
    facts: NDArray[np.float32]
    heights_m: NDArray[np.float32]
    log_angles: np.float32
    held: np.int64


@dataclass(frozen=True)
class LabelledFrame:
    """A row and where its image is."""

    row: FrameRow
    file: Path


def frames_of(folder: Path, types: Sequence[str] | None = None) -> list[LabelledFrame]:
    """All rows of a folder of `cell lab data hands` or `cell label`.

    Args:
        types: that may be held; any where None.

    Raises:
        InputError: there is no such file, it holds no frames, or rows are wrong; with file and line.
    """

    def made(row: FrameRow) -> LabelledFrame:
        for number, hand in enumerate(row.hands):
            left, top, right, bottom = hand.box_px
            if right <= left or bottom <= top:
                raise ValueError(f"hands.{number}.box_px: must be left, top, right, bottom")
            for name in (*hand.points_px, *hand.points_m):
                one_of(f"hands.{number}: no point", name, POINTS)
            if hand.held_part is not None and types is not None:
                one_of(f"hands.{number}: no part", hand.held_part, tuple(types))
        return LabelledFrame(row, folder / row.file)

    how = "make it with: cell label DIR, or cell lab data hands --out DIR"
    found = read_rows(folder / ROWS, FrameRow, made, header="cell.hands", how=how)
    if not found:
        raise InputError(f"{folder / ROWS}: holds no frames")
    return found


def load_hands(
    folders: Sequence[Path], setup: CameraSetup, types: Sequence[str], seed: int, apart: Collection[str] = ()
) -> HandData:
    """Read folders.

    Args:
        setup: of the camera that took the frames.
        types: of parts, in the order of the product.
        apart: origins of frames that are left out, for the scores.

    Raises:
        InputError: one is no such folder, is damaged, or was made for another camera or product.
    """
    regions, rng = Regions.of(setup), np.random.default_rng([seed, 5])
    view = View(setup.model, setup.mount.pose)
    rows = [
        labelled_frame
        for folder in folders
        for labelled_frame in frames_of(folder, types)
        if labelled_frame.row.origin not in apart
    ]
    small, patches = _room(rows)
    centres: list[list[float]] = []
    unsure: list[list[float]] = []
    samples: list[_Sample] = []
    lengths_m: list[float] = []
    for frame, (row, file) in enumerate((labelled_frame.row, labelled_frame.file) for labelled_frame in rows):
        image = _taken_by(setup, file)
        small[frame] = regions.small(image)
        hands, doubtful = _hands_of(row, setup)
        for found, those in ((centres, [centre for centre, _ in hands]), (unsure, doubtful)):
            found += [[frame, *((centre + 0.5) / regions.size_px)] for centre in those]
        lengths_m += [hand.palm_length_m for _, hand in hands if not math.isnan(hand.palm_length_m)]
        for centre, hand in [*hands, *((place, None) for place in _none(regions, row, rng))]:
            patches[len(samples)] = regions.cut(image, centre, PATCH_PX)
            samples.append(_sample(regions, view, frame, centre, hand, types))
    columns = {name: np.stack([getattr(sample, name) for sample in samples]) for name in _Sample._fields}
    return HandData(
        small=small,
        patches=patches[: len(samples)],
        centres=np.array(centres).reshape(-1, 3),
        unsure=np.array(unsure).reshape(-1, 3),
        palm_lengths_m=np.array(lengths_m),
        regions=regions,
        photographs=_photographs(rows),
        sha256=hashlib.sha256(b"".join((folder / ROWS).read_bytes() for folder in folders)).hexdigest(),
        **columns,
    )


def _photographs(frames: Sequence[LabelledFrame]) -> dict[str, str]:
    each = {(frame.file.parent, frame.row.log): (frame.row.source, frame.row.licence) for frame in frames}
    return by_source(origin for origin in each.values() if origin[0])


def _room(rows: Sequence[LabelledFrame]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Arrays for all small images, and for as many patches as there may be; what is not written takes no memory.

    They are gigabytes: to collect patches in a list first takes twice as much.
    """
    (width, height), most = FINDER_PX, sum(len(row.row.hands) + _most_empty(row.row) for row in rows)
    return np.empty((len(rows), height, width, 3), np.uint8), np.empty((most, PATCH_PX, PATCH_PX, 3), np.uint8)


def _hands_of(row: FrameRow, setup: CameraSetup) -> tuple[list[tuple[Array, HandRow]], list[Array]]:
    """The hands of a frame that are to be found, each with its centre, and the centres of those that need not be."""
    sure, unsure = [], []
    for hand in row.hands:
        centre = hand.centre_px
        if hand.visible >= LEAST_VISIBLE and _inside(centre, setup, EDGE_PX):
            sure.append((centre, hand))
        else:
            unsure.append(centre)
    return sure, unsure


def _taken_by(setup: CameraSetup, path: Path) -> Image:
    """An image of the camera.

    Raises:
        InputError: it is missing or damaged, or has another size than the camera's.
    """
    image = read_image(path)
    if image.shape[:2] != (setup.height_px, setup.width_px):
        raise InputError(f"{path}: must be {setup.width_px} x {setup.height_px} pixels, as the camera's are")
    return image


def _sample(
    regions: Regions, view: View, frame: int, centre: Array, hand: HandRow | None, types: Sequence[str]
) -> _Sample:
    """One row: a hand, or, with None, a place without one."""
    points, box = np.full((len(POINTS), 2), np.nan, np.float32), np.zeros(4, np.float32)
    if hand is None:
        no_facts, no_heights = np.zeros(3, np.float32), np.zeros(2, np.float32)
        no_angle, nothing_held = np.float32(0), np.int64(0)
        return _Sample(
            np.int64(frame), centre, points, box, no_facts, no_heights, log_angles=no_angle, held=nothing_held
        )
    for index, name in enumerate(POINTS):
        if name in hand.points_px:
            points[index] = regions.inside(np.array(hand.points_px[name]), centre)
    box[:] = regions.inside(np.array(hand.box_px).reshape(2, 2), centre).reshape(4)
    heights_m = [hand.points_m[name][2] if name in hand.points_m else math.nan for name in ("palm", "pinch")]
    log_angle = math.nan
    if hand.across and {"palm", "wrist"} <= hand.points_px.keys():
        log_angle = math.log(math.dist(hand.points_px["palm"], hand.points_px["wrist"]) / regions.focal_px)
    if not math.isnan(hand.palm_length_m):
        log_angle = math.log(hand.palm_length_m / float(view.depths(np.array([hand.points_m["palm"]]))[0]))
    left = math.nan if hand.side is None else float(hand.side == "left")
    held = 0 if hand.held_part is None else 1 + list(types).index(hand.held_part)
    return _Sample(
        frames=np.int64(frame),
        centres_px=centre,
        points=points,
        boxes=box,
        facts=np.array([1.0, left, hand.acting], np.float32),
        heights_m=np.array(heights_m, np.float32),
        log_angles=np.float32(log_angle),
        held=np.int64(held if hand.known else NOT_KNOWN),
    )


def _inside(point: Array, setup: CameraSetup, margin_px: float) -> Any:
    size = np.array([setup.width_px, setup.height_px])
    return ((point >= margin_px) & (point < size - margin_px)).all()


def _none(regions: Regions, row: FrameRow, rng: np.random.Generator) -> list[Array]:
    """Some places of an image without a hand: anywhere, and what looks most like one.

    That is the robot's gripper, the shadows of hands and of the gripper, and forearms.
    """
    near_px = NO_HAND_WITHIN * regions.side_px
    centres = [hand.centre_px for hand in row.hands]
    tool = () if row.tool_px is None else (np.array(row.tool_px),)
    arms = [hand for hand in row.hands if {"palm", "wrist"} <= hand.points_px.keys()]
    alike = [*tool, *map(np.array, row.decoys_px), *(_on_forearm(hand, rng) for hand in arms)]
    most = _most_empty(row)
    places = [rng.uniform((0.0, 0.0), regions.size_px) for _ in range(most - 1)]
    places += [place + rng.normal(0.0, JITTER * regions.side_px, 2) for place in alike]
    empty = [
        place
        for place in places
        if ((place >= 0) & (place < regions.size_px)).all()
        and all(np.abs(place - centre).max() > near_px for centre in centres)
    ]
    return [empty[index] for index in rng.permutation(len(empty))[:most]]


def _most_empty(row: FrameRow) -> int:
    return NO_HANDS if row.hands else WITHOUT_HANDS


def _on_forearm(hand: HandRow, rng: np.random.Generator) -> Array:
    palm, wrist = (np.array(hand.points_px[name]) for name in ("palm", "wrist"))
    point: Array = wrist + rng.uniform(*FOREARM) * (wrist - palm)
    return point
