"""`cell lab see`: what trackers and detectors find in pictures, drawn onto them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice, pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bracket_cell.commands.options import CONFIGURATION, ConfigOption, JsonOption
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.configuration import Configuration, detected_by, load_configuration, load_product, simulated
from bracket_cell.learned.bench_watcher import DetectorChain
from bracket_cell.learned.hands.reading import Reading
from bracket_cell.learned.hands.tracking import HandTracks
from bracket_cell.learned.holes.model import VOTES
from bracket_cell.recording.schemas import plain
from bracket_cell.settings import Perception
from bracket_cell.wiring.detectors import Detectors, for_camera, part_finder, with_detectors_for
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.perception import BenchView, HandSample, HandTracker
from bracket_ground.interfaces.product import Product
from bracket_lab.evaluations.detections import (
    ASSUMED_HEIGHT_M,
    PICTURE_SUFFIXES,
    VIDEO_SUFFIX,
    PictureWriter,
    drawn_bench,
    drawn_hands,
    drawn_parts,
)
from bracket_lab.pictures.sources import LEGAL, Source, camera_pose, open_source
from bracket_lab.pictures.suggestions import Often

Look = Callable[[Frame], tuple[dict[str, Any], Image]]

Size = tuple[int, int]  # height and width [px]

CAMERAS = ("overhead", "wrist")
MOST_FROM_CAMERA = 150  # ten seconds
JUMP_M = 0.08  # of a palm from one frame to the next: rather to another hand than by moving


def see(
    source: Annotated[str, typer.Argument(help=f"Source: {LEGAL}.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Picture, folder or .mp4; by default SOURCE-seen here.")
    ] = None,
    camera: Annotated[str, typer.Option(help="Which camera took it: overhead or wrist.")] = "overhead",
    hands: Annotated[
        str | None,
        typer.Option(
            help="Tracker: both, slim, classical or mediapipe, else as configured; A,B draws two side by side."
        ),
    ] = None,
    perception: Annotated[
        str | None, typer.Option(help="All detectors, whatever is configured: learned or classical.")
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames at most; all by default.")] = None,
    every: Annotated[int, typer.Option(min=1, help="Draw every Nth frame; all are searched.")] = 1,
    look: Annotated[str | None, typer.Option(help="For sim:SEED: nominal, varied, hard, or a file.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")] = False,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Draw what detectors find in pictures, a video, a log or a camera.

    Pictures of another size than the camera's are searched for hands alone.
    """
    if camera not in CAMERAS:
        raise InputError(f"--camera {camera}: unknown camera; legal: {', '.join(CAMERAS)}")
    configured = simulated(load_configuration(config), look)
    product, drawn = load_product(configured, config), source.startswith("sim:") or source.endswith(".mcap")
    trackers = [name.strip() for name in hands.split(",")] if hands else [None]
    each = [_fitted(_chosen(configured, tracker, perception), product, real=not drawn) for tracker in trackers]
    configuration = each[0]
    opened = open_source(source, camera, configuration, product, camera_pose(configuration.bench, camera))
    if look is not None and not source.startswith("sim:"):
        raise InputError("--look goes with sim:SEED; what is there already looks as it does")
    suffix = ".png" if opened.single else VIDEO_SUFFIX if opened.follows else ""
    target = out or Path(f"{opened.name}-seen{suffix}")
    if target.suffix.lower() in PICTURE_SUFFIXES and not opened.single and frames != 1:
        raise InputError(f"--out {target}: one picture holds one frame; name a folder or .mp4, or add --frames 1")
    if target.exists() and Path(source).exists() and target.samefile(source):
        raise InputError(f"{target}: is also the input; choose another with --out")
    most = frames or (MOST_FROM_CAMERA if source.startswith("camera:") else None)
    with PictureWriter(target, opened.rate_hz / every, overwrite=overwrite) as writer:
        looks = [partial(_look, image, product, camera, opened.follows) for image in each]
        rows_of = _seen(opened, most, every, writer, looks)
    rows: dict[str, object] = {"frames": len(rows_of[0])}
    for name, frames_told in zip(trackers, rows_of, strict=True):
        counts = _of_hands(frames_told, opened.follows) if camera == "overhead" else {}
        rows |= {f"{name}: {what}" if len(rows_of) > 1 else what: count for what, count in counts.items()}
    console().print(table(str(target), rows))
    if as_json:
        beside = {str(name): frames_told for name, frames_told in zip(trackers[1:], rows_of[1:], strict=True)}
        answer = {"source": source, "written": [str(file) for file in writer.written], "summary": rows}
        print_json(answer | {"frames": rows_of[0]} | ({"beside": beside} if beside else {}))


def _fitted(configuration: Configuration, product: Product, *, real: bool) -> Configuration:
    """With the detectors that this source and this product can have, and what people should know of them said."""
    looking, of_hands = for_camera(configuration.perception, real=real)
    configuration, said = with_detectors_for(configuration.model_copy(update={"perception": looking}), product)
    for line in filter(None, (of_hands, said)):
        console().print(line, highlight=False)
    return configuration


def _seen(
    opened: Source, most: int | None, every: int, writer: PictureWriter, looks: Sequence[Callable[[Size], Look]]
) -> list[list[dict[str, Any]]]:
    """What is found in every frame, by each of the looks; what is to be drawn is written, side by side.

    Frames that do not follow others stand alone.

    Args:
        looks: at frames of a height and width [px].
    """
    rows_of: list[list[dict[str, Any]]] = [[] for _ in looks]
    watching: list[Look] = []
    size = (0, 0)
    for frame in islice(opened.frames, most):
        if not watching or not opened.follows or frame.image.shape[:2] != size:
            size = (frame.image.shape[0], frame.image.shape[1])
            watching = [look(size) for look in looks]
        views, images = zip(*(watch(frame) for watch in watching), strict=True)
        file = {"file": opened.files[frame.sequence]} if opened.files else {}
        for frames_told, view in zip(rows_of, views, strict=True):
            frames_told.append(file | view)
        if frame.sequence % every == 0:
            writer.write(np.hstack(images), opened.title(frame.sequence))
    return rows_of


def _of_hands(frames: list[dict[str, Any]], follows: bool) -> dict[str, object]:
    """In how many frames hands are seen, and, where frames follow each other, how steadily the one that works is."""
    hands = [row["hand"] for row in frames]
    counts: dict[str, object] = {
        "with a hand at work": sum(map(bool, hands)),
        "with other hands": sum(bool(row["other_hands"]) for row in frames),
    }
    if not follows:
        return counts
    palms_px = [row["palm_px"] for row in frames]
    off_px = [
        math.dist(now, np.add(before, after) / 2)
        for before, now, after in zip(palms_px, palms_px[1:], palms_px[2:], strict=False)
        if before and now and after
    ]
    steps_m = [math.dist(old["palm_m"], new["palm_m"]) for old, new in pairwise(hands) if old and new]
    counts["times that it was lost"] = sum(bool(old and not new) for old, new in pairwise(hands))
    counts[f"jumps of its palm over {1000 * JUMP_M:.0f} mm"] = sum(step_m > JUMP_M for step_m in steps_m)
    if off_px:  # from the middle between the frames before and after
        median_px, most_px = np.percentile(off_px, (50, 95)).round(1).tolist()
        counts["jitter of its palm [px]"] = {"median": median_px, "95 %": most_px}
    return counts


def _chosen(configuration: Configuration, hands: str | None, kind: str | None) -> Configuration:
    """The configuration with other detectors.

    Raises:
        InputError: there are no such detectors.
    """
    if kind not in (None, "learned", "classical"):
        raise InputError(f"--perception {kind}: unknown kind; legal: learned, classical")
    configuration = detected_by(configuration, kind)
    if hands is None:
        return configuration
    perception = configuration.perception.with_detector("hands", hands)
    return configuration.model_copy(update={"perception": perception})


def _watcher(
    bench: Bench, product: Product, perception: Perception, follows: bool
) -> tuple[Callable[[Frame], BenchView], HandTracker]:
    """What answers overhead frames of a film, or else the only frame that it is asked about; and its tracker."""
    made = Detectors(bench, product, perception)
    tracker, holes = made.make("hands"), made.make("holes")
    if not follows:
        holes = Often(holes, max(VOTES, perception.classical.settle_frames))
    return DetectorChain(bench, product, tracker, holes, made.make("actions"), made.places()), tracker


def _look(configuration: Configuration, product: Product, camera: str, follows: bool, size: Size) -> Look:
    """What is found in a frame of this size, and the frame with it drawn.

    Args:
        follows: it will be asked about frames that follow each other, not about one alone.
    """
    bench, perception = configuration.bench, configuration.perception
    setup = bench.overhead if camera == "overhead" else bench.wrist
    fits = size == (setup.height_px, setup.width_px)
    if camera == "wrist":
        if not fits:
            wanted = f"{setup.width_px} x {setup.height_px}"
            raise InputError(f"a frame of {size[1]} x {size[0]} pixels; those of the wrist camera have {wanted}")
        find = part_finder(bench, product, perception)
        return lambda frame: (plain(view := find(frame)), drawn_parts(frame, view, bench, product))
    if not fits:
        return _hands_alone(_of_size(bench, size), product, perception)
    watch, tracker = _watcher(bench, product, perception, follows)

    def whole(frame: Frame) -> tuple[dict[str, Any], Image]:
        view = watch(frame)
        drawn = drawn_bench(frame, view, bench, product, _doubtful(tracker))
        return plain(view) | _of_tracker(tracker, bench, frame, view.hand), drawn

    return whole


def _of_size(bench: Bench, size: Size) -> Bench:
    """The bench with an overhead camera that sees the same in images of another size."""
    setup, model = bench.overhead, bench.overhead.model
    scale = size[1] / setup.width_px
    centre = (model.middle_px + 0.5) * scale - 0.5
    same_view: dict[str, object] = {"width_px": size[1], "height_px": size[0], "focal_px": setup.focal_px * scale}
    same_view |= {"focal_y_px": setup.focal_y_px and setup.focal_y_px * scale, "principal_px": tuple(centre.tolist())}
    return bench.model_copy(update={"overhead": setup.model_copy(update=same_view)})


def _hands_alone(bench: Bench, product: Product, perception: Perception) -> Look:
    tracker: HandTracker = Detectors(bench, product, perception).make("hands")

    def look(frame: Frame) -> tuple[dict[str, Any], Image]:
        hand = tracker.track(frame)
        seen = {"sequence": frame.sequence, "time_s": frame.time_s, "hand": hand, "other_hands": tracker.others}
        drawn = drawn_hands(frame, bench, hand, tracker.others, _doubtful(tracker))
        return plain(seen) | _of_tracker(tracker, bench, frame, hand), drawn

    return look


def _doubtful(tracker: HandTracker) -> Sequence[Reading]:
    return tracker.doubtful if isinstance(tracker, HandTracks) else ()


def _of_tracker(tracker: HandTracker, bench: Bench, frame: Frame, hand: HandSample | None) -> dict[str, Any]:
    """Where the palm is in the image, and what the tracker read and does not believe."""
    doubtful = [{"box_px": reading.box_px, "confidence": reading.confidence} for reading in _doubtful(tracker)]
    if hand is None:
        return {"palm_px": None, "doubtful": doubtful}
    height_m = ASSUMED_HEIGHT_M if hand.height_m is None else hand.height_m
    palm_px = bench.overhead.model.project(frame.world_from_camera, np.array([[*hand.palm_m, height_m]]))[0]
    return {"palm_px": palm_px.round(2).tolist(), "doubtful": doubtful}
