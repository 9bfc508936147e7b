"""Scores of a reader on single frames that it was not trained on."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.reading import HandReader, Reading
from bracket_cell.learned.hands.records import HandRow
from bracket_cell.learned.records import read_image
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.hands.data import LabelledFrame
from bracket_lab.learned.scores import ScoreCounter, latencies

FOUND_M = 0.06
LEAST_VISIBLE, EDGE_PX = 0.5, 8.0
SURE = 0.5


def score_readings(reader: HandReader, bench: Bench, frames: Iterable[LabelledFrame]) -> dict[str, float]:
    """Shares of hands found, of sides, roles and parts right, errors by the image alone [mm], processor time [ms].

    Args:
        frames: in which it is known where each hand is in space.
    """
    scored, times_s = _Scored(bench), list[float]()
    for row, file in ((frame.row, frame.file) for frame in frames):
        image, began_s = read_image(file), time.process_time()
        read = reader.read(image, ())
        times_s.append(time.process_time() - began_s)
        readings = [reading for reading in read if reading.confidence >= SURE]
        true = sum(scored.add(hand, readings) for hand in row.hands)
        scored.counter.measure("imagined_per_frame", len(readings) - true)
    return scored.counter.scores() | scored.errors() | latencies(times_s)


class _Scored:
    """What was right and how far off, hand by hand."""

    def __init__(self, bench: Bench) -> None:
        self._view = View(bench.overhead.model, bench.overhead.mount.pose)
        self._size = np.array([bench.overhead.width_px, bench.overhead.height_px])
        self._errors_m: dict[str, list[float]] = {name: [] for name in ("palm", "pinch", "index", "height")}
        self.counter = ScoreCounter()

    def add(self, hand: HandRow, readings: Sequence[Reading]) -> bool:
        """One more true hand, a row's, and the readings of its frame; whether one of them is near it."""
        view = self._view
        points = {name: np.array(px) for name, px in hand.points_px.items()}
        heights = {name: point[2] for name, point in hand.points_m.items()}
        there = {name: view.on_plane(px[np.newaxis], heights[name])[0] for name, px in points.items()}
        nearest = _nearest([_xy(view, ing, "palm") for ing in readings], there["palm"])
        if self._must_be_found(hand.visible, np.array([points["palm"], points["pinch"]])):
            self.counter.add("found" if hand.acting else "second_found", nearest is not None)
            if nearest is not None:
                self._compare(hand, readings[nearest], there)
        return nearest is not None

    def errors(self) -> dict[str, float]:
        """Medians and 95 % of the errors in [mm], by name."""
        return {
            f"{name}_p{percent}_mm": 1e3 * float(np.percentile(values, percent))
            for name, values in self._errors_m.items()
            if values
            for percent in (50, 95)
        }

    def _must_be_found(self, visible: float, places: Array) -> bool:
        inside = (places >= EDGE_PX).all() and (places < self._size - EDGE_PX).all()
        return bool(visible >= LEAST_VISIBLE and inside)

    def _compare(self, hand: HandRow, reading: Reading, there: Mapping[str, Array]) -> None:
        self.counter.add("side", (reading.left > 0.5) == (hand.side == "left"))
        self.counter.add("acting", (reading.acting > 0.5) == hand.acting)
        if not hand.acting:
            return
        self.counter.add("held", reading.held_part == hand.held_part)
        for name in ("palm", "pinch", "index"):
            self._errors_m[name].append(float(np.linalg.norm(_xy(self._view, reading, name) - there[name])))
        self._errors_m["height"].append(abs(reading.heights_m[0] - hand.points_m["palm"][2]))


def _nearest(palms: Sequence[Array], true: Array) -> int | None:
    """Number of the palm that is nearest to a true one; None where none is near."""
    distances_m = [float(np.linalg.norm(palm - true)) for palm in palms]
    return int(np.argmin(distances_m)) if min(distances_m, default=FOUND_M) < FOUND_M else None


def _xy(view: View, reading: Reading, name: str) -> Array:
    height_m = reading.heights_m[0 if name in ("palm", "wrist") else 1]
    x_y: Array = view.on_plane(np.asarray(reading.points_px[name])[np.newaxis], height_m)[0]
    return x_y
