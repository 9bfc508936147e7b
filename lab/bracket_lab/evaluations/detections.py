"""Draws what trackers and detectors found onto the frames that they found it in, and writes pictures and videos."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from bracket_cell.learned.hands.reading import Reading
from bracket_cell.recording.images import Video
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.perception import BenchView, HandSample, PartDetection, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

Colour = tuple[int, int, int]
WORKS, RESTS, WHITE, GREY, RED = (255, 220, 0), (255, 140, 0), (255, 255, 255), (190, 190, 190), (255, 60, 60)
THUMB, INDEX = (90, 160, 255), (255, 90, 160)
ASSUMED_HEIGHT_M = 0.10  # of a hand whose tracker tells none
FOREARM_M = 0.12
SMALLEST_PX = 640  # smaller images are enlarged, so that the words can be read
FONT = cv2.FONT_HERSHEY_SIMPLEX
VIDEO_SUFFIX, PICTURE_SUFFIXES = ".mp4", (".png", ".jpg", ".jpeg")


class Canvas:
    """A frame, enlarged, to draw on in its own pixels."""

    def __init__(self, frame: Frame, model: CameraModel) -> None:
        self._factor = max(1, -(-SMALLEST_PX // frame.image.shape[1]))
        self._model, self._pose = model, frame.world_from_camera
        size = tuple(self._factor * side for side in frame.image.shape[1::-1])
        self.image: Image = np.asarray(cv2.resize(frame.image, size, interpolation=cv2.INTER_LINEAR), np.uint8).copy()

    def box(self, box_px: Sequence[float], label: str, colour: Colour) -> None:
        """A box (left, top, right, bottom) with its label over it."""
        left, top, right, bottom = (round(self._factor * value) for value in box_px)
        cv2.rectangle(self.image, (left, top), (right, bottom), colour, 2)
        self.words(label, (left + 2, top - 5 if top > 20 else bottom + 15), colour)

    def dot(self, x_m: float, y_m: float, z_m: float, colour: Colour, radius_px: int = 4) -> tuple[int, int]:
        """A filled circle at a point of the world; returns where it is drawn."""
        column, row = self._model.project(self._pose, np.array([[x_m, y_m, z_m]]))[0]
        place = round(self._factor * (float(column) + 0.5)), round(self._factor * (float(row) + 0.5))
        cv2.circle(self.image, place, radius_px, colour, -1, cv2.LINE_AA)
        return place

    def ring(self, x_m: float, y_m: float, z_m: float, radius_m: float, colour: Colour) -> tuple[int, int]:
        """A circle about a point of the world."""
        points = np.array([[x_m, y_m, z_m], [x_m, y_m + radius_m, z_m]])
        middle, edge = self._factor * (self._model.project(self._pose, points) + 0.5)
        place = round(float(middle[0])), round(float(middle[1]))
        cv2.circle(self.image, place, max(3, round(float(np.linalg.norm(edge - middle)))), colour, 2, cv2.LINE_AA)
        return place

    def line(self, start: tuple[int, int], end: tuple[int, int], colour: Colour) -> None:
        """Between two places that were drawn."""
        cv2.line(self.image, start, end, colour, 2, cv2.LINE_AA)

    def words(self, text: str, place: tuple[int, int], colour: Colour) -> None:
        """Text with a dark rim, so that it can be read on anything."""
        for width, rgb in ((3, (20, 20, 20)), (1, colour)):
            cv2.putText(self.image, text, place, FONT, 0.45, rgb, width, cv2.LINE_AA)


def drawn_bench(
    frame: Frame, view: BenchView, bench: Bench, product: Product, doubtful: Sequence[Reading] = ()
) -> Image:
    """An overhead frame with hands, holes and action."""
    canvas = Canvas(frame, bench.overhead.model)
    for position, hole in view.holes.items():
        x, y, z = bench.bracket.pose.transform(np.array([*product.bracket.holes_m[position], 0.0]))
        place = canvas.ring(x, y, z, 0.016, GREY if hole.part is None else WHITE)
        tilted = "" if hole.upright else " tilted"
        canvas.words(f"{hole.part or ''}{tilted}", (place[0] - 8, place[1] - 24), WHITE)
    draw_hands(canvas, view.hand, view.other_hands, doubtful)
    canvas.words(f"{view.action} {view.action.confidence:.2f}", (8, 18), WHITE)
    trouble = view.health or view.hand_unknown
    if trouble:
        canvas.words(trouble, (8, 38), GREY if view.unseen else RED)  # a picture of something else is no fault
    return beside_depth(canvas.image, frame)


def drawn_hands(
    frame: Frame, bench: Bench, hand: HandSample | None, others: Sequence[HandSample], doubtful: Sequence[Reading]
) -> Image:
    """A frame with hands alone."""
    canvas = Canvas(frame, bench.overhead.model)
    draw_hands(canvas, hand, others, doubtful)
    return beside_depth(canvas.image, frame)


def beside_depth(image: Image, frame: Frame) -> Image:
    """An image with the frame's depths to its right: near is red, what the camera does not know is black."""
    if frame.depth_mm is None:
        return image
    near_mm, far_mm = (float(np.percentile(frame.depth_mm[frame.depth_mm > 0], share)) for share in (1, 99))
    shares = np.clip((far_mm - frame.depth_mm) / max(far_mm - near_mm, 1.0), 0, 1)
    coloured = cv2.applyColorMap(np.rint(255 * shares).astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1]
    coloured = np.where((frame.depth_mm > 0)[..., np.newaxis], coloured, 0).astype(np.uint8)
    size = image.shape[1], image.shape[0]
    return np.hstack([image, np.asarray(cv2.resize(coloured, size, interpolation=cv2.INTER_NEAREST), np.uint8)])


def drawn_parts(frame: Frame, view: PartsView, bench: Bench, product: Product) -> Image:
    """A wrist frame with its parts."""
    canvas = Canvas(frame, bench.wrist.model)
    for number, part in enumerate((*view.detections, *view.others)):
        _draw_part(canvas, part, number, product)
    return canvas.image


def draw_hands(
    canvas: Canvas, hand: HandSample | None, others: Sequence[HandSample], doubtful: Sequence[Reading] = ()
) -> None:
    """All hands: the one that works, the others, and in grey what is not believed to be one."""
    for reading in doubtful:
        canvas.box(reading.box_px, f"hand? {reading.confidence:.2f}", GREY)
    for sample, colour in [(hand, WORKS), *((other, RESTS) for other in others)]:
        if sample is not None:
            _draw_hand(canvas, sample, colour)


def _draw_hand(canvas: Canvas, hand: HandSample, colour: Colour) -> None:
    words = [hand.side or "hand", f"holds {hand.held_part}" if hand.held_part else ""]
    words += [] if hand.height_m is None else [f"{100 * hand.height_m:.0f} cm"]
    canvas.box(hand.box_px, " ".join(word for word in [*words, f"{hand.confidence:.2f}"] if word), colour)
    palm_m = ASSUMED_HEIGHT_M if hand.height_m is None else hand.height_m
    tips_m = palm_m if hand.fingertips_height_m is None else hand.fingertips_height_m
    palm = canvas.dot(*hand.palm_m, palm_m, colour, 6)
    for point, own in ((hand.fingertips_m, WHITE), (hand.thumb_m, THUMB), (hand.index_m, INDEX)):
        if point is not None:
            canvas.line(palm, canvas.dot(*point, tips_m, own), own)
    if hand.forearm_rad is not None and not hand.forearm_guessed:
        along = FOREARM_M * np.array([np.cos(hand.forearm_rad), np.sin(hand.forearm_rad)])
        x, y = np.array(hand.palm_m) + along
        canvas.line(palm, canvas.dot(float(x), float(y), palm_m, colour, 3), colour)
    if hand.held_m is not None:
        canvas.ring(*hand.held_m, tips_m, 0.02, colour)


def _draw_part(canvas: Canvas, part: PartDetection, number: int, product: Product) -> None:
    kind = product.parts.get(part.part)
    paint = (200, 200, 200) if kind is None else kind.colour_rgb
    colour = GREY if kind is None else tuple(round(255 * (0.45 + 0.55 * channel)) for channel in paint)
    upright = "" if part.upright else " lying"
    canvas.box(part.box_px, f"{number}: {part.part}{upright} {part.confidence:.2f}", colour)  # type: ignore[arg-type]
    x, y, z = part.world_from_part.position_m
    ahead: Pose = part.world_from_part @ Pose((part.size_m[0] / 2, 0.0, 0.0))
    canvas.line(canvas.dot(x, y, z, WHITE, 3), canvas.dot(*ahead.position_m, WHITE, 2), WHITE)


class PictureWriter:
    """Writes drawn frames: one picture, a folder of pictures, or a video, by the name of `path`.

    A video is whole when the writer is left; where an error leaves it, no piece of it is there.

    Raises:
        InputError: something is there already, or cannot be written.
    """

    def __init__(self, path: Path, rate_hz: float, *, overwrite: bool = False) -> None:
        self.path = path
        self.written: list[Path] = []
        self._video = Video(self._partial(), rate_hz, name=path)
        if path.is_dir() and any(path.iterdir()) and not overwrite:
            raise InputError(f"{path}: is not an empty folder; choose another with --out, or add --overwrite")
        if path.is_file() and not overwrite:
            raise InputError(f"{path}: exists already; choose another with --out, or add --overwrite")
        if path.suffix and path.suffix.lower() not in (VIDEO_SUFFIX, *PICTURE_SUFFIXES):
            raise InputError(f"{path}: must end in {VIDEO_SUFFIX}, {', '.join(PICTURE_SUFFIXES)}, or be a folder")

    def write(self, image: Image, name: str) -> None:
        """One more drawn frame.

        Args:
            name: of its file, where there are several.
        """
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        try:
            if self.path.suffix.lower() == VIDEO_SUFFIX:
                self._video.add(bgr)
                return
            file = self.path if self.path.suffix else self.path / f"{name}.png"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(cv2.imencode(file.suffix, bgr)[1].tobytes())
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        if file not in self.written:
            self.written.append(file)

    def __enter__(self) -> PictureWriter:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is not None:
            self._video.discard()
        elif self._video.close():
            self._partial().replace(self.path)
            self.written.append(self.path)

    def _partial(self) -> Path:
        return self.path.parent / f"{self.path.stem}.partial{self.path.suffix}"
