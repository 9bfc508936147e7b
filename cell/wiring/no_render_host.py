"""The place for detectors of a simulated cell that renders nothing: they answer from `ground_truth_perception`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar, cast

from cell.interfaces.devices import Devices
from cell.interfaces.perception import Frame, PartsView
from cell.wiring.detectors import bench_watcher
from learned.bench_watcher import ClassicalDetectors, DetectorChain

if TYPE_CHECKING:
    from sim.cell import SimCell
    from sim.truth.ground_truth_perception import GroundTruthPerception

Answer = TypeVar("Answer")


class NoRenderHost:
    """Implements `DetectorHost`: hands, holes and parts come from the truth; actions are detected from these."""

    def __init__(self, sight: GroundTruthPerception) -> None:
        self._sight = sight

    def host(
        self, build: Callable[..., Callable[[Frame], Answer]], *arguments: object
    ) -> Callable[[Frame], Callable[[], Answer]]:
        """What answers frames in place of what `build` would make."""
        detect = cast("Callable[[Frame], Answer]", self._watch(*arguments) if build is bench_watcher else self._find)

        def submit(frame: Frame) -> Callable[[], Answer]:
            answer = detect(frame)
            return lambda: answer

        return submit

    def _watch(self, bench: Any, product: Any, perception: Any) -> Callable[[Frame], object]:
        actions = ClassicalDetectors(bench, product, perception.classical).actions()  # others look at images
        return DetectorChain(bench, product, self._sight, self._sight, actions).watch

    def _find(self, frame: Frame) -> PartsView:
        return PartsView(frame.sequence, frame.time_s, self._sight.detect(frame))


def without_pixels(cell: SimCell) -> Devices:
    """The devices of a cell that was opened with `rendered=False`."""
    assert cell.sight is not None
    return replace(cell.devices, host=NoRenderHost(cell.sight))
