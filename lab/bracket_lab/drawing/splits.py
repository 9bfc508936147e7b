"""Which seeds are for training, which for validation and which for tests; no seed is in two of them."""

from __future__ import annotations

import numpy as np

from bracket_ground.errors import InputError
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.settings import ClutterSettings

MOST_FOREIGN = 2
LYING_SHARE, STACKED_SHARE = 0.2, 0.06  # of the parts in a mixed tray
STEEL_LEVELS = (0.40, 0.58)  # grey of bare steel, drawn for each type
TINT = 0.02
CLUTTER_STREAM, STEEL_STREAM = 6, 7
SPLITS = {"train": range(800_000), "validation": range(800_000, 900_000), "test": range(900_000, 1_000_000)}


def mixed_clutter(
    settings: ClutterSettings, seed: int, lying_share: float = LYING_SHARE, stacked_share: float = STACKED_SHARE
) -> ClutterSettings:
    """Trays in which some parts lie, some are on top of others, and up to MOST_FOREIGN objects are of no type."""
    foreign = int(np.random.default_rng([seed, CLUTTER_STREAM]).integers(MOST_FOREIGN + 1))
    mixed = {"lying_share": lying_share, "stacked_share": stacked_share, "foreign_objects": foreign}
    return settings.model_copy(update=mixed)


def sometimes_steel(product: Product, share: float, seed: int) -> Product:
    """The product in bare steel with this probability, and as it is otherwise; shapes stay what they are."""
    rng = np.random.default_rng([seed, STEEL_STREAM])
    if rng.random() >= share:
        return product
    parts = {}
    for name, kind in product.parts.items():
        red, green, blue = (float(level) for level in rng.uniform(*STEEL_LEVELS) + rng.uniform(-TINT, TINT, 3))
        parts[name] = kind.model_copy(update={"colour_rgb": (red, green, blue), "finish": "steel"})
    return product.model_copy(update={"parts": parts})


def seeds(first_seed: int, recordings: int) -> tuple[str, range]:
    """The split of a number of seeds in a row, and the seeds.

    Raises:
        InputError: they are not all of one split.
    """
    asked = range(first_seed, first_seed + recordings)
    for name, split in SPLITS.items():
        if asked and asked[0] in split and asked[-1] in split:
            return name, asked
    legal = ", ".join(f"{name} {split[0]} to {split[-1]}" for name, split in SPLITS.items())
    raise InputError(f"seeds {first_seed} to {first_seed + recordings - 1} are not of one split; legal: {legal}")
