"""Segments from folders of training data as arrays: `cell data actions`, or `cell data --from LOG` of real runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.errors import InputError, Place, Problem
from cell.interfaces.hand_window import last_at_hole
from cell.interfaces.perception import SEGMENT_FRAMES
from cell.interfaces.pose import Array
from learned.actions.classes import Classes
from learned.actions.segments import CROP_PX, Floats, Images, SegmentReader

KEPT_PX = 80  # side of what is kept of a window: what networks see, and room to shift it


@dataclass(frozen=True)
class Segments:
    """n labelled segments.

    Attributes:
        tips_m, palms_m: (n, SEGMENT_FRAMES, 2) on the bench; NaN where no hand was seen.
        windows: (windows, KEPT_PX, KEPT_PX, 3) uint8; the first one is black.
        crops: (n, 2) which window is the hand's, and that of the last moment at a hole; 0 for none.
        classes: (n,) by number.
        released: (n,) whether the fingers of an assembly have opened.
        guarded: (n,) whether a change of class is so near that nobody could name it.
        logs: (n,) the recording.
        sha256: of all of it.
    """

    tips_m: Array
    palms_m: Array
    windows: Images
    crops: NDArray[np.int64]
    classes: NDArray[np.int64]
    released: NDArray[np.bool_]
    guarded: NDArray[np.bool_]
    logs: tuple[str, ...]
    sha256: str

    def __len__(self) -> int:
        return len(self.classes)


@dataclass(frozen=True)
class Variation:
    """By how much training varies what a tracker and a camera tell.

    Attributes:
        bias_m, noise_m: standard deviation of the track, of a whole segment and of each frame.
        scale: of the track about the bracket's middle, as of a hand whose height is not known.
        lost: share of frames in which the hand is not seen.
        shift_px: of the crops, in window pixels.
        gain: of brightness and of each colour channel.
        blank: share of segments whose crops are black.
    """

    bias_m: float = 0.005
    noise_m: float = 0.0025
    scale: float = 0.015
    lost: float = 0.03
    shift_px: float = 2.5
    gain: float = 0.12
    blank: float = 0.03


def load_segments(folders: Sequence[Path], classes: Classes) -> Segments:
    """Read folders; rows of recorded runs count where what was detected was confirmed by a hole, or names no part.

    Raises:
        InputError: there are none, or a line is wrong.
    """
    rows = [row for folder in folders for row in _rows(folder, classes)]
    if not rows:
        raise InputError(f"{', '.join(map(str, folders))}: no labelled segments")
    windows, index = [np.zeros((KEPT_PX, KEPT_PX, 3), np.uint8)], {}
    digest = hashlib.sha256()
    crops = np.zeros((len(rows), 2), np.int64)
    for number, row in enumerate(rows):
        for column, file in enumerate(row.files):
            if file is not None and file not in index:
                index[file] = len(windows)
                windows.append(_kept(file))
                digest.update(windows[-1].tobytes())
            crops[number, column] = 0 if file is None else index[file]
        digest.update(row.line.encode())
    return Segments(
        tips_m=np.array([row.tips_m for row in rows]),
        palms_m=np.array([row.palms_m for row in rows]),
        windows=np.array(windows),
        crops=crops,
        classes=np.array([row.number for row in rows]),
        released=np.array([row.released for row in rows]),
        guarded=np.array([row.guarded for row in rows]),
        logs=tuple(row.log for row in rows),
        sha256=digest.hexdigest(),
    )


def inputs_of(
    segments: Segments,
    chosen: NDArray[np.int64],
    reader: SegmentReader,
    rng: np.random.Generator | None = None,
    variation: Variation | None = None,
) -> tuple[Floats, Images]:
    """Tracks (k, features, frames) and crops (k, 2, CROP_PX, CROP_PX, 3) of k segments, varied by the rng, if any."""
    tracks, crops = [], np.zeros((len(chosen), 2, CROP_PX, CROP_PX, 3), np.uint8)
    variation = variation or Variation()
    for row, number in enumerate(chosen):
        tips, palms = segments.tips_m[number], segments.palms_m[number]
        if rng is not None:
            tips, palms = _varied_track(tips, palms, reader, rng, variation)
        tracks.append(reader.track(tips, palms, last_at_hole(tips, reader.holes_m)))
        if rng is not None and rng.random() < variation.blank:
            continue
        gain = None if rng is None else np.exp(rng.normal(0, variation.gain) + rng.normal(0, variation.gain / 2, 3))
        for column in (0, 1):
            if window := int(segments.crops[number, column]):
                crops[row, column] = _crop(segments.windows[window], gain, rng, variation)
    return np.array(tracks), crops


@dataclass(frozen=True)
class _Row:
    """A labelled line of segments.jsonl."""

    log: str
    line: str
    number: int
    released: bool
    guarded: bool
    files: tuple[Path | None, Path | None]
    tips_m: Array
    palms_m: Array


def _rows(folder: Path, classes: Classes) -> Iterator[_Row]:
    path = folder / "segments.jsonl"
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not lines or _parsed(path, 1, lines[0]).get("format") != "cell.segments":
        problem = Problem(Place(path, 1), "no file of segments", "make one with: cell data actions, cell data --from")
        raise InputError(problem)
    for at, line in enumerate(lines[1:], start=2):
        row = _parsed(path, at, line)
        try:
            if (label := _label(row)) is not None:
                yield _row(folder, row, line, label, classes)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(Problem(Place(path, at), f"no segment of this product: {error}")) from error


def _label(row: dict[str, Any]) -> dict[str, Any] | None:
    """The truth, or what was detected and confirmed; None where nobody knows."""
    if "truth" in row:
        truth: dict[str, Any] = row["truth"]
        return truth
    detected: dict[str, Any] = row["detected"]
    if detected["kind"] != "assembly":
        return detected
    confirmed = row["confirmed"]
    return {**detected, "released": detected["finished"]} if confirmed and confirmed["agrees"] else None


def _row(folder: Path, row: dict[str, Any], line: str, label: dict[str, Any], classes: Classes) -> _Row:
    hands = row["hands"]
    if len(hands) != SEGMENT_FRAMES:
        raise ValueError(f"{len(hands)} frames; {SEGMENT_FRAMES} are needed")
    nowhere = [float("nan")] * 2
    files = tuple(folder / row[key] if row.get(key) else None for key in ("hand_crop", "hole_crop"))
    return _Row(
        log=row["log"],
        line=line,
        number=classes.number(label["kind"], label.get("part"), label.get("position")),
        released=bool(label.get("released")),
        guarded=bool(row.get("guarded")),
        files=(files[0], files[1]),
        tips_m=np.array([nowhere if hand is None else hand["fingertips_m"] for hand in hands], float),
        palms_m=np.array([nowhere if hand is None else hand["palm_m"] for hand in hands], float),
    )


def _parsed(path: Path, at: int, line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except ValueError as error:
        raise InputError(Problem(Place(path, at), f"no JSON: {error}")) from error
    if not isinstance(found, dict):
        raise InputError(Problem(Place(path, at), "no object"))
    return found


def _kept(file: Path) -> Images:
    """The middle of a window, in RGB."""
    image = cv2.imread(str(file))
    if image is None:
        raise InputError(f"{file}: no image")
    window = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    if window.shape[0] != window.shape[1]:
        raise InputError(f"{file}: {window.shape[1]} x {window.shape[0]} pixels; a square is needed")
    side = round(CROP_PX * 1.5)
    if window.shape[0] != side:  # another camera's scale
        window = cv2.resize(window, (side, side), interpolation=cv2.INTER_AREA)
    edge = (side - KEPT_PX) // 2
    return np.asarray(window[edge : edge + KEPT_PX, edge : edge + KEPT_PX], np.uint8)


def _varied_track(
    tips: Array, palms: Array, reader: SegmentReader, rng: np.random.Generator, variation: Variation
) -> tuple[Array, Array]:
    """As a tracker and a camera that hangs elsewhere could have told it."""
    middle_m = reader.holes_m.mean(axis=0)
    scale, bias = rng.normal(1.0, variation.scale), rng.normal(0.0, variation.bias_m, 2)
    lost = rng.random(len(tips)) < variation.lost
    varied = []
    for places in (tips, palms):
        moved = (places - middle_m) * scale + middle_m + bias + rng.normal(0.0, variation.noise_m, places.shape)
        moved[lost] = np.nan
        varied.append(moved)
    return varied[0], varied[1]


def _crop(
    window: Images, gain: Array | None, rng: np.random.Generator | None, variation: Variation
) -> Images | NDArray[np.float64]:
    edge = (KEPT_PX - CROP_PX) // 2
    if rng is None or gain is None:
        return window[edge : edge + CROP_PX, edge : edge + CROP_PX]
    down, right = (int(value) for value in np.clip(rng.normal(edge, variation.shift_px, 2).round(), 0, 2 * edge))
    crop = window[down : down + CROP_PX, right : right + CROP_PX] * gain
    return np.clip(crop, 0, 255)
