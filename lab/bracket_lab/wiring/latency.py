"""How much processor time each detector of a configuration takes for a frame, and where that is kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.kinds import kind_of
from bracket_cell.learned.bench_watcher import DetectorChain
from bracket_cell.learned.inference.onnx_model import CARD_KEY, ModelCard, save_onnx
from bracket_cell.settings import Perception
from bracket_cell.wiring.detectors import LATENCY_SCORE, Detectors, tray_view
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.product import Product
from bracket_lab.wiring.drawn_frames import overhead_frames, tray_scenes

WATCHING = {"hands": "track", "holes": "read", "actions": "detect"}
WARM_UP = 5  # frames that do not count


def watching_s(configuration: Configuration, product: Product, frames: Iterable[Frame]) -> dict[str, list[float]]:
    """Processor seconds of each overhead detector for each frame, and those of all that is done with it ("frame")."""
    cv2.setNumThreads(1)
    made = Detectors(configuration.bench, product, configuration.perception)
    spent: dict[str, list[float]] = {name: [] for name in (*WATCHING, "frame")}
    parts: list[Any] = [_Timed(made.make(name), method, spent[name]) for name, method in WATCHING.items()]
    watch = _timed(DetectorChain(configuration.bench, product, *parts).watch, spent["frame"])
    for frame in frames:
        watch(frame)
    return {name: values[WARM_UP:] for name, values in spent.items()}


def finding_s(configuration: Configuration, product: Product, frames: Iterable[Frame]) -> dict[str, list[float]]:
    """Processor seconds of the part detector for each wrist frame, and those of all that is done with it ("tray")."""
    cv2.setNumThreads(1)
    spent: dict[str, list[float]] = {"parts": [], "tray": []}
    made = Detectors(configuration.bench, product, configuration.perception).make("parts")
    detector: Any = _Timed(made, "detect", spent["parts"])
    find = _timed(tray_view(configuration.bench, product, detector), spent["tray"])
    for frame in frames:
        find(frame)
    return {name: values[WARM_UP:] for name, values in spent.items()}


def latencies_ms(
    configuration: Configuration, product: Product, frames: int, trays: int, first_seed: int
) -> dict[str, dict[str, float]]:
    """Median and 95th percentile of each detector's processor time; "frame" and "tray": all that an image costs."""
    spent = watching_s(configuration, product, islice(overhead_frames(configuration, product, first_seed), frames))
    scenes = tray_scenes(configuration, product, range(first_seed, first_seed + trays), mixed=True)
    images = [Frame("wrist", number, 0.0, scene.image, scene.believed) for number, scene in enumerate(scenes)]
    spent |= finding_s(configuration, product, images)
    return {
        name: {f"p{percent}_ms": round(1e3 * float(np.percentile(values, percent)), 2) for percent in (50, 95)}
        for name, values in spent.items()
    }


def p95_ms(seconds: list[float]) -> float:
    """The 95th percentile, in ms."""
    return float(np.percentile(seconds, 95)) * 1e3


def answers_ms(found: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """p95 [ms] of what each detector's answer costs; that of the tray comes when it is fitted how parts lie, too."""
    rows = {**{name: name for name in WATCHING}, "parts": "tray"}
    return {name: found[row]["p95_ms"] for name, row in rows.items()}


def note_latencies(perception: Perception, found: Mapping[str, float]) -> list[Path]:
    """Write p95 [ms] by detector onto the cards of the trained ones; returns the files."""
    written = []
    for name, value in found.items():
        if not kind_of(name, perception.chosen(name)).card:
            continue
        written.append(perception.weights(name))
        note_scores(written[-1], {LATENCY_SCORE: round(value, 2)})
    return written


def note_scores(path: Path, scores: Mapping[str, float]) -> None:
    """Write scores onto the card of weights; others on it stay."""
    import onnx

    model = onnx.load(path)
    card = next(entry.value for entry in model.metadata_props if entry.key == CARD_KEY)
    read = ModelCard.model_validate_json(card)
    save_onnx(model, path, read.model_copy(update={"scores": {**read.scores, **scores}}))


class _Timed:
    """A detector whose one method is timed."""

    def __init__(self, inner: Any, method: str, spent: list[float]) -> None:
        self._inner = inner
        setattr(self, method, _timed(getattr(inner, method), spent))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


def _timed(call: Callable[..., Any], spent: list[float]) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        began_s = time.process_time()
        answer = call(*arguments)
        spent.append(time.process_time() - began_s)
        return answer

    return timed
