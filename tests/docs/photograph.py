"""docs/cell.png: a portrait of the cell in the middle of a run; docs/looks.png: a contact sheet of looks."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.configuration import load_configuration, load_product
from cell.observer import TickRecord
from sim.look_range import look_range
from sim.look_sheet import look_sheet
from sim.portrait import portrait
from sim.world import World
from tests.integration.cell_rig import ASSEMBLE, Diary, run_tree, with_person

GOAL, SEED, TIME_S = "g0", 1, 27.2
WIDTH_PX, HEIGHT_PX = 1200, 675


class Photographer(Diary):
    """A diary that takes one picture."""

    def __init__(self, world: World, time_s: float) -> None:
        super().__init__()
        self._world, self._time_s = world, time_s
        self.image: NDArray[np.uint8] | None = None

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        if record.observation.time_s >= self._time_s and self.image is None:
            self.image = portrait(self._world, WIDTH_PX, HEIGHT_PX)


def photograph(time_s: float = TIME_S) -> NDArray[np.uint8]:
    """The cell (height, width, RGB) at this time of one assembly.

    Raises:
        ValueError: the run ends before.
    """
    with with_person(GOAL, SEED) as cell:
        diary = Photographer(cell.world, time_s)
        run_tree(cell, ASSEMBLE, diary=diary)
    if diary.image is None:
        raise ValueError(f"the run of {GOAL} with seed {SEED} ends before {time_s} s")
    return diary.image


def look_sheet_of(seeds: Mapping[str, int]) -> NDArray[np.uint8]:
    """So many seeds of each look."""
    configuration = load_configuration()
    product, simulation = load_product(configuration), configuration.devices.simulation
    looks = [(look_range(name), seed) for name, count in seeds.items() for seed in range(count)]
    return look_sheet(product, configuration.bench, simulation, looks)


def png(image: NDArray[np.uint8]) -> bytes:
    """An image as a PNG file."""
    return cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes()
