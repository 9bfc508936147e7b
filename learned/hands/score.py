"""Scores of a reader on single frames that it was not trained on."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cell.interfaces.bench import Bench
from cell.interfaces.pose import Array
from learned.classical.box_model import View
from learned.hands.dataset import read_image, rows_of
from learned.hands.reading import HandReader, Reading
from learned.scores import ScoreCounter, latencies

FOUND_M = 0.06
LEAST_VISIBLE, EDGE_PX = 0.5, 8.0
SURE = 0.5


def score_readings(reader: HandReader, bench: Bench, folder: Path) -> dict[str, float]:
    """Shares of hands found, of sides, roles and parts right, errors by the image alone [mm], processor time [ms].

    Args:
        folder: of `cell data hands`.
    """
    view = View(bench.overhead.model, bench.overhead.mount.pose)
    size = np.array([bench.overhead.width_px, bench.overhead.height_px])
    counter = ScoreCounter()
    times_s: list[float] = []
    errors: dict[str, list[float]] = {name: [] for name in ("palm", "pinch", "index", "height")}
    for row in rows_of(folder):
        image, began_s = read_image(row["file"]), time.process_time()
        read = reader.read(image, ())
        times_s.append(time.process_time() - began_s)
        readings = [one for one in read if one.confidence >= SURE]
        palms = [_xy(view, one, "palm") for one in readings]
        true = 0
        for hand in row["hands"]:
            points = {name: np.array(px) for name, px in hand["points_px"].items()}
            places = np.array([points["palm"], points["pinch"]])
            heights = {name: point[2] for name, point in hand["points_m"].items()}
            there = {name: view.on_plane(px[np.newaxis], heights[name])[0] for name, px in points.items()}
            nearest = _nearest(palms, there["palm"])
            found = nearest is not None
            true += found
            if hand["visible"] < LEAST_VISIBLE or (places < EDGE_PX).any() or (places >= size - EDGE_PX).any():
                continue
            counter.add("found" if hand["acting"] else "second_found", found)
            if nearest is None:
                continue
            reading = readings[nearest]
            counter.add("side", (reading.left > 0.5) == (hand["side"] == "left"))
            counter.add("acting", (reading.acting > 0.5) == hand["acting"])
            if hand["acting"]:
                counter.add("held", reading.held_part == hand["held_part"])
                for name in ("palm", "pinch", "index"):
                    errors[name].append(float(np.linalg.norm(_xy(view, reading, name) - there[name])))
                errors["height"].append(abs(reading.heights_m[0] - heights["palm"]))
        counter.measure("imagined_per_frame", len(readings) - true)
    told = {
        f"{name}_p{percent}_mm": 1e3 * float(np.percentile(values, percent))
        for name, values in errors.items()
        if values
        for percent in (50, 95)
    }
    return counter.scores() | told | latencies(times_s)


def _nearest(palms: Sequence[Array], true: Array) -> int | None:
    """Number of the palm that is nearest to a true one; None where none is near."""
    distances_m = [float(np.linalg.norm(palm - true)) for palm in palms]
    return int(np.argmin(distances_m)) if min(distances_m, default=FOUND_M) < FOUND_M else None


def _xy(view: View, reading: Reading, name: str) -> Array:
    height_m = reading.heights_m[0 if name in ("palm", "wrist") else 1]
    x_y: Array = view.on_plane(np.asarray(reading.points_px[name])[np.newaxis], height_m)[0]
    return x_y
