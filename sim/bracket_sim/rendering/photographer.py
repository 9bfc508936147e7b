"""Turns exposures into frames: renders what a camera saw and spoils it like its sensor. Needs no world, only poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_sim.rendering.studio import ScenePoses, Stage, Studio, show_poses
from bracket_sim.scene.lens import Lens
from bracket_sim.scene.look import Camera

BASELINE_M, FOCAL_PX = 0.050, 425.0  # of the stereo pair at 848 x 480
DISPARITY_PX = 0.08  # standard deviation of a matched pixel on a textured surface
SCALE_SPREAD = 0.005  # of the calibration, drawn once
WINDOW_PX, FATTENED_PX = 4.0, 2  # pixels that share an error; by so much the foreground is wider
LOST_FROM, LOST_PX = 1.88, 3.0  # standard deviations: 3 % of pixels, in blobs of so many
COARSE = 2  # pixels, along both axes, for which noise is drawn once
NEAREST_M, FARTHEST_M = 0.28, 10.0  # the least of a D435 at 848 x 480
EDGE_M, GLARE = 0.03, 250  # step in a pixel from which it is an edge; grey level of light that outshines the pattern

DepthImage = NDArray[np.uint16]


class Stereo:
    """Spoils clean depths; the same depths in the same order come out the same.

    Args:
        rng: this sensor's alone.
    """

    def __init__(self, setup: CameraSetup, look: Camera, rng: np.random.Generator) -> None:
        self._rng, self._lens = rng, Lens(setup, look)
        self._shift_px = setup.focal_px * BASELINE_M  # disparity at 1 m, in pixels of the colour image
        self._scale = 1 + float(rng.normal(0.0, SCALE_SPREAD))
        self._holes = min(max(look.depth_holes, EPS), 1 - EPS)

    @property
    def loses_things(self) -> bool:
        """Whether it has holes that belong to things."""
        return self._holes > EPS

    def spoil(self, depths_m: NDArray[np.float32], weak: NDArray[np.bool_] | None = None) -> DepthImage:
        """What the camera sends, in [mm], pixel by pixel as the colour image; 0 where it knows nothing.

        Args:
            depths_m: (height, width) true distances from the image plane, by a pinhole camera.
            weak: (height, width) where stereo finds little to match; there and at edges `depth_holes` of the look are
                lost, in blobs.
        """
        seen = self._lens.bend_nearest(depths_m)
        window = np.ones((2 * FATTENED_PX + 1,) * 2, np.uint8)
        near = np.asarray(cv2.erode(seen, window), np.float32)
        error = near**2 * DISPARITY_PX / (FOCAL_PX * BASELINE_M)
        depth = near * self._scale + error * self._smooth(near.shape, WINDOW_PX / 2)
        blobs = self._smooth(near.shape, LOST_PX)
        lost = (blobs > LOST_FROM) | self._one_eyed(seen) | (depth > FARTHEST_M) | (depth < NEAREST_M)
        if weak is not None:
            steps = cv2.morphologyEx(seen, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
            weak = self._lens.bend_nearest(weak.astype(np.float32)).astype(bool) | (steps > EDGE_M)
            lost |= weak & (self._smooth(near.shape, LOST_PX) < NormalDist().inv_cdf(self._holes))
        millimetres = np.where(lost, 0.0, np.rint(1e3 * depth)).astype(np.uint16)
        millimetres.setflags(write=False)
        return millimetres

    def _smooth(self, shape: tuple[int, ...], sigma_px: float) -> NDArray[np.float32]:
        """Noise with standard deviation 1, alike within some pixels."""
        coarse = [-(-side // COARSE) for side in shape]
        noise = self._rng.standard_normal(coarse, dtype=np.float32)
        smooth = cv2.GaussianBlur(noise, (0, 0), sigma_px / COARSE)
        whole = np.asarray(cv2.resize(smooth, shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        found: NDArray[np.float32] = whole / whole.std()
        return found

    def _one_eyed(self, depths_m: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Where something nearer stands before the second camera: to the left of its edge."""
        columns = np.arange(depths_m.shape[1]) - self._shift_px / depths_m
        from_right = np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
        hidden = np.zeros(depths_m.shape, bool)
        hidden[:, :-1] = from_right[:, 1:] < columns[:, :-1]
        return hidden


EPS = 1e-9
WHITE = 255
BANK_FRAMES = 2  # length of the noise bank, in images
RECENT_FRAMES = 128  # whose noise does not come again: a sensor's never does
ALIKE_PX, ALIKE_ROWS = 4, 2  # by which noise is moved at most where JPEG makes it like what it was
STILL = 1e-4  # by which a place [m] or a direction may change while the shutter is open, so that nothing is blurred

Image = NDArray[np.uint8]


class Sensor:
    """Spoils clean images; the same images in the same order come out the same.

    Args:
        rng: this sensor's alone.
    """

    def __init__(self, setup: CameraSetup, look: Camera, rng: np.random.Generator) -> None:
        self.width_px, self.height_px = setup.width_px, setup.height_px
        self._look, self._rng = look, rng
        self._lens = Lens(setup, look)
        # Drawing a normal number for each pixel costs as much as rendering, so frames cut theirs from a longer bank.
        size = self.width_px * self.height_px * 3
        bank = np.rint(rng.standard_normal(BANK_FRAMES * size, dtype=np.float32) * look.noise_levels)
        # Apart by sign, as bytes: what saturates is added four times as fast as wider numbers are.
        self._brighter, self._darker = (np.clip(noise, 0, WHITE).astype(np.uint8) for noise in (bank, -bank))
        self._starts: deque[int] = deque(maxlen=RECENT_FRAMES)

    def spoil(self, clean: Image) -> Image:
        """The frame of a clean image (height, width, 3), RGB."""
        look = self._look
        seen = self._lens.bend(clean)
        if look.blur_px > 0:
            seen = cv2.GaussianBlur(seen, (0, 0), look.blur_px).astype(np.uint8, copy=False)
        exposed, (brighter, darker) = self._exposed(seen), self._grain(seen)
        spoiled: Image = exposed  # its memory is used again: nobody else has it
        cv2.subtract(cv2.add(exposed, brighter, dst=spoiled), darker, dst=spoiled)
        if look.jpeg:
            spoiled = _compressed(spoiled, look.jpeg_quality)
        spoiled.setflags(write=False)
        return spoiled

    def _exposed(self, image: Image) -> Image:
        look = self._look
        gain = max(0.0, 1.0 + look.brightness_jitter * self._rng.standard_normal()) * 2.0**look.brightness_ev
        bright = cv2.convertScaleAbs(image, alpha=gain).astype(np.uint8, copy=False)
        for channel, balance in ((0, look.red_gain), (2, look.blue_gain)):
            if balance != 1:
                bright[..., channel] = cv2.convertScaleAbs(image[..., channel], alpha=gain * balance)
        return bright

    def _grain(self, image: Image) -> tuple[Image, Image]:
        """How much brighter and how much darker each pixel is than it should be; one of them is 0."""
        start = self._start(self._brighter.size - image.size + 1)
        end = start + image.size
        return self._brighter[start:end].reshape(image.shape), self._darker[start:end].reshape(image.shape)

    def _start(self, most: int) -> int:
        """Where noise is cut from the bank: away from where the last frames had theirs, if there is room."""
        start, row = int(self._rng.integers(most)), 3 * self.width_px
        for _ in range(RECENT_FRAMES):
            off = np.abs(start - np.array(self._starts, int))
            beside = np.minimum(off % row, -off % row) <= 3 * ALIKE_PX
            if not (beside & (off <= (ALIKE_ROWS + 1) * row)).any():
                break
            start = (start + row // 2) % most
        self._starts.append(start)
        return start


def _compressed(image: Image, quality: int) -> Image:
    """What JPEG leaves of an image."""
    _, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert decoded is not None
    return cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


@dataclass(frozen=True)
class Exposure:
    """All that a frame is made from.

    Attributes:
        sequence: number of the camera's frame, from 0.
        world_from_camera: as the frame will tell it.
        moments: poses of everything that can be seen, from the shutter's opening to its closing.
    """

    camera: str
    sequence: int
    time_s: float
    world_from_camera: Pose
    moments: tuple[ScenePoses, ...]


@dataclass(frozen=True)
class SensorSetup:
    """How a camera's images come about; `rng` belongs to this sensor alone."""

    setup: CameraSetup
    look: Camera
    rng: np.random.Generator


def moves(moments: Sequence[ScenePoses]) -> bool:
    """Whether anything is elsewhere at one moment than at the first, so that it can be seen."""
    return any(
        bool((np.abs(now - then) > STILL).any())
        for moment in moments[1:]
        for now, then in zip(moment, moments[0], strict=True)
    )


class Photographer:
    """Makes the frames of some cameras, each camera's in their order.

    Args:
        model: the compiled cell.
        sensors: by the camera's name.
    """

    def __init__(self, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup]) -> None:
        self._data = mujoco.MjData(model)
        self._studio = Studio(Stage(model, self._data))
        self._sensors = {name: Sensor(setup.setup, setup.look, setup.rng) for name, setup in sensors.items()}
        self._stereo = {
            name: Stereo(setup.setup, setup.look, setup.rng.spawn(1)[0])  # so that colours are the same without depths
            for name, setup in sensors.items()
            if setup.setup.depth
        }

    def take(self, exposure: Exposure) -> Frame:
        """The frame of an exposure."""
        sensor = self._sensors[exposure.camera]
        clean = self._gathered(exposure, sensor)
        image = sensor.spoil(clean)
        stereo, depth_mm = self._stereo.get(exposure.camera), None
        if stereo is not None:
            seen = exposure.camera, sensor.width_px, sensor.height_px
            weak = self._studio.unmatched(*seen) | (clean.min(axis=2) >= GLARE) if stereo.loses_things else None
            depth_mm = stereo.spoil(self._studio.depths_m(*seen), weak)
        stamp = exposure.camera, exposure.sequence, exposure.time_s
        return Frame(*stamp, image, exposure.world_from_camera, depth_mm=depth_mm)

    def _gathered(self, exposure: Exposure, sensor: Sensor) -> Image:
        """What the sensor gathers until the shutter closes; where nothing moves, one moment is as good as all."""
        moments = exposure.moments if moves(exposure.moments) else exposure.moments[-1:]
        clean = [self._clean(exposure.camera, sensor, poses) for poses in moments]
        return clean[0] if len(clean) == 1 else np.rint(np.mean(clean, axis=0)).astype(np.uint8)

    def _clean(self, camera: str, sensor: Sensor, poses: ScenePoses) -> Image:
        show_poses(self._data, poses)
        return self._studio.render(camera, sensor.width_px, sensor.height_px)

    def close(self) -> None:
        """Let go of the graphics contexts."""
        self._studio.close()
