"""f_i of the paper: features of the crop around each detected part, which shows what stands in its way.

A crop is cut from the wrist image at a fixed scale, its rows along the part's x axis. A small network turns it into the
embedding of the detection; it is trained together with the planner that reads the embeddings (learned/grasp/paper.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import Bench
from cell.interfaces.camera_model import CameraModel
from cell.interfaces.errors import ModelError
from cell.interfaces.perception import Frame, PartDetection, PartDetector
from cell.interfaces.pose import Array, Pose
from learned.grasp.boxes import Boxes
from learned.onnx_model import Network, OnnxModel

CROP_PX, STEP_M = 24, 0.005  # 12 cm: the part with the room of fingers and palm
EMBEDDING = 32  # features of a crop
CROPS_KIND = "grasp.crops"
_FINER = 2  # times finer sampled, then averaged

Crops = NDArray[np.uint8]  # (n, 3, CROP_PX, CROP_PX), one for each detection
View = tuple[Boxes, tuple[PartDetection, ...]]  # what stands in the tray, and where it was detected
TrayCamera = Callable[[Sequence[View]], list[Crops]]  # images of views, cut to crops


def crops_of(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, parts: Sequence[PartDetection]
) -> Crops:
    """Crops of all detections; x of the part runs to the right."""
    found = [_crop(image, camera, world_from_camera, part.world_from_part) for part in parts]
    return np.array(found, np.uint8).reshape(-1, 3, CROP_PX, CROP_PX)


def _crop(image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, part: Pose) -> NDArray[np.uint8]:
    pixels = CROP_PX * _FINER
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (pixels - 1) / 2 * STEP_M / _FINER
    cos, sin = np.cos(part.yaw_rad), np.sin(part.yaw_rad)
    places: Array = np.column_stack([corners @ np.array([[cos, sin], [-sin, cos]]), np.zeros(4)])
    seen = camera.project(world_from_camera, places + np.array(part.position_m)).astype(np.float32)
    own = (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (pixels - 1)).astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    turn = cv2.getPerspectiveTransform(own, seen)
    fine = cv2.warpPerspective(image, turn, (pixels, pixels), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    crop = cv2.resize(fine, (CROP_PX, CROP_PX), interpolation=cv2.INTER_AREA)
    return np.asarray(crop, np.uint8).transpose(2, 0, 1)


def with_embeddings(parts: tuple[PartDetection, ...], crops: Crops, network: Network) -> tuple[PartDetection, ...]:
    """The detections with features of their crops."""
    if not parts:
        return parts
    found = network.run({"crops": crops})["embedding"]
    return tuple(
        replace(part, embedding=tuple(round(float(value), 4) for value in row))
        for part, row in zip(parts, found, strict=True)
    )


class CropReader:
    """A part detector whose detections have embeddings (PartDetector)."""

    def __init__(self, detector: PartDetector, bench: Bench, network: Network) -> None:
        self._detector, self._network = detector, network
        self._camera = bench.wrist.model

    @staticmethod
    def load(detector: PartDetector, bench: Bench, path: Path) -> CropReader:
        """Read the network.

        Raises:
            ModelError: the file is missing, damaged or of another kind.
        """
        return CropReader(detector, bench, load_crops(path))

    def detect(self, frame: Frame) -> tuple[PartDetection, ...]:
        """What the detector finds, each with features of its crop."""
        parts = self._detector.detect(frame)
        return with_embeddings(
            parts, crops_of(frame.image, self._camera, frame.world_from_camera, parts), self._network
        )


def load_crops(path: Path) -> OnnxModel:
    """The network that turns crops into embeddings.

    Raises:
        ModelError: the file is missing, damaged or of another kind.
    """
    model = OnnxModel.load(path, CROPS_KIND)
    answer = model.run({"crops": np.zeros((1, 3, CROP_PX, CROP_PX), np.uint8)})
    if answer["embedding"].shape != (1, EMBEDDING):
        raise ModelError(f"{path}: {answer['embedding'].shape[1]} features of a crop, not {EMBEDDING}")
    return model
