"""What one run looks like to its cameras: light, surfaces, person, things lying about, cameras and how they hang.

A `Look` holds the values of one run; its defaults are the look `nominal`. The seed draws a run's values between two
looks (look_range.py). Every number has a unit and legal limits. Pairs are ranges in files, so no value here has
exactly two items.
"""

from __future__ import annotations

import colorsys
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from bracket_ground.files.model import Model
from bracket_ground.interfaces.pose import Pose

Channel = Annotated[float, Field(ge=0, le=1)]
Rgb = tuple[Channel, Channel, Channel]
Hsv = tuple[Channel, Channel, Channel]
Coordinate = Annotated[float, Field(ge=-5, le=5)]

# White of a lamp by its colour temperature, as a camera balanced for 6500 K sees it (rounded black-body colours).
TEMPERATURES_K = (2000.0, 3000.0, 4000.0, 5000.0, 6500.0, 9000.0, 15000.0)
WHITES = (
    (1.0, 0.54, 0.08),
    (1.0, 0.71, 0.42),
    (1.0, 0.82, 0.65),
    (1.0, 0.90, 0.81),
    (1.0, 1.0, 1.0),
    (0.84, 0.89, 1.0),
    (0.70, 0.80, 1.0),
)
# Skin from the palest to the darkest.
SKIN_TONES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
SKINS = (
    (0.95, 0.78, 0.67),
    (0.85, 0.62, 0.48),
    (0.74, 0.51, 0.36),
    (0.57, 0.37, 0.25),
    (0.38, 0.24, 0.17),
    (0.22, 0.14, 0.10),
)


def knob(default: float, least: float, most: float, unit: str) -> Any:
    """A number with its legal limits; "share" and "factor" are units, too."""
    return Field(default=default, ge=least, le=most, json_schema_extra={"unit": unit})


class Lamp(Model):
    """A lamp that shines on the middle of the bench from far away.

    Attributes:
        position_m: where it hangs, in the world; only the direction counts.
        strength: 1 lights a white surface fully.
        temperature_k: colour of its light; 6500 is white, less is warmer.
    """

    position_m: tuple[Coordinate, Coordinate, Coordinate]
    strength: float = knob(0.45, 0, 2, "share")
    temperature_k: float = knob(6500, 2000, 15000, "K")

    @property
    def rgb(self) -> tuple[float, float, float]:
        """Its light by channel."""
        red, green, blue = _between(TEMPERATURES_K, WHITES, self.temperature_k)
        return self.strength * red, self.strength * green, self.strength * blue


class Light(Model):
    """All light.

    Attributes:
        lamps_n: how many of the lamps are on; the first ones.
        lamps: all lamps that there are.
        ambient: light from everywhere.
        headlight: light that comes with the camera.
        shadows: the first lamp casts them; rendering takes four times as long.
    """

    lamps_n: int = knob(2, 0, 3, "lamps")
    lamps: tuple[Lamp, Lamp, Lamp] = (
        Lamp(position_m=(0.3, -0.6, 2.2)),
        Lamp(position_m=(1.2, 0.9, 2.2)),
        Lamp(position_m=(-0.6, 0.8, 2.0)),
    )
    ambient: float = knob(0.35, 0, 1, "share")
    headlight: float = knob(0.15, 0, 1, "share")
    shadows: bool = False


class Surfaces(Model):
    """Colours of what stands still, and of the parts' paint.

    Attributes:
        table_rgb, plate_rgb, tray_rgb, bin_rgb: colour of table, bracket, tray and bins.
        table_grain: contrast of the table's pattern, 0 for a plain one.
        grain_number: which pattern the table has.
        plate_shine: how much the bracket's plate mirrors a lamp.
        paint_fade: share of its saturation that the parts' paint has lost.
        paint_lightness: by which the parts' paint is lighter than in the product file.
    """

    table_rgb: Rgb = (0.24, 0.22, 0.19)
    table_grain: float = knob(0, 0, 1, "share")
    grain_number: int = knob(0, 0, 999_999, "number")
    plate_rgb: Rgb = (0.46, 0.47, 0.48)
    plate_shine: float = knob(0.5, 0, 1, "share")
    tray_rgb: Rgb = (0.16, 0.16, 0.17)
    bin_rgb: Rgb = (0.34, 0.31, 0.25)
    paint_fade: float = knob(0, 0, 1, "share")
    paint_lightness: float = knob(1, 0.3, 2, "factor")

    def painted(self, rgb: tuple[float, float, float]) -> tuple[float, float, float]:
        """The paint of a part whose colour in the product file is `rgb`."""
        if self.paint_fade == 0 and self.paint_lightness == 1:
            return rgb
        grey = sum(rgb) / 3
        red, green, blue = (
            min(1.0, (channel + self.paint_fade * (grey - channel)) * self.paint_lightness) for channel in rgb
        )
        return red, green, blue


class Appearance(Model):
    """The person, as far as cameras see them.

    Attributes:
        hand: one of human shape, or one drawn of few capsules.
        skin_tone: from the palest (0) to the darkest (1).
        glove: the hand that works wears one.
        glove_hsv: the glove's hue, saturation and value.
        sleeve_rgb: colour of the sleeve.
        cuff_m: from the wrist to the sleeve, of a human hand.
        hand_size: of all lengths of the hand; 0.88 is a small woman's, 1.13 a large man's.
        left_hand: the left hand works.
        second_hand: the other hand rests on the table.
        lean_m: how far the head reaches into the overhead view; 0: head and shoulders are out of sight.
        lean_side_m: how far the head is to the person's right of the bracket's middle.
    """

    hand: Literal["drawn", "human"] = "drawn"
    skin_tone: float = knob(0.2, 0, 1, "share")
    glove: bool = False
    glove_hsv: Hsv = (0.6, 0.7, 0.5)
    sleeve_rgb: Rgb = (0.20, 0.20, 0.21)
    cuff_m: float = knob(0.05, 0.02, 0.25, "m")
    hand_size: float = knob(1, 0.7, 1.3, "factor")
    left_hand: bool = False
    second_hand: bool = False
    lean_m: float = knob(0, 0, 0.3, "m")
    lean_side_m: float = knob(0, -0.4, 0.4, "m")

    @property
    def skin_rgb(self) -> tuple[float, float, float]:
        """Colour of bare skin."""
        return _between(SKIN_TONES, SKINS, self.skin_tone)

    @property
    def hand_rgb(self) -> tuple[float, float, float]:
        """Colour of the hand that works: its glove, or skin."""
        return colorsys.hsv_to_rgb(*self.glove_hsv) if self.glove else self.skin_rgb


class Things(Model):
    """What lies about on the table and belongs to nothing; neither robot nor person touches it.

    Attributes:
        tools_n, boxes_n: how many tools and boxes.
        unknown_n: how many things of odd shape and any colour.
        arrangement: number of the arrangement: which of them, where, in which colours.
    """

    tools_n: int = knob(0, 0, 6, "things")
    boxes_n: int = knob(0, 0, 6, "things")
    unknown_n: int = knob(0, 0, 6, "things")
    arrangement: int = knob(0, 0, 999_999, "number")


class Camera(Model):
    """How the cameras take pictures; both are of one make.

    Attributes:
        exposure_s: how long the shutter is open; what moves meanwhile is blurred.
        brightness_ev: exposure against the right one, in stops.
        red_gain, blue_gain: white balance, against green.
        distortion_k1, distortion_k2: radial distortion (Brown-Conrady), which the controller's camera model has not.
        focal_error: by which the focal length is longer than the controller believes.
        noise_levels: standard deviation of every pixel's noise, in grey levels of 255.
        brightness_jitter: standard deviation of a whole frame's gain.
        blur_px: standard deviation of the lens's blur, which also softens the renderer's jagged edges.
        jpeg: frames were compressed on their way.
        jpeg_quality: how well, where they were.
        dropped_share: probability that a frame is lost.
        late_share: probability that a frame comes later than the others.
        late_s: how much later.
        depth_holes: share of bare steel, of black things, of glare and of edges that a depth camera knows nothing of.
    """

    exposure_s: float = knob(0, 0, 0.06, "s")
    brightness_ev: float = knob(0, -4, 4, "stops")
    red_gain: float = knob(1, 0.3, 3, "factor")
    blue_gain: float = knob(1, 0.3, 3, "factor")
    distortion_k1: float = knob(0, -0.4, 0.4, "1")
    distortion_k2: float = knob(0, -0.2, 0.2, "1")
    focal_error: float = knob(0, -0.05, 0.05, "share")
    noise_levels: float = knob(2, 0, 60, "grey levels")
    brightness_jitter: float = knob(0.01, 0, 0.5, "share")
    blur_px: float = knob(0.6, 0, 6, "px")
    jpeg: bool = False
    jpeg_quality: int = knob(80, 5, 100, "percent")
    dropped_share: float = knob(0, 0, 0.5, "share")
    late_share: float = knob(0, 0, 1, "share")
    late_s: float = knob(0, 0, 1, "s")
    depth_holes: float = knob(0, 0, 1, "share")


class MountError(Model):
    """Where a camera really hangs, seen from where the controller believes it (frame of the believed camera).

    Attributes:
        shift_m: how far off.
        shift_azimuth_rad, shift_elevation_rad: in which direction: about the camera's z axis from its x axis, and
            towards z.
        turn_rad: how far turned.
        turn_azimuth_rad, turn_elevation_rad: direction of the axis of that turn.
    """

    shift_m: float = knob(0, 0, 0.1, "m")
    shift_azimuth_rad: float = knob(0, -math.pi, math.pi, "rad")
    shift_elevation_rad: float = knob(0, -math.pi / 2, math.pi / 2, "rad")
    turn_rad: float = knob(0, 0, 0.2, "rad")
    turn_azimuth_rad: float = knob(0, -math.pi, math.pi, "rad")
    turn_elevation_rad: float = knob(0, -math.pi / 2, math.pi / 2, "rad")

    def apply(self, believed: Pose) -> Pose:
        """The true mount of a camera by its believed one."""
        if self.shift_m == 0 and self.turn_rad == 0:
            return believed
        x, y, z = (self.shift_m * part for part in _direction(self.shift_azimuth_rad, self.shift_elevation_rad))
        half = self.turn_rad / 2
        a, b, c = (math.sin(half) * part for part in _direction(self.turn_azimuth_rad, self.turn_elevation_rad))
        return believed @ Pose((x, y, z), (math.cos(half), a, b, c))


class Mounts(Model):
    """How the cameras really hang; the controller knows only its bench file."""

    overhead: MountError = MountError()
    wrist: MountError = MountError()


class Look(Model):
    """Everything that one run looks like."""

    light: Light = Light()
    surfaces: Surfaces = Surfaces()
    person: Appearance = Appearance()
    things: Things = Things()
    camera: Camera = Camera()
    mounts: Mounts = Mounts()


NOMINAL = Look()


def _between(
    knots: tuple[float, ...], colours: tuple[tuple[float, float, float], ...], value: float
) -> tuple[float, float, float]:
    red, green, blue = (float(np.interp(value, knots, channel)) for channel in zip(*colours, strict=True))
    return red, green, blue


def _direction(azimuth_rad: float, elevation_rad: float) -> tuple[float, float, float]:
    level = math.cos(elevation_rad)
    return level * math.cos(azimuth_rad), level * math.sin(azimuth_rad), math.sin(elevation_rad)
