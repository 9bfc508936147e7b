"""What detectors found, drawn over camera images by viewers: hand, holes and parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from foxglove import messages

from cell.interfaces.bench import Bench
from cell.interfaces.perception import BenchView, HoleView, PartDetection
from cell.interfaces.product import Product
from cell.recording.scene_frames import timestamp

YELLOW, WHITE, GREY, RED = (1.0, 0.86, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0), (0.7, 0.7, 0.7, 1.0), (1.0, 0.2, 0.2, 1.0)
SHADE = messages.Color(r=0.0, g=0.0, b=0.0, a=0.55)
FONT_PX = 12.0
LINE_PX = 2.0

Box = tuple[int, int, int, int]
Colour = tuple[float, float, float, float]


class HoleMarks:
    """Where the bracket's holes are in the overhead image, and what is read in them."""

    def __init__(self, product: Product, bench: Bench) -> None:
        holes_m = np.array([[x, y, 0.0] for x, y in product.bracket.holes_m.values()])
        camera = bench.overhead
        pixels = camera.model.project(camera.mount.pose, bench.bracket.pose.transform(holes_m))
        self._centres = dict(zip(product.positions, pixels.tolist(), strict=True))
        depth_m = camera.mount.position_m[2] - bench.bracket.position_m[2]
        widest_m = max(part.peg_diameter_m for part in product.parts.values())
        self._diameter_px = camera.focal_px * (widest_m + 2 * product.bracket.hole_clearance_m) / depth_m
        self._colours: dict[str | None, Colour] = {name: (*p.colour_rgb, 1.0) for name, p in product.parts.items()}

    @property
    def boxes_px(self) -> dict[str, tuple[float, float, float, float]]:
        """(left, top, right, bottom) around each hole, by position."""
        half = self._diameter_px / 2
        return {name: (x - half, y - half, x + half, y + half) for name, (x, y) in self._centres.items()}

    def message(self, stamp_ns: int, holes: Mapping[str, HoleView]) -> messages.ImageAnnotations:
        """Circles and names; grey where a hole was never seen, red where a part is tilted."""
        stamp, circles, texts = timestamp(stamp_ns), [], []
        for position, (x, y) in self._centres.items():
            hole = holes.get(position)
            tilted = hole is not None and not hole.upright
            colour = GREY if hole is None else RED if tilted else self._colours.get(hole.part, WHITE)
            circles.append(
                messages.CircleAnnotation(
                    timestamp=stamp,
                    position=messages.Point2(x=x, y=y),
                    diameter=self._diameter_px,
                    thickness=LINE_PX,
                    outline_color=_colour(colour),
                )
            )
            read = "?" if hole is None else f"{hole.part or '-'}{' tilted' if tilted else ''}"
            texts.append(_text(stamp, x + self._diameter_px * 0.8, y + FONT_PX / 2, f"{position} {read}", WHITE))
        return messages.ImageAnnotations(timestamp=stamp, circles=circles, texts=texts)


def hand_overlay(stamp_ns: int, view: BenchView) -> messages.ImageAnnotations:
    """The hand's box with what it holds, and the action; empties the overlay where no hand is seen."""
    stamp, hand = timestamp(stamp_ns), view.hand
    action = _text(stamp, 6.0, 16.0, f"{view.action} {view.action.confidence:.2f}", WHITE)
    if hand is None:
        return messages.ImageAnnotations(timestamp=stamp, texts=[action])
    label = _text(stamp, hand.box_px[0], hand.box_px[1] - 3.0, f"hand, holds {hand.held_part or 'nothing'}", YELLOW)
    return messages.ImageAnnotations(timestamp=stamp, points=[_box(stamp, hand.box_px, YELLOW)], texts=[action, label])


def parts_overlay(stamp_ns: int, product: Product, parts: Sequence[PartDetection]) -> messages.ImageAnnotations:
    """A box and a label for each part in the wrist image, numbered as in the plans of the log."""
    stamp = timestamp(stamp_ns)
    return messages.ImageAnnotations(
        timestamp=stamp,
        points=[_box(stamp, part.box_px, (*product.parts[part.part].colour_rgb, 1.0)) for part in parts],
        texts=[
            _text(stamp, part.box_px[0], part.box_px[1] - 3.0, f"{number}: {part.part} {part.confidence:.2f}", WHITE)
            for number, part in enumerate(parts)
        ],
    )


def _box(stamp: messages.Timestamp, box_px: Box, colour: Colour) -> messages.PointsAnnotation:
    left, top, right, bottom = box_px
    corners = ((left, top), (right, top), (right, bottom), (left, bottom))
    return messages.PointsAnnotation(
        timestamp=stamp,
        type=messages.PointsAnnotationType.LineLoop,
        points=[messages.Point2(x=x, y=y) for x, y in corners],
        outline_color=_colour(colour),
        thickness=LINE_PX,
    )


def _text(stamp: messages.Timestamp, x: float, y: float, text: str, colour: Colour) -> messages.TextAnnotation:
    return messages.TextAnnotation(
        timestamp=stamp,
        position=messages.Point2(x=x, y=y),
        text=text,
        font_size=FONT_PX,
        text_color=_colour(colour),
        background_color=SHADE,
    )


def _colour(rgba: Colour) -> messages.Color:
    red, green, blue, alpha = rgba
    return messages.Color(r=red, g=green, b=blue, a=alpha)
