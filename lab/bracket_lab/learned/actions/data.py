"""Segments from folders of training data as arrays: of `cell lab data actions`, or of recorded runs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.actions.segments import CROP_PX, TIPS, UNKNOWN_HAND, Floats, Images, SegmentReader, opening_m
from bracket_cell.learned.actions.settings import WHOLE_FRAMES, Classes
from bracket_cell.learned.records import EXPORT, SampleRow, SegmentRow, TrueAction, read_image, read_rows
from bracket_ground.errors import InputError
from bracket_ground.interfaces.hand_window import FRAME_PX, last_at_hole
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.actions.variation import KEPT_PX, OtherCamera, Variation, cut_out, varied_track

RATE_HZ = 15.0  # of the paper's camera


@dataclass(frozen=True, eq=False)
class Segments:
    """n labelled segments.

    Attributes:
        tracks_m: (n, 1 + SEGMENT_FRAMES, 6), see `points`: the hand as it was last seen before the segment, and in each
            frame; NaN if no hand was seen or the truth is unknown.
        before_s: (n,) for how long it had not been seen when the segment began.
        windows: (windows, KEPT_PX, KEPT_PX, 3) uint8; the first one is black.
        crops: (n, 2) which window is the hand's, and that of the last moment at a hole; 0 for none.
        frames: (frames, 60, 80, 3) uint8, whole frames; none where the folder has none.
        seen: (n, k) which of the frames are seen; k is 0 where there are none.
        classes: (n,) by number.
        released: (n,) whether the fingers of an assembly have opened.
        guarded: (n,) whether a change of class is so near that nobody could name it.
        logs: (n,) the recording.
        sha256: of all of it.
    """

    tracks_m: Array
    before_s: Array
    windows: Images
    crops: NDArray[np.int64]
    frames: Images
    seen: NDArray[np.int64]
    classes: NDArray[np.int64]
    released: NDArray[np.bool_]
    guarded: NDArray[np.bool_]
    logs: tuple[str, ...]
    sha256: str

    def __len__(self) -> int:
        return len(self.classes)

    def some(self, rows: NDArray[np.int64]) -> Segments:
        """The segments of these rows (m,); images are shared."""
        return replace(
            self,
            tracks_m=self.tracks_m[rows],
            before_s=self.before_s[rows],
            crops=self.crops[rows],
            seen=self.seen[rows],
            classes=self.classes[rows],
            released=self.released[rows],
            guarded=self.guarded[rows],
            logs=tuple(self.logs[row] for row in rows),
            sha256=hashlib.sha256(self.sha256.encode() + rows.tobytes()).hexdigest(),
        )

    def without(self, fold: int, folds: int) -> tuple[Segments, Segments]:
        """The segments to learn from, and those of every Nth recording, which are kept for scores."""
        logs = sorted(set(self.logs))
        apart = set(logs[fold::folds])
        inside = np.array([log in apart for log in self.logs])
        return self.some(np.flatnonzero(~inside)), self.some(np.flatnonzero(inside))


def load_segments(folders: Sequence[Path], classes: Classes, rate_hz: float = RATE_HZ) -> Segments:
    """Read folders; of recorded runs, assemblies are learned as a hole or a person tells them, and where one does.

    Args:
        rate_hz: of the camera's frames.

    Raises:
        InputError: there are none, or a line is wrong.
    """
    rows = [row for folder in folders for row in _rows(folder, classes, rate_hz)]
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
    frames, seen = _whole_frames(rows)
    return Segments(
        tracks_m=np.array([row.track_m for row in rows]),
        before_s=np.array([row.before_s for row in rows]),
        windows=np.array(windows),
        crops=crops,
        frames=frames,
        seen=seen,
        classes=np.array([row.number for row in rows]),
        released=np.array([row.released for row in rows]),
        guarded=np.array([row.guarded for row in rows]),
        logs=tuple(row.log for row in rows),
        sha256=digest.hexdigest(),
    )


def asked(
    kind: str,
    segments: Segments,
    chosen: NDArray[np.int64],
    reader: SegmentReader,
    rng: np.random.Generator | None = None,
    variation: Variation | None = None,
) -> dict[str, NDArray[Any]]:
    """What a kind of network is asked about k segments, by the names of its inputs; varied by the rng, if any.

    Raises:
        InputError: it looks at whole frames, and there are none.
    """
    if kind not in WHOLE_FRAMES:
        track, crops = inputs_of(segments, chosen, reader, rng, variation)
        return {"track": track, "crops": crops}
    if not segments.seen.size:
        raise InputError(
            f"{kind} looks at whole frames, and the data have none; make them with: cell lab data actions --frames"
        )
    frames = segments.frames[segments.seen[chosen]]
    if rng is not None:
        gains = np.exp(rng.normal(0.0, (variation or Variation()).gain, (len(chosen), 1, 1, 1, 3)))
        frames = np.clip(frames * gains, 0, 255).astype(np.uint8)
    return {"frames": frames}


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
        track = segments.tracks_m[number]
        if rng is not None:
            track = varied_track(track, reader, rng, variation)
        at_hole = last_at_hole(track[1:, TIPS], reader.holes_m)
        tracks.append(reader.track(track, float(segments.before_s[number]), at_hole))
        if rng is not None and rng.random() < variation.blank:
            continue
        camera = None if rng is None else OtherCamera.drawn(rng, variation)
        for column in (0, 1):
            if window := int(segments.crops[number, column]):
                crop = cut_out(segments.windows[window], rng, variation)
                crops[row, column] = crop if camera is None else camera.take(crop)
    return np.array(tracks), crops


@dataclass(frozen=True, eq=False)
class _Row:
    """A labelled line of segments.jsonl."""

    log: str
    line: str
    number: int
    released: bool
    guarded: bool
    files: tuple[Path | None, Path | None]
    frames: tuple[Path, ...]
    track_m: Array
    before_s: float


def _rows(folder: Path, classes: Classes, rate_hz: float) -> list[_Row]:
    """Labelled segments of a folder; those that nobody has a label for are left out."""

    def made(row: SegmentRow) -> _Row | None:
        label = _label(row)
        if label is not None:
            row.require_whole(rate_hz)
        return None if label is None else _row(folder, row, label, classes)

    found = read_rows(folder / "segments.jsonl", SegmentRow, made, header="cell.segments", how=EXPORT)
    return [row for row in found if row is not None]


def _label(row: SegmentRow) -> TrueAction | None:
    """The truth, or what was detected as the hole told it later, or a person; None if unknown.

    Whether a label agrees with what was detected does not count: a person who corrects it may leave that as it was.

    Raises:
        ValueError: there is neither.
    """
    if row.truth is not None:
        return row.truth
    detected, confirmed = row.detected, row.confirmed
    if detected is None:
        raise ValueError("neither truth nor detected is there")
    if confirmed is None:
        unsure = detected.kind == "assembly"
        return None if unsure else TrueAction(kind=detected.kind, part=detected.part, position=detected.position)
    if confirmed.part is None:  # the hole was empty: something else was done
        return None
    released = detected.finished if confirmed.released is None else confirmed.released
    return TrueAction(kind="assembly", part=confirmed.part, position=confirmed.position, released=released)


def _row(folder: Path, row: SegmentRow, label: TrueAction, classes: Classes) -> _Row:
    before = row.hand_before  # which data of older versions do not tell
    hand, hole = (folder / name if name else None for name in (row.hand_crop, row.hole_crop))
    return _Row(
        log=row.log,
        line=row.model_dump_json(),
        number=classes.number(label.kind, label.part, label.position),
        released=label.released,
        guarded=row.guarded,
        files=(hand, hole),
        frames=tuple(folder / name for name in row.frames),
        track_m=np.array(
            [UNKNOWN_HAND if sample_row is None else _told(sample_row) for sample_row in [before, *row.hands]], float
        ),
        before_s=math.inf if before is None else row.begin_s - before.time_s,
    )


def _told(hand: SampleRow) -> tuple[float, ...]:
    height_m, apart_m = hand.fingertips_height_m, opening_m(hand.thumb_m, hand.index_m)
    return (*hand.fingertips_m, *hand.palm_m, math.nan if height_m is None else height_m, apart_m)


def _whole_frames(rows: Sequence[_Row]) -> tuple[Images, NDArray[np.int64]]:
    """All whole frames once, and which of them each row sees."""
    index: dict[Path, int] = {}
    if any(len(row.frames) != len(rows[0].frames) for row in rows):
        raise InputError("some of the segments have whole frames and others have none: make them all with --frames")
    seen = [[index.setdefault(file, len(index)) for file in row.frames] for row in rows]
    frames = [read_image(file) for file in index]
    if any(frame.shape != (*FRAME_PX[::-1], 3) for frame in frames):
        raise InputError(f"whole frames of segments must have {FRAME_PX[0]} x {FRAME_PX[1]} pixels")
    return np.array(frames, np.uint8).reshape(-1, *FRAME_PX[::-1], 3), np.array(seen, np.int64)


def _kept(file: Path) -> Images:
    """The middle of a window, in RGB."""
    window = read_image(file)
    if window.shape[0] != window.shape[1]:
        raise InputError(f"{file}: {window.shape[1]} x {window.shape[0]} pixels; a square is needed")
    side = round(CROP_PX * 1.5)
    if window.shape[0] != side:  # another camera's scale
        window = np.asarray(cv2.resize(window, (side, side), interpolation=cv2.INTER_AREA), np.uint8)
    edge = (side - KEPT_PX) // 2
    return np.asarray(window[edge : edge + KEPT_PX, edge : edge + KEPT_PX], np.uint8)
