"""Classical perception as a whole: its three detectors of overhead frames share one model of colours."""

from __future__ import annotations

from functools import cached_property

from cell.interfaces.bench import Bench
from cell.interfaces.product import Product
from learned.bench_watcher import DetectorChain
from learned.classical.action_detector import ClassicalActionDetector
from learned.classical.colour import ColourModel
from learned.classical.hand_tracker import ClassicalHandTracker
from learned.classical.hole_reader import ClassicalHoleReader
from learned.classical.part_detector import ClassicalPartDetector
from learned.classical.settings import PerceptionSettings


class ClassicalDetectors:
    """Makes the classical detectors of a bench, each when it is asked for.

    Where trained ones are chosen for everything, the product's colours may be any.
    """

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings) -> None:
        self._bench, self._product, self._settings = bench, product, settings

    @cached_property
    def _colours(self) -> ColourModel:
        """Raises SettingError where the product's colours are too pale or too much alike."""
        return ColourModel(self._product, self._settings.skin_rgb)

    def hands(self) -> ClassicalHandTracker:
        """Finds the hand by its colour."""
        return ClassicalHandTracker(self._bench, self._product, self._settings, self._colours)

    def holes(self) -> ClassicalHoleReader:
        """Reads the holes by the parts' colours."""
        return ClassicalHoleReader(self._bench, self._product, self._settings, self._colours)

    def actions(self) -> ClassicalActionDetector:
        """Names actions by what changed in the holes."""
        return ClassicalActionDetector(self._bench, self._product, self._settings)

    def parts(self) -> ClassicalPartDetector:
        """Finds parts by their colours and outlines."""
        return ClassicalPartDetector(self._bench, self._product, self._settings)


def classical_bench_watcher(
    bench: Bench, product: Product, settings: PerceptionSettings | None = None
) -> DetectorChain:
    """The three detectors of overhead frames, one after the other."""
    detectors = ClassicalDetectors(bench, product, settings or PerceptionSettings())
    return DetectorChain(bench, product, detectors.hands(), detectors.holes(), detectors.actions())
