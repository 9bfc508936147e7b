"""Segments of what the hand does, with the last crop of the hand, and crops of the holes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.hand_window import hand_window, last_at_hole, seen_frames, small_frame, window_px
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, HandTracker
from bracket_ground.interfaces.pose import Array
from bracket_lab.drawing.hands import visible_shares
from bracket_lab.drawing.placed import holes_of
from bracket_lab.drawing.recording import CAMERA, Assembly, Source
from bracket_lab.drawing.sight import Masks, Projection
from bracket_lab.drawing.tracks import Hand, as_seen_by, as_tracked, hands_of

GAPS_STREAM = 10
STRIDE_FRAMES = 15  # a segment a second
ASSEMBLY_STRIDE_FRAMES = 4  # and more while a part is placed, which is short
HOLES_STRIDE_FRAMES = 30
HOLE_HALF_M = 0.045  # half the width of a hole's crop on the plate
MOST_OF = {"assembly": 1000, "transit": 14, "screw": 8, "idle": 4}  # segments of a recording that is thinned
COVERED_BY = ("hand", "shoulder", "upper", "forearm", "wrist", "gripper", "finger", "tool", "base", "head")


def write_segments(
    source: Source,
    folder: DataFolder,
    *,
    thin: bool = False,
    frames: bool = False,
    gaps: bool = False,
    tracker: HandTracker | None = None,
) -> None:
    """Rows of segments.jsonl, and the window of the hand at the end of each and where it was last at a hole.

    Args:
        thin: only some of the segments that are no assembly, drawn by chance, so that classes are less unequal.
        frames: every third whole frame of each segment, too, made small.
        gaps: the hand as a tracker reports it, which loses it now and then.
        tracker: sees the hand in every frame, instead of the truth; gaps are its own then.
    """
    assembly = source.assembly
    hands = _hands(source, gaps) if tracker is None else as_seen_by(tracker, source, assembly.seed)
    sequences = np.array([moment.exposure.sequence for moment in assembly.moments])
    camera, seen = _Windows(source), seen_frames(SEGMENT_FRAMES - 1)
    for end in _thinned(assembly) if thin else segment_ends(assembly):
        moment, label = assembly.moments[end], assembly.labels[end]
        wanted = np.arange(sequences[end] - SEGMENT_FRAMES + 1, sequences[end] + 1)
        numbers = np.maximum(np.searchsorted(sequences, wanted, side="right") - 1, 0)  # the last frame that came
        before = hands[: int(np.searchsorted(sequences, wanted[0]))]
        came = sequences[numbers] == wanted
        window = [hands[number] if seen else None for number, seen in zip(numbers, came, strict=True)]
        at_hole = last_at_hole(_tips_m(window), source.holes_m)
        folder.row(
            "segments",
            {
                "log": source.name,
                "frame": moment.exposure.sequence,
                "begin_s": round(assembly.moments[numbers[0]].time_s, 4),
                "end_s": round(moment.time_s, 4),
                "truth": asdict(label),
                "guarded": assembly.guarded[end],
                **({"frames": [camera.small(numbers[at], folder) for at in seen]} if frames else {}),
                "hole_crop": None if at_hole is None else camera.write(numbers[at_hole], window[at_hole], folder),
                "hand_crop": camera.write(end, window[-1], folder),
                "holes": {position: part for position, (part, _) in holes_of(source, moment).items()},
                "hands": window,
                "hand_before": next((hand for hand in reversed(before) if hand is not None), None),
            },
        )
    camera.close()


def _hands(source: Source, gaps: bool) -> list[Hand | None]:
    visible = visible_shares(source, range(len(source.assembly.moments)))
    hands = hands_of(source, visible)
    if not gaps:
        return hands
    return as_tracked(source, hands, visible, np.random.default_rng([source.assembly.seed, GAPS_STREAM]))


def _tips_m(hands: Sequence[Hand | None]) -> Array:
    """(n, 2) fingertips on the bench, NaN where no hand was seen."""
    return np.array([(math.nan, math.nan) if hand is None else hand["fingertips_m"] for hand in hands])


class _Windows:
    """Writes windows around the fingertips, each once."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._photographer = source.assembly.photographer(source.bench)
        self._projection = Projection(source.assembly.world, CAMERA, source.bench.overhead, source.assembly.look)
        self._side_px = window_px(source.bench.overhead)
        self._written: dict[int, str] = {}
        self._small: dict[int, str] = {}

    def write(self, index: int, hand: Hand | None, folder: DataFolder) -> str | None:
        """The file of the window around the fingertips at a moment, where they are told to be; None where nowhere."""
        if hand is None:
            return None
        if index not in self._written:
            moment = self._source.assembly.moments[index]
            exposure = moment.exposure
            height_m = hand["fingertips_height_m"]
            tips_m = np.array([[*hand["fingertips_m"], moment.fingertips_m[2] if height_m is None else height_m]])
            column, row = self._projection.pixels(exposure.moments[-1], tips_m)[0]
            image = self._photographer.take(exposure).image
            name = f"crops/{self._source.name}-{exposure.sequence:06d}-hand.png"
            self._written[index] = folder.image(name, hand_window(image, (column, row), self._side_px))
        return self._written[index]

    def small(self, index: int, folder: DataFolder) -> str:
        """The file of the whole frame of a moment, made small."""
        if index not in self._small:
            exposure = self._source.assembly.moments[index].exposure
            name = f"frames/{self._source.name}-{exposure.sequence:06d}.jpg"
            self._small[index] = folder.image(name, small_frame(self._photographer.take(exposure).image))
        return self._small[index]

    def close(self) -> None:
        self._photographer.close()


def write_holes(source: Source, folder: DataFolder) -> None:
    """Rows of holes.jsonl: each hole as the controller would cut it out, what is in it, and how much hides it."""
    assembly, bench = source.assembly, source.bench
    photographer = assembly.photographer(bench)
    masks = Masks(assembly.world, CAMERA, bench.overhead, assembly.look)
    model = assembly.world.model
    hiding = [body for body in range(model.nbody) if model.body(body).name.startswith(COVERED_BY)]
    for moment in assembly.moments[SEGMENT_FRAMES::HOLES_STRIDE_FRAMES]:
        frame = photographer.take(moment.exposure)
        hidden = masks.of(masks.bodies(moment.exposure.moments[-1]), hiding)
        for position, (part, upright) in holes_of(source, moment).items():
            box = _hole_box(source, position)
            file = folder.image(f"crops/{source.name}-{frame.sequence:06d}-{position}.png", _crop(frame.image, box))
            covered = float(_crop(hidden, box).mean())
            folder.row(
                "holes",
                {
                    "file": file,
                    "log": source.name,
                    "frame": frame.sequence,
                    "time_s": round(moment.time_s, 4),
                    "position": position,
                    "part": part,
                    "upright": upright,
                    "covered": round(covered, 3),
                    "box_px": box,
                },
            )
    masks.close()
    photographer.close()


def segment_ends(assembly: Assembly) -> Iterator[int]:
    """Last moments of segments; where frames in between were lost, as in a run, a segment has fewer."""
    for end in range(SEGMENT_FRAMES - 1, len(assembly.moments)):
        placing = assembly.labels[end].kind == "assembly"
        if end % (ASSEMBLY_STRIDE_FRAMES if placing else STRIDE_FRAMES) == 0:
            yield end


def _thinned(assembly: Assembly) -> list[int]:
    """All segments that are assemblies, and a number of each other class."""
    rng = np.random.default_rng([assembly.seed, 5])
    ends = list(segment_ends(assembly))
    chosen: list[int] = []
    for kind, most in MOST_OF.items():
        of_kind = [end for end in ends if assembly.labels[end].kind == kind]
        chosen += list(rng.permutation(of_kind)[:most]) if of_kind else []
    return sorted(int(end) for end in chosen)


def _hole_box(source: Source, position: str) -> tuple[int, int, int, int]:
    """Around a hole as the controller's camera model says where it is."""
    setup = source.bench.overhead
    hole = source.bench.bracket.pose.transform(np.array([[*source.product.bracket.holes_m[position], 0.0]]))
    column, row = setup.model.project(setup.mount.pose, hole)[0]
    depth_m = setup.mount.position_m[2] - float(hole[0][2])
    half = round(HOLE_HALF_M * setup.focal_px / depth_m)
    return round(column) - half, round(row) - half, round(column) + half, round(row) + half


def _crop(image: NDArray[Any], box: tuple[int, int, int, int]) -> Any:
    left, top, right, bottom = box
    return image[max(0, top) : bottom, max(0, left) : right]
