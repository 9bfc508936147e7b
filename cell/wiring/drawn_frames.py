"""Frames of the simulated cell without a run: an assembly from above, and trays."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from cell.configuration import Configuration
from cell.interfaces.perception import Frame
from cell.interfaces.product import Product
from learned.parts.data import Scene, load_scenes
from sim.data.folder import DataFolder
from sim.data.hands import hand_frames
from sim.data.objects import write_objects
from sim.data.recording import Source, record
from sim.data.splits import mixed_clutter, sometimes_steel


def overhead_frames(configuration: Configuration, product: Product, seed: int) -> Iterator[Frame]:
    """The person alone before the overhead camera."""
    taken = record(product, configuration.bench, configuration.devices.simulation, seed)
    source = Source(taken, product, configuration.bench)
    for seen in hand_frames(source, [range(len(taken.moments))]):
        yield seen.frame


def tray_scenes(
    configuration: Configuration, product: Product, seeds: Sequence[int], *, mixed: bool, steel_share: float = 0.0
) -> list[Scene]:
    """What the wrist camera sees of one tray for each seed, and what is true of it.

    Args:
        mixed: some parts lie or are stacked, some objects are unknown.
    """
    settings = configuration.devices.simulation
    with tempfile.TemporaryDirectory(prefix="cell-trays-") as name:
        folder = DataFolder(Path(name) / "objects", "trays")
        for seed in seeds:
            clutter = mixed_clutter(settings.clutter, seed) if mixed else settings.clutter
            simulation = settings.model_copy(update={"clutter": clutter})
            write_objects(sometimes_steel(product, steel_share, seed), configuration.bench, simulation, seed, folder)
        return load_scenes([Path(name) / "objects"], product)
