"""Scores of a part detector on labelled images: average precision of boxes, posture, and errors of poses."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.learned.parts.maps import overlap
from bracket_cell.learned.records import UNKNOWN
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection, PartDetector
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.parts.data import Label, Scene

IOU = tuple(0.5 + 0.05 * step for step in range(10))
NEAREST_M = 0.02  # a standing part is compared with the nearest found one of its type up to here
LEAST_SHOWN = 0.15  # of its box; less of a thing may be missed or found
CAMERA = "wrist"
SHARES = ("map_50", "posture", "position_mm_p95")  # of which an interval is given
DRAWS, INTERVAL = 500, (2.5, 97.5)  # of the bootstrap, and its percentiles


@dataclass
class Findings:
    """What a detector said about some scenes, against the truth.

    Attributes:
        found: by type and IoU index, (confidence, whether it is right) of each detection.
        things: by type, how many there are.
        postures: (right, all) of parts that were found.
        position_m, yaw_rad: errors of standing parts.
        standing, missed, extra: standing parts, those without an answer within NEAREST_M, answers without a part.
        seconds: of processor time an image.
    """

    found: dict[tuple[str, int], list[tuple[float, bool]]] = field(default_factory=dict)
    things: dict[str, int] = field(default_factory=dict)
    postures: list[int] = field(default_factory=lambda: [0, 0])
    position_m: list[float] = field(default_factory=list)
    yaw_rad: list[float] = field(default_factory=list)
    standing: int = 0
    missed: int = 0
    extra: int = 0
    seconds: list[float] = field(default_factory=list)

    def scores(self, product: Product) -> dict[str, float]:
        """By name; what was not met with is left out."""
        precisions = {
            name: [average_precision(self.found.get((name, level), []), count) for level in range(len(IOU))]
            for name, count in self.things.items()
            if count
        }
        types = [precisions[name] for name in product.parts if name in precisions]
        out: dict[str, float] = {"things": float(sum(self.things.values())), "standing": float(self.standing)}
        if types:
            out["map_50"] = float(np.mean([each[0] for each in types]))
            out["map_50_95"] = float(np.mean(types))
        if UNKNOWN in precisions:
            out["ap_50_unknown"] = precisions[UNKNOWN][0]
        if self.postures[1]:
            out["posture"], out["posture_n"] = self.postures[0] / self.postures[1], float(self.postures[1])
        if self.standing:
            out["missed"], out["extra"] = self.missed / self.standing, self.extra / self.standing
        for name, values, unit in (
            ("position_mm", self.position_m, 1e3),
            ("yaw_deg", self.yaw_rad, 180 / math.pi),
            ("processor_ms", self.seconds, 1e3),
        ):
            if values:
                out[f"{name}_p50"], out[f"{name}_p95"] = (float(np.percentile(values, p)) * unit for p in (50, 95))
        return out


def together(some: Sequence[Findings]) -> Findings:
    """The findings of several scenes as if they were one."""
    found = Findings()
    for scene in some:
        for key, answers in scene.found.items():
            found.found.setdefault(key, []).extend(answers)
        for name, count in scene.things.items():
            found.things[name] = found.things.get(name, 0) + count
        found.postures = [sum(pair) for pair in zip(found.postures, scene.postures, strict=True)]
        found.position_m += scene.position_m
        found.yaw_rad += scene.yaw_rad
        found.standing, found.missed = found.standing + scene.standing, found.missed + scene.missed
        found.extra += scene.extra
        found.seconds += scene.seconds
    return found


def intervals(each: Sequence[Findings], product: Product) -> dict[str, float]:
    """95 % of the scores in SHARES as NAME_low and NAME_high, by scenes drawn again with replacement (Efron 1979)."""
    rng = np.random.default_rng(0)
    draws = [
        together([each[index] for index in rng.integers(len(each), size=len(each))]).scores(product)
        for _ in range(DRAWS)
    ]
    figures: dict[str, float] = {}
    for name in SHARES:
        if drawn := [scores[name] for scores in draws if name in scores]:
            figures[f"{name}_low"], figures[f"{name}_high"] = (float(end) for end in np.percentile(drawn, INTERVAL))
    return figures


def evaluate_parts(scenes: Sequence[Scene], detector: PartDetector, product: Product, findings: Findings) -> None:
    """Add to the findings what a detector says about scenes, each seen from where the camera is believed to be."""
    for number, scene in enumerate(scenes):
        frame = Frame(CAMERA, number, 0.0, scene.image, scene.believed)
        began_s = time.process_time()
        answers = detector.detect(frame)
        findings.seconds.append(time.process_time() - began_s)
        judge(scene, answers, product, findings)


def judge(scene: Scene, answers: Sequence[PartDetection], product: Product, findings: Findings) -> None:
    """Compare the answers about one scene with its labels."""
    for name in (*product.parts, UNKNOWN):
        labels = [label for label in scene.labels if label.part == name]
        own = sorted((answer for answer in answers if answer.part == name), key=lambda answer: -answer.confidence)
        counted = [label for label in labels if label.shown >= LEAST_SHOWN]
        findings.things[name] = findings.things.get(name, 0) + len(counted)
        for level, least in enumerate(IOU):
            findings.found.setdefault((name, level), []).extend(_matched(own, labels, least, findings, level))
    if any(label.pose is None for label in scene.labels):
        return  # of a person's own pictures boxes are known, and no poses
    for name, kind in product.parts.items():
        _poses([label for label in scene.labels if label.part == name and label.upright and label.shown >= LEAST_SHOWN],
               [answer for answer in answers if answer.part == name and answer.upright],
               kind.alike_after_half_turn, findings)  # fmt: skip


def _matched(
    own: Sequence[PartDetection], labels: Sequence[Label], least: float, findings: Findings, level: int
) -> list[tuple[float, bool]]:
    """The surest answer takes the best box first; one that meets something hardly seen does not count."""
    free, scored = list(labels), []
    for detection in own:
        best = max(free, key=lambda label: overlap(np.array(detection.box_px, float), label.box_px), default=None)
        right = best is not None and overlap(np.array(detection.box_px, float), best.box_px) >= least
        if right and best is not None:
            free = [label for label in free if label is not best]
            if level == 0 and best.part != UNKNOWN and best.upright is not None and best.shown >= LEAST_SHOWN:
                findings.postures[0] += best.upright == detection.upright
                findings.postures[1] += 1
            if best.shown < LEAST_SHOWN:
                continue
        scored.append((detection.confidence, right))
    return scored


def _poses(labels: Sequence[Label], answers: Sequence[PartDetection], alike: bool, findings: Findings) -> None:
    findings.standing += len(labels)
    free = list(answers)
    for label in labels:
        assert label.pose is not None
        place = label.pose.position_m
        near = [(math.dist(box.world_from_part.position_m[:2], place[:2]), index) for index, box in enumerate(free)]
        if not near or min(near)[0] > NEAREST_M:
            findings.missed += 1
            continue
        off_m, index = min(near)
        turn = free.pop(index).world_from_part.yaw_rad - label.pose.yaw_rad
        whole = math.pi if alike else 2 * math.pi
        findings.position_m.append(off_m)
        findings.yaw_rad.append(abs((turn + whole / 2) % whole - whole / 2))
    findings.extra += len(free)


def average_precision(found: Sequence[tuple[float, bool]], count: int) -> float:
    """Area under precision over recall, precision made monotone (PASCAL VOC 2010 and later)."""
    if count == 0:
        return math.nan
    right = np.array([good for _, good in sorted(found, key=lambda pair: -pair[0])], float)
    hits = np.cumsum(right)
    precision = hits / np.arange(1, len(right) + 1)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    return float((precision * right).sum() / count)
