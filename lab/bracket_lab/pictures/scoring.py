"""How right a detector is on labelled pictures, beside the classical one or the commonest answer on the same ones."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.learned.actions.segments import SegmentReader
from bracket_cell.learned.actions.settings import Classes
from bracket_cell.learned.holes.model import VOTES, Reading
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.learned.records import read_image
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench, CameraCalibration
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetector
from bracket_ground.interfaces.places import Mount
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.actions.data import Segments, load_segments
from bracket_lab.learned.actions.evaluate import answers, class_scores
from bracket_lab.learned.hands.data import LabelledFrame, frames_of
from bracket_lab.learned.holes.evaluate import HoleFindings, Plate, load_plates
from bracket_lab.learned.parts.data import Scene, load_scenes
from bracket_lab.learned.parts.evaluate import Findings, evaluate_parts
from bracket_lab.learned.scores import ScoreCounter
from bracket_lab.learned.training.still_dataset import Still
from bracket_lab.pictures.suggestions import Often
from bracket_lab.pictures.worst import interval, judged, write_page
from bracket_lab.wiring.latency import note_scores

Scores = dict[str, float]
CLASSICAL, TRIVIAL, PICTURES = "_classical", "_trivial", "pictures_"
LOOKS = 3  # at one picture by a tracker: a new hand must be sure
POOR = {"right": 0.8, "map_50": 0.3, "found": 0.5, "accuracy": 0.5}  # chosen: of a lower figure a run gets nothing
MORE = "label more pictures, of other days and light, look at the labels (cell label DIR), or take twice as many epochs"
MEASURES = {"holes": "right", "parts": "map_50", "hands": "found", "actions": "accuracy"}


@dataclass(frozen=True)
class Scorer:
    """Scores detectors of one task for one cell.

    Attributes:
        weights: of the kind; the configured ones where None.
    """

    configuration: Configuration
    product: Product
    task: str
    kind: str
    weights: Path | None = None

    def scores(self, pictures: Sequence[Any] | Segments) -> Scores:
        """By name; `NAME_classical` or `NAME_trivial` is what the baseline has on the same pictures.

        Raises:
            InputError: there are none.
        """
        if not len(pictures):
            raise InputError(f"no labelled pictures for {self.task}")
        measure = MEASURES[self.task]
        if isinstance(pictures, Segments):
            return self._actions(pictures)
        found = self._found(pictures, self.kind, self.weights)
        if self.kind == "classical":
            return found
        baseline = self._found(pictures, "classical", None)
        return {measure: 0.0, **found, f"{measure}{CLASSICAL}": baseline.get(measure, 0.0)}

    def _found(self, pictures: Sequence[Any], kind: str, weights: Path | None) -> Scores:
        score: Callable[[Sequence[Any], str, Path | None], Scores] = getattr(self, f"_{self.task}")
        return score(pictures, kind, weights)

    def _made(self, bench: Bench, kind: str, weights: Path | None) -> Any:
        perception = self.configuration.perception.with_detector(self.task, kind, weights)
        return Detectors(bench, self.product, perception).make(self.task)

    def _holes(self, plates: Sequence[Plate], kind: str, weights: Path | None) -> Scores:
        findings, looks = HoleFindings(), max(VOTES, self.configuration.perception.classical.settle_frames)
        for plate in plates:
            reader = self._made(as_taken(self.configuration.bench, "overhead", plate), kind, weights)
            views = Often(reader, looks).read(Frame("overhead", 0, 0.0, plate.image, plate.world_from_camera), None)
            for hole in plate.holes:
                seen = views.get(hole.position)
                findings.add(hole, None if seen is None else Reading(seen.part, seen.upright, seen.confidence))
        return findings.scores()

    def _parts(self, scenes: Sequence[Scene], kind: str, weights: Path | None) -> Scores:
        findings = Findings()
        for scene in scenes:
            placed = replace(scene, believed=scene.world_from_camera)
            evaluate_parts([placed], self._part_detector(scene, kind, weights), self.product, findings)
        return findings.scores(self.product)

    def _part_detector(self, scene: Scene, kind: str, weights: Path | None) -> PartDetector:
        made: PartDetector = self._made(as_taken(self.configuration.bench, "wrist", scene), kind, weights)
        return made

    def worst_parts(self, scenes: Sequence[Scene], scores: Scores, path: Path) -> tuple[Scores, int]:
        """A page of the worst pictures; returns the interval of the mAP, and in how many something is wrong."""
        own, classical = (
            [
                self._part_detector(scene, kind, weights).detect(Frame("wrist", 0, 0.0, scene.image, scene.believed))
                for scene in (replace(still, believed=still.world_from_camera) for still in scenes)
            ]
            for kind, weights in ((self.kind, self.weights), ("classical", None))
        )
        found = interval(scenes, own, self.product)
        pictures = ([judged(*pair) for pair in zip(scenes, some, strict=True)] for some in (own, classical))
        return found, write_page(path, f"parts, {self.kind}", {**scores, **found}, *pictures)

    def _hands(self, frames: Sequence[LabelledFrame], kind: str, weights: Path | None) -> Scores:
        """A hand counts as found where a palm is told within its box."""
        counter, bench = ScoreCounter(), self.configuration.bench
        camera, pose = bench.overhead.model, bench.overhead.mount.pose
        for frame in frames:
            tracker, image, hand = self._made(bench, kind, weights), read_image(frame.file), None
            for number in range(LOOKS):
                hand = tracker.track(Frame("overhead", number, number / bench.overhead.rate_hz, image, pose))
            seen = [each for each in (hand, *tracker.others) if each is not None]
            palms = [(*each.palm_m, each.height_m or 0.0) for each in seen]
            pixels = camera.project(pose, np.array(palms).reshape(-1, 3))
            inside = [[_within(pixel, labelled.box_px) for pixel in pixels] for labelled in frame.row.hands]
            for each in inside:
                counter.add("found", any(each))
            false = sum(not any(column) for column in zip(*inside, strict=True)) if inside else len(pixels)
            counter.measure("false_per_picture", float(false))
        return counter.scores()

    def _actions(self, segments: Segments) -> Scores:
        classes, perception = Classes.of(self.product), self.configuration.perception
        path = self.weights or perception.with_detector("actions", self.kind, None).weights("actions")
        network = OnnxModel.load(path, f"actions.{self.kind}")
        posterior, _ = answers(network, segments, SegmentReader(self.configuration.bench, self.product))
        commonest = float(np.bincount(segments.classes).max()) / len(segments)
        return {**class_scores(segments, posterior, classes), f"accuracy{TRIVIAL}": round(commonest, 4)}


def load(task: str, folders: Sequence[Path], product: Product, rate_hz: float) -> Sequence[Any] | Segments:
    """The labelled pictures or segments of some folders.

    Raises:
        InputError: a file is missing or wrong, with file and line.
    """
    if task == "holes":
        return load_plates(folders, product)
    if task == "parts":
        return load_scenes(folders, product)
    if task == "hands":
        return [frame for folder in folders for frame in frames_of(folder, tuple(product.parts))]
    return load_segments(folders, Classes.of(product), rate_hz)


def as_taken(bench: Bench, camera: str, still: Still) -> Bench:
    """The bench with the lens, and the place of a fixed camera, that a picture was truly taken with."""
    setup = bench.overhead if camera == "overhead" else bench.wrist
    pose, lens = still.world_from_camera, still.camera
    hangs = Mount(position_m=pose.position_m, quaternion_wxyz=pose.quaternion_wxyz)
    found = CameraCalibration.model_construct(
        mount=hangs if camera == "overhead" else setup.mount,
        **{name: value for name, value in asdict(lens).items() if name in CameraCalibration.model_fields},
    )
    return bench.model_copy(update={camera: setup.calibrated(found)})


def objection(scores: Mapping[str, float]) -> str | None:
    """Why weights are not worth use, by their scores; None where nothing speaks against them."""
    for name, other in scores.items():
        for suffix, whose in ((CLASSICAL, "the classical detector"), (TRIVIAL, "the commonest answer")):
            if not name.endswith(suffix):
                continue
            own = scores.get(name.removesuffix(suffix), 0.0)
            if own <= 0:
                return f"{name.removesuffix(suffix)} is 0: they answer nothing right"
            if own < other:
                return f"{name.removesuffix(suffix)} is {own:.3f}, and {whose} has {other:.3f} on the same pictures"
            if own < POOR.get(name.removesuffix(suffix), 0.0):
                return f"{name.removesuffix(suffix)} is {own:.3f} alone, which is poor: {MORE}"
    if scores.get("validation_said", 1.0) <= 0:
        return "they answer nothing"
    return None


def note(weights: Path, scores: Mapping[str, float]) -> None:
    """Write scores on a user's own pictures onto the card of weights."""
    note_scores(weights, {f"{PICTURES}{name}": round(value, 4) for name, value in scores.items()})


def apart(logs: Collection[str], share: float, seed: int) -> set[str]:
    """Recordings that are kept for the scores.

    Raises:
        InputError: there is one alone.
    """
    names = sorted(set(logs))
    if len(names) < 2:
        raise InputError(f"{len(names)} recording alone; 2 are needed: one is kept for the scores")
    count = max(1, round(share * len(names)))
    return {names[index] for index in np.random.default_rng([seed, 3]).permutation(len(names))[:count]}


def _within(pixel: Any, box: tuple[float, ...]) -> bool:
    left, top, right, bottom = box
    return bool(left <= pixel[0] <= right and top <= pixel[1] <= bottom)
