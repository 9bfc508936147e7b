"""A page of the pictures that a part detector answers worst, beside the classical one, and how sure its figure is."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from bracket_cell.learned.parts.maps import overlap
from bracket_ground.files.files import write_whole
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.product import Product
from bracket_lab.evaluations.detections import RED, WHITE, Canvas
from bracket_lab.learned.parts.data import Scene
from bracket_lab.learned.parts.evaluate import Findings, intervals, judge

SAME, RIGHT = 0.5, (90, 220, 90)  # intersection over union of one thing; colour of a right answer
SHOWN = 24  # pictures on the page
STYLE = "body{font:15px sans-serif;margin:2em;max-width:1400px} img{max-width:49%} td,th{padding:0 1em;text-align:left}"


@dataclass(frozen=True)
class Judged:
    """A picture, and what was answered.

    Attributes:
        wrong: in words, what is missed, misnamed or not there.
        things: labels and answers that there are.
        image: labels in white, right answers in green, others in red.
    """

    name: str
    wrong: tuple[str, ...]
    things: int
    image: Image

    @property
    def badness(self) -> tuple[float, int]:
        """By which pictures are ordered: the share of things that are wrong, then how many they are."""
        return len(self.wrong) / max(1, self.things), len(self.wrong)


def judged(scene: Scene, answers: Sequence[PartDetection]) -> Judged:
    """Each answer, the surest first, takes the free label that it overlaps most."""
    canvas = Canvas(Frame("wrist", 0, 0.0, scene.image, scene.world_from_camera), scene.camera)
    for label in scene.labels:
        canvas.box(label.box_px.tolist(), label.part, WHITE)
    free, wrong = list(scene.labels), []
    for detection in sorted(answers, key=lambda answer: -answer.confidence):
        box = np.array(detection.box_px, float)
        best = max(free, key=lambda label: overlap(box, label.box_px), default=None)
        if best is None or overlap(box, best.box_px) < SAME:
            said = f"{detection.part} where none is"
        else:
            said = "" if best.part == detection.part else f"{best.part} called {detection.part}"
            free = [label for label in free if label is not best]
        wrong += [said] if said else []
        canvas.box(detection.box_px, f"{detection.part} {detection.confidence:.2f}", RED if said else RIGHT)
    wrong += [f"{label.part} missed" for label in free]
    return Judged(scene.log, tuple(wrong), len(scene.labels) + len(answers), canvas.image)


def interval(scenes: Sequence[Scene], answers: Sequence[Sequence[PartDetection]], product: Product) -> dict[str, float]:
    """95 % of the scores, by pictures."""
    each = [Findings() for _ in scenes]
    for scene, some, findings in zip(scenes, answers, each, strict=True):
        judge(scene, some, product, findings)
    return intervals(each, product)


def write_page(
    path: Path, title: str, scores: Mapping[str, float], own: Sequence[Judged], other: Sequence[Judged]
) -> int:
    """Write one HTML file, the worst pictures first; returns how many pictures have something wrong.

    Args:
        own, other: of the same pictures, by this detector and by the classical one.
    """
    pairs = sorted(zip(own, other, strict=True), key=lambda pair: pair[0].badness, reverse=True)
    bad = [pair for pair in pairs if pair[0].wrong]
    rows = "".join(f"<tr><th>{html.escape(name)}<td>{value:.3g}" for name, value in scores.items())
    shown = "".join(
        f"<h2>{html.escape(seen.name)}: {html.escape(', '.join(seen.wrong))}</h2>{_img(seen.image)} {_img(rival.image)}"
        for seen, rival in bad[:SHOWN]
    )
    text = f"{len(bad)} of {len(pairs)} pictures have something wrong; the worst {min(SHOWN, len(bad))} follow. "
    text += "White: your labels. Green: right. Red: wrong. On the right the classical detector."
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
    page = f"{head}<style>{STYLE}</style><h1>{html.escape(title)}</h1><table>{rows}</table><p>{text}</p>{shown}</html>"
    write_whole(path, page.encode())
    return len(bad)


def _img(image: Image) -> str:
    encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes()
    return f'<img src="data:image/jpeg;base64,{base64.b64encode(encoded).decode()}" alt="">'
