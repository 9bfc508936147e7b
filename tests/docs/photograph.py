"""docs/cell.png: a portrait of the cell in the middle of a run."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.watching.observer import TickRecord
from bracket_sim.scene.world import World
from tests.docs.portrait import portrait
from tests.integration.cell_rig import ASSEMBLE, Recorded, run_tree, with_person

GOAL, SEED = "g0", 1
MOMENT, AFTER_S = "lowering o3", 0.24  # what the robot says that it does, and so long after it begins
WIDTH_PX, HEIGHT_PX = 1200, 675


class Photographer(Recorded):
    """A recorded that takes one picture: `after_s` after a skill says that it begins with this."""

    def __init__(self, world: World, moment: str, after_s: float) -> None:
        super().__init__()
        self._world, self._moment, self._after_s = world, moment, after_s
        self._due_s = math.inf
        self.image: NDArray[np.uint8] | None = None

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        time_s = record.observation.time_s
        if any(topic == "skill" and fields.get("reason") == self._moment for topic, fields in record.notes):
            self._due_s = min(self._due_s, time_s + self._after_s)
        if time_s >= self._due_s and self.image is None:
            self.image = portrait(self._world, WIDTH_PX, HEIGHT_PX)


def photograph(moment: str = MOMENT, after_s: float = AFTER_S) -> NDArray[np.uint8]:
    """The cell (height, width, RGB) at this moment of one assembly.

    Raises:
        ValueError: the robot does not do that in this run.
    """
    with with_person(GOAL, SEED) as cell:
        recorded = Photographer(cell.world, moment, after_s)
        run_tree(cell, ASSEMBLE, recorded=recorded)
    if recorded.image is None:
        raise ValueError(f"in the run of {GOAL} with seed {SEED} nothing says '{moment}'")
    return recorded.image


def png(image: NDArray[np.uint8]) -> bytes:
    """An image as a PNG file."""
    return cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes()
