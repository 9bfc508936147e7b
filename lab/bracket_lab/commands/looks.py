"""`cell lab looks`: what the simulated cell may look like, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from numpy.typing import NDArray

from bracket_cell.commands.options import CONFIGURATION, ConfigOption
from bracket_cell.commands.terminal import console
from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import Camera
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.look_range import LookRange, look_range, presets
from bracket_sim.scene.settings import SimSettings, settings_of

WORK_S = 3.2  # by then the first part is on its way
TILE_PX = (208, 156)
COLUMNS = 3
GAP_PX = 6
PATIENCE_S = 10.0
PAPER, INK = 32, (255, 255, 255)
Image = NDArray[np.uint8]


def looks(
    names: Annotated[
        list[str] | None, typer.Argument(help="Presets, PRESET:SECTION or look files; all presets by default.")
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Draw what the cameras see into this PNG file.")] = None,
    seeds: Annotated[int, typer.Option(min=1, max=100, help="Seeds of each look to draw.")] = 3,
    config: ConfigOption = CONFIGURATION,
) -> None:
    """List or draw what the simulation may look like."""
    chosen = [look_range(name) for name in names or presets()]
    if png is None:
        for look in chosen:
            console().print(look.name, highlight=False)
        return
    if png.is_dir() or not png.parent.is_dir():
        raise InputError(f"{png}: cannot be written: it must be a file in a folder that exists")

    configuration = load_configuration(config)
    product = load_product(configuration, config)
    wanted = [(look, seed) for look in chosen for seed in range(seeds)]
    write_png(png, look_sheet(product, configuration.bench, settings_of(configuration.devices.simulation), wanted))


def look_sheet(product: Product, bench: Bench, settings: SimSettings, looks: Sequence[tuple[LookRange, int]]) -> Image:
    """One tile for each (look, seed): overhead view on the left, wrist view on the right; RGB.

    Args:
        settings: of the simulated cell, but for the look.
    """
    seldom = bench.overhead.model_copy(update={"rate_hz": 1 / WORK_S})  # frames that nobody looks at cost most
    working = bench.model_copy(update={"overhead": seldom})
    looking = working.model_copy(update={"arm_park_rad": bench.arm_look_rad})
    tiles = []
    for number, (look, seed) in enumerate(looks):
        changed = settings.model_copy(update={"look": look})
        frames = []
        for camera, place in (("overhead", working), ("wrist", looking)):
            cell = SimCell(product, place, changed, "virtual", f"sheet-{number}", seed, "random")
            try:
                if camera == "overhead":
                    cell.devices.clock.sleep_until(WORK_S / 2)
                frames.append(_frame(cell, getattr(cell.devices, camera)))
            finally:
                cell.close()
        tiles.append(_tile(f"{look.name} {seed}", *frames))
    return _grid(tiles)


def write_png(path: Path, image: Image) -> None:
    """Write an RGB image; raises InputError where that cannot be done."""
    try:
        path.write_bytes(cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _frame(cell: SimCell, camera: Camera) -> Frame:
    """The next frame that comes; of a triggered camera too."""
    clock, before = cell.devices.clock, camera.latest()
    end_s = clock.now_s() + PATIENCE_S
    while (frame := camera.latest()) is None or frame is before:
        assert clock.now_s() < end_s, "no frame comes"
        camera.trigger()
        clock.sleep_until(clock.now_s() + cell.world.physics.control_period_s)
    return frame


def _tile(title: str, overhead: Frame, wrist: Frame) -> Image:
    pair = np.hstack([cv2.resize(frame.image, TILE_PX, interpolation=cv2.INTER_AREA) for frame in (overhead, wrist)])
    cv2.putText(pair, title, (7, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(pair, title, (7, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return pair.astype(np.uint8, copy=False)


def _grid(tiles: Sequence[Image]) -> Image:
    height, width = tiles[0].shape[0] + GAP_PX, tiles[0].shape[1] + GAP_PX
    rows = -(-len(tiles) // COLUMNS)
    sheet = np.full((rows * height + GAP_PX, min(COLUMNS, len(tiles)) * width + GAP_PX, 3), PAPER, np.uint8)
    for number, tile in enumerate(tiles):
        top, left = GAP_PX + number // COLUMNS * height, GAP_PX + number % COLUMNS * width
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet
