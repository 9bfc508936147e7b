"""Images of cameras, with depth where they have it; one may still be on its way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.pose import Array, Pose

PIXEL_BYTES = 5  # of a pixel with depth: three colours, two bytes of millimetres


@dataclass(frozen=True)
class Frame:
    """One image of one camera.

    Attributes:
        sequence: number of the frame, from 0, without gaps unless frames were lost.
        image: (height, width, 3) uint8, RGB.
        world_from_camera: where the camera was when the frame was taken.
        at_tool: `world_from_camera` tells only where it is at the tool: who reads the frame puts in where the tool was.
        robot_m: (links, n, 3) points around the robot's links and what it holds when the frame was taken: each link is
            in the hull of its points. In the world frame; None if unknown.
        depth_mm: (height, width) uint16, distance from the image plane of what each pixel of the image shows; 0 where
            the camera does not know. None of a camera without depth.
    """

    camera: str
    sequence: int
    time_s: float
    image: NDArray[np.uint8] = field(repr=False, compare=False)
    world_from_camera: Pose
    robot_m: Array | None = field(default=None, repr=False, compare=False)
    at_tool: bool = False
    depth_mm: NDArray[np.uint16] | None = field(default=None, repr=False, compare=False)

    def beside(self, robot_m: Array | None) -> Frame:
        """The same frame, with where the robot was."""
        return replace(self, robot_m=robot_m)

    def seen_from(self, world_from_camera: Pose) -> Frame:
        """The same frame, of a camera that is elsewhere than its driver reports: waits for the image."""
        stamp = self.camera, self.sequence, self.time_s
        return Frame(*stamp, self.image, world_from_camera, self.robot_m, depth_mm=self.depth_mm)

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """Image and depth as one array (height, width, 5), or the image alone: how processes hand them on."""
        return self.image if self.depth_mm is None else together(self.image, self.depth_mm)


def together(image: NDArray[np.uint8], depth_mm: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Image (height, width, 3) and depth (height, width) as `Frame.pixels`."""
    return np.dstack([image, depth_mm.astype("<u2")[..., np.newaxis].view(np.uint8)])


def apart(pixels: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint16] | None]:
    """Image and depth of `Frame.pixels`."""
    if pixels.ndim != 3 or pixels.shape[2] != PIXEL_BYTES:
        return pixels, None
    depth = np.ascontiguousarray(pixels[..., 3:]).view("<u2")[..., 0]
    return np.ascontiguousarray(pixels[..., :3]), depth.astype(np.uint16, copy=False)


class PendingFrame(Frame):
    """A frame whose image is still being made: who reads `image` or `depth_mm` waits, whoever does not goes on."""

    def __init__(
        self,
        camera: str,
        sequence: int,
        time_s: float,
        pixels: Callable[[], NDArray[np.uint8]],
        world_from_camera: Pose,
        done: Callable[[], bool] = lambda: True,
        robot_m: Array | None = None,
    ) -> None:
        fields = {"camera": camera, "sequence": sequence, "time_s": time_s, "world_from_camera": world_from_camera}
        fields["robot_m"] = robot_m
        for name, value in {**fields, "_pending": pixels, "_done": done}.items():
            object.__setattr__(self, name, value)

    @property
    def image(self) -> NDArray[np.uint8]:
        """As in `Frame`; raises DeviceFault if it could not be made."""
        return self._come[0]

    @property
    def depth_mm(self) -> NDArray[np.uint16] | None:
        """As in `Frame`; raises DeviceFault if it could not be made."""
        return self._come[1]

    @property
    def _come(self) -> tuple[NDArray[np.uint8], NDArray[np.uint16] | None]:
        """Image and depth, taken apart once."""
        own = vars(self)
        if "_apart" not in own:
            pending: Callable[[], NDArray[np.uint8]] = own["_pending"]
            object.__setattr__(self, "_apart", apart(pending()))
        found: tuple[NDArray[np.uint8], NDArray[np.uint16] | None] = own["_apart"]
        return found

    @property
    def ready(self) -> bool:
        """Whether the image can be read without a wait."""
        done: Callable[[], bool] = vars(self)["_done"]
        return done()

    def beside(self, robot_m: Array | None) -> PendingFrame:
        """As in `Frame`; the image still comes later."""
        own = vars(self)
        fields = self.camera, self.sequence, self.time_s, own["_pending"], self.world_from_camera, own["_done"]
        return PendingFrame(*fields, robot_m)

    def __reduce__(self) -> tuple[type[Frame], tuple[object, ...]]:
        stamp = self.camera, self.sequence, self.time_s
        return Frame, (*stamp, self.image, self.world_from_camera, self.robot_m, self.at_tool, self.depth_mm)
