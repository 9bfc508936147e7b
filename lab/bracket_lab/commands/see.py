"""`cell lab see`: what trackers and detectors find in pictures, drawn onto them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import islice, pairwise
from pathlib import Path
from typing import Annotated, Any

import typer

from bracket_cell.commands.options import CONFIGURATION, ConfigOption, JsonOption
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.configuration import Configuration, detected_by, load_configuration, load_product, simulated
from bracket_cell.learned.bench_watcher import DetectorChain
from bracket_cell.learned.holes.model import VOTES
from bracket_cell.pictures.sources import LEGAL, Source, camera_pose, open_source
from bracket_cell.pictures.suggestions import Often
from bracket_cell.recording.schemas import plain
from bracket_cell.settings import Perception
from bracket_cell.wiring.detectors import Detectors, bench_watcher, fitted, for_camera, part_finder
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.product import Product
from bracket_lab.evaluations.detections import (
    PICTURE_SUFFIXES,
    VIDEO_SUFFIX,
    PictureWriter,
    drawn_bench,
    drawn_hands,
    drawn_parts,
)

Look = Callable[[Frame], tuple[object, Image]]

CAMERAS = ("overhead", "wrist")
MOST_FROM_CAMERA = 150  # ten seconds


def see(
    source: Annotated[str, typer.Argument(help=f"Source: {LEGAL}.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Picture, folder or .mp4; by default SOURCE-seen here.")
    ] = None,
    camera: Annotated[str, typer.Option(help="Which camera took it: overhead or wrist.")] = "overhead",
    hands: Annotated[
        str | None, typer.Option(help="Tracker: both, slim, classical or mediapipe, else as configured.")
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
    configuration = _chosen(simulated(load_configuration(config), look), hands, perception)
    product = load_product(configuration, config)
    drawn = source.startswith("sim:") or source.endswith(".mcap")
    looking, of_hands = for_camera(configuration.perception, real=not drawn)
    configuration, said = fitted(configuration.model_copy(update={"perception": looking}), product)
    for line in filter(None, (of_hands, said)):
        console().print(line, highlight=False)
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
        look_at = partial(_look, configuration, product, camera, opened.follows)
        told = _seen(opened, most, every, writer, look_at)
    console().print(table(str(target), {"frames": len(told)} | (_of_hands(told) if camera == "overhead" else {})))
    if as_json:
        print_json({"source": source, "written": [str(file) for file in writer.written], "frames": told})


def _seen(
    opened: Source, most: int | None, every: int, writer: PictureWriter, look: Callable[[tuple[int, int]], Look]
) -> list[dict[str, Any]]:
    """What is found in every frame; what is to be drawn is written. Frames that do not follow others stand alone.

    Args:
        look: at frames of a height and width [px].
    """
    told = []
    watching: Look | None = None
    size = (0, 0)
    for frame in islice(opened.frames, most):
        if watching is None or not opened.follows or frame.image.shape[:2] != size:
            size = (frame.image.shape[0], frame.image.shape[1])
            watching = look(size)
        view, image = watching(frame)
        file = {"file": opened.files[frame.sequence]} if opened.files else {}
        told.append(file | plain(view))
        if frame.sequence % every == 0:
            writer.write(image, opened.title(frame.sequence))
    return told


def _of_hands(told: list[dict[str, Any]]) -> dict[str, int]:
    """In how many frames hands are seen, and how often the one that works was lost."""
    there = [bool(one.get("hand")) for one in told]
    lost = sum(before and not now for before, now in pairwise(there))
    beside = sum(bool(one.get("other_hands")) for one in told)
    return {"with a hand that works": sum(there), "times that it was lost": lost, "with other hands": beside}


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


def _watcher(bench: Bench, product: Product, perception: Perception, follows: bool) -> Callable[[Frame], BenchView]:
    """What answers overhead frames of a film, or else the only frame that it is asked about."""
    if follows:
        return bench_watcher(bench, product, perception)
    made = Detectors(bench, product, perception)
    holes = Often(made.make("holes"), max(VOTES, perception.classical.settle_frames))
    return DetectorChain(bench, product, made.make("hands"), holes, made.make("actions"))


def _look(configuration: Configuration, product: Product, camera: str, follows: bool, size: tuple[int, int]) -> Look:
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
        return lambda frame: (view := find(frame), drawn_parts(frame, view, bench, product))
    if fits:
        watch = _watcher(bench, product, perception, follows)
        return lambda frame: (view := watch(frame), drawn_bench(frame, view, bench, product))
    scale, model = size[1] / setup.width_px, setup.model
    centre = (model.middle_px + 0.5) * scale - 0.5
    same_view: dict[str, object] = {"width_px": size[1], "height_px": size[0], "focal_px": setup.focal_px * scale}
    same_view |= {"focal_y_px": setup.focal_y_px and setup.focal_y_px * scale, "principal_px": tuple(centre.tolist())}
    other = bench.model_copy(update={"overhead": setup.model_copy(update=same_view)})
    tracker = Detectors(other, product, perception).make("hands")

    def hands_alone(frame: Frame) -> tuple[object, Image]:
        hand = tracker.track(frame)
        seen = {"sequence": frame.sequence, "time_s": frame.time_s, "hand": hand, "other_hands": tracker.others}
        return seen, drawn_hands(frame, other, hand, tracker.others)

    return hands_alone
