"""The trained hole reader: one small network looks at all holes of a frame at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View, outline
from bracket_cell.learned.inference.exposure import Image, levelled
from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_cell.learned.inference.prefetch import Prefetch
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample, HoleView
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

CROP_PX = 48
STEP_M = 0.002  # a pixel of the crop on the plate

_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def squares_m(bench: Bench, product: Product) -> Array:
    """Corners (holes, 4, 3) of the square on the plate around each hole, in the world."""
    half_m = (CROP_PX - 1) / 2 * STEP_M
    holes = np.array(list(product.bracket.holes_m.values()))
    corners = holes[:, np.newaxis] + half_m * _CORNERS
    flat = np.concatenate([corners.reshape(-1, 2), np.zeros((4 * len(holes), 1))], axis=1)
    return bench.bracket.pose.transform(flat).reshape(-1, 4, 3)


def hole_crops(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, squares: Array
) -> NDArray[np.float32]:
    """What is seen in each square, (holes, 3, CROP_PX, CROP_PX) from -0.5 to 0.5; what is out of view repeats the edge.

    Args:
        squares: (holes, 4, 3) from `squares_m`.
    """
    turns = _turns(camera, world_from_camera, squares)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    flat = np.empty((len(turns), CROP_PX, CROP_PX, 3), np.uint8)
    for crop, turn in zip(flat, turns, strict=True):
        cv2.warpPerspective(image, turn, (CROP_PX, CROP_PX), crop, flags, cv2.BORDER_REPLICATE)
    crops: NDArray[np.float32] = flat.transpose(0, 3, 1, 2).astype(np.float32, order="C")
    crops /= np.float32(255)
    crops -= np.float32(0.5)
    return crops


def _turns(camera: CameraModel, world_from_camera: Pose, squares: Array) -> list[Array]:
    """From pixels of each crop to those of the image, (3, 3)."""
    pixels = camera.project(world_from_camera, squares.reshape(-1, 3)).reshape(-1, 4, 2).astype(np.float32)
    own = ((_CORNERS + 1) / 2 * (CROP_PX - 1)).astype(np.float32)
    return [np.asarray(cv2.getPerspectiveTransform(own, seen), np.float64) for seen in pixels]


Answer = Mapping[str, Array]  # of one frame: "kinds" (holes, types + 1), "upright" and "covered" (holes,)

KIND = "holes.plate"
VOTES = 3  # frames in a row whose mean answer a hole's view follows
# Keys of the model card: probabilities below which emptiness, and a type, are not said.
LEAST_EMPTY, LEAST_FILLED = "least_empty", "least_filled"
LEAST_UPRIGHT = "least_upright"  # of the model card: probability above which a part stands straight

KEYS = {True: LEAST_EMPTY, False: LEAST_FILLED}
SURELY_EMPTY = 0.9  # emptiness is never said below, however few recordings a validation had
COVERED = {True: 0.6, False: 0.7}  # probability from which a hole that looks empty, or filled, counts as covered
SURELY_FILLED = 0.95  # less is not believed of a hole that the robot is over: what it holds looks as if it were there
LEAST_DEPTH_M = 0.05  # links nearer to the camera hide no single hole
BESIDE_M = 0.03  # so far beside the robot's outline it is over a hole, too: about as far as a part reaches


@dataclass(frozen=True)
class Reading:
    """What a frame, or some in a row, show at one hole.

    Attributes:
        part: None where it is empty.
        confidence: calibrated probability that part and emptiness are right.
    """

    part: str | None
    upright: bool
    confidence: float


class HoleNetwork:
    """What the network says about the holes of frames."""

    def __init__(self, bench: Bench, product: Product, network: Network) -> None:
        self._model, self._network = bench.overhead.model, network
        self._squares: Array = squares_m(bench, product)
        self._positions, self._types = product.positions, tuple(product.parts)
        network.card.require_vocabulary(network.path, {"parts": self._types})
        self._least = {empty: float(str(network.card.config.get(key, 0.9))) for empty, key in KEYS.items()}
        self._least[True] = max(self._least[True], SURELY_EMPTY)
        self._least_upright = float(str(network.card.config.get(LEAST_UPRIGHT, 0.5)))

    def answer(self, image: Image, camera: Pose) -> Answer:
        """Probabilities of one frame."""
        return self._network.run({"crops": hole_crops(levelled(image), self._model, camera, self._squares)})

    def read(self, *answers: Answer) -> dict[str, Reading | None]:
        """By position, from the mean of some answers; None where a hole is covered, or nothing can be said for sure."""
        means = {
            name: np.mean([answer[name] for answer in answers], axis=0) for name in ("kinds", "upright", "covered")
        }
        rows = zip(self._positions, means["kinds"], means["upright"], means["covered"], strict=True)
        return {position: self._reading(kinds, float(up), float(hidden)) for position, kinds, up, hidden in rows}

    def _reading(self, kinds: Array, upright: float, covered: float) -> Reading | None:
        best = int(kinds.argmax())
        sure = float(kinds[best])
        if covered > COVERED[best == 0] or sure < self._least[best == 0]:
            return None
        if best == 0:
            return Reading(None, True, sure)
        return Reading(self._types[best - 1], upright > self._least_upright, sure)


class PlateHoleReader:
    """Keeps what was seen of each hole while hand or arm are in the way (HoleReader)."""

    def __init__(self, bench: Bench, product: Product, network: Network) -> None:
        self._camera = bench.overhead.mount.pose
        self._network = HoleNetwork(bench, product, network)
        self._answer = Prefetch(lambda image: self._network.answer(image, self._camera))
        self._answers: deque[Answer] = deque(maxlen=VOTES)
        self._robots: deque[Array | None] = deque(maxlen=VOTES)
        self._holes_m = dict(zip(product.positions, squares_m(bench, product).mean(axis=1), strict=True))
        self._model = bench.overhead.model
        self._views: dict[str, HoleView] = {}

    @staticmethod
    def load(bench: Bench, product: Product, weights: Path) -> PlateHoleReader:
        """With the network of a file.

        Raises:
            ModelError: the file is missing, damaged, of another kind, or trained for other parts.
        """
        return PlateHoleReader(bench, product, OnnxModel.load(weights, KIND))

    def prepare(self, image: Image) -> None:
        """Look at the holes before anybody asks."""
        self._answer.prepare(image)

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        """Holes by position name, as far as ever seen; what covers a hole is seen in the image, whatever `hand` is.

        A view follows the mean of the last frames: what noise alone makes doubtful in one is said, and a single wrong
        one changes nothing. A hole that the robot is over keeps its view unless it is surely filled.
        """
        del hand
        self._answers.append(self._answer(frame.image))
        self._robots.append(frame.robot_m)
        if len(self._answers) == VOTES:
            for position, reading in self._network.read(*self._answers).items():
                if reading is not None and not self._may_be_robot(position, reading):
                    self._views[position] = HoleView(reading.part, reading.confidence, frame.time_s, reading.upright)
        return dict(sorted(self._views.items()))

    def _may_be_robot(self, position: str, reading: Reading) -> bool:
        """Whether what seems to be in a hole may be the robot over it, or the part that it holds."""
        if reading.part is None or reading.confidence >= SURELY_FILLED:
            return False
        return any(robot_m is not None and self._over(position, robot_m) for robot_m in self._robots)

    def _over(self, position: str, robot_m: Array) -> bool:
        """Whether the robot (links, n, 3) is between the camera and a hole, or right beside that."""
        view, hole_m = View(self._model, self._camera), self._holes_m[position]
        (hole,) = view.pixels(hole_m[np.newaxis]).tolist()
        beside_px = BESIDE_M * view.pixels_per_m(hole_m.tolist())
        seen = [points for points in robot_m if float(view.depths(points).min()) > LEAST_DEPTH_M]
        outlines = (outline(view.pixels(points)).astype(np.float32) for points in seen)
        return any(cv2.pointPolygonTest(outline, hole, measureDist=True) > -beside_px for outline in outlines)
