"""The place for detectors of a simulated cell that renders nothing: they answer from `ground_truth_perception`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from bracket_cell.configuration import Configuration
from bracket_cell.learned.bench_watcher import ClassicalDetectors, DetectorChain
from bracket_cell.settings import Perception
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_ground.interfaces.product import Product

if TYPE_CHECKING:
    from bracket_sim.cell import SimCell
    from bracket_sim.truth.ground_truth_perception import GroundTruthPerception


class NoRenderHost:
    """Implements `DetectorHost`: hands, holes and parts come from the truth; actions are detected from these."""

    def __init__(self, sight: GroundTruthPerception, bench: Bench, product: Product, perception: Perception) -> None:
        actions = ClassicalDetectors(bench, product, perception.classical).actions()  # others look at images
        self._sight, self._watch = sight, DetectorChain(bench, product, sight, sight, actions, sight.spots).watch

    def await_ready(self) -> None:
        """They are."""

    def begin(self, frame: Frame) -> Callable[[], BenchView | PartsView]:
        """The answer is there at once."""
        answer = self._watch(frame.beside(None)) if frame.camera == "overhead" else self._find(frame)  # no arm is seen
        return lambda: answer

    def _find(self, frame: Frame) -> PartsView:
        return PartsView(frame.sequence, frame.time_s, self._sight.detect(frame))


def without_pixels(cell: SimCell, configuration: Configuration, product: Product) -> Devices:
    """The devices of a cell that was opened with `rendered=False`, for a controller with this configuration."""
    assert cell.sight is not None
    host = NoRenderHost(cell.sight, configuration.bench, product, configuration.perception)
    return replace(cell.devices, host=host, images=False)
