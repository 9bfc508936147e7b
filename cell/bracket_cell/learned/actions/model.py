"""Names what the hand does by a trained network (detector(I, s) of Algorithm 1); runs in onnxruntime."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from bracket_cell.learned.actions.events import EventSettings, Floats, Placement, PlacementEvents, SteadyKind
from bracket_cell.learned.actions.hole_events import DroppedParts, FilledHoles, seen_unfilled
from bracket_cell.learned.actions.segments import SegmentReader, known_features, posterior_of
from bracket_cell.learned.actions.settings import WHOLE_FRAMES, Classes
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import Action, HoleView, Segment
from bracket_ground.interfaces.product import Product

LEAST_TOLD = 0.005  # classes less probable than this are not listed in an action's posterior


class TrainedActionDetector:
    """Asks a network about every segment and turns its posteriors into actions (ActionDetector).

    Attributes:
        last_posterior: (classes,) of the last segment alone; an action is made of several.
        last_released: probability that the fingers have opened, of the same.
        settings: when a placement is reported.
    """

    def __init__(self, bench: Bench, product: Product, network: OnnxModel) -> None:
        self._classes = Classes.of(product)
        network.require_vocabulary("parts", self._classes.parts)
        network.require_vocabulary("positions", self._classes.positions)
        self._network = network
        self._whole_frames = network.card.kind.removeprefix("actions.") in WHOLE_FRAMES
        self._reader = SegmentReader(bench, product)
        self.settings = settings = EventSettings.model_validate(network.card.config.get("events", {}))
        self._report_s = settings.report_s
        self._events = PlacementEvents(self._classes, settings)
        self._filled = FilledHoles(self._classes, settings.shown_reads, settings.shown_confidence)
        self._dropped = DroppedParts(self._classes, self._reader.holes_m)
        self._kind = SteadyKind(self._classes, settings)
        self._placed: list[Placement] = []
        self.last_posterior: Floats = np.zeros(len(self._classes.names))
        self.last_released = 0.0

    def detect(self, segment: Segment, holes: Mapping[str, HoleView]) -> Action:
        """The action that the segment shows; a hole newly filled where the hand placed something confirms it."""
        now_s = segment.frames[-1].time_s
        posterior, released = self.posterior(segment)
        self.last_posterior, self.last_released = posterior, released
        filled = list(self._filled.update(holes))
        unfilled = seen_unfilled(self._classes, holes, now_s) | self._filled.long_full(now_s)
        hand = segment.hands[-1]
        dropped = self._dropped.update(now_s, hand, holes)
        holds = None if hand is None or hand.held_part is None else self._classes.parts.index(hand.held_part)
        placed = self._events.update(now_s, posterior, released, filled, unfilled, dropped, holds)
        if placed is not None:
            self._placed.append(placed)
        number, mean = self._kind.update(posterior)
        self._placed = [placement for placement in self._placed if now_s - placement.time_s < self._report_s]
        if self._placed:
            return self._finished(self._placed[0])
        return replace(self._classes.action(number, float(mean[number])), posterior=self._told(mean))

    def posterior(self, segment: Segment) -> tuple[Floats, float]:
        """(classes,) how probable each class is, and that the fingers have opened."""
        if self._whole_frames:
            found = self._network.run({"frames": self._reader.frames(segment)[np.newaxis]})
        else:
            asked = self._reader.read(segment)
            track = known_features(self._network.card, asked.track[np.newaxis])
            found = self._network.run({"track": track, "crops": asked.crops[np.newaxis]})
        return posterior_of(found["logits"][0]), float(1.0 / (1.0 + np.exp(-found["released"][0])))

    def _finished(self, placed: Placement) -> Action:
        part, position = self._classes.parts[placed.part], self._classes.positions[placed.position]
        fields = {
            f"{name} at {position}": share for name, share in zip(self._classes.parts, placed.posterior, strict=True)
        }
        sure = placed.posterior[placed.part]
        return Action("assembly", sure, part, position, finished=True, posterior=fields, shown=placed.shown)

    def _told(self, posterior: Floats) -> dict[str, float]:
        shares = zip(self._classes.names, posterior, strict=True)
        return {name: round(float(share), 4) for name, share in shares if share > LEAST_TOLD}


def load_actions(bench: Bench, product: Product, weights: Path, kind: str = "slim") -> TrainedActionDetector:
    """The detector of a file of weights.

    Raises:
        ModelError: the file is missing, damaged, of another kind, or was trained for another product.
    """
    return TrainedActionDetector(bench, product, OnnxModel.load(weights, f"actions.{kind}"))
